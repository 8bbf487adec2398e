//! A body that is a program of the user.
//!
//! It runs in its folder, without a shell, in a process group of its own that
//! is gone when the body is done. It reads the query as one line of Extended
//! JSON, relaxed, on standard input, where it adds keys behind it the documents, one a line, and writes documents to
//! standard output: JSON lines, or any other text that rmem reads as documents. An exit code other than 0
//! is an error.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use std::time::Duration;

use bson::{Document, RawDocumentBuf};

use super::body::{Asked, Body, ComputeError};
use crate::formats::credentials::masked_message;
use crate::formats::{Diagnostic, Source, Span, shell};
use crate::process::{self, End, Ended, Host, INPUT, Job, Limits, Mode};
use crate::query::QueryError;
use crate::store::{Namespace, metadata};

/// What a program may print, in bytes.
const MOST_OUTPUT: u64 = 64 << 20;
/// How many of its last lines on standard error a message repeats.
const TAIL: usize = 6;

/// A program of the user.
pub(super) struct Command {
    pub(super) words: Vec<String>,
    pub(super) folder: PathBuf,
    pub(super) timeout: Duration,
    pub(super) host: Host<'static>,
}

impl Body for Command {
    fn compute(&self, asked: &Asked<'_>) -> Result<Vec<Document>, ComputeError> {
        let read = |raw: &RawDocumentBuf| Document::try_from(&*metadata::hide(raw.clone())?).map_err(QueryError::from);
        let documents = asked.documents.unwrap_or_default().iter().map(read).collect::<Result<Vec<_>, _>>()?;
        self.answer(asked.query, &documents)
    }

    fn sources(&self, _: &Namespace) -> Vec<Namespace> {
        Vec::new()
    }

    fn describe(&self) -> String {
        format!("command `{}` in {}, at most {:?}", self.line(), self.folder.display(), self.timeout)
    }

    fn timeout(&self) -> Option<Duration> {
        Some(self.timeout)
    }
}

impl Command {
    /// The documents for a query, or the keys that are added to these documents.
    pub(super) fn answer(&self, query: &Document, documents: &[Document]) -> Result<Vec<Document>, ComputeError> {
        let lines = std::iter::once(query).chain(documents).map(|document| shell::relaxed(document) + "\n");
        let question: String = lines.collect();
        let ended = self.run(&question);
        self.read(&ended)
    }

    fn run(&self, question: &str) -> Ended {
        let program = self.program();
        let arguments: Vec<OsString> = self.words.iter().skip(1).map(OsString::from).collect();
        let job = Job {
            program: &program,
            arguments: &arguments,
            files: &[],
            is_fed: true,
            folder: Some(&self.folder),
            environment: None,
            mode: Mode::Captured,
            wanted: |_| None,
        };
        let limits = Limits { time: Some(self.timeout), memory: None, output: MOST_OUTPUT };
        process::run(&job, &[(INPUT, question)], &limits, &self.host)
    }

    /// A program given as a path is one of the folder.
    fn program(&self) -> OsString {
        let program = self.words.first().map_or("", String::as_str);
        match Path::new(program).components().count() > 1 {
            true => self.folder.join(program).into_os_string(),
            false => OsStr::new(program).to_owned(),
        }
    }

    /// The command for messages.
    fn line(&self) -> String {
        masked_message(&self.words.join(" ")).into_owned()
    }

    /// The documents that it printed, or what is wrong.
    fn read(&self, ended: &Ended) -> Result<Vec<Document>, ComputeError> {
        let message = |wrong: &str| format!("its command `{}` {wrong}{}", self.line(), tail(&ended.stderr));
        let wrong = match &ended.end {
            End::Exited(0) => None,
            End::Exited(code) => Some(format!("failed with exit code {code}")),
            End::Signalled(signal) => Some(format!("was ended by signal {signal}")),
            End::OutOfTime => Some(format!(
                "was stopped after {:?}; the computable's `timeout` is how long it may take",
                self.timeout
            )),
            End::TooMuchOutput => Some(format!("was stopped because it printed more than {} MiB", MOST_OUTPUT >> 20)),
            End::Interrupted => Some("was interrupted".to_owned()),
            End::Starved => Some("ran out of memory".to_owned()),
            End::Missing => Some(format!(
                "cannot be run: there is no such program; a path is relative to {}",
                self.folder.display()
            )),
            End::NoInterpreter(path) => Some(format!("cannot be run: its interpreter `{path}` is not there")),
            End::NoFiles(words) | End::SupervisorGone(words) | End::Failed(words) => {
                Some(format!("cannot be run: {words}"))
            }
        };
        if let Some(wrong) = wrong {
            return Err(ComputeError::Failed(message(&wrong)));
        }
        let output = Source::new("its output", ended.stdout.as_str());
        let garbled = ended.garbled.map(|place| {
            let mark = Span::new(place, place + char::REPLACEMENT_CHARACTER.len_utf8());
            Diagnostic::new(&output, mark, "expected UTF-8 text, found invalid UTF-8")
        });
        garbled
            .map_or_else(|| shell::parse_documents(&output), Err)
            .map(|documents| documents.into_iter().map(|(_, document)| document).collect())
            .map_err(|complaint| {
                let wrong = message(&format!("did not print documents, one a line\n{complaint}"));
                ComputeError::Unreadable(wrong, complaint)
            })
    }
}

/// The last lines on standard error, for a message.
fn tail(stderr: &str) -> String {
    let lines: Vec<&str> = stderr.lines().filter(|line| !line.trim().is_empty()).collect();
    let last = lines.iter().skip(lines.len().saturating_sub(TAIL));
    last.map(|line| format!("\n  | {}", line.chars().take(200).collect::<String>())).collect()
}
