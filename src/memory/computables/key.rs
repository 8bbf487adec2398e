//! Equal queries have equal keys.

use bson::{Bson, Document};
use sha2::{Digest as _, Sha256};

use super::definition::Definition;
use crate::query::key;

/// What all keys of a computable begin with, which takes longer than the rest of a key.
pub(super) fn begin(definition: &Definition) -> Sha256 {
    let Definition { name, namespace, spec, body, cache, priority: _, adds: _, origin: _ } = definition;
    Sha256::new().chain_update(format!("{name}\0{namespace}\0{spec}\0{cache:?}\0{body:?}\0"))
}

/// The key under which the answer of a computable to a query is kept: the same for all
/// processes with this computable, and for the keys of the query in any order.
pub(super) fn of(begun: &Sha256, query: &Document) -> String {
    let query = key::encode_value(&Bson::Document(sorted(query)));
    let digest = begun.clone().chain_update(query).finalize();
    let half = digest.iter().take(16).fold(0_u128, |number, byte| number << 8 | u128::from(*byte));
    format!("{half:032x}")
}

/// The document with its keys in order, and those of documents in it.
fn sorted(document: &Document) -> Document {
    let mut pairs: Vec<_> = document.iter().map(|(key, value)| (key.clone(), sorted_value(value))).collect();
    pairs.sort_by(|(a, _), (b, _)| a.cmp(b));
    pairs.into_iter().collect()
}

fn sorted_value(value: &Bson) -> Bson {
    match value {
        Bson::Document(document) => Bson::Document(sorted(document)),
        Bson::Array(values) => Bson::Array(values.iter().map(sorted_value).collect()),
        other => other.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::memory::computables::{BodyKind, Origin};
    use crate::store::Namespace;
    use bson::doc;

    fn definition() -> Definition {
        Definition {
            name: "a".into(),
            namespace: Namespace::parse("a.b").unwrap(),
            spec: doc! {},
            priority: 0,
            cache: None,
            adds: None,
            body: BodyKind::builtin("nearest", [("position", "translation".to_owned())]),
            origin: Origin::program(),
        }
    }

    #[test]
    fn queries_are_equal_with_their_keys_in_any_order() {
        let key = |query| of(&begin(&definition()), &query);
        let first = key(doc! { "a": 1, "b": [{ "c": 1, "d": { "e": 1, "f": 2 } }] });
        assert_eq!(first, key(doc! { "b": [{ "d": { "f": 2, "e": 1_i64 }, "c": 1.0 }], "a": 1 }));
        assert_ne!(first, key(doc! { "a": 1, "b": [{ "c": 1, "d": { "e": 2, "f": 1 } }] }));
        assert_ne!(key(doc! { "a": [1, 2] }), key(doc! { "a": [2, 1] }));
    }

    #[test]
    fn a_changed_computable_has_other_keys() {
        let changed = Definition { spec: doc! { "a": 1 }, ..definition() };
        assert_ne!(of(&begin(&definition()), &doc! {}), of(&begin(&changed), &doc! {}));
    }
}
