//! How often operations were done, and how long they took, for each collection (`top`, `serverStatus`).

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use bson::{Bson, Document, doc};

use super::request::Request;
use crate::saturate::to_i64;

/// Collections beyond this number are not noted.
const MOST: usize = 10_000;

/// What was done since the start.
#[derive(Debug, Default)]
pub(super) struct Usage(Mutex<Noted>);

#[derive(Debug, Default)]
struct Noted {
    counts: [u64; KINDS.len()],
    collections: HashMap<String, Totals>,
}

/// The kinds of operations, as `serverStatus` counts them, and as `top` names them.
const KINDS: [(&str, &str); 6] = [
    ("insert", "insert"),
    ("query", "queries"),
    ("update", "update"),
    ("delete", "remove"),
    ("getmore", "getmore"),
    ("command", "commands"),
];

/// The kind of the commands that are no other.
const COMMAND: usize = 5;

#[derive(Debug, Clone, Copy, Default)]
struct Spent {
    micros: i64,
    count: i64,
}

#[derive(Debug, Clone, Copy, Default)]
struct Totals {
    reads: Spent,
    writes: Spent,
    kinds: [Spent; KINDS.len()],
}

impl Usage {
    /// Notes a command that was done.
    pub(super) fn note(&self, request: &Request, is_writing: bool, time: Duration) {
        let ((kind, count), place) = (kind(request), place(request));
        let mut noted = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(sum) = noted.counts.get_mut(kind) {
            *sum = sum.saturating_add(count);
        }
        let Some(place) = place else { return };
        if noted.collections.len() >= MOST && !noted.collections.contains_key(&place) {
            return;
        }
        let totals = noted.collections.entry(place).or_default();
        let lock = if is_writing { &mut totals.writes } else { &mut totals.reads };
        lock.add(time);
        if let Some(spent) = totals.kinds.get_mut(kind) {
            spent.add(time);
        }
    }

    /// The counts of `serverStatus`.
    pub(super) fn counts(&self) -> Document {
        let noted = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let counts = KINDS.iter().zip(noted.counts);
        counts.map(|((name, _), count)| ((*name).to_owned(), Bson::Int64(count.cast_signed()))).collect()
    }

    /// What `top` says of a collection.
    pub(super) fn of(&self, place: &str) -> Document {
        let noted = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let totals = noted.collections.get(place).copied().unwrap_or_default();
        let mut all = totals.reads;
        all.micros = all.micros.saturating_add(totals.writes.micros);
        all.count = all.count.saturating_add(totals.writes.count);
        let mut said = doc! {
            "total": all.to_document(),
            "readLock": totals.reads.to_document(),
            "writeLock": totals.writes.to_document(),
        };
        let kinds = KINDS.iter().zip(totals.kinds);
        said.extend(kinds.map(|((_, name), spent)| ((*name).to_owned(), Bson::Document(spent.to_document()))));
        said
    }
}

impl Spent {
    fn add(&mut self, time: Duration) {
        self.micros = self.micros.saturating_add(to_i64(time.as_micros()));
        self.count = self.count.saturating_add(1);
    }

    fn to_document(self) -> Document {
        doc! { "time": self.micros, "count": self.count }
    }
}

/// The kind of a command, and how many operations it is: each document of an insert is one, each statement of an update.
fn kind(request: &Request) -> (usize, u64) {
    let (kind, statements) = match request.name.as_str() {
        "insert" => (0, "documents"),
        "update" => (2, "updates"),
        "delete" => (3, "deletes"),
        "find" => return (1, 1),
        "getMore" => return (4, 1),
        _ => return (COMMAND, 1),
    };
    (kind, request.body.get_array(statements).map_or(1, |statements| statements.len() as u64))
}

/// The collection that a command is about.
fn place(request: &Request) -> Option<String> {
    let name = match request.name.as_str() {
        "getMore" => request.body.get_str("collection").ok()?,
        "explain" | "renameCollection" | "getLog" => return None,
        _ => request.target()?.as_str()?,
    };
    Some(format!("{}.{name}", request.database))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn operations_are_counted_by_kind_and_collection() {
        let usage = Usage::default();
        let note = |body: Document, is_writing| {
            let request = Request::read(body).unwrap();
            usage.note(&request, is_writing, Duration::from_micros(5));
        };
        note(doc! { "insert": "c", "documents": [{}, {}], "$db": "a" }, true);
        note(doc! { "find": "c", "$db": "a" }, false);
        note(doc! { "getMore": 3_i64, "collection": "c", "$db": "a" }, false);
        note(doc! { "ping": 1, "$db": "a" }, false);
        let counts = usage.counts();
        assert_eq!(
            counts,
            doc! { "insert": 2_i64, "query": 1_i64, "update": 0_i64, "delete": 0_i64, "getmore": 1_i64, "command": 1_i64 }
        );
        let top = usage.of("a.c");
        assert_eq!(top.get_document("total").unwrap(), &doc! { "time": 15_i64, "count": 3_i64 });
        assert_eq!(top.get_document("writeLock").unwrap(), &doc! { "time": 5_i64, "count": 1_i64 });
        assert_eq!(top.get_document("queries").unwrap(), &doc! { "time": 5_i64, "count": 1_i64 });
        assert_eq!(usage.of("a.other").get_document("total").unwrap(), &doc! { "time": 0_i64, "count": 0_i64 });
    }
}
