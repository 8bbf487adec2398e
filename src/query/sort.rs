//! Sort patterns, and sorting with and without a limit.

use std::collections::BinaryHeap;

use bson::{Bson, Document, RawDocument, RawDocumentBuf};

use super::decimal::Rounding;
use super::error::{QueryError, Result};
use super::keys::Keys;
use super::number::Number;
use super::path::Path;
use super::view::Fields;

/// The most fields a pattern may have.
const MAX_FIELDS: usize = 64;

/// A compiled sort pattern.
///
/// Where a path reaches several values through an array, the least of them
/// counts ascending, the greatest descending. A missing field sorts as null, an
/// empty array before it.
#[derive(Debug, Clone)]
pub struct Sort {
    keys: Keys,
    /// `{$natural: -1}`.
    reversed: bool,
}

impl Sort {
    /// Reads a pattern like `{a: 1, "b.c": -1}`, or `{$natural: ±1}`.
    ///
    /// # Errors
    /// If a direction is not 1 or -1, or a path is empty.
    pub fn parse(pattern: &Document) -> Result<Self> {
        let mut sort = Self::none();
        if pattern.len() > MAX_FIELDS {
            return Err(QueryError::bad_value("a sort pattern has more than 64 fields"));
        }
        for (name, direction) in pattern {
            if let Bson::Document(meta) = direction {
                return Err(match meta.keys().next() {
                    Some(key) if key == "$meta" => QueryError::unsupported("$meta"),
                    _ => QueryError::invalid(15_975, "a sort direction must be 1 or -1"),
                });
            }
            let descending = match Number::of(direction).map(coerced) {
                Some(1) => false,
                Some(-1) => true,
                _ => return Err(QueryError::invalid(15_975, "a sort direction must be 1 or -1").about(name)),
            };
            if name == "$natural" && pattern.len() == 1 {
                sort.reversed = descending;
                return Ok(sort);
            }
            check_name(name)?;
            sort.keys.push(Path::parse(name)?, descending);
        }
        Ok(sort)
    }

    /// Returns whether the pattern is empty: natural order.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.keys.is_empty() && !self.reversed
    }

    /// No order: as documents come.
    #[must_use]
    pub fn none() -> Self {
        Self { keys: Keys::default(), reversed: false }
    }

    /// Returns whether it is the order of insertion, reversed.
    #[must_use]
    pub fn is_natural(&self) -> bool {
        self.reversed
    }

    /// Returns the paths with their directions (descending or not), for a store that has an index on them.
    pub fn fields(&self) -> impl Iterator<Item = (&str, bool)> {
        self.keys.fields()
    }

    /// Returns the place of a document: bytes in the order of the pattern.
    ///
    /// # Errors
    /// If two fields of the pattern run through different arrays, or a number in one means two things.
    pub fn key(&self, document: &RawDocument) -> Result<Vec<u8>> {
        self.key_of(document.into())
    }

    pub(super) fn key_of(&self, fields: Fields<'_>) -> Result<Vec<u8>> {
        let mut least: Option<Vec<u8>> = None;
        let parallel = || QueryError::bad_value("cannot sort with keys that are parallel arrays");
        self.keys
            .each(fields, &mut |key| {
                let bytes = key.encode();
                if least.as_ref().is_none_or(|least| bytes < *least) {
                    least = Some(bytes);
                }
            })
            .map_err(|unclear| unclear.complaint(parallel))?;
        Ok(least.unwrap_or_default())
    }

    /// Returns the documents in order, at most `limit` of them; equal ones stay in the order they came.
    ///
    /// # Errors
    /// The first error of the input, or parallel arrays.
    pub fn sort<E: From<QueryError>>(
        &self,
        documents: impl Iterator<Item = std::result::Result<RawDocumentBuf, E>>,
        limit: Option<usize>,
    ) -> std::result::Result<Vec<RawDocumentBuf>, E> {
        if self.keys.is_empty() {
            let mut all: Vec<_> = if self.reversed {
                documents.collect::<std::result::Result<_, E>>()?
            } else {
                documents.take(limit.unwrap_or(usize::MAX)).collect::<std::result::Result<_, E>>()?
            };
            if self.reversed {
                all.reverse();
                all.truncate(limit.unwrap_or(usize::MAX));
            }
            return Ok(all);
        }
        match limit {
            Some(limit) => self.top(documents, limit),
            None => {
                let keyed = documents.map(|document| {
                    let document = document?;
                    Ok((self.key(&document)?, document))
                });
                let mut all = keyed.collect::<std::result::Result<Vec<_>, E>>()?;
                all.sort_by(|a, b| a.0.cmp(&b.0));
                Ok(all.into_iter().map(|(_, document)| document).collect())
            }
        }
    }

    /// Returns the first few, keeping only so many in memory.
    fn top<E: From<QueryError>>(
        &self,
        documents: impl Iterator<Item = std::result::Result<RawDocumentBuf, E>>,
        limit: usize,
    ) -> std::result::Result<Vec<RawDocumentBuf>, E> {
        let mut heap: BinaryHeap<Ranked> = BinaryHeap::new();
        for (place, document) in documents.enumerate() {
            let document = document?;
            let ranked = Ranked { rank: (self.key(&document)?, place), document };
            if heap.len() < limit {
                heap.push(ranked);
            } else if heap.peek().is_some_and(|worst| ranked.rank < worst.rank) {
                heap.pop();
                heap.push(ranked);
            }
        }
        Ok(heap.into_sorted_vec().into_iter().map(|ranked| ranked.document).collect())
    }
}

