//! Stages of pipelines. The other collection is called `o`, the one for results `w`.

use bson::{Bson, Document, doc};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

use super::value::{Gen, any_of, array, either, fields, int, name, object, path, pick, scalar, several, value};
use super::{expression, filter, projection};

type Stages = Vec<Document>;

fn stage(stage: Gen) -> Gen<Stages> {
    stage.prop_map(|stage| stage.as_document().cloned().into_iter().collect()).boxed()
}

/// Stages, and then an order that is defined.
fn then_sorted(stages: Gen<Stages>) -> Gen<Stages> {
    stages
        .prop_map(|mut stages| {
            stages.push(doc! { "$sort": { "_id": 1 } });
            stages
        })
        .boxed()
}

fn field() -> Gen<String> {
    any_of(vec![(3, name(&["a", "b", "c"])), (1, path())])
}

fn a_path() -> Gen {
    field().prop_map(|path| Bson::from(format!("${path}"))).boxed()
}

/// `$project`, `$addFields`, `$set`, `$unset`, `$replaceRoot`, `$replaceWith`.
pub(crate) fn reshape() -> Gen<Stages> {
    let value = any_of(vec![(3, a_path()), (2, expression::any_group()), (1, object("$literal", scalar()))]);
    let assigned =
        vec((path(), value.clone()), 1..=2).prop_map(|fields| Bson::Document(fields.into_iter().collect())).boxed();
    let shape = any_of(vec![
        (2, projection::inclusion()),
        (2, projection::exclusion()),
        (2, projection::computed(value)),
        (1, projection::mixed()),
    ]);
    let root = any_of(vec![
        (3, pick(&["$$ROOT", "$o"])),
        (2, object("$mergeObjects", array(vec![pick(&["$$ROOT"]), object("r", a_path())]))),
        (1, a_path()),
        (1, fields(vec![("p", 80, a_path()), ("q", 50, expression::any_group())])),
    ]);
    let dropped =
        any_of(vec![(2, path().prop_map(Bson::from).boxed()), (1, several(path().prop_map(Bson::from).boxed(), 2))]);
    let one = any_of(vec![
        (4, stage(object("$project", shape.prop_map(Bson::from).boxed()))),
        (2, stage(object("$addFields", assigned.clone()))),
        (1, stage(object("$set", assigned))),
        (2, stage(object("$unset", dropped))),
        (1, stage(object("$replaceRoot", object("newRoot", root.clone())))),
        (1, stage(object("$replaceWith", root))),
    ]);
    vec(one, 1..=2).prop_map(|stages| stages.concat()).boxed()
}

fn accumulator() -> Gen {
    let operand =
        any_of(vec![(4, pick(&["$n", "$m", "$a", "$b", "$l", "$s", "$x"])), (1, int()), (1, expression::arithmetic())]);
    let many = fields(vec![("n", 99, pick(&[1, 2])), ("input", 100, operand.clone())]);
    let by = pick(&[doc! { "n": 1, "_id": 1 }, doc! { "a": -1, "_id": 1 }]);
    let top = fields(vec![("sortBy", 100, by.clone()), ("output", 100, operand.clone())]);
    let top_many = fields(vec![("n", 100, pick(&[1, 2])), ("sortBy", 100, by), ("output", 100, operand.clone())]);
    let plain = select(
        &["$sum", "$avg", "$min", "$max", "$first", "$last", "$push", "$addToSet", "$stdDevPop", "$stdDevSamp"][..],
    );
    any_of(vec![
        (10, (plain, operand).prop_map(|(name, operand)| doc! { name: operand }.into()).boxed()),
        (1, object("$mergeObjects", pick(&["$o", "$o", "$x"]))),
        (1, object("$count", pick(&[Document::new()]))),
        (1, either(vec![object("$top", top.clone()), object("$bottom", top)])),
        (1, either(vec![object("$topN", top_many.clone()), object("$bottomN", top_many)])),
        (
            1,
            either(vec![
                object("$maxN", many.clone()),
                object("$minN", many.clone()),
                object("$firstN", many.clone()),
                object("$lastN", many),
            ]),
        ),
    ])
}

/// `$group` with every accumulator.
pub(crate) fn group() -> Gen<Stages> {
    let id = any_of(vec![
        (2, pick(&[Bson::Null])),
        (4, a_path()),
        (2, pick(&["$n", "$m", "$s"])),
        (1, object("k", a_path())),
        (1, expression::conditional()),
    ]);
    let group = fields(vec![("_id", 99, id), ("p", 90, accumulator()), ("q", 60, accumulator())]);
    let sorted = pick(&[doc! { "$sort": { "_id": 1 } }, doc! { "$sort": { "n": 1, "_id": -1 } }]);
    (sorted, group)
        .prop_map(|(sorted, group)| vec![sorted.as_document().cloned().unwrap_or_default(), doc! { "$group": group }])
        .boxed()
}

