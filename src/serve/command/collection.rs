//! `create`, `drop`, `renameCollection`, `listCollections`

use bson::{Bson, Document, RawDocumentBuf, doc};

use super::definition::{Command, raw};
use super::options::{self, Options, Type};
use crate::memory::{Listed, Memory};
use crate::query::{Collation, Filter, Validator};
use crate::serve::call::Call;
use crate::serve::failure::{Answer, Failure, codes};
use crate::serve::fields::{Fields, whole};
use crate::serve::host::{FirstBatch, Host};
use crate::serve::request::namespace;
use crate::store::namespace::is_internal;
use crate::store::validation::collection_options;
use crate::store::{Index, Namespace, Validation, index};

pub(super) const COMMANDS: &[Command] = &[
    Command::write("create", create).transactional(),
    Command::write("drop", drop_collection),
    Command::write("renameCollection", rename),
    Command::read("listCollections", list),
];

/// The options of `create`.
const OF_CREATE: Options = &[
    ("autoIndexId", Type::Flag),
    ("capped", Type::Flag),
    ("changeStreamPreAndPostImages", IMAGES),
    ("clusteredIndex", Type::Given(&Type::Either(&Type::Flag, &Type::Of(&["key", "unique"], OF_CLUSTERED)))),
    ("collation", Type::Object),
    ("encryptedFields", Type::Of(&["fields"], OF_ENCRYPTED)),
    ("expireAfterSeconds", Type::Number),
    ("flags", Type::Number),
    ("idIndex", Type::Object),
    ("indexOptionDefaults", Type::Of(&[], &[("storageEngine", Type::Object)])),
    ("max", Type::Within(i64::MIN, 1 << 31)),
    ("pipeline", Type::Objects),
    ("recordPreImages", Type::Flag),
    ("size", Type::Within(1, i64::MAX)),
    ("storageEngine", Type::Object),
    ("temp", Type::Flag),
    ("timeseries", Type::Of(&["timeField"], OF_SERIES)),
    ("validationAction", ACTION),
    ("validationLevel", LEVEL),
    ("validator", Type::Object),
    ("viewOn", Type::Text),
];

/// The options of `renameCollection`.
const OF_RENAME: Options = &[("to", Type::Text), ("dropTarget", Type::Bool), ("stayTemp", Type::Bool)];

/// The options of a collection that is clustered.
const OF_CLUSTERED: Options =
    &[("key", Type::Object), ("name", Type::Text), ("unique", Type::Flag), ("v", Type::Number)];

/// The options of a time series.
const OF_SERIES: Options = &[
    ("bucketMaxSpanSeconds", Type::Within(1, i64::MAX)),
    ("granularity", GRANULARITY),
    ("metaField", Type::Text),
    ("timeField", Type::Text),
];

/// The options of a collection with encrypted fields.
const OF_ENCRYPTED: Options = &[
    ("eccCollection", Type::Text),
    ("ecocCollection", Type::Text),
    ("escCollection", Type::Text),
    ("fields", Type::Objects),
];

/// How far apart the measurements of a time series are.
pub(super) const GRANULARITY: Type = Type::OneOf(&["seconds", "minutes", "hours"]);
/// Whether changes are kept with the documents before and after them.
pub(super) const IMAGES: Type = Type::Of(&["enabled"], &[("enabled", Type::Bool)]);
/// Which writes a validator is for.
pub(super) const LEVEL: Type = Type::OneOf(&["off", "strict", "moderate"]);
/// What is done with a document that a validator does not let pass.
pub(super) const ACTION: Type = Type::OneOf(&["error", "warn"]);

/// MongoDB's code for a collection without an index on `_id`.
const NOT_REPLICATED: i32 = 50_001;

/// Options of `create` that have no meaning without another one.
const DEPENDENT: [(&str, &[&str]); 4] = [
    ("size", &["capped"]),
    ("max", &["capped"]),
    ("expireAfterSeconds", &["timeseries", "clusteredIndex"]),
    ("pipeline", &["viewOn"]),
];

/// Options of `create` that this rmem has no word for.
const REFUSED: [&str; 5] = ["capped", "clusteredIndex", "encryptedFields", "timeseries", "viewOn"];

fn create(memory: &Memory, call: &Call) -> Answer {
    let fields = call.request.fields();
    let ns = call.request.namespace()?;
    options::check("create", fields.document, OF_CREATE)?;
    check_dependent(fields)?;
    let images = images(fields)?;
    if fields.optional_flag("autoIndexId")? == Some(false) {
        let message = format!("autoIndexId:false is not allowed for collection {ns} because it can be replicated");
        return Err(Failure::new(NOT_REPLICATED, message));
    }
    let engines =
        fields.document("indexOptionDefaults")?.and_then(|defaults| defaults.get_document("storageEngine").ok());
    fields.document("storageEngine")?.into_iter().chain(engines).try_for_each(check_engines)?;
    fields.refuse(&REFUSED)?;
    let collation = fields.document("collation")?.map(Collation::parse).transpose()?;
    if let Some(definition) = fields.document("idIndex")? {
        super::index::check_ids(definition, collation.as_ref())?;
    }
    let validation = validation(memory, &ns, fields)?;
    if !memory.create_validating(&ns, collation.as_ref(), &validation, images)? {
        let message = format!("Collection {ns} already exists.");
        return Err(Failure::new(codes::NAMESPACE_EXISTS, message));
    }
    crate::serve::host::empty()
}

