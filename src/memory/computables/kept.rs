//! Computables that the memory keeps, each in the database of its collection: added and removed while others use them.
//!
//! They are pipelines and builtins. A program is none of them: whoever writes to the memory would run programs on the
//! machines of all who read it.
//!
//! A file is asked at most once in each operation whether they have changed, a server at most once a second.

use std::sync::{Arc, LazyLock};
use std::time::{Duration, Instant};

use bson::{Bson, Document, RawDocumentBuf, doc};

use super::definition::{BodyKind, Definition, NO_PROGRAMS, Origin};
use super::record::{self, COLLECTION};
use super::registry::{Computable, Registry, Wrong, taken, wrong_message};
use super::state::{Kept, Wanted};
use crate::memory::Memory;
use crate::query::QueryError;
use crate::store::{Find, Namespace, Store, StoreError, metadata};

/// Asks for all of them in the order in which they were added. Nearly every operation asks.
static IN_ORDER: LazyLock<Find> =
    LazyLock::new(|| Find { sort: doc! { metadata::info_path(metadata::INSERTED): 1, "_id": 1 }, ..Find::default() });

/// How long those of a server are believed to be as they were.
const MOST_AGE: Duration = Duration::from_secs(1);

fn place(database: &str) -> Namespace {
    Namespace { database: database.to_owned(), collection: COLLECTION.to_owned() }
}

impl Memory {
    /// The computables that queries on a collection may need, of the settings and of its database.
    pub(in crate::memory) fn registry(&self, ns: &Namespace) -> Result<Arc<Registry>, StoreError> {
        let declared = &self.computables.declared;
        if ns.is_own() {
            return Ok(Arc::clone(declared));
        }
        let operation = self.computables.operation();
        let state = self.routes.existing(ns)?.and_then(Store::state);
        let is_fresh = |kept: &&Kept| {
            operation.is_some() && kept.operation == operation
                || state.is_some() && kept.state == state
                || self.routes.is_on_server(ns) && kept.read.elapsed() < MOST_AGE
        };
        if let Some(kept) = self.computables.kept.borrow().get(&ns.database).filter(is_fresh) {
            return Ok(Arc::clone(&kept.registry));
        }
        let records = self.records(&place(&ns.database))?;
        let mut all = self.computables.kept.borrow_mut();
        if let Some(kept) = all.get_mut(&ns.database).filter(|kept| kept.records == records) {
            (kept.read, kept.operation, kept.state) = (Instant::now(), operation, state);
            return Ok(Arc::clone(&kept.registry));
        }
        let registry = match records.is_empty() {
            true => Arc::clone(declared),
            false => {
                let place = place(&ns.database);
                Arc::new(declared.with_kept(definitions(&records, &place)?, &place))
            }
        };
        registry.elsewhere(ns).for_each(|message| self.computables.warn(message));
        all.insert(
            ns.database.clone(),
            Kept { records, registry: Arc::clone(&registry), read: Instant::now(), operation, state },
        );
        Ok(registry)
    }

    /// Whether the computables that a query may need are those of a state of the store behind which one write begins.
    pub(super) fn has_read_computables(
        &self,
        definition: &Definition,
        state: Option<(i64, u64)>,
        begun: Option<(i64, u64)>,
    ) -> bool {
        let ns = &definition.namespace;
        let is_next = state.zip(begun).is_some_and(|(state, begun)| begun == (state.0, state.1 + 1));
        let read = || self.computables.kept.borrow().get(&ns.database).map(|kept| kept.state == state);
        is_next && !ns.is_own() && read() == Some(true)
    }

    /// Says that the computables are as they were read: what was written since is not about them.
    pub(super) fn keep_computables_read(&self, ns: &Namespace, state: Option<(i64, u64)>) {
        if let Some(kept) = self.computables.kept.borrow_mut().get_mut(&ns.database) {
            kept.state = state;
        }
    }

