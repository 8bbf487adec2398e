//! Where documents live. [`Store`] is what a memory asks of a database.
//!
//! Two kinds: [`embedded`], a file of this machine that several processes use
//! at once, and `mongodb`, a server or replica set reached through the official
//! driver. Both answer MongoDB's query and update languages, and both pass one
//! contract suite (`tests/integration`).

pub mod embedded;
#[cfg(feature = "mongodb")]
pub mod mongodb;

pub(crate) mod document;
pub(crate) mod holder;
pub mod index;
pub mod metadata;
pub mod namespace;
pub mod uri;
pub mod watch;

pub use document::{MAX_DEPTH, MAX_SIZE};
pub use embedded::Embedded;
pub use index::Index;
#[cfg(feature = "mongodb")]
pub use mongodb::MongoDb;
pub use namespace::{Namespace, NamespaceError};
pub use uri::{Role, StoreUri, UriError, open};
pub use watch::{Change, ChangeKind, Changes, Name, Next};

use bson::{Bson, DateTime, Document, RawDocumentBuf};

/// Documents in answer to a query, produced as they are asked for.
pub type Documents<'a> = Box<dyn Iterator<Item = Result<RawDocumentBuf, StoreError>> + 'a>;

/// What a memory asks of a database. Implementations are used from one thread
/// at a time, but several processes may use one database at once.
pub trait Store: Send {
    /// Stores the documents in order, giving an ObjectId `_id` (as the first
    /// key) to those that have none. Where one is not acceptable or its unique
    /// key is taken, those before it are stored, and [`StoreError::stored`]
    /// says which. Durable on return.
    fn insert(&self, ns: &Namespace, documents: Vec<Document>) -> Result<Inserted, StoreError>;

    /// The documents that match, lazily.
    fn find(&self, ns: &Namespace, find: &Find) -> Result<Documents<'_>, StoreError>;

    /// Answers a query to say how: `{index, keys, bounds}` of the index that is
    /// used (`index: null` where all documents are looked at; `any: [{…}]`
    /// where alternatives have one each), `sort: "index"` or `"memory"` where
    /// there is a sort, `keys_examined`, `documents_examined`, `returned`.
    fn explain(&self, ns: &Namespace, find: &Find) -> Result<Document, StoreError>;

    /// How many documents match.
    fn count(&self, ns: &Namespace, filter: &Document) -> Result<u64, StoreError>;

    /// The distinct values of a (dotted) field among matching documents, array
    /// elements counted one by one, in the order MongoDB gives them.
    fn distinct(&self, ns: &Namespace, field: &str, filter: &Document) -> Result<Vec<Bson>, StoreError>;

    /// The results of an aggregation pipeline.
    fn aggregate(&self, ns: &Namespace, pipeline: &[Document]) -> Result<Documents<'_>, StoreError>;

    /// Changes the first match, or all with `many`. Atomic per document. With
    /// a timestamp, what is changed says so under [`metadata::INFO`].
    fn update(
        &self,
        ns: &Namespace,
        update: &UpdateRequest,
        timestamp: Option<DateTime>,
    ) -> Result<Updated, StoreError>;

    /// Stores documents, each in place of the one with its `_id` where there is
    /// one, those without an `_id` under a new one; the stamp is as with
    /// [`Store::update`]. Durable on return.
    fn put(&self, ns: &Namespace, documents: Vec<Document>, timestamp: Option<DateTime>) -> Result<Put, StoreError>;

    /// Removes all matches, or the first only; returns how many.
    fn delete(&self, ns: &Namespace, filter: &Document, first_only: bool) -> Result<u64, StoreError>;

    /// Removes a whole collection; says whether there was one.
    fn drop(&self, ns: &Namespace) -> Result<bool, StoreError>;

    /// Gives the collection `from` the name `to`, in place of the one that has
    /// it, in one step. Both are in one database. Durable on return.
    fn rename(&self, from: &Namespace, to: &Namespace) -> Result<(), StoreError>;

    /// Makes an index, and the collection where there is none; says whether
    /// the index is new. Over documents that a unique index cannot be made of,
    /// nothing changes. Durable on return.
    fn create_index(&self, ns: &Namespace, index: &Index) -> Result<bool, StoreError>;

    /// Removes the index of that name; says whether there was one.
    fn drop_index(&self, ns: &Namespace, name: &str) -> Result<bool, StoreError>;

    /// The indexes of a collection, that on `_id` first; none where there is no collection.
    fn indexes(&self, ns: &Namespace) -> Result<Vec<Index>, StoreError>;

    /// All collections, sorted.
    fn collections(&self) -> Result<Vec<Namespace>, StoreError>;

    /// Follows the changes of a collection: from now on, or from where the one who had
    /// this name before was done. A name belongs to one collection, is kept in the
    /// store, and is followed by one process at a time.
    fn watch(&self, ns: &Namespace, name: Option<&str>) -> Result<Box<dyn Changes + '_>, StoreError>;

    /// Forgets a name of [`Store::watch`]; says whether there was one.
    fn forget(&self, ns: &Namespace, name: &str) -> Result<bool, StoreError>;

