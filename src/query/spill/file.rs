//! A temporary file of parts, each with its length in front.

use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read as _, Seek as _, Write as _};
use std::path::{Path, PathBuf};

use crate::query::error::{QueryError, Result};

/// A file that is written.
#[derive(Debug)]
pub(in crate::query) struct Keeper {
    file: BufWriter<File>,
    folder: PathBuf,
}

/// The same file, read from its beginning.
#[derive(Debug)]
pub(in crate::query) struct Kept {
    file: BufReader<File>,
    folder: PathBuf,
}

impl Keeper {
    pub(in crate::query) fn new(folder: &Path) -> Result<Self> {
        let file = tempfile::tempfile_in(folder).map_err(|error| failed(&error, folder))?;
        Ok(Self { file: BufWriter::new(file), folder: folder.to_owned() })
    }

    /// Adds a part.
    pub(in crate::query) fn put(&mut self, part: &[u8]) -> Result<()> {
        // No document between two stages is larger than 64 MB.
        let length = u32::try_from(part.len()).unwrap_or(u32::MAX).to_le_bytes();
        let written = self.file.write_all(&length).and_then(|()| self.file.write_all(part));
        written.map_err(|error| failed(&error, &self.folder))
    }

    pub(in crate::query) fn read(self) -> Result<Kept> {
        let folder = self.folder;
        let file = self.file.into_inner().map_err(io::IntoInnerError::into_error);
        let file = file.and_then(|mut file| file.rewind().map(|()| file));
        let file = file.map_err(|error| failed(&error, &folder))?;
        Ok(Kept { file: BufReader::new(file), folder })
    }
}

impl Kept {
    /// Returns the next part; none at the end.
    pub(in crate::query) fn next(&mut self) -> Result<Option<Vec<u8>>> {
        self.part().map_err(|error| failed(&error, &self.folder))
    }

    /// Returns the part that has to follow another.
    pub(in crate::query) fn rest(&mut self) -> Result<Vec<u8>> {
        self.next()?.ok_or_else(|| failed(&io::ErrorKind::UnexpectedEof.into(), &self.folder))
    }

    fn part(&mut self) -> io::Result<Option<Vec<u8>>> {
        let mut length = [0; 4];
        match self.file.read_exact(&mut length) {
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(None),
            read => read?,
        }
        let length = u32::from_le_bytes(length);
        let mut part = Vec::with_capacity(usize::try_from(length).unwrap_or_default());
        let read = (&mut self.file).take(length.into()).read_to_end(&mut part)?;
        if part.len() < read || u32::try_from(read) != Ok(length) {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        Ok(Some(part))
    }
}

/// The error of a temporary file.
pub(super) fn failed(error: &io::Error, folder: &Path) -> QueryError {
    let folder = folder.display();
    match error.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            QueryError::disk_full(format!("the disk is full: no room in {folder} for temporary files; set TMPDIR"))
        }
        _ => QueryError::of_file(format!("cannot use a temporary file in {folder}: {error}; set TMPDIR")),
    }
}
