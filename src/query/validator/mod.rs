//! Validators: which documents a collection takes, and why it does not take one.
//!
//! A validator is a filter without the operators that need an index, a program or chance. Why a document does not pass is
//! told as MongoDB tells it (`errInfo.details`): by the operators that it does not satisfy, each with what it looked at.

mod clause;
mod keyword;
mod leaf;
mod rule;
mod schema;

use bson::{Bson, DateTime, Document, RawDocument, RawDocumentBuf, doc};

use super::error::{QueryError, Result};
use super::filter::Filter;

/// MongoDB's code for a program in a validator.
const NO_FUNCTION: i32 = 4_660_800;
/// The most bytes of an explanation.
const MAX_SIZE: usize = 12 << 20;
/// MongoDB's code for chance in a validator.
const NO_CHANCE: i32 = 3_040_500;

/// A compiled validator.
#[derive(Debug)]
pub struct Validator {
    filter: Filter,
    specified: Document,
}

impl Validator {
    /// Reads a validator; strings compare as in the collation in effect.
    ///
    /// # Errors
    /// If it is no filter, or has an operator that no validator may have.
    pub fn parse(specified: &Document) -> Result<Self> {
        check(specified)?;
        Ok(Self { filter: Filter::parse_validator(specified)?, specified: specified.clone() })
    }

    /// Returns whether a document passes at a time. One on which an expression fails does not.
    ///
    /// # Errors
    /// If the operation was interrupted.
    pub fn passes(&self, document: &RawDocument, now: DateTime) -> Result<bool> {
        match self.filter.matches_at(document, now) {
            Err(error) if !QueryError::is_interruption(error.code) => Ok(false),
            passes => passes,
        }
    }

    /// Returns why a document does not pass, as MongoDB has it in `errInfo.details`, and whether values are left out there,
    /// which would make it too large; nothing where it is too large without them.
    #[must_use]
    pub fn details(&self, document: &Document) -> (Document, bool) {
        let explained = clause::explain_filter(&self.specified, document, false);
        let details = explained.unwrap_or_else(|| doc! { "specifiedAs": self.specified.clone() });
        if size(&details) <= MAX_SIZE {
            return (details, false);
        }
        let details = without_values(details);
        (if size(&details) <= MAX_SIZE { details } else { Document::new() }, true)
    }
}

fn size(details: &Document) -> usize {
    RawDocumentBuf::try_from(details).map_or(usize::MAX, |raw| raw.as_bytes().len())
}

/// Details without what is specified and the values that were considered, as MongoDB shortens them.
fn without_values(details: Document) -> Document {
    let keeps = ["additionalProperties", "additionalItems"].iter().any(|name| details.contains_key(*name));
    let is_kept = |name: &str| match name {
        "consideredValue" | "consideredValues" | "consideredValuesTruncated" => false,
        "specifiedAs" => keeps,
        _ => true,
    };
    let shortened = |value: Bson| match value {
        Bson::Document(inner) => without_values(inner).into(),
        Bson::Array(items) => {
            let shortened = |item| match item {
                Bson::Document(inner) => without_values(inner).into(),
                item => item,
            };
            items.into_iter().map(shortened).collect::<Vec<Bson>>().into()
        }
        value => value,
    };
    let own = |name: &str| matches!(name, "specifiedAs" | "expressionResult" | "duplicatedValue" | "additionalItems");
    let kept = details.into_iter().filter(|(name, _)| is_kept(name));
    kept.map(|(name, value)| if own(&name) { (name, value) } else { (name.clone(), shortened(value)) }).collect()
}

/// Refuses what no validator may have in its expressions; what else is refused, the parser refuses.
fn check(filter: &Document) -> Result<()> {
    for (name, value) in filter {
        match (name.as_str(), value) {
            ("$and" | "$or" | "$nor", Bson::Array(items)) => {
                items.iter().filter_map(Bson::as_document).try_for_each(check)?;
            }
            ("$expr", expression) => check_expression(expression)?,
            ("$sampleRate", _) => return Err(chance(name)),
            _ => {}
        }
    }
    Ok(())
}

/// Without recursion: expressions are checked for their depth when they are parsed.
fn check_expression(expression: &Bson) -> Result<()> {
    let mut open = vec![expression];
    while let Some(value) = open.pop() {
        match value {
            Bson::Array(items) => open.extend(items),
            Bson::Document(fields) => {
                for (name, value) in fields {
                    match name.as_str() {
                        "$function" => {
                            let message = format!("{name} cannot be used inside a validator.");
                            return Err(QueryError::invalid(NO_FUNCTION, message).about(name));
                        }
                        "$rand" => return Err(chance(name)),
                        "$literal" => {}
                        _ => open.push(value),
                    }
                }
            }
            _ => {}
        }
    }
    Ok(())
}

