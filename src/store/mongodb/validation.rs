//! Validators of collections, which the server keeps and looks at.

use bson::{Document, doc};
use mongodb::options;

use super::MongoDb;
use crate::store::{Namespace, StoreError, Validation, ValidationAction, ValidationLevel};

/// A level as the driver has it.
pub(super) fn level(level: ValidationLevel) -> options::ValidationLevel {
    match level {
        ValidationLevel::Off => options::ValidationLevel::Off,
        ValidationLevel::Strict => options::ValidationLevel::Strict,
        ValidationLevel::Moderate => options::ValidationLevel::Moderate,
    }
}

/// An action as the driver has it.
pub(super) fn action(action: ValidationAction) -> options::ValidationAction {
    match action {
        ValidationAction::Error => options::ValidationAction::Error,
        ValidationAction::Warn => options::ValidationAction::Warn,
    }
}

impl MongoDb {
    /// What a collection says of the documents that it takes.
    pub(super) fn validation_of(&self, ns: &Namespace) -> Result<Option<Validation>, StoreError> {
        let Some(options) = self.options_of(ns, &["collection"])? else { return Ok(None) };
        Ok(Some(Validation::read(&options)?).filter(|validation| !validation.is_empty()))
    }

    /// The options of what has a name, a `collection` or a `view`; none where there is no such one.
    pub(super) fn options_of(&self, ns: &Namespace, kinds: &[&str]) -> Result<Option<Document>, StoreError> {
        let command = doc! { "listCollections": 1, "filter": { "name": &ns.collection, "type": { "$in": kinds } } };
        let database = self.client().database(&ns.database);
        let mut listed = database.run_cursor_command(command).run().map_err(|e| self.explain(&e))?;
        let found = listed.next().transpose().map_err(|e| self.explain(&e))?;
        Ok(found.map(|found| found.get_document("options").cloned().unwrap_or_default()))
    }

    /// Sets what a collection says of the documents that it takes.
    pub(super) fn change_validation(&self, ns: &Namespace, validation: &Validation) -> Result<(), StoreError> {
        let mut command = doc! { "collMod": &ns.collection, "validator": Document::new() };
        // What is not said is as MongoDB has it.
        let said = Validation {
            validator: validation.validator.clone(),
            level: validation.level.or(Some(ValidationLevel::Strict)),
            action: validation.action.or(Some(ValidationAction::Error)),
        };
        command.extend(said.options());
        let database = self.client().database(&ns.database);
        database.run_command(command).run().map(drop).map_err(|e| self.explain(&e))
    }
}
