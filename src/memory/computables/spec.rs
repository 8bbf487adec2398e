//! Which queries a computable answers.

use bson::{Bson, Document};

use super::bounds::Bounds;
use crate::query::{Filter, QueryError};

/// A compiled spec: a query on queries.
#[derive(Debug)]
pub(super) struct Spec {
    document: Document,
    filter: Filter,
}

/// What a query must have, so that a spec can match it: the place where the
/// spec is looked for.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Slot {
    /// This key with this text (or with what is not a text: an array may have it).
    Text(String, String),
    /// This key, with a number within these bounds where there are some.
    Key(String, Bounds),
    /// Nothing in particular.
    Any,
}

/// What decides a spec for queries that have none of the keys which it is about.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Absence {
    /// The keys that it is about, sorted.
    pub(super) keys: Vec<String>,
    /// Whether it matches those queries.
    pub(super) is_match: bool,
}

impl Spec {
    pub(super) fn parse(document: &Document) -> Result<Self, QueryError> {
        Ok(Self { document: document.clone(), filter: Filter::parse(document)? })
    }

    /// Whether the query, as a document, matches.
    pub(super) fn matches(&self, query: &Document) -> Result<bool, QueryError> {
        self.filter.matches_document(query)
    }

    /// The clauses that the query does not match.
    pub(super) fn missed(&self, query: &Document) -> Result<Vec<Document>, QueryError> {
        let mut missed = Vec::new();
        for clause in self.document.iter().flat_map(|(key, value)| clauses(key, value)) {
            if !Filter::parse(&clause)?.matches_document(query)? {
                missed.push(clause);
            }
        }
        Ok(missed)
    }

    /// How queries are decided that have none of its keys; none where it is about other things than keys.
    pub(super) fn absence(&self) -> Option<Absence> {
        let mut keys = Vec::new();
        collect_keys(&self.document, &mut keys)?;
        keys.sort_unstable();
        keys.dedup();
        Some(Absence { keys, is_match: self.matches(&Document::new()).ok()? })
    }

    /// Where the spec is looked for: every query that it matches has one of these.
    pub(super) fn slots(&self) -> Vec<Slot> {
        slots(&self.document).unwrap_or_else(|| vec![Slot::Any])
    }
}

/// The slots of a spec, texts rather than keys; none where there are none.
fn slots(spec: &Document) -> Option<Vec<Slot>> {
    let is_exact = |slots: &[Slot]| slots.iter().all(|slot| matches!(slot, Slot::Text(..)));
    let mut best: Option<Vec<Slot>> = None;
    for (key, value) in spec {
        let Some(found) = clause_slots(key, value) else { continue };
        if best.is_none() || is_exact(&found) {
            let done = is_exact(&found);
            best = Some(found);
            if done {
                break;
            }
        }
    }
    best
}

fn clause_slots(key: &str, value: &Bson) -> Option<Vec<Slot>> {
    match (key, value) {
        ("$or", Bson::Array(alternatives)) => {
            let slots: Option<Vec<_>> = alternatives.iter().map(|spec| slots(spec.as_document()?)).collect();
            slots.map(|slots| slots.concat())
        }
        ("$and", Bson::Array(parts)) => parts.iter().find_map(|spec| slots(spec.as_document()?)),
        (operator, _) if operator.starts_with('$') => None,
        (path, value) => {
            let (first, dotted) = path.split_once('.').map_or((path, false), |(first, _)| (first, true));
            match value {
                Bson::String(text) if !dotted => Some(vec![Slot::Text(first.to_owned(), text.clone())]),
                value => {
                    let bounds = Bounds::of(value);
                    let slot = || Slot::Key(first.to_owned(), if dotted { Bounds::NONE } else { bounds });
                    (bounds != Bounds::NONE || needs_key(value)).then(|| vec![slot()])
                }
            }
        }
    }
}

/// The keys that a spec is about; nothing where it has conditions that are about more than keys.
fn collect_keys(spec: &Document, keys: &mut Vec<String>) -> Option<()> {
    for (key, value) in spec {
        match (key.as_str(), value) {
            ("$and" | "$or" | "$nor", Bson::Array(parts)) => {
                parts.iter().try_for_each(|part| collect_keys(part.as_document()?, keys))?;
            }
            (operator, _) if operator.starts_with('$') => return None,
            (path, _) => keys.push(path.split('.').next().unwrap_or(path).to_owned()),
        }
    }
    Some(())
}

