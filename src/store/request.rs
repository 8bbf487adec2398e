//! The requests and results of operations.

use bson::{Bson, Document};

use super::key_options::KeyOptions;
use super::modifiers::Modifiers;
use crate::query::{QueryError, Update};

/// Which documents are meant. A filter alone is a query without modifiers.
///
/// ```
/// use rmem::store::{Embedded, Modifiers, Namespace, Query, Store};
/// # use bson::doc;
/// let (store, ns) = (Embedded::in_memory()?, Namespace::parse("lab.cups")?);
/// let (filter, modifiers) = (doc! { "color": "red" }, Modifiers::default());
/// assert_eq!(store.count(&ns, (&filter).into())?, 0);
/// assert_eq!(store.count(&ns, Query { filter: &filter, modifiers: &modifiers })?, 0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Query<'q> {
    /// MongoDB's filter; empty matches everything.
    pub filter: &'q Document,
    /// Collation, variables, and the index to be read.
    pub modifiers: &'q Modifiers,
}

impl<'q> From<&'q Document> for Query<'q> {
    fn from(filter: &'q Document) -> Self {
        Self { filter, modifiers: Modifiers::none() }
    }
}

/// The stages of an aggregation. Stages alone are a pipeline without modifiers.
#[derive(Debug, Clone, Copy)]
pub struct Aggregation<'p> {
    /// The stages, in order.
    pub stages: &'p [Document],
    /// Collation, variables, and the index to be read.
    pub modifiers: &'p Modifiers,
}

impl<'p> From<&'p [Document]> for Aggregation<'p> {
    fn from(stages: &'p [Document]) -> Self {
        Self { stages, modifiers: Modifiers::none() }
    }
}

impl<'p> From<&'p Vec<Document>> for Aggregation<'p> {
    fn from(stages: &'p Vec<Document>) -> Self {
        stages.as_slice().into()
    }
}

impl<'p, const N: usize> From<&'p [Document; N]> for Aggregation<'p> {
    fn from(stages: &'p [Document; N]) -> Self {
        stages.as_slice().into()
    }
}

/// Which documents to return, in which order, and what of them.
#[derive(Debug, Clone, Default)]
pub struct Find {
    /// MongoDB's filter; empty matches everything.
    pub filter: Document,
    /// Keys with 1 (ascending) or -1 (descending); empty keeps the order of insertion.
    pub sort: Document,
    /// How many matches to skip.
    pub skip: u64,
    /// The most documents to return; 0 returns all.
    pub limit: u64,
    /// MongoDB's projection; empty keeps documents whole.
    pub projection: Document,
    /// Collation, variables, and the index to be read.
    pub modifiers: Modifiers,
    /// Whether the primary of a replica set is read, whatever the URI says of reads: for what a write depends on, since other
    /// members may be behind.
    pub current: bool,
    /// Between which keys of the hinted index, and whether keys or places are returned.
    pub keys: KeyOptions,
}

impl Find {
    /// The same with another filter.
    #[must_use]
    pub fn with_filter(&self, filter: Document) -> Self {
        let (sort, projection, modifiers) = (self.sort.clone(), self.projection.clone(), self.modifiers.clone());
        let (skip, limit, current, keys) = (self.skip, self.limit, self.current, self.keys.clone());
        Self { filter, sort, skip, limit, projection, modifiers, current, keys }
    }
}

/// Operators (or a replacement, which is a document without them), or a pipeline.
#[derive(Debug, Clone)]
pub enum UpdateSpec {
    /// `{$set: …}` or a replacement document.
    Document(Document),
    /// `[{$set: …}, …]`.
    Pipeline(Vec<Document>),
}

impl UpdateSpec {
    /// Compiles the update.
    ///
    /// # Errors
    /// Where it is none, or a pipeline with array filters.
    pub(crate) fn compile(&self, array_filters: &[Document], constants: &Document) -> Result<Update, QueryError> {
        match self {
            Self::Document(document) => Update::parse(document, array_filters),
            Self::Pipeline(_) if !array_filters.is_empty() => {
                Err(QueryError::failed_to_parse("a pipeline takes no array filters"))
            }
            Self::Pipeline(stages) => Update::parse_pipeline_with(stages, constants),
        }
    }
}

impl Default for UpdateSpec {
    fn default() -> Self {
        Self::Pipeline(Vec::new())
    }
}

/// Which documents to change, and how; the default changes nothing of the first document.
#[derive(Debug, Clone, Default)]
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
    /// Collation, variables, and the index to be read.
    pub modifiers: Modifiers,
}

/// What an insert did.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Inserted {
    /// The `_id`s, in the order of the documents.
    pub ids: Vec<Bson>,
}

/// What [`put`](super::Store::put) did.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Put {
    /// How many are new.
    pub inserted: u64,
    /// How many took the place of another.
    pub replaced: u64,
    /// How many were there already, the same.
    pub same: u64,
}

/// What a check of a store has looked at.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Checked {
    /// How many collections.
    pub collections: u64,
    /// How many documents.
    pub documents: u64,
    /// How many documents have no checksum, because an earlier rmem stored them.
    pub unsealed: u64,
    /// How many indexes.
    pub indexes: u64,
}

/// What a check of one collection has found ([`super::Store::validate`]).
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Validated {
    /// How many documents there are.
    pub documents: u64,
    /// How many of them are damaged.
    pub damaged: u64,
    /// The indexes, that on `_id` first.
    pub indexes: Vec<ValidatedIndex>,
}

/// An index of a collection that was checked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ValidatedIndex {
    /// Its name.
    pub name: String,
    /// How many keys it has; none where it is in the catalogue only.
    pub keys: u64,
    /// Whether it has the keys of all documents, and no others.
    pub is_sound: bool,
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
