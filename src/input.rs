//! Input: texts from files and stdin, and the two kinds of errors in what a user gives.

use crate::fault::{AtFault, Fault};
use crate::formats::{Diagnostic, Source, plain};

/// A mistake in the command line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct UsageError(String);

impl AtFault for UsageError {
    fn fault(&self) -> Fault {
        Fault::Usage
    }
}

impl UsageError {
    /// Returns an error whose text says what is wrong and what was expected.
    pub fn new(text: impl Into<String>) -> Self {
        Self(text.into())
    }
}

/// A mistake in an input as a whole, at no single place.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct WrongInput(String);

impl AtFault for WrongInput {
    fn fault(&self) -> Fault {
        Fault::Input
    }
}

impl WrongInput {
    /// Returns an error whose text says what is wrong and what was expected.
    pub fn new(text: impl Into<String>) -> Self {
        Self(text.into())
    }
}

/// Returns the error for an input that cannot be read.
pub(crate) fn unreadable(name: &str, error: &std::io::Error) -> WrongInput {
    WrongInput::new(format!("cannot read {name}: {}", plain::words(&error.to_string())))
}

/// The most bytes of a file that a program names.
#[cfg(feature = "clips-engine")]
const MOST_BYTES: u64 = 256 << 20;

/// Returns the bytes of a file that a program or a configuration names.
#[cfg(feature = "clips-engine")]
pub(crate) fn read_file(path: &std::path::Path) -> Result<Vec<u8>, WrongInput> {
    let name = path.display().to_string();
    let unread = |error| unreadable(&name, &error);
    // A device or a pipe may have no end.
    let found = std::fs::metadata(path).map_err(unread)?;
    if !found.is_file() {
        return Err(WrongInput::new(format!("cannot read {name}: it is not a file")));
    }
    if found.len() > MOST_BYTES {
        return Err(WrongInput::new(format!("cannot read {name}: it has more than {} MiB", MOST_BYTES >> 20)));
    }
    std::fs::read(path).map_err(unread)
}

/// As [`decode`], for PDDL and plans: the bytes of a comment, from `;` to the end of its line, may be any.
pub(crate) fn decode_pddl(name: &str, bytes: Vec<u8>) -> Result<Source, Diagnostic> {
    let bytes = match std::str::from_utf8(&bytes) {
        Ok(_) => bytes,
        Err(_) => bytes.split_inclusive(|byte| *byte == b'\n').flat_map(with_readable_comment).collect(),
    };
    decode(name, bytes)
}

/// A line whose comment has a mark for each byte that is not UTF-8.
fn with_readable_comment(line: &[u8]) -> Vec<u8> {
    let comment = line.iter().position(|byte| *byte == b';').unwrap_or(line.len());
    let (code, comment) = line.split_at(comment);
    [code, String::from_utf8_lossy(comment).as_bytes()].concat()
}

/// As [`decode`], for CLIPS: the bytes of a comment, from a `;` outside of strings to the end of its line, may be any.
pub(crate) fn decode_clips(name: &str, bytes: Vec<u8>) -> Result<Source, Diagnostic> {
    let bytes = match std::str::from_utf8(&bytes) {
        Ok(_) => bytes,
        Err(_) => with_readable_clips_comments(&bytes),
    };
    decode(name, bytes)
}

/// A program whose comments have a mark for each byte that is not UTF-8.
fn with_readable_clips_comments(bytes: &[u8]) -> Vec<u8> {
    let mut readable = Vec::with_capacity(bytes.len());
    let mut rest = bytes;
    while !rest.is_empty() {
        let (code, behind) = rest.split_at(code_length(rest));
        let end = behind.iter().position(|byte| matches!(byte, b'\n' | b'\r')).unwrap_or(behind.len());
        let (comment, behind) = behind.split_at(end);
        readable.extend_from_slice(code);
        readable.extend_from_slice(String::from_utf8_lossy(comment).as_bytes());
        rest = behind;
    }
    readable
}

/// The bytes of CLIPS in front of the first comment; a `;` in a string begins none.
fn code_length(bytes: &[u8]) -> usize {
    let (mut is_string, mut is_escaped) = (false, false);
    let begins_comment = |byte: &u8| {
        match byte {
            _ if is_escaped => is_escaped = false,
            b'\\' => is_escaped = is_string,
            b'"' => is_string = !is_string,
            b';' => return !is_string,
            _ => {}
        }
        false
    };
    bytes.iter().position(begins_comment).unwrap_or(bytes.len())
}

/// Returns the text that bytes spell; an error has the line and column of the first that is not UTF-8.
pub(crate) fn decode(name: &str, bytes: Vec<u8>) -> Result<Source, Diagnostic> {
    let wrong = |error| Diagnostic::not_utf8(name, &error, (1, 1));
    String::from_utf8(bytes).map(|text| Source::new(name, text)).map_err(wrong)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_comment_of_clips_may_have_any_bytes_and_a_string_may_not() {
        let read = |bytes: &[u8]| decode_clips("p.clp", bytes.to_vec()).map(|source| source.text().to_owned());
        let marked = "(a \"x;\\\"y\") ; gr\u{fffd}n \"\r\n(b) ;\u{fffd}";
        assert_eq!(read(b"(a \"x;\\\"y\") ; gr\xfcn \"\r\n(b) ;\xff").unwrap(), marked);
        for (bytes, place) in [
            (b"(a \"; \xfc\")".as_slice(), "p.clp:1:7: "),
            (b"; \xfc\n(\xfc)", "p.clp:2:2: "),
            (b"; \xfc \"\n(a \"\\\"; \xfc\")", "p.clp:2:9: "),
        ] {
            let error = read(bytes).unwrap_err().to_string();
            assert!(error.starts_with(&format!("{place}expected UTF-8 text, found invalid UTF-8")), "{error}");
        }
    }
}
