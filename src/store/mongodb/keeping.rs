//! Which histories this process keeps on a server, and how it signs (`history`).

use std::collections::HashSet;
use std::sync::{Mutex, MutexGuard, PoisonError};

use bson::Document;

use crate::store::history::next_run;
use crate::store::{HistoryRule, Namespace};

/// The histories that this process keeps, and how it signs.
#[derive(Default)]
pub(super) struct Keeping {
    pub(super) rules: Vec<HistoryRule>,
    pub(super) author: String,
    pub(super) run: i64,
    /// The collections whose recording has begun.
    pub(super) begun: HashSet<Namespace>,
    /// Whether a write is being recorded, of which another is a part.
    pub(super) is_recording: bool,
    /// Why the last write, which was done, is not in the history, where that does not end by itself.
    pub(super) unrecorded: Option<String>,
}

/// At most so many signatures are owed: the oldest ones are let go of.
const MOST_OWED: usize = 10_000;

/// The signatures of changes that were made while they could not be recorded, of all stores of this process.
static OWED: Mutex<Vec<Owed>> = Mutex::new(Vec::new());

/// The signature of changes: once they are recorded, the entries of this filter get it.
pub(super) struct Owed {
    pub(super) address: String,
    pub(super) namespace: Namespace,
    pub(super) entries: Document,
    pub(super) signature: Document,
    /// Whether no entries of other clients' later changes can be among them.
    pub(super) is_exact: bool,
}

impl Owed {
    /// Takes out those of a collection.
    pub(super) fn take(address: &str, ns: &Namespace) -> Vec<Self> {
        let mut owed = Self::all();
        owed.extract_if(.., |owed| owed.address == address && owed.namespace == *ns).collect()
    }

    /// Notes them for the next time that changes are recorded.
    pub(super) fn keep(more: impl IntoIterator<Item = Self>) {
        let mut owed = Self::all();
        owed.extend(more.into_iter().filter(|more| more.is_exact));
        let surplus = owed.len().saturating_sub(MOST_OWED);
        owed.drain(..surplus);
    }

    fn all() -> MutexGuard<'static, Vec<Self>> {
        OWED.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Keeping {
    pub(super) fn sign(&mut self, author: &str) {
        author.clone_into(&mut self.author);
        self.run = next_run();
    }
}
