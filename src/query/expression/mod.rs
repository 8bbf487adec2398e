//! Aggregation expressions.
//!
//! An expression is read once, with the variables it may use, and evaluated
//! against documents. A value may be missing ([`None`]), which is not null.
//! Operators are entries of tables, a table per family: positional ones
//! ([`operator::Operator`]) and ones with named arguments ([`operator::Named`]);
//! those that do not evaluate all their arguments are [`form::Form`]s.

mod arithmetic;
mod array;
mod boundary;
mod constants;
mod convert;
mod date;
mod form;
mod mistake;
mod object;
mod operator;
mod pair;
mod parse;
mod pattern;
mod register;
mod scope;
mod set;
mod string;
mod tree;
mod trigonometry;
mod value;

use bson::Bson;

use super::error::Result;
pub(super) use boundary::{Unit, date_step};
pub(super) use register::UNKNOWN_EXPRESSION;
pub(super) use scope::{Environment, Scope, Variables, check_name};
pub(super) use tree::{Expression, field_value};
pub(super) use value::Value;

impl Expression {
    /// Reads an expression that uses no variables but the system's.
    ///
    /// # Errors
    /// If MongoDB refuses it.
    pub(super) fn parse(value: &Bson) -> Result<Self> {
        Self::parse_in(value, &Scope::default())
    }

    /// Reads an expression that may use the variables of a scope.
    ///
    /// # Errors
    /// If MongoDB refuses it.
    pub(super) fn parse_in(value: &Bson, scope: &Scope) -> Result<Self> {
        parse::Reader::new(scope).read(value)
    }
}

/// Returns the value of what must be a constant expression.
///
/// # Errors
/// If it depends on a document.
pub(super) fn constant_of(value: &Bson, scope: &Scope) -> Result<Bson> {
    match Expression::parse_in(value, scope)? {
        Expression::Constant(value) => Ok(value.unwrap_or(Bson::Null)),
        _ => Err(super::error::QueryError::invalid(40_191, "the expression must be a constant")),
    }
}
