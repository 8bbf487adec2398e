//! The entries of an oplog as operations.
//!
//! Source: MongoDB's manual on the oplog and on `applyOps`, and entries that mongod writes. A transaction is one entry
//! or several with the same session and number; its operations count once it is committed.

use std::collections::HashMap;

use bson::{Bson, Document};

use crate::formats::mongodump::Damage;
use crate::memory::dump::read::{Log, ReadError};
use crate::query::{Collation, QueryError, key};
use crate::store::namespace::is_internal;
use crate::store::{Index, Namespace};

/// What was done.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Operation {
    /// A document was inserted.
    Insert(Document),
    /// The document with this `_id` was changed.
    Update(Bson, Document),
    /// The document with this `_id` was removed.
    Delete(Bson),
    /// A collection was made.
    Create(Option<Collation>),
    /// A collection was removed.
    Drop,
    /// The collection got another name, in place of one that had it.
    Rename(Namespace),
    /// Indexes were made.
    Index(Vec<Index>),
    /// The index of that name was removed; of all indexes, where it is `*`.
    DropIndex(String),
    /// The whole database was removed; the collection of the operation is any.
    DropDatabase,
}

/// An operation and the collection that it changed.
pub(super) type Change = (Namespace, Operation);

/// The operations of an oplog, in order.
pub(super) struct Operations<'a> {
    log: &'a Log,
    /// What transactions have done that are not committed yet, by session and number.
    open: HashMap<Vec<u8>, Vec<Change>>,
    /// What is not applied, and why.
    pub(super) left_out: Vec<String>,
}

impl<'a> Operations<'a> {
    pub(super) fn new(log: &'a Log) -> Self {
        Self { log, open: HashMap::new(), left_out: Vec::new() }
    }

    /// Calls `take` with each operation and the byte its entry starts at.
    pub(super) fn each<E: From<ReadError>>(
        &mut self,
        mut take: impl FnMut(u64, Change) -> Result<(), E>,
    ) -> Result<(), E> {
        for entry in self.log.entries()? {
            let (offset, entry) = entry?;
            let mut found = Vec::new();
            let read = self.read(&entry, &mut found);
            read.map_err(|reason| {
                self.log.damaged(Damage { offset, reason: format!("the entry of the oplog {reason}") })
            })?;
            found.into_iter().try_for_each(|change| take(offset, change))?;
        }
        Ok(())
    }

    /// Reads an entry, or one of a transaction.
    fn read(&mut self, entry: &Document, found: &mut Vec<Change>) -> Result<(), String> {
        let kind = entry.get_str("op").map_err(|_| "has no `op`".to_owned())?;
        if kind == "n" {
            return Ok(());
        }
        let name = entry.get_str("ns").map_err(|_| "has no `ns`".to_owned())?;
        let object = entry.get_document("o").map_err(|_| "has no `o`, a document".to_owned())?;
        if kind == "c" {
            return self.command(name, object, entry, found);
        }
        let Some(ns) = self.collection(name) else { return Ok(()) };
        let id = |document: &Document| document.get("_id").cloned().ok_or_else(|| "has no `_id`".to_owned());
        found.push(match kind {
            "i" => (ns, Operation::Insert(object.clone())),
            "d" => (ns, Operation::Delete(id(object)?)),
            "u" => {
                let which = entry.get_document("o2").map_err(|_| "has no `o2`, a document".to_owned())?;
                (ns, Operation::Update(id(which)?, object.clone()))
            }
            kind => return Err(format!("has an unknown `op`: {kind:?}")),
        });
        Ok(())
    }

