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

mod error;
mod identity;
mod write;

use std::collections::HashMap;
use std::collections::hash_map::DefaultHasher;
use std::fmt;
use std::fs::File;
use std::hash::{Hash as _, Hasher as _};
use std::io::{BufRead, Cursor};
use std::path::{Path, PathBuf};

use bson::Document;

use super::batch::batches;
use crate::formats::shell::{self, ReadError, WorldItem, WorldReader};
use crate::formats::{Diagnostic, Source, Span, mongodump};
use crate::memory::Memory;
use crate::query::{QueryError, key};
use crate::store::{Namespace, document, metadata};
pub(super) use identity::Identities;

pub use error::WorldError;
pub use write::{WorldDumpError, dump, write};

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
    /// Whether all documents have an `_id`.
    has_ids: bool,
}

/// What loading a world file did.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Loaded {
    /// New, replaced and unchanged documents, by namespace.
    pub namespaces: Vec<(Namespace, crate::store::Put)>,
}

/// Reads a world file and puts its documents into the memory.
///
/// # Errors
/// Where it is not a world file (nothing is stored then), or a store fails.
pub fn load(memory: &Memory, source: &Source) -> Result<Loaded, WorldError> {
    let wrong = |error| WorldError::Text { name: source.name().to_owned(), source: error };
    WorldFile::parse(source).map_err(wrong)?.load(memory)
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
                    world.namespaces.push(Listed { namespace, name, documents: 0, ordered: true, has_ids: true });
                    last.clear();
                }
                WorldItem::Document(document, source, span) => {
                    check(&source, span, &document)?;
                    let Some(listed) = world.namespaces.last_mut() else { continue };
                    listed.documents += 1;
                    listed.has_ids &= document.contains_key("_id");
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

    /// Whether it is known that the documents of a namespace are in the order of their `_id`s.
    #[must_use]
    pub fn is_ordered(&self, namespace: &Namespace) -> bool {
        self.namespaces.iter().any(|listed| listed.namespace == *namespace && listed.ordered && listed.has_ids)
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

impl fmt::Display for Loaded {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, (ns, put)) in self.namespaces.iter().enumerate() {
            let separator = if index == 0 { "" } else { "; " };
            write!(f, "{separator}{ns}: {} new, {} replaced, {} unchanged", put.inserted, put.replaced, put.same)?;
        }
        Ok(())
    }
}
