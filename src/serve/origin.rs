//! What a command belongs to.

use super::failure::Failure;
use super::session::SessionId;

/// A session and a transaction of it, or neither: what a cursor is opened in, and is read in alone.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Origin {
    pub(super) session: Option<SessionId>,
    /// The number of its transaction.
    pub(super) transaction: Option<i64>,
}

impl Origin {
    /// Whether what is asked in `here` may read a cursor that was opened in this one.
    ///
    /// # Errors
    /// MongoDB's, where it may not.
    pub(super) fn check(&self, cursor: i64, here: &Self) -> Result<(), Failure> {
        let refused = |code, why: String| {
            Err(Failure::new(code, format!("Cannot run getMore on cursor {cursor}, which was {why}")))
        };
        match (&self.session, &here.session) {
            (None, Some(own)) => return refused(50_736, format!("not created in a session, in session {own}")),
            (Some(its), None) => return refused(50_737, format!("created in session {its}, without an lsid")),
            (Some(its), Some(own)) if its != own => {
                return refused(50_738, format!("created in session {its}, in session {own}"));
            }
            _ => {}
        }
        match (self.transaction, here.transaction) {
            (None, Some(own)) => refused(50_739, format!("not created in a transaction, in transaction {own}")),
            (Some(its), None) => refused(50_740, format!("created in transaction {its}, without a txnNumber")),
            (Some(its), Some(own)) if its != own => {
                refused(50_741, format!("created in transaction {its}, in transaction {own}"))
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cursor_is_read_where_it_was_opened() {
        let [one, two] = [SessionId::random(), SessionId::random()].map(Some);
        let origin = |session: &Option<SessionId>, transaction| Origin { session: session.clone(), transaction };
        let none = Origin::default();
        for (its, here, code) in [
            (&none, &none, 0),
            (&origin(&one, Some(1)), &origin(&one, Some(1)), 0),
            (&none, &origin(&one, None), 50_736),
            (&origin(&one, Some(1)), &none, 50_737),
            (&origin(&one, None), &origin(&two, None), 50_738),
            (&origin(&one, None), &origin(&one, Some(1)), 50_739),
            (&origin(&one, Some(1)), &origin(&one, None), 50_740),
            (&origin(&one, Some(1)), &origin(&one, Some(2)), 50_741),
        ] {
            assert_eq!(its.check(7, here).map_or_else(|failure| failure.code, |()| 0), code, "{its:?} {here:?}");
        }
    }
}
