//! Applies modifiers along their paths through a document.

use bson::{Bson, Document};

use super::field;
use super::filters::ArrayFilters;
use super::modifier::{Action, Modifier, Segment};
use super::outcome::{Effects, Outcome, PATH_NOT_VIABLE};
use super::rename;
use crate::query::dollar::is_reference_key;
use crate::query::error::{QueryError, Result};
use crate::query::path::padded_index;

/// How many nulls an update may pad an array with.
const MAX_PADDING: usize = 1_500_000;

/// The application of an update to one document.
pub(super) struct Application<'a> {
    pub(super) filters: &'a ArrayFilters,
    /// The array index that `$` selects.
    pub(super) position: Option<usize>,
    /// Whether the document is being made by an upsert.
    pub(super) inserting: bool,
    pub(super) effects: Effects,
}

impl Application<'_> {
    /// Applies all modifiers.
    pub(super) fn apply(&self, modifiers: &[Modifier], document: Document) -> Result<Document> {
        let mut document = document;
        for modifier in modifiers {
            // As in mongod, a document that is inserted may have such a field.
            if !self.inserting {
                check_name(modifier)?;
            }
            match &modifier.action {
                Action::SetOnInsert(_) if !self.inserting => {}
                Action::Rename(source) => {
                    let Some(value) = rename::source(&document, source)? else { continue };
                    rename::check_target(&document, &modifier.path)?;
                    let put = Modifier { action: Action::Set(value), ..modifier.moved() };
                    self.in_document(&mut document, &modifier.path, &put)?;
                    let left = Modifier { path: source.clone(), action: Action::Unset, ..modifier.moved() };
                    self.in_document(&mut document, source, &left)?;
                }
                _ => self.in_document(&mut document, &modifier.path, modifier)?,
            }
        }
        Ok(document)
    }

    fn in_document(&self, document: &mut Document, path: &[Segment], modifier: &Modifier) -> Result<()> {
        let Some((segment, rest)) = path.split_first() else { return Ok(()) };
        // Outside of arrays, `$` is a field whose name is the matched index.
        let Segment::Name(name) = &self.named(segment) else { return self.not_an_array(modifier) };
        if rest.is_empty() {
            match field::change(modifier, document.get(name), &self.effects)? {
                Outcome::Keep => {}
                Outcome::Put(value) => {
                    document.insert(name.clone(), value);
                }
                Outcome::Remove => {
                    document.remove(name);
                }
            }
            return Ok(());
        }
        if let Some(value) = document.get_mut(name) {
            return self.in_value(value, name, rest, modifier);
        }
        if let Some(value) = self.created(rest, modifier)? {
            document.insert(name.clone(), value);
        }
        Ok(())
    }

    fn in_value(&self, value: &mut Bson, name: &str, path: &[Segment], modifier: &Modifier) -> Result<()> {
        match value {
            Bson::Document(document) => self.in_document(document, path, modifier),
            Bson::Array(items) => self.in_array(items, name, path, modifier),
            _ if matches!(path.first().map(|first| self.named(first)), Some(Segment::Name(_))) => {
                if has_all(path) {
                    return Err(must_exist(modifier));
                }
                if !modifier.action.ignores_dead_ends() {
                    let message = format!("cannot create field {} in element {{{name}: {value}}}", modifier.text);
                    return Err(QueryError::invalid(PATH_NOT_VIABLE, message));
                }
                Ok(())
            }
            _ => self.not_an_array(modifier),
        }
    }

    fn in_array(&self, items: &mut Vec<Bson>, name: &str, path: &[Segment], modifier: &Modifier) -> Result<()> {
        let Some((segment, rest)) = path.split_first() else { return Ok(()) };
        match segment {
            Segment::Name(part) => match padded_index(part) {
                Some(index) => self.at_index(items, index, rest, modifier),
                None if has_all(path) => Err(must_exist(modifier)),
                None if !modifier.action.ignores_dead_ends() => {
                    let message = format!("cannot create field '{part}' in element {{{name}: [...]}}");
                    Err(QueryError::invalid(PATH_NOT_VIABLE, message))
                }
                None => Ok(()),
            },
            Segment::Matched => match self.position {
                Some(index) => self.at_index(items, index, rest, modifier),
                None => Err(no_position()),
            },
            Segment::All => (0..items.len()).try_for_each(|index| self.at_index(items, index, rest, modifier)),
            Segment::Filtered(identifier) => {
                for index in 0..items.len() {
                    let Some(item) = items.get(index) else { break };
                    if self.filters.passes(identifier, item)? {
                        self.at_index(items, index, rest, modifier)?;
                    }
                }
                Ok(())
            }
        }
    }

    fn at_index(&self, items: &mut Vec<Bson>, index: usize, rest: &[Segment], modifier: &Modifier) -> Result<()> {
        if rest.is_empty() {
            return match field::change(modifier, items.get(index), &self.effects)? {
                Outcome::Keep => Ok(()),
                Outcome::Put(value) => put(items, index, value),
                Outcome::Remove if index < items.len() => {
                    self.effects.touched.set(true);
                    put(items, index, Bson::Null)
                }
                Outcome::Remove => Ok(()),
            };
        }
        if let Some(value) = items.get_mut(index) {
            return self.in_value(value, &index.to_string(), rest, modifier);
        }
        match self.created(rest, modifier)? {
            Some(value) => put(items, index, value),
            None => Ok(()),
        }
    }

    /// Returns what is created where the path ends early.
    fn created(&self, path: &[Segment], modifier: &Modifier) -> Result<Option<Bson>> {
        if path.iter().any(|segment| !matches!(segment, Segment::Name(_))) {
            if path.contains(&Segment::Matched) && self.position.is_none() {
                return Err(no_position());
            }
            if let Some(Segment::Matched) = path.first() {
                let mut document = Document::new();
                let named: Vec<_> = path.iter().map(|segment| self.named(segment)).collect();
                self.in_document(&mut document, &named, modifier)?;
                return Ok((!document.is_empty()).then_some(Bson::Document(document)));
            }
            return Err(must_exist(modifier));
        }
        if !modifier.action.creates() {
            return Ok(None);
        }
        let mut document = Document::new();
        self.in_document(&mut document, path, modifier)?;
        Ok((!document.is_empty()).then_some(Bson::Document(document)))
    }

    fn named(&self, segment: &Segment) -> Segment {
        match (segment, self.position) {
            (Segment::Matched, Some(index)) => Segment::Name(index.to_string()),
            (segment, _) => segment.clone(),
        }
    }

    fn not_an_array(&self, modifier: &Modifier) -> Result<()> {
        if modifier.path.contains(&Segment::Matched) && self.position.is_none() {
            return Err(no_position());
        }
        Err(QueryError::bad_value(format!("cannot apply array updates to a non-array element: {}", modifier.text)))
    }
}

