//! Finding a document and changing it in one step: the operations of which it consists, in one transaction.

use bson::{Bson, DateTime, Document, RawDocumentBuf, doc};

use super::Embedded;
use crate::query::is_positional;
use crate::store::find_and_modify::{id, none_of, same};
use crate::store::{
    Find, FindAndModify, Modification, Modified, Namespace, Store as _, StoreError, Undone, UpdateRequest, UpdateSpec,
    Updated, as_step,
};

/// MongoDB's code for a name of a field that begins with `$`.
const DOLLAR_PREFIXED: i32 = 52;

impl Embedded {
    pub(super) fn modify_first(
        &self,
        ns: &Namespace,
        request: &FindAndModify,
        timestamp: Option<DateTime>,
    ) -> Result<Modified, StoreError> {
        let steps = Steps { store: self, ns, request, timestamp };
        let work = || match steps.run() {
            // Of several mistakes, that of the update is the first.
            Err(StoreError::Query(mistake)) => Err(steps.check(Document::new()).err().unwrap_or(mistake.into())),
            done => done,
        };
        as_step(|step| self.atomically(step), work).map_err(|undone| match undone {
            Undone::Work(error) | Undone::Store(error) => error,
        })
    }
}

/// The operations of which it consists.
struct Steps<'a> {
    store: &'a Embedded,
    ns: &'a Namespace,
    request: &'a FindAndModify,
    timestamp: Option<DateTime>,
}

impl Steps<'_> {
    fn run(&self) -> Result<Modified, StoreError> {
        self.request.check()?;
        let found = self.first(&self.request.find(doc! { "_id": 1 }))?;
        let id = found.map(|found| id(&found)).transpose()?;
        // The query is asked for no other document, also where its answer is not always the same (`$rand`); it is repeated only
        // where what it matched determines which element `$` is.
        let filter = match &id {
            Some(id) if self.is_positional() => doc! { "$and": [self.request.filter.clone(), exactly(id)] },
            Some(id) => exactly(id),
            None => self.request.filter.clone(),
        };
        // Where there is nothing to show, the projection is still checked.
        let before = match (self.request.new, &id) {
            (true, Some(_)) => None,
            (false, Some(_)) if !self.shows_what_matched() => self.shown(filter.clone())?,
            _ => self.first(&self.request.find(self.request.projection.clone()))?,
        };
        let Some(update) = self.request.update_of(filter) else { return self.remove(id, before) };
        if id.is_none() && !update.upsert {
            self.check(self.request.filter.clone())?;
            return Ok(Modified::default());
        }
        let Updated { modified, upserted, .. } = self.store.update(self.ns, &update, self.timestamp)?;
        let document = match (self.request.new, id.as_ref().or(upserted.as_ref())) {
            (true, Some(id)) => self.shown(exactly(id))?,
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

    /// Whether the update has a positional `$`.
    fn is_positional(&self) -> bool {
        let Modification::Update { update: UpdateSpec::Document(update), .. } = &self.request.modification else {
            return false;
        };
        let mut paths = update.values().filter_map(Bson::as_document).flat_map(Document::keys);
        paths.any(|path| path.split('.').any(|part| part == "$"))
    }

    /// Whether the projection shows what only the query can say: the element that matched, or the score.
    fn shows_what_matched(&self) -> bool {
        let projection = &self.request.projection;
        is_positional(projection) || projection.values().any(|value| value.as_document().is_some())
    }

    /// The document of a filter, as it is asked for.
    fn shown(&self, filter: Document) -> Result<Option<RawDocumentBuf>, StoreError> {
        let modifiers = self.request.modifiers.without_hint();
        let find = self.request.find(self.request.projection.clone());
        self.first(&Find { filter, sort: Document::new(), modifiers, ..find })
    }

    fn first(&self, find: &Find) -> Result<Option<RawDocumentBuf>, StoreError> {
        self.store.find(self.ns, find)?.next().transpose()
    }
}

/// A document's `_id`, also where strings compare by a collation: by a pattern, which compares bytes.
fn exactly(id: &Bson) -> Document {
    let Bson::String(text) = id else { return same(id) };
    let escape = |c: char| if c.is_ascii_punctuation() { format!("\\{c}") } else { c.to_string() };
    let escaped: String = text.chars().map(escape).collect();
    doc! { "_id": { "$regex": format!("^{escaped}\\z") } }
}