/// `$bucket` and `$bucketAuto`.
pub(crate) fn bucket() -> Gen<Stages> {
    let by = any_of(vec![(3, pick(&["$n", "$m", "$_id"])), (1, a_path()), (1, expression::arithmetic())]);
    let edges = any_of(vec![
        (4, pick(&[Bson::from(vec![0, 2, 5]), Bson::from(vec![-5.0, 1.5, 100.0]), Bson::from(vec!["a", "b"])])),
        (1, several(scalar(), 3)),
    ]);
    let output = fields(vec![("p", 100, accumulator()), ("q", 30, accumulator())]);
    let bucket = fields(vec![
        ("groupBy", 100, by.clone()),
        ("boundaries", 100, edges),
        ("default", 70, any_of(vec![(3, pick(&["other", "zzz"])), (1, scalar())])),
        ("output", 40, output.clone()),
    ]);
    let auto = fields(vec![("groupBy", 100, by), ("buckets", 100, pick(&[1, 2, 3, 5])), ("output", 40, output)]);
    let numbers =
        pick(&[Bson::from("$_id"), doc! { "$mod": ["$_id", 3] }.into(), doc! { "$divide": ["$_id", 7] }.into()]);
    let fine = fields(vec![
        ("groupBy", 100, numbers),
        ("buckets", 100, pick(&[1, 2, 3, 5])),
        ("granularity", 100, pick(&["R5", "R80", "1-2-5", "E6", "E48", "POWERSOF2"])),
    ]);
    let auto = any_of(vec![(3, auto), (1, fine)]);
    any_of(vec![(3, then_sorted(stage(object("$bucket", bucket)))), (2, stage(object("$bucketAuto", auto)))])
}

/// An `$unwind` does not put the index where its array is in: mongod 6.0.5 ends when it is asked to.
fn without_index_above(mut unwind: Bson) -> Bson {
    if let Bson::Document(fields) = &mut unwind
        && let (Ok(path), Ok(index)) = (fields.get_str("path"), fields.get_str("includeArrayIndex"))
        && path.starts_with(&format!("${index}."))
    {
        fields.remove("includeArrayIndex");
    }
    unwind
}

/// `$unwind`.
pub(crate) fn unwind() -> Gen<Stages> {
    let long = fields(vec![
        ("path", 100, a_path()),
        ("includeArrayIndex", 50, pick(&["i", "a.i", "b"])),
        ("preserveNullAndEmptyArrays", 60, pick(&[true, false])),
    ]);
    let long = long.prop_map(without_index_above).boxed();
    let one = stage(object("$unwind", any_of(vec![(2, a_path()), (4, long)])));
    vec(one, 1..=2).prop_map(|stages| stages.concat()).boxed()
}

/// `$lookup` in all its forms.
pub(crate) fn lookup() -> Gen<Stages> {
    let names = || field().prop_map(Bson::from).boxed();
    let inner = any_of(vec![
        (3, filter::simple().prop_map(|filter| vec![doc! { "$match": filter }]).boxed()),
        (1, Just(vec![doc! { "$match": { "$expr": { "$eq": ["$a", "$$v"] } } }]).boxed()),
        (1, Just(vec![doc! { "$project": { "a": 1, "v": "$$v" } }, doc! { "$sort": { "_id": -1 } }]).boxed()),
        (1, Just(vec![doc! { "$limit": 2 }, doc! { "$addFields": { "z": "$a" } }]).boxed()),
    ]);
    let inner = inner.prop_map(|stages: Stages| Bson::from(stages)).boxed();
    let target = any_of(vec![(4, pick(&["r"])), (1, names())]);
    let plain = fields(vec![
        ("from", 100, pick(&["o", "o", "c", "none"])),
        ("localField", 100, names()),
        ("foreignField", 100, names()),
        ("as", 100, target.clone()),
    ]);
    let nested = fields(vec![
        ("from", 100, pick(&["o", "c"])),
        ("let", 100, object("v", a_path())),
        ("pipeline", 100, inner.clone()),
        ("as", 100, target.clone()),
    ]);
    let both = fields(vec![
        ("from", 100, pick(&["o"])),
        ("localField", 100, names()),
        ("foreignField", 100, names()),
        ("let", 100, object("v", a_path())),
        ("pipeline", 100, inner),
        ("as", 100, target),
    ]);
    let lookup = stage(object("$lookup", any_of(vec![(4, plain), (2, nested), (2, both)])));
    let unwound = lookup.clone().prop_map(|mut stages| {
        stages.push(doc! { "$unwind": { "path": "$r", "preserveNullAndEmptyArrays": true } });
        stages
    });
    any_of(vec![(4, lookup), (1, unwound.boxed())])
}

