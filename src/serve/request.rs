//! A command with what every command may say: its database, its session, how long it may take.

use std::sync::Arc;
use std::sync::atomic::{AtomicI32, Ordering};
use std::time::{Duration, Instant};

use bson::{Bson, Document, Timestamp};

use super::failure::{Failure, codes};
use super::fields::{Fields, integral, whole};
use super::origin::Origin;
use super::session::SessionId;
use crate::deadline::{Ending, Limits, Stop};
use crate::query::{QueryError, type_name};
use crate::store::{Acknowledgment, Namespace, WriteConcern};

/// A command to be run.
#[derive(Debug)]
pub(super) struct Request {
    /// Its name as the client spells it.
    pub(super) name: String,
    pub(super) body: Document,
    /// `$db`.
    pub(super) database: String,
    pub(super) session: Option<SessionId>,
    pub(super) transaction: Option<TransactionPart>,
    /// `bypassDocumentValidation`.
    pub(super) is_unvalidated: bool,
    /// When it came.
    pub(super) since: Instant,
    /// `maxTimeMS`.
    pub(super) limit: Option<Duration>,
    /// `writeConcern`.
    pub(super) write_concern: Option<WriteConcern>,
    /// The number by which it can be ended while it runs.
    pub(super) operation: i32,
    pub(super) stop: Arc<Stop>,
}

/// The number of the last operation.
static OPERATIONS: AtomicI32 = AtomicI32::new(0);

/// Commands that MongoDB refuses by another code than the rest where the name of their collection is no text.
const NAMED: [&str; 5] = ["collStats", "count", "dataSize", "distinct", "validate"];

/// What a command says of the transaction, or retryable write, that it belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct TransactionPart {
    /// `txnNumber`.
    pub(super) number: i64,
    /// `autocommit: false`: a transaction of several commands; else a write that may be repeated.
    pub(super) is_multi: bool,
    /// `startTransaction`.
    pub(super) starts: bool,
}

impl Request {
    /// Reads what every command may say.
    ///
    /// # Errors
    /// Where a field has the wrong type, or `$db` is missing.
    pub(super) fn read(body: Document) -> Result<Self, Failure> {
        let name = body.keys().next().cloned().unwrap_or_default();
        let fields = Fields::new(&name, &body);
        let database = match fields.text("$db")? {
            Some(database) => database.to_owned(),
            None => return Err(Failure::new(40_571, "OP_MSG requests require a $db argument")),
        };
        check_database(&database)?;
        check_version(fields)?;
        check_read_concern(fields)?;
        let write_concern = write_concern(fields)?;
        let session = fields.document("lsid")?.map(SessionId::read).transpose()?;
        let transaction = transaction(fields)?;
        if transaction.is_some() && session.is_none() {
            let message = "Transaction number requires a session ID to be specified";
            return Err(Failure::new(codes::INVALID_OPTIONS, message));
        }
        let is_unvalidated = fields.optional_flag("bypassDocumentValidation")?.unwrap_or(false);
        let limit = body.get("maxTimeMS").map(|limit| time_limit(fields, limit)).transpose()?.flatten();
        let (since, stop) = (Instant::now(), Arc::default());
        // After the largest number, it begins with 0 again.
        let operation = OPERATIONS.fetch_add(1, Ordering::Relaxed).wrapping_add(1) & i32::MAX;
        Ok(Self {
            name,
            database,
            session,
            transaction,
            is_unvalidated,
            since,
            limit,
            write_concern,
            body,
            operation,
            stop,
        })
    }

