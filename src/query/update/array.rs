//! Update operators on arrays.

use std::cmp::Ordering;

use bson::{Bson, Document};

use super::outcome::Outcome;
use crate::query::compare::{compare_values, equal_values};
use crate::query::dollar::is_operators;
use crate::query::error::{BAD_VALUE, QueryError, Result};
use crate::query::filter::{Context, Node, Parser, Test};
use crate::query::number::Number;
use crate::query::path::Path;
use crate::query::ranking::Ranking;
use crate::query::view::View;

/// `$push` with its modifiers.
#[derive(Debug)]
pub(super) struct Push {
    each: Vec<Bson>,
    position: Option<i64>,
    slice: Option<i64>,
    sort: Option<Order>,
}

/// How `$push` sorts.
#[derive(Debug)]
enum Order {
    Whole { descending: bool },
    Fields(Ranking),
}

impl Push {
    pub(super) fn parse(value: &Bson) -> Result<Self> {
        let mut push = Self { each: Vec::new(), position: None, slice: None, sort: None };
        let Bson::Document(modifiers) = value else {
            push.each.push(value.clone());
            return Ok(push);
        };
        if !is_modifiers(modifiers) {
            push.each.push(value.clone());
            return Ok(push);
        }
        for (name, value) in modifiers {
            match name.as_str() {
                "$each" => push.each = elements(value).map_err(bad)?,
                "$position" => push.position = Some(integer(name, value)?),
                "$slice" => push.slice = Some(integer(name, value)?),
                "$sort" => push.sort = Some(order(value)?),
                _ => return Err(QueryError::bad_value(format!("unrecognized clause in $push: {name}"))),
            }
        }
        Ok(push)
    }

    /// Returns whether it counts as a change even where the array stays the same.
    pub(super) fn counts(&self, value: Option<&Bson>) -> bool {
        let has_elements = matches!(value, Some(Bson::Array(items)) if !items.is_empty());
        !self.each.is_empty() || self.sort.is_some() && has_elements
    }

    pub(super) fn apply(&self, value: Option<&Bson>) -> Result<Outcome> {
        let mut items = existing("$push", value)?.unwrap_or_default();
        let length = i64::try_from(items.len()).unwrap_or(i64::MAX);
        let at = match self.position {
            None => length,
            Some(position) if position < 0 => position.saturating_add(length).max(0),
            Some(position) => position.min(length),
        };
        let at = usize::try_from(at).unwrap_or(0);
        items.splice(at..at, self.each.iter().cloned());
        match &self.sort {
            None => {}
            Some(Order::Whole { descending: false }) => items.sort_by(compare_values),
            Some(Order::Whole { descending: true }) => items.sort_by(|a, b| compare_values(b, a)),
            Some(Order::Fields(ranking)) => ranking.sort(&mut items),
        }
        if let Some(slice) = self.slice {
            let keep = usize::try_from(slice.unsigned_abs()).unwrap_or(usize::MAX);
            if slice >= 0 {
                items.truncate(keep);
            } else {
                items.drain(..items.len().saturating_sub(keep));
            }
        }
        Ok(Outcome::Put(Bson::Array(items)))
    }
}

/// Returns whether the argument of `$push` has modifiers rather than being the value to push.
fn is_modifiers(document: &Document) -> bool {
    document.contains_key("$each")
}

/// The same error as one of a value: `$push` has no other code for its modifiers.
fn bad(error: QueryError) -> QueryError {
    QueryError { code: BAD_VALUE, ..error }
}

fn order(value: &Bson) -> Result<Order> {
    match value {
        Bson::Document(pattern) if pattern.is_empty() => {
            Err(QueryError::bad_value("the $sort pattern is empty when it should be a set of fields"))
        }
        Bson::Document(pattern) => Ok(Order::Fields(Ranking::parse(pattern).map_err(bad)?)),
        value => match Number::of(value).and_then(Number::integral) {
            Some(1) => Ok(Order::Whole { descending: false }),
            Some(-1) => Ok(Order::Whole { descending: true }),
            _ => Err(QueryError::bad_value("the $sort element value must be either 1 or -1")),
        },
    }
}

fn integer(name: &str, value: &Bson) -> Result<i64> {
    Number::of(value)
        .and_then(Number::integral)
        .ok_or_else(|| QueryError::bad_value(format!("the value for {name} must be an integer value")))
}

