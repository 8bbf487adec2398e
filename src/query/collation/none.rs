//! No collator: this rmem is built without the feature `collation`.

use std::cmp::Ordering;

use super::options::Options;
use crate::query::error::{QueryError, Result};

/// A collator that cannot be made.
#[derive(Debug)]
pub(super) enum Collator {}

impl Collator {
    pub(super) fn new(options: &Options) -> Result<Self> {
        let mut refusal = QueryError::unsupported("collation");
        refusal.message = format!(
            "the collation {} needs an rmem with the feature `collation`: build it with --features collation",
            options.definition()
        );
        Err(refusal)
    }

    pub(super) fn options(&self) -> &Options {
        match *self {}
    }

    pub(super) fn compare(&self, _: &str, _: &str) -> Ordering {
        match *self {}
    }

    pub(super) fn sort_key(&self, _: &str) -> Vec<u8> {
        match *self {}
    }
}
