//! The one thread that writes: what many clients write at once is made durable once.
//!
//! While a write waits for the disk, others queue; the next write takes them all, each as a step that
//! fails alone, and is made durable by one sync. So the more clients write, the less each waits. A
//! transaction of several commands has the thread for itself until it ends.

use std::collections::{HashMap, VecDeque};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use super::failure::{Answer, Failure, codes};
use super::host::Lazy;
use super::mailbox::Mailbox;
use super::panic;
use super::retry;
use super::server::Server;
use super::session::SessionId;
use super::transaction::{self, Finished, Step};
use crate::memory::Memory;
use crate::store::{Namespace, StoreError};

/// At most so many writes are made durable at once …
const MOST: usize = 512;
/// … and none waits longer for others to be done than about so long.
const LONGEST: Duration = Duration::from_millis(20);
/// How often what is kept for change streams is looked after.
const BEAT: Duration = Duration::from_secs(15);
/// How long what a session did last is remembered.
const MEMORY: Duration = Duration::from_secs(30 * 60);

/// Something to be written.
pub(super) type Work = Box<dyn FnOnce(&Memory) -> Answer + Send>;

/// A write that is done once, however often it is sent: the session and its number.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Once {
    pub(super) session: SessionId,
    pub(super) number: i64,
}

/// What the writer is given to do.
pub(super) enum Job {
    /// A write by itself.
    Write { ns: Namespace, once: Option<Once>, work: Work, reply: Mailbox },
    /// A command of a transaction, or its end.
    Step(Step),
    /// Sessions, or all, or the connections that used them last, have ended.
    Abandon { sessions: Option<Vec<SessionId>> },
    /// The server ends.
    Stop,
}

/// Where the writer is given things to do.
pub(super) struct Writer {
    jobs: Sender<Job>,
    over: AtomicBool,
}

impl Writer {
    /// A writer that does not run yet, and what it is to be run with.
    pub(super) fn new() -> (Self, Receiver<Job>) {
        let (jobs, receiver) = channel();
        (Self { jobs, over: AtomicBool::new(false) }, receiver)
    }

    pub(super) fn submit(&self, job: Job) -> Result<(), Failure> {
        self.jobs.send(job).map_err(|_| Failure::new(codes::SHUTDOWN, "the server is shutting down"))
    }

    pub(super) fn is_over(&self) -> bool {
        self.over.load(Ordering::SeqCst)
    }
}

/// Writes until the server ends.
pub(super) fn run(server: &Arc<Server>, jobs: Receiver<Job>) {
    let memory = Lazy::new(server);
    let mut desk = Desk { server, jobs, waiting: VecDeque::new(), memory: &memory, finished: HashMap::new() };
    let mut beat = Instant::now();
    loop {
        match desk.next(BEAT.saturating_sub(beat.elapsed())) {
            Some(Job::Stop) => break,
            Some(job) => desk.perform(job),
            None => {}
        }
        if beat.elapsed() >= BEAT {
            beat = Instant::now();
            desk.look_after();
        }
    }
    server.writer.over.store(true, Ordering::SeqCst);
}

/// What the writer works with.
pub(super) struct Desk<'d> {
    pub(super) server: &'d Arc<Server>,
    jobs: Receiver<Job>,
    /// Jobs that came while others were done.
    pub(super) waiting: VecDeque<Job>,
    pub(super) memory: &'d Lazy,
    /// What each session did last.
    pub(super) finished: HashMap<SessionId, Finished>,
}

