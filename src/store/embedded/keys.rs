//! Tables of keys: those of indexes, and those of documents, whose keys are their `_id`s.
//!
//! An entry of an index has a checksum of its key and its position, which is verified when the entry is read. So are the
//! entries next to each range that is read: a search in a sorted table, for a key that damage has changed, ends beside the
//! changed one whichever way it went, so that damage is noticed where it keeps something from being found. The
//! entry of an `_id` has no checksum; there, the key is compared with that in the document's row.

use std::borrow::Cow;
use std::cmp::Ordering;

use rusqlite::types::ValueRef;
use rusqlite::{Connection, OptionalExtension as _, Result, Row};
use xxhash_rust::xxh3::xxh3_64_with_seed;

use super::catalog::Collection;
use super::failure;
use crate::query::index::Range;

/// A table of keys.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Keys {
    pub(super) table: String,
    proof: Proof,
}

/// By what it is known that an entry is as it was written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Proof {
    /// Its checksum.
    Checksum,
    /// The key in the document's row.
    Row,
    /// Nothing: an older rmem made the index.
    None,
}

/// Returns the checksum of an entry: 32 bits, which SQLite stores in four bytes.
pub(super) fn seal(key: &[u8], position: i64) -> i64 {
    let hash = xxh3_64_with_seed(key, position.cast_unsigned());
    i64::from((hash as u32).cast_signed())
}

impl Keys {
    /// The table of an index, whose entries have checksums or, made by an older rmem, have none.
    pub(super) fn of_index(table: String, is_sealed: bool) -> Self {
        Self { table, proof: if is_sealed { Proof::Checksum } else { Proof::None } }
    }

    /// The `_id`s of a collection.
    pub(super) fn of_documents(collection: Collection) -> Self {
        Self { table: collection.table(), proof: Proof::Row }
    }

    /// Whether these are the `_id`s of documents.
    pub(super) fn are_ids(&self) -> bool {
        self.proof == Proof::Row
    }

