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

mod examined;
mod found;
mod limit;
mod listing;
mod read;
mod sharing;

use std::cell::Cell;
use std::collections::VecDeque;
use std::rc::Rc;
use std::sync::Arc;

use bson::{Document, RawDocument};

use super::access::{Chosen, Listing, Way};
use super::ahead::{Ahead, Slot, Turn};
use super::catalog::Collection;
use super::indexed::{Indexes, decay};
use super::page::PageError;
use super::{Embedded, failure};
use crate::query::{Filter, Sort, collation};
use crate::store::{Hint, StoreError, metadata};
use found::Page;
use limit::check_deadline;
use sharing::{LONG, Sharing};

pub(super) use examined::Examined;
pub(super) use found::Found;

/// The most bytes of documents in a page.
const PAGE_BYTES: usize = 256 << 10;
/// The most documents in a page.
const PAGE_DOCUMENTS: usize = 512;

/// Documents of a collection that match.
pub(super) struct Scan<'a> {
    store: &'a Embedded,
    collection: Collection,
    filter: Arc<Filter>,
    rest: Rest,
    page: VecDeque<Found>,
    /// Whether matches before a document at which the filter fails are found first.
    is_up_to_failure: bool,
    /// That failure, until they are.
    failure: Option<StoreError>,
    page_documents: usize,
    /// More matches than this are not asked for.
    most: usize,
    is_sorted: bool,
    examined: Rc<Examined>,
    sharing: Sharing,
}

/// What has not been looked at.
enum Rest {
    /// The documents behind a position, up to another.
    Between(i64, i64),
    /// The documents at these positions.
    At(VecDeque<i64>),
    /// The documents that an index lists, in its order.
    Listed(Listing),
    /// What the second thread has read.
    Ahead,
    Nothing,
}

/// Whether a page has room for more.
type More = bool;

impl<'a> Scan<'a> {
    /// The matches in order of insertion.
    pub(super) fn new(
        store: &'a Embedded,
        collection: Collection,
        filter: &mut Arc<Filter>,
    ) -> Result<Self, StoreError> {
        Ok(Self::choose(store, collection, filter, &Sort::none(), None, false)?.0)
    }

    /// The matches by the index that is to be read, or in the order of the sort, where an index has it, else in
    /// order of insertion; [`Scan::in_order`] says which.
    pub(super) fn sorted(
        store: &'a Embedded,
        collection: Collection,
        filter: &mut Arc<Filter>,
        sort: &Sort,
        hint: Option<&Hint>,
    ) -> Result<Self, StoreError> {
        Ok(Self::choose(store, collection, filter, sort, hint, false)?.0)
    }

    /// The same, with an explanation of the access path.
    pub(super) fn explained(
        store: &'a Embedded,
        collection: Collection,
        filter: &mut Arc<Filter>,
        sort: &Sort,
        hint: Option<&Hint>,
    ) -> Result<(Self, Document), StoreError> {
        Self::choose(store, collection, filter, sort, hint, true)
    }

