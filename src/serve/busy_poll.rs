//! Busy polling: where a client sends one command after the other, its connection polls for the next one before it sleeps.
//!
//! To sleep and be woken takes longer than most commands, above all in a virtual machine, whose idle processors are given
//! back to its host. Only a processor that nobody else wants is used: where other connections work, or another process had
//! it meanwhile, the connection sleeps for a while.

use std::os::fd::BorrowedFd;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::{available_parallelism, yield_now};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::turns::Turns;

/// A client that sends its next command within this time sends one after the other.
const SOON: Duration = Duration::from_micros(700);
/// Where the score is as high as this, the next command is polled for: each that came soon adds one …
const BUSY: i32 = 8;
/// … up to this; …
const BUSIEST: i32 = 32;
/// … one that came later, or while others worked, takes so many away …
const LATE: i32 = 8;
/// … and where another process wanted the processor, so many more have to come soon.
const COLLIDED: i32 = -200;
/// A poll that takes longer than this was interrupted by a process that wants the processor for long. A client, which the
/// system likes to run on the processor of its server, is there for a shorter time.
const COLLISION: Duration = Duration::from_millis(1);
/// At most so many threads poll, and at most half as many as there are processors.
const MOST: usize = 2;

/// How many threads poll, and may.
#[derive(Debug)]
pub(super) struct BusyPoll {
    polling: AtomicUsize,
    most: usize,
    processors: usize,
}

/// What came of polling.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Polled {
    /// Bytes are there, or were not waited for any longer.
    Done,
    /// Other connections work.
    Crowded,
    /// Another process wanted the processor.
    Collided,
}

impl BusyPoll {
    pub(super) fn new(is_wanted: bool) -> Self {
        let processors = available_parallelism().map_or(1, usize::from);
        let most = if is_wanted { (processors / 2).min(MOST) } else { 0 };
        Self { polling: AtomicUsize::new(0), most, processors }
    }

    /// Polls until bytes are there or not to be expected any more, while there is a processor for it besides those for
    /// the client and for the connections that work.
    pub(super) fn poll(&self, pace: &Pace, from: BorrowedFd<'_>, turns: &Turns) -> Polled {
        if pace.0 < BUSY {
            return Polled::Done;
        }
        let others = self.polling.fetch_add(1, Ordering::Relaxed);
        let has_room = || others + turns.working() + 1 < self.processors;
        let polled = if others < self.most { until_there(from, has_room) } else { Polled::Done };
        self.polling.fetch_sub(1, Ordering::Relaxed);
        polled
    }
}

fn until_there(from: BorrowedFd<'_>, has_room: impl Fn() -> bool) -> Polled {
    let at_once = Timespec { tv_sec: 0, tv_nsec: 0 };
    let since = Instant::now();
    let mut last = since;
    loop {
        let mut bytes = [PollFd::from_borrowed_fd(from, PollFlags::IN)];
        // Where it fails, reading will say why.
        if poll(&mut bytes, Some(&at_once)) != Ok(0) {
            return Polled::Done;
        }
        if !has_room() {
            return Polled::Crowded;
        }
        yield_now();
        let now = Instant::now();
        if now.duration_since(last) > COLLISION {
            return Polled::Collided;
        }
        if now.duration_since(since) > SOON {
            return Polled::Done;
        }
        last = now;
    }
}

/// How quickly a client sends its commands: a score.
#[derive(Debug, Default)]
pub(super) struct Pace(i32);

impl Pace {
    /// Notes how long a command was waited for, and what came of polling for it.
    pub(super) fn note(&mut self, waited: Duration, polled: Polled) {
        self.0 = match polled {
            Polled::Collided => COLLIDED,
            Polled::Done if waited <= SOON => (self.0 + 1).min(BUSIEST),
            Polled::Done | Polled::Crowded => (self.0 - LATE).max(self.0.min(0)),
        };
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;
    use std::os::fd::AsFd as _;
    use std::os::unix::net::UnixStream;

    use super::*;

    fn pace_after(waits: &[(Duration, usize)]) -> Pace {
        let mut pace = Pace::default();
        waits.iter().for_each(|(wait, times)| (0..*times).for_each(|_| pace.note(*wait, Polled::Done)));
        pace
    }

    #[test]
    fn only_commands_that_come_one_after_the_other_are_polled_for() {
        let (soon, late) = (Duration::from_micros(100), Duration::from_millis(1));
        assert!(pace_after(&[(soon, 7)]).0 < BUSY);
        assert!(pace_after(&[(soon, 8)]).0 >= BUSY);
        assert!(pace_after(&[(soon, 100), (late, 3), (soon, 1)]).0 >= BUSY, "a few that come late change nothing");
        assert!(pace_after(&[(soon, 100), (late, 4)]).0 < BUSY);
        assert_eq!(pace_after(&[(soon, 100), (late, 100)]).0, 0);
        let mut pace = pace_after(&[(soon, 100)]);
        pace.note(soon, Polled::Collided);
        pace.note(late, Polled::Done);
        assert_eq!(pace.0, COLLIDED);
        (0..200).for_each(|_| pace.note(soon, Polled::Done));
        assert!(pace.0 < BUSY);
        let mut pace = pace_after(&[(soon, 100)]);
        (0..4).for_each(|_| pace.note(soon, Polled::Crowded));
        assert!(pace.0 < BUSY);
    }

    #[test]
    fn a_poll_ends_where_bytes_are_there_others_work_or_the_time_is_over() {
        let (mut client, server) = UnixStream::pair().unwrap();
        let (pace, turns) = (Pace(BUSIEST), Turns::default());
        let polls = BusyPoll { polling: AtomicUsize::new(0), most: 1, processors: 2 };
        assert_ne!(polls.poll(&pace, server.as_fd(), &turns), Polled::Crowded);
        turns.begin();
        assert_eq!(polls.poll(&pace, server.as_fd(), &turns), Polled::Crowded);
        assert_eq!(BusyPoll::new(false).poll(&pace, server.as_fd(), &turns), Polled::Done, "it does not poll");
        client.write_all(b"x").unwrap();
        assert_eq!(polls.poll(&pace, server.as_fd(), &turns), Polled::Done);
        assert_eq!(polls.polling.into_inner(), 0);
    }
}
