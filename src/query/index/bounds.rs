//! Which keys of an index a filter can match: intervals of values on one path.
//!
//! As in mongod, a comparison is bounded by its type, and what several
//! conditions say of one path may be combined only where no document has an
//! array there: of an array, one element may pass the one and another the
//! other. Intervals may be too wide, never too narrow; the filter is applied to
//! what they hold. Negations say nothing.

use bson::Bson;

use super::pattern::{Pattern, may_have_strings};
use crate::query::compare::canonical_type;
use crate::query::filter::{Leaf, Node, Order, Set, Test};
use crate::query::key;
use crate::query::number::Number;
use crate::query::path::Path;
use crate::query::view::View;

/// The place of undefined, which an empty array is, in the order of types.
const UNDEFINED: u8 = 2;
/// The place of null.
const NULL: u8 = 5;
/// The place of strings.
const STRING: u8 = 15;
/// The place of regular expressions, which a pattern matches too.
const REGEX: u8 = 50;

/// A position between keys: before or after all keys with some prefix.
#[derive(Debug, Clone)]
pub(super) struct Limit<'f> {
    pub(super) bytes: Vec<u8>,
    pub(super) after: bool,
    /// The value it was made from; none at the end of a type.
    value: Option<&'f Bson>,
}

/// The values between two places.
#[derive(Debug, Clone)]
pub(super) struct Interval<'f> {
    pub(super) low: Limit<'f>,
    pub(super) high: Limit<'f>,
    pub(super) is_point: bool,
}

/// Intervals in order that do not overlap.
pub(super) type Intervals<'f> = Vec<Interval<'f>>;

/// A path of an index, as bounds are made for it.
pub(super) struct IndexedPath<'a> {
    pub(super) path: &'a str,
    /// Some document has an array there.
    pub(super) multikey: bool,
    /// Documents that lack the field are not in the index.
    pub(super) sparse: bool,
    /// The index.
    pub(super) pattern: &'a Pattern,
}

/// What a filter says about a path; `None` if it says nothing that an index could use.
pub(super) fn of_node<'f>(node: &'f Node, place: &IndexedPath<'_>) -> Option<Intervals<'f>> {
    match node {
        Node::And(children) => both(children.iter().filter_map(|child| of_node(child, place)), place.multikey),
        Node::Or(children) => {
            let all: Option<Vec<_>> = children.iter().map(|child| of_node(child, place)).collect();
            all.map(|all| either(all.into_iter().flatten().collect()))
        }
        Node::Field(path, test) if path.text() == place.path => of_test(test, place),
        Node::Field(path, test) => of_elements(path, test, place),
        Node::Always(false) => Some(Vec::new()),
        _ => None,
    }
}

/// What `$elemMatch` says about a field of the elements.
fn of_elements<'f>(path: &Path, test: &'f Test, place: &IndexedPath<'_>) -> Option<Intervals<'f>> {
    let inner = place.path.strip_prefix(path.text())?.strip_prefix('.')?;
    match test {
        Test::And(tests) => both(tests.iter().filter_map(|test| of_elements(path, test, place)), place.multikey),
        Test::Leaf(Leaf::ElementMatches(node)) if !place.is_positional() => {
            of_node(node, &IndexedPath { path: inner, ..*place })
        }
        _ => None,
    }
}

fn of_test<'f>(test: &'f Test, place: &IndexedPath<'_>) -> Option<Intervals<'f>> {
    match test {
        Test::And(tests) => both(tests.iter().filter_map(|test| of_test(test, place)), place.multikey),
        Test::Not(_) => None,
        Test::Leaf(leaf) => of_leaf(leaf, place),
    }
}