fn elements(value: &Bson) -> Result<Vec<Bson>> {
    match value {
        Bson::Array(items) => Ok(items.clone()),
        _ => Err(QueryError::type_mismatch("the argument to $each must be an array")),
    }
}

/// What `$addToSet` adds: one value, or those of `$each`.
pub(super) fn each(value: &Bson) -> Result<Vec<Bson>> {
    match value {
        Bson::Document(modifiers) if modifiers.keys().next().is_some_and(|name| name == "$each") => {
            if modifiers.len() > 1 {
                return Err(QueryError::bad_value("found unexpected fields after $each in $addToSet"));
            }
            elements(modifiers.get("$each").unwrap_or(&Bson::Null))
        }
        value => Ok(vec![value.clone()]),
    }
}

pub(super) fn add_to_set(value: Option<&Bson>, new: &[Bson]) -> Result<Outcome> {
    let present = existing("$addToSet", value)?;
    let missing = present.is_none();
    let mut items = present.unwrap_or_default();
    let before = items.len();
    for item in new {
        if !contains(&items, item) {
            items.push(item.clone());
        }
    }
    Ok(if items.len() > before || missing { Outcome::Put(Bson::Array(items)) } else { Outcome::Keep })
}

pub(super) fn pop(value: Option<&Bson>, first: bool) -> Result<Outcome> {
    let mut items = match value {
        None => return Ok(Outcome::Keep),
        Some(Bson::Array(items)) => items.clone(),
        Some(_) => return Err(QueryError::type_mismatch("the path of $pop contains an element of non-array type")),
    };
    if items.is_empty() {
        return Ok(Outcome::Keep);
    }
    if first {
        items.remove(0);
    } else {
        items.pop();
    }
    Ok(Outcome::Put(Bson::Array(items)))
}

/// Returns the array without the elements for which `takes` is true.
pub(super) fn without(operator: &str, value: Option<&Bson>, takes: impl Fn(&Bson) -> Result<bool>) -> Result<Outcome> {
    let Some(items) = existing(operator, value)? else { return Ok(Outcome::Keep) };
    let mut kept = Vec::with_capacity(items.len());
    for item in items {
        if !takes(&item)? {
            kept.push(item);
        }
    }
    Ok(Outcome::Put(Bson::Array(kept)))
}

pub(super) fn contains(values: &[Bson], item: &Bson) -> bool {
    values.iter().any(|value| equal_values(value, item))
}

/// Returns the array there is; an error where there is something else.
fn existing(operator: &str, value: Option<&Bson>) -> Result<Option<Vec<Bson>>> {
    match value {
        None => Ok(None),
        Some(Bson::Array(items)) => Ok(Some(items.clone())),
        Some(other) => {
            let found = View::from(other).type_name();
            Err(QueryError::bad_value(format!("{operator} needs an array, not {found}")))
        }
    }
}

/// What `$pull` takes out.
#[derive(Debug)]
pub(super) enum Pull {
    /// Documents that match a filter.
    Matching(Node),
    /// Values that pass.
    Passing(Test),
    /// Equal values.
    Equal(Bson),
}

impl Pull {
    pub(super) fn parse(value: &Bson) -> Result<Self> {
        let parser = Parser::default();
        match value {
            Bson::Document(operators) if is_operators(operators.into()) => {
                let top = operators.keys().next().is_some_and(|name| matches!(name.as_str(), "$and" | "$or" | "$nor"));
                if top {
                    Ok(Self::Matching(parser.filter(operators)?))
                } else {
                    Ok(Self::Passing(parser.operators(operators)?))
                }
            }
            Bson::Document(filter) => Ok(Self::Matching(parser.filter(filter)?)),
            Bson::RegularExpression(_) => Ok(Self::Passing(parser.field(value)?)),
            value => Ok(Self::Equal(value.clone())),
        }
    }

    pub(super) fn takes(&self, item: &Bson) -> Result<bool> {
        match (self, item) {
            (Self::Matching(node), Bson::Document(document)) => node.matches(document.into(), &mut Context::default()),
            (Self::Matching(_), _) => Ok(false),
            (Self::Passing(test), item) => {
                let mut wrapped = Document::new();
                wrapped.insert("", item.clone());
                test.on_path(&Path::parse("")?, (&wrapped).into(), &mut Context::default())
            }
            (Self::Equal(value), item) => Ok(compare_values(value, item) == Ordering::Equal),
        }
    }
}
