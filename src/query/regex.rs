//! Regular expressions as MongoDB reads them (PCRE, UTF-8).

use pcre2::bytes::{Regex, RegexBuilder};

use super::error::{QueryError, Result};

/// The longest pattern that is compiled.
const MAX_PATTERN: usize = 32_764;

/// A compiled pattern with the text it was made from.
#[derive(Debug, Clone)]
pub(super) struct Pattern {
    /// The source.
    pub(super) pattern: String,
    /// The options.
    pub(super) options: String,
    compiled: Regex,
}

/// The groups of a match, the whole first, as byte offsets; a group may have no part in it.
pub(super) type Groups = Vec<Option<(usize, usize)>>;

impl Pattern {
    /// Compiles a pattern with options out of `imsxu`.
    ///
    /// # Errors
    /// If the pattern or an option is not acceptable.
    pub(super) fn new(pattern: &str, options: &str) -> Result<Self> {
        if pattern.contains('\0') || options.contains('\0') {
            return Err(QueryError::bad_value("a regular expression cannot contain a NUL"));
        }
        if pattern.len() > MAX_PATTERN {
            return Err(QueryError::invalid(51_091, "the regular expression is too long"));
        }
        if let Some(wrong) = options.chars().find(|option| !"imsxu".contains(*option)) {
            return Err(QueryError::invalid(51_108, format!("invalid flag in regex options: {wrong}")));
        }
        let compiled = builder(options).build(pattern).map_err(|error| {
            let message = format!("regular expression is invalid: {error}");
            QueryError::invalid(51_091, message).about(&format!("/{pattern}/"))
        })?;
        Ok(Self { pattern: pattern.to_owned(), options: options.to_owned(), compiled })
    }

    /// The same pattern, for a text in which it is looked for many times.
    ///
    /// Each time, PCRE2 looks first whether all of the text is UTF-8, so that many matches in a long text would take the
    /// square of its length. It does not where the pattern says that the text may be anything, which this crate says along with
    /// `UCP`; `(?a)` takes back that classes as `\w` are Unicode's. PCRE2 before 10.43 does not know that: then the pattern
    /// stays as it is, as one does that begins with settings of its own, `(*UCP)`, or unsets this one.
    pub(super) fn repeated(self) -> Self {
        let unsets = |flags: &str| {
            let flags = flags.trim_start_matches(|flag: char| flag.is_ascii_alphabetic());
            let unset = flags.strip_prefix('-').unwrap_or_default();
            unset.chars().take_while(char::is_ascii_alphabetic).any(|flag| flag == 'a')
        };
        // PCRE2 does not take these back.
        let has_borders = ["[[:<:]]", "[[:>:]]"].iter().any(|border| self.pattern.contains(border));
        if has_borders || self.pattern.starts_with("(*") || self.pattern.split("(?").skip(1).any(unsets) {
            return self;
        }
        match builder(&self.options).ucp(true).build(&format!("(?a){}", self.pattern)) {
            Ok(compiled) => Self { compiled, ..self },
            Err(_) => self,
        }
    }

    /// Returns whether the pattern is found; what exceeds the matcher's limits is not.
    pub(super) fn is_match(&self, text: &str) -> bool {
        self.compiled.is_match(text.as_bytes()).unwrap_or(false)
    }

    /// Returns the groups of the first match at or after a byte offset: the whole first.
    ///
    /// # Errors
    /// If the matcher's limits are exceeded.
    pub(super) fn groups(&self, text: &str, from: usize) -> Result<Option<Groups>> {
        let mut locations = self.compiled.capture_locations();
        let found = self
            .compiled
            .captures_read_at(&mut locations, text.as_bytes(), from)
            .map_err(|error| QueryError::invalid(51_156, format!("regular expression failed: {error}")))?;
        Ok(found.map(|_| (0..locations.len()).map(|index| locations.get(index)).collect()))
    }
}

fn builder(options: &str) -> RegexBuilder {
    let mut builder = RegexBuilder::new();
    builder
        .utf(true)
        .jit_if_available(true)
        .caseless(options.contains('i'))
        .multi_line(options.contains('m'))
        .dotall(options.contains('s'))
        .extended(options.contains('x'));
    builder
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pattern_for_many_matches_finds_the_same() {
        let text = "Ab1 é\u{e9} ſS\u{212a}k _ß\u{a0}\u{663}\tσςΣ\r\nx\u{2028}aa-aa  日本 ١2 İi̇ ";
        let patterns = [
            r"\w",
            r"\W+",
            r"\d",
            r"\D",
            r"\s",
            r"\S+",
            r"\b",
            r"\B",
            r"[[:alpha:]]+",
            r"[[:^digit:]]",
            r"[[:<:]]",
            r"[[:>:]]",
            r"[[:punct:]]",
            r"[[:graph:]]+",
            r"[[:xdigit:]]",
            r"[[:space:]]",
            r"[\w-]+",
            r"[^\W_]",
            r"\h",
            r"\v",
            r"\R",
            r"\X",
            r"\p{L}+",
            r"\P{Lu}",
            "s",
            "k",
            "é",
            "σ",
            "i",
            "^.",
            ".$",
            "(a)(b)?",
            r"(?<=a)a",
            r"(.)\1",
            "",
            "x*",
            r"(?i)ß",
            r"(?^)\w",
            r"(?-a:\w)",
            r"(?i-sa)\w",
            r"(*UCP)\w",
            r"\x{e9}",
            r"[à-ü]",
            r"\N{U+e9}",
            r"a|\Z",
        ];
        for pattern in patterns {
            for options in ["", "i", "m", "s", "x", "imsx"] {
                let Ok(plain) = Pattern::new(pattern, options) else { continue };
                let repeated = plain.clone().repeated();
                for from in (0..=text.len()).filter(|from| text.is_char_boundary(*from)) {
                    let found = [&plain, &repeated].map(|pattern| pattern.groups(text, from).unwrap());
                    assert_eq!(found[0], found[1], "/{pattern}/{options} from {from}");
                }
            }
        }
    }
}
