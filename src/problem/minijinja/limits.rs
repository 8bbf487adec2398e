//! What a template makes could be larger than any memory: filters of minijinja, and the text itself, each with a bound.

use std::fmt::{self, Write as _};
use std::io;
use std::sync::atomic::{AtomicUsize, Ordering};

use minijinja::value::{Rest, ValueKind};
use minijinja::{Environment, Error, ErrorKind, State, Value, filters};

use super::documents::Documents;
use super::operands::{SIZED, WRITTEN};

/// How many steps of minijinja a template may take: enough for millions of documents.
pub(super) const FUEL: u64 = 500_000_000;
/// The greatest width and count: as many as minijinja's own `range` has members at most.
const MAX: i64 = 100_000;
/// The longest text that `replace` makes, and that an operator takes, in bytes.
const MAX_TEXT: usize = 64 << 20;
/// The longest list that is made of a text, or that is added to another one.
const MAX_ELEMENTS: usize = 4_000_000;
/// The longest text that an operator makes of a list or a map, in bytes.
const MAX_WRITTEN: usize = 4 << 20;
/// Texts that are longer are counted when they are written.
const LONG_TEXT: usize = 1 << 20;

/// The longest text of a template that is held, in bytes, with what notes where its parts come from.
const MAX_RENDERED: usize = 512 << 20;

/// The text of a template, of so many bytes at most.
#[derive(Debug)]
pub(super) struct Rendered {
    bytes: Vec<u8>,
    most: usize,
}

impl Default for Rendered {
    fn default() -> Self {
        Self { bytes: Vec::new(), most: MAX_RENDERED }
    }
}

impl Rendered {
    /// The text.
    ///
    /// # Errors
    /// Where it is no UTF-8, which no template makes.
    pub(super) fn into_text(self) -> Result<String, Error> {
        String::from_utf8(self.bytes)
            .map_err(|error| Error::new(ErrorKind::WriteFailure, "the text is not UTF-8").with_source(error))
    }
}

impl io::Write for Rendered {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.bytes.len() + bytes.len() > self.most {
            return Err(io::Error::other(format!("the template writes more than {} MiB of text", self.most >> 20)));
        }
        self.bytes.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Counts the long texts that a template writes, also into a variable.
#[derive(Debug, Default)]
pub(super) struct Written(AtomicUsize);

impl Written {
    /// Counts a value that is written.
    ///
    /// # Errors
    /// Where all of them are too much.
    pub(super) fn count(&self, value: &Value) -> Result<(), Error> {
        let Some(size) = value.as_str().map(str::len).filter(|size| *size > LONG_TEXT) else { return Ok(()) };
        if self.0.fetch_add(size, Ordering::Relaxed).saturating_add(size) > MAX_RENDERED {
            let message = format!("the template writes more than {} MiB of text", MAX_RENDERED >> 20);
            return Err(Error::new(ErrorKind::InvalidOperation, message));
        }
        Ok(())
    }
}

/// A place that counts the bytes that a list or a map would be written with.
struct Counter(usize);

impl fmt::Write for Counter {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0 += text.len();
        if self.0 > MAX_WRITTEN { Err(fmt::Error) } else { Ok(()) }
    }
}

/// Refuses an operand that is too long a text, or too long a list.
fn sized(value: Value) -> Result<Value, Error> {
    let wrong = match value.as_str() {
        Some(text) if text.len() > MAX_TEXT => {
            format!("a text of {} bytes is too long for an operator; expected at most {MAX_TEXT}", text.len())
        }
        None if elements(&value) > MAX_ELEMENTS => too_many(elements(&value)),
        _ => return Ok(value),
    };
    Err(Error::new(ErrorKind::InvalidOperation, wrong))
}

/// The same of an operand that is written as text.
fn written(value: Value) -> Result<Value, Error> {
    let has_elements = matches!(value.kind(), ValueKind::Seq | ValueKind::Iterable | ValueKind::Map);
    if has_elements && write!(Counter(0), "{value}").is_err() {
        let message = format!("a list or map is too long to be written as text; expected at most {MAX_WRITTEN} bytes");
        return Err(Error::new(ErrorKind::InvalidOperation, message));
    }
    sized(value)
}

