//! `rmem plan check ID`: does the rest of a stored plan still reach its goal?

use super::stored;
use crate::cli::PlanCheck;
use crate::commands::Context;
use crate::exit::Exit;
use crate::formats::shell;
use crate::output::Format;
use crate::planning::{self, Check};

pub(super) fn run(args: &PlanCheck, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let format = context.format(&[Format::Text, Format::Json])?;
    let now = args.problem.as_deref().map(|path| context.read(path)).transpose()?;
    let memory = context.memory()?;
    let record = stored::get(&args.plan.id, &args.plan.namespace, &memory)?;
    let check = planning::check(&record, now, &memory)?;
    if check.is_from_file {
        context.output.warn(
            "the plan's problem was a file, which does not change with the memory: every step is simulated, from \
             the file's initial state; give the present state with --problem",
        );
    }
    match format {
        Format::Json => context.output.line(&shell::relaxed(&check.to_document()))?,
        _ => check.lines().iter().try_for_each(|line| context.output.line(line))?,
    }
    Ok(exit(&check))
}

fn exit(check: &Check) -> Exit {
    match (&check.fault, &check.unjudged) {
        (Some(_), _) => Exit::No,
        (None, Some(_)) => Exit::Unsupported,
        (None, None) => Exit::Done,
    }
}
