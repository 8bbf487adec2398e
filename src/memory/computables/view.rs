//! Which documents an operation sees.

use bson::oid::ObjectId;
use bson::{Bson, DateTime, Document, doc};

use crate::memory::hidden_metadata;
use crate::store::metadata;

/// What an operation sees: documents that have not decayed, and of those that
/// computables made, the ones that were computed for it.
#[derive(Debug, Clone)]
pub(in crate::memory) struct View {
    at: DateTime,
    /// Null, which stands for stored documents, and the computations that are for it; none where all are seen.
    tokens: Option<Vec<Bson>>,
    /// Whether computables add keys to what is asked for.
    adds_keys: bool,
}

/// How an answer is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::memory) enum Answering {
    /// By `Memory::read` and `Memory::tally`, which know what is not stored. It is made again where computed documents
    /// were replaced meanwhile.
    Reading,
    /// By the store, which has to have all documents; else the same.
    Asking,
    /// By the store, once: it writes.
    Writing,
}

impl View {
    /// Returns the stored documents at a time.
    pub(in crate::memory) fn at(at: DateTime) -> Self {
        Self { at, tokens: Some(vec![Bson::Null]), adds_keys: false }
    }

    /// Returns the stored documents at a time, and all that the cache holds.
    pub(in crate::memory) fn with_computed(at: DateTime) -> Self {
        Self { at, tokens: None, adds_keys: false }
    }

    /// The same for an operation whose documents get keys by computables, or do not.
    pub(super) fn with_keys(self, adds_keys: bool) -> Self {
        Self { adds_keys, ..self }
    }

    /// Whether computables add keys to what is asked for.
    pub(super) fn adds_keys(&self) -> bool {
        self.adds_keys
    }

    /// The time of the operation.
    pub(super) fn time(&self) -> DateTime {
        self.at
    }

    /// Adds the documents of a computation.
    pub(super) fn allow(&mut self, token: impl Into<Bson>) {
        if let Some(tokens) = &mut self.tokens {
            tokens.push(token.into());
        }
    }

    /// The computations whose documents are seen.
    pub(super) fn computations(&self) -> Vec<ObjectId> {
        self.tokens.iter().flatten().filter_map(Bson::as_object_id).collect()
    }

    /// Whether the documents of a computation are seen.
    pub(super) fn shows(&self, token: ObjectId) -> bool {
        self.tokens.as_ref().is_none_or(|tokens| tokens.contains(&Bson::ObjectId(token)))
    }

    /// Whether documents are in sight that may be computed anew meanwhile.
    pub(in crate::memory) fn is_computed(&self) -> bool {
        self.tokens.as_ref().is_none_or(|tokens| tokens.len() > 1)
    }

    /// What is true of the documents that are seen.
    pub(in crate::memory) fn visible(&self) -> Document {
        let mut visible = metadata::visible(self.at);
        match &self.tokens {
            Some(tokens) if matches!(tokens.as_slice(), [Bson::Null]) => return metadata::stored(self.at),
            // Null equals missing.
            Some(tokens) => visible.insert(metadata::TOKEN_PATH, doc! { "$in": tokens }),
            // What is kept longer than the cache holds, is kept for the query that it was computed for.
            None => visible.insert(metadata::info_path("cached_until"), doc! { "$not": { "$lte": self.at } }),
        };
        visible
    }

    /// The filter, for the documents that are seen. Its expressions do not see the metadata.
    pub(in crate::memory) fn filter(&self, filter: &Document) -> Document {
        let visible = self.visible();
        if filter.is_empty() {
            visible
        } else {
            doc! { "$and": [hidden_metadata::in_filter(filter), visible] }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::query::Filter;

    #[test]
    fn stored_documents_are_seen_and_of_computed_ones_those_that_are_allowed() {
        let (at, token) = (DateTime::from_millis(10), ObjectId::new());
        let stored = doc! { "name": "cup" };
        let computed = doc! { "name": "cup", "_robmem_info": { "computation": { "token": token } } };
        let decayed = doc! { "name": "cup", "_robmem_info": { "decay_time": at } };
        let mut view = View::at(at);
        let seen = |view: &View| {
            let filter = Filter::parse(&view.filter(&doc! { "name": "cup" })).unwrap();
            [&stored, &computed, &decayed].map(|document| filter.matches_document(document).unwrap())
        };
        assert_eq!(seen(&view), [true, false, false]);
        view.allow(ObjectId::new());
        assert_eq!(seen(&view), [true, false, false]);
        view.allow(token);
        assert_eq!(seen(&view), [true, true, false]);
    }
}
