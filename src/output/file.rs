//! Files that appear whole or not at all.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Read as _, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use crate::error::Result;
use crate::interrupt::Unfinished;
use crate::process::stale_files;

/// Writes beside the target and renames. Devices and pipes are written directly;
/// a symbolic link stays one; an existing file keeps its permissions. A memory is not replaced by text.
pub(super) fn write_atomically(path: &Path, write: impl FnOnce(&mut dyn Write) -> Result<()>) -> Result<()> {
    let target = Target::find(path);
    if target.is_direct {
        let mut out = BufWriter::new(OpenOptions::new().append(true).open(path)?);
        write(&mut out)?;
        return Ok(out.flush()?);
    }
    let pending = Pending::beside(target)?;
    let mut out = BufWriter::new(Unnamed(pending.file()));
    write(&mut out)?;
    out.flush()?;
    drop(out);
    Ok(pending.finish()?)
}

/// What is to be written.
#[derive(Debug)]
struct Target {
    /// Where it is; a symbolic link was followed.
    path: PathBuf,
    existing: Option<fs::Metadata>,
    /// Whether it is a device, a pipe or an open file, in whose place no other can be put.
    is_direct: bool,
}

impl Target {
    fn find(path: &Path) -> Self {
        let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let existing = fs::metadata(&target).ok();
        let is_special = existing.as_ref().is_some_and(|found| !found.is_file() && !found.is_dir());
        let is_direct = is_special || path.starts_with("/dev/fd") || path.starts_with("/proc");
        Self { path: target, existing, is_direct }
    }
}

/// A file that is written beside its target, and takes its place when it is whole; else it goes.
#[derive(Debug)]
pub struct Pending {
    file: NamedTempFile,
    /// Until the file has gone or taken the place of its target.
    _unfinished: Unfinished,
    target: Target,
}

impl Pending {
    /// Begins a file; nothing where that is no plain file, or cannot be written.
    pub(super) fn begin(path: &Path) -> Option<Self> {
        let target = Target::find(path);
        (!target.is_direct).then(|| Self::beside(target).ok()).flatten()
    }

    fn beside(target: Target) -> io::Result<Self> {
        if target.existing.as_ref().is_some_and(fs::Metadata::is_dir) {
            return Err(io::Error::from(io::ErrorKind::IsADirectory));
        }
        if target.existing.is_some() && is_database(&target.path) {
            return Err(io::Error::other("it is a memory, or another SQLite database; name another file"));
        }
        let folder = match target.path.parent() {
            Some(parent) if parent != Path::new("") => parent,
            _ => Path::new("."),
        };
        let mut builder = tempfile::Builder::new();
        let prefix = stale_files::prefix(folder, ".rmem-");
        builder.prefix(&prefix);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt as _;
            builder.permissions(fs::Permissions::from_mode(0o666));
        }
        let unnamed = |error: io::Error| io::Error::from(error.kind());
        let make = || builder.tempfile_in(folder).map_err(unnamed);
        let (file, unfinished) = Unfinished::making(make, |file| vec![file.path().to_owned()])?;
        Ok(Self { _unfinished: unfinished, file, target })
    }

    /// What is to be written.
    #[must_use]
    pub fn file(&self) -> &File {
        self.file.as_file()
    }

    /// Puts the file in the place of its target.
    pub(super) fn finish(self) -> io::Result<()> {
        if let Some(existing) = self.target.existing {
            self.file.as_file().set_permissions(existing.permissions())?;
        }
        self.file.as_file().sync_all()?;
        self.file.persist(&self.target.path).map_err(|error| error.error)?;
        Ok(())
    }
}

/// Whether a file begins as those of SQLite do (its documentation, "Database File Format", section 1.3.1).
fn is_database(path: &Path) -> bool {
    let mut start = [0; 16];
    File::open(path).and_then(|mut file| file.read_exact(&mut start)).is_ok() && start == *b"SQLite format 3\0"
}

/// A temporary file, whose name is not in its errors.
struct Unnamed<'a>(&'a File);

impl Write for Unnamed<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(bytes).map_err(|error| io::Error::from(error.kind()))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_appear_whole_and_keep_their_permissions() {
        use std::os::unix::fs::PermissionsExt as _;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out");
        write_atomically(&path, |out| Ok(out.write_all(b"one")?)).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
        write_atomically(&path, |out| Ok(out.write_all(b"two")?)).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o640);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_pending_file_takes_the_place_of_its_target_or_goes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out");
        for is_finished in [false, true] {
            let pending = Pending::begin(&path).unwrap();
            pending.file().write_all(b"one").unwrap();
            if is_finished {
                pending.finish().unwrap()
            } else {
                drop(pending)
            }
            assert_eq!(
                (path.exists(), fs::read_dir(folder.path()).unwrap().count()),
                (is_finished, is_finished.into())
            );
        }
        for path in [folder.path(), Path::new("/dev/null"), &folder.path().join("missing/out")] {
            assert!(Pending::begin(path).is_none(), "{}", path.display());
        }
    }

    #[test]
    fn a_symbolic_link_stays_one() {
        let folder = tempfile::tempdir().unwrap();
        let (target, link) = (folder.path().join("target"), folder.path().join("link"));
        fs::write(&target, "old").unwrap();
        std::os::unix::fs::symlink(&target, &link).unwrap();
        write_atomically(&link, |out| Ok(out.write_all(b"new")?)).unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read(&target).unwrap(), b"new");
    }

    #[test]
    fn a_memory_is_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let (path, link) = (folder.path().join("robot.rmem"), folder.path().join("link"));
        drop(crate::store::Embedded::open(&path).unwrap());
        std::os::unix::fs::symlink(&path, &link).unwrap();
        let before = fs::read(&path).unwrap();
        for path in [&path, &link] {
            let refused = write_atomically(path, |out| Ok(out.write_all(b"text")?)).unwrap_err();
            assert!(refused.to_string().contains("it is a memory"), "{refused}");
        }
        assert_eq!(fs::read(&path).unwrap(), before);
    }

    #[test]
    fn a_failed_write_leaves_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        assert!(write_atomically(&folder.path().join("missing/out"), |out| Ok(out.write_all(b"x")?)).is_err());
        assert!(write_atomically(folder.path(), |out| Ok(out.write_all(b"x")?)).is_err());
    }
}
