//! The table of collections.

use rusqlite::{Connection, OptionalExtension as _, Result, params};

use super::failure;
use crate::store::Namespace;

/// A collection of an embedded store.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Collection {
    /// The number in the name of its table.
    pub(super) id: i64,
    /// Grows with every change of its indexes.
    pub(super) generation: i64,
}

impl Collection {
    /// The collection called `ns`, where there is one.
    pub(super) fn find(connection: &Connection, ns: &Namespace) -> Result<Option<Self>> {
        connection
            .prepare_cached("SELECT id, generation FROM collections WHERE database = ? AND name = ?")?
            .query_row(params![ns.database, ns.collection], |row| Ok(Self { id: row.get(0)?, generation: row.get(1)? }))
            .optional()
    }

    /// The collection called `ns`, created where there is none. In a write transaction only.
    pub(super) fn ensure(connection: &Connection, ns: &Namespace) -> Result<Self> {
        if let Some(collection) = Self::find(connection, ns)? {
            return Ok(collection);
        }
        connection
            .prepare_cached("INSERT INTO collections (database, name) VALUES (?, ?)")?
            .execute(params![ns.database, ns.collection])?;
        let collection = Self { id: connection.last_insert_rowid(), generation: 0 };
        connection.execute_batch(&format!(
            "CREATE TABLE {} (position INTEGER PRIMARY KEY, key BLOB NOT NULL UNIQUE, body BLOB NOT NULL) STRICT",
            collection.table()
        ))?;
        Ok(collection)
    }

    /// Removes the collection and its documents. In a write transaction only.
    pub(super) fn drop(self, connection: &Connection) -> Result<()> {
        connection.prepare_cached("DELETE FROM collections WHERE id = ?")?.execute([self.id])?;
        connection.execute_batch(&format!("DROP TABLE {}", self.table()))
    }

    /// Notes that its indexes changed. In a write transaction only.
    pub(super) fn advance(self, connection: &Connection) -> Result<()> {
        connection
            .prepare_cached("UPDATE collections SET generation = generation + 1 WHERE id = ?")?
            .execute([self.id])
            .map(|_| ())
    }

    /// Whether it still exists.
    pub(super) fn is_there(self, connection: &Connection) -> Result<bool> {
        connection.prepare_cached("SELECT 1 FROM collections WHERE id = ?")?.exists([self.id])
    }

    /// The name of the collection, where it still exists.
    pub(super) fn namespace(self, connection: &Connection) -> Result<Option<Namespace>> {
        connection
            .prepare_cached("SELECT database, name FROM collections WHERE id = ?")?
            .query_row([self.id], |row| Ok(Namespace { database: row.get(0)?, collection: row.get(1)? }))
            .optional()
    }

    /// The same collection, of the generation it has now.
    pub(super) fn reread(self, connection: &Connection) -> Result<Self> {
        let generation = connection
            .prepare_cached("SELECT generation FROM collections WHERE id = ?")?
            .query_row([self.id], |row| row.get(0))?;
        Ok(Self { generation, ..self })
    }

    /// Returns the collection another name, which is free. In a write transaction only.
    pub(super) fn rename(self, connection: &Connection, to: &Namespace) -> Result<()> {
        connection
            .prepare_cached("UPDATE collections SET database = ?, name = ? WHERE id = ?")?
            .execute(params![to.database, to.collection, self.id])
            .map(|_| ())
    }

    /// How many documents there are.
    pub(super) fn size(self, connection: &Connection) -> Result<u64> {
        self.number(connection, "count(*)").map(i64::unsigned_abs)
    }

    /// How many bytes the documents have.
    pub(super) fn bytes(self, connection: &Connection) -> Result<i64> {
        self.number(connection, "coalesce(sum(length(body)), 0)")
    }

    /// The position of the last document, where there is one.
    pub(super) fn last(self, connection: &Connection) -> Result<i64> {
        self.number(connection, "coalesce(max(position), 0)")
    }

    /// A number about the documents; 0 where another process dropped the collection meanwhile.
    fn number(self, connection: &Connection, expression: &str) -> Result<i64> {
        let asked = connection
            .prepare_cached(&format!("SELECT {expression} FROM {}", self.table()))
            .and_then(|mut statement| statement.query_row([], |row| row.get(0)));
        match asked {
            Err(error) if failure::is_gone(&error) => Ok(0),
            asked => asked,
        }
    }

    /// All collections, sorted.
    pub(super) fn all(connection: &Connection) -> Result<Vec<Namespace>> {
        let mut statement =
            connection.prepare_cached("SELECT database, name FROM collections ORDER BY database, name")?;
        let rows = statement.query_map([], |row| Ok(Namespace { database: row.get(0)?, collection: row.get(1)? }))?;
        rows.collect()
    }

    /// The name of the table that holds the documents.
    pub(super) fn table(self) -> String {
        format!("documents_{}", self.id)
    }

    /// SQLite's own index of the keys in this table, which are those of the `_id`s.
    pub(super) fn index_of_ids(self) -> String {
        format!("sqlite_autoindex_documents_{}_1", self.id)
    }
}
