//! A read transaction: several statements see the same state of the store.

use rusqlite::{Connection, Result};

/// While it exists, writes of other processes are not seen.
pub(super) struct Snapshot<'a>(Option<&'a Connection>);

impl<'a> Snapshot<'a> {
    /// Begins a read transaction, unless a transaction is open.
    pub(super) fn begin(connection: &'a Connection) -> Result<Self> {
        if !connection.is_autocommit() {
            return Ok(Self(None));
        }
        connection.prepare_cached("BEGIN")?.execute([])?;
        Ok(Self(Some(connection)))
    }
}

impl Drop for Snapshot<'_> {
    fn drop(&mut self) {
        if let Some(connection) = self.0 {
            // A failed end of a read transaction loses nothing.
            let _ = connection.prepare_cached("COMMIT").and_then(|mut end| end.execute([]));
        }
    }
}
