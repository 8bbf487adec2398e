//! Filters: which documents match.
//!
//! [`Filter::parse`] compiles a filter into a tree that walks raw BSON without
//! decoding it. Rules of MongoDB that are easy to miss: a path reaches through
//! arrays of documents; a comparison is between values of one type only; null
//! equals missing; a negation holds where its opposite holds for no value.

mod allowed;
mod bits;
mod operators;
mod parse;
mod prefilter;
mod schema;
mod test;
mod tree;
mod types;

use std::sync::{Arc, OnceLock};

use bson::{Bson, DateTime, Document, RawDocument};

use super::error::{QueryError, Result};
use super::expression::{Scope, Variables};
use super::geo::Near;
use super::text::TextIndex;
use super::view::Fields;
pub use allowed::{check_positional, check_upsert, is_positional};
pub(super) use parse::Parser;
use prefilter::Prefilter;
pub(super) use test::{Leaf, Order, Set, Test};
pub use tree::TextSearch;
pub(super) use tree::{Context, Node};

/// Refuses what cannot be searched at once.
fn check_searches(root: &Node) -> Result<()> {
    match root.searches().len() {
        0 => Ok(()),
        1 if root.nears().is_empty() => Ok(()),
        1 => Err(QueryError::bad_value("$text and what is near cannot be asked for in one filter").about("$text")),
        _ => Err(QueryError::bad_value("a filter can have only one $text").about("$text")),
    }
}

/// A compiled filter.
#[derive(Debug)]
pub struct Filter {
    root: Node,
    /// Made for the first document that is looked at: a filter that an index answers may see none.
    prefilter: OnceLock<Option<Prefilter>>,
    variables: Variables,
    /// The default of `$$NOW`: the time at which the filter was parsed.
    now: DateTime,
}

impl Filter {
    /// Reads a filter; an empty one matches everything.
    ///
    /// # Errors
    /// If MongoDB refuses it, or rmem does not support an operator.
    pub fn parse(filter: &Document) -> Result<Self> {
        Self::of_query(filter, Parser::default(), Variables::default())
    }

    fn of_query(filter: &Document, parser: Parser<'_>, variables: Variables) -> Result<Self> {
        let root = parser.of_query().filter(filter)?;
        if root.nears().len() > 1 {
            return Err(QueryError::bad_value("a filter can ask only once for what is near"));
        }
        check_searches(&root)?;
        Ok(Self { prefilter: OnceLock::new(), root, variables, now: DateTime::now() })
    }

    /// [`Filter::parse`] with constants its expressions can use as `$$name`.
    ///
    /// # Errors
    /// As [`Filter::parse`].
    pub fn parse_with_constants(filter: &Document, constants: &Document) -> Result<Self> {
        let (scope, variables) = Scope::with_constants(constants)?;
        Self::of_query(filter, Parser::with_scope(&scope), variables)
    }

    /// Reads a filter whose expressions see `now` as `$$NOW`, and variables.
    pub(super) fn parse_with(filter: &Document, parser: &Parser<'_>) -> Result<Self> {
        let root = parser.filter(filter)?;
        check_searches(&root)?;
        Ok(Self { prefilter: OnceLock::new(), root, variables: Variables::default(), now: DateTime::now() })
    }

    /// Returns whether a document matches.
    ///
    /// # Errors
    /// If an expression of the filter fails on the document.
    pub fn matches(&self, document: &RawDocument) -> Result<bool> {
        match self.prefilter.get_or_init(|| Prefilter::of(&self.root)) {
            Some(prefilter) if !prefilter.may_match(document) => Ok(false),
            _ => self.root.matches(document.into(), &mut self.context()),
        }
    }

    /// Reads the filter of a validator.
    ///
    /// # Errors
    /// As [`Filter::parse`], and where it has an operator that no validator may have.
    pub(super) fn parse_validator(filter: &Document) -> Result<Self> {
        Self::parse_with(filter, &Parser::default().of_validator())
    }

    /// [`Filter::matches`] with `$$NOW` at this time.
    pub(super) fn matches_at(&self, document: &RawDocument, now: DateTime) -> Result<bool> {
        self.root.matches(document.into(), &mut Context { now: Some(now), ..self.context() })
    }

