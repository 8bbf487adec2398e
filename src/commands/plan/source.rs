//! What the command line says a plan is for.

use crate::cli;
use crate::commands::gen_problem::{self, request};
use crate::commands::{Context, UsageError};
use crate::plan::{Input, TaskSource};
use crate::planning::PlanningTask;

/// Reads what the command line names; the memory is not asked yet.
pub(super) fn read(task: &cli::PlanTask, context: &mut Context<'_>) -> anyhow::Result<TaskSource> {
    let lenient = task.options.lenient;
    let domain = context.read(&task.domain)?;
    let input = match (&task.problem, &task.template) {
        (Some(path), _) => Input::Problem(context.read(path)?),
        (None, Some(path)) => {
            let template = context.read(path)?;
            Input::Template(Box::new(request(template, &task.options, context)?))
        }
        (None, None) => return Err(UsageError::new("expected --problem or --template").into()),
    };
    Ok(TaskSource { domain, input, lenient })
}

/// How the numbers of documents that the sections of a template match are reported.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SectionCounts {
    /// Not at all.
    Silent,
    /// On stderr.
    Printed,
    /// On stderr; a section that matches none is an error.
    Required,
}

impl From<&cli::TemplateOptions> for SectionCounts {
    fn from(options: &cli::TemplateOptions) -> Self {
        if options.strict { Self::Required } else { Self::Printed }
    }
}

impl SectionCounts {
    /// Reports them for a task.
    pub(super) fn report(self, task: &PlanningTask, context: &mut Context<'_>) -> anyhow::Result<()> {
        match (&task.generated, self) {
            (None, _) | (_, Self::Silent) => Ok(()),
            (Some(generated), _) => gen_problem::report(generated, self == Self::Required, context),
        }
    }
}
