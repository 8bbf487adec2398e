//! The MongoDB store: a server or replica set, through the official driver.
//!
//! The only module that uses the driver. Operations go to the server as they
//! are, so the server decides what they mean. Writes are
//! acknowledged by a majority, with journal.

pub mod admin;

mod action;
mod attempts;
mod check;
mod client;
mod dates;
mod differing;
mod entry;
mod events;
mod explain;
mod failure;
mod find_and_modify;
mod history;
mod identity;
mod image;
mod index;
mod keeping;
mod known;
mod named;
mod past;
mod position;
mod prediction;
mod raw;
mod server_message;
mod single_step;
mod statements;
mod unchanged;
mod update;
mod validation;
mod verbs;
mod visible;
mod waiting;
mod watch;
mod write_command;
mod write_policy;

pub use raw::Raw;

use std::cell::Cell;
use std::sync::{Mutex, OnceLock};

use mongodb::sync::Client;

use crate::query::Collation;

/// A MongoDB server or replica set. Nothing is contacted before the first operation.
pub struct MongoDb {
    client: Client,
    /// The collections that have the index on dates of decay.
    decaying: known::Known<()>,
    /// How strings compare in collections.
    collations: known::Known<Option<Collation>>,
    /// Which collections have which names.
    identities: known::Known<known::Identity>,
    /// The histories that this process keeps.
    keeping: Mutex<keeping::Keeping>,
    /// The version of the server's wire protocol, once it was asked for.
    version: OnceLock<i32>,
    /// Whether documents are stored that do not pass the validator of their collection.
    is_bypassing: Cell<bool>,
    /// Which members have to confirm writes.
    write_policy: write_policy::WritePolicy,
    /// The URI without credentials and options.
    address: String,
}
