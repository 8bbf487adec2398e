//! Open lists: queues of what is to be looked at, by estimate; of equals, the first comes first.

use std::collections::VecDeque;

use super::state::StateId;
use super::task::OperatorId;

/// A state and an operator that is applicable in it.
pub(super) type Entry = (StateId, OperatorId);

/// A queue for each estimate.
#[derive(Debug, Default)]
pub(super) struct OpenList {
    buckets: Vec<VecDeque<Entry>>,
    /// Entries whose estimates are larger than any bucket's.
    rest: std::collections::BTreeMap<u32, VecDeque<Entry>>,
    first: usize,
    len: usize,
    /// How often it was asked, less what it was promised (Richter and Westphal 2010: alternation and boosting).
    pub(super) priority: i64,
}

/// The number of buckets.
const BUCKETS: usize = 1 << 14;

impl OpenList {
    pub(super) fn push(&mut self, estimate: u32, entry: Entry) {
        self.len += 1;
        let bucket = estimate as usize;
        if bucket >= BUCKETS {
            self.rest.entry(estimate).or_default().push_back(entry);
            return;
        }
        if bucket >= self.buckets.len() {
            self.buckets.resize_with(bucket + 1, VecDeque::new);
        }
        self.buckets[bucket].push_back(entry);
        self.first = self.first.min(bucket);
    }

    pub(super) fn pop(&mut self) -> Option<Entry> {
        while let Some(bucket) = self.buckets.get_mut(self.first) {
            if let Some(entry) = bucket.pop_front() {
                self.len -= 1;
                return Some(entry);
            }
            // Memory of thousands of entries is freed.
            *bucket = VecDeque::new();
            self.first += 1;
        }
        let (estimate, queue) = self.rest.iter_mut().next()?;
        let (estimate, entry) = (*estimate, queue.pop_front());
        if queue.is_empty() {
            self.rest.remove(&estimate);
        }
        self.len -= usize::from(entry.is_some());
        entry
    }

    pub(super) fn len(&self) -> usize {
        self.len
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
            list.push(estimate, (place as StateId, 0));
        }
        let order: Vec<StateId> = std::iter::from_fn(|| list.pop()).map(|(id, _)| id).collect();
        assert_eq!(order, [4, 1, 3, 0, 6, 5, 2]);
        assert!(list.is_empty());
    }

    #[test]
    fn what_is_smaller_than_what_was_taken_comes_next() {
        let mut list = OpenList::default();
        list.push(5, (0, 0));
        list.push(9, (1, 0));
        assert_eq!(list.pop(), Some((0, 0)));
        list.push(2, (2, 0));
        assert_eq!(list.pop(), Some((2, 0)));
        assert_eq!((list.pop(), list.pop()), (Some((1, 0)), None));
    }
}
