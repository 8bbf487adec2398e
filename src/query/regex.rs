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
        let mut builder = RegexBuilder::new();
        builder
            .utf(true)
            .jit_if_available(true)
            .caseless(options.contains('i'))
            .multi_line(options.contains('m'))
            .dotall(options.contains('s'))
            .extended(options.contains('x'));
        let compiled = builder.build(pattern).map_err(|error| {
            let message = format!("regular expression is invalid: {error}");
            QueryError::invalid(51_091, message).about(&format!("/{pattern}/"))
        })?;
        Ok(Self { pattern: pattern.to_owned(), options: options.to_owned(), compiled })
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
