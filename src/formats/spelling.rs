//! Names that differ only in hyphens and underscores.
//!
//! CLIPS and PDDL write `param-values`, templates of Fawkes and most programming languages `param_values`.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// The names that were found by another spelling, for messages.
#[derive(Debug, Default)]
pub struct Respelled(Mutex<BTreeMap<String, String>>);

impl Respelled {
    /// Keeps that `wanted` was asked for, and `found` is there.
    pub fn add(&self, wanted: &str, found: &str) {
        let mut names = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if !names.contains_key(wanted) {
            names.insert(wanted.to_owned(), found.to_owned());
        }
    }

    /// Returns a sentence for each name, and forgets the names.
    #[must_use]
    pub fn take(&self) -> Vec<String> {
        let names = std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner));
        names.into_iter().map(|(wanted, found)| format!("`{wanted}` was found as `{found}`")).collect()
    }
}

/// Whether two names are the same, or differ only in that one has a hyphen where the other has an underscore.
#[must_use]
pub fn is_alike(one: &str, other: &str) -> bool {
    let plain = |byte: u8| if byte == b'-' { b'_' } else { byte };
    one.len() == other.len() && one.bytes().map(plain).eq(other.bytes().map(plain))
}

/// Returns the candidate that is `wanted`, else the first one that differs from it only in hyphens and underscores.
#[must_use]
pub fn alike<'a>(wanted: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let mut first = None;
    for candidate in candidates {
        if candidate == wanted {
            return Some(candidate);
        }
        if first.is_none() && is_alike(wanted, candidate) {
            first = Some(candidate);
        }
    }
    first
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exact_name_goes_before_one_that_is_alike() {
        let names = ["a_b", "a-b", "a-b-c"];
        assert_eq!(alike("a-b", names), Some("a-b"));
        assert_eq!(alike("a_b_c", names), Some("a-b-c"));
        assert_eq!(alike("a_b-d", names), None);
        assert_eq!(alike("ab", names), None);
    }
}
