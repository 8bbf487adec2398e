//! Who is to confirm writes: what the URI says, and what a client asks (`writeConcern`).

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use bson::oid::ObjectId;
use bson::{Bson, Document};
use mongodb::options::{Acknowledgment, WriteConcern};

use crate::query::QueryError;

/// How long it is taken for known that the server is no member of a replica set.
const KNOWN: Duration = Duration::from_secs(5);
/// The same for which election made the primary: shorter than any election takes, so that one is not taken for an election
/// during a write that was before it.
const ELECTION_KNOWN: Duration = Duration::from_millis(20);

/// Who confirms the writes of a store.
pub(super) struct Confirmation {
    /// What the URI says, completed.
    least: WriteConcern,
    /// Whether no client may ask for less.
    is_shared: bool,
    /// Whether the primary alone confirms each write, since all are waited for behind them.
    is_postponed: AtomicBool,
    /// What the server is, and when that was known.
    member: Mutex<Option<(Instant, Member)>>,
}

/// What a server is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Member {
    /// Whether there are, or may be, other members.
    pub(super) is_replicated: bool,
    /// Which election made the primary, where it is a member of a replica set.
    pub(super) election: Option<ObjectId>,
}

impl Member {
    /// Refuses what a server without other members refuses, before anything is written.
    pub(super) fn check(self, asked: Option<&Document>) -> Result<(), QueryError> {
        let members = asked.filter(|_| !self.is_replicated).and_then(|asked| asked.get("w"));
        match members {
            Some(Bson::String(mode)) if mode != "majority" => Err(QueryError::bad_value(format!(
                "cannot use non-majority 'w' mode \"{mode}\" when a host is not a member of a replica set"
            ))),
            // It takes tags of members.
            Some(Bson::Int32(_) | Bson::Int64(_) | Bson::Double(_))
                if asked.is_some_and(|asked| asked_of(asked) == Asked::Others) =>
            {
                Err(QueryError::bad_value("cannot use 'w' > 1 when a host is not replicated"))
            }
            _ => Ok(()),
        }
    }
}

/// While it lives, the primary alone confirms each write.
pub(super) struct Postponed<'c>(&'c AtomicBool);

impl Drop for Postponed<'_> {
    fn drop(&mut self) {
        self.0.store(false, Ordering::Relaxed);
    }
}

impl Confirmation {
    pub(super) fn new(least: WriteConcern, is_shared: bool) -> Self {
        Self { least, is_shared, is_postponed: AtomicBool::default(), member: Mutex::default() }
    }

    /// The write concern of a single write.
    pub(super) fn of_one(&self) -> WriteConcern {
        match self.is_postponed.load(Ordering::Relaxed) {
            true => WriteConcern::builder().w(Acknowledgment::Nodes(1)).build(),
            false => self.least.clone(),
        }
    }

    pub(super) fn postpone(&self) -> Postponed<'_> {
        self.is_postponed.store(true, Ordering::Relaxed);
        Postponed(&self.is_postponed)
    }

    /// The write concerns that have to be met for what a client asks.
    pub(super) fn needed(&self, asked: Option<&Document>) -> Result<Vec<Document>, QueryError> {
        let mut least = bson::serialize_to_document(&self.least)?;
        let Some(asked) = asked.filter(|asked| !asked.is_empty()) else { return Ok(vec![least]) };
        match asked_of(asked) {
            Asked::Unacknowledged if !self.is_shared => Ok(Vec::new()),
            _ if !self.is_shared => Ok(vec![asked.clone()]),
            members => {
                least.extend(asked.get("wtimeout").map(|limit| ("wtimeout".to_owned(), limit.clone())));
                let more = (members == Asked::Others).then(|| asked.clone());
                Ok(std::iter::once(least).chain(more).collect())
            }
        }
    }

    pub(super) fn known(&self) -> Option<Member> {
        let member = *self.member.lock().unwrap_or_else(PoisonError::into_inner);
        let limit = |member: &Member| if member.election.is_some() { ELECTION_KNOWN } else { KNOWN };
        member.filter(|(since, member)| since.elapsed() < limit(member)).map(|(_, member)| member)
    }

    pub(super) fn learn(&self, member: Member) {
        *self.member.lock().unwrap_or_else(PoisonError::into_inner) = Some((Instant::now(), member));
    }
}

/// Who is to confirm a write.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Asked {
    /// No member: the write is not acknowledged.
    Unacknowledged,
    /// The primary, a majority, or whoever does by default.
    Usual,
    /// So many members, or those that have tags.
    Others,
}

pub(super) fn asked_of(concern: &Document) -> Asked {
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
        0 if concern.get("j") != Some(&Bson::Boolean(true)) => Asked::Unacknowledged,
        0 | 1 => Asked::Usual,
        _ => Asked::Others,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::doc;

    #[test]
    fn a_shared_store_waits_for_a_majority_whatever_less_is_asked() {
        let least = WriteConcern::builder().w(Acknowledgment::Majority).journal(true).build();
        let needed =
            |is_shared, asked: Document| Confirmation::new(least.clone(), is_shared).needed(Some(&asked)).unwrap();
        let majority = doc! { "w": "majority", "j": true };
        for less in [doc! {}, doc! { "w": 0 }, doc! { "w": 1 }, doc! { "w": "majority" }, doc! { "j": false }] {
            assert_eq!(needed(true, less.clone()), std::slice::from_ref(&majority), "{less}");
        }
        let timed = doc! { "w": "majority", "j": true, "wtimeout": 5 };
        assert_eq!(needed(true, doc! { "w": 1, "wtimeout": 5 }), [timed]);
        for more in [doc! { "w": 3 }, doc! { "w": "far" }, doc! { "w": { "place": 2 } }] {
            assert_eq!(needed(true, more.clone()), [majority.clone(), more.clone()]);
            assert_eq!(needed(false, more.clone()), [more]);
        }
        assert_eq!(needed(false, doc! { "w": 1 }), [doc! { "w": 1 }]);
        assert_eq!(needed(false, doc! { "w": 0 }), [] as [Document; 0]);
        assert_eq!(needed(false, doc! {}), [majority]);
    }

    #[test]
    fn a_server_without_others_refuses_to_wait_for_them() {
        let alone = Member { is_replicated: false, election: None };
        let code = |asked: Document| alone.check(Some(&asked)).map_err(|error| error.code).err();
        for refused in [doc! { "w": 2 }, doc! { "w": 2.0, "wtimeout": 1 }, doc! { "w": "far" }] {
            assert_eq!(code(refused.clone()), Some(2), "{refused}");
            let member = Member { is_replicated: true, election: Some(ObjectId::from_bytes([1; 12])) };
            assert_eq!(member.check(Some(&refused)), Ok(()));
        }
        for taken in [doc! {}, doc! { "w": 0 }, doc! { "w": 1 }, doc! { "w": "majority" }, doc! { "w": { "place": 2 } }]
        {
            assert_eq!(code(taken.clone()), None, "{taken}");
        }
    }

    #[test]
    fn an_election_is_known_for_a_moment_only() {
        let confirmation = Confirmation::new(WriteConcern::default(), false);
        let alone = Member { is_replicated: false, election: None };
        let member = Member { is_replicated: true, election: Some(ObjectId::from_bytes([1; 12])) };
        assert_eq!(confirmation.known(), None);
        for (server, later) in [(alone, Some(alone)), (member, None)] {
            confirmation.learn(server);
            std::thread::sleep(2 * ELECTION_KNOWN);
            assert_eq!(confirmation.known(), later);
        }
    }
}
