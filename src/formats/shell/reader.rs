//! Text to BSON.

use bson::{Bson, Document};
use pest::Parser as _;
use pest::iterators::Pair;

use super::grammar::{Rule, ShellParser};
use super::scanner::{self, MAX_DEPTH};
use super::{constructor, extended, fault, foreign, literal};
use crate::formats::{Diagnostic, Source, Span};

/// A value and where it stands.
pub(super) struct Node {
    pub(super) span: Span,
    value: Bson,
}

/// Reads a text that is one value of any type.
pub fn parse_value(source: &Source) -> Result<Bson, Diagnostic> {
    read(source, Span::new(0, source.text().len())).map(|node| node.value)
}

/// Reads a text that is one document.
pub fn parse_document(source: &Source) -> Result<Document, Diagnostic> {
    document(source, read(source, Span::new(0, source.text().len()))?)
}

/// Reads an aggregation pipeline: an array of documents, or one document as a pipeline of one stage.
pub fn parse_pipeline(source: &Source) -> Result<Vec<Document>, Diagnostic> {
    let stages = parse_documents_of(source, "an aggregation stage").map_err(|error| {
        let start = scanner::skip(source.text(), 0, b"");
        if source.text().as_bytes().get(start) == Some(&b'$') {
            return error
                .without_hints()
                .hint("stages are written in brackets and braces: [{$match: {…}}, {$group: {…}}]");
        }
        let is_row = source.text().as_bytes().get(start) == Some(&b'{') && parse_sequence(source).is_ok();
        if is_row {
            error.hint("several stages are written in brackets: [{$match: {…}}, {$group: {…}}]")
        } else {
            error
        }
    })?;
    Ok(stages.into_iter().map(|(_, document)| document).collect())
}

/// Reads the part of a text in `span` as one document.
pub fn parse_document_in(source: &Source, span: Span) -> Result<Document, Diagnostic> {
    document(source, read(source, span)?)
}

/// Reads the part of a text in `span` as a pipeline.
pub fn parse_pipeline_in(source: &Source, span: Span) -> Result<Vec<Document>, Diagnostic> {
    let node = read(source, span)?;
    let stages = match node.value {
        Bson::Document(stage) => return Ok(vec![stage]),
        Bson::Array(stages) => stages.into_iter().map(|stage| match stage {
            Bson::Document(stage) => Ok(stage),
            other => Err(kind(&other)),
        }),
        other => {
            return Err(Diagnostic::new(source, node.span, format!("expected a pipeline, found {}", kind(&other))));
        }
    };
    let wrong = |kind| Diagnostic::new(source, node.span, format!("expected aggregation stages, found {kind}"));
    stages.collect::<Result<_, _>>().map_err(wrong)
}

fn parse_documents_of(source: &Source, what: &str) -> Result<Vec<(Span, Document)>, Diagnostic> {
    let start = scanner::skip(source.text(), 0, b"");
    if !matches!(source.text().as_bytes().get(start), Some(b'[' | b'{')) {
        let node = read(source, Span::new(0, source.text().len()))?;
        let message = format!("expected {what} `{{…}}` or an array of them, found {}", kind(&node.value));
        return Err(Diagnostic::new(source, node.span, message));
    }
    if source.text().as_bytes().get(start) == Some(&b'{') {
        let node = read(source, Span::new(0, source.text().len()))?;
        return Ok(vec![(node.span, document(source, node)?)]);
    }
    parse_documents(source)
}

/// Reads documents one after another, with or without commas and line breaks
/// between them (so JSON lines, too), or one array of documents.
///
/// Each comes with its place. Only one document is in the parser at a time.
pub fn parse_documents(source: &Source) -> Result<Vec<(Span, Document)>, Diagnostic> {
    let text = source.text();
    let start = scanner::skip(text, 0, b"");
    if text.as_bytes().get(start) != Some(&b'[') {
        return sequence(source, start, text.len());
    }
    let (documents, end) = array(source, start)?;
    let rest = scanner::skip(text, end, b"");
    if rest < text.len() {
        return Err(Diagnostic::new(source, Span::at(rest), "expected nothing after the array of documents"));
    }
    Ok(documents)
}

/// Reads documents one after another, but no array of them.
pub(super) fn parse_sequence(source: &Source) -> Result<Vec<(Span, Document)>, Diagnostic> {
    sequence(source, scanner::skip(source.text(), 0, b""), source.text().len())
}

/// Documents in a row, separated by nothing or by a comma.
fn sequence(source: &Source, start: usize, end: usize) -> Result<Vec<(Span, Document)>, Diagnostic> {
    let mut documents = Vec::new();
    let mut offset = start;
    while offset < end {
        let (node, after) = element(source, offset, "another document or the end")?;
        documents.push((node.span, document(source, node)?));
        offset = scanner::skip(source.text(), after, b"");
        if source.text().as_bytes().get(offset) == Some(&b',') {
            offset = scanner::skip(source.text(), offset + 1, b"");
        }
    }
    Ok(documents)
}

