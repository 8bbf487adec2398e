//! Why a query, update, projection, sort or pipeline is refused or failed.

use std::ops::Range;

use crate::fault::{AtFault, Fault};

/// Why a query, update, projection, sort or pipeline is refused or failed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct QueryError {
    /// MongoDB's error code for the same mistake (2 BadValue, 9 FailedToParse, 14 TypeMismatch, …).
    pub code: i32,
    /// The operator or field complained about, like `$where`, where there is one.
    pub operator: Option<String>,
    /// Whether it is valid MongoDB that rmem does not support.
    pub unsupported: bool,
    /// A lower-case fragment that names operator and field.
    pub message: String,
}

impl AtFault for QueryError {
    fn fault(&self) -> Fault {
        match self.code {
            OUT_OF_DISK_SPACE | FILE_FAILED => Fault::Store,
            _ => Fault::Input,
        }
    }
}

/// The result of every function of this module that can fail.
pub(super) type Result<T> = std::result::Result<T, QueryError>;

/// MongoDB's code for a value that is not acceptable.
pub(super) const BAD_VALUE: i32 = 2;
/// MongoDB's code for a document that does not read as a query, update or stage.
pub(super) const FAILED_TO_PARSE: i32 = 9;
/// MongoDB's code for a value of the wrong type.
pub(super) const TYPE_MISMATCH: i32 = 14;
/// MongoDB's code for a disk without room.
const OUT_OF_DISK_SPACE: i32 = 14_031;
/// MongoDB's code for a sort whose file cannot be written.
const FILE_FAILED: i32 = 16_821;

impl QueryError {
    /// MongoDB's code for an operation that takes longer than its `maxTimeMS`.
    pub const EXCEEDED_TIME_LIMIT: i32 = 50;

    /// Where a text has the operator that is complained about, or the first one that the message names.
    #[must_use]
    pub fn place(&self, text: &str) -> Option<Range<usize>> {
        self.operators().find_map(|word| find(word, text))
    }

    /// Where the texts have the operator, field or regular expression that is complained about, or the first operator that the
    /// message names: the number of the text, and the place in it.
    #[must_use]
    pub fn place_among(&self, texts: &[&str]) -> Option<(usize, Range<usize>)> {
        let among = |word| texts.iter().enumerate().find_map(|(number, text)| Some((number, find(word, text)?)));
        self.operators().find_map(among)
    }

    /// What is complained about, and the operators that the message names.
    fn operators(&self) -> impl Iterator<Item = &str> {
        let named = self.message.split(|c: char| c != '$' && !c.is_alphanumeric());
        let named = named.filter(|word| word.starts_with('$') && word.len() > 1);
        self.operator.as_deref().into_iter().chain(named)
    }

    /// Returns a mistake in the query.
    #[must_use]
    pub fn invalid(code: i32, message: impl Into<String>) -> Self {
        Self { code, operator: None, unsupported: false, message: message.into() }
    }

    /// Returns a value that is not acceptable.
    #[must_use]
    pub fn bad_value(message: impl Into<String>) -> Self {
        Self::invalid(BAD_VALUE, message)
    }

    /// Something that does not read as a query, update or stage.
    #[must_use]
    pub fn failed_to_parse(message: impl Into<String>) -> Self {
        Self::invalid(FAILED_TO_PARSE, message)
    }

    /// Returns a value of the wrong type.
    #[must_use]
    pub fn type_mismatch(message: impl Into<String>) -> Self {
        Self::invalid(TYPE_MISMATCH, message)
    }

    /// Returns that an operation takes longer than its `maxTimeMS`.
    #[must_use]
    pub fn exceeded_time_limit() -> Self {
        Self::invalid(Self::EXCEEDED_TIME_LIMIT, "operation exceeded time limit")
    }

    /// Returns that there is no room for temporary files.
    pub(super) fn disk_full(message: String) -> Self {
        Self::invalid(OUT_OF_DISK_SPACE, message)
    }

    /// Returns that a temporary file cannot be used.
    pub(super) fn of_file(message: String) -> Self {
        Self::invalid(FILE_FAILED, message)
    }

    /// Returns the error with the operator or field that it is about, unless it has one already.
    pub(super) fn about(mut self, name: &str) -> Self {
        self.operator.get_or_insert_with(|| name.to_owned());
        self
    }

    /// Valid MongoDB that rmem refuses.
    #[must_use]
    pub fn unsupported(operator: &str) -> Self {
        Self {
            code: 115,
            operator: Some(operator.to_owned()),
            unsupported: true,
            message: format!("{operator} is not supported by the embedded store"),
        }
    }
}

/// Where a text has an operator, a field as a whole word, or a regular expression like `/a|b/`, which may stand in quotes.
fn find(word: &str, text: &str) -> Option<Range<usize>> {
    let at = |word: &str| text.find(word).map(|start| start..start + word.len());
    if word.starts_with('$') {
        let mut found = text.match_indices(word).map(|(start, _)| start..start + word.len());
        let is_whole = |place: &Range<usize>| !text[place.end..].starts_with(char::is_alphanumeric);
        return found.find(is_whole).or_else(|| at(word));
    }
    if let Some(pattern) = word.strip_prefix('/').and_then(|word| word.strip_suffix('/')) {
        let quoted = || ['"', '\''].into_iter().find_map(|quote| at(&format!("{quote}{pattern}{quote}")));
        return at(word).or_else(quoted).or_else(|| at("$regex"));
    }
    let is_part = |c: char| c.is_alphanumeric() || matches!(c, '_' | '$' | '-');
    let is_whole = |start: &usize| {
        let (before, after) =
            (text.get(..*start).unwrap_or_default(), text.get(start + word.len()..).unwrap_or_default());
        !before.ends_with(is_part) && !after.starts_with(is_part)
    };
    let mut starts = text.match_indices(word).map(|(start, _)| start);
    starts.find(is_whole).filter(|_| !word.is_empty()).map(|start| start..start + word.len())
}

impl From<bson::error::Error> for QueryError {
    fn from(error: bson::error::Error) -> Self {
        Self::invalid(22, format!("invalid BSON: {error}"))
    }
}
