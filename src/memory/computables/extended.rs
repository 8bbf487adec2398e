//! Documents with the keys that computables add to them, and the answers to queries over them.
//!
//! What needs nothing but the documents themselves is answered over them as they are. For the rest (another
//! collection, an index that an operator needs) they are put into a store in memory.

use std::cell::OnceCell;

use bson::{DateTime, Document, RawDocumentBuf};

use crate::memory::Memory;
use crate::query::collation::during;
use crate::query::{Collation, Description, Pipeline, QueryError, constants};
use crate::store::parsed::Parsed;
use crate::store::{
    Aggregation, Documents, Embedded, Find, Index, Modifiers, Namespace, Query, Store as _, StoreError, Values, index,
};

/// Stages that read other documents than those that they get.
const READING: [&str; 5] = ["$facet", "$geoNear", "$graphLookup", "$lookup", "$unionWith"];

/// Documents of collections, with keys that are stored nowhere.
pub(in crate::memory) struct Extended<'m> {
    memory: &'m Memory,
    collections: Vec<(Namespace, Vec<RawDocumentBuf>)>,
    store: OnceCell<Embedded>,
}

impl<'m> Extended<'m> {
    pub(super) fn new(memory: &'m Memory, collections: Vec<(Namespace, Vec<RawDocumentBuf>)>) -> Self {
        Self { memory, collections, store: OnceCell::new() }
    }

    /// The documents that match; see [`crate::store::Store::find`].
    pub(in crate::memory) fn find(&self, ns: &Namespace, find: &Find) -> Result<Vec<RawDocumentBuf>, StoreError> {
        let found = during(self.collation(ns, &find.modifiers)?.as_ref(), || self.found(ns, find))?;
        found.map_or_else(|| self.store()?.find(ns, find)?.collect(), Ok)
    }

    /// How many documents match; see [`crate::store::Store::count`].
    pub(in crate::memory) fn count(&self, ns: &Namespace, query: Query<'_>) -> Result<u64, StoreError> {
        let find = Find { filter: query.filter.clone(), modifiers: query.modifiers.clone(), ..Find::default() };
        let found = during(self.collation(ns, query.modifiers)?.as_ref(), || self.found(ns, &find))?;
        found.map_or_else(|| self.store()?.count(ns, query), |found| Ok(found.len() as u64))
    }

    /// The distinct values of a field; see [`crate::store::Store::values`].
    pub(in crate::memory) fn values(
        &self,
        ns: &Namespace,
        field: &str,
        query: Query<'_>,
    ) -> Result<Values, StoreError> {
        self.store()?.values(ns, field, query)
    }

    /// The results of a pipeline that writes nothing; see [`crate::store::Store::aggregate`].
    pub(in crate::memory) fn aggregate(
        &self,
        ns: &Namespace,
        pipeline: Aggregation<'_>,
    ) -> Result<Vec<RawDocumentBuf>, StoreError> {
        let collation = self.collation(ns, pipeline.modifiers)?;
        let modifiers = Modifiers { collation, ..pipeline.modifiers.clone() };
        let results = run(Aggregation { modifiers: &modifiers, ..pipeline }, self.documents(ns))?;
        results.map_or_else(|| self.store()?.aggregate(ns, pipeline)?.collect(), Ok)
    }

    /// How strings compare in an operation: as it says itself, else as in its collection.
    fn collation(&self, ns: &Namespace, modifiers: &Modifiers) -> Result<Option<Collation>, StoreError> {
        match &modifiers.collation {
            Some(own) => Ok(Some(own.clone())),
            None => Ok(index::collation(&self.memory.routes.reading(ns)?.indexes(ns)?)),
        }
    }

    fn documents(&self, ns: &Namespace) -> &[RawDocumentBuf] {
        let collection = self.collections.iter().find(|(own, _)| own == ns);
        collection.map(|(_, documents)| documents.as_slice()).unwrap_or_default()
    }

    /// The documents that match, where that needs no index.
    fn found(&self, ns: &Namespace, find: &Find) -> Result<Option<Vec<RawDocumentBuf>>, StoreError> {
        let parsed = Parsed::of(find)?;
        if find.modifiers.hint.is_some() || parsed.filter.near().is_some() || parsed.filter.search().is_some() {
            return Ok(None);
        }
        let filter = parsed.filter.clone();
        let matches = self.documents(ns).iter().filter_map(move |document| match filter.matches(document) {
            Ok(is_match) => is_match.then(|| Ok(document.clone())),
            Err(error) => Some(Err(error.into())),
        });
        let is_sorted = find.sort.is_empty();
        parsed.answer(Box::new(matches), is_sorted)?.collect::<Result<_, _>>().map(Some)
    }

