//! Facts to text, as `(save-facts)` writes them.

use std::fmt::Write as _;

use super::value::{Body, Fact, Value};

/// Appends a fact on one line, without a line break at its end; `value` writes each value.
pub fn write_fact(fact: &Fact, value: fn(&Value, &mut String), out: &mut String) {
    out.push('(');
    out.push_str(&fact.name);
    let values = |values: &[Value], out: &mut String| {
        for each in values {
            out.push(' ');
            value(each, out);
        }
    };
    match &fact.body {
        Body::Ordered(each) => values(each, out),
        Body::Slots(slots) => {
            for slot in slots {
                out.push_str(" (");
                out.push_str(&slot.name);
                values(&slot.values, out);
                out.push(')');
            }
        }
    }
    out.push(')');
}

/// Appends what follows a fact on its line: which of its slots are multislots, where one
/// value does not show it.
pub fn write_remark(fact: &Fact, out: &mut String) {
    let Body::Slots(slots) = &fact.body else { return };
    let mut lead = " ; rmem: multislot ";
    for slot in slots.iter().filter(|slot| slot.multiple && slot.values.len() == 1) {
        out.push_str(lead);
        out.push_str(&slot.name);
        lead = " ";
    }
}

/// Appends a value as a facts file has it. Floats have as many digits as distinguish them
/// apart, and a point or an exponent.
pub fn write_value(value: &Value, out: &mut String) {
    match value {
        Value::Symbol(text) => out.push_str(text),
        Value::Integer(number) => drop(write!(out, "{number}")),
        Value::Float(number) => write_float(*number, out),
        Value::Instance(name) => drop(write!(out, "[{name}]")),
        Value::Text(text) => {
            out.push('"');
            for character in text.chars() {
                if matches!(character, '"' | '\\') {
                    out.push('\\');
                }
                out.push(character);
            }
            out.push('"');
        }
    }
}

/// Appends a float with as many digits as tell it apart, and an exponent where C's `%.15g`
/// has one.
fn write_float(number: f64, out: &mut String) {
    let scientific = format!("{number:e}");
    let (mantissa, exponent) = scientific.split_once('e').unwrap_or((&scientific, "0"));
    let exponent: i32 = exponent.parse().unwrap_or_default();
    if (-4..15).contains(&exponent) {
        let _ = write!(out, "{number:?}");
    } else {
        let sign = if exponent < 0 { '-' } else { '+' };
        let _ = write!(out, "{mantissa}e{sign}{:02}", exponent.abs());
    }
}

/// Appends a value as `deffacts` and `assert` have it: there, a lone `=` or `:`
/// would begin an expression.
pub fn write_operand(value: &Value, out: &mut String) {
    match value {
        Value::Symbol(text) if text == "=" || text == ":" => drop(write!(out, "(sym-cat \"{text}\")")),
        value => write_value(value, out),
    }
}

/// A value as `str-cat` takes it.
pub(super) fn printed(value: &Value) -> String {
    match value {
        Value::Symbol(text) | Value::Text(text) => text.clone(),
        other => {
            let mut out = String::new();
            write_value(other, &mut out);
            out
        }
    }
}
