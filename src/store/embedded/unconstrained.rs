//! Whether documents could be in a collection for a moment with no visible effect.

use rusqlite::params;

use super::Embedded;
use super::change_log::PREFIX;
use super::indexed::{Indexed, decay};
use super::watcher::HISTORY;
use crate::store::{Namespace, StoreError};

/// Finds a watcher of a collection that gets computed documents: clients of `rmem serve` and histories do not.
const WATCHED: &str = "SELECT 1 FROM watchers WHERE database IN ('', ?1) AND collection IN ('', ?2)
                       AND (name IS NULL OR substr(name, 1, length(?3)) <> ?3 AND substr(name, 1, length(?4)) <> ?4)";

impl Embedded {
    /// Whether no validator and no index would refuse or remove documents that may be stored, strings compare byte by byte,
    /// and no watcher gets computed documents.
    pub(super) fn is_unconstrained(&self, ns: &Namespace) -> Result<bool, StoreError> {
        if let Some(collection) = self.collection(ns)? {
            let indexes = self.indexes_of(collection)?;
            if indexes.validation.is_some() {
                return Ok(false);
            }
            let decay = decay(&indexes).map(|index| index.id);
            if !indexes.iter().all(|index| Some(index.id) == decay || is_plain(index)) {
                return Ok(false);
            }
        }
        let watched =
            || self.connection.prepare_cached(WATCHED)?.exists(params![ns.database, ns.collection, PREFIX, HISTORY]);
        watched().map(|is_watched| !is_watched).map_err(|e| self.explain(&e))
    }
}

/// Whether an index takes every document: it has one key, which is no hash, so that arrays may run through it.
fn is_plain(index: &Indexed) -> bool {
    let definition = &index.definition;
    let is_hashed = definition.keys.values().any(|kind| kind.as_str() == Some("hashed"));
    let is_single = definition.keys.len() == 1 && !is_hashed && index.is_kept() && !index.is_of_ids();
    is_single && !definition.unique && definition.expire_after.is_none()
}
