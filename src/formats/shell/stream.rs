//! Documents from a stream, one at a time, for inputs larger than memory.

use std::collections::VecDeque;
use std::io::{self, BufRead};
use std::sync::Arc;

use bson::Document;

use super::reader::parse_sequence;
use super::scanner::{MAX_DEPTH, Scanner};
use crate::fault::{AtFault, Fault};
use crate::formats::{Diagnostic, Position, Source, Span};

/// Why a stream gave no document.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The stream failed.
    #[error("cannot read {name}: {error}")]
    Io {
        /// The name of the stream.
        name: String,
        /// The system's error.
        error: io::Error,
    },
    /// The text is not what it should be.
    #[error(transparent)]
    Text(#[from] Diagnostic),
}

impl AtFault for ReadError {
    fn fault(&self) -> Fault {
        match self {
            Self::Io { .. } | Self::Text(_) => Fault::Input,
        }
    }
}

/// Reads documents one after another, or the elements of one array, like
/// [`super::parse_documents`], holding only the lines of the current document.
///
/// Each comes with the line and column it starts at; errors say their line
/// in the whole stream. After an error nothing more comes.
#[derive(Debug)]
pub struct Reader<R> {
    name: Arc<str>,
    input: R,
    /// How many lines were read.
    lines: usize,
    array: Array,
    done: bool,
    ready: VecDeque<((usize, usize), Document)>,
}

/// Whether the documents are the elements of an array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Array {
    Unknown,
    None,
    Open,
    Closed,
}

/// Whole lines of the stream, the brackets and commas of the outermost array blanked.
struct Chunk {
    first_line: usize,
    bytes: Vec<u8>,
    /// The brackets and commas that were blanked, with their offsets.
    blanked: Vec<(usize, u8)>,
    /// Something after the end of the array.
    extra: Option<usize>,
}

impl<R: BufRead> Reader<R> {
    /// A reader of `input`, which messages call `name`.
    pub fn new(name: impl Into<Arc<str>>, input: R) -> Self {
        let ready = VecDeque::new();
        Self { name: name.into(), input, lines: 0, array: Array::Unknown, done: false, ready }
    }

    /// Lines until all brackets are closed; `None` at the end.
    fn chunk(&mut self) -> Result<Option<Chunk>, ReadError> {
        let mut chunk = Chunk { first_line: self.lines + 1, bytes: Vec::new(), blanked: Vec::new(), extra: None };
        let mut scanner = Scanner::new();
        loop {
            let start = chunk.bytes.len();
            let read = self.input.read_until(b'\n', &mut chunk.bytes);
            if read.map_err(|error| ReadError::Io { name: self.name.to_string(), error })? == 0 {
                break;
            }
            self.lines += 1;
            let mut offset = start;
            while let Some(byte) = chunk.bytes.get_mut(offset) {
                let written = *byte;
                if scanner.in_code() && scanner.depth() == 0 && self.outside(byte) {
                    chunk.extra.get_or_insert(offset);
                }
                scanner.step(*byte);
                if *byte != written {
                    chunk.blanked.push((offset, written));
                }
                offset += 1;
                offset += scanner.idle(chunk.bytes.get(offset..).unwrap_or_default());
            }
            if scanner.depth() > MAX_DEPTH || (scanner.in_code() && scanner.depth() == 0) {
                break;
            }
        }
        Ok(Some(chunk).filter(|chunk| !chunk.bytes.is_empty()))
    }

    /// Takes a byte that is in no document: blanks what belongs to the array.
    /// Returns whether it should not be there.
    fn outside(&mut self, byte: &mut u8) -> bool {
        match *byte {
            // White space, a comment's start, a byte order mark.
            b' ' | b'\t' | b'\r' | b'\n' | b'/' | 0xEF | 0xBB | 0xBF => return false,
            _ if self.array == Array::Closed => return true,
            b'[' if self.array == Array::Unknown => {
                self.array = Array::Open;
                *byte = b' ';
                return false;
            }
            b']' if self.array == Array::Open => {
                self.array = Array::Closed;
                *byte = b' ';
            }
            b',' if self.array != Array::Unknown => *byte = b' ',
            _ => {}
        }
        if self.array == Array::Unknown {
            self.array = Array::None;
        }
        false
    }

