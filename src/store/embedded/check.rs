//! Checking everything in the file: `rmem doctor --deep`.
//!
//! In one read transaction: SQLite's own check of its pages; every document against its checksum
//! and the key of its row; every index against the documents; the log of changes.

use bson::RawDocument;
use rusqlite::{Connection, params};

use super::catalog::Collection;
use super::indexed::Indexed;
use super::keys::seal;
use super::scan::check_ending;
use super::snapshot::Snapshot;
use super::{Embedded, body, change_log, failure};
use crate::store::index::ID;
use crate::store::{Checked, Namespace, StoreError, Validated, ValidatedIndex};

/// How many findings of SQLite's own check are reported.
const MOST_FINDINGS: u32 = 100;

impl Embedded {
    /// Checks the file; `report` gets each damage, as a sentence.
    pub(super) fn check_all(&self, report: &mut dyn FnMut(&str)) -> Result<Checked, StoreError> {
        let mut checked = Checked::default();
        let _snapshot = Snapshot::begin(&self.connection).map_err(|e| self.explain(&e))?;
        if let Err(error) = integrity(&self.connection, &MOST_FINDINGS.to_string(), report) {
            report(&format!("SQLite's check failed: {error}"));
        }
        for ns in Collection::all(&self.connection).map_err(|e| self.explain(&e))? {
            checked.collections += 1;
            if let Err(error) = self.check_collection(&ns, &mut checked, report) {
                report(&format!("{ns} cannot be read to its end: {error}"));
            }
        }
        let changes = change_log::find_damage(&self.connection, &mut |sequence, wrong| {
            report(&format!("the change {sequence} in the log is damaged: {wrong}"));
        });
        if let Err(error) = changes {
            report(&format!("the log of changes cannot be read: {}", self.explain(&error)));
        }
        Ok(checked)
    }

    /// Compares how many documents a collection has with how many its index of `_id`s names: a damaged page may seem to have
    /// fewer. Once that was so, it is not looked at again: pages are damaged while they lie on the disk.
    pub(super) fn check_count(&self, collection: Collection) -> Result<(), StoreError> {
        if self.whole.borrow().contains(&collection.id) {
            return Ok(());
        }
        let (table, index) = (collection.table(), collection.index_of_ids());
        let sql = format!(
            "SELECT (SELECT count(*) FROM {table} NOT INDEXED), (SELECT count(*) FROM {table} INDEXED BY {index})"
        );
        let counts = self.connection.query_row(&sql, [], |row| Ok((row.get(0)?, row.get(1)?)));
        let (there, named): (i64, i64) = match counts {
            // A collection that another process dropped has no documents.
            Err(error) if failure::is_gone(&error) => return Ok(()),
            counts => counts.map_err(|e| self.explain(&e))?,
        };
        if there == named {
            self.whole.borrow_mut().insert(collection.id);
            return Ok(());
        }
        let ns = self.name(collection);
        Err(self.fail(&format!(
            "it is damaged: {ns} has {there} documents, and its index of _ids names {named}; `rmem doctor --deep` says \
             more, and `rmem repair -o FILE` saves what can be read"
        )))
    }

    fn check_collection(
        &self,
        ns: &Namespace,
        checked: &mut Checked,
        report: &mut dyn FnMut(&str),
    ) -> Result<Option<Validated>, StoreError> {
        let Some(collection) = self.collection(ns)? else { return Ok(None) };
        let mut validated = Validated::default();
        let indexes = self.indexes_of(collection)?;
        let kept: Vec<&Indexed> = indexes.iter().filter(|index| index.is_kept()).collect();
        let mut expected = vec![(0_u64, true); kept.len()];
        let mut is_sound = true;
        let sql = format!("SELECT position, key, body FROM {} ORDER BY position", collection.table());
        let mut statement = self.connection.prepare(&sql).map_err(|e| self.explain(&e))?;
        let mut rows = statement.query([]).map_err(|e| self.explain(&e))?;
        while let Some(row) = rows.next().map_err(|e| self.explain(&e))? {
            check_ending()?;
            let position: i64 = row.get(0).map_err(|e| self.explain(&e))?;
            let columns = row.get_ref(1).and_then(|key| Ok((key.as_blob()?, row.get_ref(2)?.as_blob()?)));
            let (key, stored) = columns.map_err(|e| self.explain(&e))?;
            checked.documents += 1;
            validated.documents += 1;
            checked.unsealed += u64::from(!body::is_sealed(stored));
            let name =
                body::name(stored).map_or_else(|| format!("at position {position}"), |id| format!("with _id {id}"));
            let document = match body::open(stored) {
                Ok(document) => document,
                Err(damage) => {
                    report(&format!("{ns}: the document {name} is damaged: {}", damage.describe()));
                    validated.damaged += 1;
                    continue;
                }
            };
            if !body::has_key(document, key) {
                report(&format!("{ns}: the document {name} is stored under another _id"));
                is_sound = false;
            }
            for (index, (expected, is_sound)) in kept.iter().zip(&mut expected) {
                match self.missing_keys(index, document, position) {
                    Ok((keys, 0)) => *expected += keys,
                    Ok((keys, missing)) => {
                        (*expected, *is_sound) = (*expected + keys - missing, false);
                        let index = &index.definition.name;
                        report(&format!(
                            "{ns}: the index {index} lacks {missing} of {keys} keys of the document {name}"
                        ));
                    }
                    Err(error) => {
                        report(&format!("{ns}: the index {} cannot be read: {error}", index.definition.name));
                        *is_sound = false;
                    }
                }
            }
        }
        let id = ValidatedIndex { name: ID.to_owned(), keys: validated.documents, is_sound };
        validated.indexes.push(id);
        for (index, (expected, mut is_sound)) in kept.iter().zip(expected) {
            checked.indexes += 1;
            let sql = format!("SELECT count(*) FROM {}", index.table());
            let found = self.connection.query_row(&sql, [], |row| row.get::<_, i64>(0));
            let found = found.map_err(|e| self.explain(&e))?.unsigned_abs();
            if found > expected {
                let (index, more) = (&index.definition.name, found - expected);
                report(&format!("{ns}: the index {index} has {more} keys of no document"));
                is_sound = false;
            }
            let name = index.definition.name.clone();
            validated.indexes.push(ValidatedIndex { name, keys: found, is_sound });
        }
        let others = indexes.iter().filter(|index| !index.is_kept());
        let others =
            others.map(|index| ValidatedIndex { name: index.definition.name.clone(), keys: 0, is_sound: true });
        validated.indexes.extend(others);
        Ok(Some(validated))
    }

