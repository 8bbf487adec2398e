//! `getMore`, `killCursors`

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use bson::raw::cstr;
use bson::{Bson, RawDocumentBuf, doc};

use super::definition::{Command, raw};
use crate::query::QueryError;
use crate::serve::call::Call;
use crate::serve::changes::Following;
use crate::serve::cursor::{Open, Owner};
use crate::serve::failure::{Answer, Failure, codes};
use crate::serve::host::Host;
use crate::serve::request::Request;
use crate::store::Events;

pub(super) const COMMANDS: &[Command] =
    &[Command::read("getMore", more).transactional(), Command::read("killCursors", kill).transactional()];

/// How long a change stream waits for changes where `maxTimeMS` does not say it, as with MongoDB.
const DEFAULT_AWAIT_TIME: Duration = Duration::from_secs(1);
/// How long a MongoDB server behind this one is waited for before it is looked whether the wait is to end.
const SLICE: Duration = Duration::from_millis(500);

fn more(host: &mut Host<'_>, call: &Call) -> Answer {
    let fields = call.request.fields();
    fields.known(&["collection", "batchSize", "term", "lastKnownCommittedOpTime"])?;
    let id = match call.request.target() {
        Some(Bson::Int64(id)) => *id,
        _ => {
            let message = "BSON field 'getMore.getMore' is the wrong type, expected type 'long'";
            return Err(Failure::new(codes::TYPE_MISMATCH, message));
        }
    };
    let collection = fields.text("collection")?.ok_or_else(|| fields.missing("collection"))?;
    let (cursors, here) = (&host.server.cursors, call.request.origin());
    let open = cursors.get(id).ok_or_else(|| cursors.failure(id, &here))?;
    open.origin.check(id, &here)?;
    let ns = &open.namespace;
    if (ns.database.as_str(), ns.collection.as_str()) != (call.request.database.as_str(), collection) {
        let message = format!(
            "Requested getMore on namespace '{}.{collection}', but cursor belongs to a different namespace {ns}",
            call.request.database
        );
        return Err(Failure::new(codes::UNAUTHORIZED, message));
    }
    let waits = matches!(&open.owner, Owner::Stream(_));
    if !waits && call.request.body.contains_key("maxTimeMS") {
        let message = "cannot set maxTimeMS on getMore command for a non-awaitData cursor";
        return Err(Failure::new(codes::BAD_VALUE, message));
    }
    cursors.touch(id, host.id);
    let batch = fields.size("batchSize")?;
    match &open.owner {
        Owner::Thread(_) => host.more(id, batch),
        Owner::Stream(stream) => events(host, call, id, &open, stream, batch.filter(|size| *size > 0)),
    }
}

/// The next events of a change stream, which are waited for.
fn events(
    host: &mut Host<'_>,
    call: &Call,
    id: i64,
    open: &Open,
    stream: &Arc<Mutex<Following>>,
    batch: Option<u64>,
) -> Answer {
    let default = if call.request.body.contains_key("maxTimeMS") { Duration::ZERO } else { DEFAULT_AWAIT_TIME };
    let until = Instant::now() + call.request.limit.unwrap_or(default);
    loop {
        let calls = host.server.hub.calls();
        let memory = host.memory()?;
        let (next, is_of_file) = match &mut *stream.lock().unwrap_or_else(PoisonError::into_inner) {
            Following::File(stream) => {
                host.server.scopes.touch(stream.scope());
                (stream.next(memory, batch), true)
            }
            Following::Server(stream) => {
                let wait = until.saturating_duration_since(Instant::now()).min(SLICE);
                (host.server.turns.paused(|| stream.next(batch, wait)), false)
            }
        };
        let next = next.inspect_err(|_| host.server.cursors.forget(id))?;
        if next.count == 0 {
            call.request.check_ending().inspect_err(|_| host.server.cursors.forget(id))?;
        }
        if next.count > 0 || next.is_over || Instant::now() >= until {
            if next.is_over {
                host.server.cursors.forget(id);
            }
            return stream_reply(if next.is_over { 0 } else { id }, &open.namespace.to_string(), &next, false);
        }
        host.server.check_running()?;
        if host.server.cursors.get(id).is_none() {
            return Err(Failure::new(codes::CURSOR_KILLED, format!("cursor id {id} was killed")));
        }
        match is_of_file {
            true => host.wait_for_changes(calls, until),
            false => host.handle_messages(),
        }
    }
}

/// The answer with events of a change stream.
pub(super) fn stream_reply(id: i64, ns: &str, batch: &Events, is_first: bool) -> Answer {
    let mut cursor = RawDocumentBuf::new();
    cursor.append(if is_first { cstr!("firstBatch") } else { cstr!("nextBatch") }, batch.events.as_ref());
    if let Some(token) = &batch.token {
        cursor.append(cstr!("postBatchResumeToken"), RawDocumentBuf::try_from(token)?);
    }
    cursor.append(cstr!("id"), id);
    cursor.append(cstr!("ns"), ns);
    let mut reply = RawDocumentBuf::new();
    reply.append(cstr!("cursor"), cursor);
    Ok(reply)
}

fn kill(host: &mut Host<'_>, call: &Call) -> Answer {
    let fields = call.request.fields();
    fields.known(&["cursors"])?;
    let ids = fields.array("cursors")?.ok_or_else(|| fields.missing("cursors"))?;
    let (mut killed, mut missing) = (Vec::new(), Vec::new());
    for id in ids {
        let Bson::Int64(id) = id else {
            return Err(Failure::new(codes::TYPE_MISMATCH, "BSON field 'killCursors.cursors' has to have longs"));
        };
        let found = host.server.cursors.kill(*id);
        if found { killed.push(*id) } else { missing.push(*id) }
    }
    let reads_killed = |request: &Request| {
        request.name == "getMore" && matches!(request.target(), Some(Bson::Int64(id)) if killed.contains(id))
    };
    host.server.stop_operations(QueryError::CURSOR_KILLED, reads_killed);
    host.handle_messages();
    let none: Vec<i64> = Vec::new();
    raw(
        &doc! { "cursorsKilled": killed, "cursorsNotFound": missing, "cursorsAlive": none.clone(), "cursorsUnknown": none },
    )
}
