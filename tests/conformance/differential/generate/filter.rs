//! Filters.

use bson::spec::BinarySubtype;
use bson::{Binary, Bson, Document, Regex, doc};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

use super::expression;
use super::value::{
    Gen, any_of, array, document, either, fields, int, name, number, object, path, pick, scalar, several, string, value,
};

/// Conditions on fields, one or two of them.
fn on_paths(condition: Gen) -> Gen<Document> {
    vec((path(), condition), 1..=2).prop_map(|conditions| conditions.into_iter().collect()).boxed()
}

fn compared() -> Gen {
    let operator = select(&["$eq", "$ne", "$gt", "$gte", "$lt", "$lte"][..]);
    let against = value(1);
    let listed = select(&["$in", "$nin"][..]);
    any_of(vec![
        (6, (operator.clone(), against.clone()).prop_map(|(name, value)| doc! { name: value }.into()).boxed()),
        (2, against.clone()),
        (2, (listed, vec(against, 0..4)).prop_map(|(name, values)| doc! { name: values }.into()).boxed()),
        (
            1,
            (operator.clone(), scalar(), operator, scalar())
                .prop_map(|(a, x, b, y)| doc! { a: x, b: y }.into())
                .boxed(),
        ),
    ])
}

/// `$eq` to `$nin` over values of all types: the order of types, arrays, null and missing.
pub(crate) fn comparison() -> Gen<Document> {
    on_paths(compared())
}

/// A simple condition of any kind, for what combines conditions.
pub(crate) fn simple() -> Gen<Document> {
    on_paths(any_of(vec![(5, compared()), (1, element_condition()), (1, regex_condition()), (1, array_condition(1))]))
}

/// `$and`, `$or`, `$nor` and `$not`.
pub(crate) fn logical() -> Gen<Document> {
    let mut filter = simple();
    let negated = any_of(vec![(3, compared().prop_filter("an operator", is_operator).boxed()), (1, regex_condition())]);
    for _ in 0..2 {
        let operator = select(&["$and", "$or", "$nor"][..]);
        let combined = (operator, vec(filter, 1..3)).prop_map(|(name, parts)| doc! { name: parts }).boxed();
        filter = any_of(vec![(3, combined), (2, simple()), (2, on_paths(object("$not", negated.clone())))]);
    }
    filter
}

fn is_operator(value: &Bson) -> bool {
    value.as_document().is_some_and(|document| document.keys().next().is_some_and(|name| name.starts_with('$')))
}

fn element_condition() -> Gen {
    let names = &["number", "string", "array", "object", "null", "double", "int", "long", "decimal", "date", "bool"];
    let kind = any_of(vec![
        (5, pick(names)),
        (2, pick(&["objectId", "binData", "regex", "timestamp", "minKey", "maxKey", "symbol", "nothing"])),
        (3, pick(&[1, 2, 3, 4, 10, 16, 18, 19, -1, 127, 99])),
        (1, pick(&[1.0, 2.0, 16.5])),
    ]);
    let kinds = any_of(vec![(3, kind.clone()), (1, several(kind, 3))]);
    let there = any_of(vec![(5, pick(&[true, false])), (1, scalar())]);
    any_of(vec![
        (2, object("$exists", there)),
        (4, object("$type", kinds.clone())),
        (1, object("$not", object("$type", kinds))),
    ])
}

/// `$exists` and `$type`.
pub(crate) fn element() -> Gen<Document> {
    on_paths(element_condition())
}

fn regex_condition() -> Gen {
    let pattern = select(
        &["a", "^a", "b$", "^$", "A", "a.b", "[ab]+c?", "a|1", "(?i)A", "^(a|b)", "é", ".", " a", "\\$", "("][..],
    );
    let options = select(&["", "", "i", "m", "s", "x", "im", "is", "z"][..]);
    let literal = (pattern.clone(), options.clone()).prop_map(|(pattern, options)| {
        match (pattern.try_into(), options.try_into()) {
            (Ok(pattern), Ok(options)) => Bson::RegularExpression(Regex { pattern, options }),
            _ => Bson::Null,
        }
    });
    let literal = literal.boxed();
    let text = pattern.clone().prop_map(Bson::from).boxed();
    any_of(vec![
        (3, (pattern, options).prop_map(|(p, o)| doc! { "$regex": p, "$options": o }.into()).boxed()),
        (2, object("$regex", text)),
        (1, object("$regex", literal.clone())),
        (3, literal.clone()),
        (1, object("$not", literal.clone())),
        (2, object("$in", array(vec![literal, scalar()]))),
    ])
}

/// `$regex` with its options, and regular expressions as values.
pub(crate) fn regex() -> Gen<Document> {
    on_paths(regex_condition())
}

