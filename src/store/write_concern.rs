//! What a client asks of the acknowledgment of its writes (`writeConcern`).

use bson::Document;

/// The write concern of a client.
#[derive(Debug, Clone, PartialEq)]
pub struct WriteConcern {
    /// Which members it waits for.
    pub acknowledgment: Acknowledgment,
    /// All of it, as the client gives it: with `j` and `wtimeout`.
    pub document: Document,
}

/// Which members have to have a write before it is acknowledged: what `w` and `j` of a write concern say together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Acknowledgment {
    /// None (`w: 0`, without `j: true`).
    Unacknowledged,
    /// The primary, a majority, or whichever have to by default.
    Usual,
    /// More of them than one (`w: 2`).
    Several,
    /// Those with tags (`w: {place: 2}`).
    Tagged,
    /// Those of a mode (`w: "far"`) that is defined for the replica set.
    Mode(String),
}
