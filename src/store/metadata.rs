//! `_robmem_info`: the metadata that a store keeps in documents.
//!
//! The store itself writes `inserted` and `updated`, together with the document: so they are
//! right for every document that an update matches, and an update that changes nothing does
//! not change them.

use bson::raw::{CStr, RawBsonRef, cstr};
use bson::{Bson, DateTime, Document, RawDocument, RawDocumentBuf, doc};

use super::request::UpdateSpec;
use crate::query::{QueryError, decode, extent};

/// The key that metadata is under.
pub const INFO: &str = "_robmem_info";
/// Under [`INFO`]: when the document was stored.
pub const INSERTED: &str = "inserted";
/// Under [`INFO`]: when the document was changed.
pub const UPDATED: &str = "updated";
/// Under [`INFO`]: false where the document is gone after a restart.
pub const PERSISTENT: &str = "persistent";
/// Under [`INFO`]: the date from which on the document is invisible.
pub const DECAY: &str = "decay_time";
/// The path of [`DECAY`] in a document.
pub(crate) const DECAY_PATH: &str = "_robmem_info.decay_time";

/// Under [`INFO`]: of a computed document, the computable and which of its runs made it.
pub(crate) const COMPUTATION: &str = "computation";

/// The path of the run of a computable that made a document; a stored document has none.
pub(crate) const TOKEN_PATH: &str = "_robmem_info.computation.token";

/// What rmem's own commands note of a document that is stored as another is: where a plan comes from, and what CLIPS
/// makes of its slots. What is noted of computed documents goes to the store itself.
const NOTES: [&str; 2] = ["lineage", "clips"];

/// What every document may have.
const OWN: [&str; 4] = [INSERTED, UPDATED, PERSISTENT, DECAY];

const RAW_INFO: &CStr = cstr!("_robmem_info");

/// Checks what a document says under [`INFO`].
///
/// # Errors
/// Where that is not a document, has an unknown key, or has a value
/// of the wrong type.
pub fn check(document: &Document) -> Result<(), QueryError> {
    match document.get(INFO) {
        None => Ok(()),
        Some(Bson::Document(info)) => check_info(info),
        Some(_) => Err(not_a_document()),
    }
}

fn check_info<'a>(info: impl IntoIterator<Item = (&'a String, &'a Bson)>) -> Result<(), QueryError> {
    for (key, value) in info {
        match (key.as_str(), value) {
            (PERSISTENT, Bson::Boolean(_)) | (DECAY, Bson::DateTime(_)) | (INSERTED | UPDATED, _) => {}
            (PERSISTENT, _) => return Err(wrong_type(PERSISTENT, "true or false")),
            (DECAY, _) => return Err(wrong_type(DECAY, "a date, like ISODate(\"2030-01-01\")")),
            (key, Bson::Document(_)) if NOTES.contains(&key) => {}
            (key, _) if NOTES.contains(&key) => return Err(wrong_type(key, "a document")),
            (key, _) => return Err(reserved(&info_path(key))),
        }
    }
    Ok(())
}

/// Adds the metadata of a new document. What an application has set under [`INFO`] stays,
/// except for the dates, which are the memory's.
///
/// # Errors
/// As [`check`].
pub fn insert(document: &mut Document, at: DateTime) -> Result<(), QueryError> {
    check(document)?;
    match document.get_mut(INFO) {
        Some(Bson::Document(info)) => {
            info.remove(UPDATED);
            info.insert(INSERTED, at);
        }
        _ => {
            document.insert(INFO, doc! { INSERTED: at });
        }
    }
    Ok(())
}

/// Checks that an update names nothing under [`INFO`] but what is the
/// application's. What a pipeline does by its expressions is not seen here.
///
/// # Errors
/// Where it does, or gives a value of the wrong type.
pub fn check_update(update: &UpdateSpec) -> Result<(), QueryError> {
    match update {
        UpdateSpec::Document(document) if document.keys().next().is_some_and(|key| key.starts_with('$')) => {
            for (operator, fields) in document {
                let Bson::Document(fields) = fields else { continue };
                for (path, value) in fields {
                    check_path(path, ["$set", "$setOnInsert"].contains(&operator.as_str()).then_some(value))?;
                    if let ("$rename", Bson::String(to)) = (operator.as_str(), value) {
                        check_path(to, None)?;
                    }
                }
            }
            Ok(())
        }
        UpdateSpec::Document(replacement) => check(replacement),
        UpdateSpec::Pipeline(stages) => stages.iter().try_for_each(check_stage),
    }
}

