//! Several operations as one: kept as a whole, or not at all.

use super::Memory;
use crate::store::{Namespace, Store, StoreError};

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
        let (mut work, mut outcome) = (Some(work), None);
        let kept = nest(&stores, &mut || {
            outcome = work.take().map(|work| work(whole));
            match &outcome {
                Some(Ok(_)) => Ok(()),
                // It only says that nothing is to be kept.
                _ => Err(StoreError::Failed { address: self.describe(), reason: "nothing was done".to_owned() }),
            }
        });
        match (kept, outcome) {
            (Ok(()), Some(done)) => done,
            (Err(_), Some(Err(error))) => Err(error),
            (Err(error), _) => Err(failed(error)),
            (Ok(()), None) => {
                Err(failed(StoreError::Failed { address: self.describe(), reason: "nothing was done".to_owned() }))
            }
        }
    }
}

fn nest(stores: &[&dyn Store], work: &mut dyn FnMut() -> Result<(), StoreError>) -> Result<(), StoreError> {
    match stores {
        [] => work(),
        [store, rest @ ..] => store.atomically(&mut || nest(rest, work)),
    }
}
