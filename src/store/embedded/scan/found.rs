//! Documents that a scan has found.

use std::collections::VecDeque;

use bson::RawDocumentBuf;

use crate::store::key_options::RECORD_ID;

/// The most documents in a page.
pub(super) const PAGE_DOCUMENTS: usize = 512;

/// A stored document and where it is.
pub(in crate::store::embedded) struct Found {
    pub(in crate::store::embedded) position: i64,
    pub(in crate::store::embedded) body: RawDocumentBuf,
}

impl Found {
    /// The document with its place in the collection, where MongoDB shows it.
    pub(in crate::store::embedded) fn with_position(mut self) -> RawDocumentBuf {
        self.body.append(RECORD_ID, self.position);
        self.body
    }
}

/// Matches that were read at once.
#[derive(Default)]
pub(super) struct Page {
    pub(super) found: VecDeque<Found>,
    /// How many matches there are, where they are only counted.
    pub(super) number: u64,
    /// How many documents were looked at.
    pub(super) documents: u64,
    /// Whether it is the last page of its stretch.
    pub(super) is_last: bool,
    pub(super) first: Option<i64>,
    pub(super) next: Option<i64>,
}
