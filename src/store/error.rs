//! Why a store did not do what it was asked.

use bson::Bson;

use super::namespace::Namespace;
use super::taken_key::TakenKey;
use super::validation::InvalidDocument;
use crate::fault::{AtFault, Fault};
use crate::query::QueryError;

/// Why a store did not do what it was asked.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// No connection to a server, or no access to a file.
    #[error("cannot {} {address}: {reason}", if address.starts_with("file:") { "open" } else { "reach" })]
    Unreachable {
        /// The address, without credentials.
        address: String,
        /// What went wrong.
        reason: String,
        /// Whether a write was done, or it is not known if it was: the connection was lost after it was sent.
        may_be_done: bool,
    },
    /// A unique key is taken.
    #[error("{namespace} already has a document with {key}")]
    Duplicate {
        /// Where.
        namespace: Namespace,
        /// The key, printed like `_id: 7` or `name: "x" (unique index name_1)`.
        key: TakenKey,
        /// The `_id`s stored before the failure.
        stored: Vec<Bson>,
    },
    /// A document does not pass the validator of its collection.
    #[error("{0}")]
    Invalid(Box<InvalidDocument>),
    /// The filter, update, projection, sort or pipeline, or a document, is not acceptable.
    #[error(transparent)]
    Query(#[from] QueryError),
    /// An insert of several documents ended early.
    #[error("{}", match document { Some(nth) => format!("document {nth} cannot be stored"), None => "not all documents were confirmed".to_owned() })]
    Stopped {
        /// The `_id`s stored before the failure.
        stored: Vec<Bson>,
        /// The number of the document at fault, from 1, if it is one document.
        document: Option<usize>,
        /// What went wrong.
        source: Box<StoreError>,
    },
    /// A change of several documents ended early.
    #[error("failed after {}; what was done stays", documents(*done))]
    Partial {
        /// How many documents were changed.
        done: u64,
        /// What went wrong.
        source: Box<StoreError>,
    },
    /// Another process, or another purpose, holds what was asked for.
    #[error("{what}")]
    Held {
        /// What is held, by which process, and what to do.
        what: String,
    },
    /// A store of this kind cannot do what was asked.
    #[error("{address}: {reason}")]
    Unfit {
        /// The address, without credentials.
        address: String,
        /// Why, and what to do.
        reason: String,
    },
    /// A computable that the query needs failed.
    #[error("the computable `{name}` failed: {source}")]
    Computable {
        /// The computable.
        name: String,
        /// What went wrong.
        source: Box<dyn std::error::Error + Send + Sync>,
        /// What is at fault there.
        fault: Fault,
    },
    /// The user interrupted a change of many documents.
    #[error("interrupted{}", match done { 0 => "; nothing was changed".to_owned(), done => format!(" after {}; what was done stays", documents(*done)) })]
    Interrupted {
        /// How many documents were changed.
        done: u64,
    },
    /// The file system of the store has no room.
    #[error("{address}: {reason}")]
    DiskFull {
        /// The address, without credentials.
        address: String,
        /// What was not done, and what to do.
        reason: String,
    },
    /// A write that was done, but which a majority of the servers has not confirmed, or which is not in the history.
    #[error("{address}: {reason}")]
    Unconfirmed {
        /// The address, without credentials.
        address: String,
        /// What is not confirmed, or not recorded, and what to do.
        reason: String,
    },
    /// Anything else: no permission, a damaged file, a server's refusal.
    #[error("{address}: {reason}")]
    Failed {
        /// The address, without credentials.
        address: String,
        /// What went wrong, and what to do.
        reason: String,
    },
}

fn documents(count: u64) -> String {
    if count == 1 { "1 document".to_owned() } else { format!("{count} documents") }
}

impl AtFault for StoreError {
    fn fault(&self) -> Fault {
        match self {
            Self::Duplicate { .. } | Self::Invalid(_) | Self::Held { .. } => Fault::Conflict,
            Self::Unfit { .. } => Fault::Usage,
            Self::Interrupted { .. } => Fault::Interrupt,
            Self::Query(error) => error.fault(),
            Self::Stopped { source, .. } | Self::Partial { source, .. } => source.fault(),
            Self::Computable { fault, .. } => *fault,
            Self::Unreachable { .. } | Self::DiskFull { .. } | Self::Unconfirmed { .. } | Self::Failed { .. } => {
                Fault::Store
            }
        }
    }
}

impl StoreError {
    /// Returns that a server was not reached, or a file not opened, so that certainly nothing was written.
    pub(crate) fn unreachable(address: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Unreachable { address: address.into(), reason: reason.into(), may_be_done: false }
    }

    /// Returns the error for a memory that is expected to be there and has no file.
    pub(crate) fn missing(address: impl Into<String>) -> Self {
        let reason = "there is no such file; check its name, or make one: `rmem insert`, `rmem restore` and --load do";
        Self::unreachable(address, reason)
    }

    /// Returns the error for a computable that failed.
    pub(crate) fn computable(name: &str, error: impl AtFault) -> Self {
        Self::Computable { name: name.to_owned(), fault: error.fault(), source: Box::new(error) }
    }

    /// The error of a change of several documents that ended early, after `done` of them, which stay changed. One that says
    /// so already is about these, and perhaps more.
    pub(crate) fn after(self, done: u64) -> Self {
        match self {
            Self::Interrupted { .. } => Self::Interrupted { done },
            Self::Partial { done: known, source } => Self::Partial { done: known.max(done), source },
            source if done > 0 => Self::Partial { done, source: Box::new(source) },
            other => other,
        }
    }

    /// Whether it is about one document, and not about the store, or that the operation is to end.
    pub(crate) fn is_of_document(&self) -> bool {
        match self {
            Self::Duplicate { .. } | Self::Invalid(_) => true,
            Self::Query(error) => !QueryError::is_interruption(error.code),
            _ => false,
        }
    }

    /// The error with another name of the collection that it is about.
    pub(crate) fn renamed(self, ns: &Namespace) -> Self {
        match self {
            Self::Duplicate { key, stored, .. } => Self::Duplicate { namespace: ns.clone(), key, stored },
            Self::Invalid(invalid) => Self::Invalid(Box::new(InvalidDocument { namespace: ns.clone(), ..*invalid })),
            Self::Stopped { stored, document, source } => {
                Self::Stopped { stored, document, source: Box::new(source.renamed(ns)) }
            }
            other => other,
        }
    }

    /// The document that does not pass the validator of its collection, where the error is about one.
    #[must_use]
    pub fn invalid(&self) -> Option<&InvalidDocument> {
        match self {
            Self::Invalid(invalid) => Some(invalid),
            Self::Stopped { source, .. } | Self::Partial { source, .. } => source.invalid(),
            _ => None,
        }
    }

    /// The `_id`s that an insert stored before it failed.
    #[must_use]
    pub fn stored(&self) -> &[Bson] {
        match self {
            Self::Duplicate { stored, .. } | Self::Stopped { stored, .. } => stored,
            _ => &[],
        }
    }

    /// The error with the number of the document at fault, of `count`, and the `_id`s that are stored.
    pub(crate) fn stopped(self, stored: Vec<Bson>, count: usize) -> Self {
        match self {
            Self::Duplicate { namespace, key, .. } => Self::Duplicate { namespace, key, stored },
            single if count == 1 => single,
            source => {
                let document = Some(stored.len() + 1);
                Self::Stopped { stored, document, source: Box::new(source) }
            }
        }
    }
}
