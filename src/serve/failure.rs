//! Errors of commands, as clients get them.

use bson::{Bson, Document, RawDocumentBuf, doc, rawdoc};

use super::code;
use super::files::Moved;
use crate::query::QueryError;
use crate::store::{StoreError, TakenKey};

/// The codes that commands fail with by themselves.
pub(super) mod codes {
    use crate::query::QueryError;

    pub(in crate::serve) const INTERNAL: i32 = 1;
    pub(in crate::serve) const BAD_VALUE: i32 = 2;
    pub(in crate::serve) const NO_SUCH_KEY: i32 = 4;
    pub(in crate::serve) const UNREACHABLE: i32 = 6;
    pub(in crate::serve) const FAILED_TO_PARSE: i32 = 9;
    pub(in crate::serve) const NO_USER: i32 = 11;
    pub(in crate::serve) const UNAUTHORIZED: i32 = 13;
    pub(in crate::serve) const TYPE_MISMATCH: i32 = 14;
    pub(in crate::serve) const INVALID_LENGTH: i32 = 16;
    pub(in crate::serve) const PROTOCOL: i32 = 17;
    pub(in crate::serve) const AUTHENTICATION: i32 = 18;
    pub(in crate::serve) const ILLEGAL: i32 = 20;
    pub(in crate::serve) const NO_NAMESPACE: i32 = QueryError::NAMESPACE_NOT_FOUND;
    pub(in crate::serve) const NO_INDEX: i32 = QueryError::INDEX_NOT_FOUND;
    pub(in crate::serve) const NO_CURSOR: i32 = 43;
    pub(in crate::serve) const NAMESPACE_EXISTS: i32 = QueryError::NAMESPACE_EXISTS;
    pub(in crate::serve) const NO_COMMAND: i32 = 59;
    pub(in crate::serve) const IMMUTABLE: i32 = 66;
    pub(in crate::serve) const CANNOT_CREATE_INDEX: i32 = 67;
    pub(in crate::serve) const INDEX_EXISTS: i32 = 68;
    pub(in crate::serve) const INVALID_OPTIONS: i32 = 72;
    pub(in crate::serve) const INVALID_NAMESPACE: i32 = 73;
    pub(in crate::serve) const UNKNOWN_MODE: i32 = 79;
    pub(in crate::serve) const SHUTDOWN: i32 = 91;
    pub(in crate::serve) const FAILED: i32 = 96;
    pub(in crate::serve) const UNSATISFIABLE_CONCERN: i32 = 100;
    pub(in crate::serve) const WRITE_CONFLICT: i32 = 112;
    pub(in crate::serve) const NOT_SUPPORTED: i32 = 115;
    pub(in crate::serve) const CONFLICT: i32 = 117;
    pub(in crate::serve) const INVALID_DOCUMENT: i32 = 121;
    pub(in crate::serve) const COMMAND_FAILED: i32 = 125;
    pub(in crate::serve) const QUERY_PLAN_KILLED: i32 = 175;
    pub(in crate::serve) const AMBIGUOUS_INDEX: i32 = 181;
    pub(in crate::serve) const INVALID_INDEX_OPTION: i32 = 197;
    pub(in crate::serve) const CONVERTED: i32 = 217;
    pub(in crate::serve) const TRANSACTION_TOO_OLD: i32 = 225;
    pub(in crate::serve) const CURSOR_KILLED: i32 = QueryError::CURSOR_KILLED;
    pub(in crate::serve) const NO_SNAPSHOT: i32 = 246;
    pub(in crate::serve) const NO_TRANSACTION: i32 = 251;
    pub(in crate::serve) const COMMITTED: i32 = 256;
    pub(in crate::serve) const INVALID_TOKEN: i32 = 260;
    pub(in crate::serve) const NOT_IN_TRANSACTION: i32 = 263;
    pub(in crate::serve) const UNSATISFIABLE_QUORUM: i32 = 278;
    pub(in crate::serve) const STREAM_FATAL: i32 = 280;
    pub(in crate::serve) const HISTORY_LOST: i32 = 286;
    pub(in crate::serve) const API_VERSION: i32 = 322;
    pub(in crate::serve) const NO_MECHANISM: i32 = 334;
    pub(in crate::serve) const NO_QUERY: i32 = 352;
    pub(in crate::serve) const TOO_LARGE: i32 = 10_334;
    pub(in crate::serve) const DUPLICATE: i32 = 11_000;
    pub(in crate::serve) const MALFORMED_STAGE: i32 = 40_323;
    pub(in crate::serve) const UNKNOWN_STAGE: i32 = 40_324;
    pub(in crate::serve) const UNKNOWN_FIELD: i32 = 40_415;
    pub(in crate::serve) const MISSING_FIELD: i32 = 40_414;
    pub(in crate::serve) const NOT_FIRST: i32 = 40_602;
    pub(in crate::serve) const NOT_RETRYABLE: i32 = 50_768;
    pub(in crate::serve) const NO_NUMBER: i32 = 50_889;
    pub(in crate::serve) const NO_UNIQUE_INDEX: i32 = 51_183;
    pub(in crate::serve) const NO_API_VERSION: i32 = 4_886_600;
}

