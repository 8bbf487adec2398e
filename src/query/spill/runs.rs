//! Sorted runs in temporary files, and merging them.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::path::{Path, PathBuf};

use super::file::{Keeper, Kept};
use crate::query::error::{QueryError, Result};

/// The most runs of one level; so many become one of the next.
const MOST: usize = 32;

/// Records of a key and a body, in sorted runs.
#[derive(Debug)]
pub(in crate::query) struct Runs {
    folder: PathBuf,
    /// The runs in the order of their records, with how often they were merged.
    runs: Vec<(u32, Kept)>,
}

/// The next record of a run: its key, the number of the run, and its body.
type Next = (Vec<u8>, usize, Vec<u8>);

/// The records of all runs in order of their keys; of equal ones, those of earlier runs come first.
pub(in crate::query) struct Merged {
    runs: Vec<Kept>,
    next: BinaryHeap<Reverse<Next>>,
}

impl Runs {
    pub(in crate::query) fn new(folder: &Path) -> Self {
        Self { folder: folder.to_owned(), runs: Vec::new() }
    }

    pub(in crate::query) fn is_empty(&self) -> bool {
        self.runs.is_empty()
    }

    /// Returns how many runs there are.
    #[cfg(test)]
    pub(super) fn runs(&self) -> usize {
        self.runs.len()
    }

    /// Adds a run of records that are sorted by their keys.
    pub(in crate::query) fn add<K: AsRef<[u8]>, B: AsRef<[u8]>, E: From<QueryError>>(
        &mut self,
        records: impl Iterator<Item = std::result::Result<(K, B), E>>,
    ) -> std::result::Result<(), E> {
        let run = self.written(records)?;
        self.runs.push((0, run));
        while let Some((level, same)) = self.full() {
            let runs = self.runs.split_off(self.runs.len() - same).into_iter().map(|(_, run)| run).collect();
            let run = self.written(Merged::new(runs)?)?;
            self.runs.push((level + 1, run));
        }
        Ok(())
    }

    /// Returns the level of the last runs and their number, where they are to be merged.
    fn full(&self) -> Option<(u32, usize)> {
        let level = self.runs.last()?.0;
        let same = self.runs.iter().rev().take_while(|(other, _)| *other == level).count();
        (same >= MOST).then_some((level, same))
    }

    fn written<K: AsRef<[u8]>, B: AsRef<[u8]>, E: From<QueryError>>(
        &self,
        records: impl Iterator<Item = std::result::Result<(K, B), E>>,
    ) -> std::result::Result<Kept, E> {
        let mut file = Keeper::new(&self.folder)?;
        for record in records {
            let (key, body) = record?;
            file.put(key.as_ref())?;
            file.put(body.as_ref())?;
        }
        Ok(file.read()?)
    }

    /// Returns all records in order.
    pub(in crate::query) fn merged(self) -> Result<Merged> {
        Merged::new(self.runs.into_iter().map(|(_, run)| run).collect())
    }
}

impl Merged {
    fn new(runs: Vec<Kept>) -> Result<Self> {
        let mut merged = Self { next: BinaryHeap::with_capacity(runs.len()), runs };
        (0..merged.runs.len()).try_for_each(|run| merged.read(run))?;
        Ok(merged)
    }

    /// Reads the next record of a run.
    fn read(&mut self, number: usize) -> Result<()> {
        let Some(run) = self.runs.get_mut(number) else { return Ok(()) };
        if let Some(key) = run.next()? {
            self.next.push(Reverse((key, number, run.rest()?)));
        }
        Ok(())
    }
}

impl Iterator for Merged {
    type Item = Result<(Vec<u8>, Vec<u8>)>;

    fn next(&mut self) -> Option<Self::Item> {
        let Reverse((key, run, body)) = self.next.pop()?;
        Some(self.read(run).map(|()| (key, body)))
    }
}
