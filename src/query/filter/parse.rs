//! Parses filters: operators at the top, and operators under a path.

use bson::{Bson, Document};

use super::operators::field_operator;
use super::schema::Schema;
use super::test::{Leaf, Test};
use super::tree::{Node, TextSearch};
use crate::query::dollar::{is_operators, is_reference_key};
use crate::query::error::{NameContext, QueryError, QueryMistake, Result};
use crate::query::expression::{Expression, Scope};
use crate::query::geo::{Near, OPERATORS};
use crate::query::javascript::Program;
use crate::query::path::Path;
use crate::query::regex::Pattern;
use crate::query::text::Search;
use crate::query::view::View;

/// How deep filters may be nested.
const MAX_DEPTH: usize = 100;

/// MongoDB's code for a distance condition in a stage, or in a validator.
const NOT_IN_STAGE: i32 = 5_626_500;

/// MongoDB's code for a search that is not at the front of a pipeline.
const NOT_IN_FRONT: i32 = 17_313;

/// Reads filters, with the variables that their expressions may use.
#[derive(Debug, Default, Clone)]
pub(in crate::query) struct Parser<'a> {
    scope: Option<&'a Scope>,
    depth: usize,
    distance: Distance,
    /// Whether `$where` may be here: at the top of a query and in its alternatives.
    takes_code: bool,
    /// Whether `$text` may be here: as `$where`, and in the first stage of a pipeline.
    takes_search: bool,
}

/// Whether a filter may contain a distance condition, which also orders the matches.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
enum Distance {
    /// At the top of a query.
    Asked,
    /// Not within something else.
    #[default]
    Within,
    /// Not in a pipeline, which has `$geoNear`.
    Stage,
    /// Not in a validator, which no index answers.
    Validator,
}

impl<'a> Parser<'a> {
    /// Returns a parser whose expressions see the variables of `scope`.
    pub(in crate::query) fn with_scope(scope: &'a Scope) -> Self {
        Self { scope: Some(scope), ..Self::default() }
    }

    /// Returns the parser of a query, which may ask for what is near.
    pub(super) fn of_query(self) -> Self {
        Self { distance: Distance::Asked, takes_code: true, takes_search: true, ..self }
    }

    /// Returns the parser of a stage.
    pub(in crate::query) fn of_stage(self, is_first: bool) -> Self {
        Self { distance: Distance::Stage, takes_code: false, takes_search: is_first, ..self }
    }

    /// Returns the parser of a validator.
    pub(super) fn of_validator(self) -> Self {
        Self { distance: Distance::Validator, takes_code: false, takes_search: false, ..self }
    }

    /// Refuses a distance condition that is within something else.
    pub(super) fn misplaced(&self, name: &str) -> QueryError {
        match self.distance {
            Distance::Validator => not_in_validator(name),
            _ => QueryError::bad_value(format!("{name} must be the first operator of a field, at the top of a filter")),
        }
    }

    fn within(&self) -> Self {
        let distance = if self.distance == Distance::Asked { Distance::Within } else { self.distance };
        Self { distance, ..self.clone() }
    }

    fn deeper(&self) -> Result<Self> {
        if self.depth >= MAX_DEPTH {
            return Err(QueryError::bad_value("the filter is nested too deeply"));
        }
        Ok(Self { depth: self.depth + 1, ..self.clone() })
    }

    /// Reads a filter.
    pub(in crate::query) fn filter(&self, filter: &Document) -> Result<Node> {
        let parser = self.deeper()?;
        let mut children = Vec::with_capacity(filter.len());
        for (name, value) in filter {
            if name.starts_with('$') && !is_reference_key(name) {
                children.extend(parser.top(name, value).map_err(|error| error.about(name))?);
            } else if let Some(near) = parser.near(name, value)? {
                children.push(near);
            } else {
                let test = parser.field(value)?;
                children.push(Node::Field(Path::parse(name)?, test));
            }
        }
        Ok(match children.len() {
            1 => children.remove(0),
            _ => Node::And(children),
        })
    }

    /// Reads a distance condition, if the operators are one.
    fn near(&self, path: &str, value: &Bson) -> Result<Option<Node>> {
        let Bson::Document(operators) = value else { return Ok(None) };
        match operators.keys().next() {
            Some(name) if OPERATORS.contains(&name.as_str()) => match self.distance {
                Distance::Asked => {
                    let near = Near::parse(path, operators).map_err(|error| error.about(name))?;
                    Ok(Some(Node::Near(Box::new(near))))
                }
                Distance::Within => {
                    Err(QueryError::bad_value(format!("{name} must be at the top of a filter")).about(name))
                }
                Distance::Validator => Err(not_in_validator(name)),
                Distance::Stage => {
                    let message = format!("{name} is not allowed in a stage; begin the pipeline with $geoNear");
                    Err(QueryError::invalid(NOT_IN_STAGE, message).about(name))
                }
            },
            _ => Ok(None),
        }
    }

