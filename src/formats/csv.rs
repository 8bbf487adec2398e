//! Documents in rows of values that are separated by commas or tabs, below a row of keys.
//!
//! A key may say its type, as for `mongoimport --columnsHaveTypes`: `count.int32()`. Where it does not, a value is a number,
//! true or false, a date with time and zone, JSON in braces or brackets, or else a text: what `--format csv` writes. A
//! number may be spelled as for mongoimport (`+5`, `.5`, `5.`, `1e3`, `NaN`, `-inf`); one with zeros in front is a
//! text. An empty value is left out. `pose.x` is the key `x` of the document at `pose`. Quotes are those of RFC 4180;
//! the parser is the crate `csv-core`.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use bson::{Binary, Bson, DateTime, Decimal128, Document, oid::ObjectId, spec::BinarySubtype};
use csv_core::{ReadFieldResult, Reader, ReaderBuilder};

use super::shell;
use super::{Diagnostic, Source, Span, nearest};

/// The types that a key may say.
const KINDS: [(&str, Kind); 10] = [
    ("auto", Kind::Auto),
    ("string", Kind::Text),
    ("int32", Kind::Int32),
    ("int64", Kind::Int64),
    ("double", Kind::Double),
    ("decimal", Kind::Decimal),
    ("boolean", Kind::Boolean),
    ("date", Kind::Date),
    ("binary", Kind::Binary),
    ("objectId", Kind::ObjectId),
];

/// The type of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Auto,
    Text,
    Int32,
    Int64,
    Double,
    Decimal,
    Boolean,
    Date,
    Binary,
    ObjectId,
}

/// The documents of a text with this delimiter, each with the line, from 1, where its row begins, once the rows before it are
/// read. After an error nothing more comes.
pub fn documents(source: &Source, delimiter: u8) -> impl Iterator<Item = Result<(usize, Document), Diagnostic>> {
    // Some programs put a byte order mark before the first key.
    let at = source.text().len() - source.text().trim_start_matches('\u{FEFF}').len();
    let reader = ReaderBuilder::new().delimiter(delimiter).build();
    let mut rows = Rows { source, reader, at, counted: 0, line: 1 };
    let mut columns = None;
    let mut done = false;
    std::iter::from_fn(move || {
        if done {
            return None;
        }
        let read = next(&mut rows, &mut columns).transpose();
        done = !matches!(read, Some(Ok(_)));
        read
    })
}

/// The next document; the first row gives the columns.
fn next(rows: &mut Rows<'_>, columns: &mut Option<Vec<Column>>) -> Result<Option<(usize, Document)>, Diagnostic> {
    let columns = match columns {
        Some(columns) => columns,
        None => {
            let Some(header) = rows.row()? else { return Ok(None) };
            columns.insert(self::columns(rows.source, header)?)
        }
    };
    let Some(fields) = rows.row()? else { return Ok(None) };
    if fields.len() != columns.len() {
        let place = fields.get(columns.len()).or(fields.last()).map_or(Span::at(rows.at), |(_, span)| *span);
        let message =
            format!("expected {} values, as many as keys in the first row, found {}", columns.len(), fields.len());
        return Err(Diagnostic::new(rows.source, place, message));
    }
    let line = fields.first().map_or(1, |(_, first)| rows.line_of(first.start));
    let mut document = Document::new();
    for (column, (text, span)) in columns.iter().zip(fields) {
        if !text.is_empty() {
            let value = column.kind.value(&text).map_err(|what| {
                Diagnostic::new(
                    rows.source,
                    span,
                    format!("expected {what} for `{}`, found `{text}`", column.path.join(".")),
                )
            })?;
            put(&mut document, &column.path, value);
        }
    }
    Ok(Some((line, document)))
}

/// A column: where its values go.
struct Column {
    path: Vec<String>,
    kind: Kind,
}

