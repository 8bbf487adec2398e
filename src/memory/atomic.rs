//! Several operations as one: kept as a whole, or not at all.

use super::Memory;
use crate::store::{Namespace, Step, Store, StoreError, Undone, as_step};

impl Memory {
    /// Runs operations on some collections as one, as far as their stores can; `work` gets
    /// whether all of them are atomic. Where it is, a failure undoes everything.
    ///
    /// # Errors
    /// What `work` fails with; what a store fails with at the end goes through `failed`.
    pub fn atomically<T, E>(
        &self,
        namespaces: &[&Namespace],
        failed: impl Fn(StoreError) -> E,
        work: impl FnOnce(bool) -> Result<T, E>,
    ) -> Result<T, E> {
        let mut stores: Vec<&dyn Store> = Vec::new();
        for ns in namespaces {
            let store = self.routes.of(ns).map_err(&failed)?;
            if !stores.iter().any(|known| std::ptr::addr_eq(*known, store)) {
                stores.push(store);
            }
        }
        let whole = stores.iter().all(|store| store.is_atomic());
        as_step(|work| nest(&stores, work), || work(whole)).map_err(|undone| match undone {
            Undone::Work(error) => error,
            Undone::Store(error) => failed(error),
        })
    }
}

fn nest(stores: &[&dyn Store], work: Step<'_>) -> Result<(), StoreError> {
    match stores {
        [] => work(),
        [store, rest @ ..] => store.atomically(&mut || nest(rest, work)),
    }
}
