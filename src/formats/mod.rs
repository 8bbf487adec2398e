//! Text and types: one module per external text format, each with its grammar in `grammars/`.
//!
//! A module turns text into plain types and back, and decides nothing. It uses no other module of rmem but the calendar
//! and [`crate::fault`]; pest's `Rule` and `Pair` never leave it. What all of
//! them share is [`Source`], a text with a name, and [`Diagnostic`], a
//! complaint about a place in such a text.

pub mod clips;
pub mod command_line;
pub mod credentials;
pub mod csv;
pub mod diagnostic;
pub mod marker;
#[cfg(feature = "views")]
pub mod mcap;
pub mod mongodump;
pub mod mongosh;
mod nearest;
pub mod pddl;
pub(crate) mod plain;
pub mod plan;
pub mod quantity;
pub mod scene;
pub mod shell;
mod source;
mod spelling;
mod texts;
pub mod visible;
pub mod yaml;

pub use diagnostic::{Diagnostic, Diagnostics};
pub use nearest::nearest;
pub use source::{Position, Source, Span};
pub use spelling::{Respelled, alike, is_alike};
pub use texts::Texts;
