//! Which index answers a query, and between which keys.

use bson::{Bson, Document};

use super::bounds::{IndexedPath, Interval, Intervals, of_node, successor};
use super::pattern::Pattern;
use crate::query::filter::{Filter, Node};
use crate::query::sort::Sort;

/// At most so many ranges are read for one query; what would need more is bounded by fewer fields.
const MAX_RANGES: usize = 1_000;

/// An index that may be used.
#[derive(Debug, Clone, Copy)]
pub struct Candidate<'a> {
    /// Its paths.
    pub pattern: &'a Pattern,
    /// The paths that run through an array in some document, as bits.
    pub multikey: u64,
    /// Documents without its fields are not in it.
    pub sparse: bool,
}

/// Keys from `low` on, up to and without `high`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Range {
    /// The first key.
    pub low: Vec<u8>,
    /// The first key behind the range.
    pub high: Vec<u8>,
}

/// A plan that reads ranges of one index.
#[derive(Debug)]
pub struct Access<'f> {
    /// Which candidate.
    pub candidate: usize,
    /// What is read of it, in order.
    pub ranges: Vec<Range>,
    /// Whether its order is that of the sort, and then whether backwards.
    pub sorted: Option<bool>,
    /// Whether all documents in the ranges are in order of insertion: there is one key.
    pub is_natural: bool,
    fields: Vec<Option<Intervals<'f>>>,
    rank: Rank,
}

/// The rank of a plan: by fields with fixed values, then with any bounds, then by the sort.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Rank {
    points: usize,
    is_bounded: bool,
    is_sorted: bool,
}

