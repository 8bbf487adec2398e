//! The entries of a history on a server (`history`), and which of them a date belongs to.

use std::collections::{HashMap, VecDeque};

use bson::raw::RawBsonRef;
use bson::{Bson, DateTime, Document, RawDocument, RawDocumentBuf, doc};

use crate::query::{QueryError, key};
use crate::store::history::Entry;
use crate::store::metadata::{self, INFO, INSERTED, UPDATED, info_path};
use crate::store::{Change, ChangeKind, Namespace};

/// The collection of entries: `{_id, ns, operation, document, computed, time, before, after, dates, by, run}`.
pub(super) const ENTRIES: &str = "rmem.history";
/// Images of more bytes are left out: an entry is a document, which has at most 16 MiB.
const LARGEST_IMAGES: usize = 15 << 20;
/// So many changes are written at once.
const BATCH: usize = 200;
/// About so many bytes of documents.
const BATCH_BYTES: usize = 8 << 20;
/// So many of the last entries of each document are looked at for the one that a date belongs to.
pub(super) const RECENT: usize = 16;

/// What is to be written into the history.
#[derive(Default)]
pub(super) struct Batch {
    pub(super) entries: Vec<Document>,
    /// Statements that add the date of a change to its entry.
    pub(super) dates: Vec<Document>,
    pub(super) bytes: usize,
    /// The last entries of each document, where they were recorded a moment ago.
    pub(super) last: HashMap<Vec<u8>, VecDeque<Recent>>,
}

/// An entry that the date of a change may belong to.
pub(super) struct Recent {
    pub(super) position: String,
    updated: Option<DateTime>,
    /// Whether the change wrote the date itself.
    is_dated: bool,
}

impl Recent {
    pub(super) fn new(position: &str, [before, after]: [Option<&RawDocument>; 2]) -> Self {
        let of = |image: Option<&RawDocument>| image.and_then(|image| dates(image).get_datetime(UPDATED).ok().copied());
        let updated = of(after);
        let is_dated = before.is_some() && updated.is_some() && updated != of(before);
        Self { position: position.to_owned(), updated, is_dated }
    }

    /// Whether a date may belong to it: also where it was given it already, and the change of the date is read again.
    pub(super) fn takes(&self, date: Option<DateTime>) -> bool {
        !self.is_dated || self.updated == date
    }
}

impl Batch {
    pub(super) fn add(&mut self, ns: &Namespace, change: &Change) -> Result<(), QueryError> {
        self.entries.push(entry(ns, change)?);
        self.bytes +=
            [&change.before, &change.after].into_iter().flatten().map(|image| image.as_bytes().len()).sum::<usize>();
        if let Some(id) = &change.id {
            let last = self.last.entry(key::encode_value(id)).or_default();
            if last.len() == RECENT {
                last.pop_front();
            }
            last.push_back(Recent::new(&change.position, [change.before.as_deref(), change.after.as_deref()]));
        }
        Ok(())
    }

    /// The entry of a document that a date belongs to, where it was recorded a moment ago.
    pub(super) fn take(&mut self, id: &Bson, updated: Option<DateTime>) -> Option<String> {
        let last = self.last.get_mut(&key::encode_value(id))?;
        let recent = last.iter_mut().rev().find(|recent| recent.takes(updated))?;
        (recent.updated, recent.is_dated) = (updated, true);
        Some(recent.position.clone())
    }

    /// Adds the date of the change that an entry is about.
    pub(super) fn add_date(&mut self, entry: &str, dated: &RawDocument) {
        let statement = |has_images: bool, set: Document| {
            let is_there = doc! { "$exists": has_images };
            doc! { "q": { "_id": entry, "after": is_there }, "u": { "$set": set } }
        };
        let dates = dates(dated);
        let image = |(key, date): (&String, &Bson)| (format!("after.{}", info_path(key)), date.clone());
        self.dates.push(statement(true, dates.iter().map(image).collect()));
        self.dates.push(statement(false, doc! { "dates": dates }));
    }

    pub(super) fn is_full(&self) -> bool {
        self.entries.len() + self.dates.len() >= BATCH || self.bytes >= BATCH_BYTES
    }
}

pub(super) fn is_computed(document: &RawDocument) -> bool {
    metadata::is_computed(document).unwrap_or(false)
}

pub(super) fn id_key(document: &RawDocument) -> Result<Vec<u8>, QueryError> {
    Ok(document.get("_id")?.map(key::encode).unwrap_or_default())
}

/// A change as it is written.
fn entry(ns: &Namespace, change: &Change) -> Result<Document, QueryError> {
    let mut entry =
        doc! { "_id": &change.position, "ns": ns.to_string(), "operation": change.kind.name(), "time": change.time };
    entry.extend(change.id.clone().map(|id| ("document".to_owned(), id)));
    if change.after.as_deref().or(change.before.as_deref()).is_some_and(is_computed) {
        entry.insert("computed", true);
    }
    let size = |image: &Option<RawDocumentBuf>| image.as_ref().map_or(0, |image| image.as_bytes().len());
    // Of what had no room in an event, the metadata is there.
    let is_whole = change.after.as_deref().is_none_or(has_id);
    if !is_whole || size(&change.before) + size(&change.after) > LARGEST_IMAGES {
        entry.extend(change.after.as_deref().map(|after| ("dates".to_owned(), dates(after).into())));
    } else {
        for (key, image) in [("before", &change.before), ("after", &change.after)] {
            if let Some(image) = image {
                entry.insert(key, Document::try_from(&**image)?);
            }
        }
    }
    Ok(entry)
}

fn has_id(document: &RawDocument) -> bool {
    matches!(document.get("_id"), Ok(Some(_)))
}

/// When a document was inserted and changed, as its metadata says.
pub(super) fn dates(document: &RawDocument) -> Document {
    let Ok(info) = document.get_document(INFO) else { return Document::new() };
    let date = |key: &str| info.get_datetime(key).ok().map(|date| (key.to_owned(), date.into()));
    [INSERTED, UPDATED].into_iter().filter_map(date).collect()
}

/// An entry as it was written.
pub(super) fn read(document: &RawDocument) -> Result<Entry, QueryError> {
    let image = |key: &str| match document.get(key) {
        Ok(Some(RawBsonRef::Document(image))) => Ok(Some(image.to_owned())),
        Ok(_) => Ok(None),
        Err(error) => Err(QueryError::from(error)),
    };
    let text = |key: &str| document.get_str(key).ok().map(str::to_owned);
    let operation = text("operation").unwrap_or_default();
    use ChangeKind::{Delete, Drop, Insert, Replace, Update};
    let kind = [Insert, Update, Replace, Delete, Drop].into_iter().find(|kind| kind.name() == operation);
    let id = document.get("document")?.map(Bson::try_from).transpose()?;
    let time = document.get_datetime("time").unwrap_or(DateTime::from_millis(0));
    let change = Change {
        kind: kind
            .ok_or_else(|| QueryError::bad_value(format!("an entry of {ENTRIES} has the operation `{operation}`")))?,
        id,
        before: image("before")?,
        after: image("after")?,
        time,
        position: text("_id").unwrap_or_default(),
    };
    Ok(Entry { change, dropped: false, author: text("by"), run: document.get_i64("run").ok(), collation: None })
}
