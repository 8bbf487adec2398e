//! The statements that read what an index lists.
//!
//! They are put together for each query; formatting them would take as long as reading a document.

use rusqlite::Connection;

use crate::query::index::Range;
use crate::store::embedded::access::Listing;
use crate::store::embedded::keys::Keys;

impl Listing {
    /// What reads the documents of a range, with the checksums of their entries; nothing in place of one that is not there.
    pub(super) fn documents_sql(&self, documents: &str) -> String {
        let index = self.keys.table.as_str();
        let mut sql = String::with_capacity(256 + 8 * index.len() + 2 * documents.len());
        push(&mut sql, &["SELECT ", index, ".key, ", index, ".position, ", documents, ".body, ", self.keys.seals()]);
        push(&mut sql, &[" FROM ", index]);
        if index != documents {
            push(&mut sql, &[" LEFT JOIN ", documents, " USING (position)"]);
        }
        self.push_range(&mut sql, false);
        sql
    }

    /// What reads only the entries of a range, or of its rest from a key on that was read of it.
    fn entries_sql(&self, is_rest: bool) -> String {
        let mut sql = String::new();
        let table = self.keys.table.as_str();
        push(&mut sql, &["SELECT key, position, ", &self.keys.proof(table), " FROM ", table]);
        self.push_range(&mut sql, is_rest);
        sql
    }

    /// Shows the positions of a range, in the order of the listing, those behind a key and a position if they are given.
    ///
    /// # Errors
    /// Where an entry is damaged, or the one beside the range.
    pub(in crate::store::embedded) fn read_positions(
        &self,
        connection: &Connection,
        range: &Range,
        behind: Option<(&[u8], i64)>,
        take: &mut dyn FnMut(i64),
    ) -> rusqlite::Result<()> {
        let (from, to) = self.ends(range);
        if behind.is_none() {
            self.check_before(connection, range)?;
        }
        let mut statement = connection.prepare_cached(&self.entries_sql(behind.is_some()))?;
        let mut rows = statement.query([behind.map_or(from, |(key, _)| key), to])?;
        let mut last = None;
        while let Some(row) = rows.next()? {
            let position = Keys::position(row, 2)?;
            let key = row.get_ref(0)?.as_blob()?;
            if behind.is_some_and(|(known, behind)| key == known && self.is_up_to(position, behind)) {
                continue;
            }
            take(position);
            note(&mut last, key);
        }
        let last = last.as_deref().or(behind.map(|(key, _)| key));
        self.check_behind(connection, range, last)
    }

    /// Checks the entry before a range, in the order of the listing.
    pub(super) fn check_before(&self, connection: &Connection, range: &Range) -> rusqlite::Result<()> {
        self.keys.check_before(connection, range, self.backwards)
    }

    /// Checks the entry that follows what was read of a range, up to a key if to any.
    pub(super) fn check_behind(
        &self,
        connection: &Connection,
        range: &Range,
        last: Option<&[u8]>,
    ) -> rusqlite::Result<()> {
        self.keys.check_behind(connection, range, self.backwards, last)
    }

    /// Whether of two entries with one key, the one at `position` is not listed behind the other.
    fn is_up_to(&self, position: i64, other: i64) -> bool {
        if self.backwards { position >= other } else { position <= other }
    }

    /// The key from which on a range is read, and that up to which.
    pub(super) fn ends<'r>(&self, range: &'r Range) -> (&'r [u8], &'r [u8]) {
        if self.backwards { (&range.high, &range.low) } else { (&range.low, &range.high) }
    }

    /// What finds the positions of a range at which there is no document.
    pub(super) fn lost_sql(&self, documents: &str) -> String {
        format!(
            "SELECT position FROM {} AS listed WHERE key >= ? AND key < ? AND NOT EXISTS (
                 SELECT 1 FROM {documents} WHERE {documents}.position = listed.position)",
            self.keys.table
        )
    }

    /// The condition and the order of a range. Rows are not compared as a whole: SQLite would prepare the statement anew each
    /// time, and leave out an entry whose key damage has made smaller.
    fn push_range(&self, sql: &mut String, is_rest: bool) {
        let index = self.keys.table.as_str();
        let (from, to, order) = match (self.backwards, is_rest) {
            (false, _) => (">=", "<", ""),
            (true, false) => ("<", ">=", " DESC"),
            (true, true) => ("<=", ">=", " DESC"),
        };
        push(sql, &[" WHERE ", index, ".key ", from, " ?1 AND ", index, ".key ", to, " ?2"]);
        push(sql, &[" ORDER BY ", index, ".key", order, ", ", index, ".position", order]);
    }
}

/// Notes a key as the last one.
pub(super) fn note(last: &mut Option<Vec<u8>>, key: &[u8]) {
    let last = last.get_or_insert_default();
    last.clear();
    last.extend_from_slice(key);
}

fn push(sql: &mut String, parts: &[&str]) {
    parts.iter().for_each(|part| sql.push_str(part));
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use super::*;
    use crate::store::embedded::catalog::Collection;

    #[test]
    fn the_table_of_documents_is_joined_to_that_of_an_index() {
        let of = |keys: &Keys, backwards| Listing {
            keys: keys.clone(),
            ranges: VecDeque::new(),
            backwards,
            is_of_one: false,
        };
        let documents = Keys::of_documents(Collection { id: 1, generation: 0 });
        assert_eq!(
            of(&Keys::of_index("entries_3".to_owned(), true), true).documents_sql("documents_1"),
            "SELECT entries_3.key, entries_3.position, documents_1.body, seal \
             FROM entries_3 LEFT JOIN documents_1 USING (position) \
             WHERE entries_3.key < ?1 AND entries_3.key >= ?2 \
             ORDER BY entries_3.key DESC, entries_3.position DESC"
        );
        assert_eq!(
            of(&documents, false).documents_sql("documents_1"),
            "SELECT documents_1.key, documents_1.position, documents_1.body, NULL FROM documents_1 \
             WHERE documents_1.key >= ?1 AND documents_1.key < ?2 \
             ORDER BY documents_1.key, documents_1.position"
        );
    }
}
