//! Reading dumps of every format: their namespaces, and the documents of each, which can be
//! read several times.
//!
//! A world file, a folder as `mongodump` writes it, the folder of one database
//! in it, one `.bson` file, or an archive; each may be packed with gzip. The format is
//! recognised by the content, not by the name.

mod error;
mod file;
mod log;

pub use error::ReadError;
pub use log::Log;

use std::io::{BufRead, Read as _};
use std::path::{Path, PathBuf};
use std::rc::Rc;

use bson::{Document, RawDocumentBuf};

use super::world_file::{Identities, WorldError, WorldFile};
use crate::formats::Source;
use crate::formats::mongodump::{self, Archive, Archived, CollectionKind, Damage, MAGIC, Metadata, decode_document};
use crate::input::decode;
use crate::query::{Collation, QueryError, Validator, key};
use crate::store::{Index, Namespace, Validation, document, metadata};
use file::{entries, is_oplog, metadata_of, namespace, read_metadata, stem, unpacked};

/// The bytes with which a file of SQLite begins (its documentation, "Database File Format", section 1.3.1).
const DATABASE: &str = "SQLite format 3\0";

/// How many bytes are examined to recognise a text.
const LOOK: usize = 512;

/// How many bytes of a text that is not a world file are examined for what it is.
const LONGEST_START: u64 = 64 << 10;

/// The documents of a dump, each checked.
pub type Checked<'a> = Box<dyn Iterator<Item = Result<Document, ReadError>> + 'a>;

/// A dump that can be read.
#[derive(Debug)]
pub struct Dump {
    /// Its collections.
    pub parts: Vec<Part>,
    /// What changed while it was written, where it has that.
    pub log: Option<Log>,
    /// The file or folder.
    pub path: PathBuf,
    /// What of it is not taken, and why.
    notes: Vec<String>,
    /// The server's own collections, which are only taken under another name.
    own: Vec<Part>,
}

/// One collection of a dump.
#[derive(Debug)]
pub struct Part {
    /// Where its documents belong.
    pub namespace: Namespace,
    /// Its indexes, but the one on `_id`; `None` where the dump has no indexes.
    pub indexes: Option<Vec<Index>>,
    /// How its strings compare, where that is not byte by byte; `None` where the dump does not say so.
    pub collation: Option<Option<Collation>>,
    /// Which documents it takes; `None` where the dump does not say so.
    pub validation: Option<Validation>,
    content: Content,
    /// Whether documents without an `_id` get one.
    adds_ids: bool,
}

#[derive(Debug)]
enum Content {
    /// Its namespace in a world file.
    WorldFile(Rc<WorldFile>, Namespace, u64),
    File(PathBuf),
    /// Its database and name in an archive.
    Archived(PathBuf, String, String),
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
        if path.exists() && !path.is_file() {
            return Self::stream(&path.display().to_string(), unpacked(path)?);
        }
        let mut file = unpacked(path)?;
        let head = file.fill_buf().map_err(|source| ReadError::Read { path: path.to_owned(), source })?;
        // The fourth byte of a BSON document below 2^25 bytes is 0 or 1, which no text has.
        if head.get(3).is_some_and(|byte| *byte <= 1) || (head.is_empty() && stem(path).is_some()) {
            let mut dump = Self::empty(path);
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
        if start(path).is_some_and(|head| head.starts_with(DATABASE)) {
            let shown = path.display();
            let reason = format!("it is a memory, which file:{shown} names, or another SQLite database");
            return Err(ReadError::Name { path: path.to_owned(), reason });
        }
        let hint = || start(path).and_then(|head| other_reader(&head, &path.display().to_string()));
        let world = WorldFile::open(path).map_err(WorldError::from);
        Ok(Self::of(path, world.map_err(|error| error.hinted(hint()))?))
    }

    /// Reads a world file of a pipe, which can be read only once, into memory; `name` is for messages.
    ///
    /// # Errors
    /// Where it cannot be read, or is not a world file: the other dumps are read several times.
    pub fn stream(name: &str, mut stream: impl BufRead) -> Result<Self, ReadError> {
        let mut bytes = Vec::new();
        let read = stream.read_to_end(&mut bytes);
        read.map_err(|source| ReadError::Read { path: name.into(), source })?;
        if bytes.get(3).is_some_and(|byte| *byte <= 1) || bytes.starts_with(&MAGIC) {
            let reason = "a dump of mongodump is read several times, which a pipe cannot be; write it to a file first";
            return Err(ReadError::Name { path: name.into(), reason: reason.to_owned() });
        }
        let wrong = |source| WorldError::Text { name: name.to_owned(), source };
        Self::world(&decode(name, bytes).map_err(wrong)?)
    }

