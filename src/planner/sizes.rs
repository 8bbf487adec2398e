//! How large a task may be for a planner whose tables have fixed sizes.

use super::task::Task;
use crate::formats::pddl::ast::{Signature, Typed};
use crate::formats::{Diagnostic, Source, Span};

/// Limits that were compiled into a program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sizes {
    /// How many arguments a predicate or function may have.
    pub arity: usize,
    /// How many predicates a domain may have.
    pub predicates: usize,
    /// How many constants and objects a task may have.
    pub objects: usize,
}

impl Sizes {
    /// What of a task is too large, at its place.
    pub(super) fn exceeded(&self, planner: &str, task: &Task<'_>) -> Option<Diagnostic> {
        let (domain, problem) = (task.domain.tree(), task.problem.tree());
        let refuse = |source: &Source, span: Span, what: String| {
            Some(Diagnostic::new(source, span, format!("the planner `{planner}` is built for at most {what}")))
        };
        let functions = domain.functions.iter().map(|function| &function.signature);
        let derived = domain.derived.iter().map(|rule| &rule.head);
        let is_wide = |signature: &&Signature| signature.parameters.len() > self.arity;
        if let Some(wide) = domain.predicates.iter().chain(functions).chain(derived).find(is_wide) {
            let (name, count) = (&wide.name, wide.parameters.len());
            let what = format!("{} arguments; `{name}` has {count}", self.arity);
            return refuse(task.domain.source(), name.span(), what);
        }
        if let Some(first) = domain.predicates.get(self.predicates) {
            let what = format!("{} predicates; there are {}", self.predicates, domain.predicates.len());
            return refuse(task.domain.source(), first.name.span(), what);
        }
        let count = domain.constants.len() + problem.objects.len();
        let place = |source: &Source, object: &Typed| {
            refuse(source, object.name.span(), format!("{} constants and objects; there are {count}", self.objects))
        };
        match domain.constants.get(self.objects) {
            Some(constant) => place(task.domain.source(), constant),
            None => {
                let rest = self.objects.saturating_sub(domain.constants.len());
                place(task.problem.source(), problem.objects.get(rest)?)
            }
        }
    }
}
