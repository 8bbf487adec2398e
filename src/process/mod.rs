//! Programs that rmem runs: under limits, with nothing left behind.
//!
//! Planners, computables and the commands of triggers are such programs. A [`Job`] names the program and
//! its files; [`run()`] starts it through a [`supervisor`], waits for its end, stops it at a
//! limit, and returns its output. If the input takes a while to compute, the program can be
//! started before it ([`Prepared`]).

mod end;
mod handle;
pub(crate) mod holder;
mod host;
mod job;
mod launch;
mod message;
mod out_of_memory;
mod pool;
mod reading;
mod run;
pub mod search;
pub(crate) mod stale_files;
pub mod supervisor;
mod usage;

pub(crate) use end::End;
pub use host::{Host, Limits, Listener};
pub(crate) use job::{INPUT, Job, Mode};
pub(crate) use pool::{Pool, Share};
pub(crate) use run::{Ended, Prepared, run};
