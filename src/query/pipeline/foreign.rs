//! The documents of another collection by the values of a field: in memory while they are few, else in temporary files.
//!
//! The files hold the documents, and the hashes of their values in order, each with the place of its document. What is
//! found by a hash is compared.

use std::collections::hash_map::RandomState;
use std::collections::{HashMap, HashSet};
use std::hash::BuildHasher as _;
use std::rc::Rc;

use bson::RawDocumentBuf;

use super::documents::Documents;
use crate::query::error::{QueryError, Result};
use crate::query::key;
use crate::query::limit::ALLOCATION;
use crate::query::path::Path;
use crate::query::spill::{BlockWriter, Blocks, Sorter, Spill};
use crate::query::view::View;

/// How many hashes are read at a time.
const BLOCK: usize = 256;
/// The bytes of a hash and of the place of a document.
const HASH: usize = 8;
const ENTRY: usize = 2 * HASH;

/// Documents by the values that a path reaches in them.
pub(super) struct Foreign<'a> {
    field: Field<'a>,
    documents: Found,
}

/// Whose values are looked for; with `missing`, documents without one have null.
#[derive(Clone, Copy)]
struct Field<'a> {
    path: &'a Path,
    missing: bool,
}

enum Found {
    Held(Held),
    Filed(Filed),
}

impl<'a> Foreign<'a> {
    pub(super) fn read<E: From<QueryError>>(
        mut documents: Documents<'_, E>,
        path: &'a Path,
        missing: bool,
        spill: &Spill,
    ) -> std::result::Result<Rc<Self>, E> {
        let field = Field { path, missing };
        let mut held = Held::default();
        while let Some(document) = documents.next() {
            held.add(document?, field);
            if held.bytes > spill.limit / 2 {
                let first = std::mem::take(&mut held).documents.into_iter();
                let filed = Filed::write(first.map(Ok).chain(documents), field, spill)?;
                return Ok(Rc::new(Self { field, documents: Found::Filed(filed) }));
            }
        }
        Ok(Rc::new(Self { field, documents: Found::Held(held) }))
    }

    /// Returns the documents that have one of the values, in their order.
    pub(super) fn find(
        self: &Rc<Self>,
        keys: Vec<Vec<u8>>,
    ) -> Result<impl Iterator<Item = Result<RawDocumentBuf>> + use<'a>> {
        let mut places = match &self.documents {
            Found::Held(held) => held.places(&keys),
            Found::Filed(filed) => filed.places(&keys)?,
        };
        places.sort_unstable();
        places.dedup();
        let (index, keys) = (Rc::clone(self), keys.into_iter().collect::<HashSet<_>>());
        Ok(places.into_iter().filter_map(move |place| index.document(place, &keys).transpose()))
    }

    /// Returns the document at a place, if it has one of the values.
    fn document(&self, place: u64, keys: &HashSet<Vec<u8>>) -> Result<Option<RawDocumentBuf>> {
        match &self.documents {
            Found::Held(held) => Ok(usize::try_from(place).ok().and_then(|place| held.documents.get(place)).cloned()),
            Found::Filed(filed) => {
                let document = RawDocumentBuf::from_bytes(filed.documents.read(place)?)?;
                Ok(self.field.keys(&document).iter().any(|key| keys.contains(key)).then_some(document))
            }
        }
    }
}

impl Field<'_> {
    /// Returns the keys of the values in a document.
    fn keys(self, document: &RawDocumentBuf) -> Vec<Vec<u8>> {
        let mut keys = Vec::new();
        if !self.missing && !self.path.any((&**document).into(), true, &mut |value, _| value.is_some()) {
            return keys;
        }
        self.path.any((&**document).into(), true, &mut |value, _| {
            keys.push(key_of(value));
            false
        });
        keys
    }
}

/// Returns those documents in which a path reaches one of the values.
pub(super) fn with_value<'a, E: From<QueryError> + 'a>(
    documents: Documents<'a, E>,
    path: &'a Path,
    keys: Vec<Vec<u8>>,
) -> Documents<'a, E> {
    let (field, keys) = (Field { path, missing: true }, keys.into_iter().collect::<HashSet<_>>());
    Box::new(documents.filter(move |document| match document {
        Ok(document) => field.keys(document).iter().any(|key| keys.contains(key)),
        Err(_) => true,
    }))
}

