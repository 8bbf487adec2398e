//! `collStats`, `dbStats`, and the stages `$collStats` and `$indexStats`

use bson::{Bson, DateTime, Document, doc};

use super::definition::{Command, raw};
use super::index::is_shown;
use crate::memory::{Listed, Memory};
use crate::query::QueryError;
use crate::saturate::to_i64;
use crate::serve::call::Call;
use crate::serve::failure::{Answer, Failure, codes};
use crate::serve::fields::{Fields, number, whole};
use crate::serve::host::Host;
use crate::store::{Namespace, Store, Validated};

pub(super) const COMMANDS: &[Command] =
    &[Command::read("collStats", collection), Command::read("dbStats", database), Command::read("validate", validate)];

/// MongoDB's code for a `$collStats` that is no document.
const NO_OBJECT: i32 = 5_447_000;

/// Documents and their bytes.
#[derive(Debug, Clone, Copy, Default)]
struct Size {
    count: i64,
    bytes: i64,
}

fn size(memory: &Memory, ns: &Namespace) -> Result<Size, Failure> {
    let store = memory.bare(ns)?;
    let sums = doc! { "$group": { "_id": Bson::Null, "count": { "$sum": 1 }, "bytes": { "$sum": { "$bsonSize": "$$ROOT" } } } };
    let Some(found) = store.aggregate(ns, (&[sums]).into())?.next().transpose()? else { return Ok(Size::default()) };
    let found = Document::try_from(&*found).map_err(QueryError::from)?;
    let sum = |name: &str| found.get(name).and_then(whole).unwrap_or_default();
    Ok(Size { count: sum("count"), bytes: sum("bytes") })
}

/// The bytes of the documents of some collections; views have none of their own.
pub(super) fn bytes(memory: &Memory, collections: &[Namespace]) -> Result<i64, Failure> {
    collections.iter().try_fold(0, |sum, ns| match memory.collection_or_view(ns)? {
        Listed::Collection(_) | Listed::TimeSeries(_) => Ok(sum + size(memory, ns)?.bytes),
        Listed::View(_) => Ok(sum),
    })
}

/// What is known of a collection's size, in a unit.
fn described(store: &dyn Store, ns: &Namespace, size: Size, scale: i64) -> Result<Document, Failure> {
    let indexes = store.indexes(ns)?;
    let average = if size.count > 0 { size.bytes / size.count } else { 0 };
    let known = store.index_sizes(ns)?;
    let all: i64 = known.iter().map(|(_, bytes)| bytes).sum();
    let size_of = |name: &str| known.iter().find(|(known, _)| known == name).map_or(0, |(_, bytes)| *bytes);
    let sizes: Document =
        indexes.iter().map(|index| (index.name.clone(), number(size_of(&index.name) / scale))).collect();
    Ok(doc! {
        "size": number(size.bytes / scale),
        "count": number(size.count),
        "avgObjSize": number(average),
        "numOrphanDocs": 0,
        "storageSize": number(size.bytes / scale),
        "freeStorageSize": 0,
        "capped": false,
        "nindexes": i32::try_from(indexes.len()).unwrap_or(i32::MAX),
        "indexBuilds": Bson::Array(Vec::new()),
        "totalIndexSize": number(all / scale),
        "totalSize": number((size.bytes + all) / scale),
        "indexSizes": sizes,
        "scaleFactor": number(scale),
    })
}

fn collection(host: &mut Host<'_>, call: &Call) -> Answer {
    let (ns, fields) = (call.request.readable()?, call.request.fields());
    fields.known(&["scale"])?;
    let memory = host.memory()?;
    let scale = scale(fields)?;
    let mut reply = doc! { "ns": ns.to_string() };
    reply.extend(described(memory.bare(&ns)?, &ns, size(memory, &ns)?, scale)?);
    raw(&reply)
}

fn scale(fields: Fields<'_>) -> Result<i64, Failure> {
    match fields.whole("scale")? {
        None => Ok(1),
        Some(scale @ 1..) => Ok(scale),
        Some(_) => Err(Failure::new(51_024, "BSON field 'scale' value must be >= 1")),
    }
}

