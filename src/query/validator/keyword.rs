//! Single keywords of a schema.

use bson::{Bson, Document, doc};

use crate::query::compare::{compare_values, settled};
use crate::query::filter::Filter;
use crate::query::type_name;

/// Keywords that say what is, and ask for nothing.
const TITLES: [&str; 2] = ["title", "description"];

/// Copies title and description of a schema.
pub(super) fn titled(schema: &Document, details: &mut Document) {
    for (name, title) in TITLES.iter().filter_map(|name| Some((name, schema.get(name)?))) {
        details.insert(*name, title.clone());
    }
}

/// Whether a value satisfies a schema.
pub(super) fn satisfies(schema: &Document, value: &Bson) -> bool {
    let filter = doc! { "$jsonSchema": { "properties": { "v": schema.clone() } } };
    let document = doc! { "v": value.clone() };
    // A schema that was parsed as a whole has no part that is none.
    Filter::parse(&filter).and_then(|filter| filter.matches_document(&document)).unwrap_or(true)
}

/// A keyword of a schema with the one that says more of it.
pub(super) fn alone(schema: &Document, keyword: &str) -> Document {
    let companion = match keyword {
        "minimum" => "exclusiveMinimum",
        "maximum" => "exclusiveMaximum",
        _ => "",
    };
    let companion = Some(companion).filter(|name| schema.get_bool(name).unwrap_or(false));
    let meant = std::iter::once(keyword).chain(companion);
    meant.filter_map(|name| Some((name.to_owned(), schema.get(name)?.clone()))).collect()
}

/// Whether a keyword looks at values that the type of a schema allows, where that is one type: MongoDB leaves out the others.
pub(super) fn is_of_type(schema: &Document, keyword: &str) -> bool {
    const NUMBERS: [&str; 5] = ["number", "int", "long", "double", "decimal"];
    let looked_at: &[&str] = match keyword {
        "multipleOf" | "maximum" | "minimum" => &NUMBERS,
        "pattern" | "maxLength" | "minLength" => &["string"],
        "minItems" | "maxItems" | "uniqueItems" | "items" | "additionalItems" => &["array"],
        "properties"
        | "additionalProperties"
        | "patternProperties"
        | "required"
        | "minProperties"
        | "maxProperties" => &["object"],
        _ => return true,
    };
    let is_looked_at = |name: &Bson| name.as_str().is_some_and(|name| looked_at.contains(&name));
    match schema.get("type").or_else(|| schema.get("bsonType")) {
        Some(Bson::Array(names)) => match names.as_slice() {
            [name] => is_looked_at(name),
            _ => true,
        },
        Some(name) => is_looked_at(name),
        None => true,
    }
}

/// A keyword that looks at one value.
pub(super) fn plain(keyword: &str, schema: &Document, value: &Bson) -> Document {
    let mut details = doc! { "operatorName": keyword, "specifiedAs": alone(schema, keyword) };
    let reason = match keyword {
        "minimum" | "maximum" => "comparison failed",
        "multipleOf" => "considered value is not a multiple of the specified value",
        "minLength" | "maxLength" => "specified string length was not satisfied",
        "pattern" => "regular expression did not match",
        "enum" => "value was not found in enum",
        "minProperties" | "maxProperties" => "specified number of properties was not satisfied",
        "minItems" | "maxItems" => "array did not match specified length",
        "uniqueItems" => "found a duplicate item",
        _ => "type did not match",
    };
    details.insert("reason", reason);
    match (keyword, value) {
        ("minProperties" | "maxProperties", Bson::Document(fields)) => {
            details.insert("numberOfProperties", number(fields.len()));
            return details;
        }
        _ => details.insert("consideredValue", value.clone()),
    };
    match (keyword, value) {
        ("minItems" | "maxItems", Bson::Array(items)) => {
            details.insert("numberOfItems", number(items.len()));
        }
        ("uniqueItems", Bson::Array(items)) => {
            if let Some(item) = repeated(items) {
                details.insert("duplicatedValue", item.clone());
            }
        }
        ("type" | "bsonType", value) => {
            details.insert("consideredType", type_name(value));
        }
        _ => {}
    }
    details
}

/// The first item that is equal to one before it.
fn repeated(items: &[Bson]) -> Option<&Bson> {
    let mut numbered: Vec<(Bson, usize)> = items.iter().cloned().map(settled).zip(0..).collect();
    numbered.sort_by(|(one, first), (other, second)| compare_values(one, other).then(first.cmp(second)));
    let repeated = numbered.windows(2).filter_map(|pair| match pair {
        [(one, _), (other, place)] if compare_values(one, other).is_eq() => Some(*place),
        _ => None,
    });
    items.get(repeated.min()?)
}

pub(super) fn number(count: usize) -> i32 {
    i32::try_from(count).unwrap_or(i32::MAX)
}
