//! A connection: messages in, answers out, one after the other.

use std::io::{BufRead as _, BufReader, ErrorKind, Write as _};
use std::sync::atomic::Ordering;
use std::sync::{Arc, LazyLock};
use std::time::{Duration, Instant};

use bson::raw::cstr;
use bson::{Binary, RawDocumentBuf, Timestamp, rawdoc};
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::busy_poll::Pace;
use super::client::Client;
use super::command;
use super::failure::{Answer, Failure, codes};
use super::host::{EXPIRY_INTERVAL, Host};
use super::job::{Abandoned, Job};
use super::lazy::Lazy;
use super::mailbox::Inbox;
use super::panic;
use super::server::{Counters, Server};
use super::session::Once;
use super::stream::Stream;
use super::wire::{self, Form, Message, Reply, WireError};
use super::write::OPERATION_TIME;

/// Serves a client until it disconnects or an error ends the connection.
pub(super) fn serve(server: &Arc<Server>, stream: Stream, client: Client) {
    let Ok(inbox) = server.with_files(Inbox::new) else { return server.leave(client.id) };
    let reader = BufReader::with_capacity(64 << 10, stream);
    let mut connection = Connection { reader, client, pace: Pace::default() };
    loop {
        let memory = Lazy::lent(server);
        let mut host = Host::new(server, connection.client.id, &memory, &inbox, false);
        // A connection that broke is over; no client reads the error.
        if !connection.run(&mut host).unwrap_or(false) {
            connection.end(server);
            return linger(host);
        }
        host.answer_late();
        drop(host);
        memory.give_back();
    }
}

/// Other connections of the client may still read the cursors of this one.
fn linger(mut host: Host<'_>) {
    while host.has_cursors() && !host.server.is_stopping() {
        match host.inbox.receive(EXPIRY_INTERVAL.min(Duration::from_secs(1))) {
            Some(message) => host.handle(message),
            None => host.free_caches(),
        }
        host.expire();
    }
}

struct Connection {
    reader: BufReader<Stream>,
    client: Client,
    pace: Pace,
}

/// Whether there is more to come.
type GoesOn = bool;

/// What a connection waited for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Waited {
    Message,
    /// All its cursors are closed.
    NoCursors,
    /// The client has gone, or the server ends.
    End,
}

impl Connection {
    /// Answers messages with a host until it has no cursors, and another one will do.
    fn run(&mut self, host: &mut Host<'_>) -> Result<GoesOn, WireError> {
        loop {
            match self.wait(host)? {
                Waited::Message => {}
                Waited::NoCursors => return Ok(true),
                Waited::End => return Ok(false),
            }
            self.client.is_busy.store(true, Ordering::SeqCst);
            let (message, length) = wire::receive(&mut self.reader)?;
            Counters::add(&host.server.counters.received, length);
            let goes_on = self.reply(host, message)?;
            self.client.is_busy.store(false, Ordering::SeqCst);
            if !goes_on || host.server.is_stopping() {
                return Ok(false);
            }
            if !host.has_cursors() {
                return Ok(true);
            }
        }
    }

    /// Answers a message.
    fn reply(&mut self, host: &mut Host<'_>, message: Message) -> Result<GoesOn, WireError> {
        let (reply, wants_reply, form) = (Reply::to(&message), message.wants_reply, message.form);
        let server = Arc::clone(&host.server);
        server.turns.begin();
        let (answer, goes_on) = self.answer(host, message, form);
        let bytes = wants_reply.then(|| reply.bytes(&answer));
        server.turns.give_way();
        let sent = bytes.map_or(Ok(()), |bytes| self.send(&server, &bytes));
        server.turns.end();
        sent.map(|()| goes_on)
    }

    fn send(&mut self, server: &Server, bytes: &[u8]) -> Result<(), WireError> {
        Counters::add(&server.counters.sent, bytes.len());
        self.reader.get_mut().write_all(bytes)?;
        Ok(self.reader.get_mut().flush()?)
    }

    /// Ends it: what it began is given up, but for the cursors, which others may read.
    fn end(self, server: &Server) {
        let Self { client, reader, .. } = self;
        drop(reader);
        server.leave(client.id);
        server.cursors.leave(client.id);
        if !client.transactions.is_empty() {
            let begun = client.transactions.into_iter().map(|(session, number)| Once { session, number });
            let begun: Vec<Once> = begun.filter(|once| !server.readings.end(once)).collect();
            let _ = server.writer.submit(Job::Abandon(Abandoned::Begun(begun)));
        }
    }

