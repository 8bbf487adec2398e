//! `$text` and text indexes: which words a document has, and how well it answers a search.
//!
//! A text index is kept in the catalogue, as a geospatial index is: it says which strings of a
//! document are searched, with which weights and in which language. A search reads the
//! documents, splits their strings into words as mongod does, and gives each document mongod's score.

mod characters;
mod english;
mod index;
mod language;
mod search;
mod words;

use bson::raw::{CStr, cstr};
use bson::{Bson, Document, RawDocument, RawDocumentBuf};

use super::error::{QueryError, Result};
use super::limit::encode_result;
pub use index::{OPTIONS, TextIndex, is_key};
pub use search::{Search, no_index};

/// The field that documents carry their score in, from the search to the end of the answer.
pub(super) const SCORE: &str = "$textScore";
/// The same, as the name of a field in raw bytes.
pub(super) const SCORE_NAME: &CStr = cstr!("$textScore");

/// MongoDB's code for a score where nothing was searched.
const NO_SCORE: i32 = 40_218;

/// Returns whether a projection, sort or pipeline contains `{$meta: "textScore"}`.
#[must_use]
pub fn asks_for_score(document: &Document) -> bool {
    fn within(value: &Bson) -> bool {
        match value {
            Bson::Document(document) => asks_for_score(document),
            Bson::Array(items) => items.iter().any(within),
            _ => false,
        }
    }
    document.iter().any(|(name, value)| match name.as_str() {
        "$literal" => false,
        "$meta" => value.as_str() == Some("textScore"),
        _ => within(value),
    })
}

/// What `$meta` may ask for that rmem does not keep.
const OTHERS: [&str; 9] = [
    "geoNearDistance",
    "geoNearPoint",
    "indexKey",
    "randVal",
    "recordId",
    "searchHighlights",
    "searchScore",
    "searchScoreDetails",
    "sortKey",
];

/// Checks that `$meta` asks for the score.
pub(super) fn meta(argument: &Bson) -> Result<()> {
    match argument {
        Bson::String(name) if name == "textScore" => Ok(()),
        Bson::String(name) if OTHERS.contains(&name.as_str()) => {
            let mut refusal = QueryError::unsupported("$meta");
            refusal.message = format!("{{$meta: \"{name}\"}} is not supported by the embedded store; take textScore");
            Err(refusal)
        }
        Bson::String(name) => {
            Err(QueryError::invalid(17_308, format!("unsupported argument to $meta: {name}")).about("$meta"))
        }
        _ => Err(QueryError::invalid(17_307, "$meta takes a string, like \"textScore\"").about("$meta")),
    }
}

/// The refusal of a score where nothing was searched.
#[must_use]
pub fn no_score() -> QueryError {
    let message = "{$meta: \"textScore\"} needs $text in the query";
    QueryError::invalid(NO_SCORE, message).about("$meta")
}

/// Adds the score to a document, for as long as the answer is computed.
///
/// # Errors
/// If the document gets too large.
pub fn with_score(body: &RawDocument, score: f64) -> Result<RawDocumentBuf> {
    let mut document = Document::try_from(body)?;
    document.insert(SCORE, score);
    encode_result(&document)
}

/// Removes the score from a result, wherever it was put.
///
/// # Errors
/// If the result is damaged.
pub fn without_score(result: RawDocumentBuf) -> Result<RawDocumentBuf> {
    fn strip(value: &mut Bson) {
        match value {
            Bson::Document(document) => {
                document.remove(SCORE);
                document.iter_mut().for_each(|(_, value)| strip(value));
            }
            Bson::Array(items) => items.iter_mut().for_each(strip),
            _ => {}
        }
    }
    let mut whole = Bson::Document(Document::try_from(&*result)?);
    strip(&mut whole);
    match whole {
        Bson::Document(document) => encode_result(&document),
        _ => Ok(result),
    }
}