/// Checks the metadata that a stage of a pipeline whose results are stored gives them as it is written. What it gives
/// by expressions is not seen here.
///
/// # Errors
/// Where that is not the application's.
pub(crate) fn check_stored_stage(stage: &Document) -> Result<(), QueryError> {
    let Some((name, argument)) = stage.iter().next() else { return Ok(()) };
    let fields = match (name.as_str(), argument) {
        ("$set" | "$addFields" | "$project" | "$replaceWith", Bson::Document(fields)) => fields,
        ("$replaceRoot", Bson::Document(root)) => match root.get("newRoot") {
            Some(Bson::Document(fields)) => fields,
            _ => return Ok(()),
        },
        _ => return Ok(()),
    };
    let names = fields.iter().flat_map(|(path, value)| match (path.strip_prefix(INFO), value) {
        (Some(""), Bson::Document(info)) => info.keys().map(String::as_str).collect(),
        (Some(rest), _) => rest.split('.').nth(1).into_iter().collect::<Vec<_>>(),
        (None, _) => Vec::new(),
    });
    let is_allowed = |name: &&str| name.starts_with('$') || OWN.contains(name) || NOTES.contains(name);
    match names.into_iter().find(|name| !is_allowed(name)) {
        Some(name) => Err(reserved(&info_path(name))),
        None => Ok(()),
    }
}

/// The same of a document that a pipeline made.
///
/// # Errors
/// As [`check`].
pub(crate) fn check_result(document: &RawDocument) -> Result<(), QueryError> {
    check_info(&info(document)?)
}

/// A stage that names fields names none of the memory's.
fn check_stage(stage: &Document) -> Result<(), QueryError> {
    let Some((name, argument)) = stage.iter().next() else { return Ok(()) };
    match (name.as_str(), argument) {
        ("$set" | "$addFields", Bson::Document(fields)) => fields.keys().try_for_each(|path| check_path(path, None)),
        ("$unset", Bson::String(path)) => check_path(path, None),
        ("$unset", Bson::Array(paths)) => {
            paths.iter().filter_map(Bson::as_str).try_for_each(|path| check_path(path, None))
        }
        ("$project" | "$replaceWith" | "$replaceRoot", _) => check_stored_stage(stage),
        _ => Ok(()),
    }
}

fn check_path(path: &str, value: Option<&Bson>) -> Result<(), QueryError> {
    let mut names = path.split('.');
    if names.next() != Some(INFO) {
        return Ok(());
    }
    match (names.next(), names.next(), value) {
        (Some(key), None, Some(value)) if [PERSISTENT, DECAY].contains(&key) || NOTES.contains(&key) => {
            check_info(&doc! { key: value.clone() })
        }
        (Some(PERSISTENT | DECAY), None, None) => Ok(()),
        (Some(key), ..) if NOTES.contains(&key) => Ok(()),
        _ => Err(reserved(path)),
    }
}

fn wrong_type(key: &str, wanted: &str) -> QueryError {
    QueryError::type_mismatch(format!("{INFO}.{key} has to be {wanted}"))
}

fn reserved(path: &str) -> QueryError {
    let message = format!("`{path}` is rmem's; an application may set {INFO}.{PERSISTENT} and {INFO}.{DECAY}");
    QueryError::invalid(66, message)
}

/// The path of a key under [`INFO`].
pub(crate) fn info_path(key: &str) -> String {
    format!("{INFO}.{key}")
}

/// The path of what is noted of the computation that made a document.
pub(crate) fn computation(key: &str) -> String {
    format!("{INFO}.{COMPUTATION}.{key}")
}

/// The condition that matches documents that have not decayed at a time. Computed documents
/// decay when their cache time is over.
pub(crate) fn visible(at: DateTime) -> Document {
    doc! { DECAY_PATH: { "$not": { "$lte": at } } }
}

/// The same, for documents that were stored, and not computed: they have no token.
pub(crate) fn stored(at: DateTime) -> Document {
    let mut stored = visible(at);
    // MongoDB would look for null before it looks at the conditions of the operation, and for what is not there afterwards.
    stored.insert(TOKEN_PATH, doc! { "$exists": false });
    stored
}

