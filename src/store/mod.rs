//! Where documents are stored. [`Store`] is what a memory needs of a database.
//!
//! Two kinds: [`embedded`], a file of this machine that several processes use
//! at once, and `mongodb`, a server or replica set reached through the official
//! driver. Both answer MongoDB's query and update languages, and both pass one
//! contract suite (`tests/integration`).

pub mod embedded;
#[cfg(feature = "mongodb")]
pub mod mongodb;

pub(crate) mod document;
mod error;
mod file_identity;
mod find_and_modify;
pub mod history;
pub mod index;
mod key_options;
pub mod metadata;
mod modifiers;
pub mod namespace;
pub(crate) mod parsed;
mod request;
pub mod staging;
mod step;
mod taken_key;
pub mod uri;
pub mod validation;
pub mod watch;
mod write_concern;

pub use document::{MAX_DEPTH, MAX_SIZE};
pub use embedded::Embedded;
pub use error::StoreError;
pub(crate) use file_identity::FileIdentity;
pub use find_and_modify::{FindAndModify, Modification, Modified};
pub use history::{Entry, History, HistoryRule};
pub use index::{Index, IndexChange};
pub use key_options::KeyOptions;
pub use modifiers::{Hint, Modifiers};
#[cfg(feature = "mongodb")]
pub use mongodb::MongoDb;
pub use namespace::{Namespace, NamespaceError};
pub use request::{
    Aggregation, Checked, Find, Inserted, Put, Query, UpdateRequest, UpdateSpec, Updated, Validated, ValidatedIndex,
};
pub use step::{Step, Undone, as_step};
pub use taken_key::TakenKey;
pub use uri::{Role, StoreUri, UriError, open};
pub use validation::{InvalidDocument, Validation, ValidationAction, ValidationLevel};
pub use watch::{
    Change, ChangeKind, ChangePage, Changes, EventRequest, Events, Kept, Name, Next, NotedChanges, Scope, ServerEvents,
    Since,
};
pub use write_concern::{Acknowledgment, WriteConcern};

use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use bson::{Bson, DateTime, Document, RawDocumentBuf};

use crate::query::Collation;

/// Documents in answer to a query, produced as they are asked for.
pub type Documents<'a> = Box<dyn Iterator<Item = Result<RawDocumentBuf, StoreError>> + 'a>;

/// Values that were found, which need the store no more.
pub type Values = Box<dyn Iterator<Item = Result<Bson, StoreError>>>;

/// Takes warnings, from whichever thread writes.
pub type Warn = Arc<dyn Fn(&str) + Send + Sync>;

/// Chooses a query for [`Store::find_chosen`].
pub type Choose<'c, 'f> = &'c mut dyn FnMut(bool) -> Result<Option<Cow<'f, Find>>, StoreError>;

/// What a memory needs of a database. Implementations are used from one thread
/// at a time, but several processes may use one database at once.
pub trait Store: Send {
    /// Stores the documents in order, giving an ObjectId `_id` (as the first
    /// key) to those that have none. Where one is not acceptable or its unique
    /// key is taken, those before it are stored, and [`StoreError::stored`]
    /// says which. Durable on return.
    fn insert(&self, ns: &Namespace, documents: Vec<Document>) -> Result<Inserted, StoreError>;

    /// The documents that match, lazily.
    fn find(&self, ns: &Namespace, find: &Find) -> Result<Documents<'_>, StoreError>;

    /// [`Store::find`] of the query that `choose` gives, where it gives one. What `choose` reads of the store and the first of
    /// the documents are read at one moment, where the store can; `choose` writes nothing. It is told whether all documents of
    /// the collection are known to be lasting: none decays, and none was computed.
    fn find_chosen<'f>(&self, ns: &Namespace, choose: Choose<'_, 'f>) -> Result<Option<Documents<'_>>, StoreError> {
        choose(false)?.map(|find| self.find(ns, &find)).transpose()
    }

