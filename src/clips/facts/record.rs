//! `_robmem_info.clips`: what a fact says and its document alone would not.
//!
//! ```text
//! clips: {
//!   strings: ["name", "tags 2"],   // slots that hold a string which looks like a symbol
//!   instances: ["owner"],          // slots that hold the name of an instance
//!   slots: true,                   // `values` is a slot, and the fact is not ordered
//!   names: {relation_: "relation"} // keys that could not be called like their slot
//! }
//! ```
//!
//! A value of a multislot goes by the slot's name, a blank and its place from 0.

use std::collections::{BTreeMap, BTreeSet};

use bson::{Bson, Document};

use crate::store::metadata;

/// The key under [`metadata::INFO`].
pub const KEY: &str = "clips";

/// What is recorded of one fact.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Record {
    pub(super) strings: BTreeSet<String>,
    pub(super) instances: BTreeSet<String>,
    pub(super) slots: bool,
    pub(super) names: BTreeMap<String, String>,
}

/// What a value goes by: its slot, and its place where there are several.
pub(super) fn label(slot: &str, place: Option<usize>) -> String {
    place.map_or_else(|| slot.to_owned(), |place| format!("{slot} {place}"))
}

impl Record {
    /// The record of a document; what is malformed is not there.
    pub(super) fn of(document: &Document) -> Self {
        let Some(clips) = document.get_document(metadata::INFO).ok().and_then(|info| info.get_document(KEY).ok())
        else {
            return Self::default();
        };
        let names = clips.get_document("names").into_iter().flatten();
        Self {
            strings: labels(clips, "strings"),
            instances: labels(clips, "instances"),
            slots: clips.get_bool("slots").unwrap_or(false),
            names: names.filter_map(|(key, slot)| Some((key.clone(), slot.as_str()?.to_owned()))).collect(),
        }
    }

    /// The record as a document, if there is anything to say.
    pub(super) fn into_document(self) -> Option<Document> {
        let mut document = Document::new();
        let mut list = |key: &str, labels: BTreeSet<String>| {
            if !labels.is_empty() {
                document.insert(key, labels.into_iter().map(Bson::String).collect::<Vec<_>>());
            }
        };
        list("strings", self.strings);
        list("instances", self.instances);
        if self.slots {
            document.insert("slots", true);
        }
        if !self.names.is_empty() {
            let names = self.names.into_iter().map(|(key, slot)| (key, Bson::String(slot)));
            document.insert("names", names.collect::<Document>());
        }
        (!document.is_empty()).then_some(document)
    }
}

fn labels(clips: &Document, key: &str) -> BTreeSet<String> {
    let labels = clips.get_array(key).into_iter().flatten();
    labels.filter_map(|label| label.as_str().map(str::to_owned)).collect()
}