/// The label of what may be tried again as a whole transaction.
pub(super) const TRANSIENT: &str = "TransientTransactionError";

/// The label of what ends a change stream for good.
pub(super) const NOT_RESUMABLE: &str = "NonResumableChangeStreamError";

/// The label of what a change stream goes on behind, once it is opened again.
pub(super) const RESUMABLE: &str = "ResumableChangeStreamError";

/// The label of what drivers repeat: it was certainly not done.
pub(super) const RETRYABLE: &str = "RetryableWriteError";

/// What a command answers.
pub(super) type Answer = Result<RawDocumentBuf, Failure>;

/// Whether what a command did stays done.
pub(super) fn is_kept(answer: &Answer) -> bool {
    answer.as_ref().map_or_else(|failure| failure.is_partial, |_| true)
}

/// Why a command failed.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Failure {
    /// MongoDB's code for it.
    pub(super) code: i32,
    pub(super) message: String,
    /// What drivers decide by whether to try again.
    pub(super) labels: Vec<&'static str>,
    /// Whether the command is malformed: a field in it is not known, is missing or has a value of the wrong type.
    pub(super) is_malformed: bool,
    /// Whether what the command did before it failed stays done.
    pub(super) is_partial: bool,
    /// Further fields of the answer.
    pub(super) details: Box<Document>,
}

impl Failure {
    pub(super) fn new(code: i32, message: impl Into<String>) -> Self {
        Self {
            code,
            message: message.into(),
            labels: Vec::new(),
            is_malformed: false,
            is_partial: false,
            details: Box::default(),
        }
    }

    /// A field of a command is not known, is missing or has a value of the wrong type.
    pub(super) fn malformed(code: i32, message: String) -> Self {
        Self { is_malformed: true, ..Self::new(code, message) }
    }

    /// The same, where what the command did before stays done.
    pub(super) fn after_the_rest(self) -> Self {
        Self { is_partial: true, ..self }
    }

    pub(super) fn labeled(mut self, label: &'static str) -> Self {
        self.labels.push(label);
        self
    }

    /// The same where something was done: it is not to be repeated as a whole.
    fn unlabeled(self) -> Self {
        Self { labels: Vec::new(), ..self }
    }

    /// Whether it is about the server, and not about what it was asked.
    pub(super) fn is_of_server(&self) -> bool {
        matches!(self.code, codes::UNREACHABLE | codes::FAILED | codes::WRITE_CONFLICT | codes::CONFLICT)
    }

    /// The same with what failed by it in front, as MongoDB has it.
    pub(super) fn caused(self, what: &str) -> Self {
        Self { message: format!("{what} :: caused by :: {}", self.message), ..self }
    }

    /// Valid MongoDB that rmem refuses.
    pub(super) fn unsupported(what: &str) -> Self {
        Self::new(codes::NOT_SUPPORTED, format!("{what} is not supported by rmem"))
    }

    /// Who is to confirm a write is said by the name of a mode, of which there is none.
    pub(super) fn no_mode(mode: &str) -> Self {
        let message = format!("No write concern mode named '{mode}' found in replica set configuration");
        Self::new(codes::UNKNOWN_MODE, message)
    }

    /// A command that writes nothing says who is to confirm it.
    pub(super) fn without_write_concern() -> Self {
        Self::new(codes::INVALID_OPTIONS, "Command does not support writeConcern")
    }

    /// The answer to a command that failed.
    pub(super) fn reply(&self) -> Document {
        let mut reply = doc! {
            "ok": 0.0,
            "errmsg": &self.message,
            "code": self.code,
            "codeName": code::name(self.code),
        };
        reply.extend(*self.details.clone());
        if !self.labels.is_empty() {
            reply.insert("errorLabels", self.labels.clone());
        }
        reply
    }

    /// What an answer says of a write that was done, and not confirmed as asked.
    pub(super) fn concern_error(&self) -> RawDocumentBuf {
        rawdoc! { "code": self.code, "codeName": code::name(self.code), "errmsg": self.message.as_str() }
    }

    /// The failure of one statement of several.
    pub(super) fn write_error(&self, index: usize) -> Document {
        let index = i32::try_from(index).unwrap_or(i32::MAX);
        let mut error = doc! { "index": index, "code": self.code };
        let (info, keys): (Document, Document) =
            self.details.clone().into_iter().partition(|(name, _)| name == "errInfo");
        error.extend(keys);
        error.insert("errmsg", &self.message);
        error.extend(info);
        error
    }
}

impl From<QueryError> for Failure {
    fn from(error: QueryError) -> Self {
        Self::new(error.code, error.message)
    }
}

impl From<bson::error::Error> for Failure {
    fn from(error: bson::error::Error) -> Self {
        QueryError::from(error).into()
    }
}

