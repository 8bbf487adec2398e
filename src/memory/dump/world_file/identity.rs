//! The `_id`s of documents that have none in a world file, or in another dump.

use std::collections::HashMap;

use bson::oid::ObjectId;
use bson::{Document, RawDocumentBuf};
use sha2::{Digest as _, Sha256};

use crate::query::QueryError;
use crate::store::Namespace;

/// Gives documents without an `_id` one that follows from what they are.
pub(in crate::memory::dump) struct Identities {
    namespace: String,
    /// How often each content was seen, by the first bytes of its digest.
    seen: HashMap<u64, u32>,
}

impl Identities {
    pub(in crate::memory::dump) fn new(namespace: &Namespace) -> Self {
        Self { namespace: namespace.to_string(), seen: HashMap::new() }
    }

    pub(in crate::memory::dump) fn give(&mut self, mut document: Document) -> Result<Document, QueryError> {
        if document.contains_key("_id") {
            return Ok(document);
        }
        let content: [u8; 32] = Sha256::new()
            .chain_update(&self.namespace)
            .chain_update([0])
            .chain_update(RawDocumentBuf::try_from(&document)?.as_bytes())
            .finalize()
            .into();
        let short = content.iter().take(8).fold(0, |short, byte| short << 8 | u64::from(*byte));
        let nth = self.seen.entry(short).or_default();
        let digest = Sha256::new().chain_update(content).chain_update(u64::from(*nth).to_le_bytes()).finalize();
        *nth += 1;
        let mut id = [0; 12];
        id.iter_mut().zip(digest).for_each(|(byte, digit)| *byte = digit);
        document.insert("_id", ObjectId::from_bytes(id));
        Ok(document)
    }
}
