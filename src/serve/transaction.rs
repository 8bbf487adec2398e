//! Transactions that write: the writer's thread belongs to one from its first write until it ends.
//!
//! All its commands see what it saw at first and what it wrote; others see nothing of it before it is
//! committed, and wait with their writes. Where a command fails, or it takes too long, nothing of it
//! was done.

use std::sync::Arc;
use std::time::{Duration, Instant};

use bson::spec::BinarySubtype;
use bson::{Binary, Timestamp};

use super::call::Call;
use super::changes::Joined;
use super::command;
use super::failure::{Answer, Failure, TRANSIENT, codes};
use super::host::{self, Host};
use super::job::{Action, Committer, Job, Step};
use super::mailbox::{Inbox, Reply};
use super::panic;
use super::retry;
use super::server::Server;
use super::session::{Finished, How, Once, TRANSACTION_LIMIT, none, started, superseded};
use super::snapshot::Snapshot;
use super::write;
use super::writer_context::WriterContext;
use crate::memory::Memory;
use crate::store::{Namespace, StoreError};

/// How long the first command of a transaction waits for one that is open.
const BEGIN_TIMEOUT: Duration = Duration::from_secs(5);
/// How often a transaction that waits checks whether it has waited long enough.
const POLL_INTERVAL: Duration = Duration::from_millis(200);

/// Does a step where no transaction is open: the first of one, or one that comes too late.
pub(super) fn run(context: &mut WriterContext<'_>, step: Step) {
    let last = match last(context, &step) {
        Ok(last) => last,
        Err(failure) => return step.reply.answer(Err(failure)),
    };
    match step.action {
        Action::Run { starts: true, ns, call, snapshot } if last.is_none_or(|last| last.number < step.once.number) => {
            let first = First { call, snapshot, reply: step.reply };
            Open { once: step.once, until: Instant::now() + TRANSACTION_LIMIT }.live(context, ns, first);
        }
        action => step.reply.answer(late(&step.once, &action, last)),
    }
}

/// What the session of a step did last: where this process does not know, what is kept of it.
fn last(context: &WriterContext<'_>, step: &Step) -> Result<Option<Finished>, Failure> {
    match context.server.sessions.last(&step.once.session) {
        None => retry::last(context.memory.get()?, &step.once.session),
        last => Ok(last),
    }
}

/// The answer to a step of a transaction that is not open.
fn late(once: &Once, action: &Action, last: Option<Finished>) -> Answer {
    let last = last.filter(|last| last.number >= once.number);
    let is_committed = match last {
        Some(last) if last.number > once.number => return Err(superseded(once, last.number)),
        Some(_) if matches!(action, Action::Run { starts: true, .. }) => return Err(started(once)),
        Some(last) => last.how == How::Committed,
        None => false,
    };
    match (action, is_committed) {
        (Action::Commit(_), true) => host::empty(),
        (Action::Run { .. } | Action::Abort, true) => {
            Err(Failure::new(codes::COMMITTED, format!("Transaction {} has been committed.", once.number)))
        }
        (_, false) => Err(none(once)),
    }
}

/// Refuses transactions that have waited too long for another one that is open: whoever began both, one
/// after the other, would wait for himself.
fn refuse_overdue(context: &mut WriterContext<'_>) {
    let has_waited = |job: &mut Job| matches!(job, Job::Step(step) if step.since.elapsed() >= BEGIN_TIMEOUT);
    while let Some(index) = context.waiting.iter_mut().position(has_waited) {
        if let Some(Job::Step(step)) = context.waiting.remove(index) {
            let message = "another transaction is open, and one is at a time; try again";
            step.reply.answer(Err(Failure::new(codes::WRITE_CONFLICT, message).labeled(TRANSIENT)));
        }
    }
}

/// A transaction that is open.
struct Open {
    once: Once,
    until: Instant,
}

/// What the writer does first of a transaction.
struct First {
    call: Arc<Call>,
    /// What was read before.
    snapshot: Option<Snapshot>,
    reply: Reply,
}

/// How a transaction came to its end.
enum End {
    Commit(Reply, Committer),
    /// Nothing of it is kept; the client gets an error.
    Abort(Option<Reply>),
    /// It was to write, and something was written since it began to read.
    Conflict,
    /// Nothing of it is kept, and another job of the session comes next.
    Superseded(Job),
}

impl Open {
    /// Runs the transaction from its first command to its end.
    fn live(self, context: &mut WriterContext<'_>, ns: Namespace, first: First) {
        context.server.sessions.set_open(Some(self.once.clone()));
        let memory = context.memory.get();
        let (mut first, mut end, mut time, mut writing) = (Some(first), None, None, None);
        let kept = memory.and_then(|memory| {
            let work = &mut || {
                let Some(first) = first.take() else { return Ok(()) };
                let ended = self.steps(context, memory, &ns, first);
                let committer = match &ended {
                    End::Commit(_, committer) => Some(*committer),
                    _ => None,
                };
                end = Some(ended);
                // From here on its changes have their time.
                writing = Some(context.server.clock.begin_write());
                time = self.note(context.server, memory, &ns, committer.ok_or_else(|| undone(memory))?)?;
                Ok(())
            };
            memory.as_one(&ns, work)?;
            Ok(context.server.check_files()?)
        });
        let how = match &end {
            Some(End::Conflict) => How::Conflicted,
            _ if kept.is_ok() => How::Committed,
            _ => How::Aborted,
        };
        drop(writing);
        let failure = kept.err();
        let time = context.server.clock.wrote(time);
        let finished = Finished { number: self.once.number, how, at: Instant::now() };
        context.server.sessions.finish(&self.once.session, finished);
        context.server.sessions.set_open(None);
        match end {
            Some(End::Commit(reply, _)) => {
                let done = host::empty().map(|done| write::at(done, time));
                reply.answer(failure.clone().map_or(done, Err));
            }
            Some(End::Abort(Some(reply))) => reply.answer(host::empty()),
            Some(End::Abort(None) | End::Conflict) => {}
            Some(End::Superseded(job)) => context.waiting.push_front(job),
            None => {}
        }
        if let Some(First { reply, .. }) = first {
            // It could not even begin.
            reply.answer(Err(failure.unwrap_or_else(|| none(&self.once))));
        }
        context.server.hub.call();
    }

