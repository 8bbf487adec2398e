//! Which members have to confirm the writes of a store: what its URI says, and what a client asks (`writeConcern`).

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use bson::Document;
use bson::oid::ObjectId;
use mongodb::options;

use crate::query::QueryError;
use crate::store::{Acknowledgment, WriteConcern};

/// How long it is taken for known that the server is no member of a replica set.
const KNOWN: Duration = Duration::from_secs(5);
/// The same for which election made the primary: shorter than any election takes, so that one is not taken for an election
/// during a write that was before it.
const ELECTION_KNOWN: Duration = Duration::from_millis(20);

/// Which members have to confirm the writes of a store.
pub(super) struct WritePolicy {
    /// What the URI says, completed.
    least: options::WriteConcern,
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
    pub(super) fn check(self, asked: Option<&WriteConcern>) -> Result<(), QueryError> {
        let asked = asked.filter(|_| !self.is_replicated).map(|asked| &asked.acknowledgment);
        match asked {
            Some(Acknowledgment::Mode(mode)) => Err(QueryError::bad_value(format!(
                "cannot use non-majority 'w' mode \"{mode}\" when a host is not a member of a replica set"
            ))),
            Some(Acknowledgment::Several) => {
                Err(QueryError::bad_value("cannot use 'w' > 1 when a host is not replicated"))
            }
            // It takes tags of members.
            Some(Acknowledgment::Tagged | Acknowledgment::Usual | Acknowledgment::Unacknowledged) | None => Ok(()),
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

impl WritePolicy {
    pub(super) fn new(least: options::WriteConcern, is_shared: bool) -> Self {
        Self { least, is_shared, is_postponed: AtomicBool::default(), member: Mutex::default() }
    }

    /// The write concern of a single write.
    pub(super) fn of_one(&self) -> options::WriteConcern {
        match self.is_postponed() {
            true => options::WriteConcern::builder().w(options::Acknowledgment::Nodes(1)).build(),
            false => self.least.clone(),
        }
    }

    pub(super) fn is_postponed(&self) -> bool {
        self.is_postponed.load(Ordering::Relaxed)
    }

    pub(super) fn postpone(&self) -> Postponed<'_> {
        self.is_postponed.store(true, Ordering::Relaxed);
        Postponed(&self.is_postponed)
    }

    /// The write concerns that have to be met for what a client asks.
    pub(super) fn needed(&self, asked: Option<&WriteConcern>) -> Result<Vec<Document>, QueryError> {
        let mut least = bson::serialize_to_document(&self.least)?;
        let Some(asked) = asked.filter(|asked| !asked.document.is_empty()) else { return Ok(vec![least]) };
        match asked.acknowledgment {
            Acknowledgment::Unacknowledged if !self.is_shared => Ok(Vec::new()),
            _ if !self.is_shared => Ok(vec![asked.document.clone()]),
            ref members => {
                let limit = asked.document.get("wtimeout");
                least.extend(limit.map(|limit| ("wtimeout".to_owned(), limit.clone())));
                let is_less = matches!(members, Acknowledgment::Unacknowledged | Acknowledgment::Usual);
                let more = (!is_less).then(|| asked.document.clone());
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

#[cfg(test)]
mod tests {
    use super::*;
    use bson::doc;

    fn asked(acknowledgment: Acknowledgment, document: Document) -> WriteConcern {
        WriteConcern { acknowledgment, document }
    }

    /// Write concerns that ask for more than a majority.
    fn more() -> [WriteConcern; 3] {
        [
            asked(Acknowledgment::Several, doc! { "w": 3 }),
            asked(Acknowledgment::Mode("far".to_owned()), doc! { "w": "far" }),
            asked(Acknowledgment::Tagged, doc! { "w": { "place": 2 } }),
        ]
    }

    #[test]
    fn a_shared_store_waits_for_a_majority_whatever_less_is_asked() {
        let least = options::WriteConcern::builder().w(options::Acknowledgment::Majority).journal(true).build();
        let needed =
            |is_shared, asked: &WriteConcern| WritePolicy::new(least.clone(), is_shared).needed(Some(asked)).unwrap();
        let majority = doc! { "w": "majority", "j": true };
        let none = asked(Acknowledgment::Unacknowledged, doc! { "w": 0 });
        let usual = |document: Document| asked(Acknowledgment::Usual, document);
        let documents = [doc! {}, doc! { "w": 1 }, doc! { "w": "majority" }, doc! { "j": false }];
        for less in documents.map(usual).iter().chain([&none]) {
            assert_eq!(needed(true, less), std::slice::from_ref(&majority), "{less:?}");
        }
        let timed = doc! { "w": "majority", "j": true, "wtimeout": 5 };
        assert_eq!(needed(true, &usual(doc! { "w": 1, "wtimeout": 5 })), [timed]);
        for more in more() {
            assert_eq!(needed(true, &more), [majority.clone(), more.document.clone()]);
            assert_eq!(needed(false, &more), [more.document]);
        }
        assert_eq!(needed(false, &usual(doc! { "w": 1 })), [doc! { "w": 1 }]);
        assert_eq!(needed(false, &none), [] as [Document; 0]);
        assert_eq!(needed(false, &usual(doc! {})), [majority]);
    }

    #[test]
    fn a_server_without_others_refuses_to_wait_for_them() {
        let alone = Member { is_replicated: false, election: None };
        let member = Member { is_replicated: true, election: Some(ObjectId::from_bytes([1; 12])) };
        let code = |asked: &WriteConcern| alone.check(Some(asked)).map_err(|error| error.code).err();
        let [several, mode, tagged] = more();
        for refused in [several, mode] {
            assert_eq!(code(&refused), Some(2), "{refused:?}");
            assert_eq!(member.check(Some(&refused)), Ok(()));
        }
        let usual = asked(Acknowledgment::Usual, doc! { "w": 1 });
        let none = asked(Acknowledgment::Unacknowledged, doc! { "w": 0 });
        for taken in [tagged, usual, none] {
            assert_eq!(code(&taken), None, "{taken:?}");
        }
    }

    #[test]
    fn an_election_is_known_for_a_moment_only() {
        let policy = WritePolicy::new(options::WriteConcern::default(), false);
        let alone = Member { is_replicated: false, election: None };
        let member = Member { is_replicated: true, election: Some(ObjectId::from_bytes([1; 12])) };
        assert_eq!(policy.known(), None);
        for (server, later) in [(alone, Some(alone)), (member, None)] {
            policy.learn(server);
            std::thread::sleep(2 * ELECTION_KNOWN);
            assert_eq!(policy.known(), later);
        }
    }
}
