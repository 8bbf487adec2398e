//! Some documents of a collection: which keys they have, and which texts.

use std::collections::BTreeSet;

use bson::{Bson, Document};

use crate::formats::nearest;
use crate::store::metadata;

/// How many documents are looked at for keys and texts like those of a query.
pub(super) const SIZE: u64 = 1_000;

/// How many keys a message lists at most.
const MOST_KEYS: usize = 12;

/// Keys and texts of some documents.
#[derive(Debug, Default)]
pub(super) struct Sample {
    documents: Vec<Document>,
    paths: BTreeSet<String>,
}

impl Sample {
    pub(super) fn new(documents: Vec<Document>) -> Self {
        let mut paths = BTreeSet::new();
        documents.iter().for_each(|document| note(document, "", &mut paths));
        Self { documents, paths }
    }

    /// The key that is most like one which no document has: of its spelling, or the same key in a document inside.
    pub(super) fn nearest_path(&self, wanted: &str) -> Option<&str> {
        let paths = || self.paths.iter().map(String::as_str);
        let last = |path: &'_ str| path.rsplit('.').next().unwrap_or_default().to_lowercase();
        let inside = || paths().filter(|path| last(path) == last(wanted)).min_by_key(|path| path.len());
        nearest(wanted, paths()).or_else(inside)
    }

    /// The keys of the documents, unless there are too many for a message.
    pub(super) fn keys(&self) -> Vec<String> {
        let keys: Vec<String> = self.paths.iter().filter(|path| !path.contains('.')).cloned().collect();
        if keys.len() > MOST_KEYS { Vec::new() } else { keys }
    }

    /// The keys of the documents under a path, unless there are too many for a message.
    pub(super) fn keys_in(&self, path: &str) -> Vec<String> {
        let inside = |known: &String| known.strip_prefix(path)?.strip_prefix('.').map(str::to_owned);
        let keys: Vec<String> = self.paths.iter().filter_map(inside).filter(|key| !key.contains('.')).collect();
        if keys.len() > MOST_KEYS { Vec::new() } else { keys }
    }

    /// The text under a key that is most like one which no document has.
    pub(super) fn nearest_text(&self, path: &str, wanted: &str) -> Option<String> {
        let mut texts: BTreeSet<&str> = BTreeSet::new();
        self.documents.iter().for_each(|document| texts_at(document, path, &mut texts));
        nearest(wanted, texts).map(str::to_owned)
    }
}

/// Notes the paths of a document; those through arrays of documents leave out the index, as queries may.
fn note(document: &Document, prefix: &str, paths: &mut BTreeSet<String>) {
    for (key, value) in document.iter().filter(|(key, _)| *key != metadata::INFO) {
        let path = format!("{prefix}{key}");
        match value {
            Bson::Document(inner) => note(inner, &format!("{path}."), paths),
            Bson::Array(elements) => elements
                .iter()
                .filter_map(Bson::as_document)
                .for_each(|element| note(element, &format!("{path}."), paths)),
            _ => {}
        }
        paths.insert(path);
    }
}

fn texts_at<'a>(document: &'a Document, path: &str, texts: &mut BTreeSet<&'a str>) {
    let (key, rest) = path.split_once('.').map_or((path, None), |(key, rest)| (key, Some(rest)));
    let Some(value) = document.get(key) else { return };
    let elements = value.as_array().map_or(std::slice::from_ref(value), Vec::as_slice);
    for element in elements {
        match (element, rest) {
            (Bson::String(text), None) => drop(texts.insert(text)),
            (Bson::Document(inner), Some(rest)) => texts_at(inner, rest, texts),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::doc;

    #[test]
    fn keys_and_texts_are_found_by_likeness() {
        let sample = Sample::new(vec![
            doc! { "_id": 1, "colour": "RED", "pose": { "x": 1 }, "parts": [{ "name": "cap" }], "_robmem_info": { "z": 1 } },
            doc! { "_id": 2, "tags": ["fragile", "heavy"] },
        ]);
        assert_eq!(sample.nearest_path("color"), Some("colour"));
        assert_eq!(sample.nearest_path("x"), Some("pose.x"));
        assert_eq!(sample.nearest_path("part.name"), Some("parts.name"));
        assert_eq!(sample.nearest_path("z"), None, "metadata is hidden");
        assert_eq!(sample.nearest_text("tags", "fragil").as_deref(), Some("fragile"));
        assert_eq!(sample.nearest_text("parts.name", "caps").as_deref(), Some("cap"));
        assert_eq!(sample.nearest_text("gone.name", "caps"), None);
    }
}
