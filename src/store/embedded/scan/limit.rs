//! How long reading may take.

use std::time::Instant;

use crate::deadline::{self, Ending};
use crate::query::QueryError;
use crate::store::StoreError;
use crate::store::embedded::Embedded;

/// After how many documents a long read looks whether it is to end.
const STRIDE: usize = 16;

impl Embedded {
    /// Refuses to go on reading where the time for it is over.
    pub(super) fn check_time(&self) -> Result<(), StoreError> {
        check_ending()?;
        match self.reads_until.get() {
            Some(until) if Instant::now() >= until => {
                Err(StoreError::Held { what: "what reads while writers wait takes too long".to_owned() })
            }
            _ => Ok(()),
        }
    }
}

/// Refuses to go on where the operation is to end.
pub(in crate::store::embedded) fn check_ending() -> Result<(), QueryError> {
    match deadline::ending() {
        Some(Ending::OutOfTime) => Err(QueryError::exceeded_time_limit()),
        Some(Ending::Stopped(code)) => Err(QueryError::interrupted(code)),
        None => Ok(()),
    }
}

/// The same, once in a while.
pub(super) fn check_ending_at(nth: usize) -> Result<(), QueryError> {
    if nth.is_multiple_of(STRIDE) { check_ending() } else { Ok(()) }
}