/// The columns of the first row.
fn columns(source: &Source, header: Vec<(String, Span)>) -> Result<Vec<Column>, Diagnostic> {
    if let [(only, span)] = header.as_slice()
        && only.contains(';')
    {
        let message = format!("the first row is one key, `{only}`; expected keys with commas between them");
        let hint = "a spreadsheet can save with commas, or with tabs: then the file's name ends in .tsv";
        return Err(Diagnostic::new(source, *span, message).hint(hint));
    }
    let mut columns: Vec<Column> = Vec::with_capacity(header.len());
    for (text, span) in header {
        let wrong = |message: String| Diagnostic::new(source, span, message);
        let (key, kind) = match text.strip_suffix("()").and_then(|typed| typed.rsplit_once('.')) {
            Some((key, name)) => match KINDS.iter().find(|(known, _)| *known == name) {
                Some((_, kind)) => (key, *kind),
                None => {
                    let known = KINDS.map(|(known, _)| known);
                    let error = wrong(format!("unknown type `{name}`; expected one of {}", known.join(", ")));
                    let hint = nearest(name, known).map(|near| format!("did you mean `{near}`?"));
                    return Err(hint.into_iter().fold(error, Diagnostic::hint));
                }
            },
            None => (text.as_str(), Kind::Auto),
        };
        let path: Vec<String> = key.split('.').map(str::to_owned).collect();
        if text.is_empty() {
            return Err(no_heading(wrong(format!("column {} has no heading", columns.len() + 1)), columns.is_empty()));
        }
        if path.iter().any(String::is_empty) || key.contains('\0') {
            return Err(wrong(format!("expected a key, found `{text}`")));
        }
        if path.len() > shell::MAX_DEPTH {
            return Err(wrong(format!("values nest deeper than {} levels", shell::MAX_DEPTH)));
        }
        let is_within = |a: &[String], b: &[String]| a.starts_with(b) || b.starts_with(a);
        if let Some(other) = columns.iter().find(|other| is_within(&other.path, &path)) {
            let other = other.path.join(".");
            let error = wrong(format!("`{key}` and `{other}` cannot both be keys of one document"));
            let are_numbers = number(key).is_some() && number(&other).is_some();
            let hint =
                are_numbers.then_some("the first row has to name the columns; put their names in front of the values");
            return Err(hint.into_iter().fold(error, Diagnostic::hint));
        }
        columns.push(Column { path, kind });
    }
    Ok(columns)
}

/// Says what to do about a column without a heading; the first one may be the index of pandas.
fn no_heading(error: Diagnostic, is_first: bool) -> Diagnostic {
    let hint = "name it in the first row";
    match is_first {
        true => error.hint(format!("{hint}; pandas leaves its index out with df.to_csv(FILE, index=False)")),
        false => error.hint(hint),
    }
}

/// Puts a value at a path.
fn put(document: &mut Document, path: &[String], value: Bson) {
    match path {
        [] => {}
        [key] => drop(document.insert(key, value)),
        [key, rest @ ..] => {
            if let Bson::Document(inner) = document.entry(key.clone()).or_insert_with(|| Document::new().into()) {
                put(inner, rest, value);
            }
        }
    }
}

impl Kind {
    /// The value of a text that is not empty; the error is what was expected.
    fn value(self, text: &str) -> Result<Bson, &'static str> {
        let trimmed = text.trim();
        match self {
            Self::Auto => Ok(guess(text)),
            Self::Text => Ok(Bson::String(text.to_owned())),
            Self::Int32 => trimmed.parse().map(Bson::Int32).map_err(|_| "an integer of 32 bits"),
            Self::Int64 => trimmed.parse().map(Bson::Int64).map_err(|_| "an integer of 64 bits"),
            Self::Double => trimmed.parse().map(Bson::Double).map_err(|_| "a number"),
            Self::Decimal => trimmed.parse::<Decimal128>().map(Bson::Decimal128).map_err(|_| "a decimal number"),
            Self::Boolean => match trimmed.to_ascii_lowercase().as_str() {
                "true" | "1" => Ok(Bson::Boolean(true)),
                "false" | "0" => Ok(Bson::Boolean(false)),
                _ => Err("true or false"),
            },
            Self::Date => date(trimmed).ok_or("a date, like 2026-01-31T12:00:00Z"),
            Self::Binary => match STANDARD.decode(trimmed) {
                Ok(bytes) => Ok(Bson::Binary(Binary { subtype: BinarySubtype::Generic, bytes })),
                Err(_) => Err("bytes in base64"),
            },
            Self::ObjectId => ObjectId::parse_str(trimmed).map(Bson::ObjectId).map_err(|_| "24 hexadecimal digits"),
        }
    }
}

fn date(text: &str) -> Option<Bson> {
    shell::parse_date(text).map(|millis| Bson::DateTime(DateTime::from_millis(millis)))
}

/// The value of a column without a type.
fn guess(text: &str) -> Bson {
    match text {
        "true" => return Bson::Boolean(true),
        "false" => return Bson::Boolean(false),
        _ => {}
    }
    let is_date =
        text.contains('T') && (text.ends_with('Z') || text.get(19..).is_some_and(|zone| zone.contains(['+', '-'])));
    let found = match text.as_bytes().first() {
        Some(b'{' | b'[') => shell::parse_value(&Source::new("", text)).ok(),
        _ if is_date => date(text),
        _ => number(text),
    };
    found.unwrap_or_else(|| Bson::String(text.to_owned()))
}

