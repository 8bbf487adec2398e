//! The driver's errors in the words of [`StoreError`].

use bson::{Bson, Document};
use mongodb::error::{Error, ErrorKind, WriteFailure};

use super::server_message;
use crate::deadline;
use crate::query::QueryError;
use crate::store::{InvalidDocument, Namespace, StoreError, TakenKey};

/// The server's code for a taken unique key.
const DUPLICATE: i32 = 11000;

/// The server's code for a document that does not pass the validator of its collection.
const INVALID: i32 = 121;

/// Codes for the server's state, not for a mistake in the request.
const STATE: [i32; 18] = [6, 7, 13, 18, 50, 64, 89, 91, 100, 189, 262, 9001, 10058, 10107, 11600, 11602, 13435, 14031];

/// The server's code for what a user may not do.
pub(super) const UNAUTHORIZED: i32 = 13;

/// The server's code for a change stream of a server that is not replicated.
pub(super) const NO_STREAMS: i32 = 40_573;

/// Codes for a change stream that cannot go on where it ended.
pub(super) const HISTORY_LOST: [i32; 3] = [136, 280, 286];

/// The server's code for what has no room in a document, such as an event of a change stream.
pub(super) const TOO_LARGE: i32 = 10_334;

/// What to do about a server that is not replicated.
pub(super) const STANDALONE: &str = "this server is not a member of a replica set, and only replica sets report \
     changes; start mongod with --replSet NAME and run rs.initiate() once (one member is enough)";

/// Codes of temporary errors, which end when a member is elected, restarted or found, or
/// which say that a cursor was lost.
const PASSING: [i32; 19] =
    [6, 7, 43, 63, 64, 89, 91, 133, 134, 150, 189, 234, 246, 262, 9001, 10107, 11600, 11602, 13435];

/// Whether an error passes, so that one may try again.
pub(super) fn is_passing(error: &Error) -> bool {
    match error.kind.as_ref() {
        ErrorKind::Command(command) => {
            PASSING.contains(&command.code)
                || command.code == 13436
                || error.contains_label("ResumableChangeStreamError")
        }
        ErrorKind::ServerSelection { .. }
        | ErrorKind::Io(_)
        | ErrorKind::DnsResolve { .. }
        | ErrorKind::ConnectionPoolCleared { .. } => true,
        _ => error.contains_label("ResumableChangeStreamError"),
    }
}

/// Whether an insert that goes on behind errors left out nothing but documents whose keys are taken.
pub(super) fn is_of_taken_keys(error: &Error) -> bool {
    let ErrorKind::InsertMany(many) = error.kind.as_ref() else { return false };
    let is_taken =
        |errors: &Vec<_>| errors.iter().all(|error: &mongodb::error::IndexedWriteError| error.code == DUPLICATE);
    many.write_concern_error.is_none() && many.write_errors.as_ref().is_some_and(is_taken)
}

/// The server's code, where the error is the server's.
pub(super) fn code(error: &Error) -> Option<i32> {
    match error.kind.as_ref() {
        ErrorKind::Command(command) => Some(command.code),
        ErrorKind::Write(WriteFailure::WriteError(write)) => Some(write.code),
        _ => None,
    }
}

/// Puts an error into words; a duplicate needs [`explain_write`].
pub(super) fn explain(address: &str, error: &Error) -> StoreError {
    let unreachable = |reason| StoreError::unreachable(address, reason);
    match error.kind.as_ref() {
        ErrorKind::ServerSelection { message, .. } => unreachable(selection(message)),
        ErrorKind::Io(error) => unreachable(error.to_string()),
        ErrorKind::DnsResolve { message, .. } | ErrorKind::ConnectionPoolCleared { message, .. } => {
            unreachable(message.clone())
        }
        ErrorKind::Command(command) => coded(address, command.code, &command.message),
        ErrorKind::Write(WriteFailure::WriteError(write)) => coded(address, write.code, &write.message),
        ErrorKind::Write(WriteFailure::WriteConcernError(concern)) => {
            unconfirmed(address, "the write", &concern.message)
        }
        ErrorKind::InsertMany(many) => match (many.write_errors.iter().flatten().next(), &many.write_concern_error) {
            (Some(first), _) => coded(address, first.code, &first.message),
            (_, Some(concern)) => unconfirmed(address, "the write", &concern.message),
            _ => failed(address, brief(error)),
        },
        ErrorKind::Bson(error) => QueryError::invalid(22, format!("invalid BSON: {error}")).into(),
        _ => failed(address, brief(error)),
    }
}