    /// Returns whether an owned document matches.
    ///
    /// # Errors
    /// If an expression of the filter fails on the document.
    pub fn matches_document(&self, document: &Document) -> Result<bool> {
        self.root.matches(document.into(), &mut self.context())
    }

    /// [`Filter::matches`] with variables for its expressions.
    pub(super) fn matches_with(&self, fields: Fields<'_>, context: &mut Context<'_>) -> Result<bool> {
        self.root.matches(fields, context)
    }

    /// For a document that matches: the index in the array by which it does, where
    /// it matches by one. The positional `$` stands for it.
    pub(super) fn position(&self, fields: Fields<'_>, now: DateTime) -> Result<Option<usize>> {
        let mut context = Context { now: Some(now), ..self.context() };
        if !self.root.matches(fields, &mut context).unwrap_or(false) {
            context = Context { now: Some(now), is_known: true, ..self.context() };
            self.root.matches(fields, &mut context)?;
        }
        Ok(context.position)
    }

    fn context(&self) -> Context<'_> {
        Context { variables: Some(&self.variables), now: Some(self.now), ..Context::default() }
    }

    pub(super) fn root(&self) -> &Node {
        &self.root
    }

    /// Decides conditions on paths as they are decided for every document which lacks them. To be applied to such
    /// documents only.
    pub fn assume_missing(&mut self, paths: &[&str]) {
        let empty = Document::new();
        let decided = |node: Node| match &node {
            Node::Field(own, _) if paths.contains(&own.text()) => {
                match node.matches((&empty).into(), &mut Context::default()) {
                    Ok(true) => None,
                    Ok(false) => Some(Node::Always(false)),
                    Err(_) => Some(node),
                }
            }
            _ => Some(node),
        };
        let root = std::mem::replace(&mut self.root, Node::And(Vec::new()));
        self.root = Node::all(root.conjuncts().into_iter().filter_map(decided).collect());
        self.prefilter = OnceLock::new();
    }

    /// Returns the date, where the filter is only that the dates at a path are not at or before it.
    #[must_use]
    pub fn not_before(&self, path: &str) -> Option<DateTime> {
        match &self.root {
            Node::Field(own, Test::Not(test)) if own.text() == path => match test.as_ref() {
                Test::Leaf(Leaf::Order(Order::LessOrEqual, Bson::DateTime(date))) => Some(*date),
                _ => None,
            },
            _ => None,
        }
    }

    /// Returns the distance condition of the filter, if any: matches are ordered by distance.
    #[must_use]
    pub fn near(&self) -> Option<&Near> {
        self.root.nears().into_iter().next()
    }

    /// Returns the search of the filter, if any.
    #[must_use]
    pub fn search(&self) -> Option<&TextSearch> {
        self.root.searches().into_iter().next()
    }

    /// Lets the search of the filter, if any, look for what an index searches in the documents that the index holds.
    ///
    /// # Errors
    /// If the filter of a partial index is wrong.
    pub fn bind(&self, index: &Arc<TextIndex>, partial: Option<&Document>) -> Result<()> {
        for text in self.root.searches() {
            text.search.bind(index);
            if let (Some(partial), None) = (partial, text.within.get()) {
                let _ = text.within.set(Parser::default().of_query().filter(partial)?);
            }
        }
        Ok(())
    }

    /// Returns whether each alternative to the search (`$or`) has a condition on an indexed path.
    #[must_use]
    pub fn has_indexed_alternatives(&self, is_indexed: &dyn Fn(&str) -> bool) -> bool {
        self.root.has_indexed_alternatives(is_indexed)
    }

    /// Returns whether the filter fixes the value at a path.
    #[must_use]
    pub fn fixes(&self, path: &str) -> bool {
        let is_fixed = |node: &Node| matches!(node, Node::Field(own, Test::Leaf(Leaf::Equal(_))) if own.text() == path);
        match &self.root {
            Node::And(children) => children.iter().any(is_fixed),
            root => is_fixed(root),
        }
    }

    /// Returns whether no document matches, whatever it has.
    #[must_use]
    pub fn matches_none(&self) -> bool {
        match &self.root {
            Node::And(children) => children.iter().any(|child| matches!(child, Node::Always(false))),
            root => matches!(root, Node::Always(false)),
        }
    }

    /// Returns whether every document matches.
    #[must_use]
    pub fn matches_all(&self) -> bool {
        matches!(&self.root, Node::And(children) if children.is_empty())
    }
}