    /// What a collection of computables has, in the order in which they were added.
    fn records(&self, place: &Namespace) -> Result<Vec<RawDocumentBuf>, StoreError> {
        let Some(store) = self.routes.existing(place)? else { return Ok(Vec::new()) };
        store.find(place, &IN_ORDER)?.collect()
    }

    /// The collections of computables in the stores that can be reached, and why another store cannot.
    fn places(&self) -> (Vec<Namespace>, Result<(), StoreError>) {
        let (mut places, all) = self.routes.existing_collections();
        places.retain(|ns| ns.collection == COLLECTION);
        (places, all)
    }

    /// All computables, of the settings and of all databases, in the order in which they run; and what is kept as one
    /// and cannot be used, each as a sentence.
    ///
    /// # Errors
    /// Where the store fails.
    pub fn computables(&self) -> Result<(Vec<Arc<Computable>>, Vec<String>), StoreError> {
        let (computables, complaints, all) = self.reachable_computables()?;
        all.map(|()| (computables, complaints))
    }

    /// The same of the stores that can be reached, and why another one cannot.
    ///
    /// # Errors
    /// Where a store fails that can be reached.
    #[expect(clippy::type_complexity, reason = "it is spelled out once")]
    pub fn reachable_computables(
        &self,
    ) -> Result<(Vec<Arc<Computable>>, Vec<String>, Result<(), StoreError>), StoreError> {
        let mut registry = Arc::clone(&self.computables.declared);
        let (places, all) = self.places();
        for place in places {
            registry = Arc::new(registry.with_kept(definitions(&self.records(&place)?, &place)?, &place));
        }
        Ok((registry.iter().map(Arc::clone).collect(), registry.complaints(), all))
    }

    /// Whether there are computables of a collection, which give documents where none is stored. Only its own store is asked.
    ///
    /// # Errors
    /// Where the store fails.
    pub fn is_computed(&self, ns: &Namespace) -> Result<bool, StoreError> {
        Ok(self.registry(ns)?.iter().any(|computable| computable.definition.namespace == *ns))
    }

    /// Keeps computables in the memory, each in the database of its collections, from now on and for everyone who
    /// uses it. Keeps all of them or, after an error, none.
    ///
    /// # Errors
    /// Where one is a program, or a name is taken.
    pub fn keep_computables(&self, computables: &[Vec<Definition>]) -> Result<(), StoreError> {
        let (known, _) = self.computables()?;
        let mut by_place: Vec<(Namespace, Vec<Document>)> = Vec::new();
        for (at, definitions) in computables.iter().enumerate() {
            let Some(first) = definitions.first() else { continue };
            if let BodyKind::Command { .. } = first.body {
                return Err(QueryError::bad_value(format!("the computable `{}`: {NO_PROGRAMS}", first.name)).into());
            }
            let place = place(&first.namespace.database);
            let origin = Origin::Memory(place.clone());
            if let Some(other) = known.iter().find(|other| other.definition.name == first.name) {
                return Err(taken(&first.name, &other.definition.origin, &origin));
            }
            let earlier = computables.iter().take(at).filter_map(|other| other.first());
            if let Some(other) = earlier.into_iter().find(|other| other.name == first.name) {
                return Err(taken(&first.name, &other.origin, &first.origin));
            }
            // What is kept has to be what was meant.
            let record = record::write(definitions);
            record::read(&record, &origin)
                .map_err(|wrong| QueryError::bad_value(format!("the computable `{}`: {wrong}", first.name)))?;
            match by_place.iter_mut().find(|(other, _)| *other == place) {
                Some((_, records)) => records.push(record),
                None => by_place.push((place, vec![record])),
            }
        }
        let places: Vec<Namespace> = by_place.iter().map(|(place, _)| place.clone()).collect();
        let places: Vec<&Namespace> = places.iter().collect();
        let kept = self.atomically(
            &places,
            |error| error,
            |_| by_place.iter().try_for_each(|(place, records)| self.insert(place, records.clone()).map(drop)),
        );
        if let Err(StoreError::Duplicate { namespace, key, .. }) = kept {
            // Its `_id` is its name, so that one of two processes wins.
            let name = key.text().trim_start_matches("_id: ").to_owned();
            let what = format!(
                "{namespace} keeps a computable {name} already, which another process has just added; nothing was added"
            );
            return Err(StoreError::Held { what });
        }
        kept?;
        self.computables.kept.borrow_mut().clear();
        Ok(())
    }

