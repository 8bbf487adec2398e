//! The way back: a problem as documents, and a template that makes an equal problem of them.
//!
//! | relation | other keys |
//! |---|---|
//! | `domain-object` | `name`; `type`: a name, or an array where PDDL says `either`; none where there is none |
//! | `domain-fact` | `name`, `param_values`; `negated: true` where the problem says `(not …)` |
//! | `domain-function` | `name`, `param_values`, `value`: a number, or an object's name |
//! | `domain-timed-fact` | `time`, `name`, `param_values`, perhaps `negated: true` |
//! | `domain-goal` | `condition`; a document for each part of a conjunction |
//! | `domain-constraints` | `condition` |
//! | `domain-metric` | `direction`, `expression` |
//!
//! The first two are what the agents of Fawkes share their world model in. A condition is an atom
//! `{name, args}`, a comparison `{op, left, right}`, a quantifier `{op, variables, parts}`, or an operator with
//! its parts, `{op, parts}`; an expression is a number, a name, an atom, or `{op, parts}`; a variable is
//! `{variable: "x"}`. A name has the spelling of its first appearance, because a memory takes notice of case.

mod documents;
mod template;

use crate::formats::pddl::ast::Problem;
use crate::formats::{Diagnostic, Source};

/// A problem taken apart.
#[derive(Debug, Clone, PartialEq)]
pub struct Imported {
    /// Its documents, in the order of the problem.
    pub documents: Vec<bson::Document>,
    tree: Problem,
}

/// The values of `relation` that an import uses.
pub const RELATIONS: [&str; 7] = [
    "domain-object",
    "domain-fact",
    "domain-function",
    "domain-timed-fact",
    "domain-goal",
    "domain-constraints",
    "domain-metric",
];

/// Takes a problem apart.
///
/// # Errors
/// A name that is not the problem's own (a type, a predicate, a constant) and that a template could not write
/// as it is, at its place.
pub fn import(source: &Source, tree: Problem) -> Result<Imported, Diagnostic> {
    let documents = documents::of(source, &tree)?;
    Ok(Imported { documents, tree })
}

impl Imported {
    /// The template, in minijinja; it queries `namespace`. A goal that is given takes the place of the problem's.
    #[must_use]
    pub fn template(&self, namespace: &crate::store::Namespace) -> String {
        template::write(&self.tree, namespace)
    }
}
