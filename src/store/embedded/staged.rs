//! `$out`: a collection is filled beside the one that it replaces, in slices that let other processes write in between, and
//! takes its place in one step, as on MongoDB.

use std::cell::Cell;

use bson::{Document, RawDocument};

use super::Embedded;
use super::catalog::Collection;
use super::output::Results;
use super::place::Place;
use super::slices::Slice;
use crate::query::QueryError;
use crate::store::staging::{OUT, is_litter, name};
use crate::store::{Index, Namespace, StoreError, Validation, document, index};

/// MongoDB's code where the indexes of the target are others at the end than at the beginning.
const INDEXES_CHANGED: i32 = 28_769;

/// The indexes of a collection, and which documents it takes.
type Definition = (Vec<Index>, Option<Validation>);

impl Embedded {
    /// Replaces the documents of a collection, which keeps its indexes and its validator.
    pub(super) fn replace_collection(&self, ns: &Namespace, results: Results<'_>) -> Result<(), StoreError> {
        if self.place == Place::Memory || !self.connection.is_autocommit() {
            return self.write(|| self.replace_in_place(ns, results));
        }
        self.sweep_staged(&ns.database)?;
        let staged = name(OUT, ns);
        let replaced = self.stage(ns, &staged, results).and_then(|definition| self.swap(&staged, ns, &definition));
        if replaced.is_err() {
            // The error that is returned says also why it could not be removed.
            let _ = self.unstage(&staged);
        }
        replaced.map_err(|error| error.renamed(ns))
    }

    /// Replaces the documents within one transaction.
    fn replace_in_place(&self, ns: &Namespace, results: Results<'_>) -> Result<(), StoreError> {
        let collection = self.ensure(ns)?;
        self.note_drop(ns, collection, None)?;
        self.clear(collection)?;
        for result in results {
            self.add_result(ns, collection, &result?)?;
        }
        Ok(())
    }

    fn add_result(&self, ns: &Namespace, collection: Collection, result: &RawDocument) -> Result<(), StoreError> {
        let (id, body) = document::settle(Document::try_from(result).map_err(QueryError::from)?)?;
        self.add(ns, collection, &id, &body)
    }

    /// Fills a collection that is like another one; returns the definition of both.
    fn stage(&self, ns: &Namespace, staged: &Namespace, results: Results<'_>) -> Result<Definition, StoreError> {
        let (indexes, validation) = self.definition(ns)?;
        self.create_collection(staged, index::collation(&indexes).as_ref())?;
        for index in indexes.iter().filter(|index| index.name != index::ID) {
            self.create(staged, index)?;
        }
        if let Some(validation) = &validation {
            self.change_validation(staged, validation)?;
        }
        // What is staged is no change: where it fails, it is removed.
        self.in_slices(&Cell::new(0), &mut |limit| {
            let collection = self.ensure(staged)?;
            for result in &mut *results {
                self.add_result(staged, collection, &result?)?;
                if limit.is_over() {
                    return Ok(Slice::More);
                }
            }
            Ok(Slice::Last)
        })?;
        Ok((indexes, validation))
    }

    fn definition(&self, ns: &Namespace) -> Result<Definition, StoreError> {
        Ok((self.list_indexes(ns)?, self.validation_of(ns)?))
    }

    /// Gives a staged collection the name that it is for.
    fn swap(&self, staged: &Namespace, ns: &Namespace, definition: &Definition) -> Result<(), StoreError> {
        self.write(|| {
            if self.definition(ns)? != *definition {
                let message =
                    format!("the indexes or the validator of {ns} were changed while $out was written; repeat it");
                return Err(QueryError::invalid(INDEXES_CHANGED, message).into());
            }
            self.take_name(staged, ns, None)
        })
    }

    /// Removes a staged collection, of which no stream hears.
    fn unstage(&self, staged: &Namespace) -> Result<(), StoreError> {
        self.write(|| self.collection(staged)?.map_or(Ok(()), |collection| self.erase_collection(collection)))
    }

