//! From what a plan is made to the problem as it is now.

use std::collections::HashMap;
use std::time::{Duration, Instant};

use bson::{Bson, DateTime};

use crate::cli;
use crate::commands::gen_problem::{generate, request};
use crate::commands::{Context, UsageError};
use crate::formats::pddl::Dialect;
use crate::formats::{Diagnostics, shell};
use crate::memory::Memory;
use crate::pddl::{Domain, Problem};
use crate::plan::{Input, Lineage, TaskSource};
use crate::problem::{self, Generated, names};

/// Reads what the command line names; the memory is not asked yet.
pub(super) fn recipe(task: &cli::PlanTask, context: &mut Context<'_>) -> anyhow::Result<TaskSource> {
    let lenient = task.options.lenient;
    let domain = context.read(&task.domain)?;
    let task = match (&task.problem, &task.template) {
        (Some(path), _) => Input::Problem(context.read(path)?),
        (None, Some(path)) => {
            let template = context.read(path)?;
            Input::Template(Box::new(request(template, &task.options, context)?))
        }
        (None, None) => return Err(UsageError::new("expected --problem or --template").into()),
    };
    Ok(TaskSource { domain, task, lenient })
}

/// The domain of a recipe, checked.
pub(super) fn domain(recipe: &TaskSource) -> Result<Domain, Diagnostics> {
    Domain::read(&recipe.domain, Dialect { lenient: recipe.lenient }).map_err(Diagnostics)
}

/// A problem, and what is known about where it came from.
pub(super) struct PlanningTask {
    pub(super) problem: Problem,
    pub(super) generated: Option<Generated>,
    started: DateTime,
    took: Duration,
}

/// What is said of how many documents the sections of a template match.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sections {
    /// Nothing.
    Unsaid,
    /// The counts.
    Told,
    /// The counts, and that none at all is a mistake.
    Demanded,
}

impl From<&cli::TemplateOptions> for Sections {
    fn from(options: &cli::TemplateOptions) -> Self {
        if options.strict { Self::Demanded } else { Self::Told }
    }
}

/// Reads the problem, or generates it from the template, and checks it against the domain.
pub(super) fn pose(
    recipe: &TaskSource,
    domain: &Domain,
    sections: Sections,
    memory: &Memory,
    context: &mut Context<'_>,
) -> anyhow::Result<PlanningTask> {
    let (started, clock) = (DateTime::now(), Instant::now());
    let dialect = Dialect { lenient: recipe.lenient };
    let (problem, generated) = match &recipe.task {
        Input::Problem(source) => (Problem::read(source, domain, dialect).map_err(Diagnostics)?, None),
        Input::Template(request) => {
            let generated = match sections {
                Sections::Unsaid => problem::generate(request, memory)?,
                Sections::Told => generate(request, false, memory, context)?,
                Sections::Demanded => generate(request, true, memory, context)?,
            };
            (generated.check(domain, dialect).map_err(Diagnostics)?, Some(generated))
        }
    };
    Ok(PlanningTask { problem, generated, started, took: clock.elapsed() })
}

impl PlanningTask {
    /// The memory's value for a name of the problem.
    pub(super) fn value(&self, name: &str) -> Bson {
        match &self.generated {
            Some(generated) => generated.value(name),
            None => Bson::String(names::restore(name)),
        }
    }

    /// The problem's names for the memory's values, those of the domain's constants among them.
    pub(super) fn names(&self, domain: &Domain) -> HashMap<String, String> {
        let constants = domain.tree().constants.iter().map(|constant| constant.name.as_str());
        let objects = self.problem.objects().map(|object| object.name);
        constants.chain(objects).map(|name| (key(&self.value(name)), name.to_owned())).collect()
    }

    /// Where a plan for this problem comes from, before it is looked for.
    pub(super) fn lineage(&self, recipe: TaskSource) -> Lineage {
        let sections = self.generated.as_ref().map_or(&[][..], |generated| &generated.sections);
        Lineage {
            started: Some(self.started),
            times: vec![("pose".to_owned(), self.took)],
            ..Lineage::of(recipe, &self.problem, sections)
        }
    }
}

/// What tells values apart; 1, `NumberLong(1)` and 1.0 are one.
pub(super) fn key(value: &Bson) -> String {
    match value {
        Bson::Double(number) => number.to_string(),
        other => shell::relaxed_value(other),
    }
}
