//! The kinds of work that are measured.

use bson::{Document, doc};

use super::objects::Objects;

/// A kind of work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Work {
    /// One document is stored, durably.
    Insert,
    /// An object is found by its name, among all.
    FindByScan,
    /// The objects that are not where they belong: two fields are compared.
    FindMisplaced,
    /// An object found among all is changed.
    UpdateByScan,
    /// An object is found by its name, which is indexed.
    FindByIndex,
    /// An object found by its indexed name is changed, durably.
    UpdateByIndex,
}

/// One repetition of a kind of work.
#[derive(Debug, Clone)]
pub enum Task {
    /// A document to be stored.
    Insert(Document),
    /// A filter whose matches are to be read.
    Find(Document),
    /// A filter, and what is to be done to its first match.
    Update(Document, Document),
}

impl Work {
    /// All kinds, in the order of the measurement: first what is done without an index.
    pub const ALL: [Self; 6] = [
        Self::Insert,
        Self::FindByScan,
        Self::FindMisplaced,
        Self::UpdateByScan,
        Self::FindByIndex,
        Self::UpdateByIndex,
    ];

    /// Its name in figures.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Insert => "insert",
            Self::FindByScan => "find",
            Self::FindMisplaced => "find misplaced",
            Self::UpdateByScan => "update",
            Self::FindByIndex => "indexed find",
            Self::UpdateByIndex => "indexed update",
        }
    }

    /// Whether the index is made before this kind.
    pub(super) fn begins_indexed(self) -> bool {
        self == Self::FindByIndex
    }

    pub(super) fn task(self, objects: &mut Objects) -> Task {
        match self {
            Self::Insert => Task::Insert(objects.next()),
            Self::FindByScan | Self::FindByIndex => Task::Find(doc! { "name": objects.any() }),
            Self::FindMisplaced => Task::Find(doc! { "$expr": { "$ne": ["$position", "$tidied"] } }),
            Self::UpdateByScan | Self::UpdateByIndex => {
                Task::Update(doc! { "name": objects.any() }, doc! { "$set": { "position": objects.place() } })
            }
        }
    }
}