    /// Answers a query to say how: `{index, keys, bounds}` of the index that is
    /// used (`index: null` where all documents are looked at; `any: [{…}]`
    /// where alternatives have one each), `sort: "index"` or `"memory"` where
    /// there is a sort, `keys_examined`, `documents_examined`, `returned`.
    fn explain(&self, ns: &Namespace, find: &Find) -> Result<Document, StoreError>;

    /// How many documents match.
    fn count(&self, ns: &Namespace, query: Query<'_>) -> Result<u64, StoreError>;

    /// The distinct values of a (dotted) field among matching documents, array
    /// elements counted one by one, in the order MongoDB gives them.
    fn values(&self, ns: &Namespace, field: &str, query: Query<'_>) -> Result<Values, StoreError>;

    /// All of [`Store::values`].
    fn distinct(&self, ns: &Namespace, field: &str, query: Query<'_>) -> Result<Vec<Bson>, StoreError> {
        self.values(ns, field, query)?.collect()
    }

    /// The results of an aggregation pipeline.
    fn aggregate(&self, ns: &Namespace, pipeline: Aggregation<'_>) -> Result<Documents<'_>, StoreError>;

    /// Changes the first match, or all with `many`. Atomic per document. With
    /// a timestamp, what is changed says so under [`metadata::INFO`].
    fn update(
        &self,
        ns: &Namespace,
        update: &UpdateRequest,
        timestamp: Option<DateTime>,
    ) -> Result<Updated, StoreError>;

    /// Finds the first match in the order of the sort, changes or removes it, and returns it. No other client changes it in
    /// between. The metadata is as with [`Store::update`].
    fn find_and_modify(
        &self,
        ns: &Namespace,
        request: &FindAndModify,
        timestamp: Option<DateTime>,
    ) -> Result<Modified, StoreError>;

    /// Stores documents, each in place of the one with its `_id` where there is
    /// one, those without an `_id` under a new one; the metadata is as with
    /// [`Store::update`]. Durable on return.
    fn put(&self, ns: &Namespace, documents: Vec<Document>, timestamp: Option<DateTime>) -> Result<Put, StoreError>;

    /// Removes all matches, or the first only; returns how many.
    fn delete(&self, ns: &Namespace, query: Query<'_>, first_only: bool) -> Result<u64, StoreError>;

    /// Removes a whole collection; returns whether it existed.
    fn drop(&self, ns: &Namespace) -> Result<bool, StoreError>;

    /// Gives the collection `from` the name `to`, in one step; a collection that has the name is replaced with `drop_target`,
    /// and else a refusal (code 48). Both are in one database. Durable on return.
    fn rename(&self, from: &Namespace, to: &Namespace, drop_target: bool) -> Result<(), StoreError>;

    /// Creates an index, and the collection where there is none; returns whether
    /// the index is new. Over documents that a unique index cannot be made of,
    /// nothing changes. Durable on return.
    fn create_index(&self, ns: &Namespace, index: &Index) -> Result<bool, StoreError>;

    /// Refuses an index that the store cannot have, as far as that is known before it is made.
    fn check_index(&self, index: &Index) -> Result<(), StoreError> {
        let _ = index;
        Ok(())
    }

    /// Removes the index of that name; returns whether it existed.
    fn drop_index(&self, ns: &Namespace, name: &str) -> Result<bool, StoreError>;

    /// Changes the index of that name; returns whether it exists.
    fn modify_index(&self, ns: &Namespace, name: &str, change: IndexChange) -> Result<bool, StoreError>;

    /// The indexes of a collection, that on `_id` first; none where there is no collection.
    fn indexes(&self, ns: &Namespace) -> Result<Vec<Index>, StoreError>;

    /// All collections, sorted.
    fn collections(&self) -> Result<Vec<Namespace>, StoreError>;

    /// Follows the changes of a collection: from now on, or with a name that exists, from
    /// its position. A name belongs to one collection, is kept in the
    /// store, and is followed by one process at a time.
    fn watch(&self, ns: &Namespace, name: Option<&str>) -> Result<Box<dyn Changes + '_>, StoreError>;

    /// Removes a name of [`Store::watch`]; returns whether it existed.
    fn forget(&self, ns: &Namespace, name: &str) -> Result<bool, StoreError>;

    /// All names of [`Store::watch`], sorted by collection.
    fn names(&self) -> Result<Vec<Name>, StoreError>;

    /// Makes an empty collection where there is none; returns whether it is new. With a collation, its strings compare by
    /// that in every operation, and in every index, that has no collation of its own. The index on `_id` that
    /// [`Store::indexes`] lists has the collation. Durable on return.
    fn create(&self, ns: &Namespace, collation: Option<&Collation>) -> Result<bool, StoreError>;

    /// Makes an empty collection as [`Store::create`] does, that takes certain documents; where it says so, it keeps them for
    /// change streams as [`Store::set_images`] has it.
    fn create_validating(
        &self,
        ns: &Namespace,
        collation: Option<&Collation>,
        validation: &Validation,
        _images: Option<bool>,
    ) -> Result<bool, StoreError> {
        let mut is_new = false;
        self.atomically(&mut || {
            is_new = self.create(ns, collation)?;
            if is_new && !validation.is_empty() { self.set_validation(ns, validation) } else { Ok(()) }
        })?;
        Ok(is_new)
    }

    /// The options of a collection that say which documents it takes; none where it says nothing, or is not there.
    fn validation(&self, ns: &Namespace) -> Result<Option<Validation>, StoreError> {
        let _ = ns;
        Ok(None)
    }

    /// Sets the options of a collection, which is there, that say which documents it takes. Documents that are in it are not
    /// looked at. Durable on return.
    fn set_validation(&self, ns: &Namespace, validation: &Validation) -> Result<(), StoreError> {
        let _ = (ns, validation);
        Err(StoreError::Unfit { address: self.describe(), reason: "keeps no validators".to_owned() })
    }

    /// Runs writes that store documents also where they do not pass the validator of their collection.
    fn unvalidated(&self, work: &mut dyn FnMut() -> Result<(), StoreError>) -> Result<(), StoreError> {
        work()
    }

    /// Gives each warning to `warn`: a document was stored though it does not pass the validator of its collection.
    fn warn_by(&self, warn: Warn) {
        let _ = warn;
    }

    /// Keeps the changes of a scope from now on, or goes on doing so; those from before
    /// `since` go. Whoever calls this has to do so again every few seconds.
    fn keep_changes(&self, scope: &Scope, since: DateTime) -> Result<Kept, StoreError> {
        let _ = (scope, since);
        Err(self.keeps_none())
    }

    /// Stops keeping the changes of a scope.
    fn release_changes(&self, scope: &Scope) -> Result<(), StoreError> {
        let _ = scope;
        Ok(())
    }

    /// The scopes whose changes are kept.
    fn kept_scopes(&self) -> Result<Vec<Scope>, StoreError> {
        Ok(Vec::new())
    }

    /// At most `most` changes of a scope behind a position, in order. Changes that are not kept
    /// any more are an error with MongoDB's code 286.
    fn changes(&self, scope: &Scope, behind: i64, most: usize) -> Result<ChangePage, StoreError> {
        let _ = (scope, behind, most);
        Err(self.keeps_none())
    }

    /// Where the kept changes at or after a time begin.
    fn position_at(&self, scope: &Scope, time: DateTime) -> Result<Since, StoreError> {
        let _ = (scope, time);
        Err(self.keeps_none())
    }

    /// Has a collection, which is there, keep its documents before and after each change for change streams, or not any more. A
    /// store that keeps changes itself keeps them always.
    fn set_images(&self, ns: &Namespace, are_kept: bool) -> Result<(), StoreError> {
        let _ = (ns, are_kept);
        Ok(())
    }

    /// Opens a change stream of the server behind the store; gives its first events, at most so many.
    fn server_events(
        &self,
        request: EventRequest,
        most: Option<u64>,
    ) -> Result<(Box<dyn ServerEvents>, Events), StoreError> {
        let _ = (request, most);
        let reason = "has no server behind it; its changes are those that it keeps".to_owned();
        Err(StoreError::Unfit { address: self.describe(), reason })
    }

    /// The changes that the write transaction has made so far and that are kept, where there are any.
    fn noted_changes(&self) -> Result<Option<NotedChanges>, StoreError> {
        Ok(None)
    }

    /// The kept changes of the last write transaction of this store that made some and is committed, where they are still
    /// kept.
    fn committed_changes(&self) -> Result<Option<NotedChanges>, StoreError> {
        Ok(None)
    }

    /// The changes that the write transaction has made so far, all of which get the time that it is now.
    fn join_changes(&self) -> Result<Option<NotedChanges>, StoreError> {
        Ok(None)
    }

    /// Keeps the histories of these rules from the next write on.
    fn keep_history(&self, rules: &[HistoryRule]) {
        let _ = rules;
    }

    /// Sets the author of the changes that follow, as one run; the history says so.
    fn sign(&self, author: &str) {
        let _ = author;
    }

    /// The kept changes of a collection, those after a time; none where its history is not kept.
    fn history(&self, ns: &Namespace, after: Option<DateTime>) -> Result<Option<History<'_>>, StoreError> {
        let _ = (ns, after);
        Ok(None)
    }

    /// The documents of a collection as they were at a time, without those of computables.
    fn as_of(&self, ns: &Namespace, at: DateTime) -> Result<Vec<RawDocumentBuf>, StoreError> {
        let _ = at;
        Err(history::not_kept(ns, &[]))
    }

    /// Records the history of what all clients change until `stop`, where they do not do so themselves; calls
    /// `begun` when it has begun. Returns how many changes it recorded.
    fn record(&self, ns: &Namespace, stop: &AtomicBool, begun: &mut dyn FnMut()) -> Result<u64, StoreError> {
        let _ = (ns, stop, begun);
        let reason =
            "`record` is for MongoDB; where keep_history says so, every write to a file keeps its history itself"
                .to_owned();
        Err(StoreError::Unfit { address: self.describe(), reason })
    }

    /// The collections that have changes in the history, though they may be gone.
    fn changed_collections(&self) -> Result<Vec<Namespace>, StoreError> {
        Ok(Vec::new())
    }

    /// The error of a store that keeps no changes itself.
    fn keeps_none(&self) -> StoreError {
        let reason = "does not keep changes itself; use Store::watch".to_owned();
        StoreError::Unfit { address: self.describe(), reason }
    }

    /// Runs operations so that all they do is kept or, where they fail, nothing; a process
    /// that is killed has done nothing. Other writers wait meanwhile. Where [`Store::is_atomic`]
    /// is false, the operations just run.
    /// An operation that fails among others has done nothing by itself, and the others may go on.
    fn atomically(&self, work: &mut dyn FnMut() -> Result<(), StoreError>) -> Result<(), StoreError> {
        work()
    }

    /// Whether the store has taken back all of what is being done in [`Store::atomically`], since its disk was full or failed:
    /// whatever else is to be written in it fails, too.
    fn is_rolled_back(&self) -> bool {
        false
    }

    /// Runs writes, and waits until the members that their client names have them (by default, those of the store's own write
    /// concern); `work` returns whether there is something to wait for. Returns MongoDB's `writeConcernError` where they
    /// are not confirmed. A store that is one member confirms each write itself.
    ///
    /// # Errors
    /// Where the store cannot be reached, or has no such members; then `work` was not run.
    fn confirmed(
        &self,
        _: &Namespace,
        _concern: Option<&WriteConcern>,
        work: &mut dyn FnMut() -> bool,
    ) -> Result<Option<Document>, StoreError> {
        work();
        Ok(None)
    }

    /// Runs operations that all see the store at one moment, while others write. They cannot write themselves: error
    /// 112, a write conflict. Returns whether nothing was written meanwhile, where the store knows it.
    fn at_one_moment(&self, work: &mut dyn FnMut() -> Result<(), StoreError>) -> Result<bool, StoreError> {
        work().map(|()| false)
    }

    /// Numbers of which one is another after every write, also of other processes, where they are known without asking: in
    /// [`Store::find_chosen`], [`Store::at_one_moment`] and [`Store::atomically`].
    fn state(&self) -> Option<(i64, u64)> {
        None
    }

    /// Runs operations that read until a time at most, where the store can: what goes on to read documents after it is
    /// [`StoreError::Held`].
    fn reading_until(
        &self,
        _until: Instant,
        work: &mut dyn FnMut() -> Result<(), StoreError>,
    ) -> Result<(), StoreError> {
        work()
    }

    /// Runs operations that do not wait for the disk, where the store can: what they did may be lost with the power, the last
    /// of it first. Everything else holds as for others.
    fn unflushed(&self, work: &mut dyn FnMut() -> Result<(), StoreError>) -> Result<(), StoreError> {
        work()
    }

    /// Keeps at most about so many bytes of what was read, where the store keeps it in this process.
    fn limit_cache(&self, bytes: usize) -> Result<(), StoreError> {
        let _ = bytes;
        Ok(())
    }

    /// Frees what the store keeps in this process of what was read.
    fn free_cache(&self) {}

    /// How a view (`viewOn`, `pipeline`) or a time series (`timeseries`) is defined; none where the name is that of a
    /// collection of documents, or of nothing.
    fn view(&self, ns: &Namespace) -> Result<Option<Document>, StoreError> {
        let _ = ns;
        Ok(None)
    }

    /// Removes a database whose collections were dropped before: those that follow it hear of that.
    fn note_dropped(&self, database: &str) -> Result<(), StoreError> {
        let _ = database;
        Ok(())
    }

    /// The number of the collection that has a name, where the store numbers them: one that takes the name later has another.
    fn number(&self, ns: &Namespace) -> Result<Option<i64>, StoreError> {
        let _ = ns;
        Ok(None)
    }

    /// Refuses a collection of which a reader would not find all documents, where that shows without reading them.
    ///
    /// # Errors
    /// Where that is so, or the store fails.
    fn check_whole(&self, ns: &Namespace) -> Result<(), StoreError> {
        let _ = ns;
        Ok(())
    }

    /// Brings what is in a write-ahead log into the file itself, where the store has one.
    fn fold(&self) -> Result<(), StoreError> {
        Ok(())
    }

    /// Whether documents that may be stored could be in a collection for a moment with no visible effect: no index would
    /// refuse or remove them, strings compare byte by byte, and no [`Store::watch`] gets computed documents.
    fn takes_any(&self, ns: &Namespace) -> Result<bool, StoreError> {
        let _ = ns;
        Ok(false)
    }

    /// Whether [`Store::atomically`] is atomic.
    fn is_atomic(&self) -> bool {
        false
    }

    /// Checks everything that the store keeps; `report` gets each damage, as a sentence. `None`
    /// where the store has no such check (a server checks itself).
    fn check(&self, report: &mut dyn FnMut(&str)) -> Result<Option<Checked>, StoreError> {
        let _ = report;
        Ok(None)
    }

    /// Checks a collection; `report` gets each damage, as a sentence. `None` where there is no such collection.
    ///
    /// # Errors
    /// Where the store cannot do that, or it cannot be read.
    fn validate(&self, ns: &Namespace, report: &mut dyn FnMut(&str)) -> Result<Option<Validated>, StoreError> {
        let _ = (ns, report);
        let reason = "a server checks its collections itself; connect to that".to_owned();
        Err(StoreError::Unfit { address: self.describe(), reason })
    }

    /// The bytes of the keys of each index of a collection, by its name, where the store knows them.
    fn index_sizes(&self, ns: &Namespace) -> Result<Vec<(String, i64)>, StoreError> {
        let _ = ns;
        Ok(Vec::new())
    }

    /// Copies the whole store, as it is at one moment, into a new file, while other processes use it.
    fn backup(&self, path: &Path) -> Result<(), StoreError> {
        let _ = path;
        let reason = "a server is not copied to a file; use `rmem dump --all`, or mongodump".to_owned();
        Err(StoreError::Unfit { address: self.describe(), reason })
    }

    /// What the store is, for `-v` and `doctor`; never shows credentials.
    fn describe(&self) -> String;
}
