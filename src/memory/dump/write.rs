//! Dumping into a folder or an archive, as `mongodump` does: for backups and for MongoDB's own tools.
//!
//! Documents are written as they are stored, with their metadata and its
//! dates; what a computable made is left out, since it can be made again.
//! Documents are passed on one by one, so that memory stays flat. As with
//! `mongodump`, what others write meanwhile may or may not be in the dump.

use std::fs::{self, File, Permissions};
use std::io::{self, BufWriter, Write as _};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

use crate::fault::{AtFault, Fault};
use crate::formats::mongodump::{ArchiveWriter, Metadata, Packer, encode};
use crate::interrupt::Unfinished;
use crate::memory::Memory;
use crate::process::stale_files;
use crate::store::validation::collection_options;
use crate::store::{Documents, Find, Index, Namespace, StoreError, index};

/// The prefix of temporary files.
const PREFIX: &str = ".rmem-";

/// Why there is no dump. Nothing was left behind.
#[derive(Debug, thiserror::Error)]
pub enum DumpError {
    /// The folder is there already, with something in it.
    #[error("{} is not empty; name a folder that is not there yet", path.display())]
    Taken {
        /// The folder.
        path: PathBuf,
    },
    /// The folder it is to be in is not there.
    #[error("cannot write {}: the folder {} does not exist; create it first", path.display(), beside(path).display())]
    Nowhere {
        /// What was to be written.
        path: PathBuf,
    },
    /// The folder cannot be written.
    #[error("cannot write {}", path.display())]
    Write {
        /// The folder.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The store fails.
    #[error("cannot read {namespace}")]
    Store {
        /// Of which documents.
        namespace: String,
        /// What went wrong.
        source: StoreError,
    },
}

impl AtFault for DumpError {
    fn fault(&self) -> Fault {
        match self {
            Self::Taken { .. } => Fault::Input,
            Self::Nowhere { .. } | Self::Write { .. } => Fault::Store,
            Self::Store { source, .. } => source.fault(),
        }
    }
}

/// Writes the namespaces into the folder `path`, whole or not at all; returns
/// how many documents each has.
///
/// # Errors
/// Where the folder is not empty or cannot be written, or the store fails.
pub fn write_folder(
    memory: &Memory,
    namespaces: &[Namespace],
    path: &Path,
    gzip: bool,
) -> Result<Vec<(Namespace, u64)>, DumpError> {
    let failed = |source| DumpError::Write { path: path.to_owned(), source };
    if fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_some()) {
        return Err(DumpError::Taken { path: path.to_owned() });
    }
    check_place(path)?;
    let mut builder = tempfile::Builder::new();
    let prefix = stale_files::prefix(beside(path), PREFIX);
    builder.prefix(&prefix).permissions(Permissions::from_mode(0o777));
    // The error leaves out the name of the temporary folder.
    let make = || builder.tempdir_in(beside(path)).map_err(|error| failed(error.kind().into()));
    let (staged, _unfinished) = Unfinished::making(make, |staged| vec![staged.path().to_owned()])?;
    let namespaces = in_order(namespaces);
    let mut written = Vec::with_capacity(namespaces.len());
    for namespace in namespaces {
        let count = write_collection(memory, &namespace, path, staged.path(), gzip)?;
        written.push((namespace, count));
    }
    fs::rename(staged.path(), path).map_err(failed)?;
    // The folder has its final name; nothing is to be removed.
    let _ = staged.keep();
    Ok(written)
}

