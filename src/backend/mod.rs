//! The mongod processes of a robot: started, added to their replica sets, inspected, stopped.
//!
//! A robot has up to two, one for what is private to it and one that replicates
//! what the robots share ([`crate::settings::backend::Backend`]). Each is a member of a
//! replica set, the private one of a set of its own, because only replica sets report changes.
//!
//! A process runs on its own once it is started, and rmem keeps no record of it. Whether a
//! process was started by rmem is asked of the process itself each time, by the paths of its
//! data and its log. A robot initiates a set only where a majority of all its members answers
//! and none belongs to a set yet, and always through the first of them: two robots at the same
//! time initiate the same set.

mod error;
mod process;
mod set;
mod status;

pub use error::BackendError;
pub use process::{Down, Running, down, up};
pub use set::{Settled, settle};
pub use status::{Row, Status, status};
