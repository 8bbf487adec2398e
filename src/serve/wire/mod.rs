//! MongoDB's wire protocol: messages and their bytes.
//!
//! Format: MongoDB Manual, "MongoDB Wire Protocol". A message is a header (length, id, id of the
//! message it answers, operation code; little-endian) and a body. Commands come as OP_MSG, the
//! first of a connection perhaps as OP_QUERY, each perhaps within OP_COMPRESSED.

mod bytes;
mod checksum;
mod compression;
mod message;
mod reply;

pub use message::{Form, Message};
pub use reply::Reply;

pub(super) use compression::ZLIB;
pub(super) use message::receive;

/// The largest message, in bytes, which drivers get.
pub const MAX_MESSAGE: usize = 48_000_000;
/// The bytes of a header.
const HEADER: usize = 16;

const OP_REPLY: i32 = 1;
const OP_QUERY: i32 = 2004;
const OP_COMPRESSED: i32 = 2012;
const OP_MSG: i32 = 2013;

/// Why a message cannot be understood; the connection cannot go on after it.
#[derive(Debug, thiserror::Error)]
pub enum WireError {
    /// The bytes are no message.
    #[error("malformed message: {0}")]
    Malformed(String),
    /// The connection broke, or stopped within a message.
    #[error(transparent)]
    Broken(#[from] std::io::Error),
}

impl WireError {
    fn malformed(what: impl Into<String>) -> Self {
        Self::Malformed(what.into())
    }
}
