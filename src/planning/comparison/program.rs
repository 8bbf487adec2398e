//! The files that a planner's command names, by which a changed planner is recognised.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

/// Returns path, size and time of modification of a command's program and of the files among its arguments. `program` is
/// where the program was found.
#[must_use]
pub fn program_files(program: Option<PathBuf>, command: &[OsString]) -> Vec<String> {
    let arguments = command.iter().skip(1).map(PathBuf::from).filter(|path| path.is_absolute());
    program.into_iter().chain(arguments).filter_map(|path| described(&path)).collect()
}

/// A file with its size in bytes and its time of modification in nanoseconds; none where there is no such file.
fn described(path: &Path) -> Option<String> {
    let metadata = path.metadata().ok().filter(std::fs::Metadata::is_file)?;
    let modified = metadata.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok()).unwrap_or_default();
    let path = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    Some(format!("{} {} {}", path.display(), metadata.len(), modified.as_nanos()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_changed_script_makes_another_program() {
        let folder = tempfile::tempdir().unwrap();
        let script = folder.path().join("planner.sh");
        std::fs::write(&script, "echo one").unwrap();
        let command = ["sh".into(), script.clone().into_os_string(), "{domain}".into()];
        let before = program_files(None, &command);
        assert_eq!(before.len(), 1);
        std::fs::write(&script, "echo several").unwrap();
        assert_ne!(program_files(None, &command), before);
    }
}
