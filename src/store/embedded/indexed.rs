//! An index as a store uses it, and the cache of indexes.

use std::collections::HashMap;
use std::ops::Deref;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use bson::RawDocument;

use super::catalog::Collection;
use super::keys::Keys;
use super::validating::Validating;
use crate::query::collation::during;
use crate::query::index::{Entries, Pattern};
use crate::query::{Filter, QueryError};
use crate::store::{Index, index};

/// An index, ready for use.
#[derive(Debug)]
pub(super) struct Indexed {
    pub(super) id: i64,
    pub(super) definition: Index,
    pub(super) pattern: Pattern,
    /// A bit for each path that runs through an array in some document.
    pub(super) multikey: AtomicU64,
    /// Only documents that match are in the index.
    partial: Option<Filter>,
    /// Whether its entries have checksums.
    pub(super) is_sealed: bool,
}

/// The option of an index that holds only documents which match a filter.
pub(super) const PARTIAL: &str = "partialFilterExpression";

/// How a collection is defined: its indexes, but for that on `_id`, and which documents it takes.
#[derive(Debug)]
pub(super) struct Defined {
    pub(super) indexes: Vec<Indexed>,
    pub(super) validation: Option<Validating>,
}

impl Deref for Defined {
    type Target = [Indexed];

    fn deref(&self) -> &[Indexed] {
        &self.indexes
    }
}

/// The definition of one collection.
pub(super) type Indexes = Arc<Defined>;

/// The cached indexes, by collection, with their generation.
#[derive(Debug, Default)]
pub(super) struct Remembered(Mutex<HashMap<i64, (i64, Indexes)>>);

impl Remembered {
    /// Clears the cache, after a transaction that may have changed it was rolled back.
    pub(super) fn clear(&self) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }

    /// The cached indexes of this generation or, in this store's own transaction, of a later one.
    pub(super) fn get(&self, collection: Collection) -> Option<Indexes> {
        let remembered = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let (generation, indexes) = remembered.get(&collection.id)?;
        (*generation >= collection.generation).then(|| Arc::clone(indexes))
    }

    pub(super) fn set(&self, collection: Collection, indexes: &Indexes) {
        let mut remembered = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        remembered.insert(collection.id, (collection.generation, Arc::clone(indexes)));
    }
}

impl Indexed {
    /// Makes an index of its definition ready for use.
    ///
    /// # Errors
    /// If the definition is none.
    pub(super) fn new(id: i64, definition: Index, multikey: u64, is_sealed: bool) -> Result<Self, QueryError> {
        let pattern = Pattern::parse_with(&definition.keys, &definition.other)?;
        let partial = definition.other.get_document(PARTIAL).ok();
        let partial = during(pattern.collation(), || partial.map(Filter::parse).transpose())?;
        Ok(Self { id, definition, pattern, multikey: AtomicU64::new(multikey), partial, is_sealed })
    }

    /// The name of the table with the keys.
    pub(super) fn table(&self) -> String {
        format!("entries_{}", self.id)
    }

    /// The table with the keys.
    pub(super) fn keys(&self) -> Keys {
        Keys::of_index(self.table(), self.is_sealed)
    }

    /// Whether there are keys: geospatial, wildcard and text indexes are in the catalogue only.
    pub(super) fn is_kept(&self) -> bool {
        !self.pattern.is_geospatial() && !self.pattern.is_wildcard() && self.pattern.text().is_none()
    }

    /// Whether queries may use it. A partial index is left to the documents it is unique or expires for: whether a query
    /// asks for its documents only is not examined.
    pub(super) fn is_used(&self) -> bool {
        self.is_kept() && self.partial.is_none() && !self.is_hidden()
    }

    /// Whether it is of all documents.
    pub(super) fn is_whole(&self) -> bool {
        self.partial.is_none()
    }

    /// Whether it is the index on `_id` of a collection with a collation: it is kept beside the documents' table, whose
    /// keys compare byte by byte, and its collation is that of the collection.
    pub(super) fn is_of_ids(&self) -> bool {
        self.definition.name == index::ID
    }

    /// Whether it is hidden from queries.
    pub(super) fn is_hidden(&self) -> bool {
        self.definition.is_hidden()
    }

    /// The paths that run through an array in some document, as bits.
    pub(super) fn multikey(&self) -> u64 {
        self.multikey.load(Ordering::Relaxed)
    }

    pub(super) fn entries(&self, body: &RawDocument) -> Result<Entries, QueryError> {
        match &self.partial {
            Some(partial) if !during(self.pattern.collation(), || partial.matches(body))? => Ok(Entries::default()),
            _ => self.pattern.entries(body, self.definition.sparse),
        }
    }
}

/// The keys of a document in all indexes, in their order.
pub(super) type AllEntries = Vec<Entries>;

/// The index on `_id` where the collection has a collation.
pub(super) fn of_ids(indexes: &[Indexed]) -> Option<&Indexed> {
    indexes.iter().find(|index| index.is_of_ids())
}

/// The index on the dates by which documents decay.
pub(super) fn decay(indexes: &[Indexed]) -> Option<&Indexed> {
    let is_decay = |index: &&Indexed| index.definition.name == index::DECAY;
    indexes.iter().find(is_decay)
}
