//! World files: an object with namespaces as keys and arrays of documents as
//! values, read as a whole or piece by piece, for files larger than memory.

use std::collections::VecDeque;
use std::io::{BufRead, ErrorKind};
use std::sync::Arc;

use bson::Document;

use super::fault;
use super::reader::{document, element, expect, namespace};
use super::scanner::{self, MAX_DEPTH, Scanner};
use super::stream::{ReadError, decode};
use crate::formats::{Diagnostic, Source, Span};

/// How many brackets are open between two documents.
const BETWEEN: usize = 2;
/// After how many bytes a long line is divided, behind a document.
const PIECE: usize = 64 << 10;

/// A namespace of a world file, or a document of the namespace before, with the text it is from.
#[derive(Debug, Clone, PartialEq)]
pub enum WorldItem {
    /// `"database.collection":`
    Namespace(String, Source, Span),
    /// A document.
    Document(Document, Source, Span),
}

/// Reads a world file that is in memory. Each namespace comes with the place of its
/// key, each document with its own.
///
/// # Errors
/// Where it is not one.
#[allow(clippy::type_complexity, reason = "three plain things side by side")]
pub fn parse_world(source: &Source) -> Result<Vec<(String, Span, Vec<(Span, Document)>)>, Diagnostic> {
    let mut world: Vec<(String, Span, Vec<(Span, Document)>)> = Vec::new();
    let mut progress = Progress::default();
    progress.read(source, &|_| true, &mut |item| match item {
        WorldItem::Namespace(name, _, span) => world.push((name, span, Vec::new())),
        WorldItem::Document(document, _, span) => {
            world.last_mut().into_iter().for_each(|(_, _, documents)| documents.push((span, document.clone())));
        }
    })?;
    progress.end(source)?;
    Ok(world)
}

/// Reads a world file, holding only the lines of the current document; of a long line, a piece.
pub struct WorldReader<'a, R> {
    name: Arc<str>,
    input: R,
    lines: usize,
    /// How many characters of the current line were read.
    column: usize,
    scanner: Scanner,
    progress: Progress,
    wanted: Box<dyn Fn(&str) -> bool + 'a>,
    ready: VecDeque<WorldItem>,
    done: bool,
}

impl<'a, R: BufRead> WorldReader<'a, R> {
    /// A reader of `input`, which messages call `name`. Documents of namespaces that
    /// are not `wanted` are skipped unread.
    pub fn new(name: impl Into<Arc<str>>, input: R, wanted: impl Fn(&str) -> bool + 'a) -> Self {
        Self {
            name: name.into(),
            input,
            lines: 0,
            column: 0,
            scanner: Scanner::new(),
            progress: Progress::default(),
            wanted: Box::new(wanted),
            ready: VecDeque::new(),
            done: false,
        }
    }

    /// Whole lines, up to one that ends between documents, or the piece of a line; `None` at the end.
    fn chunk(&mut self) -> Result<Option<Vec<u8>>, ReadError> {
        let mut bytes = Vec::new();
        loop {
            let buffer = match self.input.fill_buf() {
                Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                read => read.map_err(|error| ReadError::Io { name: self.name.to_string(), error })?,
            };
            if buffer.is_empty() {
                break;
            }
            let line = memchr::memchr(b'\n', buffer).map_or(buffer, |newline| &buffer[..=newline]);
            let mut offset = 0;
            let mut is_divided = false;
            while let (Some(byte), false) = (line.get(offset), is_divided) {
                self.scanner.step(*byte);
                offset += 1;
                offset += self.scanner.idle(line.get(offset..).unwrap_or_default());
                let is_between = *byte == b'}' && self.scanner.depth() == BETWEEN && self.scanner.in_code();
                is_divided = is_between && bytes.len() + offset >= PIECE;
            }
            let is_line = line.get(offset - 1) == Some(&b'\n');
            bytes.extend_from_slice(&line[..offset]);
            self.input.consume(offset);
            self.lines += usize::from(is_line);
            let depth = self.scanner.depth();
            let is_whole = depth > BETWEEN + MAX_DEPTH || (self.scanner.in_code() && depth <= BETWEEN);
            if is_divided || (is_line && is_whole) {
                break;
            }
        }
        Ok(Some(bytes).filter(|bytes| !bytes.is_empty()))
    }

