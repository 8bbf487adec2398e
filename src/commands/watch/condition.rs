//! `--when "count > 3"`: a condition on how many documents match.

use std::cmp::Ordering;
use std::fmt;
use std::time::Instant;

use bson::{DateTime, Document, doc};

use crate::memory::Memory;
use crate::saturate::to_i64;
use crate::store::{Namespace, StoreError};

/// The comparisons, longer spellings first.
const COMPARISONS: [(&str, &[Ordering]); 7] = [
    (">=", &[Ordering::Greater, Ordering::Equal]),
    ("<=", &[Ordering::Less, Ordering::Equal]),
    ("==", &[Ordering::Equal]),
    ("!=", &[Ordering::Less, Ordering::Greater]),
    (">", &[Ordering::Greater]),
    ("<", &[Ordering::Less]),
    ("=", &[Ordering::Equal]),
];

/// A comparison of the number of documents with a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Condition {
    spelling: &'static str,
    wanted: &'static [Ordering],
    number: u64,
}

impl Condition {
    /// Reads a condition, like `count > 3`.
    ///
    /// # Errors
    /// What was expected.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let expected = || "expected a condition on the number of documents, like \"count > 3\"".to_owned();
        let rest = text.trim().strip_prefix("count").ok_or_else(expected)?.trim_start();
        let (spelling, wanted) = COMPARISONS.iter().find(|(known, _)| rest.starts_with(known)).ok_or_else(expected)?;
        let number = rest.get(spelling.len()..).unwrap_or_default().trim();
        let found = if number.is_empty() { "nothing".to_owned() } else { format!("`{number}`") };
        let number = number.parse().map_err(|_| format!("expected a number behind `{spelling}`, found {found}"))?;
        Ok(Self { spelling, wanted, number })
    }

    /// Whether so many documents meet it.
    pub(super) fn holds(&self, count: u64) -> bool {
        self.wanted.contains(&count.cmp(&self.number))
    }
}

impl fmt::Display for Condition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "count {} {}", self.spelling, self.number)
    }
}

/// The documents that are counted for `--when`.
pub(super) struct Counting<'a> {
    pub(super) condition: Condition,
    pub(super) memory: &'a Memory,
    pub(super) filter: &'a Document,
    /// Since when they may be others than those that were counted.
    pub(super) changed: Option<Instant>,
    /// Whether the condition held when they were counted.
    pub(super) held: bool,
}

impl Counting<'_> {
    /// Counts the documents; returns the event where the condition begins to hold.
    pub(super) fn event(&mut self, namespace: &Namespace) -> Result<Option<Document>, StoreError> {
        self.changed = None;
        let count = self.memory.count(namespace, self.filter)?;
        let held = std::mem::replace(&mut self.held, self.condition.holds(count));
        Ok((self.held && !held).then(|| {
            doc! {
                "operation": "count",
                "ns": namespace.to_string(),
                "count": to_i64(count),
                "when": self.condition.to_string(),
                "time": DateTime::now(),
            }
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::Embedded;

    #[test]
    fn each_comparison_holds_where_it_should() {
        for (text, holding) in [
            ("count > 3", &[4, 5][..]),
            ("count>=3", &[3, 4, 5]),
            (" count < 3 ", &[1, 2]),
            ("count <=3", &[1, 2, 3]),
            ("count == 3", &[3]),
            ("count = 3", &[3]),
            ("count != 3", &[1, 2, 4, 5]),
        ] {
            let condition = Condition::parse(text).unwrap();
            assert_eq!((1..=5).filter(|count| condition.holds(*count)).collect::<Vec<u64>>(), holding, "{text}");
        }
        for text in ["", "count", "count 3", "counts > 3", "count > x", "count > -1", "n > 3"] {
            assert!(Condition::parse(text).is_err(), "{text}");
        }
    }

    #[test]
    fn an_event_is_where_the_condition_begins_to_hold() {
        let memory = Memory::new(Box::new(Embedded::in_memory().unwrap()), None, Vec::new());
        let ns = Namespace::parse("a.b").unwrap();
        let (condition, filter) = (Condition::parse("count > 1").unwrap(), doc! { "n": 1 });
        let mut counting = Counting { condition, memory: &memory, filter: &filter, changed: None, held: false };
        let mut counted = || counting.event(&ns).unwrap().map(|event| event.get_i64("count").unwrap());
        memory.insert(&ns, vec![doc! { "_id": 1, "n": 1 }, doc! { "_id": 2 }]).unwrap();
        assert_eq!(counted(), None);
        memory.insert(&ns, vec![doc! { "_id": 3, "n": 1 }]).unwrap();
        assert_eq!(counted(), Some(2));
        memory.insert(&ns, vec![doc! { "_id": 4, "n": 1 }]).unwrap();
        assert_eq!(counted(), None);
        memory.delete(&ns, &filter, false).unwrap();
        assert_eq!(counted(), None);
        memory.insert(&ns, vec![doc! { "_id": 5, "n": 1 }, doc! { "_id": 6, "n": 1 }]).unwrap();
        assert_eq!(counted(), Some(2));
    }
}