    fn top(&self, name: &str, value: &Bson) -> Result<Option<Node>> {
        Ok(Some(match name {
            "$and" => Node::And(self.filters(name, value)?),
            "$or" => Node::Or(self.within().filters(name, value)?),
            "$nor" => Node::Nor(Self { takes_search: false, ..self.within() }.filters(name, value)?),
            "$comment" => return Ok(None),
            "$expr" => Node::Expression(match self.scope {
                Some(scope) => Expression::parse_in(value, scope)?,
                None => Expression::parse(value)?,
            }),
            "$jsonSchema" => match value {
                Bson::Document(schema) => Node::Schema(Box::new(Schema::parse(schema)?)),
                _ => return Err(QueryError::type_mismatch("$jsonSchema must be an object")),
            },
            "$alwaysTrue" | "$alwaysFalse" => {
                if crate::query::number::Number::of(value).and_then(|number| number.integral()) != Some(1) {
                    return Err(QueryError::failed_to_parse(format!("{name} must be an integer value of 1")));
                }
                Node::Always(name == "$alwaysTrue")
            }
            "$sampleRate" => match crate::query::number::Number::of(value).map(|number| number.to_double()) {
                Some(rate) if (0.0..=1.0).contains(&rate) => Node::Sample(rate),
                _ => return Err(QueryError::bad_value("$sampleRate must be between 0 and 1")),
            },
            "$where" if self.takes_code => Node::Where(Box::new(Program::predicate(value)?)),
            "$where" => return Err(QueryError::bad_value("$where is not allowed in this context")),
            "$text" if self.takes_search => Node::Text(Box::new(TextSearch::new(Search::parse(value)?))),
            "$text" if self.distance == Distance::Stage => {
                let message = "$match with $text is only allowed as the first stage of a pipeline";
                return Err(QueryError::invalid(NOT_IN_FRONT, message));
            }
            "$text" if self.distance == Distance::Validator => {
                return Err(QueryError::bad_value("$text is not allowed in this context"));
            }
            "$text" => return Err(QueryError::bad_value("$text is only allowed at the top of a query")),
            _ => return Err(unknown(NameContext::Filter, name, "unknown top level operator")),
        }))
    }

    fn filters(&self, name: &str, value: &Bson) -> Result<Vec<Node>> {
        let Bson::Array(items) = value else {
            return Err(QueryError::bad_value(format!("{name} must be an array")).of_kind(QueryMistake::NoArray));
        };
        if items.is_empty() {
            return Err(QueryError::bad_value(format!("{name} must be a nonempty array")));
        }
        items
            .iter()
            .map(|item| match item {
                Bson::Document(filter) => self.filter(filter),
                _ => Err(QueryError::bad_value(format!("entries of {name} need to be full objects"))),
            })
            .collect()
    }

    /// What a path must be: a value, a pattern, or operators.
    pub(in crate::query) fn field(&self, value: &Bson) -> Result<Test> {
        match value {
            Bson::Document(operators) if is_operators(operators.into()) => self.operators(operators),
            Bson::RegularExpression(regex) => {
                Ok(Test::Leaf(Leaf::Regex(Pattern::new(regex.pattern.as_str(), regex.options.as_str())?)))
            }
            Bson::Undefined => Err(QueryError::bad_value("cannot compare to undefined")),
            value => Ok(Test::Leaf(Leaf::Equal(value.clone()))),
        }
    }

    /// All operators of a document, which must hold together.
    pub(in crate::query) fn operators(&self, operators: &Document) -> Result<Test> {
        let parser = self.deeper()?;
        let mut tests = Vec::with_capacity(operators.len());
        for (name, value) in operators {
            tests.extend(field_operator(&parser, name, value, operators).map_err(|error| error.about(name))?);
        }
        Ok(match tests.len() {
            1 => tests.remove(0),
            _ => Test::And(tests),
        })
    }

    /// What `$elemMatch` takes: a filter of documents, or operators on values.
    pub(super) fn element_match(&self, value: &Bson) -> Result<Test> {
        let Bson::Document(inner) = value else {
            return Err(QueryError::bad_value("$elemMatch needs an Object"));
        };
        let on_values = is_operators(inner.into())
            && !inner.keys().next().is_some_and(|name| {
                matches!(name.as_str(), "$and" | "$or" | "$nor" | "$where" | "$expr" | "$comment" | "$jsonSchema")
            });
        Ok(Test::Leaf(if on_values {
            Leaf::ElementPasses(Box::new(self.operators(inner)?))
        } else {
            if let Some(refused) = inner.keys().find(|name| matches!(name.as_str(), "$text" | "$where" | "$expr")) {
                return Err(QueryError::bad_value(format!("{refused} cannot be in $elemMatch")).about(refused));
            }
            Leaf::ElementMatches(Box::new(
                Self { takes_code: false, takes_search: false, ..self.within() }.filter(inner)?,
            ))
        }))
    }
}

/// The error for a distance condition in a validator.
fn not_in_validator(name: &str) -> QueryError {
    let message = "$geoNear, $near, and $nearSphere are not allowed in this context";
    QueryError::invalid(NOT_IN_STAGE, message).about(name)
}

/// The error for a name that is known nowhere, or not where it stands.
pub(super) fn unknown(context: NameContext, name: &str, what: &str) -> QueryError {
    QueryError::bad_value(format!("{what}: {name}")).about(name).of_kind(QueryMistake::UnknownName(context))
}

/// Returns the elements of an operator's array.
pub(super) fn array<'a>(name: &str, value: &'a Bson) -> Result<&'a [Bson]> {
    match value {
        Bson::Array(items) => Ok(items),
        other => Err(QueryError::bad_value(format!("{name} needs an array, not {}", View::from(other).type_name()))),
    }
}
