//! The computables of a memory, and which of them a query needs.

use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, OnceLock};

use bson::{Bson, Document, doc};
use sha2::Sha256;

use super::body::Body;
use super::bounds::Bounds;
use super::definition::{Definition, Origin};
use super::key;
use super::spec::{Slot, Spec};
use crate::formats::shell;
use crate::process::Host;
use crate::query::QueryError;
use crate::store::{Namespace, StoreError};

/// A registered computable.
pub struct Computable {
    /// What was declared.
    pub definition: Definition,
    pub(super) body: Box<dyn Body>,
    pub(super) spec: Spec,
    /// What its keys begin with, once one was asked for.
    digest: OnceLock<Sha256>,
}

impl Computable {
    /// The key under which its answer to a query is kept.
    pub(super) fn key(&self, query: &Document) -> String {
        key::of(self.digest.get_or_init(|| key::begin(&self.definition)), query)
    }

    /// What computes, in a line.
    #[must_use]
    pub fn describe(&self) -> String {
        self.body.describe()
    }
}

/// All computables, in the order in which they run.
#[derive(Default)]
pub struct Registry {
    computables: Vec<Arc<Computable>>,
    places: HashMap<Namespace, Places>,
    /// What is kept and cannot be used.
    wrong: Vec<Wrong>,
    /// Names that two computables have, each with what is to be said to who needs one of them.
    taken: BTreeMap<String, String>,
}

/// A document that is kept as a computable and is none.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Wrong {
    /// The collections that it names.
    pub(super) collections: Vec<String>,
    /// What is wrong with it, and what to do.
    pub(super) message: String,
}

/// Where the specs of a namespace are looked for, so that a query is matched
/// against few of them.
#[derive(Default)]
struct Places {
    texts: HashMap<String, HashMap<String, Vec<usize>>>,
    keys: HashMap<String, Vec<(Bounds, usize)>>,
    rest: Vec<Rest>,
}

/// Specs about the same keys, which need none of them.
struct Rest {
    /// Where a query has none of these, it is known whether it matches.
    keys: Option<Vec<String>>,
    /// Those that match queries without these keys.
    matching: Vec<usize>,
    all: Vec<usize>,
}

/// A computable that a query may need, by its number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Candidate {
    index: usize,
    /// Whether its spec is known to match.
    is_certain: bool,
}

impl Registry {
    /// The computables with these definitions, registered in this order.
    ///
    /// # Errors
    /// Where a spec is not a query.
    pub fn new(definitions: Vec<Definition>, host: &Host<'static>) -> Result<Self, StoreError> {
        Self::default().with(definitions, Some(host))
    }

    /// These, and computables with further definitions; without a host, none of them may be a program.
    ///
    /// # Errors
    /// Where a spec is not a query, a body is not acceptable, or two that are declared apart have one name.
    pub(super) fn with(&self, definitions: Vec<Definition>, host: Option<&Host<'static>>) -> Result<Self, StoreError> {
        let mut registry = self.copy();
        for definition in definitions {
            let all = &registry.computables;
            if let Some(other) = all.iter().find(|other| is_taken(&definition, &other.definition)) {
                return Err(taken(&definition.name, &other.definition.origin, &definition.origin));
            }
            let name = definition.name.clone();
            registry.add(definition, host).map_err(|error| failed(&name, error))?;
        }
        Ok(registry.indexed())
    }

    /// These, and computables that a database keeps. What is wrong with one of those, or that two have one name, is for the
    /// queries that it concerns.
    pub(super) fn with_kept(&self, kept: Vec<Result<Vec<Definition>, Wrong>>, place: &Namespace) -> Self {
        let mut registry = self.copy();
        for read in kept {
            let definitions = match read {
                Ok(definitions) => definitions,
                Err(wrong) => {
                    registry.wrong.push(wrong);
                    continue;
                }
            };
            for definition in definitions {
                let (name, collection) = (definition.name.clone(), definition.namespace.to_string());
                let other = registry.computables.iter().find(|other| is_taken(&definition, &other.definition));
                if let Some(other) = other {
                    let message = taken(&name, &other.definition.origin, &definition.origin).to_string();
                    registry.taken.insert(name.clone(), message);
                }
                if let Err(error) = registry.add(definition, None) {
                    let message = wrong_message(place, &Bson::String(name), &error.to_string());
                    registry.wrong.push(Wrong { collections: vec![collection], message });
                }
            }
        }
        registry.indexed()
    }