/// Returns the key of a value; missing and undefined are null.
pub(super) fn key_of(value: Option<View<'_>>) -> Vec<u8> {
    let mut bytes = Vec::new();
    let value = value.filter(|value| !matches!(value, View::Undefined)).unwrap_or(View::Null);
    key::append(value, &mut bytes);
    bytes
}

/// Documents in memory.
#[derive(Default)]
struct Held {
    documents: Vec<RawDocumentBuf>,
    places: HashMap<Vec<u8>, Vec<u64>>,
    /// The bytes of memory that they need.
    bytes: usize,
}

impl Held {
    fn add(&mut self, document: RawDocumentBuf, field: Field<'_>) {
        let place = self.documents.len() as u64;
        for key in field.keys(&document) {
            // The tables grow by doubling.
            self.bytes += 2 * size_of::<(Vec<u8>, Vec<u64>)>() + 2 * ALLOCATION + key.len();
            self.places.entry(key).or_default().push(place);
        }
        self.bytes += 2 * size_of::<RawDocumentBuf>() + ALLOCATION + document.as_bytes().len();
        self.documents.push(document);
    }

    fn places(&self, keys: &[Vec<u8>]) -> Vec<u64> {
        keys.iter().filter_map(|key| self.places.get(key)).flatten().copied().collect()
    }
}

/// Documents in temporary files.
struct Filed {
    documents: Blocks,
    hashes: Blocks,
    /// The first hash of each block of hashes, and its place.
    blocks: Vec<(u64, u64)>,
    hash: RandomState,
}

impl Filed {
    fn write<E: From<QueryError>>(
        documents: impl Iterator<Item = std::result::Result<RawDocumentBuf, E>>,
        field: Field<'_>,
        spill: &Spill,
    ) -> std::result::Result<Self, E> {
        let hash = RandomState::new();
        let mut writer = BlockWriter::new(&spill.folder)?;
        let mut sorter = Sorter::new(&Spill { limit: spill.limit / 4, folder: spill.folder.clone() });
        for document in documents {
            let document = document?;
            let place = writer.push(document.as_bytes())?;
            for key in field.keys(&document) {
                let entry = [hash.hash_one(key).to_be_bytes(), place.to_be_bytes()];
                sorter.add(entry.as_flattened(), &[])?;
            }
        }
        let (hashes, blocks) = written(sorter.records()?.map(|record| Ok(record?.0)), spill)?;
        Ok(Self { documents: writer.finish()?, hashes, blocks, hash })
    }

    /// Returns where documents with one of the values are, and perhaps others.
    fn places(&self, keys: &[Vec<u8>]) -> Result<Vec<u64>> {
        let mut places = Vec::new();
        for hash in keys.iter().map(|key| self.hash.hash_one(key)) {
            // Also the block before those that begin with the hash may end with it.
            let first = self.blocks.partition_point(|(begin, _)| *begin < hash).saturating_sub(1);
            let blocks = self.blocks.get(first..).unwrap_or_default();
            for (_, block) in blocks.iter().take_while(|(begin, _)| *begin <= hash) {
                let entries = self.hashes.read(*block)?;
                let same = entries.chunks_exact(ENTRY).filter(|entry| number(entry, 0) == hash);
                places.extend(same.map(|entry| number(entry, HASH)));
            }
        }
        Ok(places)
    }
}

/// Writes entries; returns the first hash of each block, and its place.
fn written(entries: impl Iterator<Item = Result<Vec<u8>>>, spill: &Spill) -> Result<(Blocks, Vec<(u64, u64)>)> {
    let mut writer = BlockWriter::new(&spill.folder)?;
    let (mut blocks, mut block) = (Vec::new(), Vec::with_capacity(BLOCK * ENTRY));
    for entry in entries {
        block.extend(entry?);
        if block.len() >= BLOCK * ENTRY {
            blocks.push((number(&block, 0), writer.push(&block)?));
            block.clear();
        }
    }
    if !block.is_empty() {
        blocks.push((number(&block, 0), writer.push(&block)?));
    }
    Ok((writer.finish()?, blocks))
}

/// Returns the number whose bytes begin there.
fn number(bytes: &[u8], begin: usize) -> u64 {
    bytes.get(begin..).and_then(<[u8]>::first_chunk).map_or(0, |bytes| u64::from_be_bytes(*bytes))
}
