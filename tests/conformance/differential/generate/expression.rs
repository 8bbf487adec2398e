//! Expressions, by groups of operators. Arguments mostly have the type that
//! their operator wants, and mostly come from the fields of `typed` documents.

use bson::{Bson, Document, doc};
use proptest::prelude::*;
use proptest::sample::select;

use super::value::{
    Gen, any_of, array, date, either, fields, int, nested, number, object, pick, scalar, several, string, value,
};

/// Calls an operator of one argument.
fn one(names: &'static [&'static str], argument: Gen) -> Gen {
    (select(names), argument, any::<bool>())
        .prop_map(|(name, argument, listed)| match argument {
            argument @ Bson::Array(_) => doc! { name: [argument] }.into(),
            argument if listed => doc! { name: [argument] }.into(),
            argument => doc! { name: argument }.into(),
        })
        .boxed()
}

/// Calls an operator of several arguments.
fn call(names: &'static [&'static str], arguments: Vec<Gen>) -> Gen {
    (select(names), arguments).prop_map(|(name, arguments)| doc! { name: arguments }.into()).boxed()
}

/// Calls an operator of any number of arguments of one kind.
fn many(names: &'static [&'static str], argument: Gen) -> Gen {
    (select(names), proptest::collection::vec(argument, 1..4))
        .prop_map(|(name, arguments)| doc! { name: arguments }.into())
        .boxed()
}

/// Sometimes something else than what is wanted.
fn mostly(right: Gen) -> Gen {
    any_of(vec![(24, right), (1, pick(&["$x", "$missing"])), (1, literal(scalar()))])
}

/// A value as it is, not as an expression.
fn literal(value: Gen) -> Gen {
    object("$literal", value)
}

pub(crate) fn a_number() -> Gen {
    mostly(any_of(vec![(5, pick(&["$n", "$m", "$_id"])), (4, number())]))
}

fn a_small() -> Gen {
    mostly(any_of(vec![(2, pick(&["$m"])), (4, int())]))
}

fn a_string() -> Gen {
    let plain = string().prop_filter("not a path", |text| text.as_str() != Some("$a")).boxed();
    mostly(any_of(vec![(5, pick(&["$s", "$t"])), (3, plain)]))
}

fn an_array() -> Gen {
    mostly(any_of(vec![(6, pick(&["$l", "$k"])), (2, several(literal(scalar()), 3)), (1, pick(&["$o.b"]))]))
}

fn a_date() -> Gen {
    mostly(any_of(vec![(5, pick(&["$d"])), (2, date()), (1, pick(&["$_id"]))]))
}

fn an_object() -> Gen {
    mostly(any_of(vec![(5, pick(&["$o"])), (1, literal(nested(1))), (1, pick(&["$$ROOT"]))]))
}

fn anything() -> Gen {
    any_of(vec![
        (6, pick(&["$n", "$s", "$l", "$d", "$o", "$x", "$o.b", "$l.b", "$missing", "$$REMOVE"])),
        (3, literal(value(1))),
    ])
}

fn a_boolean() -> Gen {
    any_of(vec![
        (2, anything()),
        (1, pick(&[true, false])),
        (3, call(&["$gt", "$lt", "$eq"], vec![a_number(), a_number()])),
    ])
}

pub(crate) fn arithmetic() -> Gen {
    let group = |n: Gen| {
        either(vec![
            many(&["$add", "$multiply"], n.clone()),
            call(&["$subtract", "$divide", "$mod", "$pow"], vec![n.clone(), n.clone()]),
            one(&["$abs", "$ceil", "$floor", "$sqrt", "$trunc", "$round"], n.clone()),
            call(&["$round", "$trunc"], vec![n.clone(), a_small()]),
            call(&["$add", "$subtract"], vec![a_date(), a_small()]),
        ])
    };
    let inner = group(a_number());
    any_of(vec![(3, inner.clone()), (1, group(any_of(vec![(2, a_number()), (1, inner)])))])
}

