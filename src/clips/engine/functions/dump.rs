//! World models out and in.

use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};

use super::arguments::Arguments;
use super::failure::Failure;
use super::function::{Function, function};
use super::operation;
use crate::clips::engine::native::{Environment, Value};
use crate::clips::engine::state::State;
use crate::memory::dump::read::Dump;
use crate::memory::dump::restore::{RestoreOptions, restore};
use crate::memory::dump::{self, world_file};
use crate::store::Namespace;

pub(super) const FUNCTIONS: &[Function] = &[
    function(&["rm-dump"], 2, 2, write),
    function(&["rm-restore"], 1, 2, read),
    function(&["robmem-dump-collection"], 2, 2, dump_collection),
    function(&["robmem-restore-collection"], 2, 3, restore_collection),
];

/// `(rm-dump NS PATH)`: a world file where the path ends in `.json`, else a folder as mongodump's.
fn write(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let (ns, path) = (arguments.namespace(1)?, Path::new(arguments.text(2)?));
    if path.extension().is_none_or(|end| end != "json") {
        dump::write::write_folder(state.memory, &[ns], path, false).map_err(|error| Failure::chained(&error.into()))?;
        return Ok(Value::truth(true));
    }
    let failed = |error: std::io::Error| Failure::Declined(format!("cannot write {}: {error}", path.display()));
    let folder = path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
    let mut staged = tempfile::Builder::new().prefix(".rmem-").tempfile_in(folder).map_err(failed)?;
    let mut out = BufWriter::new(staged.as_file_mut());
    world_file::write(state.memory, &[ns], &mut out).map_err(|error| Failure::chained(&error.into()))?;
    out.flush().map_err(failed)?;
    drop(out);
    staged.persist(path).map_err(|error| failed(error.error))?;
    Ok(Value::truth(true))
}

/// `(rm-restore PATH [NS])`; returns how many documents are new or other ones.
fn read(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let into = arguments.get(2).map(|_| arguments.namespace(2)).transpose()?;
    put(state, Path::new(arguments.text(1)?), into.as_ref())
}

fn put(state: &State<'_>, path: &Path, into: Option<&Namespace>) -> Result<Value, Failure> {
    let mut source = Dump::open(path).map_err(|error| Failure::chained(&error.into()))?;
    if let Some(namespace) = into {
        let several = |_| Failure::Declined(format!("{} is a dump of several namespaces", path.display()));
        source = source.into(namespace).map_err(several)?;
    }
    let restored =
        restore(state.memory, &source, RestoreOptions::default()).map_err(|error| Failure::chained(&error.into()))?;
    Ok(operation::number(restored.collections.iter().map(|part| part.inserted + part.replaced).sum()))
}

/// `(robmem-dump-collection NS FOLDER)`: `FOLDER/DB/COLL.bson`, in place of an earlier one.
fn dump_collection(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let (ns, folder) = (arguments.namespace(1)?, PathBuf::from(arguments.text(2)?));
    let failed = |error: std::io::Error| Failure::Declined(format!("cannot write {}: {error}", folder.display()));
    std::fs::create_dir_all(&folder).map_err(failed)?;
    let staged = tempfile::Builder::new().prefix(".rmem-").tempdir_in(&folder).map_err(failed)?;
    let whole = staged.path().join("dump");
    dump::write::write_folder(state.memory, std::slice::from_ref(&ns), &whole, false)
        .map_err(|error| Failure::chained(&error.into()))?;
    let database = folder.join(&ns.database);
    std::fs::create_dir_all(&database).map_err(failed)?;
    for entry in std::fs::read_dir(whole.join(&ns.database)).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        File::open(entry.path()).and_then(|file| file.sync_all()).map_err(failed)?;
        std::fs::rename(entry.path(), database.join(entry.file_name())).map_err(failed)?;
    }
    Ok(Value::truth(true))
}

/// `(robmem-restore-collection NS FOLDER [TARGET])`
fn restore_collection(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let (ns, folder) = (arguments.namespace(1)?, Path::new(arguments.text(2)?));
    let target = arguments.get(3).map(|_| arguments.namespace(3)).transpose()?.unwrap_or_else(|| ns.clone());
    let file = folder.join(&ns.database).join(format!("{}.bson", ns.collection));
    put(state, &file, Some(&target))
}
