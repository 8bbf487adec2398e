//! Repairing a damaged file: `rmem repair`.
//!
//! In place, all indexes are made anew from the documents. Into a new file, every document that
//! can be read is copied, with the indexes and validators, the names of watches and the log of changes.
//!
//! A changed bit can make a page of documents look shorter than it is, and nothing in it tells. But the index of `_id`s, which
//! SQLite keeps, names every document: what it names and is not there is lost, or keeps an index from being made anew.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::ops::RangeInclusive;
use std::path::Path;

use rusqlite::{Connection, OptionalExtension as _, params};

use super::catalog::Collection;
use super::damage::Damage;
use super::damaged_table::DamagedTable;
use super::new_file::NewFile;
use super::page::PageError;
use super::place::Place;
use super::{Embedded, body, change_log, check, failure, file, history, validation};
use crate::query::QueryError;
use crate::store::{Index, Namespace, Store as _, StoreError, document, index};

/// What a repair did.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Repaired {
    /// The collections.
    pub collections: u64,
    /// The documents that were copied, or over which indexes were made.
    pub documents: u64,
    /// The indexes that were made.
    pub indexes: u64,
    /// What could not be saved, a sentence each.
    pub lost: Vec<String>,
}

impl Embedded {
    /// Makes all indexes anew, in one transaction.
    ///
    /// # Errors
    /// Where a document is damaged or the file cannot be written; nothing is changed then.
    pub fn rebuild_indexes(&self) -> Result<Repaired, StoreError> {
        self.write(|| {
            let mut done = Repaired::default();
            for ns in Collection::all(&self.connection).map_err(|e| self.explain(&e))? {
                let Some(collection) = self.collection(&ns)? else { continue };
                self.check_named(&ns, collection)?;
                let reindex = format!("REINDEX {}", collection.table());
                self.connection.execute_batch(&reindex).map_err(|e| self.explain(&e))?;
                done.collections += 1;
                // Each document is read, so that a damaged one is found also where no index is made.
                done.documents += self.check_documents(collection)?;
                done.indexes += self.refill_indexes(&ns, collection)?;
            }
            self.check_changes()?;
            self.check_pages()?;
            Ok(done)
        })
    }

    /// Refuses a collection that has not all documents that its index of `_id`s names: made anew, that would not name them
    /// either. One that cannot be read is what is to be repaired.
    fn check_named(&self, ns: &Namespace, collection: Collection) -> Result<(), StoreError> {
        let (table, index) = (collection.table(), collection.index_of_ids());
        let sql = format!(
            "SELECT count(*) FROM {table} AS named INDEXED BY {index} WHERE NOT EXISTS \
             (SELECT 1 FROM {table} AS stored NOT INDEXED WHERE stored.position = named.position)"
        );
        match self.connection.query_row(&sql, [], |row| row.get::<_, i64>(0)) {
            Ok(0) => Ok(()),
            Ok(absent) => Err(self.fail(&format!(
                "{ns}: {absent} of the documents that the index of _ids names are not there; copy what can be read into \
                 a new file with `rmem repair -o FILE`"
            ))),
            Err(error) if failure::is_damage(&error) => Ok(()),
            Err(error) => Err(self.explain(&error)),
        }
    }

    /// Refuses a file in which SQLite finds more damage than that of indexes, which are made anew.
    fn check_pages(&self) -> Result<(), StoreError> {
        let mut damaged = None;
        let checked = check::integrity(&self.connection, "1", &mut |finding| {
            damaged.get_or_insert(finding.to_owned());
        });
        let damaged = damaged.or_else(|| checked.err().map(|error| self.explain(&error).to_string()));
        damaged.map_or(Ok(()), |damage| {
            Err(self.fail(&format!(
                "more than its indexes is damaged: {damage}; copy what can be read into a new file with \
                 `rmem repair -o FILE`"
            )))
        })
    }

