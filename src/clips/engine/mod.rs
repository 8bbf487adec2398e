//! A real CLIPS with the memory's functions inside it: `rmem clips run`.
//!
//! [`run`] gives programs a thread of their own ([`thread`]), because their functions may
//! call themselves more deeply than any other stack has room for, and because one that cannot be
//! stopped must not block the caller. There a [`session`] loads them, asserts facts, and fires
//! rules until nothing more can happen. [`native`] is CLIPS.

mod exchange;
mod functions;
mod generated;
mod job;
mod load;
mod message;
mod model;
mod native;
mod planning;
mod program;
pub mod robot_configuration;
mod search_path;
mod session;
mod state;
mod stop;
mod subscription;
mod subscriptions;
mod table;
mod thread;
mod trace;
mod wm_facts;
mod wm_sync;
mod world;

#[cfg(test)]
pub(crate) use functions::names;
pub use job::{Ended, Job};
pub use message::{Message, Sender};
pub use thread::run;