    pub(super) fn fields(&self) -> Fields<'_> {
        Fields::new(&self.name, &self.body)
    }

    /// The value of the command's name: its target.
    pub(super) fn target(&self) -> Option<&Bson> {
        self.body.get(&self.name)
    }

    /// The collection that the command is about.
    pub(super) fn namespace(&self) -> Result<Namespace, Failure> {
        match self.target() {
            Some(Bson::String(collection)) => namespace(&self.database, collection),
            other => {
                let message = format!("collection name has invalid type {}", other.map_or("missing", type_name));
                let code =
                    if NAMED.contains(&self.name.as_str()) { codes::INVALID_NAMESPACE } else { codes::BAD_VALUE };
                Err(Failure::new(code, message))
            }
        }
    }

    /// The same for what only reads, where the server's own collections are empty ones.
    pub(super) fn readable(&self) -> Result<Namespace, Failure> {
        match self.target() {
            Some(Bson::String(collection)) if collection.starts_with("system.") => {
                Ok(Namespace { database: self.database.clone(), collection: collection.clone() })
            }
            _ => self.namespace(),
        }
    }

    /// What ends the command before it is done. The limit of `getMore` is how long it waits for changes.
    pub(super) fn limits(&self) -> Limits {
        let limit = self.limit.filter(|_| self.name != "getMore");
        let until = limit.and_then(|limit| self.since.checked_add(limit));
        Limits { until, stop: Some(Arc::clone(&self.stop)) }
    }

    /// Fails where the command has taken as long as it may, or was stopped.
    pub(super) fn check_ending(&self) -> Result<(), Failure> {
        self.limits().ending().map_or(Ok(()), |ending| Err(interrupted(ending)))
    }

    /// Refuses a command that is about the whole server on any other database than `admin`.
    pub(super) fn check_admin(&self) -> Result<(), Failure> {
        match self.database.as_str() {
            "admin" => Ok(()),
            _ => {
                let message = format!("{} may only be run against the admin database.", self.name);
                Err(Failure::new(codes::UNAUTHORIZED, message))
            }
        }
    }

    /// The session and the transaction in which it is run.
    pub(super) fn origin(&self) -> Origin {
        let transaction = self.transaction.filter(|part| part.is_multi).map(|part| part.number);
        Origin { session: self.session.clone(), transaction }
    }

    /// Whether it is to read a snapshot, and is of no transaction. A cursor goes on in the snapshot that it was opened in,
    /// whatever `getMore` says of it.
    pub(super) fn reads_snapshot(&self) -> bool {
        let concern = self.body.get_document("readConcern");
        let is_own = !self.is_in_transaction() && self.name != "getMore";
        is_own && concern.is_ok_and(|concern| concern.get_str("level").ok() == Some("snapshot"))
    }

    /// The time of the snapshot that it is to read, where it names one.
    pub(super) fn at_cluster_time(&self) -> Option<Timestamp> {
        self.body.get_document("readConcern").ok()?.get_timestamp("atClusterTime").ok()
    }

    /// Whether the client is told nothing of what is written.
    pub(super) fn is_unacknowledged(&self) -> bool {
        let concern = self.write_concern.as_ref().map(|concern| &concern.acknowledgment);
        concern == Some(&Acknowledgment::Unacknowledged)
    }

    /// Why its write concern cannot be met, where that is so.
    pub(super) fn unmet_concern(&self) -> Option<Failure> {
        let concern = self.write_concern.as_ref()?;
        match &concern.acknowledgment {
            Acknowledgment::Unacknowledged | Acknowledgment::Usual => None,
            Acknowledgment::Several => {
                let message = "Not enough data-bearing nodes: rmem is one member";
                Some(Failure::new(codes::UNSATISFIABLE_CONCERN, message))
            }
            Acknowledgment::Tagged => {
                let tag = concern.document.get_document("w").ok().and_then(|tags| tags.keys().next());
                let message = format!("No replica set tag key {} in config", tag.map_or("", String::as_str));
                Some(Failure::new(codes::NO_SUCH_KEY, message))
            }
            Acknowledgment::Mode(mode) => Some(Failure::no_mode(mode)),
        }
    }

    /// Whether it is a command of a transaction.
    pub(super) fn is_in_transaction(&self) -> bool {
        self.transaction.is_some_and(|part| part.is_multi)
    }
}

