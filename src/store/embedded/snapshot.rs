//! A read transaction: several statements see the same state of the store.

use rusqlite::{Connection, Result};

use super::catalog_cache::CatalogCache;

/// While it exists, writes of other processes are not seen.
pub(super) struct Snapshot<'a> {
    /// None where a transaction was open already.
    connection: Option<&'a Connection>,
    catalog: Option<&'a CatalogCache>,
}

impl<'a> Snapshot<'a> {
    /// Begins a read transaction, unless a transaction is open.
    pub(super) fn begin(connection: &'a Connection) -> Result<Self> {
        if !connection.is_autocommit() {
            return Ok(Self { connection: None, catalog: None });
        }
        connection.prepare_cached("BEGIN")?.execute([])?;
        Ok(Self { connection: Some(connection), catalog: None })
    }

    /// The same, in which collections are looked up that earlier ones may know.
    pub(super) fn knowing(connection: &'a Connection, catalog: &'a CatalogCache) -> Result<Self> {
        let mut snapshot = Self::begin(connection)?;
        if snapshot.connection.is_some() {
            catalog.open(connection)?;
            snapshot.catalog = Some(catalog);
        }
        Ok(snapshot)
    }
}

impl Drop for Snapshot<'_> {
    fn drop(&mut self) {
        if let Some(catalog) = self.catalog {
            catalog.close();
        }
        if let Some(connection) = self.connection {
            // A failed end of a read transaction loses nothing.
            let _ = connection.prepare_cached("COMMIT").and_then(|mut end| end.execute([]));
        }
    }
}