    /// The column with the checksums, or nothing in its place.
    pub(super) fn seals(&self) -> &'static str {
        if self.proof == Proof::Checksum { "seal" } else { "NULL" }
    }

    /// What proves an entry: its checksum, the key in the document's row, or nothing. `entry` is what the statement calls the entry.
    pub(super) fn proof(&self, entry: &str) -> Cow<'static, str> {
        match self.proof {
            Proof::Checksum | Proof::None => self.seals().into(),
            Proof::Row => {
                let table = self.table.as_str();
                let own =
                    format!("SELECT row.key FROM {table} AS row NOT INDEXED WHERE row.position = {entry}.position");
                format!("ifnull(({own}), x'')").into()
            }
        }
    }

    /// Returns the position in the columns `key` and `position` of a row, whose column `nth` has the [`Keys::proof`].
    ///
    /// # Errors
    /// Where the entry is damaged.
    pub(super) fn position(row: &Row<'_>, nth: usize) -> Result<i64> {
        let position = row.get(1)?;
        match row.get_ref(nth)? {
            ValueRef::Integer(sealed) if sealed != seal(row.get_ref(0)?.as_blob()?, position) => Err(failure::entry()),
            ValueRef::Blob(own) if own != row.get_ref(0)?.as_blob()? => Err(failure::entry()),
            _ => Ok(position),
        }
    }

    /// Checks the entry before a range that is read from its beginning, or behind one that is read from its end.
    ///
    /// # Errors
    /// Where it is damaged.
    pub(super) fn check_before(&self, connection: &Connection, range: &Range, backwards: bool) -> Result<()> {
        let (beside, key) = if backwards { (Beside::From, &range.high) } else { (Beside::Below, &range.low) };
        self.beside(connection, beside, key, &[]).map(drop)
    }

    /// Checks the entry that follows what was read of a range, up to a key if to any.
    ///
    /// # Errors
    /// Where it is damaged, or in the range.
    pub(super) fn check_behind(
        &self,
        connection: &Connection,
        range: &Range,
        backwards: bool,
        last: Option<&[u8]>,
    ) -> Result<()> {
        let (beside, key, bound) = match (backwards, last) {
            (false, None) => (Beside::From, range.low.as_slice(), &range.high),
            (false, Some(last)) => (Beside::Above, last, &range.high),
            (true, None) => (Beside::Below, range.high.as_slice(), &range.low),
            (true, Some(last)) => (Beside::Below, last, &range.low),
        };
        match self.beside(connection, beside, key, bound)? {
            None => Ok(()),
            Some(Ordering::Less) if backwards => Ok(()),
            Some(Ordering::Greater | Ordering::Equal) if !backwards => Ok(()),
            Some(_) => Err(failure::entry()),
        }
    }

    /// Checks the entries on both sides of a key that was not found: one that damage has changed is among them.
    ///
    /// # Errors
    /// Where one is damaged.
    pub(super) fn check_around(&self, connection: &Connection, key: &[u8]) -> Result<()> {
        if self.proof != Proof::None {
            self.beside(connection, Beside::Below, key, &[])?;
            self.beside(connection, Beside::From, key, &[])?;
        }
        Ok(())
    }

    /// Checks the entry beside a key; returns how its own key compares with a bound, if there is an entry.
    fn beside(&self, connection: &Connection, beside: Beside, key: &[u8], bound: &[u8]) -> Result<Option<Ordering>> {
        let (condition, order) = match beside {
            Beside::Below => ("<", " DESC"),
            Beside::From => (">=", ""),
            Beside::Above => (">", ""),
        };
        let table = self.table.as_str();
        let proof = self.proof("entry");
        let sql = format!(
            "SELECT key, position, {proof} FROM {table} AS entry WHERE key {condition} ?
             ORDER BY key{order}, position{order} LIMIT 1"
        );
        let compare = |row: &Row<'_>| {
            Self::position(row, 2)?;
            Ok(row.get_ref(0)?.as_blob()?.cmp(bound))
        };
        connection.prepare_cached(&sql)?.query_row([key], compare).optional()
    }
}

/// Which entry beside a key.
#[derive(Debug, Clone, Copy)]
enum Beside {
    /// The last one before it.
    Below,
    /// The first one from it on.
    From,
    /// The first one behind it.
    Above,
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use bson::{DateTime, Document, RawDocumentBuf, doc};

    use super::*;
    use crate::store::embedded::Embedded;
    use crate::store::{Find, Index, Namespace, Store as _, StoreError};

    const DOCUMENTS: i32 = 400;

    /// A memory whose indexes have several pages each, and its path.
    fn memory(folder: &Path) -> (Namespace, Vec<u8>) {
        let path = folder.join("whole.rmem");
        let store = Embedded::open(&path).unwrap();
        let ns = Namespace::parse("a.b").unwrap();
        let unique = Index { unique: true, ..Index::on(doc! { "serial": -1 }) };
        for index in [Index::on(doc! { "name": 1 }), unique, Index::on(doc! { "kind": 1, "tags": -1 })] {
            store.create_index(&ns, &index).unwrap();
        }
        let document = |n: i32| {
            let tags = [n % 7, n % 11 + 10];
            doc! { "_id": id(n), "name": name(n), "serial": f64::from(n) * 1.25, "kind": name(n % 20), "tags": tags.as_slice() }
        };
        // Not in their order, so that pages are split.
        store.insert(&ns, (0..DOCUMENTS).map(|n| document(n * 37 % DOCUMENTS)).collect()).unwrap();
        drop(store);
        (ns, std::fs::read(path).unwrap())
    }

    fn id(n: i32) -> String {
        format!("a thing of this world, which is called thing-{n:05}")
    }

    fn name(n: i32) -> String {
        format!("{n:05}, and what it is called by those who know it for a long time")
    }

