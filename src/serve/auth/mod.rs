//! Who may connect: users with passwords, by SCRAM-SHA-256.

mod scram;
mod users;
mod verifier;

pub(super) use scram::{Conversation, MECHANISM};
pub use users::{Users, UsersError};
