//! Programs that rmem runs: under limits, with nothing left behind.
//!
//! Planners, computables and the commands of triggers are such programs. A [`Job`] says what is run, with
//! which files; [`run()`] starts it through a [`supervisor`], waits for
//! its end or brings that about at a limit, and gives what it left. Where what the program reads takes a while to
//! make, the program gets ready meanwhile ([`Prepared`]).

mod host;
mod launch;
mod pool;
mod run;
pub mod supervisor;
mod usage;

pub use host::{Host, Limits};
pub(crate) use pool::{Pool, Share};
pub(crate) use run::{End, Ended, INPUT, Job, Mode, Prepared, run};