/// Puts the error of an update or a deletion in `ns` into words. Where the connection broke after
/// the request was sent, the change may have been made.
pub(super) fn explain_change(address: &str, ns: &Namespace, error: &Error) -> StoreError {
    sent(explain_write(address, ns, error), error, || format!("the change of {ns} was made"))
}

/// The error of what follows a change in `ns` that was made, or may have been: it does not say that nothing was done.
pub(super) fn behind_change(ns: &Namespace, is_made: bool, error: StoreError) -> StoreError {
    let made = format!("the change of {ns} was made");
    let what = if is_made { made.clone() } else { unknown(&made) };
    let unsaid = format!("; {}", unknown(&made));
    let told = |reason: &str| format!("{}; {what}", reason.strip_suffix(&unsaid).unwrap_or(reason));
    match error {
        StoreError::Unreachable { address, reason, .. } => {
            StoreError::Unreachable { address, reason: told(&reason), may_be_done: true }
        }
        StoreError::Failed { address, reason } => StoreError::Failed { address, reason: told(&reason) },
        other => other,
    }
}

fn unknown(what: &str) -> String {
    format!("whether {what} is not known")
}

/// The error of a write that was sent to a server, where one was found: where the connection was lost meanwhile, it is
/// not known whether `what` is so.
fn sent(explained: StoreError, error: &Error, what: impl FnOnce() -> String) -> StoreError {
    match explained {
        StoreError::Unreachable { address, reason, .. }
            if !matches!(*error.kind, ErrorKind::ServerSelection { .. }) =>
        {
            let reason = format!("{reason}; {}", unknown(&what()));
            StoreError::Unreachable { address, reason, may_be_done: true }
        }
        other => other,
    }
}

/// The error of a write to `ns` whose document does not pass the validator of its collection; none for any other.
pub(super) fn invalid(ns: &Namespace, error: &Error) -> Option<StoreError> {
    let (code, details) = match error.kind.as_ref() {
        ErrorKind::Write(WriteFailure::WriteError(write)) => (write.code, write.details.clone()),
        ErrorKind::Command(command) => (command.code, None),
        ErrorKind::InsertMany(many) => {
            let first = many.write_errors.as_ref()?.first()?;
            (first.code, first.details.clone())
        }
        _ => return None,
    };
    let response = || {
        let response = Document::try_from(error.server_response()?).ok()?;
        response.get_document("errInfo").ok().cloned()
    };
    (code == INVALID).then(|| {
        let info = details.or_else(response).unwrap_or_default();
        let details = info.get_document("details").cloned().unwrap_or_default();
        let id = info.get("failingDocumentId").cloned();
        let is_truncated = info.get_bool("truncated").unwrap_or(false) || info.contains_key("note");
        StoreError::Invalid(Box::new(InvalidDocument { namespace: ns.clone(), id, details, is_truncated }))
    })
}

/// Puts the error of a write to `ns` into words.
pub(super) fn explain_write(address: &str, ns: &Namespace, error: &Error) -> StoreError {
    if let Some(invalid) = invalid(ns, error) {
        return invalid;
    }
    match error.kind.as_ref() {
        ErrorKind::Write(WriteFailure::WriteError(write)) if write.code == DUPLICATE => {
            StoreError::Duplicate { namespace: ns.clone(), key: key(&write.message), stored: Vec::new() }
        }
        ErrorKind::Command(command) if command.code == DUPLICATE => {
            StoreError::Duplicate { namespace: ns.clone(), key: key(&command.message), stored: Vec::new() }
        }
        ErrorKind::Write(WriteFailure::WriteConcernError(concern)) => {
            unconfirmed(address, &format!("the change of {ns}"), &concern.message)
        }
        _ => explain(address, error),
    }
}

