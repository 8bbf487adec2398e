//! `arrayFilters`: the elements that `$[identifier]` selects.

use std::cell::Cell;

use bson::{Bson, Document};

use crate::query::error::{QueryError, Result};
use crate::query::filter::Filter;

/// Filters by identifier.
#[derive(Debug)]
pub(super) struct ArrayFilters {
    filters: Vec<(String, Filter, Cell<bool>)>,
}

impl ArrayFilters {
    pub(super) fn parse(documents: &[Document]) -> Result<Self> {
        let mut filters: Vec<(String, Filter, Cell<bool>)> = Vec::new();
        for document in documents {
            let mut names = Vec::new();
            identifiers(document, &mut names, 0)?;
            names.sort_unstable();
            names.dedup();
            let [name] = names.as_slice() else {
                return Err(QueryError::failed_to_parse("an array filter needs exactly one top-level field name"));
            };
            let starts_lower = name.starts_with(|c: char| c.is_ascii_lowercase());
            if !starts_lower || !name.chars().all(|c| c.is_ascii_alphanumeric()) {
                let message = "an array filter's name must begin with a lowercase letter and be alphanumeric";
                return Err(QueryError::bad_value(message));
            }
            if filters.iter().any(|(known, ..)| known == name) {
                let message = format!("found multiple array filters with the same top-level field name {name}");
                return Err(QueryError::failed_to_parse(message));
            }
            filters.push((name.clone(), Filter::parse(document)?, Cell::new(false)));
        }
        Ok(Self { filters })
    }

    /// Returns the filter of an identifier, noting that it is used.
    pub(super) fn mark(&self, name: &str) -> Result<()> {
        match self.filters.iter().find(|(known, ..)| known == name) {
            Some((.., used)) => {
                used.set(true);
                Ok(())
            }
            None => Err(QueryError::bad_value(format!("no array filter found for identifier '{name}'"))),
        }
    }

    /// Refuses filters that no path uses.
    pub(super) fn check_used(&self) -> Result<()> {
        match self.filters.iter().find(|(.., used)| !used.get()) {
            Some((name, ..)) => Err(QueryError::failed_to_parse(format!(
                "the array filter for identifier '{name}' was not used in the update"
            ))),
            None => Ok(()),
        }
    }

    /// Returns whether an element passes.
    pub(super) fn passes(&self, name: &str, element: &Bson) -> Result<bool> {
        let Some((_, filter, _)) = self.filters.iter().find(|(known, ..)| known == name) else { return Ok(false) };
        let mut wrapped = Document::new();
        wrapped.insert(name, element.clone());
        filter.matches_document(&wrapped)
    }
}

/// Returns the first parts of all paths in a filter.
fn identifiers(document: &Document, names: &mut Vec<String>, depth: usize) -> Result<()> {
    if depth > 100 {
        return Err(QueryError::bad_value("the array filter is nested too deeply"));
    }
    for (name, value) in document {
        match (name.as_str(), value) {
            ("$and" | "$or" | "$nor", Bson::Array(items)) => {
                for item in items {
                    if let Bson::Document(inner) = item {
                        identifiers(inner, names, depth + 1)?;
                    }
                }
            }
            ("$expr" | "$where" | "$text" | "$jsonSchema", _) => {
                return Err(QueryError::bad_value(format!("{name} is not allowed in an array filter")).about(name));
            }
            (name, _) if name.starts_with('$') => {}
            (name, _) => names.push(name.split('.').next().unwrap_or_default().to_owned()),
        }
    }
    Ok(())
}
