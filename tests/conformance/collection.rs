//! A collection in memory, over the query room's public interface.

use std::collections::HashSet;

use bson::{Bson, DateTime, Document, RawDocumentBuf};
use rmem::query::{Filter, QueryError, Update, key, prepare};

#[derive(Default, Clone)]
pub(crate) struct Collection {
    pub(crate) documents: Vec<RawDocumentBuf>,
    ids: HashSet<Vec<u8>>,
}

/// What an update did.
#[derive(Default)]
pub(crate) struct Changed {
    pub(crate) matched: i32,
    pub(crate) modified: i32,
    pub(crate) upserted: Option<Bson>,
}

impl Collection {
    pub(crate) fn insert(&mut self, document: &Document) -> Result<(), QueryError> {
        self.add(prepare(document, DateTime::now())?)
    }

    pub(crate) fn add(&mut self, document: RawDocumentBuf) -> Result<(), QueryError> {
        let id = document.get("_id").map_err(invalid)?.ok_or_else(|| invalid("no _id"))?;
        if !self.ids.insert(key::encode(id)) {
            return Err(QueryError {
                code: 11000,
                operator: None,
                unsupported: false,
                message: "duplicate key".to_owned(),
            });
        }
        self.documents.push(document);
        Ok(())
    }

    pub(crate) fn matching(&self, filter: &Filter) -> Result<Vec<usize>, QueryError> {
        let mut places = Vec::new();
        for (place, document) in self.documents.iter().enumerate() {
            if filter.matches(document)? {
                places.push(place);
            }
        }
        Ok(places)
    }

    pub(crate) fn remove(&mut self, places: &[usize]) {
        for place in places.iter().rev() {
            let document = self.documents.remove(*place);
            if let Ok(Some(id)) = document.get("_id") {
                self.ids.remove(&key::encode(id));
            }
        }
    }

    pub(crate) fn update(
        &mut self,
        places: &[usize],
        filter: &Filter,
        update: &Update,
        now: DateTime,
    ) -> Result<Changed, QueryError> {
        let mut changed = Changed::default();
        for place in places {
            if let Some(after) = update.apply(&self.documents[*place], filter, now)? {
                self.documents[*place] = after;
                changed.modified += 1;
            }
            changed.matched += 1;
        }
        Ok(changed)
    }

    /// Gives the document of an upsert the `_id` that mongod made.
    pub(crate) fn upsert(&mut self, document: RawDocumentBuf, recorded: Option<&Bson>) -> Result<Bson, QueryError> {
        let mut document = Document::try_from(&document).map_err(invalid)?;
        if let (Some(Bson::ObjectId(_)), Some(theirs @ Bson::ObjectId(_))) = (document.get("_id"), recorded) {
            document.insert("_id", theirs.clone());
        }
        let id = document.get("_id").cloned().unwrap_or(Bson::Null);
        self.add(RawDocumentBuf::try_from(&document).map_err(invalid)?)?;
        Ok(id)
    }
}

pub(crate) fn invalid(error: impl std::fmt::Display) -> QueryError {
    QueryError { code: 2, operator: None, unsupported: false, message: error.to_string() }
}
