//! MongoDB's semantics on BSON: filters, updates, projections, sorts, pipelines.
//!
//! Nothing here touches a store; the embedded store calls it, and so do
//! computables and triggers. What is not supported is refused by name, never
//! ignored.

/// Why a query, update, projection, sort or pipeline is refused or failed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct QueryError {
    /// MongoDB's error code for the same mistake (2 BadValue, 9 FailedToParse, 14 TypeMismatch, …).
    pub code: i32,
    /// The operator complained about, like `$where`, where there is one.
    pub operator: Option<String>,
    /// Whether it is valid MongoDB that rmem does not support.
    pub unsupported: bool,
    /// A lower-case fragment that names operator and field.
    pub message: String,
}

impl QueryError {
    /// A mistake in the query.
    #[must_use]
    pub fn invalid(code: i32, message: impl Into<String>) -> Self {
        Self { code, operator: None, unsupported: false, message: message.into() }
    }

    /// Valid MongoDB that rmem refuses.
    #[must_use]
    pub fn unsupported(operator: &str) -> Self {
        Self {
            code: 115,
            operator: Some(operator.to_owned()),
            unsupported: true,
            message: format!("{operator} is not supported by the embedded store"),
        }
    }
}
