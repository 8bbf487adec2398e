//! What the thread of CLIPS sends to the thread that runs it.

use std::cell::RefCell;
use std::sync::Arc;
use std::sync::mpsc::{SyncSender, sync_channel};

use super::native::Stream;
use crate::memory::{Observer, Operation};

/// How much is printed at once.
const CHUNK: usize = 8 << 10;

/// A message of the engine to the thread that runs it.
#[derive(Debug)]
pub enum Message {
    /// For stdout.
    Out(Vec<u8>),
    /// For stderr.
    Err(Vec<u8>),
    /// What is worth a note.
    Note(String),
    /// What the user should be careful about.
    Warning(String),
    /// What the memory did.
    Operation(Operation),
    /// A line of stdin is wanted, with its end; none where there is no more.
    Read(SyncSender<Option<Vec<u8>>>),
    /// Nothing more comes for now: output should be flushed.
    Pause,
}

/// Sends the engine's messages.
pub struct Sender {
    pub(super) sender: SyncSender<Message>,
    pub(super) out: RefCell<Vec<u8>>,
    /// What is left of a line of stdin, the next byte last.
    pub(super) line: RefCell<Vec<u8>>,
}

impl Sender {
    /// Returns an observer of the memory that sends its operations.
    #[must_use]
    pub fn observer(&self) -> Observer {
        let sender = self.sender.clone();
        Arc::new(move |operation: &Operation| drop(sender.send(Message::Operation(operation.clone()))))
    }

    pub(super) fn note(&self, text: String) {
        self.flush();
        self.send(Message::Note(text));
    }

    pub(super) fn warn(&self, text: String) {
        self.flush();
        self.send(Message::Warning(text));
    }

    pub(super) fn write(&self, stream: Stream, bytes: &[u8]) {
        if stream == Stream::Err {
            self.flush();
            return self.send(Message::Err(bytes.to_vec()));
        }
        let mut out = self.out.borrow_mut();
        out.extend_from_slice(bytes);
        let is_enough = out.len() >= CHUNK || bytes.contains(&b'\n');
        drop(out);
        if is_enough {
            self.flush();
        }
    }

    /// Hands over what was printed.
    pub(super) fn flush(&self) {
        let out = std::mem::take(&mut *self.out.borrow_mut());
        if !out.is_empty() {
            self.send(Message::Out(out));
        }
    }

    /// The next byte of stdin.
    pub(super) fn read(&self) -> Option<u8> {
        if let Some(byte) = self.line.borrow_mut().pop() {
            return Some(byte);
        }
        self.flush();
        let (answer, line) = sync_channel(1);
        self.send(Message::Read(answer));
        let mut line = line.recv().ok().flatten()?;
        line.reverse();
        let byte = line.pop();
        *self.line.borrow_mut() = line;
        byte
    }

    /// Sends a message; a receiver that has ended needs none.
    fn send(&self, message: Message) {
        drop(self.sender.send(message));
    }
}
