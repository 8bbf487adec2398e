//! Reading one page of a scan: from the documents in their order, at known positions, or along an index.

use std::collections::VecDeque;

use bson::RawDocument;
use rusqlite::types::ValueRef;

use super::examined::Examined;
use super::limit::check_ending_at;
use super::listing::note;
use super::sharing::LONG;
use super::{More, Rest, Scan};
use crate::store::embedded::access::Listing;
use crate::store::embedded::keys::Keys;
use crate::store::embedded::page::PageError;
use crate::store::embedded::snapshot::Snapshot;
use crate::store::embedded::{body, failure};

/// The most documents examined for a page, matching or not.
const PAGE_ROWS: usize = 20_000;

/// Documents of up to so many bytes are short: a page of the file, of 4,096 bytes, holds more than [`OF_A_PAGE`].
const SHORT: usize = 512;

/// Of so many short documents, the position of at least one is read, so that a page in the place of another is noticed.
const OF_A_PAGE: usize = 4;

impl Scan<'_> {
    /// Whether the filter matches a document.
    fn matches(&self, document: &RawDocument) -> Result<bool, PageError> {
        self.filter.matches(document).map_err(PageError::Query)
    }

    pub(super) fn read_between(
        &mut self,
        mut position: i64,
        last: i64,
        take: &mut dyn FnMut(i64, &RawDocument) -> More,
    ) -> Result<Rest, PageError> {
        let (store, table) = (self.store, self.collection.table());
        let sql = format!("SELECT body, position FROM {table} WHERE position > ? ORDER BY position");
        let mut statement = store.connection.prepare_cached(&sql)?;
        let mut rows = statement.query([position])?;
        let most = if self.sharing.is_counted_where_long().is_some() { LONG } else { PAGE_ROWS };
        for nth in 1..=most {
            let Some(row) = rows.next()? else { return Ok(Rest::Nothing) };
            if self.sharing.is_part() {
                let behind = std::mem::replace(&mut position, row.get(1)?);
                failure::check_order(position, behind)?;
                if self.sharing.arrive(position) {
                    self.check_seam(position)?;
                }
                if position > last {
                    self.sharing.leave(Some(position));
                    return Ok(Rest::Nothing);
                }
            }
            check_ending_at(nth)?;
            let body = body::of_column(row.get_ref(0)?)?;
            let is_match = self.matches(body)?;
            Examined::add(&self.examined.documents, 1);
            if !self.sharing.is_part() {
                // Not every position is read: that costs time, too.
                let is_seen = is_match || nth == most || nth.is_multiple_of(OF_A_PAGE) || body.as_bytes().len() > SHORT;
                if !is_seen {
                    continue;
                }
                let behind = std::mem::replace(&mut position, row.get(1)?);
                failure::check_order(position, behind)?;
                if position > last {
                    return Ok(Rest::Nothing);
                }
            }
            if is_match && !take(position, body) {
                break;
            }
        }
        Ok(Rest::Between(position, last))
    }

    /// Checks that a stretch begins where the one before it ended. Where a page of the file leads to a wrong one, it may not; nor
    /// where documents were removed and stored meanwhile, so that all positions are looked at then.
    pub(super) fn check_seam(&mut self, first: i64) -> rusqlite::Result<()> {
        if self.sharing.is_joined(first) {
            return Ok(());
        }
        let sql = format!("SELECT position FROM {} NOT INDEXED ORDER BY position", self.collection.table());
        let mut statement = self.store.connection.prepare_cached(&sql)?;
        let (mut rows, mut behind) = (statement.query([])?, i64::MIN);
        while let Some(row) = rows.next()? {
            let position = row.get(0)?;
            failure::check_order(position, behind)?;
            behind = position;
        }
        Ok(())
    }

    pub(super) fn read_at(
        &mut self,
        mut positions: VecDeque<i64>,
        take: &mut dyn FnMut(i64, &RawDocument) -> More,
    ) -> Result<Rest, PageError> {
        // A transaction for each document would take longer than reading it.
        let store = self.store;
        let _snapshot = (positions.len() > 1).then(|| Snapshot::begin(&store.connection)).transpose()?;
        let sql = format!("SELECT body FROM {} WHERE position = ?", self.collection.table());
        let mut statement = store.connection.prepare_cached(&sql)?;
        for nth in 1..=PAGE_ROWS {
            check_ending_at(nth)?;
            let Some(position) = positions.pop_front() else { return Ok(Rest::Nothing) };
            let mut rows = statement.query([position])?;
            let Some(row) = rows.next()? else {
                self.check_listings()?;
                continue;
            };
            let body = body::of_column(row.get_ref(0)?)?;
            Examined::add(&self.examined.documents, 1);
            if self.matches(body)? && !take(position, body) {
                break;
            }
        }
        Ok(Rest::At(positions))
    }

    /// Checks that a document which is not there any more was removed, and not lost: what is lost stays in the list.
    /// Where that holds at one moment, it holds for what is missing later.
    fn check_listings(&mut self) -> rusqlite::Result<()> {
        for listing in std::mem::take(&mut self.listings) {
            match self.is_sound(&listing) {
                Ok(true) => {}
                Ok(false) => return Err(failure::no_document()),
                // An index that another process dropped lists nothing.
                Err(error) if failure::is_gone(&error) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Whether all documents are there that are listed at this moment.
    fn is_sound(&self, listing: &Listing) -> rusqlite::Result<bool> {
        let mut statement = self.store.connection.prepare_cached(&listing.lost_sql(&self.collection.table()))?;
        for range in &listing.ranges {
            if statement.exists([&range.low, &range.high])? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Reads a page, and where the rest is, at one moment.
    pub(super) fn read_listed(
        &mut self,
        mut listing: Listing,
        take: &mut dyn FnMut(i64, &RawDocument) -> More,
    ) -> Result<Rest, PageError> {
        let store = self.store;
        let _snapshot = Snapshot::begin(&store.connection)?;
        let sql = listing.documents_sql(&self.collection.table());
        let mut statement = store.connection.prepare_cached(&sql)?;
        let (mut taken, mut nth) = (0, 0);
        while let Some(range) = listing.ranges.front() {
            let (from, to) = listing.ends(range);
            let mut rows = statement.query([from, to])?;
            let mut last = None;
            while let Some(row) = rows.next()? {
                nth += 1;
                check_ending_at(nth)?;
                Examined::add(&self.examined.keys, 1);
                Examined::add(&self.examined.documents, 1);
                let position = Keys::position(row, 3)?;
                if row.get_ref(2)? == ValueRef::Null {
                    return Err(failure::no_document().into());
                }
                let body = body::of_column(row.get_ref(2)?)?;
                let key = row.get_ref(0)?.as_blob().map_err(rusqlite::Error::from)?;
                note(&mut last, key);
                if listing.keys.are_ids() && !body::has_key(body, key) {
                    return Err(failure::entry().into());
                }
                if !self.matches(body)? {
                    continue;
                }
                taken += 1;
                if !take(position, body) {
                    listing.check_before(&store.connection, range)?;
                    let behind = (key.to_vec(), position);
                    drop(rows);
                    return if taken >= self.most { Ok(Rest::Nothing) } else { self.list(listing, &behind) };
                }
            }
            drop(rows);
            // Where there can be one entry, and there it is, those beside it hide nothing.
            if !listing.is_of_one || last.is_none() {
                listing.check_before(&store.connection, range)?;
                listing.check_behind(&store.connection, range, last.as_deref())?;
            }
            listing.ranges.pop_front();
        }
        Ok(Rest::Nothing)
    }

    /// Where the documents are that the index lists behind a key and a position.
    fn list(&mut self, mut listing: Listing, behind: &(Vec<u8>, i64)) -> Result<Rest, PageError> {
        self.listings = vec![listing.clone()];
        let (mut behind, mut positions) = (Some((behind.0.as_slice(), behind.1)), VecDeque::new());
        while let Some(range) = listing.ranges.pop_front() {
            let mut take = |position| positions.push_back(position);
            listing.read_positions(&self.store.connection, &range, behind.take(), &mut take)?;
        }
        Examined::add(&self.examined.keys, positions.len() as u64);
        Ok(Rest::At(positions))
    }
}

#[cfg(test)]
mod tests {
    use bson::{Document, doc};

    use crate::store::{Embedded, Find, Index, Namespace, Store as _};

    #[test]
    fn documents_that_others_remove_between_two_pages_are_no_damage() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("robot.rmem");
        let (store, other) = (Embedded::open(&path).unwrap(), Embedded::open(&path).unwrap());
        let ns = Namespace::parse("a.b").unwrap();
        store.insert(&ns, (0..3_000).map(|n| doc! { "_id": n, "n": n }).collect()).unwrap();
        store.create_index(&ns, &Index::on(doc! { "n": 1 })).unwrap();
        let some = doc! { "$or": [{ "n": { "$lt": 2_900 } }, { "_id": { "$gte": 2_900 } }] };
        let finds = [(doc! {}, doc! { "n": 1 }), (doc! {}, doc! { "_id": 1 }), (some, Document::new())];
        for (nth, (filter, sort)) in (1..).zip(finds) {
            let find = Find { filter, sort, ..Find::default() };
            let mut found = store.find(&ns, &find).unwrap();
            assert!(found.next().is_some_and(|first| first.is_ok()));
            other.delete(&ns, (&doc! { "_id": 2_000 + nth }).into(), true).unwrap();
            assert_eq!(found.map(Result::unwrap).count(), 2_999 - nth as usize, "{find:?}");
        }
    }
}
