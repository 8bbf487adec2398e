//! Blocks of bytes in a temporary file, which are read by their place.

use std::fs::File;
use std::io::{self, BufWriter, Write as _};
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};

use super::file::failed;
use crate::query::error::Result;

/// The bytes that are read at first: enough for most blocks, with their length in front.
const FIRST: usize = 1024;
/// The bytes of a length.
const LENGTH: usize = 4;

/// A file of blocks that is written.
#[derive(Debug)]
pub(in crate::query) struct BlockWriter {
    file: BufWriter<File>,
    folder: PathBuf,
    end: u64,
}

/// A file of blocks.
#[derive(Debug)]
pub(in crate::query) struct Blocks {
    file: File,
    folder: PathBuf,
}

impl BlockWriter {
    pub(in crate::query) fn new(folder: &Path) -> Result<Self> {
        let file = tempfile::tempfile_in(folder).map_err(|error| failed(&error, folder))?;
        Ok(Self { file: BufWriter::new(file), folder: folder.to_owned(), end: 0 })
    }

    /// Adds a block, and returns its place; places ascend.
    pub(in crate::query) fn push(&mut self, block: &[u8]) -> Result<u64> {
        let length = u32::try_from(block.len()).unwrap_or(u32::MAX).to_le_bytes();
        let written = self.file.write_all(&length).and_then(|()| self.file.write_all(block));
        written.map_err(|error| failed(&error, &self.folder))?;
        let place = self.end;
        self.end += (LENGTH + block.len()) as u64;
        Ok(place)
    }

    pub(in crate::query) fn finish(self) -> Result<Blocks> {
        let folder = self.folder;
        let file = self.file.into_inner().map_err(|error| failed(&error.into_error(), &folder))?;
        Ok(Blocks { file, folder })
    }
}

impl Blocks {
    /// Returns the block at a place.
    pub(in crate::query) fn read(&self, place: u64) -> Result<Vec<u8>> {
        self.block(place).map_err(|error| failed(&error, &self.folder))
    }

    fn block(&self, place: u64) -> io::Result<Vec<u8>> {
        let mut bytes = vec![0; FIRST];
        let read = self.file.read_at(&mut bytes, place)?;
        bytes.truncate(read);
        let length = bytes.first_chunk().ok_or(io::ErrorKind::UnexpectedEof)?;
        let length = usize::try_from(u32::from_le_bytes(*length)).map_err(io::Error::other)?;
        bytes.drain(..LENGTH);
        let read = bytes.len();
        bytes.resize(length, 0);
        if let Some(rest) = bytes.get_mut(read..).filter(|rest| !rest.is_empty()) {
            self.file.read_exact_at(rest, place + (LENGTH + read) as u64)?;
        }
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_of_any_length_are_read_in_any_order() {
        let mut writer = BlockWriter::new(&std::env::temp_dir()).unwrap();
        let blocks = [0, 1, FIRST - LENGTH, FIRST, 3 * FIRST, 7].map(|length| vec![length.to_le_bytes()[0]; length]);
        let places = blocks.clone().map(|block| writer.push(&block).unwrap());
        let file = writer.finish().unwrap();
        for (place, block) in places.into_iter().zip(blocks).rev() {
            assert_eq!(file.read(place).unwrap(), block);
        }
        assert!(file.read(1 << 20).is_err());
    }
}
