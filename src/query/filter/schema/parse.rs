//! Parses schemas.

use bson::{Bson, Document};

use super::{Items, Others, Properties, Rule, Schema};
use crate::query::compare::{compare_values, has_equal, settled};
use crate::query::error::{QueryError, Result};
use crate::query::filter::types::TypeSet;
use crate::query::number::Number;
use crate::query::regex::Pattern;

/// How deep schemas may be nested.
const MAX_DEPTH: usize = 100;

/// Keywords of JSON Schema that MongoDB does not take.
const UNSUPPORTED: [&str; 6] = ["$ref", "$schema", "default", "definitions", "format", "id"];

/// JSON's types, and MongoDB's names for them.
const JSON_TYPES: [(&str, &str); 6] = [
    ("array", "array"),
    ("boolean", "bool"),
    ("null", "null"),
    ("number", "number"),
    ("object", "object"),
    ("string", "string"),
];

fn wrong(keyword: &str, wanted: &str) -> QueryError {
    QueryError::type_mismatch(format!("$jsonSchema keyword '{keyword}' must be {wanted}"))
}

fn invalid(message: impl Into<String>) -> QueryError {
    QueryError::failed_to_parse(message)
}

impl Schema {
    /// Reads a schema.
    ///
    /// # Errors
    /// If a keyword is unknown or its argument is wrong.
    pub(in crate::query::filter) fn parse(schema: &Document) -> Result<Self> {
        read(schema, 0)
    }
}

fn read(schema: &Document, depth: usize) -> Result<Schema> {
    if depth > MAX_DEPTH {
        return Err(invalid("the schema is nested too deeply"));
    }
    if schema.contains_key("type") && schema.contains_key("bsonType") {
        return Err(invalid("cannot specify both $jsonSchema keywords 'type' and 'bsonType'"));
    }
    let mut rules = Vec::new();
    for (keyword, value) in schema {
        rules.extend(rule(keyword, value, schema, depth)?);
    }
    rules.extend(properties(schema, depth)?.map(Rule::Properties));
    rules.extend(items(schema, depth)?.map(Rule::Items));
    Ok(Schema { rules })
}

fn rule(keyword: &str, value: &Bson, schema: &Document, depth: usize) -> Result<Vec<Rule>> {
    let one = match keyword {
        "type" => Rule::Type(types(keyword, value, true)?),
        "bsonType" => Rule::Type(types(keyword, value, false)?),
        "enum" => Rule::Enum(options(value)?),
        "allOf" => Rule::AllOf(schemas(keyword, value, depth)?),
        "anyOf" => Rule::AnyOf(schemas(keyword, value, depth)?),
        "oneOf" => Rule::OneOf(schemas(keyword, value, depth)?),
        "not" => Rule::Not(inner(keyword, value, depth)?),
        "minimum" => Rule::Minimum(number(keyword, value)?, exclusive(schema, "exclusiveMinimum")?),
        "maximum" => Rule::Maximum(number(keyword, value)?, exclusive(schema, "exclusiveMaximum")?),
        "exclusiveMinimum" => {
            exclusive(schema, keyword)?;
            return needs(schema, keyword, "minimum");
        }
        "exclusiveMaximum" => {
            exclusive(schema, keyword)?;
            return needs(schema, keyword, "maximum");
        }
        "multipleOf" => {
            let divisor = number(keyword, value)?;
            if divisor.is_nan() || !divisor.is_finite() || !Number::compare(divisor, Number::Int(0)).is_gt() {
                return Err(invalid("$jsonSchema keyword 'multipleOf' must have a positive value"));
            }
            Rule::MultipleOf(divisor)
        }
        "minLength" => Rule::MinLength(size(keyword, value)?),
        "maxLength" => Rule::MaxLength(size(keyword, value)?),
        "pattern" => match value {
            Bson::String(pattern) => Rule::Pattern(Pattern::new(pattern, "")?),
            _ => return Err(wrong(keyword, "a string")),
        },
        "required" => Rule::Required(names(keyword, value)?),
        "minProperties" => Rule::MinProperties(size(keyword, value)?),
        "maxProperties" => Rule::MaxProperties(size(keyword, value)?),
        "dependencies" => return dependencies(value, depth),
        "minItems" => Rule::MinItems(size(keyword, value)?),
        "maxItems" => Rule::MaxItems(size(keyword, value)?),
        "uniqueItems" => match value {
            Bson::Boolean(true) => Rule::UniqueItems,
            Bson::Boolean(false) => return Ok(Vec::new()),
            _ => return Err(wrong(keyword, "a boolean")),
        },
        "title" | "description" => match value {
            Bson::String(_) => return Ok(Vec::new()),
            _ => return Err(wrong(keyword, "a string")),
        },
        "properties" | "patternProperties" | "additionalProperties" | "items" | "additionalItems" => {
            return Ok(Vec::new());
        }
        "encrypt" | "encryptMetadata" => return Err(QueryError::unsupported(keyword)),
        _ if UNSUPPORTED.contains(&keyword) => {
            return Err(invalid(format!("$jsonSchema keyword '{keyword}' is not currently supported")));
        }
        _ => return Err(invalid(format!("unknown $jsonSchema keyword: {keyword}"))),
    };
    Ok(vec![one])
}

