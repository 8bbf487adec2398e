//! Indexes: the keys of a document, and the ranges of keys that answer a query.
//!
//! A key is the values of the indexed paths as bytes in BSON order, descending
//! ones inverted. As in mongod: a missing field is null; of an array each
//! element is a key and an empty one is undefined; two paths may not run
//! through two arrays.

mod bounds;
mod pattern;
mod plan;
mod wildcard;

pub use pattern::{Entries, Pattern};
pub use plan::{Access, Candidate, Range, alternatives, order, ways};
