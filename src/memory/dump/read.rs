//! Reading dumps of every format: their namespaces, and the documents of each, which can be
//! read several times.
//!
//! A world file, a folder as `mongodump` writes it, the folder of one database
//! in it, one `.bson` file, or an archive; each may be packed with gzip. The format is
//! recognised by the content, not by the name.

use std::fs::{self, File};
use std::io::{BufRead as _, Read as _};
use std::path::{Path, PathBuf};
use std::rc::Rc;

use bson::{Document, RawDocumentBuf};

use super::world_file::{WorldError, WorldFile};
use crate::fault::{AtFault, Fault};
use crate::formats::Source;
use crate::formats::mongodump::{self, Archive, Archived, CollectionKind, Damage, MAGIC, Metadata, decode_document};
use crate::store::{Index, Namespace, document};

/// How many bytes are examined to recognise a text.
const LOOK: usize = 512;

/// The documents of a dump, each checked.
pub type Checked<'a> = Box<dyn Iterator<Item = Result<Document, ReadError>> + 'a>;

/// A dump that can be read.
#[derive(Debug)]
pub struct Dump {
    /// Its collections.
    pub parts: Vec<Part>,
    /// What of it is not taken, and why.
    pub notes: Vec<String>,
}

/// One collection of a dump.
#[derive(Debug)]
pub struct Part {
    /// Where its documents belong.
    pub namespace: Namespace,
    /// Its indexes, but the one on `_id`; `None` where the dump has no indexes.
    pub indexes: Option<Vec<Index>>,
    content: Content,
}

#[derive(Debug)]
enum Content {
    /// Its namespace in a world file.
    WorldFile(Rc<WorldFile>, Namespace, u64),
    File(PathBuf),
    /// Its database and name in an archive.
    Archived(PathBuf, String, String),
}

/// Why a dump cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// A file or folder cannot be read.
    #[error("cannot read {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A file is truncated or damaged, or a document in it cannot be stored.
    #[error("{}: {damage}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Where, and what is wrong.
        damage: Damage,
    },
    /// A file is not what it should be.
    #[error(transparent)]
    Text(#[from] WorldError),
    /// A file's name does not give a namespace, or there is nothing to be read.
    #[error("{}: {reason}", path.display())]
    Name {
        /// The file or folder.
        path: PathBuf,
        /// What is wrong, and what to do.
        reason: String,
    },
}

impl AtFault for ReadError {
    fn fault(&self) -> Fault {
        match self {
            Self::Read { .. } | Self::Damaged { .. } | Self::Name { .. } => Fault::Input,
            Self::Text(error) => error.fault(),
        }
    }
}

