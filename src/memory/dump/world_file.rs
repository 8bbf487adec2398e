//! World files: a memory as a text that is read, compared and committed.
//!
//! One Extended JSON object, namespaces as keys in order, arrays of documents
//! as values, one document per line, sorted by `_id`: the same content gives
//! the same bytes. When documents were stored and changed is left out, since
//! it says nothing about the world; `persistent` and `decay_time` stay.
//!
//! Loading puts documents into a memory. One with an `_id` takes the place of
//! the document that has it. One without gets an `_id` that follows from its
//! namespace and content (and from which of several equal documents it is), so
//! that loading the same file again changes nothing. An edited document
//! without `_id` is another document: the earlier one stays.
//!
//! Files may be larger than memory: documents are written as they are read from
//! the memory, and read several times instead of being kept.

use std::collections::HashMap;
use std::collections::hash_map::DefaultHasher;
use std::fmt;
use std::fs::File;
use std::hash::{Hash as _, Hasher as _};
use std::io::{self, BufRead, Cursor, Write};
use std::path::{Path, PathBuf};

use bson::oid::ObjectId;
use bson::{Bson, Document, RawDocumentBuf, doc};
use sha2::{Digest as _, Sha256};

use super::batch::batches;
use crate::fault::{AtFault, Fault};
use crate::formats::shell::{self, ReadError, WorldItem, WorldReader};
use crate::formats::{Diagnostic, Source, Span, mongodump};
use crate::memory::Memory;
use crate::query::{QueryError, key};
use crate::store::{Find, Namespace, StoreError, document, metadata};

/// A world file that was read through once: its namespaces, in the order of the file.
#[derive(Debug, Clone)]
pub struct WorldFile {
    origin: Origin,
    namespaces: Vec<Listed>,
}

/// Where a world file can be read from the beginning, as often as need be.
#[derive(Debug, Clone)]
enum Origin {
    Text(Source),
    File(PathBuf),
}

/// A namespace of a world file.
#[derive(Debug, Clone)]
struct Listed {
    namespace: Namespace,
    /// As it is written.
    name: String,
    documents: u64,
    /// Whether the documents that have an `_id` are in its order.
    ordered: bool,
}

/// What loading a world file did.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Loaded {
    /// New, replaced and unchanged documents, by namespace.
    pub namespaces: Vec<(Namespace, crate::store::Put)>,
}

/// Why a world file was not loaded.
#[derive(Debug, thiserror::Error)]
pub enum WorldError {
    /// It is not a world file.
    #[error("{name} is not a world file")]
    Text {
        /// The file.
        name: String,
        /// Where, and what is wrong.
        source: Diagnostic,
    },
    /// It cannot be read.
    #[error("cannot read {name}: {reason}")]
    Read {
        /// The file.
        name: String,
        /// The system's error.
        reason: String,
    },
    /// A namespace could not be stored; those before it were.
    #[error("cannot put the documents of {namespace} into the memory")]
    Store {
        /// The namespace.
        namespace: String,
        /// What went wrong.
        source: StoreError,
    },
}

impl AtFault for WorldError {
    fn fault(&self) -> Fault {
        match self {
            Self::Text { .. } | Self::Read { .. } => Fault::Input,
            Self::Store { source, .. } => source.fault(),
        }
    }
}

