//! Two threads: the engine's, and that of who runs it and does the talking.

use std::cell::RefCell;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError, TryRecvError, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Context as _;

use super::job::{Ended, Job};
use super::message::{Message, Sender};
use super::session;
use crate::memory::Memory;

/// The stack of the engine's thread; only what is used of it is real.
const STACK: usize = 1 << 30;
/// How long an engine that is told to end may take. One that matches a million facts with
/// each other cannot be told; then it is left behind.
const GRACE: Duration = Duration::from_secs(2);
/// How often the time is looked at.
const SLICE: Duration = Duration::from_millis(50);
/// How many words may be on their way.
const QUEUE: usize = 256;

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
