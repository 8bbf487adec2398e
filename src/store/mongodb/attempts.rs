//! Trying again what other clients came in between.

use std::time::Duration;

use bson::Document;

use super::MongoDb;
use super::named::has_operator;
use crate::deadline::{self, Ending};
use crate::interrupt::stops_work;
use crate::query::{QueryError, random_up_to};
use crate::store::StoreError;

/// How often something is tried.
const ATTEMPTS: u32 = 64;
/// How long one waits behind the second attempt; behind each one more, so much longer.
const PAUSE: Duration = Duration::from_micros(200);
/// The most documents of which one is chosen.
const MOST_CHOICES: u32 = 64;

impl MongoDb {
    /// Does what gives nothing where other clients changed a document meanwhile, until it gives something. It is told the
    /// number of the attempt.
    ///
    /// # Errors
    /// Where it fails, or others are always faster.
    pub(super) fn in_attempts<T>(
        &self,
        mut work: impl FnMut(u32) -> Result<Option<T>, StoreError>,
    ) -> Result<T, StoreError> {
        for attempt in 0..ATTEMPTS {
            if let Some(done) = work(attempt)? {
                return Ok(done);
            }
            check_going_on(0)?;
            std::thread::sleep(PAUSE * attempt);
        }
        let reason = format!("other clients changed the document {ATTEMPTS} times between finding and changing it");
        Err(StoreError::Failed { address: self.address.clone(), reason })
    }
}

/// Refuses to go on where the operation is to end, after `done` changes.
pub(super) fn check_going_on(done: u64) -> Result<(), StoreError> {
    if stops_work() {
        return Err(StoreError::Interrupted { done });
    }
    match deadline::ending() {
        Some(Ending::OutOfTime) => Err(StoreError::from(QueryError::exceeded_time_limit()).after(done)),
        Some(Ending::Stopped(code)) => Err(StoreError::from(QueryError::interrupted(code)).after(done)),
        None => Ok(()),
    }
}

/// One of the matches.
pub(super) fn any_of<T>(mut matches: Vec<T>) -> Option<T> {
    let last = matches.len().checked_sub(1)?;
    Some(matches.swap_remove(random_up_to(last)))
}

/// Of how many matches one is taken, where any will do: with each attempt of more, so that clients get out of each other's way.
pub(super) fn choices(filter: &Document, attempt: u32) -> u64 {
    if has_order(filter) {
        return 1;
    }
    u64::from(1u32.checked_shl(attempt).map_or(MOST_CHOICES, |choices| choices.min(MOST_CHOICES)))
}

/// Whether the first match is the nearest one.
fn has_order(filter: &Document) -> bool {
    has_operator(filter, &["$near", "$nearSphere", "$geoNear"])
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::doc;

    #[test]
    fn others_are_chosen_where_no_match_is_the_first() {
        let free = doc! { "free": true, "near": "$near" };
        assert_eq!([0, 1, 3, 9, 60].map(|attempt| choices(&free, attempt)), [1, 2, 8, 64, 64]);
        for nearest in [
            doc! { "free": true, "at": { "$near": [1, 2] } },
            doc! { "$and": [{ "free": true }, { "at": { "$nearSphere": [1, 2], "$maxDistance": 1 } }] },
            doc! { "at": { "$geoNear": [1, 2] } },
        ] {
            assert_eq!(choices(&nearest, 9), 1, "{nearest}");
        }
    }
}