    /// Removes what processes that were killed have staged in a database.
    fn sweep_staged(&self, database: &str) -> Result<(), StoreError> {
        let all = Collection::all(&self.connection).map_err(|e| self.explain(&e))?;
        for ns in all.iter().filter(|ns| ns.database == database && is_litter(OUT, &ns.collection)) {
            self.unstage(ns)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

    use bson::doc;

    use super::*;
    use crate::store::{Aggregation, Modifiers, Query, Store as _};

    fn out(store: &Embedded, stages: &[Document]) -> Result<(), StoreError> {
        let aggregation = Aggregation { stages, modifiers: Modifiers::none() };
        store.aggregate(&Namespace::parse("a.from").unwrap(), aggregation).map(drop)
    }

    fn count(store: &Embedded, ns: &Namespace) -> u64 {
        store.count(ns, Query::from(&Document::new())).unwrap()
    }

    #[test]
    fn others_write_while_a_collection_is_replaced_and_see_the_old_one_until_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("robot.rmem");
        let [from, to, other] = ["a.from", "a.to", "a.other"].map(|name| Namespace::parse(name).unwrap());
        let store = Embedded::open(&path).unwrap();
        store.insert(&from, (0..30_000).map(|n| doc! { "_id": n }).collect()).unwrap();
        store.insert(&to, vec![doc! { "_id": "old" }]).unwrap();
        store.create_index(&to, &Index::parse(&doc! { "key": { "n": 1 }, "name": "n_1" }).unwrap()).unwrap();
        let (done, between) = (AtomicBool::new(false), AtomicU64::new(0));
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let store = Embedded::open(&path).unwrap();
                while !done.load(Ordering::SeqCst) {
                    store.insert(&other, vec![doc! {}]).unwrap();
                    let seen = count(&store, &to);
                    assert!(seen == 1 || seen == 30_000, "{seen}");
                    between.fetch_add(u64::from(seen == 1), Ordering::SeqCst);
                }
            });
            while between.load(Ordering::SeqCst) == 0 {
                std::thread::yield_now();
            }
            let before = between.load(Ordering::SeqCst);
            out(&store, &[doc! { "$out": "to" }]).unwrap();
            done.store(true, Ordering::SeqCst);
            // It takes several slices in a build without optimisation, too.
            assert!(between.load(Ordering::SeqCst) > before + 1);
        });
        assert_eq!(count(&store, &to), 30_000);
        let names: Vec<String> = store.indexes(&to).unwrap().into_iter().map(|index| index.name).collect();
        assert_eq!(names, ["_id_", "n_1"]);
        assert_eq!(store.collections().unwrap(), [from, other, to]);
    }

    #[test]
    fn what_fails_leaves_the_collection_and_nothing_beside_it() {
        let folder = tempfile::tempdir().unwrap();
        let store = Embedded::open(folder.path().join("robot.rmem")).unwrap();
        let [from, to] = ["a.from", "a.to"].map(|name| Namespace::parse(name).unwrap());
        store.insert(&from, (0..10).map(|n| doc! { "_id": n, "n": n % 7 }).collect()).unwrap();
        store.insert(&to, vec![doc! { "_id": "old", "n": 1 }]).unwrap();
        let unique = doc! { "key": { "n": 1 }, "name": "n_1", "unique": true };
        store.create_index(&to, &Index::parse(&unique).unwrap()).unwrap();
        let error = out(&store, &[doc! { "$out": "to" }]).unwrap_err();
        assert!(matches!(&error, StoreError::Duplicate { namespace, .. } if *namespace == to), "{error:?}");
        assert_eq!((count(&store, &to), store.collections().unwrap()), (1, vec![from, to]));
    }

    #[test]
    fn what_a_killed_process_has_staged_is_removed_by_the_next() {
        let folder = tempfile::tempdir().unwrap();
        let store = Embedded::open(folder.path().join("robot.rmem")).unwrap();
        let [from, to] = ["a.from", "a.to"].map(|name| Namespace::parse(name).unwrap());
        let mine = name(OUT, &to);
        let (rest, id) = mine.collection.rsplit_once('_').unwrap();
        let (process, _) = rest.rsplit_once('_').unwrap();
        let left = Namespace { database: "a".to_owned(), collection: format!("{process}_1_{id}") };
        for ns in [&from, &mine, &left] {
            store.insert(ns, vec![doc! {}]).unwrap();
        }
        out(&store, &[doc! { "$out": "to" }]).unwrap();
        assert_eq!(store.collections().unwrap(), [from, mine, to]);
    }
}
