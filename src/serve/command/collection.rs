//! `create`, `drop`, `renameCollection`, `collMod`, `listCollections`

use bson::{Document, RawDocumentBuf, doc};

use super::definition::{Command, raw};
use crate::memory::{Listed, Memory};
use crate::query::{Collation, Filter};
use crate::serve::call::Call;
use crate::serve::failure::{Answer, Failure, codes};
use crate::serve::fields::Fields;
use crate::serve::host::{FirstBatch, Host};
use crate::serve::request::namespace;
use crate::store::{Index, Namespace, index};

pub(super) const COMMANDS: &[Command] = &[
    Command::write("create", create).transactional(),
    Command::write("drop", drop_collection),
    Command::write("renameCollection", rename),
    Command::write("collMod", modify),
    Command::read("listCollections", list),
];

/// The options of `create` that are taken, or make no difference here.
const TAKEN: [&str; 9] = [
    "autoIndexId",
    "changeStreamPreAndPostImages",
    "collation",
    "flags",
    "idIndex",
    "indexOptionDefaults",
    "storageEngine",
    "validationAction",
    "validationLevel",
];

/// What this rmem has no word for.
const REFUSED: [&str; 10] = [
    "capped",
    "clusteredIndex",
    "encryptedFields",
    "expireAfterSeconds",
    "max",
    "pipeline",
    "size",
    "timeseries",
    "validator",
    "viewOn",
];

fn create(memory: &Memory, call: &Call) -> Answer {
    let (ns, fields) = (call.request.namespace()?, call.request.fields());
    fields.check(&TAKEN, &REFUSED)?;
    let collation = fields.document("collation")?.map(Collation::parse).transpose()?;
    if !memory.create_collection(&ns, collation.as_ref())? {
        let message = format!("Collection {ns} already exists.");
        return Err(Failure::new(codes::NAMESPACE_EXISTS, message));
    }
    crate::serve::host::empty()
}

fn drop_collection(memory: &Memory, call: &Call) -> Answer {
    let ns = call.request.namespace()?;
    call.request.fields().known(&[])?;
    let count = i32::try_from(memory.indexes(&ns)?.len()).unwrap_or(i32::MAX);
    match call.access(memory).drop(&ns)? {
        true => raw(&doc! { "nIndexesWas": count, "ns": ns.to_string() }),
        false => Err(Failure::new(codes::NO_NAMESPACE, "ns not found")),
    }
}

fn rename(memory: &Memory, call: &Call) -> Answer {
    let fields = call.request.fields();
    fields.known(&["to", "dropTarget", "stayTemp"])?;
    let read = |text: Option<&str>, name: &str| -> Result<Namespace, Failure> {
        let text = text.ok_or_else(|| fields.missing(name))?;
        let (database, collection) = text.split_once('.').unwrap_or((text, ""));
        namespace(database, if collection.is_empty() { "" } else { "x" })?;
        namespace(database, collection).map_err(|failure| Failure { code: codes::ILLEGAL, ..failure })
    };
    if call.request.database != "admin" {
        let message = "renameCollection may only be run against the admin database.";
        return Err(Failure::new(codes::UNAUTHORIZED, message));
    }
    let (from, to) = (read(fields.text("renameCollection")?, "renameCollection")?, read(fields.text("to")?, "to")?);
    if from.database != to.database {
        return Err(Failure::unsupported("renaming a collection into another database"));
    }
    if from == to {
        return Err(Failure::new(codes::ILLEGAL, "Can't rename a collection to itself"));
    }
    let all = memory.all_collections()?;
    if !all.contains(&from) {
        return Err(Failure::new(codes::NO_NAMESPACE, format!("Source collection {from} does not exist")));
    }
    if all.contains(&to) && !fields.flag("dropTarget")? {
        return Err(Failure::new(codes::NAMESPACE_EXISTS, "target namespace exists"));
    }
    memory.rename_collection(&from, &to)?;
    crate::serve::host::empty()
}