    /// Checks the documents of a collection and returns how many there are.
    fn check_documents(&self, collection: Collection) -> Result<u64, StoreError> {
        let sql = format!("SELECT position, key, body FROM {} NOT INDEXED ORDER BY position", collection.table());
        let read = || -> Result<u64, PageError> {
            let mut statement = self.connection.prepare(&sql)?;
            let (mut rows, mut behind, mut count) = (statement.query([])?, i64::MIN, 0);
            while let Some(row) = rows.next()? {
                let position = row.get(0)?;
                failure::check_order(position, behind)?;
                let document = body::of_column(row.get_ref(2)?)?;
                if !body::has_key(document, row.get_ref(1)?.as_blob().map_err(rusqlite::Error::from)?) {
                    return Err(PageError::Damaged(Damage::Key, body::name(document.as_bytes())));
                }
                (behind, count) = (position, count + 1);
            }
            Ok(count)
        };
        read().map_err(|error| match error {
            PageError::Store(error) => self.explain(&error),
            PageError::Query(error) => error.into(),
            PageError::Damaged(damage, id) => self.damaged(collection, id.as_deref(), damage),
        })
    }

    /// Refuses a log of changes in which something is damaged.
    fn check_changes(&self) -> Result<(), StoreError> {
        let mut damaged = None;
        change_log::find_damage(&self.connection, &mut |sequence, wrong| {
            damaged.get_or_insert((sequence, wrong));
        })
        .map_err(|e| self.explain(&e))?;
        damaged.map_or(Ok(()), |(sequence, wrong)| {
            Err(self.fail(&format!(
                "the change {sequence} in the log is damaged: {wrong}; copy what can be read into a new file with \
                 `rmem repair -o FILE`"
            )))
        })
    }

    /// Copies what can be read of the file at `from` into a new file at `to`.
    ///
    /// # Errors
    /// Where the list of collections cannot be read, or the new file exists or cannot be written.
    pub fn salvage(from: &Path, to: &Path) -> Result<Repaired, StoreError> {
        let place = Place::File(from.to_owned());
        let new = NewFile::beside(to)?;
        let source = file::to_salvage(from)?;
        let mut done = Repaired::default();
        // An empty file is a memory in which nothing was stored.
        let collections = match file::is_empty(from) {
            true => None,
            false => Some(collections(&source, &mut done.lost).map_err(|error| {
                match failure::is_gone(&error) || failure::is_no_database(&error) || failure::is_damage(&error) {
                    true => file::foreign(&place),
                    false => failure::explain(&place, &error),
                }
            })?),
        };
        new.permit_as(from)?;
        let copied = Self::open(new.staged()).and_then(|target| {
            if let Some(collections) = collections {
                target.salvage_all(&source, collections, &mut done)?;
            }
            target.fold().map(|()| done)
        });
        let done = copied.map_err(|error| failure::of_copy(new.place(), error))?;
        new.keep().map(|()| done)
    }

    fn salvage_all(
        &self,
        source: &Connection,
        collections: Vec<(i64, Namespace)>,
        done: &mut Repaired,
    ) -> Result<(), StoreError> {
        for (id, ns) in collections {
            done.collections += 1;
            self.write(|| self.salvage_collection(source, id, &ns, done))?;
        }
        self.write(|| match self.salvage_watchers(source, done) {
            Err(error) if failure::is_full_disk(&error) => Err(self.explain(&error)),
            Err(error) => {
                done.lost.push(format!("the names of watches and the log of changes: {error}"));
                Ok(())
            }
            Ok(()) => Ok(()),
        })
    }