    fn choose(
        store: &'a Embedded,
        collection: Collection,
        filter: &mut Arc<Filter>,
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
        filter: &Arc<Filter>,
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
            filter: Arc::clone(filter),
            // The rest of an index is listed with the first page, so that page is large.
            page_documents: if matches!(rest, Rest::Listed(_)) { PAGE_DOCUMENTS } else { 1 },
            rest,
            page: VecDeque::new(),
            is_up_to_failure: false,
            failure: None,
            most: usize::MAX,
            is_sorted: chosen.is_sorted,
            examined: Rc::new(examined),
            sharing: Sharing::never(),
        })
    }

    /// The matches behind a position, up to another.
    fn stretch(store: &'a Embedded, collection: Collection, filter: &Arc<Filter>, (behind, last): (i64, i64)) -> Self {
        Self {
            store,
            collection,
            filter: Arc::clone(filter),
            page_documents: PAGE_DOCUMENTS,
            rest: Rest::Between(behind, last),
            page: VecDeque::new(),
            is_up_to_failure: false,
            failure: None,
            most: usize::MAX,
            is_sorted: false,
            examined: Rc::default(),
            sharing: Sharing::stretch(),
        }
    }

    /// The same matches, of which a second thread may read a part; not for what writes while it reads.
    pub(super) fn shared(self) -> Self {
        Self { sharing: Sharing::where_long(false), ..self }
    }

    /// The same matches, those before a document at which the filter fails among them: for what changes one after the other.
    pub(super) fn up_to_failure(self) -> Self {
        Self { is_up_to_failure: true, ..self }
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
            rest @ (Rest::Nothing | Rest::Listed(_) | Rest::Ahead) => *rest = Rest::At(positions.into()),
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
        self.sharing = Sharing::where_long(true);
        let mut count = 0;
        while !matches!(self.rest, Rest::Nothing) {
            count += self.counted()?;
        }
        Ok(count)
    }

    /// How many documents of the next page match.
    fn counted(&mut self) -> Result<u64, StoreError> {
        if matches!(self.rest, Rest::Ahead) {
            return Ok(self.take_page()?.number);
        }
        let mut count = 0;
        self.read(&mut |_, _| {
            count += 1;
            true
        })?;
        Ok(count)
    }

    /// Reads the next page; with the matches, or with their number.
    fn page(&mut self, is_counted: bool) -> Result<Page, StoreError> {
        let before = self.examined.documents.get();
        let number = if is_counted { self.counted()? } else { self.turn().map(|()| 0)? };
        let documents = self.examined.documents.get() - before;
        let is_last = matches!(self.rest, Rest::Nothing);
        let found = std::mem::take(&mut self.page);
        let (first, next) = self.sharing.ends();
        Ok(Page { found, number, documents, is_last, first, next })
    }

    /// The next page of what the second thread has read.
    fn take_page(&mut self) -> Result<Page, StoreError> {
        let page = match self.sharing.ahead() {
            Some(ahead) => ahead.piece().unwrap_or_else(|| Err(self.store.fail("a thread that reads it ended"))),
            None => Ok(Page { is_last: true, ..Page::default() }),
        };
        let page = page.inspect_err(|_| self.rest = Rest::Nothing)?;
        Examined::add(&self.examined.documents, page.documents);
        if let Some(Err(error)) = page.first.map(|first| self.check_seam(first)) {
            self.rest = Rest::Nothing;
            // A collection that another process dropped has no documents.
            return if failure::is_gone(&error) { Ok(Page::default()) } else { Err(self.store.explain(&error)) };
        }
        if page.is_last {
            self.sharing.leave(page.next);
            self.rest = self.next_stretch();
        }
        Ok(page)
    }

    /// What is to be read after a stretch.
    fn next_stretch(&mut self) -> Rest {
        match self.sharing.turn() {
            Turn::Own(behind, last) => Rest::Between(behind, last),
            Turn::Other => Rest::Ahead,
            Turn::Over => Rest::Nothing,
        }
    }

    /// Shares what is left with a second thread where the scan has become a long one.
    fn share(&mut self) {
        let (Some(is_counted), Rest::Between(behind, last)) = (self.sharing.is_counted_where_long(), &self.rest) else {
            return;
        };
        if self.examined.documents.get() < LONG as u64 {
            return;
        }
        self.sharing = self.ahead((*behind, *last), is_counted).map_or_else(Sharing::never, Sharing::with);
        if self.sharing.is_part() {
            self.rest = self.next_stretch();
        }
    }

    /// Starts a second thread for the documents behind a position, up to another. There is none where it is not worth it, where
    /// what is read is of one moment, or where all processors have such threads.
    fn ahead(&self, (behind, last): (i64, i64), is_counted: bool) -> Option<Ahead<Result<Page, StoreError>>> {
        let is_of_a_moment = !self.store.connection.is_autocommit() || self.store.reads_until.get().is_some();
        if last.saturating_sub(behind) < LONG as i64 || is_of_a_moment || collation::is_in_effect() {
            return None;
        }
        let slot = Slot::take()?;
        let lent = self.store.spare.lend(|| self.store.again())?;
        let (collection, filter) = (self.collection, Arc::clone(&self.filter));
        Ahead::start(slot, (behind, last), move |stretch, send| {
            let Some(store) = lent.store() else { return false };
            let mut scan = Scan::stretch(store, collection, &filter, stretch);
            loop {
                let page = scan.page(is_counted);
                let is_last = page.as_ref().map(|page| page.is_last).ok();
                match (send(page), is_last) {
                    (true, Some(false)) => {}
                    (is_taken, is_last) => return is_taken && is_last.is_some(),
                }
            }
        })
    }

    /// Reads the next page: small at first, for callers that want the first match
    /// only, then larger.
    fn turn(&mut self) -> Result<(), StoreError> {
        if matches!(self.rest, Rest::Ahead) {
            self.page = self.take_page()?.found;
            return Ok(());
        }
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
        self.share();
        let was_listed = matches!(self.rest, Rest::Listed(_));
        let read = match std::mem::replace(&mut self.rest, Rest::Nothing) {
            Rest::Between(position, last) => self.read_between(position, last, take),
            Rest::At(positions) => self.read_at(positions, take),
            Rest::Listed(listing) => self.read_listed(listing, take),
            rest @ (Rest::Ahead | Rest::Nothing) => Ok(rest),
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
            Ok(Rest::Nothing) => self.next_stretch(),
            Ok(rest) => rest,
        };
        Ok(())
    }
}

