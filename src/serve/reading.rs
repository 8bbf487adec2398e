//! Transactions that have only read: each has a thread with a snapshot of its own, so that no writer waits for it.
//!
//! With its first write a transaction goes on in the writer's thread, if nothing was written since its snapshot; else
//! it is a write conflict, and the client begins again. Its cursors stay where they are.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, TryRecvError, channel};
use std::time::{Duration, Instant};

use super::call::Call;
use super::failure::{Answer, Failure, TRANSIENT, codes};
use super::host::{self, Host};
use super::lazy::Lazy;
use super::mailbox::Inbox;
use super::panic;
use super::server::{Server, thread};
use super::session::{Finished, How, Once, TRANSACTION_LIMIT, none, started, superseded};
use super::snapshot::{Ask, Reading, Snapshot};
use crate::store::Namespace;

/// At most so many have a thread. One more would read in the writer's, and every write wait for it: it is refused.
const MOST: usize = 200;
/// How often a thread checks whether its time is over.
const POLL_INTERVAL: Duration = Duration::from_millis(200);
/// The same, where cursors of a snapshot are read by messages.
const MESSAGE_POLL_INTERVAL: Duration = Duration::from_millis(5);
/// Runs a command where its transaction is.
pub(super) type Command = fn(&mut Host<'_>, &Call) -> Answer;

/// Runs a command in the thread of its transaction, which gets one here where it begins with a read of a namespace. Where
/// it has none, or where the command writes after all, nothing is answered: it is for the writer, with the snapshot.
pub(super) fn run(
    host: &mut Host<'_>,
    once: &Once,
    call: &Arc<Call>,
    begins: Option<(&Namespace, Command)>,
) -> Result<Option<Answer>, Failure> {
    let server = Arc::clone(&host.server);
    let (question, reply) = host.inbox.question(none(once));
    let ask = Ask::Run { call: Arc::clone(call), reply };
    let is_asked = match begins {
        Some(work) => begin(&server, once, work, ask)?,
        None => server.readings.ask(once, ask)?,
    };
    if !is_asked {
        return Ok(None);
    }
    let answer = host.wait(question);
    Ok(Some(answer).filter(|answer| !is_write(answer)))
}

/// Gives a transaction a thread, if there is room for it and its number is new, and asks it. The thread has what it is
/// asked from its beginning on, so that it is answered even where no snapshot can be taken.
fn begin(server: &Arc<Server>, once: &Once, (ns, command): (&Namespace, Command), first: Ask) -> Result<bool, Failure> {
    // One that came to a conflict is tried again by the writer, which no other write can disturb.
    let keeps_out = |last: Finished| last.number >= once.number || last.how == How::Conflicted;
    if server.sessions.last(&once.session).is_some_and(keeps_out) {
        return Ok(false);
    }
    let (asks, asked) = channel();
    let mut readings = server.readings.lock();
    match readings.get(&once.session) {
        Some(reading) if reading.number > once.number => return Err(superseded(once, reading.number)),
        Some(reading) if reading.number == once.number => return Err(started(once)),
        None if readings.len() >= MOST => return Err(too_many()),
        _ => {}
    }
    let (shared, own, ns) = (Arc::clone(server), once.clone(), ns.clone());
    let is_asked = asks.send(first).is_ok();
    let work = move || live(&shared, &own, (&ns, command), &asked);
    let is_begun = thread("transaction").spawn(work).is_ok();
    if is_begun {
        readings.insert(once.session.clone(), Reading { number: once.number, asks, moved: None });
    }
    Ok(is_begun && is_asked)
}

/// The failure of a transaction for which there is no thread: drivers begin it again.
fn too_many() -> Failure {
    let message = format!("{MOST} transactions that have only read are open, as many as there can be; begin it again");
    Failure::new(codes::WRITE_CONFLICT, message).labeled(TRANSIENT)
}

/// Returns the snapshot of a transaction that is going to write, where it has read before: its cursors are read to
/// their end, and from now on the writer does what the transaction does.
pub(super) fn snapshot(host: &mut Host<'_>, once: &Once) -> Result<Option<Snapshot>, Failure> {
    let server = Arc::clone(&host.server);
    let (question, reply) = host.inbox.question(none(once));
    if !server.readings.ask(once, Ask::Settle(reply))? {
        return Ok(None);
    }
    host.wait(question)?;
    Ok(server.readings.snapshot(once))
}

/// Whether something that only reads had to write: the store refuses that within a snapshot.
fn is_write(answer: &Answer) -> bool {
    answer.as_ref().is_err_and(|failure| failure.code == codes::WRITE_CONFLICT)
}

/// The thread of a transaction.
fn live(server: &Arc<Server>, once: &Once, (ns, command): (&Namespace, Command), asked: &Receiver<Ask>) {
    let failed = panic::caught(|| read(server, once, (ns, command), asked).and_then(|()| host::empty())).err();
    match &failed {
        Some(_) => abort(server, once),
        None => drop(server.readings.end(once)),
    }
    for late in asked.try_iter() {
        // What cannot be read now is not tried again and again.
        if let (Ask::Run { reply, .. } | Ask::Settle(reply), Some(failure)) = (late, &failed) {
            reply.answer(Err(failure.clone()));
        }
    }
}

/// Takes a snapshot, and answers what is read of it until the transaction ends.
fn read(
    server: &Arc<Server>,
    once: &Once,
    (ns, command): (&Namespace, Command),
    asked: &Receiver<Ask>,
) -> Result<(), Failure> {
    let (memory, inbox) = (Lazy::aside(server), server.with_files(Inbox::new)?);
    let until = Instant::now() + TRANSACTION_LIMIT;
    let mut host = Host::new(server, server.next_id(), &memory, &inbox, true);
    let mut check = None;
    let is_current = host.memory()?.at_one_moment(ns, &mut || {
        check = answer_all(&mut host, (once, command), asked, until);
        Ok(())
    });
    if let Some(reply) = check {
        // The writer may have given up.
        let _ = reply.send(is_current.unwrap_or(false));
        give_cursors(&mut host, asked, until);
    } else {
        abort(server, once);
        is_current?;
    }
    host.end_all();
    Ok(())
}

/// Ends a transaction of which nothing is kept.
fn abort(server: &Server, once: &Once) {
    // It has one end, whoever finds it open.
    if server.readings.end(once) {
        let aborted = Finished { number: once.number, how: How::Aborted, at: Instant::now() };
        server.sessions.finish(&once.session, aborted);
    }
}

/// Runs commands, until the transaction ends (nothing is returned), or it is asked whether its snapshot is current.
fn answer_all(
    host: &mut Host<'_>,
    (once, command): (&Once, Command),
    asked: &Receiver<Ask>,
    until: Instant,
) -> Option<Sender<bool>> {
    let mut interval = POLL_INTERVAL;
    loop {
        match asked.recv_timeout(interval) {
            Ok(Ask::Run { call, reply }) => {
                let answer = panic::caught(|| command(host, &call));
                // A snapshot outlives commands that fail, and its cursors are read by messages.
                let is_transaction = call.request.is_in_transaction();
                interval = if is_transaction || !host.has_cursors() { POLL_INTERVAL } else { MESSAGE_POLL_INTERVAL };
                let is_failed = is_transaction && answer.is_err() && !is_write(&answer);
                if is_failed {
                    // Before the client can commit it.
                    abort(&host.server, once);
                }
                reply.answer(answer);
                if is_failed {
                    return None;
                }
            }
            Ok(Ask::Settle(reply)) => {
                let answer = panic::caught(|| {
                    let cursors = host.settle();
                    host.server.readings.hand_over(once, cursors);
                    host::empty()
                });
                if answer.is_err() {
                    abort(&host.server, once);
                    reply.answer(answer);
                    return None;
                }
                reply.answer(answer);
            }
            Ok(Ask::IsCurrent(reply)) => return Some(reply),
            Err(RecvTimeoutError::Timeout) if Instant::now() < until && !host.server.is_stopping() => {
                host.handle_messages();
                host.expire();
            }
            Err(_) => return None,
        }
    }
}

/// Lets others read the cursors, until the transaction ends.
fn give_cursors(host: &mut Host<'_>, asked: &Receiver<Ask>, until: Instant) {
    while host.has_cursors() && Instant::now() < until && !host.server.is_stopping() {
        if matches!(asked.try_recv(), Err(TryRecvError::Disconnected)) {
            return;
        }
        if let Some(message) = host.inbox.receive(POLL_INTERVAL) {
            host.handle(message);
        }
    }
}
