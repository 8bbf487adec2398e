//! A look at brackets, strings and comments that needs no stack: where a value
//! ends, and how deep it nests.

/// How deep documents and arrays may nest.
pub const MAX_DEPTH: usize = 200;

/// Follows a text byte by byte.
#[derive(Debug, Clone)]
pub(super) struct Scanner {
    depth: usize,
    inside: Inside,
    /// The last byte outside of strings and comments that is not white space.
    before: u8,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Inside {
    Code,
    /// After a slash that may open a comment or a regular expression.
    Slash,
    Text(u8),
    Escape(u8),
    LineComment,
    BlockComment,
    /// After a star in a block comment.
    Star,
    Regex,
    RegexEscape,
    Class,
    ClassEscape,
}

impl Scanner {
    pub(super) fn new() -> Self {
        Self { depth: 0, inside: Inside::Code, before: b',' }
    }

    /// How many brackets are open.
    pub(super) fn depth(&self) -> usize {
        self.depth
    }

    /// Whether the position is outside of strings, comments and regular expressions.
    pub(super) fn in_code(&self) -> bool {
        matches!(self.inside, Inside::Code)
    }

    /// How many of the bytes that come next change nothing: the inside of a string or of a comment.
    pub(super) fn idle(&self, rest: &[u8]) -> usize {
        let found = match self.inside {
            Inside::Text(quote) => memchr::memchr3(quote, b'\\', b'\n', rest),
            Inside::LineComment => memchr::memchr(b'\n', rest),
            Inside::BlockComment => memchr::memchr(b'*', rest),
            _ => return 0,
        };
        found.unwrap_or(rest.len())
    }

    /// Takes the next byte.
    pub(super) fn step(&mut self, byte: u8) {
        self.inside = match self.inside {
            Inside::Code => self.code(byte),
            Inside::Slash => self.slash(byte),
            Inside::Text(quote) => match byte {
                b'\\' => Inside::Escape(quote),
                b'\n' => Inside::Code,
                _ if byte == quote => Inside::Code,
                _ => Inside::Text(quote),
            },
            Inside::Escape(quote) => Inside::Text(quote),
            Inside::LineComment if byte == b'\n' => Inside::Code,
            Inside::LineComment => Inside::LineComment,
            Inside::BlockComment | Inside::Star if byte == b'*' => Inside::Star,
            Inside::Star if byte == b'/' => Inside::Code,
            Inside::BlockComment | Inside::Star => Inside::BlockComment,
            Inside::Regex => match byte {
                b'/' | b'\n' => Inside::Code,
                b'\\' => Inside::RegexEscape,
                b'[' => Inside::Class,
                _ => Inside::Regex,
            },
            Inside::RegexEscape if byte == b'\n' => Inside::Code,
            Inside::RegexEscape => Inside::Regex,
            Inside::Class => match byte {
                b']' => Inside::Regex,
                b'\\' => Inside::ClassEscape,
                b'\n' => Inside::Code,
                _ => Inside::Class,
            },
            Inside::ClassEscape if byte == b'\n' => Inside::Code,
            Inside::ClassEscape => Inside::Class,
        };
    }

    fn code(&mut self, byte: u8) -> Inside {
        match byte {
            b'/' => return Inside::Slash,
            b' ' | b'\t' | b'\r' | b'\n' => return Inside::Code,
            b'{' | b'[' | b'(' => self.depth += 1,
            b'}' | b']' | b')' => self.depth = self.depth.saturating_sub(1),
            _ => {}
        }
        self.before = byte;
        if matches!(byte, b'"' | b'\'') { Inside::Text(byte) } else { Inside::Code }
    }

