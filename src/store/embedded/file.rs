//! The file: identified, opened, and laid out.
//!
//! `application_id` says that an SQLite file is a memory, `user_version` which
//! layout it has. The layout of version 2:
//!
//! - `collections`: one row per collection; ids are never used again, the
//!   generation grows with each change of its indexes.
//! - `documents_ID`, one per collection: `position` (order of insertion, which
//!   is MongoDB's natural order), `key` (the `_id` as comparable bytes, unique),
//!   `body` (the document as BSON, with a checksum: `body`). A table of its own keeps a collection's
//!   documents side by side on the disk, and dropping it is one step.
//! - `indexes`: one row per index: its definition as BSON, as MongoDB lists it,
//!   and which of its paths run through arrays, as bits.
//! - `entries_ID`, one per index: the keys, each with the position of its document and a checksum (`keys`).
//! - `watchers`: the watchers of collections, with their positions (`watcher`).
//! - `changes`: the changes that watchers have not taken (`change_log`); numbers are never used again.
//! - `histories`, `origins` and `cut_runs`, where a history was kept: of what, the authors of changes, and the runs of
//!   which changes are not kept any more (`history`).
//! - `validators`, where a collection has a validator: which documents it takes (`validation`). The version is 3 then.

use std::cell::{Cell, RefCell};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use rusqlite::config::DbConfig;
use rusqlite::{Connection, OpenFlags};

use super::catalog_cache::CatalogCache;
use super::indexed::Remembered;
use super::log_size::LogSize;
use super::place::{Place, companions, folder, log};
use super::rolled_back::RolledBack;
use super::scan::check_ending;
use super::spare::Spare;
use super::transaction::Log;
use super::{Embedded, busy, failure};
use crate::query::look_at;
use crate::store::StoreError;

/// The newest layout this rmem reads: that of a file in which a collection has, or had, a validator. A file is marked with
/// it when the first one is set, so that no rmem that knows of none writes to it.
pub const VERSION: i32 = 3;
/// The layout of every other file.
const SEALED: i32 = 2;
/// The layout before: documents have no checksums. It is read, and marked as version 2 with the first
/// opening that may write: documents get their checksums when they are changed.
const UNSEALED: i32 = 1;
/// `rmem` in ASCII: what `file` and SQLite show as the application id.
const APPLICATION: i32 = 0x726D_656D;

const LAYOUT: &str = "
CREATE TABLE collections (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    database TEXT NOT NULL,
    name TEXT NOT NULL,
    generation INTEGER NOT NULL DEFAULT 0,
    UNIQUE (database, name)
) STRICT;
CREATE TABLE indexes (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    collection INTEGER NOT NULL,
    name TEXT NOT NULL,
    definition BLOB NOT NULL,
    multikey INTEGER NOT NULL DEFAULT 0,
    UNIQUE (collection, name)
) STRICT;
CREATE TABLE watchers (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    name TEXT UNIQUE,
    database TEXT NOT NULL,
    collection TEXT NOT NULL,
    position INTEGER NOT NULL,
    missed INTEGER NOT NULL DEFAULT 0,
    holder TEXT,
    beat INTEGER NOT NULL
) STRICT;
CREATE TABLE changes (
    sequence INTEGER PRIMARY KEY AUTOINCREMENT,
    database TEXT NOT NULL,
    collection TEXT NOT NULL,
    kind INTEGER NOT NULL,
    time INTEGER NOT NULL,
    before BLOB,
    after BLOB,
    volume INTEGER NOT NULL
) STRICT;
CREATE INDEX changes_of ON changes (database, collection, sequence);";

