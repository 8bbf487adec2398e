//! The kinds of work that are measured.

use bson::{Document, doc};

use super::objects::Objects;

/// What is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Operation {
    /// One document is stored, durably.
    Insert,
    /// An object is found by its name.
    Find,
    /// The objects that are not where they belong: two fields are compared by an expression.
    FindMisplaced,
    /// The same, by a function in JavaScript.
    FindMisplacedByFunction,
    /// An object that is found by its name is changed, durably.
    Update,
    /// A computable gives the object that is nearest to a place.
    Nearest,
}

/// A kind of work: an operation, without or with an index on the objects' names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Work {
    /// What is done.
    pub operation: Operation,
    /// Whether names are indexed.
    pub is_indexed: bool,
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
    /// Stages that give one object, which a memory has as a computable.
    Nearest,
}

impl Operation {
    /// All of them, in the order of the measurement.
    pub const ALL: [Self; 6] =
        [Self::Insert, Self::Find, Self::FindMisplaced, Self::FindMisplacedByFunction, Self::Update, Self::Nearest];

    /// Its name in figures.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Insert => "insert",
            Self::Find => "find",
            Self::FindMisplaced => "find misplaced",
            Self::FindMisplacedByFunction => "find misplaced ($where)",
            Self::Update => "update",
            Self::Nearest => "nearest (computable)",
        }
    }

    /// Whether rmem was built with what it needs.
    fn is_there(self) -> bool {
        self != Self::FindMisplacedByFunction || cfg!(feature = "javascript")
    }
}

impl Work {
    /// All kinds, in the order of the measurement: first what is done without an index.
    pub fn all() -> impl Iterator<Item = Self> {
        let operations = || Operation::ALL.into_iter().filter(|operation| operation.is_there());
        let all = move |is_indexed| operations().map(move |operation| Self { operation, is_indexed });
        all(false).chain(all(true))
    }

    /// Its name in figures.
    #[must_use]
    pub fn name(self) -> String {
        let name = self.operation.name();
        if self.is_indexed { format!("indexed {name}") } else { name.to_owned() }
    }

    pub(super) fn task(self, objects: &mut Objects) -> Task {
        match self.operation {
            Operation::Insert => Task::Insert(objects.next()),
            Operation::Find => Task::Find(doc! { "name": objects.any() }),
            Operation::FindMisplaced => Task::Find(doc! { "$expr": { "$ne": ["$position", "$tidied"] } }),
            Operation::FindMisplacedByFunction => {
                Task::Find(doc! { "$where": "function() { return this.position != this.tidied; }" })
            }
            Operation::Update => {
                Task::Update(doc! { "name": objects.any() }, doc! { "$set": { "position": objects.place() } })
            }
            Operation::Nearest => Task::Nearest,
        }
    }
}
