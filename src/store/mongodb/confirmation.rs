//! Who is to confirm writes: what the URI says, and what a client asks (`writeConcern`).

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use bson::oid::ObjectId;
use bson::{Bson, Document};
use mongodb::options::{Acknowledgment, WriteConcern};

use crate::query::QueryError;

/// How long it is taken for known which election made the primary.
const KNOWN: Duration = Duration::from_secs(5);

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
pub(super) struct Postponed<'c>(&'c AtomicBool);

impl Drop for Postponed<'_> {
    fn drop(&mut self) {
        self.0.store(false, Ordering::Relaxed);
    }
}

impl Confirmation {
    pub(super) fn new(least: WriteConcern, is_shared: bool) -> Self {
        Self { least, is_shared, is_postponed: AtomicBool::default(), election: Mutex::default() }
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
            Asked::Nobody if !self.is_shared => Ok(Vec::new()),
            _ if !self.is_shared => Ok(vec![asked.clone()]),
            members => {
                least.extend(asked.get("wtimeout").map(|limit| ("wtimeout".to_owned(), limit.clone())));
                let more = (members == Asked::Others).then(|| asked.clone());
                Ok(std::iter::once(least).chain(more).collect())
            }
        }
    }

    pub(super) fn known(&self) -> Option<Option<ObjectId>> {
        let election = *self.election.lock().unwrap_or_else(PoisonError::into_inner);
        election.filter(|(since, _)| since.elapsed() < KNOWN).map(|(_, election)| election)
    }

    pub(super) fn learn(&self, election: Option<ObjectId>) {
        *self.election.lock().unwrap_or_else(PoisonError::into_inner) = Some((Instant::now(), election));
    }
}

/// Who is to confirm a write.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Asked {
    Nobody,
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
        0 if concern.get("j") != Some(&Bson::Boolean(true)) => Asked::Nobody,
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
}
