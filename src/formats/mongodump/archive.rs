//! An archive: all collections of a dump in one file.
//!
//! A magic number; a header; for each collection what is known of it; a mark.
//! Then segments, in any order and interleaved: which collection, documents, a
//! mark; and after the last of a collection, its end, with a checksum over its
//! documents, and a mark. All but the number and the marks is BSON.

use std::io::{self, BufRead, Write};

use bson::{Document, RawDocument, RawDocumentBuf, doc};

use super::checksum::Checksum;
use super::metadata::Metadata;
use super::stream::{Damage, Frame, Frames, MARK, damage};

/// The first bytes of an archive.
pub const MAGIC: [u8; 4] = 0x8199_E26D_u32.to_le_bytes();
/// The version of the format, and the server whose documents these could be.
const VERSIONS: (&str, &str) = ("0.1", "6.0.0");

/// What an archive says of a collection.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Archived {
    /// The database.
    pub database: String,
    /// The collection.
    pub collection: String,
    /// Its metadata, as in `COLL.metadata.json`.
    pub metadata: String,
}

impl Archived {
    /// Whether it is the oplog that `mongodump --oplog` adds: a collection of no database.
    #[must_use]
    pub fn is_oplog(&self) -> bool {
        self.database.is_empty() && self.collection == "oplog"
    }
}

/// An archive whose collections are known, and whose documents are not read yet.
pub struct Archive<R> {
    frames: Frames<R>,
    collections: Vec<Archived>,
}

impl<R: BufRead> Archive<R> {
    /// Reads which collections there are.
    ///
    /// # Errors
    /// Where it is not an archive, or damaged.
    pub fn open(mut input: R) -> Result<Self, Damage> {
        let mut magic = [0; 4];
        if input.read_exact(&mut magic).is_err() || magic != MAGIC {
            return Err(Damage { offset: 0, reason: "this is not an archive of mongodump".to_owned() });
        }
        let mut archive = Self { frames: Frames::new(input, 4), collections: Vec::new() };
        match archive.frames.read()? {
            Some(Frame::Document(..)) => {}
            _ => return Err(archive.damage("expected the header of an archive")),
        }
        loop {
            match archive.frames.read()? {
                Some(Frame::Mark) => return Ok(archive),
                Some(Frame::Document(offset, document)) => archive.collections.push(archived(offset, &document)?),
                None => return Err(archive.damage("the archive ends before its first collection; it is truncated")),
            }
        }
    }

    /// The collections, in the order of the archive.
    pub fn collections(&self) -> &[Archived] {
        &self.collections
    }

    /// The documents of one collection, each with the byte it starts at. Reads
    /// the archive to its end; after an error nothing more comes.
    pub fn documents(
        self,
        database: &str,
        collection: &str,
    ) -> impl Iterator<Item = Result<(u64, RawDocumentBuf), Damage>> {
        let wanted = (database.to_owned(), collection.to_owned());
        let mut segments =
            Segments { archive: self, wanted, inside: None, checksum: Checksum::default(), complete: false };
        let mut done = false;
        std::iter::from_fn(move || {
            if done {
                return None;
            }
            let read = segments.read().transpose();
            done = !matches!(read, Some(Ok(_)));
            read
        })
    }

    fn damage(&self, reason: impl Into<String>) -> Damage {
        Damage { offset: self.frames.offset(), reason: reason.into() }
    }
}

/// Walks over the segments and takes the documents of one collection.
struct Segments<R> {
    archive: Archive<R>,
    wanted: (String, String),
    /// Whether the segment we are in is one of the collection that is wanted.
    inside: Option<bool>,
    checksum: Checksum,
    complete: bool,
}

impl<R: BufRead> Segments<R> {
    fn read(&mut self) -> Result<Option<(u64, RawDocumentBuf)>, Damage> {
        loop {
            match (self.archive.frames.read()?, self.inside) {
                (None, None) if self.complete => return Ok(None),
                (None, _) => {
                    let (database, collection) = &self.wanted;
                    let reason = format!("the archive ends before the end of {database}.{collection}; it is truncated");
                    return Err(self.archive.damage(reason));
                }
                (Some(Frame::Mark), Some(_)) => self.inside = None,
                (Some(Frame::Mark), None) => return Err(self.archive.damage("expected the header of a collection")),
                (Some(Frame::Document(offset, header)), None) => self.enter(offset, &header)?,
                (Some(Frame::Document(offset, document)), Some(true)) => {
                    self.checksum.add(document.as_bytes());
                    return Ok(Some((offset, document)));
                }
                (Some(Frame::Document(..)), Some(false)) => {}
            }
        }
    }

    /// Begins a segment, or ends the collection.
    fn enter(&mut self, offset: u64, header: &RawDocument) -> Result<(), Damage> {
        let is_wanted =
            field(offset, header, "db")? == self.wanted.0 && field(offset, header, "collection")? == self.wanted.1;
        let ends = header.get_bool("EOF").unwrap_or(false);
        self.inside = Some(is_wanted && !ends);
        if is_wanted && ends {
            self.complete = true;
            if header.get_i64("CRC").is_ok_and(|stated| stated != self.checksum.value()) {
                let (database, collection) = &self.wanted;
                let reason = format!("the checksum over the documents of {database}.{collection} is wrong");
                return Err(Damage { offset, reason });
            }
        }
        Ok(())
    }
}

fn archived(offset: u64, document: &RawDocument) -> Result<Archived, Damage> {
    let text = |key| field(offset, document, key).map(str::to_owned);
    Ok(Archived { database: text("db")?, collection: text("collection")?, metadata: text("metadata")? })
}

