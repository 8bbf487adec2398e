//! MongoDB's shell spelling and Extended JSON v2, as one language: text ⇄ BSON.
//!
//! Reading takes both spellings, mixed at will. Integers are Int32 where they
//! fit, else Int64, else Double; a decimal point or an exponent makes a Double.
//! A document with a key of Extended JSON (`$oid`, `$date`, `$numberLong`, …)
//! is that type, or an error if it is malformed. `{$regex: …, $options: …}` is
//! MongoDB's query operator and stays a document; in version 1 it was a regular
//! expression, which [`with_regexes`] makes of it where no query stands.
//!
//! Writing gives Extended JSON v2, [`canonical`] (every type survives) or
//! [`relaxed`] (integers are plain numbers, so an Int64 that fits reads back as
//! an Int32). Source: the Extended JSON specification v2.
//!
//! Values nest at most [`MAX_DEPTH`] deep; deeper text is an error, found
//! before anything recurses.

mod constructor;
mod date;
mod extended;
mod fault;
mod foreign;
mod grammar;
mod legacy;
mod literal;
mod reader;
mod scanner;
mod stream;
mod world;
mod writer;

/// Returns the value that a document of Extended JSON stands for, or the document itself.
///
/// # Errors
/// Where its wrapper is not as it should be: what it should look like.
pub fn unwrap_extended(document: bson::Document) -> Result<bson::Bson, String> {
    extended::unwrap(document)
}

/// Returns the number that an integer or a decimal number of JSON is: the smallest type that holds an integer, or a double.
#[must_use]
pub fn parse_number(text: &str) -> Option<bson::Bson> {
    literal::number(text).ok()
}

/// Returns milliseconds since 1970 of a date as in ISO 8601, in UTC where it names no zone.
#[must_use]
pub fn parse_date(text: &str) -> Option<i64> {
    date::parse(text)
}

pub use extended::ambiguous_key;
pub use legacy::{with_regexes, with_regexes_in_arrays};
pub use reader::{parse_document, parse_document_in, parse_documents, parse_pipeline, parse_pipeline_in, parse_value};
pub use scanner::MAX_DEPTH;
pub use stream::{ReadError, Reader};
pub use world::{WorldItem, WorldReader, parse_world};
pub use writer::{canonical, canonical_value, pretty, relaxed, relaxed_value, typed, write_canonical, write_relaxed};
