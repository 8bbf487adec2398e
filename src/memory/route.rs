//! Which store a database is in, and opening it when it is needed.

use std::cell::{Cell, OnceCell, RefCell};
use std::collections::BTreeMap;
use std::sync::Arc;

use crate::query::QueryError;
use crate::store::{self, Embedded, HistoryRule, Name, Namespace, Role, Scope, Store, StoreError, StoreUri, Warn};

/// A store that is opened by its first use.
pub(super) struct Lazy {
    uri: Option<StoreUri>,
    role: Role,
    store: OnceCell<Box<dyn Store>>,
    /// What is read as long as there is no file.
    nothing: OnceCell<Box<dyn Store>>,
    /// Whether it is an error to read a file that is not there.
    expected: Cell<bool>,
    keeping: Box<RefCell<Keeping>>,
}

/// What the store gets once it is open: the histories it keeps, the author of its changes, who takes its warnings, and how much
/// it may keep of what was read.
#[derive(Default)]
struct Keeping {
    histories: Vec<HistoryRule>,
    author: String,
    cache: Option<usize>,
    warn: Option<Warn>,
}

impl Lazy {
    pub(super) fn at(uri: StoreUri, role: Role) -> Self {
        Self { uri: Some(uri), role, ..Self::empty() }
    }

    pub(super) fn open(store: Box<dyn Store>) -> Self {
        Self { store: OnceCell::from(store), ..Self::empty() }
    }

    fn empty() -> Self {
        Self {
            uri: None,
            role: Role::Local,
            store: OnceCell::new(),
            nothing: OnceCell::new(),
            expected: Cell::new(false),
            keeping: Box::default(),
        }
    }

    fn keep_history(&self, rules: &[HistoryRule]) {
        self.keeping.borrow_mut().histories = rules.to_vec();
        if let Some(store) = self.store.get() {
            store.keep_history(rules);
        }
    }

    fn sign(&self, author: &str) {
        match self.store.get() {
            Some(store) => store.sign(author),
            None => author.clone_into(&mut self.keeping.borrow_mut().author),
        }
    }

    fn warn_by(&self, warn: &Warn) {
        self.keeping.borrow_mut().warn = Some(Arc::clone(warn));
        if let Some(store) = self.store.get() {
            store.warn_by(Arc::clone(warn));
        }
    }

    fn limit_cache(&self, bytes: usize) -> Result<(), StoreError> {
        self.keeping.borrow_mut().cache = Some(bytes);
        self.store.get().map_or(Ok(()), |store| store.limit_cache(bytes))
    }

    /// Whether a server keeps the store.
    fn is_on_server(&self) -> bool {
        self.uri.as_ref().is_some_and(|uri| uri.path().is_none() && !uri.is_in_memory())
    }

    pub(super) fn get(&self) -> Result<&dyn Store, StoreError> {
        if let (None, Some(uri)) = (self.store.get(), &self.uri) {
            let opened = store::open(uri, self.role)?;
            let keeping = self.keeping.borrow();
            opened.keep_history(&keeping.histories);
            opened.sign(&keeping.author);
            if let Some(warn) = &keeping.warn {
                opened.warn_by(Arc::clone(warn));
            }
            keeping.cache.map_or(Ok(()), |bytes| opened.limit_cache(bytes))?;
            drop(keeping);
            // The cell is empty: nothing else of this thread can have filled it meanwhile.
            let _ = self.store.set(opened);
        }
        match self.store.get() {
            Some(store) => Ok(store.as_ref()),
            None => Err(StoreError::Failed { address: self.describe(), reason: "is not open".to_owned() }),
        }
    }

    /// The store for what stores nothing: a file that is not there yet is not
    /// made, and answers as an empty one, unless it is expected to be there.
    pub(super) fn reading(&self) -> Result<&dyn Store, StoreError> {
        if self.store.get().is_some() || !self.uri.as_ref().is_some_and(is_missing) {
            return self.get();
        }
        if self.expected.get() {
            return Err(StoreError::missing(self.describe()));
        }
        if self.nothing.get().is_none() {
            // The cell is empty: nothing else of this thread can have filled it meanwhile.
            let _ = self.nothing.set(Box::new(Embedded::in_memory()?));
        }
        self.nothing.get().map_or_else(|| self.get(), |nothing| Ok(nothing.as_ref()))
    }