/// Why a world file was not written.
#[derive(Debug, thiserror::Error)]
pub enum WorldDumpError {
    /// The store fails.
    #[error("{0}")]
    Store(#[from] StoreError),
    /// What it is written to fails.
    #[error("{0}")]
    Write(#[from] io::Error),
}

impl AtFault for WorldDumpError {
    fn fault(&self) -> Fault {
        match self {
            Self::Store(error) => error.fault(),
            Self::Write(error) => error.fault(),
        }
    }
}

/// Reads a world file and puts its documents into the memory.
///
/// # Errors
/// Where it is not a world file (nothing is stored then), or a store fails.
pub fn load(memory: &Memory, source: &Source) -> Result<Loaded, WorldError> {
    let wrong = |error| WorldError::Text { name: source.name().to_owned(), source: error };
    WorldFile::parse(source).map_err(wrong)?.load(memory)
}

/// The namespaces of the memory as a world file.
///
/// # Errors
/// Where a store fails.
pub fn dump(memory: &Memory, namespaces: &[Namespace]) -> Result<String, WorldDumpError> {
    let mut bytes = Vec::new();
    write(memory, namespaces, &mut bytes)?;
    String::from_utf8(bytes).map_err(|error| io::Error::other(error).into())
}

/// Writes the namespaces of the memory as a world file, document by document.
///
/// # Errors
/// Where a store fails, or `out`.
pub fn write(memory: &Memory, namespaces: &[Namespace], out: &mut dyn Write) -> Result<(), WorldDumpError> {
    let mut namespaces = namespaces.to_vec();
    namespaces.sort();
    namespaces.dedup();
    let mut text = String::from("{");
    for (index, ns) in namespaces.iter().enumerate() {
        text.push_str(if index == 0 { "\n  " } else { ",\n  " });
        shell::write_relaxed(&Bson::String(ns.to_string()), &mut text);
        text.push_str(": [");
        let count = write_documents(memory, ns, &mut text, out)?;
        text.push_str(if count == 0 { "]" } else { "\n  ]" });
    }
    text.push_str(if namespaces.is_empty() { "}\n" } else { "\n}\n" });
    Ok(out.write_all(text.as_bytes())?)
}

/// Writes the documents behind `text`, which is emptied whenever it is long.
fn write_documents(
    memory: &Memory,
    ns: &Namespace,
    text: &mut String,
    out: &mut dyn Write,
) -> Result<usize, WorldDumpError> {
    let find = Find { sort: doc! { "_id": 1 }, ..Find::default() };
    let mut count = 0;
    for document in memory.stored(ns, &find)? {
        let mut document =
            Document::try_from(&*document?).map_err(|error| StoreError::from(QueryError::from(error)))?;
        metadata::forget_dates(&mut document);
        text.push_str(if count == 0 { "\n    " } else { ",\n    " });
        shell::write_relaxed(&faithful(Bson::Document(document)), text);
        count += 1;
        if text.len() > FLUSH {
            out.write_all(text.as_bytes())?;
            text.clear();
        }
    }
    Ok(count)
}

/// So many bytes of text are written at once.
const FLUSH: usize = 64 << 10;

/// The value with small 64-bit integers spelled out: as plain numbers they
/// would be read back with 32 bits. As deep as documents may be nested.
fn faithful(value: Bson) -> Bson {
    match value {
        Bson::Int64(number) if i32::try_from(number).is_ok() => doc! { "$numberLong": number.to_string() }.into(),
        Bson::Document(document) => {
            Bson::Document(document.into_iter().map(|(key, value)| (key, faithful(value))).collect())
        }
        Bson::Array(values) => Bson::Array(values.into_iter().map(faithful).collect()),
        other => other,
    }
}

impl WorldFile {
    /// Reads a world file that is in memory, and checks that a store would take its documents.
    ///
    /// # Errors
    /// Where the text is not one, a document cannot be stored, or two documents
    /// of a namespace have one `_id`, at its place.
    pub fn parse(source: &Source) -> Result<Self, Diagnostic> {
        Self::read(Origin::Text(source.clone())).map_err(|error| match error {
            ReadError::Text(wrong) => wrong,
            ReadError::Io { name, error } => Diagnostic::at(&name, 1, 1, error.to_string()),
        })
    }

    /// The same for a file, which may be packed with gzip, and larger than memory.
    ///
    /// # Errors
    /// As with [`WorldFile::parse`], and where the file cannot be read.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        Self::read(Origin::File(path.to_owned()))
    }

    fn read(origin: Origin) -> Result<Self, ReadError> {
        let mut world = Self { origin, namespaces: Vec::new() };
        let mut last = Vec::new();
        for item in world.origin.items(|_| true)? {
            match item? {
                WorldItem::Namespace(name, source, span) => {
                    let wrong = |error: crate::store::NamespaceError| Diagnostic::new(&source, span, error.to_string());
                    let namespace = Namespace::parse(&name).map_err(wrong)?;
                    world.namespaces.push(Listed { namespace, name, documents: 0, ordered: true });
                    last.clear();
                }
                WorldItem::Document(document, source, span) => {
                    check(&source, span, &document)?;
                    let Some(listed) = world.namespaces.last_mut() else { continue };
                    listed.documents += 1;
                    if let Some(id) = document.get("_id") {
                        let key = key::encode_value(id);
                        listed.ordered &= last < key;
                        last = key;
                    }
                }
            }
        }
        for listed in world.namespaces.iter().filter(|listed| !listed.ordered) {
            world.refuse_twins(listed)?;
        }
        Ok(world)
    }

    /// Refuses an `_id` that two documents of a namespace have: where they are not in
    /// order, by hashes first, which are small.
    fn refuse_twins(&self, listed: &Listed) -> Result<(), ReadError> {
        let mut hashes = Vec::new();
        self.origin.ids(&listed.name, |id, _, _| {
            hashes.push(hash(&id));
            Ok(())
        })?;
        hashes.sort_unstable();
        let twins: Vec<u64> = hashes.windows(2).filter(|pair| pair[0] == pair[1]).map(|pair| pair[0]).collect();
        drop(hashes);
        let mut seen: HashMap<Vec<u8>, (usize, usize)> = HashMap::new();
        self.origin.ids(&listed.name, |id, source, span| {
            if twins.binary_search(&hash(&id)).is_err() {
                return Ok(());
            }
            let here = source.position(span.start);
            let Some((line, column)) = seen.insert(id, here) else { return Ok(()) };
            Err((line, column))
        })
    }

    /// The namespaces, and how many documents each has.
    pub fn namespaces(&self) -> impl Iterator<Item = (&Namespace, u64)> {
        self.namespaces.iter().map(|listed| (&listed.namespace, listed.documents))
    }

    /// The documents of a namespace, with an `_id` for each that has none.
    ///
    /// # Errors
    /// Where the file cannot be opened.
    pub fn documents(
        &self,
        namespace: &Namespace,
    ) -> Result<impl Iterator<Item = Result<Document, ReadError>> + use<>, ReadError> {
        let listed = self.namespaces.iter().find(|listed| listed.namespace == *namespace);
        let name = listed.map(|listed| listed.name.clone()).unwrap_or_default();
        let wanted = name.clone();
        let mut identities = Identities::new(namespace);
        let mut inside = false;
        let items = self.origin.items(move |name| *name == *wanted)?;
        Ok(items.filter_map(move |item| match item {
            Err(error) => Some(Err(error)),
            Ok(WorldItem::Namespace(found, ..)) => {
                inside = found == name;
                None
            }
            Ok(WorldItem::Document(document, source, span)) if inside => {
                let wrong = |error: QueryError| Diagnostic::new(&source, span, error.message).into();
                Some(identities.give(document).map_err(wrong))
            }
            Ok(WorldItem::Document(..)) => None,
        }))
    }

    /// Puts the documents into the memory, one namespace after the other.
    ///
    /// # Errors
    /// Where a store fails; the namespaces before are loaded then.
    pub fn load(self, memory: &Memory) -> Result<Loaded, WorldError> {
        let mut loaded = Loaded::default();
        for Listed { namespace, .. } in &self.namespaces {
            let failed = |source| WorldError::Store { namespace: namespace.to_string(), source };
            let put = memory.atomically(&[namespace], failed, |_| {
                let mut put = crate::store::Put::default();
                for batch in batches(self.documents(namespace)?) {
                    let done = memory.put(namespace, batch?).map_err(failed)?;
                    put.inserted += done.inserted;
                    put.replaced += done.replaced;
                    put.same += done.same;
                }
                Ok::<_, WorldError>(put)
            })?;
            loaded.namespaces.push((namespace.clone(), put));
        }
        Ok(loaded)
    }
}

impl From<ReadError> for WorldError {
    fn from(error: ReadError) -> Self {
        match error {
            ReadError::Text(wrong) => Self::Text { name: wrong.name().to_owned(), source: wrong },
            ReadError::Io { name, error } => Self::Read { name, reason: error.to_string() },
        }
    }
}

impl Origin {
    /// What is in the file, from the beginning.
    fn items(
        &self,
        wanted: impl Fn(&str) -> bool + 'static,
    ) -> Result<WorldReader<'static, Box<dyn BufRead>>, ReadError> {
        match self {
            Self::Text(source) => {
                let text = Cursor::new(Text(source.clone()));
                Ok(WorldReader::new(source.name(), Box::new(text), wanted))
            }
            Self::File(path) => {
                let name = path.display().to_string();
                let opened = File::open(path).and_then(mongodump::unpack);
                let file = opened.map_err(|error| ReadError::Io { name: name.clone(), error })?;
                Ok(WorldReader::new(name, file, wanted))
            }
        }
    }

