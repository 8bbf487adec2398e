//! `--collation`, `--let` and `--hint`: how strings compare, variables of expressions, and which index is read.

use bson::Bson;
use clap::Args;

use crate::error::Result;
use crate::formats::{Diagnostic, Source, Span, shell};
use crate::query::{Collation, QueryError, constants};
use crate::store::{Hint, Modifiers};

/// What the text of `--hint` is called.
pub(super) const HINT: &str = "<hint>";

/// Modifiers of an operation.
#[derive(Debug, Clone, Args)]
pub struct ModifierArgs {
    #[command(flatten)]
    collation: CollationArgs,
    /// Variables for expressions, as $$NAME, e.g. '{limit: 3}'
    #[arg(long = "let", value_name = "VARIABLES")]
    variables: Option<String>,
    /// Index to read: its name, or its keys, e.g. '{name: 1}'
    #[arg(long, value_name = "INDEX")]
    hint: Option<String>,
}

/// How strings compare.
#[derive(Debug, Clone, Args)]
pub struct CollationArgs {
    /// How strings compare, e.g. '{locale: "en", strength: 2}' (ignore case) or '{locale: "en", numericOrdering: true}'
    #[arg(long, value_name = "COLLATION")]
    collation: Option<String>,
}

impl CollationArgs {
    pub(super) fn is_given(&self) -> bool {
        self.collation.is_some()
    }

    pub(super) fn read(&self) -> Result<Option<Collation>> {
        let Some(text) = &self.collation else { return Ok(None) };
        let spec = shell::parse_document(&Source::new("<collation>", text.as_str()))?;
        Ok(Some(Collation::parse(&spec).map_err(|error| shown("<collation>", text, &error))?))
    }
}

impl ModifierArgs {
    pub(super) fn read(&self) -> Result<Modifiers> {
        let variables = match &self.variables {
            None => bson::Document::new(),
            Some(text) => {
                let variables = shell::parse_document(&Source::new("<let>", text.as_str()))?;
                constants(&variables).map_err(|error| shown("<let>", text, &error))?;
                variables
            }
        };
        let hint = match &self.hint {
            None => None,
            Some(text) if text.trim_start().starts_with('{') => {
                Hint::parse(&shell::parse_value(&Source::new(HINT, text.as_str()))?)
                    .map_err(|error| shown(HINT, text, &error))?
            }
            Some(name) => Hint::parse(&Bson::from(name.as_str())).map_err(|error| shown(HINT, name, &error))?,
        };
        Ok(Modifiers { collation: self.collation.read()?, variables, hint })
    }

    /// The text of the hint, which is empty where there is none, under its name.
    pub(super) fn hint(&self) -> (&'static str, &str) {
        (HINT, self.hint.as_deref().unwrap_or_default())
    }
}

/// An error about the text of an option, at the operator or field that it is about.
fn shown(name: &'static str, text: &str, error: &QueryError) -> Diagnostic {
    let place = error.place_among(&[text]).map_or(0..text.len(), |(_, place)| place);
    Diagnostic::new(&Source::new(name, text), Span::new(place.start, place.end), error.message.clone())
}
