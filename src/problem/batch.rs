//! Documents side by side, on their way from the memory to a template.

use std::sync::LazyLock;

use bson::{RawDocument, RawDocumentBuf};

use crate::store::metadata;

static EMPTY: LazyLock<RawDocumentBuf> = LazyLock::new(RawDocumentBuf::new);

/// Documents in one piece of memory: making and dropping each by itself, in different threads, takes longer than reading it.
#[derive(Debug, Default)]
pub(super) struct Batch {
    bytes: Vec<u8>,
    /// Where each of them ends.
    ends: Vec<usize>,
    /// Whether the documents have metadata that is not for the template.
    has_hidden: bool,
}

impl Batch {
    /// An empty one with room for so many documents and bytes.
    pub(super) fn with_capacity(documents: usize, bytes: usize) -> Self {
        Self { bytes: Vec::with_capacity(bytes), ends: Vec::with_capacity(documents), has_hidden: false }
    }

    /// The same, whose documents have metadata that is not for the template, if they do.
    pub(super) fn hiding(self, has_hidden: bool) -> Self {
        Self { has_hidden, ..self }
    }

    /// Whether the template does not see a key of a document.
    pub(super) fn hides(&self, key: &str) -> bool {
        self.has_hidden && key == metadata::INFO
    }

    /// Adds a document.
    pub(super) fn push(&mut self, document: &RawDocument) {
        self.bytes.extend_from_slice(document.as_bytes());
        self.ends.push(self.bytes.len());
    }

    /// How many documents there are.
    pub(super) fn len(&self) -> usize {
        self.ends.len()
    }

    /// How many bytes they have.
    pub(super) fn size(&self) -> usize {
        self.bytes.len()
    }

    /// A document, with what is hidden of it; an empty one where there are not so many.
    pub(super) fn get(&self, nth: usize) -> &RawDocument {
        let start = nth.checked_sub(1).map_or(Some(0), |before| self.ends.get(before).copied());
        let end = self.ends.get(nth).copied();
        let bytes = start.zip(end).and_then(|(start, end)| self.bytes.get(start..end));
        bytes.and_then(|bytes| RawDocument::from_bytes(bytes).ok()).unwrap_or(&EMPTY)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::rawdoc;

    #[test]
    fn documents_come_back_one_by_one() {
        let documents = [rawdoc! { "a": 1 }, rawdoc! {}, rawdoc! { "a": { "b": ["text"] } }];
        let mut batch = Batch::with_capacity(1, 0);
        documents.iter().for_each(|document| batch.push(document));
        assert_eq!((batch.len(), batch.size()), (3, documents.iter().map(|one| one.as_bytes().len()).sum()));
        for (nth, document) in documents.iter().enumerate() {
            assert_eq!(batch.get(nth), &**document);
        }
        assert_eq!(batch.get(3), &*rawdoc! {});
    }
}