fn needs(schema: &Document, keyword: &str, other: &str) -> Result<Vec<Rule>> {
    if schema.contains_key(other) {
        return Ok(Vec::new());
    }
    Err(invalid(format!("$jsonSchema keyword '{other}' must be present if '{keyword}' is present")))
}

fn exclusive(schema: &Document, keyword: &str) -> Result<bool> {
    match schema.get(keyword) {
        None => Ok(false),
        Some(Bson::Boolean(exclusive)) => Ok(*exclusive),
        Some(_) => Err(wrong(keyword, "a boolean")),
    }
}

fn types(keyword: &str, value: &Bson, json: bool) -> Result<TypeSet> {
    let names: Vec<&Bson> = match value {
        Bson::String(_) => vec![value],
        Bson::Array(items) if !items.is_empty() => items.iter().collect(),
        Bson::Array(_) => return Err(invalid(format!("$jsonSchema keyword '{keyword}' must name at least one type"))),
        _ => return Err(wrong(keyword, "a string or an array of strings")),
    };
    let mut types = TypeSet::default();
    let mut seen: Vec<&str> = Vec::new();
    for name in names {
        let Bson::String(name) = name else { return Err(wrong(keyword, "a string or an array of strings")) };
        if seen.contains(&name.as_str()) {
            return Err(invalid(format!("$jsonSchema keyword '{keyword}' has a duplicate value: {name}")));
        }
        seen.push(name);
        if json && name == "integer" {
            return Err(invalid("$jsonSchema type 'integer' is not currently supported"));
        }
        if json {
            let known = JSON_TYPES.iter().find(|(known, _)| known == name).map(|(_, alias)| *alias);
            types.add_name(known.ok_or_else(|| QueryError::bad_value(format!("unknown type name alias: {name}")))?)?;
        } else {
            types.add_name(name)?;
        }
    }
    Ok(types)
}

fn options(value: &Bson) -> Result<Vec<Bson>> {
    let Bson::Array(items) = value else { return Err(wrong("enum", "an array")) };
    if items.is_empty() {
        return Err(invalid("$jsonSchema keyword 'enum' cannot be an empty array"));
    }
    let items: Vec<Bson> = items.iter().cloned().map(settled).collect();
    if has_equal(items.iter().collect(), compare_values) {
        return Err(invalid("$jsonSchema keyword 'enum' cannot contain duplicate values"));
    }
    Ok(items)
}

fn schemas(keyword: &str, value: &Bson, depth: usize) -> Result<Vec<Schema>> {
    let Bson::Array(items) = value else { return Err(wrong(keyword, "an array")) };
    if items.is_empty() {
        return Err(QueryError::bad_value(format!("$jsonSchema keyword '{keyword}' must be a non-empty array")));
    }
    items.iter().map(|item| inner(keyword, item, depth)).collect()
}

