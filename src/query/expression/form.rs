//! Forms: operators that evaluate only some of their arguments, or that bind variables.

use std::cmp::Ordering;

use bson::{Bson, Document};

use super::mistake;
use super::operator::{is_nullish, is_true, type_name};
use super::pair::{fields as pair_of_fields, order};
use super::parse::Reader;
use super::scope::{Environment, check_name};
use super::tree::{Expression, constant};
use super::value::Value;
use crate::query::error::{QueryError, Result};
use crate::query::interruption;
use crate::query::javascript::Program;
use crate::query::limit::Held;
use crate::query::number::Number;

/// A compiled form.
#[derive(Debug)]
pub(in crate::query) enum Form {
    And(Vec<Expression>),
    Or(Vec<Expression>),
    Compare(Comparison, [Expression; 2]),
    Cond([Expression; 3]),
    IfNull(Vec<Expression>),
    Switch(Vec<(Expression, Expression)>, Option<Expression>),
    Let(Vec<(usize, Expression)>, Expression),
    Map { input: Expression, slot: usize, body: Expression },
    Filter { input: Expression, slot: usize, condition: Expression, limit: Option<Expression> },
    Reduce { input: Expression, initial: Expression, value: usize, this: usize, body: Expression },
    Function(Program, Expression),
}

/// The comparison operators.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::query) enum Comparison {
    Equal,
    NotEqual,
    Less,
    LessOrEqual,
    Greater,
    GreaterOrEqual,
    Compare,
}

const COMPARISONS: [(&str, Comparison); 7] = [
    ("$eq", Comparison::Equal),
    ("$ne", Comparison::NotEqual),
    ("$lt", Comparison::Less),
    ("$lte", Comparison::LessOrEqual),
    ("$gt", Comparison::Greater),
    ("$gte", Comparison::GreaterOrEqual),
    ("$cmp", Comparison::Compare),
];

/// Reads a form, where the name is of one.
pub(super) fn read(reader: &Reader<'_>, name: &str, argument: &Bson) -> Result<Option<Form>> {
    if let Some((_, comparison)) = COMPARISONS.iter().find(|(known, _)| *known == name) {
        let pair = reader.arguments(name, (2, 2), argument)?;
        let pair =
            <[Expression; 2]>::try_from(pair).map_err(|_| QueryError::invalid(16_020, "two arguments needed"))?;
        return Ok(Some(Form::Compare(*comparison, pair)));
    }
    Ok(Some(match name {
        "$and" => Form::And(reader.arguments(name, (0, usize::MAX), argument)?),
        "$or" => Form::Or(reader.arguments(name, (0, usize::MAX), argument)?),
        "$cond" => cond(reader, argument)?,
        "$ifNull" => Form::IfNull(reader.arguments(name, (2, usize::MAX), argument)?),
        "$switch" => switch(reader, argument)?,
        "$let" => bind(reader, argument)?,
        "$map" => map(reader, argument)?,
        "$filter" => filter(reader, argument)?,
        "$reduce" => reduce(reader, argument)?,
        "$function" => function(reader, argument)?,
        _ => return Ok(None),
    }))
}

impl Form {
    /// Returns a constant, where the form depends on nothing.
    pub(super) fn folded(self) -> Result<Expression> {
        let constants = match &self {
            Self::And(items) | Self::Or(items) | Self::IfNull(items) => items.iter().all(Expression::is_constant),
            Self::Compare(_, items) => items.iter().all(Expression::is_constant),
            Self::Cond(items) => items.iter().all(Expression::is_constant),
            Self::Switch(branches, default) => {
                branches.iter().all(|(case, then)| case.is_constant() && then.is_constant())
                    && default.as_ref().is_none_or(Expression::is_constant)
            }
            _ => false,
        };
        // One constant decides the value, whatever the other arguments are.
        let decided = match &self {
            Self::And(items) => items.iter().any(|item| matches!(item, Expression::Constant(value) if !is_true(value))),
            Self::Or(items) => items.iter().any(|item| matches!(item, Expression::Constant(value) if is_true(value))),
            _ => false,
        };
        if decided {
            return Ok(Expression::Constant(Some(Bson::Boolean(matches!(self, Self::Or(_))))));
        }
        if let Self::Cond([Expression::Constant(condition), then, otherwise]) = self {
            return Ok(if is_true(&condition) { then } else { otherwise });
        }
        let form = Expression::Form(Box::new(self));
        if constants { Ok(Expression::Constant(constant(&form)?)) } else { Ok(form) }
    }