/// `$graphLookup`.
pub(crate) fn graph() -> Gen<Stages> {
    let names = || any_of(vec![(3, name(&["a", "b", "c", "_id"])), (1, path())]).prop_map(Bson::from).boxed();
    let graph = fields(vec![
        ("from", 100, pick(&["o", "c"])),
        ("startWith", 100, any_of(vec![(3, a_path()), (1, scalar()), (1, pick(&["$_id"]))])),
        ("connectFromField", 100, names()),
        ("connectToField", 100, names()),
        ("as", 100, pick(&["r"])),
        ("maxDepth", 40, pick(&[0, 1, 2])),
        ("depthField", 40, pick(&["depth"])),
        ("restrictSearchWithMatch", 30, filter::simple().prop_map(Bson::from).boxed()),
    ]);
    stage(object("$graphLookup", graph))
}

fn small() -> Gen<Document> {
    any_of(vec![
        (2, filter::simple().prop_map(|filter| doc! { "$match": filter }).boxed()),
        (2, projection::sort().prop_map(|sort| doc! { "$sort": sort }).boxed()),
        (1, pick(&[1, 2, 5, 0]).prop_map(|n| doc! { "$limit": n }).boxed()),
        (1, pick(&[0, 1, 3]).prop_map(|n| doc! { "$skip": n }).boxed()),
        (1, a_path().prop_map(|path| doc! { "$unwind": path }).boxed()),
        (1, projection::inclusion().prop_map(|shape| doc! { "$project": shape }).boxed()),
    ])
}

/// `$match`, `$sort`, `$limit`, `$skip`, one after another, `$count`, `$sortByCount`.
pub(crate) fn sequence() -> Gen<Stages> {
    let counted = Just(doc! { "$count": "n" }).boxed();
    let by = any_of(vec![(3, a_path()), (1, expression::conditional())]);
    let by_count = by.prop_map(|by| doc! { "$sortByCount": by }).boxed();
    (vec(small(), 1..=4), proptest::option::of(any_of(vec![(1, counted), (1, by_count)])))
        .prop_map(|(mut stages, last)| {
            stages.extend(last);
            stages
        })
        .boxed()
}

/// `$facet`, `$unionWith`, `$sample`, `$redact`, `$documents` inside others.
pub(crate) fn combined() -> Gen<Stages> {
    let stages = || vec(small(), 0..=2).prop_map(Bson::from).boxed();
    let facet = fields(vec![("p", 100, stages()), ("q", 60, stages())]);
    let union = any_of(vec![
        (1, pick(&["o", "none"])),
        (2, fields(vec![("coll", 100, pick(&["o", "c"])), ("pipeline", 80, stages())])),
    ]);
    let decision =
        |test: Gen| object("$cond", array(vec![test, pick(&["$$KEEP", "$$DESCEND"]), pick(&["$$PRUNE", "$$DESCEND"])]));
    any_of(vec![
        (3, stage(object("$facet", facet))),
        (3, stage(object("$unionWith", union))),
        (1, stage(object("$sample", object("size", pick(&[1, 3, 100]))))),
        (2, stage(object("$redact", decision(expression::comparison())))),
    ])
}

/// `$out` and `$merge`.
pub(crate) fn output() -> Gen<Stages> {
    let fields_of = fields(vec![
        ("a", 80, a_path()),
        ("z", 60, value(1).prop_map(|value| doc! { "$literal": value }.into()).boxed()),
    ]);
    let update = Just(Bson::from(vec![doc! { "$set": { "was": "$a", "now": "$$new.a" } }])).boxed();
    let matched = any_of(vec![(4, pick(&["replace", "merge", "keepExisting", "fail"])), (1, update)]);
    let merge = fields(vec![
        ("into", 100, pick(&["w"])),
        ("on", 20, pick(&["_id"])),
        ("whenMatched", 80, matched),
        ("whenNotMatched", 60, pick(&["insert", "discard", "fail"])),
    ]);
    let write = any_of(vec![
        (1, object("$out", pick(&["w"]))),
        (6, object("$merge", any_of(vec![(1, pick(&["w"])), (8, merge)]))),
    ]);
    let id = any_of(vec![(3, pick(&["$_id"])), (1, pick(&["$a", "$b"]))]);
    let shaped = (id, fields_of).prop_map(|(id, fields)| {
        let mut shape = doc! { "_id": id };
        shape.extend(super::value::document(fields));
        doc! { "$project": shape }
    });
    (vec(small(), 0..=1), shaped, write)
        .prop_map(|(mut stages, shaped, write)| {
            stages.push(shaped);
            stages.push(super::value::document(write));
            stages
        })
        .boxed()
}