    /// Reads one chunk and what is in it; returns whether there was one.
    fn advance(&mut self) -> Result<bool, ReadError> {
        let first_line = self.lines + 1;
        let chunk = self.chunk()?;
        let is_end = chunk.is_none();
        let text = decode(&self.name, chunk.unwrap_or_default(), (first_line, self.column + 1))?;
        let source = Source::starting_at(Arc::clone(&self.name), text, first_line).in_column(self.column + 1);
        self.column = match source.text().ends_with('\n') {
            true => 0,
            false => source.position(source.text().len()).1 - 1,
        };
        if is_end {
            self.progress.end(&source)?;
            return Ok(false);
        }
        let ready = &mut self.ready;
        self.progress.read(&source, &self.wanted, &mut |item| ready.push_back(item))?;
        Ok(true)
    }
}

impl<R: BufRead> Iterator for WorldReader<'_, R> {
    type Item = Result<WorldItem, ReadError>;

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

/// How far a world file has been read.
#[derive(Debug, Default)]
struct Progress {
    expected: Expected,
    names: Vec<String>,
    /// Line and column of the array that is open.
    opened: (usize, usize),
}

/// What comes next.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum Expected {
    #[default]
    World,
    Name,
    Colon,
    Array,
    Document,
    AfterDocument,
    AfterArray,
    Nothing,
}

impl Progress {
    /// Reads a text that ends where a document, a key or a sign does.
    fn read(
        &mut self,
        source: &Source,
        wanted: &dyn Fn(&str) -> bool,
        take: &mut dyn FnMut(WorldItem),
    ) -> Result<(), Diagnostic> {
        let text = source.text();
        let mut offset = scanner::skip(text, 0, b"");
        while let Some(byte) = text.as_bytes().get(offset).copied() {
            let after = self.step(source, offset, byte, wanted, take)?;
            offset = scanner::skip(text, after, b"");
        }
        Ok(())
    }

    /// Takes what begins at `offset`; returns where it ends.
    fn step(
        &mut self,
        source: &Source,
        offset: usize,
        byte: u8,
        wanted: &dyn Fn(&str) -> bool,
        take: &mut dyn FnMut(WorldItem),
    ) -> Result<usize, Diagnostic> {
        let unexpected = |expected| fault::unexpected(source, Span::new(offset, source.text().len()), expected);
        let (after, next) = match (self.expected, byte) {
            (Expected::World, b'{') => (offset + 1, Expected::Name),
            (Expected::World, _) => return Err(no_world(source, offset)),
            (Expected::Name | Expected::AfterArray, b'}') => (offset + 1, Expected::Nothing),
            (Expected::Name, _) => {
                let (name, span) = namespace(source, offset)?;
                if self.names.contains(&name) {
                    return Err(Diagnostic::new(source, span, format!("the namespace `{name}` is given twice")));
                }
                self.names.push(name.clone());
                take(WorldItem::Namespace(name, source.clone(), span));
                (span.end, Expected::Colon)
            }
            (Expected::Colon, _) => (expect(source, offset, b':', "`:` after the namespace")?, Expected::Array),
            (Expected::Array, _) => {
                self.opened = source.position(offset);
                (expect(source, offset, b'[', "an array of documents `[…]`")?, Expected::Document)
            }
            (Expected::Document | Expected::AfterDocument, b']') => (offset + 1, Expected::AfterArray),
            (Expected::Document, b'{') if !self.names.last().is_some_and(|name| wanted(name)) => {
                (scanner::value_end(source.text(), offset).unwrap_or(source.text().len()), Expected::AfterDocument)
            }
            (Expected::Document, _) => {
                let (node, after) = element(source, offset, "a document or `]`")?;
                let span = node.span;
                take(WorldItem::Document(document(source, node)?, source.clone(), span));
                (after, Expected::AfterDocument)
            }
            (Expected::AfterDocument, b',') => (offset + 1, Expected::Document),
            (Expected::AfterDocument, _) => return Err(unexpected("`,` or `]` after a document")),
            (Expected::AfterArray, b',') => (offset + 1, Expected::Name),
            (Expected::AfterArray, _) => return Err(unexpected("`,` or `}` after an array")),
            (Expected::Nothing, _) => {
                return Err(Diagnostic::new(source, Span::at(offset), "expected nothing after the world"));
            }
        };
        self.expected = next;
        Ok(after)
    }

    /// Whether everything that was opened is closed.
    fn end(&self, source: &Source) -> Result<(), Diagnostic> {
        let end = source.text().len();
        match self.expected {
            Expected::Nothing => Ok(()),
            Expected::World => Err(no_world(source, end)),
            Expected::Document | Expected::AfterDocument => {
                let (line, column) = self.opened;
                let message = "expected `]`, found the end of the text";
                let hint = format!("the array opened at {line}:{column}");
                Err(Diagnostic::new(source, Span::at(end), message).hint(hint))
            }
            Expected::Colon => Err(fault::unexpected(source, Span::at(end), "`:` after the namespace")),
            Expected::Array => Err(fault::unexpected(source, Span::at(end), "an array of documents `[…]`")),
            Expected::Name | Expected::AfterArray => {
                Err(Diagnostic::new(source, Span::at(end), "expected `}`, found the end of the text"))
            }
        }
    }
}

