//! The keys of documents that stand for parts of facts.

/// The key of a document that is the name of its template.
pub const RELATION: &str = "relation";

/// The key of a document that holds the values of an ordered fact.
pub const VALUES: &str = "values";