    /// Reads a world file that is in memory.
    ///
    /// # Errors
    /// Where the text is not one.
    pub fn world(source: &Source) -> Result<Self, ReadError> {
        let hint = || other_reader(source.text(), Some(source.name()).filter(|name| *name != "<stdin>").unwrap_or("-"));
        let wrong = |error| WorldError::Text { name: source.name().to_owned(), source: error }.hinted(hint());
        Ok(Self::of(Path::new(source.name()), WorldFile::parse(source).map_err(wrong)?))
    }

    fn empty(path: &Path) -> Self {
        Self { parts: Vec::new(), log: None, path: path.to_owned(), notes: Vec::new(), own: Vec::new() }
    }

    fn of(path: &Path, world: WorldFile) -> Self {
        let world = Rc::new(world);
        let part = |(namespace, count): (&Namespace, u64)| Part {
            collation: None,
            validation: None,
            namespace: namespace.clone(),
            indexes: None,
            content: Content::WorldFile(Rc::clone(&world), namespace.clone(), count),
            adds_ids: true,
        };
        Self { parts: world.namespaces().map(part).collect(), ..Self::empty(path) }
    }

    /// Which collections an archive has.
    fn archive(path: &Path, file: Box<dyn BufRead>) -> Result<Self, ReadError> {
        let refuse = |reason: String| ReadError::Name { path: path.to_owned(), reason };
        let archive = Archive::open(file).map_err(|damage| ReadError::Damaged { path: path.to_owned(), damage })?;
        let mut dump = Self::empty(path);
        for archived @ Archived { database, collection, metadata } in archive.collections() {
            if archived.is_oplog() {
                dump.log = Some(Log::archived(path, database, collection));
                continue;
            }
            let name = format!("{database}.{collection}");
            let source = Source::new(format!("{} ({name})", path.display()), metadata.as_str());
            let metadata =
                Metadata::parse(&source).map_err(|source| ReadError::Metadata { collection: name.clone(), source })?;
            if let CollectionKind::Other(kind) = metadata.kind {
                dump.notes.push(format!("{name} is a {kind} and is left out"));
                continue;
            }
            let namespace = match collection.starts_with("system.") {
                true => Namespace { database: database.clone(), collection: collection.clone() },
                false => Namespace::parse(&name).map_err(|error| refuse(error.to_string()))?,
            };
            let content = Content::Archived(path.to_owned(), database.clone(), collection.clone());
            dump.push(namespace, content, Some(&metadata));
        }
        Ok(dump)
    }

