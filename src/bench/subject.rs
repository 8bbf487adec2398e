//! The stores that are measured.

use std::time::{Duration, Instant};

use bson::{Document, doc};

use super::objects::{NEAREST, nearest};
use super::work::Task;
use crate::memory::Memory;
use crate::memory::computables::{BodyKind, Definition, Origin};
use crate::store::{Find, Index, Namespace, StoreError, UpdateRequest, UpdateSpec};

/// A memory or a database that does the work.
pub trait Subject {
    /// Its name in figures.
    fn name(&self) -> &'static str;

    /// Stores documents.
    ///
    /// # Errors
    /// Where it fails.
    fn insert(&self, documents: Vec<Document>) -> Result<(), StoreError>;

    /// Reads all matches; returns how many there were.
    ///
    /// # Errors
    /// Where it fails.
    fn find(&self, filter: Document) -> Result<u64, StoreError>;

    /// Changes the first match.
    ///
    /// # Errors
    /// Where it fails.
    fn update(&self, filter: Document, update: Document) -> Result<(), StoreError>;

    /// Finds the object that is nearest to a place; returns how many there are.
    ///
    /// # Errors
    /// Where it fails.
    fn nearest(&self) -> Result<u64, StoreError>;

    /// Makes the index on names.
    ///
    /// # Errors
    /// Where it fails.
    fn index(&self) -> Result<(), StoreError>;

    /// Removes the index on names.
    ///
    /// # Errors
    /// Where it fails.
    fn drop_index(&self) -> Result<(), StoreError>;

    /// How long a task takes.
    ///
    /// # Errors
    /// Where it fails.
    fn time(&self, task: &Task) -> Result<Duration, StoreError> {
        let task = task.clone();
        let start = Instant::now();
        match task {
            Task::Insert(document) => self.insert(vec![document])?,
            Task::Find(filter) => drop(self.find(filter)?),
            Task::Update(filter, update) => self.update(filter, update)?,
            Task::Nearest => drop(self.nearest()?),
        }
        Ok(start.elapsed())
    }
}

/// The computable of a memory that is measured: it finds the nearest object, and keeps nothing.
#[must_use]
pub fn computable(namespace: &Namespace) -> Definition {
    Definition {
        name: NEAREST.to_owned(),
        namespace: namespace.clone(),
        spec: doc! { "compute": NEAREST },
        priority: 0,
        cache: None,
        adds: None,
        body: BodyKind::Pipeline { from: namespace.clone(), stages: nearest() },
        origin: Origin::program(),
    }
}

/// A memory as a subject.
pub struct OfMemory<'a> {
    /// Its name in figures.
    pub name: &'static str,
    /// The memory.
    pub memory: &'a Memory,
    /// Where the documents are.
    pub namespace: Namespace,
}

impl OfMemory<'_> {
    fn index_on_names() -> Index {
        Index::on(doc! { "name": 1 })
    }
}

impl Subject for OfMemory<'_> {
    fn name(&self) -> &'static str {
        self.name
    }

    fn insert(&self, documents: Vec<Document>) -> Result<(), StoreError> {
        self.memory.insert(&self.namespace, documents).map(drop)
    }

    fn find(&self, filter: Document) -> Result<u64, StoreError> {
        let find = Find { filter, ..Find::default() };
        self.memory.find(&self.namespace, &find)?.try_fold(0, |count, document| document.map(|_| count + 1))
    }

    fn update(&self, filter: Document, update: Document) -> Result<(), StoreError> {
        let update = UpdateSpec::Document(update);
        let request = UpdateRequest { filter, update, ..UpdateRequest::default() };
        self.memory.update(&self.namespace, &request).map(drop)
    }

    fn nearest(&self) -> Result<u64, StoreError> {
        self.find(doc! { "compute": NEAREST })
    }

    fn index(&self) -> Result<(), StoreError> {
        self.memory.create_index(&self.namespace, &Self::index_on_names()).map(drop)
    }

    fn drop_index(&self) -> Result<(), StoreError> {
        self.memory.drop_index(&self.namespace, &Self::index_on_names().name).map(drop)
    }
}

#[cfg(feature = "mongodb")]
impl Subject for crate::store::mongodb::Raw {
    fn name(&self) -> &'static str {
        "mongod"
    }

    fn insert(&self, documents: Vec<Document>) -> Result<(), StoreError> {
        self.insert(documents)
    }

    fn find(&self, filter: Document) -> Result<u64, StoreError> {
        self.find(filter)
    }

    fn update(&self, filter: Document, update: Document) -> Result<(), StoreError> {
        self.update(filter, update)
    }

    fn nearest(&self) -> Result<u64, StoreError> {
        self.aggregate(nearest())
    }

    fn index(&self) -> Result<(), StoreError> {
        self.index()
    }

    fn drop_index(&self) -> Result<(), StoreError> {
        self.drop_index()
    }
}
