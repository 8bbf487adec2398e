//! The one thread that writes: what many clients write at once is made durable once.
//!
//! While a write waits for the disk, others queue; the next write takes them all, each as a step that
//! fails alone, and is made durable by one sync. So the more clients write, the less each waits. A
//! transaction of several commands has the thread for itself until it ends. Where one client alone writes, it does so in
//! its own thread ([`super::write::alone`]), and this one waits for its turn.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

use super::age::LONGEST;
use super::failure::{Answer, Failure, codes};
use super::job::{Job, Work};
use super::lazy::Lazy;
use super::mailbox::Reply;
use super::panic;
use super::retry;
use super::server::{Server, thread};
use super::statements::Repeatable;
use super::transaction;
use super::write;
use super::writer_context::WriterContext;
use crate::memory::Memory;
use crate::store::Namespace;

/// At most so many writes are made durable at once …
const MOST: usize = 512;
/// … and none waits longer for others to be done than about so long.
const MAX_GROUP_DELAY: Duration = Duration::from_millis(20);
/// How often what is kept for change streams is looked after, and what is due removed.
const MAINTENANCE_INTERVAL: Duration = Duration::from_secs(15);
/// How long what a session did last is remembered: as long as MongoDB keeps a session that is not used.
const SESSION_TIMEOUT: Duration = Duration::from_secs(30 * 60);

/// Writes until the server ends.
pub(super) fn run(server: &Arc<Server>, jobs: &Receiver<Job>) {
    let mut waiting = VecDeque::new();
    loop {
        // After a mistake of rmem's own it is another one: the transaction of that may be open still.
        let memory = Lazy::of_writer(server);
        let mut context = WriterContext { server, jobs, waiting: &mut waiting, memory: &memory };
        if panic::passed(|| context.work()) {
            return;
        }
        server.sessions.set_open(None);
    }
}

impl WriterContext<'_> {
    fn work(&mut self) {
        let mut beat = Instant::now();
        loop {
            match self.next(MAINTENANCE_INTERVAL.saturating_sub(beat.elapsed())) {
                Some(Job::Stop) => return self.fold(),
                Some(job) => self.perform(job),
                None => {}
            }
            if beat.elapsed() >= MAINTENANCE_INTERVAL {
                beat = Instant::now();
                self.look_after();
            }
        }
    }

    /// Brings what was acknowledged into a file that has been moved: its log stays at its old name.
    fn fold(&self) {
        if self.server.check_files().is_err()
            && let Some(memory) = self.memory.opened()
        {
            // What clients still read keeps a part from it; then it is tried again at the end.
            let _ = memory.fold();
        }
    }

    fn perform(&mut self, job: Job) {
        let server = self.server;
        let _turn = server.writer.turn();
        if let Err(moved) = self.server.check_files() {
            self.fold();
            return job.refuse(&moved.into());
        }
        match job {
            Job::Write { ns, once, work, reply } => self.group(Write { ns, once, work, reply }),
            Job::Step(step) => transaction::run(self, step),
            // Nothing is open: a transaction has the thread for itself.
            Job::Abandon(_) | Job::Stop => {}
        }
    }

    /// Does a write and all that wait with it.
    fn group(&mut self, first: Write) {
        let (ns, since) = (first.ns.clone(), Instant::now());
        let mut answers: Vec<(Reply, Answer)> = Vec::new();
        let mut next = Some(first);
        let writing = self.server.clock.begin_write();
        let done = self.memory.get().and_then(|memory| {
            let is_shared = memory.is_shared(&ns);
            let work = &mut || {
                while let Some(Write { ns, once, work, reply }) = next.take() {
                    answers.push((reply, write::step(self.server, memory, &ns, once, work)));
                    let has_time = answers.len() < MOST && since.elapsed() < MAX_GROUP_DELAY;
                    // On a full disk all of the group is lost; those that wait are not drawn into that.
                    if has_time && !memory.is_rolled_back(&ns) {
                        next = self.companion(memory, is_shared);
                    }
                }
                Ok(())
            };
            memory.as_one(&ns, work)?;
            Ok(self.server.check_files()?)
        });
        if let Some(write) = next {
            // It could not even begin.
            answers.push((write.reply, Err(Failure::new(codes::FAILED, "nothing was written"))));
        }
        drop(writing);
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

    /// Lets go of what is too old.
    fn look_after(&mut self) {
        if self.server.pool.has_cold(Instant::now()) {
            // To close many takes longer than a write should wait.
            let server = Arc::clone(self.server);
            let _ = thread("pool").spawn(move || server.pool.tidy(Instant::now()));
        }
        self.server.sessions.forget(SESSION_TIMEOUT);
        self.server.behind.forget(SESSION_TIMEOUT);
        if self.server.check_files().is_err() {
            return self.fold();
        }
        let Ok(memory) = self.memory.get() else { return };
        // What cannot be done now is done at the next beat.
        let _ = self.server.scopes.look_after(memory, &self.server.ages);
        if !self.server.options.read_only {
            let _ = retry::sweep(memory, self.server.ages.ago(LONGEST));
            let _ = memory.expire_due();
        }
        self.server.expire_streams();
    }
}

struct Write {
    ns: Namespace,
    once: Option<Repeatable>,
    work: Work,
    reply: Reply,
}
