//! Programs that rmem runs: under limits, with nothing left behind.
//!
//! Planners, computables and the commands of triggers are such programs. A [`Job`] says what is run, with
//! which files and which input; [`run()`] starts it through a [`warden`], waits for
//! its end or brings that about at a limit, and gives what it left.

mod host;
mod launch;
mod pool;
mod run;
mod usage;
pub mod warden;

pub use host::{Host, Limits};
pub(crate) use pool::{Pool, Share};
pub(crate) use run::{End, Ended, Job, Manner, run};