    fn salvage_collection(
        &self,
        source: &Connection,
        id: i64,
        ns: &Namespace,
        done: &mut Repaired,
    ) -> Result<(), StoreError> {
        let collection = self.ensure(ns)?;
        let table = DamagedTable { source, collection: Collection { id, generation: 0 } };
        self.salvage_documents(table, (ns, collection), done)?;
        for definition in definitions(source, id) {
            let Some(index) = definition else {
                done.lost.push(format!("{ns}: an index: a definition cannot be read"));
                continue;
            };
            match self.salvage_index(ns, collection, &index) {
                Ok(made) => done.indexes += u64::from(made),
                Err(error @ StoreError::DiskFull { .. }) => return Err(error),
                Err(error) => done.lost.push(format!("{ns}: an index: {}: {error}", index.name)),
            }
        }
        // Behind the documents, which may be older than it.
        match validation::kept(source, id) {
            Ok(None) => Ok(()),
            Ok(Some(bytes)) => match validation::read(&bytes) {
                Ok(validation) => self.change_validation(ns, &validation),
                Err(error) => {
                    done.lost.push(format!("{ns}: its validator: {error}"));
                    Ok(())
                }
            },
            Err(error) if failure::is_full_disk(&error) => Err(self.explain(&error)),
            Err(error) => {
                done.lost.push(format!("{ns}: its validator: {error}"));
                Ok(())
            }
        }
    }

    /// Copies the documents in the order in which they are in their table, past what cannot be read; then those that the index of
    /// `_id`s names beside them. What it names and is not there is lost.
    fn salvage_documents(
        &self,
        table: DamagedTable<'_>,
        (ns, collection): (&Namespace, Collection),
        done: &mut Repaired,
    ) -> Result<(), StoreError> {
        let mut salvage = |stored: &[u8]| -> Result<(), StoreError> {
            match self.salvage_document(ns, collection, stored)? {
                None => done.documents += 1,
                Some(lost) => done.lost.push(lost),
            }
            Ok(())
        };
        // The positions that were read: a damaged tree of pages may lead to one twice, and in any order.
        let mut read: HashSet<i64> = HashSet::new();
        let mut unread: Vec<RangeInclusive<i64>> = Vec::new();
        let mut position = i64::MIN;
        loop {
            let ended = table.walk(position, &mut |found, stored| {
                position = position.max(found);
                if read.insert(found) { salvage(stored) } else { Ok(()) }
            })?;
            if ended {
                break;
            }
            let behind = table.behind_damage(position);
            unread.push(position.saturating_add(1).max(1)..=behind.unwrap_or(i64::MAX));
            match behind {
                Some(behind) => position = behind,
                None => break,
            }
        }
        let mut absent: Vec<i64> = Vec::new();
        let named = table.named(&mut |position, look| {
            if read.insert(position) {
                match look() {
                    Some(stored) => salvage(&stored)?,
                    None => absent.push(position),
                }
            }
            Ok(())
        })?;
        let lost = |places: &RangeInclusive<i64>| match (*places.start(), *places.end()) {
            (first, i64::MAX) => format!("{ns}: the documents behind position {}", first - 1),
            (first, last) if first == last => format!("{ns}: the document at position {first}"),
            (first, last) => format!("{ns}: the documents at positions {first} to {last}"),
        };
        absent.sort_unstable();
        let absent = absent.chunk_by(|one, next| one + 1 == *next);
        let absent = absent.filter_map(|places| Some(*places.first()?..=*places.last()?));
        done.lost.extend(absent.map(|places| lost(&places)));
        if let Some(reason) = named {
            done.lost.extend(unread.iter().map(lost));
            done.lost.push(format!("{ns}: more documents, perhaps: the index of _ids, which names all, {reason}"));
        }
        Ok(())
    }

    /// Makes an index as it is defined. That on `_id` is the first one, and says what collation the collection has.
    fn salvage_index(&self, ns: &Namespace, collection: Collection, index: &Index) -> Result<bool, StoreError> {
        match index.name == index::ID {
            true => self.make_index(ns, collection, index).map(|()| true),
            false => self.create(ns, &index.clone().standing_alone()),
        }
    }

