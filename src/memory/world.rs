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

use std::collections::HashMap;
use std::fmt;

use bson::oid::ObjectId;
use bson::{Bson, Document, RawDocumentBuf, doc};
use sha2::{Digest as _, Sha256};

use super::Memory;
use crate::formats::{Diagnostic, Source, Span, shell};
use crate::query::{QueryError, key};
use crate::store::{Find, Namespace, StoreError, document, stamp};

/// The documents of a world file, by namespace, in the order of the file.
#[derive(Debug, Clone, PartialEq)]
pub struct World {
    namespaces: Vec<(Namespace, Vec<Document>)>,
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
    /// A namespace could not be stored; those before it were.
    #[error("cannot put the documents of {namespace} into the memory")]
    Store {
        /// The namespace.
        namespace: String,
        /// What went wrong.
        source: StoreError,
    },
}

/// Reads a world file and puts its documents into the memory.
///
/// # Errors
/// Where it is not a world file (nothing is stored then), or a store fails.
pub fn load(memory: &Memory, source: &Source) -> Result<Loaded, WorldError> {
    let wrong = |error| WorldError::Text { name: source.name().to_owned(), source: error };
    World::parse(source).map_err(wrong)?.load(memory)
}

/// The namespaces of the memory as a world file.
///
/// # Errors
/// Where a store fails.
pub fn dump(memory: &Memory, namespaces: &[Namespace]) -> Result<String, StoreError> {
    let mut namespaces = namespaces.to_vec();
    namespaces.sort();
    namespaces.dedup();
    let mut text = String::from("{");
    for (index, ns) in namespaces.iter().enumerate() {
        text.push_str(if index == 0 { "\n  " } else { ",\n  " });
        shell::write_relaxed(&Bson::String(ns.to_string()), &mut text);
        text.push_str(": [");
        let count = dump_documents(memory, ns, &mut text)?;
        text.push_str(if count == 0 { "]" } else { "\n  ]" });
    }
    text.push_str(if namespaces.is_empty() { "}\n" } else { "\n}\n" });
    Ok(text)
}

fn dump_documents(memory: &Memory, ns: &Namespace, text: &mut String) -> Result<usize, StoreError> {
    let find = Find { sort: doc! { "_id": 1 }, ..Find::default() };
    let mut count = 0;
    for document in memory.stored(ns, &find)? {
        let mut document = Document::try_from(&*document?).map_err(QueryError::from)?;
        forget_dates(&mut document);
        text.push_str(if count == 0 { "\n    " } else { ",\n    " });
        shell::write_relaxed(&faithful(Bson::Document(document)), text);
        count += 1;
    }
    Ok(count)
}

/// Leaves out when the document was stored and changed.
pub(super) fn forget_dates(document: &mut Document) {
    if let Some(Bson::Document(info)) = document.get_mut(stamp::INFO) {
        info.remove(stamp::INSERTED);
        info.remove(stamp::UPDATED);
        if info.is_empty() {
            document.remove(stamp::INFO);
        }
    }
}

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

impl World {
    /// Reads a world file, and checks that a store would take its documents.
    ///
    /// # Errors
    /// Where the text is not one, a document cannot be stored, or two documents
    /// of a namespace have one `_id`, at its place.
    pub fn parse(source: &Source) -> Result<Self, Diagnostic> {
        let mut namespaces = Vec::new();
        for (name, span, documents) in shell::parse_world(source)? {
            let ns = Namespace::parse(&name).map_err(|error| Diagnostic::new(source, span, error.to_string()))?;
            let mut ids = HashMap::new();
            for (span, document) in &documents {
                check(source, *span, document, &mut ids)?;
            }
            namespaces.push((ns, documents.into_iter().map(|(_, document)| document).collect()));
        }
        Ok(Self { namespaces })
    }

    /// The documents, by namespace.
    pub fn namespaces(&self) -> impl Iterator<Item = (&Namespace, &[Document])> {
        self.namespaces.iter().map(|(ns, documents)| (ns, documents.as_slice()))
    }

    /// The documents, by namespace, to be taken.
    pub(super) fn into_namespaces(self) -> Vec<(Namespace, Vec<Document>)> {
        self.namespaces
    }

    /// Puts the documents into the memory, one namespace after the other.
    ///
    /// # Errors
    /// Where a store fails; the namespaces before are loaded then.
    pub fn load(self, memory: &Memory) -> Result<Loaded, WorldError> {
        let mut loaded = Loaded::default();
        for (namespace, documents) in self.namespaces {
            let put = identified(&namespace, documents)
                .map_err(StoreError::from)
                .and_then(|documents| memory.put(&namespace, documents));
            match put {
                Ok(put) => loaded.namespaces.push((namespace, put)),
                Err(source) => return Err(WorldError::Store { namespace: namespace.to_string(), source }),
            }
        }
        Ok(loaded)
    }
}

/// Refuses a document that no store would take, or whose `_id` is one of
/// `ids`: those before it, by their comparable bytes.
fn check(source: &Source, span: Span, document: &Document, ids: &mut HashMap<Vec<u8>, Span>) -> Result<(), Diagnostic> {
    let wrong = |error: QueryError| Diagnostic::new(source, span, error.message);
    document::check(document).map_err(wrong)?;
    stamp::check(document).map_err(wrong)?;
    let Some(id) = document.get("_id") else { return Ok(()) };
    let Some(earlier) = ids.insert(key::encode_value(id), span) else { return Ok(()) };
    let (line, column) = source.position(earlier.start);
    let message = format!("the _id {} is given twice", shell::relaxed_value(id));
    Err(Diagnostic::new(source, span, message).hint(format!("the other document with it is at {line}:{column}")))
}

/// The documents, with an `_id` for each that has none.
pub(super) fn identified(ns: &Namespace, mut documents: Vec<Document>) -> Result<Vec<Document>, QueryError> {
    let mut seen: HashMap<[u8; 32], u64> = HashMap::new();
    for document in documents.iter_mut().filter(|document| !document.contains_key("_id")) {
        let content: [u8; 32] = Sha256::new()
            .chain_update(ns.to_string())
            .chain_update([0])
            .chain_update(RawDocumentBuf::try_from(&*document)?.as_bytes())
            .finalize()
            .into();
        let nth = seen.entry(content).or_default();
        let digest = Sha256::new().chain_update(content).chain_update(nth.to_le_bytes()).finalize();
        *nth += 1;
        let mut id = [0; 12];
        id.iter_mut().zip(digest).for_each(|(byte, digit)| *byte = digit);
        document.insert("_id", ObjectId::from_bytes(id));
    }
    Ok(documents)
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
