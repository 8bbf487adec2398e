//! How the documents of a query are reached: by walking over all of them, or through an index.
//!
//! Positions that an index gives are put in the order of insertion, so that
//! an answer without a sort has the order it has without the index (mongod
//! gives the index's). Where an index has the order of the sort, it is read in
//! that order, a page at a time. The choice between equally promising indexes
//! is made by counting, up to a limit.

use std::collections::{HashSet, VecDeque};
use std::sync::LazyLock;

use bson::{Bson, Document, doc};
use rusqlite::params;

use super::Embedded;
use super::catalog::Collection;
use super::failure;
use super::indexed::{Indexed, Indexes};
use super::keys::Keys;
use super::snapshot::Snapshot;
use crate::query::index::{Access, Candidate, Pattern, Range, alternatives, order, ways};
use crate::query::{Filter, QueryError, QueryMistake, Sort};
use crate::store::{Hint, Index, KeyOptions, StoreError};

/// MongoDB's code for a query that the hinted index cannot answer.
const NO_PLAN: i32 = 291;
/// MongoDB's code for bounds of keys without a hint.
const NO_HINT: i32 = 51_173;
/// MongoDB's code for bounds that are no keys of the hinted index.
const OTHER_KEYS: i32 = 51_174;
/// MongoDB's code for bounds between which there can be no key.
const TURNED: i32 = 51_175;
/// How many keys are counted to choose between indexes.
const PROBE: i64 = 1_000;

/// The pattern of the index on `_id`, which is part of the documents' table.
pub(super) static IDS: LazyLock<Pattern> =
    LazyLock::new(|| Pattern::parse(&doc! { "_id": 1 }).expect("a pattern that is written here"));

/// The index on `_id` as one that may be used.
fn of_ids() -> Candidate<'static> {
    Candidate { pattern: &IDS, multikey: 0, sparse: false }
}

/// The way to the documents of a query.
pub(super) enum Way {
    /// All documents.
    Walk,
    /// Those at these positions, in this order, and what listed them, if anything did.
    Positions(VecDeque<i64>, Vec<Listing>),
    /// Those that a table of keys lists, as it lists them.
    Listed(Listing),
}

/// Ranges of a table with keys, being read.
#[derive(Clone)]
pub(super) struct Listing {
    pub(super) keys: Keys,
    pub(super) ranges: VecDeque<Range>,
    pub(super) backwards: bool,
    /// Whether one entry is listed at most.
    pub(super) is_of_one: bool,
}

impl Listing {
    fn forwards(keys: Keys, ranges: Vec<Range>) -> Self {
        Self { keys, ranges: ranges.into(), backwards: false, is_of_one: false }
    }
}

/// An access path, with what is known of it.
pub(super) struct Chosen {
    pub(super) way: Way,
    /// Whether it gives documents in the order of the sort.
    pub(super) is_sorted: bool,
    /// Its explanation, for `explain`; empty otherwise.
    pub(super) explanation: Document,
    /// How many keys were read to find it.
    pub(super) keys: u64,
}

