//! The files of a folder that `mongodump` wrote: their names, and what stands beside them.

use std::fs::{self, File};
use std::io::{BufRead, Read as _};
use std::path::{Path, PathBuf};

use bson::RawDocument;

use super::ReadError;
use crate::formats::Source;
use crate::formats::mongodump::{self, Metadata};
use crate::store::Namespace;

/// What `mongodump --oplog` calls the oplog, and what a server does.
const OPLOGS: [&str; 2] = ["oplog", "oplog.rs"];

/// Opens a file, unpacked where it is packed.
pub(super) fn unpacked(path: &Path) -> Result<Box<dyn BufRead>, ReadError> {
    File::open(path).and_then(mongodump::unpack).map_err(|source| ReadError::Read { path: path.to_owned(), source })
}

/// What is in a folder, sorted.
pub(super) fn entries(folder: &Path) -> Result<Vec<PathBuf>, ReadError> {
    let read = || fs::read_dir(folder)?.map(|entry| entry.map(|entry| entry.path())).collect::<Result<Vec<_>, _>>();
    let mut entries = read().map_err(|source| ReadError::Read { path: folder.to_owned(), source })?;
    entries.sort();
    Ok(entries)
}

/// The name of a `.bson` file without its extension.
pub(super) fn stem(path: &Path) -> Option<&str> {
    let name = path.file_name()?.to_str()?;
    name.strip_suffix(".gz").unwrap_or(name).strip_suffix(".bson")
}

/// The metadata beside a `.bson` file, where there is some.
pub(super) fn metadata_of(path: &Path) -> Result<Option<Metadata>, ReadError> {
    let Some(stem) = stem(path) else { return Ok(None) };
    let candidates =
        ["metadata.json", "metadata.json.gz"].map(|extension| path.with_file_name(format!("{stem}.{extension}")));
    candidates.iter().find(|path| path.is_file()).map_or(Ok(None), |path| read_metadata(path))
}

/// Reads a metadata file; an empty one is as none, as for `mongorestore`.
pub(super) fn read_metadata(path: &Path) -> Result<Option<Metadata>, ReadError> {
    let mut text = String::new();
    unpacked(path)?.read_to_string(&mut text).map_err(|source| ReadError::Read { path: path.to_owned(), source })?;
    if text.is_empty() {
        return Ok(None);
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let collection = name.split_once(".metadata.json").map_or(&*name, |(collection, _)| collection).to_owned();
    Metadata::parse(&Source::new(path.display().to_string(), text))
        .map(Some)
        .map_err(|source| ReadError::Metadata { collection, source })
}

/// Whether a `.bson` file is the oplog of a dump: it is called so, has no metadata beside it, and its first document
/// is an entry of an oplog.
pub(super) fn is_oplog(path: &Path, metadata: Option<&Metadata>) -> Result<bool, ReadError> {
    if metadata.is_some() || !stem(path).is_some_and(|stem| OPLOGS.contains(&stem)) {
        return Ok(false);
    }
    Ok(match mongodump::Documents::new(unpacked(path)?).next() {
        Some(Ok((_, first))) => is_entry(&first),
        Some(Err(damage)) => return Err(ReadError::Damaged { path: path.to_owned(), damage }),
        None => true,
    })
}

/// Whether a document is an entry of an oplog: what was done, when, and where.
fn is_entry(document: &RawDocument) -> bool {
    document.get_timestamp("ts").is_ok() && document.get_str("op").is_ok() && document.get_str("ns").is_ok()
}

/// Where the documents of a `.bson` file belong: its folder is the database.
pub(super) fn namespace(path: &Path, metadata: Option<&Metadata>) -> Result<Namespace, ReadError> {
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
    if collection.starts_with("system.") {
        return Ok(Namespace { database: database.to_owned(), collection });
    }
    Namespace::parse(&format!("{database}.{collection}"))
        .map_err(|error| refuse(format!("{error}; the file's folder names the database, the file the collection")))
}