impl Embedded {
    /// Opens the memory in the file `path`, creating it where there is none
    /// (its folder has to exist). What this process may not write, it reads.
    ///
    /// # Errors
    /// Where the file cannot be opened, is not a memory, or is one of a newer rmem.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, StoreError> {
        let path = path.as_ref();
        let place = Place::File(path.to_owned());
        if let Some(reason) = special(path) {
            return Err(StoreError::unreachable(place.to_string(), reason));
        }
        if is_read_only(path) {
            return Self::open_unchanging(path, place);
        }
        if !may_write(path) || !may_log(path) {
            return Self::open_of_others(path, place);
        }
        let flags = OpenFlags::SQLITE_OPEN_READ_WRITE
            | OpenFlags::SQLITE_OPEN_CREATE
            | OpenFlags::SQLITE_OPEN_NO_MUTEX
            | OpenFlags::SQLITE_OPEN_EXRESCODE;
        let is_new = path.symlink_metadata().is_err();
        let opened = Self::open_with(path, &place, flags);
        if is_new && matches!(opened, Err(StoreError::DiskFull { .. })) {
            remove_blank(path);
            return Err(failure::no_room(&place));
        }
        opened
    }

    fn open_with(path: &Path, place: &Place, flags: OpenFlags) -> Result<Self, StoreError> {
        let open = || Connection::open_with_flags(path, flags).map_err(|e| failure::explain(place, &e));
        match Self::prepare(open()?, place.clone()) {
            Err(StoreError::DiskFull { .. }) => {
                // Without room for the index of the log beside the file, the index is in memory. Other processes wait then.
                let connection = open()?;
                let alone = connection.pragma_update(None, "locking_mode", "EXCLUSIVE");
                alone.map_err(|e| failure::explain(place, &e))?;
                Ok(Self { identity: None, ..Self::prepare(connection, place.clone())? })
            }
            prepared => prepared,
        }
    }

    /// Opens a file that this process may not write. If it has a write-ahead log, the log is read
    /// as well; otherwise no file is created beside it that its owner could not open.
    fn open_of_others(path: &Path, place: Place) -> Result<Self, StoreError> {
        if !has_log(path) {
            return Self::open_unchanging(path, place);
        }
        let flags =
            OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX | OpenFlags::SQLITE_OPEN_EXRESCODE;
        let connection = Connection::open_with_flags(path, flags).map_err(|e| failure::explain(&place, &e))?;
        Self::prepare(connection, place)
    }

    /// Opens a file that does not change, so that it is read without a log beside it.
    fn open_unchanging(path: &Path, place: Place) -> Result<Self, StoreError> {
        Self::prepare(connect_unchanging(path, &place)?, place)
    }

    /// The same file opened once more, with a quarter of the cache; none where that cannot be done, or another file has taken
    /// its name.
    pub(super) fn again(&self) -> Option<Self> {
        let path = self.place.file().filter(|_| self.identity.is_some() && self.place.identity() == self.identity)?;
        let other = Self::open(path).ok()?;
        let cache: i64 = self.connection.query_row("PRAGMA cache_size", [], |row| row.get(0)).ok()?;
        other.connection.pragma_update(None, "cache_size", cache / 4).ok()?;
        Some(other)
    }

    /// A memory without a file, which ends with the store.
    ///
    /// # Errors
    /// Where there is not enough memory.
    pub fn in_memory() -> Result<Self, StoreError> {
        let connection = Connection::open_in_memory().map_err(|e| failure::explain(&Place::Memory, &e))?;
        Self::prepare(connection, Place::Memory)
    }

    fn prepare(mut connection: Connection, place: Place) -> Result<Self, StoreError> {
        let explain = |error| failure::explain(&place, &error);
        let is_brief = Arc::new(AtomicBool::new(false));
        busy::install(&mut connection, Arc::clone(&is_brief), place.log()).map_err(explain)?;
        connection.set_prepared_statement_cache_capacity(64);
        let marks =
            busy::retry(|| Marks::read(&connection)).map_err(|error| match failure::is_no_database(&error) {
                true => foreign(&place),
                false => explain(error),
            })?;
        match marks {
            Marks { application: APPLICATION, version: VERSION | SEALED, .. } => {}
            Marks { application: APPLICATION, version: UNSEALED, .. } => upgrade(&connection).map_err(explain)?,
            Marks { application: APPLICATION, version, .. } => return Err(wrong_version(&place, version)),
            Marks { application: 0, version: 0, blank: true, untouched: true }
                if is_ours(&connection).map_err(explain)? =>
            {
                lay_out(&connection).map_err(explain)?;
            }
            _ => return Err(unmarked(&place, &connection)),
        }
        tune(&connection).map_err(explain)?;
        look_at(check_ending);
        Ok(Self {
            identity: place.identity(),
            connection,
            place,
            indexes: Remembered::default(),
            catalog_cache: CatalogCache::default(),
            log: Log::default(),
            rolled_back: RolledBack::default(),
            is_brief,
            is_reading: Cell::default(),
            reads_until: Cell::default(),
            is_bypassing: Cell::default(),
            whole: RefCell::default(),
            warn: RefCell::default(),
            is_deleting: Cell::default(),
            is_crowded: Cell::new(true),
            log_size: LogSize::default(),
            spare: Spare::default(),
        })
    }
}