impl From<StoreError> for Failure {
    fn from(error: StoreError) -> Self {
        let message = error.to_string();
        match error {
            StoreError::Query(error) => error.into(),
            StoreError::Stopped { stored, source, .. } if stored.is_empty() => Self::from(*source),
            StoreError::Stopped { source, .. } => Self::from(*source).unlabeled(),
            StoreError::Partial { source, .. } => {
                let mut failure = Self::from(*source).unlabeled().after_the_rest();
                if failure.code == codes::UNREACHABLE {
                    failure.message = format!("{}; {message}", failure.message);
                }
                failure
            }
            StoreError::Duplicate { namespace, key, .. } => duplicate(&namespace.to_string(), &key),
            StoreError::Invalid(invalid) => {
                let failure = Self::new(codes::INVALID_DOCUMENT, "Document failed validation");
                Self { details: Box::new(doc! { "errInfo": invalid.info() }), ..failure }
            }
            StoreError::Unreachable { may_be_done: true, .. } => Self::new(codes::UNREACHABLE, message),
            StoreError::Unreachable { .. } => Self::new(codes::UNREACHABLE, message).labeled(RETRYABLE),
            StoreError::Held { .. } => Self::new(codes::CONFLICT, message),
            StoreError::Unfit { .. } => Self::new(codes::ILLEGAL, message),
            StoreError::Computable { ref source, .. } => match computed(source.as_ref()) {
                Some(inner) => Self::new(inner, message),
                None => Self::new(codes::FAILED, message),
            },
            StoreError::Interrupted { .. }
            | StoreError::DiskFull { .. }
            | StoreError::Unconfirmed { .. }
            | StoreError::Failed { .. } => Self::new(codes::FAILED, message),
        }
    }
}

impl From<Moved> for Failure {
    fn from(moved: Moved) -> Self {
        Self::new(codes::FAILED, moved.to_string())
    }
}

/// The code of a mistake in what a computable asked or answered.
fn computed(source: &(dyn std::error::Error + 'static)) -> Option<i32> {
    let query = match source.downcast_ref::<StoreError>() {
        Some(StoreError::Query(error)) => Some(error.code),
        _ => source.downcast_ref::<QueryError>().map(|error| error.code),
    };
    query.or_else(|| source.source().and_then(computed))
}

/// A taken key in MongoDB's words; drivers and programs look for them.
fn duplicate(ns: &str, key: &TakenKey) -> Failure {
    let (index, values) = (key.index().unwrap_or(crate::store::index::ID), key.text());
    let message = format!("E11000 duplicate key error collection: {ns} index: {index} dup key: {{ {values} }}");
    let mut failure = Failure::new(codes::DUPLICATE, message);
    if !key.values().is_empty() {
        let pattern: Document = key.values().keys().map(|name| (name.clone(), Bson::Int32(1))).collect();
        *failure.details = doc! { "keyPattern": pattern, "keyValue": key.values() };
    }
    failure
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::Namespace;

    #[test]
    fn a_taken_key_is_told_in_the_words_of_mongodb() {
        let taken = |key: TakenKey| {
            let namespace = Namespace::parse("a.b").unwrap();
            Failure::from(StoreError::Duplicate { namespace, key, stored: Vec::new() })
        };
        let id = taken(TakenKey::id(&7.into()));
        assert_eq!(id.message, "E11000 duplicate key error collection: a.b index: _id_ dup key: { _id: 7 }");
        assert_eq!(*id.details, doc! { "keyPattern": { "_id": 1 }, "keyValue": { "_id": 7 } });
        let name = taken(TakenKey::of_index("name_1", doc! { "name": "x" }));
        assert!(name.message.ends_with("index: name_1 dup key: { name: \"x\" }"), "{}", name.message);
    }

    #[test]
    fn what_was_certainly_not_done_may_be_repeated() {
        let labels = |may_be_done| {
            let (address, reason) = ("mongodb://robot1".to_owned(), "closed".to_owned());
            Failure::from(StoreError::Unreachable { address, reason, may_be_done }).labels
        };
        assert_eq!(labels(false), [RETRYABLE]);
        assert!(labels(true).is_empty());
        let away = || Box::new(StoreError::unreachable("mongodb://robot1", "closed"));
        let stopped = |stored| Failure::from(StoreError::Stopped { stored, document: None, source: away() }).labels;
        assert_eq!(stopped(Vec::new()), [RETRYABLE]);
        assert!(stopped(vec![Bson::Int32(1)]).is_empty());
        assert!(Failure::from(StoreError::Partial { done: 1, source: away() }).labels.is_empty());
    }

    #[test]
    fn a_failure_has_its_code_and_the_name_of_it() {
        let reply = Failure::new(codes::NO_COMMAND, "no such command: 'x'").labeled(TRANSIENT).reply();
        assert_eq!(reply.get_str("codeName").unwrap(), "CommandNotFound");
        assert_eq!(reply.get_array("errorLabels").unwrap().len(), 1);
    }
}
