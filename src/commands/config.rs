//! `rmem config`: the settings in force, and where each came from.

use bson::{Bson, doc};
use clap::Args;

use super::{Context, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::shell;
use crate::output::Format;
use crate::settings::Origin;
use crate::store::{HistoryRule, Scope, StoreUri};

/// Print the settings in force and the origin of each
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  rmem config", arg = formats::argument(&formats::TEXT))]
pub struct ConfigArgs {}

pub(super) fn run(_: &ConfigArgs, context: &mut Context<'_>) -> Result<Exit> {
    let settings = &context.settings;
    let file = settings.file.as_ref().map_or_else(|| "none".to_owned(), |path| path.display().to_string());
    let mut rows = vec![
        row(format!("# settings file: {file}"), "file", settings.file.as_ref().map(|_| file.clone()), None),
        setting("memory", settings.memory.value.as_deref().map(address), &settings.memory.origin),
        setting("shared", settings.shared.value.as_deref().map(address), &settings.shared.origin),
        setting("shared_databases", Some(settings.shared_databases.value.clone()), &settings.shared_databases.origin),
        setting("collection", Some(settings.collection.value.to_string()), &settings.collection.origin),
        setting("format", settings.format.value.map(Format::name), &settings.format.origin),
        setting(
            "keep_history",
            (!settings.histories.value.is_empty())
                .then(|| settings.histories.value.iter().map(history).collect::<Vec<_>>()),
            &settings.histories.origin,
        ),
        setting("log", settings.log.value.as_ref().map(|path| path.display().to_string()), &settings.log.origin),
    ];
    rows.extend(settings.planners.iter().map(|planner| {
        let line = format!("planner.{} = {:?}", planner.name, planner.command);
        row(line, &format!("planner.{}", planner.name), Some(planner.command.clone()), None)
    }));
    rows.extend(settings.backends.iter().map(|backend| {
        let value = format!("{} in {}", backend.address(), backend.path.display());
        row(format!("backend.{} at {value}", backend.name), &format!("backend.{}", backend.name), Some(value), None)
    }));
    rows.extend(settings.computables.iter().map(|computable| {
        let value = format!("{}: {}", computable.namespace, shell::relaxed(&computable.spec));
        let line = format!("computable {} on {value}", computable.name);
        row(line, &format!("computable.{}", computable.name), Some(value), None)
    }));
    context.print_lines(rows)?;
    Ok(Exit::Done)
}

/// A line, and the same as a document.
fn row(line: String, key: &str, value: Option<impl Into<Bson>>, origin: Option<&Origin>) -> (String, Bson) {
    let mut document = doc! { "key": key, "value": value.map_or(Bson::Null, Into::into) };
    if let Some(origin) = origin {
        document.insert("origin", origin.to_string());
    }
    (line, document.into())
}

/// A setting as it would be written in `rmem.toml`; a comment if it has no value.
fn setting<T: Into<Bson> + std::fmt::Debug>(key: &str, value: Option<T>, origin: &Origin) -> (String, Bson) {
    let line = match &value {
        Some(value) => format!("{key} = {value:?}  # {origin}"),
        None => format!("# {key} is not set"),
    };
    row(line, key, value, Some(origin))
}

/// A rule of the history, as `robmem for 24h`.
fn history(rule: &HistoryRule) -> String {
    let scope = match &rule.scope {
        Scope::All => "all".to_owned(),
        Scope::Database(database) => database.clone(),
        Scope::Collection(ns) => ns.to_string(),
    };
    match rule.age.as_secs() {
        0 if rule.age.is_zero() => format!("{scope} off"),
        seconds => format!("{scope} for {seconds} s, up to {} bytes", rule.size),
    }
}

/// Returns a URI without credentials.
pub(super) fn address(uri: &str) -> String {
    StoreUri::parse(uri).map_or_else(|error| error.to_string(), |uri| uri.to_string())
}
