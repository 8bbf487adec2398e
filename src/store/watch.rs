//! The changes of a collection, as they are made: what triggers are built on.

use std::time::{Duration, Instant};

use bson::{Bson, DateTime, Document, RawArrayBuf, RawDocumentBuf};

use super::error::StoreError;
use super::namespace::Namespace;

/// What was done to a document, or to the collection as a whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ChangeKind {
    /// A document was stored.
    Insert,
    /// A document was changed in part.
    Update,
    /// A document took the place of another with its `_id`.
    Replace,
    /// A document was removed.
    Delete,
    /// The collection was removed with all its documents, or is about to be filled
    /// anew: what a rename, `restore --drop` or `$out` puts in its place follows as
    /// inserts.
    Drop,
    /// A database was removed, after its collections: kept for scopes that are a database or everything.
    DropDatabase,
    /// A collection got another name; `after` has the fields `db`, `from` and `to`. Of a page of changes ([`ChangePage`])
    /// alone: a watch of either name gets a drop, and that of the new one the documents as inserts.
    Rename,
}

impl ChangeKind {
    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Insert => "insert",
            Self::Update => "update",
            Self::Replace => "replace",
            Self::Delete => "delete",
            Self::Drop => "drop",
            Self::DropDatabase => "dropDatabase",
            Self::Rename => "rename",
        }
    }
}

/// One change.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// What was done.
    pub kind: ChangeKind,
    /// To which document; none where it was done to the collection.
    pub id: Option<Bson>,
    /// The document before, where there was one and the store has it.
    pub before: Option<RawDocumentBuf>,
    /// The document after, where there is one and the store has it.
    pub after: Option<RawDocumentBuf>,
    /// When, by the clock of the writing process or server.
    pub time: DateTime,
    /// Where in the store's own order; unique.
    pub position: String,
}

/// Which collections changes are followed of.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub enum Scope {
    /// One collection.
    Collection(Namespace),
    /// All collections of a database.
    Database(String),
    /// All collections.
    All,
}

impl Scope {
    /// The database, where it is one.
    #[must_use]
    pub fn database(&self) -> Option<&str> {
        match self {
            Self::Collection(ns) => Some(&ns.database),
            Self::Database(database) => Some(database),
            Self::All => None,
        }
    }
}

/// Between which positions changes are kept ([`super::Store::keep_changes`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Kept {
    /// All changes behind this position are there.
    pub from: i64,
    /// The position of the last change that was made.
    pub last: i64,
    /// Whether nothing was kept for the scope before.
    pub is_new: bool,
}

/// The kept changes of one write transaction ([`super::Store::noted_changes`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NotedChanges {
    /// The position of the first.
    pub first: i64,
    /// The position of the last.
    pub last: i64,
    /// When the last was made.
    pub time: DateTime,
}

/// Where the changes at or after a time begin ([`super::Store::position_at`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Since {
    /// They are behind this position.
    pub position: i64,
    /// Whether an earlier change is kept, too, so that all of them are.
    pub is_whole: bool,
}

/// Changes behind a position ([`super::Store::changes`]).
#[derive(Debug, Clone, PartialEq)]
pub struct ChangePage {
    /// The changes in order, each with its collection.
    pub changes: Vec<(Namespace, Change)>,
    /// All changes up to this position have been looked at.
    pub until: i64,
}

/// A name by which the changes of a collection are followed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Name {
    /// The name.
    pub name: String,
    /// Of which collection.
    pub namespace: Namespace,
    /// The process that follows them now.
    pub process: Option<u32>,
    /// Whether changes that were not delivered are gone.
    pub missed: bool,
    /// What is kept until it is delivered, where the store keeps it for the name.
    pub waiting: Option<Waiting>,
}

/// Changes that wait to be delivered.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Waiting {
    /// How many.
    pub changes: u64,
    /// About how many bytes.
    pub bytes: u64,
}

/// The result of waiting for a change.
#[derive(Debug)]
pub enum Next {
    /// A change.
    Change(Box<Change>),
    /// None came in time.
    Nothing,
    /// The store cannot be reached; the next call connects again, and no change is lost.
    Interrupted(StoreError),
}

/// The changes of one collection, in the order in which they were made, each at least once.
pub trait Changes {
    /// The next change, or nothing if none comes within `timeout`.
    ///
    /// # Errors
    /// Where nothing more will come: the position is lost, or another process has
    /// taken the name.
    fn next(&mut self, timeout: Duration) -> Result<Next, StoreError>;

    /// Records that the application is done with all changes returned so far: the next
    /// process with the same name starts behind them.
    ///
    /// # Errors
    /// As [`Changes::next`].
    fn done(&mut self) -> Result<(), StoreError>;

    /// Records that this process is running. To be called every few seconds while it is
    /// busy with a change.
    ///
    /// # Errors
    /// As [`Changes::next`].
    fn renew(&mut self) -> Result<(), StoreError>;
}

/// A change stream of the server behind a store, as a client asks for it ([`super::Store::server_events`]).
#[derive(Debug, Clone, PartialEq)]
pub struct EventRequest {
    /// Whose changes.
    pub scope: Scope,
    /// The options of `$changeStream`, but for the scope.
    pub options: Document,
    /// The moment with whose changes it begins, where that is not said by the options: the server's clock may be another.
    pub since: Option<Instant>,
    /// The stages behind it.
    pub stages: Vec<Document>,
    /// How their strings compare.
    pub collation: Option<Document>,
    /// The values of their variables.
    pub variables: Option<Document>,
}

/// Some events of a change stream, as the server sends them.
#[derive(Debug)]
pub struct Events {
    /// The events, in order.
    pub events: RawArrayBuf,
    /// How many they are.
    pub count: usize,
    /// Where the stream is gone on with behind them.
    pub token: Option<Document>,
    /// Whether nothing more comes.
    pub is_over: bool,
}

/// The events of a change stream of the server behind a store, which goes on where the server was away.
pub trait ServerEvents: Send {
    /// The next events, at most so many, or none if none comes within `wait`.
    ///
    /// # Errors
    /// Where the server has not been there for long, or says that nothing more will come.
    fn next(&mut self, most: Option<u64>, wait: Duration) -> Result<Events, StoreError>;
}