    /// Copies one document; returns what is lost, if anything is.
    fn salvage_document(
        &self,
        ns: &Namespace,
        collection: Collection,
        stored: &[u8],
    ) -> Result<Option<String>, StoreError> {
        let name =
            || body::name(stored).map_or_else(|| "a document".to_owned(), |id| format!("the document with _id {id}"));
        let document = match body::open(stored) {
            Ok(document) => document,
            Err(damage) => return Ok(Some(format!("{ns}: {}: {}", name(), damage.describe()))),
        };
        let added =
            document::vet(document).map_err(StoreError::from).and_then(|id| self.add(ns, collection, &id, document));
        match added {
            Ok(()) => Ok(None),
            Err(error @ StoreError::DiskFull { .. }) => Err(error),
            Err(error) => Ok(Some(format!("{ns}: {}: {error}", name()))),
        }
    }

    fn salvage_watchers(&self, source: &Connection, done: &mut Repaired) -> rusqlite::Result<()> {
        copy(source, &self.connection, "watchers", "id, name, database, collection, position, missed, holder, beat")?;
        copy(source, &self.connection, "changes", "sequence, database, collection, kind, time, before, after, volume")?;
        history::prepare(&self.connection)?;
        for (table, columns) in history::TABLES_WITH_COLUMNS {
            if source.prepare("SELECT 1 FROM sqlite_schema WHERE name = ?")?.exists([table])? {
                copy(source, &self.connection, table, columns)?;
            }
        }
        let last: Option<i64> = source
            .query_row("SELECT seq FROM sqlite_sequence WHERE name = 'changes'", [], |row| row.get(0))
            .optional()?;
        if let Some(last) = last {
            self.connection.execute("DELETE FROM sqlite_sequence WHERE name = 'changes'", [])?;
            self.connection.execute("INSERT INTO sqlite_sequence (name, seq) VALUES ('changes', ?)", [last])?;
        }
        self.cut_damaged_changes(done)
    }

    /// Removes the changes of the log up to the last one that is damaged: what is read of it has no gaps.
    fn cut_damaged_changes(&self, done: &mut Repaired) -> rusqlite::Result<()> {
        let mut damaged = None;
        change_log::find_damage(&self.connection, &mut |sequence, wrong| damaged = Some((sequence, wrong)))?;
        let Some((last, wrong)) = damaged else { return Ok(()) };
        let kept = history::current(&self.connection)?;
        change_log::cut(&self.connection, last, |last| history::cut(&self.connection, &kept, last))?;
        done.lost.push(format!("the changes up to {last} in the log, which is damaged: {wrong}"));
        Ok(())
    }
}

/// The collections that are listed, and what of the list cannot be read. The names stand in the table and in its index.
fn collections(source: &Connection, lost: &mut Vec<String>) -> rusqlite::Result<Vec<(i64, Namespace)>> {
    let (mut found, mut unnamed) = (BTreeMap::new(), BTreeSet::new());
    let of_table = list(source, "NOT INDEXED", &mut found, &mut unnamed);
    let of_index = list(source, "INDEXED BY sqlite_autoindex_collections_1", &mut found, &mut unnamed);
    if let (Err(error), Err(_)) = (of_table, of_index) {
        if found.is_empty() {
            return Err(error);
        }
        lost.push(format!("more collections, perhaps: {error}"));
    }
    let unnamed = unnamed.iter().filter(|id| id.is_none_or(|id| !found.contains_key(&id)));
    lost.extend(unnamed.map(|_| "a collection: its name cannot be read".to_owned()));
    Ok(found.into_iter().collect())
}

/// Adds the collections that are listed in one place, and the numbers of those without a name.
fn list(
    source: &Connection,
    place: &str,
    found: &mut BTreeMap<i64, Namespace>,
    unnamed: &mut BTreeSet<Option<i64>>,
) -> rusqlite::Result<()> {
    let mut statement = source.prepare(&format!("SELECT id, database, name FROM collections {place}"))?;
    let mut rows = statement.query([])?;
    while let Some(row) = rows.next()? {
        let name = || -> rusqlite::Result<_> { Ok(Namespace { database: row.get(1)?, collection: row.get(2)? }) };
        match (row.get(0), name()) {
            (Ok(id), Ok(name)) => drop(found.entry(id).or_insert(name)),
            (id, _) => drop(unnamed.insert(id.ok())),
        }
    }
    Ok(())
}