    /// The store for reading; none where its file is not there.
    fn existing(&self) -> Result<Option<&dyn Store>, StoreError> {
        let path = self.uri.as_ref().and_then(StoreUri::path);
        match self.store.get().is_none() && path.is_some_and(|path| matches!(path.try_exists(), Ok(false))) {
            true => Ok(None),
            false => self.get().map(Some),
        }
    }

    pub(super) fn describe(&self) -> String {
        match (self.store.get(), &self.uri) {
            (Some(store), _) => store.describe(),
            (None, Some(uri)) => uri.to_string(),
            (None, None) => String::new(),
        }
    }
}

/// Whether there is no file at an address, but a folder for it.
fn is_missing(uri: &StoreUri) -> bool {
    let Some(path) = uri.path() else { return false };
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    matches!(path.try_exists(), Ok(false)) && folder.is_none_or(std::path::Path::is_dir)
}

/// The stores, and the databases that are shared.
pub(super) struct Routes {
    local: Lazy,
    shared: Option<Lazy>,
    shared_databases: Vec<String>,
}

impl Routes {
    /// Two stores; one where none is shared or both are the same.
    pub(super) fn new(local: Lazy, shared: Option<Lazy>, shared_databases: Vec<String>) -> Self {
        let shared = shared.filter(|shared| shared.uri.is_none() || shared.uri != local.uri);
        Self { local, shared, shared_databases }
    }

    /// To read a file that is not there is an error from now on.
    pub(super) fn expect(&self) {
        self.both().for_each(|lazy| lazy.expected.set(true));
    }

    /// Keeps these histories, and signs changes with a name.
    pub(super) fn keep_history(&self, rules: &[HistoryRule], author: &str) {
        self.both().for_each(|lazy| {
            lazy.keep_history(rules);
            lazy.sign(author);
        });
    }

    /// Gives the warnings of the stores to `warn`.
    pub(super) fn warn_by(&self, warn: &Warn) {
        self.both().for_each(|lazy| lazy.warn_by(warn));
    }

    /// Returns the rules of histories in force for the store of a collection.
    pub(super) fn histories(&self, ns: &Namespace) -> Vec<HistoryRule> {
        self.lazy(ns).keeping.borrow().histories.clone()
    }

    /// Signs the changes that follow.
    pub(super) fn sign(&self, author: &str) {
        self.both().for_each(|lazy| lazy.sign(author));
    }

    /// Limits how many bytes of what was read each store keeps in this process, once it is open.
    pub(super) fn limit_caches(&self, bytes: usize) -> Result<(), StoreError> {
        self.both().try_for_each(|lazy| lazy.limit_cache(bytes))
    }

    /// Frees the caches of the stores that are open.
    pub(super) fn free_caches(&self) {
        self.both().filter_map(|lazy| lazy.store.get()).for_each(|store| store.free_cache());
    }

    /// The store of a collection may be empty after all.
    pub(super) fn excuse(&self, ns: &Namespace) {
        self.lazy(ns).expected.set(false);
    }

    /// The store that a database is in.
    pub(super) fn of(&self, ns: &Namespace) -> Result<&dyn Store, StoreError> {
        self.lazy(ns).get()
    }

    /// The same for what stores nothing.
    pub(super) fn reading(&self, ns: &Namespace) -> Result<&dyn Store, StoreError> {
        self.lazy(ns).reading()
    }

    /// The store for a write: a file that is not there yet is made only where the write may insert.
    pub(super) fn writing(&self, ns: &Namespace, inserts: bool) -> Result<&dyn Store, StoreError> {
        if inserts { self.of(ns) } else { self.reading(ns) }
    }

    /// The store for reading; none where its file is not there.
    pub(super) fn existing(&self, ns: &Namespace) -> Result<Option<&dyn Store>, StoreError> {
        self.lazy(ns).existing()
    }

    /// Whether a server keeps the database.
    pub(super) fn is_on_server(&self, ns: &Namespace) -> bool {
        self.lazy(ns).is_on_server()
    }

