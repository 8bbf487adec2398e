//! The bodies of computables.

use std::collections::BTreeMap;
use std::time::Duration;

use bson::{Document, RawDocumentBuf};

use crate::fault::{AtFault, Fault};
use crate::formats::Diagnostic;
use crate::query::QueryError;
use crate::store::{Documents, Find, Namespace, StoreError};

/// The memory as a body reads it.
pub(super) trait Source {
    /// Documents without metadata; see [`crate::store::Store::find`].
    fn find(&self, ns: &Namespace, find: &Find) -> Result<Documents<'_>, StoreError>;

    /// The results of a pipeline without metadata; see [`crate::store::Store::aggregate`].
    fn aggregate(&self, ns: &Namespace, pipeline: &[Document]) -> Result<Documents<'_>, StoreError>;

    /// The same over these documents of the collection alone, as they were read.
    fn aggregate_over(
        &self,
        ns: &Namespace,
        documents: &[RawDocumentBuf],
        pipeline: &[Document],
    ) -> Result<Documents<'_>, StoreError>;
}

/// The options of a builtin body, by the key of `[[computable]]` that gives them.
pub type Options = BTreeMap<String, String>;

/// An option that a builtin body does not accept: its key, and what is wrong.
pub(super) type WrongOption = (&'static str, String);

/// A builtin body, as `builtin = "NAME"` declares it.
pub struct Builtin {
    /// Its name.
    pub name: &'static str,
    /// The keys of `[[computable]]` that only builtin bodies have, and that this one takes.
    pub keys: &'static [&'static str],
    /// Makes the body of a computable of a namespace.
    #[expect(clippy::type_complexity, reason = "it is spelled out once")]
    pub(super) make: fn(&Options, &Namespace) -> Result<Box<dyn Body>, WrongOption>,
}

impl Builtin {
    /// Checks the options of a computable of a namespace.
    ///
    /// # Errors
    /// The first option that is not acceptable.
    pub fn check(&self, options: &Options, ns: &Namespace) -> Result<(), (&'static str, String)> {
        (self.make)(options, ns).map(drop)
    }
}

/// The query that a body answers.
pub(super) struct Asked<'a> {
    /// The memory, for the documents that the answer depends on. A query on it runs
    /// the computables that it needs.
    pub(super) memory: &'a dyn Source,
    /// The namespace of the asked query.
    pub(super) namespace: &'a Namespace,
    /// The asked query.
    pub(super) query: &'a Document,
    /// The stored documents that keys are added to, with their metadata; `None` where documents are asked for.
    pub(super) documents: Option<&'a [RawDocumentBuf]>,
}

/// Computes documents. The query is answered over all documents afterwards, so a body may
/// return documents that do not match it; they are not part of the answer.
pub(super) trait Body: Send + Sync {
    /// The documents. One without an `_id` gets one.
    ///
    /// # Errors
    /// Where they cannot be computed; nothing is stored then.
    fn compute(&self, asked: &Asked<'_>) -> Result<Vec<Document>, ComputeError>;

    /// What it is, in a line.
    fn describe(&self) -> String;

    /// The collections that it is computed from, as far as that is known.
    fn sources(&self, asked: &Namespace) -> Vec<Namespace>;

    /// How long it may take, where it is bound. Another process that asks the
    /// same waits for it so long.
    fn timeout(&self) -> Option<Duration> {
        None
    }
}

/// Why a body gave no documents.
#[derive(Debug, thiserror::Error)]
pub(super) enum ComputeError {
    /// The memory that it asked failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The asked query, or a document that it is about, is not as it has to be.
    #[error(transparent)]
    Query(#[from] QueryError),
    /// The output of a program is not documents.
    #[error("{0}")]
    Unreadable(String, #[source] Diagnostic),
    /// Anything else, in a sentence.
    #[error("{0}")]
    Failed(String),
}

impl AtFault for ComputeError {
    fn fault(&self) -> Fault {
        match self {
            Self::Store(error) => error.fault(),
            Self::Query(_) | Self::Unreadable(..) => Fault::Input,
            Self::Failed(_) => Fault::Store,
        }
    }
}

impl ComputeError {
    /// A mistake in the asked query or in a document, in a sentence.
    pub(super) fn wrong(words: impl Into<String>) -> Self {
        QueryError::bad_value(words).into()
    }
}
