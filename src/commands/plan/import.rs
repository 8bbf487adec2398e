//! `rmem plan import FILE`: a plan that was found elsewhere, validated and stored.

use bson::doc;

use super::pose::{self, Sections, pose};
use super::run::{layout, store};
use crate::cli::PlanImport;
use crate::commands::Context;
use crate::exit::Exit;
use crate::formats::plan::read_plan;
use crate::pddl::{Validation, repair, validate};
use crate::plan::{IMPORTED, Plan, to_document};
use crate::problem::names;
use crate::store::metadata;

pub(super) fn run(args: &PlanImport, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let recipe = pose::recipe(&args.task, context)?;
    let domain = pose::domain(&recipe)?;
    let file = context.read(&args.file)?;
    let plan = Plan::from(read_plan(&file)?);
    let memory = context.memory()?;
    let posed = pose(&recipe, &domain, Sections::from(&args.task.options), &memory, context)?;
    let mut plan = plan.spelled(domain.tree(), posed.problem.tree());
    match validate(&domain, &posed.problem, &plan.steps) {
        Validation::Valid { value } => plan.cost = value.or(plan.cost),
        verdict => {
            let said = names::restore(&verdict.to_string());
            context.output.error(&format!("{} is not stored: {said}", file.name()));
            for repair in repair(&domain, &posed.problem, &plan.steps) {
                context.output.note(&names::restore(&repair.to_string()));
            }
            return Ok(if matches!(verdict, Validation::Invalid(_)) { Exit::No } else { Exit::Unsupported });
        }
    }
    let mut lineage = posed.lineage(recipe);
    lineage.planner = IMPORTED.to_owned();
    lineage.arguments = vec![file.name().to_owned()];
    lineage.outcome = "success".to_owned();
    lineage.cost = plan.cost;
    lineage.length = Some(plan.steps.len());
    let mut document = to_document(&plan, domain.tree(), layout(args.layout), &|name| posed.value(name));
    document.insert(metadata::INFO, doc! { "lineage": lineage.to_document() });
    let id = store(document, &args.into, &memory, context)?;
    context.output.line(&id)?;
    Ok(Exit::Done)
}
