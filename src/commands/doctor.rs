//! `rmem doctor`: whether settings, stores and planners are in order.

use clap::Args;

use super::Context;
use crate::error::Result;
use crate::exit::Exit;
use crate::output::amount;
use crate::store::Checked;

/// What stands below the help of `doctor`.
const HELP: &str = "\
Examples:
  rmem doctor
  rmem doctor --deep

--deep checks all data in the file of the memory: SQLite's own check, the checksum of every document, every index \
against the documents, and the log of changes. Each damage is a line on stdout, and the command exits with 4; rmem \
repair saves what can be saved. For a MongoDB server, use db.c.validate() in mongosh.";

/// Check the memory, and look for the programs of planners
#[derive(Debug, Args)]
#[command(after_help = HELP)]
pub struct DoctorArgs {
    /// Read and check all data in the file of the memory
    #[arg(long)]
    pub deep: bool,
}

pub(super) fn run(args: &DoctorArgs, context: &mut Context<'_>) -> Result<Exit> {
    let mut healthy = true;
    let settings = context.settings.file.as_ref().map_or("none".to_owned(), |path| path.display().to_string());
    context.output.line(&format!("settings   {settings}"))?;

    let address = context.settings.memory.value.as_deref().map_or("none".to_owned(), super::config::address);
    let state = match context.memory().and_then(|memory| Ok(memory.collections()?.len())) {
        Ok(count) => format!("ok, {count} collections"),
        Err(error) => {
            healthy = false;
            format!("{error:#}")
        }
    };
    context.output.line(&format!("memory     {address}: {state}"))?;
    #[cfg(feature = "serve")]
    if let Some(server) = super::serve::server(&context.settings) {
        context.output.line(&format!("served     by process {} at {}", server.process, server.uris))?;
    }

    if args.deep && healthy {
        healthy = deep(context)?;
    }

    context.output.line("planner    builtin: ok")?;
    let mut programs =
        vec![("ff".to_owned(), "ff".to_owned()), ("fast-downward".to_owned(), "fast-downward".to_owned())];
    let configured = context.settings.planners.iter();
    programs.extend(configured.filter_map(|planner| Some((planner.name.clone(), planner.command.first()?.clone()))));
    for (name, program) in programs {
        let state = match context.program(&program) {
            Some(path) => format!("ok, {}", path.display()),
            None => format!("the program `{program}` is not installed"),
        };
        context.output.line(&format!("planner    {name}: {state}"))?;
    }
    Ok(if healthy { Exit::Done } else { Exit::Store })
}

/// Checks the stores; says whether nothing is damaged.
fn deep(context: &mut Context<'_>) -> Result<bool> {
    let memory = context.memory()?;
    let mut damages = Vec::new();
    let checked = memory.check(|damage| damages.push(damage.to_owned()));
    for damage in &damages {
        context.output.line(&format!("damage     {damage}"))?;
    }
    for (address, checked) in checked? {
        let Some(checked) = checked else {
            context.output.line(&format!("checked    {address}: not here; a server checks itself"))?;
            continue;
        };
        let Checked { collections, documents, unsealed, indexes } = checked;
        let old = match unsealed {
            0 => String::new(),
            count => format!(", {count} of them without a checksum (stored by an earlier rmem)"),
        };
        let counts = format!(
            "{}, {}{old}, {}",
            amount(collections, "collection"),
            amount(documents, "document"),
            amount(indexes, "index")
        );
        context.output.line(&format!("checked    {address}: {counts}"))?;
    }
    Ok(damages.is_empty())
}
