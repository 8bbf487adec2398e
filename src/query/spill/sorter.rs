//! Sorting records by their keys.

use super::{Runs, Spill};
use crate::query::error::{QueryError, Result};

/// Collects records of a key and a body, and gives the bodies in the order of their keys; those of equal keys in the
/// order in which they came.
#[derive(Debug)]
pub(in crate::query) struct Sorter {
    limit: usize,
    /// The keys and bodies, one after the other.
    bytes: Vec<u8>,
    records: Vec<Record>,
    runs: Runs,
}

/// A record that is given back.
type KeyAndBody = (Vec<u8>, Vec<u8>);

/// Where a record is: its key, and its body up to the end.
#[derive(Debug, Clone, Copy)]
struct Record {
    start: usize,
    body: usize,
    end: usize,
}

impl Record {
    fn key(self, bytes: &[u8]) -> &[u8] {
        bytes.get(self.start..self.body).unwrap_or_default()
    }

    fn body(self, bytes: &[u8]) -> &[u8] {
        bytes.get(self.body..self.end).unwrap_or_default()
    }
}

impl Sorter {
    pub(in crate::query) fn new(spill: &Spill) -> Self {
        Self { limit: spill.limit, bytes: Vec::new(), records: Vec::new(), runs: Runs::new(&spill.folder) }
    }

    pub(in crate::query) fn add(&mut self, key: &[u8], body: &[u8]) -> Result<()> {
        let start = self.bytes.len();
        self.bytes.extend_from_slice(key);
        let body_start = self.bytes.len();
        self.bytes.extend_from_slice(body);
        self.records.push(Record { start, body: body_start, end: self.bytes.len() });
        if self.bytes.len() + self.records.len() * size_of::<Record>() > self.limit { self.spill() } else { Ok(()) }
    }

    fn sort(&mut self) {
        let bytes = &self.bytes;
        self.records.sort_unstable_by(|a, b| a.key(bytes).cmp(b.key(bytes)).then(a.start.cmp(&b.start)));
    }

    /// Writes what is held as a run.
    fn spill(&mut self) -> Result<()> {
        self.sort();
        let records = self.records.iter().map(|record| (record.key(&self.bytes), record.body(&self.bytes)));
        self.runs.add(records.map(Ok::<_, QueryError>))?;
        self.records.clear();
        self.bytes.clear();
        Ok(())
    }

    /// Returns the bodies in order.
    pub(in crate::query) fn finish(self) -> Result<Box<dyn Iterator<Item = Result<Vec<u8>>>>> {
        Ok(Box::new(self.records()?.map(|record| record.map(|(_, body)| body))))
    }

    /// Returns the keys and bodies in order.
    pub(in crate::query) fn records(mut self) -> Result<Box<dyn Iterator<Item = Result<KeyAndBody>>>> {
        if self.runs.is_empty() {
            self.sort();
            let bytes = self.bytes;
            let copy = move |record: Record| Ok((record.key(&bytes).to_vec(), record.body(&bytes).to_vec()));
            return Ok(Box::new(self.records.into_iter().map(copy)));
        }
        if !self.records.is_empty() {
            self.spill()?;
        }
        // The memory is not needed any more.
        let Self { runs, .. } = self;
        Ok(Box::new(runs.merged()?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_runs_are_merged_in_order() {
        let spill = Spill { limit: 200, ..Spill::default() };
        let mut sorter = Sorter::new(&spill);
        let mut wanted = Vec::new();
        for n in 0..30_000u32 {
            let (key, body) = ((n * 7919 % 1000).to_be_bytes(), n.to_be_bytes());
            sorter.add(&key, &body).unwrap();
            wanted.push((key, body));
        }
        assert!(sorter.runs.runs() < 3 * 32, "they are merged meanwhile");
        wanted.sort();
        let sorted: Vec<_> = sorter.finish().unwrap().map(Result::unwrap).collect();
        assert_eq!(sorted, wanted.iter().map(|(_, body)| body.to_vec()).collect::<Vec<_>>());
    }
}
