//! Documents in the order in which they came.

use std::io::{BufReader, BufWriter, Read, Seek as _, Write as _};
use std::path::PathBuf;

use bson::RawDocumentBuf;
use tempfile::{SpooledTempFile, spooled_tempfile_in};

use super::Spill;
use super::file::failed;
use crate::query::error::Result;

/// Collects documents: in memory while they are few, else in a temporary file.
#[derive(Debug)]
pub struct Spool {
    file: BufWriter<SpooledTempFile>,
    folder: PathBuf,
}

impl Spool {
    /// Returns an empty one.
    #[must_use]
    pub fn new(spill: &Spill) -> Self {
        let file = spooled_tempfile_in(spill.limit / 4, &spill.folder);
        Self { file: BufWriter::new(file), folder: spill.folder.clone() }
    }

    /// Adds a document.
    ///
    /// # Errors
    /// If the temporary file cannot be written.
    pub fn push(&mut self, document: &bson::RawDocument) -> Result<()> {
        self.file.write_all(document.as_bytes()).map_err(|error| failed(&error, &self.folder))
    }

    /// Returns the documents.
    ///
    /// # Errors
    /// If the temporary file cannot be used.
    pub fn read(self) -> Result<impl Iterator<Item = Result<RawDocumentBuf>>> {
        let folder = self.folder;
        let file = self.file.into_inner().map_err(std::io::IntoInnerError::into_error);
        let file = file.and_then(|mut file| file.rewind().map(|()| file));
        let mut file = BufReader::new(file.map_err(|error| failed(&error, &folder))?);
        Ok(std::iter::from_fn(move || next(&mut file).map_err(|error| failed(&error, &folder)).transpose()).fuse())
    }
}

/// Reads the next document.
fn next(file: &mut impl Read) -> std::io::Result<Option<RawDocumentBuf>> {
    let mut bytes = vec![0; 4];
    match file.read_exact(&mut bytes) {
        Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => return Ok(None),
        read => read?,
    }
    let length = bytes.iter().rev().fold(0, |length, byte| length << 8 | usize::from(*byte));
    bytes.resize(length.max(4), 0);
    file.read_exact(bytes.get_mut(4..).unwrap_or_default())?;
    RawDocumentBuf::from_bytes(bytes).map(Some).map_err(std::io::Error::other)
}