/// The failure of a command that ends before it is done.
pub(super) fn interrupted(ending: Ending) -> Failure {
    match ending {
        Ending::OutOfTime => QueryError::exceeded_time_limit().into(),
        Ending::Stopped(code) => QueryError::interrupted(code).into(),
    }
}

/// Refuses what is not a name of a database, whatever the command: with a dot in it, it would name a collection.
fn check_database(name: &str) -> Result<(), Failure> {
    let is_name = !name.is_empty() && name.len() <= 63 && !name.contains(['.', '/', '\\', ' ', '"', '$', '\0']);
    match is_name || name == "$external" {
        true => Ok(()),
        false => Err(Failure::new(codes::INVALID_NAMESPACE, format!("Invalid database name: '{name}'"))),
    }
}

/// Refuses versions of the API that there are not: there is one.
fn check_version(fields: Fields<'_>) -> Result<(), Failure> {
    let (strict, deprecation) = (fields.optional_flag("apiStrict")?, fields.optional_flag("apiDeprecationErrors")?);
    match fields.text("apiVersion")? {
        Some("1") => Ok(()),
        Some(other) => Err(Failure::new(codes::API_VERSION, format!("API version must be \"1\", got \"{other}\""))),
        None if strict.is_some() || deprecation.is_some() => {
            let message = "Provided apiStrict and/or apiDeprecationErrors without passing apiVersion";
            Err(Failure::new(codes::NO_API_VERSION, message))
        }
        None => Ok(()),
    }
}

/// A namespace of a command.
pub(super) fn namespace(database: &str, collection: &str) -> Result<Namespace, Failure> {
    Namespace::parse(&format!("{database}.{collection}"))
        .map_err(|error| Failure::new(codes::INVALID_NAMESPACE, format!("Invalid namespace specified: {error}")))
}

fn transaction(fields: Fields<'_>) -> Result<Option<TransactionPart>, Failure> {
    let number = fields.whole("txnNumber")?;
    let (autocommit, starts) = (fields.optional_flag("autocommit")?, fields.optional_flag("startTransaction")?);
    match (number, autocommit) {
        _ if starts.is_some() && autocommit.is_none() => {
            let message = "'startTransaction' field requires 'autocommit' field to also be specified";
            Err(Failure::new(codes::INVALID_OPTIONS, message))
        }
        _ if starts == Some(false) => {
            Err(Failure::new(codes::INVALID_OPTIONS, "startTransaction is true where it is given"))
        }
        (Some(number), _) if number < 0 => {
            Err(Failure::new(codes::INVALID_OPTIONS, "the transaction number may not be negative"))
        }
        (Some(_), Some(true)) => Err(Failure::new(codes::INVALID_OPTIONS, "autocommit is false where it is given")),
        (Some(number), autocommit) => {
            Ok(Some(TransactionPart { number, is_multi: autocommit.is_some(), starts: starts == Some(true) }))
        }
        (None, Some(_)) => {
            Err(Failure::new(codes::INVALID_OPTIONS, "'autocommit' field requires a transaction number"))
        }
        (None, None) => Ok(None),
    }
}

/// How long the command may take, where that is limited.
fn time_limit(fields: Fields<'_>, limit: &Bson) -> Result<Option<Duration>, Failure> {
    if fields.of == "aggregate" {
        // It reads it first, as it reads its other fields.
        fields.size("maxTimeMS")?;
    }
    let wrong = |message: String| Err(Failure::new(codes::BAD_VALUE, message));
    match whole(limit) {
        None => wrong("maxTimeMS must be a number".to_owned()),
        Some(_) if matches!(limit, Bson::Double(_)) && integral(limit).is_none() => {
            wrong("maxTimeMS has non-integral value".to_owned())
        }
        Some(0) => Ok(None),
        Some(millis @ 0..=0x7FFF_FFFF) => Ok(Some(Duration::from_millis(millis.unsigned_abs()))),
        Some(other) => wrong(format!("{other} value for maxTimeMS is out of range")),
    }
}

