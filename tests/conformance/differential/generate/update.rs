//! Updates: a statement of the command, without its filter.

use bson::{Bson, Document, doc};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

use super::expression;
use super::value::{
    Gen, any_of, array, either, fields, int, name, nested, number, object, path, pick, scalar, several, string, value,
    wild,
};

/// Operators, each over one or two paths.
fn operators(operator: Gen<(String, String, Bson)>) -> Gen<Document> {
    vec(operator, 1..=2)
        .prop_map(|parts| {
            let mut update = Document::new();
            for (operator, path, value) in parts {
                let mut fields = update.get_document(&operator).cloned().unwrap_or_default();
                fields.insert(path, value);
                update.insert(operator, fields);
            }
            update
        })
        .boxed()
}

fn operator(names: &'static [&'static str], path: Gen<String>, value: Gen) -> Gen<(String, String, Bson)> {
    (select(names), path, value).prop_map(|(name, path, value)| (name.to_owned(), path, value)).boxed()
}

/// `$set`, `$unset`, `$rename`, `$setOnInsert`.
pub(crate) fn set() -> Gen<Document> {
    let to = path().prop_map(Bson::from).boxed();
    operators(any_of(vec![
        (5, operator(&["$set"], path(), value(2))),
        (2, operator(&["$unset"], path(), pick(&[""]))),
        (2, operator(&["$rename"], path(), to)),
        (1, operator(&["$setOnInsert"], path(), scalar())),
    ]))
}

/// `$inc`, `$mul`, `$min`, `$max`, `$bit`.
pub(crate) fn numbers() -> Gen<Document> {
    let mask = any_of(vec![(4, int()), (1, pick(&[1i64, 6])), (1, scalar())]);
    let bits = (select(&["and", "or", "xor"][..]), mask).prop_map(|(name, mask)| doc! { name: mask }.into()).boxed();
    let fields = || any_of(vec![(3, name(&["n", "m"])), (1, path())]);
    operators(any_of(vec![
        (4, operator(&["$inc", "$mul"], fields(), any_of(vec![(9, number()), (1, scalar())]))),
        (3, operator(&["$min", "$max"], any_of(vec![(1, fields()), (2, path())]), value(1))),
        (1, operator(&["$bit"], fields(), bits)),
    ]))
}

fn ordered() -> Gen {
    any_of(vec![(3, pick(&[1, -1])), (2, pick(&[doc! { "b": 1 }, doc! { "b": -1, "c": 1 }])), (1, scalar())])
}

/// `$push` with its modifiers, `$addToSet`, `$pop`, `$pull`, `$pullAll`.
pub(crate) fn arrays() -> Gen<Document> {
    let item = any_of(vec![(3, scalar()), (1, value(1)), (1, nested(0))]);
    let items = several(item.clone(), 3);
    let modified = fields(vec![
        ("$each", 98, items.clone()),
        ("$position", 40, pick(&[0, 1, -1, 5])),
        ("$slice", 40, pick(&[0, 1, 2, -1, -2])),
        ("$sort", 40, ordered()),
    ]);
    let compared = (select(&["$gt", "$lt", "$in", "$ne"][..]), scalar())
        .prop_map(|(name, value)| match name {
            "$in" => doc! { name: [value] }.into(),
            _ => doc! { name: value }.into(),
        })
        .boxed();
    let pulled = any_of(vec![
        (3, item.clone()),
        (2, compared.clone()),
        (2, fields(vec![("b", 70, any_of(vec![(1, compared.clone()), (1, scalar())])), ("c", 30, scalar())])),
        (1, object("$elemMatch", compared)),
    ]);
    let paths = || any_of(vec![(4, name(&["a", "b", "l", "k"])), (1, path())]);
    operators(any_of(vec![
        (2, operator(&["$push", "$addToSet"], paths(), item)),
        (3, operator(&["$push"], paths(), modified)),
        (2, operator(&["$addToSet"], paths(), object("$each", items.clone()))),
        (1, operator(&["$pop"], paths(), any_of(vec![(6, pick(&[1, -1])), (1, scalar())]))),
        (2, operator(&["$pull"], paths(), pulled)),
        (2, operator(&["$pullAll"], paths(), any_of(vec![(9, items), (1, scalar())]))),
    ]))
}

