//! The compiled filter and how it walks a document.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use bson::{DateTime, RawDocument};

use super::schema::Schema;
use super::test::{Leaf, Test};
use crate::query::collation::during;
use crate::query::error::Result;
use crate::query::expression::{Environment, Expression, Variables};
use crate::query::geo::Near;
use crate::query::javascript::Program;
use crate::query::path::Path;
use crate::query::random::random;
use crate::query::text::Search;
use crate::query::view::{Fields, View};

/// A part of a filter that looks at a whole document.
#[derive(Debug)]
pub(in crate::query) enum Node {
    And(Vec<Node>),
    Or(Vec<Node>),
    Nor(Vec<Node>),
    /// A test of what a path reaches.
    Field(Path, Test),
    /// A place within distances of a point; an order too.
    Near(Box<Near>),
    /// An aggregation expression that must be true.
    Expression(Expression),
    Schema(Box<Schema>),
    /// A predicate in JavaScript.
    Where(Box<Program>),
    /// A search of words.
    Text(Box<TextSearch>),
    /// A constant answer.
    Always(bool),
    /// True for about this part of the documents.
    Sample(f64),
}

/// Input of a match beside the document, and the position that it finds.
#[derive(Debug, Default, Clone)]
pub(in crate::query) struct Context<'a> {
    /// The index in the array by which the document matched.
    pub(in crate::query) position: Option<usize>,
    /// The value of `$$NOW`.
    pub(in crate::query) now: Option<DateTime>,
    /// Variables for expressions.
    pub(in crate::query) variables: Option<&'a Variables>,
    /// Whether the document is known to match: what may be answered otherwise a second time (`$rand`), or
    /// only with an index, is not asked again.
    pub(in crate::query) is_known: bool,
}

/// A search, and which documents are in its index.
#[derive(Debug)]
pub struct TextSearch {
    pub(super) search: Search,
    pub(super) within: OnceLock<Node>,
}

impl TextSearch {
    pub(super) fn new(search: Search) -> Self {
        Self { search, within: OnceLock::new() }
    }

    fn is_indexed(&self, fields: Fields<'_>) -> Result<bool> {
        match self.within.get() {
            None => Ok(true),
            Some(node) => during(None, || node.matches(fields, &mut Context::default())),
        }
    }

    /// Returns the score of a document, word by word, in the order of words; nothing where another part of the filter
    /// found it.
    ///
    /// # Errors
    /// If no index says what is searched.
    pub fn scores(&self, document: &RawDocument) -> Result<Option<BTreeMap<String, f64>>> {
        if self.is_indexed(document.into())? { self.search.scores(document) } else { Ok(None) }
    }

    /// Returns the score of a document, as [`Self::scores`] does.
    ///
    /// # Errors
    /// If no index says what is searched.
    pub fn score(&self, document: &RawDocument) -> Result<Option<f64>> {
        Ok(self.scores(document)?.map(|scores| scores.values().sum()))
    }
}

impl Node {
    /// All of these together.
    pub(super) fn all(mut nodes: Vec<Self>) -> Self {
        if nodes.len() == 1 { nodes.remove(0) } else { Self::And(nodes) }
    }

    /// Returns the conditions that must hold together, taken out of nested ones.
    pub(super) fn conjuncts(self) -> Vec<Self> {
        match self {
            Self::And(children) => children.into_iter().flat_map(Self::conjuncts).collect(),
            other => vec![other],
        }
    }

    pub(in crate::query) fn matches(&self, fields: Fields<'_>, context: &mut Context<'_>) -> Result<bool> {
        match self {
            Self::And(children) => {
                for child in children {
                    if !child.matches(fields, context)? {
                        return Ok(false);
                    }
                }
                Ok(true)
            }
            // Alternatives leave no position, but where they are as good as one `$in`.
            Self::Or(children) => {
                let position = context.position;
                let found = any(children, fields, context)?;
                if !is_one_set(children) {
                    context.position = position;
                }
                Ok(found)
            }
            Self::Nor(children) => {
                let position = context.position;
                let found = any(children, fields, context)?;
                context.position = position;
                Ok(!found)
            }
            Self::Field(path, test) => test.on_path(path, fields, context),
            Self::Near(near) => Ok(near.nearest(fields).is_some()),
            Self::Expression(_) | Self::Where(_) | Self::Sample(_) | Self::Text(_) if context.is_known => Ok(true),
            Self::Expression(expression) => holds(expression, fields, context),
            // A schema compares strings byte by byte.
            Self::Schema(schema) => Ok(during(None, || schema.accepts(View::Document(fields)))),
            Self::Where(program) => program.holds(fields),
            Self::Text(text) => Ok(text.is_indexed(fields)? && text.search.matches(fields)?),
            Self::Always(answer) => Ok(*answer),
            Self::Sample(rate) => Ok(random() < *rate),
        }
    }

