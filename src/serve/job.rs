//! The jobs of the writer, and the queue that they come through.

use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::Instant;

use super::call::Call;
use super::failure::{Answer, Failure, codes};
use super::mailbox::Reply;
use super::session::{Once, SessionId};
use super::snapshot::Snapshot;
use super::statements::Repeatable;
use crate::memory::Memory;
use crate::store::Namespace;

/// Whoever is first has a write: the writer, which begins it, or its client, which gives it up.
#[derive(Debug, Clone, Default)]
pub(super) struct Claim(Arc<AtomicBool>);

impl Claim {
    /// Takes it; says whether it was free.
    pub(super) fn take(&self) -> bool {
        !self.0.swap(true, Ordering::SeqCst)
    }
}

/// Something to be written.
pub(super) type Work = Box<dyn FnOnce(&Memory) -> Answer + Send>;

/// What the writer is given to do.
pub(super) enum Job {
    /// A write by itself.
    Write { ns: Namespace, once: Option<Repeatable>, work: Work, reply: Reply },
    /// A command of a transaction, or its end.
    Step(Step),
    /// Transactions end without their commit.
    Abandon(Abandoned),
    /// The server ends.
    Stop,
}

impl Job {
    /// Ends whatever transactions sessions have.
    pub(super) fn abandon(sessions: Vec<SessionId>) -> Self {
        Self::Abandon(Abandoned::Sessions(sessions))
    }

    /// Answers that it is not done.
    pub(super) fn refuse(self, failure: &Failure) {
        match self {
            Self::Write { reply, .. } | Self::Step(Step { reply, .. }) => reply.answer(Err(failure.clone())),
            Self::Abandon(_) | Self::Stop => {}
        }
    }
}

/// Which transactions end.
pub(super) enum Abandoned {
    /// All.
    All,
    /// Those of sessions, which have ended.
    Sessions(Vec<SessionId>),
    /// Those that a connection has begun, which is gone: later ones of the same sessions may be others'.
    Begun(Vec<Once>),
}

impl Abandoned {
    /// Whether a transaction is one of them.
    pub(super) fn includes(&self, once: &Once) -> bool {
        match self {
            Self::All => true,
            Self::Sessions(sessions) => sessions.contains(&once.session),
            Self::Begun(begun) => begun.contains(once),
        }
    }
}

/// A command of a transaction.
pub(super) struct Step {
    pub(super) once: Once,
    pub(super) action: Action,
    pub(super) reply: Reply,
    /// When it came.
    pub(super) since: Instant,
}

impl Step {
    /// Whether it begins a transaction.
    pub(super) fn is_first(&self) -> bool {
        matches!(self.action, Action::Run { starts: true, .. })
    }
}

/// What is to be done.
pub(super) enum Action {
    /// Runs a command; the first begins the transaction.
    Run {
        starts: bool,
        ns: Namespace,
        call: Arc<Call>,
        /// What it has read before its first write.
        snapshot: Option<Snapshot>,
    },
    Commit(Committer),
    Abort,
}

/// Who commits a transaction: what events of it name beside the session, the SHA-256 of the user's name.
pub(super) type Committer = [u8; 32];

/// Where the writer is given things to do, and whose turn it is to write.
pub(super) struct JobQueue {
    jobs: Sender<Job>,
    turn: Mutex<()>,
    /// The client that had something written last.
    last: AtomicI64,
}

/// No client.
const NO_CLIENT: i64 = 0;

impl JobQueue {
    /// Returns a queue, and where the writer takes jobs from it.
    pub(super) fn new() -> (Self, Receiver<Job>) {
        let (jobs, receiver) = channel();
        (Self { jobs, turn: Mutex::new(()), last: AtomicI64::new(NO_CLIENT) }, receiver)
    }

    pub(super) fn submit(&self, job: Job) -> Result<(), Failure> {
        self.submit_of(NO_CLIENT, job)
    }

    /// Submits a write of a client.
    pub(super) fn submit_of(&self, client: i64, job: Job) -> Result<(), Failure> {
        self.last.store(client, Ordering::SeqCst);
        self.jobs.send(job).map_err(|_| Failure::new(codes::SHUTDOWN, "the server is shutting down"))
    }

    /// Waits until no other thread writes.
    pub(super) fn turn(&self) -> Turn<'_> {
        self.turn.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The turn of a client that writes in its own thread, which saves two switches of threads: only where it was the last
    /// that wrote, so that what its thread keeps of the file is current. Hardly any other one waits then: one that comes
    /// between the two looks here has its turn next.
    pub(super) fn own_turn(&self, client: i64) -> Option<Turn<'_>> {
        if self.last.load(Ordering::SeqCst) != client {
            return None;
        }
        match self.turn.try_lock() {
            Ok(turn) => Some(turn),
            Err(TryLockError::Poisoned(turn)) => Some(turn.into_inner()),
            Err(TryLockError::WouldBlock) => None,
        }
    }
}

/// While it lives, no other thread writes.
pub(super) type Turn<'a> = MutexGuard<'a, ()>;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_client_has_its_own_turn_only_where_it_wrote_last_and_no_thread_writes() {
        let (queue, _jobs) = JobQueue::new();
        assert!(queue.own_turn(1).is_none());
        queue.submit_of(1, Job::Stop).unwrap();
        assert!(queue.own_turn(1).is_some() && queue.own_turn(2).is_none());
        let turn = queue.turn();
        assert!(queue.own_turn(1).is_none());
        drop(turn);
        queue.submit(Job::Stop).unwrap();
        assert!(queue.own_turn(1).is_none());
    }
}
