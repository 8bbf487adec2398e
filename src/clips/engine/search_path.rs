//! The folders in which a program finds its files, as Fawkes has them.

use std::cell::RefCell;
use std::path::{Path, PathBuf};

/// The folders, and what stands for parts of their names.
pub(super) struct SearchPath {
    folders: RefCell<Vec<PathBuf>>,
    substitutions: RefCell<Vec<(String, String)>>,
    /// The files that are being loaded, each by a command in the one before it.
    open: RefCell<Vec<PathBuf>>,
}

/// At most so many files load one another.
pub(super) const MOST_OPEN: usize = 64;
/// The longest name of a folder.
const LONGEST: usize = 4096;

/// A file that is being loaded.
pub(super) struct Open<'a>(&'a SearchPath);

impl Drop for Open<'_> {
    fn drop(&mut self) {
        self.0.open.borrow_mut().pop();
    }
}

impl SearchPath {
    /// These folders.
    pub(super) fn new(folders: &[PathBuf]) -> Self {
        Self { folders: RefCell::new(folders.to_vec()), substitutions: RefCell::default(), open: RefCell::default() }
    }

    /// Adds a folder behind the others; returns whether its name can be that of one.
    pub(super) fn add(&self, folder: &str) -> bool {
        let mut folder = folder.to_owned();
        for (what, by) in self.substitutions.borrow().iter().filter(|(what, _)| !what.is_empty()) {
            if folder.len() > LONGEST {
                break;
            }
            folder = folder.replace(what, by);
        }
        let is_short = folder.len() <= LONGEST;
        if is_short {
            self.folders.borrow_mut().push(PathBuf::from(folder));
        }
        is_short
    }

    /// Notes that a file is being loaded; `None` where it is already, or too many are.
    pub(super) fn open(&self, path: &Path) -> Option<Open<'_>> {
        let path = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        let mut open = self.open.borrow_mut();
        if open.len() >= MOST_OPEN || open.contains(&path) {
            return None;
        }
        open.push(path);
        Some(Open(self))
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
