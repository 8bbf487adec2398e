//! Single keywords of a schema.

use bson::{Bson, Document, doc};

use crate::query::compare::equal_values;
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

/// A keyword of a schema with those that say what it is about.
pub(super) fn alone(schema: &Document, keyword: &str) -> Document {
    let companions: &[&str] = match keyword {
        "minimum" => &["exclusiveMinimum"],
        "maximum" => &["exclusiveMaximum"],
        _ => &[],
    };
    let meant = |name: &&String| name.as_str() == keyword || companions.contains(&name.as_str());
    schema.iter().filter(|(name, _)| meant(name)).map(|(name, value)| (name.clone(), value.clone())).collect()
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
            let is_repeated =
                |(index, item): &(usize, &Bson)| items.iter().take(*index).any(|other| equal_values(other, item));
            if let Some((_, item)) = items.iter().enumerate().find(is_repeated) {
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

pub(super) fn number(count: usize) -> i32 {
    i32::try_from(count).unwrap_or(i32::MAX)
}
