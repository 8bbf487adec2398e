//! Two threads: the engine's, and that of who runs it and does the talking.

use std::cell::RefCell;
use std::rc::Rc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TryRecvError, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Context as _;

use super::native::Stream;
use super::session;
use super::{Ended, Job};
use crate::memory::{Memory, Observer, Operation};

/// The stack of the engine's thread; only what is used of it is real.
const STACK: usize = 1 << 30;
/// How long an engine that is told to end may take. One that matches a million facts with
/// each other cannot be told; then it is left behind.
const GRACE: Duration = Duration::from_secs(2);
/// How often the time is looked at.
const SLICE: Duration = Duration::from_millis(50);
/// How much is printed at once.
const CHUNK: usize = 8 << 10;
/// How many words may be on their way.
const QUEUE: usize = 256;

/// What the engine says to who runs it.
#[derive(Debug)]
pub enum Message {
    /// For stdout.
    Out(Vec<u8>),
    /// For stderr.
    Err(Vec<u8>),
    /// What is worth a note.
    Note(String),
    /// What the memory did.
    Operation(Operation),
    /// A line of stdin is wanted, with its end; none where there is no more.
    Read(SyncSender<Option<Vec<u8>>>),
    /// Nothing more comes for now: what was printed should be seen.
    Pause,
}

/// Runs programs and hands on what they say. Their memory is opened in the engine's thread.
///
/// # Errors
/// What does not load, with its place; what `open` and `listen` fail with.
pub fn run(
    job: Job,
    open: impl FnOnce(&Sender) -> anyhow::Result<Memory> + Send + 'static,
    listen: &mut dyn FnMut(Message) -> anyhow::Result<()>,
) -> anyhow::Result<Ended> {
    let deadline = job.timeout.and_then(|timeout| Instant::now().checked_add(timeout));
    let interrupted = job.interrupted;
    let (sender, receiver) = sync_channel(QUEUE);
    let engine = std::thread::Builder::new()
        .name("clips".to_owned())
        .stack_size(STACK)
        .spawn(move || {
            let sender = Sender { sender, out: RefCell::default(), line: RefCell::default() };
            let memory = open(&sender)?;
            let ended = session::run(&job, deadline, &memory, &sender);
            sender.flush();
            ended
        })
        .context("cannot start a thread for CLIPS")?;
    let mut told = None;
    loop {
        let stop = match (interrupted.load(Ordering::Relaxed), deadline) {
            (true, _) => Some(Ended::Interrupted),
            (false, Some(deadline)) if Instant::now() >= deadline => Some(Ended::OutOfTime),
            _ => None,
        };
        if let Some(ended) = stop {
            let since = *told.get_or_insert_with(Instant::now);
            if since.elapsed() >= GRACE {
                return Ok(ended);
            }
        }
        match next(&receiver, listen)? {
            Received::Something => {}
            Received::Over => return join(engine),
        }
    }
}

enum Received {
    Something,
    Over,
}

/// Hands on what is said, if it is said soon.
fn next(
    receiver: &Receiver<Message>,
    listen: &mut dyn FnMut(Message) -> anyhow::Result<()>,
) -> anyhow::Result<Received> {
    let said = match receiver.try_recv() {
        Err(TryRecvError::Empty) => {
            listen(Message::Pause)?;
            receiver.recv_timeout(SLICE)
        }
        Err(TryRecvError::Disconnected) => Err(RecvTimeoutError::Disconnected),
        Ok(said) => Ok(said),
    };
    match said {
        Ok(said) => listen(said).map(|()| Received::Something),
        Err(RecvTimeoutError::Timeout) => Ok(Received::Something),
        Err(RecvTimeoutError::Disconnected) => Ok(Received::Over),
    }
}

fn join(engine: JoinHandle<anyhow::Result<Ended>>) -> anyhow::Result<Ended> {
    match engine.join() {
        Ok(ended) => ended,
        Err(_) => anyhow::bail!("the engine failed in a way that it should not"),
    }
}

/// The engine's end of the conversation.
pub struct Sender {
    sender: SyncSender<Message>,
    out: RefCell<Vec<u8>>,
    /// What is left of a line of stdin, the next byte last.
    line: RefCell<Vec<u8>>,
}

impl Sender {
    /// Hears of what the memory does.
    #[must_use]
    pub fn observer(&self) -> Observer {
        let sender = self.sender.clone();
        Rc::new(move |operation: &Operation| drop(sender.send(Message::Operation(operation.clone()))))
    }

    pub(super) fn note(&self, text: String) {
        self.flush();
        self.send(Message::Note(text));
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

    /// Where nobody listens any more, nothing is left to be said.
    fn send(&self, said: Message) {
        drop(self.sender.send(said));
    }
}