/// Exponentials, logarithms and trigonometry, on numbers whose results all libraries agree on.
pub(crate) fn transcendental() -> Gen {
    let exact = mostly(any_of(vec![(3, pick(&[0, 1, -1, 2])), (3, pick(&["$m"])), (1, pick(&[0.0, 1.0, 0.5]))]));
    either(vec![
        one(&["$exp", "$ln", "$log10", "$sqrt"], exact.clone()),
        call(&["$log"], vec![exact.clone(), pick(&[2, 10, 1])]),
        one(
            &["$sin", "$cos", "$tan", "$asin", "$acos", "$atan", "$sinh", "$cosh", "$tanh", "$asinh", "$atanh"],
            exact.clone(),
        ),
        one(&["$degreesToRadians", "$radiansToDegrees", "$acosh"], exact.clone()),
        call(&["$atan2"], vec![exact.clone(), exact]),
    ])
}

pub(crate) fn strings() -> Gen {
    let (s, n) = (a_string(), a_small());
    let pattern = mostly(pick(&["a", "^a", "(a)(b)?", "[ab]", "b$", "", "(?<x>a)"]));
    let options = pick(&["", "i", "s", "m"]);
    let regex = fields(vec![("input", 100, s.clone()), ("regex", 100, pattern), ("options", 25, options)]);
    let replace = fields(vec![("input", 100, s.clone()), ("find", 98, s.clone()), ("replacement", 98, s.clone())]);
    let trim = fields(vec![("input", 100, s.clone()), ("chars", 40, s.clone())]);
    either(vec![
        many(&["$concat"], s.clone()),
        one(&["$toLower", "$toUpper", "$strLenBytes", "$strLenCP"], s.clone()),
        call(&["$split", "$strcasecmp"], vec![s.clone(), s.clone()]),
        call(&["$substr", "$substrBytes", "$substrCP"], vec![s.clone(), n.clone(), n.clone()]),
        call(&["$indexOfBytes", "$indexOfCP"], vec![s.clone(), s.clone()]),
        call(&["$indexOfBytes", "$indexOfCP"], vec![s.clone(), s.clone(), n.clone(), n]),
        either(vec![object("$trim", trim.clone()), object("$ltrim", trim.clone()), object("$rtrim", trim)]),
        either(vec![object("$replaceOne", replace.clone()), object("$replaceAll", replace)]),
        either(vec![
            object("$regexFind", regex.clone()),
            object("$regexFindAll", regex.clone()),
            object("$regexMatch", regex),
        ]),
    ])
}

pub(crate) fn arrays() -> Gen {
    let (a, n) = (an_array(), a_small());
    let by = any_of(vec![
        (3, pick(&[1, -1])),
        (2, pick(&[doc! { "b": 1 }, doc! { "b": -1, "c": 1 }, doc! { "b.c": 1 }])),
        (1, number()),
    ]);
    let sort = fields(vec![("input", 100, a.clone()), ("sortBy", 98, by)]);
    let zip = fields(vec![
        ("inputs", 100, array(vec![a.clone(), a.clone()])),
        ("useLongestLength", 40, pick(&[true])),
        ("defaults", 10, array(vec![int(), int()])),
    ]);
    let some = fields(vec![("n", 98, mostly(pick(&[1, 2, 3]))), ("input", 100, a.clone())]);
    either(vec![
        call(&["$arrayElemAt"], vec![a.clone(), n.clone()]),
        one(&["$first", "$last", "$size", "$reverseArray", "$isArray"], a.clone()),
        many(&["$concatArrays"], a.clone()),
        call(&["$in"], vec![anything(), a.clone()]),
        call(&["$indexOfArray"], vec![a.clone(), anything()]),
        call(&["$indexOfArray"], vec![a.clone(), anything(), n.clone(), n.clone()]),
        call(&["$range"], vec![n.clone(), a_small(), a_small()]),
        call(&["$range"], vec![n.clone(), n.clone()]),
        call(&["$slice"], vec![a.clone(), n.clone()]),
        call(&["$slice"], vec![a.clone(), n.clone(), pick(&[1, 2, 3])]),
        object("$sortArray", sort),
        object("$zip", zip),
        either(vec![
            object("$firstN", some.clone()),
            object("$lastN", some.clone()),
            object("$maxN", some.clone()),
            object("$minN", some),
        ]),
        one(&["$arrayToObject"], any_of(vec![(1, a), (3, pairs())])),
    ])
}

