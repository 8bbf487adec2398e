//! One write: done once, however often it is sent, and where it fails, it has done nothing, unless it says so.

use bson::raw::{CStr, cstr};
use bson::{RawDocumentBuf, Timestamp};

use super::attempt::attempt;
use super::clock;
use super::failure::{Answer, is_kept};
use super::panic;
use super::retry;
use super::server::Server;
use super::session::{Finished, Once};
use super::statements::Repeatable;
use crate::memory::Memory;
use crate::monotonic;
use crate::store::{Namespace, NotedChanges, Store, StoreError};

/// The time of what was written or read.
pub(super) const OPERATION_TIME: &CStr = cstr!("operationTime");

/// Does a write by itself, in the thread of its client.
pub(super) fn alone(
    server: &Server,
    memory: &Memory,
    ns: &Namespace,
    repeatable: Option<Repeatable>,
    work: impl FnOnce(&Memory) -> Answer,
) -> Answer {
    server.check_files()?;
    let _writing = server.clock.begin_write();
    let answer = step(server, memory, ns, repeatable, work);
    server.check_files()?;
    server.hub.call();
    answer
}

/// Does a write, as one of several that are made durable together where there is a transaction.
pub(super) fn step(
    server: &Server,
    memory: &Memory,
    ns: &Namespace,
    repeatable: Option<Repeatable>,
    work: impl FnOnce(&Memory) -> Answer,
) -> Answer {
    if let Some(write) = &repeatable {
        retry::recall(memory, ns, write, server.sessions.last(&write.once.session))?;
    }
    let mut noted = None;
    let answer = attempt(memory, ns, |memory| {
        let store = memory.bare(ns)?;
        // Those of the writes that are made durable with this one.
        let before = store.noted_changes()?;
        let answer = panic::caught(|| work(memory));
        if is_kept(&answer) {
            repeatable.iter().try_for_each(|write| retry::keep(memory, ns, write))?;
            let own = |noted: &NotedChanges| before.is_none_or(|before| before.last < noted.last);
            noted = time_of(server, store, store.noted_changes()?.filter(own))?;
        }
        answer
    });
    if !is_kept(&answer) {
        return answer;
    }
    let time = server.clock.wrote(noted);
    if let Some(Repeatable { once: Once { session, number }, .. }) = repeatable {
        server.sessions.finish(&session, Finished::write(number));
    }
    answer.map(|reply| at(reply, time))
}

/// The time of the changes of the write that is being done. Where the clock was set back, they are dated anew if a later time
/// was told already.
pub(super) fn time_of(
    server: &Server,
    store: &dyn Store,
    noted: Option<NotedChanges>,
) -> Result<Option<Timestamp>, StoreError> {
    let time = |noted: NotedChanges| clock::of(noted.time, noted.last);
    match noted.map(time) {
        Some(told) if monotonic::is_ahead() && server.clock.has_told(told) => {
            server.clock.move_on();
            Ok(store.join_changes()?.map(time))
        }
        later => Ok(later),
    }
}

/// An answer that says when what it is about was written.
pub(super) fn at(mut reply: RawDocumentBuf, time: Timestamp) -> RawDocumentBuf {
    reply.append(OPERATION_TIME, time);
    reply
}
