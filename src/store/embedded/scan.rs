//! Scanning a collection or an index, page by page.
//!
//! Each page is a statement of its own that goes on after the last position.
//! So a slow reader holds no read transaction, which would keep
//! the write-ahead log growing; memory stays flat; and an answer may be read
//! while the same store writes. A document is seen at most once, in the state
//! it has when its page is read, as with MongoDB's cursors; what is stored
//! after the scan began is not seen, so that it ends. In an index, writers
//! move documents, so its first page and the positions of the rest are read in one
//! transaction.

use std::cell::Cell;
use std::collections::VecDeque;
use std::rc::Rc;
use std::time::Instant;

use bson::{Document, RawDocument, RawDocumentBuf};
use rusqlite::params;

use super::access::{Chosen, Listing, Way};
use super::catalog::Collection;
use super::indexed::{Indexes, decay};
use super::page::PageError;
use super::snapshot::Snapshot;
use super::{Embedded, body, failure};
use crate::query::{Filter, Sort};
use crate::store::{Hint, StoreError, metadata};

/// The most bytes of documents in a page.
const PAGE_BYTES: usize = 256 << 10;
/// The most documents in a page.
const PAGE_DOCUMENTS: usize = 512;
/// The most documents examined for a page, matching or not.
const PAGE_ROWS: usize = 20_000;

/// A stored document and where it is.
pub(super) struct Found {
    pub(super) position: i64,
    pub(super) body: RawDocumentBuf,
}

/// Documents of a collection that match.
pub(super) struct Scan<'a> {
    store: &'a Embedded,
    collection: Collection,
    filter: Rc<Filter>,
    rest: Rest,
    page: VecDeque<Found>,
    page_documents: usize,
    /// More matches than this are not asked for.
    most: usize,
    is_sorted: bool,
    examined: Rc<Examined>,
}

/// What was looked at to answer a query.
#[derive(Debug, Default)]
pub(super) struct Examined {
    /// Keys of indexes.
    pub(super) keys: Cell<u64>,
    /// Documents.
    pub(super) documents: Cell<u64>,
}

impl Examined {
    fn add(counter: &Cell<u64>, more: u64) {
        counter.set(counter.get() + more);
    }
}

/// What has not been looked at.
enum Rest {
    /// The documents behind a position, up to another.
    Between(i64, i64),
    /// The documents at these positions.
    At(VecDeque<i64>),
    /// The documents that an index lists, in its order.
    Listed(Listing),
    Nothing,
}

/// Whether a page has room for more.
type More = bool;

impl<'a> Scan<'a> {
    /// The matches in order of insertion.
    pub(super) fn new(
        store: &'a Embedded,
        collection: Collection,
        filter: &mut Rc<Filter>,
    ) -> Result<Self, StoreError> {
        Ok(Self::choose(store, collection, filter, &Sort::none(), None, false)?.0)
    }

    /// The matches by the index that is to be read, or in the order of the sort, where an index has it, else in
    /// order of insertion; [`Scan::in_order`] says which.
    pub(super) fn sorted(
        store: &'a Embedded,
        collection: Collection,
        filter: &mut Rc<Filter>,
        sort: &Sort,
        hint: Option<&Hint>,
    ) -> Result<Self, StoreError> {
        Ok(Self::choose(store, collection, filter, sort, hint, false)?.0)
    }

    /// The same, with an explanation of the access path.
    pub(super) fn explained(
        store: &'a Embedded,
        collection: Collection,
        filter: &mut Rc<Filter>,
        sort: &Sort,
        hint: Option<&Hint>,
    ) -> Result<(Self, Document), StoreError> {
        Self::choose(store, collection, filter, sort, hint, true)
    }

    fn choose(
        store: &'a Embedded,
        collection: Collection,
        filter: &mut Rc<Filter>,
        sort: &Sort,
        hint: Option<&Hint>,
        is_explained: bool,
    ) -> Result<(Self, Document), StoreError> {
        let indexes = store.indexes_of(collection)?;
        sharpen(&indexes, filter);
        let mut chosen = match (filter.near(), hint) {
            _ if filter.search().is_some() => store.by_words(collection, &indexes, filter, (sort, hint))?,
            (None, Some(hint)) => store.hinted(collection, &indexes, filter, sort, hint)?,
            (Some(near), _) => store.by_distance(collection, &indexes, filter, near, sort)?,
            (None, None) => store.choose(collection, &indexes, filter, sort, is_explained)?,
        };
        let explanation = std::mem::take(&mut chosen.explanation);
        Ok((Self::along(store, collection, filter, chosen)?, explanation))
    }