impl Desk<'_> {
    /// The next job, those that waited first.
    fn next(&mut self, limit: Duration) -> Option<Job> {
        self.waiting.pop_front().or_else(|| self.arriving(limit))
    }

    /// The next job that comes.
    pub(super) fn arriving(&mut self, limit: Duration) -> Option<Job> {
        match self.jobs.recv_timeout(limit) {
            Ok(job) => Some(job),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => Some(Job::Stop),
        }
    }

    fn perform(&mut self, job: Job) {
        match job {
            Job::Write { ns, once, work, reply } => self.group(Write { ns, once, work, reply }),
            Job::Step(step) => transaction::run(self, step),
            // Nothing is open: a transaction has the thread for itself.
            Job::Abandon { .. } | Job::Stop => {}
        }
    }

    /// Does a write and all that wait with it.
    fn group(&mut self, first: Write) {
        let (ns, since) = (first.ns.clone(), Instant::now());
        let mut answers: Vec<(Mailbox, Answer)> = Vec::new();
        let mut next = Some(first);
        let done = self.memory.get().and_then(|memory| {
            let is_shared = memory.is_shared(&ns);
            let work = &mut || {
                while let Some(write) = next.take() {
                    answers.push((write.reply.clone(), self.step(memory, write)));
                    if answers.len() < MOST && since.elapsed() < LONGEST {
                        next = self.companion(memory, is_shared);
                    }
                }
                Ok(())
            };
            memory.as_one(&ns, work).map_err(Failure::from)
        });
        if let Some(write) = next {
            // It could not even begin.
            answers.push((write.reply, Err(Failure::new(codes::FAILED, "nothing was written"))));
        }
        for (reply, answer) in answers {
            reply.answer(done.clone().and(answer));
        }
        self.server.hub.call();
    }

    /// A write of the same store that waits.
    fn companion(&mut self, memory: &Memory, is_shared: bool) -> Option<Write> {
        let job = self.waiting.pop_front().or_else(|| self.jobs.try_recv().ok())?;
        match job {
            Job::Write { ns, once, work, reply } if memory.is_shared(&ns) == is_shared => {
                Some(Write { ns, once, work, reply })
            }
            other => {
                self.waiting.push_front(other);
                None
            }
        }
    }

    /// One write of several: where it fails, it has done nothing.
    fn step(&mut self, memory: &Memory, write: Write) -> Answer {
        let Write { ns, once, work, .. } = write;
        if let Some(once) = &once
            && let Some(answer) = retry::recall(memory, &ns, once, &self.finished)?
        {
            return Ok(answer);
        }
        let answer = attempt(memory, &ns, |memory| {
            let answer = panic::caught(|| work(memory))?;
            once.iter().try_for_each(|once| retry::keep(memory, &ns, once, &answer))?;
            Ok(answer)
        })?;
        if let Some(Once { session, number }) = once {
            self.finished.insert(session, Finished::write(number));
        }
        Ok(answer)
    }

    /// Lets go of what is too old.
    fn look_after(&mut self) {
        self.finished.retain(|_, finished| finished.at.elapsed() < MEMORY);
        let Ok(memory) = self.memory.get() else { return };
        // What cannot be done now is done at the next beat.
        let _ = self.server.scopes.look_after(memory);
        if !self.server.options.read_only {
            let _ = retry::sweep(memory);
        }
        self.server.expire_streams();
    }
}

struct Write {
    ns: Namespace,
    once: Option<Once>,
    work: Work,
    reply: Mailbox,
}

/// Does something that, where it fails, has done nothing.
pub(super) fn attempt(memory: &Memory, ns: &Namespace, work: impl FnOnce(&Memory) -> Answer) -> Answer {
    let (mut work, mut answer) = (Some(work), None);
    let kept = memory.as_one(ns, &mut || {
        answer = work.take().map(|work| work(memory));
        match &answer {
            Some(Ok(_)) => Ok(()),
            // It only says that nothing is to be kept.
            _ => Err(StoreError::Failed { address: memory.describe(), reason: "nothing was done".to_owned() }),
        }
    });
    match (kept, answer) {
        (Ok(()), Some(answer)) | (Err(_), Some(answer @ Err(_))) => answer,
        (Err(error), _) => Err(error.into()),
        (Ok(()), None) => Err(Failure::new(codes::INTERNAL, "nothing was done")),
    }
}
