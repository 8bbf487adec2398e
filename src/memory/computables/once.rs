//! Documents that were computed for one query alone.
//!
//! Where the store could not tell the difference, they stay in memory, and are answered together with the stored ones
//! ([`together`](super::together)). An answer that the store alone makes (a pipeline, distances, a search) has them stored
//! first, and removed afterwards.

use std::collections::HashSet;
use std::sync::Arc;

use bson::oid::ObjectId;
use bson::{Bson, Document, RawDocumentBuf, doc};

use super::alone::{Once, Storage};
use super::cache::{self, Lifetime};
use super::state::Wanted;
use super::storing::{self, BATCH};
use super::together;
use super::view::View;
use crate::memory::Memory;
use crate::query::{QueryError, field, key};
use crate::store::{Documents, Find, Namespace, Query, Store, StoreError, document, metadata};

impl Memory {
    /// Keeps what a body gave until the query is answered; returns how many documents.
    pub(super) fn keep_once(
        &self,
        wanted: &Wanted<'_>,
        documents: Vec<Document>,
        token: ObjectId,
        life: Lifetime,
    ) -> Result<u64, StoreError> {
        let definition = &wanted.computable.definition;
        let store = self.routes.reading(&definition.namespace)?;
        let ids: Vec<Bson> = documents.iter().filter_map(|document| document.get("_id").cloned()).collect();
        let documents = storing::marked(definition, documents, token, life, self.clock.now())?;
        let count = documents.len() as u64;
        let place = match self.settled(store, &definition.namespace, &ids, &documents)? {
            Some(settled) => Storage::Memory(settled),
            None => {
                // With the others in the store, an `_id` that is taken is found there.
                self.store_once()?;
                let (mut documents, mut ids) = (Some(documents), Vec::new());
                cache::write(store, || {
                    ids = storing::insert(store, definition, documents.take().unwrap_or_default(), token)?;
                    Ok(())
                })?;
                Storage::Store(ids)
            }
        };
        let once = Once { token, computable: Arc::clone(&wanted.computable), documents: place };
        self.computables.once.borrow_mut().push(once);
        Ok(count)
    }

    /// The documents as they would be stored, where the store could not tell that they are not.
    fn settled(
        &self,
        store: &dyn Store,
        ns: &Namespace,
        ids: &[Bson],
        documents: &[Document],
    ) -> Result<Option<Vec<RawDocumentBuf>>, StoreError> {
        if documents.is_empty() {
            return Ok(Some(Vec::new()));
        }
        if ids.len() > BATCH || !store.takes_any(ns)? || self.has_one_of(store, ns, ids)? {
            return Ok(None);
        }
        let settled = |document: &Document| document::settle(document.clone()).map(|(_, body)| body);
        // What may not be stored is for the store to complain about.
        Ok(documents.iter().map(settled).collect::<Result<_, QueryError>>().ok())
    }

    /// Whether a document of the collection has one of the `_id`s.
    fn has_one_of(&self, store: &dyn Store, ns: &Namespace, ids: &[Bson]) -> Result<bool, StoreError> {
        if ids.is_empty() {
            return Ok(false);
        }
        let once = self.computables.once.borrow();
        let others = once.iter().filter(|once| once.namespace() == ns).flat_map(Once::in_memory);
        let mut others = others.filter_map(|document| field(document, "_id").map(key::encode)).peekable();
        if others.peek().is_some() {
            let ids: HashSet<Vec<u8>> = ids.iter().map(key::encode_value).collect();
            if others.any(|id| ids.contains(&id)) {
                return Ok(true);
            }
        }
        let mut taken = metadata::visible(self.clock.now());
        taken.insert("_id", doc! { "$in": ids });
        let find = Find { filter: taken, limit: 1, projection: doc! { "_id": 1 }, ..Find::default() };
        Ok(store.find(ns, &find)?.next().transpose()?.is_some())
    }

    /// Stores what is in memory, for an answer that the store alone makes.
    pub(super) fn store_once(&self) -> Result<(), StoreError> {
        for once in self.computables.once.borrow_mut().iter_mut() {
            let Storage::Memory(documents) = &mut once.documents else { continue };
            let documents = std::mem::take(documents);
            once.documents = Storage::Store(Vec::new());
            let documents = documents.iter().map(|raw| Document::try_from(&**raw)).collect::<Result<Vec<_>, _>>();
            let (mut documents, mut ids) = (Some(documents.map_err(QueryError::from)?), Vec::new());
            let definition = &once.computable.definition;
            let store = self.routes.reading(&definition.namespace)?;
            cache::write(store, || {
                ids = storing::insert(store, definition, documents.take().unwrap_or_default(), once.token)?;
                Ok(())
            })?;
            once.documents = Storage::Store(ids);
        }
        Ok(())
    }

    /// Removes what was computed for one query.
    pub(super) fn forget_once(&self, token: ObjectId) -> Result<(), StoreError> {
        let mut all = self.computables.once.borrow_mut();
        let Some(at) = all.iter().position(|once| once.token == token) else { return Ok(()) };
        let once = all.swap_remove(at);
        let Storage::Store(ids) = &once.documents else { return Ok(()) };
        let store = self.routes.reading(once.namespace())?;
        cache::write(store, || storing::remove(store, once.namespace(), ids, token))
    }

    /// Whether documents are in memory that an operation may see.
    pub(in crate::memory) fn has_once(&self) -> bool {
        self.computables.once.borrow().iter().any(|once| !once.in_memory().is_empty())
    }

    /// The documents of a collection that are in memory and seen.
    fn seen_once(&self, ns: &Namespace, view: &View) -> Vec<RawDocumentBuf> {
        let once = self.computables.once.borrow();
        let seen = once.iter().filter(|once| once.namespace() == ns && view.shows(once.token));
        seen.flat_map(Once::in_memory).cloned().collect()
    }

    /// Documents that are stored or in memory; `find` asks for those that are seen. See [`Store::find`].
    pub(in crate::memory) fn read(
        &self,
        ns: &Namespace,
        find: &Find,
        view: &View,
    ) -> Result<Documents<'_>, StoreError> {
        let store = self.routes.reading(ns)?;
        let others = self.seen_once(ns, view);
        if others.is_empty() {
            return store.find(ns, find);
        }
        if let Some(found) = together::find(store, ns, find, others)? {
            return Ok(found);
        }
        self.store_once()?;
        store.find(ns, find)
    }

    /// Counts those of [`Memory::read`].
    pub(in crate::memory) fn tally(&self, ns: &Namespace, query: Query<'_>, view: &View) -> Result<u64, StoreError> {
        let store = self.routes.reading(ns)?;
        let others = self.seen_once(ns, view);
        if others.is_empty() {
            return store.count(ns, query);
        }
        if let Some(count) = together::count(store, ns, query, &others)? {
            return Ok(count);
        }
        self.store_once()?;
        store.count(ns, query)
    }
}
