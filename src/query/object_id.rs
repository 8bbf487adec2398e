//! New ObjectIds, whatever the clock says.
//!
//! As MongoDB's specification has them: seconds since 1970 (4 bytes), a random number of the process (5),
//! a counter that begins at random (3). The driver's own constructor panics before 1970 and after 2106.

use std::hash::{BuildHasher as _, Hasher as _, RandomState};
use std::sync::LazyLock;
use std::sync::atomic::{AtomicU32, Ordering};

use bson::DateTime;
use bson::oid::ObjectId;

static PROCESS: LazyLock<u64> = LazyLock::new(random);
static COUNTER: LazyLock<AtomicU32> = LazyLock::new(|| AtomicU32::new(random() as u32));

fn random() -> u64 {
    let mut hasher = RandomState::new().build_hasher();
    hasher.write_u32(std::process::id());
    hasher.finish()
}

/// Returns a new ObjectId.
#[must_use]
pub fn new() -> ObjectId {
    at(DateTime::now())
}

/// An ObjectId of a time; the seconds wrap in 2106, and are 0 before 1970.
fn at(time: DateTime) -> ObjectId {
    let seconds = u64::try_from(time.timestamp_millis() / 1_000).unwrap_or(0);
    let [.., s0, s1, s2, s3] = seconds.to_be_bytes();
    let [p0, p1, p2, p3, p4, ..] = PROCESS.to_be_bytes();
    let [_, c0, c1, c2] = COUNTER.fetch_add(1, Ordering::Relaxed).to_be_bytes();
    ObjectId::from_bytes([s0, s1, s2, s3, p0, p1, p2, p3, p4, c0, c1, c2])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_new_at_any_time() {
        let times = [i64::MIN, -1, 0, 1_800_000_000_000, 4_294_967_296_000, i64::MAX];
        let mut ids: Vec<ObjectId> = times.iter().flat_map(|time| [at(DateTime::from_millis(*time)); 1]).collect();
        ids.extend((0..1_000).map(|_| new()));
        let count = ids.len();
        ids.sort_unstable();
        ids.dedup();
        assert_eq!(ids.len(), count);
        assert_eq!(at(DateTime::from_millis(1_800_000_000_000)).timestamp().timestamp_millis(), 1_800_000_000_000);
    }
}
