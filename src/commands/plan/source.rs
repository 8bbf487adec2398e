//! What the command line says a plan is for.

use std::path::PathBuf;

use clap::{ArgGroup, Args};

use crate::commands::template::{self, TemplateArgs};
use crate::commands::{Context, UsageError};
use crate::error::Result;
use crate::memory::Memory;
use crate::pddl::Domain;
use crate::plan::{Input, TaskSource};
use crate::planning::{PlanningError, PlanningTask};

/// The task of a plan.
#[derive(Debug, Clone, Args)]
#[command(group = ArgGroup::new("source").required(true).args(["problem", "template"]))]
pub struct TaskArgs {
    /// The domain; one that ends in .j2 or .tmpl is a template, rendered when the plan is made
    #[arg(short, long, value_name = "FILE")]
    pub domain: PathBuf,
    /// The problem; - is stdin
    #[arg(short, long, value_name = "FILE")]
    pub problem: Option<PathBuf>,
    /// The template to generate the problem from; - is stdin
    #[arg(short, long, value_name = "FILE")]
    pub template: Option<PathBuf>,
    /// The template's arguments.
    #[command(flatten)]
    pub options: TemplateArgs,
}

/// Reads what the command line names; the memory is not asked yet.
pub(super) fn read(task: &TaskArgs, context: &mut Context<'_>) -> Result<TaskSource> {
    let lenient = task.options.lenient;
    let (domain, rendered) = match template::is_template(&task.domain) {
        true => {
            let memory = context.memory()?;
            let (domain, request) = template::render_domain(&task.domain, &task.options, &memory, context)?;
            (domain, Some(request))
        }
        false => (context.read_pddl(&task.domain)?, None),
    };
    if task.problem.is_some() {
        refuse_unused(&task.options, rendered.is_some())?;
    }
    let input = match (&task.problem, &task.template) {
        (Some(path), _) => Input::Problem(context.read_pddl(path)?),
        (None, Some(path)) => {
            let text = context.read(path)?;
            Input::Template(Box::new(template::request(text, &task.options, rendered.as_ref(), context)?))
        }
        (None, None) => return Err(UsageError::new("expected --problem or --template").into()),
    };
    Ok(TaskSource { domain, input, lenient })
}

/// Refuses what only a template uses.
fn refuse_unused(options: &TemplateArgs, is_domain_rendered: bool) -> Result<(), UsageError> {
    if options.goal.is_some() {
        return Err(UsageError::new("--goal is for a template; the problem of --problem has a goal of its own"));
    }
    match options.definitions.first() {
        Some(definition) if !is_domain_rendered => {
            Err(UsageError::new(format!("-D {} is for a template; --problem is taken as it is", definition.name)))
        }
        _ => Ok(()),
    }
}

/// How the numbers of documents that the sections of a template match are reported.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SectionCounts {
    /// Not at all.
    Silent,
    /// Under `-v` on stderr, and where a section matches none.
    Printed,
    /// As well; a section that matches none is an error.
    Required,
}

impl From<&TemplateArgs> for SectionCounts {
    fn from(options: &TemplateArgs) -> Self {
        if options.strict { Self::Required } else { Self::Printed }
    }
}

impl SectionCounts {
    /// Prints what is odd but not wrong in the domain and the problem.
    pub(super) fn warn(self, domain: &Domain, task: &PlanningTask, context: &mut Context<'_>) {
        if self == Self::Silent {
            return;
        }
        template::warn(domain.warnings(), context);
        let odd = task.problem.warnings().to_vec();
        let odd = task.generated.as_ref().map_or(odd.clone(), |generated| generated.explain(odd));
        template::warn(&odd, context);
    }

    /// Reports them for a task, also for one whose problem is wrong: the memory may lack what the template asks.
    pub(super) fn report(
        self,
        task: Result<&PlanningTask, &PlanningError>,
        memory: &Memory,
        context: &mut Context<'_>,
    ) -> Result<()> {
        let generated = match task {
            Ok(task) => task.generated.as_ref(),
            Err(error) => error.generated(),
        };
        let Some(generated) = generated.filter(|_| self != Self::Silent) else { return Ok(()) };
        template::report(&generated.into(), memory, context);
        // What is wrong with the problem is said instead.
        if self == Self::Required && task.is_ok() { template::require(&generated.sections) } else { Ok(()) }
    }
}
