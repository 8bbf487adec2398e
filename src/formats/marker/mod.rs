//! Templates in the Fawkes spelling: `<<#NAME|{query}>> … <<key>> … <</NAME>>`.
//!
//! Here a template becomes a tree whose nodes know their places. What queries
//! mean and what values look like is decided where the tree is expanded.

mod reader;

use std::collections::HashMap;

pub use reader::parse;

use super::Span;

/// A template as a tree.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Template {
    /// What it consists of, in order.
    pub nodes: Vec<Node>,
}

impl Template {
    /// Returns the section with the query whose documents the text or marker at `offset` is expanded for: the innermost
    /// one, or the one that it uses again by name.
    #[must_use]
    pub fn queried_at(&self, offset: usize) -> Option<&Section> {
        queried(&self.nodes, offset, None, &mut HashMap::new()).flatten()
    }
}

/// The section around `offset`, if `offset` is in one of the nodes; `latest` has the sections with a query so far. The
/// reader bounds how deep sections nest.
fn queried<'a>(
    nodes: &'a [Node],
    offset: usize,
    around: Option<&'a Section>,
    latest: &mut HashMap<&'a str, &'a Section>,
) -> Option<Option<&'a Section>> {
    nodes.iter().find_map(|node| match node {
        Node::Text(span) | Node::Value { span, .. } => (span.start..span.end).contains(&offset).then_some(around),
        Node::Section(section) => {
            if section.query.is_some() {
                latest.insert(&section.name, section);
            }
            let own = latest.get(section.name.as_str()).copied();
            queried(&section.body, offset, own, latest)
        }
        Node::Separator(body) => queried(body, offset, around, latest),
    })
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
