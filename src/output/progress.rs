//! Progress of long work, on stderr where that is a terminal.
//!
//! Nothing is drawn before a second has passed, so that short work shows nothing. A thread draws, so that the work
//! only counts; messages and results are printed above the line, which is gone when the work is over.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// How long work takes before it is shown.
const DELAY: Duration = Duration::from_secs(1);
/// How often what is shown is looked at.
const INTERVAL: Duration = Duration::from_millis(100);

/// Work that goes on; when this is dropped, it is over.
pub struct Progress {
    meter: Arc<AtomicU64>,
    text: Arc<Mutex<String>>,
    shown: Option<Shown>,
}

/// A line that is drawn by a thread.
struct Shown {
    over: Sender<()>,
    thread: JoinHandle<()>,
}

impl Progress {
    /// Progress that shows nothing.
    pub(super) fn hidden() -> Self {
        Self { meter: Arc::default(), text: Arc::default(), shown: None }
    }

    /// Progress on stderr, with the line that it draws on.
    pub(super) fn on_terminal(text: &str) -> (Self, ProgressBar) {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::hidden());
        if let Ok(style) = ProgressStyle::with_template("{spinner} {msg}, {elapsed}") {
            bar.set_style(style);
        }
        let (meter, text) = (Arc::<AtomicU64>::default(), Arc::new(Mutex::new(text.to_owned())));
        let (over, receiver) = channel();
        let line = Line { bar: bar.clone(), meter: Arc::clone(&meter), text: Arc::clone(&text) };
        let thread = std::thread::spawn(move || {
            let mut wait = DELAY;
            while receiver.recv_timeout(wait) == Err(RecvTimeoutError::Timeout) {
                line.draw(wait == DELAY);
                wait = INTERVAL;
            }
            line.bar.finish_and_clear();
        });
        (Self { meter, text, shown: Some(Shown { over, thread }) }, bar)
    }

    /// Returns the number of documents that are done, for the caller that counts them.
    #[must_use]
    pub fn meter(&self) -> Arc<AtomicU64> {
        Arc::clone(&self.meter)
    }

    /// Says what is being done now.
    pub fn say(&self, text: &str) {
        Reporter(Arc::clone(&self.text)).say(text);
    }

    /// Returns what reports from another thread what is being done; nothing where nothing is shown.
    #[must_use]
    pub fn reporter(&self) -> Option<Reporter> {
        self.shown.is_some().then(|| Reporter(Arc::clone(&self.text)))
    }
}

/// Reports what is being done.
pub struct Reporter(Arc<Mutex<String>>);

impl Reporter {
    /// Says what is being done now.
    pub fn say(&self, text: &str) {
        text.clone_into(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner));
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if let Some(Shown { over, thread }) = self.shown.take() {
            drop(over);
            // A thread that only draws has nothing to say about the work.
            let _ = thread.join();
        }
    }
}

/// What is drawn.
struct Line {
    bar: ProgressBar,
    meter: Arc<AtomicU64>,
    text: Arc<Mutex<String>>,
}

impl Line {
    fn draw(&self, is_first: bool) {
        if is_first {
            self.bar.set_draw_target(ProgressDrawTarget::stderr());
        }
        let text = self.text.lock().unwrap_or_else(PoisonError::into_inner).clone();
        self.bar.set_message(match self.meter.load(Ordering::Relaxed) {
            0 => text,
            count => format!("{text}: {count} documents"),
        });
        self.bar.tick();
    }
}
