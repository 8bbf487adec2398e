//! Answering queries: find, count, distinct.

use std::rc::Rc;

use bson::{Bson, DateTime, Document};

use super::Embedded;
use super::scan::Scan;
use crate::query::{self, Filter, Projection, QueryError, Sort};
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
        check_path(field)?;
        let filter = Filter::parse(filter)?;
        let Some(collection) = self.collection(ns)? else {
            return query::distinct(std::iter::empty::<Result<_, StoreError>>(), field);
        };
        let found = Scan::new(self, collection, Rc::new(filter))?;
        query::distinct(found.map(|found| found.map(|found| found.body)), field)
    }
}

fn count(number: u64) -> usize {
    usize::try_from(number).unwrap_or(usize::MAX)
}

/// Refuses paths that MongoDB refuses to list the values of.
fn check_path(path: &str) -> Result<(), QueryError> {
    if path.is_empty() {
        return Err(QueryError::invalid(40_352, "the field's path is empty"));
    }
    for name in path.split('.') {
        if name.is_empty() {
            return Err(QueryError::invalid(15_998, format!("the path `{path}` has an empty field name")));
        }
        if name.starts_with('$') && !["$id", "$ref", "$db"].contains(&name) {
            return Err(QueryError::invalid(16_410, format!("the field name `{name}` may not start with `$`")));
        }
    }
    Ok(())
}