/// The documents of the array that opens at `start`, and where it ends.
fn array(source: &Source, start: usize) -> Result<(Vec<(Span, Document)>, usize), Diagnostic> {
    let text = source.text();
    let mut documents = Vec::new();
    let mut offset = scanner::skip(text, start + 1, b"");
    loop {
        match text.as_bytes().get(offset) {
            Some(b']') => return Ok((documents, offset + 1)),
            None => return Err(unclosed(source, start, offset)),
            Some(_) => {}
        }
        let (node, after) = element(source, offset, "a document or `]`")?;
        documents.push((node.span, document(source, node)?));
        offset = scanner::skip(text, after, b"");
        match text.as_bytes().get(offset) {
            Some(b',') => offset = scanner::skip(text, offset + 1, b""),
            Some(b']') => {}
            None => return Err(unclosed(source, start, offset)),
            Some(_) => {
                return Err(fault::unexpected(source, Span::new(offset, text.len()), "`,` or `]` after a document"));
            }
        }
    }
}

fn unclosed(source: &Source, start: usize, offset: usize) -> Diagnostic {
    let (line, column) = source.position(start);
    let message = "expected `]`, found the end of the text";
    Diagnostic::new(source, Span::at(offset), message).hint(format!("the array opened at {line}:{column}"))
}

/// One document of many: from its opening bracket to its closing one. Where no value can start, `expected` is.
pub(super) fn element(source: &Source, start: usize, expected: &str) -> Result<(Node, usize), Diagnostic> {
    let rest = Span::new(start, source.text().len());
    let text = source.slice(rest);
    if !text.starts_with('{') {
        if text.starts_with(['}', ']', ')', ',', ':', '(']) {
            return Err(fault::unexpected(source, rest, expected));
        }
        if let Some(offset) = scanner::too_deep(text) {
            return Err(depth(source, start + offset));
        }
        // Either nothing that can be read, which is explained, or not a document.
        let end = fault::end_of_value(source, rest)?;
        let node = read(source, Span::new(start, end))?;
        let span = node.span;
        document(source, node)?;
        return Err(Diagnostic::new(source, span, "expected a document `{…}`"));
    }
    let end = scanner::value_end(source.text(), start).map_err(|offset| depth(source, offset))?;
    Ok((read(source, Span::new(start, end))?, end))
}

/// The byte wanted at the next place; returns the offset after it.
pub(super) fn expect(source: &Source, offset: usize, wanted: u8, expected: &str) -> Result<usize, Diagnostic> {
    let offset = scanner::skip(source.text(), offset, b"");
    if source.text().as_bytes().get(offset) == Some(&wanted) {
        return Ok(offset + 1);
    }
    Err(fault::unexpected(source, Span::new(offset, source.text().len()), expected))
}

/// The key at `offset`: quoted, or a bare `database.collection`.
pub(super) fn namespace(source: &Source, offset: usize) -> Result<(String, Span), Diagnostic> {
    let rest = source.text().get(offset..).unwrap_or_default();
    let bare = rest.find(|c: char| !(c.is_alphanumeric() || "_-.$".contains(c))).unwrap_or(rest.len());
    if bare > 0 {
        let span = Span::new(offset, offset + bare);
        return Ok((source.slice(span).to_owned(), span));
    }
    let whole = Span::new(offset, source.text().len());
    if !rest.starts_with(['"', '\'']) {
        return Err(fault::unexpected(source, whole, "a namespace"));
    }
    fault::end_of_value(source, whole)?;
    let mut pairs = ShellParser::parse(Rule::string, rest).map_err(|error| diagnose(source, offset, &error))?;
    let Some(pair) = pairs.next() else {
        return Err(Diagnostic::new(source, Span::at(offset), "expected a namespace"));
    };
    let span = Span::new(offset, offset + pair.as_str().len());
    Ok((Walker { source, base: offset }.text(&pair)?, span))
}

/// Reads the one value in `span`.
fn read(source: &Source, span: Span) -> Result<Node, Diagnostic> {
    let text = source.slice(span);
    if let Some(offset) = scanner::too_deep(text) {
        return Err(depth(source, span.start + offset));
    }
    let refused = |error| fault::find(source, span).unwrap_or_else(|| diagnose(source, span.start, &error));
    let mut pairs = ShellParser::parse(Rule::whole, text).map_err(refused)?;
    match pairs.next() {
        Some(pair) => Walker { source, base: span.start }.value(pair),
        None => Err(Diagnostic::new(source, span, "expected a value")),
    }
}

fn depth(source: &Source, offset: usize) -> Diagnostic {
    Diagnostic::new(source, Span::at(offset), format!("values nest deeper than {MAX_DEPTH} levels"))
}

/// The document that a node must be.
pub(super) fn document(source: &Source, node: Node) -> Result<Document, Diagnostic> {
    match node.value {
        Bson::Document(document) => Ok(document),
        other => {
            let message = format!("expected a document `{{…}}`, found {}", kind(&other));
            Err(Diagnostic::new(source, node.span, message))
        }
    }
}