    /// A folder of databases, or of one.
    fn folder(path: &Path) -> Result<Self, ReadError> {
        let mut dump = Self::empty(path);
        for entry in entries(path)? {
            let inside = if entry.is_dir() { entries(&entry)? } else { vec![entry] };
            for file in inside {
                dump.look_at(&file)?;
            }
        }
        if dump.parts.is_empty() && dump.own.is_empty() && dump.log.is_none() {
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
        if stem(path).is_some() {
            self.add(path)?;
        } else if (name.ends_with(".metadata.json") || name.ends_with(".metadata.json.gz"))
            && let Some(Metadata { kind: CollectionKind::Other(kind), .. }) = read_metadata(path)?
        {
            self.notes.push(format!("{} describes a {kind} and is left out", path.display()));
        }
        Ok(())
    }

    fn add(&mut self, path: &Path) -> Result<(), ReadError> {
        let metadata = metadata_of(path)?;
        if is_oplog(path, metadata.as_ref())? {
            self.log = Some(Log::file(path));
            return Ok(());
        }
        let namespace = namespace(path, metadata.as_ref())?;
        self.push(namespace, Content::File(path.to_owned()), metadata.as_ref());
        Ok(())
    }

    fn push(&mut self, namespace: Namespace, content: Content, metadata: Option<&Metadata>) {
        let is_own = namespace.collection.starts_with("system.");
        let mut indexes = metadata.map(|_| Vec::new());
        for definition in metadata.iter().filter(|_| !is_own).flat_map(|metadata| &metadata.indexes) {
            match (Index::parse(definition), &mut indexes) {
                (Ok(index), Some(indexes)) => indexes.push(index),
                (read, _) => {
                    let why = read.err().map(|error| error.message).unwrap_or_default();
                    self.notes.push(format!("an index of {namespace} is not restored: {why}"));
                }
            }
        }
        let collation =
            metadata.map(|metadata| match metadata.options.get_document("collation").ok().map(Collation::parse) {
                None => None,
                Some(Ok(collation)) => Some(collation).filter(|collation| !collation.is_simple()),
                Some(Err(error)) => {
                    self.notes.push(format!("the collation of {namespace} is not restored: {}", error.message));
                    None
                }
            });
        let validation = metadata.map(|metadata| {
            let read = Validation::read(&metadata.options).and_then(|validation| {
                validation.validator.as_ref().map(Validator::parse).transpose()?;
                Ok(validation)
            });
            read.unwrap_or_else(|error| {
                self.notes.push(format!("the validator of {namespace} is not restored: {}", error.message));
                Validation::default()
            })
        });
        let parts = if is_own { &mut self.own } else { &mut self.parts };
        parts.push(Part { namespace, indexes, collation, validation, content, adds_ids: false });
    }

    /// Sends the one collection of the dump to another namespace. One of the server's own is the one where there is
    /// no other.
    ///
    /// # Errors
    /// Where there are more of them: their names.
    pub fn into(mut self, namespace: &Namespace) -> Result<Self, Vec<Namespace>> {
        if self.parts.is_empty() {
            self.parts = std::mem::take(&mut self.own);
        }
        match self.parts.as_mut_slice() {
            [part] => {
                part.namespace = namespace.clone();
                Ok(self)
            }
            parts => Err(parts.iter().map(|part| part.namespace.clone()).collect()),
        }
    }

    /// The same dump, whose documents without an `_id` get one: the same each time it is read.
    #[must_use]
    pub fn with_ids(mut self) -> Self {
        self.parts.iter_mut().for_each(|part| part.adds_ids = true);
        self
    }

    /// What of it is not taken, and why.
    pub fn notes(&self) -> impl Iterator<Item = String> {
        let own = self.own.iter().map(|part| format!("{} is the server's own and is left out", part.name()));
        self.notes.iter().cloned().chain(own)
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

    /// Refuses a dump of nothing but what is left out; `replays` says that its oplog is not.
    ///
    /// # Errors
    /// Where it has only an oplog, or only collections of the server.
    pub fn check_content(&self, replays: bool) -> Result<(), ReadError> {
        let refuse = |reason: &str| Err(ReadError::Name { path: self.path.clone(), reason: reason.to_owned() });
        match (&self.log, self.parts.is_empty()) {
            (None, _) if replays => refuse("there is no oplog to replay; `mongodump --oplog` writes one"),
            (Some(_), true) if !replays => refuse("there is only an oplog; --oplog-replay applies it to the memory"),
            (None, true) if !self.own.is_empty() => {
                refuse("there are only the server's own collections; --into NS restores one of them under another name")
            }
            _ => Ok(()),
        }
    }
}

impl Part {
    /// Whether the documents are in the order of their `_id`s, where that is known without decoding them.
    #[must_use]
    pub fn is_ordered(&self) -> bool {
        let Content::File(path) = &self.content else {
            return match &self.content {
                Content::WorldFile(world, namespace, _) => world.is_ordered(namespace),
                _ => false,
            };
        };
        let Ok(file) = unpacked(path) else { return false };
        let mut last = Vec::new();
        for document in mongodump::Documents::new(file) {
            // What is damaged is reported where it is read.
            let Ok((_, document)) = document else { return false };
            let Ok(Some(id)) = document.get("_id") else { return false };
            let key = key::encode(id);
            if key < last {
                return false;
            }
            last = key;
        }
        true
    }

    /// The documents from the beginning, each well-formed and such that it can be stored.
    ///
    /// What a computable made is left out.
    ///
    /// # Errors
    /// Where the file cannot be opened.
    pub fn documents(&self) -> Result<Checked<'_>, ReadError> {
        let documents: Checked<'_> = match &self.content {
            Content::WorldFile(world, namespace, _) => {
                let documents = world.documents(namespace).map_err(WorldError::from)?;
                Box::new(documents.map(|read| read.map_err(|error| WorldError::from(error).into())))
            }
            Content::File(path) => self.checked(path, mongodump::Documents::new(unpacked(path)?)),
            Content::Archived(path, database, collection) => {
                let archive = Archive::open(unpacked(path)?)
                    .map_err(|damage| ReadError::Damaged { path: path.clone(), damage })?;
                self.checked(path, archive.documents(database, collection))
            }
        };
        Ok(Box::new(documents.filter(|read| !read.as_ref().is_ok_and(metadata::says_computed))))
    }

