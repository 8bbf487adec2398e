//! The memory: what an application talks to.
//!
//! Operations with metadata, routed to the local or the shared store by the
//! database's name. Nothing falls through to the other store, and a store is
//! opened by the first operation that needs it, so that a robot without a
//! network works with what is its own.

mod atomic;
mod clock;
pub mod computables;
pub mod difference;
pub mod dump;
pub mod dumped;
pub mod expiry;
mod index;
mod journal;
pub mod lock;
mod operations;
mod rehearsal;
pub mod restore;
mod route;
mod staging;
pub mod watch;
pub mod world;

pub use clock::Clock;
pub use journal::{Observer, Operation};
pub use operations::Memory;
