//! The files of a robot's configuration, as Fawkes has them.
//!
//! Where a file begins with a document that has `include`, the files and folders that it names are read behind it: those with
//! the tag `!ignore-missing` where they exist, and the one with `!host-specific`, which may be missing, behind all
//! others. `$host` in a name is the name of this computer. Names are relative to the folder of the first file. Source:
//! Fawkes' `src/libs/config/yaml.cpp`.

use std::collections::{HashSet, VecDeque};
use std::path::{Path, PathBuf};

use bson::Document;

use crate::fault::{AtFault, Fault};
use crate::formats::{Diagnostic, Source, yaml};
use crate::input::{WrongInput, decode, read_file};

/// The key of the files that are included.
const INCLUDE: &str = "include";
/// The keys of a document that is about the file, and no part of the configuration.
const ABOUT: [&str; 2] = [INCLUDE, "doc-url"];
/// At most so many files are included.
const MOST_FILES: usize = 10_000;

/// Why a configuration cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ConfigurationError {
    /// What is written in a file is wrong.
    #[error(transparent)]
    Text(#[from] Diagnostic),
    /// A file cannot be read.
    #[error(transparent)]
    File(#[from] WrongInput),
}

impl AtFault for ConfigurationError {
    fn fault(&self) -> Fault {
        match self {
            Self::Text(diagnostic) => diagnostic.fault(),
            Self::File(wrong) => wrong.fault(),
        }
    }
}

/// Reads the configuration in a file, and what it includes; a later document changes those before it.
///
/// # Errors
/// Where the file, or one that it includes, cannot be read or is no YAML.
pub fn read(path: &str) -> Result<Vec<Document>, ConfigurationError> {
    documents(&decode(path, read_file(Path::new(path))?)?)
}

/// Returns the documents of a configuration, and of the files that it includes; a later one changes those before it.
///
/// # Errors
/// Where it is no YAML, or a file that it includes cannot be read.
pub fn documents(first: &Source) -> Result<Vec<Document>, ConfigurationError> {
    let folder = Path::new(first.name()).parent().unwrap_or(Path::new("")).to_owned();
    let mut files = Files { folder, waiting: VecDeque::new(), known: HashSet::new(), of_host: None };
    files.known.extend(std::fs::canonicalize(first.name()));
    let mut all = files.of_file(first)?;
    while let Some(path) = files.waiting.pop_front() {
        all.extend(files.open(&path)?);
    }
    if let Some(path) = files.of_host.take().filter(|path| path.exists()) {
        all.extend(files.open(&path)?);
    }
    Ok(all)
}

/// The files that are included.
struct Files {
    folder: PathBuf,
    waiting: VecDeque<PathBuf>,
    /// Those that were read or wait: each is read once.
    known: HashSet<PathBuf>,
    of_host: Option<PathBuf>,
}

impl Files {
    fn open(&mut self, path: &Path) -> Result<Vec<Document>, ConfigurationError> {
        let name = path.display().to_string();
        self.of_file(&decode(&name, read_file(path)?)?)
    }

    /// The documents of a file; what it includes waits.
    fn of_file(&mut self, source: &Source) -> Result<Vec<Document>, ConfigurationError> {
        let mut documents =
            yaml::documents(source).map(|read| read.map(|(_, document)| document)).collect::<Result<Vec<_>, _>>()?;
        let is_about = |document: &Document| document.keys().all(|key| ABOUT.contains(&key.as_str()));
        if documents.len() > 1 && documents.first().is_some_and(is_about) {
            documents.remove(0);
            for (tag, name) in yaml::tagged_texts(source, INCLUDE) {
                self.include(tag.as_deref(), &name)?;
            }
        }
        Ok(documents)
    }

    fn include(&mut self, tag: Option<&str>, name: &str) -> Result<(), ConfigurationError> {
        let host = rustix::system::uname().nodename().to_string_lossy().into_owned();
        let path = self.folder.join(name.replace("$host", &host));
        match tag {
            Some("host-specific") => self.of_host = Some(path),
            Some("ignore-missing") if !path.exists() => {}
            _ if name.ends_with('/') => {
                for path in in_folder(&path)? {
                    self.add(path)?;
                }
            }
            _ => self.add(path)?,
        }
        Ok(())
    }

    /// Lets a file wait, unless it is known.
    fn add(&mut self, path: PathBuf) -> Result<(), ConfigurationError> {
        let name = std::fs::canonicalize(&path).unwrap_or_else(|_| path.clone());
        if self.known.insert(name) {
            if self.known.len() > MOST_FILES {
                return Err(WrongInput::new(format!("the configuration includes more than {MOST_FILES} files")).into());
            }
            self.waiting.push_back(path);
        }
        Ok(())
    }
}

/// The files of a folder whose names are letters, digits, `_` and `-`, and end in `.yaml`, sorted.
fn in_folder(path: &Path) -> Result<Vec<PathBuf>, WrongInput> {
    let unread = |error| crate::input::unreadable(&path.display().to_string(), &error);
    let mut found = Vec::new();
    for entry in std::fs::read_dir(path).map_err(unread)? {
        let path = entry.map_err(unread)?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let is_plain =
            |stem: &str| !stem.is_empty() && stem.chars().all(|c| c.is_ascii_alphanumeric() || "_-".contains(c));
        if name.strip_suffix(".yaml").is_some_and(is_plain) {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::doc;

    #[test]
    fn files_and_folders_are_included_each_once() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        let includes =
            "include:\n  - !ignore-missing none/\n  - conf.d/\n  - more.yaml\n  - !host-specific host.yaml\n";
        write("config.yaml", &format!("%YAML 1.2\n%TAG ! tag:fawkesrobotics.org,cfg/\n---\n{includes}---\na: 1\n"));
        write("conf.d/y.yaml", "doc-url: !url http://localhost\n---\na: 2\n");
        write("conf.d/x.yaml", "include: [config.yaml, conf.d/x.yaml]\n---\nb: 1\n");
        write("conf.d/not.yaml~", "c: 1\n");
        write("more.yaml", "d: 1\n");
        write("host.yaml", "a: 3\n");
        let path = folder.path().join("config.yaml").display().to_string();
        let expected = [doc! { "a": 1 }, doc! { "b": 1 }, doc! { "a": 2 }, doc! { "d": 1 }, doc! { "a": 3 }];
        assert_eq!(read(&path).unwrap(), expected);
        write("more.yaml", "include: [absent.yaml]\n---\nd: 1\n");
        assert!(read(&path).unwrap_err().to_string().contains("absent.yaml"));
        assert!(read(&folder.path().display().to_string()).is_err());
        assert!(read("/dev/zero").unwrap_err().to_string().contains("not a file"));
    }
}