    /// [`Routes::collections`], of stores that are there, and why one of them fails.
    pub(super) fn existing_collections(&self) -> (Vec<Namespace>, Result<(), StoreError>) {
        let (mut all, mut done) = (Vec::new(), Ok(()));
        for lazy in self.both() {
            let found = lazy.existing().and_then(|store| store.map_or(Ok(Vec::new()), |store| store.collections()));
            match found {
                Ok(found) => all.extend(found.into_iter().filter(|ns| std::ptr::eq(self.lazy(ns), lazy))),
                Err(error) => done = done.and(Err(error)),
            }
        }
        (all, done)
    }

    /// [`Routes::collections`], of the stores that no server keeps.
    pub(super) fn collections_in_files(&self) -> Result<Vec<Namespace>, StoreError> {
        self.listed(self.in_files())
    }

    /// [`Routes::collections`], of the private store and, where databases are in it, of the shared one: each with its address.
    pub(super) fn collections_by_store(&self) -> impl Iterator<Item = (String, Result<Vec<Namespace>, StoreError>)> {
        self.in_use().map(|lazy| (lazy.describe(), self.listed(std::iter::once(lazy))))
    }

    /// [`Routes::collections`], by database. Where the shared store cannot be reached, its databases are there without any.
    pub(super) fn databases(&self) -> Result<BTreeMap<String, Vec<Namespace>>, StoreError> {
        let mut found = self.listed(std::iter::once(&self.local))?;
        let mut databases: BTreeMap<String, Vec<Namespace>> = BTreeMap::new();
        match self.used().map(|shared| self.listed(std::iter::once(shared))) {
            Some(Err(StoreError::Unreachable { .. })) => {
                databases.extend(self.shared_databases.iter().map(|name| (name.clone(), Vec::new())));
            }
            Some(shared) => found.extend(shared?),
            None => {}
        }
        for ns in found {
            databases.entry(ns.database.clone()).or_default().push(ns);
        }
        Ok(databases)
    }

