//! Sort patterns, and sorting with and without a limit.

use std::collections::BinaryHeap;

use bson::{Bson, Document, RawDocument, RawDocumentBuf};

use super::error::{QueryError, Result};
use super::keys::Keys;
use super::limit::ALLOCATION;
use super::number::Number;
use super::path::Path;
use super::spill::{Sorter, Spill};
use super::text;
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
                let Some(argument) = meta.get("$meta") else {
                    return Err(QueryError::invalid(17_312, "the only object for a sort direction is {$meta: …}")
                        .about("$meta"));
                };
                if meta.len() > 1 {
                    return Err(
                        QueryError::failed_to_parse("{$meta: …} may have no other field in a sort").about("$meta")
                    );
                }
                if !matches!(argument, Bson::String(_)) {
                    return Err(
                        QueryError::invalid(31_138, "the argument of $meta in a sort must be a string").about("$meta")
                    );
                }
                check_meta(argument)?;
                text::meta(argument)?;
                // The best come first.
                sort.keys.push(Path::parse(text::SCORE)?, true);
                continue;
            }
            let descending = match Number::of(direction).map(Number::coerced) {
                Some(1) => false,
                Some(-1) => true,
                Some(_) => return Err(QueryError::invalid(15_975, "a sort direction must be 1 or -1").about(name)),
                None => return Err(QueryError::invalid(15_974, "a sort direction must be a number").about(name)),
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

    /// Returns the documents in order, at most `limit` of them; equal ones stay in the order they came. Beyond the
    /// limit of memory they go to temporary files.
    ///
    /// # Errors
    /// The first error of the input, parallel arrays, or a temporary file that cannot be used.
    pub fn sort<E: From<QueryError>>(
        &self,
        mut documents: impl Iterator<Item = std::result::Result<RawDocumentBuf, E>>,
        limit: Option<usize>,
        spill: &Spill,
    ) -> std::result::Result<Sorted, E> {
        let first = match limit.map(|limit| self.top(&mut documents, limit, spill.limit)).transpose()? {
            Some(Ok(all)) => {
                let all = all.into_sorted_vec().into_iter().map(|ranked| Ok(ranked.document));
                return Ok(Sorted(Box::new(all)));
            }
            Some(Err(first)) => first,
            None => Vec::new(),
        };
        let mut sorter = Sorter::new(spill);
        let mut place = 0;
        for ranked in first {
            place = ranked.rank.1 + 1;
            sorter.add(&ranked.rank.0, ranked.document.as_bytes())?;
        }
        for (place, document) in (place..).zip(documents) {
            let document = document?;
            sorter.add(&self.rank(&document, place)?.0, document.as_bytes())?;
        }
        let sorted = sorter.finish()?.take(limit.unwrap_or(usize::MAX));
        Ok(Sorted(Box::new(sorted.map(|body| Ok(RawDocumentBuf::from_bytes(body?)?)))))
    }

    /// Returns the place of a document among all: its key, and for equal ones which came first.
    fn rank(&self, document: &RawDocument, place: usize) -> Result<(Vec<u8>, usize)> {
        match (self.keys.is_empty(), self.reversed) {
            (false, _) => Ok((self.key(document)?, place)),
            (true, false) => Ok((Vec::new(), place)),
            (true, true) => Ok(((usize::MAX - place).to_be_bytes().to_vec(), place)),
        }
    }

    /// Returns the first few, keeping only so many in memory; those that were read, in the order they came, where
    /// even they are more than `most` bytes.
    fn top<E: From<QueryError>>(
        &self,
        documents: &mut impl Iterator<Item = std::result::Result<RawDocumentBuf, E>>,
        limit: usize,
        most: usize,
    ) -> std::result::Result<std::result::Result<BinaryHeap<Ranked>, Vec<Ranked>>, E> {
        let mut heap: BinaryHeap<Ranked> = BinaryHeap::new();
        let (mut held, mut place) = (0, 0);
        while held <= most {
            if heap.len() == limit && self.keys.is_empty() && !self.reversed {
                return Ok(Ok(heap));
            }
            let Some(document) = documents.next() else { return Ok(Ok(heap)) };
            let document = document?;
            let ranked = Ranked { rank: self.rank(&document, place)?, document };
            place += 1;
            if heap.len() < limit {
                held += ranked.bytes();
                heap.push(ranked);
            } else if heap.peek().is_some_and(|worst| ranked.rank < worst.rank) {
                held += ranked.bytes();
                held -= heap.pop().map_or(0, |worst| worst.bytes());
                heap.push(ranked);
            }
        }
        let mut first = heap.into_vec();
        first.sort_unstable_by_key(|ranked| ranked.rank.1);
        Ok(Err(first))
    }
}

/// Documents in order.
pub struct Sorted(Box<dyn Iterator<Item = Result<RawDocumentBuf>>>);

impl std::fmt::Debug for Sorted {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Sorted").finish_non_exhaustive()
    }
}

impl Iterator for Sorted {
    type Item = Result<RawDocumentBuf>;

    fn next(&mut self) -> Option<Self::Item> {
        self.0.next()
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

impl Ranked {
    /// Returns the memory that it needs.
    fn bytes(&self) -> usize {
        size_of::<Self>() + 2 * ALLOCATION + self.rank.0.len() + self.document.as_bytes().len()
    }
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

/// Refuses metadata that MongoDB does not sort by.
fn check_meta(argument: &Bson) -> Result<()> {
    match argument.as_str() {
        Some("textScore" | "randVal" | "geoNearDistance" | "searchScore") | None => Ok(()),
        Some(name) => {
            Err(QueryError::invalid(31_138, format!("a sort cannot be by {{$meta: \"{name}\"}}")).about("$meta"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::{doc, rawdoc};

    fn sorted(pattern: Document, documents: &[RawDocumentBuf], limit: Option<usize>) -> Vec<i32> {
        let input = documents.iter().cloned().map(Ok::<_, QueryError>);
        let output = Sort::parse(&pattern).unwrap().sort(input, limit, &Spill::default()).unwrap();
        output.map(|document| document.unwrap().get_i32("_id").unwrap()).collect()
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
