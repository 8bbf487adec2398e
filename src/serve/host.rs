//! A thread with a memory and the cursors it reads: where commands are run.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;
use std::time::{Duration, Instant};

use bson::RawDocumentBuf;

use super::clock;
use super::cursor::{self, Open, Owner, Results, SETTLE_TIMEOUT};
use super::failure::{Answer, Failure, codes};
use super::job::{Claim, Job, Work};
use super::lazy::Lazy;
use super::mailbox::{Inbox, More, Question, Reply, ThreadMessage};
use super::origin::Origin;
use super::request::interrupted;
use super::server::Server;
use super::statements::Repeatable;
use super::write::{self, at};
use crate::deadline::{self, Deadline, Limits};
use crate::memory::Memory;
use crate::store::{Documents, Namespace};

/// How often a thread that has cursors looks for those that are too old. Cursors live for minutes.
pub(super) const EXPIRY_INTERVAL: Duration = Duration::from_secs(10);

/// How often a thread that waits for another looks whether its operation is to end.
const STOP_INTERVAL: Duration = Duration::from_millis(200);

/// A thread with its memory and cursors.
pub(super) struct Host<'m> {
    pub(super) server: Arc<Server>,
    /// The number of its connection, or of its own where it has none.
    pub(super) id: i64,
    memory: &'m Lazy,
    cursors: HashMap<i64, Results<'m>>,
    /// Whether it has had cursors, so that others may have asked for the next documents of one.
    has_had_cursors: bool,
    pub(super) inbox: &'m Inbox,
    /// Whether what it writes is written at once: within a transaction, by the writer itself.
    writes_itself: bool,
}

impl<'m> Host<'m> {
    pub(super) fn new(server: &Arc<Server>, id: i64, memory: &'m Lazy, inbox: &'m Inbox, writes_itself: bool) -> Self {
        let (server, cursors) = (Arc::clone(server), HashMap::new());
        Self { server, id, memory, cursors, has_had_cursors: false, inbox, writes_itself }
    }