    /// Whether computables with these definitions could be added.
    ///
    /// # Errors
    /// What is wrong with one, in a sentence.
    pub(super) fn check(mut self, definitions: Vec<Definition>) -> Result<(), String> {
        let mut definitions = definitions.into_iter();
        definitions.try_for_each(|definition| self.add(definition, None)).map_err(|error| error.to_string())
    }

    fn copy(&self) -> Self {
        let (wrong, taken) = (self.wrong.clone(), self.taken.clone());
        Self { computables: self.computables.clone(), places: HashMap::new(), wrong, taken }
    }

    fn add(&mut self, definition: Definition, host: Option<&Host<'static>>) -> Result<(), QueryError> {
        let body = definition.body.body(&definition.namespace, host)?;
        let spec = Spec::parse(&definition.spec)?;
        // Of equal priorities, the later registered runs first.
        let at = self.computables.partition_point(|other| other.definition.priority > definition.priority);
        self.computables.insert(at, Arc::new(Computable { definition, body, spec, digest: OnceLock::new() }));
        Ok(())
    }

    /// With the places of the specs.
    fn indexed(mut self) -> Self {
        for (index, computable) in self.computables.iter().enumerate() {
            let places = self.places.entry(computable.definition.namespace.clone()).or_default();
            computable.spec.slots().into_iter().for_each(|slot| places.add(slot, &computable.spec, index));
        }
        self
    }

    /// What is wrong with what is kept, and the names that two have.
    pub(super) fn complaints(&self) -> Vec<String> {
        let taken = self.taken.values().cloned();
        self.wrong.iter().map(|wrong| wrong.message.clone()).chain(taken).collect()
    }

    /// What is wrong with documents that do not concern a collection.
    pub(super) fn elsewhere<'a>(&'a self, ns: &Namespace) -> impl Iterator<Item = &'a str> {
        let name = ns.to_string();
        let elsewhere = self.wrong.iter().filter(move |wrong| !wrong.collections.contains(&name));
        elsewhere.map(|wrong| wrong.message.as_str())
    }

    /// All, in the order in which they run.
    pub fn iter(&self) -> impl Iterator<Item = &Arc<Computable>> {
        self.computables.iter()
    }

    /// Whether a query may need one that has a document under a key: what the document has is not looked at.
    pub(super) fn may_match(&self, ns: &Namespace, key: &str) -> bool {
        let is_wrong = self.wrong.iter().any(|wrong| wrong.collections.contains(&ns.to_string()));
        let places = self.places.get(ns);
        is_wrong || places.is_some_and(|places| !places.candidates(&doc! { key: {} }).is_empty())
    }

    /// Those that a query needs, in the order in which they run.
    ///
    /// # Errors
    /// Where an expression in a spec fails on the query; what is kept for the collection is not a computable; one that the query
    /// needs has the name of another.
    pub fn matching(&self, ns: &Namespace, query: &Document) -> Result<Vec<Arc<Computable>>, StoreError> {
        if !self.wrong.is_empty() {
            let name = ns.to_string();
            if let Some(wrong) = self.wrong.iter().find(|wrong| wrong.collections.contains(&name)) {
                return Err(QueryError::bad_value(wrong.message.as_str()).into());
            }
        }
        let Some(places) = self.places.get(ns) else { return Ok(Vec::new()) };
        let mut matching = Vec::new();
        for Candidate { index, is_certain } in places.candidates(query) {
            let Some(computable) = self.computables.get(index) else { continue };
            let matches = || computable.spec.matches(query).map_err(|error| failed(&computable.definition.name, error));
            if is_certain || matches()? {
                if let Some(message) = self.taken.get(&computable.definition.name) {
                    return Err(QueryError::bad_value(message.as_str()).into());
                }
                matching.push(Arc::clone(computable));
            }
        }
        Ok(matching)
    }
}

