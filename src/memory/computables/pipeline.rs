//! A body that is an aggregation over the memory.

use bson::{Bson, Document};

use super::body::{Asked, Body, ComputeError};
use crate::formats::shell;
use crate::query::QueryError;
use crate::store::Namespace;

/// The results of a pipeline. The query that it asks of its collection is its
/// first `$match`; what computables give for that is part of its input.
pub(super) struct Pipeline {
    pub(super) from: Namespace,
    pub(super) stages: Vec<Document>,
}

impl Body for Pipeline {
    fn compute(&self, asked: &Asked<'_>) -> Result<Vec<Document>, ComputeError> {
        let results = asked.memory.aggregate(&self.from, &self.stages)?;
        results.map(|result| Ok(Document::try_from(&*result?).map_err(|error| failed(&error))?)).collect()
    }

    fn describe(&self) -> String {
        let stages = Bson::Array(self.stages.iter().cloned().map(Bson::Document).collect());
        format!("pipeline over {}: {}", self.from, shell::relaxed_value(&stages))
    }
}

fn failed(error: &bson::error::Error) -> crate::store::StoreError {
    QueryError::bad_value(error.to_string()).into()
}
