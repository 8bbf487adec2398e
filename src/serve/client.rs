//! The client of a connection.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use sha2::{Digest as _, Sha256};

use super::access::Metadata;
use super::activity::Activity;
use super::auth::Conversation;
use super::session::SessionId;

/// A client, as far as it has introduced itself.
pub(super) struct Client {
    pub(super) id: i64,
    /// Its address.
    pub(super) peer: String,
    /// This server, as the client reaches it.
    pub(super) host: String,
    pub(super) metadata: Metadata,
    /// What it calls itself, or else its driver.
    pub(super) author: Arc<str>,
    /// Whether it has to log in before anything else.
    pub(super) needs_login: bool,
    /// The user as whom it has logged in.
    pub(super) user: Option<User>,
    /// A login that has begun.
    pub(super) login: Option<Conversation>,
    /// The sessions whose transactions it has begun, and the number of the last one of each.
    pub(super) transactions: HashMap<SessionId, i64>,
    /// Whether it is being answered.
    pub(super) is_busy: Arc<AtomicBool>,
    /// What is being done for it.
    pub(super) activity: Arc<Activity>,
}

impl Client {
    /// What sessions are told apart by beside their own id, as with MongoDB: the SHA-256 of the user's name, or of nothing.
    pub(super) fn digest(&self) -> [u8; 32] {
        let user = self.user.as_ref().map(|user| format!("{}@{}", user.name, user.database));
        Sha256::digest(user.unwrap_or_default()).into()
    }
}

/// A user, and the database it logged in at.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct User {
    pub(super) name: String,
    pub(super) database: String,
}
