//! The statements that read what an index lists.
//!
//! They are put together for each query; formatting them would take as long as reading a document.

use crate::store::embedded::access::Listing;

impl Listing {
    /// What reads the documents of a range behind a key and a position; nothing in place of one that is not there.
    pub(super) fn documents_sql(&self, documents: &str) -> String {
        let index = self.table.as_str();
        let mut sql = String::with_capacity(256 + 8 * index.len() + 2 * documents.len());
        push(&mut sql, &["SELECT ", index, ".key, ", index, ".position, ", documents, ".body FROM ", index]);
        if index != documents {
            push(&mut sql, &[" LEFT JOIN ", documents, " USING (position)"]);
        }
        self.push_range(&mut sql);
        sql
    }

    /// What reads only where they are.
    pub(super) fn positions_sql(&self) -> String {
        let mut sql = String::new();
        push(&mut sql, &["SELECT position FROM ", &self.table]);
        self.push_range(&mut sql);
        sql
    }

    /// What finds the positions of a range at which there is no document.
    pub(super) fn lost_sql(&self, documents: &str) -> String {
        format!(
            "SELECT position FROM {} AS listed WHERE key >= ? AND key < ? AND NOT EXISTS (
                 SELECT 1 FROM {documents} WHERE {documents}.position = listed.position)",
            self.table
        )
    }

    fn push_range(&self, sql: &mut String) {
        let (behind, before, order) = if self.backwards { ("<", ">=", " DESC") } else { (">", "<", " ASC") };
        let index = self.table.as_str();
        push(sql, &[" WHERE (", index, ".key, ", index, ".position) ", behind, " (?1, ?2)"]);
        push(sql, &[" AND ", index, ".key ", before, " ?3 ORDER BY ", index, ".key", order]);
        push(sql, &[", ", index, ".position", order]);
    }
}

fn push(sql: &mut String, parts: &[&str]) {
    parts.iter().for_each(|part| sql.push_str(part));
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use super::*;

    #[test]
    fn the_table_of_documents_is_joined_to_that_of_an_index() {
        let of = |table: &str, backwards| Listing { table: table.to_owned(), ranges: VecDeque::new(), backwards };
        assert_eq!(
            of("entries_3", true).documents_sql("documents_1"),
            "SELECT entries_3.key, entries_3.position, documents_1.body \
             FROM entries_3 LEFT JOIN documents_1 USING (position) \
             WHERE (entries_3.key, entries_3.position) < (?1, ?2) AND entries_3.key >= ?3 \
             ORDER BY entries_3.key DESC, entries_3.position DESC"
        );
        assert_eq!(
            of("documents_1", false).documents_sql("documents_1"),
            "SELECT documents_1.key, documents_1.position, documents_1.body FROM documents_1 \
             WHERE (documents_1.key, documents_1.position) > (?1, ?2) AND documents_1.key < ?3 \
             ORDER BY documents_1.key ASC, documents_1.position ASC"
        );
    }
}
