//! What a second thread reads of a long scan: every other stretch, ahead of when it is asked for.

use std::collections::VecDeque;
use std::rc::Rc;
use std::sync::Arc;

use super::found::{PAGE_DOCUMENTS, Page};
use super::sharing::{LONG, Sharing};
use super::{Examined, Rest, Scan};
use crate::deadline::{self, Deadline};
use crate::query::{Filter, collation};
use crate::store::StoreError;
use crate::store::embedded::ahead::{Ahead, Slot, Turn};
use crate::store::embedded::catalog::Collection;
use crate::store::embedded::{Embedded, failure};

impl<'a> Scan<'a> {
    /// The matches behind a position, up to another.
    fn stretch(store: &'a Embedded, collection: Collection, filter: &Arc<Filter>, (behind, last): (i64, i64)) -> Self {
        Self {
            store,
            collection,
            filter: Arc::clone(filter),
            page_documents: PAGE_DOCUMENTS,
            rest: Rest::Between(behind, last),
            listings: Vec::new(),
            page: VecDeque::new(),
            is_up_to_failure: false,
            failure: None,
            is_whole: false,
            most: usize::MAX,
            is_sorted: false,
            examined: Rc::default(),
            sharing: Sharing::stretch(),
        }
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
    pub(super) fn take_page(&mut self) -> Result<Page, StoreError> {
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
    pub(super) fn next_stretch(&mut self) -> Rest {
        match self.sharing.turn() {
            Turn::Own(behind, last) => Rest::Between(behind, last),
            Turn::Other => Rest::Ahead,
            Turn::Over => Rest::Nothing,
        }
    }

    /// Shares what is left with a second thread where the scan has become a long one.
    pub(super) fn share(&mut self) {
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
        let (collection, filter, limits) = (self.collection, Arc::clone(&self.filter), deadline::limits());
        Ahead::start(slot, (behind, last), move |stretch, send| {
            let _deadline = Deadline::set(limits.clone());
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
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::time::Duration;

    use bson::{Bson, Document, doc};
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
