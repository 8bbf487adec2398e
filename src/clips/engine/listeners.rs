//! The subscriptions of one run.

use std::cell::{Cell, RefCell};

use crate::memory::watch::Watch;
use crate::store::Namespace;

/// Who wants to hear of changes.
#[derive(Debug, Clone)]
pub(super) enum Who {
    /// A trigger, by its number and name.
    Trigger(u64, String),
    /// The shared world model.
    WorldModel,
}

pub(super) struct Listener<'m> {
    pub(super) who: Who,
    pub(super) namespace: Namespace,
    pub(super) watch: Watch<'m>,
    /// Whether the store is lost, which was said.
    pub(super) lost: bool,
}

/// All that is followed.
#[derive(Default)]
pub(super) struct Listening<'m> {
    pub(super) listeners: RefCell<Vec<Listener<'m>>>,
    /// Triggers that are no more.
    pub(super) ended: RefCell<Vec<u64>>,
    pub(super) number: Cell<u64>,
    /// Whether there is anything to follow; the listeners may be away while they are asked.
    pub(super) count: Cell<usize>,
    pub(super) resting: Cell<bool>,
}
