//! `$redact`: documents with the parts that a condition lets through.

use bson::{Bson, Document};

use super::documents::{Documents, encode};
use super::run::Run;
use crate::query::error::{QueryError, Result};
use crate::query::expression::{Expression, Scope};

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
                let redacted = self.redacted(&document, &document, &run, 0)?;
                Ok(redacted.map(|redacted| encode(&redacted)).transpose()?)
            });
            redacted.transpose()
        }))
    }

    fn redacted<E>(
        &self,
        root: &Document,
        current: &Document,
        run: &Run<'_, E>,
        depth: usize,
    ) -> Result<Option<Document>> {
        if depth > 200 {
            return Err(QueryError::invalid(15, "the document is nested too deeply"));
        }
        let mut variables = (*run.variables).clone();
        variables.set(self.current, Some(Bson::Document(current.clone())));
        let run = run.with(variables);
        let decision = self.condition.evaluate(&run.environment(root.into()))?;
        match decision.as_ref().and_then(Bson::as_str) {
            Some("keep") => Ok(Some(current.clone())),
            Some("prune") => Ok(None),
            Some("descend") => {
                let mut kept = Document::new();
                for (name, value) in current {
                    if let Some(value) = self.inside(root, value, &run, depth + 1)? {
                        kept.insert(name.clone(), value);
                    }
                }
                Ok(Some(kept))
            }
            _ => Err(QueryError::invalid(17_053, "$redact's expression should return $$KEEP, $$PRUNE, or $$DESCEND")
                .about("$redact")),
        }
    }

    fn inside<E>(&self, root: &Document, value: &Bson, run: &Run<'_, E>, depth: usize) -> Result<Option<Bson>> {
        match value {
            Bson::Document(inner) => Ok(self.redacted(root, inner, run, depth)?.map(Bson::Document)),
            Bson::Array(items) => {
                let mut kept = Vec::new();
                for item in items {
                    kept.extend(self.inside(root, item, run, depth + 1)?);
                }
                Ok(Some(Bson::Array(kept)))
            }
            other => Ok(Some(other.clone())),
        }
    }
}
