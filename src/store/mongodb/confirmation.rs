//! Writes of a client that says who is to confirm them (`writeConcern`).
//!
//! The driver gives no result of a write that is not confirmed, and MongoDB answers both. So the primary alone confirms
//! each write, and then an update of nothing has the client's write concern: the server waits for all that was written
//! before it. Where another member has become the primary meanwhile, what was written before may be lost, and is
//! reported as not confirmed.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use bson::oid::ObjectId;
use bson::{Bson, Document, doc};
use mongodb::options::{Acknowledgment, WriteConcern};

use super::{MongoDb, failure};
use crate::query::QueryError;
use crate::store::uri::Role;
use crate::store::{Namespace, StoreError};

/// The collection that the update of nothing is made in; it does not have to be there.
const NOTHING: &str = "rmem.retries";
/// How long it is taken for known which election made the primary.
const KNOWN: Duration = Duration::from_secs(5);
/// The server's code for a write during which another member became the primary.
const ELECTED: i32 = 11_602;
/// The server's code for a member that is not reached.
const UNREACHABLE: i32 = 6;

/// Who confirms the writes of a store.
pub(super) struct Confirmation {
    /// What the URI says, completed.
    least: WriteConcern,
    /// Whether no client may ask for less.
    is_shared: bool,
    /// Whether the primary alone confirms each write, since all are waited for behind them.
    is_postponed: AtomicBool,
    /// Which election made the primary, and when that was known.
    election: Mutex<Option<(Instant, Option<ObjectId>)>>,
}

/// While it lives, the primary alone confirms each write.
struct Postponed<'c>(&'c AtomicBool);

impl Drop for Postponed<'_> {
    fn drop(&mut self) {
        self.0.store(false, Ordering::Relaxed);
    }
}

impl Confirmation {
    pub(super) fn new(least: WriteConcern, role: Role) -> Self {
        Self { least, is_shared: role == Role::Shared, is_postponed: AtomicBool::default(), election: Mutex::default() }
    }

    /// The write concern of a single write.
    pub(super) fn of_one(&self) -> WriteConcern {
        match self.is_postponed.load(Ordering::Relaxed) {
            true => WriteConcern::builder().w(Acknowledgment::Nodes(1)).build(),
            false => self.least.clone(),
        }
    }

    fn postpone(&self) -> Postponed<'_> {
        self.is_postponed.store(true, Ordering::Relaxed);
        Postponed(&self.is_postponed)
    }

    /// The write concerns that have to be met for what a client asks.
    fn needed(&self, asked: Option<&Document>) -> Result<Vec<Document>, QueryError> {
        let mut least = bson::serialize_to_document(&self.least)?;
        let Some(asked) = asked.filter(|asked| !asked.is_empty()) else { return Ok(vec![least]) };
        match asked_of(asked) {
            Asked::Nobody if !self.is_shared => Ok(Vec::new()),
            _ if !self.is_shared => Ok(vec![asked.clone()]),
            members => {
                least.extend(asked.get("wtimeout").map(|limit| ("wtimeout".to_owned(), limit.clone())));
                let more = (members == Asked::Others).then(|| asked.clone());
                Ok(std::iter::once(least).chain(more).collect())
            }
        }
    }

    fn known(&self) -> Option<Option<ObjectId>> {
        let election = *self.election.lock().unwrap_or_else(PoisonError::into_inner);
        election.filter(|(since, _)| since.elapsed() < KNOWN).map(|(_, election)| election)
    }

    fn learn(&self, election: Option<ObjectId>) {
        *self.election.lock().unwrap_or_else(PoisonError::into_inner) = Some((Instant::now(), election));
    }
}

/// Who is to confirm a write.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Asked {
    Nobody,
    /// The primary, a majority, or whoever does by default.
    Usual,
    /// So many members, or those that have tags.
    Others,
}

fn asked_of(concern: &Document) -> Asked {
    let members = match concern.get("w") {
        Some(Bson::Int32(count)) => i64::from(*count),
        Some(Bson::Int64(count)) => *count,
        #[expect(clippy::cast_possible_truncation, reason = "MongoDB cuts it, too")]
        Some(Bson::Double(count)) => *count as i64,
        None | Some(Bson::Null) => 1,
        Some(Bson::String(mode)) if mode == "majority" => 1,
        Some(_) => return Asked::Others,
    };
    match members {
        0 if concern.get("j") != Some(&Bson::Boolean(true)) => Asked::Nobody,
        0 | 1 => Asked::Usual,
        _ => Asked::Others,
    }
}

