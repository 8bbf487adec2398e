//! Filters of minijinja whose result could be larger than any memory, each with a bound.

use minijinja::value::Rest;
use minijinja::{Environment, Error, ErrorKind, State, Value, filters};

/// How many steps of minijinja a template may take: enough for millions of documents.
pub(super) const FUEL: u64 = 500_000_000;
/// The greatest width and count: as many as minijinja's own `range` has members at most.
const MAX: i64 = 100_000;
/// The longest text that `replace` makes, in bytes.
const MAX_TEXT: usize = 64 << 20;

/// What is wrong with the arguments of a filter, its value the first.
type Check = fn(&[Value]) -> Result<(), String>;

/// Puts bounds on the filters `format`, `indent`, `batch` and `slice`.
pub(super) fn register(environment: &mut Environment<'_>) {
    environment.add_filter(original("format"), filters::format);
    environment.add_filter(original("indent"), filters::indent);
    environment.add_filter(original("batch"), filters::batch);
    environment.add_filter(original("slice"), filters::slice);
    let checks: [(&str, Check); 4] = [("format", widths), ("indent", counts), ("batch", counts), ("slice", counts)];
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
