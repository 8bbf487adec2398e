//! Cursors: answers that are taken batch by batch.

use std::collections::{HashMap, HashSet};
use std::iter::Peekable;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use bson::raw::cstr;
use bson::{RawArrayBuf, RawDocumentBuf};

use super::changes::Following;
use super::ended::Ended;
use super::failure::{Failure, codes};
use super::mailbox::{Mailbox, More, ThreadMessage};
use super::origin::Origin;
use super::request::interrupted;
use crate::deadline;
use crate::query::{QueryError, Spill, Spool};
use crate::store::{Documents, MAX_SIZE, Namespace, StoreError};

/// How many documents the first batch has by default.
const FIRST_BATCH: u64 = 101;
/// How long the first write of a transaction waits until what its cursors have not given yet is read.
pub(super) const SETTLE_TIMEOUT: Duration = Duration::from_secs(5);
/// What a cursor says that has more.
const UNSETTLED: &str = "the transaction began to write before this cursor was read to its end, and there was too much \
    left to keep; read it to its end before the first write, or narrow the query";
/// At most so many cursors are open at once …
const MOST: usize = 10_000;
/// … and so many of one connection.
const MOST_OF_ONE: usize = 1_000;
/// At most so many connections that have ended keep cursors, and with them a thread and open files.
const MOST_LEFT: usize = 100;

/// Documents that were not sent yet.
pub(super) struct Results<'m> {
    documents: Peekable<Documents<'m>>,
    pub(super) used: Instant,
    pub(super) never_expires: bool,
    /// The number of the collection that is read.
    pub(super) collection: Option<i64>,
}

impl<'m> Results<'m> {
    pub(super) fn new(documents: Documents<'m>) -> Self {
        Self { documents: documents.peekable(), used: Instant::now(), never_expires: false, collection: None }
    }

    /// The next documents: at most so many, and no more than fit in a message.
    pub(super) fn batch(&mut self, most: Option<u64>) -> Result<RawArrayBuf, Failure> {
        let (mut batch, mut bytes, mut count) = (RawArrayBuf::new(), 0, 0);
        while most.is_none_or(|most| count < most) {
            // Where the documents come from another server, nothing else looks.
            if let Some(ending) = deadline::ending() {
                return Err(interrupted(ending));
            }
            let Some(next) = self.documents.peek() else { break };
            let size = next.as_ref().map_or(0, |document| document.as_bytes().len()) + 16;
            if count > 0 && bytes + size > MAX_SIZE {
                break;
            }
            let Some(document) = self.documents.next() else { break };
            batch.push(document?.as_ref());
            (bytes, count) = (bytes + size, count + 1);
        }
        self.used = Instant::now();
        Ok(batch)
    }

    /// Reads what was not sent yet, so that it stays as it is. What is not read by then is an error.
    pub(super) fn settle(&mut self, until: Instant) {
        let rest = std::mem::replace(&mut self.documents, (Box::new(std::iter::empty()) as Documents<'m>).peekable());
        self.documents = (match spooled(rest, until) {
            Ok(documents) => documents,
            Err(error) => Box::new(std::iter::once(Err(error))),
        })
        .peekable();
    }

    /// Whether all documents were sent.
    pub(super) fn is_over(&mut self) -> bool {
        self.documents.peek().is_none()
    }
}

/// Documents in memory, or in a temporary file where they are many.
fn spooled<'m>(
    documents: impl Iterator<Item = Result<RawDocumentBuf, StoreError>>,
    until: Instant,
) -> Result<Documents<'m>, StoreError> {
    let mut spool = Spool::new(&Spill::default());
    for document in documents {
        spool.push(&document?)?;
        if Instant::now() >= until {
            // What was read is given; behind it is the error.
            let error = QueryError::invalid(codes::FAILED, UNSETTLED).into();
            return Ok(Box::new(spool.read()?.map(|document| Ok(document?)).chain(std::iter::once(Err(error)))));
        }
    }
    Ok(Box::new(spool.read()?.map(|document| Ok(document?))))
}

/// How many documents a first batch has.
pub(super) fn first_batch(asked: Option<u64>) -> u64 {
    asked.unwrap_or(FIRST_BATCH)
}

