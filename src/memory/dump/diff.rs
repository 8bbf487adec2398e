//! Comparing two worlds, document by document: dumps, world files, memories.
//!
//! Documents are paired by namespace and `_id` and compared without their
//! metadata; what a computable made is left out. A memory is read in the order
//! of `_id`, and so is a dump that has this order; any other dump is put in
//! order first, which takes as much memory as it has documents.

use std::iter::Peekable;

use bson::{Document, RawDocumentBuf};

use super::read::{Dump, Part, ReadError};
use crate::fault::{AtFault, Fault};
use crate::memory::Memory;
use crate::query::{QueryError, key};
use crate::store::document::with_id_first;
use crate::store::{Find, Namespace, StoreError, metadata};

/// One of the two that are compared.
pub enum Side {
    /// A dump or a world file.
    Dump(Dump),
    /// A memory.
    Memory(Memory),
}

/// A document that is not on both sides, the same.
#[derive(Debug, Clone, PartialEq)]
pub enum Difference {
    /// Only in the first.
    Removed(Document),
    /// Only in the second.
    Added(Document),
    /// In both, but not the same: the first's and the second's.
    Changed(Document, Document),
}

/// Why two worlds cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum DiffError {
    /// A dump cannot be read.
    #[error(transparent)]
    Dump(#[from] ReadError),
    /// A store fails.
    #[error("{0}")]
    Store(#[from] StoreError),
}

impl AtFault for DiffError {
    fn fault(&self) -> Fault {
        match self {
            Self::Dump(error) => error.fault(),
            Self::Store(error) => error.fault(),
        }
    }
}

impl From<QueryError> for DiffError {
    fn from(error: QueryError) -> Self {
        Self::Store(error.into())
    }
}

/// A document without its metadata, and the bytes its `_id` is ordered by.
type Keyed = (Vec<u8>, RawDocumentBuf);
/// What two sides have under one `_id`.
type Pair = (Option<RawDocumentBuf>, Option<RawDocumentBuf>);
type Ordered<'a> = Peekable<Box<dyn Iterator<Item = Result<Keyed, DiffError>> + 'a>>;

/// Reports each difference, in the order of namespaces and `_id`s; returns how many there are. Where `only` names
/// collections, no others are compared.
///
/// # Errors
/// Where one of the two cannot be read, or `report` fails.
pub fn compare<E: From<DiffError>>(
    first: &Side,
    second: &Side,
    only: &[Namespace],
    mut report: impl FnMut(&Namespace, Difference) -> Result<(), E>,
) -> Result<u64, E> {
    let mut namespaces = first.namespaces()?;
    namespaces.extend(second.namespaces()?);
    namespaces.sort();
    namespaces.dedup();
    namespaces.retain(|ns| only.is_empty() || only.contains(ns));
    let mut count = 0;
    for ns in &namespaces {
        let (mut first, mut second) = (first.documents(ns)?, second.documents(ns)?);
        while let Some(pair) = pair(&mut first, &mut second)? {
            if let Some(difference) = difference(pair).map_err(DiffError::from)? {
                report(ns, difference)?;
                count += 1;
            }
        }
    }
    Ok(count)
}

/// The next documents with the smallest `_id`.
fn pair(first: &mut Ordered<'_>, second: &mut Ordered<'_>) -> Result<Option<Pair>, DiffError> {
    let order = match (first.peek(), second.peek()) {
        (None, None) => return Ok(None),
        (Some(Ok((a, _))), Some(Ok((b, _)))) => a.cmp(b),
        (Some(_), None) | (Some(Err(_)), _) => std::cmp::Ordering::Less,
        (None, Some(_)) | (_, Some(Err(_))) => std::cmp::Ordering::Greater,
    };
    let take = |side: &mut Ordered<'_>| side.next().transpose().map(|found| found.map(|(_, document)| document));
    let first = if order.is_le() { take(first)? } else { None };
    let second = if order.is_ge() { take(second)? } else { None };
    Ok(Some((first, second)))
}

fn difference(pair: Pair) -> Result<Option<Difference>, QueryError> {
    let decode = |document: RawDocumentBuf| Document::try_from(&*document).map_err(QueryError::from);
    Ok(match pair {
        (Some(a), Some(b)) if a.as_bytes() == b.as_bytes() => None,
        (Some(a), Some(b)) => Some(Difference::Changed(decode(a)?, decode(b)?)),
        (Some(a), None) => Some(Difference::Removed(decode(a)?)),
        (None, Some(b)) => Some(Difference::Added(decode(b)?)),
        (None, None) => None,
    })
}

impl Side {
    /// The collections.
    ///
    /// # Errors
    /// Where the store fails.
    pub fn namespaces(&self) -> Result<Vec<Namespace>, DiffError> {
        match self {
            Self::Dump(dump) => Ok(dump.parts.iter().map(|part| part.namespace.clone()).collect()),
            Self::Memory(memory) => Ok(memory.collections()?),
        }
    }

    /// The documents of a namespace in the order of their `_id`s.
    fn documents(&self, ns: &Namespace) -> Result<Ordered<'_>, DiffError> {
        let documents: Box<dyn Iterator<Item = Result<Keyed, DiffError>>> = match self {
            Self::Memory(memory) => {
                let find = Find { sort: bson::doc! { "_id": 1 }, ..Find::default() };
                let found = memory.stored(ns, &find)?;
                Box::new(found.map(|document| Ok(keyed(document?)?)))
            }
            Self::Dump(dump) => {
                let parts: Vec<&Part> = dump.parts.iter().filter(|part| part.namespace == *ns).collect();
                match parts.as_slice() {
                    [part] if part.is_ordered() || is_ordered(part)? => Box::new(read(part)?),
                    parts => Box::new(in_order(parts)?.into_iter().map(Ok)),
                }
            }
        };
        Ok(documents.peekable())
    }
}

fn read(part: &Part) -> Result<impl Iterator<Item = Result<Keyed, DiffError>> + '_, DiffError> {
    Ok(part.documents()?.map(|document| Ok(encode(document?).and_then(keyed)?)))
}

fn is_ordered(part: &Part) -> Result<bool, DiffError> {
    let mut last = Vec::new();
    for document in read(part)? {
        let (key, _) = document?;
        if key < last {
            return Ok(false);
        }
        last = key;
    }
    Ok(true)
}

fn in_order(parts: &[&Part]) -> Result<Vec<Keyed>, DiffError> {
    let mut documents = Vec::new();
    for part in parts {
        for document in read(part)? {
            documents.push(document?);
        }
    }
    documents.sort_by(|(a, _), (b, _)| a.cmp(b));
    Ok(documents)
}

/// The document as a store would keep it: its `_id` first.
fn encode(document: Document) -> Result<RawDocumentBuf, QueryError> {
    let document = match document.get("_id").cloned() {
        Some(id) => with_id_first(document, &id),
        None => document,
    };
    Ok(RawDocumentBuf::try_from(&document)?)
}

fn keyed(document: RawDocumentBuf) -> Result<Keyed, QueryError> {
    let document = metadata::hide(document)?;
    let key = document.get("_id")?.map(key::encode).unwrap_or_default();
    Ok((key, document))
}
