//! `$redact`: documents with the parts that a condition lets through.

use bson::{Bson, Document};

use super::documents::{Documents, encode};
use super::run::Run;
use crate::query::error::{QueryError, Result};
use crate::query::expression::{Environment, Expression, Scope};
use crate::query::interruption;

/// A compiled `$redact`.
#[derive(Debug)]
pub(super) struct Redact {
    condition: Expression,
    /// The variable that is the document looked at.
    current: usize,
}

impl Redact {
    pub(super) fn parse(argument: &Bson, scope: &Scope) -> Result<Self> {
        let mut scope = scope.clone();
        scope.redacting = true;
        let current = scope.add("CURRENT");
        Ok(Self { condition: Expression::parse_in(argument, &scope)?, current })
    }

    pub(super) fn run<'a, E: From<QueryError> + 'a>(
        &'a self,
        input: Documents<'a, E>,
        run: Run<'a, E>,
    ) -> Documents<'a, E> {
        Box::new(input.filter_map(move |document| {
            let redacted = document.and_then(|document| {
                let document = Document::try_from(document).map_err(QueryError::from)?;
                let redacted = self.redacted(&document, &run.environment((&document).into()), 0)?;
                Ok(redacted.map(|redacted| encode(&redacted)).transpose()?)
            });
            redacted.transpose()
        }))
    }

    /// The part of a document that is let through, in the environment of the document that it lies in.
    fn redacted(&self, current: &Document, outer: &Environment<'_>, depth: usize) -> Result<Option<Document>> {
        if depth > 200 {
            return Err(QueryError::invalid(15, "the document is nested too deeply"));
        }
        interruption::check()?;
        let value = Some(Bson::Document(current.clone()));
        let frame = outer.frame(self.current, &value);
        let decision = self.condition.evaluate(&outer.within(&frame))?;
        match decision.as_ref().and_then(Bson::as_str) {
            Some("keep") => Ok(Some(current.clone())),
            Some("prune") => Ok(None),
            Some("descend") => {
                let mut kept = Document::new();
                for (name, value) in current {
                    if let Some(value) = self.inside(value, outer, depth + 1)? {
                        kept.insert(name.clone(), value);
                    }
                }
                Ok(Some(kept))
            }
            _ => Err(QueryError::invalid(17_053, "$redact's expression should return $$KEEP, $$PRUNE, or $$DESCEND")
                .about("$redact")),
        }
    }

    fn inside(&self, value: &Bson, outer: &Environment<'_>, depth: usize) -> Result<Option<Bson>> {
        match value {
            Bson::Document(inner) => Ok(self.redacted(inner, outer, depth)?.map(Bson::Document)),
            Bson::Array(items) => {
                let mut kept = Vec::new();
                for item in items {
                    kept.extend(self.inside(item, outer, depth + 1)?);
                }
                Ok(Some(Bson::Array(kept)))
            }
            other => Ok(Some(other.clone())),
        }
    }
}