fn field<'a>(offset: u64, document: &'a RawDocument, key: &str) -> Result<&'a str, Damage> {
    document.get_str(key).map_err(|error| Damage { offset, reason: format!("not of an archive: {}", damage(&error)) })
}

/// Writes an archive, one collection after the other.
pub struct ArchiveWriter<W> {
    out: W,
    checksum: Checksum,
    begun: bool,
}

impl<W: Write> ArchiveWriter<W> {
    /// Begins an archive of collections, each with its database.
    ///
    /// # Errors
    /// Where `out` cannot be written.
    pub fn new<'a>(out: W, collections: impl IntoIterator<Item = (&'a str, &'a Metadata)>) -> io::Result<Self> {
        let mut archive = Self { out, checksum: Checksum::default(), begun: false };
        archive.out.write_all(&MAGIC)?;
        archive.put(&doc! {
            "concurrent_collections": 1, "version": VERSIONS.0, "server_version": VERSIONS.1,
            "tool_version": env!("CARGO_PKG_VERSION"),
        })?;
        for (database, metadata) in collections {
            let collection = metadata.collection.clone().unwrap_or_default();
            archive.put(&doc! {
                "db": database, "collection": collection, "metadata": metadata.write(), "size": 0, "type": "collection",
            })?;
        }
        archive.mark()?;
        Ok(archive)
    }

    /// Writes the next document of a collection.
    ///
    /// # Errors
    /// Where `out` cannot be written.
    pub fn document(&mut self, database: &str, collection: &str, document: &RawDocument) -> io::Result<()> {
        if !self.begun {
            self.begun = true;
            self.put(&doc! { "db": database, "collection": collection, "EOF": false, "CRC": 0_i64 })?;
        }
        self.checksum.add(document.as_bytes());
        self.out.write_all(document.as_bytes())
    }

    /// Ends a collection; the next document is another's.
    ///
    /// # Errors
    /// Where `out` cannot be written.
    pub fn end(&mut self, database: &str, collection: &str) -> io::Result<()> {
        if std::mem::take(&mut self.begun) {
            self.mark()?;
        }
        let checksum = std::mem::take(&mut self.checksum).value();
        self.put(&doc! { "db": database, "collection": collection, "EOF": true, "CRC": checksum })?;
        self.mark()
    }

    /// Gives back what was written to.
    pub fn finish(self) -> W {
        self.out
    }

    fn put(&mut self, document: &Document) -> io::Result<()> {
        let document = RawDocumentBuf::try_from(document).map_err(io::Error::other)?;
        self.out.write_all(document.as_bytes())
    }

    fn mark(&mut self) -> io::Result<()> {
        self.out.write_all(&MARK.to_le_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn raw(document: &Document) -> Vec<u8> {
        RawDocumentBuf::try_from(document).unwrap().into_bytes()
    }

    fn written() -> Vec<u8> {
        let collections = [Metadata::plain("one"), Metadata::plain("none")];
        let mut archive = ArchiveWriter::new(Vec::new(), collections.iter().map(|metadata| ("a", metadata))).unwrap();
        for n in 0..3 {
            archive.document("a", "one", &RawDocumentBuf::try_from(&doc! { "_id": n }).unwrap()).unwrap();
        }
        archive.end("a", "one").unwrap();
        archive.end("a", "none").unwrap();
        archive.finish()
    }

    fn ids(bytes: &[u8], collection: &str) -> Result<Vec<i32>, Damage> {
        let documents = Archive::open(bytes)?.documents("a", collection);
        documents.map(|document| document.map(|(_, document)| document.get_i32("_id").unwrap())).collect()
    }

    #[test]
    fn what_is_written_is_read() {
        let bytes = written();
        assert_eq!(Archive::open(bytes.as_slice()).unwrap().collections().len(), 2);
        assert_eq!(ids(&bytes, "one").unwrap(), [0, 1, 2]);
        assert_eq!(ids(&bytes, "none").unwrap(), [0; 0]);
        assert!(ids(&bytes, "other").is_err());
    }

    #[test]
    fn segments_may_be_interleaved() {
        let header =
            |collection, end, crc: i64| raw(&doc! { "db": "a", "collection": collection, "EOF": end, "CRC": crc });
        let mark = MARK.to_le_bytes().to_vec();
        let mut checksum = Checksum::default();
        [1, 3].iter().for_each(|id| checksum.add(&raw(&doc! { "_id": id })));
        let bytes = [
            MAGIC.to_vec(),
            raw(&doc! { "version": "0.1" }),
            mark.clone(),
            header("x", false, 0),
            raw(&doc! { "_id": 1 }),
            mark.clone(),
            header("y", false, 0),
            raw(&doc! { "_id": 2 }),
            mark.clone(),
            header("x", false, 0),
            raw(&doc! { "_id": 3 }),
            mark.clone(),
            header("x", true, checksum.value()),
            mark.clone(),
            header("y", true, 7),
            mark,
        ]
        .concat();
        assert_eq!(ids(&bytes, "x").unwrap(), [1, 3]);
        assert!(ids(&bytes, "y").unwrap_err().reason.contains("checksum"));
    }

    #[test]
    fn an_archive_cut_or_changed_anywhere_is_noticed() {
        let bytes = written();
        let last = bytes.len() - raw(&doc! { "db": "a", "collection": "none", "EOF": true, "CRC": 0_i64 }).len() - 4;
        for length in 0..last {
            assert!(ids(bytes.get(..length).unwrap(), "one").is_err(), "{length}");
        }
        let mut changed = bytes.clone();
        let at = bytes.windows(4).position(|window| window == b"_id\0").unwrap() + 4;
        *changed.get_mut(at).unwrap() = 9;
        assert!(ids(&changed, "one").unwrap_err().reason.contains("checksum"));
    }
}
