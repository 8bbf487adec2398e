//! The memory: what an application talks to.
//!
//! Operations with metadata, routed to the local or the shared store by the
//! database's name. No operation falls back to the other store, and a store is
//! opened by the first operation that needs it, so that a robot without a
//! network works with its local databases.

mod atomic;
mod check;
mod clock;
pub mod computables;
mod diagnosis;
pub mod dump;
pub mod expiry;
pub mod frames;
mod hidden_metadata;
pub mod history;
mod index;
mod journal;
pub mod lock;
pub mod modify;
mod operations;
mod past;
mod route;
mod sharing;
pub mod undo;
pub mod watch;

pub use clock::Clock;
pub use diagnosis::{Condition, Diagnosis, Remark};
pub use journal::{Observer, Operation};
pub use operations::Memory;
pub use sharing::Listed;
