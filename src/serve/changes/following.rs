//! An open change stream, wherever its changes are kept.

use std::time::Instant;

use super::behind::Behind;
use super::stream::Stream;

/// An open change stream.
pub(in crate::serve) enum Following {
    /// Of a file, whose changes are kept for it.
    File(Stream),
    /// Of the MongoDB server behind this one.
    Server(Behind),
}

impl Following {
    /// When it was read last.
    pub(in crate::serve) fn used(&self) -> Instant {
        match self {
            Self::File(stream) => stream.used,
            Self::Server(stream) => stream.used,
        }
    }
}