    /// Notes, in the transaction, that it was committed, and which changes are its own; returns their time.
    fn note(
        &self,
        server: &Server,
        memory: &Memory,
        ns: &Namespace,
        committer: Committer,
    ) -> Result<Option<Timestamp>, StoreError> {
        let kept = retry::keep_committed(memory, &self.once);
        kept.map_err(|failure| StoreError::Failed { address: memory.describe(), reason: failure.message })?;
        let store = memory.bare(ns)?;
        let Some(noted) = store.join_changes()? else { return Ok(None) };
        let time = write::time_of(server, store, Some(noted))?;
        let mut lsid = self.once.session.to_document();
        lsid.insert("uid", Binary { subtype: BinarySubtype::Generic, bytes: committer.to_vec() });
        Joined::new(noted, lsid, self.once.number).keep(memory, &ns.database)?;
        Ok(time)
    }

    fn steps(&self, context: &mut WriterContext<'_>, memory: &Memory, ns: &Namespace, first: First) -> End {
        let First { call, snapshot, reply } = first;
        if snapshot.is_some_and(|snapshot| !snapshot.end()) {
            let message = "something was written since the transaction began to read; begin it again";
            reply.answer(Err(Failure::new(codes::WRITE_CONFLICT, message).labeled(TRANSIENT)));
            return End::Conflict;
        }
        let inbox = match context.server.with_files(Inbox::new) {
            Ok(inbox) => inbox,
            Err(failure) => {
                reply.answer(Err(failure));
                return End::Abort(None);
            }
        };
        let mut host = Host::new(context.server, context.server.next_id(), context.memory, &inbox, true);
        let mut failed = perform(&mut host, memory, ns, ns, &call, reply);
        let end = loop {
            if failed {
                break End::Abort(None);
            }
            refuse_overdue(context);
            let left = self.until.saturating_duration_since(Instant::now());
            match context.arriving(left.min(POLL_INTERVAL)) {
                None if left.is_zero() => break End::Abort(None),
                None => host.handle_messages(),
                Some(Job::Step(step)) if step.once == self.once => match step.action {
                    Action::Commit(committer) => break End::Commit(step.reply, committer),
                    Action::Abort => break End::Abort(Some(step.reply)),
                    Action::Run { starts: true, .. } => {
                        step.reply.answer(Err(started(&self.once)));
                    }
                    Action::Run { ns: other, call, .. } => {
                        failed = perform(&mut host, memory, ns, &other, &call, step.reply);
                    }
                },
                Some(Job::Abandon(abandoned)) if abandoned.includes(&self.once) => break End::Abort(None),
                Some(Job::Abandon(abandoned)) => context.abandon(&abandoned),
                Some(Job::Step(step)) if self.is_late(&step) => {
                    let last = context.server.sessions.last(&step.once.session);
                    let is_older = step.once.session == self.once.session && step.once.number < self.once.number;
                    step.reply.answer(match is_older {
                        true => Err(superseded(&step.once, self.once.number)),
                        false => late(&step.once, &step.action, last),
                    });
                }
                Some(job) if self.is_superseded(&job) => break End::Superseded(job),
                Some(Job::Stop) => {
                    context.waiting.push_back(Job::Stop);
                    break End::Abort(None);
                }
                Some(job) => context.waiting.push_back(job),
            }
        };
        host.end_all();
        end
    }

    /// Whether a step can be of no transaction that is to come: its answer does not have to wait.
    fn is_late(&self, step: &Step) -> bool {
        let is_older = step.once.session == self.once.session && step.once.number < self.once.number;
        is_older || !step.is_first()
    }

    /// Whether a job begins something later in the session, without an end of this transaction.
    fn is_superseded(&self, job: &Job) -> bool {
        let once = match job {
            Job::Step(step) => Some(&step.once).filter(|_| step.is_first()),
            Job::Write { once, .. } => once.as_ref().map(|repeatable| &repeatable.once),
            Job::Abandon(_) | Job::Stop => None,
        };
        once.is_some_and(|once| once.session == self.once.session && once.number > self.once.number)
    }
}

/// Runs a command of a transaction that began in the store of `home`; says whether it failed.
fn perform(host: &mut Host<'_>, memory: &Memory, home: &Namespace, ns: &Namespace, call: &Call, reply: Reply) -> bool {
    let answer = match memory.is_shared(home) == memory.is_shared(ns) {
        true => panic::caught(|| command::inside(host, call)),
        false => {
            let message = format!("{ns} is in another store than {home}, and a transaction does not leave its store");
            Err(Failure::new(codes::NOT_IN_TRANSACTION, message))
        }
    };
    // A statement that failed among others fails the transaction, too.
    let failed = answer.as_ref().map_or(true, |reply| matches!(reply.get("writeErrors"), Ok(Some(_)) | Err(_)));
    reply.answer(answer);
    failed
}

fn undone(memory: &Memory) -> StoreError {
    StoreError::Failed { address: memory.describe(), reason: "the transaction was aborted".to_owned() }
}
