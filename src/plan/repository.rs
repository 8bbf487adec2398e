//! The plans that are stored in a namespace, found by their ids.

use bson::oid::ObjectId;
use bson::{Bson, DateTime, Document, doc};

use super::document::{PlanDocumentError, Stored, from_document};
use super::progress::{Progress, Status, mark, progress};
use super::source::{SourceError, TaskSource};
use crate::fault::{AtFault, Fault};
use crate::formats::shell;
use crate::memory::Memory;
use crate::problem::names;
use crate::store::{Find, Namespace, StoreError, UpdateRequest, UpdateSpec, metadata};

/// The word for the plan that was stored last.
pub const LAST: &str = "last";

/// Which of the stored runs `last` is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Last {
    /// The last run of a planner, also one that found no plan.
    Run,
    /// The last plan, also an empty one; the last run where there is no plan.
    Plan,
    /// The last plan that has steps.
    WithSteps,
}

impl Last {
    /// What its document matches.
    fn filter(self) -> Document {
        match self {
            Self::Run => doc! {},
            Self::Plan => doc! { "plan": { "$in": ["success", 1] } },
            Self::WithSteps => doc! { "$or": [{ "1": { "$exists": true } }, { "actions.0": { "$exists": true } }] },
        }
    }
}

/// How many ids a complaint about one that is not unique names.
const NAMED: usize = 5;

/// The plans of a namespace.
#[derive(Clone, Copy)]
pub struct Repository<'a> {
    memory: &'a Memory,
    namespace: &'a Namespace,
}

/// Why a plan was not found or changed.
#[derive(Debug, thiserror::Error)]
pub enum RepositoryError {
    /// No plan has the id.
    #[error("no plan in {namespace} has the id `{id}`; list the ids with `rmem plan list`, or use `last`")]
    Unknown {
        /// What was asked for.
        id: String,
        /// Where.
        namespace: Namespace,
    },
    /// There is none at all.
    #[error("there is no plan in {0}")]
    Empty(Namespace),
    /// There are runs, and none of them gave a plan with steps.
    #[error("no plan in {namespace} has steps; the last run is {newest}")]
    NoSteps {
        /// Where.
        namespace: Namespace,
        /// The id of the last run, and what came of it.
        newest: String,
    },
    /// Several plans have ids that begin so.
    #[error("several plans in {namespace} have ids that begin with `{id}`: {}", .known.join(", "))]
    Ambiguous {
        /// What was asked for.
        id: String,
        /// Where.
        namespace: Namespace,
        /// Some of them.
        known: Vec<String>,
    },
    /// The plan has no such step.
    #[error("the plan has {count} steps; expected a number from 1 to {count}, found {number}")]
    NoStep {
        /// What was asked for.
        number: usize,
        /// How many there are.
        count: usize,
    },
    /// The store failed.
    #[error("{0}")]
    Store(#[from] StoreError),
}

impl AtFault for RepositoryError {
    fn fault(&self) -> Fault {
        match self {
            Self::Unknown { .. }
            | Self::Empty(_)
            | Self::NoSteps { .. }
            | Self::Ambiguous { .. }
            | Self::NoStep { .. } => Fault::Usage,
            Self::Store(error) => error.fault(),
        }
    }
}

/// A stored plan with all that is known of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// The document with its metadata.
    pub document: Document,
}

impl<'a> Repository<'a> {
    /// The plans of `namespace`.
    #[must_use]
    pub fn new(memory: &'a Memory, namespace: &'a Namespace) -> Self {
        Self { memory, namespace }
    }

    /// Stores a plan's document, with its metadata, and returns its id.
    ///
    /// # Errors
    /// Where the store fails.
    pub fn store(&self, document: Document) -> Result<String, StoreError> {
        let inserted = self.memory.insert(self.namespace, vec![document])?;
        Ok(inserted.ids.first().map(readable).unwrap_or_default())
    }

