//! A change stream of the MongoDB server behind this one, as clients see its documents: without what rmem keeps there.
//!
//! The server behind leaves it out itself, by stages in front of the client's own.

use std::time::{Duration, Instant};

use bson::{Bson, Document, Timestamp, doc};

use super::spec::Spec;
use crate::memory::Memory;
use crate::serve::access::Metadata;
use crate::serve::clock;
use crate::serve::failure::{Failure, NOT_RESUMABLE, codes};
use crate::store::metadata::INFO;
use crate::store::{EventRequest, Events, Scope, ServerEvents, StoreError};

/// An open change stream of the server behind.
pub(in crate::serve) struct Behind {
    pub(in crate::serve) used: Instant,
    events: Box<dyn ServerEvents>,
}

impl Behind {
    /// Opens a stream; gives its first events, at most so many.
    ///
    /// # Errors
    /// Where the server behind cannot be reached, or refuses.
    pub(in crate::serve) fn open(
        memory: &Memory,
        spec: Spec,
        metadata: Metadata,
        most: Option<u64>,
    ) -> Result<(Self, Events), Failure> {
        let mut stages = stages(&spec.scope, metadata);
        stages.extend(spec.stages);
        let mut options = spec.options;
        options.remove("allChangesForCluster");
        if let Some(Bson::Timestamp(time)) = options.get_mut("startAtOperationTime") {
            *time = time_of_server(*time);
        }
        let request = EventRequest { scope: spec.scope, options, stages, collation: spec.collation };
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
        _ => failure,
    }
}

/// The time of the server behind that stands for one that this server told: the two count differently within a second, so
/// it is the beginning of that.
fn time_of_server(time: Timestamp) -> Timestamp {
    if clock::is_counted(time) { Timestamp { increment: 1, ..time } } else { time }
}

/// The stages that leave out what a client does not see: rmem's own collections, documents that a computable made, metadata,
/// and updates of nothing else.
fn stages(scope: &Scope, metadata: Metadata) -> Vec<Document> {
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
    let mut stages = vec![doc! { "$match": is_seen }];
    if metadata == Metadata::Hidden {
        stages.extend(hiding());
    }
    stages
}

/// The stages that leave the metadata out.
fn hiding() -> [Document; 3] {
    let is_shown = |path: &str| doc! { "$ne": [{ "$first": { "$split": [path, "."] } }, INFO] };
    let filtered =
        |input: Bson, path: &str| doc! { "$filter": { "input": input, "as": "path", "cond": is_shown(path) } };
    let fields = doc! { "$objectToArray": "$updateDescription.updatedFields" };
    let update = doc! {
        "updatedFields": { "$arrayToObject": filtered(fields.into(), "$$path.k") },
        "removedFields": filtered("$updateDescription.removedFields".into(), "$$path"),
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
