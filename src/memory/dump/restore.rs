//! Restoring a dump: everything is verified before anything is changed.
//!
//! Without `drop`, documents are put into their collections: new ones are
//! added, those whose `_id` is taken replace what is there, equal ones are
//! skipped, and documents that are only in the memory stay. With it, each collection
//! is staged beside the one it replaces, in its database, and all are swapped
//! once everything is stored. Many documents of collections that a file does not have yet are staged, too, so that
//! other processes can write meanwhile.
//!
//! On an embedded store either is one step: a process that fails or is killed
//! leaves what was there. On MongoDB it is not: there a killed
//! process may have stored some of the documents, each whole; with `drop`, it may
//! have swapped some of the collections, each whole. What it staged is removed
//! by the next restore.
//!
//! Indexes are created where the dump has them. A world file has none; the existing
//! indexes stay then. So it is with the validator, which the documents of a dump that has it do not have to pass: they may be
//! older than it. A collection that keeps its validator refuses documents that do not pass it.
//!
//! The oplog of a dump, what changed while it was written, is applied behind its documents, in the same step.
//!
//! The metadata of a dump is kept, but for its dates: a document is inserted
//! when it is restored, and equal to one that was inserted at another time.

use std::collections::{BTreeSet, HashMap};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use bson::{Bson, Document, RawDocumentBuf, doc};

use super::batch::{batches, undated};
use super::error::{RestoreError, nothing_done, unchanged};
use super::read::{Dump, Part};
use super::{dry_run, oplog};
use crate::memory::Memory;
use crate::query::collation::during;
use crate::query::{QueryError, key};
use crate::store::{Find, Index, Namespace, StoreError, TakenKey, Validation, index, metadata, staging};

/// From so many documents on others would wait long for a restore in one step.
const LONG: u64 = 10_000;

/// What restoring a collection did, or would do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Restored {
    /// The collection.
    pub namespace: Namespace,
    /// How many documents are new.
    pub inserted: u64,
    /// How many took the place of another.
    pub replaced: u64,
    /// How many were there already, the same.
    pub skipped: u64,
    /// How many documents the former collection had, where it was replaced as a whole.
    pub dropped: Option<u64>,
    /// How many operations of the dump's oplog change it.
    pub replayed: u64,
    /// The indexes that the store cannot have, and why.
    pub without: Vec<String>,
}

/// What restoring a dump did, or would do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Report {
    /// For each collection.
    pub collections: Vec<Restored>,
    /// What of the oplog is not applied, and why.
    pub notes: Vec<String>,
}

/// What to do with what is there.
#[derive(Debug, Clone, Copy, Default)]
pub struct RestoreOptions<'a> {
    /// Replace collections as a whole.
    pub drop: bool,
    /// Apply the oplog of the dump.
    pub replay: bool,
    /// Only say what would be done; what would be refused is.
    pub dry_run: bool,
    /// Where a dry run may write what it checks unique keys by; nothing is `/tmp`.
    pub temporary: Option<&'a Path>,
    /// Once this is set, what is not swapped in yet is removed again.
    pub stop: Option<&'a AtomicBool>,
}

