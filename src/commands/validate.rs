//! `rmem validate DOMAIN [PROBLEM [PLAN]]`: parse, check, and simulate a plan.

use std::path::PathBuf;

use clap::Args;

use super::Context;
use super::template::read_domain;
use crate::exit::Exit;
use crate::formats::{Diagnostics, pddl::Dialect, plan::read_plan};
use crate::pddl::{Problem, Step, Validation, repair, validate};

/// Check a domain and a problem, and simulate a plan
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  rmem validate domain.pddl problem.pddl plan.txt")]
pub struct ValidateArgs {
    /// The domain
    #[arg(value_name = "DOMAIN")]
    pub domain: PathBuf,
    /// A problem of it; - is stdin
    #[arg(value_name = "PROBLEM")]
    pub problem: Option<PathBuf>,
    /// A plan for it; - is stdin
    #[arg(value_name = "PLAN")]
    pub plan: Option<PathBuf>,
    /// Take `//` to the end of a line as a comment
    #[arg(long)]
    pub lenient: bool,
}

pub(super) fn run(args: &ValidateArgs, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let domain = read_domain(&args.domain, args.lenient, context)?;
    let Some(problem) = &args.problem else {
        context.output.line(&format!("domain {} is valid", domain.name()))?;
        return Ok(Exit::Done);
    };
    let source = context.read(problem)?;
    let problem = Problem::read(&source, &domain, Dialect { lenient: args.lenient }).map_err(Diagnostics)?;
    let Some(plan) = &args.plan else {
        context.output.line(&format!("problem {} is valid", problem.name()))?;
        return Ok(Exit::Done);
    };
    let steps = read_plan(&context.read(plan)?)?.actions.into_iter().map(Step::from).collect::<Vec<_>>();
    let verdict = validate(&domain, &problem, &steps);
    context.output.line(&verdict.to_string())?;
    if let Validation::Invalid(_) = verdict {
        for repair in repair(&domain, &problem, &steps) {
            repair.to_string().lines().try_for_each(|line| context.output.line(&format!("  {line}")))?;
        }
    }
    Ok(match verdict {
        Validation::Valid { .. } => Exit::Done,
        Validation::Invalid(_) => Exit::No,
        Validation::Unjudged(_) => Exit::Unsupported,
    })
}