impl Embedded {
    /// Chooses a way to what a filter may match. With `is_explained`, explains it.
    pub(super) fn choose(
        &self,
        collection: Collection,
        indexes: &Indexes,
        filter: &Filter,
        sort: &Sort,
        is_explained: bool,
    ) -> Result<Chosen, StoreError> {
        let kept: Vec<&Indexed> = indexes.iter().filter(|index| index.is_used()).collect();
        let candidates: Vec<Candidate<'_>> =
            [of_ids()].into_iter().chain(kept.iter().map(|index| candidate(index))).collect();
        let index = |candidate: usize| candidate.checked_sub(1).and_then(|nth| kept.get(nth));
        let keys = |candidate| index(candidate).map_or_else(|| Keys::of_documents(collection), |index| index.keys());
        let explanation = |access: &Access<'_>| match is_explained {
            false => Document::new(),
            true => {
                let (definition, pattern) = match index(access.candidate) {
                    Some(index) => (index.definition.clone(), &index.pattern),
                    None => (Index::of_ids(), &*IDS),
                };
                doc! { "index": definition.name, "keys": definition.keys, "bounds": access.bounds(pattern) }
            }
        };
        let found = ways(filter, sort, &candidates);
        if let Some(access) = self.best(found, |candidate| keys(candidate).table)? {
            let (explanation, keys, is_sorted) =
                (explanation(&access), keys(access.candidate), access.sorted.is_some());
            let backwards = access.sorted.unwrap_or(false);
            if access.is_natural && sort.is_empty() || is_sorted && !sort.is_empty() {
                let is_unique = index(access.candidate).is_none_or(|index| index.definition.unique);
                let is_of_one = access.is_natural && is_unique;
                let listing = Listing { keys, ranges: in_turn(access.ranges, backwards), backwards, is_of_one };
                return Ok(Chosen { way: Way::Listed(listing), is_sorted, explanation, keys: 0 });
            }
            return self.positions(vec![Listing::forwards(keys, access.ranges)], explanation, sort.is_empty());
        }
        let Some(parts) = alternatives(filter, &candidates) else {
            let explanation = if is_explained {
                doc! { "index": Bson::Null }
            } else {
                Document::new()
            };
            return Ok(Chosen { way: Way::Walk, is_sorted: sort.is_empty(), explanation, keys: 0 });
        };
        let explanation = match is_explained {
            true => doc! { "any": parts.iter().map(explanation).collect::<Vec<_>>() },
            false => Document::new(),
        };
        let parts = parts.into_iter().map(|access| Listing::forwards(keys(access.candidate), access.ranges));
        self.positions(parts.collect(), explanation, sort.is_empty())
    }

    /// The way through the index that a hint names: between the bounds of the filter, or the whole of it.
    ///
    /// # Errors
    /// Where there is no such index.
    pub(super) fn hinted(
        &self,
        collection: Collection,
        indexes: &Indexes,
        filter: &Filter,
        sort: &Sort,
        hint: &Hint,
    ) -> Result<Chosen, StoreError> {
        let walk = |positions: Option<VecDeque<i64>>| Chosen {
            way: positions.map_or(Way::Walk, |positions| Way::Positions(positions, Vec::new())),
            is_sorted: sort.is_empty(),
            explanation: doc! { "index": Bson::Null },
            keys: 0,
        };
        let (index, candidate, keys) = match named(indexes, hint)? {
            Named::None { backwards: false } => return Ok(walk(None)),
            Named::None { backwards: true } => return Ok(walk(Some(self.backwards(collection)?))),
            Named::Ids => (Index::of_ids(), of_ids(), Keys::of_documents(collection)),
            // What has no keys is answered by all documents.
            Named::Index(index) if !index.pattern.serves(filter) => {
                let message = "the hint names a wildcard index, and the query asks for none of its paths";
                return Err(QueryError::invalid(NO_PLAN, message).of_kind(QueryMistake::Hint).into());
            }
            Named::Index(index) if !index.is_kept() => return Ok(walk(None)),
            Named::Index(index) => (index.definition.clone(), candidate(index), index.keys()),
        };
        let access = ways(filter, sort, &[candidate]).pop();
        let bounds = access.as_ref().map(|access| access.bounds(candidate.pattern)).unwrap_or_default();
        let all = || vec![Range { low: Vec::new(), high: vec![0xff; 2] }];
        let (is_sorted, backwards, ranges) = match access {
            Some(access) => (access.sorted.is_some(), access.sorted.unwrap_or(false), access.ranges),
            None => (sort.is_empty(), false, all()),
        };
        let listing = Listing { keys, ranges: in_turn(ranges, backwards), backwards, is_of_one: false };
        let explanation = doc! { "index": index.name, "keys": index.keys, "bounds": bounds };
        self.along_index(listing, is_sorted || sort.is_empty(), explanation)
    }

    /// The way through the index that a hint names, from one key up to another.
    ///
    /// # Errors
    /// Where there is no such index, or it has no such keys.
    pub(super) fn between(
        &self,
        collection: Collection,
        indexes: &Indexes,
        sort: &Sort,
        hint: Option<&Hint>,
        bounds: &KeyOptions,
    ) -> Result<Chosen, StoreError> {
        let refuse = |code, message: &str| QueryError::invalid(code, message).of_kind(QueryMistake::Hint);
        let hint = hint.ok_or_else(|| refuse(NO_HINT, "min and max need a hint: which index they are keys of"))?;
        let (index, candidate, keys) = match named(indexes, hint)? {
            Named::None { .. } => return Err(refuse(NO_PLAN, "min and max are incompatible with $natural").into()),
            Named::Ids => (Index::of_ids(), of_ids(), Keys::of_documents(collection)),
            Named::Index(index) if !index.is_kept() && !index.pattern.is_wildcard() || index.pattern.is_hashed() => {
                return Err(QueryError::unsupported("min and max of a hashed, geospatial or text index").into());
            }
            Named::Index(index) => (index.definition.clone(), candidate(index), index.keys()),
        };
        let key = |values: &Document, open: Vec<u8>| match values.is_empty() {
            true => Ok(open),
            false => candidate.pattern.bound(values).ok_or_else(|| {
                refuse(
                    OTHER_KEYS,
                    "min and max need a value for each key of the hinted index, in its order and collation",
                )
            }),
        };
        let range = Range { low: key(&bounds.min, Vec::new())?, high: key(&bounds.max, vec![0xff; 2])? };
        if range.low >= range.high {
            return Err(refuse(TURNED, "min has to be before max in the hinted index").into());
        }
        let backwards = order(sort, candidate);
        let ranges = [range].into();
        let listing = Listing { keys, ranges, backwards: backwards.unwrap_or(false), is_of_one: false };
        let explanation = doc! { "index": index.name, "keys": index.keys, "bounds": {} };
        self.along_index(listing, backwards.is_some(), explanation)
    }

    /// The way to what ranges of an index list, in its order.
    fn along_index(&self, listing: Listing, is_sorted: bool, explanation: Document) -> Result<Chosen, StoreError> {
        let positions = self.listed(&listing).map_err(|e| self.explain(&e))?;
        let keys = positions.len() as u64;
        Ok(Chosen { way: Way::Positions(positions, vec![listing]), is_sorted, explanation, keys })
    }

    /// The positions of all documents, the last one first.
    fn backwards(&self, collection: Collection) -> Result<VecDeque<i64>, StoreError> {
        let sql = format!("SELECT position FROM {} ORDER BY position DESC", collection.table());
        let list = || -> rusqlite::Result<VecDeque<i64>> {
            self.connection.prepare_cached(&sql)?.query_map([], |row| row.get(0))?.collect()
        };
        list().map_err(|e| self.explain(&e))
    }

    /// The positions that a table of keys lists, in its order, each once.
    fn listed(&self, listing: &Listing) -> rusqlite::Result<VecDeque<i64>> {
        let (mut positions, mut seen) = (VecDeque::new(), HashSet::new());
        self.each_listed(listing, &mut |position| {
            if seen.insert(position) {
                positions.push_back(position);
            }
        })?;
        Ok(positions)
    }

    /// Shows the positions that a table of keys lists, in its order.
    fn each_listed(&self, listing: &Listing, take: &mut dyn FnMut(i64)) -> rusqlite::Result<()> {
        let _snapshot = Snapshot::begin(&self.connection)?;
        listing.ranges.iter().try_for_each(|range| listing.read_positions(&self.connection, range, None, take))
    }

    /// The one of several ways with the fewest keys.
    fn best<'f>(
        &self,
        mut ways: Vec<Access<'f>>,
        table: impl Fn(usize) -> String,
    ) -> Result<Option<Access<'f>>, StoreError> {
        if ways.len() < 2 {
            return Ok(ways.pop());
        }
        let mut best: Option<(i64, Access<'f>)> = None;
        for way in ways {
            let keys = self.probe(&table(way.candidate), &way.ranges)?;
            if best.as_ref().is_none_or(|(fewest, _)| keys < *fewest) {
                best = Some((keys, way));
            }
        }
        Ok(best.map(|(_, way)| way))
    }

    /// How many keys there are in the ranges, counted up to [`PROBE`].
    fn probe(&self, table: &str, ranges: &[Range]) -> Result<i64, StoreError> {
        let sql = format!("SELECT count(*) FROM (SELECT 1 FROM {table} WHERE key >= ? AND key < ? LIMIT ?)");
        let count = || -> rusqlite::Result<i64> {
            let mut statement = self.connection.prepare_cached(&sql)?;
            let mut keys = 0;
            for range in ranges {
                keys +=
                    statement.query_row(params![range.low, range.high, PROBE - keys], |row| row.get::<_, i64>(0))?;
                if keys >= PROBE {
                    break;
                }
            }
            Ok(keys)
        };
        match count() {
            Err(error) if failure::is_gone(&error) => Ok(PROBE),
            counted => counted.map_err(|e| self.explain(&e)),
        }
    }

    /// The positions that ranges of tables list, in order of insertion, each
    /// once. Where a table is gone, all documents have to be looked at.
    fn positions(&self, parts: Vec<Listing>, explanation: Document, is_sorted: bool) -> Result<Chosen, StoreError> {
        let mut positions: Vec<i64> = Vec::new();
        for part in &parts {
            match self.each_listed(part, &mut |position| positions.push(position)) {
                Err(error) if failure::is_gone(&error) => {
                    return Ok(Chosen { way: Way::Walk, is_sorted, explanation, keys: 0 });
                }
                listed => listed.map_err(|e| self.explain(&e))?,
            }
        }
        let keys = positions.len() as u64;
        positions.sort_unstable();
        positions.dedup();
        Ok(Chosen { way: Way::Positions(positions.into(), parts), is_sorted, explanation, keys })
    }

    /// How many documents have a date at or before `date` in the index on decay.
    pub(super) fn decayed(&self, index: &Indexed, date: bson::DateTime) -> Result<u64, StoreError> {
        let filter = Filter::parse(&doc! { crate::store::metadata::DECAY_PATH: { "$lte": date } })?;
        let candidate = Candidate { sparse: true, ..candidate(index) };
        let Some(access) = ways(&filter, &Sort::none(), &[candidate]).pop() else {
            return Err(QueryError::bad_value("the index on decay has no dates").into());
        };
        let mut positions = Vec::new();
        let part = Listing::forwards(index.keys(), access.ranges);
        self.each_listed(&part, &mut |position| positions.push(position)).map_err(|e| self.explain(&e))?;
        positions.sort_unstable();
        positions.dedup();
        Ok(positions.len() as u64)
    }
}