/// Connects to a file that may be damaged, to read it. It stays as it is, and so does what is beside it.
///
/// # Errors
/// Where there is none, or it cannot be read.
pub(super) fn to_salvage(path: &Path) -> Result<Connection, StoreError> {
    let place = Place::File(path.to_owned());
    let explain = |error: rusqlite::Error| failure::explain(&place, &error);
    if let Some(reason) = special(path) {
        return Err(StoreError::unreachable(place.to_string(), reason));
    }
    let leniently = |connection: Connection| {
        // Else SQLite refuses a file that has lost its end.
        let lenient = connection.pragma_update(None, "writable_schema", "ON");
        lenient.and_then(|()| connection.pragma_update(None, "query_only", "ON")).map(|()| connection)
    };
    if is_read_only(path) || !has_log(path) && (!may_write(path) || !may_log(path)) {
        return leniently(connect_unchanging(path, &place)?).map_err(explain);
    }
    let open = |access| {
        let flags = access | OpenFlags::SQLITE_OPEN_NO_MUTEX | OpenFlags::SQLITE_OPEN_EXRESCODE;
        Connection::open_with_flags(path, flags)
    };
    // What only reads folds no log into the file; and what may write removes the empty log that it made.
    let access = if has_log(path) { OpenFlags::SQLITE_OPEN_READ_ONLY } else { OpenFlags::SQLITE_OPEN_READ_WRITE };
    let connection = open(access).and_then(leniently).map_err(explain)?;
    match Marks::read(&connection).map_err(explain) {
        // There is no room for the index of its log.
        Err(StoreError::DiskFull { .. }) if has_log(path) => {
            let connection = open(OpenFlags::SQLITE_OPEN_READ_WRITE).map_err(explain)?;
            connection.set_db_config(DbConfig::SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, true).map_err(explain)?;
            connection.pragma_update(None, "locking_mode", "EXCLUSIVE").map_err(explain)?;
            leniently(connection).map_err(explain)
        }
        Err(StoreError::DiskFull { .. }) => leniently(connect_unchanging(path, &place)?).map_err(explain),
        // What else is wrong is found as it is read.
        _ => Ok(connection),
    }
}

/// Connects to a file that does not change.
fn connect_unchanging(path: &Path, place: &Place) -> Result<Connection, StoreError> {
    if has_log(path) {
        return Err(StoreError::Failed {
            address: place.to_string(),
            reason: "is on a read-only file system, with writes still in its log (-wal); copy both files \
                     to where they can be written"
                .to_owned(),
        });
    }
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY
        | OpenFlags::SQLITE_OPEN_URI
        | OpenFlags::SQLITE_OPEN_NO_MUTEX
        | OpenFlags::SQLITE_OPEN_EXRESCODE;
    Connection::open_with_flags(unchanging(path), flags).map_err(|e| failure::explain(place, &e))
}

/// Whether there is nothing in a file. (The files of a virtual file system have no size.)
pub(super) fn is_empty(path: &Path) -> bool {
    use std::io::Read as _;
    !has_log(path) && std::fs::File::open(path).and_then(|mut file| file.read(&mut [0])).is_ok_and(|read| read == 0)
}

/// Removes a file that has not become a memory, with what is beside it. What another process laid out, or uses, stays.
fn remove_blank(path: &Path) {
    let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let Ok(connection) = Connection::open_with_flags(path, flags) else { return };
    // Without room for the index of its log, the log is read by one process alone.
    let alone = connection.pragma_update(None, "locking_mode", "EXCLUSIVE");
    if alone.and_then(|()| Marks::read(&connection)).is_ok_and(|marks| marks.blank) {
        let _ = std::fs::remove_file(path);
        companions(path).iter().for_each(|file| drop(std::fs::remove_file(file)));
    }
}

/// Whether there is a file, on a file system that is mounted read-only.
fn is_read_only(path: &Path) -> bool {
    rustix::fs::statvfs(path).is_ok_and(|system| system.f_flag.contains(rustix::fs::StatVfsMountFlags::RDONLY))
}

/// Whether this process may write the file, or make it.
fn may_write(path: &Path) -> bool {
    !path.exists() || rustix::fs::access(path, rustix::fs::Access::WRITE_OK).is_ok()
}

