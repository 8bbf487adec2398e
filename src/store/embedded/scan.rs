//! Walking over a collection, page by page.
//!
//! Each page is a statement of its own that goes on after the last position.
//! So a reader that takes its time holds no read transaction, which would keep
//! the write-ahead log growing; memory stays flat; and an answer may be read
//! while the same store writes. A document is seen at most once, in the state
//! it has when its page is read, as with MongoDB's cursors.

use std::collections::VecDeque;

use bson::{RawDocument, RawDocumentBuf};
use rusqlite::{Connection, ToSql};

use super::catalog::Collection;
use super::language::Filter;
use super::{Embedded, failure};
use crate::store::StoreError;

/// At most so many bytes of documents wait to be taken.
const PAGE_BYTES: usize = 256 << 10;
/// At most so many documents wait to be taken.
const PAGE_DOCUMENTS: usize = 512;
/// After so many documents that do not match, a page ends nevertheless.
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
    filter: Filter,
    /// The documents that can match at all, where the filter asks for `_id`s.
    keys: Option<Vec<Vec<u8>>>,
    after: i64,
    page: VecDeque<Found>,
    page_documents: usize,
    exhausted: bool,
}

impl<'a> Scan<'a> {
    pub(super) fn new(store: &'a Embedded, collection: Collection, filter: Filter) -> Self {
        Self {
            store,
            collection,
            filter,
            keys: None,
            after: i64::MIN,
            page: VecDeque::new(),
            page_documents: 1,
            exhausted: false,
        }
    }

    /// Reads on until a page is full or the collection ends.
    fn read(&mut self) -> Result<(), StoreError> {
        let read = self.read_page(&self.store.connection);
        match read {
            Ok(page) => {
                self.after = page.after;
                self.exhausted = page.exhausted;
                self.page = page.found;
                self.page_documents = (self.page_documents * 4).min(PAGE_DOCUMENTS);
                Ok(())
            }
            Err(error) if failure::is_gone(&error) => {
                self.exhausted = true;
                Ok(())
            }
            Err(error) => {
                self.exhausted = true;
                Err(failure::explain(&self.store.place, &error))
            }
        }
    }

    fn read_page(&self, connection: &Connection) -> rusqlite::Result<Page> {
        let sql =
            format!("SELECT position, body FROM {} WHERE position > ? ORDER BY position", self.collection.table());
        let mut statement = connection.prepare_cached(&sql)?;
        let mut rows = statement.query([&self.after as &dyn ToSql])?;
        let mut page = Page { found: VecDeque::new(), after: self.after, exhausted: false };
        let (mut bytes, mut passed) = (0, 0);
        while page.found.len() < self.page_documents && bytes < PAGE_BYTES && passed < PAGE_ROWS {
            let Some(row) = rows.next()? else {
                page.exhausted = true;
                break;
            };
            page.after = row.get(0)?;
            passed += 1;
            let body = document(row.get_ref(1)?.as_blob()?)?;
            if self.filter.matches(body) {
                bytes += body.as_bytes().len();
                page.found.push_back(Found { position: page.after, body: body.to_owned() });
            }
        }
        Ok(page)
    }
}

struct Page {
    found: VecDeque<Found>,
    after: i64,
    exhausted: bool,
}

/// The document that a body is.
pub(super) fn document(body: &[u8]) -> rusqlite::Result<&RawDocument> {
    RawDocument::from_bytes(body)
        .map_err(|error| rusqlite::Error::FromSqlConversionFailure(1, rusqlite::types::Type::Blob, Box::new(error)))
}

impl Iterator for Scan<'_> {
    type Item = Result<Found, StoreError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(found) = self.page.pop_front() {
                return Some(Ok(found));
            }
            if self.exhausted {
                return None;
            }
            if let Err(error) = self.read() {
                return Some(Err(error));
            }
        }
    }
}
