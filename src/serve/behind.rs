//! Writes on a MongoDB server that are done once, however often they are sent.
//!
//! A client's number of a write is of its session with this server, and not of those that this server has with the one behind
//! it. So what the statements of each session's last write did is remembered here, as long as this process runs.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use bson::Bson;

use super::failure::Answer;
use super::retry::too_old;
use super::session::SessionId;
use super::statements::Repeatable;

/// The last write of each session.
#[derive(Default)]
pub(super) struct Behind(Mutex<HashMap<SessionId, Arc<Mutex<Last>>>>);

/// The last write of a session; locked while it is done.
struct Last {
    number: Option<i64>,
    /// What its statements did.
    done: Vec<Bson>,
    at: Instant,
}

impl Default for Last {
    fn default() -> Self {
        Self { number: None, done: Vec::new(), at: Instant::now() }
    }
}

impl Behind {
    /// Does those statements of a write that were not done when it was sent before. While it is done, the same write of
    /// another connection waits.
    ///
    /// # Errors
    /// Where the session has done a later write since, or the write fails.
    pub(super) fn once(&self, Repeatable { once, statements }: &Repeatable, work: impl FnOnce() -> Answer) -> Answer {
        let last = Arc::clone(lock(&self.0).entry(once.session.clone()).or_default());
        let mut last = lock(&last);
        match last.number {
            Some(later) if later > once.number => return Err(too_old(once, later)),
            Some(number) if number == once.number => statements.recall(&last.done)?,
            _ => *last = Last { number: Some(once.number), ..Last::default() },
        }
        let answer = work();
        // Where it failed, some may have been done before.
        if let Some(done) = statements.to_be_kept() {
            last.done = done.into_iter().map(Bson::Document).collect();
        }
        last.at = Instant::now();
        answer
    }

    /// Forgets what is older; what is being done is not.
    pub(super) fn forget(&self, age: Duration) {
        let is_kept = |last: &Arc<Mutex<Last>>| last.try_lock().map_or(true, |last| last.at.elapsed() < age);
        lock(&self.0).retain(|_, last| is_kept(last));
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::serve::effect::Effect;
    use crate::serve::failure::{Failure, codes};
    use crate::serve::host::empty;
    use crate::serve::request::Request;
    use crate::serve::session::Once;
    use crate::serve::statements::Statements;
    use bson::doc;

    /// Sends a write with this number and two statements, the first of which is done, or both; gives which were done before.
    fn send(behind: &Behind, number: i64, is_whole: bool) -> Result<[bool; 2], i32> {
        let request = Request::read(doc! { "insert": "c", "documents": [{}, {}], "$db": "a" }).unwrap();
        let statements = Arc::new(Statements::read(&request).unwrap());
        let once = Once { session: SessionId::default(), number };
        let mut before = [false; 2];
        let work = || {
            before = [0, 1].map(|place| statements.repeated(place).is_some());
            statements.note(0..if is_whole { 2 } else { 1 }, &Effect::Inserted);
            if is_whole { empty() } else { Err(Failure::new(codes::UNREACHABLE, "gone")) }
        };
        let answer = behind.once(&Repeatable { once, statements: Arc::clone(&statements) }, work);
        match answer {
            Err(failure) if failure.code != codes::UNREACHABLE => Err(failure.code),
            _ => Ok(before),
        }
    }

    #[test]
    fn statements_are_done_once_and_the_others_when_they_are_sent_again() {
        let behind = Behind::default();
        assert_eq!(send(&behind, 3, false), Ok([false, false]));
        assert_eq!(send(&behind, 3, true), Ok([true, false]));
        assert_eq!(send(&behind, 3, true), Ok([true, true]));
        assert_eq!(send(&behind, 4, true), Ok([false, false]));
        assert_eq!(send(&behind, 3, true), Err(codes::TRANSACTION_TOO_OLD));
        behind.forget(Duration::from_secs(3600));
        assert_eq!(send(&behind, 4, true), Ok([true, true]));
        behind.forget(Duration::ZERO);
        assert_eq!(send(&behind, 4, true), Ok([false, false]));
    }
}
