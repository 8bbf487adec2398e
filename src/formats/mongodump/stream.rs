//! BSON documents one after another.

use std::io::{self, BufRead, Read as _};

use bson::error::ErrorKind;
use bson::{Document, RawDocument, RawDocumentBuf};

use crate::formats::visible;

/// The most bytes of a document: MongoDB's limit and what it adds itself.
const LONGEST: usize = (16 << 20) + (16 << 10);
/// Stands where a length would, between the parts of an archive.
pub(super) const MARK: i32 = -1;
/// An empty document.
const SHORTEST: usize = 5;

/// What is wrong in a file, and at which byte (of what it holds, where it is packed).
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("byte {offset}: {reason}")]
pub struct Damage {
    /// How many bytes lie before.
    pub offset: u64,
    /// What is wrong.
    pub reason: String,
}

/// What stands in a stream of documents.
#[derive(Debug)]
pub(super) enum Frame {
    /// A document, and the byte it starts at.
    Document(u64, RawDocumentBuf),
    /// The mark between the parts of an archive.
    Mark,
}

/// Documents and marks, one after another.
pub(super) struct Frames<R> {
    input: R,
    offset: u64,
}

impl<R: BufRead> Frames<R> {
    /// Reads `input`, of which `offset` bytes are read already.
    pub(super) fn new(input: R, offset: u64) -> Self {
        Self { input, offset }
    }

    /// How many bytes are read.
    pub(super) fn offset(&self) -> u64 {
        self.offset
    }

    /// The next document or mark; `None` at the end.
    pub(super) fn read(&mut self) -> Result<Option<Frame>, Damage> {
        let start = self.offset;
        let mut bytes = Vec::new();
        self.fill(&mut bytes, 4)?;
        let Ok(size) = <[u8; 4]>::try_from(bytes.as_slice()).map(i32::from_le_bytes) else {
            return match bytes.len() {
                0 => Ok(None),
                found => Err(self.cut(start, 4, found)),
            };
        };
        if size == MARK {
            return Ok(Some(Frame::Mark));
        }
        let size = usize::try_from(size)
            .ok()
            .filter(|size| (SHORTEST..=LONGEST).contains(size))
            .ok_or_else(|| no_length(start, size))?;
        self.fill(&mut bytes, size - 4)?;
        if bytes.len() < size {
            return Err(self.cut(start, size, bytes.len()));
        }
        let damaged = |error| Damage { offset: start, reason: not_bson(&error) };
        RawDocumentBuf::from_bytes(bytes).map(|document| Some(Frame::Document(start, document))).map_err(damaged)
    }

    /// Reads up to `count` bytes more; memory grows with what is there, not with what is promised.
    fn fill(&mut self, bytes: &mut Vec<u8>, count: usize) -> Result<(), Damage> {
        match self.input.by_ref().take(count as u64).read_to_end(bytes) {
            Ok(read) => {
                self.offset += read as u64;
                Ok(())
            }
            Err(error) => Err(Damage { offset: self.offset, reason: unreadable(&error) }),
        }
    }

    fn cut(&self, start: u64, wanted: usize, found: usize) -> Damage {
        let reason = format!(
            "the file ends in the middle of a document that starts at byte {start} ({found} of {wanted} bytes); \
             it is truncated"
        );
        Damage { offset: self.offset, reason }
    }
}

fn no_length(offset: u64, size: i32) -> Damage {
    Damage { offset, reason: format!("{size} is not the length of a document; is this a BSON file?") }
}

/// The documents of a `.bson` file, each with the byte it starts at. After an
/// error nothing more comes.
pub struct Documents<R> {
    frames: Frames<R>,
    done: bool,
}

impl<R: BufRead> Documents<R> {
    /// Reads the documents in `input`.
    pub fn new(input: R) -> Self {
        Self { frames: Frames::new(input, 0), done: false }
    }

    fn read(&mut self) -> Result<Option<(u64, RawDocumentBuf)>, Damage> {
        match self.frames.read()? {
            None => Ok(None),
            Some(Frame::Document(offset, document)) => Ok(Some((offset, document))),
            Some(Frame::Mark) => Err(no_length(self.frames.offset().saturating_sub(4), MARK)),
        }
    }
}

fn unreadable(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::UnexpectedEof => "the gzip file ends too early; it is truncated".to_owned(),
        io::ErrorKind::InvalidInput | io::ErrorKind::InvalidData => format!("the gzip file is damaged ({error})"),
        _ => error.to_string(),
    }
}

impl<R: BufRead> Iterator for Documents<R> {
    type Item = Result<(u64, RawDocumentBuf), Damage>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.done {
            return None;
        }
        let read = self.read().transpose();
        self.done = !matches!(read, Some(Ok(_)));
        read
    }
}

