//! `rmem validate DOMAIN [PROBLEM [PLAN]]`: parse, check, and simulate a plan.

use super::{Context, gen_problem::read_domain};
use crate::cli::Validate;
use crate::exit::Exit;
use crate::formats::{Diagnostics, pddl::Dialect, plan::read_plan};
use crate::pddl::{Problem, Step, Validation, repair, validate};

pub(super) fn run(args: &Validate, context: &mut Context<'_>) -> anyhow::Result<Exit> {
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