/// The answer with a batch of a cursor; 0 is that of one that is over.
pub(super) fn reply(id: i64, ns: &str, batch: &RawArrayBuf, is_first: bool) -> RawDocumentBuf {
    let mut cursor = RawDocumentBuf::new();
    cursor.append(if is_first { cstr!("firstBatch") } else { cstr!("nextBatch") }, batch.as_ref());
    cursor.append(cstr!("id"), id);
    cursor.append(cstr!("ns"), ns);
    let mut reply = RawDocumentBuf::new();
    reply.append(cstr!("cursor"), cursor);
    reply
}

/// An open cursor, known to all connections.
#[derive(Clone)]
pub(super) struct Open {
    pub(super) namespace: Namespace,
    pub(super) origin: Origin,
    pub(super) owner: Owner,
    /// The connection that read it last, by its number.
    connection: i64,
    /// Whether that connection has ended. Another one may read the cursor still.
    has_left: bool,
    used: Instant,
}

impl Open {
    /// A cursor that a connection opens.
    pub(super) fn new(namespace: Namespace, origin: Origin, owner: Owner, connection: i64) -> Self {
        Self { namespace, origin, owner, connection, has_left: false, used: Instant::now() }
    }
}

/// The reader of a cursor.
#[derive(Clone)]
pub(super) enum Owner {
    /// The thread that opened it.
    Thread(Mailbox),
    /// Whoever is asked: a change stream holds nothing of a thread.
    Stream(Arc<Mutex<Following>>),
}

/// All cursors.
#[derive(Default)]
pub(super) struct Cursors(Mutex<All>);

/// Those that are open, and those of transactions that have ended.
#[derive(Default)]
struct All {
    open: HashMap<i64, Open>,
    /// How many of them each connection has.
    counts: Counts,
    ended: Ended,
}

/// How many cursors each connection has, by its number; connections without any are left out.
#[derive(Default)]
struct Counts(HashMap<i64, usize>);

impl Counts {
    fn of(&self, connection: i64) -> usize {
        self.0.get(&connection).copied().unwrap_or_default()
    }

    fn add(&mut self, connection: i64) {
        *self.0.entry(connection).or_default() += 1;
    }

    fn remove(&mut self, connection: i64) {
        let rest = self.of(connection).saturating_sub(1);
        match rest {
            0 => drop(self.0.remove(&connection)),
            rest => drop(self.0.insert(connection, rest)),
        }
    }
}

impl All {
    fn insert(&mut self, id: i64, cursor: Open) {
        self.counts.add(cursor.connection);
        self.open.insert(id, cursor);
    }

    fn remove(&mut self, id: i64) -> Option<Open> {
        let removed = self.open.remove(&id)?;
        self.counts.remove(removed.connection);
        Some(removed)
    }

    /// Closes a cursor; its thread frees it.
    fn close(&mut self, id: i64) -> bool {
        let removed = self.remove(id);
        if let Some(Open { owner: Owner::Thread(mailbox), .. }) = &removed {
            mailbox.send(ThreadMessage::Kill(id));
        }
        removed.is_some()
    }

    /// Closes the cursor that was not read for longest of those whose connections have ended; says whether there was one.
    fn close_left(&mut self) -> bool {
        let left = self.open.iter().filter(|(_, open)| open.has_left);
        let oldest = left.min_by_key(|(_, open)| open.used).map(|(id, _)| *id);
        oldest.is_some_and(|id| self.close(id))
    }

    /// Closes all cursors of the connection that has ended and was not read for longest, of those that keep files open; says
    /// whether there was one.
    fn close_connection_left(&mut self) -> bool {
        let left = || self.open.iter().filter(|(_, open)| open.has_left && matches!(open.owner, Owner::Thread(_)));
        let Some(connection) = left().min_by_key(|(_, open)| open.used).map(|(_, open)| open.connection) else {
            return false;
        };
        let ids: Vec<i64> = left().filter(|(_, open)| open.connection == connection).map(|(id, _)| *id).collect();
        for id in ids {
            self.close(id);
        }
        true
    }

    /// How many connections that have ended keep cursors.
    fn left(&self) -> usize {
        let left = self.open.values().filter(|open| open.has_left);
        left.map(|open| open.connection).collect::<HashSet<_>>().len()
    }
}

