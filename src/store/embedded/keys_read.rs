//! The keys by which an index gave documents, in place of the documents (`returnKey`).

use bson::{Document, RawDocument, RawDocumentBuf};

use super::Embedded;
use super::access::{IDS, Listing};
use super::catalog::Collection;
use super::indexed::{Indexed, Indexes};
use super::scan::Scan;
use crate::query::QueryError;
use crate::query::index::Pattern;
use crate::store::{StoreError, index};

/// What is read of indexes.
pub(super) struct KeysRead {
    indexes: Indexes,
    /// Each index, or nothing for that on `_id` in the documents' table, and what is read of it.
    listings: Vec<(Option<usize>, Listing)>,
}

impl Embedded {
    /// The keys that a scan reads.
    ///
    /// # Errors
    /// Where they are not the values of documents.
    pub(super) fn keys_read(&self, collection: Collection, scan: &Scan<'_>) -> Result<KeysRead, StoreError> {
        let indexes = self.indexes_of(collection)?;
        let nth = |listing: &Listing| indexes.iter().position(|index| index.table() == listing.keys.table);
        let listings: Vec<_> = scan.listings().map(|listing| (nth(listing), listing.clone())).collect();
        let of = |(nth, _): &(Option<usize>, Listing)| nth.and_then(|nth| indexes.get(nth));
        if let Some(index) = listings.iter().filter_map(of).find(|index| !has_values(index)) {
            let of_what =
                format!("returnKey with the index {}, which is hashed or has a collation", index.definition.name);
            return Err(QueryError::unsupported(&of_what).into());
        }
        Ok(KeysRead { indexes, listings })
    }
}

impl KeysRead {
    /// The key by which a document was found; empty where that was not by an index.
    pub(super) fn of(&self, document: &RawDocument) -> Result<RawDocumentBuf, StoreError> {
        let keys = self.listings.iter().map(|(nth, listing)| {
            let index = nth.and_then(|nth| self.indexes.get(nth));
            // The application does not know of this one.
            if index.is_some_and(|index| index.definition.name == index::DECAY) {
                return Ok(None);
            }
            let entries = match index {
                Some(index) => index.entries(document)?,
                None => IDS.entries(document, false)?,
            };
            let read = |key: &&Vec<u8>| listing.ranges.iter().any(|range| range.low <= **key && **key < range.high);
            let mut found = entries.keys.iter().filter(read);
            let key = if listing.backwards { found.next_back() } else { found.next() };
            let pattern: &Pattern = index.map_or(&IDS, |index| &index.pattern);
            Ok(key.map(|key| pattern.values(document, key)))
        });
        let first: Option<Document> = keys.collect::<Result<Vec<_>, QueryError>>()?.into_iter().flatten().next();
        Ok(RawDocumentBuf::try_from(&first.unwrap_or_default()).map_err(QueryError::from)?)
    }
}

/// Whether the keys of an index are the values of documents.
fn has_values(index: &Indexed) -> bool {
    !index.pattern.is_hashed() && index.pattern.collation().is_none()
}
