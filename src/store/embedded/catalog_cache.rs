//! The collections that transactions looked up, remembered for the next ones.
//!
//! `PRAGMA data_version` changes with every commit of another connection, in this process or another one. As long as
//! it is the same, and this store has changed no collection itself, what was looked up is still so.

use std::cell::{Cell, RefCell};
use std::collections::HashMap;

use rusqlite::{Connection, Result};

use super::catalog::Collection;
use crate::store::Namespace;

/// How many are remembered: names that are asked for may be any number.
const MOST: usize = 1_000;

/// Collections by name, also those that do not exist.
#[derive(Debug, Default)]
pub(super) struct CatalogCache {
    /// The version of the file that they are of.
    version: Cell<Option<i64>>,
    /// Whether a transaction is open in which the version was read.
    is_open: Cell<bool>,
    /// How often this store began to write.
    writes: Cell<u64>,
    collections: RefCell<HashMap<Namespace, Option<Collection>>>,
}

impl CatalogCache {
    /// Forgets what is out of date. In a transaction that has begun, until [`CatalogCache::close`].
    pub(super) fn open(&self, connection: &Connection) -> Result<()> {
        let version = Some(version(connection)?);
        if self.version.replace(version) != version {
            self.collections.borrow_mut().clear();
        }
        self.is_open.set(true);
        Ok(())
    }

    /// Says that the transaction ends.
    pub(super) fn close(&self) {
        self.is_open.set(false);
    }

    /// Counts a write of this store. Before it.
    pub(super) fn count_write(&self) {
        self.writes.set(self.writes.get() + 1);
    }

    /// Numbers of which one is another after every write; nothing where no transaction is open.
    pub(super) fn state(&self) -> Option<(i64, u64)> {
        let version = self.version.get().filter(|_| self.is_open.get());
        version.map(|version| (version, self.writes.get()))
    }

    /// Forgets everything: this store has changed a collection, or took a change back.
    pub(super) fn forget(&self) {
        self.count_write();
        self.collections.borrow_mut().clear();
    }

    /// The collection of a name, created where there is none. In a write transaction only.
    pub(super) fn ensure(&self, connection: &Connection, ns: &Namespace) -> Result<Collection> {
        if let Some(known) = self.find(connection, ns)? {
            return Ok(known);
        }
        self.forget();
        Collection::ensure(connection, ns)
    }

    /// Notes that the indexes of a collection changed. In a write transaction only.
    pub(super) fn advance(&self, connection: &Connection, collection: Collection) -> Result<()> {
        self.forget();
        collection.advance(connection)
    }

    /// The collection of a name, where there is one.
    pub(super) fn find(&self, connection: &Connection, ns: &Namespace) -> Result<Option<Collection>> {
        if !self.is_open.get() {
            return Collection::find(connection, ns);
        }
        if let Some(known) = self.collections.borrow().get(ns) {
            return Ok(*known);
        }
        let found = Collection::find(connection, ns)?;
        let mut collections = self.collections.borrow_mut();
        if collections.len() >= MOST {
            collections.clear();
        }
        collections.insert(ns.clone(), found);
        Ok(found)
    }
}

/// A number that changes with what other connections write.
pub(super) fn version(connection: &Connection) -> Result<i64> {
    connection.prepare_cached("PRAGMA data_version")?.query_row([], |row| row.get(0))
}

#[cfg(test)]
mod tests {
    use crate::store::{Embedded, Find, Index, Namespace, Store as _};
    use bson::doc;

    #[test]
    fn what_others_do_to_collections_is_seen_by_the_next_query() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("robot.rmem");
        let (store, other) = (Embedded::open(&path).unwrap(), Embedded::open(&path).unwrap());
        let (ns, new) = (Namespace::parse("a.b").unwrap(), Namespace::parse("a.c").unwrap());
        let found = |ns: &Namespace, n: i32| {
            let find = Find { filter: doc! { "n": n }, ..Find::default() };
            let first = store.find(ns, &find).unwrap().count();
            assert_eq!(store.find(ns, &find).unwrap().count(), first, "asked again");
            first
        };
        assert_eq!(found(&ns, 1), 0, "there is none");
        other.insert(&ns, vec![doc! { "n": 1 }]).unwrap();
        assert_eq!(found(&ns, 1), 1, "another made it");
        other.create_index(&ns, &Index::on(doc! { "n": 1 })).unwrap();
        other.insert(&ns, vec![doc! { "n": [1, 2] }]).unwrap();
        assert_eq!((found(&ns, 1), found(&ns, 2)), (2, 1), "by the index of another");
        store.drop_index(&ns, "n_1").unwrap();
        assert_eq!(found(&ns, 1), 2, "without the index that it dropped itself");
        other.rename(&ns, &new, true).unwrap();
        assert_eq!((found(&ns, 1), found(&new, 1)), (0, 2));
        other.drop(&new).unwrap();
        other.insert(&new, vec![doc! { "n": 2 }]).unwrap();
        assert_eq!((found(&new, 1), found(&new, 2)), (0, 1), "another collection of that name");
        store.drop(&new).unwrap();
        assert_eq!(found(&new, 2), 0);
        let failed = store.atomically(&mut || {
            store.insert(&new, vec![doc! { "n": 3 }])?;
            assert_eq!(found(&new, 3), 1, "in its own transaction");
            Err(store.fail("taken back"))
        });
        assert!(failed.is_err());
        assert_eq!(found(&new, 3), 0);
        let made = Namespace::parse("a.d").unwrap();
        let written = store.atomically(&mut || {
            let failed = store.atomically(&mut || {
                store.insert(&made, vec![doc! { "n": 4 }])?;
                Err(store.fail("taken back alone"))
            });
            assert!(failed.is_err() && found(&made, 4) == 0, "a step that was taken back made no collection");
            store.insert(&made, vec![doc! { "n": 5 }])?;
            store.create_index(&made, &Index::on(doc! { "n": 1 }))?;
            store.insert(&made, vec![doc! { "n": [5, 6] }])?;
            assert_eq!((found(&made, 5), found(&made, 6)), (2, 1), "by the index of the transaction");
            store.rename(&made, &ns, true)?;
            assert_eq!((found(&made, 5), found(&ns, 5)), (0, 2));
            store.insert(&made, vec![doc! { "n": 6 }]).map(drop)
        });
        assert!(written.is_ok());
        assert_eq!((found(&made, 6), found(&ns, 6)), (1, 1));
    }

    #[test]
    fn the_state_is_another_after_every_write() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("robot.rmem");
        let (store, other) = (Embedded::open(&path).unwrap(), Embedded::open(&path).unwrap());
        let ns = Namespace::parse("a.b").unwrap();
        let state = || {
            let mut state = None;
            let chosen = store.find_chosen(&ns, &mut |_| {
                state = store.state();
                Ok(None)
            });
            assert!(chosen.unwrap().is_none() && state.is_some() && store.state().is_none());
            state
        };
        let mut seen = vec![state()];
        assert_eq!(state(), seen[0], "nothing was written");
        for writer in [&store, &other, &store] {
            writer.insert(&ns, vec![doc! {}]).unwrap();
            seen.push(state());
        }
        let within = store.atomically(&mut || {
            seen.push(store.state());
            store.insert(&ns, vec![doc! {}])?;
            seen.push(store.state());
            Ok(())
        });
        assert!(within.is_ok());
        seen.push(state());
        seen.dedup();
        assert!(seen.len() >= 6 && seen.is_sorted(), "{seen:?}");
    }
}
