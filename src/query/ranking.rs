//! The order of array elements by several fields, for `$push` and `$sortArray`.
//!
//! Unlike in a sort of documents, arrays on a path or at its end are compared as a whole.

use std::cmp::Ordering;

use bson::{Bson, Document};

use super::compare::compare_values;
use super::error::Result;
use super::sort::Sort;

/// Paths with directions.
#[derive(Debug)]
pub(super) struct Ranking {
    fields: Vec<(String, bool)>,
}

impl Ranking {
    /// Reads a pattern like `{a: 1, "b.c": -1}`.
    ///
    /// # Errors
    /// If it is no pattern of a sort.
    pub(super) fn parse(pattern: &Document) -> Result<Self> {
        let sort = Sort::parse(pattern)?;
        Ok(Self { fields: sort.fields().map(|(path, descending)| (path.to_owned(), descending)).collect() })
    }

    /// Sorts elements; equal ones stay as they are.
    pub(super) fn sort(&self, items: &mut [Bson]) {
        items.sort_by(|a, b| self.compare(a, b));
    }

    fn compare(&self, a: &Bson, b: &Bson) -> Ordering {
        let at = |item, path| field(item, path).unwrap_or(&Bson::Null);
        let orders = self.fields.iter().map(|(path, descending)| {
            let order = compare_values(at(a, path), at(b, path));
            if *descending { order.reverse() } else { order }
        });
        orders.fold(Ordering::Equal, Ordering::then)
    }
}

/// Returns the value at a path; array elements are reached by index only.
fn field<'a>(item: &'a Bson, path: &str) -> Option<&'a Bson> {
    let Bson::Document(document) = item else { return None };
    let (name, rest) = path.split_once('.').map_or((path, None), |(name, rest)| (name, Some(rest)));
    let mut value = document.get(name)?;
    for part in rest.into_iter().flat_map(|rest| rest.split('.')) {
        value = match value {
            Bson::Document(inner) => inner.get(part)?,
            Bson::Array(items) => items.get(part.parse::<usize>().ok()?)?,
            _ => return None,
        };
    }
    Some(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::{bson, doc};

    #[test]
    fn arrays_count_as_they_are() {
        let mut items = [bson!({"c": []}), bson!(1), bson!({"c": 5}), bson!({"c": {"0": 2}})];
        Ranking::parse(&doc! { "c": 1 }).unwrap().sort(&mut items);
        assert_eq!(items, [bson!(1), bson!({"c": 5}), bson!({"c": {"0": 2}}), bson!({"c": []})]);
        let mut items = [bson!({"c": [3]}), bson!({"c": [2]}), bson!({"c": 1})];
        Ranking::parse(&doc! { "c.0": -1 }).unwrap().sort(&mut items);
        assert_eq!(items, [bson!({"c": [3]}), bson!({"c": [2]}), bson!({"c": 1})]);
    }
}
