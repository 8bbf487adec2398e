//! Names that begin with `$`: operators, and the three names of a DBRef.

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
