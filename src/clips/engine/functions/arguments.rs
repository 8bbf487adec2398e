//! The arguments of a function, each as what it should be.

use bson::{Bson, Document};

use super::failure::Failure;
use crate::clips::engine::exchange;
use crate::clips::engine::native::{CallError, FactRef, Value};
use crate::clips::engine::state::State;
use crate::formats::{Source, shell};
use crate::store::Namespace;

/// The arguments of a call, counted from 1.
#[derive(Clone, Copy)]
pub(super) struct Arguments<'a>(&'a [Value]);

impl<'a> Arguments<'a> {
    pub(super) fn new(values: &'a [Value]) -> Self {
        Self(values)
    }

    /// All of them.
    pub(super) fn values(self) -> &'a [Value] {
        self.0
    }

    pub(super) fn get(self, nth: u32) -> Option<&'a Value> {
        self.0.get(usize::try_from(nth).ok()?.checked_sub(1)?)
    }

    fn wrong(nth: u32, expected: &'static str) -> Failure {
        CallError::Argument(nth, expected).into()
    }

    /// All from this one on; those in multifields one by one.
    pub(super) fn rest(self, nth: u32) -> Vec<&'a Value> {
        let from = usize::try_from(nth).unwrap_or(usize::MAX).saturating_sub(1);
        let mut rest = Vec::new();
        for value in self.0.get(from..).unwrap_or_default() {
            match value {
                Value::Many(values) => rest.extend(values),
                value => rest.push(value),
            }
        }
        rest
    }

    pub(super) fn text(self, nth: u32) -> Result<&'a str, Failure> {
        match self.get(nth) {
            Some(Value::Symbol(text) | Value::Text(text)) => Ok(text),
            _ => Err(Self::wrong(nth, "symbol or string")),
        }
    }

    pub(super) fn integer(self, nth: u32) -> Result<i64, Failure> {
        match self.get(nth) {
            Some(Value::Integer(number)) => Ok(*number),
            #[allow(clippy::cast_possible_truncation, reason = "a fraction of a second, say, does not matter")]
            Some(Value::Float(number)) => Ok(*number as i64),
            _ => Err(Self::wrong(nth, "integer or float")),
        }
    }

    pub(super) fn address(self, nth: u32, expected: &'static str) -> Result<u64, Failure> {
        match self.get(nth) {
            Some(Value::Address(address)) => Ok(*address),
            _ => Err(Self::wrong(nth, expected)),
        }
    }

    pub(super) fn fact(self, nth: u32) -> Result<&'a FactRef, Failure> {
        match self.get(nth) {
            Some(Value::Fact(fact)) => Ok(fact),
            _ => Err(Self::wrong(nth, "fact address")),
        }
    }

    pub(super) fn namespace(self, nth: u32) -> Result<Namespace, Failure> {
        self.text(nth)?.parse::<Namespace>().map_err(Failure::declined)
    }

    /// A copy of a document, or the document that a text is.
    pub(super) fn document(self, nth: u32, state: &State<'_>) -> Result<Document, Failure> {
        match self.get(nth) {
            Some(Value::Address(address)) => {
                state.table.borrow_mut().document(*address).map(|document| document.clone()).map_err(Failure::wrong)
            }
            Some(Value::Symbol(text) | Value::Text(text)) => parse(text),
            _ => Err(Self::wrong(nth, "document (external address) or string")),
        }
    }

    /// The value in a document.
    pub(super) fn value(self, nth: u32, state: &State<'_>) -> Result<Bson, Failure> {
        let value = self.get(nth).ok_or_else(|| Self::wrong(nth, "value"))?;
        exchange::to_bson(value, &mut state.table.borrow_mut()).map_err(Failure::wrong)
    }
}

/// A document of a text in shell syntax; an empty text is an empty document.
pub(super) fn parse(text: &str) -> Result<Document, Failure> {
    if text.trim().is_empty() {
        return Ok(Document::new());
    }
    shell::parse_document(&Source::new("<document>", text)).map_err(Failure::declined)
}