impl Dump {
    /// Looks into a file or folder. Documents in `.bson` files are not read yet.
    ///
    /// # Errors
    /// Where it cannot be read, is no dump, or names a namespace that cannot be.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        if path.is_dir() {
            return Self::folder(path);
        }
        let mut file = unpacked(path)?;
        let head = file.fill_buf().map_err(|source| ReadError::Read { path: path.to_owned(), source })?;
        // The fourth byte of a BSON document below 2^25 bytes is 0 or 1, which no text has.
        if head.get(3).is_some_and(|byte| *byte <= 1) || (head.is_empty() && stem(path).is_some()) {
            let mut dump = Self { parts: Vec::new(), notes: Vec::new() };
            dump.add(path)?;
            return Ok(dump);
        }
        if head.starts_with(&MAGIC) {
            return Self::archive(path, file);
        }
        let is_text = head.iter().take(LOOK).all(|byte| *byte >= b' ' || byte.is_ascii_whitespace());
        if !is_text {
            let reason = "expected a world file or a dump, found neither".to_owned();
            return Err(ReadError::Name { path: path.to_owned(), reason });
        }
        Ok(Self::of(WorldFile::open(path).map_err(WorldError::from)?))
    }

    /// Reads a world file that is in memory.
    ///
    /// # Errors
    /// Where the text is not one.
    pub fn world(source: &Source) -> Result<Self, ReadError> {
        let wrong = |error| WorldError::Text { name: source.name().to_owned(), source: error };
        Ok(Self::of(WorldFile::parse(source).map_err(wrong)?))
    }

    fn of(world: WorldFile) -> Self {
        let world = Rc::new(world);
        let part = |(namespace, count): (&Namespace, u64)| Part {
            namespace: namespace.clone(),
            indexes: None,
            content: Content::WorldFile(Rc::clone(&world), namespace.clone(), count),
        };
        Self { parts: world.namespaces().map(part).collect(), notes: Vec::new() }
    }

    /// Which collections an archive has.
    fn archive(path: &Path, file: Box<dyn std::io::BufRead>) -> Result<Self, ReadError> {
        let refuse = |reason: String| ReadError::Name { path: path.to_owned(), reason };
        let archive = Archive::open(file).map_err(|damage| ReadError::Damaged { path: path.to_owned(), damage })?;
        let mut dump = Self { parts: Vec::new(), notes: Vec::new() };
        for Archived { database, collection, metadata } in archive.collections() {
            let name = format!("{database}.{collection}");
            let source = Source::new(format!("{} ({name})", path.display()), metadata.as_str());
            let metadata = Metadata::parse(&source).map_err(|error| refuse(error.to_string()))?;
            if collection.starts_with("system.") {
                dump.notes.push(format!("{name} is the server's own and is left out"));
            } else if let CollectionKind::Other(kind) = metadata.kind {
                dump.notes.push(format!("{name} is a {kind} and is left out"));
            } else {
                let namespace = Namespace::parse(&name).map_err(|error| refuse(error.to_string()))?;
                let content = Content::Archived(path.to_owned(), database.clone(), collection.clone());
                dump.push(namespace, content, Some(&metadata));
            }
        }
        Ok(dump)
    }

    /// A folder of databases, or of one.
    fn folder(path: &Path) -> Result<Self, ReadError> {
        let mut dump = Self { parts: Vec::new(), notes: Vec::new() };
        for entry in entries(path)? {
            let inside = if entry.is_dir() { entries(&entry)? } else { vec![entry] };
            for file in inside {
                dump.look_at(&file)?;
            }
        }
        if dump.parts.is_empty() {
            return Err(ReadError::Name {
                path: path.to_owned(),
                reason: "there is nothing to restore; expected DATABASE/COLLECTION.bson, as mongodump writes it"
                    .to_owned(),
            });
        }
        Ok(dump)
    }

    /// Takes a file of a folder, where it is one of a collection.
    fn look_at(&mut self, path: &Path) -> Result<(), ReadError> {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if stem(path).is_some_and(|stem| stem.starts_with("system.")) {
            self.notes.push(format!("{} is the server's own and is left out", path.display()));
        } else if stem(path).is_some() {
            self.add(path)?;
        } else if name.ends_with(".metadata.json") || name.ends_with(".metadata.json.gz") {
            let metadata = read_metadata(path)?;
            if let CollectionKind::Other(kind) = metadata.kind {
                self.notes.push(format!("{} describes a {kind} and is left out", path.display()));
            }
        }
        Ok(())
    }

    fn add(&mut self, path: &Path) -> Result<(), ReadError> {
        let metadata = metadata_of(path)?;
        let namespace = namespace(path, metadata.as_ref())?;
        self.push(namespace, Content::File(path.to_owned()), metadata.as_ref());
        Ok(())
    }

    fn push(&mut self, namespace: Namespace, content: Content, metadata: Option<&Metadata>) {
        let mut indexes = metadata.map(|_| Vec::new());
        for definition in metadata.iter().flat_map(|metadata| &metadata.indexes) {
            match (Index::parse(definition), &mut indexes) {
                (Ok(index), Some(indexes)) => indexes.push(index),
                (read, _) => {
                    let why = read.err().map(|error| error.message).unwrap_or_default();
                    self.notes.push(format!("an index of {namespace} is not restored: {why}"));
                }
            }
        }
        self.parts.push(Part { namespace, indexes, content });
    }

    /// Sends the one collection of the dump to another namespace.
    ///
    /// # Errors
    /// Where there are more of them: their names.
    pub fn into(mut self, namespace: &Namespace) -> Result<Self, Vec<Namespace>> {
        match self.parts.as_mut_slice() {
            [part] => {
                part.namespace = namespace.clone();
                Ok(self)
            }
            parts => Err(parts.iter().map(|part| part.namespace.clone()).collect()),
        }
    }

    /// Reads everything through; returns how many documents each collection has.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn verify(&self) -> Result<Vec<u64>, ReadError> {
        self.parts
            .iter()
            .map(|part| match &part.content {
                // It was read through when it was opened.
                Content::WorldFile(_, _, count) => Ok(*count),
                _ => part.documents()?.try_fold(0, |count, document| document.map(|_| count + 1)),
            })
            .collect()
    }
}

