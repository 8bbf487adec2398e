//! `rmem plan import FILE`: a plan that was found elsewhere, validated and stored.

use anyhow::Context as _;
use bson::doc;

use super::search::layout;
use super::source::{self, SectionCounts};
use crate::cli::PlanImport;
use crate::commands::Context;
use crate::exit::Exit;
use crate::formats::plan::read_plan;
use crate::pddl::{Plan, Validation, repair, validate};
use crate::plan::{IMPORTED, Repository, to_document};
use crate::planning::PlanningTask;
use crate::problem::names;
use crate::store::metadata;

pub(super) fn run(args: &PlanImport, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let source = source::read(&args.task, context)?;
    let domain = source.read_domain()?;
    let file = context.read(&args.file)?;
    let plan = Plan::from(read_plan(&file)?);
    let memory = context.memory()?;
    let task = PlanningTask::instantiate(&source, None, &domain, &memory)?;
    SectionCounts::from(&args.task.options).report(&task, context)?;
    let mut plan = plan.spelled(domain.tree(), task.problem.tree());
    match validate(&domain, &task.problem, &plan.steps) {
        Validation::Valid { value } => plan.cost = value.or(plan.cost),
        verdict => {
            let reason = names::restore(&verdict.to_string());
            context.output.error(&format!("{} is not stored: {reason}", file.name()));
            for repair in repair(&domain, &task.problem, &plan.steps) {
                context.output.note(&names::restore(&repair.to_string()));
            }
            return Ok(if matches!(verdict, Validation::Invalid(_)) { Exit::No } else { Exit::Unsupported });
        }
    }
    let mut lineage = task.lineage(source);
    lineage.planner = IMPORTED.to_owned();
    lineage.arguments = vec![file.name().to_owned()];
    lineage.outcome = "success".to_owned();
    lineage.cost = plan.cost;
    lineage.length = Some(plan.steps.len());
    let mut document = to_document(&plan, domain.tree(), layout(args.layout), &|name| task.value(name));
    document.insert(metadata::INFO, doc! { "lineage": lineage.to_document() });
    let id = Repository::new(&memory, &args.into).store(document).context("storing the plan")?;
    context.output.note(&format!("stored in {} as {id}", args.into));
    context.output.line(&id)?;
    Ok(Exit::Done)
}
