//! `--validator`, `--validation-level` and `--validation-action`: which documents a collection takes.

use bson::{Document, doc};
use clap::Args;

use super::query::{argument, blame};
use crate::error::{Error, Result};
use crate::store::StoreError;
use crate::store::validation::{ACTION, LEVEL, VALIDATOR};

/// What the text of `--validator` is called.
const SOURCE: &str = "<validator>";

/// Which documents a collection takes.
#[derive(Debug, Clone, Args)]
pub struct ValidationArgs {
    /// Query that documents have to match, e.g. '{weight: {$gt: 0}}' or '{$jsonSchema: {required: ["name"]}}'
    #[arg(long, value_name = "QUERY")]
    validator: Option<String>,
    /// Writes that are checked: strict (all), moderate (not updates of documents that did not match before), off (none)
    #[arg(long, value_name = "LEVEL", value_parser = ["strict", "moderate", "off"], hide_possible_values = true)]
    validation_level: Option<String>,
    /// What becomes of a document that does not match: error (it is refused), warn (it is stored, with a warning)
    #[arg(long, value_name = "ACTION", value_parser = ["error", "warn"], hide_possible_values = true)]
    validation_action: Option<String>,
}

impl ValidationArgs {
    pub(super) fn is_given(&self) -> bool {
        [&self.validator, &self.validation_level, &self.validation_action].into_iter().any(Option::is_some)
    }

    /// What is asked for, as options of a collection.
    pub(super) fn options(&self) -> Result<Document> {
        let mut options = Document::new();
        if let Some(text) = &self.validator {
            options.insert(VALIDATOR, argument(SOURCE, text)?);
        }
        for (name, value) in [(LEVEL, &self.validation_level), (ACTION, &self.validation_action)] {
            options.extend(value.iter().flat_map(|value| doc! { name: value }));
        }
        Ok(options)
    }

    /// A complaint about a validator, shown at its place.
    pub(super) fn blame(&self, error: StoreError) -> Error {
        let texts: Vec<(&'static str, &str)> = self.validator.iter().map(|text| (SOURCE, text.as_str())).collect();
        blame(error, &texts)
    }
}