    /// Reads a command: its name is the first key.
    fn command(
        &mut self,
        name: &str,
        object: &Document,
        entry: &Document,
        found: &mut Vec<Change>,
    ) -> Result<(), String> {
        let (command, argument) = object.iter().next().ok_or("has an empty command")?;
        match command.as_str() {
            "applyOps" => self.operations(argument, object, entry, found)?,
            "commitTransaction" => found.extend(self.open.remove(&transaction(entry)).unwrap_or_default()),
            "abortTransaction" => {
                self.open.remove(&transaction(entry));
            }
            "startIndexBuild" | "abortIndexBuild" => {}
            command => {
                let database = name.split('.').next().unwrap_or_default();
                let target = match (command, argument.as_str()) {
                    ("dropDatabase", _) => format!("{database}.all"),
                    ("renameCollection", Some(from)) => from.to_owned(),
                    (_, Some(collection)) => format!("{database}.{collection}"),
                    (command, None) => return Err(format!("has no name of a collection in `{command}`")),
                };
                if let Some(ns) = self.collection(&target) {
                    let operation = self.operation(command, object, &ns)?;
                    found.extend(operation.map(|operation| (ns, operation)));
                }
            }
        }
        Ok(())
    }

    /// Reads the operations of `applyOps`. Those of a transaction that is still open wait for its end.
    fn operations(
        &mut self,
        operations: &Bson,
        object: &Document,
        entry: &Document,
        found: &mut Vec<Change>,
    ) -> Result<(), String> {
        let mut inner = Vec::new();
        for operation in operations.as_array().ok_or("has no operations in `applyOps`")? {
            self.read(operation.as_document().ok_or("has no document in `applyOps`")?, &mut inner)?;
        }
        if !entry.contains_key("txnNumber") {
            found.append(&mut inner);
            return Ok(());
        }
        self.open.entry(transaction(entry)).or_default().append(&mut inner);
        let is_set = |key| object.get_bool(key).unwrap_or(false);
        if !is_set("partialTxn") && !is_set("prepare") {
            found.extend(self.open.remove(&transaction(entry)).unwrap_or_default());
        }
        Ok(())
    }

    /// What a command does to a collection; none where it is left out.
    fn operation(&mut self, command: &str, object: &Document, ns: &Namespace) -> Result<Option<Operation>, String> {
        Ok(Some(match command {
            "create" if object.contains_key("viewOn") => {
                self.left_out.push(format!("{ns}: a view is not made"));
                return Ok(None);
            }
            "create" => {
                if object.contains_key("validator") {
                    self.left_out.push(format!("{ns}: its validator is not set"));
                }
                Operation::Create(match object.get_document("collation") {
                    Ok(spec) => Some(Collation::parse(spec).map_err(|error| error.message)?),
                    Err(_) => None,
                })
            }
            "drop" => Operation::Drop,
            "dropDatabase" => Operation::DropDatabase,
            "renameCollection" => {
                let to = object.get_str("to").map_err(|_| "has no `to`".to_owned())?;
                return Ok(self.collection(to).map(Operation::Rename));
            }
            "createIndexes" => {
                let options = ["createIndexes", "indexBuildUUID"];
                let own = object.iter().filter(|(key, _)| !options.contains(&key.as_str()));
                Operation::Index(vec![index(&own.map(|(key, value)| (key.clone(), value.clone())).collect())?])
            }
            "commitIndexBuild" => {
                let indexes = object.get_array("indexes").map_err(|_| "has no `indexes`".to_owned())?;
                Operation::Index(indexes.iter().filter_map(Bson::as_document).map(index).collect::<Result<_, _>>()?)
            }
            "dropIndexes" | "deleteIndexes" => Operation::DropIndex(object.get_str("index").unwrap_or("*").to_owned()),
            command => {
                self.left_out.push(format!("{ns}: `{command}` is not applied"));
                return Ok(None);
            }
        }))
    }

    /// The collection of an operation; none where it is the server's own.
    fn collection(&mut self, name: &str) -> Option<Namespace> {
        let ns = Namespace::parse(name).ok().filter(|ns| !is_internal(&ns.database));
        if ns.is_none() {
            self.left_out.push(format!("{name} is the server's own and is left out"));
        }
        ns
    }
}

/// The key of the transaction that an entry belongs to.
fn transaction(entry: &Document) -> Vec<u8> {
    key::encode_value(&Bson::Array(vec![session(entry, "lsid"), session(entry, "txnNumber")]))
}

fn session(entry: &Document, key: &str) -> Bson {
    entry.get(key).cloned().unwrap_or(Bson::Null)
}

fn index(definition: &Document) -> Result<Index, String> {
    Index::parse(definition).map_err(|error: QueryError| format!("has no index: {}", error.message))
}
