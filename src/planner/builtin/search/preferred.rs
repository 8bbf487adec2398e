//! The preferred operators of states, kept once for all open lists in which they wait.

use super::open::Entry;
use super::state::StateId;
use super::task::OperatorId;

/// Marks the last operator of a state: there are fewer operators than this.
const LAST: OperatorId = 1 << 31;

/// States with their preferred operators, one after another.
#[derive(Debug, Default)]
pub(super) struct Preferred {
    /// A state, and then its operators, of which the last is marked.
    numbers: Vec<u32>,
}

impl Preferred {
    /// Adds a state with its operators; returns their place, where there are any.
    pub(super) fn push(&mut self, state: StateId, operators: impl Iterator<Item = OperatorId>) -> Option<Entry> {
        let place = self.numbers.len();
        self.numbers.push(state);
        self.numbers.extend(operators);
        let Some(last) = self.numbers.get_mut(place + 1..).and_then(<[u32]>::last_mut) else {
            self.numbers.truncate(place);
            return None;
        };
        *last |= LAST;
        Some(place as Entry)
    }

    /// Returns the state of a place and one of its operators, and whether that is the last one.
    pub(super) fn get(&self, place: Entry, number: u32) -> ((StateId, OperatorId), bool) {
        let place = place as usize;
        let operator = self.numbers[place + 1 + number as usize];
        ((self.numbers[place], operator & !LAST), operator & LAST != 0)
    }

    /// Returns how many bytes they take.
    pub(super) fn bytes(&self) -> usize {
        self.numbers.capacity() * size_of::<u32>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn operators_come_in_order_with_their_state() {
        let mut preferred = Preferred::default();
        assert_eq!(preferred.push(7, [].into_iter()), None);
        let places = [(7, vec![3]), (8, vec![0, 5, 4]), (9, vec![1, 2])].map(|(state, operators)| {
            let place = preferred.push(state, operators.iter().copied()).unwrap();
            (place, state, operators)
        });
        for (place, state, operators) in places {
            for (number, operator) in operators.iter().enumerate() {
                let is_last = number + 1 == operators.len();
                assert_eq!(preferred.get(place, number as u32), ((state, *operator), is_last));
            }
        }
    }
}
