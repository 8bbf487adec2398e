//! Computables that the memory keeps, each in the database of its collection: added and removed while others use them.
//!
//! They are pipelines and builtins. A program is none of them: whoever writes to the memory would run programs on the
//! machines of all who read it.
//!
//! A file is asked before each operation whether they have changed, a server at most once a second.

use std::rc::Rc;
use std::time::{Duration, Instant};

use bson::{Bson, Document, doc};

use super::definition::{BodyKind, Definition, NO_PROGRAMS, Origin};
use super::record;
use super::registry::{Computable, Registry, taken};
use super::state::{Kept, Wanted};
use crate::formats::shell;
use crate::memory::Memory;
use crate::query::QueryError;
use crate::store::{Find, Namespace, StoreError, metadata};

/// The collection of the computables of a database.
pub(in crate::memory) const COLLECTION: &str = "rmem.computables";
/// How long those of a server are believed to be as they were.
const MOST_AGE: Duration = Duration::from_secs(1);

fn place(database: &str) -> Namespace {
    Namespace { database: database.to_owned(), collection: COLLECTION.to_owned() }
}

impl Memory {
    /// The computables that queries on a collection may need, of the settings and of its database.
    pub(in crate::memory) fn registry(&self, ns: &Namespace) -> Result<Rc<Registry>, StoreError> {
        let declared = &self.computables.declared;
        if ns.is_own() {
            return Ok(Rc::clone(declared));
        }
        let is_fresh = |kept: &&Kept| self.routes.is_on_server(ns) && kept.read.elapsed() < MOST_AGE;
        if let Some(kept) = self.computables.kept.borrow().get(&ns.database).filter(is_fresh) {
            return Ok(Rc::clone(&kept.registry));
        }
        let records = self.records(&place(&ns.database))?;
        let mut all = self.computables.kept.borrow_mut();
        if let Some(kept) = all.get_mut(&ns.database).filter(|kept| kept.records == records) {
            kept.read = Instant::now();
            return Ok(Rc::clone(&kept.registry));
        }
        let registry = match records.is_empty() {
            true => Rc::clone(declared),
            false => Rc::new(declared.with(definitions(&records, &place(&ns.database))?, None)?),
        };
        all.insert(ns.database.clone(), Kept { records, registry: Rc::clone(&registry), read: Instant::now() });
        Ok(registry)
    }

    /// What a collection of computables has, in the order in which they were added.
    fn records(&self, place: &Namespace) -> Result<Vec<Document>, StoreError> {
        let Some(store) = self.routes.existing(place)? else { return Ok(Vec::new()) };
        let find = Find { sort: doc! { metadata::info_path(metadata::INSERTED): 1, "_id": 1 }, ..Find::default() };
        let found = store.find(place, &find)?;
        found.map(|raw| Ok(Document::try_from(&*raw?).map_err(QueryError::from)?)).collect()
    }

    /// The collections of computables.
    fn places(&self) -> Result<Vec<Namespace>, StoreError> {
        let mut places = self.routes.existing_collections()?;
        places.retain(|ns| ns.collection == COLLECTION);
        Ok(places)
    }

    /// All computables, of the settings and of all databases, in the order in which they run.
    ///
    /// # Errors
    /// Where the store fails, what is kept is no computable, or two have one name.
    pub fn computables(&self) -> Result<Vec<Rc<Computable>>, StoreError> {
        let mut kept = Vec::new();
        for place in self.places()? {
            kept.extend(definitions(&self.records(&place)?, &place)?);
        }
        Ok(self.computables.declared.with(kept, None)?.iter().map(Rc::clone).collect())
    }

    /// Keeps computables in the memory, each in the database of its collections, from now on and for everyone who
    /// uses it. Keeps all of them or, after an error, none.
    ///
    /// # Errors
    /// Where one is a program, or a name is taken.
    pub fn keep_computables(&self, computables: &[Vec<Definition>]) -> Result<(), StoreError> {
        let known = self.computables()?;
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
        self.atomically(
            &places,
            |error| error,
            |_| by_place.iter().try_for_each(|(place, records)| self.insert(place, records.clone()).map(drop)),
        )?;
        self.computables.kept.borrow_mut().clear();
        Ok(())
    }

    /// Removes what is kept under a name; returns whether there was something.
    ///
    /// # Errors
    /// Where the store fails.
    pub fn forget_computable(&self, name: &str) -> Result<bool, StoreError> {
        let mut removed = 0;
        for place in self.places()? {
            removed += self.delete(&place, &doc! { "_id": name }, false)?;
        }
        self.computables.kept.borrow_mut().clear();
        Ok(removed > 0)
    }

    /// All that the questions need, in the order in which it runs.
    pub(super) fn wanted<'a>(&self, questions: &[(&Namespace, &'a Document)]) -> Result<Vec<Wanted<'a>>, StoreError> {
        let mut wanted: Vec<Wanted<'a>> = Vec::new();
        for (ns, query) in questions {
            for computable in self.needed(ns, query)? {
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
        Ok(wanted)
    }

    /// The computables that add keys to what a query asks for, in the order in which they run.
    pub(super) fn adding<'a>(&self, ns: &Namespace, query: &'a Document) -> Result<Vec<Wanted<'a>>, StoreError> {
        let needed = self.needed(ns, query)?.into_iter();
        let adding = needed.filter(|computable| computable.definition.adds.is_some());
        Ok(adding.map(|computable| Wanted::new(computable, query)).collect())
    }
}

/// The definitions of what a collection keeps.
fn definitions(records: &[Document], place: &Namespace) -> Result<Vec<Definition>, StoreError> {
    let origin = Origin::Memory(place.clone());
    let mut definitions = Vec::new();
    for record in records {
        let read = record::read(record, &origin).and_then(|read| match read.first() {
            Some(first) if first.namespace.database != place.database => {
                Err(format!("`collection`: {} is in another database", first.namespace))
            }
            _ => Ok(read),
        });
        definitions.extend(read.map_err(|wrong| wrong_record(record, place, &wrong))?);
    }
    Ok(definitions)
}

fn wrong_record(record: &Document, place: &Namespace, wrong: &str) -> StoreError {
    let id = record.get("_id").map(shell::relaxed_value).unwrap_or_default();
    let remove = match record.get("_id") {
        Some(Bson::String(name)) => format!("rmem computables remove {name}"),
        _ => format!("rmem delete {place} '{{_id: {id}}}'"),
    };
    let message = format!("{place} has a document with _id {id} that is no computable: {wrong}; remove it: {remove}");
    QueryError::bad_value(message).into()
}
