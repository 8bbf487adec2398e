//! Computables as documents, with the keys of `[[computable]]`: what the memory keeps, and what is to be kept.

use std::time::Duration;

use bson::{Bson, Document, doc};

use super::body::Options;
use super::builtin::BUILTINS;
use super::definition::{BodyKind, Definition, NO_PROGRAMS, Origin, check_adds};
use super::pipeline::check;
use crate::formats::{Source, nearest, quantity, shell};
use crate::query::Filter;
use crate::store::{Namespace, metadata};

/// The collection of the computables of a database.
pub(in crate::memory) const COLLECTION: &str = "rmem.computables";

/// All keys, and those of programs.
const KEYS: [&str; 11] =
    ["name", "collection", "spec", "priority", "cache", "adds", "pipeline", "from", "builtin", "frames", "position"];
const OF_PROGRAMS: [&str; 2] = ["command", "timeout"];
/// The keys of builtins.
const OPTIONS: [&str; 2] = ["frames", "position"];

/// Returns the document that is kept for the definitions of one computable, of one or several collections.
pub(super) fn write(definitions: &[Definition]) -> Document {
    let Some(first) = definitions.first() else { return Document::new() };
    let collections: Vec<String> = definitions.iter().map(|definition| definition.namespace.to_string()).collect();
    let mut record = doc! {
        "_id": &first.name,
        "collection": collections,
        // As texts: not every store takes keys that begin with `$`.
        "spec": shell::canonical(&first.spec),
        "priority": first.priority,
    };
    if let Some(cache) = first.cache {
        record.insert("cache", quantity::write_duration(cache));
    }
    match &first.adds {
        Some(keys) if keys.is_empty() => drop(record.insert("adds", true)),
        Some(keys) => drop(record.insert("adds", keys.clone())),
        None => {}
    }
    match &first.body {
        BodyKind::Pipeline { from, stages } => {
            let stages = stages.iter().cloned().map(Bson::Document).collect();
            record.insert("pipeline", shell::canonical_value(&Bson::Array(stages)));
            let is_own = |definition: &Definition| matches!(&definition.body, BodyKind::Pipeline { from, .. } if *from == definition.namespace);
            if !definitions.iter().all(is_own) {
                record.insert("from", from.to_string());
            }
        }
        BodyKind::Builtin { name, options } => {
            record.insert("builtin", name);
            record.extend(options.iter().map(|(key, value)| (key.clone(), Bson::from(value.clone()))));
        }
        BodyKind::Command { .. } => {}
    }
    record
}

/// Reads a computable: one definition for each of its collections.
///
/// # Errors
/// The first key that is wrong, and why, in a sentence.
pub fn read(record: &Document, origin: &Origin) -> Result<Vec<Definition>, String> {
    for key in record.keys() {
        if OF_PROGRAMS.contains(&key.as_str()) {
            return Err(format!("`{key}`: {NO_PROGRAMS}"));
        }
        if !KEYS.contains(&key.as_str()) && !["_id", metadata::INFO].contains(&key.as_str()) {
            let hint = match nearest(key, KEYS) {
                Some(near) => format!("did you mean `{near}`?"),
                None => format!("expected {}", KEYS.join(", ")),
            };
            return Err(format!("unknown key `{key}`; {hint}"));
        }
    }
    let name = name(record)?;
    let namespaces = namespaces(record)?;
    let spec = spec(record)?;
    let (adds, cache) = (adds(record)?, cache(record)?);
    let definition = |namespace: Namespace| {
        Ok(Definition {
            name: name.clone(),
            spec: spec.clone(),
            priority: priority(record)?,
            cache,
            adds: adds.clone(),
            body: body(record, &namespace)?,
            namespace,
            origin: origin.clone(),
        })
    };
    namespaces.into_iter().map(definition).collect()
}

