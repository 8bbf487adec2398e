//! Reading what a program left in the directory of its run.

use std::fs::{self, File};
use std::io::Read as _;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::time::Instant;

use rustix::fs::OFlags;

use super::end::End;
use super::host::Host;
use crate::formats::Source;

/// How much of a file is read or written between two looks at the clock.
pub(super) const PIECE: usize = 1 << 20;

/// The largest file that is read, in bytes.
const LARGEST_FILE: u64 = 16 << 20;

/// How long there is to read what a program left.
pub(super) struct Reading<'a> {
    pub(super) host: &'a Host<'a>,
    /// Whether it goes on after an interruption.
    pub(super) is_kept: bool,
    pub(super) deadline: Option<Instant>,
}

impl Reading<'_> {
    /// Why nothing more is to be read.
    pub(super) fn over(&self) -> Option<End> {
        match self.deadline {
            _ if self.host.is_interrupted() && !self.is_kept => Some(End::Interrupted),
            Some(deadline) if Instant::now() > deadline => Some(End::OutOfTime),
            _ => None,
        }
    }

    /// The first `limit` bytes of a file in the run's directory. What is not a file of its own
    /// there has no text: a pipe, a device, a link that leads out.
    pub(super) fn text(&self, directory: &Path, name: &str, limit: u64) -> Option<Printed> {
        let path = directory.join(name).canonicalize().ok()?;
        if !path.starts_with(directory.canonicalize().ok()?) {
            return None;
        }
        // Between a look at a file and its opening, it could become another.
        let flags = (OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::NOCTTY).bits();
        let file = File::options().read(true).custom_flags(i32::try_from(flags).ok()?).open(path).ok()?;
        if !file.metadata().ok()?.is_file() {
            return None;
        }
        let (mut file, mut bytes) = (file.take(limit), Vec::new());
        while self.over().is_none() && file.by_ref().take(PIECE as u64).read_to_end(&mut bytes).ok()? > 0 {}
        Some(Printed::from(bytes))
    }
}

/// What a program wrote, as text.
#[derive(Debug, Default)]
pub(super) struct Printed {
    /// With marks for what is not UTF-8.
    pub(super) text: String,
    /// How many bytes lie before the first of those marks, where there is one.
    pub(super) garbled: Option<usize>,
}

impl From<Vec<u8>> for Printed {
    fn from(bytes: Vec<u8>) -> Self {
        match String::from_utf8(bytes) {
            Ok(text) => Self { text, garbled: None },
            Err(error) => Self {
                text: String::from_utf8_lossy(error.as_bytes()).into_owned(),
                garbled: Some(error.utf8_error().valid_up_to()),
            },
        }
    }
}

/// The wanted files in the run's directory, in their order.
pub(super) fn files(directory: &Path, reading: &Reading<'_>, wanted: fn(&str) -> Option<u64>) -> Vec<Source> {
    let Ok(entries) = fs::read_dir(directory) else { return Vec::new() };
    let names = entries.flatten().filter_map(|entry| entry.file_name().into_string().ok());
    let mut names: Vec<(u64, String)> = names.filter_map(|name| Some((wanted(&name)?, name))).collect();
    names.sort();
    let texts = names.into_iter().filter_map(|(_, name)| {
        let printed = reading.text(directory, &name, LARGEST_FILE)?;
        Some(Source::new(name, printed.text))
    });
    texts.collect()
}