/// The number that a text is, as for mongoimport: `5`, `+5`, `.5`, `5.`, `1e3`, `NaN`, `-inf`. One with zeros in front is
/// a text (mongoimport takes `007` for 7, and so loses what postal codes and part numbers begin with).
fn number(text: &str) -> Option<Bson> {
    let unsigned = text.strip_prefix(['-', '+']).unwrap_or(text);
    // In any case of the letters, as Go reads them; only the infinities have a sign.
    let is_infinite = ["inf", "infinity"].iter().any(|name| unsigned.eq_ignore_ascii_case(name));
    if is_infinite || text.eq_ignore_ascii_case("nan") {
        return text.parse().ok().map(Bson::Double);
    }
    let is_padded = matches!(unsigned.as_bytes(), [b'0', b'0'..=b'9', ..]);
    let is_number = unsigned.starts_with(|c: char| c.is_ascii_digit() || c == '.')
        && unsigned.bytes().all(|byte| byte.is_ascii_digit() || b"+-.eE".contains(&byte));
    if !is_number || is_padded {
        return None;
    }
    let plain = text.strip_prefix('+').unwrap_or(text);
    let large = || text.parse::<f64>().ok().filter(|number| number.is_finite()).map(Bson::Double);
    shell::parse_number(plain).or_else(large)
}

/// The rows of a text, each field with its place.
struct Rows<'a> {
    source: &'a Source,
    reader: Reader,
    at: usize,
    /// Up to where lines are counted, and the line there.
    counted: usize,
    line: usize,
}

