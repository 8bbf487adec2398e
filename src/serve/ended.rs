//! Cursors of transactions that have ended: a command from elsewhere that asks for one is told whose it was.

use std::collections::VecDeque;

use super::cursor::not_found;
use super::failure::Failure;
use super::origin::Origin;

/// At most so many are remembered; the oldest is forgotten first.
const MOST: usize = 1_000;

/// The numbers of such cursors, and where they were opened.
#[derive(Debug, Default)]
pub(super) struct Ended(VecDeque<(i64, Origin)>);

impl Ended {
    pub(super) fn add(&mut self, cursor: i64, origin: Origin) {
        if self.0.len() >= MOST {
            self.0.pop_front();
        }
        self.0.push_back((cursor, origin));
    }

    /// Forgets those that `is_meant` says; says whether there were any.
    pub(super) fn remove(&mut self, is_meant: impl Fn(i64, &Origin) -> bool) -> bool {
        let before = self.0.len();
        self.0.retain(|(cursor, origin)| !is_meant(*cursor, origin));
        self.0.len() < before
    }

    /// Why a cursor that is not open cannot be read in `here`.
    pub(super) fn failure(&self, cursor: i64, here: &Origin) -> Failure {
        let origin = self.0.iter().find(|(ended, _)| *ended == cursor).map(|(_, origin)| origin);
        origin.and_then(|origin| origin.check(cursor, here).err()).unwrap_or_else(|| not_found(cursor))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::serve::session::SessionId;

    #[test]
    fn a_cursor_of_an_ended_transaction_is_known_by_where_it_was_opened() {
        let session = Some(SessionId::random());
        let origin = |transaction| Origin { session: session.clone(), transaction };
        let mut ended = Ended::default();
        ended.add(7, origin(Some(1)));
        assert_eq!(ended.failure(7, &Origin::default()).code, 50_737);
        assert_eq!(ended.failure(7, &origin(None)).code, 50_740);
        assert_eq!(ended.failure(7, &origin(Some(2))).code, 50_741);
        assert_eq!(ended.failure(8, &origin(Some(2))), not_found(8));
        assert!(ended.remove(|cursor, _| cursor == 7) && !ended.remove(|cursor, _| cursor == 7));
        assert_eq!(ended.failure(7, &Origin::default()), not_found(7));
    }

    #[test]
    fn the_oldest_is_forgotten_first() {
        let mut ended = Ended::default();
        let origin = Origin { session: Some(SessionId::random()), transaction: Some(1) };
        (0..=MOST).zip(0..).for_each(|(_, cursor)| ended.add(cursor, origin.clone()));
        assert_eq!(ended.failure(0, &Origin::default()), not_found(0));
        assert_eq!(ended.failure(1, &Origin::default()).code, 50_737);
    }
}
