//! Which transactions have a thread with a snapshot of their own, and what such a thread is asked.

use std::collections::{HashMap, HashSet};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::call::Call;
use super::failure::Failure;
use super::mailbox::Reply;
use super::session::{Once, SessionId, superseded};

/// How long the writer waits for the answer whether a snapshot is current.
const CHECK_TIMEOUT: Duration = Duration::from_secs(2);

/// What a thread is asked.
pub(super) enum Ask {
    Run {
        call: Arc<Call>,
        reply: Reply,
    },
    /// Reads cursors to their end, and lets the writer do everything else: the snapshot is going to end.
    Settle(Reply),
    /// Ends the snapshot, and says whether nothing was written since it began.
    IsCurrent(Sender<bool>),
}

/// The snapshot of a transaction that wants to write.
pub(super) struct Snapshot(Sender<Ask>);

impl Snapshot {
    /// Ends it, and says whether nothing was written since it began.
    pub(super) fn end(self) -> bool {
        let (reply, answer) = channel();
        self.0.send(Ask::IsCurrent(reply)).is_ok() && answer.recv_timeout(CHECK_TIMEOUT).unwrap_or(false)
    }
}

/// A transaction that has a thread.
pub(super) struct Reading {
    pub(super) number: i64,
    pub(super) asks: Sender<Ask>,
    /// The cursors that the thread has, once everything else is done by the writer.
    pub(super) moved: Option<HashSet<i64>>,
}

/// The transactions that have a thread, by their sessions.
#[derive(Default)]
pub(super) struct Readings(Mutex<HashMap<SessionId, Reading>>);

impl Readings {
    /// Ends those of sessions.
    pub(super) fn end_all(&self, is_meant: impl Fn(&SessionId) -> bool) {
        self.lock().retain(|session, _| !is_meant(session));
    }

    /// Ends the transaction of a session, where it has a number below this one.
    pub(super) fn end_before(&self, once: &Once) {
        let mut readings = self.lock();
        if readings.get(&once.session).is_some_and(|reading| reading.number < once.number) {
            readings.remove(&once.session);
        }
    }

    /// Ends a transaction; says whether it has only read.
    pub(super) fn end(&self, once: &Once) -> bool {
        let mut readings = self.lock();
        match readings.get(&once.session) {
            Some(reading) if reading.number == once.number => {
                readings.remove(&once.session).is_some_and(|reading| reading.moved.is_none())
            }
            _ => false,
        }
    }

    /// The number of a later transaction of the session that has a thread.
    pub(super) fn later(&self, once: &Once) -> Option<i64> {
        let number = self.lock().get(&once.session)?.number;
        (number > once.number).then_some(number)
    }

    /// Whether a transaction has a thread.
    pub(super) fn has(&self, once: &Once) -> bool {
        self.lock().get(&once.session).is_some_and(|reading| reading.number == once.number)
    }

    /// Whether the thread of a transaction has a cursor, though the writer does everything else.
    pub(super) fn keeps_cursor(&self, once: &Once, cursor: i64) -> bool {
        let readings = self.lock();
        let moved = readings.get(&once.session).filter(|reading| reading.number == once.number);
        moved.and_then(|reading| reading.moved.as_ref()).is_some_and(|cursors| cursors.contains(&cursor))
    }

    /// Asks the thread of a transaction that has only read; where there is none, says so.
    pub(super) fn ask(&self, once: &Once, ask: Ask) -> Result<bool, Failure> {
        let readings = self.lock();
        match readings.get(&once.session) {
            Some(reading) if reading.number > once.number => Err(superseded(once, reading.number)),
            Some(reading) if reading.number == once.number && reading.moved.is_none() => {
                // The lock is held: a thread that ends answers what it was asked before.
                Ok(reading.asks.send(ask).is_ok())
            }
            _ => Ok(false),
        }
    }

    /// Lets the writer do what a transaction does, but for reading these cursors.
    pub(super) fn hand_over(&self, once: &Once, cursors: HashSet<i64>) {
        let mut readings = self.lock();
        let reading = readings.get_mut(&once.session).filter(|reading| reading.number == once.number);
        reading.into_iter().for_each(|reading| reading.moved = Some(cursors.clone()));
    }

    /// The snapshot of a transaction that the writer is to go on with.
    pub(super) fn snapshot(&self, once: &Once) -> Option<Snapshot> {
        let readings = self.lock();
        let moved = readings.get(&once.session).filter(|reading| reading.number == once.number);
        moved.filter(|reading| reading.moved.is_some()).map(|reading| Snapshot(reading.asks.clone()))
    }

    pub(super) fn lock(&self) -> MutexGuard<'_, HashMap<SessionId, Reading>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
