//! `rmem config`: the settings in force, and where each came from.

use super::Context;
use crate::exit::Exit;
use crate::store::StoreUri;

pub(super) fn run(context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let settings = &context.settings;
    let address = |value: &Option<String>| value.as_deref().map_or_else(|| "none".to_owned(), address);
    let file = settings.file.as_ref().map_or_else(|| "none".to_owned(), |path| path.display().to_string());
    let format = settings.format.value.map_or("by command", crate::output::Format::name);
    let log = settings.log.value.as_ref().map_or_else(|| "none".to_owned(), |path| path.display().to_string());
    let mut lines = vec![
        format!("settings file: {file}"),
        format!("memory = {:?}  # {}", address(&settings.memory.value), settings.memory.origin),
        format!("shared = {:?}  # {}", address(&settings.shared.value), settings.shared.origin),
        format!("shared_databases = {:?}  # {}", settings.shared_databases.value, settings.shared_databases.origin),
        format!("collection = {:?}  # {}", settings.collection.value.to_string(), settings.collection.origin),
        format!("format = {format:?}  # {}", settings.format.origin),
        format!("log = {log:?}  # {}", settings.log.origin),
    ];
    for planner in &settings.planners {
        lines.push(format!("planner.{} = {:?}", planner.name, planner.command));
    }
    for computable in &settings.computables {
        lines.push(format!("computable {} on {}: {}", computable.name, computable.collection, computable.spec));
    }
    for line in lines {
        context.output.line(&line)?;
    }
    Ok(Exit::Done)
}

/// A URI without credentials.
pub(super) fn address(uri: &str) -> String {
    StoreUri::parse(uri).map_or_else(|error| error.to_string(), |uri| uri.to_string())
}