    /// The collections that belong to these stores, sorted.
    fn listed<'a>(&'a self, stores: impl Iterator<Item = &'a Lazy>) -> Result<Vec<Namespace>, StoreError> {
        let mut all = Vec::new();
        for lazy in stores {
            let found = lazy.reading()?.collections()?;
            all.extend(found.into_iter().filter(|ns| std::ptr::eq(self.lazy(ns), lazy)));
        }
        all.sort();
        Ok(all)
    }

    /// The collections of a database; the store of other databases is not asked.
    pub(super) fn collections_of(&self, database: &str) -> Result<Vec<Namespace>, StoreError> {
        let mut found = self.lazy_of(database).reading()?.collections()?;
        found.retain(|ns| ns.database == database);
        Ok(found)
    }

    /// The same for what is stored to be found again, but can do without that: a file that
    /// is not there is made, where that is possible.
    pub(super) fn keeping(&self, ns: &Namespace) -> Result<&dyn Store, StoreError> {
        let lazy = self.lazy(ns);
        lazy.get().or_else(|_| lazy.reading())
    }

    /// Whether the store of a database is a file.
    pub(super) fn is_in_file(&self, ns: &Namespace) -> bool {
        self.lazy(ns).uri.as_ref().is_some_and(|uri| uri.path().is_some())
    }

    /// Refuses a pipeline over `ns` that reads or writes a collection of the other store.
    pub(super) fn check_reach(&self, ns: &Namespace, other: &Namespace) -> Result<(), StoreError> {
        if std::ptr::eq(self.lazy(ns), self.lazy(other)) {
            return Ok(());
        }
        let (kind, of) = if self.is_shared(other) { ("shared", "private") } else { ("private", "shared") };
        let message = format!(
            "{other} is in the {kind} store, and a pipeline over the {of} {ns} does not leave its store; \
             query one and insert into the other"
        );
        Err(QueryError::bad_value(message).into())
    }

    fn lazy(&self, ns: &Namespace) -> &Lazy {
        self.lazy_of(&ns.database)
    }

    fn lazy_of(&self, database: &str) -> &Lazy {
        match &self.shared {
            Some(shared) if self.shared_databases.iter().any(|shared| shared == database) => shared,
            _ => &self.local,
        }
    }

    /// The local store, and the shared one where it is another.
    fn both(&self) -> impl Iterator<Item = &Lazy> {
        std::iter::once(&self.local).chain(&self.shared)
    }

    /// The shared store, where it is another than the local one and databases are in it.
    fn used(&self) -> Option<&Lazy> {
        self.shared.as_ref().filter(|_| !self.shared_databases.is_empty())
    }

    /// The private store and, where databases are in it, the shared one.
    fn in_use(&self) -> impl Iterator<Item = &Lazy> {
        std::iter::once(&self.local).chain(self.used())
    }

    /// Those that no server keeps.
    fn in_files(&self) -> impl Iterator<Item = &Lazy> {
        self.both().filter(|lazy| !lazy.is_on_server())
    }

    /// Opens the local store, where it is a file that is there.
    pub(super) fn open_existing(&self) -> Result<(), StoreError> {
        let is_file = self.local.uri.as_ref().is_some_and(|uri| uri.path().is_some());
        if is_file { self.local.existing().map(drop) } else { Ok(()) }
    }

    /// The local store, for reading.
    pub(super) fn local(&self) -> Result<&dyn Store, StoreError> {
        self.local.reading()
    }

    /// The local store, and the shared one where it is another, for reading.
    pub(super) fn stores(&self) -> Result<Vec<&dyn Store>, StoreError> {
        self.both().map(Lazy::reading).collect()
    }

    /// The same, without those that a server keeps.
    pub(super) fn stores_in_files(&self) -> Result<Vec<&dyn Store>, StoreError> {
        self.in_files().map(Lazy::reading).collect()
    }

    /// The shared store that is used, for reading.
    pub(super) fn shared(&self) -> Result<Option<&dyn Store>, StoreError> {
        self.used().map(Lazy::reading).transpose()
    }

    /// The store that a scope is in; that of everything is the local one.
    pub(super) fn scoped(&self, scope: &Scope) -> Result<&dyn Store, StoreError> {
        scope.database().map_or(&self.local, |database| self.lazy_of(database)).get()
    }

    /// The scopes whose changes are kept in files.
    pub(super) fn kept_scopes(&self) -> Result<Vec<Scope>, StoreError> {
        let mut all = Vec::new();
        for lazy in self.in_files() {
            all.extend(lazy.get()?.kept_scopes()?);
        }
        Ok(all)
    }

    /// All collections, each in the store its database belongs to, sorted.
    pub(super) fn collections(&self) -> Result<Vec<Namespace>, StoreError> {
        self.listed(self.in_use())
    }

    /// The collections in the store of `ns`, without asking another store.
    pub(super) fn collections_beside(&self, ns: &Namespace) -> Result<Vec<Namespace>, StoreError> {
        let mut found = self.reading(ns)?.collections()?;
        found.retain(|other| self.is_shared(other) == self.is_shared(ns));
        Ok(found)
    }

    /// All names of watches, each of the store its database belongs to, sorted by collection.
    pub(super) fn names(&self) -> Result<Vec<Name>, StoreError> {
        let mut all = self.local.reading()?.names()?;
        if let Some(shared) = &self.shared {
            all.retain(|name| !self.is_shared(&name.namespace));
            if !self.shared_databases.is_empty() {
                let names = shared.reading()?.names()?;
                all.extend(names.into_iter().filter(|name| self.is_shared(&name.namespace)));
            }
            all.sort_by(|a, b| (&a.namespace, &a.name).cmp(&(&b.namespace, &b.name)));
        }
        Ok(all)
    }

    /// What the stores are, without opening them.
    pub(super) fn describe(&self) -> String {
        match self.describe_shared() {
            None => self.describe_private(),
            Some(shared) => format!("{}, shared {shared}", self.describe_private()),
        }
    }

    /// What the private store is.
    pub(super) fn describe_private(&self) -> String {
        self.local.describe()
    }

    /// Which databases are in the shared store, and what that is, where there is another one.
    pub(super) fn describe_shared(&self) -> Option<String> {
        let shared = self.shared.as_ref()?;
        Some(format!("{} at {}", self.shared_databases.join(", "), shared.describe()))
    }

    /// The databases in the shared store, where that is another than the local one.
    pub(super) fn databases_elsewhere(&self) -> &[String] {
        if self.shared.is_some() { &self.shared_databases } else { &[] }
    }

    pub(super) fn is_shared(&self, ns: &Namespace) -> bool {
        self.shared_databases.contains(&ns.database)
    }
}
