//! Computables: documents that are computed when a query asks for them.
//!
//! A computable has a *spec*, a query that is matched against the asked query
//! as a document ([`spec`]). The [`registry`] knows which of them a query needs,
//! and in which order: those of the settings, and those that the memory itself keeps ([`kept`], as documents:
//! [`record`]). Each has a [`body`], one file per kind: [`pipeline`], [`command`], [`transform`], [`nearest`]. What a
//! body gives is stored beside the other documents, with an entry in the
//! [`cache`] that all processes share ([`renewal`]); then the query is answered over all of
//! them ([`answer`]).
//!
//! Rules:
//!
//! - A query sees stored documents, and those that were computed for it (or for an
//!   equal query), and no others: the same memory gives the same answer, whatever others asked
//!   before. [`Memory::show_computed`](crate::memory::Memory::show_computed) shows all that the cache holds.
//! - A body may query the memory, and its queries may need other computables. It sees
//!   the documents of those that ran before it for the same query, and does not see the documents
//!   of its own computable, unless its query needs that.
//! - Updates and deletions change stored documents only.
//! - A computable that adds keys ([`adding`]) gives no documents: its keys are in the answer, and stored nowhere.
//! - Without a cache time, documents are gone when the query is answered; mostly, they are not stored at all ([`once`]).
//! - The cache holds as long as the documents are as they were computed: where
//!   some were removed or changed, the next query computes them anew, and what
//!   is left of them goes.

mod adding;
mod alone;
mod answer;
mod binding;
mod body;
mod bounds;
mod builtin;
mod cache;
mod check;
mod command;
mod definition;
mod example;
mod extended;
mod kept;
mod kept_check;
mod key;
mod nearest;
mod once;
mod pipeline;
mod questions;
mod record;
mod registry;
mod renewal;
mod report;
mod sources;
mod spec;
mod state;
mod storing;
mod together;
mod transform;
mod view;

pub use body::{Builtin, Options};
pub use builtin::BUILTINS;
pub use check::{Check, Verdict};
pub use definition::{BodyKind, Definition, NO_PROGRAMS, Origin, check_adds};
pub use pipeline::check as check_pipeline;
pub(super) use record::COLLECTION as KEPT;
pub use record::read;
pub use registry::{Computable, Registry};
pub use report::Computed;
pub use sources::Sources;

pub(super) use cache::forget;
pub(super) use questions::{questions, target, visible_stages};
pub(super) use state::Computables;
pub use state::Warnings;
pub(super) use view::{Answering, View};