    /// Returns the searches, also those that are alternatives.
    pub(super) fn searches(&self) -> Vec<&TextSearch> {
        match self {
            Self::And(children) | Self::Or(children) => children.iter().flat_map(Self::searches).collect(),
            Self::Text(search) => vec![search],
            _ => Vec::new(),
        }
    }

    /// Returns whether each alternative to a search has a condition on an indexed path.
    pub(super) fn has_indexed_alternatives(&self, is_indexed: &dyn Fn(&str) -> bool) -> bool {
        match self {
            Self::And(children) => children.iter().all(|child| child.has_indexed_alternatives(is_indexed)),
            Self::Or(children) if !self.searches().is_empty() => {
                children.iter().all(|child| child.is_served(is_indexed))
            }
            _ => true,
        }
    }

    fn is_served(&self, is_indexed: &dyn Fn(&str) -> bool) -> bool {
        match self {
            Self::And(children) => children.iter().any(|child| child.is_served(is_indexed)),
            Self::Or(children) => children.iter().all(|child| child.is_served(is_indexed)),
            Self::Field(path, _) => is_indexed(path.text()),
            Self::Text(_) | Self::Always(false) => true,
            _ => false,
        }
    }

    /// Returns the distance conditions.
    pub(super) fn nears(&self) -> Vec<&Near> {
        match self {
            Self::And(children) => children.iter().flat_map(Self::nears).collect(),
            Self::Near(near) => vec![near],
            _ => Vec::new(),
        }
    }
}

/// Returns whether an expression is true for a document.
fn holds(expression: &Expression, fields: Fields<'_>, context: &Context<'_>) -> Result<bool> {
    let none = Variables::default();
    let now = context.now.unwrap_or_else(bson::DateTime::now);
    expression.truth(&Environment::new(fields, context.variables.unwrap_or(&none), now))
}

/// Returns whether alternatives are equalities of one path.
fn is_one_set(children: &[Node]) -> bool {
    let path_of = |node: &Node| match node {
        Node::Field(path, Test::Leaf(Leaf::Equal(_) | Leaf::In(_) | Leaf::Regex(_))) => Some(path.text().to_owned()),
        _ => None,
    };
    let mut paths = children.iter().map(path_of);
    let Some(Some(first)) = paths.next() else { return false };
    paths.all(|path| path.as_ref() == Some(&first))
}

fn any(children: &[Node], fields: Fields<'_>, context: &mut Context<'_>) -> Result<bool> {
    for child in children {
        if child.matches(fields, context)? {
            return Ok(true);
        }
    }
    Ok(false)
}

impl Test {
    /// Returns whether what the path reaches in the document passes.
    pub(in crate::query) fn on_path(&self, path: &Path, fields: Fields<'_>, context: &mut Context<'_>) -> Result<bool> {
        match self {
            Self::And(tests) => {
                for test in tests {
                    if !test.on_path(path, fields, context)? {
                        return Ok(false);
                    }
                }
                Ok(true)
            }
            Self::Not(test) => {
                let position = context.position;
                let found = test.on_path(path, fields, context)?;
                context.position = position;
                Ok(!found)
            }
            Self::Leaf(leaf) => leaf.on_path(path, fields, context),
        }
    }
}

impl Leaf {
    fn on_path(&self, path: &Path, fields: Fields<'_>, context: &mut Context<'_>) -> Result<bool> {
        let mut failure = None;
        let mut position = None;
        let base = Context { position: None, ..context.clone() };
        let found = path.any(fields, self.looks_into_leaves(), &mut |value, outer| {
            let mut inner = base.clone();
            match self.matches(value, &mut inner) {
                Ok(found) => {
                    position = outer.or(inner.position);
                    found
                }
                Err(error) => {
                    failure = Some(error);
                    true
                }
            }
        });
        if let Some(error) = failure {
            return Err(error);
        }
        if found && position.is_some() {
            context.position = position;
        }
        Ok(found)
    }
}
