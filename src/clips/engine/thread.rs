//! Two threads: CLIPS runs in one; the other reads its messages, prints, and stops it.

use std::cell::RefCell;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError, TryRecvError, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::job::{Ended, Job};
use super::message::{Message, Sender};
use super::session;
use crate::error::{Context as _, Result};
use crate::input::WrongInput;
use crate::memory::Memory;

/// The stack of the engine's thread; only what is used of it is real.
const STACK: usize = 1 << 30;
/// How long CLIPS may take to stop. While it matches a million facts with each other it does
/// not notice; then its thread is abandoned.
const HALT_TIMEOUT: Duration = Duration::from_secs(2);
/// How often to check the time while a message is waited for.
const POLL_INTERVAL: Duration = Duration::from_millis(50);
/// How many messages may be queued.
const QUEUE: usize = 256;

/// Runs programs and hands on their messages. Their memory is opened in the engine's thread.
///
/// # Errors
/// What does not load, with its place; what `open` and `receive` fail with.
pub fn run(
    job: Job,
    open: impl FnOnce(&Sender) -> Result<Memory> + Send + 'static,
    receive: &mut dyn FnMut(Message) -> Result<()>,
) -> Result<Ended> {
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
    let mut stopped = None;
    loop {
        let stop = match (interrupted.load(Ordering::Relaxed), deadline) {
            (true, _) => Some(Ended::Interrupted),
            (false, Some(deadline)) if Instant::now() >= deadline => Some(Ended::OutOfTime),
            _ => None,
        };
        if let Some(ended) = stop {
            let since = *stopped.get_or_insert_with(Instant::now);
            if since.elapsed() >= HALT_TIMEOUT {
                return Ok(ended);
            }
        }
        match next(&receiver, receive)? {
            Received::Something => {}
            Received::Over => return join(engine),
        }
    }
}

enum Received {
    Something,
    Over,
}

/// Passes on the next message, if one comes within [`POLL_INTERVAL`].
fn next(receiver: &Receiver<Message>, receive: &mut dyn FnMut(Message) -> Result<()>) -> Result<Received> {
    let message = match receiver.try_recv() {
        Err(TryRecvError::Empty) => {
            receive(Message::Pause)?;
            receiver.recv_timeout(POLL_INTERVAL)
        }
        Err(TryRecvError::Disconnected) => Err(RecvTimeoutError::Disconnected),
        Ok(message) => Ok(message),
    };
    match message {
        Ok(message) => receive(message).map(|()| Received::Something),
        Err(RecvTimeoutError::Timeout) => Ok(Received::Something),
        Err(RecvTimeoutError::Disconnected) => Ok(Received::Over),
    }
}

fn join(engine: JoinHandle<Result<Ended>>) -> Result<Ended> {
    match engine.join() {
        Ok(ended) => ended,
        Err(_) => Err(WrongInput::new("the engine failed in a way that it should not").into()),
    }
}