/// The indexes of a collection, `None` for each that cannot be read.
fn definitions(source: &Connection, id: i64) -> Vec<Option<Index>> {
    let read = || -> rusqlite::Result<Vec<Vec<u8>>> {
        let mut statement = source.prepare("SELECT definition FROM indexes WHERE collection = ? ORDER BY id")?;
        statement.query_map([id], |row| row.get(0))?.collect()
    };
    let parse = |bytes: Vec<u8>| -> Option<Index> {
        let definition = bson::RawDocumentBuf::from_bytes(bytes).ok().filter(|raw| body::is_well_formed(raw))?;
        let definition = bson::Document::try_from(&*definition).map_err(QueryError::from).ok()?;
        Index::parse(&definition).ok()
    };
    read().map_or_else(|_| vec![None], |all| all.into_iter().map(parse).collect())
}

/// Copies the rows of a table that can be read.
fn copy(source: &Connection, target: &Connection, table: &str, columns: &str) -> rusqlite::Result<()> {
    let count = columns.split(',').count();
    let places = vec!["?"; count].join(", ");
    let mut statement = source.prepare(&format!("SELECT {columns} FROM {table} ORDER BY 1"))?;
    let mut insert = target.prepare(&format!("INSERT INTO {table} ({columns}) VALUES ({places})"))?;
    let mut rows = statement.query([])?;
    while let Some(row) = rows.next()? {
        let values = (0..count).map(|column| row.get::<_, rusqlite::types::Value>(column));
        insert.execute(rusqlite::params_from_iter(values.collect::<rusqlite::Result<Vec<_>>>()?))?;
    }
    Ok(())
}

