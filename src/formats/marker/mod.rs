//! Templates in the Fawkes spelling: `<<#NAME|{query}>> … <<key>> … <</NAME>>`.
//!
//! Here a template becomes a tree whose nodes know their places. What queries
//! mean and what values look like is decided where the tree is expanded.

mod reader;

pub use reader::parse;

use super::Span;

/// A template as a tree.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Template {
    /// What it consists of, in order.
    pub nodes: Vec<Node>,
}

/// A part of a template.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Node {
    /// Text that stays as it is.
    Text(Span),
    /// `<<key>>`
    Value {
        /// The key of a document, or a name like `GOAL`.
        key: String,
        /// The marker.
        span: Span,
    },
    /// `<<#NAME|…>> … <</NAME>>`
    Section(Section),
    /// `<<#NAME_separator>> … <</NAME_separator>>` inside the section `NAME`:
    /// expanded, where it stands, for every document but the last.
    Separator(Vec<Node>),
}

/// A part that is expanded once for each document.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Section {
    /// Its name.
    pub name: String,
    /// The opening marker.
    pub span: Span,
    /// Where its documents come from; without one it uses the documents of the
    /// section of that name before it.
    pub query: Option<Query>,
    /// What is expanded.
    pub body: Vec<Node>,
}

/// The query of a section.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Query {
    /// Which language it is in.
    pub kind: QueryKind,
    /// Its text.
    pub text: String,
    /// Where it stands.
    pub span: Span,
}

/// The language of a section's query.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum QueryKind {
    /// `|{…}`: a filter.
    Find,
    /// `||[…]`: an aggregation pipeline.
    Pipeline,
}
