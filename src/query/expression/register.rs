//! The register of all operators, by name.

use super::operator::{Named, Operator};
use super::{arithmetic, array, convert, date, object, pattern, set, string, trigonometry};
use crate::query::error::QueryError;

/// All families of positional operators.
const FAMILIES: [&[Operator]; 8] = [
    &arithmetic::OPERATORS,
    &array::OPERATORS,
    &convert::OPERATORS,
    &object::OPERATORS,
    &set::OPERATORS,
    &string::OPERATORS,
    &trigonometry::OPERATORS,
    &date::OPERATORS,
];

/// All families of operators with named arguments.
const NAMED: [&[Named]; 6] =
    [&array::NAMED, &convert::NAMED, &date::NAMED, &object::NAMED, &pattern::NAMED, &string::NAMED];

/// MongoDB's code for an expression that it does not know.
pub(in crate::query) const UNKNOWN_EXPRESSION: i32 = 168;

/// Operators of MongoDB that rmem refuses by name.
const REFUSED: [&str; 2] = ["$accumulator", "$toHashedIndexKey"];

pub(super) fn positional(name: &str) -> Option<&'static Operator> {
    FAMILIES.iter().flat_map(|family| family.iter()).find(|operator| operator.name == name)
}

pub(super) fn named(name: &str) -> Option<&'static Named> {
    NAMED.iter().flat_map(|family| family.iter()).find(|operator| operator.name == name)
}

/// The error for an unknown name.
pub(super) fn unknown(name: &str) -> QueryError {
    if REFUSED.contains(&name) {
        return QueryError::unsupported(name);
    }
    QueryError::invalid(UNKNOWN_EXPRESSION, format!("unrecognized expression '{name}'")).about(name)
}