impl MongoDb {
    /// Runs writes, and waits until they are confirmed as asked.
    pub(super) fn wait_for_all(
        &self,
        ns: &Namespace,
        asked: Option<&Document>,
        work: &mut dyn FnMut() -> bool,
    ) -> Result<Option<Document>, StoreError> {
        let needed = self.confirmation.needed(asked)?;
        let election = match self.confirmation.known() {
            Some(election) => election,
            None => self.ask_for_election(asked)?,
        };
        let postponed = self.confirmation.postpone();
        let has_written = work();
        drop(postponed);
        let mut needed = needed.into_iter().filter(|_| has_written);
        Ok(needed.find_map(|concern| self.wait(ns, concern, election)))
    }

    /// Which election made the primary; there is none where the server is no member of a replica set.
    fn ask_for_election(&self, asked: Option<&Document>) -> Result<Option<ObjectId>, StoreError> {
        let hello = self.client().database("admin").run_command(doc! { "hello": 1 }).run();
        let hello = hello.map_err(|e| self.explain(&e))?;
        let is_of_others = asked.is_some_and(|asked| asked_of(asked) == Asked::Others);
        if is_of_others && !hello.contains_key("setName") && !hello.contains_key("msg") {
            return Err(QueryError::bad_value("cannot use 'w' > 1 when a host is not replicated").into());
        }
        let election = hello.get_object_id("electionId").ok();
        self.confirmation.learn(election);
        Ok(election)
    }

    /// Waits until all that was written is confirmed; returns why it is not.
    fn wait(&self, ns: &Namespace, concern: Document, before: Option<ObjectId>) -> Option<Document> {
        let update = doc! { "q": { "_id": { "$in": [] } }, "u": { "$set": { "confirmed": true } } };
        let mut nothing = doc! { "update": NOTHING, "updates": [update], "writeConcern": concern };
        if let Some(left) = crate::deadline::left() {
            nothing.insert("maxTimeMS", i64::try_from(left.as_millis().max(1)).unwrap_or(i64::MAX));
        }
        let answer = match self.client().database(&ns.database).run_command(nothing).run() {
            Ok(answer) => answer,
            Err(error) => {
                let code = failure::code(&error).unwrap_or(UNREACHABLE);
                return Some(doc! { "code": code, "errmsg": self.explain(&error).to_string() });
            }
        };
        let after = answer.get_object_id("electionId").ok();
        self.confirmation.learn(after);
        match answer.get_document("writeConcernError") {
            Ok(error) => Some(error.clone()),
            Err(_) if before.is_none() || before == after => None,
            Err(_) => {
                let message = "another member has become the primary; what was written before that may be lost";
                Some(doc! { "code": ELECTED, "errmsg": message })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shared_store_waits_for_a_majority_whatever_less_is_asked() {
        let least = WriteConcern::builder().w(Acknowledgment::Majority).journal(true).build();
        let needed = |role, asked: Document| Confirmation::new(least.clone(), role).needed(Some(&asked)).unwrap();
        let majority = doc! { "w": "majority", "j": true };
        for less in [doc! {}, doc! { "w": 0 }, doc! { "w": 1 }, doc! { "w": "majority" }, doc! { "j": false }] {
            assert_eq!(needed(Role::Shared, less.clone()), std::slice::from_ref(&majority), "{less}");
        }
        let timed = doc! { "w": "majority", "j": true, "wtimeout": 5 };
        assert_eq!(needed(Role::Shared, doc! { "w": 1, "wtimeout": 5 }), [timed]);
        for more in [doc! { "w": 3 }, doc! { "w": "far" }, doc! { "w": { "place": 2 } }] {
            assert_eq!(needed(Role::Shared, more.clone()), [majority.clone(), more.clone()]);
            assert_eq!(needed(Role::Local, more.clone()), [more]);
        }
        assert_eq!(needed(Role::Local, doc! { "w": 1 }), [doc! { "w": 1 }]);
        assert_eq!(needed(Role::Local, doc! { "w": 0 }), [] as [Document; 0]);
        assert_eq!(needed(Role::Local, doc! {}), [majority]);
    }
}
