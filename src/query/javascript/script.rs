//! A function as a machine gets it.

use std::sync::atomic::{AtomicU64, Ordering};

use bson::Document;

/// The text of a function.
#[derive(Debug)]
#[cfg_attr(not(feature = "javascript"), expect(dead_code, reason = "without a machine nothing is run"))]
pub(super) enum Code {
    /// An expression whose value is the function.
    Function(String),
    /// The function, its body, or an expression, as `$where` takes it.
    Predicate(String),
}

/// A function as text, with its global variables.
#[derive(Debug)]
#[cfg_attr(not(feature = "javascript"), expect(dead_code, reason = "without a machine nothing is run"))]
pub(super) struct Script {
    /// The number under which a machine knows it.
    pub(super) id: u64,
    pub(super) code: Code,
    /// Global variables.
    pub(super) scope: Document,
    /// The fields of documents that the function uses; all where that is unknown.
    pub(super) fields: Option<Vec<String>>,
}

static NEXT: AtomicU64 = AtomicU64::new(0);

impl Script {
    /// Returns a function that no machine knows yet and that may use all fields.
    pub(super) fn new(code: Code, scope: Document) -> Self {
        Self { id: NEXT.fetch_add(1, Ordering::Relaxed), code, scope, fields: None }
    }
}
