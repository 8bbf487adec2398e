//! Window functions, gaps in series, and predicates in JavaScript.

use bson::{Bson, Document, doc};
use proptest::prelude::*;

use super::value::{Gen, any_of, pick};

/// `$setWindowFields` with one function.
pub(crate) fn window() -> Gen<Vec<Document>> {
    let plain = ["$sum", "$avg", "$min", "$max", "$push", "$first", "$last", "$stdDevPop", "$stdDevSamp", "$locf"];
    let input = pick(&["$n", "$_id", "$k", "$o.b", "$missing"]);
    let of_input = (proptest::sample::select(plain.to_vec()), input.clone())
        .prop_map(|(name, input)| Bson::from(doc! { name: input }))
        .boxed();
    let pair = (pick(&["$n", "$_id", "$o.b"]), pick(&["$_id", "$k"]), any::<bool>())
        .prop_map(|(x, y, sample)| {
            let name = if sample { "$covarianceSamp" } else { "$covariancePop" };
            Bson::from(doc! { name: [x, y] })
        })
        .boxed();
    let others = pick(&[
        doc! { "$count": {} },
        doc! { "$rank": {} },
        doc! { "$denseRank": {} },
        doc! { "$documentNumber": {} },
        doc! { "$shift": { "output": "$_id", "by": 1 } },
        doc! { "$shift": { "output": "$n", "by": -2, "default": "none" } },
        doc! { "$expMovingAvg": { "input": "$_id", "N": 3 } },
        doc! { "$expMovingAvg": { "input": "$n", "alpha": 0.25 } },
        doc! { "$derivative": { "input": "$_id" } },
        doc! { "$integral": { "input": "$_id" } },
        doc! { "$linearFill": "$n" },
        doc! { "$sum": 1 },
        doc! { "$unknown": 1 },
    ]);
    let function = any_of(vec![(4, of_input), (1, pair), (4, others)]);
    let bounds = pick(&[
        doc! {},
        doc! { "documents": [-1, 1] },
        doc! { "documents": ["unbounded", "current"] },
        doc! { "documents": ["current", 2] },
        doc! { "documents": [-2, -1] },
        doc! { "documents": [1, 0] },
        doc! { "range": [-1, 1] },
        doc! { "range": ["unbounded", "current"] },
        doc! { "range": [-1, 0], "unit": "day" },
    ]);
    let order =
        any_of(vec![(6, pick(&[doc! { "_id": 1 }])), (2, pick(&[doc! { "_id": -1 }, doc! { "n": 1, "_id": 1 }]))]);
    (function, proptest::option::weighted(0.6, bounds), proptest::option::weighted(0.9, order), 0..3u32)
        .prop_map(|(function, bounds, order, parts)| {
            let mut field = function.as_document().cloned().unwrap_or_default();
            field.extend(bounds.map(|bounds| ("window".to_owned(), bounds)));
            let mut spec = Document::new();
            if parts > 0 {
                spec.insert("partitionBy", doc! { "$mod": ["$_id", i32::try_from(parts + 1).unwrap_or(2)] });
            }
            spec.extend(order.map(|order| ("sortBy".to_owned(), order)));
            spec.insert("output", doc! { "x": field });
            vec![doc! { "$setWindowFields": spec }, doc! { "$project": { "x": 1 } }, doc! { "$sort": { "_id": 1 } }]
        })
        .boxed()
}

/// `$densify` and `$fill`.
pub(crate) fn gaps() -> Gen<Vec<Document>> {
    let step = pick(&[Bson::from(1), 2.into(), 0.5.into(), 0.into()]);
    let bounds = pick(&[
        Bson::from("full"),
        "partition".into(),
        vec![Bson::from(-2), 6.into()].into(),
        vec![Bson::from(3), 1.into()].into(),
    ]);
    let densify = (pick(&["_id", "n", "missing"]), step, bounds)
        .prop_map(|(field, step, bounds)| {
            let sorted = doc! { "$sort": { field.as_str().unwrap_or("_id"): 1, "_id": 1 } };
            vec![doc! { "$densify": { "field": field, "range": { "step": step, "bounds": bounds } } }, sorted]
        })
        .boxed();
    let how =
        pick(&[doc! { "method": "linear" }, doc! { "method": "locf" }, doc! { "value": "$_id" }, doc! { "value": 7 }]);
    let fill = (pick(&["n", "k", "missing", "o.b"]), how, any::<bool>())
        .prop_map(|(field, how, sorted)| {
            let field = field.as_str().unwrap_or("n");
            let mut spec = doc! { "output": { field: how } };
            if sorted {
                spec.insert("sortBy", doc! { "_id": 1 });
            }
            vec![doc! { "$fill": spec }, doc! { "$project": { field: 1 } }]
        })
        .boxed();
    any_of(vec![(1, densify), (1, fill)])
}

/// `$where`, alone and among other conditions.
pub(crate) fn predicate() -> Gen<Document> {
    let code = pick(&[
        "this.a == 1",
        "this.a > 0",
        "obj.b",
        "this.a != this.b",
        "typeof this.a == 'string'",
        "this.l && this.l.length > 1",
        "return this.a",
        "function() { return this.c == null }",
        "() => obj.a == null",
        "this.a + 1 == 2",
        "Object.keys(this).length > 3",
        "this.a.b.c",
        "throw 5",
        "this.a ===",
        "",
        "this.a instanceof Date",
        "var x = this._id; return x % 2 == 0;",
        "isNumber(this.a)",
        "this['b'] === undefined",
        "Array.isArray(this.a) || this.a === null",
        "tojson(this._id) == '3'",
    ]);
    (code, 0..5u32)
        .prop_map(|(code, place)| match place {
            0 => doc! { "$or": [{ "$where": code }, { "_id": 1 }] },
            1 => doc! { "$nor": [{ "$where": code }] },
            2 => doc! { "_id": { "$gt": 3 }, "$where": code },
            _ => doc! { "$where": code },
        })
        .boxed()
}

/// `$function` of a path.
pub(crate) fn function() -> Gen {
    let body = pick(&[
        "function(x) { return x }",
        "function(x) { return x + 1 }",
        "function(x) { return [x, 1, 'a', null] }",
        "function(x) { return {a: x, n: NumberInt(3), l: NumberLong(5)} }",
        "function(x) { return typeof x }",
        "function(x) { return x == null }",
        "(x) => String(x)",
        "function(x) { return undefined }",
        "function(x) { return new Date(0) }",
        "function(x) { return x.y.z }",
    ]);
    let argument = pick(&["$a", "$b", "$n", "$k", "$o", "$t", "$_id", "$missing"]);
    (body, argument)
        .prop_map(|(body, argument)| doc! { "$function": { "body": body, "args": [argument], "lang": "js" } }.into())
        .boxed()
}
