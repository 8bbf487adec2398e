//! Groups with their accumulators, in memory.

use std::collections::HashMap;

use bson::raw::CString;
use bson::{Bson, Document, RawBson, RawDocumentBuf};

use super::accumulator::Accumulator;
use super::run::Run;
use super::state::State;
use crate::query::error::{QueryError, Result};
use crate::query::expression::Scope;
use crate::query::key;
use crate::query::limit::{ALLOCATION, check_between, check_levels, memory};
use crate::query::view::Fields;

/// Fields with their accumulators.
#[derive(Debug)]
pub(super) struct Accumulators {
    fields: Vec<(String, Accumulator)>,
}

/// The groups so far.
pub(super) struct Groups<'a> {
    accumulators: &'a Accumulators,
    places: HashMap<Vec<u8>, usize>,
    groups: Vec<Group>,
    /// The bytes of memory that they need.
    held: usize,
}

/// A group.
pub(super) struct Group {
    /// The number of its first document.
    pub(super) first: u64,
    pub(super) id: Bson,
    pub(super) states: Vec<State>,
}

impl Accumulators {
    /// Reads the fields of a group other than `_id`.
    pub(super) fn parse<'a>(fields: impl Iterator<Item = (&'a String, &'a Bson)>, scope: &Scope) -> Result<Self> {
        let mut accumulators = Vec::new();
        for (name, spec) in fields {
            if !Accumulator::is_one(spec) {
                return Err(QueryError::invalid(40_234, format!("the field '{name}' must be an accumulator object")));
            }
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

    /// Returns the name of the only field, where that is a count of documents.
    pub(super) fn only_count(&self) -> Option<&str> {
        match self.fields.as_slice() {
            [(name, accumulator)] if accumulator.counts() => Some(name),
            _ => None,
        }
    }

    /// Returns the states of a group before its first document.
    pub(super) fn start<E>(&self, id: &Bson, run: &Run<'_, E>) -> Result<Vec<State>> {
        self.fields.iter().map(|(_, accumulator)| accumulator.start(id, run)).collect()
    }

    /// Returns the document of a group.
    ///
    /// # Errors
    /// If a function of `$accumulator` fails.
    pub(super) fn finish(&self, group: Group) -> Result<Document> {
        let mut document = Document::new();
        document.insert("_id", group.id);
        for ((name, accumulator), state) in self.fields.iter().zip(group.states) {
            document.insert(name.clone(), accumulator.finish(state)?);
        }
        Ok(document)
    }

    /// Returns the same document as BSON, for another stage.
    ///
    /// # Errors
    /// If a function of `$accumulator` fails, or the document is too large.
    pub(super) fn encoded(&self, group: Group) -> Result<RawDocumentBuf> {
        let (mut document, name) = (RawDocumentBuf::new(), |name: &str| CString::try_from(name));
        check_levels(&group.id, 1)?;
        document.append(name("_id")?, RawBson::try_from(group.id)?);
        for ((field, accumulator), state) in self.fields.iter().zip(group.states) {
            match state {
                State::Many(values) => document.append(name(field)?, values.into_array()),
                State::Distinct(values) => document.append(name(field)?, values.into_collected().into_array()),
                state => {
                    let value = accumulator.finish(state)?;
                    check_levels(&value, 1)?;
                    document.append(name(field)?, RawBson::try_from(value)?);
                }
            }
        }
        check_between(&document)?;
        Ok(document)
    }
}

impl<'a> Groups<'a> {
    pub(super) fn new(accumulators: &'a Accumulators) -> Self {
        Self { accumulators, places: HashMap::new(), groups: Vec::new(), held: 0 }
    }

    /// Takes a document into the group of an `_id`.
    pub(super) fn add<E>(&mut self, id: Bson, fields: Fields<'_>, run: &Run<'_, E>) -> Result<()> {
        self.add_numbered(0, id, fields, run)
    }

    /// The same, with the document's number.
    pub(super) fn add_numbered<E>(
        &mut self,
        number: u64,
        id: Bson,
        fields: Fields<'_>,
        run: &Run<'_, E>,
    ) -> Result<()> {
        let key = key::collated(&id);
        let place = match self.places.get(&key) {
            Some(place) => *place,
            None => {
                let states = self.accumulators.start(&id, run)?;
                self.insert(key, Group { first: number, id, states })
            }
        };
        let Some(Group { states, .. }) = self.groups.get_mut(place) else { return Ok(()) };
        for ((_, accumulator), state) in self.accumulators.fields.iter().zip(states) {
            let before = state.bytes();
            accumulator.add(state, fields, run)?;
            self.held = (self.held + state.bytes()).saturating_sub(before);
        }
        Ok(())
    }

    /// Takes a group that is not yet among them; returns its place.
    fn insert(&mut self, key: Vec<u8>, group: Group) -> usize {
        // The tables grow by doubling.
        let entry = 2 * size_of::<(Vec<u8>, usize)>() + 2 * size_of::<Group>() + 3 * ALLOCATION;
        let states = group.states.len() * size_of::<State>() + group.states.iter().map(State::bytes).sum::<usize>();
        self.held += entry + key.len() + memory(&group.id).unwrap_or_default() + states;
        self.groups.push(group);
        let place = self.groups.len() - 1;
        self.places.insert(key, place);
        place
    }

    /// Takes a group that was taken out before.
    pub(super) fn resume(&mut self, group: Group) {
        let key = key::collated(&group.id);
        self.insert(key, group);
    }

    pub(super) fn len(&self) -> usize {
        self.groups.len()
    }

    /// Returns the bytes of memory that they need.
    pub(super) fn held(&self) -> usize {
        self.held
    }

    /// Takes all groups out, in the order in which they began.
    pub(super) fn take(&mut self) -> Vec<Group> {
        self.places = HashMap::new();
        self.held = 0;
        std::mem::take(&mut self.groups)
    }

    /// Returns a document per group.
    ///
    /// # Errors
    /// If a function of `$accumulator` fails.
    pub(super) fn finish(mut self) -> Result<Vec<Document>> {
        self.take().into_iter().map(|group| self.accumulators.finish(group)).collect()
    }
}
