//! Applying the oplog of a dump: the changes that were made while `mongodump --oplog` read the collections. A dump with
//! them is the memory as it was at one moment, at the end of the dump.
//!
//! A change that the dump has seen already changes nothing: an insert takes the place of the document with its `_id`,
//! a removal of what is not there removes nothing, and so does an update. So applying is repeatable.

mod delta;
mod entry;

use std::collections::BTreeMap;

use bson::{Bson, DateTime, Document, RawDocumentBuf, doc};

use super::batch::undated;
use super::dry_run;
use super::error::RestoreError;
use super::read::Log;
use crate::formats::mongodump::Damage;
use crate::memory::Memory;
use crate::query::{Filter, QueryError, Update};
use crate::store::{Find, Namespace, StoreError, index, metadata};
use entry::{Operation, Operations};

/// What an oplog would change.
pub(super) struct Survey {
    /// The collections, each with the number of operations.
    pub(super) counts: BTreeMap<Namespace, u64>,
    /// What is not applied, and why.
    pub(super) notes: Vec<String>,
}

/// Reads an oplog through.
///
/// # Errors
/// Where it cannot be read, or an entry is not one.
pub(super) fn survey(log: &Log) -> Result<Survey, RestoreError> {
    let mut operations = Operations::new(log);
    let mut counts = BTreeMap::new();
    operations.each::<RestoreError>(|_, (ns, operation)| {
        if let Operation::Rename(to) = operation {
            *counts.entry(to).or_default() += 1;
        }
        *counts.entry(ns).or_default() += 1;
        Ok(())
    })?;
    let mut notes = operations.left_out;
    notes.sort();
    notes.dedup();
    Ok(Survey { counts, notes })
}

/// Applies an oplog; returns notes on the indexes that the store cannot have.
///
/// # Errors
/// Where it cannot be read, a difference is not of its document, or a store fails.
pub(super) fn apply(memory: &Memory, log: &Log) -> Result<Vec<String>, RestoreError> {
    let mut without = Vec::new();
    Operations::new(log).each(|offset, (ns, operation)| {
        let applied = one(memory, &ns, operation, &mut without);
        applied.map_err(|problem| match problem {
            Problem::Entry(reason) => {
                log.damaged(Damage { offset, reason: format!("the entry of the oplog {reason}") }).into()
            }
            Problem::Store(source) => {
                RestoreError::Store { which: format!("{ns} by the oplog; nothing of it is complete"), source }
            }
        })
    })?;
    Ok(without)
}

/// Why an operation was not applied.
enum Problem {
    Entry(String),
    Store(StoreError),
}

impl From<StoreError> for Problem {
    fn from(error: StoreError) -> Self {
        Self::Store(error)
    }
}

impl From<QueryError> for Problem {
    fn from(error: QueryError) -> Self {
        Self::Store(error.into())
    }
}

fn one(memory: &Memory, ns: &Namespace, operation: Operation, without: &mut Vec<String>) -> Result<(), Problem> {
    match operation {
        Operation::Insert(document) if metadata::says_computed(&document) => {}
        Operation::Insert(document) => drop(memory.put(ns, undated(vec![document]))?),
        Operation::Update(id, change) => {
            if let Some(document) = updated(memory, ns, id, &change)? {
                memory.put(ns, undated(vec![document]))?;
            }
        }
        Operation::Delete(id) => drop(memory.delete(ns, &doc! { "_id": { "$eq": id } }, true)?),
        // A collection without a collation is there once it has a document or an index.
        Operation::Create(None) => {}
        Operation::Create(Some(collation)) => drop(memory.create_collection(ns, Some(&collation))?),
        Operation::Drop => drop(memory.drop_collection(ns)?),
        Operation::DropDatabase => {
            for found in memory.collections_beside(ns)?.iter().filter(|found| found.database == ns.database) {
                memory.drop_collection(found)?;
            }
        }
        Operation::Rename(to) => {
            // What was renamed before the dump read it is there under its new name.
            if memory.collections_beside(ns)?.contains(ns) {
                memory.rename_collection(ns, &to, true)?;
            }
        }
        Operation::Index(indexes) => {
            for index in &indexes {
                match memory.create_index(ns, index) {
                    Err(StoreError::Query(error)) if error.unsupported => {
                        without.push(format!("{ns}: {}", dry_run::without(index, &error)));
                    }
                    made => drop(made?),
                }
            }
        }
        Operation::DropIndex(name) if name == "*" => {
            for index in memory.indexes(ns)?.iter().filter(|index| index.name != index::ID) {
                memory.drop_index(ns, &index.name)?;
            }
        }
        Operation::DropIndex(name) => drop(memory.drop_index(ns, &name)?),
    }
    Ok(())
}

/// The document after an update; nothing where there is no such document (any more).
fn updated(memory: &Memory, ns: &Namespace, id: Bson, change: &Document) -> Result<Option<Document>, Problem> {
    let is_operators = change.keys().any(|key| key.starts_with('$')) || change.contains_key("diff");
    if !is_operators {
        let mut document = doc! { "_id": id };
        document
            .extend(change.iter().filter(|(key, _)| *key != "_id").map(|(key, value)| (key.clone(), value.clone())));
        return Ok(Some(document));
    }
    let find = Find { filter: doc! { "_id": { "$eq": id } }, limit: 1, ..Find::default() };
    let Some(stored) = memory.stored(ns, &find)?.next().transpose()? else { return Ok(None) };
    if let Ok(difference) = change.get_document("diff") {
        let mut document = Document::try_from(&*stored).map_err(QueryError::from)?;
        delta::apply(&mut document, difference).map_err(Problem::Entry)?;
        return Ok(Some(document));
    }
    let operators = change.iter().filter(|(key, _)| *key != "$v").map(|(key, value)| (key.clone(), value.clone()));
    let update = Update::parse(&operators.collect(), &[])?;
    let changed = update.apply(&stored, &Filter::parse(&Document::new())?, DateTime::now())?;
    let document: RawDocumentBuf = changed.unwrap_or(stored);
    Ok(Some(Document::try_from(&*document).map_err(QueryError::from)?))
}