impl Places {
    fn add(&mut self, slot: Slot, spec: &Spec, index: usize) {
        match slot {
            Slot::Text(key, text) => self.texts.entry(key).or_default().entry(text).or_default().push(index),
            Slot::Key(key, bounds) => self.keys.entry(key).or_default().push((bounds, index)),
            Slot::Any => {
                let absence = spec.absence();
                let (keys, is_match) = absence.map_or((None, false), |absence| (Some(absence.keys), absence.is_match));
                let at = self.rest.iter().position(|rest| rest.keys == keys);
                let at = at.unwrap_or_else(|| {
                    self.rest.push(Rest { keys, matching: Vec::new(), all: Vec::new() });
                    self.rest.len() - 1
                });
                if let Some(rest) = self.rest.get_mut(at) {
                    rest.all.push(index);
                    rest.matching.extend(is_match.then_some(index));
                }
            }
        }
    }

    /// The specs that can match the query, in their order.
    fn candidates(&self, query: &Document) -> Vec<Candidate> {
        let possible = |index: &usize| Candidate { index: *index, is_certain: false };
        let mut found = Vec::new();
        for rest in &self.rest {
            match &rest.keys {
                Some(keys) if !keys.iter().any(|key| query.contains_key(key)) => {
                    let certain = |index: &usize| Candidate { index: *index, is_certain: true };
                    found.extend(rest.matching.iter().map(certain));
                }
                _ => found.extend(rest.all.iter().map(possible)),
            }
        }
        for (key, value) in query {
            match (self.texts.get(key), value) {
                (Some(texts), Bson::String(text)) => found.extend(texts.get(text).into_iter().flatten().map(possible)),
                (Some(texts), _) => found.extend(texts.values().flatten().map(possible)),
                (None, _) => {}
            }
            let bounded = self.keys.get(key).into_iter().flatten();
            found.extend(bounded.filter(|(bounds, _)| bounds.admit(value)).map(|(_, index)| possible(index)));
        }
        found.sort_unstable();
        found.dedup_by_key(|candidate| candidate.index);
        found
    }
}

/// Whether a computable has a name that one declared elsewhere has.
fn is_taken(definition: &Definition, other: &Definition) -> bool {
    definition.name == other.name && definition.origin != other.origin
}

/// The error for two computables of one name.
pub(super) fn taken(name: &str, one: &Origin, other: &Origin) -> StoreError {
    if let (Origin::Memory(one), Origin::Memory(other)) = (one, other)
        && one == other
    {
        let what = format!("{one} keeps a computable `{name}` already; rmem computables remove {name} takes it away");
        return QueryError::bad_value(what).into();
    }
    let hint = match (one, other) {
        (Origin::Settings(_), Origin::Settings(_)) => "rename one of them".to_owned(),
        _ => format!("rename one of them, or take the one in the memory away: rmem computables remove {name}"),
    };
    QueryError::bad_value(format!("two computables are called `{name}`: that of {one}, and that of {other}; {hint}"))
        .into()
}

/// What to say of a document that is kept as a computable and is none.
pub(super) fn wrong_message(place: &Namespace, id: &Bson, wrong: &str) -> String {
    let remove = match id {
        Bson::String(name) => format!("rmem computables remove {name}"),
        _ => format!("rmem delete {place} '{{_id: {}}}'", shell::relaxed_value(id)),
    };
    let id = shell::relaxed_value(id);
    format!("{place} has a document with _id {id} that is not a computable: {wrong}; remove it: {remove}")
}

fn failed(name: &str, error: QueryError) -> StoreError {
    StoreError::computable(name, error)
}
