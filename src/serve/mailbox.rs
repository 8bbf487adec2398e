//! Letters between the threads of the server.
//!
//! A cursor is read by the thread that opened it; others write to that thread where their client asks
//! for more. While a thread waits for an answer, it answers letters itself, so that no two
//! wait for each other.

use std::io::{Read as _, Write as _};
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use super::failure::Answer;

/// What threads write to each other.
pub(super) enum Letter {
    /// What was asked for, answered.
    Answer(Answer),
    /// The next documents of a cursor are wanted.
    More(More),
    /// A cursor is not wanted any more.
    Kill(i64),
}

/// The next documents of a cursor.
pub(super) struct More {
    pub(super) cursor: i64,
    pub(super) batch: Option<u64>,
    pub(super) to: Mailbox,
}

/// Where letters to a thread go.
#[derive(Debug, Clone)]
pub(super) struct Mailbox {
    letters: Sender<Letter>,
    bell: Arc<UnixStream>,
}

impl Mailbox {
    /// Sends an answer to the waiting thread.
    pub(super) fn answer(&self, answer: Answer) {
        // The thread that waited may have ended.
        let _ = self.letters.send(Letter::Answer(answer));
    }

    /// Sends a letter to a thread that may be waiting for its client; says whether it is still there.
    pub(super) fn send(&self, letter: Letter) -> bool {
        let is_there = self.letters.send(letter).is_ok();
        // A bell that is full rings already.
        let _ = (&*self.bell).write(&[1]);
        is_there
    }
}

/// The letters of a thread.
pub(super) struct Inbox {
    letters: Receiver<Letter>,
    bell: UnixStream,
    mailbox: Mailbox,
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
        Ok(Self { letters, bell, mailbox: Mailbox { letters: sender, bell: Arc::new(button) } })
    }

    pub(super) fn mailbox(&self) -> Mailbox {
        self.mailbox.clone()
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
