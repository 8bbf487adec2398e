//! A substring search over raw documents that rejects most of them before a filter is evaluated.
//!
//! A document that matches `{name: "B"}` contains the bytes of the string "B". A document without these bytes
//! cannot match.

use bson::Bson;
use memchr::memmem::Finder;

use super::test::{Leaf, Test};
use super::tree::Node;
use crate::query::collation::is_in_effect;

/// Bytes that every matching document contains.
#[derive(Debug)]
pub(super) struct Prefilter(Box<Finder<'static>>);

impl Prefilter {
    /// Returns the longest string or id that the filter demands, if there is one. A filter with an expression has no
    /// prefilter, because a document that does not match can still be an error.
    pub(super) fn of(root: &Node) -> Option<Self> {
        let conjuncts = match root {
            Node::And(children) => children.as_slice(),
            single => std::slice::from_ref(single),
        };
        let is_plain = conjuncts.iter().all(|node| matches!(node, Node::Field(..) | Node::Always(_)));
        // Strings that are equal by a collation have other bytes.
        let is_plain = is_plain && !is_in_effect();
        let longest = conjuncts.iter().filter_map(bytes).max_by_key(Vec::len).filter(|_| is_plain)?;
        Some(Self(Box::new(Finder::new(&longest).into_owned())))
    }

    /// Returns whether a document with these bytes can match.
    pub(super) fn may_match(&self, bytes: &[u8]) -> bool {
        self.0.find(bytes).is_some()
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
        ];
        let documents: [Document; 9] = [
            doc! { "a": "text", "n": 1 },
            doc! { "a": ["x", "text"], "n": [1] },
            doc! { "a": [{ "b": ["text"] }] },
            doc! { "a": Bson::Symbol("text".into()) },
            doc! { "a": { "b": "text" }, "id": id },
            doc! { "a": "texts", "b": "text", "n": 2 },
            doc! { "a": "", "id": [id] },
            doc! { "a": [["text"]] },
            doc! { "n": 2 },
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
