//! Scanning a collection or an index, page by page.
//!
//! Each page is a statement of its own that goes on after the last position.
//! So a slow reader holds no read transaction, which would keep
//! the write-ahead log growing; memory stays flat; and an answer may be read
//! while the same store writes. A document is seen at most once, in the state
//! it has when its page is read, as with MongoDB's cursors; what is stored
//! after the scan began is not seen, so that it ends. In an index, writers
//! move documents, so its first page and the positions of the rest are read in one
//! transaction.

mod choose;
mod examined;
mod found;
mod limit;
mod listing;
mod paging;
mod read;
mod second_thread;
mod sharing;

use std::collections::VecDeque;
use std::rc::Rc;
use std::sync::Arc;

use super::Embedded;
use super::access::Listing;
use super::catalog::Collection;
use crate::query::Filter;
use crate::store::StoreError;
use found::PAGE_DOCUMENTS;
use sharing::Sharing;

pub(super) use choose::sharpen;
pub(super) use examined::Examined;
pub(super) use found::Found;
pub(super) use limit::check_ending;

/// Documents of a collection that match.
pub(super) struct Scan<'a> {
    store: &'a Embedded,
    collection: Collection,
    filter: Arc<Filter>,
    rest: Rest,
    /// What listed the positions that are read now, until a document was missing there and the lists were looked through.
    listings: Vec<Listing>,
    page: VecDeque<Found>,
    /// Whether matches before a document at which the filter fails are found first.
    is_up_to_failure: bool,
    /// That failure, until they are.
    failure: Option<StoreError>,
    page_documents: usize,
    /// Whether it looks at all documents, and how many there should be is still to be looked at.
    is_whole: bool,
    /// More matches than this are not asked for.
    most: usize,
    is_sorted: bool,
    examined: Rc<Examined>,
    sharing: Sharing,
}

/// What has not been looked at.
enum Rest {
    /// The documents behind a position, up to another.
    Between(i64, i64),
    /// The documents at these positions.
    At(VecDeque<i64>),
    /// The documents that an index lists, in its order.
    Listed(Listing),
    /// What the second thread has read.
    Ahead,
    Nothing,
}

/// Whether a page has room for more.
type More = bool;

impl Scan<'_> {
    /// The same matches, of which a second thread may read a part; not for what writes while it reads.
    pub(super) fn shared(self) -> Self {
        Self { sharing: Sharing::where_long(false), ..self }
    }

    /// The same matches, those before a document at which the filter fails among them: for what changes one after the other.
    pub(super) fn up_to_failure(self) -> Self {
        Self { is_up_to_failure: true, ..self }
    }

    /// The same matches, of which no more than so many are asked for.
    pub(super) fn at_most(self, most: usize) -> Self {
        let page_documents = if most == usize::MAX { self.page_documents } else { most.clamp(1, PAGE_DOCUMENTS) };
        Self { most, page_documents, ..self }
    }

    /// The parts of indexes that list them, before anything is read.
    pub(super) fn listings(&self) -> impl Iterator<Item = &Listing> {
        let listed = if let Rest::Listed(listing) = &self.rest { Some(listing) } else { None };
        listed.into_iter().chain(&self.listings)
    }

    /// Whether no index finds the matches.
    pub(super) fn looks_at_all(&self) -> bool {
        self.is_whole
    }

    /// Whether the matches come in the order of the sort.
    pub(super) fn in_order(&self) -> bool {
        self.is_sorted
    }

    /// What is looked at, counted as it is.
    pub(super) fn examined(&self) -> Rc<Examined> {
        Rc::clone(&self.examined)
    }
}