impl Iterator for Scan<'_> {
    type Item = Result<Found, StoreError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Err(error) = check_deadline() {
                (self.rest, self.page) = (Rest::Nothing, VecDeque::new());
                return Some(Err(error));
            }
            if let Some(found) = self.page.pop_front() {
                return Some(Ok(found));
            }
            if matches!(self.rest, Rest::Nothing) {
                return self.failure.take().map(Err);
            }
            match self.turn() {
                Err(error) if self.is_up_to_failure && error.is_of_document() => self.failure = Some(error),
                Err(error) => {
                    self.page.clear();
                    return Some(Err(error));
                }
                Ok(()) => {}
            }
        }
    }
}

/// Removes the conditions on decay and computation from a filter where the collection has no decaying documents.
/// Computed documents decay.
pub(super) fn sharpen(indexes: &Indexes, filter: &mut Arc<Filter>) {
    if let (None, Some(filter)) = (decay(indexes), Arc::get_mut(filter)) {
        filter.assume_missing(&[metadata::DECAY_PATH, metadata::TOKEN_PATH]);
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::time::Duration;

    use bson::{Bson, doc};
    use rusqlite::Connection;

    use super::*;
    use crate::store::{Aggregation, Find, Modifiers, Namespace, Store as _};

    const COUNT: i32 = 40_000;

    /// A memory of many documents, some of which were deleted; its positions are the numbers of the documents and one more.
    fn store(path: &Path) -> (Embedded, Namespace) {
        let (store, ns) = (Embedded::open(path).unwrap(), Namespace::parse("a.b").unwrap());
        store.insert(&ns, (0..COUNT).map(|n| doc! { "_id": n, "rest": n % 7, "text": "some text" }).collect()).unwrap();
        store.delete(&ns, (&doc! { "_id": { "$gte": 15_000, "$lt": 21_000 } }).into(), false).unwrap();
        (store, ns)
    }

    fn numbers(wanted: impl Fn(i32) -> bool) -> Vec<i32> {
        (0..COUNT).filter(|n| !(15_000..21_000).contains(n) && wanted(*n)).collect()
    }

    fn found(store: &Embedded, ns: &Namespace, filter: Document) -> Result<Vec<i32>, StoreError> {
        let documents = store.find(ns, &Find { filter, ..Find::default() })?;
        documents.map(|document| Ok(document?.get_i32("_id").unwrap())).collect()
    }

    #[test]
    fn what_two_threads_read_is_what_one_would() {
        let folder = tempfile::tempdir().unwrap();
        let (store, ns) = store(&folder.path().join("a.rmem"));
        assert_eq!(found(&store, &ns, doc! {}).unwrap(), numbers(|_| true));
        let few = doc! { "$expr": { "$eq": [{ "$mod": ["$_id", 501] }, "$rest"] } };
        assert_eq!(found(&store, &ns, few.clone()).unwrap(), numbers(|n| n % 501 == n % 7));
        assert_eq!(store.count(&ns, (&few).into()).unwrap(), numbers(|n| n % 501 == n % 7).len() as u64);
        assert_eq!(store.count(&ns, (&doc! { "rest": 3 }).into()).unwrap(), numbers(|n| n % 7 == 3).len() as u64);
        let values = store.values(&ns, "rest", (&doc! {}).into()).unwrap();
        assert_eq!(values.map(Result::unwrap).collect::<Vec<_>>(), (0..7).map(Bson::Int32).collect::<Vec<_>>());
        let stages = [doc! { "$match": { "rest": 1 } }, doc! { "$group": { "_id": null, "sum": { "$sum": "$_id" } } }];
        let mut sums = store.aggregate(&ns, Aggregation { stages: &stages, modifiers: &Modifiers::default() }).unwrap();
        let sum: i32 = numbers(|n| n % 7 == 1).into_iter().sum();
        assert_eq!(sums.next().unwrap().unwrap().get_i32("sum").unwrap(), sum);
        // One that is not read to its end.
        let some = store.find(&ns, &Find::default()).unwrap().take(30_000).count();
        assert_eq!(some, 30_000);
    }

    #[test]
    fn a_thread_is_started_for_long_scans_of_a_file_only() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.rmem");
        let (store, ns) = store(&path);
        let scan = |store| {
            let mut filter = Arc::new(Filter::parse(&doc! {}).unwrap());
            let store: &Embedded = store;
            Scan::new(store, store.collection(&ns).unwrap().unwrap(), &mut filter).unwrap()
        };
        let is_started = |last| scan(&store).ahead((0, last), true).is_some();
        if std::thread::available_parallelism().is_ok_and(|all| all.get() > 1) {
            // Other tests may have such a thread for a moment.
            let mut tries = std::iter::repeat_with(|| std::thread::sleep(Duration::from_millis(10))).take(6_000);
            assert!(is_started(LONG as i64) || tries.any(|()| is_started(LONG as i64)));
        }
        assert!(!is_started(LONG as i64 - 1));
        let other = Embedded::open(&path).unwrap();
        std::fs::rename(&path, folder.path().join("b.rmem")).unwrap();
        assert!(scan(&other).ahead((0, LONG as i64), true).is_none(), "the file has another name");
        assert!(!path.exists());
        let memory = Embedded::in_memory().unwrap();
        memory.insert(&ns, vec![doc! {}]).unwrap();
        assert!(scan(&memory).ahead((0, LONG as i64), true).is_none());
    }

    #[test]
    fn what_the_other_thread_finds_damaged_is_reported() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.rmem");
        let (store, ns) = store(&path);
        let table = store.collection(&ns).unwrap().unwrap().table();
        let sql = format!(
            "UPDATE {table} SET body = CAST(substr(body, 1, length(body) - 1) || x'ff' AS BLOB) WHERE position = ?"
        );
        for position in [11_000, 14_000] {
            let change = Connection::open(&path).unwrap();
            change.execute_batch("BEGIN").unwrap();
            assert_eq!(change.execute(&sql, [position]).unwrap(), 1);
            change.execute_batch("COMMIT").unwrap();
            let refusal = found(&store, &ns, doc! { "rest": 9 }).unwrap_err().to_string();
            assert!(refusal.contains("damaged"), "{refusal}");
            assert!(store.count(&ns, (&doc! { "rest": 9 }).into()).is_err());
        }
    }

    #[test]
    fn a_page_in_the_place_of_another_is_noticed_between_two_stretches() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.rmem");
        let (first, ns) = store(&path);
        let table = first.collection(&ns).unwrap().unwrap().table();
        drop(first);
        let file = Connection::open(&path).unwrap();
        let size: u32 = file.query_row("PRAGMA page_size", [], |row| row.get(0)).unwrap();
        let sql = "SELECT rootpage FROM sqlite_schema WHERE name = ?";
        let root: u32 = file.query_row(sql, [&table], |row| row.get(0)).unwrap();
        drop(file);
        let whole = std::fs::read(&path).unwrap();
        let number = |at: usize| usize::from(u16::from_be_bytes([whole[at], whole[at + 1]]));
        let begin = |page: u32| ((page - 1) * size) as usize;
        // The cells of an inner page begin with the numbers of its pages.
        let cell = |page: u32, nth: usize| begin(page) + number(begin(page) + 12 + 2 * nth);
        let child = |at: usize| u32::from_be_bytes([whole[at], whole[at + 1], whole[at + 2], whole[at + 3]]);
        let mut page = root;
        while number(begin(page) + 3) < 40 {
            assert_eq!(whole[begin(page)], 5, "an inner page");
            // The last one, behind the part that one thread reads.
            page = child(begin(page) + 8);
        }
        let cells = number(begin(page) + 3);
        let (mut tried, mut unnoticed) = (0, 0);
        for nth in (1..cells - 12).step_by(9) {
            for other in [nth - 1, nth + 1, nth + 11] {
                let mut damaged = whole.clone();
                damaged.copy_within(cell(page, other)..cell(page, other) + 4, cell(page, nth));
                std::fs::write(&path, &damaged).unwrap();
                let store = Embedded::open(&path).unwrap();
                let found = found(&store, &ns, doc! { "rest": 9 });
                let count = store.count(&ns, (&doc! { "rest": 3 }).into());
                tried += 2;
                unnoticed += usize::from(found.is_ok()) + usize::from(count.is_ok());
            }
        }
        // Where the copy lies across the end of a stretch, the next one goes on behind it.
        assert!(tried > 50 && unnoticed * 10 < tried, "{unnoticed} of {tried}");
    }
}
