//! The computables of a memory: which are registered, which are running, what the last operation computed.

use std::cell::RefCell;

use bson::{DateTime, Document};

use super::definition::Definition;
use super::key;
use super::registry::{Computable, Registry};
use super::report::Computed;
use super::view::View;
use crate::store::{Namespace, StoreError};

/// The computables of a memory at work.
#[derive(Default)]
pub(in crate::memory) struct Computables {
    pub(super) registry: Registry,
    /// Those whose bodies are at work, each for what the one before asked.
    pub(super) running: RefCell<Vec<Running>>,
    /// What was done for the last operation.
    pub(super) told: RefCell<Vec<Computed>>,
}

/// A computable that a query needs.
pub(super) struct Wanted<'a> {
    pub(super) computable: &'a Computable,
    pub(super) query: &'a Document,
    pub(super) key: String,
}

/// A computable whose body is at work.
pub(super) struct Running {
    pub(super) name: String,
    pub(super) namespace: Namespace,
    pub(super) key: String,
    /// Those of the namespace that are due after it for the same question: what its body
    /// asks does not run them, for it is they who see what it gives.
    pub(super) later: Vec<String>,
}

impl Computables {
    pub(in crate::memory) fn new(registry: Registry) -> Self {
        Self { registry, ..Self::default() }
    }

    /// What was computed, or found in the cache, for the last operation.
    pub(in crate::memory) fn told(&self) -> Vec<Computed> {
        self.told.borrow().clone()
    }

    /// All that the questions need, in the order in which it runs.
    pub(super) fn wanted<'a>(
        &'a self,
        questions: &[(&Namespace, &'a Document)],
    ) -> Result<Vec<Wanted<'a>>, StoreError> {
        let mut wanted: Vec<Wanted<'a>> = Vec::new();
        for (ns, query) in questions {
            for computable in self.registry.matching(ns, query)? {
                let key = key::of(&computable.definition, query);
                if !wanted.iter().any(|other| other.key == key) && !self.is_due(&computable.definition) {
                    wanted.push(Wanted { computable, query, key });
                }
            }
        }
        wanted.sort_by_key(|wanted| std::cmp::Reverse(wanted.computable.definition.priority));
        Ok(wanted)
    }

    /// Whether a computable is due after one whose body is at work.
    fn is_due(&self, definition: &Definition) -> bool {
        let running = self.running.borrow();
        running.iter().any(|at| at.namespace == definition.namespace && at.later.contains(&definition.name))
    }

    /// What is visible now to a body at work, or to anybody else.
    pub(super) fn view(&self, now: DateTime) -> View {
        let mut view = View::at(now);
        for running in self.running.borrow().iter() {
            view.limit(&running.namespace, &running.name);
            running.later.iter().for_each(|name| view.limit(&running.namespace, name));
        }
        view
    }
}
