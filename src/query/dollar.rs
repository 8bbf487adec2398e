//! Names that begin with `$`: operators, and the three names of a DBRef.

use bson::{Bson, Document};

use super::error::{QueryError, Result};
use super::view::{Fields, View};

/// Returns whether a document holds operators: its first name begins with `$` and is not one of a DBRef.
pub(super) fn is_operators(fields: Fields<'_>) -> bool {
    fields.iter().next().is_some_and(|(name, _)| name.starts_with('$') && !is_reference_key(name))
}

/// Returns whether a name is one of those of a DBRef.
pub(super) fn is_reference_key(name: &str) -> bool {
    matches!(name, "$ref" | "$id" | "$db")
}

/// Returns whether a value is a document of operators.
pub(super) fn is_operator_object(value: View<'_>) -> bool {
    matches!(value, View::Document(fields) if is_operators(fields))
}

/// Refuses names within an `_id` that begin with `$`, but for those of a reference (`$ref`, `$id` and perhaps `$db`, in front).
///
/// # Errors
/// Where there is one (code 52).
pub fn check_id_names(id: &Bson) -> Result<()> {
    match id {
        Bson::Document(fields) => check_names(fields),
        Bson::JavaScriptCodeWithScope(code) => check_names(&code.scope),
        Bson::Array(items) => items.iter().try_for_each(check_id_names),
        _ => Ok(()),
    }
}

fn check_names(fields: &Document) -> Result<()> {
    let mut before = None;
    let mut fields = fields.iter().peekable();
    while let Some((name, value)) = fields.next() {
        let next = fields.peek().map(|(name, _)| name.as_str());
        let is_allowed = match (before, name.as_str(), value) {
            (None, "$ref", Bson::String(_)) => next == Some("$id"),
            (Some("$ref"), "$id", _) | (Some("$id"), "$db", Bson::String(_)) => true,
            _ => !name.starts_with('$'),
        };
        if !is_allowed {
            let message = format!("the '_id' may not contain fields that start with '$', like {name}");
            return Err(QueryError::invalid(52, message).about(name));
        }
        if name != "$id" {
            check_id_names(value)?;
        }
        before = Some(name.as_str());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::doc;

    #[test]
    fn an_id_may_be_a_reference() {
        let code = |id: Document| check_id_names(&Bson::Document(id)).err().map(|mistake| mistake.code);
        for id in [
            doc! { "$ref": "a", "$id": 1 },
            doc! { "$ref": "a", "$id": 1, "$db": "b", "x": 1 },
            doc! { "of": { "$ref": "a", "$id": { "$x": 1 } } },
        ] {
            assert_eq!(code(id.clone()), None, "{id}");
        }
        for id in [
            doc! { "$id": 1 },
            doc! { "$ref": "a" },
            doc! { "$id": 1, "$ref": "a" },
            doc! { "x": 1, "$ref": "a", "$id": 1 },
            doc! { "$ref": 1, "$id": 1 },
            doc! { "$ref": "a", "$id": 1, "$db": 1 },
            doc! { "a": [{ "$x": 1 }] },
            doc! { "a": bson::JavaScriptCodeWithScope { code: String::new(), scope: doc! { "$x": 1 } } },
        ] {
            assert_eq!(code(id.clone()), Some(52), "{id}");
        }
    }
}