    /// Shows the comparable bytes of each `_id` of a namespace. `look` may give the place
    /// of another document that has it, which is an error.
    fn ids(
        &self,
        name: &str,
        mut look: impl FnMut(Vec<u8>, &Source, Span) -> Result<(), (usize, usize)>,
    ) -> Result<(), ReadError> {
        let wanted = name.to_owned();
        for item in self.items(move |name| *name == *wanted)? {
            let WorldItem::Document(document, source, span) = item? else { continue };
            let Some(id) = document.get("_id") else { continue };
            if let Err((line, column)) = look(key::encode_value(id), &source, span) {
                let message = format!("the _id {} is given twice", shell::relaxed_value(id));
                let hint = format!("the other document with it is at {line}:{column}");
                return Err(Diagnostic::new(&source, span, message).hint(hint).into());
            }
        }
        Ok(())
    }
}

/// A text as bytes that are shared.
struct Text(Source);

impl AsRef<[u8]> for Text {
    fn as_ref(&self) -> &[u8] {
        self.0.text().as_bytes()
    }
}

/// A number that equal keys share, and others hardly.
fn hash(key: &[u8]) -> u64 {
    let mut hasher = DefaultHasher::new();
    key.hash(&mut hasher);
    hasher.finish()
}

/// Refuses a document that no store would take.
fn check(source: &Source, span: Span, document: &Document) -> Result<(), Diagnostic> {
    let wrong = |error: QueryError| Diagnostic::new(source, span, error.message);
    document::check(document).map_err(wrong)?;
    metadata::check(document).map_err(wrong)
}

