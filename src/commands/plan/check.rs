//! `rmem plan check ID`: does the rest of a stored plan still reach its goal?

use std::path::PathBuf;

use clap::Args;

use super::stored::{self, StoredArgs};
use crate::commands::{Context, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::shell;
use crate::output::Format;
use crate::plan::Last;
use crate::planning::{self, Check};

/// Check whether the rest of a stored plan still reaches its goal, from the memory as it is now
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  rmem plan check last\n  rmem plan check 65f0 --format json\n  rmem gen-problem -t now.j2 | rmem plan check last --problem -\n\n\
Exits with 0 if the plan holds, else with 1, and prints the first step that fails and its false conditions. The\n\
problem is generated again from the domain, the template, the goal and the parameters that are\n\
kept with the plan; steps that are done are not simulated, and of a\n\
step that is running only what it needs and changes after its start. The plan of a problem that was a\n\
file does not follow the memory: give the present problem with --problem."
)]
#[command(arg = formats::argument(&formats::TEXT))]
pub struct CheckArgs {
    /// The plan.
    #[command(flatten)]
    pub plan: StoredArgs,
    /// The problem as it is now, instead of the memory; - is stdin
    #[arg(short, long, value_name = "FILE")]
    pub problem: Option<PathBuf>,
}

pub(super) fn run(args: &CheckArgs, context: &mut Context<'_>) -> Result<Exit> {
    let format = context.format(&[Format::Text, Format::Json])?;
    let now = args.problem.as_deref().map(|path| context.read_pddl(path)).transpose()?;
    let memory = context.memory()?;
    let record = stored::get(&args.plan, Last::Plan, &memory, context)?;
    if let Ok(source) = record.source()
        && now.is_none()
    {
        stored::warn_of_changes(&record.id(), &source, context);
    }
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