    /// Returns the names of two fields of the document itself, where the form is that they differ.
    pub(super) fn differing(&self) -> Option<[&str; 2]> {
        match self {
            Self::Compare(Comparison::NotEqual, pair) => pair_of_fields(pair),
            _ => None,
        }
    }

    pub(super) fn truth(&self, environment: &Environment<'_>) -> Result<bool> {
        match self {
            Self::And(items) => {
                for item in items {
                    if !item.truth(environment)? {
                        return Ok(false);
                    }
                }
                Ok(true)
            }
            Self::Or(items) => {
                for item in items {
                    if item.truth(environment)? {
                        return Ok(true);
                    }
                }
                Ok(false)
            }
            Self::Compare(comparison, pair) if *comparison != Comparison::Compare => {
                Ok(comparison.holds(order(pair, environment)?))
            }
            _ => Ok(is_true(&self.evaluate(environment)?)),
        }
    }

    pub(super) fn evaluate(&self, environment: &Environment<'_>) -> Result<Value> {
        match self {
            Self::And(_) | Self::Or(_) => Ok(Some(Bson::Boolean(self.truth(environment)?))),
            Self::Compare(Comparison::Compare, pair) => Ok(Some(Bson::Int32(order(pair, environment)? as i32))),
            Self::Compare(..) => Ok(Some(Bson::Boolean(self.truth(environment)?))),
            Self::Cond([condition, then, otherwise]) => {
                if condition.truth(environment)? {
                    then.evaluate(environment)
                } else {
                    otherwise.evaluate(environment)
                }
            }
            Self::IfNull(items) => first_value(items, environment),
            Self::Switch(branches, default) => switched(branches, default.as_ref(), environment),
            Self::Let(bindings, body) => within(bindings, environment, environment, body),
            Self::Map { input, slot, body } => match array("$map", 16_883, input.evaluate(environment)?)? {
                Some(items) => mapped(items, *slot, body, environment),
                None => Ok(Some(Bson::Null)),
            },
            Self::Filter { input, slot, condition, limit } => {
                kept(input, *slot, condition, limit.as_ref(), environment)
            }
            Self::Function(program, arguments) => called(program, arguments, environment),
            Self::Reduce { input, initial, value, this, body } => {
                match array("$reduce", 40_080, input.evaluate(environment)?)? {
                    Some(items) => reduced(items, initial.evaluate(environment)?, (*value, *this), body, environment),
                    None => Ok(Some(Bson::Null)),
                }
            }
        }
    }
}

/// `$ifNull`: the first value that is not null, or the last.
fn first_value(items: &[Expression], environment: &Environment<'_>) -> Result<Value> {
    let mut value = None;
    for item in items {
        value = item.evaluate(environment)?;
        if !is_nullish(&value) {
            break;
        }
    }
    Ok(value)
}

/// `$switch`: what belongs to the first case that holds.
fn switched(
    branches: &[(Expression, Expression)],
    default: Option<&Expression>,
    environment: &Environment<'_>,
) -> Result<Value> {
    for (case, then) in branches {
        if case.truth(environment)? {
            return then.evaluate(environment);
        }
    }
    let message = "$switch could not find a matching branch, and has no default";
    default.ok_or_else(|| QueryError::invalid(40_066, message).about("$switch"))?.evaluate(environment)
}