    /// Queries that indexes answer, each with the sort it is asked with.
    fn queries() -> Vec<(Document, Document)> {
        let mut queries: Vec<_> = (0..DOCUMENTS)
            .flat_map(|n| [doc! { "_id": id(n) }, doc! { "name": name(n) }, doc! { "serial": f64::from(n) * 1.25 }])
            .map(|filter| (filter, Document::new()))
            .collect();
        for n in (0..DOCUMENTS).step_by(20) {
            let part = |low: String, high: String| doc! { "$gte": low, "$lt": high };
            queries.push((doc! { "name": part(name(n), name(n + 20)) }, Document::new()));
            queries.push((doc! { "name": part(name(n), name(n + 20)) }, doc! { "name": -1 }));
            queries.push((doc! { "_id": part(id(n), id(n + 20)) }, doc! { "_id": 1 }));
            queries.push((doc! { "kind": name(n % 20), "tags": { "$lt": 15 } }, doc! { "kind": 1, "tags": -1 }));
            queries.push((doc! { "_id": part(id(n), id(n + 20)), "kind": { "$exists": true } }, Document::new()));
            queries.push((doc! { "_id": { "$in": [id(n), id(n + 3), id(n + 9)] } }, Document::new()));
            queries.push((doc! { "name": { "$in": [name(n), name(n + 3), name(n + 9)] } }, Document::new()));
        }
        queries.push((Document::new(), doc! { "_id": 1 }));
        queries.push((Document::new(), doc! { "serial": 1 }));
        queries
    }

    /// What queries find; nothing for those that are refused.
    fn answers(store: &Embedded, ns: &Namespace) -> Vec<Option<Vec<RawDocumentBuf>>> {
        let answer = |(filter, sort)| {
            let found = store.find(ns, &Find { filter, sort, ..Find::default() }).ok()?;
            found.collect::<Result<_, _>>().ok()
        };
        queries().into_iter().map(answer).collect()
    }

    /// Copies of a file with one bit changed in a page of an index, each with the place of the bit.
    fn changed(whole: &[u8]) -> impl Iterator<Item = (usize, Vec<u8>)> {
        let page = usize::from(u16::from_be_bytes([whole[16], whole[17]]));
        // Inner pages and leaves of the trees of indexes begin with 2 and 10.
        let pages: Vec<usize> = (1..whole.len() / page).map(|nth| nth * page).collect();
        let pages: Vec<usize> = pages.into_iter().filter(|at| matches!(whole[*at], 2 | 10)).collect();
        let mut random = 88_172_645_463_325_252_u64;
        std::iter::repeat_with(move || {
            random ^= random << 13;
            random ^= random >> 7;
            random ^= random << 17;
            let draw = random as usize;
            let (begin, bit) = (pages[draw % pages.len()], draw >> 16 & 7);
            let at = begin + 12 + (draw >> 24) % (page - 12);
            let mut damaged = whole.to_vec();
            damaged[at] ^= 1 << bit;
            (at, damaged)
        })
    }

    #[test]
    fn a_changed_key_is_noticed_by_the_queries_that_it_changes() {
        let folder = tempfile::tempdir().unwrap();
        let (ns, whole) = memory(folder.path());
        let path = folder.path().join("damaged.rmem");
        let expected = answers(&Embedded::open(folder.path().join("whole.rmem")).unwrap(), &ns);
        let rounds = std::env::var("RMEM_TEST_CHANGED_KEYS").ok().and_then(|rounds| rounds.parse().ok()).unwrap_or(60);
        let (mut refused, mut wrong) = (0, Vec::new());
        for (round, (at, damaged)) in changed(&whole).take(rounds).enumerate() {
            std::fs::write(&path, &damaged).unwrap();
            let Ok(store) = Embedded::open(&path) else { continue };
            let found = answers(&store, &ns);
            let differ = found.iter().zip(&expected).filter(|(found, expected)| found.is_some() && found != expected);
            let (differ, errors) = (differ.count(), found.iter().filter(|found| found.is_none()).count());
            refused += usize::from(errors > 0);
            if differ > 0 {
                wrong.push((round, at, differ, errors));
            }
        }
        assert!(
            refused * 4 > rounds && wrong.is_empty(),
            "{refused} of {rounds} refused, {} wrong: {wrong:?}",
            wrong.len()
        );
    }

