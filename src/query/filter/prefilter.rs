//! A look at the bytes of a document that rejects most of them before a filter is evaluated.
//!
//! A document that matches `{name: "B"}` contains the bytes of the string "B". A document without these bytes
//! cannot match. Of two fields that are to differ (`{$expr: {$ne: ["$a", "$b"]}}`), not both have the same bytes.

use bson::{Bson, RawDocument};
use memchr::memmem::Finder;

use super::test::{Leaf, Test};
use super::tree::Node;
use crate::query::collation::is_in_effect;
use crate::query::element::Elements;

/// What every matching document has.
#[derive(Debug)]
pub(super) enum Prefilter {
    /// These bytes.
    Bytes(Box<Finder<'static>>),
    /// Fields of these names that differ.
    Differing([Box<str>; 2]),
}

impl Prefilter {
    /// Returns the longest string or id that the filter demands, or fields that are to differ, if there are any. A
    /// filter with another expression has no prefilter, because a document that does not match can still be an error.
    pub(super) fn of(root: &Node) -> Option<Self> {
        let conjuncts = match root {
            Node::And(children) => children.as_slice(),
            single => std::slice::from_ref(single),
        };
        let is_plain = |node: &Node| matches!(node, Node::Field(..) | Node::Always(_)) || differing(node).is_some();
        if !conjuncts.iter().all(is_plain) {
            return None;
        }
        // Strings that are equal by a collation have other bytes.
        let values = conjuncts.iter().filter(|_| !is_in_effect()).filter_map(bytes);
        if let Some(longest) = values.max_by_key(Vec::len) {
            return Some(Self::Bytes(Box::new(Finder::new(&longest).into_owned())));
        }
        conjuncts.iter().find_map(differing).map(|names| Self::Differing(names.map(Box::from)))
    }

    /// Returns whether a document can match.
    pub(super) fn may_match(&self, document: &RawDocument) -> bool {
        match self {
            Self::Bytes(finder) => finder.find(document.as_bytes()).is_some(),
            Self::Differing([a, b]) => match Elements::new(document).find_both([a.as_bytes(), b.as_bytes()]) {
                [Some(a), Some(b)] => !a.has_same_bytes(&b),
                _ => true,
            },
        }
    }
}

/// Returns the names of two fields that are to differ.
fn differing(node: &Node) -> Option<[&str; 2]> {
    match node {
        Node::Expression(expression) => expression.differing(),
        _ => None,
    }
}

/// Returns bytes contained in every document that passes this node.
fn bytes(node: &Node) -> Option<Vec<u8>> {
    let Node::Field(_, test) = node else { return None };
    match test {
        Test::Leaf(leaf) => value(leaf),
        Test::And(tests) => {
            let leaves = tests.iter().filter_map(|test| if let Test::Leaf(leaf) = test { value(leaf) } else { None });
            leaves.max_by_key(Vec::len)
        }
        Test::Not(_) => None,
    }
}

/// Returns the bytes of a value to be equal to. Strings and symbols, which are equal, have the same bytes.
fn value(leaf: &Leaf) -> Option<Vec<u8>> {
    match leaf {
        Leaf::Equal(Bson::String(text) | Bson::Symbol(text)) => {
            let length = i32::try_from(text.len() + 1).ok()?;
            Some([&length.to_le_bytes(), text.as_bytes(), &[0]].concat())
        }
        Leaf::Equal(Bson::ObjectId(id)) => Some(id.bytes().to_vec()),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::super::Filter;
    use bson::{Bson, Document, RawDocumentBuf, doc, oid::ObjectId};

    #[test]
    fn a_prefilter_never_rejects_a_document_that_matches() {
        let id = ObjectId::from_bytes([9; 12]);
        let filters = [
            doc! { "a": "text" },
            doc! { "a.b": "text" },
            doc! { "a": { "$eq": "text", "$exists": true } },
            doc! { "$and": [{ "a": "text" }, { "n": 1 }] },
            doc! { "id": id },
            doc! { "a": { "$elemMatch": { "$eq": "text" } } },
            doc! { "a": { "$ne": "text" } },
            doc! { "$or": [{ "a": "text" }, { "n": 2 }] },
            doc! { "a": "" },
            doc! { "$expr": { "$ne": ["$a", "$b"] } },
            doc! { "$expr": { "$ne": ["$a", "$n"] }, "n": { "$not": { "$gt": 1 } } },
            doc! { "$expr": { "$ne": ["$a", "$id"] }, "b": "text" },
        ];
        let documents: [Document; 15] = [
            doc! { "a": "text", "n": 1 },
            doc! { "a": ["x", "text"], "n": [1] },
            doc! { "a": [{ "b": ["text"] }] },
            doc! { "a": Bson::Symbol("text".into()) },
            doc! { "a": { "b": "text" }, "id": id },
            doc! { "a": "texts", "b": "text", "n": 2 },
            doc! { "a": "", "id": [id] },
            doc! { "a": [["text"]] },
            doc! { "n": 2 },
            doc! { "b": "text", "a": "text" },
            doc! { "a": 1, "n": 1, "b": 1.0 },
            doc! { "a": f64::NAN, "n": f64::NAN, "b": f64::NAN },
            doc! { "a": [1, { "x": Bson::Null }], "b": [1, { "x": Bson::Null }] },
            doc! { "a": Bson::Symbol("text".into()), "b": "text" },
            doc! { "a": Bson::Null },
        ];
        for filter in &filters {
            let filter = Filter::parse(filter).unwrap();
            for document in &documents {
                let raw = RawDocumentBuf::try_from(document).unwrap();
                assert_eq!(
                    filter.matches(&raw).unwrap(),
                    filter.matches_document(document).unwrap(),
                    "{filter:?}: {document}"
                );
            }
        }
    }
}
