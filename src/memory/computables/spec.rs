//! Which queries a computable answers.

use bson::{Bson, Document};

use crate::query::{Filter, QueryError};

/// A compiled spec: a query on queries.
#[derive(Debug)]
pub(super) struct Spec {
    document: Document,
    filter: Filter,
}

/// What a query must have, so that a spec can match it: the place where the
/// spec is looked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Slot {
    /// This key with this text (or with what is no text: an array may have it).
    Text(String, String),
    /// This key.
    Key(String),
    /// Nothing in particular.
    Any,
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

    /// Where the spec is looked for.
    pub(super) fn slot(&self) -> Slot {
        let mut slot = Slot::Any;
        for (key, value) in self.document.iter().filter(|(key, _)| !key.starts_with('$') && !key.contains('.')) {
            match value {
                Bson::String(text) => return Slot::Text(key.clone(), text.clone()),
                value if needs_key(value) => slot = Slot::Key(key.clone()),
                _ => {}
            }
        }
        slot
    }
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
        let slot = |document| spec(document).slot();
        assert_eq!(slot(doc! { "x": { "$exists": true }, "a": "b" }), Slot::Text("a".into(), "b".into()));
        assert_eq!(slot(doc! { "x": { "$exists": true } }), Slot::Key("x".into()));
        assert_eq!(slot(doc! { "x": 1 }), Slot::Key("x".into()));
        for document in [
            doc! {},
            doc! { "x": null },
            doc! { "x": { "$exists": false } },
            doc! { "x": { "$ne": 1 } },
            doc! { "x.y": "a" },
            doc! { "$or": [{ "a": "b" }] },
        ] {
            assert_eq!(slot(document), Slot::Any);
        }
    }
}
