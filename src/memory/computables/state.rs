//! The computables of a memory: which are registered, which are running, what the last operation computed.

use std::cell::{Cell, RefCell};

use bson::oid::ObjectId;
use bson::{DateTime, Document};

use super::definition::Definition;
use super::key;
use super::registry::{Computable, Registry};
use super::report::Computed;
use super::view::View;
use crate::store::{Namespace, StoreError};

/// The computables of a memory.
#[derive(Default)]
pub(in crate::memory) struct Computables {
    pub(super) registry: Registry,
    /// Those whose bodies are running, each for a query of the one before.
    pub(super) running: RefCell<Vec<Running>>,
    /// What was computed for the last operation.
    pub(super) computed: RefCell<Vec<Computed>>,
    /// Whether all that the cache holds is seen.
    is_shown: Cell<bool>,
}

/// A computable that a query needs.
pub(super) struct Wanted<'a> {
    pub(super) computable: &'a Computable,
    pub(super) query: &'a Document,
    pub(super) key: String,
}

/// The other computables that a query needs, seen from one of them.
#[derive(Clone, Copy)]
pub(super) struct Others<'a> {
    /// The computations of those that ran before.
    pub(super) earlier: &'a [ObjectId],
    /// Those that run after it.
    pub(super) later: &'a [Wanted<'a>],
}

/// A computable whose body is running.
pub(super) struct Running {
    pub(super) name: String,
    pub(super) namespace: Namespace,
    pub(super) key: String,
    /// Those of the namespace that run after it for the same query. A query of its body does
    /// not run them: they see its documents, and not the other way round.
    pub(super) later: Vec<String>,
    /// The computations of those that ran before it for the same query.
    pub(super) earlier: Vec<ObjectId>,
}

impl Computables {
    pub(in crate::memory) fn new(registry: Registry) -> Self {
        Self { registry, ..Self::default() }
    }

    /// Shows all that the cache holds, or only what was computed for an operation.
    pub(in crate::memory) fn show(&self, is_shown: bool) {
        self.is_shown.set(is_shown);
    }

    /// What was computed, or found in the cache, for the last operation.
    pub(in crate::memory) fn computed(&self) -> Vec<Computed> {
        self.computed.borrow().clone()
    }

    /// All that the questions need, in the order in which it runs.
    pub(super) fn wanted<'a>(
        &'a self,
        questions: &[(&Namespace, &'a Document)],
    ) -> Result<Vec<Wanted<'a>>, StoreError> {
        let mut wanted: Vec<Wanted<'a>> = Vec::new();
        for (ns, query) in questions {
            let documents = self.registry.matching(ns, query)?.into_iter();
            for computable in documents.filter(|computable| computable.definition.adds.is_none()) {
                let key = key::of(&computable.definition, query);
                if !wanted.iter().any(|other| other.key == key) && !self.is_due(&computable.definition) {
                    wanted.push(Wanted { computable, query, key });
                }
            }
        }
        wanted.sort_by_key(|wanted| std::cmp::Reverse(wanted.computable.definition.priority));
        Ok(wanted)
    }

    /// The computables that add keys to what a query asks for, in the order in which they run.
    pub(super) fn adding<'a>(&'a self, ns: &Namespace, query: &'a Document) -> Result<Vec<Wanted<'a>>, StoreError> {
        let adding = self.registry.matching(ns, query)?.into_iter();
        let adding = adding.filter(|computable| computable.definition.adds.is_some());
        Ok(adding.map(|computable| Wanted { computable, query, key: key::of(&computable.definition, query) }).collect())
    }

    /// Whether a computable runs after one whose body is running.
    fn is_due(&self, definition: &Definition) -> bool {
        let running = self.running.borrow();
        running.iter().any(|at| at.namespace == definition.namespace && at.later.contains(&definition.name))
    }

    /// What is visible now, to a running body or to an application.
    pub(in crate::memory) fn view(&self, now: DateTime) -> View {
        if self.is_shown.get() {
            return View::with_computed(now);
        }
        let mut view = View::at(now);
        for token in self.running.borrow().iter().flat_map(|running| &running.earlier) {
            view.allow(*token);
        }
        view
    }
}
