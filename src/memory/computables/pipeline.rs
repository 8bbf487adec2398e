//! A body that is an aggregation over the memory.

use bson::{Bson, Document};

use super::binding::bind;
use super::body::{Asked, Body, ComputeError};
use super::questions::questions;
use crate::formats::shell;
use crate::query::{Pipeline as Stages, QueryError};
use crate::store::Namespace;

/// The results of a pipeline. The query that it asks of its collection is its
/// first `$match`; what computables give for that is part of its input. It may
/// use the asked query as `$$query`.
pub(super) struct Pipeline {
    pub(super) from: Namespace,
    pub(super) stages: Vec<Document>,
}

impl Body for Pipeline {
    fn compute(&self, asked: &Asked<'_>) -> Result<Vec<Document>, ComputeError> {
        let stages = bind(&self.stages, asked.query)?;
        let results = match asked.documents.filter(|_| self.from == *asked.namespace) {
            // Only of the documents that get keys.
            Some(documents) => asked.memory.aggregate_over(&self.from, documents, &stages)?,
            None => asked.memory.aggregate(&self.from, &stages)?,
        };
        results.map(|result| Ok(Document::try_from(&*result?).map_err(|error| failed(&error))?)).collect()
    }

    fn sources(&self, _: &Namespace) -> Vec<Namespace> {
        questions(&self.from, &self.stages).into_iter().map(|(namespace, _)| namespace).collect()
    }

    fn describe(&self) -> String {
        let stages = Bson::Array(self.stages.iter().cloned().map(Bson::Document).collect());
        format!("pipeline over {}: {}", self.from, shell::relaxed_value(&stages))
    }
}

/// Looks for mistakes in a pipeline that can be seen before a query is asked.
///
/// # Errors
/// Where it is none, or writes to a collection. What a server may know and the
/// embedded store does not is left to them, and so is a pipeline that takes
/// filters from the query.
pub fn check(stages: &[Document]) -> Result<(), QueryError> {
    let names = stages.iter().flat_map(Document::keys);
    if let Some(name) = names.into_iter().find(|name| matches!(name.as_str(), "$out" | "$merge")) {
        let message = format!("a computable gives documents and stores none itself; leave {name} out");
        return Err(QueryError::bad_value(message).about(name));
    }
    let Ok(stages) = bind(stages, &Document::new()) else { return Ok(()) };
    match Stages::parse(&stages) {
        Err(error) if !error.unsupported => Err(error),
        _ => Ok(()),
    }
}

fn failed(error: &bson::error::Error) -> crate::store::StoreError {
    QueryError::bad_value(error.to_string()).into()
}