/// Puts the error of an ordered insert of documents with `ids` into words.
/// Where the connection was lost, it is not known which of them the server stored.
pub(super) fn explain_insert(address: &str, ns: &Namespace, ids: &[Bson], error: &Error) -> StoreError {
    let ErrorKind::InsertMany(many) = error.kind.as_ref() else {
        let stored = || format!("these {} documents were stored", ids.len());
        return sent(explain_write(address, ns, error), error, stored);
    };
    let Some(first) = many.write_errors.as_ref().and_then(|errors| errors.first()) else {
        let source = Box::new(match &many.write_concern_error {
            Some(concern) => {
                let what = match ids {
                    [id] => format!("the document {id} of {ns}"),
                    ids => format!("all {} documents of {ns}", ids.len()),
                };
                unconfirmed(address, &what, &concern.message)
            }
            None => explain(address, error),
        });
        return StoreError::Stopped { stored: ids.to_vec(), document: None, source };
    };
    let stored = ids.get(..first.index).unwrap_or_default().to_vec();
    if let Some(invalid) = invalid(ns, error) {
        return invalid.stopped(stored, ids.len());
    }
    if first.code != DUPLICATE {
        return coded(address, first.code, &first.message).stopped(stored, ids.len());
    }
    let key = match ids.get(first.index) {
        Some(id) if first.message.contains("index: _id_ ") => TakenKey::id(id),
        _ => key(&first.message),
    };
    StoreError::Duplicate { namespace: ns.clone(), key, stored }
}

/// The error of an insert of documents behind others, which are stored: those before it, if there are any.
pub(super) fn behind(before: &[Bson], error: StoreError) -> StoreError {
    let all = |stored: Vec<Bson>| [before, &stored].concat();
    match error {
        StoreError::Duplicate { namespace, key, stored } => {
            StoreError::Duplicate { namespace, key, stored: all(stored) }
        }
        StoreError::Stopped { stored, document, source } => {
            let document = document.map(|nth| nth + before.len());
            StoreError::Stopped { stored: all(stored), document, source }
        }
        other if !before.is_empty() => {
            StoreError::Stopped { stored: before.to_vec(), document: None, source: Box::new(other) }
        }
        other => other,
    }
}

/// The driver's message without its debug output.
pub(super) fn brief(error: &Error) -> String {
    error.kind.to_string()
}

fn coded(address: &str, code: i32, message: &str) -> StoreError {
    // A limit that the operation itself has set is no state of the server.
    let is_own_limit = code == QueryError::EXCEEDED_TIME_LIMIT && deadline::left().is_some();
    if STATE.contains(&code) && !is_own_limit {
        return failed(address, format!("{message} (code {code})"));
    }
    server_message::refusal(code, message).into()
}

/// A write that the primary did, and which is lost where it fails before others have it.
pub(super) fn unconfirmed(address: &str, what: &str, message: &str) -> StoreError {
    let reason = format!(
        "{what} was written by the primary, but a majority of the members did not confirm it ({message}); it may be lost \
         where the primary fails now; see `rmem backend status`"
    );
    StoreError::Unconfirmed { address: address.to_owned(), reason }
}

fn failed(address: &str, reason: String) -> StoreError {
    StoreError::Failed { address: address.to_owned(), reason }
}

/// `_id: 7` out of `E11000 duplicate key error collection: a.b index: _id_ dup key: { _id: 7 }`;
/// another index is named.
fn key(message: &str) -> TakenKey {
    let behind = message.split_once("dup key: {").map_or(message, |(_, behind)| behind);
    let key = behind.trim();
    let key = key.strip_suffix('}').unwrap_or(key).trim();
    let index = message.split_once("index: ").and_then(|(_, behind)| behind.split_once(" dup key"));
    match index {
        Some((name, _)) if name != "_id_" => TakenKey::spelled(Some(name), key),
        _ => TakenKey::spelled(None, key),
    }
}