impl Rows<'_> {
    /// The line of a place behind all that were asked for before.
    fn line_of(&mut self, place: usize) -> usize {
        let passed = self.source.text().get(self.counted..place).unwrap_or_default();
        self.line += passed.matches('\n').count();
        self.counted = place;
        self.line
    }

    fn row(&mut self) -> Result<Option<Vec<(String, Span)>>, Diagnostic> {
        let mut fields = Vec::new();
        while let Some((text, span, is_last)) = self.field()? {
            fields.push((text, span));
            if is_last {
                return Ok(Some(fields));
            }
        }
        Ok(None)
    }

    /// The next field, and whether it is the last of its row.
    fn field(&mut self) -> Result<Option<(String, Span, bool)>, Diagnostic> {
        let text = self.source.text();
        let start = self.at;
        let (mut out, mut length) = (vec![0; 64], 0);
        let is_last = loop {
            let rest = text.as_bytes().get(self.at..).unwrap_or_default();
            let (result, read, written) = self.reader.read_field(rest, out.get_mut(length..).unwrap_or_default());
            self.at += read;
            length += written;
            match result {
                ReadFieldResult::InputEmpty => {}
                ReadFieldResult::OutputFull => out.resize(out.len() * 2, 0),
                ReadFieldResult::Field { record_end } => break record_end,
                ReadFieldResult::End => return Ok(None),
            }
        };
        // Blank lines belong to no field.
        let raw = text.get(start..self.at).unwrap_or_default();
        let skipped = raw.len() - raw.trim_start_matches(['\r', '\n']).len();
        let raw = raw.get(skipped..).unwrap_or_default();
        let start = start + skipped;
        if self.at == text.len() && raw.starts_with('"') && raw.matches('"').count() % 2 == 1 {
            let error = Diagnostic::new(self.source, Span::at(start), "the quoted value has no end");
            return Err(error.hint("a quote inside of a quoted value is written twice"));
        }
        let field = String::from_utf8_lossy(out.get(..length).unwrap_or_default()).into_owned();
        let shown = raw.trim_end_matches(['\r', '\n', ',', '\t', ';']).len();
        Ok(Some((field, Span::new(start, start + shown), is_last)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::doc;

    fn read(text: &str) -> Result<Vec<Document>, String> {
        let source = Source::new("x.csv", text);
        let documents = documents(&source, b',').map(|read| read.map(|(_, document)| document));
        documents.collect::<Result<_, _>>().map_err(|error| error.to_string())
    }

    #[test]
    fn values_are_what_they_look_like() {
        let text = "\u{FEFF}name,n,pose.x,pose.y,ok,at,more\r\n\
                    cup,3,1.5,-2,true,2026-01-02T03:04:05Z,\"{a: [1, 2]}\"\r\n\r\n\
                    \"a \"\"b\"\", c\",007,1e3,,no,2026-01-02,{x\r\n\"two\nlines\",-0.5,0,9007199254740993,,,[1]";
        let at = DateTime::from_millis(shell::parse_date("2026-01-02T03:04:05Z").unwrap());
        let wanted = vec![
            doc! { "name": "cup", "n": 3, "pose": { "x": 1.5, "y": -2 }, "ok": true, "at": at, "more": { "a": [1, 2] } },
            doc! { "name": "a \"b\", c", "n": "007", "pose": { "x": 1000.0 }, "ok": "no", "at": "2026-01-02", "more": "{x" },
            doc! { "name": "two\nlines", "n": -0.5, "pose": { "x": 0, "y": 9_007_199_254_740_993_i64 }, "more": [1] },
        ];
        assert_eq!(read(text), Ok(wanted));
        for empty in ["", "\n\n", "a,b\n"] {
            assert_eq!(read(empty), Ok(vec![]), "{empty:?}");
        }
    }

    #[test]
    fn numbers_are_spelled_as_for_mongoimport() {
        for (text, wanted) in [
            (".5", Bson::Double(0.5)),
            ("-.5", Bson::Double(-0.5)),
            ("5.", Bson::Double(5.0)),
            ("+5", Bson::Int32(5)),
            ("+.5e1", Bson::Double(5.0)),
            ("1e3", Bson::Double(1000.0)),
            ("-Infinity", Bson::Double(f64::NEG_INFINITY)),
            ("-inf", Bson::Double(f64::NEG_INFINITY)),
            ("INF", Bson::Double(f64::INFINITY)),
            ("0.5", Bson::Double(0.5)),
            ("0", Bson::Int32(0)),
            ("-3000000000", Bson::Int64(-3_000_000_000)),
        ] {
            assert_eq!(guess(text), wanted, "{text}");
        }
        for text in ["NaN", "nan"] {
            assert!(matches!(guess(text), Bson::Double(number) if number.is_nan()), "{text}");
        }
        for text in [
            "-nan",
            "infinite",
            "007",
            "-007",
            "+00.5",
            ".",
            "+",
            "-",
            "e5",
            ".e",
            "1e",
            "1e999",
            "1.2.3",
            "2026-01-02",
            "0x10",
            "1_000",
            " 5",
        ] {
            assert_eq!(guess(text), Bson::String(text.to_owned()));
        }
    }

    #[test]
    fn a_key_says_the_type_of_its_values() {
        let text = "a.string(),b.int32(),c.int64(),d.double(),e.decimal(),f.boolean(),g.date(),h.binary(),_id.objectId(),k.auto()\n\
                    1,2,3,4,5.10,1,2026-01-02,Zm9v,507f1f77bcf86cd799439011,x\n";
        let wanted = doc! {
            "a": "1", "b": 2, "c": 3_i64, "d": 4.0, "e": "5.10".parse::<Decimal128>().unwrap(), "f": true,
            "g": DateTime::from_millis(shell::parse_date("2026-01-02").unwrap()),
            "h": Binary { subtype: BinarySubtype::Generic, bytes: b"foo".to_vec() },
            "_id": ObjectId::parse_str("507f1f77bcf86cd799439011").unwrap(), "k": "x",
        };
        assert_eq!(read(text), Ok(vec![wanted]));
    }

    #[test]
    fn what_is_wrong_is_told_with_its_place() {
        for (text, place) in [
            ("a,b\n1,2\n3\n", "x.csv:3:1: expected 2 values, as many as keys in the first row, found 1"),
            ("a,b\n1,2,3\n", "x.csv:2:5: expected 2 values"),
            ("a,n.int32()\nx,1\ny,1.5\n", "x.csv:3:3: expected an integer of 32 bits for `n`, found `1.5`"),
            ("a.int23()\n", "x.csv:1:1: unknown type `int23`"),
            ("a,,b\n", "x.csv:1:3: column 2 has no heading"),
            (",a\n0,1\n", "x.csv:1:1: column 1 has no heading"),
            ("a.,b\n", "x.csv:1:1: expected a key, found `a.`"),
            ("pose,pose.x\n", "x.csv:1:6: `pose.x` and `pose` cannot both be keys"),
            ("a\n\"x\ny\n", "x.csv:2:1: the quoted value has no end"),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.starts_with(place), "{text:?}: {error}");
        }
        for (text, hint) in [
            (
                ",a\n0,1\n",
                "hint: name it in the first row; pandas leaves its index out with df.to_csv(FILE, index=False)",
            ),
            ("1,2.5,1\n", "hint: the first row has to name the columns; put their names in front of the values"),
            ("1,1.5\n", "hint: the first row has to name the columns; put their names in front of the values"),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.ends_with(hint), "{text:?}: {error}");
        }
        assert!(!read("a,a\n").unwrap_err().contains("hint"));
    }
}
