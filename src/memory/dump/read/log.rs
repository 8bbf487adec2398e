//! The oplog of a dump: what changed while `mongodump --oplog` wrote it.

use std::path::{Path, PathBuf};

use bson::{Document, RawDocumentBuf};

use super::ReadError;
use super::file::unpacked;
use crate::formats::mongodump::{self, Archive, Damage, decode_document};
use crate::store::document;

/// The entries of an oplog, each with the byte it starts at.
pub(in crate::memory::dump) type Entries<'a> = Box<dyn Iterator<Item = Result<(u64, Document), ReadError>> + 'a>;

/// The oplog of a dump.
#[derive(Debug)]
pub struct Log {
    path: PathBuf,
    /// Its database and collection in an archive.
    archived: Option<(String, String)>,
}

impl Log {
    /// The oplog in a file of its own.
    pub(super) fn file(path: &Path) -> Self {
        Self { path: path.to_owned(), archived: None }
    }

    /// The oplog in an archive.
    pub(super) fn archived(path: &Path, database: &str, collection: &str) -> Self {
        Self { path: path.to_owned(), archived: Some((database.to_owned(), collection.to_owned())) }
    }

    /// What messages call it.
    #[must_use]
    pub fn name(&self) -> String {
        match &self.archived {
            None => self.path.display().to_string(),
            Some(_) => format!("the oplog in {}", self.path.display()),
        }
    }

    /// Its entries from the beginning.
    ///
    /// # Errors
    /// Where the file cannot be opened.
    pub(in crate::memory::dump) fn entries(&self) -> Result<Entries<'_>, ReadError> {
        let file = unpacked(&self.path)?;
        Ok(match &self.archived {
            None => self.decoded(mongodump::Documents::new(file)),
            Some((database, collection)) => {
                let archive = Archive::open(file).map_err(|damage| self.damaged(damage))?;
                self.decoded(archive.documents(database, collection))
            }
        })
    }

    fn decoded<'a>(&'a self, entries: impl Iterator<Item = Result<(u64, RawDocumentBuf), Damage>> + 'a) -> Entries<'a> {
        let decode = |(offset, entry): (u64, RawDocumentBuf)| {
            document::check_shape(&entry).map_err(|error| Damage { offset, reason: error.message })?;
            Ok((offset, decode_document(offset, &entry)?))
        };
        Box::new(entries.map(move |read| read.and_then(decode).map_err(|damage| self.damaged(damage))))
    }

    /// The error for an entry that is not one.
    pub(in crate::memory::dump) fn damaged(&self, damage: Damage) -> ReadError {
        ReadError::Damaged { path: self.path.clone(), damage }
    }
}