/// The text under a key; none where there is no such key.
fn text<'a>(record: &'a Document, key: &str) -> Result<Option<&'a str>, String> {
    match record.get(key) {
        None => Ok(None),
        Some(Bson::String(text)) => Ok(Some(text)),
        Some(other) => Err(format!("`{key}`: expected a string, found {}", shell::relaxed_value(other))),
    }
}

fn name(record: &Document) -> Result<String, String> {
    let key = if record.contains_key("name") { "name" } else { "_id" };
    match text(record, key)? {
        Some(name) if record.get("_id").is_some_and(|id| id.as_str() != Some(name)) => {
            Err(format!("`_id`: it is kept under its name, `{name}`; leave `_id` out"))
        }
        Some(name) if !name.trim().is_empty() => Ok(name.to_owned()),
        Some(_) => Err("`name`: expected a name for the computable, found an empty one".to_owned()),
        None => Err("expected a `name` for the computable".to_owned()),
    }
}

fn namespaces(record: &Document) -> Result<Vec<Namespace>, String> {
    let read = |name: &Bson| match name {
        Bson::String(name) => name.parse::<Namespace>().map_err(|error| format!("`collection`: {error}")),
        other => {
            let found = shell::relaxed_value(other);
            Err(format!("`collection`: expected a collection, or an array of collections, found {found}"))
        }
    };
    let names: Vec<Namespace> = match record.get("collection") {
        None => return Err("expected the `collection` that it is for".to_owned()),
        Some(Bson::Array(names)) => names.iter().map(read).collect::<Result<_, _>>()?,
        Some(name) => vec![read(name)?],
    };
    let Some(first) = names.first() else { return Err("`collection`: expected a collection, found none".to_owned()) };
    for (at, name) in names.iter().enumerate() {
        if names.iter().take(at).any(|other| other == name) {
            return Err(format!("`collection`: {name} is given twice"));
        }
        if name.database != first.database {
            return Err(format!(
                "`collection`: {first} and {name} are in different databases, and a computable is kept in the database \
                 of its collection; add one for each database"
            ));
        }
    }
    Ok(names)
}

fn spec(record: &Document) -> Result<Document, String> {
    let spec = match record.get("spec") {
        None => return Err("expected a `spec`: the query that it answers, like {below: {$exists: true}}".to_owned()),
        Some(Bson::Document(spec)) => spec.clone(),
        Some(Bson::String(text)) => shell::parse_document(&Source::new("spec", text.as_str()))
            .map_err(|error| format!("`spec`: {}", error.message()))?,
        Some(other) => return Err(format!("`spec`: expected a query, found {}", shell::relaxed_value(other))),
    };
    Filter::parse(&spec).map_err(|error| format!("`spec`: expected a query: {error}"))?;
    Ok(spec)
}

fn priority(record: &Document) -> Result<i64, String> {
    match record.get("priority") {
        None => Ok(0),
        Some(Bson::Int32(number)) => Ok(i64::from(*number)),
        Some(Bson::Int64(number)) => Ok(*number),
        Some(other) => Err(format!("`priority`: expected an integer, found {}", shell::relaxed_value(other))),
    }
}

fn cache(record: &Document) -> Result<Option<Duration>, String> {
    let Some(text) = text(record, "cache")? else { return Ok(None) };
    match quantity::duration(text).map_err(|error| format!("`cache`: {error}"))? {
        Duration::ZERO => {
            Err("`cache`: expected a duration above zero; leave it out to compute for each query".to_owned())
        }
        duration => Ok(Some(duration)),
    }
}

fn adds(record: &Document) -> Result<Option<Vec<String>>, String> {
    let keys = match record.get("adds") {
        None | Some(Bson::Boolean(false)) => return Ok(None),
        Some(Bson::Boolean(true)) => Some(Vec::new()),
        Some(Bson::Array(keys)) => keys.iter().map(|key| key.as_str().map(str::to_owned)).collect(),
        Some(_) => None,
    };
    let Some(keys) = keys else {
        return Err("`adds`: expected true, or an array of the added keys: ['distance']".to_owned());
    };
    if matches!(record.get("adds"), Some(Bson::Array(_))) {
        check_adds(&keys).map_err(|error| format!("`adds`: {error}"))?;
    }
    if record.contains_key("cache") {
        return Err("`cache` has no meaning where keys are added: they are stored nowhere".to_owned());
    }
    if record.contains_key("builtin") {
        return Err("keys are added by a `pipeline`, not by a builtin".to_owned());
    }
    Ok(Some(keys))
}

