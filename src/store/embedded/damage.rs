//! Damage of stored documents.

/// What is wrong with a stored document.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Damage {
    /// Its length is not the one it begins with.
    Length,
    /// Its checksum does not fit its content.
    Checksum,
    /// It is not well-formed BSON.
    Structure,
    /// The key of its row is not that of its `_id`.
    Key,
}

impl Damage {
    /// Describes the damage, as a clause.
    pub(super) fn describe(self) -> &'static str {
        match self {
            Self::Length => "its length is wrong",
            Self::Checksum => "its checksum is wrong",
            Self::Structure => "it is not well-formed BSON",
            Self::Key => "it is stored under another _id",
        }
    }
}
