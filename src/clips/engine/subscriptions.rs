//! The subscriptions of one run.

use std::cell::{Cell, RefCell};

use crate::memory::watch::Watch;
use crate::store::Namespace;

/// A subscriber to changes.
#[derive(Debug, Clone)]
pub(super) enum Subscriber {
    /// A trigger, by its number and name.
    Trigger(u64, String),
    /// The shared world model.
    WorldModel,
    /// The world model of executives.
    WmFacts,
}

pub(super) struct Subscription<'m> {
    pub(super) subscriber: Subscriber,
    pub(super) namespace: Namespace,
    pub(super) watch: Watch<'m>,
    /// Whether the store is lost, which was reported.
    pub(super) lost: bool,
}

/// All subscriptions.
#[derive(Default)]
pub(super) struct Subscriptions<'m> {
    pub(super) all: RefCell<Vec<Subscription<'m>>>,
    /// Triggers that were destroyed.
    pub(super) ended: RefCell<Vec<u64>>,
    pub(super) number: Cell<u64>,
    /// How many there are; `all` is empty while they are polled.
    pub(super) count: Cell<usize>,
    pub(super) resting: Cell<bool>,
}