    #[test]
    fn a_changed_key_lets_no_second_one_into_a_unique_index() {
        let folder = tempfile::tempdir().unwrap();
        let (ns, whole) = memory(folder.path());
        let path = folder.path().join("damaged.rmem");
        let mut noticed = 0;
        for (at, damaged) in changed(&whole).take(100) {
            std::fs::write(&path, &damaged).unwrap();
            let Ok(store) = Embedded::open(&path) else { continue };
            for n in 0..DOCUMENTS {
                let second = vec![doc! { "_id": "new", "serial": f64::from(n) * 1.25 }];
                match store.insert(&ns, second) {
                    Err(StoreError::Duplicate { .. }) => {}
                    Err(_) => noticed += 1,
                    Ok(_) => panic!("the bit at {at}: {n} is there twice"),
                }
            }
        }
        assert!(noticed > 0);
    }

    #[test]
    fn a_changed_key_of_a_date_expires_nothing() {
        let store = Embedded::in_memory().unwrap();
        let ns = Namespace::parse("a.b").unwrap();
        store.create_index(&ns, &Index { expire_after: Some(0), ..Index::on(doc! { "until": 1 }) }).unwrap();
        let date = |minutes: i64| DateTime::from_millis(DateTime::now().timestamp_millis() + minutes * 60_000);
        store.insert(&ns, vec![doc! { "_id": 1, "until": date(60) }, doc! { "_id": 2, "until": date(90) }]).unwrap();
        let over = crate::query::key::encode_value(&date(-60).into());
        store.connection.execute("UPDATE entries_1 SET key = ? WHERE position = 1", [over]).unwrap();
        let error = store.insert(&ns, vec![doc! { "_id": 3 }]).map(drop).unwrap_err();
        assert!(error.to_string().contains("damaged"), "{error}");
        assert_eq!(store.count(&ns, (&doc! {}).into()).unwrap(), 2);
    }

    #[test]
    fn an_index_without_checksums_is_used_as_it_is_and_gets_them_by_repair() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.rmem");
        let ns = Namespace::parse("a.b").unwrap();
        let store = Embedded::open(&path).unwrap();
        store.create_index(&ns, &Index::on(doc! { "n": 1 })).unwrap();
        store.insert(&ns, (0..10).map(|n| doc! { "_id": n, "n": n % 2 }).collect()).unwrap();
        drop(store);
        let file = rusqlite::Connection::open(&path).unwrap();
        file.execute_batch("ALTER TABLE entries_1 DROP COLUMN seal").unwrap();
        let store = Embedded::open(&path).unwrap();
        store.insert(&ns, vec![doc! { "_id": 10, "n": 1 }]).unwrap();
        store.delete(&ns, (&doc! { "_id": 3 }).into(), true).unwrap();
        let found = |store: &Embedded| {
            let find = Find { filter: doc! { "n": 1 }, ..Find::default() };
            store.find(&ns, &find).unwrap().collect::<Result<Vec<_>, _>>().unwrap().len()
        };
        assert_eq!(found(&store), 5);
        assert!(store.check_all(&mut |damage| panic!("{damage}")).is_ok());
        store.rebuild_indexes().unwrap();
        drop(store);
        let sealed = "SELECT count(*) FROM entries_1 WHERE seal NOTNULL";
        assert_eq!(file.query_row(sealed, [], |row| row.get::<_, i64>(0)).unwrap(), 10);
        assert_eq!(found(&Embedded::open(&path).unwrap()), 5);
    }
}