/// Checks what is asked of what reads see.
fn check_read_concern(fields: Fields<'_>) -> Result<(), Failure> {
    if fields.of == "aggregate" {
        fields.document("readConcern")?;
    }
    if fields.document.get("readConcern").is_some_and(|concern| concern.as_document().is_none()) {
        return Err(Failure::new(codes::FAILED_TO_PARSE, "readConcern field should be an object"));
    }
    if let Some(concern) = fields.document("readConcern")? {
        let concern = Fields::new("readConcern", concern);
        let known = ["level", "afterClusterTime", "atClusterTime", "provenance"];
        if let Some(unknown) = concern.document.keys().find(|name| !known.contains(&name.as_str())) {
            let message = format!("Unrecognized option in readConcern: {unknown}");
            return Err(Failure::new(codes::INVALID_OPTIONS, message));
        }
        let level = concern.text("level")?;
        check_provenance(concern)?;
        if concern.timestamp("afterClusterTime")?.is_some_and(|moment| moment == Timestamp { time: 0, increment: 0 }) {
            return Err(Failure::new(codes::INVALID_OPTIONS, "afterClusterTime cannot be a null timestamp"));
        }
        if concern.timestamp("atClusterTime")?.is_some() && level != Some("snapshot") {
            let message = "atClusterTime field can be set only if level is equal to snapshot";
            return Err(Failure::new(codes::INVALID_OPTIONS, message));
        }
        match level {
            None | Some("local" | "majority" | "available" | "linearizable" | "snapshot") => {}
            Some(other) => {
                let message = format!("readConcern.level has no value '{other}'");
                return Err(Failure::new(codes::FAILED_TO_PARSE, message));
            }
        }
    }
    Ok(())
}

/// Reads the write concern, where there is one.
fn write_concern(fields: Fields<'_>) -> Result<Option<WriteConcern>, Failure> {
    let Some(given) = fields.document.get("writeConcern") else { return Ok(None) };
    let Bson::Document(document) = given else {
        let message = format!("\"writeConcern\" had the wrong type. Expected object, found {}", type_name(given));
        return Err(Failure::new(codes::TYPE_MISMATCH, message));
    };
    let concern = Fields::new("writeConcern", document);
    concern.known_inside(&["w", "j", "fsync", "wtimeout", "wtimeoutMS", "getLastError", "provenance"])?;
    let is_journaled = concern.optional_flag("j")? == Some(true);
    if concern.optional_flag("fsync")? == Some(true) && is_journaled {
        return Err(Failure::new(codes::FAILED_TO_PARSE, "fsync and j options cannot be used together"));
    }
    check_provenance(concern)?;
    if document.get("wtimeout").is_some_and(is_too_long) {
        return Err(Failure::new(codes::FAILED_TO_PARSE, "wtimeout must be a 32-bit integer"));
    }
    let acknowledgment = match members(document.get("w"))? {
        Acknowledgment::Unacknowledged if is_journaled => Acknowledgment::Usual,
        members => members,
    };
    Ok(Some(WriteConcern { acknowledgment, document: document.clone() }))
}

/// Where a read or write concern says that it comes from.
fn check_provenance(concern: Fields<'_>) -> Result<(), Failure> {
    let known = ["clientSupplied", "implicitDefault", "customDefault", "getLastErrorDefaults", "internalWriteDefault"];
    match concern.text("provenance")? {
        Some(other) if !known.contains(&other) => {
            let message =
                format!("Enumeration value '{other}' for field '{}.provenance' is not a valid value.", concern.of);
            Err(Failure::new(codes::BAD_VALUE, message))
        }
        _ => Ok(()),
    }
}

/// Whether a time in milliseconds does not fit into 32 bits.
fn is_too_long(millis: &Bson) -> bool {
    match millis {
        Bson::Int64(millis) => *millis > i32::MAX.into(),
        Bson::Double(millis) => *millis > f64::from(i32::MAX),
        Bson::Decimal128(millis) => millis.to_string().parse::<f64>().is_ok_and(|millis| millis > f64::from(i32::MAX)),
        _ => false,
    }
}

