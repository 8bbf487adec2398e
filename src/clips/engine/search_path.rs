//! The folders in which a program finds its files, as Fawkes has them.

use std::cell::RefCell;
use std::path::{Path, PathBuf};

/// The folders, and what stands for parts of their names.
pub(super) struct SearchPath {
    folders: RefCell<Vec<PathBuf>>,
    substitutions: RefCell<Vec<(String, String)>>,
}

impl SearchPath {
    /// These folders.
    pub(super) fn new(folders: &[PathBuf]) -> Self {
        Self { folders: RefCell::new(folders.to_vec()), substitutions: RefCell::default() }
    }

    /// Adds a folder behind the others.
    pub(super) fn add(&self, folder: &str) {
        let mut folder = folder.to_owned();
        for (what, by) in self.substitutions.borrow().iter().filter(|(what, _)| !what.is_empty()) {
            folder = folder.replace(what, by);
        }
        self.folders.borrow_mut().push(PathBuf::from(folder));
    }

    /// Lets a text in the names of folders that are added from now on stand for another.
    pub(super) fn substitute(&self, what: &str, by: &str) {
        self.substitutions.borrow_mut().push((what.to_owned(), by.to_owned()));
    }

    /// The folders, each with a `/` at its end.
    pub(super) fn folders(&self) -> Vec<String> {
        let ended = |folder: &PathBuf| format!("{}/", folder.display().to_string().trim_end_matches('/'));
        self.folders.borrow().iter().map(ended).collect()
    }

    /// The file of this name in the first folder that has it.
    pub(super) fn find(&self, name: &str) -> Option<PathBuf> {
        if Path::new(name).is_absolute() {
            return Some(PathBuf::from(name)).filter(|path| path.is_file());
        }
        let within = |folder: &PathBuf| if folder == Path::new(".") { PathBuf::from(name) } else { folder.join(name) };
        self.folders.borrow().iter().map(within).find(|path| path.is_file())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_are_added_with_their_substitutions() {
        let search = SearchPath::new(&[PathBuf::from("agent/"), PathBuf::from(".")]);
        search.add("@BASEDIR@/x");
        search.substitute("@BASEDIR@", "/opt/robot");
        search.add("@BASEDIR@/clips");
        assert_eq!(search.folders(), ["agent/", "./", "@BASEDIR@/x/", "/opt/robot/clips/"]);
        assert_eq!(search.find("no such file.clp"), None);
        assert_eq!(search.find("/no such file.clp"), None);
    }
}
