//! The dates of the metadata in updates.

use bson::{Bson, DateTime, Document, doc};

use crate::query::QueryError;
use crate::store::metadata::{INFO, INSERTED};

/// Adds a date to the fields of an operator.
pub(super) fn add_field(update: &mut Document, operator: &str, key: &str, at: DateTime) -> Result<(), QueryError> {
    match update.entry(operator.to_owned()).or_insert_with(|| Bson::Document(Document::new())) {
        Bson::Document(fields) => {
            fields.insert(path(key), at);
            Ok(())
        }
        _ => Err(QueryError::failed_to_parse(format!("{operator} takes a document of fields")).about(operator)),
    }
}

/// The expression that keeps when a document was inserted.
pub(super) fn inserted(at: DateTime) -> Document {
    doc! { "$ifNull": [format!("${}", path(INSERTED)), at] }
}

/// The path of a date.
pub(super) fn path(key: &str) -> String {
    format!("{INFO}.{key}")
}
