//! The mongod processes of a robot: started, made members of their replica sets, looked at, stopped.
//!
//! A robot has up to two, one for what is private to it and one that replicates
//! what the robots share ([`crate::settings::backend::Backend`]). Each is a member of a
//! replica set, the private one of a set of its own, because only those tell of changes.
//!
//! A process runs on its own once it is started; nothing remembers it but the
//! system. So whether a process is ours is asked of the process itself each
//! time, by where its data and its log are. A robot founds a set only where
//! a majority of all its members answers and none belongs to it yet, and always
//! through the first of them: two robots that found one at once found the same.

mod error;
mod process;
mod set;
mod status;

pub use error::BackendError;
pub use process::{Down, Running, down, up};
pub use set::{Settled, settle};
pub use status::{Row, status};