    pub(super) fn memory(&self) -> Result<&'m Memory, Failure> {
        self.memory.get()
    }

    /// Frees what is kept of what was read, while the connection is idle.
    pub(super) fn free_caches(&self) {
        if let Some(memory) = self.memory.opened() {
            memory.free_caches();
        }
    }

    pub(super) fn has_cursors(&self) -> bool {
        !self.cursors.is_empty()
    }

    /// Has something written: by the writer, with what others write, or at once where no others do. It is not begun any
    /// more when it is to end.
    pub(super) fn write(&mut self, ns: Namespace, once: Option<Repeatable>, limits: Limits, work: Work) -> Answer {
        let memory = self.memory()?;
        if self.writes_itself || !memory.is_current(&ns)? {
            let _deadline = Deadline::set(limits);
            return match &once {
                Some(once) => self.server.behind.once(once, || work(memory)),
                None => work(memory),
            };
        }
        // A snapshot that a cursor reads cannot be written to.
        if limits.until.is_none()
            && !self.has_cursors()
            && let Some(_turn) = self.server.writer.own_turn(self.id)
        {
            let work = |memory: &Memory| {
                let _deadline = Deadline::set(limits);
                work(memory)
            };
            let _none = Deadline::set(Limits::default());
            return write::alone(&self.server, memory, &ns, once, work);
        }
        let claim = Claim::default();
        let (begun, own) = (claim.clone(), limits.clone());
        let work: Work = Box::new(move |memory| {
            if let Some(ending) = own.ending() {
                return Err(interrupted(ending));
            }
            if !begun.take() {
                return Err(Failure::new(codes::FAILED, "the write was given up"));
            }
            let _deadline = Deadline::set(own);
            work(memory)
        });
        let (question, reply) = self.question();
        self.server.writer.submit_of(self.id, Job::Write { ns, once, work, reply })?;
        self.wait_until(question, Some((limits, Some(claim))))
    }

    /// Writes in slices, between which others write, in this thread, as another process would.
    pub(super) fn write_in_slices(
        &mut self,
        ns: &Namespace,
        limits: Limits,
        work: impl FnOnce(&Memory) -> Answer,
    ) -> Answer {
        if self.writes_itself || !self.memory()?.is_current(ns)? {
            return work(self.memory()?);
        }
        // It has its turn behind what waits already, and behind a transaction that is open.
        self.write(ns.clone(), None, limits, Box::new(|_| empty()))?;
        // A snapshot that a cursor reads cannot be written to.
        let other = Lazy::aside(&self.server);
        let memory = if self.has_cursors() { other.get()? } else { self.memory()? };
        let before = memory.bare(ns)?.committed_changes()?;
        let answer = work(memory);
        // A change stream from the time of the answer begins with the last of its changes.
        let last =
            memory.bare(ns)?.committed_changes()?.filter(|last| before.is_none_or(|before| before.last < last.last));
        let time = self.server.clock.wrote(last.map(|last| clock::of(last.time, last.last)));
        self.server.check_files()?;
        self.server.hub.call();
        answer.map(|reply| at(reply, time))
    }

    /// Gives the writer something to do and waits for its answer.
    pub(super) fn submit(&mut self, job: impl FnOnce(Reply) -> Job) -> Answer {
        let (question, reply) = self.question();
        self.server.writer.submit(job(reply))?;
        self.wait(question)
    }

    /// A question to the writer.
    fn question(&self) -> (Question, Reply) {
        self.inbox.question(Failure::new(codes::SHUTDOWN, "the server is shutting down"))
    }

    /// Waits for the answer to a question, answering messages meanwhile.
    pub(super) fn wait(&mut self, question: Question) -> Answer {
        self.wait_until(question, None)
    }

    /// The same; the answer is given up where the operation is to end, but not that of a write which has begun.
    fn wait_until(&mut self, question: Question, mut limit: Option<(Limits, Option<Claim>)>) -> Answer {
        loop {
            let timeout = limit.as_ref().map_or(EXPIRY_INTERVAL, |(limits, _)| {
                let left = limits.until.map(|until| until.saturating_duration_since(Instant::now()));
                left.map_or(STOP_INTERVAL, |left| left.min(STOP_INTERVAL))
            });
            match self.server.turns.paused(|| self.inbox.receive(timeout)) {
                Some(ThreadMessage::Answer(number, answer)) if question.is(number) => return answer,
                Some(message) => self.handle(message),
                None => self.expire(),
            }
            let ending = limit.as_ref().and_then(|(limits, _)| limits.ending());
            if let Some(ending) = ending
                && let Some((_, claim)) = limit.take()
                && claim.is_none_or(|claim| claim.take())
            {
                return Err(interrupted(ending));
            }
        }
    }

    /// Answers messages that are there.
    pub(super) fn handle_messages(&mut self) {
        self.inbox.clear_wakeup();
        while let Some(message) = self.inbox.take() {
            self.handle(message);
        }
    }

    /// Answers what was asked about cursors that are closed since. Behind its last command: a connection without cursors
    /// waits for its client alone.
    pub(super) fn answer_late(&mut self) {
        // What is left in the wakeup pipe wakes it once more than needed.
        while self.has_had_cursors
            && let Some(message) = self.inbox.take()
        {
            self.handle(message);
        }
    }

    pub(super) fn handle(&mut self, message: ThreadMessage) {
        match message {
            // Answers that are not awaited any more.
            ThreadMessage::Answer(..) => {}
            ThreadMessage::Kill(cursor) => drop(self.cursors.remove(&cursor)),
            ThreadMessage::More(more) => {
                let _deadline = Deadline::set(more.limits);
                let answer = self.own(more.cursor, more.batch);
                more.to.answer(answer.unwrap_or_else(|| Err(cursor::not_found(more.cursor))));
            }
        }
    }

    /// The first batch of an answer; the rest becomes a cursor.
    pub(super) fn answer(
        &mut self,
        ns: &Namespace,
        origin: Origin,
        documents: Documents<'m>,
        batch: FirstBatch,
    ) -> Answer {
        let mut results = Results::new(documents);
        let first = results.batch(Some(cursor::first_batch(batch.size)))?;
        if batch.is_only || results.is_over() {
            return Ok(cursor::reply(0, &ns.to_string(), &first, true));
        }
        results.never_expires = batch.never_expires;
        results.collection = self.memory()?.number(ns)?;
        self.has_had_cursors = true;
        let owner = Owner::Thread(self.inbox.mailbox());
        let id = self.server.cursors.open(Open::new(ns.clone(), origin, owner, self.id))?;
        self.cursors.insert(id, results);
        Ok(cursor::reply(id, &ns.to_string(), &first, true))
    }

    /// The next documents of a cursor, whoever has it.
    pub(super) fn more(&mut self, cursor: i64, batch: Option<u64>) -> Answer {
        let limits = deadline::limits();
        if let Some(answer) = self.own(cursor, batch) {
            return answer;
        }
        if self.writes_itself {
            return Err(cursor::not_found(cursor));
        }
        let (question, to) = self.inbox.question(cursor::not_found(cursor));
        self.server.cursors.ask(More { cursor, batch, limits: limits.clone(), to });
        self.wait_until(question, Some((limits, None)))
    }

    fn own(&mut self, cursor: i64, batch: Option<u64>) -> Option<Answer> {
        let results = self.cursors.get_mut(&cursor)?;
        let next = results.batch(batch.filter(|size| *size > 0));
        let (is_over, collection) = (next.is_err() || results.is_over(), results.collection);
        let ns = self.server.cursors.get(cursor).map(|open| open.namespace);
        // What a collection had that was dropped meanwhile would be taken for all of it.
        let next = next.and_then(|next| self.check_collection(ns.as_ref(), collection).map(|()| next));
        if is_over || next.is_err() {
            self.close(cursor);
        }
        let ns = ns.map(|ns| ns.to_string()).unwrap_or_default();
        Some(next.map(|next| cursor::reply(if is_over { 0 } else { cursor }, &ns, &next, false)))
    }

    /// Fails where a collection that had a number has it no more.
    fn check_collection(&self, ns: Option<&Namespace>, number: Option<i64>) -> Result<(), Failure> {
        match ns {
            Some(ns) if number.is_some() && self.memory()?.number(ns)? != number => {
                let message = format!("the collection {ns} was dropped or renamed while it was read");
                Err(Failure::new(codes::QUERY_PLAN_KILLED, message))
            }
            _ => Ok(()),
        }
    }

    fn close(&mut self, cursor: i64) {
        self.cursors.remove(&cursor);
        self.server.cursors.forget(cursor);
    }

    /// Closes cursors that were not read for long.
    pub(super) fn expire(&mut self) {
        let limit = self.server.options.cursor_timeout;
        let old = |results: &Results<'_>| !results.never_expires && results.used.elapsed() >= limit;
        let old: Vec<i64> = self.cursors.iter().filter(|(_, results)| old(results)).map(|(id, _)| *id).collect();
        old.into_iter().for_each(|id| self.close(id));
    }

    /// Closes all cursors: their transaction has ended.
    pub(super) fn end_all(&mut self) {
        for (id, _) in self.cursors.drain() {
            self.server.cursors.end(id);
        }
    }

    /// Reads cursors to their end, into temporary files where they are large; returns their numbers.
    pub(super) fn settle(&mut self) -> HashSet<i64> {
        let until = Instant::now() + SETTLE_TIMEOUT;
        self.cursors.values_mut().for_each(|results| results.settle(until));
        self.cursors.keys().copied().collect()
    }

    /// Waits for changes that others make, answering messages meanwhile.
    pub(super) fn wait_for_changes(&mut self, calls: u64, until: Instant) {
        let slice = if self.has_cursors() { Duration::from_millis(5) } else { Duration::from_secs(1) };
        let left = until.saturating_duration_since(Instant::now());
        self.server.turns.paused(|| self.server.hub.wait(calls, left.min(slice)));
        self.handle_messages();
    }
}