/// Restores a dump; returns what was done for each collection.
///
/// # Errors
/// Where the dump is not well throughout (nothing is changed then), or a store fails.
pub fn restore(memory: &Memory, dump: &Dump, options: RestoreOptions<'_>) -> Result<Report, RestoreError> {
    dump.check_content(options.replay)?;
    let counts = dump.verify()?;
    let log = dump.log.as_ref().filter(|_| options.replay);
    let survey = log.map(oplog::survey).transpose()?;
    let mut report = Report { collections: Vec::new(), notes: Vec::new() };
    report.collections = if options.dry_run {
        dry_run::check_keys(memory, dump, options.drop, options.temporary.unwrap_or(Path::new("/tmp")))?;
        let mut foreseen = match options.drop {
            true => foresee(memory, dump, &counts)?,
            false => put(memory, dump, true, true, None)?,
        };
        for (restored, part) in foreseen.iter_mut().zip(&dump.parts) {
            if !options.drop {
                let failed = |source| unchanged(&part.namespace, source);
                let is_there = !memory.indexes(&part.namespace).map_err(failed)?.is_empty();
                restored.without.extend(other_options(memory, part, is_there).map_err(failed)?);
            }
            restored.without.extend(dry_run::refused(memory, part)?);
        }
        foreseen
    } else {
        let changed = survey.iter().flat_map(|survey| survey.counts.keys());
        let mut namespaces: Vec<&Namespace> = dump.parts.iter().map(|part| &part.namespace).chain(changed).collect();
        namespaces.dedup();
        let failed = |source| RestoreError::Store { which: "the dump; nothing was changed".to_owned(), source };
        sweep(memory, &namespaces).map_err(failed)?;
        let apply = || log.map_or(Ok(Vec::new()), |log| oplog::apply(memory, log));
        let is_staged = options.drop || (log.is_none() && is_long_and_new(memory, dump, &counts).map_err(failed)?);
        let (collections, without) = match is_staged {
            true => replace(memory, dump, &namespaces, options, apply)?,
            false => memory.atomically(&namespaces, failed, |whole| {
                Ok((put(memory, dump, false, whole, options.stop)?, apply()?))
            })?,
        };
        report.notes = without;
        collections
    };
    if let Some(survey) = survey {
        report.notes.splice(0..0, survey.notes);
        for (ns, count) in survey.counts {
            match report.collections.iter_mut().find(|restored| restored.namespace == ns) {
                Some(restored) => restored.replayed = count,
                None => report.collections.push(Restored { replayed: count, ..Restored::nothing(&ns) }),
            }
        }
    }
    Ok(report)
}