impl Cursors {
    /// Registers a cursor; gives its number. Where there are too many, those of connections that have ended make room.
    ///
    /// # Errors
    /// Where there are too many of this connection, or of all that are there.
    pub(super) fn open(&self, cursor: Open) -> Result<i64, Failure> {
        let mut cursors = self.lock();
        let full = |most, whose| {
            let message = format!("{most} cursors {whose}are open; close some, or let them be read to their end");
            Err(Failure::new(codes::FAILED, message))
        };
        if cursors.counts.of(cursor.connection) >= MOST_OF_ONE {
            return full(MOST_OF_ONE, "of this connection ");
        }
        if cursors.open.len() >= MOST && !cursors.close_left() {
            return full(MOST, "");
        }
        let id = loop {
            let id = random() & i64::MAX;
            if id != 0 && !cursors.open.contains_key(&id) {
                break id;
            }
        };
        cursors.insert(id, cursor);
        Ok(id)
    }

    pub(super) fn get(&self, id: i64) -> Option<Open> {
        self.lock().open.get(&id).cloned()
    }

    /// Notes that a connection reads a cursor.
    pub(super) fn touch(&self, id: i64, connection: i64) {
        let All { open, counts, .. } = &mut *self.lock();
        if let Some(open) = open.get_mut(&id) {
            if open.connection != connection {
                counts.remove(open.connection);
                counts.add(connection);
            }
            (open.connection, open.has_left, open.used) = (connection, false, Instant::now());
        }
    }

    /// Notes that a connection has ended: its cursors are there for others, as long as there is room for them.
    pub(super) fn leave(&self, connection: i64) {
        let mut cursors = self.lock();
        let own = cursors.open.values_mut().filter(|open| open.connection == connection);
        own.for_each(|open| open.has_left = true);
        while cursors.left() > MOST_LEFT && cursors.close_left() {}
    }

    /// Closes the cursors of a connection that has ended, so that its thread closes its files; says whether there was one.
    pub(super) fn close_connection_left(&self) -> bool {
        self.lock().close_connection_left()
    }

    /// Why a cursor that is not open cannot be read in `here`.
    pub(super) fn failure(&self, id: i64, here: &Origin) -> Failure {
        self.lock().ended.failure(id, here).unwrap_or_else(|| not_found(id))
    }

    pub(super) fn count(&self) -> usize {
        self.lock().open.len()
    }

    /// Removes a cursor; its thread frees it.
    pub(super) fn kill(&self, id: i64) -> bool {
        let mut cursors = self.lock();
        let (was_open, has_ended) = (cursors.close(id), cursors.ended.remove(|ended, _| ended == id));
        was_open || has_ended
    }

    /// Asks the thread of a cursor for its next documents. What is asked about a cursor that is closed already is dropped,
    /// which answers it. So whatever a thread is asked, it has received before it forgets its last cursor.
    pub(super) fn ask(&self, more: More) {
        let (mut cursors, id) = (self.lock(), more.cursor);
        let Some(Owner::Thread(mailbox)) = cursors.open.get(&id).map(|open| &open.owner) else { return };
        if !mailbox.send(ThreadMessage::More(more)) {
            cursors.remove(id);
        }
    }

    /// Forgets a cursor that its thread has let go of.
    pub(super) fn forget(&self, id: i64) {
        self.lock().remove(id);
    }

    /// Closes a cursor with its transaction.
    pub(super) fn end(&self, id: i64) {
        let mut cursors = self.lock();
        if let Some(open) = cursors.remove(id) {
            cursors.ended.add(id, open.origin);
        }
    }

    /// Kills the cursors that were opened where `is_meant` says.
    pub(super) fn kill_all(&self, is_meant: impl Fn(&Origin) -> bool) {
        let meant: Vec<i64> = {
            let mut cursors = self.lock();
            cursors.ended.remove(|_, origin| is_meant(origin));
            cursors.open.iter().filter(|(_, open)| is_meant(&open.origin)).map(|(id, _)| *id).collect()
        };
        for id in meant {
            self.kill(id);
        }
    }

    /// Closes the change streams that were not read since a time.
    pub(super) fn expire_streams(&self, is_old: impl Fn(Instant) -> bool) {
        let All { open, counts, .. } = &mut *self.lock();
        open.retain(|_, open| {
            let is_kept = match &open.owner {
                // One that is being read is in use.
                Owner::Stream(stream) => {
                    stream.try_lock().is_ok_and(|stream| !is_old(stream.used())) || is_locked(stream)
                }
                Owner::Thread(_) => true,
            };
            if !is_kept {
                counts.remove(open.connection);
            }
            is_kept
        });
    }

    fn lock(&self) -> MutexGuard<'_, All> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn is_locked(stream: &Mutex<Following>) -> bool {
    matches!(stream.try_lock(), Err(std::sync::TryLockError::WouldBlock))
}

