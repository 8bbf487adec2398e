//! A validator as a store uses it.

use bson::{Bson, DateTime, Document, RawDocument};

use crate::query::collation::during;
use crate::query::{Collation, QueryError, Validator};
use crate::store::{InvalidDocument, Namespace, Validation, ValidationAction, ValidationLevel, metadata};

/// Which documents a collection takes, ready for use.
#[derive(Debug)]
pub(super) struct Validating {
    pub(super) options: Validation,
    /// None where nothing is looked at.
    validator: Option<Validator>,
    collation: Option<Collation>,
}

impl Validating {
    /// Makes the options of a collection ready for use.
    ///
    /// # Errors
    /// Where the validator is none.
    pub(super) fn new(options: Validation, collation: Option<&Collation>) -> Result<Self, QueryError> {
        let validator = options.validator.as_ref().filter(|_| options.level != Some(ValidationLevel::Off));
        let validator = during(collation, || validator.map(Validator::parse).transpose())?;
        Ok(Self { options, validator, collation: collation.cloned() })
    }

    /// A document that does not pass, and why; none where it does. `before` is what it takes the place of.
    pub(super) fn failure(
        &self,
        ns: &Namespace,
        body: &RawDocument,
        before: Option<&RawDocument>,
    ) -> Result<Option<InvalidDocument>, QueryError> {
        let Some(validator) = &self.validator else { return Ok(None) };
        let now = DateTime::now();
        let passes = |body: &RawDocument| -> Result<bool, QueryError> {
            let seen = metadata::hide(body.to_owned())?;
            during(self.collation.as_ref(), || validator.passes(&seen, now))
        };
        if passes(body)? {
            return Ok(None);
        }
        if let (Some(ValidationLevel::Moderate), Some(before)) = (self.options.level, before)
            && !passes(before)?
        {
            return Ok(None);
        }
        let seen = Document::try_from(&*metadata::hide(body.to_owned())?)?;
        let (details, is_truncated) = during(self.collation.as_ref(), || validator.details(&seen));
        let id = Some(seen.get("_id").cloned().unwrap_or(Bson::Null));
        Ok(Some(InvalidDocument { namespace: ns.clone(), id, details, is_truncated }))
    }

    /// Whether a document that does not pass is stored.
    pub(super) fn only_warns(&self) -> bool {
        self.options.action == Some(ValidationAction::Warn)
    }
}
