//! Cursors of transactions that have ended: a command from elsewhere that asks for one is told whose it was.

use std::collections::VecDeque;

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

    /// Why a cursor that is not open cannot be read in `here`, where that is by where it was opened.
    pub(super) fn failure(&self, cursor: i64, here: &Origin) -> Option<Failure> {
        let (_, origin) = self.0.iter().find(|(ended, _)| *ended == cursor)?;
        origin.check(cursor, here).err()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::serve::session::SessionId;

    fn code(ended: &Ended, cursor: i64, here: &Origin) -> Option<i32> {
        ended.failure(cursor, here).map(|failure| failure.code)
    }

    #[test]
    fn a_cursor_of_an_ended_transaction_is_known_by_where_it_was_opened() {
        let session = Some(SessionId::random());
        let origin = |transaction| Origin { session: session.clone(), transaction };
        let mut ended = Ended::default();
        ended.add(7, origin(Some(1)));
        assert_eq!(code(&ended, 7, &Origin::default()), Some(50_737));
        assert_eq!(code(&ended, 7, &origin(None)), Some(50_740));
        assert_eq!(code(&ended, 7, &origin(Some(2))), Some(50_741));
        assert_eq!(code(&ended, 8, &origin(Some(2))), None);
        assert!(ended.remove(|cursor, _| cursor == 7) && !ended.remove(|cursor, _| cursor == 7));
        assert_eq!(code(&ended, 7, &Origin::default()), None);
    }

    #[test]
    fn the_oldest_is_forgotten_first() {
        let mut ended = Ended::default();
        let origin = Origin { session: Some(SessionId::random()), transaction: Some(1) };
        (0..=MOST).zip(0..).for_each(|(_, cursor)| ended.add(cursor, origin.clone()));
        assert_eq!(code(&ended, 0, &Origin::default()), None);
        assert_eq!(code(&ended, 1, &Origin::default()), Some(50_737));
    }
}