/// Whether this process may make a log beside the file, or write the one that exists.
fn may_log(path: &Path) -> bool {
    let may = |path: &Path| rustix::fs::access(path, rustix::fs::Access::WRITE_OK).is_ok();
    !path.exists() || may(folder(path)) || may(&log(path))
}

/// Why something that is not a file cannot be a memory.
fn special(path: &Path) -> Option<&'static str> {
    use std::os::unix::fs::FileTypeExt as _;
    let kind = match std::fs::metadata(path) {
        Ok(found) => found.file_type(),
        Err(error) if rustix::io::Errno::from_io_error(&error) == Some(rustix::io::Errno::LOOP) => {
            return Some("it is a symbolic link that leads back to itself; name a file");
        }
        Err(_) => return None,
    };
    match kind {
        kind if kind.is_dir() => Some("it is a directory; name a file in it"),
        kind if kind.is_fifo() => Some("it is a pipe; name a file"),
        kind if kind.is_socket() => Some("it is a socket; name a file"),
        kind if kind.is_char_device() || kind.is_block_device() => {
            Some("it is a device; name a file, or mem: for a memory without one")
        }
        _ => None,
    }
}

/// Whether there are writes that are not folded into the file.
fn has_log(path: &Path) -> bool {
    std::fs::metadata(log(path)).is_ok_and(|log| log.len() > 0)
}

/// SQLite's URI for a file that does not change; each byte of the path that
/// may mean something in a URI is written as its number.
fn unchanging(path: &Path) -> String {
    use std::fmt::Write as _;
    use std::os::unix::ffi::OsStrExt as _;
    let mut uri = String::from("file:");
    for byte in path.as_os_str().as_bytes() {
        match byte {
            b'/' | b'.' | b'-' | b'_' | b'0'..=b'9' | b'A'..=b'Z' | b'a'..=b'z' => uri.push(char::from(*byte)),
            // Writing to a String cannot fail.
            _ => drop(write!(uri, "%{byte:02X}")),
        }
    }
    uri.push_str("?immutable=1");
    uri
}

/// The marks of a memory in an SQLite file.
struct Marks {
    application: i32,
    version: i32,
    blank: bool,
    /// Whether it never had a table.
    untouched: bool,
}

impl Marks {
    fn read(connection: &Connection) -> rusqlite::Result<Self> {
        let sql = "SELECT application_id, user_version, (SELECT count(*) FROM sqlite_schema) = 0, schema_version = 0
                   FROM pragma_application_id, pragma_user_version, pragma_schema_version";
        connection.query_row(sql, [], |row| {
            Ok(Self { application: row.get(0)?, version: row.get(1)?, blank: row.get(2)?, untouched: row.get(3)? })
        })
    }
}

/// Whether a database that never had tables is an empty file, or one that another rmem is laying out. An
/// empty database of another program has pages, and no write-ahead log.
fn is_ours(connection: &Connection) -> rusqlite::Result<bool> {
    let pages: i64 = connection.query_row("PRAGMA page_count", [], |row| row.get(0))?;
    let mode: String = connection.query_row("PRAGMA journal_mode", [], |row| row.get(0))?;
    Ok(pages == 0 || mode == "wal" || mode == "memory")
}

/// Makes a blank file a memory. Several processes may do so at the same time; one of them does.
fn lay_out(connection: &Connection) -> rusqlite::Result<()> {
    busy::retry(|| connection.pragma_update(None, "journal_mode", "WAL"))?;
    connection.execute_batch("BEGIN IMMEDIATE")?;
    let laid_out = Marks::read(connection).and_then(|marks| {
        if !marks.blank {
            return Ok(());
        }
        connection.execute_batch(LAYOUT)?;
        connection.pragma_update(None, "application_id", APPLICATION)?;
        connection.pragma_update(None, "user_version", SEALED)
    });
    connection.execute_batch(if laid_out.is_ok() { "COMMIT" } else { "ROLLBACK" })?;
    laid_out
}

/// Marks a file as one in which a collection has a validator. In a write transaction only.
pub(super) fn mark_validators(connection: &Connection) -> rusqlite::Result<()> {
    connection.pragma_update(None, "user_version", VERSION)
}