/// Arrays that `$arrayToObject` takes, mostly.
fn pairs() -> Gen {
    let key = any_of(vec![(9, pick(&["a", "b", "c"])), (1, scalar())]);
    let listed = several(array(vec![literal(key.clone()), literal(scalar())]), 3);
    let named = several(literal(fields(vec![("k", 98, key), ("v", 97, scalar())])), 3);
    any_of(vec![(1, listed), (1, named), (1, object("$objectToArray", an_object()))])
}

/// `$map`, `$filter`, `$reduce`, `$let`.
pub(crate) fn variables() -> Gen {
    let this = pick(&["$$this", "$$this.b", "$n"]);
    let test = call(&["$gt", "$lt", "$eq", "$ne"], vec![this.clone(), any_of(vec![(3, int()), (1, anything())])]);
    let made = any_of(vec![(2, this.clone()), (2, one(&["$type", "$isNumber"], this.clone())), (1, test.clone())]);
    let folded = either(vec![
        call(&["$concatArrays"], vec![pick(&["$$value"]), array(vec![this.clone()])]),
        call(&["$max", "$min"], vec![pick(&["$$value"]), this]),
        pick(&["$$value", "$$this"]),
    ]);
    let initial = any_of(vec![(2, several(int(), 1)), (1, literal(scalar()))]);
    let vars = fields(vec![("v", 98, anything()), ("w", 60, a_number())]);
    let named = call(&["$add", "$eq", "$ifNull"], vec![pick(&["$$v", "$$w", "$n"]), pick(&["$$v", "$m"])]);
    either(vec![
        object("$map", fields(vec![("input", 100, an_array()), ("in", 100, made)])),
        object("$filter", fields(vec![("input", 100, an_array()), ("cond", 100, test), ("limit", 15, int())])),
        object("$reduce", fields(vec![("input", 100, an_array()), ("initialValue", 99, initial), ("in", 100, folded)])),
        object("$let", fields(vec![("vars", 100, vars), ("in", 100, named)])),
    ])
}

pub(crate) fn sets() -> Gen {
    let a = an_array();
    either(vec![
        many(&["$setUnion", "$setIntersection"], a.clone()),
        call(&["$setDifference", "$setIsSubset"], vec![a.clone(), a.clone()]),
        call(&["$setEquals"], vec![a.clone(), a.clone()]),
        one(&["$allElementsTrue", "$anyElementTrue"], array(vec![a])),
    ])
}

fn zone() -> Gen {
    mostly(pick(&["UTC", "+01:30", "-0500", "Europe/Berlin", "America/New_York", "Asia/Kolkata", "+3"]))
}

fn unit() -> Gen {
    mostly(pick(&["millisecond", "second", "minute", "hour", "day", "week", "month", "quarter", "year"]))
}

