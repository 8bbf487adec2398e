//! `rmem config`: the settings in force, and where each came from.

use clap::Args;

use super::Context;
use crate::exit::Exit;
use crate::formats::shell;
use crate::settings::Origin;
use crate::store::StoreUri;

/// Print the settings in force, and where each came from
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  rmem config")]
pub struct ConfigArgs {}

pub(super) fn run(_: &ConfigArgs, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let settings = &context.settings;
    let file = settings.file.as_ref().map_or_else(|| "none".to_owned(), |path| path.display().to_string());
    let mut lines = vec![
        format!("# settings file: {file}"),
        line("memory", settings.memory.value.as_deref().map(address), &settings.memory.origin),
        line("shared", settings.shared.value.as_deref().map(address), &settings.shared.origin),
        format!("shared_databases = {:?}  # {}", settings.shared_databases.value, settings.shared_databases.origin),
        format!("collection = {:?}  # {}", settings.collection.value.to_string(), settings.collection.origin),
        line("format", settings.format.value.map(|format| format.name().to_owned()), &settings.format.origin),
        line("log", settings.log.value.as_ref().map(|path| path.display().to_string()), &settings.log.origin),
    ];
    for planner in &settings.planners {
        lines.push(format!("planner.{} = {:?}", planner.name, planner.command));
    }
    for backend in &settings.backends {
        lines.push(format!("backend.{} at {} in {}", backend.name, backend.address(), backend.path.display()));
    }
    for computable in &settings.computables {
        lines.push(format!(
            "computable {} on {}: {}",
            computable.name,
            computable.namespace,
            shell::relaxed(&computable.spec)
        ));
    }
    for line in lines {
        context.output.line(&line)?;
    }
    Ok(Exit::Done)
}

/// A setting as it would stand in `rmem.toml`; a comment where there is none.
fn line(key: &str, value: Option<String>, origin: &Origin) -> String {
    match value {
        Some(value) => format!("{key} = {value:?}  # {origin}"),
        None => format!("# {key} is not set"),
    }
}

/// A URI without credentials.
pub(super) fn address(uri: &str) -> String {
    StoreUri::parse(uri).map_or_else(|error| error.to_string(), |uri| uri.to_string())
}
