//! The stored form of a document: its BSON, then a checksum of 8 bytes.
//!
//! The checksum is XXH3 of the BSON, little-endian. It is verified whenever a document is read,
//! so that damage is reported and never answered. BSON begins with its length, by which a
//! document that a version 1 file stored without a checksum is recognised; of such a document the
//! structure is verified instead.

use bson::raw::{RawBsonRef, RawIter};
use bson::{Bson, RawDocument};
use xxhash_rust::xxh3::xxh3_64;

use super::damage::Damage;
use super::page::PageError;
use crate::formats::shell;
use crate::query::key;

/// The length of a checksum, in bytes.
const CHECKSUM: usize = 8;

/// Returns the bytes to store for a document.
pub(super) fn seal(document: &RawDocument) -> Vec<u8> {
    let bytes = document.as_bytes();
    let mut sealed = Vec::with_capacity(bytes.len() + CHECKSUM);
    sealed.extend_from_slice(bytes);
    sealed.extend_from_slice(&xxh3_64(bytes).to_le_bytes());
    sealed
}

/// Returns the document in stored bytes.
///
/// # Errors
/// Where it is damaged.
pub(super) fn open(stored: &[u8]) -> Result<&RawDocument, Damage> {
    let length = stored.first_chunk().map(|length| i32::from_le_bytes(*length));
    let length = length.and_then(|length| usize::try_from(length).ok()).ok_or(Damage::Length)?;
    let (bytes, checksum) = stored.split_at_checked(length).ok_or(Damage::Length)?;
    match checksum.first_chunk::<CHECKSUM>() {
        Some(expected) if checksum.len() == CHECKSUM => {
            if u64::from_le_bytes(*expected) != xxh3_64(bytes) {
                return Err(Damage::Checksum);
            }
            RawDocument::from_bytes(bytes).map_err(|_| Damage::Structure)
        }
        None if checksum.is_empty() => {
            let document = RawDocument::from_bytes(bytes).map_err(|_| Damage::Structure)?;
            if is_well_formed(document) { Ok(document) } else { Err(Damage::Structure) }
        }
        _ => Err(Damage::Length),
    }
}

/// Whether stored bytes have a checksum.
pub(super) fn is_sealed(stored: &[u8]) -> bool {
    let length = stored.first_chunk().map(|length| i32::from_le_bytes(*length));
    length.and_then(|length| usize::try_from(length).ok()).is_some_and(|length| length < stored.len())
}

/// Whether every element of a document, at any depth, can be read. Without recursion: a damaged
/// document may be nested more deeply than a stored one.
pub(super) fn is_well_formed(document: &RawDocument) -> bool {
    let mut open: Vec<RawIter<'_>> = vec![document.iter_elements()];
    while let Some(elements) = open.last_mut() {
        let Some(element) = elements.next() else {
            open.pop();
            continue;
        };
        match element.and_then(|element| element.value()) {
            Ok(RawBsonRef::Document(inner)) => open.push(inner.iter_elements()),
            Ok(RawBsonRef::Array(inner)) => open.push(inner.iter_elements()),
            Ok(_) => {}
            Err(_) => return false,
        }
    }
    true
}

/// Returns the document in a column of a page.
pub(super) fn of_column(column: rusqlite::types::ValueRef<'_>) -> Result<&RawDocument, PageError> {
    let stored = column.as_blob().map_err(rusqlite::Error::from)?;
    open(stored).map_err(|damage| PageError::Damaged(damage, name(stored)))
}

/// What errors call the document in damaged bytes: its `_id`, as far as it can be read.
pub(super) fn name(stored: &[u8]) -> Option<String> {
    let length = stored.first_chunk().map(|length| i32::from_le_bytes(*length))?;
    let bytes = stored.get(..usize::try_from(length).ok()?)?;
    let id = RawDocument::from_bytes(bytes).ok()?.get("_id").ok()??;
    // An `_id` of any depth: only plain values are printed.
    let id = match id {
        RawBsonRef::Document(_) | RawBsonRef::Array(_) | RawBsonRef::JavaScriptCodeWithScope(_) => return None,
        id => Bson::try_from(id).ok()?,
    };
    Some(shell::relaxed_value(&id))
}

/// Whether the key of a row is that of the document's `_id`.
pub(super) fn has_key(document: &RawDocument, key: &[u8]) -> bool {
    document.get("_id").ok().flatten().is_some_and(|id| key::encode(id) == key)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::rawdoc;

    #[test]
    fn a_document_comes_back_with_and_without_a_checksum() {
        let document = rawdoc! { "_id": 7, "a": { "b": [1, "x"] } };
        let sealed = seal(&document);
        assert_eq!(sealed.len(), document.as_bytes().len() + CHECKSUM);
        assert_eq!(open(&sealed).unwrap(), &*document);
        assert_eq!(open(document.as_bytes()).unwrap(), &*document);
        assert!(is_sealed(&sealed) && !is_sealed(document.as_bytes()));
        assert_eq!(name(&sealed).as_deref(), Some("7"));
    }

    #[test]
    fn every_changed_byte_is_noticed() {
        let sealed = seal(&rawdoc! { "_id": 7, "a": { "b": [1, "x"] } });
        for at in 0..sealed.len() {
            for bit in 0..8 {
                let mut damaged = sealed.clone();
                damaged[at] ^= 1 << bit;
                assert!(open(&damaged).is_err(), "byte {at}, bit {bit}");
            }
        }
        for length in 0..sealed.len() - CHECKSUM {
            assert!(open(&sealed[..length]).is_err(), "{length} bytes");
        }
    }

    #[test]
    fn malformed_bson_without_a_checksum_is_noticed_at_any_depth() {
        let mut bytes = rawdoc! { "_id": 7, "a": { "b": "text" } }.into_bytes();
        let at = bytes.windows(4).position(|window| window == b"text").unwrap();
        bytes[at] = 0xff;
        assert_eq!(open(&bytes), Err(Damage::Structure));
        let mut deep = rawdoc! {};
        for _ in 0..50_000 {
            deep = rawdoc! { "a": deep };
        }
        assert!(is_well_formed(&deep));
    }
}
