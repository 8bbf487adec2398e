//! The rules of a schema, and what does not satisfy them.

use bson::{Bson, Document, doc};

use super::keyword::{alone, is_of_type, number, plain, satisfies, titled};
use crate::query::regex::Pattern;

/// The keywords in the order in which MongoDB tells of them.
const ORDER: [&str; 25] = [
    "multipleOf",
    "maximum",
    "minimum",
    "pattern",
    "maxLength",
    "minLength",
    "minItems",
    "maxItems",
    "uniqueItems",
    "items",
    "additionalItems",
    "properties",
    "additionalProperties",
    "patternProperties",
    "required",
    "minProperties",
    "maxProperties",
    "dependencies",
    "allOf",
    "anyOf",
    "oneOf",
    "not",
    "enum",
    "type",
    "bsonType",
];

/// What a schema is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Place {
    /// A whole document, which can be nothing else.
    Whole,
    /// A value in it.
    Value,
}

/// The rules of a schema that a value does not satisfy.
pub(super) fn failing(schema: &Document, value: &Bson, place: Place) -> Vec<Document> {
    let stated = ORDER.iter().filter(|keyword| schema.contains_key(keyword) && is_of_type(schema, keyword));
    stated.filter_map(|keyword| explain(keyword, schema, value, place)).collect()
}

/// Returns that no document satisfies a schema of whole ones, where that is about something else.
pub(super) fn never(schema: &Document, value: &Bson, place: Place) -> Option<Document> {
    let fails = |keyword: &&str| schema.contains_key(keyword) && !satisfies(&alone(schema, keyword), value);
    (place == Place::Whole && ["type", "bsonType"].iter().any(fails)).then(|| {
        doc! {
            "operatorName": "$jsonSchema", "specifiedAs": { "$jsonSchema": schema.clone() },
            "reason": "expression always evaluates to false",
        }
    })
}

/// The rules of a schema within another one, with its title, that a value does not satisfy.
fn within(details: &mut Document, schema: &Document, value: &Bson, place: Place) {
    match never(schema, value, place) {
        Some(never) => details.insert("details", never),
        None => {
            titled(schema, details);
            details.insert("details", failing(schema, value, place))
        }
    };
}

/// Returns why a value does not satisfy a keyword; nothing where it does.
fn explain(keyword: &str, schema: &Document, value: &Bson, place: Place) -> Option<Document> {
    let argument = schema.get(keyword)?;
    let details = doc! { "operatorName": keyword };
    match (keyword, argument, value) {
        ("properties", Bson::Document(named), Bson::Document(fields)) => properties(details, named, fields),
        ("patternProperties", Bson::Document(patterns), Bson::Document(fields)) => {
            pattern_properties(details, patterns, fields)
        }
        ("additionalProperties", argument, Bson::Document(fields)) => {
            additional_properties(details, schema, argument, fields)
        }
        ("required", Bson::Array(names), Bson::Document(fields)) => {
            let mut missing = missing(names, fields)?;
            missing.sort_unstable();
            Some(with(details, doc! { "specifiedAs": alone(schema, keyword), "missingProperties": missing }))
        }
        ("dependencies", Bson::Document(needed), Bson::Document(fields)) => {
            dependencies(details, needed, fields, place)
        }
        ("items", Bson::Document(each), Bson::Array(items)) => {
            let reason = "At least one item did not match the sub-schema";
            first_failing(details, reason, each, items.iter().enumerate())
        }
        ("items", Bson::Array(each), Bson::Array(items)) => {
            let pairs = each.iter().filter_map(Bson::as_document).zip(items).enumerate();
            let pairs = pairs.filter(|(_, (schema, item))| !satisfies(schema, item));
            let listed = pairs.map(|(index, (schema, item))| {
                doc! { "itemIndex": i64::from(number(index)), "details": failing(schema, item, Place::Value) }
            });
            some(listed.collect()).map(|listed| with(details, doc! { "details": listed }))
        }
        ("items" | "properties" | "patternProperties" | "additionalProperties" | "dependencies" | "required", ..) => {
            None
        }
        ("additionalItems", argument, Bson::Array(items)) => additional_items(details, schema, argument, items),
        ("additionalItems", ..) => None,
        ("oneOf", Bson::Array(schemas), value) => one_of(details, schemas, value, place),
        ("allOf" | "anyOf", Bson::Array(schemas), value) => {
            (!satisfies(&alone(schema, keyword), value)).then(|| several(details, schemas, value, place))
        }
        _ if satisfies(&alone(schema, keyword), value) => None,
        ("not", ..) => Some(with(details, doc! { "reason": "child expression matched" })),
        ("enum", Bson::Array(options), _)
            if place == Place::Whole && !options.iter().any(|option| option.as_document().is_some()) =>
        {
            // No document can be what is no document.
            let reason = "expression always evaluates to false";
            Some(with(details, doc! { "specifiedAs": alone(schema, keyword), "reason": reason }))
        }
        _ => Some(plain(keyword, schema, value)),
    }
}

fn properties(details: Document, named: &Document, fields: &Document) -> Option<Document> {
    let mut listed = Vec::new();
    for (name, schema) in named {
        let (Bson::Document(schema), Some(value)) = (schema, fields.get(name)) else { continue };
        if !satisfies(schema, value) {
            let mut property = doc! { "propertyName": name };
            within(&mut property, schema, value, Place::Value);
            listed.push(property);
        }
    }
    some(listed).map(|listed| with(details, doc! { "propertiesNotSatisfied": listed }))
}