/// Whether a dump has many documents, and only of collections that a file of this machine does not have.
fn is_long_and_new(memory: &Memory, dump: &Dump, counts: &[u64]) -> Result<bool, StoreError> {
    if counts.iter().sum::<u64>() < LONG {
        return Ok(false);
    }
    for part in &dump.parts {
        let is_plain = !matches!(part.collation, Some(Some(_)));
        if !(is_plain && memory.is_in_file(&part.namespace) && memory.indexes(&part.namespace)?.is_empty()) {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Puts all documents into the memory; `whole` says that nothing is kept where one fails.
fn put(
    memory: &Memory,
    dump: &Dump,
    dry_run: bool,
    whole: bool,
    stop: Option<&AtomicBool>,
) -> Result<Vec<Restored>, RestoreError> {
    let mut done: Vec<Restored> = Vec::with_capacity(dump.parts.len());
    for part in &dump.parts {
        let mut restored = Restored::nothing(&part.namespace);
        let mut is_new = false;
        if !dry_run {
            let notes;
            (is_new, notes) = prepare(memory, part).map_err(|source| unchanged(&part.namespace, source))?;
            restored.without.extend(notes);
        }
        for batch in batches(part.documents()?) {
            let batch = undated(batch?);
            if stop.is_some_and(|stop| stop.load(Ordering::Relaxed)) {
                return Err(match whole {
                    true => nothing_done(),
                    false => RestoreError::Interrupted(format!("{}: {}", part.namespace, so_far(&restored, &done))),
                });
            }
            merge(memory, batch, dry_run, &mut restored).map_err(|source| match whole {
                true => unchanged(&part.namespace, source),
                false => {
                    RestoreError::Store { which: format!("{}; {}", part.namespace, so_far(&restored, &done)), source }
                }
            })?;
        }
        if !dry_run {
            let indexes = part.indexes.as_deref().unwrap_or_default();
            let without = index(memory, &part.namespace, indexes).map_err(|source| {
                if whole {
                    return unchanged(&part.namespace, source);
                }
                let which =
                    format!("{}; its documents are stored, but not all of its indexes are made", part.namespace);
                RestoreError::Store { which, source }
            })?;
            restored.without.extend(without);
        }
        if let (true, Some(validation)) = (is_new, &part.validation) {
            // Behind the documents, which may be older than it.
            validate(memory, &part.namespace, validation).map_err(|source| match whole {
                true => unchanged(&part.namespace, source),
                false => {
                    let which = format!("{}; its documents are stored, but its validator is not set", part.namespace);
                    RestoreError::Store { which, source }
                }
            })?;
        }
        done.push(restored);
    }
    Ok(done)
}

/// Makes the collection of a dump, also one without documents, with its collation. Returns whether it is new; and notes where
/// it exists with other options.
fn prepare(memory: &Memory, part: &Part) -> Result<(bool, Vec<String>), StoreError> {
    let is_new = memory.create_collection(&part.namespace, part.collation.as_ref().and_then(Option::as_ref))?;
    Ok((is_new, other_options(memory, part, !is_new)?))
}

/// Notes where the collection exists with another collation, or another validator, than the dump has.
fn other_options(memory: &Memory, part: &Part, is_there: bool) -> Result<Vec<String>, StoreError> {
    let mut notes = Vec::new();
    if !is_there {
        return Ok(notes);
    }
    let mut note = |what: &str| {
        notes.push(format!(
            "the {what} of the collection is not restored: it exists with another one; --drop replaces it"
        ));
    };
    if let Some(Some(collation)) = &part.collation
        && memory.collation(&part.namespace)?.as_ref() != Some(collation)
    {
        note("collation");
    }
    if let Some(validation) = part.validation.as_ref().filter(|validation| validation.validator.is_some())
        && memory.validation(&part.namespace)?.and_then(|own| own.validator) != validation.validator
    {
        note("validator");
    }
    Ok(notes)
}

/// Sets which documents a collection takes, where a dump says something of it.
fn validate(memory: &Memory, ns: &Namespace, validation: &Validation) -> Result<(), StoreError> {
    if validation.is_empty() { Ok(()) } else { memory.set_validation(ns, validation) }
}

/// How much of a collection was stored, and after which others.
fn so_far(restored: &Restored, done: &[Restored]) -> String {
    let complete: Vec<String> = done.iter().map(|done| done.namespace.to_string()).collect();
    let before = if complete.is_empty() { String::new() } else { format!(" after {}", complete.join(", ")) };
    format!("{} of its documents were stored{before}, and the rest were not", restored.inserted + restored.replaced)
}

/// Creates indexes as they are defined; returns notes on those that the store does not support.
fn index(memory: &Memory, ns: &Namespace, indexes: &[Index]) -> Result<Vec<String>, StoreError> {
    let mut without = Vec::new();
    let is_collated = !indexes.is_empty() && memory.collation(ns)?.is_some();
    for index in indexes {
        let alone = is_collated.then(|| index.clone().standing_alone());
        match memory.create_index(ns, alone.as_ref().unwrap_or(index)) {
            Err(StoreError::Query(error)) if error.unsupported => {
                without.push(dry_run::without(index, &error));
            }
            made => drop(made?),
        }
    }
    Ok(without)
}

impl Restored {
    fn nothing(namespace: &Namespace) -> Self {
        Self {
            namespace: namespace.clone(),
            inserted: 0,
            replaced: 0,
            skipped: 0,
            dropped: None,
            replayed: 0,
            without: Vec::new(),
        }
    }
}

/// Puts those documents into the memory that are not there, or different.
fn merge(memory: &Memory, batch: Vec<Document>, dry_run: bool, restored: &mut Restored) -> Result<(), StoreError> {
    let ids: Vec<&Bson> = batch.iter().filter_map(|document| document.get("_id")).collect();
    let find = Find { filter: doc! { "_id": { "$in": ids } }, ..Find::default() };
    let mut present = HashMap::new();
    for document in memory.stored(&restored.namespace, &find)? {
        let document = document?;
        let key = document.get("_id").map_err(QueryError::from)?.map(key::encode).unwrap_or_default();
        present.insert(key, document);
    }
    refuse_alike(memory, &restored.namespace, &batch, &present)?;
    let mut different = Vec::with_capacity(batch.len());
    let (mut added, mut replaced) = (0, 0);
    for document in batch {
        match document.get("_id").and_then(|id| present.get(&key::encode_value(id))) {
            None => added += 1,
            Some(present) if same(&document, present)? => {
                restored.skipped += 1;
                continue;
            }
            Some(_) => replaced += 1,
        }
        different.push(document);
    }
    if dry_run {
        restored.inserted += added;
        restored.replaced += replaced;
    } else if !different.is_empty() {
        let put = memory.put(&restored.namespace, different)?;
        restored.inserted += put.inserted;
        restored.replaced += put.replaced;
        restored.skipped += put.same;
    }
    Ok(())
}

/// Refuses documents whose `_id` the collation of the collection takes for that of another, which they would replace.
fn refuse_alike(
    memory: &Memory,
    ns: &Namespace,
    batch: &[Document],
    present: &HashMap<Vec<u8>, RawDocumentBuf>,
) -> Result<(), StoreError> {
    let Some(collation) = memory.collation(ns)? else { return Ok(()) };
    let mut ids = Vec::with_capacity(present.len() + batch.len());
    for document in present.values() {
        let id = document.get("_id").map_err(QueryError::from)?;
        ids.extend(id.map(Bson::try_from).transpose().map_err(QueryError::from)?);
    }
    ids.extend(batch.iter().filter_map(|document| document.get("_id").cloned()));
    let mut seen = HashMap::with_capacity(ids.len());
    for id in &ids {
        let (own, alike) = (key::encode_value(id), during(Some(&collation), || key::collated(id)));
        if seen.insert(alike, own.clone()).is_some_and(|other| other != own) {
            return Err(StoreError::Duplicate { namespace: ns.clone(), key: TakenKey::id(id), stored: Vec::new() });
        }
    }
    Ok(())
}

/// Whether a document without dates says what a stored one says, key for key.
fn same(document: &Document, stored: &RawDocumentBuf) -> Result<bool, QueryError> {
    let mut stored = Document::try_from(&**stored)?;
    metadata::forget_dates(&mut stored);
    if document.get(metadata::INFO) != stored.get(metadata::INFO) {
        return Ok(false);
    }
    let mut document = document.clone();
    document.remove(metadata::INFO);
    stored.remove(metadata::INFO);
    Ok(RawDocumentBuf::try_from(&document)?.as_bytes() == RawDocumentBuf::try_from(&stored)?.as_bytes())
}

/// The outcome of replacing whole collections.
fn foresee(memory: &Memory, dump: &Dump, counts: &[u64]) -> Result<Vec<Restored>, RestoreError> {
    let parts = dump.parts.iter().zip(counts);
    let foreseen = parts.map(|(part, inserted)| {
        let dropped = size(memory, &part.namespace)?;
        Ok(Restored { inserted: *inserted, dropped: Some(dropped), ..Restored::nothing(&part.namespace) })
    });
    foreseen.collect()
}

fn size(memory: &Memory, ns: &Namespace) -> Result<u64, RestoreError> {
    memory.count(ns, &Document::new()).map_err(|source| unchanged(ns, source))
}

/// A collection that waits to take the place of another.
struct Staged {
    name: Namespace,
    restored: Restored,
}

/// Stages all collections, then swaps them in, and does what comes behind that.
fn replace<T>(
    memory: &Memory,
    dump: &Dump,
    namespaces: &[&Namespace],
    options: RestoreOptions<'_>,
    behind: impl FnOnce() -> Result<T, RestoreError>,
) -> Result<(Vec<Restored>, T), RestoreError> {
    let failed = |source| RestoreError::Store { which: "the dump; nothing was changed".to_owned(), source };
    let mut staged = Vec::with_capacity(dump.parts.len());
    for part in &dump.parts {
        let name = staging::name(staging::RESTORE, &part.namespace);
        staged.push(Staged { name, restored: Restored::nothing(&part.namespace) });
        let stored = match staged.last_mut() {
            Some(last) => stage(memory, part, last, options),
            None => Ok(()),
        };
        if let Err(error) = stored {
            // The error that is returned also explains why these could not be removed.
            staged.iter().for_each(|staged| drop(memory.drop_collection(&staged.name)));
            return Err(error);
        }
    }
    let names: Vec<Namespace> = staged.iter().map(|staged| staged.name.clone()).collect();
    let swapped = memory.atomically(namespaces, failed, |whole| {
        if !options.drop {
            check_absent(memory, dump)?;
        }
        Ok((swap(memory, staged, whole)?, behind()?))
    });
    if swapped.is_err() {
        names.iter().for_each(|name| drop(memory.drop_collection(name)));
    }
    swapped
}

/// Removes what restores that were killed have left in the databases of these collections.
fn sweep(memory: &Memory, namespaces: &[&Namespace]) -> Result<(), StoreError> {
    let databases: BTreeSet<&str> = namespaces.iter().map(|ns| ns.database.as_str()).collect();
    for database in databases {
        for found in memory.collections_of(database)? {
            if staging::is_litter(staging::RESTORE, &found.collection) {
                memory.drop_collection(&found)?;
            }
        }
    }
    Ok(())
}

/// Refuses to take the place of collections that another process has made meanwhile.
fn check_absent(memory: &Memory, dump: &Dump) -> Result<(), RestoreError> {
    for Part { namespace, .. } in &dump.parts {
        if !memory.indexes(namespace).map_err(|source| unchanged(namespace, source))?.is_empty() {
            let reason = "another process has made the collection meanwhile; repeat the restore".to_owned();
            return Err(unchanged(namespace, StoreError::Failed { address: namespace.to_string(), reason }));
        }
    }
    Ok(())
}

/// Returns the staged collections their names, one after the other.
fn swap(memory: &Memory, staged: Vec<Staged>, whole: bool) -> Result<Vec<Restored>, RestoreError> {
    let mut done: Vec<Restored> = Vec::with_capacity(staged.len());
    for Staged { name, restored } in staged {
        let ns = &restored.namespace;
        if let Err(source) = memory.rename_collection(&name, ns, true) {
            let before: Vec<String> = done.iter().map(|done| done.namespace.to_string()).collect();
            let state = match before.as_slice() {
                some @ [_, ..] if !whole => format!("only {} is restored", some.join(", ")),
                _ => "nothing was changed".to_owned(),
            };
            return Err(RestoreError::Store { which: format!("{ns}; {state}"), source });
        }
        done.push(restored);
    }
    Ok(done)
}

fn stage(memory: &Memory, part: &Part, staged: &mut Staged, options: RestoreOptions<'_>) -> Result<(), RestoreError> {
    if options.drop {
        staged.restored.dropped = Some(size(memory, &part.namespace)?);
    }
    let failed = |source| unchanged(&part.namespace, source);
    let collation = match &part.collation {
        Some(collation) => collation.clone(),
        // A dump that says nothing of it keeps the existing one.
        None => memory.collation(&part.namespace).map_err(failed)?,
    };
    // One without documents is made, too.
    memory.create_collection(&staged.name, collation.as_ref()).map_err(failed)?;
    if part.validation.is_none()
        && let Some(validation) = memory.validation(&part.namespace).map_err(failed)?
    {
        // Nor does it change the validator, to which its documents are new.
        memory.set_validation(&staged.name, &validation).map_err(failed)?;
    }
    for batch in batches(part.documents()?) {
        if options.stop.is_some_and(|stop| stop.load(Ordering::Relaxed)) {
            return Err(nothing_done());
        }
        let batch = undated(batch?);
        if options.drop {
            staged.restored.inserted += memory.insert(&staged.name, batch).map_err(failed)?.ids.len() as u64;
        } else {
            // A document that the dump has twice is as if it was restored twice.
            let put = memory.put(&staged.name, batch).map_err(failed)?;
            staged.restored.inserted += put.inserted;
            staged.restored.replaced += put.replaced;
            staged.restored.skipped += put.same;
        }
    }
    let indexes = match &part.indexes {
        Some(indexes) => indexes.clone(),
        // A dump without indexes keeps the existing ones.
        None => memory.indexes(&part.namespace).map_err(failed)?,
    };
    let own: Vec<Index> = indexes.into_iter().filter(|index| index.name != index::ID).collect();
    staged.restored.without = index(memory, &staged.name, &own).map_err(failed)?;
    // Behind the documents, which may be older than it.
    part.validation.as_ref().map_or(Ok(()), |validation| validate(memory, &staged.name, validation)).map_err(failed)
}