fn no_world(source: &Source, offset: usize) -> Diagnostic {
    Diagnostic::new(source, Span::at(offset), "expected a world `{\"database.collection\": [documents…], …}`")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn items(text: &str) -> Vec<String> {
        let reader = WorldReader::new("in", text.as_bytes(), |name| name != "no.no");
        let outcome = |item: Result<WorldItem, ReadError>| match item {
            Ok(WorldItem::Namespace(name, ..)) => name,
            Ok(WorldItem::Document(document, source, span)) => {
                let (line, column) = source.position(span.start);
                format!("{line}:{column} {}", super::super::relaxed(&document))
            }
            Err(error) => error.to_string().lines().next().unwrap_or_default().to_owned(),
        };
        reader.map(outcome).collect()
    }

    #[test]
    fn the_same_is_read_however_it_is_laid_out() {
        let wanted = ["a.b", "1", "2", "c.d", "3"];
        for text in [
            "{'a.b': [{x: 1}, {x: 2}], 'c.d': [{x: 3}]}",
            "{\n'a.b'\n:\n[\n{x:\n1}\n,\n{x: 2}]\n,'c.d' : [ {x: 3} ]\n}\n",
            "// a world\n{'a.b': [{x: 1}, // one ]\n {x: 2},], /*\n}*/ 'c.d': [{x: 3}],\n}",
            "{'a.b': [{x: 1}, {x: 2}], 'no.no': [{x: 5}, {x: '\\n]'}], 'c.d': [{x: 3}]}",
        ] {
            let found = items(text);
            let found: Vec<&str> = found
                .iter()
                .map(|item| item.split_once("{\"x\":").map_or(item.as_str(), |(_, n)| n.trim_end_matches('}')))
                .filter(|item| *item != "no.no")
                .collect();
            assert_eq!(found, wanted, "{text}");
        }
    }

    #[test]
    fn a_long_line_is_read_in_pieces_with_the_places_of_the_whole() {
        let documents: Vec<String> = (0..20_000).map(|n| format!("{{n: {n}, é: '}}]\\\'{{'}}")).collect();
        let text = format!("\n{{'a.b': [{}], 'c.d': [{{x: 3}}]}}", documents.join(","));
        assert!(text.len() > 5 * PIECE);
        let place = |part: &str| text[1..text.find(part).unwrap()].chars().count() + 1;
        let found = items(&text);
        assert_eq!(found.len(), 20_003);
        for n in [0, 1, 3_000, 19_999] {
            let place = place(&format!("{{n: {n},"));
            assert_eq!(found[n + 1], format!("2:{place} {{\"n\":{n},\"é\":\"}}]'{{\"}}"));
        }
        let wrong = text.replace("{n: 15000,", "{n: o,");
        let place = wrong[1..wrong.find("o,").unwrap()].chars().count() + 1;
        let found = items(&wrong).into_iter().find(|item| item.starts_with("in:")).unwrap_or_default();
        assert!(found.starts_with(&format!("in:2:{place}: expected a value")), "{found}");
        // However much the input gives at a time.
        let whole = WorldReader::new("in", text.as_bytes(), |_| true).map(Result::unwrap).count();
        for size in [1, 7, 4096] {
            let input = std::io::BufReader::with_capacity(size, text.as_bytes());
            assert_eq!(WorldReader::new("in", input, |_| true).map(Result::unwrap).count(), whole);
        }
    }

    #[test]
    fn mistakes_are_told_with_their_line_in_the_file() {
        for (text, wanted) in [
            ("{'a.b': [\n{x: 1},\n{x: y}]}", "in:3:5: expected a value"),
            ("{'a.b': [\n{x: 1}\n{x: 2}]}", "in:3:1: expected `,` or `]` after a document"),
            ("{'a.b': [\n{x: 1},\n", "in:3:1: expected `]`, found the end of the text"),
            ("{'a.b': [],\n'a.b': []}", "in:2:1: the namespace `a.b` is given twice"),
            ("{'a.b': []}\n\n{", "in:3:1: expected nothing after the world"),
            ("{'a.b': []\n", "in:2:1: expected `}`, found the end of the text"),
            ("", "in:1:1: expected a world"),
        ] {
            let found = items(text);
            assert!(found.last().is_some_and(|last| last.starts_with(wanted)), "{text}: {found:?}");
        }
    }
}
