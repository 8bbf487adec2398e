//! Where a program is.

use std::ffi::OsStr;
use std::path::PathBuf;

/// Returns the path of an executable program: a name is looked for in the folders of `path` (spelled as in `PATH`),
/// a path is taken as it is.
#[must_use]
pub fn find(program: &OsStr, path: Option<&OsStr>) -> Option<PathBuf> {
    which::which_in(program, path, ".").ok()
}

#[cfg(test)]
mod tests {
    use std::fs::{self, Permissions};
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    #[test]
    fn a_file_that_may_not_be_executed_is_passed_over() {
        let (first, second) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        fs::write(first.path().join("planner"), "a text").unwrap();
        let program = second.path().join("planner");
        fs::write(&program, "#!/bin/sh\n").unwrap();
        fs::set_permissions(&program, Permissions::from_mode(0o755)).unwrap();
        let path = std::env::join_paths([first.path(), second.path()]).unwrap();
        assert_eq!(find(OsStr::new("planner"), Some(&path)), Some(program.clone()));
        assert_eq!(find(program.as_os_str(), None), Some(program));
        assert_eq!(find(first.path().join("planner").as_os_str(), Some(&path)), None);
        assert_eq!(find(OsStr::new("planner"), None), None);
    }
}