    /// Reads one chunk and what is in it; returns whether there was one.
    fn advance(&mut self) -> Result<bool, ReadError> {
        let Some(chunk) = self.chunk()? else {
            if self.array == Array::Open {
                let message = "expected `]`, found the end of the text";
                return Err(Diagnostic::at(&self.name, self.lines.max(1), 1, message).into());
            }
            return Ok(false);
        };
        let text = decode(&self.name, chunk.bytes, (chunk.first_line, 1))?;
        let source = Source::starting_at(self.name.clone(), text, chunk.first_line);
        // A complaint shows the line as it is in the stream.
        let complain = |error: Diagnostic| {
            let mut bytes = source.text().as_bytes().to_vec();
            for (offset, written) in &chunk.blanked {
                bytes.get_mut(*offset).into_iter().for_each(|byte| *byte = *written);
            }
            let text = String::from_utf8_lossy(&bytes).into_owned();
            let written = Source::starting_at(self.name.clone(), text, chunk.first_line);
            let shown = Diagnostic::new(&written, error.span(), error.message());
            error.hints().iter().fold(shown, Diagnostic::hint)
        };
        if let Some(offset) = chunk.extra {
            let message = "expected nothing after the array of documents";
            return Err(complain(Diagnostic::new(&source, Span::at(offset), message)).into());
        }
        // Documents come in order, so that lines and columns are counted once.
        let (mut line, mut column, mut counted) = (chunk.first_line, 1, 0);
        for (span, document) in parse_sequence(&source).map_err(complain)? {
            let passed = source.slice(Span::new(counted, span.start));
            line += passed.matches('\n').count();
            column = match passed.rsplit_once('\n') {
                Some((_, rest)) => rest.chars().count() + 1,
                None => column + passed.chars().count(),
            };
            counted = span.start;
            self.ready.push_back(((line, column), document));
        }
        Ok(true)
    }
}

impl<R: BufRead> Iterator for Reader<R> {
    type Item = Result<((usize, usize), Document), ReadError>;

    fn next(&mut self) -> Option<Self::Item> {
        while self.ready.is_empty() && !self.done {
            match self.advance() {
                Ok(more) => self.done = !more,
                Err(error) => {
                    self.done = true;
                    return Some(Err(error));
                }
            }
        }
        self.ready.pop_front().map(Ok)
    }
}

/// The text of a part of a stream, which begins at a line and a column.
pub(super) fn decode(name: &str, bytes: Vec<u8>, first: Position) -> Result<String, Diagnostic> {
    String::from_utf8(bytes).map_err(|error| Diagnostic::not_utf8(name, &error, first))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places(text: &str) -> Vec<((usize, usize), String)> {
        let read = Reader::new("in", text.as_bytes()).map(|item| item.expect("readable"));
        read.map(|(place, document)| (place, super::super::relaxed(&document))).collect()
    }

    #[test]
    fn says_where_in_the_stream_each_document_starts() {
        let of = |places: [(usize, usize); 3]| {
            let documents = [r#"{"a":1}"#, r#"{"b":[1,2]}"#, r#"{"c":1}"#].map(str::to_owned);
            places.into_iter().zip(documents).collect::<Vec<_>>()
        };
        assert_eq!(places("{a: 1}\n// one\n {b: [1,\n  2]},\n{c: 1}"), of([(1, 1), (3, 2), (5, 1)]));
        assert_eq!(places("[{a: 1},\n\n{b: [1,\n  2]},\n{c: 1}\n]\n"), of([(1, 2), (3, 1), (5, 1)]));
        assert_eq!(places("[{a: 1}, {b: [1,2]}, {c: 1}]"), of([(1, 2), (1, 10), (1, 22)]));
    }

    #[test]
    fn counts_lines_through_the_stream_in_errors() {
        for (text, place) in [
            ("{a: 1}\n{a: 2}\n{a: x}\n", "in:3:5: expected a value, found `x`"),
            ("[{a: 1}\n, {a: 2}", "in:2:1: expected `]`, found the end of the text"),
            ("[{a: 1}]\n{a: 2}", "in:2:1: expected nothing after the array of documents"),
            ("{a: 1}\n[{a: 2}]", "in:2:1: expected a document `{…}`, found an array"),
        ] {
            let error = Reader::new("in", text.as_bytes()).find_map(Result::err).expect("an error");
            assert!(error.to_string().starts_with(place), "{error}");
        }
        let text = "[{a: 1}, x,\n{a: 2}]";
        let error = Reader::new("in", text.as_bytes()).find_map(Result::err).expect("an error");
        assert!(error.to_string().contains("1 | [{a: 1}, x,\n"), "{error}");
        let error = Reader::new("in", &b"{a: 1}\n{b: '\xff'}\n"[..]).find_map(Result::err).expect("an error");
        assert!(error.to_string().starts_with("in:2:6: expected UTF-8 text, found invalid UTF-8\n"), "{error}");
    }
}
