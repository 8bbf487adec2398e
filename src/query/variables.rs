//! `let` of commands: variables that the expressions of an operation can use.

use bson::{Bson, DateTime, Document};

use super::error::{QueryError, Result};
use super::expression::{Environment, Expression, Scope, Variables};

/// MongoDB's code for a variable that depends on a document.
const NEEDS_DOCUMENT: i32 = 4_890_500;

/// Returns the values of the variables of a command's `let`: each is an expression without a document, which may use
/// those before it.
///
/// # Errors
/// If a name cannot be one, or an expression is wrong or asks for a field.
pub fn constants(variables: &Document) -> Result<Document> {
    let (now, mut values) = (DateTime::now(), Document::new());
    for (name, expression) in variables {
        if asks_for_field(expression) {
            let message =
                format!("the variable {name} of `let` depends on a document; it is computed before any is read");
            return Err(QueryError::invalid(NEEDS_DOCUMENT, message).about("let"));
        }
        let (scope, known) = Scope::with_constants(&values)?;
        values.insert(name.clone(), evaluated(expression, &scope, &known, now)?);
        Scope::with_constants(&values)?;
    }
    Ok(values)
}

fn evaluated(expression: &Bson, scope: &Scope, known: &Variables, now: DateTime) -> Result<Bson> {
    let empty = Document::new();
    let value = Expression::parse_in(expression, scope)?.evaluate(&Environment::new((&empty).into(), known, now))?;
    Ok(value.unwrap_or(Bson::Undefined))
}

/// Returns whether an expression has a path of a document.
fn asks_for_field(expression: &Bson) -> bool {
    match expression {
        Bson::String(text) => match text.strip_prefix("$$") {
            Some(variable) => matches!(variable.split('.').next(), Some("ROOT" | "CURRENT")),
            None => text.starts_with('$'),
        },
        Bson::Array(items) => items.iter().any(asks_for_field),
        Bson::Document(fields) => fields.iter().any(|(name, value)| name != "$literal" && asks_for_field(value)),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::doc;

    #[test]
    fn variables_are_expressions_without_a_document() {
        let given = doc! { "a": { "$add": [1, 2] }, "b": ["$$a", { "$literal": "$x" }], "c": { "x": "plain" } };
        assert_eq!(constants(&given).unwrap(), doc! { "a": 3, "b": [3, "$x"], "c": { "x": "plain" } });
        assert!(constants(&doc! { "now": "$$NOW" }).unwrap().get_datetime("now").is_ok());
        for (wrong, code) in [
            (doc! { "a": "$field" }, NEEDS_DOCUMENT),
            (doc! { "a": { "$add": ["$$ROOT", 1] } }, NEEDS_DOCUMENT),
            (doc! { "a": "$$nothing" }, 17_276),
            (doc! { "A": 1 }, 9),
            (doc! { "": 1 }, 9),
        ] {
            assert_eq!(constants(&wrong).unwrap_err().code, code, "{wrong}");
        }
    }
}