/// What a command says of the documents that a collection takes.
pub(super) fn validation(memory: &Memory, ns: &Namespace, fields: Fields<'_>) -> Result<Validation, Failure> {
    let validation = Validation::read(fields.document)?;
    let Some(validator) = &validation.validator else { return Ok(validation) };
    if is_internal(&ns.database) {
        let database = &ns.database;
        let message =
            format!("Document validators are not allowed on collection {ns} in the {database} internal database");
        return Err(Failure::new(codes::INVALID_OPTIONS, message));
    }
    // A MongoDB server says itself what it takes.
    if memory.is_current(ns)? {
        Validator::parse(validator)?;
    }
    Ok(validation)
}

/// Refuses options that have no meaning without others.
fn check_dependent(fields: Fields<'_>) -> Result<(), Failure> {
    let is_said = |name: &str| match fields.document.get(name) {
        None | Some(Bson::Null | Bson::Undefined | Bson::Boolean(false)) => false,
        Some(value) => whole(value) != Some(0) || matches!(name, "size" | "max" | "expireAfterSeconds"),
    };
    let invalid = |message: String| Err(Failure::new(codes::INVALID_OPTIONS, message));
    if is_said("capped") && !is_said("size") {
        return invalid("the 'size' field is required when 'capped' is true".to_owned());
    }
    if fields.optional_flag("temp")?.is_some() {
        return invalid("the 'temp' field is an invalid option".to_owned());
    }
    match DEPENDENT.iter().find(|(name, others)| is_said(name) && !others.iter().any(|other| is_said(other))) {
        Some((name, others)) => invalid(format!("the '{name}' field needs {}", others.join(" or "))),
        None => Ok(()),
    }
}

/// Whether a command says that documents are to be kept as they were before and after changes, or not to be; those of a file
/// always are. MongoDB refuses to be asked in both ways.
pub(super) fn images(fields: Fields<'_>) -> Result<Option<bool>, Failure> {
    let images = fields.document("changeStreamPreAndPostImages")?.and_then(|images| images.get_bool("enabled").ok());
    match fields.flag("recordPreImages")? && images == Some(true) {
        true => {
            let message =
                "'recordPreImages' and 'changeStreamPreAndPostImages.enabled' can not be set to true simultaneously";
            Err(Failure::new(codes::INVALID_OPTIONS, message))
        }
        false => Ok(images),
    }
}

/// Refuses options for engines that MongoDB does not have; those of its own make no difference here.
fn check_engines(engines: &Document) -> Result<(), Failure> {
    for (name, options) in engines {
        if !matches!(options, Bson::Document(_)) {
            let message = format!("'storageEngine.{name}' has to be an embedded document.");
            return Err(Failure::new(codes::BAD_VALUE, message));
        }
        if name != "wiredTiger" {
            let message = format!("{name} is not a registered storage engine for this server");
            return Err(Failure::new(codes::INVALID_OPTIONS, message));
        }
    }
    Ok(())
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
    options::check("renameCollection", fields.document, OF_RENAME)?;
    if let Some(null @ (Bson::Null | Bson::Undefined)) = fields.document.get("dropTarget") {
        return Err(fields.wrong("dropTarget", null, "bool"));
    }
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
    if !memory.collections_of(&from.database)?.contains(&from) {
        return Err(Failure::new(codes::NO_NAMESPACE, format!("Source collection {from} does not exist")));
    }
    memory.rename_collection(&from, &to, fields.flag("dropTarget")?)?;
    crate::serve::host::empty()
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
    for ns in call.access(memory).collections_of(&database)? {
        let listed = match memory.collection_or_view(&ns)? {
            Listed::Collection(indexes) => {
                described(&ns, memory.validation(&ns)?.as_ref(), index::collation(&indexes).as_ref())
            }
            Listed::View(options) => {
                doc! { "name": &ns.collection, "type": "view", "options": options, "info": { "readOnly": true } }
            }
            Listed::TimeSeries(options) => {
                doc! { "name": &ns.collection, "type": "timeseries", "options": options, "info": { "readOnly": false } }
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

fn described(ns: &Namespace, validation: Option<&Validation>, collation: Option<&Collation>) -> Document {
    let ids = collation.map_or_else(Index::of_ids, Index::of_collated_ids);
    doc! {
        "name": &ns.collection,
        "type": "collection",
        "options": collection_options(validation, collation),
        "info": { "readOnly": false },
        "idIndex": ids.definition(),
    }
}
