//! `createIndexes`, `listIndexes`, `dropIndexes`

use bson::{Bson, Document, RawDocumentBuf, doc};

use super::definition::{Command, raw};
use super::options::{self, Options, Type, is_known};
use crate::memory::Memory;
use crate::query::Collation;
use crate::serve::access::Metadata;
use crate::serve::call::Call;
use crate::serve::failure::{Answer, Failure, codes};
use crate::serve::fields::{Fields, integral, whole};
use crate::serve::host::{FirstBatch, Host};
use crate::store::{Find, Index, Namespace, index};

pub(super) const COMMANDS: &[Command] = &[
    Command::write("createIndexes", create).transactional(),
    Command::write("dropIndexes", discard),
    Command::write("deleteIndexes", discard),
    Command::read("listIndexes", list),
];

/// What the definition of an index may say; the others are checked where the index is read.
const OPTIONS: Options = &[
    ("2dsphereIndexVersion", NUMBER),
    ("background", Type::Given(&Type::Flag)),
    ("bits", NUMBER),
    ("bucketSize", Type::Any),
    ("clustered", Type::Any),
    ("coarsestIndexedLevel", Type::Any),
    ("collation", Type::Any),
    ("default_language", Type::Any),
    ("dropDups", Type::Any),
    ("expireAfterSeconds", Type::Any),
    ("finestIndexedLevel", Type::Any),
    ("hidden", Type::Any),
    ("key", Type::Given(&Type::Object)),
    ("language_override", Type::Any),
    ("max", NUMBER),
    ("min", NUMBER),
    ("name", Type::Given(&Type::Text)),
    ("ns", Type::Any),
    ("partialFilterExpression", Type::Any),
    ("prepareUnique", Type::Any),
    ("sparse", Type::Given(&Type::Flag)),
    ("storageEngine", Type::Any),
    ("textIndexVersion", Type::Any),
    ("unique", Type::Given(&Type::Flag)),
    ("v", NUMBER),
    ("weights", Type::Any),
    ("wildcardProjection", Type::Any),
];

const NUMBER: Type = Type::Given(&Type::Number);

/// The options of `createIndexes`.
const OF_CREATE: Options =
    &[("commitQuorum", Type::Any), ("ignoreUnknownIndexOptions", Type::Flag), ("indexes", Type::Objects)];

/// What that of the index on `_id` may say.
const OF_ID: [&str; 5] = ["collation", "key", "name", "ns", "v"];

