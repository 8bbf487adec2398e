//! Function calls where a fact's values stand: `(create$ …)`, arithmetic.

use super::function::is_function;
use super::global::Globals;
use super::lexer::{Lexer, Token, TokenKind};
use super::value::Value;
use super::writer::printed;
use crate::formats::{Diagnostic, Span};

/// How deep calls may be nested.
const MAX_DEPTH: usize = 200;

/// The names that are functions where slots could stand as well; `min` or
/// `round` could be the name of a slot.
const UNMISTAKABLE: [&str; 10] = ["create$", "+", "-", "*", "/", "**", "div", "mod", "str-cat", "sym-cat"];

/// Whether a list with this head is a call and not a slot.
pub(super) fn is_call(name: &str) -> bool {
    UNMISTAKABLE.contains(&name) || name.ends_with('$') && is_function(name)
}

struct Call<'a> {
    name: &'a str,
    span: Span,
    operands: Vec<Value>,
}

/// Evaluates the call whose `(` is the next word and takes all of it.
///
/// # Errors
/// Outside, where the text is not a list; inside, where it is one whose value is not known here.
pub(super) fn evaluate(lexer: &mut Lexer<'_>, globals: &Globals) -> Result<Result<Vec<Value>, Diagnostic>, Diagnostic> {
    let mut calls: Vec<Call<'_>> = Vec::new();
    let mut wrong: Option<Diagnostic> = None;
    loop {
        let token = lexer.next()?;
        match token.kind {
            TokenKind::Open => {
                if calls.len() == MAX_DEPTH {
                    let message = format!("calls nested more than {MAX_DEPTH} deep");
                    return Err(Diagnostic::new(lexer.source, token.span, message));
                }
                let head = lexer.peek(0)?;
                if head.kind == TokenKind::Symbol {
                    lexer.next()?;
                } else {
                    wrong.get_or_insert_with(|| lexer.wrong(head, "the name of a function"));
                }
                calls.push(Call { name: lexer.text(head), span: token.span.to(head.span), operands: Vec::new() });
            }
            TokenKind::Close => {
                let Some(call) = calls.pop() else { return Err(lexer.wrong(token, "a call")) };
                let values = apply(call.name, &call.operands).unwrap_or_else(|message| {
                    wrong.get_or_insert_with(|| Diagnostic::new(lexer.source, call.span, message));
                    Vec::new()
                });
                match calls.last_mut() {
                    Some(outer) => outer.operands.extend(values),
                    None => return Ok(wrong.map_or(Ok(values), Err)),
                }
            }
            TokenKind::End => return Err(unclosed(lexer, token, &calls)),
            _ => match (globals.values(lexer, token), calls.last_mut()) {
                (Ok(values), Some(call)) => call.operands.extend(values),
                (Err(error), _) => drop(wrong.get_or_insert(error)),
                (Ok(_), None) => return Err(lexer.wrong(token, "a call")),
            },
        }
    }
}

fn unclosed(lexer: &Lexer<'_>, token: Token, calls: &[Call<'_>]) -> Diagnostic {
    let error = lexer.wrong(token, "`)`");
    let Some(call) = calls.last() else { return error };
    let (line, column) = lexer.source.position(call.span.start);
    error.hint(format!("the list opened at {line}:{column} is not closed"))
}

