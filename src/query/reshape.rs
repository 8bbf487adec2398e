//! Stages that turn each document into one document.

use bson::{Bson, DateTime, Document};

use super::error::{QueryError, Result};
use super::expression::{Environment, Expression, Scope, Variables};
use super::projection::Shape;
use super::view::View;

/// `$project`, `$addFields`, `$unset`, `$replaceRoot` and their other names.
#[derive(Debug)]
pub(super) enum Reshape {
    Shape(Shape),
    Root(Expression),
}

impl Reshape {
    /// Reads a stage, where its name is one of these.
    pub(super) fn parse(name: &str, argument: &Bson, scope: &Scope) -> Result<Option<Self>> {
        let stage = match name {
            "$project" => Self::Shape(Shape::project(object(name, argument)?, scope)?),
            "$addFields" | "$set" => Self::Shape(Shape::add_fields(object(name, argument)?, scope)?),
            "$unset" => Self::Shape(match argument {
                Bson::String(_) => Shape::unset(std::slice::from_ref(argument))?,
                Bson::Array(paths) if !paths.is_empty() => Shape::unset(paths)?,
                _ => return Err(QueryError::invalid(31_002, "$unset needs a string or an array of strings")),
            }),
            "$replaceRoot" => {
                let argument = object(name, argument)?;
                match argument.get("newRoot") {
                    Some(root) if argument.len() == 1 => Self::Root(Expression::parse_in(root, scope)?),
                    _ => return Err(QueryError::invalid(40_414, "$replaceRoot needs newRoot, and nothing else")),
                }
            }
            "$replaceWith" => Self::Root(Expression::parse_in(argument, scope)?),
            _ => return Ok(None),
        };
        Ok(Some(stage))
    }

    /// Reads a stage of a pipeline update.
    pub(super) fn parse_update(stage: &Document, scope: &Scope) -> Result<Self> {
        let (Some((name, argument)), 1) = (stage.iter().next(), stage.len()) else {
            return Err(QueryError::invalid(40_323, "a pipeline stage must have exactly one field"));
        };
        match Self::parse(name, argument, scope)? {
            Some(stage) => Ok(stage),
            None => Err(QueryError::invalid(72, format!("{name} is not allowed to be used within an update"))),
        }
    }

    /// Returns the new document.
    pub(super) fn apply(&self, document: Document, variables: &Variables, now: DateTime) -> Result<Document> {
        match self {
            Self::Shape(shape) => shape.apply(&document, variables, now),
            Self::Root(expression) => {
                match expression.evaluate(&Environment::new((&document).into(), variables, now))? {
                    Some(Bson::Document(root)) => Ok(root),
                    other => {
                        let found = other.map_or("missing", |other| View::from(&other).type_name());
                        Err(QueryError::invalid(40_228, format!("the new root must be an object, not {found}")))
                    }
                }
            }
        }
    }
}

/// Returns the document a stage takes.
pub(super) fn object<'a>(stage: &str, argument: &'a Bson) -> Result<&'a Document> {
    match argument {
        Bson::Document(document) => Ok(document),
        other => {
            let found = View::from(other).type_name();
            Err(QueryError::invalid(15_969, format!("{stage} specification must be an object, not {found}")))
        }
    }
}
