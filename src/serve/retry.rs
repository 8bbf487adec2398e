//! Writes that are done once, however often they are sent.
//!
//! A driver that lost its connection does not know whether its write was done, and sends it again with the same
//! session and number. What was answered is kept in the collection `rmem.retries` of the database, in
//! the write itself: a server that is killed and started again knows it, too.

use bson::{Bson, DateTime, Document, RawDocumentBuf, doc};

use super::access::RECORDS;
use super::failure::{Failure, codes};
use super::session::{Finished, Once, SessionId};
use super::statements::Repeatable;
use crate::memory::Memory;
use crate::query::decode;
use crate::store::{Find, Namespace, StoreError};

/// How long it is kept: longer than a session lives.
const KEPT: i64 = 40 * 60 * 1000;

fn records(ns: &Namespace) -> Namespace {
    Namespace { database: ns.database.clone(), collection: RECORDS.to_owned() }
}

/// What a write was answered when it was done before.
///
/// # Errors
/// Where the session has done a later one since, or this one with other statements.
pub(super) fn recall(
    memory: &Memory,
    ns: &Namespace,
    Repeatable { once, statements }: &Repeatable,
    last: Option<Finished>,
) -> Result<Option<RawDocumentBuf>, Failure> {
    match last {
        Some(last) if last.number < once.number => return Ok(None),
        Some(last) if last.number > once.number => return Err(too_old(once, last.number)),
        _ => {}
    }
    let Some(record) = record(memory, ns, &once.session)? else { return Ok(None) };
    let number = record.get_i64("number").unwrap_or_default();
    if number > once.number {
        return Err(too_old(once, number));
    }
    match record.get("reply") {
        Some(Bson::Document(reply)) if number == once.number => {
            // A record of an earlier rmem has none.
            let kept = record.get_array("statements").ok().map(|kept| kept.iter().filter_map(Bson::as_i64).collect());
            if kept.is_some_and(|kept: Vec<i64>| kept != statements.numbers) {
                return Err(Failure::unsupported("repeating a write with other statements (stmtIds) than it had"));
            }
            Ok(Some(RawDocumentBuf::try_from(&statements.repeated(reply.clone()))?))
        }
        _ => Ok(None),
    }
}

fn record(memory: &Memory, ns: &Namespace, session: &SessionId) -> Result<Option<Document>, Failure> {
    let records = records(ns);
    let find = Find { filter: doc! { "_id": session.to_bson() }, ..Find::default() };
    let found = memory.bare(&records)?.find(&records, &find)?.next().transpose()?;
    Ok(found.map(|raw| Document::try_from(&*raw)).transpose()?)
}

fn too_old(once: &Once, last: i64) -> Failure {
    let message = format!(
        "Cannot start transaction {} on session {} because a newer transaction with txnNumber {last} has already started.",
        once.number, once.session
    );
    Failure::new(codes::TRANSACTION_TOO_OLD, message)
}

/// Keeps what a write is answered. In the write only.
pub(super) fn keep(
    memory: &Memory,
    ns: &Namespace,
    once: &Once,
    statements: &[i64],
    reply: &RawDocumentBuf,
) -> Result<(), Failure> {
    let record = doc! {
        "_id": once.session.to_bson(),
        "number": once.number,
        "at": DateTime::now(),
        "statements": statements.to_vec(),
        "reply": decode(reply)?,
    };
    let records = records(ns);
    memory.bare(&records)?.put(&records, vec![record], None)?;
    Ok(())
}

/// Whether a transaction of this number was committed, as far as is kept.
pub(super) fn is_committed(memory: &Memory, ns: &Namespace, once: &Once) -> Result<bool, Failure> {
    let record = record(memory, ns, &once.session)?;
    Ok(record.is_some_and(|record| record.get_i64("number").ok() == Some(once.number)))
}

/// Removes what is kept longer than any session lives.
pub(super) fn sweep(memory: &Memory) -> Result<(), StoreError> {
    let before = DateTime::from_millis(DateTime::now().timestamp_millis() - KEPT);
    for records in memory.all_collections()?.into_iter().filter(|ns| ns.collection == RECORDS) {
        memory.bare(&records)?.delete(&records, (&doc! { "at": { "$lt": before } }).into(), false)?;
    }
    Ok(())
}