fn inner(keyword: &str, value: &Bson, depth: usize) -> Result<Schema> {
    match value {
        Bson::Document(schema) => read(schema, depth + 1),
        _ => Err(wrong(keyword, "an object")),
    }
}

fn number(keyword: &str, value: &Bson) -> Result<Number> {
    Number::of(value).ok_or_else(|| wrong(keyword, "a number"))
}

fn size(keyword: &str, value: &Bson) -> Result<usize> {
    Number::of(value)
        .and_then(Number::integral)
        .and_then(|size| usize::try_from(size).ok())
        .ok_or_else(|| invalid(format!("$jsonSchema keyword '{keyword}' must be an integer that is not negative")))
}

fn names(keyword: &str, value: &Bson) -> Result<Vec<String>> {
    let Bson::Array(items) = value else { return Err(wrong(keyword, "an array")) };
    if items.is_empty() {
        return Err(invalid(format!("$jsonSchema keyword '{keyword}' cannot be an empty array")));
    }
    let mut names: Vec<String> = Vec::with_capacity(items.len());
    for item in items {
        let Bson::String(name) = item else { return Err(wrong(keyword, "an array of strings")) };
        names.push(name.clone());
    }
    if has_equal(names.iter().collect(), |one: &String, other: &String| one.cmp(other)) {
        return Err(invalid(format!("$jsonSchema keyword '{keyword}' cannot contain duplicate values")));
    }
    Ok(names)
}

fn dependencies(value: &Bson, depth: usize) -> Result<Vec<Rule>> {
    let Bson::Document(fields) = value else { return Err(wrong("dependencies", "an object")) };
    let rules = fields.iter().map(|(name, needed)| match needed {
        Bson::Array(_) => Ok(Rule::FieldsNeeded(name.clone(), names("dependencies", needed)?)),
        Bson::Document(_) => Ok(Rule::SchemaNeeded(name.clone(), inner("dependencies", needed, depth)?)),
        _ => Err(wrong("dependencies", "of arrays and objects")),
    });
    rules.collect()
}

fn others(keyword: &str, value: Option<&Bson>, depth: usize) -> Result<Others> {
    match value {
        None | Some(Bson::Boolean(true)) => Ok(Others::Allowed),
        Some(Bson::Boolean(false)) => Ok(Others::Forbidden),
        Some(value @ Bson::Document(_)) => Ok(Others::Checked(Box::new(inner(keyword, value, depth)?))),
        Some(_) => Err(wrong(keyword, "an object or a boolean")),
    }
}

fn fields<'a>(schema: &'a Document, keyword: &str) -> Result<Option<&'a Document>> {
    match schema.get(keyword) {
        None => Ok(None),
        Some(Bson::Document(fields)) => Ok(Some(fields)),
        Some(_) => Err(wrong(keyword, "an object")),
    }
}

fn properties(schema: &Document, depth: usize) -> Result<Option<Properties>> {
    let mut properties = Properties {
        others: others("additionalProperties", schema.get("additionalProperties"), depth)?,
        ..Properties::default()
    };
    for (name, value) in fields(schema, "properties")?.into_iter().flatten() {
        properties.named.push((name.clone(), inner("properties", value, depth)?));
    }
    for (pattern, value) in fields(schema, "patternProperties")?.into_iter().flatten() {
        properties.patterns.push((Pattern::new(pattern, "")?, inner("patternProperties", value, depth)?));
    }
    let silent =
        properties.named.is_empty() && properties.patterns.is_empty() && matches!(properties.others, Others::Allowed);
    Ok((!silent).then_some(properties))
}

fn items(schema: &Document, depth: usize) -> Result<Option<Items>> {
    let additional = others("additionalItems", schema.get("additionalItems"), depth)?;
    match schema.get("items") {
        None => Ok(None),
        Some(value @ Bson::Document(_)) => Ok(Some(Items::All(Box::new(inner("items", value, depth)?)))),
        Some(Bson::Array(items)) => {
            let schemas = items.iter().map(|item| inner("items", item, depth)).collect::<Result<_>>()?;
            Ok(Some(Items::Each(schemas, additional)))
        }
        Some(_) => Err(wrong("items", "an object or an array of objects")),
    }
}
