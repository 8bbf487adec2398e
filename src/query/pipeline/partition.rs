//! Groups that do not fit in memory, in temporary files.
//!
//! When the groups of an input need too much memory, they are written to several files, by the hash of their `_id`;
//! the documents that are left follow them. Each file is an input of its own then: its groups go on from where they
//! were, so that every group sees its documents in their order. What the files give is put in order at the end.

use std::collections::hash_map::RandomState;
use std::hash::BuildHasher as _;

use bson::{Bson, Document, RawDocumentBuf};

use super::groups::{Accumulators, Group, Groups};
use super::run::Run;
use super::state::State;
use crate::query::error::{QueryError, Result};
use crate::query::key;
use crate::query::spill::{Keeper, Kept, Runs};

/// How many files an input is written to.
const FILES: usize = 16;
/// How often an input is divided: what is left has more than a million million parts.
const DEEPEST: u32 = 10;

/// A part of an input.
pub(super) enum Entry {
    /// A document with its number and the `_id` of its group.
    Document(u64, Bson, RawDocumentBuf),
    /// A group that began before.
    Group(Group),
}

/// What is grouped.
pub(super) struct Grouping<'a, 'b, E> {
    pub(super) accumulators: &'a Accumulators,
    pub(super) run: &'b Run<'a, E>,
    pub(super) hash: RandomState,
}

impl<'a, E: From<QueryError>> Grouping<'a, '_, E> {
    /// Returns the groups of an input; those that do not fit in memory are in `runs`, all of them, by their first document.
    pub(super) fn group(
        &self,
        input: &mut dyn Iterator<Item = std::result::Result<Entry, E>>,
        depth: u32,
        runs: &mut Runs,
    ) -> std::result::Result<Groups<'a>, E> {
        let mut groups = Groups::new(self.accumulators);
        while let Some(item) = input.next() {
            match item? {
                Entry::Document(number, id, document) => {
                    groups.add_numbered(number, id, (&*document).into(), self.run)?;
                }
                Entry::Group(group) => groups.resume(group),
            }
            // A single group has to fit.
            if groups.held() > self.run.spill().limit && groups.len() > 1 && depth < DEEPEST {
                let files = self.divide(&mut groups, input, depth)?;
                for file in files {
                    let mut rest = self.items(file);
                    let mut part = self.group(&mut rest, depth + 1, runs)?;
                    self.write(part.take(), runs)?;
                }
                break;
            }
        }
        Ok(groups)
    }

    /// Writes the documents of groups as a run.
    pub(super) fn write(&self, groups: Vec<Group>, runs: &mut Runs) -> std::result::Result<(), E> {
        if groups.is_empty() {
            return Ok(());
        }
        runs.add(groups.into_iter().map(|group| {
            let number = group.first.to_be_bytes();
            Ok((number, self.accumulators.encoded(group)?.into_bytes()))
        }))
    }

    /// Writes groups, and what is left of their input, to files.
    fn divide(
        &self,
        groups: &mut Groups<'_>,
        input: &mut dyn Iterator<Item = std::result::Result<Entry, E>>,
        depth: u32,
    ) -> std::result::Result<Vec<Kept>, E> {
        let folder = &self.run.spill().folder;
        let mut files = (0..FILES).map(|_| Keeper::new(folder)).collect::<Result<Vec<_>>>()?;
        let first = groups.take().into_iter().map(|group| Ok(Entry::Group(group)));
        for item in first.chain(input) {
            let (id, head, body) = parts(item?)?;
            let hash = self.hash.hash_one(key::collated(&id)) >> (4 * depth);
            let file = usize::try_from(hash).map_or(0, |hash| hash % FILES);
            if let Some(file) = files.get_mut(file) {
                file.put(head.as_bytes())?;
                file.put(&body)?;
            }
        }
        Ok(files.into_iter().map(Keeper::read).collect::<Result<_>>()?)
    }

    /// Reads a file.
    fn items(&self, mut file: Kept) -> impl Iterator<Item = std::result::Result<Entry, E>> {
        std::iter::from_fn(move || self.item(&mut file).map_err(E::from).transpose())
    }

    fn item(&self, file: &mut Kept) -> Result<Option<Entry>> {
        let Some(head) = file.next()? else { return Ok(None) };
        let body = file.rest()?;
        let mut head = Document::try_from(&*RawDocumentBuf::from_bytes(head)?)?;
        let first = head.get_i64("first").unwrap_or_default().cast_unsigned();
        let id = head.remove("id").unwrap_or(Bson::Null);
        let Some(Bson::Array(saved)) = head.remove("states") else {
            return Ok(Some(Entry::Document(first, id, RawDocumentBuf::from_bytes(body)?)));
        };
        let starts = self.accumulators.start(&id, self.run)?;
        let states = starts.into_iter().zip(saved).map(|(start, saved)| match saved {
            Bson::Array(saved) => State::load(start, saved),
            _ => Ok(start),
        });
        let states = states.collect::<Result<_>>()?;
        Ok(Some(Entry::Group(Group { first, id, states })))
    }
}

/// Returns what is written of an item: its group, and its document, if it is one.
fn parts(item: Entry) -> Result<(Bson, RawDocumentBuf, Vec<u8>)> {
    let mut head = Document::new();
    let (first, id, body) = match item {
        Entry::Document(number, id, document) => (number, id, document.into_bytes()),
        Entry::Group(Group { first, id, states }) => {
            let states = states.into_iter().map(|state| Ok(Bson::Array(state.save()?)));
            head.insert("states", states.collect::<Result<Vec<Bson>>>()?);
            (first, id, Vec::new())
        }
    };
    head.insert("first", first.cast_signed());
    head.insert("id", id.clone());
    Ok((id, RawDocumentBuf::try_from(&head)?, body))
}
