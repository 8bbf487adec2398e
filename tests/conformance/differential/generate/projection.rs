//! Projections and sorts of `find`.

use bson::{Bson, Document, doc};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

use super::value::{Gen, any_of, array, fields, int, name, object, path, pick, scalar};

fn of(field: Gen<(String, Bson)>) -> Gen<Document> {
    (vec(field, 1..=3), any_of(vec![(3, pick(&[Bson::Null])), (1, pick(&[0, 1]))]))
        .prop_map(|(fields, id)| {
            let mut projection: Document = fields.into_iter().collect();
            if id != Bson::Null {
                projection.insert("_id", id);
            }
            projection
        })
        .boxed()
}

/// `{a: 1, "b.c": true}`.
pub(crate) fn inclusion() -> Gen<Document> {
    let yes = any_of(vec![(6, pick(&[1])), (1, pick(&[true])), (1, pick(&[2.5]))]);
    of((path(), yes).boxed())
}

/// `{a: 0, "b.c": false}`.
pub(crate) fn exclusion() -> Gen<Document> {
    let no = any_of(vec![(6, pick(&[0])), (1, pick(&[false]))]);
    of((path(), no).boxed())
}

/// Inclusion and exclusion together, nested objects, paths that collide.
pub(crate) fn mixed() -> Gen<Document> {
    let flag = pick(&[0, 1, 1]);
    let nested = fields(vec![("b", 80, flag.clone()), ("c", 50, flag.clone())]);
    of((path(), any_of(vec![(3, flag), (1, nested)])).boxed())
}

/// `$slice`, alone and among others.
pub(crate) fn slice() -> Gen<Document> {
    let slice = any_of(vec![
        (4, object("$slice", pick(&[0, 1, 2, -1, -2, 5]))),
        (4, object("$slice", array(vec![int(), pick(&[1, 2])]))),
        (1, object("$slice", array(vec![scalar(), int()]))),
    ]);
    of((path(), any_of(vec![(3, slice), (1, pick(&[1])), (1, pick(&[0]))])).boxed())
}

/// `$elemMatch` as a projection.
pub(crate) fn element() -> Gen<Document> {
    let compared = (select(&["$gt", "$lt", "$eq", "$ne", "$in"][..]), scalar())
        .prop_map(|(name, value)| match name {
            "$in" => doc! { name: [value] }.into(),
            _ => doc! { name: value }.into(),
        })
        .boxed();
    let within = fields(vec![("b", 70, compared.clone()), ("c", 40, scalar())]);
    let found = object("$elemMatch", any_of(vec![(1, compared), (2, within)]));
    let top = any_of(vec![(5, name(&["a", "b"])), (1, path())]);
    of((top, any_of(vec![(4, found), (1, pick(&[1]))])).boxed())
}

/// `"a.$": 1`.
pub(crate) fn positional() -> Gen<Document> {
    let plain = of((name(&["b", "c"]), pick(&[1])).boxed());
    (name(&["a.$", "a.$", "b.$", "a.b.$"]), proptest::option::of(plain))
        .prop_map(|(field, rest)| {
            let mut projection = doc! { field: 1 };
            projection.extend(rest.unwrap_or_default());
            projection
        })
        .boxed()
}

/// Expressions as values.
pub(crate) fn computed(expression: Gen) -> Gen<Document> {
    let names = any_of(vec![(3, name(&["r", "q"])), (1, path())]);
    let value = any_of(vec![
        (4, expression),
        (1, pick(&[1])),
        (1, pick(&["$a", "$n", "text"])),
        (1, object("$literal", scalar())),
    ]);
    of((names, value).boxed())
}

/// A sort over values of all types; mostly ended by `_id`, so that its order is defined.
pub(crate) fn sort() -> Gen<Document> {
    (vec((path(), pick(&[1, -1])), 1..=2), pick(&[1, -1]))
        .prop_map(|(keys, id)| {
            let mut sort: Document = keys.into_iter().collect();
            if !sort.contains_key("_id") {
                sort.insert("_id", id);
            }
            sort
        })
        .boxed()
}
