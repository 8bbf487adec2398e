//! `rmem plan` itself: a problem from the memory, a plan for it, and the plan into the memory.

use std::panic::resume_unwind;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use clap::Args;

use super::find::{choose, find_prepared};
use super::layout::Layout;
use super::source::{self, SectionCounts, TaskArgs};
use super::{show, watch};
use crate::commands::Context;
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::quantity;
use crate::plan::Input;
use crate::planner::Planner;
use crate::planning::{self, PlanRequest, SearchOptions};
use crate::store::Namespace;

/// Find a plan, check it, store it, print it
#[derive(Debug, Args)]
pub struct SearchArgs {
    /// The task.
    #[command(flatten)]
    pub task: TaskArgs,
    /// How to plan.
    #[command(flatten)]
    pub limits: LimitArgs,
    /// Plan again whenever the memory changes so that the plan does not hold any more
    #[arg(long, requires = "template", conflicts_with = "no_store")]
    pub watch: bool,
}

/// How to plan, and where the plan goes.
#[derive(Debug, Clone, Args)]
pub struct LimitArgs {
    /// Planner: builtin, ff, fast-downward, or a [planner.NAME] of rmem.toml (can be repeated; the first valid plan wins)
    #[arg(long, value_name = "NAME", default_value = "builtin")]
    pub planner: Vec<String>,
    /// Time limit
    #[arg(long, value_name = "DURATION", default_value = "60s", value_parser = quantity::time_limit)]
    pub timeout: Duration,
    /// Use all of the time to find better plans, and take the best; an interruption (130) takes the best so far
    #[arg(long)]
    pub anytime: bool,
    /// Memory limit
    #[arg(long, value_name = "SIZE", value_parser = quantity::memory_limit)]
    pub memory_limit: Option<u64>,
    /// Collection in which the plan is stored
    #[arg(long, value_name = "NS", default_value = "robmem.plans")]
    pub into: Namespace,
    /// Layout of the plan document: numbered, fawkes
    #[arg(long, value_name = "LAYOUT", default_value = "numbered", hide_possible_values = true)]
    pub layout: Layout,
    /// Do not store the plan
    #[arg(long)]
    pub no_store: bool,
}

pub(super) fn run(args: &SearchArgs, context: &mut Context<'_>) -> Result<Exit> {
    context.format(&show::FORMATS)?;
    let planners = choose(&args.limits.planner, args.limits.anytime, context)?;
    let sections = SectionCounts::from(&args.task.options);
    if args.watch {
        let source = source::read(&args.task, context)?;
        let request = PlanRequest::new(source, planners, options(&args.limits))?;
        let memory = context.memory()?;
        return watch::run(request, sections, &memory, context);
    }
    let planners: Arc<[Box<dyn Planner>]> = planners.into();
    let (options, host) = (options(&args.limits), context.host());
    // The planners' programs start while the domain is read and the problem is made, but not beside that in this process:
    // threads that need new memory wait for each other. The built-in one begins with a large problem while that is checked.
    let mut portfolio = planning::start(&planners, &options.limits(), &host);
    let source = source::read(&args.task, context)?;
    let early = match &source.input {
        Input::Problem(problem) if !source.lenient => Some((source.domain.clone(), problem.clone())),
        _ => None,
    };
    thread::scope(|scope| {
        let host = &host;
        let starting = scope.spawn(move || {
            if let Some((domain, problem)) = early {
                portfolio.begin(&domain, &problem, host);
            }
            portfolio
        });
        let request = PlanRequest::new(source, planners.clone(), options.clone())?;
        let memory = context.memory()?;
        let started = || starting.join().unwrap_or_else(|panic| resume_unwind(panic));
        let prepared = planning::prepare_started(&request, &memory, started);
        let (found, result) = find_prepared(&request, prepared, sections, &memory, context)?;
        // The end of the process gives back a large problem at once.
        std::mem::forget(result);
        std::mem::forget(request);
        Ok(found.exit)
    })
}

fn options(limits: &LimitArgs) -> SearchOptions {
    SearchOptions {
        anytime: limits.anytime,
        timeout: limits.timeout,
        memory_limit: limits.memory_limit,
        into: (!limits.no_store).then(|| limits.into.clone()),
        layout: limits.layout.into(),
    }
}