/// Images of documents before and after changes are always kept; an index can be hidden, and nothing else be modified.
fn modify(memory: &Memory, call: &Call) -> Answer {
    let (ns, fields) = (call.request.namespace()?, call.request.fields());
    fields.check(&["changeStreamPreAndPostImages", "validationLevel", "validationAction", "index"], &["validator"])?;
    if !memory.all_collections()?.contains(&ns) {
        return Err(Failure::new(codes::NO_NAMESPACE, format!("ns does not exist: {ns}")));
    }
    match fields.document("index")? {
        Some(change) => modify_index(memory, &ns, Fields::new("collMod.index", change)),
        None => crate::serve::host::empty(),
    }
}

/// Hides an index, or gives it back to queries.
fn modify_index(memory: &Memory, ns: &Namespace, fields: Fields<'_>) -> Answer {
    fields.check_inside(&["name", "keyPattern", "hidden"], &["expireAfterSeconds", "unique", "prepareUnique"])?;
    let indexes = memory.indexes(ns)?;
    let found = match (fields.text("name")?, fields.document("keyPattern")?) {
        (Some(name), None) => indexes.iter().find(|index| index.name == name),
        (None, Some(keys)) => indexes.iter().find(|index| index.has_keys(keys)),
        _ => {
            let message = "either the name or the keyPattern of an index is needed";
            return Err(Failure::new(codes::INVALID_OPTIONS, message));
        }
    };
    let Some(found) = found else {
        return Err(Failure::new(codes::NO_INDEX, format!("cannot find the index in {ns}")));
    };
    let Some(hidden) = fields.optional_flag("hidden")? else {
        return Err(Failure::new(codes::INVALID_OPTIONS, "no hidden field: there is nothing to modify"));
    };
    let before = found.other.get_bool("hidden").unwrap_or(false);
    if before == hidden {
        return crate::serve::host::empty();
    }
    memory.hide_index(ns, &found.name, hidden)?;
    raw(&doc! { "hidden_old": before, "hidden_new": hidden })
}

fn list(host: &mut Host<'_>, call: &Call) -> Answer {
    let fields = call.request.fields();
    fields.known(&["filter", "nameOnly", "authorizedCollections", "cursor"])?;
    let database = namespace(&call.request.database, "x")?.database;
    fields.boolean("authorizedCollections")?;
    let name_only = fields.boolean("nameOnly")?.unwrap_or(false);
    let filter = Filter::parse(&fields.document_or_empty("filter")?)?;
    let mut documents = Vec::new();
    let memory = host.memory()?;
    let mut names = call.access(memory).collections()?;
    names.retain(|ns| ns.database == database);
    for ns in names {
        let listed = match memory.collection_or_view(&ns)? {
            Listed::Collection(indexes) => described(&ns, index::collation(&indexes).as_ref()),
            Listed::View(options) => {
                doc! { "name": &ns.collection, "type": "view", "options": options, "info": { "readOnly": true } }
            }
        };
        if filter.matches(&RawDocumentBuf::try_from(&listed)?)? {
            let short = || listed.iter().take(2).map(|(name, value)| (name.clone(), value.clone())).collect();
            documents.push(Ok(RawDocumentBuf::try_from(&if name_only { short() } else { listed })?));
        }
    }
    let size = fields.document("cursor")?.map(|cursor| Fields::new("cursor", cursor).size("batchSize")).transpose()?;
    let batch = FirstBatch { size: size.flatten(), ..FirstBatch::default() };
    let place = Namespace { database, collection: "$cmd.listCollections".to_owned() };
    host.answer(&place, call.request.origin(), Box::new(documents.into_iter()), batch)
}

fn described(ns: &Namespace, collation: Option<&Collation>) -> Document {
    let options = collation.map(|collation| doc! { "collation": collation.definition().clone() });
    let ids = collation.map_or_else(Index::of_ids, Index::of_collated_ids);
    doc! {
        "name": &ns.collection,
        "type": "collection",
        "options": options.unwrap_or_default(),
        "info": { "readOnly": false },
        "idIndex": ids.definition(),
    }
}
