//! `rmem plan import FILE`: a plan that was found elsewhere, validated and stored.

use std::path::PathBuf;

use bson::doc;
use clap::Args;

use super::layout::Layout;
use super::show;
use super::source::{self, SectionCounts, TaskArgs};
use crate::commands::{Context, formats};
use crate::error::{Context as _, Result};
use crate::exit::Exit;
use crate::formats::plan::read_plan;
use crate::formats::{Source, shell};
use crate::output::Format;
use crate::pddl::{Domain, Plan, Problem, Validation, repair, validate};
use crate::plan::{IMPORTED, Repository, rounded, to_document};
use crate::planner::{Task, spaced};
use crate::planning::PlanningTask;
use crate::problem::names;
use crate::store::{Namespace, metadata};

/// Store a plan from a file, after it is validated
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  rmem plan import plan.txt --domain domain.pddl --template problem.pddl.j2 --goal '(on A B)'\n  ff -o domain.pddl -f problem.pddl | rmem plan import - --domain domain.pddl --problem problem.pddl\n\n\
Reads what FF prints, plans as in planning competitions, and temporal plans. A plan that does\n\
not reach the goal is not stored; exits with 1 then."
)]
#[command(arg = formats::argument(&formats::TEXT))]
pub struct ImportArgs {
    /// The plan; - is stdin
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// The task.
    #[command(flatten)]
    pub task: TaskArgs,
    /// Collection in which the plan is stored
    #[arg(long, value_name = "NS", default_value = "robmem.plans")]
    pub into: Namespace,
    /// Layout of the plan document: numbered, fawkes
    #[arg(long, value_name = "LAYOUT", default_value = "numbered", hide_possible_values = true)]
    pub layout: Layout,
}

pub(super) fn run(args: &ImportArgs, context: &mut Context<'_>) -> Result<Exit> {
    let is_json = context.format(&formats::TEXT)? == Format::Json;
    let source = source::read(&args.task, context)?;
    let domain = source.read_domain()?;
    let file = context.read_pddl(&args.file)?;
    let text = Source::new(file.name(), names::spell_plan(file.text()));
    let found = read_plan(&text)?;
    let is_printed = found.is_printed;
    let plan = Plan::from(found);
    let memory = context.memory()?;
    let task = PlanningTask::instantiate(&source, None, &domain, &memory);
    let sections = SectionCounts::from(&args.task.options);
    sections.report(task.as_ref(), &memory, context)?;
    let task = task?;
    sections.warn(&domain, &task, context);
    let mut plan = plan.timed_as(&domain, &task.problem).spelled(domain.tree(), task.problem.tree());
    let mut verdict = validate(&domain, &task.problem, &plan.steps);
    if is_printed && matches!(verdict, Validation::Invalid(_)) {
        let pddl = Task { domain: &domain, problem: &task.problem };
        (plan, verdict) = spaced(&plan, &pddl).unwrap_or((plan, verdict));
    }
    match verdict {
        Validation::Valid { value } => {
            if let Some((claim, value)) = plan.cost.zip(value).filter(|(claim, value)| (claim - value).abs() > 0.01) {
                let (claim, value) = (rounded(claim), rounded(value));
                let note = format!("{} says that its cost is {claim}; it is {value}", file.name());
                context.output.note(&note);
            }
            plan.cost = value.or(plan.cost);
        }
        verdict => return refuse(file.name(), &verdict, (&domain, &task.problem, &plan), is_json, context),
    }
    let mut lineage = task.lineage(source);
    lineage.planner = IMPORTED.to_owned();
    lineage.arguments = vec![file.name().to_owned()];
    lineage.outcome = "success".to_owned();
    lineage.cost = plan.cost;
    lineage.length = Some(plan.steps.len());
    let mut document = to_document(&plan, domain.tree(), args.layout.into(), &|name| task.value(name));
    document.insert(metadata::INFO, doc! { "lineage": lineage.to_document() });
    let repository = Repository::new(&memory, &args.into);
    let id = repository.store(document).context("storing the plan")?;
    context.output.note(&format!("stored in {} as {id}", args.into));
    if is_json {
        show::report(&repository.get(&id)?, Some(&args.into), Exit::Done, context)?;
    } else {
        context.output.line(&id)?;
    }
    Ok(Exit::Done)
}

/// Prints why a plan is not stored, and how it could be mended.
fn refuse(
    file: &str,
    verdict: &Validation,
    (domain, problem, plan): (&Domain, &Problem, &Plan),
    is_json: bool,
    context: &mut Context<'_>,
) -> Result<Exit> {
    let reason = names::readable(&verdict.to_string());
    context.output.error(&format!("{file} is not stored: {reason}"));
    for repair in repair(domain, problem, &plan.steps) {
        context.output.note(&names::readable(&repair.to_string()));
    }
    let (outcome, exit) = match verdict {
        Validation::Invalid(_) => ("invalid", Exit::No),
        _ => ("unsupported", Exit::Unsupported),
    };
    if is_json {
        let code = i32::from(exit.code());
        let report = doc! { "id": null, "namespace": null, "outcome": outcome, "exit": code, "message": reason };
        context.output.line(&shell::relaxed(&report))?;
    }
    Ok(exit)
}
