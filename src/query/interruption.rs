//! Whether work is to end before it is done. Who runs queries says how that is seen; loops look between their steps.

use std::sync::OnceLock;

use super::error::Result;

/// Fails where the work of the thread that calls it is to end.
type Check = fn() -> Result<()>;

static CHECK: OnceLock<Check> = OnceLock::new();

/// Has all work in this process look whether it is to end; the first check stays.
pub fn look_at(check: Check) {
    // Whoever was first has said the same.
    let _ = CHECK.set(check);
}

/// Fails where the work of this thread is to end.
pub(super) fn check() -> Result<()> {
    CHECK.get().map_or(Ok(()), |check| check())
}