/// Marks a file of version 1 as one of version 2, where it may be written.
fn upgrade(connection: &Connection) -> rusqlite::Result<()> {
    if connection.is_readonly("main")? {
        return Ok(());
    }
    connection.execute_batch("BEGIN IMMEDIATE")?;
    let marked = match Marks::read(connection) {
        Ok(Marks { version: UNSEALED, .. }) => connection.pragma_update(None, "user_version", SEALED),
        marks => marks.map(|_| ()),
    };
    connection.execute_batch(if marked.is_ok() { "COMMIT" } else { "ROLLBACK" })?;
    marked
}

/// Settings of a connection; those of the file are set once, in [`lay_out`].
///
/// FULL makes every commit wait for the disk, so that not even a loss of power
/// takes back what was acknowledged. The commit that fills 1000 pages of the log folds
/// them into the file, and the log is cut to 64 MiB after a long reader let it grow. The cache holds some hundred
/// thousand small documents.
fn tune(connection: &Connection) -> rusqlite::Result<()> {
    be_durable(connection, true)?;
    connection.pragma_update(None, "journal_size_limit", 64 << 20)?;
    connection.pragma_update(None, "cache_size", -(32 << 10))?;
    // A damaged page of an index is rather noticed than read wrongly.
    connection.pragma_update(None, "cell_size_check", "ON")?;
    connection.pragma_update(None, "trusted_schema", "OFF")
}

/// Sets whether a commit waits for the disk. Without, it survives the process but not a loss of power.
pub(super) fn be_durable(connection: &Connection, durable: bool) -> rusqlite::Result<()> {
    connection.pragma_update(None, "synchronous", if durable { "FULL" } else { "NORMAL" })
}

fn wrong_version(place: &Place, version: i32) -> StoreError {
    StoreError::Failed {
        address: place.to_string(),
        reason: match version > VERSION {
            true => format!("is a memory of version {version}, this rmem reads version {VERSION}; use a newer rmem"),
            false => format!("is a memory of version {version}, which no rmem wrote; the file is damaged"),
        },
    }
}

/// The error for a file without the tables of a memory.
pub(super) fn foreign(place: &Place) -> StoreError {
    let head = place.file().and_then(|path| head(&path));
    let is_marked = head.is_some_and(|head| head[68..] == APPLICATION.to_be_bytes());
    let reason = match head.is_some_and(|head| head.starts_with(b"SQLite format 3\0")) {
        true if is_marked => {
            "it is damaged: the list of its collections is lost, without which nothing can be read; restore a backup"
        }
        true => "it is an SQLite database of another program, not an rmem memory; name another file",
        false if is_marked => {
            "it is damaged: it does not begin as a memory does, without which nothing can be read; restore a backup"
        }
        false => "it is not an rmem memory; name another file",
    };
    StoreError::Failed { address: place.to_string(), reason: reason.to_owned() }
}

/// The error for a database without the marks of a memory.
fn unmarked(place: &Place, connection: &Connection) -> StoreError {
    let sql = "SELECT count(*) = 4 FROM sqlite_schema WHERE name IN ('collections', 'indexes', 'watchers', 'changes')";
    match connection.query_row(sql, [], |row| row.get(0)) {
        Ok(true) => StoreError::Failed {
            address: place.to_string(),
            reason:
                "it is damaged: its first page has lost the marks of a memory; copy what can be read into a new file \
                     with `rmem repair -o FILE`"
                    .to_owned(),
        },
        _ => foreign(place),
    }
}

/// What an SQLite file begins with, up to the number of its program.
fn head(path: &Path) -> Option<[u8; 72]> {
    use std::io::Read as _;
    let mut head = [0; 72];
    std::fs::File::open(path).and_then(|mut file| file.read_exact(&mut head)).ok().map(|()| head)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::{Namespace, Store as _};
    use bson::doc;

    #[test]
    fn a_file_that_does_not_change_is_read_without_a_log() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a?b#%41 ü.rmem");
        let ns = Namespace::parse("a.b").unwrap();
        Embedded::open(&path).unwrap().insert(&ns, vec![doc! { "_id": 1 }]).unwrap();
        let store = Embedded::open_unchanging(&path, Place::File(path.clone())).unwrap();
        assert_eq!(store.count(&ns, (&doc! {}).into()).unwrap(), 1);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is made beside the file");
        let refusal = store.insert(&ns, vec![doc! {}]).unwrap_err().to_string();
        assert!(refusal.contains("cannot be written"), "{refusal}");
        std::fs::write(folder.path().join("a?b#%41 ü.rmem-wal"), "x").unwrap();
        assert!(Embedded::open_unchanging(&path, Place::File(path.clone())).is_err());
    }
}
