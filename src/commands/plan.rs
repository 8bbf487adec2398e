//! `rmem plan`: a problem from the memory, a plan for it, and the plan into the memory.

use std::time::Instant;

use anyhow::Context as _;

use super::gen_problem::{check, generate, read_domain};
use super::{Context, UsageError};
use crate::cli;
use crate::exit::Exit;
use crate::formats::{Diagnostics, Source, pddl::Dialect, shell};
use crate::memory::Memory;
use crate::output::Format;
use crate::pddl::{Domain, Problem, validate};
use crate::plan::{self, Plan};
use crate::planner::{self, Host, Limits, Outcome, Planner, Run, Task};
use crate::problem::{Generated, names};

pub(super) fn run(args: &cli::Plan, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let format = context.format(&[Format::Text, Format::Json, Format::Clips, Format::Ff, Format::Dot])?;
    let planner = choose(&args.planner, context)?;
    let domain = read_domain(&args.domain, args.options.lenient, context)?;
    let memory = context.memory()?;
    let posed = pose(args, &domain, &memory, context)?;
    let mut run = search(planner.as_ref(), &domain, &posed.problem, args, context);
    simulate(&mut run, &domain, &posed.problem);
    restore(&mut run);
    if !args.no_store {
        store(&run, args, &domain, &posed, &memory, context)?;
    }
    print(&run, &domain, format, args, context)
}

/// A problem, and what is known about where it came from.
struct Posed {
    problem: Problem,
    source: Source,
    template: Option<Source>,
    generated: Option<Generated>,
}

/// Reads the problem, or generates it from the template, and checks it against the domain.
fn pose(args: &cli::Plan, domain: &Domain, memory: &Memory, context: &mut Context<'_>) -> anyhow::Result<Posed> {
    let dialect = Dialect { lenient: args.options.lenient };
    if let Some(path) = &args.problem {
        let source = context.read(path)?;
        let problem = Problem::read(&source, domain, dialect).map_err(Diagnostics)?;
        return Ok(Posed { problem, source, template: None, generated: None });
    }
    let template = args.template.as_deref().ok_or_else(|| UsageError::new("expected --problem or --template"))?;
    let (template, generated) = generate(template, &args.options, memory, context)?;
    let problem = check(&generated, domain, args.options.lenient)?;
    let source = problem.source().clone();
    Ok(Posed { problem, source, template: Some(template), generated: Some(generated) })
}

/// The planner of that name: one of rmem's own or of the settings.
fn choose(name: &str, context: &Context<'_>) -> Result<Box<dyn Planner>, UsageError> {
    let configured = context.settings.planners.iter().find(|planner| planner.name == name);
    if let Some(configured) = configured {
        return Ok(Box::new(configured.clone()));
    }
    planner::by_name(name).ok_or_else(|| {
        let mut known = vec!["builtin", "ff", "fast-downward"];
        known.extend(context.settings.planners.iter().map(|planner| planner.name.as_str()));
        UsageError::new(format!("there is no planner `{name}`; expected one of {}", known.join(", ")))
    })
}

fn search(planner: &dyn Planner, domain: &Domain, problem: &Problem, args: &cli::Plan, context: &mut Context<'_>) -> Run {
    let limits = Limits { time: Some(args.timeout), memory: args.memory_limit, ..Limits::default() };
    let host = Host {
        exe: context.executable.clone(),
        temporary: context.environment.get("TMPDIR").map_or_else(|| "/tmp".into(), Into::into),
        interrupted: crate::interruptible(),
    };
    let task = Task {
        domain: domain.tree(),
        problem: problem.tree(),
        domain_source: domain.source(),
        problem_source: problem.source(),
    };
    let start = Instant::now();
    let run = planner::run(planner, &task, &limits, &host);
    context.output.operation("plan", &run.planner, run.outcome.word(), start.elapsed());
    run
}

/// A plan that does not reach the goal is none, whatever its planner says.
fn simulate(run: &mut Run, domain: &Domain, problem: &Problem) {
    let Outcome::Plan(plan) = &run.outcome else { return };
    let verdict = validate(domain, problem, &plan.steps);
    if verdict.is_invalid() {
        run.message = format!("it returned a plan that is not valid: {verdict}");
        run.outcome = Outcome::Failed;
    }
}

/// Gives objects the memory's spelling.
fn restore(run: &mut Run) {
    let Outcome::Plan(plan) = &mut run.outcome else { return };
    for argument in plan.steps.iter_mut().flat_map(|step| &mut step.arguments) {
        if let Some(original) = names::restore(argument) {
            *argument = original;
        }
    }
}
