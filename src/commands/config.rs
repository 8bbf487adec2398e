//! `rmem config`: the settings in force, and where each came from.

use bson::{Bson, Document, doc};
use clap::Args;

use super::context::parse_uri;
use super::{Context, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::credentials::masked_message;
use crate::formats::{quantity, shell};
use crate::output::Format;
use crate::saturate::to_i64;
use crate::settings::{Origin, Setting, Settings};
use crate::store::{HistoryRule, Scope, StoreUri};

/// Print the settings in force and the origin of each
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  rmem config", arg = formats::argument(&formats::TEXT))]
pub struct ConfigArgs {}

pub(super) fn run(_: &ConfigArgs, context: &mut Context<'_>) -> Result<Exit> {
    let settings = &context.settings;
    let address = |uri: &Setting<Option<String>>| -> Result<Option<String>> {
        // Its text has no credentials.
        let uri = uri.value.as_deref().map(|value| parse_uri(value, &uri.origin)).transpose()?;
        Ok(uri.map(|uri| uri.to_string()))
    };
    let file = settings.file.as_ref().map_or_else(|| "none".to_owned(), |path| path.display().to_string());
    let mut rows = vec![
        row(format!("# settings file: {file}"), "file", settings.file.as_ref().map(|_| file.clone()), None),
        setting("memory", address(&settings.memory)?, &settings.memory.origin),
        setting("shared", address(&settings.shared)?, &settings.shared.origin),
        setting("shared_databases", Some(settings.shared_databases.value.clone()), &settings.shared_databases.origin),
        setting("collection", Some(settings.collection.value.to_string()), &settings.collection.origin),
        setting(
            "template_path",
            Some(settings.template_path.value.iter().map(|path| path.display().to_string()).collect::<Vec<_>>()),
            &settings.template_path.origin,
        ),
        setting("format", settings.format.value.map(Format::name), &settings.format.origin),
        keep_history(settings),
        history_size(settings),
        setting("log", settings.log.value.as_ref().map(|path| path.display().to_string()), &settings.log.origin),
    ];
    rows.extend(settings.most_documents.iter().map(|(namespace, most)| {
        let key = format!("most_documents.{namespace}");
        row(format!("{key} = {most}"), &key, Some(to_i64(*most)), None)
    }));
    rows.extend(settings.planners.iter().map(|planner| {
        let command: Vec<_> = planner.command.iter().map(|word| masked_message(word).into_owned()).collect();
        let line = format!("planner.{} = {command:?}", planner.name);
        row(line, &format!("planner.{}", planner.name), Some(command), None)
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
    rows.extend(settings.object_kinds.iter().map(|kind| {
        let value = format!("{}: {}", kind.namespace, shell::relaxed(&kind.query));
        let line = format!("scene.object {} in {value}", kind.name);
        row(line, &format!("scene.object.{}", kind.name), Some(value), None)
    }));
    let is_without_effect = settings.histories.value.is_empty() && settings.history_size.origin != Origin::Default;
    context.print_lines(rows)?;
    if is_without_effect {
        context.output.warn("history_size has no effect without keep_history");
    }
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

/// The line for `keep_history` as it would be written in `rmem.toml`.
fn keep_history(settings: &Settings) -> (String, Bson) {
    let (rules, origin) = (&settings.histories.value, &settings.histories.origin);
    let (text, value) = match rules.as_slice() {
        [] => return setting("keep_history", None::<String>, origin),
        [rule] if rule.scope == Scope::All => (format!("{:?}", age(rule)), age(rule).into()),
        rules => {
            let of = |rule: &HistoryRule| (scope(rule), age(rule));
            let pairs: Vec<(String, String)> = rules.iter().map(of).collect();
            let text: Vec<String> = pairs.iter().map(|(scope, age)| format!("{scope:?} = {age:?}")).collect();
            let value: Document = pairs.into_iter().map(|(scope, age)| (scope, age.into())).collect();
            (format!("{{ {} }}", text.join(", ")), Bson::Document(value))
        }
    };
    row(format!("keep_history = {text}  # {origin}"), "keep_history", Some(value), Some(origin))
}

/// The line for `history_size`; the default counts where a history is kept.
fn history_size(settings: &Settings) -> (String, Bson) {
    let Setting { value, origin } = &settings.history_size;
    let is_set = !settings.histories.value.is_empty() || *origin != Origin::Default;
    setting("history_size", is_set.then(|| quantity::write_size(*value)), origin)
}

fn scope(rule: &HistoryRule) -> String {
    match &rule.scope {
        Scope::All => "all".to_owned(),
        Scope::Database(database) => database.clone(),
        Scope::Collection(ns) => ns.to_string(),
    }
}

fn age(rule: &HistoryRule) -> String {
    if rule.age.is_zero() { "off".to_owned() } else { quantity::write_duration(rule.age) }
}

/// Returns a URI without credentials.
pub(super) fn address(uri: &str) -> String {
    StoreUri::parse(uri).map_or_else(|error| error.to_string(), |uri| uri.to_string())
}