    /// The documents, where each is well-formed and can be stored.
    fn checked<'a>(
        &self,
        path: &'a Path,
        documents: impl Iterator<Item = Result<(u64, RawDocumentBuf), Damage>> + 'a,
    ) -> Checked<'a> {
        let mut identities = self.adds_ids.then(|| Identities::new(&self.namespace));
        let mut check = move |(offset, document): (u64, RawDocumentBuf)| {
            let refused = |error: QueryError| Damage { offset, reason: error.message };
            let has_id = document.get("_id").is_ok_and(|id| id.is_some());
            let lacks_id =
                |document| document::check_shape(document).is_ok() && matches!(document.get("_id"), Ok(None));
            match &mut identities {
                Some(identities) if !has_id => {
                    document::check_shape(&document).map_err(refused)?;
                    let document = identities.give(decode_document(offset, &document)?).map_err(refused)?;
                    let id = document.get("_id").cloned().unwrap_or(bson::Bson::Null);
                    Ok(document::with_id_first(document, &id))
                }
                _ => {
                    document::vet(&document).map_err(|error| match lacks_id(&document) {
                        false => refused(error),
                        true => Damage { offset, reason: format!("{}; --add-ids gives it one", error.message) },
                    })?;
                    decode_document(offset, &document)
                }
            }
        };
        let damaged = |damage| ReadError::Damaged { path: path.to_owned(), damage };
        Box::new(documents.map(move |read| read.and_then(&mut check).map_err(damaged)))
    }

    /// What messages call it: its file, or its name in an archive.
    fn name(&self) -> String {
        match &self.content {
            Content::File(path) => path.display().to_string(),
            _ => self.namespace.to_string(),
        }
    }
}

/// The start of a file that is a text; comments may stand in front of what it is.
fn start(path: &Path) -> Option<String> {
    let mut head = Vec::new();
    unpacked(path).ok()?.take(LONGEST_START).read_to_end(&mut head).ok()?;
    Some(String::from_utf8_lossy(&head).into_owned())
}

/// The command for a text that is not a world file, by how it begins: facts, or documents.
fn other_reader(head: &str, file: &str) -> Option<String> {
    let head = head.trim_start_matches('\u{FEFF}').trim_start();
    let first = head.strip_prefix('{').and_then(|rest| rest.split_once(':'));
    // Comments may stand in front of PDDL.
    let code = head.lines().map(str::trim_start).find(|line| !line.is_empty() && !line.starts_with(';'));
    let list = code.and_then(|code| code.strip_prefix('(')).unwrap_or_default().to_ascii_lowercase();
    if let Some(defined) = list.trim_start().strip_prefix("define") {
        let is_problem = defined.trim_start_matches(['(', ' ', '\t']).starts_with("problem");
        return Some(match is_problem {
            true => {
                format!("`rmem import-problem` stores a problem's facts, `rmem plan --problem {file}` plans for it")
            }
            false => format!("`rmem validate` checks PDDL, `rmem plan --domain {file}` plans with a domain"),
        });
    }
    if head.starts_with(['(', ';']) {
        return Some(format!("`rmem clips import {file}` reads facts of CLIPS"));
    }
    // The keys of a world file are namespaces, and its values arrays.
    let is_field = |(key, value): (&str, &str)| !key.contains('.') && !value.trim_start().starts_with('[');
    let is_document = head.starts_with('[') || first.is_some_and(is_field);
    is_document.then(|| format!("`rmem insert NS --file {file}` reads documents, such as JSON lines"))
}