/// How many elements a list has, where that is known without a query.
fn elements(value: &Value) -> usize {
    let is_list = matches!(value.kind(), ValueKind::Seq | ValueKind::Iterable);
    if is_list && value.downcast_object_ref::<Documents>().is_none() { value.len().unwrap_or(0) } else { 0 }
}

/// The characters of a text that becomes a list.
fn characters(arguments: &[Value]) -> Result<(), String> {
    match arguments.first().and_then(Value::as_str).map_or(0, str::len) {
        size if size > MAX_ELEMENTS => Err(too_many(size)),
        _ => Ok(()),
    }
}

fn too_many(count: usize) -> String {
    format!("a list of {count} elements is too long; expected at most {MAX_ELEMENTS}")
}

/// What is wrong with the arguments of a filter, its value the first.
type Check = fn(&[Value]) -> Result<(), String>;

/// Puts bounds on the filters `format`, `indent`, `batch`, `slice` and `list`, and on operands.
pub(super) fn register(environment: &mut Environment<'_>) {
    environment.add_filter(original("format"), filters::format);
    environment.add_filter(original("indent"), filters::indent);
    environment.add_filter(original("batch"), filters::batch);
    environment.add_filter(original("slice"), filters::slice);
    environment.add_filter(original("list"), filters::list);
    environment.add_filter(SIZED, sized);
    environment.add_filter(WRITTEN, written);
    let checks: [(&str, Check); 5] =
        [("format", widths), ("indent", counts), ("batch", counts), ("slice", counts), ("list", characters)];
    for (name, check) in checks {
        environment.add_filter(name, move |state: &mut State<'_, '_>, arguments: Rest<Value>| {
            check(&arguments).map_err(|wrong| Error::new(ErrorKind::InvalidOperation, wrong))?;
            state.apply_filter(&original(name), &arguments)
        });
    }
}

/// The name of minijinja's own filter: none that a template can write.
fn original(name: &str) -> String {
    format!("{name} without bound")
}

fn too_large(number: &str) -> String {
    format!("{number} is too large; expected at most {MAX}")
}

/// Widths and precisions of a format like `"%5.2f"`.
fn widths(arguments: &[Value]) -> Result<(), String> {
    let Some(format) = arguments.first().and_then(Value::as_str) else { return Ok(()) };
    for conversion in format.split('%').skip(1) {
        let end = conversion.find(|c: char| !c.is_ascii_digit() && !"+- #.".contains(c)).unwrap_or(conversion.len());
        for number in conversion[..end].split(|c: char| !c.is_ascii_digit()).filter(|digits| !digits.is_empty()) {
            if number.parse::<i64>().map_or(true, |number| number > MAX) {
                return Err(too_large(number));
            }
        }
    }
    Ok(())
}

/// Numbers among the arguments.
fn counts(arguments: &[Value]) -> Result<(), String> {
    let mut others = arguments.iter().skip(1);
    match others.find(|value| value.as_i64().is_some_and(|number| number > MAX)) {
        Some(large) => Err(too_large(&large.to_string())),
        None => Ok(()),
    }
}

/// Refuses to put a text in place of another where all together would be too long.
pub(super) fn replacing(whole: &str, old: &str, new: &str) -> Result<(), Error> {
    match whole.matches(old).count().saturating_mul(new.len()) {
        size if size > MAX_TEXT => {
            let message = format!("the replaced text would have {size} bytes; expected at most {MAX_TEXT}");
            Err(Error::new(ErrorKind::InvalidOperation, message))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use minijinja::Environment;

    use super::*;

    #[test]
    fn a_text_that_is_too_long_ends_the_rendering() {
        let environment = Environment::new();
        let template = environment.template_from_str("{% for n in range(1000) %}0123456789{% endfor %}").unwrap();
        let mut whole = Rendered { bytes: Vec::new(), most: 10_000 };
        template.render_captured_to((), &mut whole).unwrap();
        assert_eq!(whole.into_text().unwrap().len(), 10_000);
        let mut part = Rendered { bytes: Vec::new(), most: 9_999 };
        let error = template.render_captured_to((), &mut part).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::WriteFailure);
        let source = std::error::Error::source(&error).unwrap().to_string();
        assert_eq!(source, "the template writes more than 0 MiB of text");
        assert!(part.bytes.len() < 10_000);
    }
}
