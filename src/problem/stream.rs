//! A problem that is written to a temporary file while it is made.
//!
//! This is for problems that are only to be written, however large they are. Where anything is wrong with one, or odd, or
//! cannot be told without knowing where its parts come from, the stream is doubtful: it ends, and the problem is made again as
//! a [`Generated`](super::Generated), whose complaints are exact.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::{self, JoinHandle};

use tempfile::{SpooledTempFile, spooled_tempfile_in};

use super::assembly::Assembler;
use super::{SectionReport, empty_goal, unchecked};
use crate::formats::Span;
use crate::formats::Texts;
use crate::formats::pddl::Dialect;
use crate::pddl::{Domain, Doubtful, Screen};
use crate::store::Namespace;

/// How many bytes of a problem are kept in memory.
const IN_MEMORY: usize = 8 << 20;
/// How many bytes are rendered, and of how many pieces, before they are made into the problem.
const RENDERED: usize = 64 << 10;
const PIECES: usize = 16 << 10;
/// How many parts may wait for this.
const WAITING: usize = 16;
/// After how many bytes a given file is sent to the disk.
const FLUSHED: usize = 2 << 20;

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
    pub(super) file: Destination,
}

/// Where a problem is written.
#[derive(Debug)]
pub(super) enum Destination {
    /// In a file that is only ours.
    Temporary(SpooledTempFile),
    /// In the file that was asked for, and how many bytes of it are not on their way to the disk yet.
    Given(File, usize),
}

/// A file that is written, and read again.
trait Contents: Read + Write + Seek {}

impl<T: Read + Write + Seek> Contents for T {}

impl Destination {
    fn new(file: Option<File>) -> Self {
        match file {
            Some(file) => Self::Given(file, 0),
            None => Self::Temporary(spooled_tempfile_in(IN_MEMORY, std::env::temp_dir())),
        }
    }

    fn contents(&mut self) -> &mut dyn Contents {
        match self {
            Self::Temporary(file) => file,
            Self::Given(file, _) => file,
        }
    }

    fn write(&mut self, text: &str) -> io::Result<()> {
        self.contents().write_all(text.as_bytes())?;
        let Self::Given(file, open) = self else { return Ok(()) };
        *open += text.len();
        if *open < FLUSHED {
            return Ok(());
        }
        // What is on the disk by the end needs not be waited for then.
        *open = 0;
        file.sync_data()
    }

    /// Writes all of it to `out`.
    fn copy_to(&mut self, out: &mut dyn Write) -> io::Result<()> {
        let contents = self.contents();
        contents.rewind()?;
        io::copy(contents, out).map(|_| ())
    }

    /// Its last bytes, of which there are no more than `most`.
    fn tail(&mut self, most: u64) -> io::Result<Vec<u8>> {
        let contents = self.contents();
        let length = contents.seek(SeekFrom::End(0))?;
        contents.seek(SeekFrom::Start(length.saturating_sub(most)))?;
        let mut tail = Vec::new();
        contents.read_to_end(&mut tail)?;
        Ok(tail)
    }
}

impl Streamed {
    /// Whether it is in the file that was given for it.
    #[must_use]
    pub fn is_in_place(&self) -> bool {
        matches!(self.file, Destination::Given(..))
    }

    /// Writes the PDDL text.
    ///
    /// # Errors
    /// Where the temporary file cannot be read, or `out` fails.
    pub fn copy_to(&mut self, out: &mut dyn Write) -> io::Result<()> {
        self.file.copy_to(out)
    }

    /// Whether the metric, or where a section matched nothing the goal, is near the end and empty.
    pub(super) fn has_empty_part(&mut self) -> bool {
        let Ok(tail) = self.file.tail(empty_goal::TAIL as u64) else { return false };
        let tail = String::from_utf8_lossy(&tail);
        let is_goal_empty = || empty_goal::find(&tail).is_some();
        let is_unmatched = self.sections.iter().any(|section| section.matched == 0);
        is_unmatched && is_goal_empty() || unchecked::empty_metric(&tail).is_some()
    }
}

/// A problem under way.
///
/// What is rendered is collected, and made into the problem part by part. If there is more than one part, a thread of its own
/// does this, while the next part is rendered.
#[derive(Debug)]
pub(super) struct Stream {
    rendered: Rendered,
    worker: Worker,
}

