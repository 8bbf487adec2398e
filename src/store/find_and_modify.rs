//! Finding a document and changing it in one step: what a queue of work or a counter needs.

use bson::{Bson, DateTime, Document, RawDocumentBuf, doc};

use super::modifiers::Modifiers;
use super::request::{Find, UpdateRequest, UpdateSpec, Updated};
use super::step::{Undone, as_step};
use super::{Namespace, Store, StoreError};
use crate::query::{QueryError, check_positional, check_upsert};

/// MongoDB's code for a name of a field that begins with `$`.
const DOLLAR_PREFIXED: i32 = 52;

/// What happens to the document that is found.
#[derive(Debug, Clone)]
pub enum Modification {
    /// It is removed.
    Remove,
    /// It is changed.
    Update {
        /// How.
        update: UpdateSpec,
        /// For `$[identifier]`.
        array_filters: Vec<Document>,
        /// Insert what filter and update describe where nothing matches.
        upsert: bool,
    },
}

/// Which document to find, what to do to it, and what of it to return.
#[derive(Debug, Clone)]
pub struct FindAndModify {
    /// MongoDB's filter; empty matches everything.
    pub filter: Document,
    /// Keys with 1 (ascending) or -1 (descending), which decide what the first match is.
    pub sort: Document,
    /// What happens to it.
    pub modification: Modification,
    /// Return the document as it is afterwards, not as it was.
    pub new: bool,
    /// MongoDB's projection of what is returned; empty keeps the document whole.
    pub projection: Document,
    /// Collation, variables, and the index to be read.
    pub modifiers: Modifiers,
}

/// What was done to the first match.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Modified {
    /// The document as it is asked for. None where none matched, or none was there before or is there afterwards.
    pub document: Option<RawDocumentBuf>,
    /// Whether a document matched.
    pub is_found: bool,
    /// Whether a document is different now, removed or inserted.
    pub is_changed: bool,
    /// The `_id` of the document that an upsert made.
    pub upserted: Option<Bson>,
}

impl FindAndModify {
    /// The update alone, of the documents that match another filter; none where documents are removed.
    pub(crate) fn update_of(&self, filter: Document) -> Option<UpdateRequest> {
        let Modification::Update { update, array_filters, upsert } = &self.modification else { return None };
        Some(UpdateRequest {
            filter,
            update: update.clone(),
            array_filters: array_filters.clone(),
            many: false,
            upsert: *upsert,
            modifiers: self.modifiers.without_hint(),
        })
    }

    /// The same for no document at all.
    pub(crate) fn of_nothing(&self) -> Self {
        let mut nothing = Self { filter: none_of(&self.filter), ..self.clone() };
        if let Modification::Update { upsert, .. } = &mut nothing.modification {
            *upsert = false;
        }
        nothing
    }

    /// Refuses what does not go together.
    pub(super) fn check(&self) -> Result<(), QueryError> {
        check_positional(&self.filter, &self.projection)?;
        let Modification::Update { upsert, .. } = self.modification else { return Ok(()) };
        if self.new && self.projection.keys().any(|path| path.ends_with(".$")) {
            let message = "the positional `$` of a projection is of the document as it was, not of the new one";
            return Err(QueryError::bad_value(message));
        }
        if upsert { check_upsert(&self.filter) } else { Ok(()) }
    }

    /// The query for the first match.
    pub(super) fn find(&self, projection: Document) -> Find {
        let (filter, sort, modifiers) = (self.filter.clone(), self.sort.clone(), self.modifiers.clone());
        Find { filter, sort, limit: 1, projection, modifiers, current: true, ..Find::default() }
    }
}

/// [`Store::find_and_modify`] by the store's other operations, as one step of it.
pub(super) fn in_one_step<S: Store + ?Sized>(
    store: &S,
    ns: &Namespace,
    request: &FindAndModify,
    timestamp: Option<DateTime>,
) -> Result<Modified, StoreError> {
    let steps = Steps { store, ns, request, timestamp };
    let work = || match steps.run() {
        // Of several mistakes, that of the update is the first.
        Err(StoreError::Query(mistake)) => Err(steps.check(Document::new()).err().unwrap_or(mistake.into())),
        done => done,
    };
    as_step(|step| store.atomically(step), work).map_err(|undone| match undone {
        Undone::Work(error) | Undone::Store(error) => error,
    })
}

