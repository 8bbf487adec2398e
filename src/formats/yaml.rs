//! Documents in YAML 1.2: mappings, one after another (`---`) or in a sequence.
//!
//! Plain scalars are null, true and false, numbers, dates like `2026-01-31` and `2026-01-31T12:00:00Z` (as in YAML 1.1 and
//! as most libraries write them), or else texts. A mapping of Extended JSON (`{$oid: …}`) is the value that it stands
//! for. Anchors, aliases and `<<` are resolved. Source: the YAML specification 1.2.2, its core schema, and the types
//! `timestamp` and `merge` of 1.1; the parser is the crate `saphyr-parser`.

mod indentation;

use std::borrow::Cow;
use std::collections::{HashMap, HashSet};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use bson::{Binary, Bson, DateTime, Document, spec::BinarySubtype};
use saphyr_parser::{Event, Marker, Parser, ScalarStyle, ScanError, StrInput, Tag};

use super::shell::{self, MAX_DEPTH};
use super::{Diagnostic, Position, Source, Span};
use indentation::Indented;

/// At most so many values come from aliases, so that few lines cannot fill the memory.
const MOST_ALIASED: usize = 1_000_000;

/// The documents of a YAML text, each with the line and column, from 1, where it begins, once the text before it is
/// read. After an error nothing more comes.
pub fn documents(source: &Source) -> Box<dyn Iterator<Item = Result<(Position, Document), Diagnostic>> + '_> {
    let indented = Indented::of(source.text());
    match indented.text {
        Cow::Borrowed(text) => Box::new(read(source, text, |offset| offset)),
        // Such a text is copied, and so read at once.
        Cow::Owned(ref text) => {
            let read: Vec<_> = read(source, text, |offset| indented.original(offset)).collect();
            Box::new(read.into_iter())
        }
    }
}

/// The documents of a text which is that of a source but for blanks; `original` leads from its offsets to the source's.
fn read<'t>(
    source: &'t Source,
    text: &'t str,
    original: impl Fn(usize) -> usize + 't,
) -> impl Iterator<Item = Result<(Position, Document), Diagnostic>> + 't {
    let mut reader = Reader {
        source,
        text,
        original,
        parser: Parser::new_from_str(text),
        anchors: HashMap::new(),
        left: MOST_ALIASED,
        is_inside: false,
        done: false,
    };
    std::iter::from_fn(move || {
        if reader.done {
            return None;
        }
        let read = reader.document().transpose();
        reader.done = !matches!(read, Some(Ok(_)));
        read
    })
}

/// Returns the texts in the sequence that is the value of a key of the first document, each with the suffix of its
/// tag: a tag of an application, which [`documents`] passes over. Texts that are no YAML have none.
pub fn tagged_texts(source: &Source, key: &str) -> Vec<(Option<String>, String)> {
    let indented = Indented::of(source.text());
    let mut parser = Parser::new_from_str(&indented.text);
    let mut next = || parser.next_event().and_then(Result::ok).map(|(event, _)| event);
    let (mut found, mut depth, mut is_key, mut is_wanted) = (Vec::new(), 0, true, false);
    while let Some(event) = next() {
        match event {
            Event::MappingStart(..) | Event::SequenceStart(..) => depth += 1,
            Event::MappingEnd | Event::SequenceEnd => {
                depth -= 1;
                is_key |= depth == 1;
                is_wanted &= depth > 1;
            }
            Event::Scalar(text, ..) if depth == 1 && is_key => {
                is_wanted = text == key;
                is_key = false;
            }
            Event::Scalar(..) | Event::Alias(_) if depth == 1 => is_key = true,
            Event::Scalar(text, _, _, tag) if depth == 2 && is_wanted => {
                found.push((tag.map(|tag| tag.suffix.clone()), text.into_owned()));
            }
            Event::DocumentEnd => break,
            _ => {}
        }
    }
    found
}

