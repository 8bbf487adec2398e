//! Temporary files and folders of processes that were killed.
//!
//! Their names hold the process that made them, so that the next process that makes one in the same
//! folder removes what killed processes left there.

use std::fs;
use std::path::Path;
use std::time::Duration;

use super::holder::{Holder, Life};

/// The age at which the files of a process that cannot be seen from here are removed: no run is expected to take a day.
const MAX_AGE: Duration = Duration::from_secs(24 * 3600);

/// Returns the beginning of a name for a temporary file of this process, to be followed by random
/// letters. Removes what killed processes left in the folder under names with the same prefix.
pub(crate) fn prefix(folder: &Path, prefix: &str) -> String {
    sweep(folder, prefix);
    format!("{prefix}{}-", Holder::myself().tag())
}

/// Removes what killed processes left. What cannot be removed stays: it may belong to another user.
fn sweep(folder: &Path, prefix: &str) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let Some(tag) = name.to_str().and_then(|name| own(name).strip_prefix(prefix)?.rsplit_once('-')) else {
            continue;
        };
        let Some(life) = Holder::life_of(tag.0) else { continue };
        let Ok(found) = entry.metadata() else { continue };
        let is_old = found.modified().ok().and_then(|at| at.elapsed().ok()).is_some_and(|age| age > MAX_AGE);
        if life == Life::Over || (life != Life::Running && is_old) {
            let _ = match found.is_dir() {
                true => fs::remove_dir_all(entry.path()),
                false => fs::remove_file(entry.path()),
            };
        }
    }
}

/// What SQLite puts behind the name of a file for its log.
pub(crate) const SQLITE_LOG: &str = "-wal";
/// What SQLite puts behind the name of a file for those that it makes beside it.
pub(crate) const SQLITE_ENDS: [&str; 3] = ["-journal", SQLITE_LOG, "-shm"];

/// A name, without what SQLite puts behind it for a file beside another.
fn own(name: &str) -> &str {
    SQLITE_ENDS.iter().find_map(|end| name.strip_suffix(end)).unwrap_or(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_files_of_ended_processes_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let mine = prefix(folder.path(), ".rmem-");
        let (tag, _) = mine.rsplit_once('-').unwrap();
        let (process, _) = tag.rsplit_once('.').unwrap();
        let names = [
            format!("{mine}abc"),
            format!("{mine}abc-wal"),
            format!("{process}.1-abc"),
            format!("{process}.1-abc-wal"),
            ".rmem-plan".to_owned(),
            "other-1".to_owned(),
        ];
        for name in &names {
            fs::create_dir(folder.path().join(name)).unwrap();
        }
        prefix(folder.path(), ".rmem-");
        let is_there = names.map(|name| folder.path().join(name).exists());
        assert_eq!(is_there, [true, true, false, false, true, true]);
    }
}
