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
use crate::plan::{self, Answered, Given, Lineage, Recipe};
use crate::problem::{self, Generated, SectionReport, names};

/// Reads what the command line names; the memory is not asked yet.
pub(super) fn recipe(task: &cli::PlanTask, context: &mut Context<'_>) -> anyhow::Result<Recipe> {
    let lenient = task.options.lenient;
    let domain = context.read(&task.domain)?;
    let task = match (&task.problem, &task.template) {
        (Some(path), _) => Given::Problem(context.read(path)?),
        (None, Some(path)) => {
            let template = context.read(path)?;
            Given::Template(Box::new(request(template, &task.options, context)?))
        }
        (None, None) => return Err(UsageError::new("expected --problem or --template").into()),
    };
    Ok(Recipe { domain, task, lenient })
}

/// The domain of a recipe, checked.
pub(super) fn domain(recipe: &Recipe) -> Result<Domain, Diagnostics> {
    Domain::read(&recipe.domain, Dialect { lenient: recipe.lenient }).map_err(Diagnostics)
}

/// A problem, and what is known about where it came from.
pub(super) struct Posed {
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
    recipe: &Recipe,
    domain: &Domain,
    sections: Sections,
    memory: &Memory,
    context: &mut Context<'_>,
) -> anyhow::Result<Posed> {
    let (started, clock) = (DateTime::now(), Instant::now());
    let dialect = Dialect { lenient: recipe.lenient };
    let (problem, generated) = match &recipe.task {
        Given::Problem(source) => (Problem::read(source, domain, dialect).map_err(Diagnostics)?, None),
        Given::Template(request) => {
            let generated = match sections {
                Sections::Unsaid => problem::generate(request, memory)?,
                Sections::Told => generate(request, false, memory, context)?,
                Sections::Demanded => generate(request, true, memory, context)?,
            };
            (generated.check(domain, dialect).map_err(Diagnostics)?, Some(generated))
        }
    };
    Ok(Posed { problem, generated, started, took: clock.elapsed() })
}

impl Posed {
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
    pub(super) fn lineage(&self, recipe: Recipe) -> Lineage {
        let given = match &recipe.task {
            Given::Template(request) => request.goal.clone(),
            Given::Problem(_) => None,
        };
        let template = match &recipe.task {
            Given::Template(request) => Some(plan::hash(request.template.text())),
            Given::Problem(_) => None,
        };
        let sections = self.generated.iter().flat_map(|generated| &generated.sections);
        Lineage {
            domain: plan::hash(recipe.domain.text()),
            problem: plan::hash(self.problem.source().text()),
            template,
            goal: given.unwrap_or_else(|| goal(&self.problem)),
            queries: sections.map(answered).collect(),
            started: Some(self.started),
            times: vec![("pose".to_owned(), self.took)],
            sources: Some(recipe),
            ..Lineage::default()
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

/// The goal as PDDL.
fn goal(problem: &Problem) -> String {
    problem.tree().goal.as_ref().map(ToString::to_string).unwrap_or_default()
}

fn answered(section: &SectionReport) -> Answered {
    Answered {
        name: section.name.clone(),
        namespace: section.namespace.to_string(),
        query: shell::relaxed(&section.query),
        count: section.matched,
    }
}
