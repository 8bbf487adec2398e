//! Names of collections that are filled beside others and then take their places.
//!
//! They are called `PREFIX_HOLDER_ID`. The holder is the process that fills them, so that
//! collections of a killed process are recognised and removed.

use std::time::Duration;

use bson::DateTime;
use bson::oid::ObjectId;

use super::Namespace;
use crate::process::holder::{Holder, Life};
use crate::query::object_id;

/// The prefix of what a restore fills: a collection of rmem's own, which no list shows and no watch reports.
pub const RESTORE: &str = "rmem.restoring_";
/// The prefix of what `$out` fills, the same.
pub const OUT: &str = "rmem.out_";

/// The age at which the collections of a process that cannot be seen from here are removed: no restore is expected to
/// take a day.
const MAX_AGE: Duration = Duration::from_secs(24 * 3600);

/// A new name for a collection that waits, in the database of `namespace`.
#[must_use]
pub fn name(prefix: &str, namespace: &Namespace) -> Namespace {
    let holder = Holder::myself().to_string().replace(' ', "_");
    let collection = format!("{prefix}{holder}_{}", object_id::new().to_hex());
    Namespace { database: namespace.database.clone(), collection }
}

/// Whether a collection waits for a process that has ended.
#[must_use]
pub fn is_litter(prefix: &str, collection: &str) -> bool {
    let parts = collection.strip_prefix(prefix).and_then(|rest| rest.rsplit_once('_'));
    let Some((holder, id)) = parts else { return false };
    let (Ok(holder), Ok(id)) = (holder.replace('_', " ").parse::<Holder>(), ObjectId::parse_str(id)) else {
        return false;
    };
    match holder.life() {
        Life::Over => true,
        Life::Running => false,
        Life::Unseen | Life::Elsewhere => {
            let age = DateTime::now().timestamp_millis() - id.timestamp().timestamp_millis();
            u64::try_from(age).is_ok_and(|age| Duration::from_millis(age) > MAX_AGE)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_collections_of_ended_processes_are_litter() {
        for prefix in [RESTORE, OUT] {
            let mine = name(prefix, &Namespace::parse("a.b").unwrap()).collection;
            let is_litter = |collection: &str| is_litter(prefix, collection);
            assert!(!is_litter(&mine));
            let (holder, id) = mine.rsplit_once('_').unwrap();
            let (process, _) = holder.rsplit_once('_').unwrap();
            // The same process id, started at another time.
            assert!(is_litter(&format!("{process}_1_{id}")));
            let elsewhere = format!("{prefix}another_pid:[1]_1_1");
            assert!(!is_litter(&format!("{elsewhere}_{id}")));
            assert!(is_litter(&format!("{elsewhere}_{}", "0".repeat(24))));
            assert!(!is_litter(&format!("{prefix}blocks")) && !is_litter("blocks"));
        }
    }
}
