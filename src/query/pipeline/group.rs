//! `$group`.

use std::collections::HashMap;

use bson::{Bson, Document, RawDocumentBuf};

use super::accumulator::{Accumulator, State};
use super::documents::{Documents, encode};
use super::run::Run;
use crate::query::error::{QueryError, Result};
use crate::query::expression::{Expression, Scope};
use crate::query::key;
use crate::query::number::Number;
use crate::query::view::Fields;

/// A compiled `$group`. Groups come out in the order in which they began.
#[derive(Debug)]
pub(super) struct Group {
    id: Expression,
    /// The name of the only field of an `_id` that is an object: null where its value is missing.
    only: Option<String>,
    accumulators: Accumulators,
}

/// Fields with their accumulators.
#[derive(Debug)]
pub(super) struct Accumulators {
    fields: Vec<(String, Accumulator)>,
}

/// The groups so far.
pub(super) struct Groups<'a> {
    accumulators: &'a Accumulators,
    places: HashMap<Vec<u8>, usize>,
    groups: Vec<(Bson, Vec<State>)>,
}

impl Accumulators {
    /// Reads the fields of a group other than `_id`.
    pub(super) fn parse<'a>(fields: impl Iterator<Item = (&'a String, &'a Bson)>, scope: &Scope) -> Result<Self> {
        let mut accumulators = Vec::new();
        for (name, spec) in fields {
            if name.contains('.') {
                return Err(QueryError::invalid(40_235, format!("the field name '{name}' cannot contain '.'")));
            }
            if name.starts_with('$') {
                return Err(QueryError::invalid(40_236, format!("the field name '{name}' cannot be an operator name")));
            }
            accumulators.push((name.clone(), Accumulator::parse(spec, scope)?));
        }
        Ok(Self { fields: accumulators })
    }

    /// Returns a `count` of documents.
    pub(super) fn counting() -> Self {
        Self { fields: vec![("count".to_owned(), Accumulator::counting())] }
    }
}

impl Group {
    pub(super) fn parse(spec: &Document, scope: &Scope) -> Result<Self> {
        let id =
            spec.get("_id").ok_or_else(|| QueryError::invalid(15_955, "a group specification must include an _id"))?;
        if let Bson::Document(parts) = id
            && parts.values().any(|part| matches!(part, Bson::Boolean(_)) || Number::of(part).is_some())
            && !parts.keys().any(|name| name.starts_with('$'))
        {
            return Err(QueryError::invalid(17_390, "$group does not support inclusion-style expressions"));
        }
        let fields = spec.iter().filter(|(name, _)| *name != "_id");
        let only = match id {
            Bson::Document(parts) if parts.len() == 1 => parts.keys().next().filter(|name| !name.starts_with('$')),
            _ => None,
        };
        let accumulators = Accumulators::parse(fields, scope)?;
        Ok(Self { id: Expression::parse_in(id, scope)?, only: only.cloned(), accumulators })
    }

    /// Counts by a key.
    pub(super) fn counting(id: Expression) -> Self {
        Self { id, only: None, accumulators: Accumulators::counting() }
    }

    pub(super) fn run<E: From<QueryError>>(
        &self,
        input: Documents<'_, E>,
        run: &Run<'_, E>,
    ) -> std::result::Result<Vec<RawDocumentBuf>, E> {
        let mut groups = Groups::new(&self.accumulators);
        for document in input {
            let document = document?;
            let fields = Fields::from(&*document);
            let mut id = self.id.evaluate(&run.environment(fields))?.unwrap_or(Bson::Null);
            if let (Some(name), Bson::Document(parts)) = (&self.only, &mut id) {
                parts.entry(name.clone()).or_insert(Bson::Null);
            }
            groups.add(id, fields, run)?;
        }
        let documents = groups.finish()?;
        Ok(documents.iter().map(encode).collect::<Result<_>>()?)
    }
}

impl<'a> Groups<'a> {
    pub(super) fn new(accumulators: &'a Accumulators) -> Self {
        Self { accumulators, places: HashMap::new(), groups: Vec::new() }
    }

    /// Takes a document into the group of an `_id`.
    pub(super) fn add<E>(&mut self, id: Bson, fields: Fields<'_>, run: &Run<'_, E>) -> Result<()> {
        let key = key::collated(&id);
        let place = match self.places.get(&key) {
            Some(place) => *place,
            None => {
                let states = self.accumulators.fields.iter().map(|(_, accumulator)| accumulator.start(&id, run));
                let states = states.collect::<Result<_>>()?;
                self.groups.push((id, states));
                self.places.insert(key, self.groups.len() - 1);
                self.groups.len() - 1
            }
        };
        let Some((_, states)) = self.groups.get_mut(place) else { return Ok(()) };
        for ((_, accumulator), state) in self.accumulators.fields.iter().zip(states) {
            accumulator.add(state, fields, run)?;
        }
        Ok(())
    }

    /// Returns a document per group.
    ///
    /// # Errors
    /// If a function of `$accumulator` fails.
    pub(super) fn finish(self) -> Result<Vec<Document>> {
        let accumulators = self.accumulators;
        let documents = self.groups.into_iter().map(|(id, states)| {
            let mut document = Document::new();
            document.insert("_id", id);
            for ((name, accumulator), state) in accumulators.fields.iter().zip(states) {
                document.insert(name.clone(), accumulator.finish(state)?);
            }
            Ok(document)
        });
        documents.collect()
    }
}
