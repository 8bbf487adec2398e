//! A change stream of the MongoDB server behind this one, as clients see its documents: without what rmem keeps there.
//!
//! The server behind leaves it out itself, by stages in front of the client's own.

use std::time::{Duration, Instant};

use bson::{Bson, Document, Timestamp, doc};

use super::spec::Spec;
use crate::memory::Memory;
use crate::serve::access::Metadata;
use crate::serve::clock;
use crate::serve::failure::{Failure, NOT_RESUMABLE, RESUMABLE, codes};
use crate::store::metadata::INFO;
use crate::store::{EventRequest, Events, Scope, ServerEvents, StoreError, index};

/// An open change stream of the server behind.
pub(in crate::serve) struct Behind {
    pub(in crate::serve) used: Instant,
    events: Box<dyn ServerEvents>,
}

impl Behind {
    /// Opens a stream; gives its first events, at most so many. `now` is the time as this server tells it.
    ///
    /// # Errors
    /// Where the server behind cannot be reached, or refuses.
    pub(in crate::serve) fn open(
        memory: &Memory,
        spec: Spec,
        metadata: Metadata,
        now: Timestamp,
        most: Option<u64>,
    ) -> Result<(Self, Events), Failure> {
        let mut stages = stages(memory, &spec.scope, &spec.options, metadata);
        stages.extend(spec.stages);
        let (mut options, mut since) = (spec.options, None);
        options.remove("allChangesForCluster");
        if let Some(told) = options.get_timestamp("startAtOperationTime").ok().filter(|time| clock::is_counted(*time)) {
            // The server behind counts otherwise, and its clock may be another.
            let now = clock::date(now).timestamp_millis();
            let ago = u64::try_from(now - clock::date(told).timestamp_millis()).unwrap_or_default();
            since = Instant::now().checked_sub(Duration::from_millis(ago));
            if since.is_some() {
                options.remove("startAtOperationTime");
            }
        }
        let (scope, collation, variables) = (spec.scope, spec.collation, spec.variables);
        let request = EventRequest { scope, options, since, stages, collation, variables };
        let (events, first) = memory.server_events(request, most).map_err(ending)?;
        Ok((Self { used: Instant::now(), events }, first))
    }

    /// The next events, at most so many, or none if none comes within `wait`.
    ///
    /// # Errors
    /// Where the server behind was away for long, or says that nothing more will come.
    pub(in crate::serve) fn next(&mut self, most: Option<u64>, wait: Duration) -> Result<Events, Failure> {
        self.used = Instant::now();
        self.events.next(most, wait).map_err(ending)
    }
}

/// What ends a stream, labeled as a MongoDB server does.
fn ending(error: StoreError) -> Failure {
    let failure = Failure::from(error);
    match failure.code {
        codes::STREAM_FATAL | codes::HISTORY_LOST => failure.labeled(NOT_RESUMABLE),
        codes::UNREACHABLE => Failure { labels: vec![RESUMABLE], ..failure },
        _ => failure,
    }
}

/// The stages that leave out what a client does not see: rmem's own collections and index, documents that a computable made,
/// databases of another store, metadata, and updates of nothing else.
fn stages(memory: &Memory, scope: &Scope, options: &Document, metadata: Metadata) -> Vec<Document> {
    if metadata == Metadata::Own {
        return Vec::new();
    }
    let mut is_seen = doc! {};
    for document in ["fullDocument", "fullDocumentBeforeChange"] {
        is_seen.insert(format!("{document}.{INFO}.computed"), doc! { "$ne": true });
    }
    if !matches!(scope, Scope::Collection(_)) {
        is_seen.insert("ns.coll", doc! { "$not": { "$regex": "^rmem\\." } });
    }
    let elsewhere = memory.databases_elsewhere();
    if *scope == Scope::All && !elsewhere.is_empty() {
        is_seen.insert("ns.db", doc! { "$nin": elsewhere });
    }
    let mut stages = vec![doc! { "$match": is_seen }];
    if metadata == Metadata::Hidden {
        stages.extend(hiding());
        if options.get_bool("showExpandedEvents").unwrap_or(false) {
            stages.push(without_index());
        }
    }
    stages
}

/// The stages that leave the metadata out.
fn hiding() -> [Document; 3] {
    let is_shown = |path: &str| doc! { "$ne": [{ "$first": { "$split": [path, "."] } }, INFO] };
    let filtered =
        |input: Bson, path: &str| doc! { "$filter": { "input": input, "as": "path", "cond": is_shown(path) } };
    let keys_filtered = |field: &str| {
        let keys = doc! { "$objectToArray": field };
        doc! { "$arrayToObject": filtered(keys.into(), "$$path.k") }
    };
    // What a version of the server does not say is not there.
    let where_it_is =
        |field: &str, filtered: Document| doc! { "$cond": [{ "$gt": [field, Bson::Null] }, filtered, "$$REMOVE"] };
    let (cut, ambiguous) = ("$updateDescription.truncatedArrays", "$updateDescription.disambiguatedPaths");
    let update = doc! {
        "updatedFields": keys_filtered("$updateDescription.updatedFields"),
        "removedFields": filtered("$updateDescription.removedFields".into(), "$$path"),
        "truncatedArrays": where_it_is(cut, filtered(cut.into(), "$$path.field")),
        "disambiguatedPaths": where_it_is(ambiguous, keys_filtered(ambiguous)),
    };
    let is_update = doc! { "$eq": ["$operationType", "update"] };
    let shown = doc! { "$mergeObjects": ["$updateDescription", update] };
    [
        doc! { "$set": { "updateDescription": { "$cond": [is_update, shown, "$$REMOVE"] } } },
        doc! { "$match": { "$nor": [{
            "operationType": "update",
            "updateDescription.updatedFields": {},
            "updateDescription.removedFields": { "$size": 0 },
            "updateDescription.truncatedArrays.0": { "$exists": false },
        }] } },
        doc! { "$unset": [format!("fullDocument.{INFO}"), format!("fullDocumentBeforeChange.{INFO}")] },
    ]
}

/// The stage that leaves out what is done to the index by which rmem finds what has decayed.
fn without_index() -> Document {
    let all = doc! { "$ifNull": ["$operationDescription.indexes.name", []] };
    let is_one = doc! { "$eq": ["$operationDescription.index.name", index::DECAY] };
    let is_own = doc! { "$or": [{ "$in": [index::DECAY, all] }, is_one] };
    // Written with `$nor`, MongoDB 6.0 makes a condition of it that it refuses itself.
    doc! { "$match": { "$expr": { "$not": [is_own] } } }
}