/// Returns the result of an update of `old` with its metadata. A replacement keeps the date at
/// which its predecessor was inserted. Returns nothing where only metadata would change.
pub(crate) fn update(
    old: &RawDocument,
    new: &RawDocument,
    replacement: bool,
    at: DateTime,
) -> Result<Option<RawDocumentBuf>, QueryError> {
    let (mut info, before) = (info(new)?, info(old).unwrap_or_default());
    check_info(info.iter().filter(|(key, value)| before.get(key) != Some(*value)))?;
    if own(&info) == own(&before) && same(old, new)? {
        return Ok(None);
    }
    match before.get(INSERTED) {
        Some(inserted) => {
            info.insert(INSERTED, inserted.clone());
        }
        None if replacement => {
            info.insert(INSERTED, at);
        }
        None => {
            info.remove(INSERTED);
        }
    }
    info.insert(UPDATED, at);
    with_info(new, &info).map(Some)
}

/// Returns the document of an upsert with its metadata.
pub(crate) fn upsert(document: &RawDocument, at: DateTime) -> Result<RawDocumentBuf, QueryError> {
    let mut info = info(document)?;
    check_info(&info)?;
    info.insert(INSERTED, at);
    info.insert(UPDATED, at);
    with_info(document, &info)
}

/// The document without its metadata.
///
/// # Errors
/// Where the document is malformed.
pub fn hide(document: RawDocumentBuf) -> Result<RawDocumentBuf, QueryError> {
    // Where there is none, the document may also be damaged.
    let found = match extent(&document, INFO) {
        Some(found) => Some(found),
        None => find(&document)?,
    };
    match found {
        None => Ok(document),
        Some((start, end)) => {
            let mut bytes = document.into_bytes();
            bytes.drain(start..end);
            let size = i32::try_from(bytes.len()).unwrap_or(i32::MAX);
            bytes.get_mut(..4).into_iter().for_each(|length| length.copy_from_slice(&size.to_le_bytes()));
            Ok(RawDocumentBuf::from_bytes(bytes)?)
        }
    }
}

/// The same without the metadata of documents within it: `$lookup`, `$facet` and `$$ROOT` put documents into others.
///
/// # Errors
/// As [`hide`].
pub fn hide_within(document: RawDocumentBuf) -> Result<RawDocumentBuf, QueryError> {
    let document = hide(document)?;
    if memchr::memmem::find(document.as_bytes(), INFO.as_bytes()).is_none() {
        return Ok(document);
    }
    let mut decoded = Document::try_from(&*document)?;
    forget_within(&mut decoded);
    Ok(RawDocumentBuf::try_from(&decoded)?)
}

fn forget_within(document: &mut Document) {
    document.remove(INFO);
    document.iter_mut().for_each(|(_, value)| forget_in(value));
}

fn forget_in(value: &mut Bson) {
    match value {
        Bson::Document(document) => forget_within(document),
        Bson::Array(values) => values.iter_mut().for_each(forget_in),
        _ => {}
    }
}

/// Whether a computable made the document.
pub(crate) fn is_computed(document: &RawDocument) -> Result<bool, QueryError> {
    let info = document.get(INFO)?.and_then(|info| info.as_document());
    let computed = info.map(|info| info.get("computed")).transpose()?.flatten();
    Ok(computed == Some(RawBsonRef::Boolean(true)))
}

/// The same of a document that is read already.
pub(crate) fn says_computed(document: &Document) -> bool {
    document.get_document(INFO).is_ok_and(|info| info.get_bool("computed").unwrap_or(false))
}

/// Removes the dates at which the document was inserted and updated.
pub(crate) fn forget_dates(document: &mut Document) {
    if let Some(Bson::Document(info)) = document.get_mut(INFO) {
        info.remove(INSERTED);
        info.remove(UPDATED);
        if info.is_empty() {
            document.remove(INFO);
        }
    }
}

/// Where in the bytes of the document its metadata is.
fn find(document: &RawDocument) -> Result<Option<(usize, usize)>, QueryError> {
    let mut start = 4;
    for element in document.iter_elements() {
        let element = element?;
        let end = start + 1 + element.key().len() + 1 + element.size();
        if element.key() == RAW_INFO {
            return Ok(Some((start, end)));
        }
        start = end;
    }
    Ok(None)
}