/// The operations of which it consists.
struct Steps<'a, S: ?Sized> {
    store: &'a S,
    ns: &'a Namespace,
    request: &'a FindAndModify,
    timestamp: Option<DateTime>,
}

impl<S: Store + ?Sized> Steps<'_, S> {
    fn run(&self) -> Result<Modified, StoreError> {
        self.request.check()?;
        let found = self.first(&self.request.find(doc! { "_id": 1 }))?;
        let id = found.map(|found| id(&found)).transpose()?;
        // Where there is nothing to show, the projection is still checked.
        let before = match (self.request.new, &id) {
            (true, Some(_)) => None,
            _ => self.first(&self.request.find(self.request.projection.clone()))?,
        };
        // What the query matched determines which element `$` is.
        let filter = match &id {
            Some(id) => doc! { "$and": [self.request.filter.clone(), exactly(id)] },
            None => self.request.filter.clone(),
        };
        let Some(update) = self.request.update_of(filter) else { return self.remove(id, before) };
        if id.is_none() && !update.upsert {
            self.check(self.request.filter.clone())?;
            return Ok(Modified::default());
        }
        let Updated { modified, upserted, .. } = self.store.update(self.ns, &update, self.timestamp)?;
        let document = match (self.request.new, id.as_ref().or(upserted.as_ref())) {
            (true, Some(id)) => {
                let (filter, projection) = (same(id), self.request.projection.clone());
                self.first(&Find { filter, limit: 1, projection, current: true, ..Find::default() })?
            }
            _ => before,
        };
        Ok(Modified { document, is_found: id.is_some(), is_changed: modified > 0 || upserted.is_some(), upserted })
    }

    fn remove(&self, id: Option<Bson>, document: Option<RawDocumentBuf>) -> Result<Modified, StoreError> {
        let Some(id) = id else { return Ok(Modified::default()) };
        self.store.delete(self.ns, (&same(&id)).into(), true)?;
        Ok(Modified { document, is_found: true, is_changed: true, upserted: None })
    }

    /// Refuses an update that is wrong, also where there is nothing to update; names of fields are for the document itself.
    fn check(&self, filter: Document) -> Result<(), StoreError> {
        let Some(update) = self.request.update_of(none_of(&filter)) else { return Ok(()) };
        let nothing = UpdateRequest { upsert: false, ..update };
        match self.store.update(self.ns, &nothing, self.timestamp) {
            Err(StoreError::Query(error)) if error.code == DOLLAR_PREFIXED => Ok(()),
            done => done.map(|_| ()),
        }
    }

    fn first(&self, find: &Find) -> Result<Option<RawDocumentBuf>, StoreError> {
        self.store.find(self.ns, find)?.next().transpose()
    }
}

/// The `_id` of a document.
pub(super) fn id(document: &RawDocumentBuf) -> Result<Bson, QueryError> {
    let id = document.get("_id")?.map(Bson::try_from).transpose()?;
    Ok(id.unwrap_or(Bson::Null))
}

/// A filter that matches nothing and contains another, so that it is checked.
pub(super) fn none_of(filter: &Document) -> Document {
    doc! { "$and": [filter.clone(), { "_id": { "$in": [] } }] }
}

pub(super) fn same(id: &Bson) -> Document {
    doc! { "_id": { "$eq": id } }
}

/// A document's `_id`, also where strings compare by a collation: by a pattern, which compares bytes.
fn exactly(id: &Bson) -> Document {
    let Bson::String(text) = id else { return same(id) };
    let escape = |c: char| if c.is_ascii_punctuation() { format!("\\{c}") } else { c.to_string() };
    let escaped: String = text.chars().map(escape).collect();
    doc! { "_id": { "$regex": format!("^{escaped}\\z") } }
}
