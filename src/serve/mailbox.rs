//! Messages between the threads of the server.
//!
//! A cursor is read by the thread that opened it; other threads send that thread a message where their client asks for
//! more. While a thread waits for an answer, it answers messages itself, so that no two wait for each other. A question
//! that is not answered, since its receiver has ended or panicked, gets its answer when the [`Reply`] is dropped.

use std::cell::Cell;
use std::io::{Read as _, Write as _};
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use super::failure::{Answer, Failure, codes};
use super::panic;
use crate::deadline::Limits;

/// What threads send to each other.
pub(super) enum ThreadMessage {
    /// What was asked for, answered: the number of the question, and the answer.
    Answer(u64, Answer),
    /// The next documents of a cursor are wanted.
    More(More),
    /// A cursor is not wanted any more.
    Kill(i64),
}

/// The next documents of a cursor.
pub(super) struct More {
    pub(super) cursor: i64,
    pub(super) batch: Option<u64>,
    /// What ends reading them before it is done.
    pub(super) limits: Limits,
    pub(super) to: Reply,
}

/// The sender of messages to a thread.
#[derive(Debug, Clone)]
pub(super) struct Mailbox {
    messages: Sender<ThreadMessage>,
    /// The end of the wakeup pipe that is written to.
    wakeup: Arc<UnixStream>,
}

impl Mailbox {
    /// Sends a message to a thread that may be waiting for its client; says whether it is still there.
    pub(super) fn send(&self, message: ThreadMessage) -> bool {
        let is_there = self.messages.send(message).is_ok();
        // A pipe that is full is readable already.
        let _ = (&*self.wakeup).write(&[1]);
        is_there
    }
}

/// Where the answer to one question goes.
#[derive(Debug)]
pub(super) struct Reply {
    to: Sender<ThreadMessage>,
    number: u64,
    /// What is answered where nothing else is.
    otherwise: Option<Failure>,
}

impl Reply {
    /// Sends the answer to the waiting thread.
    pub(super) fn answer(mut self, answer: Answer) {
        self.otherwise = None;
        self.send(answer);
    }

    fn send(&self, answer: Answer) {
        // The thread that waited may have ended.
        let _ = self.to.send(ThreadMessage::Answer(self.number, answer));
    }
}

impl Drop for Reply {
    fn drop(&mut self) {
        if let Some(failure) = self.otherwise.take() {
            self.send(Err(if std::thread::panicking() { panic::mistake() } else { failure }));
        }
    }
}

/// A question that was asked, by its number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Question(u64);

impl Question {
    pub(super) fn is(self, number: u64) -> bool {
        self.0 == number
    }
}

/// The receiver of a thread's messages.
pub(super) struct Inbox {
    messages: Receiver<ThreadMessage>,
    /// The end of the wakeup pipe that is polled.
    wakeup: UnixStream,
    mailbox: Mailbox,
    /// How many questions were asked.
    asked: Cell<u64>,
}

impl Inbox {
    /// An empty one.
    ///
    /// # Errors
    /// Where the system has no more sockets to give.
    pub(super) fn new() -> Result<Self, Failure> {
        let (sender, messages) = channel();
        let (wakeup, writer) = pair().map_err(|error| {
            let message =
                format!("the system has no more sockets to give ({error}); raise the limit on open files (ulimit -n)");
            Failure::new(codes::FAILED, message)
        })?;
        let mailbox = Mailbox { messages: sender, wakeup: Arc::new(writer) };
        Ok(Self { messages, wakeup, mailbox, asked: Cell::new(0) })
    }

    pub(super) fn mailbox(&self) -> Mailbox {
        self.mailbox.clone()
    }

    /// Asks something: returns what the answer is awaited by, and where it is to go. `otherwise` is answered where
    /// nothing else is.
    pub(super) fn question(&self, otherwise: Failure) -> (Question, Reply) {
        let number = self.asked.get() + 1;
        self.asked.set(number);
        (Question(number), Reply { to: self.mailbox.messages.clone(), number, otherwise: Some(otherwise) })
    }

    /// Returns the next message; `None` if none comes within `limit`.
    pub(super) fn receive(&self, limit: Duration) -> Option<ThreadMessage> {
        self.messages.recv_timeout(limit).ok()
    }

    /// Returns the next message; `None` if there is none yet.
    pub(super) fn take(&self) -> Option<ThreadMessage> {
        self.messages.try_recv().ok()
    }

    /// Returns what becomes readable when a message comes.
    pub(super) fn wakeup(&self) -> &UnixStream {
        &self.wakeup
    }

    /// Empties the wakeup pipe.
    pub(super) fn clear_wakeup(&self) {
        let mut bytes = [0; 64];
        while (&self.wakeup).read(&mut bytes).is_ok_and(|count| count > 0) {}
    }
}

/// Two ends of a pipe, neither of which is waited for.
fn pair() -> std::io::Result<(UnixStream, UnixStream)> {
    let (wakeup, writer) = UnixStream::pair()?;
    wakeup.set_nonblocking(true)?;
    writer.set_nonblocking(true)?;
    Ok((wakeup, writer))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answer(inbox: &Inbox, question: Question) -> Option<i32> {
        let messages = std::iter::from_fn(|| inbox.receive(Duration::from_secs(60)));
        messages
            .filter_map(|message| match message {
                ThreadMessage::Answer(number, answer) if question.is(number) => {
                    Some(answer.map_or_else(|error| error.code, |_| 0))
                }
                _ => None,
            })
            .next()
    }

    #[test]
    fn a_question_that_is_dropped_or_whose_receiver_panics_is_answered() {
        let inbox = Inbox::new().unwrap();
        let ask = || inbox.question(Failure::new(codes::NO_CURSOR, "gone"));
        let (first, reply) = ask();
        reply.answer(Ok(bson::RawDocumentBuf::new()));
        assert_eq!(answer(&inbox, first), Some(0));
        let (second, reply) = ask();
        drop(reply);
        let (third, reply) = ask();
        let thread = std::thread::spawn(move || {
            let _reply = reply;
            panic!("a mistake");
        });
        assert!(thread.join().is_err());
        // Answers that are not awaited any more are passed over.
        assert_eq!(answer(&inbox, third), Some(codes::INTERNAL));
        let (fourth, reply) = ask();
        let other = Inbox::new().unwrap();
        let mailbox = other.mailbox();
        drop(other);
        assert!(!mailbox.send(ThreadMessage::More(More {
            cursor: 1,
            batch: None,
            limits: Limits::default(),
            to: reply
        })));
        assert_eq!(answer(&inbox, fourth), Some(codes::NO_CURSOR));
        assert_ne!(second, fourth);
    }
}