/// `$map`: what the body makes of each item, which is in a slot.
fn mapped(items: Vec<Bson>, slot: usize, body: &Expression, environment: &Environment<'_>) -> Result<Value> {
    let (mut mapped, mut held) = (Vec::with_capacity(items.len()), Held::default());
    held.add_all(&items)?;
    for item in items {
        interruption::check()?;
        let item = Some(item);
        let frame = environment.frame(slot, &item);
        let value = body.evaluate(&environment.within(&frame))?.unwrap_or(Bson::Null);
        held.add(&value)?;
        mapped.push(value);
    }
    Ok(Some(Bson::Array(mapped)))
}

/// `$reduce`: what the body makes of a value with each item; the slots are those of the value and of the item.
fn reduced(
    items: Vec<Bson>,
    initial: Value,
    (value, this): (usize, usize),
    body: &Expression,
    environment: &Environment<'_>,
) -> Result<Value> {
    let (mut accumulated, mut input, mut held) = (initial, Held::default(), Held::default());
    input.add_all(&items)?;
    for item in items {
        interruption::check()?;
        let item = Some(item);
        let outer = environment.frame(this, &item);
        let environment = environment.within(&outer);
        let inner = environment.frame(value, &accumulated);
        let next = body.evaluate(&environment.within(&inner))?;
        held.replace(next.as_ref())?;
        accumulated = next;
    }
    Ok(accumulated)
}

/// `$function`: what JavaScript returns.
fn called(program: &Program, arguments: &Expression, environment: &Environment<'_>) -> Result<Value> {
    let Some(Bson::Array(values)) = arguments.evaluate(environment)? else {
        return Err(QueryError::invalid(31_266, "the 'args' of $function must be an array").about("$function"));
    };
    let value = program.call(&values.into_iter().map(Some).collect::<Vec<_>>())?;
    Ok(value.map(|value| if value == Bson::Undefined { Bson::Null } else { value }))
}

impl Comparison {
    fn holds(self, order: Ordering) -> bool {
        match self {
            Self::Equal => order == Ordering::Equal,
            Self::NotEqual => order != Ordering::Equal,
            Self::Less => order == Ordering::Less,
            Self::LessOrEqual => order != Ordering::Greater,
            Self::Greater => order == Ordering::Greater,
            Self::GreaterOrEqual => order != Ordering::Less,
            Self::Compare => false,
        }
    }
}

/// Evaluates the bindings outside, the body inside.
fn within(
    bindings: &[(usize, Expression)],
    outside: &Environment<'_>,
    inside: &Environment<'_>,
    body: &Expression,
) -> Result<Value> {
    let Some(((slot, expression), rest)) = bindings.split_first() else { return body.evaluate(inside) };
    let value = expression.evaluate(outside)?;
    let mut held = Held::default();
    held.replace(value.as_ref())?;
    let frame = inside.frame(*slot, &value);
    within(rest, outside, &inside.within(&frame), body)
}

fn kept(
    input: &Expression,
    slot: usize,
    condition: &Expression,
    limit: Option<&Expression>,
    environment: &Environment<'_>,
) -> Result<Value> {
    let Some(items) = array("$filter", 28_651, input.evaluate(environment)?)? else { return Ok(Some(Bson::Null)) };
    if items.is_empty() {
        return Ok(Some(Bson::Array(items)));
    }
    let limit = match limit.map(|limit| limit.evaluate(environment)).transpose()? {
        None => None,
        Some(value) if is_nullish(&value) => None,
        Some(value) => match value.as_ref().and_then(Number::of).and_then(Number::integral_32) {
            Some(limit) if limit >= 1 => usize::try_from(limit).ok(),
            Some(_) => {
                return Err(QueryError::invalid(327_392, "$filter: limit must be greater than 0").about("$filter"));
            }
            None => {
                return Err(QueryError::invalid(327_391, "$filter: limit must be a 32-bit integer of at least 1")
                    .about("$filter"));
            }
        },
    };
    let (mut kept, mut held) = (Vec::new(), Held::default());
    held.add_all(&items)?;
    for item in items {
        interruption::check()?;
        if limit.is_some_and(|limit| kept.len() >= limit) {
            break;
        }
        let item = Some(item);
        let frame = environment.frame(slot, &item);
        if condition.truth(&environment.within(&frame))? {
            kept.extend(item);
        }
    }
    Ok(Some(Bson::Array(kept)))
}

