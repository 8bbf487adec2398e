//! The statements that read what an index lists.

use crate::store::embedded::access::Listing;

impl Listing {
    /// What reads the documents of a range behind a key and a position; nothing in place of one that is not there.
    pub(super) fn documents_sql(&self, documents: &str) -> String {
        let (from, index) = match self.table == documents {
            true => (documents.to_owned(), documents),
            false => (format!("{0} LEFT JOIN {documents} USING (position)", self.table), self.table.as_str()),
        };
        format!("SELECT {index}.key, {index}.position, {documents}.body FROM {from} {}", self.range(index))
    }

    /// What reads only where they are.
    pub(super) fn positions_sql(&self) -> String {
        format!("SELECT position FROM {} {}", self.table, self.range(&self.table))
    }

    /// What finds the positions of a range at which there is no document.
    pub(super) fn lost_sql(&self, documents: &str) -> String {
        format!(
            "SELECT position FROM {} AS listed WHERE key >= ? AND key < ? AND NOT EXISTS (
                 SELECT 1 FROM {documents} WHERE {documents}.position = listed.position)",
            self.table
        )
    }

    fn range(&self, index: &str) -> String {
        let (behind, before, order) = if self.backwards { ("<", ">=", "DESC") } else { (">", "<", "ASC") };
        format!(
            "WHERE ({index}.key, {index}.position) {behind} (?1, ?2) AND {index}.key {before} ?3 \
             ORDER BY {index}.key {order}, {index}.position {order}"
        )
    }
}
