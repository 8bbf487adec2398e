//! Reads of the memory as it was at the first of them (`readConcern: {level: "snapshot"}`), outside of a transaction.
//!
//! The first read of a session has a thread with a snapshot, as a transaction that only reads; its answer says at which
//! time it was taken (`atClusterTime`), which the client sends with the next ones. One snapshot of a session is kept, for as
//! long as a transaction may take.

use std::sync::Arc;
use std::time::Duration;

use bson::{Bson, Document, RawDocumentBuf, Timestamp};

use super::call::Call;
use super::clock;
use super::failure::{Answer, Failure, codes};
use super::host::Host;
use super::reading;
use super::session::{Once, SessionId};
use crate::store::Namespace;

/// Commands that read at a time.
const READING: [&str; 3] = ["find", "aggregate", "distinct"];

/// How long a snapshot waits for a write that is being made durable.
const SETTLE_TIMEOUT: Duration = Duration::from_secs(1);

/// Runs a command that reads a snapshot.
pub(super) fn read(host: &mut Host<'_>, ns: &Namespace, call: Call, command: reading::Command) -> Answer {
    let name = &call.request.name;
    if !READING.contains(&name.as_str()) {
        let message = format!("Command {name} does not support {{ readConcern: {{ level: \"snapshot\" }} }}");
        return Err(Failure::new(codes::INVALID_OPTIONS, message));
    }
    if name == "aggregate" {
        check_pipeline(&call)?;
    }
    if !host.memory()?.is_current(ns)? {
        return Err(unavailable("readConcern snapshot is for databases in a file; this one is on a MongoDB server"));
    }
    let asked = call.request.at_cluster_time();
    let time = asked.unwrap_or_else(|| host.server.clock.settled_tick(SETTLE_TIMEOUT));
    if clock::packed(time) > clock::packed(host.server.clock.now()) {
        let message = "readConcern atClusterTime value must not be greater than the current clusterTime.";
        return Err(Failure::new(codes::INVALID_OPTIONS, message));
    }
    let once = snapshot_of(call.request.session.as_ref(), time);
    let begins = asked.is_none().then_some((ns, command));
    let answer = reading::run(host, &once, &Arc::new(call), begins).map_err(|_| gone())?;
    dated(answer.ok_or_else(gone)??, time)
}

/// Refuses pipelines that read no snapshot, or write.
fn check_pipeline(call: &Call) -> Result<(), Failure> {
    let invalid = |message: String| Err(Failure::new(codes::INVALID_OPTIONS, message));
    let fields = call.request.fields();
    if fields.strict_flag("explain")? {
        return invalid("Explain for the aggregate command cannot run with a readConcern other than local".to_owned());
    }
    let stages = fields.documents("pipeline")?.unwrap_or_default();
    let names: Vec<_> = stages.iter().filter_map(|stage| stage.keys().next()).map(String::as_str).collect();
    match (names.first(), names.last()) {
        (Some(&"$changeStream"), _) => {
            invalid("$changeStream cannot run with a readConcern of level snapshot; it takes majority".to_owned())
        }
        (_, Some(name @ (&"$out" | &"$merge"))) => invalid(format!(
            "{name} cannot run with a readConcern of level snapshot: nothing can be written in a snapshot; run it \
             outside of the session"
        )),
        _ => Ok(()),
    }
}

/// What the thread of a snapshot is known by: its session is no transaction's.
fn snapshot_of(session: Option<&SessionId>, time: Timestamp) -> Once {
    let number = i64::try_from(clock::packed(time)).unwrap_or(i64::MAX);
    Once { session: session.map(SessionId::of_snapshot).unwrap_or_default(), number }
}

fn gone() -> Failure {
    unavailable(
        "the snapshot is not kept: each session has one, for 60 s, at most 200 sessions have one at once, and nothing can be \
         written or computed in it",
    )
}

fn unavailable(message: &str) -> Failure {
    Failure::new(codes::NO_SNAPSHOT, message)
}

/// The answer with the time of what it has read.
fn dated(reply: RawDocumentBuf, time: Timestamp) -> Answer {
    let mut reply = Document::try_from(&*reply)?;
    match reply.get_mut("cursor") {
        Some(Bson::Document(cursor)) => cursor.insert("atClusterTime", time),
        _ => reply.insert("atClusterTime", time),
    };
    Ok(RawDocumentBuf::try_from(&reply)?)
}