/// Returns the plans that find the matches through indexes, the most promising first. Several
/// are given only where they are equally good as far as can be seen from here.
/// Each gives all matches and, perhaps, more.
#[must_use]
pub fn ways<'f>(filter: &'f Filter, sort: &Sort, candidates: &[Candidate<'_>]) -> Vec<Access<'f>> {
    of_filter(filter.root(), sort, candidates)
}

/// For a filter with alternatives, none of whose paths bounds all of it: a way
/// to each alternative. The matches of one may be matches of another.
#[must_use]
pub fn alternatives<'f>(filter: &'f Filter, candidates: &[Candidate<'_>]) -> Option<Vec<Access<'f>>> {
    let branches = match filter.root() {
        Node::Or(branches) => branches,
        Node::And(children) => children.iter().find_map(|child| match child {
            Node::Or(branches) => Some(branches),
            _ => None,
        })?,
        _ => return None,
    };
    let way = |branch| {
        let mut ways = of_filter(branch, &Sort::none(), candidates);
        if ways.is_empty() { None } else { Some(ways.swap_remove(0)) }
    };
    branches.iter().map(way).collect()
}

/// Returns whether an index that is read as a whole, or between two keys, has the order of the sort: forwards (false) or
/// backwards (true).
#[must_use]
pub fn order(sort: &Sort, candidate: Candidate<'_>) -> Option<bool> {
    in_order(sort, candidate, 0)
}

fn of_filter<'f>(root: &'f Node, sort: &Sort, candidates: &[Candidate<'_>]) -> Vec<Access<'f>> {
    let mut ways: Vec<_> = candidates
        .iter()
        .enumerate()
        .filter(|(_, candidate)| !candidate.pattern.is_geospatial())
        .filter_map(|(index, candidate)| access(root, sort, index, *candidate))
        .collect();
    ways.sort_by_key(|way| std::cmp::Reverse(way.rank));
    let best = ways.first().map(|way| way.rank);
    ways.retain(|way| Some(way.rank) == best);
    ways
}

fn access<'f>(root: &'f Node, sort: &Sort, candidate: usize, index: Candidate<'_>) -> Option<Access<'f>> {
    let fields = bounds(root, index);
    let points = fields.iter().take_while(|field| matches!(field, Some(all) if all.iter().all(|i| i.is_point))).count();
    let is_bounded = matches!(fields.first(), Some(Some(_)));
    let constant = fields.iter().take_while(|field| matches!(field, Some(all) if all.len() == 1 && all[0].is_point));
    let sorted = in_order(sort, index, constant.count());
    // A sparse index has not all documents, unless a condition on a field asks for it.
    if !is_bounded && (sorted.is_none() || index.sparse || sort.is_empty()) {
        return None;
    }
    let ranges = ranges(&fields, index.pattern);
    let is_natural = ranges.len() == 1 && points == fields.len();
    let rank = Rank { points, is_bounded, is_sorted: sorted.is_some() && !sort.is_empty() };
    Some(Access { candidate, ranges, sorted, is_natural, fields, rank })
}

/// What the filter says about each path, up to and with the first that is not fixed to points.
fn bounds<'f>(root: &'f Node, index: Candidate<'_>) -> Vec<Option<Intervals<'f>>> {
    let (mut fields, mut is_open, mut arrays, mut count) = (Vec::new(), true, false, 1usize);
    for (nth, (path, _)) in index.pattern.fields().enumerate() {
        let multikey = index.multikey >> nth.min(63) & 1 == 1;
        // Two paths through one array: their conditions may hold of different elements.
        let usable = is_open && !(multikey && arrays);
        let intervals = match usable {
            true => of_node(root, &IndexedPath { path, multikey, sparse: index.sparse, pattern: index.pattern }),
            false => None,
        };
        let intervals = intervals.filter(|all| count.saturating_mul(all.len()) <= MAX_RANGES || nth == 0);
        if let Some(all) = &intervals {
            arrays |= multikey;
            count = count.saturating_mul(all.len());
        }
        is_open = matches!(&intervals, Some(all) if all.iter().all(|interval| interval.is_point));
        fields.push(intervals);
    }
    fields
}

/// Returns whether the index has the order of the sort: forwards (false) or backwards
/// (true). Its first fields are `constant`, which sorting need not look at.
fn in_order(sort: &Sort, index: Candidate<'_>, constant: usize) -> Option<bool> {
    if sort.is_empty() {
        return Some(false);
    }
    if sort.is_natural() || index.multikey != 0 || !index.pattern.is_in_effect() {
        return None;
    }
    let fixed: Vec<&str> = index.pattern.fields().take(constant).map(|(path, _)| path).collect();
    let mut kept = index.pattern.fields().skip(constant);
    let mut backwards = None;
    for (path, descending) in sort.fields().filter(|(path, _)| !fixed.contains(path)) {
        let (own, own_descending) = kept.next()?;
        let turned = descending != own_descending;
        if own != path || backwards.is_some_and(|backwards| backwards != turned) {
            return None;
        }
        backwards = Some(turned);
    }
    Some(backwards.unwrap_or(false))
}

/// Returns the ranges of keys, in their order.
fn ranges(fields: &[Option<Intervals<'_>>], pattern: &Pattern) -> Vec<Range> {
    let mut prefixes: Vec<Vec<u8>> = vec![Vec::new()];
    let mut ranges = None;
    for (field, (_, descending)) in fields.iter().zip(pattern.fields()) {
        let Some(intervals) = field else { break };
        let turned: Vec<(Vec<u8>, Vec<u8>)> = turned(intervals, descending);
        if intervals.iter().all(|interval| interval.is_point) {
            let extended = prefixes.iter().flat_map(|prefix| turned.iter().map(|(low, _)| joined(prefix, low)));
            prefixes = extended.collect();
            continue;
        }
        let all = prefixes.iter().flat_map(|prefix| {
            turned.iter().map(|(low, high)| Range { low: joined(prefix, low), high: joined(prefix, high) })
        });
        ranges = Some(all.collect());
        break;
    }
    ranges.unwrap_or_else(|| {
        let whole = |prefix: Vec<u8>| match prefix.is_empty() {
            true => Range { low: Vec::new(), high: vec![0xff; 2] },
            false => Range { high: successor(prefix.clone()), low: prefix },
        };
        prefixes.into_iter().map(whole).collect()
    })
}

/// Returns the limits of intervals as bytes of the index, in its order.
fn turned(intervals: &[Interval<'_>], descending: bool) -> Vec<(Vec<u8>, Vec<u8>)> {
    if !descending {
        return intervals.iter().map(|interval| (interval.low.place(), interval.high.place())).collect();
    }
    let turn = |interval: &Interval<'_>| (interval.high.inverted().place(), interval.low.inverted().place());
    intervals.iter().rev().map(turn).collect()
}

fn joined(prefix: &[u8], rest: &[u8]) -> Vec<u8> {
    [prefix, rest].concat()
}

impl Access<'_> {
    /// Returns the bounds, path by path, in words.
    #[must_use]
    pub fn bounds(&self, pattern: &Pattern) -> Document {
        let words = |field: &Option<Intervals<'_>>| match field {
            None => vec![Bson::from("all")],
            Some(intervals) => intervals.iter().map(|interval| interval.to_string().into()).collect(),
        };
        let fields = pattern.fields().zip(&self.fields);
        fields.map(|((path, _), field)| (path.to_owned(), Bson::Array(words(field)))).collect()
    }
}