/// Refuses to make a field at the top whose name is one of an operator.
fn check_name(modifier: &Modifier) -> Result<()> {
    if !modifier.action.creates() {
        return Ok(());
    }
    match modifier.path.first() {
        Some(Segment::Name(name)) if name.starts_with('$') => {
            let message = format!("the dollar ($) prefixed field '{name}' is not allowed at the top of a document");
            Err(QueryError::invalid(if is_reference_key(name) { 55 } else { 52 }, message).about(name))
        }
        _ => Ok(()),
    }
}

/// Returns whether a path has `$[]` or `$[identifier]` in it, which want an array to be there.
fn has_all(path: &[Segment]) -> bool {
    path.iter().any(|segment| matches!(segment, Segment::All | Segment::Filtered(_)))
}

fn must_exist(modifier: &Modifier) -> QueryError {
    let path = &modifier.text;
    QueryError::bad_value(format!("the path '{path}' must exist in the document in order to apply array updates"))
}

fn no_position() -> QueryError {
    QueryError::bad_value("the positional operator did not find the match needed from the query")
}

/// Puts a value at an index, with nulls up to it.
fn put(items: &mut Vec<Bson>, index: usize, value: Bson) -> Result<()> {
    if let Some(place) = items.get_mut(index) {
        *place = value;
        return Ok(());
    }
    if index - items.len() > MAX_PADDING {
        return Err(QueryError::bad_value("cannot pad an array with more than 1500000 nulls"));
    }
    items.resize(index, Bson::Null);
    items.push(value);
    Ok(())
}
