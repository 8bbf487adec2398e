//! Reading a store as it is at one moment, in several statements.

use rusqlite::{Connection, Result};

/// While it lives, what others write is not seen.
pub(super) struct Moment<'a>(Option<&'a Connection>);

impl<'a> Moment<'a> {
    /// Begins one, unless there is a transaction, which is one too.
    pub(super) fn begin(connection: &'a Connection) -> Result<Self> {
        if !connection.is_autocommit() {
            return Ok(Self(None));
        }
        connection.prepare_cached("BEGIN")?.execute([])?;
        Ok(Self(Some(connection)))
    }
}

impl Drop for Moment<'_> {
    fn drop(&mut self) {
        if let Some(connection) = self.0 {
            // What was only read has nothing that could be lost.
            let _ = connection.prepare_cached("COMMIT").and_then(|mut end| end.execute([]));
        }
    }
}