fn body(record: &Document, namespace: &Namespace) -> Result<BodyKind, String> {
    let refuse = |body: &str, keys: &[&str]| match keys.iter().find(|key| record.contains_key(key)) {
        Some(key) => Err(format!("`{key}` has no meaning for the body `{body}`")),
        None => Ok(()),
    };
    match (record.get("pipeline"), text(record, "builtin")?) {
        (Some(pipeline), None) => {
            refuse("pipeline", &OPTIONS)?;
            let stages = stages(pipeline)?;
            check(&stages).map_err(|error| format!("`pipeline`: expected a pipeline: {error}"))?;
            let from = text(record, "from")?.map(str::parse::<Namespace>).transpose();
            let from = from.map_err(|error| format!("`from`: {error}"))?;
            Ok(BodyKind::Pipeline { from: from.unwrap_or_else(|| namespace.clone()), stages })
        }
        (None, Some(name)) => {
            refuse(name, &["from"])?;
            let Some(builtin) = BUILTINS.iter().find(|builtin| builtin.name == name) else {
                let known: Vec<&str> = BUILTINS.iter().map(|builtin| builtin.name).collect();
                return Err(format!("`builtin`: unknown builtin `{name}`; expected one of {}", known.join(", ")));
            };
            let mut options = Options::new();
            for key in OPTIONS {
                if let Some(value) = text(record, key)? {
                    if !builtin.keys.contains(&key) {
                        return Err(format!("`{key}` has no meaning for the body `{name}`"));
                    }
                    options.insert(key.to_owned(), value.to_owned());
                }
            }
            builtin.check(&options, namespace).map_err(|(key, wrong)| format!("`{key}`: {wrong}"))?;
            Ok(BodyKind::Builtin { name: name.to_owned(), options })
        }
        _ => Err("expected one body: `pipeline` or `builtin`".to_owned()),
    }
}

/// The stages of a pipeline, an array or its text.
fn stages(pipeline: &Bson) -> Result<Vec<Document>, String> {
    let wrong =
        |found: &Bson| format!("`pipeline`: expected an array of stages, found {}", shell::relaxed_value(found));
    match pipeline {
        Bson::String(text) => {
            let source = Source::new("pipeline", text.as_str());
            shell::parse_pipeline(&source).map_err(|error| format!("`pipeline`: {}", error.message()))
        }
        Bson::Array(stages) => {
            stages.iter().map(|stage| stage.as_document().cloned().ok_or_else(|| wrong(stage))).collect()
        }
        other => Err(wrong(other)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_reads_as_it_was() {
        let origin = Origin::program();
        for document in [
            doc! { "name": "low", "collection": "a.b", "spec": { "n": { "$gt": 3_i64 } }, "pipeline": [{ "$match": { "z": 1 } }] },
            doc! { "name": "low", "collection": ["a.b", "a.c"], "spec": "{}", "pipeline": "[]", "cache": "90s", "priority": 3 },
            doc! { "name": "low", "collection": ["a.b", "a.c"], "spec": {}, "pipeline": [], "from": "a.d", "adds": ["x"] },
            doc! { "name": "low", "collection": "a.b", "spec": {}, "pipeline": [], "from": "x.d", "adds": true },
            doc! { "name": "near", "collection": "a.b", "spec": {}, "builtin": "nearest", "position": "at" },
        ] {
            let definitions = read(&document, &origin).unwrap();
            assert_eq!(read(&write(&definitions), &origin).unwrap(), definitions, "{document}");
        }
    }
}
