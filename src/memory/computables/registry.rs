//! The computables of a memory, and which of them a query needs.

use std::collections::HashMap;
use std::rc::Rc;

use bson::{Bson, Document};

use super::body::Body;
use super::definition::{Definition, Origin};
use super::spec::{Slot, Spec};
use crate::process::Host;
use crate::query::QueryError;
use crate::store::{Namespace, StoreError};

/// A registered computable.
pub struct Computable {
    /// What was declared.
    pub definition: Definition,
    pub(super) body: Box<dyn Body>,
    pub(super) spec: Spec,
}

impl Computable {
    /// What computes, in a line.
    #[must_use]
    pub fn describe(&self) -> String {
        self.body.describe()
    }
}

/// All computables, in the order in which they run.
#[derive(Default)]
pub struct Registry {
    computables: Vec<Rc<Computable>>,
    places: HashMap<Namespace, Places>,
}

/// Where the specs of a namespace are looked for, so that a query is matched
/// against few of them.
#[derive(Default)]
struct Places {
    texts: HashMap<String, HashMap<String, Vec<usize>>>,
    keys: HashMap<String, Vec<usize>>,
    rest: Vec<usize>,
}

impl Registry {
    /// The computables with these definitions, registered in this order.
    ///
    /// # Errors
    /// Where a spec is no query.
    pub fn new(definitions: Vec<Definition>, host: &Host<'static>) -> Result<Self, StoreError> {
        Self::default().with(definitions, Some(host))
    }

    /// These, and computables with further definitions; without a host, none of them may be a program.
    ///
    /// # Errors
    /// Where a spec is no query, a body is not acceptable, or two that are declared apart have one name.
    pub(super) fn with(&self, definitions: Vec<Definition>, host: Option<&Host<'static>>) -> Result<Self, StoreError> {
        let mut all = self.computables.clone();
        for definition in definitions {
            if let Some(other) = all.iter().find(|other| is_taken(&definition, &other.definition)) {
                return Err(taken(&definition.name, &other.definition.origin, &definition.origin));
            }
            let body = definition.body.body(&definition.namespace, host);
            let body = body.map_err(|error| failed(&definition.name, error))?;
            let spec = Spec::parse(&definition.spec).map_err(|error| failed(&definition.name, error))?;
            // Of equal priorities, the later registered runs first.
            let at = all.partition_point(|other| other.definition.priority > definition.priority);
            all.insert(at, Rc::new(Computable { definition, body, spec }));
        }
        let mut places: HashMap<Namespace, Places> = HashMap::new();
        for (index, computable) in all.iter().enumerate() {
            let places = places.entry(computable.definition.namespace.clone()).or_default();
            computable.spec.slots().into_iter().for_each(|slot| places.add(slot, index));
        }
        Ok(Self { computables: all, places })
    }

    /// All, in the order in which they run.
    pub fn iter(&self) -> impl Iterator<Item = &Rc<Computable>> {
        self.computables.iter()
    }

    /// Those that a query needs, in the order in which they run.
    ///
    /// # Errors
    /// Where an expression in a spec fails on the query.
    pub fn matching(&self, ns: &Namespace, query: &Document) -> Result<Vec<Rc<Computable>>, StoreError> {
        let Some(places) = self.places.get(ns) else { return Ok(Vec::new()) };
        let mut found = places.candidates(query);
        found.sort_unstable();
        found.dedup();
        let mut matching = Vec::new();
        for computable in found.into_iter().filter_map(|index| self.computables.get(index)) {
            if computable.spec.matches(query).map_err(|error| failed(&computable.definition.name, error))? {
                matching.push(Rc::clone(computable));
            }
        }
        Ok(matching)
    }
}

impl Places {
    fn add(&mut self, slot: Slot, index: usize) {
        match slot {
            Slot::Text(key, text) => self.texts.entry(key).or_default().entry(text).or_default().push(index),
            Slot::Key(key) => self.keys.entry(key).or_default().push(index),
            Slot::Any => self.rest.push(index),
        }
    }

    /// The specs that can match the query.
    fn candidates(&self, query: &Document) -> Vec<usize> {
        let mut found = self.rest.clone();
        for (key, value) in query {
            match (self.texts.get(key), value) {
                (Some(texts), Bson::String(text)) => found.extend(texts.get(text).into_iter().flatten()),
                (Some(texts), _) => found.extend(texts.values().flatten()),
                (None, _) => {}
            }
            found.extend(self.keys.get(key).into_iter().flatten());
        }
        found
    }
}

/// Whether a computable has a name that one declared elsewhere has.
fn is_taken(definition: &Definition, other: &Definition) -> bool {
    definition.name == other.name && definition.origin != other.origin
}

/// The error for two computables of one name.
pub(super) fn taken(name: &str, one: &Origin, other: &Origin) -> StoreError {
    let hint = match (one, other) {
        (Origin::Settings(_), Origin::Settings(_)) => "rename one of them".to_owned(),
        _ => format!("rename one of them, or take the one in the memory away: rmem computables remove {name}"),
    };
    QueryError::bad_value(format!("two computables are called `{name}`: that of {one}, and that of {other}; {hint}"))
        .into()
}

fn failed(name: &str, error: QueryError) -> StoreError {
    StoreError::computable(name, error)
}