    /// Checks one collection, and SQLite's pages of it.
    pub(super) fn validated(
        &self,
        ns: &Namespace,
        report: &mut dyn FnMut(&str),
    ) -> Result<Option<Validated>, StoreError> {
        let _snapshot = Snapshot::begin(&self.connection).map_err(|e| self.explain(&e))?;
        let Some(collection) = self.collection(ns)? else { return Ok(None) };
        let indexes = self.indexes_of(collection)?;
        let kept = indexes.iter().filter(|index| index.is_kept()).map(Indexed::table);
        for table in std::iter::once(collection.table()).chain(kept) {
            if let Err(error) = integrity(&self.connection, &format!("'{table}'"), report) {
                report(&format!("SQLite's check failed: {error}"));
            }
        }
        self.check_collection(ns, &mut Checked::default(), report)
    }

    /// How many keys a document has in an index, and how many of them are missing.
    fn missing_keys(&self, index: &Indexed, document: &RawDocument, position: i64) -> Result<(u64, u64), StoreError> {
        let keys = index.entries(document)?.keys;
        let table_of = index.keys();
        let (table, seals) = (&table_of.table, table_of.seals());
        let sql = format!("SELECT 1 FROM {table} WHERE key = ?1 AND position = ?2 AND ifnull({seals}, ?3) = ?3");
        let mut statement = self.connection.prepare_cached(&sql).map_err(|e| self.explain(&e))?;
        let mut missing = 0;
        for key in &keys {
            missing += u64::from(
                !statement.exists(params![key, position, seal(key, position)]).map_err(|e| self.explain(&e))?,
            );
        }
        Ok((keys.len() as u64, missing))
    }
}

/// SQLite's own check of its pages, trees and constraints: of a table, or of all with so many findings.
pub(super) fn integrity(connection: &Connection, of: &str, report: &mut dyn FnMut(&str)) -> rusqlite::Result<()> {
    let mut statement = connection.prepare(&format!("PRAGMA integrity_check({of})"))?;
    let mut rows = statement.query([])?;
    while let Some(row) = rows.next()? {
        let finding: String = row.get(0)?;
        if finding != "ok" {
            report(&format!("SQLite: {finding}"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use bson::doc;
    use rusqlite::Connection;

    use super::*;
    use crate::store::{Index, Store as _};

    #[test]
    fn a_collection_is_checked_alone_and_says_which_index_lacks_keys() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.rmem");
        let store = Embedded::open(&path).unwrap();
        let [ns, other] = ["a.b", "a.c"].map(|ns| Namespace::parse(ns).unwrap());
        for ns in [&ns, &other] {
            store.insert(ns, (0..10).map(|n| doc! { "_id": n, "n": n }).collect()).unwrap();
            store.create_index(ns, &Index::on(doc! { "n": 1 })).unwrap();
            store.create_index(ns, &Index::on(doc! { "place": "2dsphere" })).unwrap();
        }
        let table = store.indexes_of(store.collection(&ns).unwrap().unwrap()).unwrap()[0].table();
        let removed = Connection::open(&path).unwrap().execute(&format!("DELETE FROM {table} WHERE position = 3"), []);
        assert_eq!(removed.unwrap(), 1);
        let validated = |ns: &Namespace| {
            let mut damage = Vec::new();
            let validated = store.validate(ns, &mut |one| damage.push(one.to_owned())).unwrap();
            (validated, damage)
        };
        let index = |name: &str, keys, is_sound| ValidatedIndex { name: name.to_owned(), keys, is_sound };
        let (found, damage) = validated(&ns);
        let indexes = found.unwrap().indexes;
        assert_eq!(indexes, [index("_id_", 10, true), index("n_1", 9, false), index("place_2dsphere", 0, true)]);
        assert!(matches!(damage.as_slice(), [one] if one.contains("the index n_1 lacks 1 of 1 keys")), "{damage:?}");
        let (found, damage) = validated(&other);
        assert!(damage.is_empty() && found.unwrap().indexes.iter().all(|index| index.is_sound));
        assert_eq!(validated(&Namespace::parse("a.none").unwrap()), (None, Vec::new()));
    }
}
