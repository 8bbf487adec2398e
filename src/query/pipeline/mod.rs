//! Aggregation pipelines.

mod reshape;
pub(super) use reshape::Reshape;
