//! BSON to Extended JSON v2.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use bson::{Bson, Document, RawDocumentBuf, doc};

use super::date;

/// The document in relaxed Extended JSON, on one line, keys in the document's order.
#[must_use]
pub fn relaxed(document: &Document) -> String {
    let mut text = String::new();
    Writer { out: &mut text, canonical: false, indent: None }.document(document, 0);
    text
}

/// The document in canonical Extended JSON, on one line: every type survives.
#[must_use]
pub fn canonical(document: &Document) -> String {
    let mut text = String::new();
    Writer { out: &mut text, canonical: true, indent: None }.document(document, 0);
    text
}

/// Any value in relaxed Extended JSON, on one line.
#[must_use]
pub fn relaxed_value(value: &Bson) -> String {
    let mut out = String::new();
    write_relaxed(value, &mut out);
    out
}

/// Any value in canonical Extended JSON, on one line.
#[must_use]
pub fn canonical_value(value: &Bson) -> String {
    let mut out = String::new();
    write_canonical(value, &mut out);
    out
}

/// Relaxed Extended JSON over several lines, two blanks per level.
#[must_use]
pub fn pretty(value: &Bson) -> String {
    let mut text = String::new();
    Writer { out: &mut text, canonical: false, indent: Some(2) }.value(value, 0);
    text
}

/// Appends any value in relaxed Extended JSON.
pub fn write_relaxed(value: &Bson, out: &mut String) {
    Writer { out, canonical: false, indent: None }.value(value, 0);
}

/// Appends any value in canonical Extended JSON.
pub fn write_canonical(value: &Bson, out: &mut String) {
    Writer { out, canonical: true, indent: None }.value(value, 0);
}

/// A value as a person would type it: keys bare where they may be, texts and dates in the shell's spelling.
#[must_use]
pub fn typed(value: &Bson) -> String {
    let is_part = |c: char| c.is_alphanumeric() || matches!(c, '_' | '$');
    let is_bare = |key: &str| !key.is_empty() && key.chars().all(is_part) && !key.starts_with(char::is_numeric);
    match value {
        Bson::Document(document) => {
            let pairs = document.iter().map(|(key, value)| match is_bare(key) {
                true => format!("{key}: {}", typed(value)),
                false => format!("'{key}': {}", typed(value)),
            });
            format!("{{{}}}", pairs.collect::<Vec<_>>().join(", "))
        }
        Bson::DateTime(date) => match date.try_to_rfc3339_string() {
            Ok(text) => format!("ISODate('{text}')"),
            Err(_) => relaxed_value(value),
        },
        Bson::ObjectId(id) => format!("ObjectId('{id}')"),
        other => relaxed_value(other),
    }
}

struct Writer<'a> {
    out: &'a mut String,
    canonical: bool,
    indent: Option<usize>,
}