impl Part {
    /// The documents from the beginning, each well-formed and such that it can be stored.
    ///
    /// # Errors
    /// Where the file cannot be opened.
    pub fn documents(&self) -> Result<Checked<'_>, ReadError> {
        match &self.content {
            Content::WorldFile(world, namespace, _) => {
                let documents = world.documents(namespace).map_err(WorldError::from)?;
                Ok(Box::new(documents.map(|read| read.map_err(|error| WorldError::from(error).into()))))
            }
            Content::File(path) => Ok(checked(path, mongodump::Documents::new(unpacked(path)?))),
            Content::Archived(path, database, collection) => {
                let archive = Archive::open(unpacked(path)?)
                    .map_err(|damage| ReadError::Damaged { path: path.clone(), damage })?;
                Ok(checked(path, archive.documents(database, collection)))
            }
        }
    }
}

/// The documents, where each is well-formed and can be stored.
fn checked<'a>(
    path: &'a Path,
    documents: impl Iterator<Item = Result<(u64, RawDocumentBuf), Damage>> + 'a,
) -> Checked<'a> {
    let check = |(offset, document): (u64, RawDocumentBuf)| {
        let refused = |error: crate::query::QueryError| Damage { offset, reason: error.message };
        document::vet(&document).map_err(refused)?;
        decode_document(offset, &document)
    };
    let damaged = |damage| ReadError::Damaged { path: path.to_owned(), damage };
    Box::new(documents.map(move |read| read.and_then(check).map_err(damaged)))
}

fn unpacked(path: &Path) -> Result<Box<dyn std::io::BufRead>, ReadError> {
    File::open(path).and_then(mongodump::unpack).map_err(|source| ReadError::Read { path: path.to_owned(), source })
}

/// What is in a folder, sorted.
fn entries(folder: &Path) -> Result<Vec<PathBuf>, ReadError> {
    let read = || fs::read_dir(folder)?.map(|entry| entry.map(|entry| entry.path())).collect::<Result<Vec<_>, _>>();
    let mut entries = read().map_err(|source| ReadError::Read { path: folder.to_owned(), source })?;
    entries.sort();
    Ok(entries)
}

/// The name of a `.bson` file without its extension.
fn stem(path: &Path) -> Option<&str> {
    let name = path.file_name()?.to_str()?;
    name.strip_suffix(".gz").unwrap_or(name).strip_suffix(".bson")
}

/// The metadata beside a `.bson` file, where it is there.
fn metadata_of(path: &Path) -> Result<Option<Metadata>, ReadError> {
    let Some(stem) = stem(path) else { return Ok(None) };
    let candidates =
        ["metadata.json", "metadata.json.gz"].map(|extension| path.with_file_name(format!("{stem}.{extension}")));
    candidates.iter().find(|path| path.is_file()).map(|path| read_metadata(path)).transpose()
}

fn read_metadata(path: &Path) -> Result<Metadata, ReadError> {
    let mut text = String::new();
    unpacked(path)?.read_to_string(&mut text).map_err(|source| ReadError::Read { path: path.to_owned(), source })?;
    let source = Source::new(path.display().to_string(), text);
    Metadata::parse(&source).map_err(|error| ReadError::Name { path: path.to_owned(), reason: error.to_string() })
}

/// Where the documents of a `.bson` file belong: its folder is the database.
fn namespace(path: &Path, metadata: Option<&Metadata>) -> Result<Namespace, ReadError> {
    let refuse = |reason: String| ReadError::Name { path: path.to_owned(), reason };
    let whole = fs::canonicalize(path).map_err(|source| ReadError::Read { path: path.to_owned(), source })?;
    let database = whole.parent().and_then(Path::file_name).and_then(|name| name.to_str()).unwrap_or_default();
    let named = metadata.and_then(|metadata| metadata.collection.clone());
    let collection = match named {
        Some(collection) => collection,
        None => stem(path).and_then(mongodump::decode).unwrap_or_else(|| "documents".to_owned()),
    };
    if database.contains('.') {
        return Err(refuse(format!(
            "the folder `{database}` cannot be a database's name, since it has a dot; rename it"
        )));
    }
    Namespace::parse(&format!("{database}.{collection}"))
        .map_err(|error| refuse(format!("{error}; the file's folder names the database, the file the collection")))
}