/// A value's type in a user's words.
fn kind(value: &Bson) -> &'static str {
    match value {
        Bson::Array(_) => "an array",
        Bson::String(_) => "a string",
        Bson::Document(_) => "a document",
        Bson::Int32(_) | Bson::Int64(_) | Bson::Double(_) | Bson::Decimal128(_) => "a number",
        Bson::RegularExpression(_) => "a regular expression",
        Bson::Null => "null",
        Bson::Boolean(_) => "a boolean",
        Bson::DateTime(_) => "a date",
        Bson::ObjectId(_) => "an ObjectId",
        _ => "a value of another type",
    }
}

/// pest's complaint about a text that starts at `base` of the source.
fn diagnose(source: &Source, base: usize, error: &pest::error::Error<Rule>) -> Diagnostic {
    use pest::error::InputLocation;
    let mut error = error.clone();
    error.location = match error.location {
        InputLocation::Pos(offset) => InputLocation::Pos(base + offset),
        InputLocation::Span((start, end)) => InputLocation::Span((base + start, base + end)),
    };
    Diagnostic::from_pest(source, &error, |rule| words(*rule).to_owned())
}

fn words(rule: Rule) -> &'static str {
    match rule {
        Rule::member | Rule::key | Rule::bare | Rule::name | Rule::digits => "a key",
        Rule::end | Rule::EOI => "the end of the text",
        Rule::new => "`new`",
        _ => "a value",
    }
}

/// Turns pairs into values; its recursion is bounded by [`MAX_DEPTH`].
struct Walker<'a> {
    source: &'a Source,
    base: usize,
}

impl Walker<'_> {
    fn span(&self, pair: &Pair<'_, Rule>) -> Span {
        let span = pair.as_span();
        Span::new(self.base + span.start(), self.base + span.end())
    }

    fn value(&self, pair: Pair<'_, Rule>) -> Result<Node, Diagnostic> {
        let span = self.span(&pair);
        let wrong = |message: String| Diagnostic::new(self.source, span, message);
        let value = match pair.as_rule() {
            Rule::document => self.document(pair)?,
            Rule::array => {
                let values = pair.into_inner().map(|inner| self.value(inner).map(|node| node.value));
                Bson::Array(values.collect::<Result<_, _>>()?)
            }
            Rule::string => Bson::String(self.text(&pair)?),
            Rule::number => literal::number(pair.as_str()).map_err(wrong)?,
            Rule::regex => {
                let (pattern, options) = pair.as_str()[1..].rsplit_once('/').unwrap_or_default();
                literal::regex(pattern, options).map_err(wrong)?
            }
            Rule::call => self.call(pair)?,
            Rule::word => {
                let name = pair.as_str();
                constructor::word(name).ok_or_else(|| {
                    wrong(format!("expected a value, found `{name}`")).hint(foreign::hint_of_word(name))
                })?
            }
            other => return Err(wrong(format!("expected a value, found {}", words(other)))),
        };
        Ok(Node { span, value })
    }

    fn document(&self, pair: Pair<'_, Rule>) -> Result<Bson, Diagnostic> {
        let span = self.span(&pair);
        let mut document = Document::new();
        for member in pair.into_inner() {
            let mut inner = member.into_inner();
            let (Some(key), Some(value)) = (inner.next(), inner.next()) else { continue };
            let key_span = self.span(&key);
            let name = if key.as_rule() == Rule::string { self.text(&key)? } else { key.as_str().to_owned() };
            if name.contains('\0') {
                return Err(Diagnostic::new(self.source, key_span, "a key cannot hold a NUL character"));
            }
            let value = self.value(value)?.value;
            if document.contains_key(&name) {
                return Err(Diagnostic::new(self.source, key_span, format!("the key `{name}` is given twice")));
            }
            document.insert(name, value);
        }
        extended::unwrap(document).map_err(|message| Diagnostic::new(self.source, span, message))
    }

    fn call(&self, pair: Pair<'_, Rule>) -> Result<Bson, Diagnostic> {
        let span = self.span(&pair);
        let mut inner = pair.into_inner().filter(|inner| inner.as_rule() != Rule::new);
        let name = inner.next().map_or("", |name| name.as_str());
        let arguments = inner.map(|argument| self.value(argument).map(|node| node.value));
        let arguments: Vec<Bson> = arguments.collect::<Result<_, _>>()?;
        constructor::call(name, &arguments).map_err(|message| {
            let hint = if constructor::is_known(name) { None } else { foreign::hint(name) };
            hint.into_iter().fold(Diagnostic::new(self.source, span, message), Diagnostic::hint)
        })
    }

    fn text(&self, pair: &Pair<'_, Rule>) -> Result<String, Diagnostic> {
        literal::string(pair.as_str()).map_err(|(offset, message)| {
            let start = self.base + pair.as_span().start();
            Diagnostic::new(self.source, Span::at(start + offset), message)
        })
    }
}