/// `$mod` and the bitwise operators.
pub(crate) fn bitwise() -> Gen<Document> {
    let binary = |bytes: &[u8]| Bson::Binary(Binary { subtype: BinarySubtype::Generic, bytes: bytes.to_vec() });
    let mask = any_of(vec![
        (5, pick(&[0, 1, 2, 3, 5, 64])),
        (3, several(pick(&[0, 1, 2, 5, 6, 63, 200]), 3)),
        (1, pick(&[binary(b"a"), binary(b"")])),
        (1, any_of(vec![(1, number()), (1, string())])),
    ]);
    let bits = select(&["$bitsAllSet", "$bitsAnySet", "$bitsAllClear", "$bitsAnyClear"][..]);
    let divisor = any_of(vec![(5, pick(&[1, 2, 3])), (1, number())]);
    on_paths(any_of(vec![
        (3, (bits, mask).prop_map(|(name, mask)| doc! { name: mask }.into()).boxed()),
        (2, object("$mod", array(vec![divisor.clone(), int()]))),
        (1, object("$mod", several(divisor, 3))),
    ]))
}

fn array_condition(depth: u32) -> Gen {
    let inner = fields(vec![("b", 60, compared()), ("c", 40, compared())]);
    let mut element = any_of(vec![
        (3, compared().prop_filter("an operator", is_operator).boxed()),
        (3, inner.clone()),
        (1, object("$or", array(vec![inner.clone(), inner]))),
    ]);
    if depth > 0 {
        element = any_of(vec![(4, element), (1, array_condition(depth - 1))]);
    }
    let found = object("$elemMatch", element);
    any_of(vec![
        (4, found.clone()),
        (2, object("$all", several(scalar(), 2))),
        (1, object("$all", several(found.clone(), 2))),
        (1, object("$all", several(value(1), 2))),
        (2, object("$size", any_of(vec![(6, pick(&[0, 1, 2, 3])), (1, number())]))),
        (1, object("$not", found)),
    ])
}

/// `$elemMatch`, `$all` and `$size`.
pub(crate) fn arrays() -> Gen<Document> {
    on_paths(array_condition(1))
}

/// `$expr` with expressions that say yes or no.
pub(crate) fn expr() -> Gen<Document> {
    either(vec![expression::comparison(), expression::boolean()])
        .prop_map(|expression| doc! { "$expr": expression })
        .boxed()
}

/// `$jsonSchema`.
pub(crate) fn schema() -> Gen<Document> {
    schema_of(2).prop_map(|schema| doc! { "$jsonSchema": schema }).boxed()
}

fn schema_of(depth: u32) -> Gen {
    let kinds = any_of(vec![
        (4, pick(&["object", "array", "number", "string", "null", "boolean"])),
        (1, several(pick(&["object", "array", "number", "string"]), 2)),
    ]);
    let bson_kinds = any_of(vec![
        (4, pick(&["object", "array", "int", "double", "long", "decimal", "string", "date", "bool", "number"])),
        (1, several(pick(&["object", "array", "int", "string", "null"]), 2)),
    ]);
    let names = several(pick(&["a", "b", "c"]), 2);
    let count = pick(&[0, 1, 2]);
    let mut words = vec![
        ("type", 15, kinds),
        ("bsonType", 20, bson_kinds),
        ("required", 25, names),
        ("minimum", 12, number()),
        ("maximum", 12, number()),
        ("exclusiveMinimum", 3, pick(&[true, false])),
        ("multipleOf", 5, pick(&[1, 2, 3])),
        ("minLength", 6, count.clone()),
        ("maxLength", 6, count.clone()),
        ("pattern", 6, pick(&["^a", "b"])),
        ("minItems", 8, count.clone()),
        ("maxItems", 8, count.clone()),
        ("uniqueItems", 8, pick(&[true, false])),
        ("minProperties", 5, count.clone()),
        ("maxProperties", 5, count),
        ("enum", 8, several(value(1), 3)),
        ("title", 2, pick(&["a"])),
    ];
    if depth > 0 {
        let inner = schema_of(depth - 1);
        let within = fields(vec![("a", 60, inner.clone()), ("b", 40, inner.clone()), ("c", 30, inner.clone())]);
        let list = proptest::collection::vec(inner.clone(), 1..3).prop_map(Bson::Array).boxed();
        let closed = any_of(vec![(1, pick(&[true, false])), (1, inner.clone())]);
        words.extend([
            ("properties", 55, within.clone()),
            ("patternProperties", 8, within.clone()),
            ("additionalProperties", 6, closed.clone()),
            ("items", 15, any_of(vec![(3, inner.clone()), (1, list.clone())])),
            ("additionalItems", 4, closed),
            ("allOf", 5, list.clone()),
            ("anyOf", 8, list.clone()),
            ("oneOf", 6, list),
            ("not", 6, inner.clone()),
            ("dependencies", 4, any_of(vec![(1, within), (1, object("a", pick(&[Bson::Array(vec!["b".into()])])))])),
        ]);
    }
    fields(words)
}

/// A filter that many documents match, or few.
pub(crate) fn loose() -> Gen<Document> {
    any_of(vec![
        (3, Just(Document::new()).boxed()),
        (3, fields(vec![("_id", 100, object("$gte", pick(&[1, 2, 3, 5])))]).prop_map(document).boxed()),
        (2, (name(&["a", "b", "n", "l"]), pick(&[true])).prop_map(|(n, yes)| doc! { n: { "$exists": yes } }).boxed()),
        (2, simple()),
    ])
}