fn of_leaf<'f>(leaf: &'f Leaf, place: &IndexedPath<'_>) -> Option<Intervals<'f>> {
    // Where strings compare in another way than in the index, only other values have their places there.
    if !place.pattern.is_in_effect() && has_strings(leaf) {
        return None;
    }
    match leaf {
        Leaf::Equal(value) => equal(value, place),
        Leaf::In(set) => one_of(set, place),
        Leaf::Order(order, bound) => ordered(*order, bound, place),
        Leaf::Regex(pattern) => matching(&pattern.pattern, &pattern.options, place),
        // One element passes all of it.
        Leaf::ElementPasses(test) if !place.is_positional() => {
            of_test(test, &IndexedPath { multikey: false, ..*place })
        }
        Leaf::Never => Some(Vec::new()),
        _ => None,
    }
}

/// Returns whether a test compares strings, or values that may contain some.
fn has_strings(leaf: &Leaf) -> bool {
    match leaf {
        Leaf::Equal(value) | Leaf::Order(_, value) => may_have_strings(value),
        Leaf::In(set) => set.values.iter().any(may_have_strings),
        _ => false,
    }
}

impl IndexedPath<'_> {
    /// Returns whether a part of the path may be the index of an element.
    fn is_positional(&self) -> bool {
        self.path.split('.').any(|part| part.bytes().all(|byte| byte.is_ascii_digit()))
    }
}

fn equal<'f>(value: &'f Bson, place: &IndexedPath<'_>) -> Option<Intervals<'f>> {
    match value {
        Bson::Null => null(place),
        // The array may be the value, whose first element is a key then, or an element.
        Bson::Array(items) => {
            let first = items.first().map_or_else(|| Interval::of_type(UNDEFINED), |item| Interval::point(item, place));
            Some(either(vec![first, Interval::point(value, place)]))
        }
        value => Some(vec![Interval::point(value, place)]),
    }
}

/// Null equals what is missing, which a sparse index lacks, and which a number
/// in a path that is no index of an array gives more often than there are keys.
fn null<'f>(place: &IndexedPath<'_>) -> Option<Intervals<'f>> {
    let usable = !place.sparse && !place.is_positional();
    usable.then(|| vec![Interval::of_type(UNDEFINED), Interval::of_type(NULL)])
}

fn one_of<'f>(set: &'f Set, place: &IndexedPath<'_>) -> Option<Intervals<'f>> {
    let values = set.values.iter().map(|value| equal(value, place));
    let patterns = set.patterns.iter().map(|pattern| matching(&pattern.pattern, &pattern.options, place));
    let all: Option<Vec<_>> = values.chain(patterns).collect();
    all.map(|all| either(all.into_iter().flatten().collect()))
}

fn ordered<'f>(order: Order, bound: &'f Bson, place: &IndexedPath<'_>) -> Option<Intervals<'f>> {
    match bound {
        Bson::Null => return null(place),
        Bson::Array(_) | Bson::MinKey | Bson::MaxKey | Bson::Undefined => return None,
        _ => {}
    }
    let view = View::from(bound);
    if matches!(view, View::Number(number) if Number::is_nan(number)) {
        return Some(vec![Interval::point(bound, place)]);
    }
    let whole = Interval::of_type(canonical_type(view));
    let at = |after| Limit { bytes: place.pattern.encode(bound), after, value: Some(bound) };
    let (low, high) = match order {
        Order::Less => (whole.low, at(false)),
        Order::LessOrEqual => (whole.low, at(true)),
        Order::Greater => (at(true), whole.high),
        Order::GreaterOrEqual => (at(false), whole.high),
    };
    Some(vec![Interval { low, high, is_point: false }])
}

/// Returns the texts that begin as a pattern says they must, and patterns, which match themselves.
fn matching<'f>(pattern: &str, options: &str, place: &IndexedPath<'_>) -> Option<Intervals<'f>> {
    if place.pattern.collation().is_some() {
        return None;
    }
    let prefix = literal_prefix(pattern).filter(|prefix| !prefix.is_empty() && options.is_empty())?;
    let mut bytes = key::encode_value(&Bson::String(prefix));
    // Without the end of the text, which is two zeros.
    bytes.truncate(bytes.len().saturating_sub(2));
    let limit = |after| Limit { bytes: bytes.clone(), after, value: None };
    let texts = Interval { low: limit(false), high: limit(true), is_point: false };
    debug_assert_eq!(bytes.first(), Some(&STRING));
    Some(vec![texts, Interval::of_type(REGEX)])
}

