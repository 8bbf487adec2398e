//! Filters: which documents match.
//!
//! [`Filter::parse`] compiles a filter into a tree that walks raw BSON without
//! decoding it. Rules of MongoDB that are easy to miss: a path reaches through
//! arrays of documents; a comparison is between values of one type only; null
//! equals missing; a negation holds where its opposite holds for no value.

mod bits;
mod operators;
mod parse;
mod schema;
mod test;
mod tree;
mod types;

use bson::{Bson, DateTime, Document, RawDocument};

use super::error::Result;
use super::view::{Fields, View};
pub(super) use parse::Parser;
pub(super) use test::Test;
pub(super) use tree::{Context, Node};
pub(super) use types::TypeSet;

/// A compiled filter.
#[derive(Debug)]
pub struct Filter {
    root: Node,
}

impl Filter {
    /// Reads a filter; an empty one matches everything.
    ///
    /// # Errors
    /// Where MongoDB refuses it, or rmem does not support an operator.
    pub fn parse(filter: &Document) -> Result<Self> {
        Ok(Self { root: Parser::default().filter(filter)? })
    }

    /// Reads a filter whose expressions see `now` as `$$NOW`, and variables.
    pub(super) fn parse_with(filter: &Document, parser: &Parser<'_>) -> Result<Self> {
        Ok(Self { root: parser.filter(filter)? })
    }

    /// Whether a document matches.
    ///
    /// # Errors
    /// Where an expression of the filter fails on the document.
    pub fn matches(&self, document: &RawDocument) -> Result<bool> {
        self.root.matches(document.into(), &mut Context::default())
    }

    /// Whether an owned document matches.
    ///
    /// # Errors
    /// Where an expression of the filter fails on the document.
    pub fn matches_document(&self, document: &Document) -> Result<bool> {
        self.root.matches(document.into(), &mut Context::default())
    }

    /// [`Filter::matches`] with variables for its expressions.
    pub(super) fn matches_with(&self, fields: Fields<'_>, context: &mut Context<'_>) -> Result<bool> {
        self.root.matches(fields, context)
    }

    /// For a document that matches: the index in the array by which it does, where
    /// it matches by one. The positional `$` stands for it.
    pub(super) fn position(&self, fields: Fields<'_>, now: DateTime) -> Result<Option<usize>> {
        let mut context = Context { now: Some(now), ..Context::default() };
        Ok(if self.root.matches(fields, &mut context)? { context.position } else { None })
    }

    /// Whether every document matches.
    #[must_use]
    pub fn matches_all(&self) -> bool {
        matches!(&self.root, Node::And(children) if children.is_empty())
    }

    /// The only values of `_id` that a match can have, where the filter says so:
    /// an index may be asked for them. The filter must still be applied.
    #[must_use]
    pub fn ids(&self) -> Option<Vec<Bson>> {
        self.root.ids()
    }

    pub(super) fn root(&self) -> &Node {
        &self.root
    }
}

/// Whether a value can be looked up in an index of whole values.
fn indexable(value: &Bson) -> bool {
    !matches!(value, Bson::Array(_) | Bson::Null | Bson::Undefined | Bson::RegularExpression(_))
}

/// Whether a document is one of operators: its first key has a `$` and it is no reference.
pub(super) fn is_operators(fields: Fields<'_>) -> bool {
    fields.iter().next().is_some_and(|(name, _)| name.starts_with('$') && !is_reference_key(name))
}

/// Whether a key is one of those of a DBRef.
pub(super) fn is_reference_key(name: &str) -> bool {
    matches!(name, "$ref" | "$id" | "$db")
}

/// Whether a value is an object of operators.
pub(super) fn is_operator_object(value: View<'_>) -> bool {
    matches!(value, View::Document(fields) if is_operators(fields))
}
