//! Names and what they stand for, compared without regard to case.

use std::borrow::Cow;
use std::collections::HashMap;
use std::sync::Arc;

use crate::formats::pddl::Seeded;
use crate::formats::pddl::ast::Name;

/// How many names are looked at for a suggestion.
const CANDIDATES: usize = 10_000;

/// What a table holds: anything with a name.
pub(super) trait Named {
    fn name(&self) -> &Name;
}

/// Things by number and by name.
#[derive(Debug, Clone)]
pub(super) struct Table<T> {
    items: Vec<T>,
    index: HashMap<Arc<str>, u32, Seeded>,
}

impl<T: Named> Table<T> {
    pub(super) fn new() -> Self {
        Self { items: Vec::new(), index: HashMap::default() }
    }

    /// Adds an item and returns its number, or returns the item whose name it has.
    pub(super) fn add(&mut self, item: T) -> Result<u32, &T> {
        let key = key(item.name());
        if let Some(known) = self.index.get(&key) {
            return Err(&self.items[*known as usize]);
        }
        let number = u32::try_from(self.items.len()).unwrap_or(u32::MAX);
        self.index.insert(key, number);
        self.items.push(item);
        Ok(number)
    }

    pub(super) fn find(&self, name: &str) -> Option<u32> {
        self.index.get(lower(name).as_ref()).copied()
    }

    pub(super) fn get(&self, number: u32) -> Option<&T> {
        self.items.get(number as usize)
    }

    pub(super) fn items(&self) -> &[T] {
        &self.items
    }

    /// The name most like `wanted`, if one is like it.
    pub(super) fn nearest(&self, wanted: &str) -> Option<&str> {
        nearest(wanted, self.items.iter().take(CANDIDATES).map(|item| item.name().as_str()))
    }
}

fn key(name: &Name) -> Arc<str> {
    match lower(name.as_str()) {
        Cow::Borrowed(_) => name.shared(),
        Cow::Owned(lower) => lower.into(),
    }
}

/// As PDDL compares names.
pub(super) fn lower(name: &str) -> Cow<'_, str> {
    if name.bytes().any(|byte| byte.is_ascii_uppercase()) {
        Cow::Owned(name.to_ascii_lowercase())
    } else {
        Cow::Borrowed(name)
    }
}

/// The candidate most like `wanted`: at most a third of its letters differ. Names of one letter are like no other.
pub(super) fn nearest<'a>(wanted: &str, candidates: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let wanted: Vec<char> = lower(wanted).chars().take(64).collect();
    let letters = wanted.iter().filter(|letter| **letter != '?').count();
    let limit = (letters.div_ceil(3)).min(3).min(letters.saturating_sub(1));
    candidates
        .filter(|candidate| candidate.len().abs_diff(wanted.len()) <= 4 * limit)
        .map(|candidate| (distance(&wanted, candidate), candidate))
        .filter(|(distance, _)| *distance <= limit)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, candidate)| candidate)
}

/// How many letters must be added, dropped, changed or swapped with their neighbour.
fn distance(wanted: &[char], candidate: &str) -> usize {
    let candidate: Vec<char> = lower(candidate).chars().take(64).collect();
    let width = candidate.len() + 1;
    let mut rows = vec![0_usize; width * (wanted.len() + 1)];
    for (index, cell) in rows.iter_mut().take(width).enumerate() {
        *cell = index;
    }
    for (row, letter) in wanted.iter().enumerate() {
        let (here, above) = ((row + 1) * width, row * width);
        rows[here] = row + 1;
        for (column, other) in candidate.iter().enumerate() {
            let mut best = rows[above + column] + usize::from(letter != other);
            best = best.min(rows[above + column + 1] + 1).min(rows[here + column] + 1);
            let swapped = row > 0 && column > 0 && wanted[row - 1] == *other && *letter == candidate[column - 1];
            if swapped {
                best = best.min(rows[above - width + column - 1] + 1);
            }
            rows[here + column + 1] = best;
        }
    }
    rows.last().copied().unwrap_or_default()
}

/// ``, did you mean `x`?`` or nothing.
pub(super) fn suggestion(nearest: Option<&str>) -> String {
    nearest.map_or_else(String::new, |name| format!("did you mean `{name}`?"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slip_of_the_finger_is_recognised() {
        let names = ["holding", "clear", "on-table", "on"];
        assert_eq!(nearest("holdign", names.into_iter()), Some("holding"));
        assert_eq!(nearest("ontable", names.into_iter()), Some("on-table"));
        assert_eq!(nearest("CLEAN", names.into_iter()), Some("clear"));
        assert_eq!(nearest("frobnicate", names.into_iter()), None);
        assert_eq!(nearest("o", names.into_iter()), None);
        assert_eq!(nearest("", names.into_iter()), None);
    }
}