/// What every text begins with that a pattern matches, where it says so plainly: `^abc…`.
fn literal_prefix(pattern: &str) -> Option<String> {
    let rest = pattern.strip_prefix('^')?;
    if rest.contains('|') {
        return None;
    }
    let (mut prefix, mut chars) = (String::new(), rest.chars().peekable());
    while let Some(char) = chars.next() {
        let literal = match char {
            '\\' => chars.next().filter(|escaped| escaped.is_ascii_punctuation()),
            char if ".[](){}*+?^$".contains(char) => None,
            char => Some(char),
        };
        match (literal, chars.peek()) {
            (Some(_), Some('*' | '?' | '{')) | (None, _) => break,
            (Some(literal), _) => prefix.push(literal),
        }
    }
    Some(prefix)
}

/// What holds of values for which all of these do: their intersection or,
/// where it may be different elements that pass, the narrowest of them.
fn both<'f>(all: impl Iterator<Item = Intervals<'f>>, multikey: bool) -> Option<Intervals<'f>> {
    all.reduce(|a, b| match multikey {
        false => intersection(&a, &b),
        true if breadth(&b) < breadth(&a) => b,
        true => a,
    })
}

/// Returns a measure of how much intervals hold: ranges more than points.
fn breadth(intervals: &[Interval<'_>]) -> usize {
    intervals.iter().map(|interval| if interval.is_point { 1 } else { 1_000 }).sum()
}

fn intersection<'f>(a: &[Interval<'f>], b: &[Interval<'f>]) -> Intervals<'f> {
    let mut common = Vec::new();
    for first in a {
        for second in b {
            let low = if first.low.place() < second.low.place() { &second.low } else { &first.low };
            let high = if first.high.place() < second.high.place() { &first.high } else { &second.high };
            if low.place() < high.place() {
                let is_point = first.is_point || second.is_point;
                common.push(Interval { low: low.clone(), high: high.clone(), is_point });
            }
        }
    }
    common.sort_by_key(|interval| interval.low.place());
    common
}

/// Returns the union, in order.
fn either(mut all: Intervals<'_>) -> Intervals<'_> {
    all.sort_by_key(|interval| interval.low.place());
    let mut merged: Intervals<'_> = Vec::with_capacity(all.len());
    for interval in all {
        match merged.last_mut() {
            Some(last) if interval.low.place() < last.high.place() => {
                if last.high.place() < interval.high.place() {
                    last.high = interval.high;
                    last.is_point = false;
                }
            }
            _ => merged.push(interval),
        }
    }
    merged
}

impl<'f> Interval<'f> {
    fn point(value: &'f Bson, place: &IndexedPath<'_>) -> Self {
        let bytes = place.pattern.encode(value);
        let limit = |bytes, after| Limit { bytes, after, value: Some(value) };
        Self { low: limit(bytes.clone(), false), high: limit(bytes, true), is_point: true }
    }

    /// All values of a type; undefined and null are types of one value.
    fn of_type(place: u8) -> Self {
        let limit = |after| Limit { bytes: vec![place], after, value: None };
        Self { low: limit(false), high: limit(true), is_point: matches!(place, UNDEFINED | NULL) }
    }
}

impl std::fmt::Display for Interval<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let end = |limit: &Limit<'_>| limit.value.map_or_else(|| type_name(&limit.bytes), |value| value.to_string());
        let open = if self.low.after { '(' } else { '[' };
        let close = if self.high.after { ']' } else { ')' };
        write!(f, "{open}{}, {}{close}", end(&self.low), end(&self.high))
    }
}

/// Returns the end of a type's values, for messages.
fn type_name(bytes: &[u8]) -> String {
    match bytes {
        [UNDEFINED] => "undefined".to_owned(),
        [NULL] => "null".to_owned(),
        [_] => "…".to_owned(),
        [_, text @ ..] => format!("\"{}…\"", String::from_utf8_lossy(text)),
        [] => String::new(),
    }
}

