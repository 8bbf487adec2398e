//! Templates to problems: gather (queries answered) → render → check.
//!
//! [`generate`] takes a template in one of two spellings and a memory, and
//! gives a PDDL problem together with where each part of it came from.
//!
//! No value can inject syntax. Whatever comes out of a document, a
//! parameter or an expression becomes (part of) one PDDL name or number; see
//! [`names`]. Only the goal is PDDL text, and it must be balanced.

mod answer;
mod assembly;
mod batch;
mod empty_goal;
mod explain;
mod generate;
mod goal;
pub mod import;
mod marker;
mod minijinja;
pub mod names;
mod origin;
mod parts;
mod request;
mod stream;
mod taken;
mod unchecked;
mod usage;

pub use explain::{Explanation, Part, Writer};
pub use generate::{generate, stream};
pub use origin::{Generated, Origin};
pub use parts::read_parts;
pub use request::{ProblemError, Request, SectionReport, Syntax, TemplatePart};
pub use stream::Streamed;
pub use unchecked::unchecked;
pub use usage::{check_use, takes_goal};