struct Reader<'a, F> {
    source: &'a Source,
    /// The source's text, but for blanks at the beginning of lines.
    text: &'a str,
    /// Leads from the text to the source.
    original: F,
    parser: Parser<'a, StrInput<'a>>,
    anchors: HashMap<usize, Bson>,
    /// How many more values may come from aliases.
    left: usize,
    /// Whether the documents are elements of a sequence.
    is_inside: bool,
    done: bool,
}

/// An event with its place.
type Found<'a> = (Event<'a>, saphyr_parser::Span);

impl<'a, F: Fn(usize) -> usize> Reader<'a, F> {
    /// The next document.
    fn document(&mut self) -> Result<Option<(Position, Document)>, Diagnostic> {
        loop {
            let Some((event, place)) = self.next()? else { return Ok(None) };
            match event {
                Event::SequenceStart(..) if !self.is_inside => self.is_inside = true,
                Event::SequenceEnd => self.is_inside = false,
                Event::StreamStart
                | Event::StreamEnd
                | Event::DocumentStart(_)
                | Event::DocumentEnd
                | Event::Nothing => {
                    self.anchors.clear();
                }
                event => {
                    let is_empty =
                        matches!(&event, Event::Scalar(text, ScalarStyle::Plain, 0, None) if text.is_empty());
                    if is_empty && !self.is_inside {
                        continue;
                    }
                    return match self.value(event, place, 0)? {
                        Bson::Document(document) => Ok(Some(((place.start.line(), place.start.col() + 1), document))),
                        _ => Err(self.wrong(place, "expected a document, which is a mapping: `key: value`")),
                    };
                }
            }
        }
    }