/// A client cannot guess the number of another's cursor.
fn random() -> i64 {
    getrandom::u64().map_or_else(|_| i64::from(std::process::id()), u64::cast_signed)
}

pub(super) fn not_found(id: i64) -> Failure {
    Failure::new(codes::NO_CURSOR, format!("cursor id {id} not found"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cursors_of_connections_that_have_ended_make_room_the_oldest_first() {
        let cursors = Cursors::default();
        let inbox = super::super::mailbox::Inbox::new().unwrap();
        let open = |connection| {
            let ns = Namespace::parse("a.b").unwrap();
            cursors.open(Open::new(ns, Origin::default(), Owner::Thread(inbox.mailbox()), connection))
        };
        let of = |connection| (0..MOST_OF_ONE).map(|_| open(connection).unwrap()).collect::<Vec<_>>();
        let all: Vec<Vec<i64>> = (0..10).map(of).collect();
        assert!(open(0).unwrap_err().message.contains("of this connection"));
        assert!(open(10).is_err());
        cursors.leave(7);
        // Another connection reads this one.
        cursors.touch(all[7][0], 8);
        assert!(open(10).is_ok());
        assert!(
            cursors.get(all[7][0]).is_some() && cursors.get(all[7][1]).is_none() && cursors.get(all[7][2]).is_some()
        );
        assert!(matches!(inbox.take(), Some(ThreadMessage::Kill(id)) if id == all[7][1]));
        assert_eq!(cursors.count(), MOST);
        // Those that are closed or read by another connection do not count.
        assert!(open(8).is_err(), "it has one more than it opened");
        assert!(all[8].iter().take(2).all(|id| cursors.kill(*id)));
        assert!(open(8).is_ok() && open(8).is_err());
    }

    #[test]
    fn few_connections_that_have_ended_keep_cursors() {
        let cursors = Cursors::default();
        let inbox = super::super::mailbox::Inbox::new().unwrap();
        let most = i64::try_from(MOST_LEFT).unwrap();
        for connection in 0..=most {
            let ns = Namespace::parse("a.b").unwrap();
            cursors.open(Open::new(ns, Origin::default(), Owner::Thread(inbox.mailbox()), connection)).unwrap();
            cursors.leave(connection);
        }
        assert_eq!(cursors.count(), MOST_LEFT);
        assert!(matches!(inbox.take(), Some(ThreadMessage::Kill(_))));
    }

    #[test]
    fn files_are_given_back_by_the_connection_that_was_not_read_for_longest_and_has_ended() {
        let cursors = Cursors::default();
        let inbox = super::super::mailbox::Inbox::new().unwrap();
        let ns = || Namespace::parse("a.b").unwrap();
        let open = |connection| {
            let owner = Owner::Thread(inbox.mailbox());
            cursors.open(Open::new(ns(), Origin::default(), owner, connection)).unwrap()
        };
        let all = [1, 2, 1, 3, 2].map(open);
        assert!(!cursors.close_connection_left(), "none has ended");
        cursors.leave(2);
        cursors.leave(1);
        let open = || all.map(|id| cursors.get(id).is_some());
        assert!(cursors.close_connection_left());
        assert_eq!(open(), [false, true, false, true, true]);
        assert!(cursors.close_connection_left());
        assert_eq!(open(), [false, false, false, true, false]);
        assert!(!cursors.close_connection_left());
        let killed = std::iter::from_fn(|| inbox.take()).filter(|one| matches!(one, ThreadMessage::Kill(_)));
        assert_eq!(killed.count(), 4);
    }

    #[test]
    fn what_is_not_read_in_time_of_a_cursor_is_an_error_behind_what_is() {
        let results = |until| {
            let documents = (0..3).map(|n| Ok(bson::rawdoc! { "n": n }));
            let mut results = Results::new(Box::new(documents));
            results.settle(until);
            results
        };
        let count = |batch: RawArrayBuf| batch.into_iter().count();
        let mut all = results(Instant::now() + SETTLE_TIMEOUT);
        assert_eq!(all.batch(None).map(count).unwrap(), 3);
        let mut some = results(Instant::now());
        assert_eq!(some.batch(Some(1)).map(count).unwrap(), 1);
        let failure = some.batch(None).unwrap_err();
        assert!(failure.code == codes::FAILED && failure.message.contains("read it to its end"), "{failure:?}");
    }
}