    /// All names of [`Store::watch`], sorted by collection.
    fn names(&self) -> Result<Vec<Name>, StoreError>;

    /// Runs operations so that all they do is kept or, where they fail, nothing; a process
    /// that is killed has done nothing. Others wait with their writes meanwhile. Where
    /// [`Store::is_atomic`] is false, the operations are just run.
    fn atomically(&self, work: &mut dyn FnMut() -> Result<(), StoreError>) -> Result<(), StoreError> {
        work()
    }

    /// Whether [`Store::atomically`] keeps its word.
    fn is_atomic(&self) -> bool {
        false
    }

    /// What the store is, for `-v` and `doctor`; never shows credentials.
    fn describe(&self) -> String;
}

/// A query with its modifiers.
#[derive(Debug, Clone, Default)]
pub struct Find {
    /// MongoDB's filter; empty matches everything.
    pub filter: Document,
    /// Keys with 1 or -1; empty leaves natural order (order of insertion).
    pub sort: Document,
    /// How many matches to pass over.
    pub skip: u64,
    /// At most so many; 0 is all.
    pub limit: u64,
    /// MongoDB's projection; empty keeps documents whole.
    pub projection: Document,
}

/// Operators (or a replacement, which is a document without them), or a pipeline.
#[derive(Debug, Clone)]
pub enum UpdateSpec {
    /// `{$set: …}` or a replacement document.
    Document(Document),
    /// `[{$set: …}, …]`.
    Pipeline(Vec<Document>),
}

/// Which documents to change, and how.
#[derive(Debug, Clone)]
pub struct UpdateRequest {
    /// Which documents.
    pub filter: Document,
    /// How.
    pub update: UpdateSpec,
    /// For `$[identifier]`.
    pub array_filters: Vec<Document>,
    /// All matches, not only the first.
    pub many: bool,
    /// Insert what filter and update describe where nothing matches.
    pub upsert: bool,
}

/// What an insert did.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Inserted {
    /// The `_id`s, in the order of the documents.
    pub ids: Vec<Bson>,
}

/// What [`Store::put`] did.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Put {
    /// How many are new.
    pub inserted: u64,
    /// How many took the place of another.
    pub replaced: u64,
    /// How many were there already, the same.
    pub same: u64,
}

/// What an update did.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Updated {
    /// How many documents matched.
    pub matched: u64,
    /// How many are different now.
    pub modified: u64,
    /// The `_id` of the document that an upsert made.
    pub upserted: Option<Bson>,
}

/// Why a store did not do what it was asked.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// No connection to a server, or no access to a file.
    #[error("cannot reach {address}: {reason}")]
    Unreachable {
        /// The address, without credentials.
        address: String,
        /// What went wrong.
        reason: String,
    },
    /// A unique key is taken.
    #[error("{namespace} already has a document with {key}")]
    Duplicate {
        /// Where.
        namespace: Namespace,
        /// The key and value, like `_id: 7`.
        key: String,
        /// The `_id`s stored before the failure.
        stored: Vec<Bson>,
    },
    /// The filter, update, projection, sort or pipeline, or a document, is not acceptable.
    #[error(transparent)]
    Query(#[from] crate::query::QueryError),
    /// An insert of several documents ended early.
    #[error("{}", match document { Some(nth) => format!("document {nth} cannot be stored"), None => "not all went well".to_owned() })]
    Stopped {
        /// The `_id`s stored before the failure.
        stored: Vec<Bson>,
        /// Which document is to blame, from 1, where it is one.
        document: Option<usize>,
        /// What went wrong.
        source: Box<StoreError>,
    },
    /// Another process, or another use, has what was asked for.
    #[error("{what}")]
    Held {
        /// What, who has it, and what to do.
        what: String,
    },
    /// A store of this kind cannot do what was asked.
    #[error("{address}: {reason}")]
    Unfit {
        /// The address, without credentials.
        address: String,
        /// Why, and what to do.
        reason: String,
    },
    /// Documents that are computed when a query asks for them could not be had.
    #[error("the computable `{name}` failed: {source}")]
    Computable {
        /// The computable.
        name: String,
        /// What went wrong.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// Anything else: disk full, no permission, a damaged file, a server's refusal.
    #[error("{address}: {reason}")]
    Failed {
        /// The address, without credentials.
        address: String,
        /// What went wrong, and what to do.
        reason: String,
    },
}

impl StoreError {
    /// The `_id`s that an insert stored before it failed.
    #[must_use]
    pub fn stored(&self) -> &[Bson] {
        match self {
            Self::Duplicate { stored, .. } | Self::Stopped { stored, .. } => stored,
            _ => &[],
        }
    }

    /// The error, saying which of `count` documents is to blame and which are stored.
    fn stopped(self, stored: Vec<Bson>, count: usize) -> Self {
        match self {
            Self::Duplicate { namespace, key, .. } => Self::Duplicate { namespace, key, stored },
            single if count == 1 => single,
            source => {
                let document = Some(stored.len() + 1);
                Self::Stopped { stored, document, source: Box::new(source) }
            }
        }
    }
}
