//! What computables did for an operation.

use std::time::Duration;

use bson::{Document, doc};

use crate::saturate::to_i64;
use crate::store::Namespace;

/// What one computable did for an operation.
#[derive(Debug, Clone, PartialEq)]
pub struct Computed {
    /// Its name.
    pub name: String,
    /// The namespace of its documents.
    pub namespace: Namespace,
    /// The cache held the answer to an equal query.
    pub cached: bool,
    /// How many documents it gave.
    pub documents: u64,
    /// How long that took.
    pub took: Duration,
}

impl Computed {
    /// The report as a document: `{name, namespace, cached, documents, milliseconds}`.
    #[must_use]
    pub fn to_document(&self) -> Document {
        doc! {
            "name": &self.name,
            "namespace": self.namespace.to_string(),
            "cached": self.cached,
            "documents": to_i64(self.documents),
            "milliseconds": (self.took.as_secs_f64() * 1e6).round() / 1e3,
        }
    }
}
