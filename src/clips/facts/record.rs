//! `_robmem_info.clips`: what a fact says and its document alone would not.
//!
//! ```text
//! clips: {
//!   strings: ["name", "tags red"], // slots that hold a string which looks like a symbol
//!   instances: ["owner"],          // slots that hold the name of an instance
//!   slots: true,                   // `values` is a slot, and the fact is not ordered
//!   names: {relation_: "relation"} // keys that could not be called like their slot
//! }
//! ```
//!
//! A value of a multislot goes by the slot's name, a blank and its text, so that it is found where the array has
//! changed; where the multislot has the same text also as a value of another type, by its place from 0 instead of its text.

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

/// What a text may go by: its slot, or where that has several, their place or the text.
pub(super) fn labels(slot: &str, place: Option<usize>, text: &str) -> Vec<String> {
    place.map_or_else(|| vec![slot.to_owned()], |place| vec![by_place(slot, place), by_text(slot, text)])
}

/// What a value of a multislot goes by where its text is not enough.
pub(super) fn by_place(slot: &str, place: usize) -> String {
    format!("{slot} {place}")
}

/// What a value of a multislot goes by.
pub(super) fn by_text(slot: &str, text: &str) -> String {
    format!("{slot} {text}")
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
            strings: list(clips, "strings"),
            instances: list(clips, "instances"),
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

fn list(clips: &Document, key: &str) -> BTreeSet<String> {
    let labels = clips.get_array(key).into_iter().flatten();
    labels.filter_map(|label| label.as_str().map(str::to_owned)).collect()
}