    /// The matches by a way that was chosen.
    pub(super) fn along(
        store: &'a Embedded,
        collection: Collection,
        filter: &Rc<Filter>,
        chosen: Chosen,
    ) -> Result<Self, StoreError> {
        let last = |store: &Embedded| collection.last(&store.connection).map_err(|e| store.explain(&e));
        let rest = match chosen.way {
            _ if filter.matches_none() => Rest::Nothing,
            Way::Walk => Rest::Between(i64::MIN, last(store)?),
            Way::Positions(positions) => Rest::At(positions),
            // What it lists is read at one moment.
            Way::Listed(listing) => Rest::Listed(listing),
        };
        let examined = Examined { keys: Cell::new(chosen.keys), documents: Cell::default() };
        Ok(Self {
            store,
            collection,
            filter: Rc::clone(filter),
            // The rest of an index is listed with the first page, so that page is large.
            page_documents: if matches!(rest, Rest::Listed(_)) { PAGE_DOCUMENTS } else { 1 },
            rest,
            page: VecDeque::new(),
            most: usize::MAX,
            is_sorted: chosen.is_sorted,
            examined: Rc::new(examined),
        })
    }

    /// The same matches, of which no more than so many are asked for.
    pub(super) fn at_most(self, most: usize) -> Self {
        let page_documents = if most == usize::MAX { self.page_documents } else { most.clamp(1, PAGE_DOCUMENTS) };
        Self { most, page_documents, ..self }
    }

    /// Gives back the page that was read and not taken, so that it is read again.
    pub(super) fn unread(&mut self) {
        let positions: Vec<i64> = self.page.drain(..).map(|found| found.position).collect();
        let Some(first) = positions.first().copied() else { return };
        match &mut self.rest {
            Rest::Between(behind, _) => *behind = first - 1,
            Rest::At(rest) => positions.into_iter().rev().for_each(|position| rest.push_front(position)),
            rest @ (Rest::Nothing | Rest::Listed(_)) => *rest = Rest::At(positions.into()),
        }
    }

    /// Reads the first page now.
    pub(super) fn begun(mut self) -> Result<Self, StoreError> {
        if !matches!(self.rest, Rest::Nothing) {
            self.turn()?;
        }
        Ok(self)
    }

    /// Whether the matches come in the order of the sort.
    pub(super) fn in_order(&self) -> bool {
        self.is_sorted
    }

