//! Answering queries: find, count, distinct.

use std::collections::HashSet;
use std::rc::Rc;

use bson::raw::{RawArray, RawBsonRef};
use bson::{Bson, DateTime, Document, RawDocument};

use super::Embedded;
use super::scan::Scan;
use crate::query::{Filter, Projection, QueryError, Sort, key};
use crate::store::{Documents, Find, Namespace, StoreError};

impl Embedded {
    pub(super) fn answer(&self, ns: &Namespace, find: &Find) -> Result<Documents<'_>, StoreError> {
        let filter = Rc::new(Filter::parse(&find.filter)?);
        let sort = Sort::parse(&find.sort)?;
        let projection = match find.projection.is_empty() {
            true => None,
            false => Some(Projection::parse(&find.projection)?),
        };
        let Some(collection) = self.collection(ns)? else { return Ok(Box::new(std::iter::empty())) };
        let matches = Scan::new(self, collection, Rc::clone(&filter))?.map(|found| found.map(|found| found.body));
        let (skip, limit) = (count(find.skip), if find.limit == 0 { usize::MAX } else { count(find.limit) });
        let ordered: Documents<'_> = match sort.is_empty() {
            true => Box::new(matches),
            false => Box::new(sort.sort(matches, skip.checked_add(limit))?.into_iter().map(Ok)),
        };
        let chosen = ordered.skip(skip).take(limit);
        let Some(projection) = projection else { return Ok(Box::new(chosen)) };
        let now = DateTime::now();
        Ok(Box::new(chosen.map(move |document| Ok(projection.apply(&document?, &filter, now)?))))
    }

    pub(super) fn tally(&self, ns: &Namespace, filter: &Document) -> Result<u64, StoreError> {
        let filter = Filter::parse(filter)?;
        let Some(collection) = self.collection(ns)? else { return Ok(0) };
        if filter.matches_all() {
            return collection.size(&self.connection).map_err(|e| self.explain(&e));
        }
        Scan::new(self, collection, Rc::new(filter))?.count()
    }

    pub(super) fn values(&self, ns: &Namespace, field: &str, filter: &Document) -> Result<Vec<Bson>, StoreError> {
        let filter = Filter::parse(filter)?;
        let Some(collection) = self.collection(ns)? else { return Ok(Vec::new()) };
        let path: Vec<&str> = field.split('.').collect();
        let mut distinct = Distinct::default();
        for found in Scan::new(self, collection, Rc::new(filter))? {
            distinct.collect(&found?.body, &path)?;
        }
        Ok(distinct.values)
    }
}

fn count(number: u64) -> usize {
    usize::try_from(number).unwrap_or(usize::MAX)
}

/// Values at a path, each once, in the order they are met.
#[derive(Default)]
struct Distinct {
    seen: HashSet<Vec<u8>>,
    values: Vec<Bson>,
}

impl Distinct {
    /// Goes down one step of the path for each call: as deep as the path is long.
    fn collect(&mut self, document: &RawDocument, path: &[&str]) -> Result<(), QueryError> {
        let Some((first, rest)) = path.split_first() else { return Ok(()) };
        match document.get(first)? {
            None => Ok(()),
            Some(value) => self.descend(value, rest),
        }
    }

    fn descend(&mut self, value: RawBsonRef<'_>, path: &[&str]) -> Result<(), QueryError> {
        match (value, path) {
            (RawBsonRef::Array(array), []) => {
                for element in array {
                    self.add(element?)?;
                }
                Ok(())
            }
            (value, []) => self.add(value),
            (RawBsonRef::Document(document), _) => self.collect(document, path),
            (RawBsonRef::Array(array), [first, rest @ ..]) => self.through(array, first, rest, path),
            _ => Ok(()),
        }
    }

    /// A step into an array: by index, and into the documents it holds.
    fn through(&mut self, array: &RawArray, first: &str, rest: &[&str], path: &[&str]) -> Result<(), QueryError> {
        if let Some(element) = first.parse().ok().and_then(|index| array.get(index).transpose()) {
            self.descend(element?, rest)?;
        }
        for element in array {
            if let RawBsonRef::Document(document) = element? {
                self.collect(document, path)?;
            }
        }
        Ok(())
    }

    fn add(&mut self, value: RawBsonRef<'_>) -> Result<(), QueryError> {
        if self.seen.insert(key::encode(value)) {
            self.values.push(Bson::try_from(value)?);
        }
        Ok(())
    }
}