    fn next(&mut self) -> Result<Option<Found<'a>>, Diagnostic> {
        self.parser.next_event().transpose().map_err(|error: ScanError| {
            let place = self.byte(*error.marker());
            let wrong = Diagnostic::new(self.source, Span::at(place), format!("this is not YAML: {}", error.info()));
            indentation::hint(error.info()).into_iter().fold(wrong, Diagnostic::hint)
        })
    }

    /// The event that has to come inside of a value.
    fn inside(&mut self, start: saphyr_parser::Span) -> Result<Found<'a>, Diagnostic> {
        self.next()?.ok_or_else(|| self.wrong(start, "the value has no end"))
    }

    fn value(&mut self, event: Event<'a>, place: saphyr_parser::Span, depth: usize) -> Result<Bson, Diagnostic> {
        if depth > MAX_DEPTH {
            return Err(self.wrong(place, format!("values nest deeper than {MAX_DEPTH} levels")));
        }
        let (value, anchor) = match event {
            Event::Scalar(text, style, anchor, tag) => {
                let value = scalar(&text, style, tag.as_deref()).map_err(|message| self.wrong(place, message))?;
                (value, anchor)
            }
            Event::SequenceStart(anchor, tag) => {
                self.check_tag(tag.as_deref(), &["seq", "python/tuple"], place)?;
                (self.sequence(place, depth)?, anchor)
            }
            Event::MappingStart(anchor, tag) => {
                self.check_tag(tag.as_deref(), &["map"], place)?;
                (self.mapping(place, depth)?, anchor)
            }
            Event::Alias(id) => {
                let value = self.anchors.get(&id).cloned();
                let value = value.ok_or_else(|| self.wrong(place, "the alias is inside of what it stands for"))?;
                if depth + levels(&value) > MAX_DEPTH {
                    return Err(self.wrong(place, format!("values nest deeper than {MAX_DEPTH} levels")));
                }
                let size = size(&value);
                self.left = self
                    .left
                    .checked_sub(size)
                    .ok_or_else(|| self.wrong(place, format!("aliases stand for more than {MOST_ALIASED} values")))?;
                (value, 0)
            }
            _ => return Err(self.wrong(place, "expected a value")),
        };
        if anchor > 0 {
            self.anchors.insert(anchor, value.clone());
        }
        Ok(value)
    }

    fn sequence(&mut self, start: saphyr_parser::Span, depth: usize) -> Result<Bson, Diagnostic> {
        let mut values = Vec::new();
        loop {
            match self.inside(start)? {
                (Event::SequenceEnd, _) => return Ok(Bson::Array(values)),
                (event, place) => values.push(self.value(event, place, depth + 1)?),
            }
        }
    }

    fn mapping(&mut self, start: saphyr_parser::Span, depth: usize) -> Result<Bson, Diagnostic> {
        let mut document = Document::new();
        let mut given = HashSet::new();
        loop {
            let (key, plain, key_place) = match self.inside(start)? {
                (Event::MappingEnd, _) => break,
                (Event::Scalar(text, style, ..), place) => (text.into_owned(), style == ScalarStyle::Plain, place),
                (_, place) => return Err(self.wrong(place, "expected a key, which is a text, found another value")),
            };
            let (event, place) = self.inside(start)?;
            let value = self.value(event, place, depth + 1)?;
            if plain && key == "<<" {
                for (key, value) in merged(value).ok_or_else(|| self.wrong(place, "`<<` takes mappings"))? {
                    if !document.contains_key(&key) {
                        document.insert(key, value);
                    }
                }
                continue;
            }
            if key.contains('\0') {
                return Err(self.wrong(key_place, "a key cannot hold a NUL character"));
            }
            if !given.insert(key.clone()) {
                return Err(self.wrong(key_place, format!("the key `{key}` is given twice")));
            }
            document.insert(key, value);
        }
        shell::unwrap_extended(document).map_err(|message| self.wrong(start, message))
    }

    fn check_tag(&self, tag: Option<&Tag>, known: &[&str], place: saphyr_parser::Span) -> Result<(), Diagnostic> {
        match tag {
            Some(tag) if !(is_local(tag) || tag.is_yaml_core_schema() && known.contains(&tag.suffix.as_str())) => {
                Err(self.wrong(place, unknown(tag)))
            }
            _ => Ok(()),
        }
    }

    fn wrong(&self, place: saphyr_parser::Span, message: impl Into<String>) -> Diagnostic {
        let (start, end) = (self.byte(place.start), self.byte(place.end));
        Diagnostic::new(self.source, Span::new(start, end.max(start)), message)
    }

    /// The byte of the source at a place, which the parser counts in characters.
    fn byte(&self, place: Marker) -> usize {
        let byte = self.text.char_indices().nth(place.index()).map_or(self.text.len(), |(byte, _)| byte);
        (self.original)(byte)
    }
}

/// Whether a tag is one of an application, like `!url`, also with a prefix that `%TAG` gives it: it says nothing about
/// the value.
fn is_local(tag: &Tag) -> bool {
    !(tag.is_yaml_core_schema() || tag.handle.is_empty() && tag.suffix == "!")
}

fn unknown(tag: &Tag) -> String {
    format!("the tag `{tag}` is not known; leave it out, or write a plain value")
}

/// How many values there are in a value.
fn size(value: &Bson) -> usize {
    match value {
        Bson::Document(document) => 1 + document.values().map(size).sum::<usize>(),
        Bson::Array(values) => 1 + values.iter().map(size).sum::<usize>(),
        _ => 1,
    }
}

/// How deep a value is nested.
fn levels(value: &Bson) -> usize {
    match value {
        Bson::Document(document) => 1 + document.values().map(levels).max().unwrap_or(0),
        Bson::Array(values) => 1 + values.iter().map(levels).max().unwrap_or(0),
        _ => 0,
    }
}

/// What `<<` brings: a mapping, or several, of which the first counts.
fn merged(value: Bson) -> Option<Document> {
    match value {
        Bson::Document(document) => Some(document),
        Bson::Array(values) => {
            let mut all = Document::new();
            for value in values {
                let Bson::Document(document) = value else { return None };
                all.extend(document.into_iter().filter(|(key, _)| !all.contains_key(key)).collect::<Vec<_>>());
            }
            Some(all)
        }
        _ => None,
    }
}