fn database(host: &mut Host<'_>, call: &Call) -> Answer {
    let fields = call.request.fields();
    fields.known(&["scale", "freeStorage"])?;
    let (memory, scale) = (host.memory()?, scale(fields)?);
    let all = call.access(memory).collections_of(&call.request.database)?;
    let (mut sum, mut indexes, mut keys) = (Size::default(), 0, 0);
    let mut views = 0_i64;
    for ns in &all {
        match memory.collection_or_view(ns)? {
            Listed::Collection(own) => indexes += own.len(),
            Listed::TimeSeries(_) => {}
            Listed::View(_) => {
                views += 1;
                continue;
            }
        }
        keys += memory.bare(ns)?.index_sizes(ns)?.iter().map(|(_, bytes)| bytes).sum::<i64>();
        let one = size(memory, ns)?;
        sum = Size { count: sum.count + one.count, bytes: sum.bytes + one.bytes };
    }
    #[expect(clippy::cast_precision_loss, reason = "MongoDB has doubles here, too")]
    let double = |number: i64| number as f64;
    raw(&doc! {
        "db": &call.request.database,
        "collections": number(to_i64(all.len()) - views),
        "views": number(views),
        "objects": number(sum.count),
        "avgObjSize": if sum.count > 0 { double(sum.bytes) / double(sum.count) } else { 0.0 },
        "dataSize": double(sum.bytes / scale),
        "storageSize": double(sum.bytes / scale),
        "indexes": number(to_i64(indexes)),
        "indexSize": double(keys / scale),
        "totalSize": double((sum.bytes + keys) / scale),
        "scaleFactor": double(scale),
        "fsUsedSize": 0.0,
        "fsTotalSize": 0.0,
    })
}

fn validate(host: &mut Host<'_>, call: &Call) -> Answer {
    let (ns, fields) = (call.request.readable()?, call.request.fields());
    // How deep it looks makes no difference: it is as deep as it can be.
    fields.check(&["full", "background", "metadata", "checkBSONConformance"], &["repair"])?;
    let mut errors = Vec::new();
    let validated = host.memory()?.bare(&ns)?.validate(&ns, &mut |damage| errors.push(damage.to_owned()))?;
    let Some(Validated { documents, damaged, mut indexes }) = validated else {
        let message = format!("Collection '{ns}' does not exist to validate.");
        return Err(Failure::new(codes::NO_NAMESPACE, message));
    };
    indexes.retain(|index| is_shown(call, &index.name));
    let keys: Document = indexes.iter().map(|index| (index.name.clone(), number(to_i64(index.keys)))).collect();
    let details = indexes.iter().map(|index| (index.name.clone(), doc! { "valid": index.is_sound }.into()));
    raw(&doc! {
        "ns": ns.to_string(),
        "nInvalidDocuments": number(to_i64(damaged)),
        "nNonCompliantDocuments": 0,
        "nrecords": number(to_i64(documents)),
        "nIndexes": number(to_i64(indexes.len())),
        "keysPerIndex": keys,
        "indexDetails": details.collect::<Document>(),
        "valid": errors.is_empty(),
        "repaired": false,
        "warnings": [],
        "errors": errors,
        "extraIndexEntries": [],
        "missingIndexEntries": [],
        "corruptRecords": [],
    })
}

/// The document of `$collStats`.
pub(super) fn stage(memory: &Memory, call: &Call, ns: &Namespace, argument: &Bson) -> Result<Document, Failure> {
    let Bson::Document(asked) = argument else {
        return Err(Failure::new(NO_OBJECT, "$collStats must take a nested object"));
    };
    let fields = Fields::new("$collStats", asked);
    fields.known_inside(&["latencyStats", "storageStats", "count", "queryExecStats"])?;
    let host = super::server::host_name();
    let mut document = doc! { "ns": ns.to_string(), "host": host, "localTime": DateTime::now() };
    let is_counted = ["count", "storageStats"].iter().any(|name| asked.contains_key(name));
    if is_counted && !memory.collections_of(&ns.database)?.contains(ns) {
        return Err(Failure::new(codes::NO_NAMESPACE, format!("Collection [{ns}] not found.")));
    }
    let size = size(memory, ns)?;
    if let Some(storage) = fields.document("storageStats")? {
        let scale = scale(Fields::new("storageStats", storage))?;
        document.insert("storageStats", described(memory.bare(ns)?, ns, size, scale)?);
    }
    if fields.document("count")?.is_some() {
        let count = call.access(memory).count(ns, (&Document::new()).into())?;
        document.insert("count", number(count.cast_signed()));
    }
    if let Some(latency) = fields.document("latencyStats")? {
        let latency = Fields::new("$collStats.latencyStats", latency);
        latency.known_inside(&["histograms"])?;
        latency.strict_flag("histograms")?;
        let none = doc! { "latency": 0_i64, "ops": 0_i64 };
        document.insert(
            "latencyStats",
            doc! { "reads": none.clone(), "writes": none.clone(), "commands": none.clone(), "transactions": none },
        );
    }
    if fields.document("queryExecStats")?.is_some() {
        document.insert("queryExecStats", doc! { "collectionScans": { "total": 0_i64, "nonTailable": 0_i64 } });
    }
    Ok(document)
}

/// The documents of `$indexStats`.
pub(super) fn indexes(memory: &Memory, ns: &Namespace) -> Result<Vec<Document>, Failure> {
    let of = |index: &crate::store::Index| {
        doc! {
            "name": &index.name,
            "key": index.keys.clone(),
            "host": "rmem",
            "accesses": { "ops": 0_i64, "since": DateTime::now() },
            "spec": index.definition(),
        }
    };
    Ok(memory.indexes(ns)?.iter().map(of).collect())
}