/// What is asked of the first batch of an answer.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct FirstBatch {
    pub(super) size: Option<u64>,
    /// Nothing more is wanted.
    pub(super) is_only: bool,
    pub(super) never_expires: bool,
}

/// An answer without documents.
pub(super) fn empty() -> Answer {
    Ok(RawDocumentBuf::new())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::serve::server::{Opener, Options};
    use crate::store::StoreUri;

    #[test]
    fn whoever_asks_for_more_of_a_cursor_that_is_closed_meanwhile_is_answered() {
        let open: Opener = Arc::new(|| {
            let uri = StoreUri::parse("mem:").unwrap();
            Ok(Memory::at(uri.clone(), uri, Vec::new()))
        });
        let (server, _jobs) = Server::new(open, Options::default());
        let memory = Lazy::aside(&server);
        let inboxes = [Inbox::new().unwrap(), Inbox::new().unwrap()];
        let mut owner = Host::new(&server, 1, &memory, &inboxes[0], false);
        let mut other = Host::new(&server, 2, &memory, &inboxes[1], false);
        let documents = (0..2).map(|n| Ok(bson::rawdoc! { "n": n }));
        let batch = FirstBatch { size: Some(1), ..FirstBatch::default() };
        let ns = Namespace::parse("a.b").unwrap();
        let answer = owner.answer(&ns, Origin::default(), Box::new(documents), batch).unwrap();
        let cursor = answer.get_document("cursor").unwrap().get_i64("id").unwrap();
        // The owner reads it to its end for its own client, and has no other one.
        let (question, to) = other.inbox.question(cursor::not_found(cursor));
        server.cursors.ask(More { cursor, batch: None, limits: Limits::default(), to });
        assert!(owner.more(cursor, None).is_ok() && !owner.has_cursors());
        owner.answer_late();
        let code = match other.inbox.take() {
            Some(ThreadMessage::Answer(number, Err(failure))) if question.is(number) => Some(failure.code),
            _ => None,
        };
        assert_eq!(code, Some(codes::NO_CURSOR));
        // The other one has seen the cursor before it was closed.
        let until = Some(Instant::now() + Duration::from_secs(5));
        let _deadline = Deadline::set(Limits { until, ..Limits::default() });
        assert_eq!(other.more(cursor, None).map_err(|failure| failure.code), Err(codes::NO_CURSOR));
        assert!(owner.inbox.take().is_none(), "it is not asked any more");
    }
}
