//! Letters between the threads of the server.
//!
//! A cursor is read by the thread that opened it; others write to that thread where their client asks
//! for more. While a thread waits for an answer, it answers letters itself, so that no two
//! wait for each other. A question that is not answered, since its reader has ended or panicked, answers itself
//! when it is dropped.

use std::cell::Cell;
use std::io::{Read as _, Write as _};
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use super::failure::{Answer, Failure};
use super::panic;

/// What threads write to each other.
pub(super) enum Letter {
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
    pub(super) to: Reply,
}

/// Where letters to a thread go.
#[derive(Debug, Clone)]
pub(super) struct Mailbox {
    letters: Sender<Letter>,
    bell: Arc<UnixStream>,
}

impl Mailbox {
    /// Sends a letter to a thread that may be waiting for its client; says whether it is still there.
    pub(super) fn send(&self, letter: Letter) -> bool {
        let is_there = self.letters.send(letter).is_ok();
        // A bell that is full rings already.
        let _ = (&*self.bell).write(&[1]);
        is_there
    }
}

/// Where the answer to one question goes.
#[derive(Debug)]
pub(super) struct Reply {
    to: Sender<Letter>,
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
        let _ = self.to.send(Letter::Answer(self.number, answer));
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

/// The letters of a thread.
pub(super) struct Inbox {
    letters: Receiver<Letter>,
    bell: UnixStream,
    mailbox: Mailbox,
    /// How many questions were asked.
    asked: Cell<u64>,
}

impl Inbox {
    /// An empty one.
    ///
    /// # Errors
    /// Where the system has no more sockets to give.
    pub(super) fn new() -> std::io::Result<Self> {
        let (sender, letters) = channel();
        let (bell, button) = UnixStream::pair()?;
        bell.set_nonblocking(true)?;
        button.set_nonblocking(true)?;
        let mailbox = Mailbox { letters: sender, bell: Arc::new(button) };
        Ok(Self { letters, bell, mailbox, asked: Cell::new(0) })
    }

    pub(super) fn mailbox(&self) -> Mailbox {
        self.mailbox.clone()
    }

    /// Asks something: returns what the answer is awaited by, and where it is to go. `otherwise` is answered where
    /// nothing else is.
    pub(super) fn question(&self, otherwise: Failure) -> (Question, Reply) {
        let number = self.asked.get() + 1;
        self.asked.set(number);
        (Question(number), Reply { to: self.mailbox.letters.clone(), number, otherwise: Some(otherwise) })
    }

    /// The next letter; none where the time is over first.
    pub(super) fn receive(&self, limit: Duration) -> Option<Letter> {
        self.letters.recv_timeout(limit).ok()
    }

    /// A letter that is there.
    pub(super) fn take(&self) -> Option<Letter> {
        self.letters.try_recv().ok()
    }

    /// What becomes readable when a letter comes.
    pub(super) fn bell(&self) -> &UnixStream {
        &self.bell
    }

    /// Stops the bell.
    pub(super) fn silence(&self) {
        let mut rings = [0; 64];
        while (&self.bell).read(&mut rings).is_ok_and(|count| count > 0) {}
    }
}

#[cfg(test)]
mod tests {
    use super::super::failure::codes;
    use super::*;

    fn answer(inbox: &Inbox, question: Question) -> Option<i32> {
        let letters = std::iter::from_fn(|| inbox.receive(Duration::from_secs(60)));
        letters
            .filter_map(|letter| match letter {
                Letter::Answer(number, answer) if question.is(number) => {
                    Some(answer.map_or_else(|error| error.code, |_| 0))
                }
                _ => None,
            })
            .next()
    }

    #[test]
    fn a_question_that_is_dropped_or_whose_reader_panics_is_answered() {
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
        assert!(!mailbox.send(Letter::More(More { cursor: 1, batch: None, to: reply })));
        assert_eq!(answer(&inbox, fourth), Some(codes::NO_CURSOR));
        assert_ne!(second, fourth);
    }
}
