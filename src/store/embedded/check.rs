//! Checking everything in the file: `rmem doctor --deep`.
//!
//! In one read transaction: SQLite's own check of its pages; every document against its checksum
//! and the key of its row; every index against the documents; the log of changes.

use bson::RawDocument;
use rusqlite::{Connection, params};

use super::catalog::Collection;
use super::indexed::Indexed;
use super::snapshot::Snapshot;
use super::{Embedded, body, change_log};
use crate::store::{Checked, Namespace, StoreError};

/// How many findings of SQLite's own check are reported.
const MOST_FINDINGS: u32 = 100;

impl Embedded {
    /// Checks the file; `report` gets each damage, as a sentence.
    pub(super) fn check_all(&self, report: &mut dyn FnMut(&str)) -> Result<Checked, StoreError> {
        let mut checked = Checked::default();
        let _snapshot = Snapshot::begin(&self.connection).map_err(|e| self.explain(&e))?;
        if let Err(error) = integrity(&self.connection, report) {
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

    fn check_collection(
        &self,
        ns: &Namespace,
        checked: &mut Checked,
        report: &mut dyn FnMut(&str),
    ) -> Result<(), StoreError> {
        let Some(collection) = self.collection(ns)? else { return Ok(()) };
        let indexes = self.indexes_of(collection)?;
        let kept: Vec<&Indexed> = indexes.iter().filter(|index| index.is_kept()).collect();
        let mut expected = vec![0_u64; kept.len()];
        let sql = format!("SELECT position, key, body FROM {} ORDER BY position", collection.table());
        let mut statement = self.connection.prepare(&sql).map_err(|e| self.explain(&e))?;
        let mut rows = statement.query([]).map_err(|e| self.explain(&e))?;
        while let Some(row) = rows.next().map_err(|e| self.explain(&e))? {
            let position: i64 = row.get(0).map_err(|e| self.explain(&e))?;
            let columns = row.get_ref(1).and_then(|key| Ok((key.as_blob()?, row.get_ref(2)?.as_blob()?)));
            let (key, stored) = columns.map_err(|e| self.explain(&e))?;
            checked.documents += 1;
            checked.unsealed += u64::from(!body::is_sealed(stored));
            let name =
                body::name(stored).map_or_else(|| format!("at position {position}"), |id| format!("with _id {id}"));
            let document = match body::open(stored) {
                Ok(document) => document,
                Err(damage) => {
                    report(&format!("{ns}: the document {name} is damaged: {}", damage.describe()));
                    continue;
                }
            };
            if !body::has_key(document, key) {
                report(&format!("{ns}: the document {name} is stored under another _id"));
            }
            for (index, expected) in kept.iter().zip(&mut expected) {
                match self.missing_keys(index, document, position) {
                    Ok((keys, 0)) => *expected += keys,
                    Ok((keys, missing)) => {
                        *expected += keys - missing;
                        let index = &index.definition.name;
                        report(&format!(
                            "{ns}: the index {index} lacks {missing} of {keys} keys of the document {name}"
                        ));
                    }
                    Err(error) => report(&format!("{ns}: the index {} cannot be read: {error}", index.definition.name)),
                }
            }
        }
        for (index, expected) in kept.iter().zip(expected) {
            checked.indexes += 1;
            let sql = format!("SELECT count(*) FROM {}", index.table());
            let found = self.connection.query_row(&sql, [], |row| row.get::<_, i64>(0));
            let found = found.map_err(|e| self.explain(&e))?.unsigned_abs();
            if found > expected {
                let (index, more) = (&index.definition.name, found - expected);
                report(&format!("{ns}: the index {index} has {more} keys of no document"));
            }
        }
        Ok(())
    }

    /// How many keys a document has in an index, and how many of them are missing.
    fn missing_keys(&self, index: &Indexed, document: &RawDocument, position: i64) -> Result<(u64, u64), StoreError> {
        let keys = index.entries(document)?.keys;
        let sql = format!("SELECT 1 FROM {} WHERE key = ? AND position = ?", index.table());
        let mut statement = self.connection.prepare_cached(&sql).map_err(|e| self.explain(&e))?;
        let mut missing = 0;
        for key in &keys {
            missing += u64::from(!statement.exists(params![key, position]).map_err(|e| self.explain(&e))?);
        }
        Ok((keys.len() as u64, missing))
    }
}

/// SQLite's own check of its pages, trees and constraints.
fn integrity(connection: &Connection, report: &mut dyn FnMut(&str)) -> rusqlite::Result<()> {
    let mut statement = connection.prepare(&format!("PRAGMA integrity_check({MOST_FINDINGS})"))?;
    let mut rows = statement.query([])?;
    while let Some(row) = rows.next()? {
        let finding: String = row.get(0)?;
        if finding != "ok" {
            report(&format!("SQLite: {finding}"));
        }
    }
    Ok(())
}
