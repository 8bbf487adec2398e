//! Collections that wait to take the place of others.
//!
//! They are called `restoring_HOLDER_ID`. The holder is the process that fills them, so that
//! collections of a killed process are recognised and removed.

use std::time::Duration;

use bson::DateTime;
use bson::oid::ObjectId;

use crate::memory::Memory;
use crate::process::holder::{Holder, Life};
use crate::query::object_id;
use crate::store::{Namespace, StoreError};

const PREFIX: &str = "restoring_";

/// When the collections of a process that cannot be seen from here are removed.
const OLD: Duration = Duration::from_secs(24 * 3600);

/// A new name for a collection that waits, in the database of `namespace`.
pub(super) fn name(namespace: &Namespace) -> Namespace {
    let holder = Holder::myself().to_string().replace(' ', "_");
    let collection = format!("{PREFIX}{holder}_{}", object_id::new().to_hex());
    Namespace { database: namespace.database.clone(), collection }
}

/// Removes what restores that were killed have left in the databases of these collections.
pub(super) fn sweep(memory: &Memory, namespaces: &[&Namespace]) -> Result<(), StoreError> {
    for found in memory.collections()? {
        let is_near = namespaces.iter().any(|ns| ns.database == found.database);
        if is_near && is_litter(&found.collection) {
            memory.drop_collection(&found)?;
        }
    }
    Ok(())
}

fn is_litter(collection: &str) -> bool {
    let parts = collection.strip_prefix(PREFIX).and_then(|rest| rest.rsplit_once('_'));
    let Some((holder, id)) = parts else { return false };
    let (Ok(holder), Ok(id)) = (holder.replace('_', " ").parse::<Holder>(), ObjectId::parse_str(id)) else {
        return false;
    };
    match holder.life() {
        Life::Over => true,
        Life::Running => false,
        Life::Unseen | Life::Elsewhere => {
            let age = DateTime::now().timestamp_millis() - id.timestamp().timestamp_millis();
            u64::try_from(age).is_ok_and(|age| Duration::from_millis(age) > OLD)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_collections_of_ended_processes_are_litter() {
        let mine = name(&Namespace::parse("a.b").unwrap()).collection;
        assert!(!is_litter(&mine));
        let (holder, id) = mine.rsplit_once('_').unwrap();
        let (process, _) = holder.rsplit_once('_').unwrap();
        // The same process id, started at another time.
        assert!(is_litter(&format!("{process}_1_{id}")));
        let elsewhere = format!("{PREFIX}another_pid:[1]_1_1");
        assert!(!is_litter(&format!("{elsewhere}_{id}")));
        assert!(is_litter(&format!("{elsewhere}_{}", "0".repeat(24))));
        assert!(!is_litter("restoring_blocks") && !is_litter("blocks"));
    }
}
