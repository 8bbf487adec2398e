//! Stages that turn each document into one document.

use bson::{Bson, DateTime, Document, RawDocument, RawDocumentBuf};

use super::error::{FAILED_TO_PARSE, QueryError, Result};
use super::expression::{Environment, Expression, Scope, Variables};
use super::interruption;
use super::limit::{check_between, encode_between};
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
                if let Some(name) = argument.keys().find(|name| *name != "newRoot") {
                    return Err(QueryError::invalid(40_415, format!("$replaceRoot takes newRoot, and no '{name}'")));
                }
                let root = argument.get("newRoot");
                let root = root.ok_or_else(|| QueryError::invalid(40_414, "$replaceRoot needs newRoot"))?;
                Self::Root(Expression::parse_in(root, scope)?)
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
        match Self::parse(name, argument, scope).map_err(|error| error.about(name))? {
            Some(stage) => Ok(stage),
            None => {
                Err(QueryError::invalid(72, format!("{name} is not allowed to be used within an update")).about(name))
            }
        }
    }

    /// Returns the new document, for another stage.
    ///
    /// # Errors
    /// If it cannot be made or is too large, or the operation is to end.
    pub(super) fn apply(&self, document: &RawDocument, variables: &Variables, now: DateTime) -> Result<RawDocumentBuf> {
        // Each stage may double a document.
        interruption::check()?;
        match self {
            Self::Shape(shape) => {
                let shaped = shape.apply(document, variables, now)?;
                check_between(&shaped).map(|()| shaped)
            }
            Self::Root(expression) => match expression.evaluate(&Environment::new(document.into(), variables, now))? {
                Some(Bson::Document(root)) => encode_between(&root),
                other => {
                    let found = other.map_or("missing", |other| View::from(&other).type_name());
                    Err(QueryError::invalid(40_228, format!("the new root must be an object, not {found}")))
                }
            },
        }
    }
}

/// Returns the document a stage takes.
pub(super) fn object<'a>(stage: &str, argument: &'a Bson) -> Result<&'a Document> {
    match argument {
        Bson::Document(document) => Ok(document),
        other => {
            let code = match stage {
                "$addFields" | "$set" => 40_272,
                "$replaceRoot" => 40_229,
                "$match" => 15_959,
                "$sort" => 15_973,
                "$group" => 15_947,
                "$bucket" => 40_201,
                "$bucketAuto" => 40_240,
                "$facet" => 40_169,
                "$sample" => 28_745,
                "$setWindowFields" | "$densify" | "$fill" | "$lookup" | "$graphLookup" => FAILED_TO_PARSE,
                _ => 15_969,
            };
            let found = View::from(other).type_name();
            Err(QueryError::invalid(code, format!("{stage} specification must be an object, not {found}")))
        }
    }
}
