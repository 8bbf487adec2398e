//! Logical sessions: by what a client says which of its commands belong together.

use std::collections::HashMap;
use std::fmt;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use bson::spec::BinarySubtype;
use bson::{Binary, Bson, Document, doc};

use super::failure::{Failure, TRANSIENT, codes};
use super::fields::Fields;

/// How many minutes a session lives without being used, which drivers get.
pub(super) const TIMEOUT_MINUTES: i32 = 30;

/// How long a transaction may take.
pub(super) const TRANSACTION_LIMIT: Duration = Duration::from_secs(60);

/// A session: the UUID that the client gave it.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub(super) struct SessionId([u8; 16]);

impl SessionId {
    /// Reads `lsid`.
    ///
    /// # Errors
    /// Where it is no `{id: UUID}`.
    pub(super) fn read(lsid: &Document) -> Result<Self, Failure> {
        let fields = Fields::new("lsid", lsid);
        fields.known_inside(&["id", "uid", "txnNumber", "txnUUID"])?;
        match lsid.get("id") {
            Some(Bson::Binary(Binary { subtype: BinarySubtype::Uuid, bytes })) => match bytes.as_slice().try_into() {
                Ok(id) => Ok(Self(id)),
                Err(_) => Err(Failure::new(207, "uuid must be a 16-byte binary field with UUID (4) subtype")),
            },
            Some(_) => Err(Failure::new(codes::TYPE_MISMATCH, "BSON field 'lsid.id' has to be a UUID")),
            None => Err(fields.missing("id")),
        }
    }

    /// A new session.
    pub(super) fn random() -> Self {
        Self(bson::Uuid::new().bytes())
    }

    /// What the snapshot of a session is kept by.
    pub(super) fn of_snapshot(&self) -> Self {
        Self(self.0.map(|byte| !byte))
    }

    pub(super) fn to_bson(&self) -> Bson {
        Binary { subtype: BinarySubtype::Uuid, bytes: self.0.to_vec() }.into()
    }

    pub(super) fn to_document(&self) -> Document {
        doc! { "id": self.to_bson() }
    }
}

impl fmt::Display for SessionId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        bson::Uuid::from_bytes(self.0).fmt(f)
    }
}

/// A write that is done once, however often it is sent: the session and its number.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Once {
    pub(super) session: SessionId,
    pub(super) number: i64,
}

/// What a session did last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Finished {
    pub(super) number: i64,
    pub(super) how: How,
    pub(super) at: Instant,
}

/// How that ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum How {
    Write,
    Committed,
    Aborted,
    /// A transaction that was aborted since others had written before it did.
    Conflicted,
}

/// What each session did last, and whose transaction is open in the writer's thread.
#[derive(Debug, Default)]
pub(super) struct Sessions(Mutex<(HashMap<SessionId, Finished>, Option<Once>)>);

impl Sessions {
    /// What a session did last.
    pub(super) fn last(&self, session: &SessionId) -> Option<Finished> {
        self.lock().0.get(session).copied()
    }

    /// Keeps what a session did, unless it has done this, or a later thing, already.
    pub(super) fn finish(&self, session: &SessionId, finished: Finished) {
        let mut sessions = self.lock();
        if sessions.0.get(session).is_none_or(|last| last.number < finished.number) {
            sessions.0.insert(session.clone(), finished);
        }
    }

    /// Whether a session used this number for a transaction.
    pub(super) fn has_transaction(&self, once: &Once) -> bool {
        let sessions = self.lock();
        let last = sessions.0.get(&once.session);
        sessions.1.as_ref() == Some(once)
            || last.is_some_and(|last| last.number == once.number && last.how != How::Write)
    }

    /// Forgets what is older.
    pub(super) fn forget(&self, age: Duration) {
        self.lock().0.retain(|_, finished| finished.at.elapsed() < age);
    }

    /// Says whose transaction the writer's thread is busy with.
    pub(super) fn set_open(&self, transaction: Option<Once>) {
        self.lock().1 = transaction;
    }

    /// The number of the transaction of a session that the writer's thread is busy with.
    pub(super) fn open(&self, session: &SessionId) -> Option<i64> {
        self.lock().1.as_ref().filter(|open| open.session == *session).map(|open| open.number)
    }

    fn lock(&self) -> MutexGuard<'_, (HashMap<SessionId, Finished>, Option<Once>)> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Finished {
    /// A write by itself.
    pub(super) fn write(number: i64) -> Self {
        Self { number, how: How::Write, at: Instant::now() }
    }
}

/// The failure of a transaction whose session has begun a later one.
pub(super) fn superseded(once: &Once, last: i64) -> Failure {
    let message = format!("the session {} has begun transaction {last} since {}", once.session, once.number);
    Failure::new(codes::TRANSACTION_TOO_OLD, message)
}

/// The failure of a transaction that is begun twice.
pub(super) fn started(once: &Once) -> Failure {
    Failure::new(codes::CONFLICT, format!("transaction {} has been started already", once.number))
}

/// The failure of a transaction that is not open.
pub(super) fn none(once: &Once) -> Failure {
    let message = format!(
        "Given transaction number {} does not match any in-progress transactions of session {}.",
        once.number, once.session
    );
    Failure::new(codes::NO_TRANSACTION, message).labeled(TRANSIENT)
}
