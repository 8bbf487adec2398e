//! The documents of a table that may be damaged: what of them can be read.

use rusqlite::{Connection, OptionalExtension as _};

use super::catalog::Collection;
use super::{body, failure};
use crate::store::StoreError;

/// A row: its position and the stored bytes.
type Row = (i64, Vec<u8>);

/// What is done with the document at a position.
pub(super) type OfDocument<'f> = dyn FnMut(i64, &[u8]) -> Result<(), StoreError> + 'f;

/// Gives the document at a position, where it is there.
pub(super) type Look<'f> = dyn FnMut() -> Option<Vec<u8>> + 'f;

/// What is done with a position that is named.
pub(super) type OfName<'f> = dyn FnMut(i64, &mut Look<'_>) -> Result<(), StoreError> + 'f;

/// The table of a collection in a file that is only read.
#[derive(Clone, Copy)]
pub(super) struct DamagedTable<'s> {
    pub(super) source: &'s Connection,
    pub(super) collection: Collection,
}

impl DamagedTable<'_> {
    /// Reads the documents behind a position, as the tree of their pages leads to them. Returns whether it came to the end: where
    /// something cannot be read, it stops.
    ///
    /// # Errors
    /// Those of `each`.
    pub(super) fn walk(self, position: i64, each: &mut OfDocument<'_>) -> Result<bool, StoreError> {
        let sql = format!("SELECT position, body FROM {} NOT INDEXED WHERE position > ?", self.collection.table());
        let Ok(mut statement) = self.source.prepare(&sql) else { return Ok(false) };
        let Ok(mut rows) = statement.query([position]) else { return Ok(false) };
        loop {
            let row = match rows.next() {
                Ok(None) => return Ok(true),
                Ok(Some(row)) => row,
                Err(_) => return Ok(false),
            };
            match (row.get(0), row.get_ref(1).map(|body| body.as_blob())) {
                (Ok(position), Ok(Ok(body))) => each(position, body)?,
                _ => return Ok(false),
            }
        }
    }

    /// Reads the positions that the index of `_id`s names; each can be asked for the document that is there under that `_id`.
    /// Returns why it cannot be read to its end, where that is so.
    ///
    /// # Errors
    /// Those of `each`.
    pub(super) fn named(self, each: &mut OfName<'_>) -> Result<Option<String>, StoreError> {
        let (table, index) = (self.collection.table(), self.collection.index_of_ids());
        let names = format!("SELECT key, position FROM {table} INDEXED BY {index} ORDER BY key");
        let body = format!("SELECT body FROM {table} NOT INDEXED WHERE position = ?");
        let mut read = || -> rusqlite::Result<Result<(), StoreError>> {
            let (mut names, mut body) = (self.source.prepare(&names)?, self.source.prepare(&body)?);
            let mut rows = names.query([])?;
            while let Some(row) = rows.next()? {
                let (key, position): (Vec<u8>, i64) = (row.get(0)?, row.get(1)?);
                let is_named =
                    |stored: &Vec<u8>| body::open(stored).is_ok_and(|document| body::has_key(document, &key));
                let mut look = || body.query_row([position], |row| row.get(0)).ok().filter(is_named);
                if let Err(error) = each(position, &mut look) {
                    return Ok(Err(error));
                }
            }
            Ok(Ok(()))
        };
        match read() {
            Ok(done) => done.map(|()| None),
            Err(error) => Ok(Some(format!("cannot be read: {error}"))),
        }
    }

    /// The last position of a damaged part that begins behind `position`: the smallest behind which a
    /// document can be read. `None` where none can.
    pub(super) fn behind_damage(self, position: i64) -> Option<i64> {
        let start = position.max(0);
        let is_readable = |at: i64| matches!(self.next(at), Ok(Some(_)));
        let (mut damaged, mut step) = (start, 1_i64);
        let mut readable = loop {
            let at = start.checked_add(step)?;
            if is_readable(at) {
                break at;
            }
            if matches!(self.next(at), Ok(None)) {
                return None;
            }
            damaged = at;
            step = step.checked_mul(2)?;
        };
        while readable - damaged > 1 {
            let middle = damaged + (readable - damaged) / 2;
            if is_readable(middle) { readable = middle } else { damaged = middle }
        }
        Some(readable)
    }

    /// The next document behind a position.
    fn next(self, position: i64) -> rusqlite::Result<Option<Row>> {
        let table = self.collection.table();
        let sql =
            format!("SELECT position, body FROM {table} NOT INDEXED WHERE position > ? ORDER BY position LIMIT 1");
        let mut statement = self.source.prepare_cached(&sql)?;
        let found: Option<Row> = statement.query_row([position], |row| Ok((row.get(0)?, row.get(1)?))).optional()?;
        found.iter().try_for_each(|(found, _)| failure::check_order(*found, position))?;
        Ok(found)
    }
}
