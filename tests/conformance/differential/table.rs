//! What was compared, by family.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use super::pair::Verdict;

#[derive(Debug, Default, Clone)]
pub(super) struct Counts {
    pub(super) cases: usize,
    something: usize,
    errors: usize,
    refused: usize,
    known: usize,
    pub(super) differ: usize,
}

impl Counts {
    pub(super) fn add(&mut self, verdict: &Verdict) {
        self.cases += 1;
        match verdict {
            Verdict::Agrees { something, error } => {
                self.something += usize::from(*something && !error);
                self.errors += usize::from(*error);
            }
            Verdict::Refused => self.refused += 1,
            Verdict::Known(..) => self.known += 1,
            Verdict::Differs(_) => self.differ += 1,
        }
    }
}

static TABLE: Mutex<BTreeMap<String, Counts>> = Mutex::new(BTreeMap::new());

pub(super) fn add(name: &str, counts: &Counts) {
    TABLE.lock().unwrap_or_else(PoisonError::into_inner).insert(name.to_owned(), counts.clone());
}

/// Prints the table, in markdown, where anything was compared.
pub(super) fn print() {
    let table = TABLE.lock().unwrap_or_else(PoisonError::into_inner);
    if table.is_empty() {
        return;
    }
    println!(
        "| operator family | cases | found or changed something | both an error | refused | known differences | differences |"
    );
    println!("|---|--:|--:|--:|--:|--:|--:|");
    for (name, counts) in &*table {
        let Counts { cases, something, errors, refused, known, differ } = counts;
        let percent = |part: usize| format!("{:.0} %", part as f64 * 100.0 / (*cases).max(1) as f64);
        println!(
            "| {name} | {cases} | {} | {} | {refused} | {known} | {differ} |",
            percent(*something),
            percent(*errors)
        );
    }
}