pub(crate) fn dates() -> Gen {
    let d = a_date();
    let parted = fields(vec![("date", 100, d.clone()), ("timezone", 50, zone())]);
    let part = any_of(vec![(1, d.clone()), (1, parted.clone())]);
    let parts = &["$year", "$month", "$dayOfMonth", "$dayOfWeek", "$dayOfYear", "$hour", "$minute", "$second"][..];
    let more = &["$millisecond", "$week", "$isoWeek", "$isoWeekYear", "$isoDayOfWeek"][..];
    let named = |names: &'static [&'static str]| {
        (select(names), part.clone()).prop_map(|(name, part)| doc! { name: part }.into()).boxed()
    };
    let start = pick(&["monday", "sun", "Friday"]);
    let amount = mostly(pick(&[0, 1, -1, 13, 400]));
    let add = fields(vec![
        ("startDate", 100, d.clone()),
        ("unit", 100, unit()),
        ("amount", 100, amount),
        ("timezone", 30, zone()),
    ]);
    let diff = fields(vec![
        ("startDate", 100, d.clone()),
        ("endDate", 100, d.clone()),
        ("unit", 100, unit()),
        ("timezone", 30, zone()),
        ("startOfWeek", 20, start.clone()),
    ]);
    let trunc = fields(vec![
        ("date", 100, d.clone()),
        ("unit", 100, unit()),
        ("binSize", 40, pick(&[1, 2, 5, 7])),
        ("timezone", 30, zone()),
        ("startOfWeek", 20, start),
    ]);
    let format = pick(&["%Y-%m-%d", "%H:%M:%S.%L %z", "%j %U %V %G %u %w %%", "%Z", "%Y", "x%"]);
    let text = fields(vec![
        ("date", 100, d.clone()),
        ("format", 70, format),
        ("timezone", 40, zone()),
        ("onNull", 30, pick(&["none"])),
    ]);
    let spelled = pick(&[
        "2017-02-08T12:10:40.787Z",
        "2017-02-08",
        "2017-02-08T12:10:40+0300",
        "2017-02-30",
        "08/02/2017",
        "12",
        "",
        "2017-02-08 12:10",
        "2017-W06-3",
    ]);
    let read = fields(vec![
        ("dateString", 100, any_of(vec![(6, spelled), (1, a_string())])),
        ("format", 25, pick(&["%Y-%m-%d", "%d/%m/%Y", "%Y-%m-%dT%H:%M:%S.%LZ", "%G-W%V-%u"])),
        ("timezone", 20, zone()),
        ("onError", 50, pick(&["bad"])),
        ("onNull", 30, pick(&["none"])),
    ]);
    let from_parts = fields(vec![
        ("year", 98, pick(&[2000, 2016, 2017, 1969, 9999])),
        ("month", 60, mostly(pick(&[1, 2, 12, 14, 0, -3]))),
        ("day", 60, mostly(pick(&[1, 29, 31, 60, 0]))),
        ("hour", 40, mostly(pick(&[0, 23, 25, -1]))),
        ("minute", 20, pick(&[0, 59, 61])),
        ("second", 20, pick(&[0, 59, 61])),
        ("millisecond", 20, pick(&[0, 999, 1001])),
        ("timezone", 30, zone()),
    ]);
    let from_iso = fields(vec![
        ("isoWeekYear", 100, pick(&[2000, 2016, 1969])),
        ("isoWeek", 60, mostly(pick(&[1, 53, 54, 0]))),
        ("isoDayOfWeek", 60, mostly(pick(&[1, 7, 8]))),
        ("timezone", 30, zone()),
    ]);
    let to_parts = fields(vec![("date", 100, d), ("timezone", 40, zone()), ("iso8601", 40, pick(&[true, false]))]);
    any_of(vec![
        (2, named(parts)),
        (1, named(more)),
        (2, object("$dateAdd", add.clone())),
        (1, object("$dateSubtract", add)),
        (2, object("$dateDiff", diff)),
        (2, object("$dateTrunc", trunc)),
        (2, object("$dateToString", text)),
        (2, object("$dateFromString", read)),
        (2, object("$dateFromParts", either(vec![from_parts, from_iso]))),
        (1, object("$dateToParts", to_parts)),
    ])
}

pub(crate) fn conditional() -> Gen {
    let cond = fields(vec![("if", 100, a_boolean()), ("then", 99, anything()), ("else", 99, anything())]);
    let branch = fields(vec![("case", 100, a_boolean()), ("then", 100, anything())]);
    let branches = proptest::collection::vec(branch, 1..3).prop_map(Bson::Array).boxed();
    either(vec![
        object("$cond", cond),
        call(&["$cond"], vec![a_boolean(), anything(), anything()]),
        call(&["$ifNull"], vec![anything(), anything()]),
        call(&["$ifNull"], vec![anything(), anything(), anything()]),
        object("$switch", fields(vec![("branches", 100, branches), ("default", 80, anything())])),
    ])
}

