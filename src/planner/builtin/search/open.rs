//! Open lists: queues of what is to be looked at, by estimate; of equals, the first comes first.
//!
//! There are more entries than anything else in a search, so an entry is one number: a state, or the place of what else is
//! known of it. What an entry stands for can be taken one by one: only of the first of its estimate is a part taken, so
//! that how many were is kept once for each estimate.

use std::collections::VecDeque;

/// The number of what is to be looked at.
pub(super) type Entry = u32;

/// A queue for each estimate.
#[derive(Debug, Default)]
pub(super) struct OpenList {
    buckets: Vec<Queue>,
    /// Entries whose estimates are larger than any bucket's.
    rest: std::collections::BTreeMap<u32, Queue>,
    first: usize,
    len: usize,
    /// How often it was asked, less what it was promised (Richter and Westphal 2010: alternation and boosting).
    pub(super) priority: i64,
}

/// The number of buckets.
const BUCKETS: usize = 1 << 14;

/// The entries that get and free their memory together.
const BLOCK: usize = 256;

/// Entries in the order in which they came.
#[derive(Debug, Default)]
struct Queue {
    blocks: VecDeque<Vec<Entry>>,
    /// How many were taken from the first block.
    taken: u32,
    /// How many parts were taken of the entry that comes next.
    parts: u32,
}

impl Queue {
    fn push(&mut self, entry: Entry) {
        match self.blocks.back_mut() {
            Some(block) if block.len() < BLOCK => block.push(entry),
            // A queue that stays short takes little.
            None => self.blocks.push_back(vec![entry]),
            Some(_) => {
                let mut block = Vec::with_capacity(BLOCK);
                block.push(entry);
                self.blocks.push_back(block);
            }
        }
    }

    fn front(&mut self) -> Option<(Entry, &mut u32)> {
        let entry = *self.blocks.front()?.get(self.taken as usize)?;
        Some((entry, &mut self.parts))
    }

    fn pop(&mut self) -> Option<Entry> {
        let block = self.blocks.front()?;
        let entry = block.get(self.taken as usize).copied();
        self.taken += 1;
        self.parts = 0;
        if self.taken as usize >= block.len() {
            self.blocks.pop_front();
            self.taken = 0;
        }
        entry
    }

    fn is_empty(&self) -> bool {
        self.blocks.is_empty()
    }
}

impl OpenList {
    pub(super) fn push(&mut self, estimate: u32, entry: Entry) {
        self.len += 1;
        let bucket = estimate as usize;
        if bucket >= BUCKETS {
            self.rest.entry(estimate).or_default().push(entry);
            return;
        }
        if bucket >= self.buckets.len() {
            self.buckets.resize_with(bucket + 1, Queue::default);
        }
        self.buckets[bucket].push(entry);
        self.first = self.first.min(bucket);
    }

    /// The entry that comes next, and how many of its parts were taken, to be counted on.
    pub(super) fn front(&mut self) -> Option<(Entry, &mut u32)> {
        while self.buckets.get(self.first).is_some_and(Queue::is_empty) {
            self.first += 1;
        }
        match self.buckets.get_mut(self.first) {
            Some(queue) => queue.front(),
            None => self.rest.iter_mut().next()?.1.front(),
        }
    }

    pub(super) fn pop(&mut self) -> Option<Entry> {
        self.front()?;
        self.len -= 1;
        if let Some(queue) = self.buckets.get_mut(self.first) {
            return queue.pop();
        }
        let mut queue = self.rest.first_entry()?;
        let entry = queue.get_mut().pop();
        if queue.get().is_empty() {
            queue.remove();
        }
        entry
    }

    /// Returns about how many bytes its entries take.
    pub(super) fn bytes(&self) -> usize {
        self.len * size_of::<Entry>() + self.buckets.len() * size_of::<Queue>()
    }

    pub(super) fn is_empty(&self) -> bool {
        self.len == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_estimates_come_first_and_equal_ones_in_order() {
        let mut list = OpenList::default();
        for (place, estimate) in [7, 3, 1 << 20, 3, 0, 1 << 15, 7].into_iter().enumerate() {
            list.push(estimate, place as Entry);
        }
        let order: Vec<Entry> = std::iter::from_fn(|| list.pop()).collect();
        assert_eq!(order, [4, 1, 3, 0, 6, 5, 2]);
        assert!(list.is_empty());
    }

    #[test]
    fn what_is_smaller_than_what_was_taken_comes_next() {
        let mut list = OpenList::default();
        list.push(5, 0);
        list.push(9, 1);
        assert_eq!(list.pop(), Some(0));
        list.push(2, 2);
        assert_eq!(list.pop(), Some(2));
        assert_eq!((list.pop(), list.pop()), (Some(1), None));
    }

    #[test]
    fn entries_keep_their_order_over_many_blocks() {
        let mut list = OpenList::default();
        let (mut pushed, mut taken) = (0, 0);
        for round in 0..6 * BLOCK as Entry {
            for _ in 0..1 + round % 3 {
                list.push(1, pushed);
                pushed += 1;
            }
            assert_eq!(list.pop(), Some(taken));
            taken += 1;
        }
        assert!(std::iter::from_fn(|| list.pop()).eq(taken..pushed));
        assert!(list.is_empty() && list.front().is_none());
    }

    #[test]
    fn parts_are_counted_for_each_entry_alone() {
        let mut list = OpenList::default();
        [(3, 0), (3, 1), (1 << 20, 2)].into_iter().for_each(|(estimate, entry)| list.push(estimate, entry));
        *list.front().unwrap().1 += 2;
        // What comes before an entry leaves its count as it is.
        list.push(1, 3);
        for (entry, parts) in [(3, 0), (0, 2), (1, 0), (2, 0)] {
            assert_eq!(list.front(), Some((entry, &mut { parts })));
            *list.front().unwrap().1 += 1;
            assert_eq!(list.pop(), Some(entry));
        }
        assert_eq!(list.front(), None);
    }
}
