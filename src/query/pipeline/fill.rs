//! `$fill`: values in the place of null and missing ones, by other stages.

use bson::{Bson, Document, doc};

use super::stage::Stage;
use super::window::Window;
use crate::query::error::{QueryError, Result};
use crate::query::expression::{Expression, Scope};
use crate::query::reshape::Reshape;

/// Returns the stages that fill: a window for the methods, and fields for the values.
pub(super) fn stages(spec: &Document, scope: &Scope) -> Result<Vec<Stage>> {
    const KNOWN: [&str; 4] = ["partitionBy", "partitionByFields", "sortBy", "output"];
    if let Some(name) = spec.keys().find(|name| !KNOWN.contains(&name.as_str())) {
        return Err(QueryError::invalid(40_415, format!("'$fill.{name}' is an unknown field")));
    }
    let output = match spec.get("output") {
        Some(Bson::Document(output)) if !output.is_empty() => output,
        Some(Bson::Document(_)) => return Err(QueryError::invalid(6_050_203, "the 'output' of $fill is empty")),
        Some(_) => return Err(QueryError::type_mismatch("the 'output' of $fill must be an object")),
        None => return Err(QueryError::invalid(40_414, "$fill needs 'output'")),
    };
    let sort = match spec.get("sortBy") {
        None => None,
        Some(Bson::Document(pattern)) => Some(pattern),
        Some(_) => return Err(QueryError::type_mismatch("the 'sortBy' of $fill must be an object")),
    };
    let (mut methods, mut values) = (Vec::new(), Document::new());
    for (path, how) in output {
        let wrong = || QueryError::invalid(6_050_202, format!("'{path}' of $fill needs either 'value' or 'method'"));
        let Bson::Document(how) = how else { return Err(wrong()) };
        match (how.get("value"), how.get("method"), how.len()) {
            (Some(value), None, 1) => {
                values.insert(path.clone(), doc! { "$ifNull": [format!("${path}"), value.clone()] });
            }
            (None, Some(Bson::String(method)), 1) if method == "linear" || method == "locf" => {
                methods.push((path.clone(), method == "linear"));
            }
            _ => return Err(wrong()),
        }
    }
    let mut stages = Vec::new();
    if !methods.is_empty() {
        stages.push(Stage::Window(Window::filling(partition(spec, scope)?, sort, &methods)?));
    }
    if !values.is_empty() {
        stages.extend(Reshape::parse("$addFields", &Bson::Document(values), scope)?.map(Stage::Reshape));
    }
    Ok(stages)
}

fn partition(spec: &Document, scope: &Scope) -> Result<Option<Expression>> {
    let value = match (spec.get("partitionBy"), spec.get("partitionByFields")) {
        (Some(_), Some(_)) => {
            return Err(QueryError::invalid(6_050_204, "$fill takes 'partitionBy' or 'partitionByFields', not both"));
        }
        (Some(value @ (Bson::String(_) | Bson::Document(_))), None) => value.clone(),
        (Some(_), None) => return Err(QueryError::type_mismatch("'partitionBy' must be a string or an object")),
        (None, Some(Bson::Array(paths))) => {
            let mut fields = Vec::new();
            for path in paths {
                let Bson::String(path) = path else {
                    return Err(QueryError::type_mismatch("'partitionByFields' must be an array of strings"));
                };
                fields.push(Bson::from(doc! { "v": format!("${path}") }));
            }
            // An object, because a partition may not be an array.
            let names = (0..fields.len()).map(|index| index.to_string());
            Bson::Document(names.zip(fields).collect())
        }
        (None, Some(_)) => return Err(QueryError::type_mismatch("'partitionByFields' must be an array of strings")),
        (None, None) => return Ok(None),
    };
    Expression::parse_in(&value, scope).map(Some)
}
