//! What the writer is given to do, and the queue that it is given it by.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Instant;

use super::call::Call;
use super::failure::{Answer, Failure, codes};
use super::mailbox::Reply;
use super::session::{Once, SessionId};
use super::snapshot::Snapshot;
use crate::memory::Memory;
use crate::store::Namespace;

/// Something to be written.
pub(super) type Work = Box<dyn FnOnce(&Memory) -> Answer + Send>;

/// What the writer is given to do.
pub(super) enum Job {
    /// A write by itself.
    Write { ns: Namespace, once: Option<Once>, work: Work, reply: Reply },
    /// A command of a transaction, or its end.
    Step(Step),
    /// Sessions, or all, or the connections that used them last, have ended.
    Abandon { sessions: Option<Vec<SessionId>> },
    /// The server ends.
    Stop,
}

impl Job {
    /// Ends the transactions of sessions: their connection is gone, or the client has ended them.
    pub(super) fn abandon(sessions: Vec<SessionId>) -> Self {
        Self::Abandon { sessions: Some(sessions) }
    }

    /// Ends all transactions.
    pub(super) fn abandon_all() -> Self {
        Self::Abandon { sessions: None }
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
    Commit,
    Abort,
}

/// Where the writer is given things to do.
pub(super) struct JobQueue(Sender<Job>);

impl JobQueue {
    /// Returns a queue, and where the writer takes jobs from it.
    pub(super) fn new() -> (Self, Receiver<Job>) {
        let (jobs, receiver) = channel();
        (Self(jobs), receiver)
    }

    pub(super) fn submit(&self, job: Job) -> Result<(), Failure> {
        self.0.send(job).map_err(|_| Failure::new(codes::SHUTDOWN, "the server is shutting down"))
    }
}