/// Whether a clause matches only documents that have its key.
fn needs_key(value: &Bson) -> bool {
    match value {
        Bson::Null | Bson::Undefined => false,
        Bson::Document(operators) if is_operators(operators) => {
            matches!(operators.get("$exists"), Some(Bson::Boolean(true)))
        }
        _ => true,
    }
}

fn is_operators(document: &Document) -> bool {
    document.keys().next().is_some_and(|key| key.starts_with('$'))
}

/// The parts of a clause that can fail for themselves.
fn clauses(key: &str, value: &Bson) -> Vec<Document> {
    match value {
        Bson::Document(operators) if is_operators(operators) && !operators.contains_key("$options") => {
            operators.iter().map(|(name, value)| bson::doc! { key: { name: value.clone() } }).collect()
        }
        value => vec![bson::doc! { key: value.clone() }],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::doc;

    fn spec(document: Document) -> Spec {
        Spec::parse(&document).unwrap()
    }

    #[test]
    fn the_query_is_matched_as_a_document() {
        let sum = spec(doc! { "compute": "sum", "x": { "$exists": true }, "y": { "$exists": true } });
        assert!(sum.matches(&doc! { "compute": "sum", "x": 15, "y": 4 }).unwrap());
        assert!(!sum.matches(&doc! { "compute": "sum", "x": 15 }).unwrap());
        let range = spec(doc! { "x.$gt": { "$gte": 3 } });
        assert!(range.matches(&doc! { "x": { "$gt": 5 } }).unwrap());
    }

    #[test]
    fn the_clauses_that_fail_are_named() {
        let spec = spec(doc! { "compute": "sum", "x": { "$exists": true, "$gt": 3 } });
        assert_eq!(
            spec.missed(&doc! { "compute": "product", "x": 2 }).unwrap(),
            [doc! { "compute": "sum" }, doc! { "x": { "$gt": 3 } }]
        );
    }

    #[test]
    fn a_spec_is_looked_for_where_every_match_is() {
        let slots = |document| spec(document).slots();
        let text = |key: &str, text: &str| Slot::Text(key.into(), text.into());
        let key = |key: &str| Slot::Key(key.into(), Bounds::NONE);
        let number = |key: &str, value: Bson| Slot::Key(key.into(), Bounds::of(&value));
        assert_eq!(slots(doc! { "x": { "$exists": true }, "a": "b" }), [text("a", "b")]);
        assert_eq!(slots(doc! { "x": { "$exists": true } }), [key("x")]);
        assert_eq!(slots(doc! { "x": 1 }), [number("x", 1.into())]);
        assert_eq!(slots(doc! { "x": { "$gt": 3 } }), [number("x", doc! { "$gte": 3.0 }.into())]);
        assert_eq!(slots(doc! { "x.y": { "$gt": 3 } }), [key("x")]);
        assert_eq!(slots(doc! { "x.y": "a" }), [key("x")]);
        let either = doc! { "$or": [{ "a": "b" }, { "a.$in": "b" }] };
        assert_eq!(slots(either.clone()), [text("a", "b"), key("a")]);
        assert_eq!(slots(doc! { "$and": [{ "x": null }, either] }), [text("a", "b"), key("a")]);
        for document in [
            doc! {},
            doc! { "x": null },
            doc! { "x": { "$exists": false } },
            doc! { "x": { "$ne": 1 } },
            doc! { "$or": [{ "a": "b" }, { "c": null }] },
            doc! { "$nor": [{ "a": "b" }] },
        ] {
            assert_eq!(slots(document), [Slot::Any]);
        }
    }

    #[test]
    fn queries_without_its_keys_are_decided_at_once() {
        let absence = |document| spec(document).absence();
        let decided = |keys: &[&str], is_match| {
            Some(Absence { keys: keys.iter().map(|key| (*key).to_owned()).collect(), is_match })
        };
        assert_eq!(absence(doc! { "a": { "$ne": 1 } }), decided(&["a"], true));
        assert_eq!(absence(doc! { "b": 1, "a.c": 2 }), decided(&["a", "b"], false));
        assert_eq!(absence(doc! { "$nor": [{ "b": 1 }, { "a": { "$exists": true } }] }), decided(&["a", "b"], true));
        assert_eq!(absence(doc! {}), decided(&[], true));
        assert_eq!(absence(doc! { "a": 1, "$expr": { "$gt": ["$b", 1] } }), None);
    }
}
