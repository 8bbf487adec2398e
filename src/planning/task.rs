//! From what a plan is made to the problem as it is now.

use std::collections::HashMap;
use std::time::{Duration, Instant};

use bson::{Bson, DateTime};

use super::PlanningError;
use crate::formats::pddl::Dialect;
use crate::formats::{Diagnostics, shell};
use crate::memory::Memory;
use crate::pddl::{Domain, Problem};
use crate::plan::{Input, TaskSource};
use crate::problem::{self, Generated, names};

/// A problem to plan for, and where it came from.
#[derive(Debug)]
pub struct PlanningTask {
    /// The problem, checked against its domain.
    pub problem: Problem,
    /// What it was generated from, where a template made it.
    pub generated: Option<Generated>,
    /// When it began to be made.
    pub(super) started: DateTime,
    /// How long that took.
    pub(super) time: Duration,
}

impl PlanningTask {
    /// Reads the problem, or generates it from the template and the memory, and checks it against the domain.
    /// `generated` is what the template gave, where it was rendered before.
    ///
    /// # Errors
    /// What is wrong with the problem or the template; a store that fails.
    pub fn instantiate(
        source: &TaskSource,
        generated: Option<Generated>,
        domain: &Domain,
        memory: &Memory,
    ) -> Result<Self, PlanningError> {
        let (started, clock) = (DateTime::now(), Instant::now());
        let dialect = Dialect { lenient: source.lenient };
        let generated = match (&source.input, generated) {
            (Input::Problem(_), _) => None,
            (Input::Template(_), Some(generated)) => Some(generated),
            (Input::Template(request), None) => Some(problem::generate(request, memory)?),
        };
        let problem = match &generated {
            Some(generated) => generated.check(domain, dialect),
            None => Problem::read(source.input.text(), domain, dialect),
        };
        match problem {
            Ok(problem) => Ok(Self { problem, generated, started, time: clock.elapsed() }),
            Err(wrong) => Err(PlanningError::Pddl { wrong: Diagnostics(wrong), generated: generated.map(Box::new) }),
        }
    }

    /// Returns the memory's value for a name of the problem.
    #[must_use]
    pub fn value(&self, name: &str) -> Bson {
        match &self.generated {
            Some(generated) => generated.value(name),
            None => Bson::String(names::restore(name)),
        }
    }

    /// Returns the problem's names, those of the domain's constants among them, by the memory's values.
    pub(super) fn names(&self, domain: &Domain) -> NameTable {
        let constants = domain.tree().constants.iter().map(|constant| constant.name.as_str());
        let objects = self.problem.objects().map(|object| object.name);
        NameTable(constants.chain(objects).map(|name| (key(&self.value(name)), name.to_owned())).collect())
    }
}

/// The names of a problem by the values they stand for.
pub(super) struct NameTable(HashMap<String, String>);

impl NameTable {
    pub(super) fn get(&self, value: &Bson) -> Option<String> {
        self.0.get(&key(value)).cloned()
    }
}

/// What distinguishes values; 1, `NumberLong(1)` and 1.0 are one.
fn key(value: &Bson) -> String {
    match value {
        Bson::Double(number) => number.to_string(),
        other => shell::relaxed_value(other),
    }
}
