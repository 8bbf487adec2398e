//! Aggregation expressions.

use super::error::{QueryError, Result};
use super::filter::Context;
use super::view::Fields;
use bson::{Bson, DateTime, Document};

#[derive(Debug)]
pub(super) struct Expression {}
#[derive(Debug, Default)]
pub(super) struct Scope {}
#[derive(Debug, Default)]
pub(super) struct Variables {}
#[derive(Debug)]
pub(super) struct Environment<'a> {
    root: Fields<'a>,
}

impl<'a> Environment<'a> {
    pub(super) fn new(root: Fields<'a>, _variables: &'a Variables, _now: DateTime) -> Self {
        Self { root }
    }
}

impl Scope {
    pub(super) fn with_constants(_constants: &Document) -> Result<(Self, Variables)> {
        Ok((Self::default(), Variables::default()))
    }
}

impl Expression {
    pub(super) fn parse(_value: &Bson) -> Result<Self> {
        Err(QueryError::unsupported("$expr"))
    }
    pub(super) fn parse_in(_value: &Bson, _scope: &Scope) -> Result<Self> {
        Err(QueryError::unsupported("$expr"))
    }
    pub(super) fn holds(&self, _fields: Fields<'_>, _context: &Context<'_>) -> Result<bool> {
        Err(QueryError::unsupported("$expr"))
    }
    pub(super) fn evaluate(&self, _environment: &Environment<'_>) -> Result<Option<Bson>> {
        Err(QueryError::unsupported("$expr"))
    }
}

pub(super) fn random() -> f64 {
    0.5
}
