//! The computables of a memory: which are registered, which are running, what the last operation computed.

use std::cell::{Cell, RefCell};
use std::collections::{HashMap, HashSet};
use std::sync::Arc;
use std::time::{Duration, Instant};

use bson::oid::ObjectId;
use bson::{DateTime, Document, RawDocumentBuf};

use super::alone::Once;
use super::definition::Definition;
use super::registry::{Computable, Registry};
use super::report::Computed;
use super::view::View;
use crate::store::Namespace;

/// How long a body without a limit is waited for by other processes, and how
/// long storing may take.
pub(super) const COMPUTE_TIMEOUT: Duration = Duration::from_secs(30);

/// The computables of a memory.
#[derive(Default)]
pub(in crate::memory) struct Computables {
    /// Those of the settings.
    pub(super) declared: Arc<Registry>,
    /// Those of each database that was asked, by its name.
    pub(super) kept: RefCell<HashMap<String, Kept>>,
    /// Those whose bodies are running, each for a query of the one before.
    pub(super) running: RefCell<Vec<Running>>,
    /// How many bodies have run.
    pub(super) runs: Cell<u64>,
    /// The computation that is a part of a write.
    pub(super) within: Cell<Option<Within>>,
    /// What was computed for queries that are being answered, and for them alone.
    pub(super) once: RefCell<Vec<Once>>,
    /// What was computed for the last operation.
    pub(super) computed: RefCell<Vec<Computed>>,
    /// What was warned of, which is not said again.
    warned: RefCell<HashSet<String>>,
    /// Where warnings go.
    warnings: RefCell<Option<Warnings>>,
    /// Whether all that the cache holds is seen.
    is_shown: Cell<bool>,
    /// How many operations were begun, and how many of them, each within the one before, are not over.
    operations: Cell<(u64, usize)>,
}

/// An operation, while it exists. What computables there are is read once in it, also by the bodies that run for it.
pub(in crate::memory) struct OperationScope<'a>(&'a Computables);

impl Drop for OperationScope<'_> {
    fn drop(&mut self) {
        let (begun, open) = self.0.operations.get();
        self.0.operations.set((begun, open.saturating_sub(1)));
    }
}

/// A computation within the transaction that stores what it makes: it may need no other one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Within {
    /// How many bodies were running before.
    pub(super) depth: usize,
    /// Whether it needed another one after all.
    pub(super) is_refused: bool,
}

/// Called with each warning, once.
pub type Warnings = Arc<dyn Fn(&str) + Send + Sync>;

/// The computables of a database: those of the settings, and those that it keeps.
pub(super) struct Kept {
    /// What is kept.
    pub(super) records: Vec<RawDocumentBuf>,
    pub(super) registry: Arc<Registry>,
    /// When the records were read.
    pub(super) read: Instant,
    /// In which operation they were read, if in one.
    pub(super) operation: Option<u64>,
    /// The state of the store in which they were read; see [`crate::store::Store::state`].
    pub(super) state: Option<(i64, u64)>,
}

/// A computable that a query needs.
pub(super) struct Wanted<'a> {
    pub(super) computable: Arc<Computable>,
    pub(super) query: &'a Document,
    pub(super) key: String,
}

impl<'a> Wanted<'a> {
    pub(super) fn new(computable: Arc<Computable>, query: &'a Document) -> Self {
        let key = computable.key(query);
        Self { computable, query, key }
    }
}

/// The other computables that a query needs, seen from one of them.
#[derive(Clone, Copy)]
pub(super) struct Others<'a> {
    /// The computations of those that ran before.
    pub(super) earlier: &'a [ObjectId],
    /// Those that run after it.
    pub(super) later: &'a [Wanted<'a>],
}

impl Others<'_> {
    /// How long those that run after it may take.
    pub(super) fn time(&self) -> Duration {
        let most = |wanted: &Wanted<'_>| wanted.computable.body.timeout().unwrap_or(COMPUTE_TIMEOUT);
        self.later.iter().map(most).fold(Duration::ZERO, Duration::saturating_add)
    }
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
    pub(in crate::memory) fn new(declared: Registry) -> Self {
        Self { declared: Arc::new(declared), ..Self::default() }
    }

    /// Says where warnings go.
    pub(in crate::memory) fn set_warnings(&self, warnings: Warnings) {
        *self.warnings.borrow_mut() = Some(warnings);
    }

    /// Warns, once.
    pub(super) fn warn(&self, message: &str) {
        if let Some(warnings) = &*self.warnings.borrow()
            && self.warned.borrow_mut().insert(message.to_owned())
        {
            warnings(message);
        }
    }

    /// Shows all that the cache holds, or only what was computed for an operation.
    pub(in crate::memory) fn show(&self, is_shown: bool) {
        self.is_shown.set(is_shown);
    }

    /// What was computed, or found in the cache, for the last operation.
    pub(in crate::memory) fn computed(&self) -> Vec<Computed> {
        self.computed.borrow().clone()
    }

    /// Begins an operation, or a part of one.
    pub(in crate::memory) fn operate(&self) -> OperationScope<'_> {
        let (begun, open) = self.operations.get();
        self.operations.set((begun + u64::from(open == 0), open + 1));
        OperationScope(self)
    }

    /// The operation that is not over.
    pub(super) fn operation(&self) -> Option<u64> {
        let (begun, open) = self.operations.get();
        (open > 0).then_some(begun)
    }

    /// Forgets what was computed for the last operation, unless this one is part of it.
    pub(in crate::memory) fn forget_last(&self) {
        if self.running.borrow().is_empty() {
            self.computed.borrow_mut().clear();
        }
    }

    /// Whether a computable runs after one whose body is running.
    pub(super) fn is_due(&self, definition: &Definition) -> bool {
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