/// What is wrong with bytes that are not BSON.
fn not_bson(error: &bson::error::Error) -> String {
    format!("not BSON: {}", damage(error))
}

/// What an error of BSON says, without the types of its library.
pub(super) fn damage(error: &bson::error::Error) -> String {
    let said = error.message.as_deref().unwrap_or_default();
    if matches!(error.kind, ErrorKind::Utf8Encoding { .. }) || is_inner_encoding(said) {
        return "a text in it is not UTF-8".to_owned();
    }
    let kind = match &error.kind {
        ErrorKind::ValueAccess { kind, .. } => kind.to_string(),
        kind => kind.to_string(),
    };
    let what = if said.is_empty() { kind.as_str() } else { innermost(said) };
    let what = what.trim_end_matches('.');
    match error.key.as_deref().or_else(|| inner_key(said)) {
        Some(key) => format!("{what} (key {})", visible::line(key)),
        None => what.to_owned(),
    }
}

// The library writes an error in another one into its message, as text: as `BSON error at key "a". Kind: K. Message: M.`, or as
// `Error { kind: K, message: Some("M"), key: … }`.

/// Whether the message of an error has one in it about a text that is not UTF-8.
fn is_inner_encoding(message: &str) -> bool {
    message.contains("Utf8Encoding") || message.contains("Invalid UTF-8")
}

/// The key in the error that a message has in it.
fn inner_key(message: &str) -> Option<&str> {
    message.split_once(" at key \"").and_then(|(_, rest)| rest.split_once('"')).map(|(key, _)| key)
}

/// What the error says that a message has in it, or the message.
fn innermost(message: &str) -> &str {
    let what =
        message.rsplit_once("Message: ").or_else(|| message.rsplit_once("Kind: ")).map_or(message, |(_, what)| what);
    let what = what.strip_prefix("An error occurred when attempting to access a document value: ").unwrap_or(what);
    what.split_once("message: Some(\"").and_then(|(_, rest)| rest.split_once("\")")).map_or(what, |(inner, _)| inner)
}

/// Decodes a document that starts at byte `offset`. As deep as the document is
/// nested, so that is to be checked first.
///
/// # Errors
/// Where it is not well-formed throughout.
pub fn decode_document(offset: u64, document: &RawDocument) -> Result<Document, Damage> {
    Document::try_from(document).map_err(|error| Damage { offset, reason: not_bson(&error) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::doc;

    fn bytes(documents: &[Document]) -> Vec<u8> {
        documents.iter().flat_map(|document| RawDocumentBuf::try_from(document).unwrap().into_bytes()).collect()
    }

    fn read(bytes: &[u8]) -> Result<Vec<(u64, RawDocumentBuf)>, Damage> {
        Documents::new(bytes).collect()
    }

    #[test]
    fn documents_come_with_their_places() {
        let read = read(&bytes(&[doc! {}, doc! { "a": 1 }, doc! { "b": "x" }])).unwrap();
        assert_eq!(read.iter().map(|(offset, _)| *offset).collect::<Vec<_>>(), [0, 5, 17]);
    }

    #[test]
    fn a_file_cut_anywhere_is_told() {
        let whole = bytes(&[doc! { "a": 1 }, doc! { "a": 2 }]);
        for length in 0..whole.len() {
            let result = read(whole.get(..length).unwrap());
            match length {
                0 | 12 => assert!(result.is_ok()),
                _ => assert_eq!(result.unwrap_err().offset, length as u64),
            }
        }
    }

    #[test]
    fn lengths_that_cannot_be_are_refused_before_memory_is_asked_for() {
        for size in [-1_i32, 0, 4, i32::MAX, i32::MIN, 17 << 20] {
            assert!(read(&size.to_le_bytes()).unwrap_err().reason.contains("not the length"), "{size}");
        }
        assert!(read(&(16_i32 << 20).to_le_bytes()).unwrap_err().reason.contains("truncated"));
    }

    #[test]
    fn a_document_without_its_end_is_refused() {
        let mut bytes = bytes(&[doc! { "a": 1 }]);
        *bytes.last_mut().unwrap() = 7;
        assert_eq!(read(&bytes).unwrap_err().offset, 0);
    }

    #[test]
    fn random_bytes_end_in_a_result() {
        let mut state = 1_u64;
        for _ in 0..2_000 {
            let mut bytes = 40_u32.to_le_bytes().to_vec();
            for _ in 0..40 {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                bytes.push((state >> 56) as u8 % 20);
            }
            for (offset, document) in read(&bytes).into_iter().flatten() {
                let _ = decode_document(offset, &document);
            }
        }
    }
}