/// The metadata of a document; empty where it has none.
fn info(document: &RawDocument) -> Result<Document, QueryError> {
    match document.get(INFO)? {
        None => Ok(Document::new()),
        Some(RawBsonRef::Document(info)) => decode(info),
        Some(_) => Err(not_a_document()),
    }
}

/// What of the metadata is the application's.
fn own(info: &Document) -> Document {
    info.iter()
        .filter(|(key, _)| *key != INSERTED && *key != UPDATED)
        .map(|(key, value)| (key.clone(), value.clone()))
        .collect()
}

/// Whether two documents are the same but for their metadata.
fn same(old: &RawDocument, new: &RawDocument) -> Result<bool, QueryError> {
    let (old, new) = (beside(old)?, beside(new)?);
    Ok(old == new || old.concat() == new.concat())
}

/// The bytes of the elements in front of the metadata and behind it.
fn beside(document: &RawDocument) -> Result<[&[u8]; 2], QueryError> {
    let bytes = document.as_bytes();
    let (start, end) = match extent(document, INFO) {
        Some(found) => found,
        None => find(document)?.unwrap_or((bytes.len(), bytes.len())),
    };
    Ok([bytes.get(4..start).unwrap_or_default(), bytes.get(end..).unwrap_or_default()])
}

fn with_info(document: &RawDocument, info: &Document) -> Result<RawDocumentBuf, QueryError> {
    let mut with_metadata = hide(document.to_owned())?;
    with_metadata.append(RAW_INFO, RawDocumentBuf::try_from(info)?);
    Ok(with_metadata)
}

fn not_a_document() -> QueryError {
    QueryError::type_mismatch(format!("{INFO} holds rmem's metadata and has to be a document"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn raw(document: &Document) -> RawDocumentBuf {
        RawDocumentBuf::try_from(document).unwrap()
    }

    fn at(millis: i64) -> DateTime {
        DateTime::from_millis(millis)
    }

    #[test]
    fn metadata_is_hidden_in_documents_within_others() {
        let info = || doc! { INSERTED: at(1) };
        let inner = doc! { "_id": 2, INFO: info(), "n": { INFO: info() } };
        let document = doc! { INFO: info(), "one": inner.clone(), "all": [[inner.clone()], 3, inner], "s": INFO };
        let plain = doc! { "_id": 2, "n": {} };
        let expected = doc! { "one": plain.clone(), "all": [[plain.clone()], 3, plain], "s": INFO };
        assert_eq!(hide_within(raw(&document)).unwrap(), raw(&expected));
        assert_eq!(hide_within(raw(&expected)).unwrap(), raw(&expected));
    }

    #[test]
    fn metadata_is_hidden_wherever_it_stands() {
        let plain = doc! { "_id": 1, "a": { "b": [1, "x"] }, "s": "text" };
        for place in 0..=plain.len() {
            let mut pairs: Vec<_> = plain.clone().into_iter().collect();
            pairs.insert(place, (INFO.to_owned(), doc! { INSERTED: at(5) }.into()));
            assert_eq!(hide(raw(&pairs.into_iter().collect())).unwrap(), raw(&plain));
        }
        assert_eq!(hide(raw(&plain)).unwrap(), raw(&plain));
    }

    #[test]
    fn an_application_may_set_how_long_a_document_lives() {
        let mut document = doc! { INFO: { "persistent": false, INSERTED: 1 } };
        insert(&mut document, at(7)).unwrap();
        assert_eq!(document, doc! { INFO: { "persistent": false, INSERTED: at(7) } });
        assert!(insert(&mut doc! { INFO: 3 }, at(7)).is_err());
    }

    #[test]
    fn a_replacement_keeps_when_its_predecessor_was_inserted() {
        let old = raw(&doc! { "_id": 1, "a": 1, INFO: { INSERTED: at(1), "persistent": false } });
        let new = raw(&doc! { "_id": 1, "a": 2 });
        let with_metadata = update(&old, &new, true, at(9)).unwrap().unwrap();
        assert_eq!(with_metadata, raw(&doc! { "_id": 1, "a": 2, INFO: { INSERTED: at(1), UPDATED: at(9) } }));
    }

    #[test]
    fn a_replacement_by_the_same_is_no_change() {
        let old = raw(&doc! { "_id": 1, INFO: { INSERTED: at(1), UPDATED: at(2) }, "a": 1 });
        let new = raw(&doc! { "_id": 1, "a": 1 });
        assert_eq!(update(&old, &new, true, at(9)).unwrap(), None);
    }
}
