//! MongoDB's semantics on BSON: filters, updates, projections, sorts, pipelines.
//!
//! Nothing here touches a store; the embedded store calls it, and so do
//! computables and triggers. What is not supported is refused by name, never
//! ignored.

mod arithmetic;
#[cfg(test)]
mod bombs;
pub mod collation;
mod compare;
mod decimal;
mod decode;
mod distinct;
mod dollar;
mod element;
mod error;
mod expression;
mod filter;
mod geo;
pub mod index;
mod interruption;
mod javascript;
pub mod key;
mod keys;
mod limit;
mod names;
mod nesting;
mod number;
pub mod object_id;
mod path;
mod pipeline;
mod projection;
mod random;
mod ranking;
mod regex;
mod reshape;
mod row;
mod series;
mod sort;
mod spill;
#[cfg(test)]
mod spilled;
mod statistics;
pub mod text;
mod u256;
mod update;
mod validator;
mod variables;
mod view;
mod zone;

pub use collation::Collation;
pub use compare::{compare, compare_values};
pub use decode::{decode, decode_but};
pub use distinct::Distinct;
pub use dollar::check_id_names;
pub use element::{extent, field};
pub use error::{NameContext, QueryError, QueryMistake};
pub use filter::{Filter, TextSearch, check_positional, check_upsert, is_positional};
pub use geo::Near;
pub use interruption::look_at;
pub use javascript::{MapReduce, Merging};
pub use names::{is_condition, known_names, misplaced};
pub use nesting::check;
pub use pipeline::{
    Description, Documents, Merge, Origin, Output, Pipeline, Sources, WhenMatched, WhenNotMatched, is_empty_match,
};
pub use projection::Projection;
pub use random::random_up_to;
pub use row::Row;
pub use sort::Sort;
pub use spill::{Spill, Spool};
pub use update::{Update, prepare};
pub use validator::Validator;
pub use variables::constants;
pub use view::type_name;
