//! `createIndexes`, `listIndexes`, `dropIndexes`

use bson::{Bson, Document, RawDocumentBuf, doc};

use super::definition::{Command, raw};
use crate::memory::Memory;
use crate::serve::access::Metadata;
use crate::serve::call::Call;
use crate::serve::failure::{Answer, Failure, codes};
use crate::serve::fields::Fields;
use crate::serve::host::{FirstBatch, Host};
use crate::store::{Find, Index, Namespace, index};

pub(super) const COMMANDS: &[Command] = &[
    Command::write("createIndexes", create).transactional(),
    Command::write("dropIndexes", discard),
    Command::write("deleteIndexes", discard),
    Command::read("listIndexes", list),
];

fn create(memory: &Memory, call: &Call) -> Answer {
    let (ns, fields) = (call.request.namespace()?, call.request.fields());
    fields.known(&["indexes", "commitQuorum", "ignoreUnknownIndexOptions"])?;
    let definitions = fields.documents("indexes")?.ok_or_else(|| fields.missing("indexes"))?;
    if definitions.is_empty() {
        return Err(Failure::new(codes::BAD_VALUE, "Must specify at least one index to create"));
    }
    let definitions = definitions.into_iter().map(read).collect::<Result<Vec<_>, _>>()?;
    let made = memory.create_collection(&ns, None)?;
    let before = shown(memory, call, &ns)?.len();
    for definition in &definitions {
        let is_new = memory.create_index(&ns, definition)?;
        if is_new && !made && call.request.is_in_transaction() && !is_empty(memory, &ns)? {
            let message =
                format!("Cannot create new indexes on existing collection {ns} in a multi-document transaction.");
            return Err(Failure::new(codes::NOT_IN_TRANSACTION, message));
        }
    }
    let after = shown(memory, call, &ns)?.len();
    let mut reply = doc! {
        "numIndexesBefore": i32::try_from(before).unwrap_or(i32::MAX),
        "numIndexesAfter": i32::try_from(after).unwrap_or(i32::MAX),
        "createdCollectionAutomatically": made,
    };
    if before == after {
        reply.insert("note", "all indexes already exist");
    }
    raw(&reply)
}

fn is_empty(memory: &Memory, ns: &Namespace) -> Result<bool, Failure> {
    let find = Find { limit: 1, ..Find::default() };
    Ok(memory.bare(ns)?.find(ns, &find)?.next().transpose()?.is_none())
}

fn read(definition: &Document) -> Result<Index, Failure> {
    let mut definition = definition.clone();
    // An option whose value says nothing.
    if definition.get_bool("hidden").is_ok_and(|hidden| !hidden) {
        definition.remove("hidden");
    }
    if !definition.contains_key("name") {
        let message = "Error in specification: the 'name' field is a required property of an index specification";
        return Err(Failure::new(codes::FAILED_TO_PARSE, message));
    }
    Ok(Index::parse(&definition)?)
}

/// The indexes that a client sees: not the one by which a memory finds what has decayed.
fn shown(memory: &Memory, call: &Call, ns: &Namespace) -> Result<Vec<Index>, Failure> {
    let mut indexes = memory.indexes(ns)?;
    if call.metadata == Metadata::Hidden {
        indexes.retain(|kept| kept.name != index::DECAY);
    }
    Ok(indexes)
}

fn list(host: &mut Host<'_>, call: &Call) -> Answer {
    let (ns, fields) = (call.request.readable()?, call.request.fields());
    fields.known(&["cursor", "includeBuildUUIDs", "includeIndexBuildInfo"])?;
    let indexes = shown(host.memory()?, call, &ns)?;
    if indexes.is_empty() {
        return Err(Failure::new(codes::NO_NAMESPACE, format!("ns does not exist: {ns}")));
    }
    let mut documents = Vec::new();
    for index in &indexes {
        documents.push(Ok(RawDocumentBuf::try_from(&index.definition())?));
    }
    let size = fields.document("cursor")?.map(|cursor| Fields::new("cursor", cursor).size("batchSize")).transpose()?;
    let batch = FirstBatch { size: size.flatten(), ..FirstBatch::default() };
    host.answer(&ns, call.request.origin(), Box::new(documents.into_iter()), batch)
}

fn discard(memory: &Memory, call: &Call) -> Answer {
    let (ns, fields) = (call.request.namespace()?, call.request.fields());
    fields.known(&["index"])?;
    let present = shown(memory, call, &ns)?;
    if present.is_empty() {
        return Err(Failure::new(codes::NO_NAMESPACE, format!("ns not found {ns}")));
    }
    let count = i32::try_from(present.len()).unwrap_or(i32::MAX);
    for name in named(fields, &present)? {
        if name == index::ID {
            return Err(Failure::new(codes::INVALID_OPTIONS, "cannot drop _id index"));
        }
        if !memory.drop_index(&ns, &name)? {
            return Err(Failure::new(codes::NO_INDEX, format!("index not found with name [{name}]")));
        }
    }
    raw(&doc! { "nIndexesWas": count })
}

/// The names of the indexes that are to go.
fn named(fields: Fields<'_>, present: &[Index]) -> Result<Vec<String>, Failure> {
    match fields.document.get("index") {
        Some(Bson::String(name)) if name == "*" => {
            let others = present.iter().filter(|kept| kept.name != index::ID && kept.name != index::DECAY);
            Ok(others.map(|kept| kept.name.clone()).collect())
        }
        Some(Bson::String(name)) => Ok(vec![name.clone()]),
        Some(Bson::Document(keys)) => {
            let found: Vec<_> =
                present.iter().filter(|kept| kept.has_keys(keys)).map(|kept| kept.name.clone()).collect();
            match found.as_slice() {
                [] => Err(Failure::new(codes::NO_INDEX, format!("can't find index with key: {keys}"))),
                [_] => Ok(found),
                several => {
                    let message = format!(
                        "{} indexes found for key: {keys}, identify by name instead. Conflicting indexes: {}",
                        several.len(),
                        several.join(", ")
                    );
                    Err(Failure::new(codes::AMBIGUOUS_INDEX, message))
                }
            }
        }
        Some(Bson::Array(names)) => {
            let text = |name: &Bson| name.as_str().map(str::to_owned);
            let names: Option<Vec<String>> = names.iter().map(text).collect();
            names.ok_or_else(|| Failure::new(codes::TYPE_MISMATCH, "the names of indexes are strings"))
        }
        _ => Err(fields.missing("index")),
    }
}