/// Returns the elements; `None` if there is null.
fn array(operator: &str, code: i32, value: Value) -> Result<Option<Vec<Bson>>> {
    match value {
        Some(Bson::Array(items)) => Ok(Some(items)),
        None | Some(Bson::Null | Bson::Undefined) => Ok(None),
        Some(other) => {
            Err(QueryError::invalid(code, format!("input to {operator} must be an array, not {}", type_name(&other)))
                .about(operator))
        }
    }
}

/// Returns the named arguments of a form: all of `required`, any of `optional`, nothing else.
fn fields<'a>(name: &str, argument: &'a Bson, required: &[&str], optional: &[&str]) -> Result<&'a Document> {
    let Bson::Document(fields) = argument else {
        return Err(mistake::shape(name));
    };
    for field in fields.keys() {
        if !required.contains(&field.as_str()) && !optional.contains(&field.as_str()) {
            return Err(mistake::unknown(name, field));
        }
    }
    let absent: Vec<&str> = required.iter().copied().filter(|field| !fields.contains_key(field)).collect();
    mistake::missing(name, &absent).map_or(Ok(fields), Err)
}

fn get<'a>(fields: &'a Document, name: &str) -> &'a Bson {
    fields.get(name).unwrap_or(&Bson::Null)
}

fn cond(reader: &Reader<'_>, argument: &Bson) -> Result<Form> {
    let parts = match argument {
        Bson::Document(document) if !document.keys().next().is_some_and(|name| name.starts_with('$')) => {
            let fields = fields("$cond", argument, &["if", "then", "else"], &[])?;
            vec![reader.read(get(fields, "if"))?, reader.read(get(fields, "then"))?, reader.read(get(fields, "else"))?]
        }
        other => reader.arguments("$cond", (3, 3), other)?,
    };
    let parts =
        <[Expression; 3]>::try_from(parts).map_err(|_| QueryError::invalid(16_020, "$cond takes 3 arguments"))?;
    Ok(Form::Cond(parts))
}

fn switch(reader: &Reader<'_>, argument: &Bson) -> Result<Form> {
    let fields = fields("$switch", argument, &[], &["branches", "default"])?;
    let (mut branches, mut decided) = (Vec::new(), false);
    match fields.get("branches") {
        None => {}
        Some(Bson::Array(items)) => {
            for item in items {
                let branch = self::fields("a branch of $switch", item, &["case", "then"], &[])?;
                // The result of a case that never holds, and everything after a case that always holds, is not
                // evaluated.
                let reader = if decided { reader.lazily() } else { *reader };
                let case = reader.read(get(branch, "case"))?;
                let holds = match &case {
                    Expression::Constant(value) => Some(is_true(value)),
                    _ => None,
                };
                let then = if holds == Some(false) { reader.lazily() } else { reader }.read(get(branch, "then"))?;
                decided |= holds == Some(true);
                branches.push((case, then));
            }
        }
        Some(_) => return Err(QueryError::invalid(40_061, "$switch expected an array for 'branches'")),
    }
    if branches.is_empty() {
        return Err(QueryError::invalid(40_068, "$switch requires at least one branch"));
    }
    let default = fields.get("default").map(|default| reader.read(default)).transpose()?;
    let never = |(case, _): &(Expression, _)| matches!(case, Expression::Constant(value) if !is_true(value));
    if reader.folds() && default.is_none() && branches.iter().all(never) {
        return Err(QueryError::invalid(40_069, "no case of $switch can hold, and there is no default"));
    }
    Ok(Form::Switch(branches, default))
}