/// Reads `w`: which members a write waits for.
fn members(members: Option<&Bson>) -> Result<Acknowledgment, Failure> {
    match members {
        None | Some(Bson::Null) => Ok(Acknowledgment::Usual),
        Some(Bson::String(mode)) if mode == "majority" => Ok(Acknowledgment::Usual),
        Some(Bson::String(mode)) => Ok(Acknowledgment::Mode(mode.clone())),
        // Tags of members, and how many have to have each.
        Some(Bson::Document(tags)) => {
            if tags.is_empty() || tags.values().any(|count| whole(count).is_none()) {
                let message = "the tags of a write concern must be a single level document with only number values";
                return Err(Failure::new(codes::FAILED_TO_PARSE, message));
            }
            Ok(Acknowledgment::Tagged)
        }
        Some(number) => match whole(number) {
            Some(0) => Ok(Acknowledgment::Unacknowledged),
            Some(1) => Ok(Acknowledgment::Usual),
            Some(2..=50) => Ok(Acknowledgment::Several),
            _ => Err(Failure::new(codes::FAILED_TO_PARSE, "w has to be a number from 0 to 50, or 'majority'")),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::doc;

    fn code(body: Document) -> i32 {
        Request::read(body).map_or_else(|failure| failure.code, |_| 0)
    }

    #[test]
    fn what_every_command_may_say_is_checked() {
        assert_eq!(code(doc! { "ping": 1, "$db": "a", "readConcern": { "level": "majority" } }), 0);
        assert_eq!(code(doc! { "ping": 1 }), 40_571);
        assert_eq!(code(doc! { "ping": 1, "$db": 3 }), codes::TYPE_MISMATCH);
        assert_eq!(code(doc! { "ping": 1, "$db": "a", "txnNumber": 1_i64 }), codes::INVALID_OPTIONS);
        let lsid = doc! { "id": bson::Uuid::new() };
        let alone = doc! { "ping": 1, "$db": "a", "lsid": &lsid, "txnNumber": 1_i64, "startTransaction": true };
        assert_eq!(code(alone), codes::INVALID_OPTIONS);
        let part = doc! { "ping": 1, "$db": "a", "lsid": lsid, "txnNumber": 1_i64, "autocommit": false };
        assert_eq!(code(part.clone()), 0);
        let not = part.into_iter().chain([("startTransaction".to_owned(), false.into())]).collect();
        assert_eq!(code(not), codes::INVALID_OPTIONS);
        assert_eq!(code(doc! { "ping": 1, "$db": "a", "readConcern": { "level": "past" } }), codes::FAILED_TO_PARSE);
        let others = Request::read(doc! { "ping": 1, "$db": "a", "writeConcern": { "w": 3 } }).unwrap();
        assert_eq!(others.write_concern.unwrap().acknowledgment, Acknowledgment::Several);
        let mode = Request::read(doc! { "ping": 1, "$db": "a", "writeConcern": { "w": "far" } }).unwrap();
        assert_eq!(mode.write_concern.unwrap().acknowledgment, Acknowledgment::Mode("far".to_owned()));
        assert_eq!(code(doc! { "ping": 1, "$db": "a", "writeConcern": { "j": "x" } }), codes::TYPE_MISMATCH);
        let both = doc! { "j": true, "fsync": true };
        assert_eq!(code(doc! { "ping": 1, "$db": "a", "writeConcern": both }), codes::FAILED_TO_PARSE);
        let long = doc! { "wtimeout": 1_i64 << 31 };
        assert_eq!(code(doc! { "ping": 1, "$db": "a", "writeConcern": long }), codes::FAILED_TO_PARSE);
        let limited = |limit: Bson| Request::read(doc! { "ping": 1, "$db": "a", "maxTimeMS": limit });
        for wrong in
            [(1_i64 << 31).into(), (-1).into(), 1.5.into(), f64::NAN.into(), "1".into(), true.into(), Bson::Null]
        {
            assert_eq!(limited(wrong).unwrap_err().code, codes::BAD_VALUE);
        }
        assert_eq!(limited(0.into()).unwrap().limit, None);
        assert_eq!(limited(2.0.into()).unwrap().limit, Some(Duration::from_millis(2)));
        for (command, expected) in [("ping", codes::FAILED_TO_PARSE), ("aggregate", codes::TYPE_MISMATCH)] {
            assert_eq!(code(doc! { command: 1, "$db": "a", "readConcern": "local" }), expected);
        }
        assert_eq!(code(doc! { "aggregate": 1, "$db": "a", "readConcern": Bson::Null }), codes::FAILED_TO_PARSE);
        assert_eq!(code(doc! { "aggregate": 1, "$db": "a", "maxTimeMS": "1" }), codes::TYPE_MISMATCH);
        assert_eq!(code(doc! { "ping": 1, "$db": "a", "writeConcern": Bson::Null }), codes::TYPE_MISMATCH);
        assert_eq!(code(doc! { "ping": 1, "$db": "a", "bypassDocumentValidation": "x" }), codes::TYPE_MISMATCH);
        let concern = |concern: Document| code(doc! { "ping": 1, "$db": "a", "readConcern": concern });
        assert_eq!(concern(doc! { "afterClusterTime": Timestamp { time: 1, increment: 1 } }), 0);
        assert_eq!(concern(doc! { "afterClusterTime": Timestamp { time: 0, increment: 0 } }), codes::INVALID_OPTIONS);
        assert_eq!(concern(doc! { "afterClusterTime": Bson::Null }), codes::TYPE_MISMATCH);
        assert_eq!(concern(doc! { "atClusterTime": Timestamp { time: 1, increment: 1 } }), codes::INVALID_OPTIONS);
        assert_eq!(concern(doc! { "provenance": "clientSupplied" }), 0);
        assert_eq!(concern(doc! { "provenance": "far" }), codes::BAD_VALUE);
        assert_eq!(concern(doc! { "other": 1 }), codes::INVALID_OPTIONS);
        let none = Request::read(doc! { "ping": 1, "$db": "a", "writeConcern": { "w": 0.5 } }).unwrap();
        assert_eq!(none.write_concern.unwrap().acknowledgment, Acknowledgment::Unacknowledged);
        let journaled = Request::read(doc! { "ping": 1, "$db": "a", "writeConcern": { "w": 0, "j": true } }).unwrap();
        assert_eq!(journaled.write_concern.unwrap().acknowledgment, Acknowledgment::Usual);
        let tagged = Request::read(doc! { "ping": 1, "$db": "a", "writeConcern": { "w": { "place": 2 } } }).unwrap();
        assert_eq!(tagged.write_concern.unwrap().acknowledgment, Acknowledgment::Tagged);
    }

    #[test]
    fn no_command_takes_a_database_that_is_none() {
        for name in ["aa.bb", "", "a b", "a$b", "a/b"] {
            assert_eq!(code(doc! { "ping": 1, "$db": name }), codes::INVALID_NAMESPACE, "{name}");
        }
        assert_eq!(code(doc! { "ping": 1, "$db": "$external" }), 0);
    }

    #[test]
    fn a_bad_namespace_is_refused_by_its_code() {
        let request = Request::read(doc! { "insert": "a..b", "$db": "d" }).unwrap();
        assert_eq!(request.namespace().unwrap_err().code, codes::INVALID_NAMESPACE);
        let request = Request::read(doc! { "insert": 1, "$db": "d" }).unwrap();
        assert_eq!(request.namespace().unwrap_err().code, codes::BAD_VALUE);
        let request = Request::read(doc! { "count": 1, "$db": "d" }).unwrap();
        assert_eq!(request.namespace().unwrap_err().code, codes::INVALID_NAMESPACE);
    }
}
