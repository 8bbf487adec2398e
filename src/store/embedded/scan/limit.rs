//! How long reading may take.

use std::time::Instant;

use crate::deadline;
use crate::query::QueryError;
use crate::store::StoreError;
use crate::store::embedded::Embedded;

impl Embedded {
    /// Refuses to go on reading where the time for it is over.
    pub(super) fn check_time(&self) -> Result<(), StoreError> {
        check_deadline()?;
        match self.reads_until.get() {
            Some(until) if Instant::now() >= until => {
                Err(StoreError::Held { what: "what reads while writers wait takes too long".to_owned() })
            }
            _ => Ok(()),
        }
    }
}

/// Refuses to go on where the operation has taken as long as it may.
pub(super) fn check_deadline() -> Result<(), StoreError> {
    match deadline::has_passed() {
        true => Err(QueryError::exceeded_time_limit().into()),
        false => Ok(()),
    }
}