/// Operators on `a.$`, `a.$[]` and `a.$[e]`, with the filters for `e`.
pub(crate) fn positional() -> Gen<Document> {
    let place = any_of(vec![
        (3, name(&["a.$", "a.$.b", "l.$", "b.$"])),
        (3, name(&["a.$[]", "a.$[].b", "l.$[]", "a.$[].b.$[]"])),
        (4, name(&["a.$[e]", "a.$[e].b", "l.$[e]", "l.$[e].b", "a.$[e].c"])),
    ]);
    let operator = any_of(vec![
        (4, operator(&["$set"], place.clone(), scalar())),
        (2, operator(&["$inc", "$mul", "$max", "$min"], place.clone(), number())),
        (1, operator(&["$unset"], place.clone(), pick(&[""]))),
        (1, operator(&["$push"], place, scalar())),
    ]);
    let compared = (select(&["$gt", "$gte", "$lt", "$ne", "$exists"][..]), scalar())
        .prop_map(|(name, value)| doc! { name: value }.into());
    let condition = any_of(vec![(3, compared.boxed()), (1, scalar())]);
    let key = name(&["e", "e", "e.b", "e.c"]);
    (vec(operator, 1..=1), key, condition)
        .prop_map(|(parts, key, condition)| {
            let mut statement = Document::new();
            let mut update = Document::new();
            for (operator, path, value) in parts {
                if path.contains("$[e]") {
                    statement.insert("arrayFilters", vec![doc! { &key: condition.clone() }]);
                }
                update.insert(operator, doc! { path: value });
            }
            statement.insert("u", update);
            statement
        })
        .boxed()
}

/// A whole document in place of another.
pub(crate) fn replacement() -> Gen<Document> {
    (wild(), any_of(vec![(9, pick(&[Bson::Null])), (1, pick(&[1, 2, 3]))]))
        .prop_map(|(mut document, id)| {
            if id != Bson::Null {
                document.insert("_id", id);
            }
            document
        })
        .boxed()
}

/// A pipeline that changes a document.
pub(crate) fn pipeline() -> Gen {
    let value = any_of(vec![(4, expression::any_group()), (1, object("$literal", scalar()))]);
    let names = || any_of(vec![(3, name(&["r", "a", "n", "l"])), (1, path())]);
    let assigned =
        vec((names(), value.clone()), 1..=2).prop_map(|fields| Bson::Document(fields.into_iter().collect())).boxed();
    let kept =
        vec((names(), pick(&[1])), 1..=2).prop_map(|fields| Bson::Document(fields.into_iter().collect())).boxed();
    let stage = any_of(vec![
        (3, object("$set", assigned.clone())),
        (1, object("$addFields", assigned)),
        (2, object("$unset", names().prop_map(Bson::from).boxed())),
        (1, object("$project", kept)),
        (1, object("$replaceWith", object("$mergeObjects", array(vec![pick(&["$$ROOT"]), object("r", value)])))),
        (1, object("$replaceRoot", object("newRoot", pick(&["$o", "$$ROOT"])))),
    ]);
    vec(stage, 1..=2).prop_map(Bson::Array).boxed()
}

/// A filter that matches nothing mostly, but says what an upsert is to be.
pub(crate) fn absent() -> Gen<Document> {
    let condition = any_of(vec![
        (4, scalar()),
        (2, object("$eq", value(1))),
        (1, object("$gt", pick(&[100, 200]))),
        (1, object("$in", several(scalar(), 2))),
        (1, object("$all", several(scalar(), 2))),
        (1, object("$elemMatch", object("b", scalar()))),
    ]);
    let fields = vec((any_of(vec![(3, name(&["a", "b", "q"])), (2, path())]), condition), 1..=2)
        .prop_map(|fields| fields.into_iter().collect::<Document>())
        .boxed();
    let id = any_of(vec![(3, pick(&[1000, 1001])), (1, string()), (1, value(1))]);
    (fields.clone(), fields, id, 0..6)
        .prop_map(|(one, other, id, shape)| match shape {
            0 => doc! { "$and": [one, other], "_id": { "$ne": 1 } },
            1 => doc! { "$or": [one], "q": "none" },
            2 => doc! { "_id": id },
            _ => {
                let mut filter = one;
                filter.insert("q", "none");
                filter
            }
        })
        .boxed()
}

/// Any update by operators.
pub(crate) fn any_operators() -> Gen<Document> {
    either(vec![set(), numbers(), arrays()])
}
