//! Tests of single values.

use std::cmp::Ordering;

use bson::Bson;

use super::bits::Bits;
use super::tree::{Context, Node};
use super::types::TypeSet;
use crate::query::compare::{canonical_type, compare_values, views};
use crate::query::error::Result;
use crate::query::geo::Region;
use crate::query::number::{Number, double_to_long};
use crate::query::regex::Pattern;
use crate::query::view::{Fields, Items, View};

/// A test with its negations and conjunctions; on a path, each leaf looks for a value of its own.
#[derive(Debug)]
pub(in crate::query) enum Test {
    And(Vec<Test>),
    Not(Box<Test>),
    Leaf(Leaf),
}

/// A test of one value.
#[derive(Debug)]
pub(in crate::query) enum Leaf {
    Equal(Bson),
    Order(Order, Bson),
    In(Set),
    Regex(Pattern),
    Exists,
    Type(TypeSet),
    /// Divisor and remainder.
    Mod(i64, i64),
    Size(i64),
    Bits(Bits),
    /// An element that is a document and matches.
    ElementMatches(Box<Node>),
    /// An element that passes.
    ElementPasses(Box<Test>),
    /// A geometry in a region.
    Place(Box<Region>),
    Never,
}

/// The comparisons other than equality.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::query) enum Order {
    Less,
    LessOrEqual,
    Greater,
    GreaterOrEqual,
}

/// What `$in` lists.
#[derive(Debug)]
pub(in crate::query) struct Set {
    /// In BSON order, without duplicates.
    pub(in crate::query) values: Vec<Bson>,
    pub(in crate::query) patterns: Vec<Pattern>,
    pub(super) has_null: bool,
}

impl Set {
    pub(super) fn new(mut values: Vec<Bson>, patterns: Vec<Pattern>) -> Self {
        values.sort_by(compare_values);
        values.dedup_by(|a, b| compare_values(a, b) == Ordering::Equal);
        let has_null = values.contains(&Bson::Null);
        Self { values, patterns, has_null }
    }

    fn contains(&self, value: Option<View<'_>>) -> bool {
        let Some(value) = value else { return self.has_null };
        if self.values.binary_search_by(|candidate| views(candidate.into(), value)).is_ok() {
            return true;
        }
        (self.has_null && matches!(value, View::Undefined))
            || self.patterns.iter().any(|pattern| matches_pattern(pattern, value))
    }
}

impl Test {
    /// Returns whether one value passes; no path, so an array is only itself.
    pub(in crate::query) fn on_value(&self, value: View<'_>, context: &mut Context<'_>) -> Result<bool> {
        match self {
            Self::And(tests) => {
                for test in tests {
                    if !test.on_value(value, context)? {
                        return Ok(false);
                    }
                }
                Ok(true)
            }
            Self::Not(test) => Ok(!test.on_value(value, context)?),
            Self::Leaf(leaf) => leaf.matches(Some(value), context),
        }
    }
}

impl Leaf {
    /// Returns whether the elements of an array at the end of a path are looked at one by one.
    pub(super) fn looks_into_leaves(&self) -> bool {
        !matches!(self, Self::Size(_) | Self::ElementMatches(_) | Self::ElementPasses(_))
    }

    pub(super) fn matches(&self, value: Option<View<'_>>, context: &mut Context<'_>) -> Result<bool> {
        Ok(match self {
            Self::Equal(wanted) => is_equal(wanted, value),
            Self::Order(order, bound) => in_order(*order, bound, value),
            Self::In(set) => set.contains(value),
            Self::Exists => value.is_some(),
            Self::Never => false,
            _ => {
                let Some(value) = value else { return Ok(false) };
                return self.matches_present(value, context);
            }
        })
    }

