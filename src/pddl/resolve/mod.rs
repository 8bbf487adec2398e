//! Syntax tree → resolved conditions and effects, with complaints and the features in use.
//!
//! Recursion is as deep as the brackets, which the reader of the syntax bounds.
//! After a complaint a stand-in takes the place of what could not be resolved, so
//! that the rest is looked at too.

mod condition;
mod effect;
mod number;
mod term;

use super::feature::Uses;
use super::model::Variable;
use super::report::Report;
use super::table::Table;
use super::vocabulary::{ObjectEntry, Vocabulary};
use crate::formats::pddl::ast::Name;

/// Names to resolve against, and where complaints and features go.
pub(in crate::pddl) struct Resolver<'a, 'r, 's> {
    pub(in crate::pddl) vocabulary: &'a Vocabulary,
    pub(in crate::pddl) objects: &'a Table<ObjectEntry>,
    pub(in crate::pddl) report: &'r mut Report<'s>,
    pub(in crate::pddl) uses: &'r mut Uses,
    /// Variables in scope; their places are their slots.
    pub(in crate::pddl) scope: Vec<Variable>,
    /// Whether `?duration` and `#t` mean something here.
    pub(in crate::pddl) durative: bool,
    /// The predicates that rules derive.
    pub(in crate::pddl) derived: &'a [u32],
    /// Preferences that have a name, for `is-violated`.
    pub(in crate::pddl) preferences: Vec<Name>,
}

/// `no arguments`, `1 argument`, `2 arguments`.
pub(in crate::pddl) fn count(number: usize) -> String {
    match number {
        0 => "no arguments".to_owned(),
        1 => "1 argument".to_owned(),
        more => format!("{more} arguments"),
    }
}