fn bind(reader: &Reader<'_>, argument: &Bson) -> Result<Form> {
    let fields = fields("$let", argument, &["vars", "in"], &[])?;
    if matches!(get(fields, "vars"), Bson::Array(items) if !items.is_empty()) {
        return Err(QueryError::failed_to_parse("the names of variables may not be numbers"));
    }
    let Bson::Document(variables) = get(fields, "vars") else {
        return Err(QueryError::invalid(10_065, "invalid parameter: expected an object (vars)"));
    };
    let mut scope = reader.scope.clone();
    let mut bindings = Vec::new();
    for (name, value) in variables {
        check_name(name)?;
        bindings.push((scope.add(name), reader.read(value)?));
    }
    let body = reader.within(&scope).read(get(fields, "in"))?;
    Ok(Form::Let(bindings, body))
}

/// Returns the name of the variable that `as` gives; `this` where it is not given.
fn variable(fields: &Document) -> Result<&str> {
    match fields.get("as") {
        None => Ok("this"),
        Some(Bson::String(name)) => {
            check_name(name)?;
            Ok(name)
        }
        Some(_) => Err(QueryError::failed_to_parse("'as' must be a string")),
    }
}

fn map(reader: &Reader<'_>, argument: &Bson) -> Result<Form> {
    let fields = fields("$map", argument, &["input", "in"], &["as"])?;
    let mut scope = reader.scope.clone();
    let slot = scope.add(variable(fields)?);
    let input = reader.read(get(fields, "input"))?;
    Ok(Form::Map { input, slot, body: reader.within(&scope).read(get(fields, "in"))? })
}

fn filter(reader: &Reader<'_>, argument: &Bson) -> Result<Form> {
    let fields = fields("$filter", argument, &["input", "cond"], &["as", "limit"])?;
    let mut scope = reader.scope.clone();
    let slot = scope.add(variable(fields)?);
    let input = reader.read(get(fields, "input"))?;
    let condition = reader.within(&scope).read(get(fields, "cond"))?;
    let limit = fields.get("limit").map(|limit| reader.read(limit)).transpose()?;
    Ok(Form::Filter { input, slot, condition, limit })
}

fn reduce(reader: &Reader<'_>, argument: &Bson) -> Result<Form> {
    let fields = fields("$reduce", argument, &["input", "initialValue", "in"], &[])?;
    let mut scope = reader.scope.clone();
    let (this, value) = (scope.add("this"), scope.add("value"));
    let input = reader.read(get(fields, "input"))?;
    let initial = reader.read(get(fields, "initialValue"))?;
    Ok(Form::Reduce { input, initial, value, this, body: reader.within(&scope).read(get(fields, "in"))? })
}

fn function(reader: &Reader<'_>, argument: &Bson) -> Result<Form> {
    let Bson::Document(fields) = argument else {
        return Err(QueryError::invalid(31_260, "$function needs an object {body, args, lang}"));
    };
    // Other fields are let through, and what is missing is said after what is wrong before it.
    let wrong = match fields.get("body") {
        None => Some((31_261, "$function needs 'body'")),
        Some(Bson::String(path)) if path.starts_with('$') => {
            Some((31_432, "the 'body' of $function is not a constant"))
        }
        Some(Bson::String(_) | Bson::JavaScriptCode(_)) => None,
        Some(_) => Some((31_262, "the 'body' of $function must be a string or code")),
    };
    let wrong = wrong.or_else(|| (!fields.contains_key("args")).then_some((31_263, "$function needs 'args'")));
    let wrong = wrong.or_else(|| match fields.get("lang") {
        None => Some((31_418, "$function needs 'lang'")),
        Some(Bson::String(language)) if language == "js" => None,
        Some(_) => Some((31_419, "the 'lang' of $function must be 'js'")),
    });
    if let Some((code, message)) = wrong {
        return Err(QueryError::invalid(code, message));
    }
    let program = Program::function("$function", "body", get(fields, "body"))?;
    Ok(Form::Function(program, reader.read(get(fields, "args"))?))
}