fn create(memory: &Memory, call: &Call) -> Answer {
    let (ns, fields) = (call.request.namespace()?, call.request.fields());
    options::check("createIndexes", fields.document, OF_CREATE)?;
    let definitions = fields.documents("indexes")?.ok_or_else(|| fields.missing("indexes"))?;
    if definitions.is_empty() {
        return Err(Failure::new(codes::BAD_VALUE, "Must specify at least one index to create"));
    }
    check_quorum(fields)?;
    let skips_unknown = fields.flag("ignoreUnknownIndexOptions")?;
    let definitions = definitions.into_iter().map(|definition| read(definition, skips_unknown));
    let definitions = definitions.collect::<Result<Vec<_>, _>>()?;
    if definitions.iter().enumerate().any(|(nth, index)| definitions.iter().take(nth).any(|other| other.is_same(index)))
    {
        return Err(Failure::new(codes::INDEX_EXISTS, "Identical index already exists: the command names it twice"));
    }
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

/// There is one member, which votes.
fn check_quorum(fields: Fields<'_>) -> Result<(), Failure> {
    match fields.document.get("commitQuorum") {
        None => Ok(()),
        Some(Bson::String(mode)) if mode.is_empty() => {
            Err(Failure::new(codes::FAILED_TO_PARSE, "commitQuorum can't be an empty string"))
        }
        Some(Bson::String(mode)) if mode == "majority" || mode == "votingMembers" => Ok(()),
        Some(Bson::String(mode)) => Err(Failure::no_mode(mode)),
        Some(_) => match fields.whole("commitQuorum")? {
            None | Some(0 | 1) => Ok(()),
            Some(2..=50) => {
                let message = "Not enough data-bearing nodes to satisfy commit quorum: rmem is one member";
                Err(Failure::new(codes::UNSATISFIABLE_QUORUM, message))
            }
            Some(_) => {
                let message = "commitQuorum has to be a non-negative number and not greater than 50";
                Err(Failure::new(codes::FAILED_TO_PARSE, message))
            }
        },
    }
}

/// Refuses a definition that is none in MongoDB, with its codes.
fn check(definition: &Document) -> Result<(), Failure> {
    let cannot = |message: String| Err(Failure::new(codes::CANNOT_CREATE_INDEX, message));
    options::check_inside("createIndexes.indexes", definition, OPTIONS)?;
    let fields = Fields::new("createIndexes.indexes", definition);
    let invalid = |message: String| Err(Failure::new(codes::BAD_VALUE, message));
    match definition.get("v").map(|version| integral(version).and_then(|version| i32::try_from(version).ok())) {
        None | Some(Some(1 | 2)) => {}
        Some(Some(version)) => {
            return cannot(format!("cannot create an index with version {version}; there are 1 and 2"));
        }
        Some(None) => return invalid("Index version must be representable as a 32-bit integer".to_owned()),
    }
    let Some(keys) = fields.document("key")? else { return Ok(()) };
    let is_kind = |kind: &str| ["2d", "2dsphere", "geoHaystack", "hashed", "text"].contains(&kind);
    if let Some(kind) = keys.values().filter_map(Bson::as_str).find(|kind| !is_kind(kind)) {
        return cannot(format!("Unknown index plugin '{kind}'"));
    }
    let direction = keys.get("_id").and_then(whole).filter(|_| keys.len() == 1);
    match (fields.text("name")?, direction) {
        (Some("*"), _) => invalid("The index name '*' is not valid.".to_owned()),
        (_, Some(..0)) => invalid(format!("The field 'key' for an _id index must be {{_id: 1}}, but got {keys}")),
        (Some(index::ID), None) => {
            let message = format!(
                "The index name '_id_' is reserved for the _id index, which has the key {{_id: 1}}, not {keys}"
            );
            invalid(message)
        }
        (_, Some(_)) => match definition.keys().find(|name| !OF_ID.contains(&name.as_str())) {
            Some(other) => Err(not_valid(other, "an _id index")),
            None => Ok(()),
        },
        _ => Ok(()),
    }
}

/// Refuses a definition of the index on `_id` that MongoDB refuses for a collection with this collation.
pub(super) fn check_ids(definition: &Document, collation: Option<&Collation>) -> Result<(), Failure> {
    let fields = Fields::new("create.idIndex", definition);
    if let Some(unknown) = definition.keys().find(|name| !is_known(OPTIONS, name)) {
        return Err(not_valid(unknown, "an index"));
    }
    if let Some(name) = ["key", "name"].into_iter().find(|name| !definition.contains_key(name)) {
        let message = format!("The '{name}' field is a required property of an index specification");
        return Err(Failure::new(codes::FAILED_TO_PARSE, message));
    }
    options::check_inside("create.idIndex", definition, OPTIONS)?;
    let keys = fields.document_or_empty("key")?;
    if keys.is_empty() || fields.text("name")?.is_none_or(str::is_empty) {
        let message = "an index needs keys, and a name that is not empty";
        return Err(Failure::new(codes::CANNOT_CREATE_INDEX, message));
    }
    check(definition)?;
    if !Index::of_ids().has_keys(&keys) {
        let message = format!("The field 'key' for an _id index must be {{_id: 1}}, but got {keys}");
        return Err(Failure::new(codes::BAD_VALUE, message));
    }
    match fields.document("collation")?.map(Collation::parse).transpose()? {
        Some(own) if Some(&own).filter(|own| !own.is_simple()) != collation.filter(|own| !own.is_simple()) => {
            let message = "'idIndex' must have the same collation as the collection.";
            Err(Failure::new(codes::BAD_VALUE, message))
        }
        _ => Ok(()),
    }
}

fn not_valid(option: &str, what: &str) -> Failure {
    let message = format!("The field '{option}' is not valid for {what} specification.");
    Failure::new(codes::INVALID_INDEX_OPTION, message)
}

fn read(definition: &Document, skips_unknown: bool) -> Result<Index, Failure> {
    let mut definition = definition.clone();
    if let Some(unknown) = definition.keys().find(|name| !is_known(OPTIONS, name)).cloned() {
        if !skips_unknown {
            return Err(not_valid(&unknown, "an index"));
        }
        definition = definition.into_iter().filter(|(name, _)| is_known(OPTIONS, name)).collect();
    }
    check(&definition)?;
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
pub(super) fn shown(memory: &Memory, call: &Call, ns: &Namespace) -> Result<Vec<Index>, Failure> {
    let mut indexes = memory.indexes(ns)?;
    indexes.retain(|kept| is_shown(call, &kept.name));
    Ok(indexes)
}

/// Whether a client sees the index of that name.
pub(super) fn is_shown(call: &Call, name: &str) -> bool {
    call.metadata != Metadata::Hidden || name != index::DECAY
}

fn list(host: &mut Host<'_>, call: &Call) -> Answer {
    let (ns, fields) = (call.request.readable()?, call.request.fields());
    fields.known(&["cursor", "includeBuildUUIDs", "includeIndexBuildInfo"])?;
    fields.flag("includeBuildUUIDs")?;
    fields.flag("includeIndexBuildInfo")?;
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
    let mut reply = doc! { "nIndexesWas": count };
    if fields.document.get("index") == Some(&Bson::from("*")) {
        reply.insert("msg", "non-_id indexes dropped for collection");
    }
    raw(&reply)
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
        Some(other) => Err(fields.wrong("index", other, "string")),
        None => Err(fields.missing("index")),
    }
}
