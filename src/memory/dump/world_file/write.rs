//! A memory written as a world file.

use std::io::{self, Write};

use bson::{Bson, Document, doc};

use crate::fault::{AtFault, Fault};
use crate::formats::shell;
use crate::memory::Memory;
use crate::query::QueryError;
use crate::store::{Find, Namespace, StoreError, metadata};

/// Why a world file was not written.
#[derive(Debug, thiserror::Error)]
pub enum WorldDumpError {
    /// The store fails.
    #[error("{0}")]
    Store(#[from] StoreError),
    /// A document has a key that Extended JSON uses.
    #[error(
        "{namespace}: the document with _id {id} has the key `{key}`, by which a world file says the type of a value; \
         dump into a folder or an archive, which hold BSON"
    )]
    Ambiguous {
        /// The collection.
        namespace: Namespace,
        /// The `_id` of the document.
        id: String,
        /// The key.
        key: String,
    },
    /// What it is written to fails.
    #[error("{0}")]
    Write(#[from] io::Error),
}

impl AtFault for WorldDumpError {
    fn fault(&self) -> Fault {
        match self {
            Self::Store(error) => error.fault(),
            Self::Ambiguous { .. } => Fault::Input,
            Self::Write(error) => error.fault(),
        }
    }
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
    memory.check_whole(ns)?;
    let mut count = 0;
    for document in memory.stored(ns, &find)? {
        let mut document =
            Document::try_from(&*document?).map_err(|error| StoreError::from(QueryError::from(error)))?;
        metadata::forget_dates(&mut document);
        if let Some(key) = shell::ambiguous_key(&document) {
            let id = document.get("_id").map(shell::relaxed_value).unwrap_or_default();
            return Err(WorldDumpError::Ambiguous { namespace: ns.clone(), id, key: key.to_owned() });
        }
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
