//! MongoDB's semantics on BSON: filters, updates, projections, sorts, pipelines.
//!
//! Nothing here touches a store; the embedded store calls it, and so do
//! computables and triggers. What is not supported is refused by name, never
//! ignored.

mod error;
mod filter;
mod projection;
mod sort;
mod update;

pub use error::QueryError;
pub use filter::Filter;
pub use projection::Projection;
pub use sort::Sort;
pub use update::Update;