/// Who makes rendered parts into the problem.
#[derive(Debug)]
enum Worker {
    /// The thread that renders, until there is enough for another one.
    Here(Box<Writer>),
    /// A thread, which ends with the first doubt.
    Beside { parts: SyncSender<Rendered>, thread: JoinHandle<Result<Box<Writer>, Doubtful>> },
    /// Its thread is joined.
    Gone,
}

/// Text and values in the order in which they were rendered.
#[derive(Debug, Default)]
struct Rendered {
    text: String,
    /// Where each of them ends in the text, and what it is.
    pieces: Vec<(usize, PieceKind)>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PieceKind {
    Text,
    Name,
    Number,
    Goal,
}

impl Stream {
    /// Begins a problem, which is checked if there is a domain.
    pub(super) fn new(template: &Texts, domain: Option<&Domain>, file: Option<File>) -> Self {
        Self { rendered: Rendered::default(), worker: Worker::Here(Box::new(Writer::new(template, domain, file))) }
    }

    /// Adds text.
    pub(super) fn text(&mut self, text: &str) -> Result<(), Doubtful> {
        self.add(text, PieceKind::Text)
    }

    /// Adds a value: its text, as yet not a name, and whether it is a number.
    pub(super) fn value(&mut self, text: &str, number: bool) -> Result<(), Doubtful> {
        self.add(text, if number { PieceKind::Number } else { PieceKind::Name })
    }

    /// Adds the goal.
    pub(super) fn goal(&mut self, goal: &str) -> Result<(), Doubtful> {
        self.add(goal, PieceKind::Goal)
    }

    fn add(&mut self, text: &str, kind: PieceKind) -> Result<(), Doubtful> {
        self.rendered.add(text, kind);
        if self.rendered.text.len() < RENDERED && self.rendered.pieces.len() < PIECES {
            return Ok(());
        }
        let part = std::mem::replace(&mut self.rendered, Rendered::with_capacity());
        self.hand_over(part)
    }

    /// Gives a part to the thread, which begins with the first one.
    fn hand_over(&mut self, part: Rendered) -> Result<(), Doubtful> {
        let (parts, thread) = match std::mem::replace(&mut self.worker, Worker::Gone) {
            Worker::Here(writer) => begin(writer).map_err(|_| Doubtful)?,
            Worker::Beside { parts, thread } => (parts, thread),
            Worker::Gone => return Err(Doubtful),
        };
        parts.send(part).map_err(|_| Doubtful)?;
        self.worker = Worker::Beside { parts, thread };
        Ok(())
    }

    /// Ends the problem; gives the file with its text.
    pub(super) fn finish(self, domain: Option<&Domain>, dialect: Dialect) -> Result<Destination, Doubtful> {
        let mut writer = match self.worker {
            Worker::Here(writer) => writer,
            Worker::Beside { parts, thread } => {
                drop(parts);
                thread.join().map_err(|_| Doubtful)??
            }
            Worker::Gone => return Err(Doubtful),
        };
        writer.take(&self.rendered)?;
        writer.finish(domain, dialect)
    }
}

/// Begins the thread that makes parts into the problem, until there are no more.
#[expect(clippy::type_complexity, reason = "it is spelled out once")]
fn begin(mut writer: Box<Writer>) -> io::Result<(SyncSender<Rendered>, JoinHandle<Result<Box<Writer>, Doubtful>>)> {
    let (parts, waiting) = sync_channel::<Rendered>(WAITING);
    let work = move || {
        waiting.iter().try_for_each(|part| writer.take(&part))?;
        Ok(writer)
    };
    Ok((parts, thread::Builder::new().spawn(work)?))
}

impl Rendered {
    fn with_capacity() -> Self {
        Self { text: String::with_capacity(RENDERED + RENDERED / 4), pieces: Vec::with_capacity(PIECES) }
    }

    fn add(&mut self, text: &str, kind: PieceKind) {
        self.text.push_str(text);
        self.pieces.push((self.text.len(), kind));
    }

