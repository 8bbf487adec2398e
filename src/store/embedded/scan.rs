//! Walking over a collection, page by page.
//!
//! Each page is a statement of its own that goes on after the last position.
//! So a reader that takes its time holds no read transaction, which would keep
//! the write-ahead log growing; memory stays flat; and an answer may be read
//! while the same store writes. A document is seen at most once, in the state
//! it has when its page is read, as with MongoDB's cursors; what is stored
//! after the walk began is not seen, so that it ends.

use std::collections::VecDeque;
use std::rc::Rc;

use bson::{RawDocument, RawDocumentBuf};
use rusqlite::OptionalExtension as _;

use super::catalog::Collection;
use super::{Embedded, failure};
use crate::query::{Filter, key};
use crate::store::StoreError;

/// At most so many bytes of documents wait to be taken.
const PAGE_BYTES: usize = 256 << 10;
/// At most so many documents wait to be taken.
const PAGE_DOCUMENTS: usize = 512;
/// After so many documents, matching or not, a page ends.
const PAGE_ROWS: usize = 20_000;

/// A stored document and where it is.
pub(super) struct Found {
    pub(super) position: i64,
    pub(super) body: RawDocumentBuf,
}

/// Documents of a collection that match, in order of insertion.
pub(super) struct Scan<'a> {
    store: &'a Embedded,
    collection: Collection,
    filter: Rc<Filter>,
    rest: Rest,
    page: VecDeque<Found>,
    page_documents: usize,
}

/// What has not been looked at.
enum Rest {
    /// The documents behind a position, up to another.
    Between(i64, i64),
    /// The documents at these positions, for a filter that names its `_id`s.
    At(VecDeque<i64>),
    Nothing,
}

/// Whether a page has room for more.
type Room = bool;

impl<'a> Scan<'a> {
    pub(super) fn new(store: &'a Embedded, collection: Collection, filter: Rc<Filter>) -> Result<Self, StoreError> {
        let rest = match filter.ids() {
            Some(ids) => Rest::At(positions(store, collection, &ids).map_err(|e| store.explain(&e))?),
            None => Rest::Between(i64::MIN, collection.last(&store.connection).map_err(|e| store.explain(&e))?),
        };
        Ok(Self { store, collection, filter, rest, page: VecDeque::new(), page_documents: 1 })
    }

    /// How many documents match.
    pub(super) fn count(mut self) -> Result<u64, StoreError> {
        let mut count = 0;
        while !matches!(self.rest, Rest::Nothing) {
            self.read(&mut |_, _| {
                count += 1;
                true
            })?;
        }
        Ok(count)
    }

    /// Reads the next page: small at first, for those who want the first match
    /// only, then larger.
    fn turn(&mut self) -> Result<(), StoreError> {
        let (most, mut page, mut bytes) = (self.page_documents, VecDeque::new(), 0);
        let read = self.read(&mut |position, body| {
            bytes += body.as_bytes().len();
            page.push_back(Found { position, body: body.to_owned() });
            page.len() < most && bytes < PAGE_BYTES
        });
        self.page = page;
        self.page_documents = (most * 4).min(PAGE_DOCUMENTS);
        read
    }

    /// Shows matching documents to `take` until it has no room, or enough have been looked at.
    fn read(&mut self, take: &mut dyn FnMut(i64, &RawDocument) -> Room) -> Result<(), StoreError> {
        let read = match std::mem::replace(&mut self.rest, Rest::Nothing) {
            Rest::Between(position, last) => self.read_between(position, last, take),
            Rest::At(positions) => self.read_at(positions, take),
            Rest::Nothing => Ok(Rest::Nothing),
        };
        self.rest = match read {
            Err(Trouble::Store(error)) if failure::is_gone(&error) => Rest::Nothing,
            Err(Trouble::Store(error)) => return Err(self.store.explain(&error)),
            Err(Trouble::Query(error)) => return Err(error.into()),
            Ok(rest) => rest,
        };
        Ok(())
    }

    fn read_between(
        &self,
        mut position: i64,
        last: i64,
        take: &mut dyn FnMut(i64, &RawDocument) -> Room,
    ) -> Result<Rest, Trouble> {
        let table = self.collection.table();
        let sql = format!("SELECT position, body FROM {table} WHERE position > ? AND position <= ? ORDER BY position");
        let mut statement = self.store.connection.prepare_cached(&sql)?;
        let mut rows = statement.query([position, last])?;
        for _ in 0..PAGE_ROWS {
            let Some(row) = rows.next()? else { return Ok(Rest::Nothing) };
            position = row.get(0)?;
            let body = document(row.get_ref(1)?)?;
            if self.filter.matches(body)? && !take(position, body) {
                break;
            }
        }
        Ok(Rest::Between(position, last))
    }

    fn read_at(
        &self,
        mut positions: VecDeque<i64>,
        take: &mut dyn FnMut(i64, &RawDocument) -> Room,
    ) -> Result<Rest, Trouble> {
        let sql = format!("SELECT body FROM {} WHERE position = ?", self.collection.table());
        let mut statement = self.store.connection.prepare_cached(&sql)?;
        while let Some(position) = positions.pop_front() {
            let mut rows = statement.query([position])?;
            let Some(row) = rows.next()? else { continue };
            let body = document(row.get_ref(0)?)?;
            if self.filter.matches(body)? && !take(position, body) {
                return Ok(Rest::At(positions));
            }
        }
        Ok(Rest::Nothing)
    }
}

impl Iterator for Scan<'_> {
    type Item = Result<Found, StoreError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(found) = self.page.pop_front() {
                return Some(Ok(found));
            }
            if matches!(self.rest, Rest::Nothing) {
                return None;
            }
            if let Err(error) = self.turn() {
                self.page.clear();
                return Some(Err(error));
            }
        }
    }
}

/// Where the documents with these `_id`s are, in order of insertion.
fn positions(store: &Embedded, collection: Collection, ids: &[bson::Bson]) -> rusqlite::Result<VecDeque<i64>> {
    let sql = format!("SELECT position FROM {} WHERE key = ?", collection.table());
    let mut statement = match store.connection.prepare_cached(&sql) {
        Err(error) if failure::is_gone(&error) => return Ok(VecDeque::new()),
        prepared => prepared?,
    };
    let mut positions = Vec::with_capacity(ids.len());
    for id in ids {
        positions.extend(statement.query_row([key::encode_value(id)], |row| row.get::<_, i64>(0)).optional()?);
    }
    positions.sort_unstable();
    positions.dedup();
    Ok(positions.into())
}

/// The document that a column holds.
fn document(column: rusqlite::types::ValueRef<'_>) -> Result<&RawDocument, Trouble> {
    RawDocument::from_bytes(column.as_blob().map_err(rusqlite::Error::from)?)
        .map_err(|error| Trouble::Query(crate::query::QueryError::from(error)))
}

/// Either of the two things that can go wrong in a page.
enum Trouble {
    Store(rusqlite::Error),
    Query(crate::query::QueryError),
}

impl From<rusqlite::Error> for Trouble {
    fn from(error: rusqlite::Error) -> Self {
        Self::Store(error)
    }
}

impl From<crate::query::QueryError> for Trouble {
    fn from(error: crate::query::QueryError) -> Self {
        Self::Query(error)
    }
}