fn pattern_properties(details: Document, patterns: &Document, fields: &Document) -> Option<Document> {
    let mut listed = Vec::new();
    for (text, schema) in patterns {
        let (Bson::Document(schema), Ok(pattern)) = (schema, Pattern::new(text, "")) else { continue };
        let mut matching = fields.iter().filter(|(name, _)| pattern.is_match(name));
        if let Some((name, value)) = matching.find(|(_, value)| !satisfies(schema, value)) {
            let mut property = doc! { "propertyName": name };
            titled(schema, &mut property);
            property.insert("regexMatched", text);
            property.insert("details", failing(schema, value, Place::Value));
            listed.push(property);
        }
    }
    some(listed).map(|listed| with(details, doc! { "details": listed }))
}

fn additional_properties(
    mut details: Document,
    schema: &Document,
    argument: &Bson,
    fields: &Document,
) -> Option<Document> {
    let named = schema.get_document("properties").ok();
    let patterns = schema.get_document("patternProperties").into_iter().flatten();
    let patterns: Vec<Pattern> = patterns.filter_map(|(pattern, _)| Pattern::new(pattern, "").ok()).collect();
    let is_known = |name: &str| {
        named.is_some_and(|named| named.contains_key(name)) || patterns.iter().any(|pattern| pattern.is_match(name))
    };
    let mut others = fields.iter().filter(|(name, _)| !is_known(name));
    match argument {
        Bson::Boolean(false) => {
            let names = some(others.map(|(name, _)| name.clone()).collect())?;
            let specified = doc! { "additionalProperties": false };
            Some(with(details, doc! { "specifiedAs": specified, "additionalProperties": names }))
        }
        Bson::Document(schema) => {
            let (name, value) = others.find(|(_, value)| !satisfies(schema, value))?;
            titled(schema, &mut details);
            let reason = "at least one additional property did not match the subschema";
            let failing = failing(schema, value, Place::Value);
            Some(with(details, doc! { "reason": reason, "failingProperty": name, "details": failing }))
        }
        _ => None,
    }
}

fn additional_items(details: Document, schema: &Document, argument: &Bson, items: &[Bson]) -> Option<Document> {
    let count = schema.get_array("items").ok()?.len();
    let others = items.iter().enumerate().skip(count);
    match argument {
        Bson::Boolean(false) => {
            let items = some(others.map(|(_, item)| item.clone()).collect())?;
            let specified = doc! { "additionalItems": false };
            let reason = "found additional items";
            Some(with(details, doc! { "specifiedAs": specified, "reason": reason, "additionalItems": items }))
        }
        Bson::Document(schema) => {
            let reason = "At least one additional item did not match the sub-schema";
            first_failing(details, reason, schema, others)
        }
        _ => None,
    }
}

fn dependencies(details: Document, needed: &Document, fields: &Document, place: Place) -> Option<Document> {
    let mut listed = Vec::new();
    for (name, needed) in needed.iter().filter(|(name, _)| fields.contains_key(name.as_str())) {
        let why = match needed {
            Bson::Array(names) => missing(names, fields).map(|missing| ("missingProperties", Bson::from(missing))),
            Bson::Document(schema) => {
                let value = Bson::Document(fields.clone());
                let why =
                    || never(schema, &value, place).map_or_else(|| failing(schema, &value, place).into(), Bson::from);
                (!satisfies(schema, &value)).then(|| ("details", why()))
            }
            _ => None,
        };
        listed.extend(why.map(|(key, why)| doc! { "conditionalProperty": name, key: why }));
    }
    some(listed).map(|listed| with(details, doc! { "failingDependencies": listed }))
}

fn one_of(details: Document, schemas: &[Bson], value: &Bson, place: Place) -> Option<Document> {
    let matching = schemas.iter().filter_map(Bson::as_document).enumerate();
    let matching: Vec<i32> =
        matching.filter(|(_, schema)| satisfies(schema, value)).map(|(index, _)| number(index)).collect();
    match matching.len() {
        0 => Some(several(details, schemas, value, place)),
        1 => None,
        _ => {
            let reason = "more than one subschema matched";
            Some(with(details, doc! { "reason": reason, "matchingSchemaIndexes": matching }))
        }
    }
}

/// The schemas that a value does not satisfy.
fn several(details: Document, schemas: &[Bson], value: &Bson, place: Place) -> Document {
    let mut listed = Vec::new();
    for (index, schema) in schemas.iter().filter_map(Bson::as_document).enumerate() {
        if !satisfies(schema, value) {
            let mut one = doc! { "index": number(index) };
            within(&mut one, schema, value, place);
            listed.push(one);
        }
    }
    with(details, doc! { "schemasNotSatisfied": listed })
}

/// The first item that does not satisfy a schema.
fn first_failing<'a>(
    mut details: Document,
    reason: &str,
    schema: &Document,
    mut items: impl Iterator<Item = (usize, &'a Bson)>,
) -> Option<Document> {
    let (index, item) = items.find(|(_, item)| !satisfies(schema, item))?;
    titled(schema, &mut details);
    let failing = failing(schema, item, Place::Value);
    Some(with(details, doc! { "reason": reason, "itemIndex": number(index), "details": failing }))
}

/// Those of the names that a document does not have; none where it has all.
fn missing(names: &[Bson], fields: &Document) -> Option<Vec<String>> {
    let missing = names.iter().filter_map(Bson::as_str).filter(|name| !fields.contains_key(*name));
    some(missing.map(str::to_owned).collect())
}

fn some<T>(listed: Vec<T>) -> Option<Vec<T>> {
    Some(listed).filter(|listed| !listed.is_empty())
}

fn with(mut details: Document, more: Document) -> Document {
    details.extend(more);
    details
}
