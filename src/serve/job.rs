//! The jobs of the writer, and the queue that they come through.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
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