fn chance(name: &str) -> QueryError {
    QueryError::invalid(NO_CHANCE, "$rand not allowed inside collection validators").about(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn details(validator: &Document, document: &Document) -> Document {
        let validator = Validator::parse(validator).unwrap();
        let raw = RawDocumentBuf::try_from(document).unwrap();
        assert!(!validator.passes(&raw, DateTime::now()).unwrap(), "{document}");
        validator.details(document).0
    }

    #[test]
    fn what_would_be_too_large_is_told_without_values() {
        let schema = doc! { "properties": { "a": { "maxLength": 1, "pattern": "y" } }, "additionalProperties": false };
        let found = details(&doc! { "$jsonSchema": schema }, &doc! { "_id": 1, "a": "x".repeat(7 << 20) });
        let rule = |name: &str, reason: &str| doc! { "operatorName": name, "reason": reason };
        let rules = [
            rule("pattern", "regular expression did not match"),
            rule("maxLength", "specified string length was not satisfied"),
        ];
        let others = doc! {
            "operatorName": "additionalProperties", "specifiedAs": { "additionalProperties": false },
            "additionalProperties": ["_id"],
        };
        let named = doc! { "propertyName": "a", "details": rules.to_vec() };
        let expected = doc! {
            "operatorName": "$jsonSchema",
            "schemaRulesNotSatisfied": [{ "operatorName": "properties", "propertiesNotSatisfied": [named] }, others],
        };
        assert_eq!(found, expected);
        let unique = doc! { "$jsonSchema": { "properties": { "a": { "uniqueItems": true } } } };
        let text = "x".repeat(13 << 20);
        assert_eq!(details(&unique, &doc! { "a": [&text, &text] }), doc! {});
    }

    #[test]
    fn what_needs_an_index_a_program_or_chance_is_refused() {
        let code = |validator: Document| Validator::parse(&validator).unwrap_err().code;
        assert_eq!(code(doc! { "$where": "1" }), 2);
        assert_eq!(code(doc! { "a": { "$near": [1, 2] } }), 5_626_500);
        assert_eq!(code(doc! { "a": { "$not": { "$near": [1, 2] } } }), 5_626_500);
        assert_eq!(code(doc! { "$text": { "$search": "x" } }), 2);
        assert_eq!(code(doc! { "$nor": [{ "$text": { "$search": "x" } }] }), 2);
        assert_eq!(code(doc! { "$expr": { "$function": { "body": "x", "args": [], "lang": "js" } } }), NO_FUNCTION);
        assert_eq!(code(doc! { "$and": [{ "$expr": { "$lt": [{ "$rand": {} }, 1] } }] }), NO_CHANCE);
        assert_eq!(code(doc! { "$sampleRate": 0.5 }), NO_CHANCE);
        assert_eq!(code(doc! { "$jsonSchema": { "foo": 1 } }), 9);
        assert_eq!(code(doc! { "$jsonSchema": { "properties": { "a": { "type": "integer" } } } }), 9);
        Validator::parse(&doc! { "$expr": { "$eq": ["$a", { "$literal": { "$rand": {} } }] } }).unwrap();
    }

    #[test]
    fn values_of_a_schema_have_their_fields_in_any_order() {
        let schema = doc! { "properties": { "a": { "enum": [{ "x": 1, "y": [{ "z": 1, "w": 2 }] }] } } };
        let validator = Validator::parse(&doc! { "$jsonSchema": schema }).unwrap();
        let passes = |document: Document| {
            validator.passes(&RawDocumentBuf::try_from(&document).unwrap(), DateTime::now()).unwrap()
        };
        assert!(passes(doc! { "a": { "y": [{ "w": 2, "z": 1 }], "x": 1 } }));
        assert!(!passes(doc! { "a": { "y": [{ "w": 2, "z": 2 }], "x": 1 } }));
    }

    #[test]
    fn the_present_is_that_of_the_write() {
        let validator = Validator::parse(&doc! { "$expr": { "$lt": ["$a", "$$NOW"] } }).unwrap();
        let document = RawDocumentBuf::try_from(&doc! { "a": DateTime::from_millis(5) }).unwrap();
        let passes = |now| validator.passes(&document, DateTime::from_millis(now)).unwrap();
        assert_eq!((passes(5), passes(6)), (false, true));
    }

    #[test]
    fn an_expression_that_fails_is_told_with_its_error() {
        let validator = doc! { "$expr": { "$gt": [{ "$divide": [1, "$a"] }, 0] } };
        let found = details(&validator, &doc! { "a": 0 });
        assert_eq!(found.get_str("reason").unwrap(), "failed to evaluate aggregation expression");
        assert_eq!(found.get_document("details").unwrap().get_i32("code").unwrap(), 2);
        let found = details(&validator, &doc! { "a": -2 });
        assert!(!found.get_bool("expressionResult").unwrap());
    }

    #[test]
    fn what_is_joined_is_told_by_its_parts() {
        let found = details(&doc! { "a": { "$gt": 1, "$lt": 5 }, "b": 1 }, &doc! { "a": 0 });
        let clause = |index: i32, details: Document| doc! { "index": index, "details": details };
        let missing = doc! { "operatorName": "$eq", "specifiedAs": { "b": 1 }, "reason": "field was missing" };
        let compared = doc! {
            "operatorName": "$gt", "specifiedAs": { "a": { "$gt": 1 } }, "reason": "comparison failed",
            "consideredValue": 0,
        };
        let expected =
            doc! { "operatorName": "$and", "clausesNotSatisfied": [clause(0, compared), clause(2, missing)] };
        assert_eq!(found, expected);
    }

    #[test]
    fn a_schema_is_told_by_the_properties_that_do_not_satisfy_it() {
        let schema = doc! {
            "bsonType": "object", "required": ["a", "b"],
            "properties": { "a": { "bsonType": "string", "description": "a text" } },
        };
        let found = details(&doc! { "$jsonSchema": schema }, &doc! { "_id": 1, "a": 2 });
        let of_type = doc! {
            "operatorName": "bsonType", "specifiedAs": { "bsonType": "string" }, "reason": "type did not match",
            "consideredValue": 2, "consideredType": "int",
        };
        let property = doc! { "propertyName": "a", "description": "a text", "details": [of_type] };
        let expected = doc! {
            "operatorName": "$jsonSchema",
            "schemaRulesNotSatisfied": [
                { "operatorName": "properties", "propertiesNotSatisfied": [property] },
                { "operatorName": "required", "specifiedAs": { "required": ["a", "b"] }, "missingProperties": ["b"] },
            ],
        };
        assert_eq!(found, expected);
    }
}
