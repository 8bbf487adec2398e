//! The smallest case that still differs in the same way.
//!
//! Cases are documents, so this takes parts of documents away, whatever they
//! mean; what no longer differs is not kept.

use bson::{Bson, Document};
use libtest_mimic::Failed;

use super::pair::{Case, Difference, Pair, Verdict};

/// So many smaller cases are tried.
const TRIES: usize = 400;

/// The smallest case found, with its difference; nothing where the case does not differ when asked alone.
pub(super) fn shrink(pair: &mut Pair, case: &Case) -> Result<Option<(Case, Difference)>, Failed> {
    let Some(mut difference) = differs(pair, case)? else { return Ok(None) };
    let (mut smallest, kind, mut tries) = (case.clone(), difference.kind(), 0);
    'smaller: loop {
        for candidate in candidates(&smallest) {
            tries += 1;
            if tries > TRIES {
                return Ok(Some((smallest, difference)));
            }
            if let Some(found) = differs(pair, &candidate)?.filter(|found| found.kind() == kind) {
                (smallest, difference) = (candidate, found);
                continue 'smaller;
            }
        }
        return Ok(Some((smallest, difference)));
    }
}

fn differs(pair: &mut Pair, case: &Case) -> Result<Option<Difference>, Failed> {
    if pair.reset(&case.documents, &case.others).is_err() {
        return Ok(None);
    }
    Ok(match pair.ask(&case.command)? {
        Verdict::Differs(difference) => Some(*difference),
        _ => None,
    })
}

fn candidates(case: &Case) -> Vec<Case> {
    let documents = without_one(&case.documents).into_iter().map(|documents| Case { documents, ..case.clone() });
    let others = (!case.others.is_empty()).then(|| Case { others: Vec::new(), ..case.clone() });
    let other = without_one(&case.others).into_iter().map(|others| Case { others, ..case.clone() });
    let commands = fields(&case.command, 1).into_iter().map(|command| Case { command, ..case.clone() });
    let inside = |documents: &[Document]| -> Vec<Vec<Document>> {
        let smaller = |place: usize| {
            fields(&documents[place], 1).into_iter().map(move |document| {
                let mut documents = documents.to_vec();
                documents[place] = document;
                documents
            })
        };
        (0..documents.len()).flat_map(smaller).collect()
    };
    let within = inside(&case.documents).into_iter().map(|documents| Case { documents, ..case.clone() });
    let within_others = inside(&case.others).into_iter().map(|others| Case { others, ..case.clone() });
    others.into_iter().chain(documents).chain(other).chain(commands).chain(within).chain(within_others).collect()
}

fn without_one(documents: &[Document]) -> Vec<Vec<Document>> {
    let without = |place| {
        let mut rest = documents.to_vec();
        rest.remove(place);
        rest
    };
    (0..documents.len()).map(without).collect()
}

/// The documents with one field less, or a smaller value in one; the first `kept` fields stay.
fn fields(document: &Document, kept: usize) -> Vec<Document> {
    let names: Vec<_> = document.keys().skip(kept).cloned().collect();
    let mut smaller = Vec::new();
    for name in &names {
        let mut less = document.clone();
        less.remove(name);
        smaller.push(less);
    }
    for name in &names {
        for value in document.get(name).map(values).unwrap_or_default() {
            let mut less = document.clone();
            less.insert(name, value);
            smaller.push(less);
        }
    }
    smaller
}

/// Smaller values than this.
fn values(value: &Bson) -> Vec<Bson> {
    match value {
        Bson::Document(document) => {
            let inner = document.values().filter(|value| matches!(value, Bson::Document(_))).cloned();
            inner.chain(fields(document, 0).into_iter().map(Bson::Document)).collect()
        }
        Bson::Array(items) => {
            let mut smaller = Vec::new();
            for place in 0..items.len() {
                let mut less = items.clone();
                less.remove(place);
                smaller.push(Bson::Array(less));
            }
            for (place, item) in items.iter().enumerate() {
                for value in values(item) {
                    let mut less = items.clone();
                    less[place] = value;
                    smaller.push(Bson::Array(less));
                }
            }
            smaller
        }
        Bson::Int32(1) => Vec::new(),
        Bson::String(text) if text.is_empty() => Vec::new(),
        _ => vec![Bson::Int32(1)],
    }
}
