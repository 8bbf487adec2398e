//! `rmem doctor`: whether settings, stores and planners are in order.

use clap::Args;

use super::Context;
use crate::exit::Exit;

/// Say whether store, planners and settings are in order
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  rmem doctor")]
pub struct DoctorArgs {}

pub(super) fn run(_: &DoctorArgs, context: &mut Context<'_>) -> anyhow::Result<Exit> {
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
