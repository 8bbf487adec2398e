//! Why a query, update, projection, sort or pipeline is refused or failed.

use std::ops::Range;

use crate::fault::{AtFault, Fault};

/// Why a query, update, projection, sort or pipeline is refused or failed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct QueryError {
    /// MongoDB's error code for the same mistake (2 BadValue, 9 FailedToParse, 14 TypeMismatch, …).
    pub code: i32,
    /// The operators and fields that it is about, like `$where` or `/a|b/`: the innermost first, then what encloses it.
    pub names: Vec<String>,
    /// What kind of mistake it is, where there is advice for the kind.
    pub mistake: Option<QueryMistake>,
    /// Whether it is valid MongoDB that rmem does not support.
    pub unsupported: bool,
    /// A lower-case fragment that names operator and field.
    pub message: String,
}

/// A kind of mistake for which there is advice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum QueryMistake {
    /// An operator or a stage that is not known where it stands.
    UnknownName(NameContext),
    /// An operator of filters whose argument has to be an array, like `$or`, and is not.
    NoArray,
    /// A `$group` without `_id`.
    NoGroupId,
    /// A hint that names no index, or none that can be read for the query.
    Hint,
    /// A function of a map-reduce that failed.
    InFunction(&'static str),
}

/// Where a name stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NameContext {
    /// At the top of a filter.
    Filter,
    /// Behind a key of a filter.
    Condition,
    /// At the top of an update.
    Update,
    /// At the top of a stage.
    Stage,
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
    /// MongoDB's code for a collection that is not there.
    pub const NAMESPACE_NOT_FOUND: i32 = 26;
    /// MongoDB's code for an index that is not there.
    pub const INDEX_NOT_FOUND: i32 = 27;
    /// MongoDB's code for a name that a collection has already.
    pub const NAMESPACE_EXISTS: i32 = 48;
    /// MongoDB's code for an operation that takes longer than its `maxTimeMS`.
    pub const EXCEEDED_TIME_LIMIT: i32 = 50;
    /// MongoDB's code for an operation that `killCursors` has ended.
    pub const CURSOR_KILLED: i32 = 237;
    /// MongoDB's code for an operation whose client is gone.
    pub const CLIENT_DISCONNECT: i32 = 279;
    /// MongoDB's code for an operation that `killOp` or `killSessions` has ended.
    pub const INTERRUPTED: i32 = 11_601;

    /// Returns where a text has the first of the operators, fields and regular expressions that the error is about.
    #[must_use]
    pub fn place(&self, text: &str) -> Option<Range<usize>> {
        self.place_among(&[text]).map(|(_, place)| place)
    }

    /// Returns where the texts have the first of the operators, fields and regular expressions that the error is about:
    /// the number of the text, and the place in it.
    #[must_use]
    pub fn place_among(&self, texts: &[&str]) -> Option<(usize, Range<usize>)> {
        let among =
            |name: &String| texts.iter().enumerate().find_map(|(number, text)| Some((number, find(name, text)?)));
        self.names.iter().find_map(among)
    }

    /// Returns a mistake in the query.
    #[must_use]
    pub fn invalid(code: i32, message: impl Into<String>) -> Self {
        Self { code, names: Vec::new(), mistake: None, unsupported: false, message: message.into() }
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

    /// Returns that an operation was stopped, with the code that says why.
    #[must_use]
    pub fn interrupted(code: i32) -> Self {
        Self::invalid(code, "operation was interrupted")
    }

    /// Whether a code is that of an operation that ended before it was done: its time was over, or it was stopped.
    #[must_use]
    pub fn is_interruption(code: i32) -> bool {
        matches!(code, Self::EXCEEDED_TIME_LIMIT | Self::CURSOR_KILLED | Self::CLIENT_DISCONNECT | Self::INTERRUPTED)
    }

    /// Returns that there is no room for temporary files.
    pub(super) fn disk_full(message: String) -> Self {
        Self::invalid(OUT_OF_DISK_SPACE, message)
    }

    /// Returns that a temporary file cannot be used.
    pub(super) fn of_file(message: String) -> Self {
        Self::invalid(FILE_FAILED, message)
    }

    /// Returns the error with an operator or field that it is about, or that encloses what it is about.
    #[must_use]
    pub fn about(mut self, name: &str) -> Self {
        if self.names.last().is_none_or(|last| last != name) {
            self.names.push(name.to_owned());
        }
        self
    }

    /// Returns the error with the kind of mistake it is.
    #[must_use]
    pub fn of_kind(self, mistake: QueryMistake) -> Self {
        Self { mistake: Some(mistake), ..self }
    }

    /// Returns the function of a map-reduce that failed, where it is about one: `map`, `reduce` or `finalize`.
    #[must_use]
    pub fn function(&self) -> Option<&'static str> {
        match self.mistake {
            Some(QueryMistake::InFunction(function)) => Some(function),
            _ => None,
        }
    }

    /// Valid MongoDB that rmem refuses.
    #[must_use]
    pub fn unsupported(operator: &str) -> Self {
        Self {
            code: 115,
            names: vec![operator.to_owned()],
            mistake: None,
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