/// What a hint names.
enum Named<'i> {
    /// No index: all documents, forwards or backwards.
    None { backwards: bool },
    /// The index on `_id` that is part of the documents' table.
    Ids,
    /// Another index.
    Index(&'i Indexed),
}

/// The index that a hint names.
///
/// # Errors
/// Where there is none that queries use.
fn named<'i>(indexes: &'i Indexes, hint: &Hint) -> Result<Named<'i>, StoreError> {
    let is_meant = |index: &Index| match hint {
        Hint::Name(name) => index.name == *name,
        Hint::Keys(keys) => index.has_keys(keys),
        Hint::Natural { .. } => false,
    };
    match (hint, indexes.iter().find(|index| is_meant(&index.definition))) {
        (Hint::Natural { backwards }, _) => Ok(Named::None { backwards: *backwards }),
        (_, Some(index)) if !index.is_hidden() => Ok(Named::Index(index)),
        (_, None) if is_meant(&Index::of_ids()) => Ok(Named::Ids),
        _ => Err(no_hinted()),
    }
}

/// The error for a hint that names no index.
fn no_hinted() -> StoreError {
    let message = "the hint names no index that queries use: `rmem index NS` lists the indexes";
    QueryError::bad_value(message).of_kind(QueryMistake::Hint).into()
}

fn candidate(index: &Indexed) -> Candidate<'_> {
    Candidate { pattern: &index.pattern, multikey: index.multikey(), sparse: index.definition.sparse }
}

/// The ranges in the order in which they are read.
fn in_turn(mut ranges: Vec<Range>, backwards: bool) -> VecDeque<Range> {
    if backwards {
        ranges.reverse();
    }
    ranges.into()
}
