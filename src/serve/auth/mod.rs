//! Users with passwords who may connect, by SCRAM-SHA-256.

mod scram;
mod users;
mod verifier;

pub(super) use scram::{Conversation, MECHANISM};
pub use users::{Users, UsersError};