/// Returns a direction as an integer: doubles are cut, decimals rounded.
fn coerced(direction: Number) -> i64 {
    match direction {
        Number::Decimal(direction) => Number::Decimal(direction.round_to(0, Rounding::HalfEven)).to_long(),
        other => other.to_long(),
    }
}

/// Refuses empty names and operators in a sort pattern.
fn check_name(name: &str) -> Result<()> {
    if name.split('.').any(str::is_empty) {
        return Err(QueryError::invalid(40_352, "a field path may not have an empty part").about(name));
    }
    if name.split('.').any(|part| part.starts_with('$') && !super::dollar::is_reference_key(part)) {
        return Err(QueryError::invalid(16_410, format!("the sort field {name} may not start with '$'")).about(name));
    }
    Ok(())
}

/// A document with its place, for the heap.
struct Ranked {
    rank: (Vec<u8>, usize),
    document: RawDocumentBuf,
}

impl PartialEq for Ranked {
    fn eq(&self, other: &Self) -> bool {
        self.rank == other.rank
    }
}

impl Eq for Ranked {}

impl PartialOrd for Ranked {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Ranked {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.rank.cmp(&other.rank)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::{doc, rawdoc};

    fn sorted(pattern: Document, documents: &[RawDocumentBuf], limit: Option<usize>) -> Vec<i32> {
        let input = documents.iter().cloned().map(Ok::<_, QueryError>);
        let output = Sort::parse(&pattern).unwrap().sort(input, limit).unwrap();
        output.iter().map(|document| document.get_i32("_id").unwrap()).collect()
    }

    #[test]
    fn takes_the_least_or_the_greatest_of_an_array() {
        let documents = [
            rawdoc! {"_id": 1, "a": [3, 9]},
            rawdoc! {"_id": 2, "a": 5},
            rawdoc! {"_id": 3},
            rawdoc! {"_id": 4, "a": []},
            rawdoc! {"_id": 5, "a": "x"},
        ];
        assert_eq!(sorted(doc! {"a": 1}, &documents, None), [4, 3, 1, 2, 5]);
        assert_eq!(sorted(doc! {"a": -1}, &documents, None), [5, 1, 2, 3, 4]);
        assert_eq!(sorted(doc! {"a": -1}, &documents, Some(2)), [5, 1]);
    }

    #[test]
    fn takes_an_array_at_an_index_as_a_whole() {
        let documents = [
            rawdoc! {"_id": 1, "v": [[1, 2], [3]]},
            rawdoc! {"_id": 2, "v": {"0": "zero"}},
            rawdoc! {"_id": 3, "v": [5]},
            rawdoc! {"_id": 4, "v": [{"a": 1}]},
        ];
        assert_eq!(sorted(doc! {"v.0": 1}, &documents, None), [3, 2, 4, 1]);
        assert_eq!(sorted(doc! {"v.0": -1}, &documents, None), [1, 4, 2, 3]);
    }

    #[test]
    fn refuses_parallel_arrays() {
        let document = rawdoc! {"a": [1], "b": [2]};
        assert!(Sort::parse(&doc! {"a": 1, "b": 1}).unwrap().key(&document).is_err());
    }

    #[test]
    fn an_array_as_id_is_sorted_as_a_whole() {
        let ids = [bson::bson!(null), bson::bson!(1), bson::bson!({}), bson::bson!([]), bson::bson!([0])];
        let sort = Sort::parse(&doc! { "_id": 1 }).unwrap();
        let keys = ids.map(|id| sort.key(&RawDocumentBuf::try_from(&doc! { "_id": id }).unwrap()).unwrap());
        assert!(keys.is_sorted());
    }
}