impl Embedded {
    /// Empties the indexes of a collection and fills them from its documents; returns how many there are.
    fn refill_indexes(&self, ns: &Namespace, collection: Collection) -> Result<u64, StoreError> {
        let indexes = self.indexes_of(collection)?;
        let mut made = 0;
        for index in indexes.iter() {
            made += 1;
            if index.is_kept() {
                let table = index.table();
                // Entries that an older rmem made have no checksums.
                let clear = match index.is_sealed {
                    true => format!("DELETE FROM {table}"),
                    false => format!("DELETE FROM {table}; ALTER TABLE {table} ADD COLUMN seal INTEGER"),
                };
                self.connection
                    .execute_batch(&clear)
                    .and_then(|_| {
                        self.connection.execute("UPDATE indexes SET multikey = 0 WHERE id = ?", params![index.id])
                    })
                    .map_err(|e| self.explain(&e))?;
            }
        }
        self.catalog_cache.advance(&self.connection, collection).map_err(|e| self.explain(&e))?;
        self.indexes.clear();
        let collection = collection.reread(&self.connection).map_err(|e| self.explain(&e))?;
        for index in self.indexes_of(collection)?.iter() {
            self.fill(ns, collection, index)?;
        }
        Ok(made)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::Find;
    use bson::doc;

    /// How many documents the files of these tests have.
    const COUNT: u64 = 600;

    /// A file of which the bytes were changed: with the places of its pages of documents, and how many bytes each has.
    fn changed(path: &Path, change: impl Fn(&mut Vec<u8>, &[usize], usize)) -> Namespace {
        let ns = Namespace::parse("a.b").unwrap();
        let store = Embedded::open(path).unwrap();
        let text = "x".repeat(100);
        store.insert(&ns, (0..COUNT).map(|id| doc! { "_id": id as i64, "text": &text }).collect()).unwrap();
        let page = store.connection.query_row("PRAGMA page_size", [], |row| row.get::<_, u32>(0)).unwrap() as usize;
        drop(store);
        let mut bytes = std::fs::read(path).unwrap();
        let has_documents = |nth: &usize| String::from_utf8_lossy(&bytes[nth * page..][..page]).contains(&text);
        let pages: Vec<usize> = (1..bytes.len() / page).filter(has_documents).collect();
        change(&mut bytes, &pages, page);
        std::fs::write(path, bytes).unwrap();
        ns
    }

    /// A file of which one page of documents was overwritten with an earlier one.
    fn with_a_page_twice(path: &Path) -> Namespace {
        changed(path, |bytes, pages, size| {
            let (first, last) = (pages[1], pages[pages.len() - 2]);
            bytes.copy_within(first * size..(first + 1) * size, last * size);
        })
    }

    #[test]
    fn a_page_that_hides_documents_is_not_made_good_by_forgetting_them() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("robot.rmem");
        // The number of its documents is in the fourth and fifth byte of a page.
        let ns = changed(&path, |bytes, pages, size| {
            let count = &mut bytes[pages[3] * size + 4];
            assert!(*count > 8, "{count}");
            *count -= 4;
        });
        let before = std::fs::read(&path).unwrap();
        let store = Embedded::open(&path).unwrap();
        let counted = "a.b has 596 documents, and its index of _ids names 600";
        let read: Vec<Result<_, StoreError>> = store.find(&ns, &Find::default()).unwrap().collect();
        let last = read.last().and_then(|last| last.as_ref().err()).expect("what is missing is noticed").to_string();
        assert!(read.len() as u64 == COUNT - 3 && last.contains(counted), "{} {last}", read.len());
        let filter = doc! { "text": { "$exists": true } };
        let matched = store.count(&ns, (&filter).into()).unwrap_err().to_string();
        assert!(matched.contains(counted), "{matched}");
        assert!(store.check_whole(&ns).unwrap_err().to_string().contains(counted));
        let refused = store.rebuild_indexes().unwrap_err().to_string();
        assert!(refused.contains("a.b: 4 of the documents that the index of _ids names are not there"), "{refused}");
        drop(store);
        assert!(std::fs::read(&path).unwrap() == before, "the file is as it was");
        let repaired = Embedded::salvage(&path, &folder.path().join("saved.rmem")).unwrap();
        assert_eq!(repaired.documents, COUNT - 4);
        let [lost] = repaired.lost.as_slice() else { panic!("{repaired:?}") };
        assert!(lost.starts_with("a.b: the documents at positions "), "{lost}");
    }

    #[test]
    fn documents_on_pages_that_have_changed_places_are_saved() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("robot.rmem");
        let ns = changed(&path, |bytes, pages, size| {
            let (one, other) = (pages[2] * size, pages[9] * size);
            (0..size).for_each(|place| bytes.swap(one + place, other + place));
        });
        assert!(Embedded::open(&path).unwrap().rebuild_indexes().is_err());
        let saved = folder.path().join("saved.rmem");
        let repaired = Embedded::salvage(&path, &saved).unwrap();
        assert_eq!((repaired.documents, repaired.lost.as_slice()), (COUNT, [].as_slice()));
        let saved = Embedded::open(&saved).unwrap();
        assert_eq!(saved.find(&ns, &Find::default()).unwrap().count() as u64, COUNT);
    }

    #[test]
    fn a_page_that_is_there_twice_is_damage_and_not_read_for_ever() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("robot.rmem");
        let ns = with_a_page_twice(&path);
        let store = Embedded::open(&path).unwrap();
        let mut found = store.find(&ns, &Find::default()).unwrap();
        let error = found.find_map(Result::err).expect("the damage is noticed");
        assert!(error.to_string().contains("it is damaged"), "{error}");
        let copy = folder.path().join("copy.rmem");
        if let Err(error) = store.backup(&copy) {
            assert!(error.to_string().contains("robot.rmem"), "{error}");
        }
        let saved = folder.path().join("saved.rmem");
        let repaired = Embedded::salvage(&path, &saved).unwrap();
        assert!(repaired.documents > 300 && !repaired.lost.is_empty(), "{repaired:?}");
    }
}