/// A scalar as its tag says, or as it looks where it is plain.
fn scalar(text: &str, style: ScalarStyle, tag: Option<&Tag>) -> Result<Bson, String> {
    let Some(tag) = tag.filter(|tag| !is_local(tag)) else {
        return Ok(if style == ScalarStyle::Plain { plain(text) } else { Bson::String(text.to_owned()) });
    };
    let found = plain(text);
    let value = match (tag.suffix.as_str(), found) {
        ("str" | "!", _) => Some(Bson::String(text.to_owned())),
        ("null", Bson::Null) => Some(Bson::Null),
        ("bool", found @ Bson::Boolean(_)) | ("int", found @ (Bson::Int32(_) | Bson::Int64(_))) => Some(found),
        ("float", Bson::Double(number)) => Some(Bson::Double(number)),
        ("float", Bson::Int32(number)) => Some(Bson::Double(number.into())),
        ("float", Bson::Int64(number)) => Some(Bson::Double(number as f64)),
        ("timestamp", found @ Bson::DateTime(_)) => Some(found),
        ("binary", _) => {
            let digits: String = text.chars().filter(|c| !c.is_whitespace()).collect();
            let bytes = STANDARD.decode(digits).ok();
            bytes.map(|bytes| Bson::Binary(Binary { subtype: BinarySubtype::Generic, bytes }))
        }
        ("null" | "bool" | "int" | "float" | "timestamp", _) => None,
        _ => return Err(unknown(tag)),
    };
    value.ok_or_else(|| format!("`{text}` is not a value of the tag `{tag}`"))
}

/// A plain scalar.
fn plain(text: &str) -> Bson {
    match text {
        "" | "~" | "null" | "Null" | "NULL" => return Bson::Null,
        "true" | "True" | "TRUE" => return Bson::Boolean(true),
        "false" | "False" | "FALSE" => return Bson::Boolean(false),
        ".nan" | ".NaN" | ".NAN" => return Bson::Double(f64::NAN),
        _ => {}
    }
    let (sign, unsigned) = match text.strip_prefix('-') {
        Some(rest) => (-1.0, rest),
        None => (1.0, text.strip_prefix('+').unwrap_or(text)),
    };
    if [".inf", ".Inf", ".INF"].contains(&unsigned) {
        return Bson::Double(sign * f64::INFINITY);
    }
    number(text, unsigned).or_else(|| date(text)).unwrap_or_else(|| Bson::String(text.to_owned()))
}

/// An integer, in decimal, octal (`0o17`) or hexadecimal (`0x1F`), or a decimal number.
fn number(text: &str, unsigned: &str) -> Option<Bson> {
    let based = |prefix, base| text.strip_prefix(prefix).map(|digits| i64::from_str_radix(digits, base).ok());
    if let Some(number) = based("0o", 8).or_else(|| based("0x", 16)) {
        return number.map(smallest);
    }
    let is_digit = |c: char| c.is_ascii_digit();
    let is_number =
        unsigned.starts_with(is_digit) || unsigned.strip_prefix('.').is_some_and(|rest| rest.starts_with(is_digit));
    if !is_number || !unsigned.chars().all(|c| is_digit(c) || "+-.eE".contains(c)) {
        return None;
    }
    match text.parse::<i64>() {
        Ok(number) => Some(smallest(number)),
        Err(_) => text.parse::<f64>().ok().filter(|number| number.is_finite()).map(Bson::Double),
    }
}

/// An integer in the smallest type that holds it.
fn smallest(number: i64) -> Bson {
    i32::try_from(number).map_or(Bson::Int64(number), Bson::Int32)
}

