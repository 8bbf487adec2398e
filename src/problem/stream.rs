//! A problem that is written to a temporary file while it is made.
//!
//! This is for problems that are only to be written, however large they are. Where anything is wrong with one, or odd, or
//! cannot be told without knowing where its parts come from, the stream is doubtful: it ends, and the problem is made again as
//! a [`Generated`](super::Generated), whose complaints are exact.

use std::io::{self, Read as _, Seek as _, SeekFrom, Write};

use tempfile::{SpooledTempFile, spooled_tempfile_in};

use super::assembly::Assembler;
use super::{SectionReport, empty_goal};
use crate::formats::Span;
use crate::formats::Texts;
use crate::formats::pddl::Dialect;
use crate::pddl::{Domain, Doubtful, Screen};
use crate::store::Namespace;

/// How many bytes of a problem are kept in memory.
const IN_MEMORY: usize = 8 << 20;
/// How many bytes are made before they are checked and written.
const PART: usize = 64 << 10;

/// A problem that was made without being held, and what was asked for it.
#[derive(Debug)]
pub struct Streamed {
    /// The queries of the template in the order in which they were first asked.
    pub sections: Vec<SectionReport>,
    /// All namespaces that the template asked, for whatever, in the order in which they were first asked.
    pub namespaces: Vec<Namespace>,
    /// Keys that documents have in another spelling than the template: sentences for the user.
    pub respelled: Vec<String>,
    /// Whether a goal was given that nothing of what was rendered used.
    pub is_goal_unused: bool,
    pub(super) file: SpooledTempFile,
}

impl Streamed {
    /// Writes the PDDL text.
    ///
    /// # Errors
    /// Where the temporary file cannot be read, or `out` fails.
    pub fn copy_to(&mut self, out: &mut dyn Write) -> io::Result<()> {
        self.file.rewind()?;
        io::copy(&mut self.file, out).map(|_| ())
    }

    /// Whether a section matched nothing and the goal, if it is near the end, is empty.
    pub(super) fn has_empty_goal(&mut self) -> bool {
        let mut tail = Vec::new();
        let mut read = || -> io::Result<usize> {
            let length = self.file.seek(SeekFrom::End(0))?;
            self.file.seek(SeekFrom::Start(length.saturating_sub(empty_goal::TAIL as u64)))?;
            self.file.read_to_end(&mut tail)
        };
        let is_read = self.sections.iter().any(|section| section.matched == 0) && read().is_ok();
        is_read && empty_goal::find(&String::from_utf8_lossy(&tail)).is_some()
    }
}

/// A problem under way.
#[derive(Debug)]
pub(super) struct Stream {
    assembler: Assembler,
    /// The check against a domain.
    screen: Option<Screen>,
    file: SpooledTempFile,
}

impl Stream {
    /// Begins a problem, which is checked if there is a domain.
    pub(super) fn new(template: &Texts, domain: Option<&Domain>) -> Self {
        let file = spooled_tempfile_in(IN_MEMORY, std::env::temp_dir());
        Self { assembler: Assembler::without_notes(template), screen: domain.map(Screen::new), file }
    }

    /// Adds text.
    pub(super) fn text(&mut self, text: &str) -> Result<(), Doubtful> {
        self.assembler.text(text).map_err(|_| Doubtful)?;
        self.write(PART)
    }

    /// Adds a value: its text, as yet not a name, and whether it is a number.
    pub(super) fn value(&mut self, text: &str, number: bool) {
        self.assembler.plain_value(text, number);
    }

    /// Adds the goal.
    pub(super) fn goal(&mut self, goal: &str) -> Result<(), Doubtful> {
        self.assembler.goal(goal, Span::default()).map_err(|_| Doubtful)
    }

    /// Checks and writes what was made, unless it is still short.
    fn write(&mut self, short: usize) -> Result<(), Doubtful> {
        let text = self.assembler.made_text();
        if text.len() < short {
            return Ok(());
        }
        if let Some(screen) = &mut self.screen {
            screen.read(text)?;
        }
        // Without room for a temporary file, the problem is made in memory.
        self.file.write_all(text.as_bytes()).map_err(|_| Doubtful)?;
        text.clear();
        Ok(())
    }

    /// Ends the problem; gives the file with its text.
    pub(super) fn finish(mut self, domain: Option<&Domain>, dialect: Dialect) -> Result<SpooledTempFile, Doubtful> {
        self.assembler.flush().map_err(|_| Doubtful)?;
        self.write(0)?;
        if let (Some(screen), Some(domain)) = (self.screen, domain) {
            screen.finish(domain, dialect)?;
        }
        Ok(self.file)
    }
}