    /// The newest plans, at most `limit`; 0 is all.
    ///
    /// # Errors
    /// Where the store fails.
    pub fn newest(&self, limit: u64) -> Result<impl Iterator<Item = Result<Record, StoreError>> + 'a, StoreError> {
        self.find(doc! {}, newest_first(), limit)
    }

    /// The plan with an id: `last`, a whole id, or what only one id begins with.
    ///
    /// # Errors
    /// Where there is none or are several, or the store fails.
    pub fn get(&self, id: &str) -> Result<Record, RepositoryError> {
        if id == LAST {
            return self.last(Last::Run);
        }
        let mut filters = vec![doc! { "_id": id }];
        if let Some([first, last]) = range(id) {
            filters.push(doc! { "_id": { "$gte": first, "$lte": last } });
        }
        let limit = NAMED as u64 + 1;
        let found = self.find(doc! { "$or": filters }, doc! { "_id": 1 }, limit)?;
        let mut found: Vec<Record> = found.collect::<Result<_, _>>()?;
        match found.len() {
            1 => Ok(found.remove(0)),
            0 => Err(RepositoryError::Unknown { id: id.to_owned(), namespace: self.namespace.clone() }),
            _ => Err(RepositoryError::Ambiguous {
                id: id.to_owned(),
                namespace: self.namespace.clone(),
                known: found.iter().take(NAMED).map(Record::id).collect(),
            }),
        }
    }

    /// The last plan, or the last run of a planner.
    ///
    /// # Errors
    /// Where there is none, or the store fails.
    pub fn last(&self, last: Last) -> Result<Record, RepositoryError> {
        let namespace = || self.namespace.clone();
        if let Some(found) = self.find(last.filter(), newest_first(), 1)?.next().transpose()? {
            return Ok(found);
        }
        let newest = self.newest(1)?.next().transpose()?.ok_or_else(|| RepositoryError::Empty(namespace()))?;
        if last != Last::WithSteps {
            return Ok(newest);
        }
        let newest = format!("{} ({})", newest.id(), newest.outcome());
        Err(RepositoryError::NoSteps { namespace: namespace(), newest })
    }

    /// Notes how far a step is; steps count from 1.
    ///
    /// # Errors
    /// Where the plan has no such step, is gone, or the store fails.
    pub fn mark(&self, plan: &Record, number: usize, status: Status, at: DateTime) -> Result<(), RepositoryError> {
        let count = plan.progress().len();
        let update = mark(&plan.document, number, status, at).ok_or(RepositoryError::NoStep { number, count })?;
        let request = UpdateRequest {
            filter: doc! { "_id": plan.document.get("_id").cloned().unwrap_or(Bson::Null) },
            update: UpdateSpec::Document(update),
            ..UpdateRequest::default()
        };
        match self.memory.update(self.namespace, &request)?.matched {
            0 => Err(RepositoryError::Unknown { id: plan.id(), namespace: self.namespace.clone() }),
            _ => Ok(()),
        }
    }

    fn find(
        &self,
        filter: Document,
        sort: Document,
        limit: u64,
    ) -> Result<impl Iterator<Item = Result<Record, StoreError>> + 'a, StoreError> {
        let filter = doc! { "$and": [{ "plan": { "$exists": true } }, filter] };
        // The next step of an executive depends on what it noted last.
        let find = Find { filter, sort, limit, current: true, ..Find::default() };
        let found = self.memory.find_with_metadata(self.namespace, &find)?;
        Ok(found.map(|document| {
            let document = Document::try_from(&*document?).map_err(crate::query::QueryError::from)?;
            Ok(Record { document })
        }))
    }
}

/// The order of runs, the last one first.
fn newest_first() -> Document {
    doc! { format!("{}.{}", metadata::INFO, metadata::INSERTED): -1, "_id": -1 }
}

/// An id as people write it.
fn readable(id: &Bson) -> String {
    match id {
        Bson::ObjectId(id) => id.to_hex(),
        Bson::String(id) => id.clone(),
        other => shell::relaxed_value(other),
    }
}

/// The first and the last id that begin with some hexadecimal digits.
fn range(prefix: &str) -> Option<[ObjectId; 2]> {
    let digits = !prefix.is_empty() && prefix.bytes().all(|byte| byte.is_ascii_hexdigit());
    let fill = |digit: char| {
        let mut id = prefix.to_owned();
        id.extend(std::iter::repeat_n(digit, 24_usize.checked_sub(prefix.len())?));
        ObjectId::parse_str(id).ok()
    };
    digits.then(|| Some([fill('0')?, fill('f')?])).flatten()
}

impl Record {
    /// The id as people say it.
    #[must_use]
    pub fn id(&self) -> String {
        self.document.get("_id").map(readable).unwrap_or_default()
    }

    /// The plan, or that there is none. `name` gives the problem's name for a value.
    ///
    /// # Errors
    /// Where the document is not a plan.
    pub fn plan(&self, name: &dyn Fn(&Bson) -> Option<String>) -> Result<Stored, PlanDocumentError> {
        let mut document = self.document.clone();
        document.remove("_id");
        from_document(&document, name)
    }

    /// What is known of the execution of each step.
    #[must_use]
    pub fn progress(&self) -> Vec<Progress> {
        progress(&self.document)
    }

    /// Where the plan comes from; nothing where another program stored it.
    #[must_use]
    pub fn lineage(&self) -> Option<&Document> {
        self.document.get_document(metadata::INFO).ok()?.get_document("lineage").ok()
    }

    /// What the plan was made from.
    ///
    /// # Errors
    /// What is missing.
    pub fn source(&self) -> Result<TaskSource, SourceError> {
        let sources = self.lineage().and_then(|lineage| lineage.get_document("sources").ok());
        TaskSource::from_document(sources.ok_or(SourceError::Missing("sources"))?)
    }
}

/// A value of the memory's as a name of PDDL, where the problem is not at hand.
#[must_use]
pub fn spelled(value: &Bson) -> Option<String> {
    match value {
        Bson::String(text) => Some(names::mangle(text)),
        Bson::ObjectId(id) => Some(names::mangle(&id.to_hex())),
        Bson::Int32(_) | Bson::Int64(_) | Bson::Double(_) | Bson::Boolean(_) => Some(shell::relaxed_value(value)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_the_beginning_of_ids() {
        let [first, last] = range("6B01").unwrap();
        assert!(first.to_hex().starts_with("6b0100") && last.to_hex().starts_with("6b01ff"));
        let id = ObjectId::new();
        assert_eq!(range(&id.to_hex()), Some([id, id]));
        for prefix in ["", "x", "6b01 ", "0000000000000000000000000"] {
            assert_eq!(range(prefix), None, "{prefix}");
        }
    }
}