    /// What is looked at, counted as it is.
    pub(super) fn examined(&self) -> Rc<Examined> {
        Rc::clone(&self.examined)
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

    /// Reads the next page: small at first, for callers that want the first match
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
    fn read(&mut self, take: &mut dyn FnMut(i64, &RawDocument) -> More) -> Result<(), StoreError> {
        self.store.check_time()?;
        let was_listed = matches!(self.rest, Rest::Listed(_));
        let read = match std::mem::replace(&mut self.rest, Rest::Nothing) {
            Rest::Between(position, last) => self.read_between(position, last, take),
            Rest::At(positions) => self.read_at(positions, take),
            Rest::Listed(listing) => self.read_listed(listing, take),
            Rest::Nothing => Ok(Rest::Nothing),
        };
        self.rest = match read {
            Err(PageError::Store(error)) if failure::is_gone(&error) => {
                // A collection that another process dropped has no documents.
                if was_listed && self.collection.is_there(&self.store.connection).map_err(|e| self.store.explain(&e))? {
                    return Err(self.store.fail("an index was dropped while it was read; repeat the query"));
                }
                Rest::Nothing
            }
            Err(PageError::Store(error)) => return Err(self.store.explain(&error)),
            Err(PageError::Query(error)) => return Err(error.into()),
            Err(PageError::Damaged(damage, id)) => {
                return Err(self.store.damaged(self.collection, id.as_deref(), damage));
            }
            Ok(rest) => rest,
        };
        Ok(())
    }

    /// Whether the filter matches a document.
    fn matches(&self, document: &RawDocument) -> Result<bool, PageError> {
        self.filter.matches(document).map_err(PageError::Query)
    }

    fn read_between(
        &self,
        mut position: i64,
        last: i64,
        take: &mut dyn FnMut(i64, &RawDocument) -> More,
    ) -> Result<Rest, PageError> {
        let table = self.collection.table();
        let sql = format!("SELECT body, position FROM {table} WHERE position > ? ORDER BY position");
        let mut statement = self.store.connection.prepare_cached(&sql)?;
        let mut rows = statement.query([position])?;
        for nth in 1..=PAGE_ROWS {
            let Some(row) = rows.next()? else { return Ok(Rest::Nothing) };
            let body = body::of_column(row.get_ref(0)?)?;
            let is_match = self.matches(body)?;
            Examined::add(&self.examined.documents, 1);
            // The position is read only for matches: reading it costs time, too.
            if !is_match && nth < PAGE_ROWS {
                continue;
            }
            let behind = std::mem::replace(&mut position, row.get(1)?);
            failure::check_order(position, behind)?;
            if position > last {
                return Ok(Rest::Nothing);
            }
            if is_match && !take(position, body) {
                break;
            }
        }
        Ok(Rest::Between(position, last))
    }

    fn read_at(
        &self,
        mut positions: VecDeque<i64>,
        take: &mut dyn FnMut(i64, &RawDocument) -> More,
    ) -> Result<Rest, PageError> {
        // A transaction for each document would take longer than reading it.
        let _snapshot = (positions.len() > 1).then(|| Snapshot::begin(&self.store.connection)).transpose()?;
        let sql = format!("SELECT body FROM {} WHERE position = ?", self.collection.table());
        let mut statement = self.store.connection.prepare_cached(&sql)?;
        for _ in 0..PAGE_ROWS {
            let Some(position) = positions.pop_front() else { return Ok(Rest::Nothing) };
            let mut rows = statement.query([position])?;
            let Some(row) = rows.next()? else { continue };
            let body = body::of_column(row.get_ref(0)?)?;
            Examined::add(&self.examined.documents, 1);
            if self.matches(body)? && !take(position, body) {
                break;
            }
        }
        Ok(Rest::At(positions))
    }

    /// Reads a page, and where the rest is, at one moment.
    fn read_listed(
        &self,
        mut listing: Listing,
        take: &mut dyn FnMut(i64, &RawDocument) -> More,
    ) -> Result<Rest, PageError> {
        let _snapshot = Snapshot::begin(&self.store.connection)?;
        let sql = listing.documents_sql(&self.collection.table());
        let mut statement = self.store.connection.prepare_cached(&sql)?;
        let mut taken = 0;
        while let Some(range) = listing.ranges.front() {
            let (from, to) = if listing.backwards { (&range.high, &range.low) } else { (&range.low, &range.high) };
            let mut rows = statement.query(params![from, i64::MIN, to])?;
            while let Some(row) = rows.next()? {
                Examined::add(&self.examined.keys, 1);
                Examined::add(&self.examined.documents, 1);
                let position = row.get(1)?;
                let body = body::of_column(row.get_ref(2)?)?;
                if !self.matches(body)? {
                    continue;
                }
                taken += 1;
                if !take(position, body) {
                    let key: Vec<u8> = row.get(0)?;
                    drop(rows);
                    return if taken >= self.most { Ok(Rest::Nothing) } else { self.list(listing, (key, position)) };
                }
            }
            drop(rows);
            listing.ranges.pop_front();
        }
        Ok(Rest::Nothing)
    }

    /// Where the documents are that the index lists behind a key and a position.
    fn list(&self, mut listing: Listing, behind: (Vec<u8>, i64)) -> Result<Rest, PageError> {
        let mut statement = self.store.connection.prepare_cached(&listing.positions_sql())?;
        let (mut behind, mut positions) = (Some(behind), VecDeque::new());
        while let Some(range) = listing.ranges.pop_front() {
            let (from, to) = if listing.backwards { (range.high, range.low) } else { (range.low, range.high) };
            let (key, position) = behind.take().unwrap_or((from, i64::MIN));
            let mut rows = statement.query(params![key, position, to])?;
            while let Some(row) = rows.next()? {
                positions.push_back(row.get(0)?);
            }
        }
        Examined::add(&self.examined.keys, positions.len() as u64);
        Ok(Rest::At(positions))
    }
}

impl Listing {
    /// What reads the documents of a range behind a key and a position.
    fn documents_sql(&self, documents: &str) -> String {
        let (from, index) = match self.table == documents {
            true => (documents.to_owned(), documents),
            false => (format!("{0} CROSS JOIN {documents} USING (position)", self.table), self.table.as_str()),
        };
        format!("SELECT {index}.key, {index}.position, {documents}.body FROM {from} {}", self.range(index))
    }

    /// What reads only where they are.
    fn positions_sql(&self) -> String {
        format!("SELECT position FROM {} {}", self.table, self.range(&self.table))
    }

    fn range(&self, index: &str) -> String {
        let (behind, before, order) = if self.backwards { ("<", ">=", "DESC") } else { (">", "<", "ASC") };
        format!(
            "WHERE ({index}.key, {index}.position) {behind} (?1, ?2) AND {index}.key {before} ?3 \
             ORDER BY {index}.key {order}, {index}.position {order}"
        )
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

impl Embedded {
    /// Refuses to go on reading where the time for it is over.
    fn check_time(&self) -> Result<(), StoreError> {
        match self.reads_until.get() {
            Some(until) if Instant::now() >= until => {
                Err(StoreError::Held { what: "what reads while writers wait takes too long".to_owned() })
            }
            _ => Ok(()),
        }
    }
}

/// Removes the conditions on decay and computation from a filter where the collection has no decaying documents.
/// Computed documents decay.
pub(super) fn sharpen(indexes: &Indexes, filter: &mut Rc<Filter>) {
    if let (None, Some(filter)) = (decay(indexes), Rc::get_mut(filter)) {
        filter.assume_missing(&[metadata::DECAY_PATH, metadata::TOKEN_PATH]);
    }
}
