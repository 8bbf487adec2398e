//! `rmem ff -o DOMAIN -f PROBLEM`: the built-in planner, speaking FF.

use super::Context;
use crate::cli::Ff;
use crate::exit::Exit;
use crate::planner::builtin;

pub(super) fn run(args: &Ff, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let domain = context.read(&args.domain)?;
    let problem = context.read(&args.problem)?;
    let (text, code) = builtin::child(domain.text(), problem.text(), builtin::Options::default());
    context.output.stdout().write_all(text.as_bytes())?;
    Ok(Exit::Passed(u8::try_from(code).unwrap_or(Exit::PlannerBroken.code())))
}
