//! `$jsonSchema`: draft 4 of JSON Schema as MongoDB has it, with `bsonType`.
//!
//! A keyword about one type accepts values of all other types.

mod accept;
mod parse;

use bson::Bson;

use super::types::TypeSet;
use crate::query::number::Number;
use crate::query::regex::Pattern;

/// A compiled schema: all rules must accept.
#[derive(Debug, Default)]
pub(in crate::query) struct Schema {
    rules: Vec<Rule>,
}

/// A keyword with its argument.
#[derive(Debug)]
enum Rule {
    Type(TypeSet),
    Enum(Vec<Bson>),
    AllOf(Vec<Schema>),
    AnyOf(Vec<Schema>),
    OneOf(Vec<Schema>),
    Not(Schema),
    Minimum(Number, bool),
    Maximum(Number, bool),
    MultipleOf(Number),
    MinLength(usize),
    MaxLength(usize),
    Pattern(Pattern),
    Required(Vec<String>),
    Properties(Properties),
    MinProperties(usize),
    MaxProperties(usize),
    /// Fields that others need.
    FieldsNeeded(String, Vec<String>),
    /// A schema that the document must pass where it has a field.
    SchemaNeeded(String, Schema),
    Items(Items),
    MinItems(usize),
    MaxItems(usize),
    UniqueItems,
}

/// Schemas of fields by name, by pattern, and of all others.
#[derive(Debug, Default)]
struct Properties {
    named: Vec<(String, Schema)>,
    patterns: Vec<(Pattern, Schema)>,
    others: Others,
}

/// The rule for fields or elements that no other rule names.
#[derive(Debug, Default)]
enum Others {
    #[default]
    Allowed,
    Forbidden,
    Checked(Box<Schema>),
}

/// Schemas of elements.
#[derive(Debug)]
enum Items {
    All(Box<Schema>),
    Each(Vec<Schema>, Others),
}