    fn matches_present(&self, value: View<'_>, context: &mut Context<'_>) -> Result<bool> {
        Ok(match (self, value) {
            (Self::Regex(pattern), value) => matches_pattern(pattern, value),
            (Self::Type(types), value) => types.contains(value),
            (Self::Mod(divisor, remainder), View::Number(number)) => has_remainder(number, *divisor, *remainder),
            (Self::Bits(bits), value) => bits.matches(value),
            (Self::Place(region), value) => region.takes(value),
            (Self::Size(size), View::Array(items)) => i64::try_from(items.len()).is_ok_and(|length| length == *size),
            (Self::ElementMatches(node), View::Array(items)) => {
                first_element(items, context, |item, context| match item {
                    View::Document(fields) => node.matches(fields, context),
                    View::Array(items) => node.matches(Fields::Owned(&by_index(items)), context),
                    _ => Ok(false),
                })?
            }
            (Self::ElementPasses(test), View::Array(items)) => {
                first_element(items, context, |item, context| test.on_value(item, context))?
            }
            _ => false,
        })
    }
}

/// Returns whether an element passes; leaves its index in the context.
fn first_element<'a>(
    items: Items<'a>,
    context: &mut Context<'_>,
    passes: impl Fn(View<'a>, &mut Context<'_>) -> Result<bool>,
) -> Result<bool> {
    for (index, item) in items.iter().enumerate() {
        let mut inner = Context { position: None, ..context.clone() };
        if passes(item, &mut inner)? {
            context.position = Some(index);
            return Ok(true);
        }
    }
    Ok(false)
}

/// Returns an array as the document it is in BSON: keys are indexes.
fn by_index(items: Items<'_>) -> bson::Document {
    items.iter().enumerate().map(|(index, item)| (index.to_string(), item.to_bson())).collect()
}

/// Equality as filters have it: null equals missing and undefined.
fn is_equal(wanted: &Bson, value: Option<View<'_>>) -> bool {
    match (wanted, value) {
        (Bson::Null, None | Some(View::Undefined | View::Null)) => true,
        (_, None) => false,
        (wanted, Some(value)) => views(wanted.into(), value) == Ordering::Equal,
    }
}

/// Order within one type; only MinKey and MaxKey are compared with all.
fn in_order(order: Order, bound: &Bson, value: Option<View<'_>>) -> bool {
    let wanted = View::from(bound);
    let inclusive = matches!(order, Order::LessOrEqual | Order::GreaterOrEqual);
    let same_type = value.is_some_and(|value| canonical_type(value) == canonical_type(wanted));
    let Some(value) = value.filter(|_| same_type) else {
        return match wanted {
            View::Null => inclusive && matches!(value, None | Some(View::Undefined)),
            View::MaxKey => matches!(order, Order::Less | Order::LessOrEqual),
            View::MinKey => matches!(order, Order::Greater | Order::GreaterOrEqual),
            _ => false,
        };
    };
    if let (View::Number(a), View::Number(b)) = (value, wanted)
        && (a.is_nan() || b.is_nan())
    {
        return inclusive && a.is_nan() && b.is_nan();
    }
    let found = views(value, wanted);
    match order {
        Order::Less => found == Ordering::Less,
        Order::LessOrEqual => found != Ordering::Greater,
        Order::Greater => found == Ordering::Greater,
        Order::GreaterOrEqual => found != Ordering::Less,
    }
}

/// Returns a text in which the pattern is found, or the same pattern as a value.
fn matches_pattern(pattern: &Pattern, value: View<'_>) -> bool {
    match value {
        View::String(text) | View::Symbol(text) => pattern.is_match(text),
        View::Regex(other, options) => other == pattern.pattern && options == pattern.options,
        _ => false,
    }
}

fn has_remainder(number: Number, divisor: i64, remainder: i64) -> bool {
    let value = match number {
        Number::Double(value) => double_to_long(value),
        Number::Decimal(value) => value.to_i128().and_then(|value| i64::try_from(value).ok()),
        other => Some(other.to_long()),
    };
    value.is_some_and(|value| value.checked_rem(divisor).unwrap_or(0) == remainder)
}
