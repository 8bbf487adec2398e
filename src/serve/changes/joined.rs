//! Which changes one transaction of several commands made: their events have one time, and say whose they are.
//!
//! A record `{_id: {transaction: LAST}, first, lsid, number, at}` is beside what is kept of retried writes, made in the
//! transaction itself; `first` and `LAST` are the positions of its first and last change.

use bson::{DateTime, Document, Timestamp, doc};

use crate::memory::Memory;
use crate::serve::access::records;
use crate::serve::clock;
use crate::serve::failure::Failure;
use crate::store::{Change, Find, NotedChanges, StoreError};

/// The changes of a transaction.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::serve) struct Joined {
    first: i64,
    last: i64,
    /// The session, as events name it.
    lsid: Document,
    /// The number of the transaction.
    number: i64,
}

impl Joined {
    pub(in crate::serve) fn new(noted: NotedChanges, lsid: Document, number: i64) -> Self {
        Self { first: noted.first, last: noted.last, lsid, number }
    }

    /// Keeps it, in the store of a database. In the transaction only.
    pub(in crate::serve) fn keep(&self, memory: &Memory, database: &str) -> Result<(), StoreError> {
        let records = records(memory, database);
        let record = doc! {
            "_id": { "transaction": self.last },
            "first": self.first,
            "lsid": self.lsid.clone(),
            "number": self.number,
            "at": DateTime::now(),
        };
        memory.bare(&records)?.put(&records, vec![record], None).map(drop)
    }

    /// Those that have changes from a position up to another in the store of a database.
    pub(super) fn between(memory: &Memory, database: &str, (from, to): (i64, i64)) -> Result<Vec<Self>, Failure> {
        let records = records(memory, database);
        let filter = doc! { "_id": { "$gte": { "transaction": from } } };
        let find = Find { filter, sort: doc! { "_id": 1 }, ..Find::default() };
        let mut found = Vec::new();
        for record in memory.bare(&records)?.find(&records, &find)? {
            match Self::read(&Document::try_from(&*record?)?).filter(|joined| joined.first <= to) {
                Some(joined) => found.push(joined),
                // Later ones, or what is kept of retried writes.
                None => break,
            }
        }
        Ok(found)
    }

    fn read(record: &Document) -> Option<Self> {
        let last = record.get_document("_id").ok()?.get_i64("transaction").ok()?;
        let lsid = record.get_document("lsid").ok()?.clone();
        Some(Self { first: record.get_i64("first").ok()?, last, lsid, number: record.get_i64("number").ok()? })
    }

    /// The one that made the change at a position.
    pub(super) fn of(all: &[Self], position: i64) -> Option<&Self> {
        let next = all.partition_point(|joined| joined.last < position);
        all.get(next).filter(|joined| joined.first <= position)
    }

    /// What events say of it.
    pub(super) fn fields(&self) -> Document {
        doc! { "lsid": self.lsid.clone(), "txnNumber": self.number }
    }
}

/// The cluster's time of a change, which is that of its transaction where it is of one.
pub(super) fn time(change: &Change, position: i64, joined: Option<&Joined>) -> Timestamp {
    clock::of(change.time, joined.map_or(position, |joined| joined.last))
}
