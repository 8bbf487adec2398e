//! A computation for one query alone, and where its documents are.

use std::sync::Arc;

use bson::oid::ObjectId;
use bson::{Bson, RawDocumentBuf};

use super::registry::Computable;
use crate::store::Namespace;

/// A computation for one query alone.
pub(super) struct Once {
    pub(super) token: ObjectId,
    pub(super) computable: Arc<Computable>,
    pub(super) documents: Storage,
}

/// Where documents are.
pub(super) enum Storage {
    Memory(Vec<RawDocumentBuf>),
    /// In the store, with these `_id`s.
    Store(Vec<Bson>),
}

impl Once {
    pub(super) fn namespace(&self) -> &Namespace {
        &self.computable.definition.namespace
    }

    pub(super) fn in_memory(&self) -> &[RawDocumentBuf] {
        match &self.documents {
            Storage::Memory(documents) => documents,
            Storage::Store(_) => &[],
        }
    }
}