/// Gives documents without an `_id` one that follows from what they are.
struct Identities {
    namespace: String,
    /// How often each content was seen, by the first bytes of its digest.
    seen: HashMap<u64, u32>,
}

impl Identities {
    fn new(namespace: &Namespace) -> Self {
        Self { namespace: namespace.to_string(), seen: HashMap::new() }
    }

    fn give(&mut self, mut document: Document) -> Result<Document, QueryError> {
        if document.contains_key("_id") {
            return Ok(document);
        }
        let content: [u8; 32] = Sha256::new()
            .chain_update(&self.namespace)
            .chain_update([0])
            .chain_update(RawDocumentBuf::try_from(&document)?.as_bytes())
            .finalize()
            .into();
        let short = content.iter().take(8).fold(0, |short, byte| short << 8 | u64::from(*byte));
        let nth = self.seen.entry(short).or_default();
        let digest = Sha256::new().chain_update(content).chain_update(u64::from(*nth).to_le_bytes()).finalize();
        *nth += 1;
        let mut id = [0; 12];
        id.iter_mut().zip(digest).for_each(|(byte, digit)| *byte = digit);
        document.insert("_id", ObjectId::from_bytes(id));
        Ok(document)
    }
}

impl fmt::Display for Loaded {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, (ns, put)) in self.namespaces.iter().enumerate() {
            let separator = if index == 0 { "" } else { "; " };
            write!(f, "{separator}{ns}: {} new, {} replaced, {} unchanged", put.inserted, put.replaced, put.same)?;
        }
        Ok(())
    }
}