    /// A regular expression can only stand where a value can.
    fn slash(&mut self, byte: u8) -> Inside {
        match byte {
            b'/' => Inside::LineComment,
            b'*' => Inside::BlockComment,
            _ if matches!(self.before, b':' | b',' | b'[' | b'(') => {
                self.before = b'/';
                match byte {
                    b'\\' => Inside::RegexEscape,
                    b'[' => Inside::Class,
                    b'\n' => Inside::Code,
                    _ => Inside::Regex,
                }
            }
            _ => self.code(byte),
        }
    }
}

/// The length of the string that `text` starts with, its quotes included; `None` if it has no end on its line.
pub(super) fn string_end(text: &str) -> Option<usize> {
    let bytes = text.as_bytes();
    let quote = *bytes.first()?;
    let mut at = 1;
    loop {
        at += memchr::memchr3(quote, b'\\', b'\n', bytes.get(at..)?)?;
        match bytes.get(at)? {
            b'\\' => at += 2,
            b'\n' => return None,
            _ => return Some(at + 1),
        }
    }
}

/// The length of the regular expression that `text` starts with, without its options.
pub(super) fn regex_end(text: &str) -> Option<usize> {
    let (mut class, mut escaped) = (false, false);
    for (at, byte) in text.bytes().enumerate().skip(1) {
        match byte {
            b'\n' => return None,
            _ if escaped => escaped = false,
            b'\\' => escaped = true,
            b'[' => class = true,
            b']' => class = false,
            b'/' if !class => return Some(at + 1),
            _ => {}
        }
    }
    None
}

/// Where the bracketed value that starts at `start` ends; the end of the text if it does not.
pub(super) fn value_end(text: &str, start: usize) -> Result<usize, usize> {
    let mut scanner = Scanner::new();
    let bytes = text.as_bytes();
    let mut at = start;
    while let Some(byte) = bytes.get(at).copied() {
        scanner.step(byte);
        if scanner.depth() > MAX_DEPTH {
            return Err(at);
        }
        at += 1;
        if scanner.depth() == 0 && scanner.in_code() && matches!(byte, b'}' | b']' | b')') {
            return Ok(at);
        }
        at += scanner.idle(bytes.get(at..).unwrap_or_default());
    }
    Ok(text.len())
}

/// The offset of the first bracket that is too deep.
pub(super) fn too_deep(text: &str) -> Option<usize> {
    let mut scanner = Scanner::new();
    let bytes = text.as_bytes();
    let mut at = 0;
    while let Some(byte) = bytes.get(at).copied() {
        scanner.step(byte);
        if scanner.depth() > MAX_DEPTH {
            return Some(at);
        }
        at += 1;
        at += scanner.idle(bytes.get(at..).unwrap_or_default());
    }
    None
}

/// The first offset from `start` on that is no white space, comment or byte in `also`.
pub(super) fn skip(text: &str, start: usize, also: &[u8]) -> usize {
    let bytes = text.as_bytes();
    let mut offset = start;
    while let Some(rest) = text.get(offset..).filter(|rest| !rest.is_empty()) {
        if rest.starts_with("//") {
            offset += rest.find('\n').unwrap_or(rest.len());
        } else if rest.starts_with("/*") {
            match memchr::memmem::find(rest.as_bytes(), b"*/") {
                Some(end) => offset += end + 2,
                None => return offset,
            }
        } else if rest.starts_with('\u{FEFF}') {
            offset += '\u{FEFF}'.len_utf8();
        } else if rest.starts_with('\u{A0}') {
            offset += '\u{A0}'.len_utf8();
        } else if bytes.get(offset).is_some_and(|byte| b" \t\r\n".contains(byte) || also.contains(byte)) {
            offset += 1;
        } else {
            break;
        }
    }
    offset
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_end_of_a_value_past_brackets_in_strings_comments_and_regular_expressions() {
        for text in ["{a: '}'}", "{a: \"\\\"}\"}", "{/* } */ a: 1 // }\n}", "{a: /[/}]}\\/}/}", "[{}, (1)]"] {
            assert_eq!(value_end(&format!("{text} {{}}"), 0), Ok(text.len()), "{text}");
        }
    }

    #[test]
    fn tells_depth_without_a_stack() {
        assert_eq!(too_deep(&"[".repeat(1_000_000)), Some(MAX_DEPTH));
        assert_eq!(too_deep(&"[]".repeat(1_000)), None);
    }
}