impl Writer<'_> {
    fn value(&mut self, value: &Bson, level: usize) {
        match value {
            Bson::Document(document) => self.document(document, level),
            Bson::Array(values) => self.array(values, level),
            Bson::String(text) => self.string(text),
            Bson::Boolean(flag) => self.plain(flag),
            Bson::Null => self.plain("null"),
            Bson::Int32(number) if self.canonical => self.quoted("$numberInt", number),
            Bson::Int32(number) => self.plain(number),
            Bson::Int64(number) if self.canonical => self.quoted("$numberLong", number),
            Bson::Int64(number) => self.plain(number),
            Bson::Double(number) => self.double(*number),
            Bson::DateTime(date) => self.date(date.timestamp_millis()),
            other => self.typed(other, level),
        }
    }

    fn typed(&mut self, value: &Bson, level: usize) {
        match value {
            Bson::ObjectId(id) => self.quoted("$oid", id.to_hex()),
            Bson::Decimal128(number) => self.quoted("$numberDecimal", number),
            Bson::Symbol(text) => self.wrapped("$symbol", |this| this.string(text)),
            Bson::Binary(binary) => {
                let subtype = u8::from(binary.subtype);
                let base64 = STANDARD.encode(&binary.bytes);
                self.wrapped("$binary", |this| {
                    this.fields(&[("base64", &base64), ("subType", &format!("{subtype:02x}"))]);
                });
            }
            Bson::RegularExpression(regex) => self.wrapped("$regularExpression", |this| {
                this.fields(&[("pattern", regex.pattern.as_str()), ("options", regex.options.as_str())]);
            }),
            Bson::Timestamp(stamp) => {
                let _ = write!(self.out, "{{\"$timestamp\":{{\"t\":{},\"i\":{}}}}}", stamp.time, stamp.increment);
            }
            Bson::JavaScriptCode(code) => self.wrapped("$code", |this| this.string(code)),
            Bson::JavaScriptCodeWithScope(code) => self.wrapped("$code", |this| {
                this.string(&code.code);
                this.out.push_str(",\"$scope\":");
                this.document(&code.scope, level + 1);
            }),
            Bson::DbPointer(_) => self.pointer(value),
            Bson::MinKey => self.plain("{\"$minKey\":1}"),
            Bson::MaxKey => self.plain("{\"$maxKey\":1}"),
            Bson::Undefined => self.plain("{\"$undefined\":true}"),
            _ => self.plain("null"),
        }
    }

    fn plain(&mut self, value: impl std::fmt::Display) {
        let _ = write!(self.out, "{value}");
    }

    fn quoted(&mut self, key: &str, value: impl std::fmt::Display) {
        let _ = write!(self.out, "{{\"{key}\":\"{value}\"}}");
    }

    fn wrapped(&mut self, key: &str, inner: impl FnOnce(&mut Self)) {
        let _ = write!(self.out, "{{\"{key}\":");
        inner(self);
        self.out.push('}');
    }

    fn fields(&mut self, fields: &[(&str, &str)]) {
        for (index, (key, value)) in fields.iter().enumerate() {
            self.out.push(if index == 0 { '{' } else { ',' });
            let _ = write!(self.out, "\"{key}\":");
            self.string(value);
        }
        self.out.push('}');
    }

    /// A decimal point or an exponent is always there, so that it reads back as a double.
    fn double(&mut self, number: f64) {
        let text = match number {
            _ if number.is_nan() => "NaN".to_owned(),
            _ if number.is_infinite() => if number > 0.0 { "Infinity" } else { "-Infinity" }.to_owned(),
            _ => format!("{number:?}"),
        };
        if self.canonical || !number.is_finite() {
            self.quoted("$numberDouble", text);
        } else {
            self.out.push_str(&text);
        }
    }

    fn date(&mut self, millis: i64) {
        match date::format(millis).filter(|_| !self.canonical) {
            Some(text) => self.quoted("$date", text),
            None => self.wrapped("$date", |this| this.quoted("$numberLong", millis)),
        }
    }

    /// The driver shows a pointer's parts only in its bytes:
    /// the document's length (4), type and key (3), the text's length (4), the text, NUL, the id (12), NUL.
    fn pointer(&mut self, value: &Bson) {
        let raw = RawDocumentBuf::try_from(&doc! { "p": value.clone() }).map(RawDocumentBuf::into_bytes);
        let bytes = raw.unwrap_or_default();
        let text = bytes.get(11..bytes.len().saturating_sub(14)).unwrap_or_default();
        let id = bytes.get(bytes.len().saturating_sub(13)..bytes.len().saturating_sub(1)).unwrap_or_default();
        let hex: String = id.iter().map(|byte| format!("{byte:02x}")).collect();
        self.wrapped("$dbPointer", |this| {
            this.out.push_str("{\"$ref\":");
            this.string(&String::from_utf8_lossy(text));
            this.out.push_str(",\"$id\":");
            this.quoted("$oid", hex);
            this.out.push('}');
        });
    }

    fn document(&mut self, document: &Document, level: usize) {
        self.out.push('{');
        for (index, (key, value)) in document.iter().enumerate() {
            self.separate(index, level + 1);
            self.string(key);
            self.out.push(':');
            if self.indent.is_some() {
                self.out.push(' ');
            }
            self.value(value, level + 1);
        }
        self.close(document.is_empty(), level, '}');
    }

    fn array(&mut self, values: &[Bson], level: usize) {
        self.out.push('[');
        for (index, value) in values.iter().enumerate() {
            self.separate(index, level + 1);
            self.value(value, level + 1);
        }
        self.close(values.is_empty(), level, ']');
    }

    fn separate(&mut self, index: usize, level: usize) {
        if index > 0 {
            self.out.push(',');
        }
        self.line(level);
    }

    fn close(&mut self, empty: bool, level: usize, bracket: char) {
        if !empty {
            self.line(level);
        }
        self.out.push(bracket);
    }

    fn line(&mut self, level: usize) {
        if let Some(width) = self.indent {
            self.out.push('\n');
            self.out.extend(std::iter::repeat_n(' ', width * level));
        }
    }

    fn string(&mut self, text: &str) {
        self.out.push('"');
        let mut start = 0;
        for (index, byte) in text.bytes().enumerate() {
            let escape = match byte {
                b'"' => "\\\"",
                b'\\' => "\\\\",
                b'\n' => "\\n",
                b'\r' => "\\r",
                b'\t' => "\\t",
                0x08 => "\\b",
                0x0c => "\\f",
                0..=0x1f | 0x7f => "",
                _ => continue,
            };
            self.out.push_str(&text[start..index]);
            self.out.push_str(escape);
            if escape.is_empty() {
                let _ = write!(self.out, "\\u{byte:04x}");
            }
            start = index + 1;
        }
        self.out.push_str(&text[start..]);
        self.out.push('"');
    }
}
