//! Finding a document and changing it in one step: what a queue of work or a counter needs.

use bson::{Bson, DateTime, Document, RawDocumentBuf, doc};

use super::{Memory, hidden_metadata};
use crate::query::{Filter, QueryError, Update};
use crate::store::{Find, Namespace, StoreError, Undone, UpdateRequest, UpdateSpec, as_step};

/// How often a document is looked for again after another client of a server changed it.
const ATTEMPTS: usize = 64;

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
        /// Insert what query and update describe where nothing matches.
        upsert: bool,
    },
}

/// The document that was found, with its metadata.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Modified {
    /// As it was; nothing where none matched.
    pub before: Option<RawDocumentBuf>,
    /// As it is now; nothing where it was removed, or where none matched and none was inserted.
    pub after: Option<RawDocumentBuf>,
}

impl Memory {
    /// Finds the first stored document that matches, and changes or removes it. No other client changes it in between.
    ///
    /// # Errors
    /// Where the query or the update is wrong, the store fails, or other clients change the document all the time.
    pub fn find_and_modify(
        &self,
        ns: &Namespace,
        filter: &Document,
        sort: &Document,
        modification: &Modification,
    ) -> Result<Modified, StoreError> {
        let asked = Asked { memory: self, ns, filter, sort, modification };
        let upserts = matches!(modification, Modification::Update { upsert: true, .. });
        let store = if upserts { self.routes.of(ns)? } else { self.routes.reading(ns)? };
        if store.is_atomic() {
            return match as_step(|work| store.atomically(work), || asked.once(true)) {
                Ok(modified) => Ok(modified.unwrap_or_default()),
                Err(Undone::Work(error) | Undone::Store(error)) => Err(error),
            };
        }
        for _ in 0..ATTEMPTS {
            if let Some(modified) = asked.once(false)? {
                return Ok(modified);
            }
        }
        let reason = format!("other clients changed the document {ATTEMPTS} times between finding and changing it");
        Err(StoreError::Failed { address: self.describe(), reason })
    }
}

/// What is asked for.
struct Asked<'a> {
    memory: &'a Memory,
    ns: &'a Namespace,
    filter: &'a Document,
    sort: &'a Document,
    modification: &'a Modification,
}

impl Asked<'_> {
    /// Finds and changes; nothing where another client changed the document in between, which only happens where this
    /// is not `alone`.
    fn once(&self, alone: bool) -> Result<Option<Modified>, StoreError> {
        let Some(before) = self.first(self.filter.clone())? else { return self.insert(alone) };
        let id = before.get("_id").map_err(QueryError::from)?.map(Bson::try_from).transpose();
        let id = id.map_err(QueryError::from)?.unwrap_or(Bson::Null);
        // The query is repeated, since it determines which element the positional `$` is.
        let mut these = vec![self.filter.clone(), same(&id)];
        if !alone {
            let known = Document::try_from(&*before).map_err(QueryError::from)?;
            these.push(doc! { "$expr": { "$eq": ["$$ROOT", { "$literal": known }] } });
        }
        let these = doc! { "$and": these };
        let (count, after) = match self.modification {
            Modification::Remove => (self.memory.delete(self.ns, &these, true)?, None),
            Modification::Update { update, array_filters, .. } => {
                let (update, array_filters) = (update.clone(), array_filters.clone());
                let request = UpdateRequest { filter: these, update, array_filters, ..UpdateRequest::default() };
                let matched = self.memory.update(self.ns, &request)?.matched;
                let predicted = if alone { None } else { self.predicted(&request, &before) };
                let after = match predicted {
                    Some(after) => Some(after),
                    None => self.first(same(&id))?,
                };
                (matched, after)
            }
        };
        Ok((count > 0).then_some(Modified { before: Some(before), after }))
    }

    /// What an update of a known document gives, where rmem knows that as well as the server.
    fn predicted(&self, request: &UpdateRequest, before: &RawDocumentBuf) -> Option<RawDocumentBuf> {
        let update = compiled(&request.update, &request.array_filters);
        let changed = update.ok()?.apply(before, &Filter::parse(self.filter).ok()?, DateTime::now()).ok()?;
        Some(changed.unwrap_or_else(|| before.clone()))
    }

    /// Inserts a document where none matches and one is asked for; nothing where another client has just inserted one.
    fn insert(&self, alone: bool) -> Result<Option<Modified>, StoreError> {
        let Modification::Update { update, array_filters, upsert } = self.modification else {
            return Ok(Some(Modified::default()));
        };
        if !upsert {
            // An update of nothing is checked, too.
            if alone {
                compiled(update, array_filters)?;
            }
            return Ok(Some(Modified::default()));
        }
        if !alone {
            // An upsert would change the document of another client, and not say how it was.
            let made = compiled(update, array_filters)?.upsert(self.filter, DateTime::now())?;
            let document = Document::try_from(&*made).map_err(QueryError::from)?;
            return match self.memory.insert(self.ns, vec![document]) {
                Ok(_) => Ok(Some(Modified { before: None, after: Some(made) })),
                Err(StoreError::Duplicate { .. }) if self.first(self.filter.clone())?.is_some() => Ok(None),
                Err(error) => Err(error),
            };
        }
        let request = UpdateRequest {
            filter: self.filter.clone(),
            update: update.clone(),
            array_filters: array_filters.clone(),
            upsert: true,
            ..UpdateRequest::default()
        };
        let upserted = self.memory.update(self.ns, &request)?.upserted;
        let after = upserted.map(|id| self.first(same(&id))).transpose()?.flatten();
        Ok(Some(Modified { before: None, after }))
    }

    fn first(&self, filter: Document) -> Result<Option<RawDocumentBuf>, StoreError> {
        let find = Find { filter, sort: self.sort.clone(), limit: 1, current: true, ..Find::default() };
        self.memory.stored(self.ns, &find)?.next().transpose()
    }
}

pub(super) fn compiled(update: &UpdateSpec, array_filters: &[Document]) -> Result<Update, QueryError> {
    match hidden_metadata::in_update(update) {
        UpdateSpec::Document(update) => Update::parse(&update, array_filters),
        UpdateSpec::Pipeline(stages) => Update::parse_pipeline(&stages),
    }
}

fn same(id: &Bson) -> Document {
    doc! { "_id": { "$eq": id } }
}