impl Limit<'_> {
    /// Returns the first key at or behind this place.
    pub(super) fn place(&self) -> Vec<u8> {
        if self.after { successor(self.bytes.clone()) } else { self.bytes.clone() }
    }

    /// Returns the same place where bytes are inverted.
    pub(super) fn inverted(&self) -> Self {
        Self { bytes: self.bytes.iter().map(|byte| !byte).collect(), after: !self.after, value: self.value }
    }
}

/// Returns the first bytes behind all that begin with these. (No key begins with 0xff only.)
pub(super) fn successor(mut bytes: Vec<u8>) -> Vec<u8> {
    while let Some(last) = bytes.pop() {
        if last < 0xff {
            bytes.push(last + 1);
            return bytes;
        }
    }
    vec![0xff; 2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::query::Filter;
    use bson::{Document, doc};

    fn bounds(filter: &Document, multikey: bool) -> Vec<String> {
        let pattern = Pattern::parse(&doc! {"a": 1}).unwrap();
        let filter = Filter::parse(filter).unwrap();
        match of_node(filter.root(), &IndexedPath { path: "a", multikey, sparse: false, pattern: &pattern }) {
            None => vec!["all".to_owned()],
            Some(intervals) => intervals.iter().map(ToString::to_string).collect(),
        }
    }

    #[test]
    fn conditions_bound_a_path() {
        for (filter, single, multi) in [
            (doc! {"a": 1}, vec!["[1, 1]"], vec!["[1, 1]"]),
            (doc! {"a": {"$gt": 1, "$lt": 5}}, vec!["(1, 5)"], vec!["(1, …]"]),
            (doc! {"$and": [{"a": {"$gte": 1}}, {"a": {"$lte": 5}}]}, vec!["[1, 5]"], vec!["[1, …]"]),
            (doc! {"a": {"$in": [5, 1, 5]}, "b": 2}, vec!["[1, 1]", "[5, 5]"], vec!["[1, 1]", "[5, 5]"]),
            (doc! {"a": {"$in": [5, 1], "$gt": 2}}, vec!["[5, 5]"], vec!["[1, 1]", "[5, 5]"]),
            (doc! {"$or": [{"a": 1}, {"a": {"$gt": 0}}]}, vec!["(0, …]"], vec!["(0, …]"]),
            (doc! {"$or": [{"a": 1}, {"b": 2}]}, vec!["all"], vec!["all"]),
            (doc! {"a": {"$ne": 1}}, vec!["all"], vec!["all"]),
            (doc! {"a": {"$elemMatch": {"$gt": 1, "$lt": 5}}}, vec!["(1, 5)"], vec!["(1, 5)"]),
            (
                doc! {"a": Bson::Null},
                vec!["[undefined, undefined]", "[null, null]"],
                vec!["[undefined, undefined]", "[null, null]"],
            ),
            (doc! {"a": [1, 2]}, vec!["[1, 1]", "[[1, 2], [1, 2]]"], vec!["[1, 1]", "[[1, 2], [1, 2]]"]),
            (doc! {"a": {"$gt": [1]}}, vec!["all"], vec!["all"]),
            (doc! {"a": {"$gt": 3, "$lt": 2}}, vec![], vec!["(3, …]"]),
        ] {
            assert_eq!(bounds(&filter, false), single, "{filter}");
            assert_eq!(bounds(&filter, true), multi, "{filter}");
        }
    }

    #[test]
    fn a_pattern_bounds_by_its_beginning() {
        for (pattern, prefix) in [
            ("^abc", Some("abc")),
            ("^abc*", Some("ab")),
            (r"^a\.b.*", Some("a.b")),
            (r"^a\d", Some("a")),
            ("^a+", Some("a")),
            ("^a|b", None),
            ("abc", None),
        ] {
            assert_eq!(literal_prefix(pattern).as_deref(), prefix, "{pattern}");
        }
    }
}
