//! Short expressions that describe large values. mongod accepts larger ones between stages than can be results, so each
//! is a result here.

use bson::{Bson, doc};
use proptest::prelude::*;

use super::value::{Gen, any_of, pick};

/// Expressions whose values grow with each level.
pub(crate) fn expression() -> Gen {
    let leaf = any_of(vec![(3, pick(&["$a", "$b", "x"])), (1, pick(&[1])), (1, doubled(pick(&["0123456789abcdef"])))]);
    leaf.prop_recursive(3, 12, 2, |inner| {
        any_of(vec![
            (3, nested(inner.clone().boxed())),
            (2, doubled(inner.clone().boxed())),
            (2, repeated(inner.clone().boxed(), "$concatArrays")),
            (1, repeated(inner.clone().boxed(), "$mergeObjects")),
            (1, mapped(inner.clone().boxed())),
            (1, inner.prop_map(|inner| Bson::from(vec![inner.clone(), inner])).boxed()),
        ])
    })
    .boxed()
}

fn reduce(initial: Bson, times: i32, body: Bson) -> Bson {
    doc! { "$reduce": { "input": { "$range": [0, times] }, "initialValue": initial, "in": body } }.into()
}

/// A document or array in another one, below and above 200 levels. mongod itself fails at some ten thousand.
fn nested(inner: Gen) -> Gen {
    let body = pick(&[Bson::from(doc! { "a": "$$value" }), Bson::from(vec!["$$value"])]);
    let times = any::<prop::sample::Index>().prop_map(|index| [1, 50, 100, 190, 198, 199, 200, 250][index.index(8)]);
    (inner, times, body).prop_map(|(inner, times, body)| reduce(inner, times, body)).boxed()
}

/// A string doubled below and above 16 MB.
fn doubled(inner: Gen) -> Gen {
    let body = doc! { "$concat": ["$$value", "$$value"] };
    let times = any::<prop::sample::Index>().prop_map(|index| [1, 4, 10, 19, 20, 21, 34][index.index(7)]);
    (inner, times).prop_map(move |(inner, times)| reduce(inner, times, body.clone().into())).boxed()
}

fn repeated(inner: Gen, operator: &'static str) -> Gen {
    (inner, 0..12i32)
        .prop_map(move |(inner, times)| {
            let body = doc! { operator: ["$$value", "$$value", [inner.clone()]] };
            reduce(vec![inner].into(), times, body.into())
        })
        .boxed()
}

fn mapped(inner: Gen) -> Gen {
    (inner, 0..4u32)
        .prop_map(|(inner, size)| doc! { "$map": { "input": { "$range": [0, 10i32.pow(size)] }, "in": inner } }.into())
        .boxed()
}