    /// Removes what is kept under a name: one computable, also where several databases keep one of that name. Returns
    /// where it was, and where others are.
    ///
    /// # Errors
    /// Where the store fails.
    pub fn forget_computable(&self, name: &str) -> Result<Option<(Namespace, Vec<Namespace>)>, StoreError> {
        let named = doc! { "_id": name };
        let mut removed = None;
        let mut others = Vec::new();
        let (places, all) = self.places();
        all?;
        for place in places {
            match removed {
                None if self.delete(&place, &named, false)? > 0 => removed = Some(place),
                Some(_) if self.count_stored(&place, &named)? > 0 => others.push(place),
                _ => {}
            }
        }
        self.computables.kept.borrow_mut().clear();
        Ok(removed.map(|place| (place, others)))
    }

    /// All that the questions need, in the order in which it runs; and whether others add keys to what they ask for.
    pub(super) fn wanted<'a>(
        &self,
        questions: &[(&Namespace, &'a Document)],
    ) -> Result<(Vec<Wanted<'a>>, bool), StoreError> {
        let (mut wanted, mut adds_keys): (Vec<Wanted<'a>>, _) = (Vec::new(), false);
        for (ns, query) in questions {
            for computable in self.needed(ns, query)? {
                adds_keys |= computable.definition.adds.is_some();
                if computable.definition.adds.is_some() || self.computables.is_due(&computable.definition) {
                    continue;
                }
                let next = Wanted::new(computable, query);
                if !wanted.iter().any(|other| other.key == next.key) {
                    wanted.push(next);
                }
            }
        }
        wanted.sort_by_key(|wanted| std::cmp::Reverse(wanted.computable.definition.priority));
        Ok((wanted, adds_keys))
    }

    /// The computables that add keys to what a query asks for, in the order in which they run.
    pub(super) fn adding<'a>(&self, ns: &Namespace, query: &'a Document) -> Result<Vec<Wanted<'a>>, StoreError> {
        let needed = self.needed(ns, query)?.into_iter();
        let adding = needed.filter(|computable| computable.definition.adds.is_some());
        Ok(adding.map(|computable| Wanted::new(computable, query)).collect())
    }
}

/// The definitions of what a collection keeps.
fn definitions(
    records: &[RawDocumentBuf],
    place: &Namespace,
) -> Result<Vec<Result<Vec<Definition>, Wrong>>, QueryError> {
    let definitions = records.iter().map(|record| {
        let record = Document::try_from(&**record)?;
        Ok(read(&record, place).map_err(|wrong| {
            let id = record.get("_id").cloned().unwrap_or(Bson::Null);
            Wrong { collections: collections(&record), message: wrong_message(place, &id, &wrong) }
        }))
    });
    definitions.collect()
}

/// The definitions of one document.
///
/// # Errors
/// What is wrong with it, in a sentence.
pub(super) fn read(record: &Document, place: &Namespace) -> Result<Vec<Definition>, String> {
    let read = record::read(record, &Origin::Memory(place.clone()))?;
    match read.first() {
        Some(first) if first.namespace.database != place.database => {
            Err(format!("`collection`: {} is in another database", first.namespace))
        }
        _ => Ok(read),
    }
}

/// The collections that a document names, though there is something wrong with it.
fn collections(record: &Document) -> Vec<String> {
    let names = match record.get("collection") {
        Some(Bson::Array(names)) => names.as_slice(),
        Some(name) => std::slice::from_ref(name),
        None => &[],
    };
    names.iter().filter_map(Bson::as_str).map(str::to_owned).collect()
}
