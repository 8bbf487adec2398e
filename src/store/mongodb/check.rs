//! Checking a collection, by the server's own command.

use bson::{Bson, Document, doc};

use super::{MongoDb, failure};
use crate::query::QueryError;
use crate::store::{Namespace, StoreError, Validated, ValidatedIndex};

impl MongoDb {
    pub(super) fn validated(
        &self,
        ns: &Namespace,
        report: &mut dyn FnMut(&str),
    ) -> Result<Option<Validated>, StoreError> {
        let command = doc! { "validate": &ns.collection };
        let found = match self.client().database(&ns.database).run_command(command).run() {
            Ok(found) => found,
            Err(error) if failure::code(&error) == Some(QueryError::NAMESPACE_NOT_FOUND) => return Ok(None),
            Err(error) => return Err(self.explain(&error)),
        };
        let errors = found.get_array("errors").map(Vec::as_slice).unwrap_or_default();
        errors.iter().filter_map(Bson::as_str).for_each(report);
        let none = Document::new();
        let part = |name: &str| found.get_document(name).unwrap_or(&none);
        let (keys, details) = (part("keysPerIndex"), part("indexDetails"));
        let is_sound = |name: &str| details.get_document(name).and_then(|one| one.get_bool("valid"));
        let index = |(name, keys): (&String, &Bson)| ValidatedIndex {
            name: name.clone(),
            keys: count(Some(keys)),
            is_sound: is_sound(name).unwrap_or(true),
        };
        Ok(Some(Validated {
            documents: count(found.get("nrecords")),
            damaged: count(found.get("nInvalidDocuments")),
            indexes: keys.iter().map(index).collect(),
        }))
    }
}

/// A count in any of the types that the server gives it in.
fn count(value: Option<&Bson>) -> u64 {
    match value {
        Some(Bson::Int32(count)) => u64::try_from(*count).unwrap_or(0),
        Some(Bson::Int64(count)) => u64::try_from(*count).unwrap_or(0),
        _ => 0,
    }
}
