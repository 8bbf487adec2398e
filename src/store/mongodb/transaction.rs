//! Transactions: what is read in one is not changed by others before it is updated.
//!
//! Members of replica sets have them. A server that stands alone has none, and none changes a capped collection in one.

use std::time::Duration;

use bson::RawDocumentBuf;
use mongodb::error::{Error, ErrorKind, TRANSIENT_TRANSACTION_ERROR, UNKNOWN_TRANSACTION_COMMIT_RESULT, WriteFailure};
use mongodb::options::{ReadConcern, ReadPreference, SelectionCriteria};
use mongodb::sync::ClientSession;

use super::action::{hint_of_driver, modified, of_driver};
use super::named::id_of;
use super::prediction::Before;
use super::visible::for_server;
use super::{MongoDb, failure};
use crate::store::{Find, Modifiers, Namespace, StoreError, UpdateRequest, Updated};

/// How often a transaction is begun that others come in between of.
const ATTEMPTS: u32 = 5;
/// How long one waits behind the first of them; behind each one more, so much longer.
const PAUSE: Duration = Duration::from_millis(1);
/// How often the server is asked to commit.
const COMMITS: u32 = 3;

/// The server's code where it has no transactions: `IllegalOperation`.
const WITHOUT: i32 = 20;
/// The same where it has none for such a collection: `OperationNotSupportedInTransaction`.
const NOT_OF_THESE: i32 = 263;

/// What came of work in transactions.
pub(super) enum Tried<T> {
    Done(T),
    /// Others were always faster.
    Overtaken,
    /// The server has no transactions, or none for this collection.
    Unable,
}

/// Why work in a transaction ended.
pub(super) enum Ended {
    Overtaken,
    Unable,
    Failed(Box<StoreError>),
}

impl<E: Into<StoreError>> From<E> for Ended {
    fn from(error: E) -> Self {
        Self::Failed(Box::new(error.into()))
    }
}

/// A transaction on the documents of a collection.
pub(super) struct Transaction<'s> {
    store: &'s MongoDb,
    ns: &'s Namespace,
    session: ClientSession,
}

impl MongoDb {
    /// Does work in a transaction, once more where others come in between. Where the work fails, nothing of it is kept.
    ///
    /// # Errors
    /// What the work fails with; where the connection is lost while the server commits, it is not known whether it did.
    pub(super) fn in_transaction<T>(
        &self,
        ns: &Namespace,
        mut work: impl FnMut(&mut Transaction<'_>) -> Result<T, Ended>,
    ) -> Result<Tried<T>, StoreError> {
        if self.is_without_transactions.get() {
            return Ok(Tried::Unable);
        }
        let session = match self.client().start_session().run() {
            Ok(session) => session,
            Err(error) if matches!(*error.kind, ErrorKind::SessionsNotSupported) => return Ok(Tried::Unable),
            Err(error) => return Err(self.explain(&error)),
        };
        let mut transaction = Transaction { store: self, ns, session };
        for attempt in 0..ATTEMPTS {
            std::thread::sleep(PAUSE * attempt);
            match transaction.begin().and_then(|()| work(&mut transaction)) {
                Ok(done) => match transaction.commit() {
                    Ok(()) => return Ok(Tried::Done(done)),
                    Err(Ended::Overtaken) => continue,
                    Err(Ended::Unable) => return Ok(Tried::Unable),
                    Err(Ended::Failed(error)) => return Err(*error),
                },
                Err(ended) => {
                    // What was not committed counts for nothing, also where the server cannot be told.
                    let _ = transaction.session.abort_transaction().run();
                    match ended {
                        Ended::Overtaken => {}
                        Ended::Unable => return Ok(Tried::Unable),
                        Ended::Failed(error) => return Err(*error),
                    }
                }
            }
        }
        Ok(Tried::Overtaken)
    }
}

impl Transaction<'_> {
    fn begin(&mut self) -> Result<(), Ended> {
        let action = self.session.start_transaction();
        let action = action.read_concern(ReadConcern::local()).write_concern(self.store.write_policy.of_one());
        let primary = SelectionCriteria::ReadPreference(ReadPreference::Primary);
        action.selection_criteria(primary).run().map_err(|error| self.ended(&error))
    }

    fn commit(&mut self) -> Result<(), Ended> {
        let mut commits = 0;
        loop {
            commits += 1;
            let Err(error) = self.session.commit_transaction().run() else { return Ok(()) };
            let is_unconfirmed = matches!(*error.kind, ErrorKind::Write(WriteFailure::WriteConcernError(_)));
            if is_unconfirmed || commits >= COMMITS || !error.contains_label(UNKNOWN_TRANSACTION_COMMIT_RESULT) {
                return Err(self.ended(&error));
            }
        }
    }

    /// The matches, by `_id`; nothing where they have more than so many bytes.
    pub(super) fn read(&mut self, find: &Find, most_bytes: usize) -> Result<Option<Before>, Ended> {
        let collection = self.store.collection(self.ns);
        let (filter, seen) = for_server(find)?;
        let mut action = collection.find(filter.into_owned());
        if find.limit > 0 {
            action = action.limit(crate::saturate::to_i64(find.limit));
        }
        let action = modified!(action, &find.modifiers, collation variables hint time);
        let mut cursor = match action.session(&mut self.session).run() {
            Ok(cursor) => cursor,
            Err(error) => return Err(self.ended(&error)),
        };
        let (mut matches, mut bytes) = (Before::new(), 0);
        while let Some(found) = cursor.next(&mut self.session) {
            let document: RawDocumentBuf = found.map_err(|error| self.ended(&error))?;
            if let Some(seen) = &seen
                && !seen.matches(&document)?
            {
                continue;
            }
            bytes += document.as_bytes().len();
            if bytes > most_bytes && !matches.is_empty() {
                return Ok(None);
            }
            matches.push((id_of(&document)?, document));
        }
        Ok(Some(matches))
    }

    /// Updates in the server's own way.
    pub(super) fn update(&mut self, request: UpdateRequest) -> Result<Updated, Ended> {
        let done = self.store.asked(self.ns, request, Some(&mut self.session))?;
        done.map_err(|error| self.ended(&error))
    }

    /// What an error of the driver means for the work.
    fn ended(&self, error: &Error) -> Ended {
        if matches!(*error.kind, ErrorKind::ServerSelection { .. }) {
            return self.store.explain(error).into();
        }
        if error.contains_label(TRANSIENT_TRANSACTION_ERROR) {
            return Ended::Overtaken;
        }
        match failure::code(error) {
            Some(WITHOUT) => {
                self.store.is_without_transactions.set(true);
                Ended::Unable
            }
            Some(NOT_OF_THESE) => Ended::Unable,
            _ => failure::explain_change(&self.store.address, self.ns, error).into(),
        }
    }
}