    /// The documents in a store.
    pub(in crate::memory) fn store(&self) -> Result<&Embedded, StoreError> {
        if let Some(store) = self.store.get() {
            return Ok(store);
        }
        let store = Embedded::in_memory()?;
        for (ns, documents) in &self.collections {
            let indexes = self.memory.routes.reading(ns)?.indexes(ns)?;
            if let Some(collation) = index::collation(&indexes) {
                store.create(ns, Some(&collation))?;
            }
            for index in indexes.into_iter().filter(|index| index.name != index::ID) {
                // Some operators need their index. One that cannot be made here is missed by its operator.
                let index = Index { unique: false, expire_after: None, ..index.standing_alone() };
                drop(store.create_index(ns, &index));
            }
            let documents: Result<Vec<Document>, _> = documents.iter().map(|raw| Document::try_from(&**raw)).collect();
            store.put(ns, documents.map_err(QueryError::from)?, None)?;
        }
        Ok(self.store.get_or_init(|| store))
    }
}

/// The results of a pipeline over documents; none where it needs more than them.
pub(super) fn run(
    Aggregation { stages, modifiers }: Aggregation<'_>,
    documents: &[RawDocumentBuf],
) -> Result<Option<Vec<RawDocumentBuf>>, StoreError> {
    let is_described = || Ok::<_, QueryError>(stages.first().map(Description::parse).transpose()?.flatten().is_some());
    if reads_others(stages) || modifiers.hint.is_some() || is_described()? {
        return Ok(None);
    }
    during(modifiers.collation.as_ref(), || {
        let pipeline = Pipeline::parse_with(stages, &constants(&modifiers.variables)?)?;
        if pipeline.is_scored() || !pipeline.searches().is_empty() || pipeline.output().is_some() {
            return Ok(None);
        }
        let input: Documents<'_> = match pipeline.brings_documents() {
            true => Box::new(std::iter::empty()),
            false => Box::new(documents.iter().cloned().map(Ok)),
        };
        let results = pipeline.run(input, DateTime::now(), &|_, _| Ok(None));
        results.collect::<Result<_, _>>().map(Some)
    })
}

/// Whether a stage reads other documents than those that it gets.
fn reads_others(stages: &[Document]) -> bool {
    stages.iter().flat_map(Document::keys).any(|name| READING.contains(&name.as_str()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::{doc, rawdoc};

    #[test]
    fn answers_over_documents_are_those_of_a_store() {
        let memory = Memory::new(Box::new(Embedded::in_memory().unwrap()), None, Vec::new());
        let ns = Namespace::parse("a.b").unwrap();
        let documents = (0..40).map(|n| rawdoc! { "_id": n, "n": n * 7 % 10, "s": [n % 3, "x"], "t": { "u": n % 4 } });
        let extended = Extended::new(&memory, vec![(ns.clone(), documents.collect())]);
        let store = extended.store().unwrap();
        for (filter, sort, projection) in [
            (doc! {}, doc! {}, doc! {}),
            (doc! { "n": { "$gt": 3 } }, doc! { "n": -1, "_id": 1 }, doc! { "n": 1 }),
            (doc! { "s": 1, "$expr": { "$gt": ["$n", "$t.u"] } }, doc! { "t.u": 1 }, doc! { "_id": 0, "t": 0 }),
            (doc! { "s": { "$elemMatch": { "$gte": 2 } } }, doc! {}, doc! { "s.$": 1 }),
        ] {
            let find = Find { filter: filter.clone(), sort, projection, skip: 1, limit: 7, ..Find::default() };
            let wanted: Vec<_> = store.find(&ns, &find).unwrap().map(Result::unwrap).collect();
            assert!(!wanted.is_empty(), "{find:?}");
            assert_eq!(extended.found(&ns, &find).unwrap(), Some(wanted), "{find:?}");
            let query = Query { filter: &filter, modifiers: Modifiers::none() };
            assert_eq!(extended.count(&ns, query).unwrap(), store.count(&ns, query).unwrap(), "{filter}");
        }
        for (stages, is_plain) in [
            (vec![doc! { "$match": { "n": 3 } }, doc! { "$set": { "m": "$t.u" } }], true),
            (vec![doc! { "$group": { "_id": "$n", "c": { "$sum": 1 } } }, doc! { "$sort": { "_id": 1 } }], true),
            (vec![doc! { "$lookup": { "from": "b", "localField": "n", "foreignField": "_id", "as": "o" } }], false),
        ] {
            let wanted: Vec<_> = store.aggregate(&ns, (&stages).into()).unwrap().map(Result::unwrap).collect();
            assert_eq!(extended.aggregate(&ns, (&stages).into()).unwrap(), wanted, "{stages:?}");
            assert_eq!(run((&stages).into(), extended.documents(&ns)).unwrap().is_some(), is_plain, "{stages:?}");
        }
        let wrong = Find { filter: doc! { "$nothing": 1 }, ..Find::default() };
        assert!(extended.find(&ns, &wrong).is_err());
    }
}