/// A date, with or without a time.
fn date(text: &str) -> Option<Bson> {
    let dashes = (text.as_bytes().get(4), text.as_bytes().get(7));
    if dashes != (Some(&b'-'), Some(&b'-')) {
        return None;
    }
    shell::parse_date(text).map(|millis| Bson::DateTime(DateTime::from_millis(millis)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::doc;

    fn read(text: &str) -> Result<Vec<Document>, String> {
        let source = Source::new("x.yaml", text);
        let documents = documents(&source).map(|read| read.map(|(_, document)| document));
        documents.collect::<Result<_, _>>().map_err(|error| error.to_string())
    }

    #[test]
    fn documents_come_one_after_another_or_in_a_sequence() {
        let wanted = Ok(vec![doc! { "a": 1 }, doc! { "b": { "c": [1, "x"] } }]);
        assert_eq!(read("a: 1\n---\nb:\n  c: [1, x]\n"), wanted);
        assert_eq!(read("- a: 1\n- b: {c: [1, 'x']}\n"), wanted);
        assert_eq!(read("%YAML 1.2\n---\n- {a: 1}\n---\n- b:\n    c:\n    - 1\n    - \"x\"\n...\n"), wanted);
        for empty in ["", "# nothing\n", "---\n", "[]\n"] {
            assert_eq!(read(empty), Ok(vec![]), "{empty:?}");
        }
    }

    #[test]
    fn brackets_and_quotes_go_on_in_lines_that_are_not_indented() {
        for (text, wanted) in [
            ("a: [1,\n2]\nb: 3\n", doc! { "a": [1, 2], "b": 3 }),
            ("p:\n  a: [\"x\",\n  \"y\"]\n  b: 1\n", doc! { "p": { "a": ["x", "y"], "b": 1 } }),
            ("p:\n  a: {x: 1,\ny: [2,\n3], # ]\n z: \"}\n]\"}\nb: it's\n", {
                doc! { "p": { "a": { "x": 1, "y": [2, 3], "z": "} ]" } }, "b": "it's" }
            }),
            ("p:\n  a: \"x\ny \\\"\n\n z\"\n  b: 'q\nr'\n", doc! { "p": { "a": "x y \"\nz", "b": "q r" } }),
            ("a: [x y\nz, q\n]\nb: |\n  [1,\n  2\nc: [1,\n2]\n", {
                doc! { "a": ["x y z", "q"], "b": "[1,\n2\n", "c": [1, 2] }
            }),
        ] {
            assert_eq!(read(text), Ok(vec![wanted]), "{text}");
        }
        let text = "a: [1,\n2,\n3]\n---\n- b\n";
        let source = Source::new("x.yaml", text);
        let mut all = documents(&source);
        assert_eq!(all.next().unwrap().unwrap(), ((1, 1), doc! { "a": [1, 2, 3] }));
        let error = all.next().unwrap().unwrap_err().to_string();
        assert!(error.starts_with("x.yaml:5:3: expected a document") && error.contains("5 | - b\n  |   ^"), "{error}");
    }

    #[test]
    fn scalars_are_what_they_look_like() {
        let text = "n: [1, -7, 0x1F, 0o17, 9007199254740993, 1.5, .5, 1e3, -.inf, +12]\n\
                    t: [true, False, null, ~, ]\n\
                    s: ['1', \"true\", 1.2.3, yes, 10-20, -x, 12ab, 0x, 1_000]\n\
                    d: [2026-01-31, 2026-01-31T12:00:00Z, 2026-01-31 12:00:00.5+01:00]\n\
                    k: !!str 5\nf: !!float 3\nb: !!binary Zm9v\ntext: |\n  two\n  lines\n";
        let date = |text: &str| DateTime::from_millis(shell::parse_date(text).unwrap());
        let bytes = Binary { subtype: BinarySubtype::Generic, bytes: b"foo".to_vec() };
        let wanted = doc! {
            "n": [1, -7, 31, 15, 9_007_199_254_740_993_i64, 1.5, 0.5, 1000.0, f64::NEG_INFINITY, 12],
            "t": [true, false, null, null],
            "s": ["1", "true", "1.2.3", "yes", "10-20", "-x", "12ab", "0x", "1_000"],
            "d": [date("2026-01-31"), date("2026-01-31T12:00:00Z"), date("2026-01-31T11:00:00.500Z")],
            "k": "5", "f": 3.0, "b": bytes, "text": "two\nlines\n",
        };
        assert_eq!(read(text), Ok(vec![wanted]));
    }

    #[test]
    fn tags_of_applications_say_nothing() {
        let text = "%TAG ! tag:robots.example,2026/\n---\nurl: !url http://localhost/x\nn: !count 3\nt: !text '3'\nm: !pose {x: !m 1.5}\nl: !list [1]\n";
        let wanted = doc! { "url": "http://localhost/x", "n": 3, "t": "3", "m": { "x": 1.5 }, "l": [1] };
        assert_eq!(read(text), Ok(vec![wanted]));
    }

    #[test]
    fn the_texts_of_a_sequence_are_there_with_their_tags() {
        let text = "%TAG ! tag:robots.example,2026/\n---\nb: [x, {include: [y]}]\nc: z\ninclude:\n- !maybe a/\n- b.yaml\nd: [q]\n---\ninclude: [n]\n";
        let wanted = [(Some("maybe".to_owned()), "a/".to_owned()), (None, "b.yaml".to_owned())];
        assert_eq!(tagged_texts(&Source::new("x.yaml", text), "include"), wanted);
        assert_eq!(tagged_texts(&Source::new("x.yaml", "include: x\n- ]"), "include"), []);
    }

    #[test]
    fn extended_json_anchors_and_merges_are_resolved() {
        let text =
            "- &base {frame: map, at: {$date: '2026-01-31T12:00:00Z'}}\n- <<: *base\n  frame: odom\n  again: *base\n";
        let at = DateTime::from_millis(shell::parse_date("2026-01-31T12:00:00Z").unwrap());
        let base = doc! { "frame": "map", "at": at };
        assert_eq!(read(text), Ok(vec![base.clone(), doc! { "frame": "odom", "at": at, "again": base }]));
    }

    #[test]
    fn what_is_wrong_is_told_with_its_place() {
        for (text, place) in [
            ("a: 1\na: 2\n", "x.yaml:2:1: the key `a` is given twice"),
            ("a: [1\n", "x.yaml:2:1: this is not YAML"),
            ("ä: 'é'\nb: !!robot 3\n", "x.yaml:2:"),
            ("- a: 1\n- 7\n", "x.yaml:2:3: expected a document, which is a mapping"),
            ("just text\n", "x.yaml:1:1: expected a document, which is a mapping"),
            ("a: {$oid: 3}\n", "x.yaml:1:4: `$oid` takes a string of 24 hexadecimal digits"),
            ("[1, 2]: 3\n", "x.yaml:1:1: expected a key"),
            ("a: !!int x\n", "x.yaml:1:"),
            ("a: &a [*a]\n", "x.yaml:1:"),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.starts_with(place), "{text:?}: {error}");
        }
    }

    #[test]
    fn what_would_fill_the_memory_is_refused() {
        let mut text = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n".to_owned();
        for level in 1..9 {
            let aliases = vec![format!("*a{}", level - 1); 10].join(", ");
            text += &format!("a{level}: &a{level} [{aliases}]\n");
        }
        assert!(read(&text).unwrap_err().contains("aliases stand for more than"));
        let mut text = format!("a0: &a0 {}1{}\n", "[".repeat(150), "]".repeat(150));
        text += &format!("a1: {}*a0{}\n", "[".repeat(100), "]".repeat(100));
        assert!(read(&text).unwrap_err().contains("nest deeper"));
        for deep in ["[".repeat(100_000), "{a: ".repeat(100_000), "- ".repeat(100_000), "? ".repeat(10_000)] {
            assert!(read(&deep).is_err());
        }
    }
}
