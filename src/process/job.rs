//! What is to be run, and how.

use std::ffi::{OsStr, OsString};
use std::path::Path;

/// The file in the run's directory that the program reads as standard input.
pub(crate) const INPUT: &str = "stdin";

/// A program to run, in a directory made for the run.
pub(crate) struct Job<'a> {
    pub(crate) program: &'a OsStr,
    pub(crate) arguments: &'a [OsString],
    /// Files in the run's directory: what stands for one in the arguments, and its name there.
    pub(crate) files: &'a [(&'a str, &'a str)],
    /// Whether the program reads [`INPUT`]; else it has nothing on standard input.
    pub(crate) is_fed: bool,
    /// Where the program runs, where that is not the run's directory.
    pub(crate) folder: Option<&'a Path>,
    /// The whole environment, where it is not rmem's.
    pub(crate) environment: Option<&'a [(&'a str, &'a str)]>,
    /// How it runs.
    pub(crate) mode: Mode<'a>,
    /// Which of the files it leaves are wanted: where one stands among them, by its name.
    pub(crate) wanted: fn(&str) -> Option<u64>,
}

/// How a program runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mode<'a> {
    /// For rmem: its output is captured, and nothing that it started outlives it.
    Captured,
    /// For the user: it has rmem's standard streams and these additional variables, and may leave something in
    /// the background when it ends by itself.
    Attached(&'a [(&'a str, &'a str)]),
}

/// A program given as a relative path, as the caller's folder has it; the run has another.
pub(super) fn located(program: &OsStr) -> OsString {
    let path = Path::new(program);
    match path.components().count() > 1 {
        true => std::path::absolute(path).map_or_else(|_| program.to_owned(), Into::into),
        false => program.to_owned(),
    }
}

/// A word of a command with the paths of the run's files in it. They are absolute, for the
/// sake of wrappers that change the folder.
pub(super) fn filled(word: &OsStr, directory: &Path, files: &[(&str, &str)]) -> OsString {
    match word.to_str() {
        Some(text) if text.contains('{') => {
            let path = |file: &str| directory.join(file).to_string_lossy().into_owned();
            files.iter().fold(text.to_owned(), |text, (mark, file)| text.replace(mark, &path(file))).into()
        }
        _ => word.to_owned(),
    }
}
