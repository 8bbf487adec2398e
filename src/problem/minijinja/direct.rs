//! What is rendered becomes the problem at once.
//!
//! A value goes into the problem where minijinja writes directly to it. Where minijinja collects text first, for a macro, a
//! block or a filter, the value is kept, and a number in brackets stands for it in that text until the text is
//! written. A value is kept until then only: a text that is written twice makes the problem doubtful.

use std::collections::HashMap;
use std::io;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use minijinja::{Error, ErrorKind, Output};

use super::pieces::{Piece, is_marked, pieces};
use super::value::{CLOSE, OPEN};
use crate::pddl::Doubtful;
use crate::problem::stream::Stream;

/// The longest mark, in bytes: its brackets and a number.
const LONGEST: usize = 32;

/// A problem that is made while it is rendered.
#[derive(Debug)]
pub(super) struct Direct {
    under_way: Mutex<UnderWay>,
    /// Whether minijinja wrote nothing, which it does when it is tried.
    is_tried: AtomicBool,
    is_doubtful: AtomicBool,
    /// How many steps were made without minijinja.
    steps: AtomicU64,
}

#[derive(Debug)]
struct UnderWay {
    /// None once the problem is taken.
    stream: Option<Stream>,
    kept: Kept,
}

/// Values that stand in collected text.
#[derive(Debug, Default)]
struct Kept {
    next: usize,
    values: HashMap<usize, Value>,
    /// The beginning of a mark that is not written to its end.
    open: String,
}

#[derive(Debug)]
struct Value {
    text: String,
    number: bool,
    goal: bool,
}

pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Direct {
    pub(super) fn new(stream: Stream) -> Self {
        Self {
            under_way: Mutex::new(UnderWay { stream: Some(stream), kept: Kept::default() }),
            is_tried: AtomicBool::new(false),
            is_doubtful: AtomicBool::new(false),
            steps: AtomicU64::new(0),
        }
    }

    /// Whether nothing comes of it.
    pub(super) fn is_doubtful(&self) -> bool {
        self.is_doubtful.load(Ordering::Relaxed)
    }

    /// The problem, all of which was rendered.
    pub(super) fn take(&self) -> Result<Stream, Doubtful> {
        let mut under_way = lock(&self.under_way);
        let is_whole = under_way.kept.open.is_empty() && !self.is_doubtful();
        under_way.stream.take().filter(|_| is_whole).ok_or(Doubtful)
    }

    /// Whether minijinja writes directly to the problem, and collects nothing.
    pub(super) fn is_straight(&self, out: &mut Output<'_>) -> Result<bool, Error> {
        self.is_tried.store(false, Ordering::Relaxed);
        out.write_str("")?;
        Ok(self.is_tried.load(Ordering::Relaxed))
    }

    /// Adds to the problem, where minijinja collects nothing.
    pub(super) fn straight(&self, add: impl FnOnce(&mut Stream) -> Result<(), Doubtful>) -> Result<(), Doubtful> {
        let mut under_way = lock(&self.under_way);
        let UnderWay { stream, kept } = &mut *under_way;
        stream.as_mut().filter(|_| kept.open.is_empty() && !self.is_doubtful()).ok_or(Doubtful).and_then(add)
    }

    /// Counts steps that were made without minijinja; returns how many there were.
    pub(super) fn count(&self, steps: u64) -> u64 {
        self.steps.fetch_add(steps, Ordering::Relaxed) + steps
    }

    /// Adds a value or the goal.
    pub(super) fn emit(&self, text: &str, number: bool, goal: bool, out: &mut Output<'_>) -> Result<(), Error> {
        let is_straight = self.is_straight(out)?;
        let mut under_way = lock(&self.under_way);
        if is_straight {
            let UnderWay { stream, kept } = &mut *under_way;
            let added = match stream.as_mut().filter(|_| kept.open.is_empty()) {
                Some(stream) if goal => stream.goal(text),
                Some(stream) => stream.value(text, number),
                None => Err(Doubtful),
            };
            return added.map_err(|Doubtful| self.doubt());
        }
        let kept = &mut under_way.kept;
        let place = kept.next;
        kept.next += 1;
        kept.values.insert(place, Value { text: text.to_owned(), number, goal });
        drop(under_way);
        Ok(write!(out, "{OPEN}{place}{CLOSE}")?)
    }

    /// The text of a value that is kept.
    pub(super) fn text(&self, number: usize) -> Option<String> {
        let text = lock(&self.under_way).kept.values.get(&number).map(|value| value.text.clone());
        if text.is_none() {
            self.doubt();
        }
        text
    }

    /// Adds text that was rendered.
    fn write(&self, text: &str) -> Result<(), Doubtful> {
        if self.is_doubtful() {
            return Err(Doubtful);
        }
        let mut under_way = lock(&self.under_way);
        let UnderWay { stream, kept } = &mut *under_way;
        let stream = stream.as_mut().ok_or(Doubtful)?;
        if kept.open.is_empty() && !is_marked(text) {
            return stream.text(text);
        }
        let text = std::mem::take(&mut kept.open) + text;
        let end = text.rfind(OPEN).filter(|open| !text[*open..].contains(CLOSE)).unwrap_or(text.len());
        let (text, open) = text.split_at(end);
        if open.len() > LONGEST {
            return Err(Doubtful);
        }
        open.clone_into(&mut kept.open);
        for piece in pieces(text) {
            match piece {
                Piece::Text(text) => stream.text(text)?,
                Piece::Value(number) => match kept.values.remove(&number).ok_or(Doubtful)? {
                    Value { text, goal: true, .. } => stream.goal(&text)?,
                    Value { text, number, .. } => stream.value(&text, number)?,
                },
                Piece::Mark(_) | Piece::Begin(_) | Piece::End => return Err(Doubtful),
            }
        }
        Ok(())
    }

    /// The error that ends the rendering, since nothing comes of it.
    pub(super) fn doubt(&self) -> Error {
        self.is_doubtful.store(true, Ordering::Relaxed);
        Error::new(ErrorKind::InvalidOperation, "the problem is doubtful")
    }
}

/// Where minijinja writes what is rendered.
pub(super) struct Sink(pub(super) Arc<Direct>);

impl io::Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.write_all(bytes).map(|()| bytes.len())
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        let direct = &self.0;
        if bytes.is_empty() {
            direct.is_tried.store(true, Ordering::Relaxed);
            return Ok(());
        }
        let text = std::str::from_utf8(bytes).map_err(io::Error::other)?;
        direct.write(text).map_err(|Doubtful| io::Error::other(direct.doubt()))
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
