//! Documents in the order in which they came.

use std::cell::RefCell;
use std::io::{BufReader, BufWriter, Read, Seek as _, SeekFrom, Write as _};
use std::path::PathBuf;
use std::rc::Rc;

use bson::RawDocumentBuf;
use tempfile::{SpooledTempFile, spooled_tempfile_in};

use super::Spill;
use super::file::failed;
use crate::query::error::Result;

/// How many bytes are read at a time.
const BLOCK: usize = 64 << 10;

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

    /// Returns the documents, which can be read several times.
    ///
    /// # Errors
    /// If the temporary file cannot be used.
    pub(in crate::query) fn shared(self) -> Result<Shared> {
        let folder = self.folder;
        let file = self.file.into_inner().map_err(std::io::IntoInnerError::into_error);
        let file = file.map_err(|error| failed(&error, &folder))?;
        Ok(Shared { file: Rc::new(RefCell::new(file)), folder })
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

/// Documents that can be read several times.
#[derive(Debug)]
pub(in crate::query) struct Shared {
    file: Rc<RefCell<SpooledTempFile>>,
    folder: PathBuf,
}

impl Shared {
    /// Returns the documents, from the first on.
    pub(in crate::query) fn documents(&self) -> impl Iterator<Item = Result<RawDocumentBuf>> + use<> {
        let mut file = BufReader::with_capacity(BLOCK, Reader { file: Rc::clone(&self.file), offset: 0 });
        let folder = self.folder.clone();
        std::iter::from_fn(move || next(&mut file).map_err(|error| failed(&error, &folder)).transpose()).fuse()
    }
}

/// Reads a file from a place of its own.
struct Reader {
    file: Rc<RefCell<SpooledTempFile>>,
    offset: u64,
}

impl Read for Reader {
    fn read(&mut self, bytes: &mut [u8]) -> std::io::Result<usize> {
        let mut file = self.file.borrow_mut();
        file.seek(SeekFrom::Start(self.offset))?;
        let length = file.read(bytes)?;
        self.offset += length as u64;
        Ok(length)
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