/// The value of a call.
fn apply(name: &str, operands: &[Value]) -> Result<Vec<Value>, String> {
    let value = match name {
        "create$" => return Ok(operands.to_vec()),
        "str-cat" => Value::Text(operands.iter().map(printed).collect()),
        "sym-cat" => Value::Symbol(operands.iter().map(printed).collect()),
        "+" => fold(name, operands, i64::checked_add, |a, b| a + b)?,
        "-" => fold(name, operands, i64::checked_sub, |a, b| a - b)?,
        "*" => fold(name, operands, i64::checked_mul, |a, b| a * b)?,
        "/" => floats(name, operands, |a, b| a / b)?,
        "**" => floats(name, operands, f64::powf)?,
        "min" => chosen(name, operands, |a, b| b < a)?,
        "max" => chosen(name, operands, |a, b| b > a)?,
        "div" => fold(name, &truncated(operands), i64::checked_div, |a, b| a / b)?,
        "mod" => fold(name, operands, i64::checked_rem, |a, b| a % b)?,
        "abs" => match operands {
            [Value::Integer(number)] => Value::Integer(number.checked_abs().ok_or_else(overflow)?),
            _ => Value::Float(single(name, operands)?.abs()),
        },
        "sqrt" => Value::Float(single(name, operands)?.sqrt()),
        "float" => Value::Float(single(name, operands)?),
        "integer" => whole(single(name, operands)?, operands, f64::trunc)?,
        "round" => whole(single(name, operands)?, operands, |number| (number - 0.5).ceil())?,
        "pi" if operands.is_empty() => Value::Float(std::f64::consts::PI),
        _ => return Err(format!("expected `create$` or arithmetic, found the function `{}`", name.escape_debug())),
    };
    match value {
        Value::Float(number) if !number.is_finite() => Err(format!("the value of `{name}` is not a finite number")),
        value => Ok(vec![value]),
    }
}

fn overflow() -> String {
    "the result does not fit into 64 bits".to_owned()
}

#[allow(clippy::cast_precision_loss, reason = "as CLIPS does it")]
fn number(name: &str, value: &Value) -> Result<f64, String> {
    match value {
        Value::Integer(number) => Ok(*number as f64),
        Value::Float(number) => Ok(*number),
        other => Err(format!("`{name}` expected a number, found `{}`", printed(other))),
    }
}

fn single(name: &str, operands: &[Value]) -> Result<f64, String> {
    match operands {
        [value] => number(name, value),
        _ => Err(format!("`{name}` expected one number")),
    }
}

/// Integers as long as all are, else floats.
fn fold(
    name: &str,
    operands: &[Value],
    integers: fn(i64, i64) -> Option<i64>,
    floats: fn(f64, f64) -> f64,
) -> Result<Value, String> {
    let [first, rest @ ..] = operands else { return Err(format!("`{name}` expected numbers")) };
    if rest.is_empty() {
        return Err(format!("`{name}` expected two numbers or more"));
    }
    number(name, first)?;
    rest.iter().try_fold(first.clone(), |sum, value| match (&sum, value) {
        (Value::Integer(_), Value::Integer(0)) if matches!(name, "div" | "mod") => {
            Err(format!("`{name}` expected a number that is not zero"))
        }
        (Value::Integer(a), Value::Integer(b)) => integers(*a, *b).map(Value::Integer).ok_or_else(overflow),
        (a, b) => Ok(Value::Float(floats(number(name, a)?, number(name, b)?))),
    })
}

fn floats(name: &str, operands: &[Value], with: fn(f64, f64) -> f64) -> Result<Value, String> {
    let [first, second, rest @ ..] = operands else { return Err(format!("`{name}` expected two numbers or more")) };
    let start = with(number(name, first)?, number(name, second)?);
    let result = rest.iter().try_fold(start, |sum, value| Ok::<_, String>(with(sum, number(name, value)?)));
    result.map(Value::Float)
}

fn chosen(name: &str, operands: &[Value], better: fn(f64, f64) -> bool) -> Result<Value, String> {
    let [first, rest @ ..] = operands else { return Err(format!("`{name}` expected numbers")) };
    let mut best = (number(name, first)?, first);
    for value in rest {
        let number = number(name, value)?;
        if better(best.0, number) {
            best = (number, value);
        }
    }
    Ok(best.1.clone())
}

/// Floats cut to integers, for `div`.
fn truncated(operands: &[Value]) -> Vec<Value> {
    let cut = |value: &Value| match value {
        Value::Float(number) => whole(*number, &[], f64::trunc).unwrap_or(Value::Float(*number)),
        other => other.clone(),
    };
    operands.iter().map(cut).collect()
}

#[allow(clippy::cast_possible_truncation, reason = "the range is checked")]
fn whole(number: f64, operands: &[Value], round: fn(f64) -> f64) -> Result<Value, String> {
    if let [Value::Integer(number)] = operands {
        return Ok(Value::Integer(*number));
    }
    let rounded = round(number);
    // 2^63: the first float that is too large.
    if rounded.abs() < 9_223_372_036_854_775_808.0 { Ok(Value::Integer(rounded as i64)) } else { Err(overflow()) }
}
