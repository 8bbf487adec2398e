//! Work on a range of positions that two threads share.
//!
//! The range is cut into stretches. One thread works on every other stretch when it comes to it; those between are read
//! ahead by a second one, which sends what it finds in pieces. So the order is that of one thread.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

/// The fewest positions of a stretch.
const SHORTEST: i64 = 2_048;
/// The most stretches: where most documents were deleted, a stretch may hold none.
const MOST_STRETCHES: i64 = 256;
/// The most pieces that wait to be taken.
const WAITING: usize = 8;

/// How many threads read ahead in this process.
static READERS: AtomicUsize = AtomicUsize::new(0);

/// A second thread, and what it sends.
pub(super) struct Ahead<T> {
    stretches: Stretches,
    /// Whether the next stretch is the second thread's.
    is_others: bool,
    pieces: Option<Receiver<T>>,
    thread: Option<JoinHandle<()>>,
}

/// Who works on the next stretch.
pub(super) enum Turn {
    /// The first thread, on what is behind a position, up to another.
    Own(i64, i64),
    /// The second one, which has begun with it.
    Other,
    /// There is none.
    Over,
}

impl<T: Send + 'static> Ahead<T> {
    /// Starts the second thread. It calls `read` for each of its stretches, with what sends a piece; both return whether to
    /// go on.
    pub(super) fn start(
        slot: Slot,
        (behind, last): (i64, i64),
        mut read: impl FnMut((i64, i64), &mut dyn FnMut(T) -> bool) -> bool + Send + 'static,
    ) -> Option<Self> {
        let stretches = Stretches::new(behind, last);
        let (sender, pieces) = sync_channel(WAITING);
        let mut others = stretches.clone().skip(1).step_by(2);
        let work = move || {
            let _slot = slot;
            let sender: SyncSender<T> = sender;
            others.all(|stretch| read(stretch, &mut |piece| sender.send(piece).is_ok()));
        };
        let thread = std::thread::Builder::new().name("read ahead".to_owned()).spawn(work).ok()?;
        Some(Self { stretches, is_others: false, pieces: Some(pieces), thread: Some(thread) })
    }

    /// Goes on to the next stretch.
    pub(super) fn turn(&mut self) -> Turn {
        let Some((behind, last)) = self.stretches.next() else { return Turn::Over };
        let is_others = self.is_others;
        self.is_others = !is_others;
        if is_others { Turn::Other } else { Turn::Own(behind, last) }
    }

    /// The next piece, which is waited for; none where the second thread has ended.
    pub(super) fn piece(&self) -> Option<T> {
        self.pieces.as_ref()?.recv().ok()
    }
}

impl<T> Drop for Ahead<T> {
    fn drop(&mut self) {
        // Without a receiver, the thread ends with the next piece.
        drop(self.pieces.take());
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

/// Positions cut into stretches, each behind a position and up to another.
#[derive(Debug, Clone)]
struct Stretches {
    behind: i64,
    last: i64,
    length: i64,
}

impl Stretches {
    fn new(behind: i64, last: i64) -> Self {
        Self { behind, last, length: SHORTEST.max(last.saturating_sub(behind) / MOST_STRETCHES + 1) }
    }
}

impl Iterator for Stretches {
    type Item = (i64, i64);

    fn next(&mut self) -> Option<(i64, i64)> {
        let behind = self.behind;
        self.behind = behind.saturating_add(self.length).min(self.last);
        (behind < self.last).then_some((behind, self.behind))
    }
}

/// The right to have a second thread: a process has fewer of them than there are processors.
pub(super) struct Slot(());

impl Slot {
    pub(super) fn take() -> Option<Self> {
        let others = std::thread::available_parallelism().map_or(0, |all| all.get() - 1);
        let more = |taken: usize| (taken < others).then_some(taken + 1);
        READERS.fetch_update(Ordering::Relaxed, Ordering::Relaxed, more).ok().map(|_| Self(()))
    }
}

impl Drop for Slot {
    fn drop(&mut self) {
        READERS.fetch_sub(1, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_lie_side_by_side() {
        for (behind, last) in [(0, 1), (0, 2_048), (0, 2_049), (7, 100_000), (-1, 10_000_000), (i64::MIN, i64::MAX)] {
            let stretches: Vec<_> = Stretches::new(behind, last).collect();
            assert!(stretches.len() <= 513, "{}", stretches.len());
            assert_eq!((stretches[0].0, stretches[stretches.len() - 1].1), (behind, last));
            assert!(stretches.windows(2).all(|pair| pair[0].1 == pair[1].0), "{stretches:?}");
        }
        assert_eq!(Stretches::new(5, 5).next(), None);
    }

    #[test]
    fn the_pieces_of_both_threads_come_in_order_and_one_that_is_dropped_ends() {
        let read = |(behind, last): (i64, i64), send: &mut dyn FnMut(i64) -> bool| (behind + 1..=last).all(send);
        let start = || Ahead::start(Slot(()), (0, 50_000), read).unwrap();
        READERS.fetch_add(3, Ordering::Relaxed);
        let (mut ahead, mut all) = (start(), Vec::new());
        loop {
            match ahead.turn() {
                Turn::Own(behind, last) => all.extend(behind + 1..=last),
                Turn::Other => {
                    let until = (all.len() as i64 + SHORTEST).min(50_000);
                    while (all.len() as i64) < until {
                        all.extend(ahead.piece());
                    }
                }
                Turn::Over => break,
            }
        }
        assert_eq!(all, (1..=50_000).collect::<Vec<_>>());
        assert_eq!(ahead.piece(), None);
        let other = start();
        assert_eq!(other.piece(), Some(SHORTEST + 1));
        drop(other);
        drop(start());
    }
}