/// Writes the namespaces into one file, an archive, whole or not at all; returns
/// how many documents each has.
///
/// # Errors
/// Where the file cannot be written, or the store fails.
pub fn write_archive(
    memory: &Memory,
    namespaces: &[Namespace],
    path: &Path,
    gzip: bool,
) -> Result<Vec<(Namespace, u64)>, DumpError> {
    let failed = |source| DumpError::Write { path: path.to_owned(), source };
    check_place(path)?;
    let mut builder = tempfile::Builder::new();
    let prefix = stale_files::prefix(beside(path), PREFIX);
    builder.prefix(&prefix).permissions(Permissions::from_mode(0o666));
    let make = || builder.tempfile_in(beside(path)).map_err(failed).map(tempfile::NamedTempFile::into_parts);
    let ((file, staged), _unfinished) = Unfinished::making(make, |(_, staged)| vec![staged.to_path_buf()])?;
    let namespaces = in_order(namespaces);
    let described = namespaces.iter().map(|ns| metadata(memory, ns)).collect::<Result<Vec<_>, _>>()?;
    let names = namespaces.iter().zip(&described).map(|(ns, metadata)| (ns.database.as_str(), metadata));
    let packer = Packer::new(BufWriter::with_capacity(128 << 10, file), gzip);
    let mut archive = ArchiveWriter::new(packer, names).map_err(failed)?;
    let mut written = Vec::with_capacity(namespaces.len());
    for ns in &namespaces {
        let unread = |source| DumpError::Store { namespace: ns.to_string(), source };
        let mut count = 0;
        for document in all(memory, ns).map_err(unread)? {
            archive.document(&ns.database, &ns.collection, &document.map_err(unread)?).map_err(failed)?;
            count += 1;
        }
        archive.end(&ns.database, &ns.collection).map_err(failed)?;
        written.push((ns.clone(), count));
    }
    close(archive.finish()).map_err(failed)?;
    staged.persist(path).map_err(|error| failed(error.error))?;
    Ok(written)
}

/// The folder that something is in.
fn beside(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    }
}

fn check_place(path: &Path) -> Result<(), DumpError> {
    match beside(path).try_exists() {
        Ok(false) => Err(DumpError::Nowhere { path: path.to_owned() }),
        _ => Ok(()),
    }
}

/// Sorted, each once.
fn in_order(namespaces: &[Namespace]) -> Vec<Namespace> {
    let mut namespaces = namespaces.to_vec();
    namespaces.sort();
    namespaces.dedup();
    namespaces
}

fn write_collection(memory: &Memory, ns: &Namespace, path: &Path, folder: &Path, gzip: bool) -> Result<u64, DumpError> {
    let failed = |source| DumpError::Write { path: path.to_owned(), source };
    let unread = |source| DumpError::Store { namespace: ns.to_string(), source };
    let folder = folder.join(&ns.database);
    fs::create_dir_all(&folder).map_err(failed)?;
    let (name, packed) = (encode(&ns.collection), if gzip { ".gz" } else { "" });
    let create = |extension: &str| -> io::Result<Packer<BufWriter<File>>> {
        let file = File::create_new(folder.join(format!("{name}.{extension}{packed}")))?;
        Ok(Packer::new(BufWriter::with_capacity(128 << 10, file), gzip))
    };
    let mut documents = create("bson").map_err(failed)?;
    let mut count = 0;
    for document in all(memory, ns).map_err(unread)? {
        documents.write_all(document.map_err(unread)?.as_bytes()).map_err(failed)?;
        count += 1;
    }
    close(documents).map_err(failed)?;
    let mut metadata = create("metadata.json").map_err(failed)?;
    metadata.write_all(self::metadata(memory, ns)?.write().as_bytes()).map_err(failed)?;
    close(metadata).map_err(failed)?;
    Ok(count)
}

/// The documents of a collection, which has to be whole: the dump may be all that is left of it one day.
fn all<'m>(memory: &'m Memory, ns: &Namespace) -> Result<Documents<'m>, StoreError> {
    memory.check_whole(ns)?;
    memory.stored(ns, &Find::default())
}

/// What a dump says of a collection: its indexes, as the store lists them, and its options.
fn metadata(memory: &Memory, ns: &Namespace) -> Result<Metadata, DumpError> {
    let failed = |source| DumpError::Store { namespace: ns.to_string(), source };
    let indexes = memory.indexes(ns).map_err(failed)?;
    let validation = memory.validation(ns).map_err(failed)?;
    let options = collection_options(validation.as_ref(), index::collation(&indexes).as_ref());
    let indexes = indexes.iter().filter(|index| index.name != index::ID).map(Index::definition).collect();
    Ok(Metadata { indexes, options, ..Metadata::plain(&ns.collection) })
}

fn close(file: Packer<BufWriter<File>>) -> io::Result<()> {
    file.finish()?.into_inner().map_err(io::IntoInnerError::into_error)?.sync_all()
}
