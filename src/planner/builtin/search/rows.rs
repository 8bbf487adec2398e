//! Rows of words, all of one length, each kept once.
//!
//! There may be many millions, so the table that finds them is small: a place of it is the number of a row, and the bits that
//! numbers do not need yet are some of the row's hash, so that a row is looked at where it is likely the right one only.

use super::hash;

/// The number of a row.
pub(super) type RowId = u32;

/// A place without a row. No row has this place: the table has more places than there are rows.
const FREE: u32 = u32::MAX;

/// The places of the first table.
const PLACES: usize = 64;

/// The rows, numbered as they came.
#[derive(Debug)]
pub(super) struct Rows<W> {
    /// Words of each row.
    width: usize,
    words: Vec<W>,
    count: usize,
    /// Open addressing, one place after another.
    table: Vec<u32>,
}

impl<W: Copy + Eq + Into<u64>> Rows<W> {
    pub(super) fn new(width: usize) -> Self {
        Self { width, words: Vec::new(), count: 0, table: vec![FREE; PLACES] }
    }

    /// Returns how many rows there are.
    pub(super) fn len(&self) -> usize {
        self.count
    }

    /// Returns about how many bytes they take.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.words.as_slice()) + self.table.len() * size_of::<u32>()
    }

    pub(super) fn get(&self, id: RowId) -> &[W] {
        let start = id as usize * self.width;
        &self.words[start..start + self.width]
    }

    /// Adds a row; says its number and whether it is new.
    pub(super) fn insert(&mut self, row: &[W]) -> (RowId, bool) {
        let hash = hash::words(row);
        let mask = self.mask();
        let tag = hash as u32 & !mask;
        let mut place = self.place(hash);
        loop {
            let found = self.table[place];
            if found == FREE {
                break;
            }
            if found & !mask == tag && self.get(found & mask) == row {
                return (found & mask, false);
            }
            place = if place + 1 == self.table.len() { 0 } else { place + 1 };
        }
        let id = self.count as RowId;
        self.table[place] = tag | id;
        self.words.extend_from_slice(row);
        self.count += 1;
        if self.count * 5 > self.table.len() * 4 {
            self.grow();
        }
        (id, true)
    }

    /// The bits of a place that are the number of its row.
    fn mask(&self) -> u32 {
        (self.table.len().next_power_of_two() - 1) as u32
    }

    /// The place where to begin to look for a row.
    fn place(&self, hash: u64) -> usize {
        (((hash >> 32) * self.table.len() as u64) >> 32) as usize
    }

    fn grow(&mut self) {
        let places = self.table.len() / 2 * 3;
        // The old table is gone before there is a new one.
        self.table = Vec::new();
        self.table = vec![FREE; places];
        let mask = self.mask();
        for id in 0..self.count as RowId {
            let hash = hash::words(self.get(id));
            let mut place = self.place(hash);
            while self.table[place] != FREE {
                place = if place + 1 == places { 0 } else { place + 1 };
            }
            self.table[place] = (hash as u32 & !mask) | id;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_is_kept_once() {
        let mut rows = Rows::new(2);
        let row = |number: u32| [number % 7, number / 7];
        for number in 0..100_000 {
            assert_eq!(rows.insert(&row(number)), (number, true));
        }
        for number in (0..100_000).rev() {
            assert_eq!(rows.insert(&row(number)), (number, false));
            assert_eq!(rows.get(number), row(number));
        }
        assert_eq!(rows.len(), 100_000);
    }

    #[test]
    fn rows_without_words_are_one() {
        let mut rows = Rows::<u64>::new(0);
        assert_eq!([(); 3].map(|()| rows.insert(&[])), [(0, true), (0, false), (0, false)]);
        assert_eq!((rows.len(), rows.get(0)), (1, [].as_slice()));
    }
}