pub(crate) fn comparison() -> Gen {
    call(&["$eq", "$ne", "$gt", "$gte", "$lt", "$lte", "$cmp"], vec![anything(), anything()])
}

pub(crate) fn boolean() -> Gen {
    let test = any_of(vec![(2, comparison()), (1, anything())]);
    either(vec![many(&["$and", "$or"], test.clone()), one(&["$not"], array(vec![test]))])
}

pub(crate) fn conversion() -> Gen {
    let texts = pick(&[
        "1",
        "-2",
        "1.5",
        "1e3",
        " 1",
        "abc",
        "0x1A",
        "true",
        "",
        "2017-02-08T12:10:40Z",
        "010101010101010101010101",
        "9223372036854775808",
        "NaN",
        "Infinity",
        "+5",
        ".5",
    ]);
    let source = any_of(vec![(4, anything()), (3, texts), (2, literal(number())), (1, literal(scalar()))]);
    let kinds = any_of(vec![
        (5, pick(&["double", "string", "objectId", "bool", "date", "int", "long", "decimal"])),
        (1, pick(&[1, 2, 7, 8, 9, 16, 18, 19])),
        (1, scalar()),
    ]);
    let to = any_of(vec![(6, kinds), (1, pick(&["$s", "$missing"]))]);
    let convert = fields(vec![
        ("input", 100, source.clone()),
        ("to", 100, to),
        ("onError", 50, pick(&["bad"])),
        ("onNull", 40, pick(&["none"])),
    ]);
    either(vec![
        object("$convert", convert.clone()),
        object("$convert", convert),
        one(
            &["$toBool", "$toDate", "$toDecimal", "$toDouble", "$toInt", "$toLong", "$toObjectId", "$toString"],
            source.clone(),
        ),
        one(&["$type", "$isNumber"], source),
    ])
}

pub(crate) fn objects() -> Gen {
    let o = an_object();
    let key = pick(&["a", "b", "c", "$x", "a.b"]).prop_map(|key| match key {
        Bson::String(key) if key.starts_with('$') => doc! { "$literal": key }.into(),
        key => key,
    });
    let key = key.boxed();
    let set = fields(vec![("field", 100, key.clone()), ("input", 100, o.clone()), ("value", 99, anything())]);
    let unset = fields(vec![("field", 100, key.clone()), ("input", 100, o.clone())]);
    either(vec![
        many(&["$mergeObjects"], o.clone()),
        one(&["$objectToArray"], o.clone()),
        one(&["$arrayToObject"], pairs()),
        object("$setField", set),
        object("$unsetField", unset.clone()),
        object("$getField", unset),
        object("$getField", key),
        one(&["$bsonSize"], o),
        one(&["$binarySize"], any_of(vec![(2, a_string()), (1, anything())])),
        fields(vec![("p", 80, anything()), ("q", 60, a_number()), ("r", 40, literal(scalar()))]),
    ])
}

/// Accumulators as expressions: over arrays and lists of arguments.
pub(crate) fn accumulators() -> Gen {
    const NAMES: &[&str] = &["$sum", "$avg", "$min", "$max", "$stdDevPop", "$stdDevSamp"];
    any_of(vec![
        (2, one(NAMES, an_array())),
        (2, one(NAMES, a_number())),
        (3, many(NAMES, anything())),
        (2, many(NAMES, a_number())),
    ])
}

/// An expression of any group.
pub(crate) fn any_group() -> Gen {
    either(vec![
        arithmetic(),
        strings(),
        arrays(),
        sets(),
        conditional(),
        comparison(),
        objects(),
        accumulators(),
        variables(),
        anything(),
    ])
}

/// A document with an expression as a stage of a pipeline uses it.
pub(crate) fn projected(expression: Gen) -> Gen<Vec<Document>> {
    (expression, any::<bool>())
        .prop_map(|(expression, project)| match project {
            true => vec![doc! { "$project": { "r": expression } }],
            false => vec![doc! { "$addFields": { "r": expression } }, doc! { "$project": { "r": 1 } }],
        })
        .boxed()
}