    /// The text and the values.
    fn iter(&self) -> impl Iterator<Item = (&str, PieceKind)> {
        let mut start = 0;
        self.pieces.iter().map(move |(end, kind)| {
            let piece = self.text.get(start..*end).unwrap_or_default();
            start = *end;
            (piece, *kind)
        })
    }
}

/// Makes the problem of what was rendered.
#[derive(Debug)]
struct Writer {
    assembler: Assembler,
    /// The check against a domain.
    screen: Option<Screen>,
    file: Destination,
}

impl Writer {
    fn new(template: &Texts, domain: Option<&Domain>, file: Option<File>) -> Self {
        let file = Destination::new(file);
        Self { assembler: Assembler::without_notes(template), screen: domain.map(Screen::new), file }
    }

    /// Makes a part into the problem.
    fn take(&mut self, part: &Rendered) -> Result<(), Doubtful> {
        let mut pieces = part.iter().peekable();
        while let Some((text, kind)) = pieces.next() {
            match kind {
                PieceKind::Text => self.assembler.text(text).map_err(|_| Doubtful)?,
                PieceKind::Name => {
                    let next = pieces.peek().filter(|(_, kind)| *kind == PieceKind::Text).map_or("", |(next, _)| next);
                    if !self.assembler.whole_value(text, next).map_err(|_| Doubtful)? {
                        self.assembler.plain_value(text, false);
                    }
                }
                PieceKind::Number => self.assembler.plain_value(text, true),
                PieceKind::Goal => self.assembler.goal(text, Span::default()).map_err(|_| Doubtful)?,
            }
        }
        self.write()
    }

    /// Checks and writes what was made.
    fn write(&mut self) -> Result<(), Doubtful> {
        let text = self.assembler.made_text();
        if let Some(screen) = &mut self.screen {
            screen.read(text)?;
        }
        // Without room for a temporary file, the problem is made in memory.
        self.file.write(text).map_err(|_| Doubtful)?;
        text.clear();
        Ok(())
    }

    /// Ends the problem; gives the file with its text.
    fn finish(mut self, domain: Option<&Domain>, dialect: Dialect) -> Result<Destination, Doubtful> {
        self.assembler.flush().map_err(|_| Doubtful)?;
        self.write()?;
        if let (Some(screen), Some(domain)) = (self.screen, domain) {
            screen.finish(domain, dialect)?;
        }
        Ok(self.file)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::Source;

    /// The text of a problem of so many atoms, made part by part, and at once; nothing where it is doubtful.
    fn made(atoms: usize, last: &str) -> (Option<String>, Option<String>) {
        let texts = Texts::new(&Source::new("t", ""), []);
        let (mut stream, mut assembler) = (Stream::new(&texts, None, None), Assembler::without_notes(&texts));
        let mut add = |before: &str, value: &str, number: bool| {
            assembler.plain_value(value, number);
            let _ = assembler.text(before);
            stream.value(value, number).and_then(|()| stream.text(before))
        };
        let mut added = add("(", "a b", false);
        for nth in 0..atoms {
            added = added.and_then(|()| add(") (at ", &format!("Box {nth}"), false)).and_then(|()| add(" ", "3", true));
        }
        added = added.and_then(|()| add(")", last, false));
        let streamed = added.and_then(|()| stream.finish(None, Dialect::default())).ok().map(|mut file| {
            let mut bytes = Vec::new();
            file.copy_to(&mut bytes).unwrap();
            String::from_utf8(bytes).unwrap()
        });
        (streamed, assembler.finish().ok().map(|assembled| assembled.text))
    }

    #[test]
    fn a_problem_made_in_parts_has_the_text_of_one_made_at_once() {
        for atoms in [0, 10, 20_000] {
            let (streamed, whole) = made(atoms, "end");
            assert!(streamed.is_some());
            assert_eq!(streamed, whole, "{atoms} atoms");
        }
    }

    #[test]
    fn a_doubt_in_any_part_makes_the_problem_doubtful() {
        // Two names differ in case only.
        for atoms in [1, 20_000] {
            let texts = Texts::new(&Source::new("t", ""), []);
            let mut stream = Stream::new(&texts, None, None);
            let mut add = |value: &str| stream.value(value, false).and_then(|()| stream.text(" (on "));
            let added = add("box").and_then(|()| add("Box"));
            let added = added.and_then(|()| (0..atoms).try_for_each(|nth| add(&format!("b{nth}"))));
            assert!(added.and_then(|()| stream.finish(None, Dialect::default())).is_err(), "{atoms} atoms");
        }
    }
}