/// The useful part of the driver's report on the servers it tried.
fn selection(message: &str) -> String {
    let cause = message
        .split_once("I/O error: ")
        .map(|(_, behind)| behind.split_once(", labels").map_or(behind, |(cause, _)| cause));
    match cause {
        _ if message.contains("ReplicaSetNoPrimary") && message.contains("None of the available servers") => {
            let what = match message.contains("criteria Write") {
                true => "nothing can be written",
                false => "what is read from the primary cannot be read",
            };
            format!(
                "the replica set has no primary, so {what}: a majority of its members has to be up and in reach of each \
                 other; `rmem backend status` shows them, `rmem backend up` starts those of this robot"
            )
        }
        Some(cause) => format!("no server answers ({cause}); is it running?"),
        None if message.contains("None of the available servers") => {
            "no server takes this operation (is there a primary? does replicaSet in the URI fit?)".to_owned()
        }
        None if message.contains("No available servers") && !message.contains("Address: ") => {
            "a server answers, but its replica set has another name; correct replicaSet in the URI".to_owned()
        }
        None => "no server answers; is it running?".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_key_is_found_in_the_servers_message() {
        let message = "E11000 duplicate key error collection: a.b index: name_1 dup key: { name: \"x}\" }";
        assert_eq!(key(message).to_string(), "name: \"x}\" (unique index name_1)");
        let id = key("E11000 duplicate key error collection: a.b index: _id_ dup key: { _id: {} }");
        assert_eq!(id.to_string(), "_id: {}");
    }

    #[test]
    fn no_error_behind_a_change_says_that_it_was_not_made() {
        let ns = Namespace::parse("a.b").unwrap();
        let unreachable = || StoreError::unreachable("mongodb://robot1", "closed");
        let text = |is_made, error| behind_change(&ns, is_made, error).to_string();
        assert!(matches!(behind_change(&ns, true, unreachable()), StoreError::Unreachable { may_be_done: true, .. }));
        let made = "cannot reach mongodb://robot1: closed; the change of a.b was made";
        assert_eq!(text(true, unreachable()), made);
        // One of a second request that was sent is about the first one, too.
        let uncertain = behind_change(&ns, false, unreachable());
        assert!(uncertain.to_string().ends_with("closed; whether the change of a.b was made is not known"));
        assert_eq!(text(true, uncertain), made);
        let stopped = behind(&[Bson::Int32(1)], unreachable());
        assert_eq!(stopped.stored(), [Bson::Int32(1)]);
    }

    #[test]
    fn without_a_primary_the_error_suggests_what_to_do() {
        let message = "Server selection timeout: None of the available servers suitable for criteria Write. Topology: \
            { Type: ReplicaSetNoPrimary, Set Name: shared, Servers: [ { Address: 127.0.0.1:1, Type: Unknown, Error: Kind: \
            I/O error: Connection refused (os error 111), labels: {} }, { Address: 127.0.0.1:2, Type: RsSecondary } ] }";
        assert!(selection(message).contains("`rmem backend up` starts those of this robot"), "{}", selection(message));
        assert!(selection(message).contains("so nothing can be written"), "{}", selection(message));
        let reading = selection(&message.replace("criteria Write", "criteria ReadPreference(Primary)"));
        assert!(reading.contains("cannot be read") && !reading.contains("writ"), "{reading}");
    }

    #[test]
    fn the_cause_is_found_in_the_drivers_message() {
        let message = "Server selection timeout: No available servers. Topology: { Type: Unknown, Servers: [ { \
            Address: 127.0.0.1:1, Type: Unknown, Error: Kind: I/O error: Connection refused (os error 111), labels: {} } ] }";
        assert_eq!(selection(message), "no server answers (Connection refused (os error 111)); is it running?");
    }
}