    /// Waits for a message of the client; for those of other threads, too, where there are cursors that they may read.
    fn wait(&mut self, host: &mut Host<'_>) -> Result<Waited, WireError> {
        if !self.reader.buffer().is_empty() || self.reader.get_mut().has_received() {
            return Ok(Waited::Message);
        }
        let since = Instant::now();
        let server = &host.server;
        let polled = server.busy_poll.poll(&self.pace, self.reader.get_ref().descriptor(), &server.turns);
        let waited = self.sleep(host);
        self.pace.note(since.elapsed(), polled);
        waited
    }

    /// Sleeps until there is a message.
    fn sleep(&mut self, host: &mut Host<'_>) -> Result<Waited, WireError> {
        loop {
            if host.has_cursors() && self.reader.buffer().is_empty() && !self.reader.get_mut().has_received() {
                self.listen(host)?;
                if !host.has_cursors() {
                    return Ok(Waited::NoCursors);
                }
            }
            match self.reader.fill_buf() {
                Ok([]) => return Ok(Waited::End),
                Ok(_) => return Ok(Waited::Message),
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                    if host.server.is_stopping() {
                        return Ok(Waited::End);
                    }
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error.into()),
            }
        }
    }

    /// Answers messages of other threads until the client sends something.
    fn listen(&mut self, host: &mut Host<'_>) -> Result<(), WireError> {
        let limit = Timespec::try_from(EXPIRY_INTERVAL).ok();
        loop {
            let (mut received, mut woken) = (false, false);
            {
                let stream = PollFd::from_borrowed_fd(self.reader.get_ref().descriptor(), PollFlags::IN);
                let wakeup = PollFd::new(host.inbox.wakeup(), PollFlags::IN);
                let mut both = [stream, wakeup];
                match poll(&mut both, limit.as_ref()) {
                    Ok(0) => host.free_caches(),
                    Ok(_) => {
                        let mut has_come = both.iter().map(|one| !one.revents().is_empty());
                        received = has_come.next().unwrap_or(true);
                        woken = has_come.next().unwrap_or(false);
                    }
                    Err(rustix::io::Errno::INTR) => {}
                    Err(error) => return Err(WireError::Broken(error.into())),
                }
            }
            if woken {
                host.handle_messages();
            }
            host.expire();
            if received || !host.has_cursors() {
                return Ok(());
            }
        }
    }

    /// Runs a command; returns the answer.
    fn answer(&mut self, host: &mut Host<'_>, message: Message, form: Form) -> (RawDocumentBuf, GoesOn) {
        Counters::add(&host.server.counters.commands, 1);
        if let Some(name) = self.reader.get_ref().name()
            && let Some((_, port)) = self.client.host.rsplit_once(':')
        {
            self.client.host = format!("{name}:{port}");
        }
        let client = &mut self.client;
        // A change stream from the time of what is read misses no change that is not seen here.
        let began = host.server.clock.settled();
        let answer = panic::caught(|| {
            let body = message.command.map_err(Failure::from)?;
            command::run(host, client, body, form)
        });
        let goes_on = !matches!(&answer, Err(failure) if failure.code == codes::INTERNAL);
        (finished(&host.server, answer, began, form), goes_on)
    }
}

/// The signature of the cluster's time: there is no other member that could verify it.
static SIGNATURE: LazyLock<RawDocumentBuf> = LazyLock::new(|| {
    rawdoc! {
        "hash": Binary { subtype: bson::spec::BinarySubtype::Generic, bytes: vec![0; 20] },
        "keyId": 0_i64,
    }
});

/// The answer with what every one ends with; `began` is when its command did.
fn finished(server: &Server, answer: Answer, began: Timestamp, form: Form) -> RawDocumentBuf {
    let mut reply = match answer {
        Ok(mut reply) => {
            reply.append(cstr!("ok"), 1.0);
            reply
        }
        Err(failure) => {
            // What is written here is always a document.
            RawDocumentBuf::try_from(&failure.reply()).unwrap_or_default()
        }
    };
    if form == Form::Msg {
        let is_dated = matches!(reply.get(OPERATION_TIME), Ok(Some(_)));
        let mut time = RawDocumentBuf::new();
        time.append(cstr!("clusterTime"), server.clock.now());
        time.append(cstr!("signature"), &**SIGNATURE);
        reply.append(cstr!("$clusterTime"), time);
        if !is_dated {
            reply.append(OPERATION_TIME, began);
        }
    }
    reply
}
