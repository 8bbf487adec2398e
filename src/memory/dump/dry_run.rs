//! Whether a restore would violate a unique index or a validator, found out in a temporary store.
//!
//! The documents of a collection that has, or gets, unique indexes, or keeps a validator, are put into a
//! store of their own, in the order in which a restore would do it.

use std::path::Path;

use super::batch::{batches, undated};
use super::error::{RestoreError, unchanged};
use super::read::{Dump, Part};
use crate::memory::Memory;
use crate::process::stale_files;
use crate::query::{Collation, QueryError};
use crate::store::{Documents, Embedded, Find, Index, Namespace, Store as _, StoreError, Validation, index};

/// How many documents are copied at once.
const BATCH: usize = 1_000;

/// Checks the unique keys of a dump, and whether its documents pass the validator that stays, beside what is there or, with
/// `drop`, instead of it.
///
/// # Errors
/// The one that a restore would fail with; where the dump cannot be read, or a store fails.
pub(super) fn check_keys(memory: &Memory, dump: &Dump, drop: bool, temporary: &Path) -> Result<(), RestoreError> {
    for part in &dump.parts {
        let failed = |source| unchanged(&part.namespace, source);
        let present = unique(memory.indexes(&part.namespace).map_err(failed)?);
        let dump = part.indexes.clone().map(unique);
        let (before, after) = match (drop, dump) {
            (true, dump) => (Vec::new(), dump.unwrap_or(present)),
            (false, dump) => (present, dump.unwrap_or_default()),
        };
        let collation = match &part.collation {
            Some(collation) if drop => collation.clone(),
            _ => memory.collation(&part.namespace).map_err(failed)?.or_else(|| part.collation.clone().flatten()),
        };
        let validation = match &part.validation {
            Some(_) if drop => None,
            _ => memory.validation(&part.namespace).map_err(failed)?,
        };
        // By a collation, two documents of the dump may have the same `_id`.
        if !before.is_empty() || !after.is_empty() || collation.is_some() || validation.is_some() {
            let plan = RestorePlan { part, collation, validation, present: (!drop).then_some(memory), before, after };
            TrialStore::new(&part.namespace, temporary)?.run(&plan)?;
        }
    }
    Ok(())
}

/// Notes on the indexes of a collection that the store would refuse.
///
/// # Errors
/// Where an index is none.
pub(super) fn refused(memory: &Memory, part: &Part) -> Result<Vec<String>, RestoreError> {
    let mut notes = Vec::new();
    for index in part.indexes.iter().flatten() {
        match memory.check_index(&part.namespace, index) {
            Err(StoreError::Query(error)) if error.unsupported => notes.push(without(index, &error)),
            checked => checked.map_err(|source| unchanged(&part.namespace, source))?,
        }
    }
    Ok(notes)
}

/// The note on an index that the store cannot have.
pub(super) fn without(index: &Index, error: &QueryError) -> String {
    format!("the index {} is not restored: {}", index.name, error.message)
}

fn unique(indexes: Vec<Index>) -> Vec<Index> {
    indexes.into_iter().filter(|index| index.unique && index.name != index::ID).collect()
}

/// A restore that is tried out.
struct RestorePlan<'a> {
    /// What would be restored.
    part: &'a Part,
    /// How strings compare in the collection.
    collation: Option<Collation>,
    /// Which documents the collection takes, where it goes on doing so.
    validation: Option<Validation>,
    /// Where the documents are that it joins, if any.
    present: Option<&'a Memory>,
    /// The unique indexes that are there already.
    before: Vec<Index>,
    /// Those that come with it.
    after: Vec<Index>,
}

/// A store for one collection, in a folder that is removed with it.
struct TrialStore<'a> {
    store: Embedded,
    namespace: &'a Namespace,
    _folder: tempfile::TempDir,
}

impl<'a> TrialStore<'a> {
    fn new(namespace: &'a Namespace, temporary: &Path) -> Result<Self, RestoreError> {
        let failed = |error: std::io::Error| {
            let (address, reason) = (temporary.display().to_string(), format!("cannot make a folder: {error}"));
            unchanged(namespace, StoreError::Failed { address, reason })
        };
        let folder = tempfile::Builder::new()
            .prefix(&stale_files::prefix(temporary, ".rmem-"))
            .tempdir_in(temporary)
            .map_err(failed)?;
        let store = Embedded::open(folder.path().join("trial.rmem")).map_err(|source| unchanged(namespace, source))?;
        Ok(Self { store, namespace, _folder: folder })
    }

    /// Stores everything in one transaction, which is rolled back.
    fn run(&self, plan: &RestorePlan<'_>) -> Result<(), RestoreError> {
        let mut outcome = None;
        let kept = self.store.atomically(&mut || {
            outcome = Some(self.fill(plan));
            Err(StoreError::Failed { address: self.store.describe(), reason: "nothing is kept".to_owned() })
        });
        // Where the work did not begin, the error is the store's.
        outcome.unwrap_or_else(|| kept.map_err(|error| unchanged(self.namespace, error)))
    }

    fn fill(&self, plan: &RestorePlan<'_>) -> Result<(), RestoreError> {
        let failed = |source| unchanged(self.namespace, source);
        self.store.create(self.namespace, plan.collation.as_ref()).map_err(failed)?;
        self.index(&plan.before)?;
        if let Some(memory) = plan.present {
            let mut stored = memory.stored(self.namespace, &Find::default()).map_err(failed)?;
            while let Some(batch) = some(&mut stored).map_err(failed)? {
                self.store.put(self.namespace, batch, None).map_err(failed)?;
            }
        }
        // Behind what is there, which stays whether or not it passes.
        if let Some(validation) = &plan.validation {
            self.store.set_validation(self.namespace, validation).map_err(failed)?;
        }
        for batch in batches(plan.part.documents()?) {
            let batch = undated(batch?);
            let stored = match plan.present {
                Some(_) => self.store.put(self.namespace, batch, None).map(drop),
                None => self.store.insert(self.namespace, batch).map(drop),
            };
            stored.map_err(failed)?;
        }
        self.index(&plan.after)
    }

    fn index(&self, indexes: &[Index]) -> Result<(), RestoreError> {
        let make = |index: Index| self.store.create_index(self.namespace, &index.standing_alone()).map(drop);
        indexes.iter().cloned().try_for_each(make).map_err(|source| unchanged(self.namespace, source))
    }
}

/// The next documents, where there are any.
fn some(documents: &mut Documents<'_>) -> Result<Option<Vec<bson::Document>>, StoreError> {
    let decode = |document: Result<bson::RawDocumentBuf, StoreError>| {
        Ok(bson::Document::try_from(&*document?).map_err(crate::query::QueryError::from)?)
    };
    let batch = documents.take(BATCH).map(decode).collect::<Result<Vec<_>, StoreError>>()?;
    Ok(Some(batch).filter(|batch| !batch.is_empty()))
}
