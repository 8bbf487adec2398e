//! gzip around a file: written on request, recognised by content when read.

use std::io::{self, BufRead, BufReader, Read, Write};

use flate2::Compression;
use flate2::bufread::MultiGzDecoder;
use flate2::write::GzEncoder;

/// How many bytes are read at once.
const BLOCK: usize = 128 << 10;

/// Reads a file, unpacked where it is packed.
///
/// # Errors
/// Where the file cannot be read.
pub fn unpack<'a>(file: impl Read + 'a) -> io::Result<Box<dyn BufRead + 'a>> {
    let mut head = Vec::new();
    let mut file = file;
    file.by_ref().take(10).read_to_end(&mut head)?;
    let packed = is_packed(&head);
    let whole = BufReader::with_capacity(BLOCK, io::Cursor::new(head).chain(file));
    Ok(match packed {
        true => Box::new(BufReader::with_capacity(BLOCK, MultiGzDecoder::new(whole))),
        false => Box::new(whole),
    })
}

/// Whether these are the first bytes of gzip. A BSON document of 559 903 bytes
/// starts so too, but has its `_id` behind.
fn is_packed(head: &[u8]) -> bool {
    head.starts_with(&[0x1F, 0x8B, 8]) && head.get(5..9) != Some(b"_id\0")
}

/// Writes a file, packed or not.
pub enum Packer<W: Write> {
    /// As it is.
    Plain(W),
    /// With gzip.
    Packed(GzEncoder<W>),
}

impl<W: Write> Packer<W> {
    /// A writer to `file`.
    pub fn new(file: W, gzip: bool) -> Self {
        match gzip {
            true => Self::Packed(GzEncoder::new(file, Compression::default())),
            false => Self::Plain(file),
        }
    }

    /// Writes what is left, and gives the file back.
    ///
    /// # Errors
    /// Where the file cannot be written.
    pub fn finish(self) -> io::Result<W> {
        match self {
            Self::Plain(file) => Ok(file),
            Self::Packed(encoder) => encoder.finish(),
        }
    }
}

impl<W: Write> Write for Packer<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Plain(file) => file.write(bytes),
            Self::Packed(encoder) => encoder.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Plain(file) => file.flush(),
            Self::Packed(encoder) => encoder.flush(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn round(bytes: &[u8], gzip: bool) -> Vec<u8> {
        let mut packer = Packer::new(Vec::new(), gzip);
        packer.write_all(bytes).unwrap();
        let packed = packer.finish().unwrap();
        assert_eq!(is_packed(&packed), gzip);
        let mut read = Vec::new();
        unpack(packed.as_slice()).unwrap().read_to_end(&mut read).unwrap();
        read
    }

    #[test]
    fn packed_or_not_the_bytes_come_back() {
        for bytes in [b"".as_slice(), b"x", &[7; 300_000]] {
            assert_eq!(round(bytes, true), bytes);
            assert_eq!(round(bytes, false), bytes);
        }
    }

    #[test]
    fn a_document_whose_length_looks_packed_is_not() {
        let size: i32 = 559_903;
        let document = bson::doc! { "_id": 1, "a": "x".repeat(559_903 - 22) };
        let bytes = bson::RawDocumentBuf::try_from(&document).unwrap().into_bytes();
        assert_eq!(bytes.get(..4), Some(size.to_le_bytes().as_slice()), "{}", bytes.len());
        assert_eq!(round(&bytes, false), bytes);
    }
}
