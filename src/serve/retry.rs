//! Writes that are done once, however often they are sent.
//!
//! A driver that lost its connection does not know whether its write was done, and sends it again with the same
//! session and number. What its statements did is kept in the collection `rmem.retries` of `config`, in
//! the write itself: a server that is killed and started again knows it, too.
//!
//! A record is `{_id: SESSION, number, at, done: [RUN, …]}`, where `done` of a transaction is empty. Where `done` does not fit into a document, it is cut into
//! parts `{_id: {session, part}, number, at, bytes}`, of which the record has the count (`parts`).

use std::time::Instant;

use bson::spec::BinarySubtype;
use bson::{Binary, Bson, DateTime, Document, doc};

use super::access::{OF_FILES, RECORDS, records};
use super::failure::{Failure, codes};
use super::session::{Finished, How, Once, SessionId};
use super::statements::Repeatable;
use crate::memory::Memory;
use crate::store::{Find, Namespace, StoreError};

/// At most so many bytes of `done` are in one document, which has 16 MiB at most.
const LARGEST_PART: usize = 8 << 20;

/// Recalls what the statements of a write did when they were sent before.
///
/// # Errors
/// Where the session has done a later write since.
pub(super) fn recall(
    memory: &Memory,
    ns: &Namespace,
    Repeatable { once, statements }: &Repeatable,
    last: Option<Finished>,
) -> Result<(), Failure> {
    match last {
        Some(last) if last.number < once.number => return Ok(()),
        Some(last) if last.number > once.number => return Err(too_old(once, last.number)),
        _ => {}
    }
    let Some(record) = record(memory, &ns.database, &once.session)? else { return Ok(()) };
    match record.get_i64("number").unwrap_or_default() {
        number if number > once.number => Err(too_old(once, number)),
        number if number == once.number => statements.recall(&done(memory, &ns.database, once, &record)?),
        _ => Ok(()),
    }
}

fn record(memory: &Memory, database: &str, session: &SessionId) -> Result<Option<Document>, Failure> {
    kept(memory, database, session.to_bson())
}

/// What the statements of a write did, as its record or its parts have it.
fn done(memory: &Memory, database: &str, once: &Once, record: &Document) -> Result<Vec<Bson>, Failure> {
    let Ok(parts) = record.get_i32("parts") else {
        return Ok(record.get_array("done").cloned().unwrap_or_default());
    };
    let damaged = || Failure::new(codes::INTERNAL, format!("what was kept of a write of {} is damaged", once.session));
    let mut bytes = Vec::new();
    for part in 0..parts {
        let part = kept(memory, database, part_id(once, part))?.ok_or_else(damaged)?;
        if part.get_i64("number").ok() != Some(once.number) {
            return Err(damaged());
        }
        bytes.extend_from_slice(part.get_binary_generic("bytes").map_err(|_| damaged())?);
    }
    let mut whole: Document = bson::deserialize_from_slice(&bytes)?;
    match whole.remove("done") {
        Some(Bson::Array(done)) => Ok(done),
        _ => Err(damaged()),
    }
}

fn part_id(once: &Once, part: i32) -> Bson {
    doc! { "session": once.session.to_bson(), "part": part }.into()
}

fn kept(memory: &Memory, database: &str, id: Bson) -> Result<Option<Document>, Failure> {
    let records = records(memory, database);
    let find = Find { filter: doc! { "_id": { "$eq": id } }, ..Find::default() };
    let found = memory.bare(&records)?.find(&records, &find)?.next().transpose()?;
    Ok(found.map(|raw| Document::try_from(&*raw)).transpose()?)
}

/// The failure of a write whose session has done a later one.
pub(super) fn too_old(once: &Once, last: i64) -> Failure {
    let message = format!(
        "Retryable write with txnNumber {} is prohibited on session {} because a newer retryable write with txnNumber {last} has already started on this session.",
        once.number, once.session
    );
    Failure::new(codes::TRANSACTION_TOO_OLD, message)
}

/// Keeps what the statements of a write did. In the write only.
pub(super) fn keep(memory: &Memory, ns: &Namespace, write: &Repeatable) -> Result<(), Failure> {
    write.statements.to_be_kept().map_or(Ok(()), |done| put(memory, &ns.database, &write.once, done))
}

/// Keeps that a transaction was committed. In the transaction only.
pub(super) fn keep_committed(memory: &Memory, once: &Once) -> Result<(), Failure> {
    put(memory, OF_FILES, once, Vec::new())
}

fn put(memory: &Memory, database: &str, once: &Once, done: Vec<Document>) -> Result<(), Failure> {
    let records = records(memory, database);
    memory.bare(&records)?.put(&records, documents(once, done)?, None)?;
    Ok(())
}

/// The record of a write, with its parts where it has any.
fn documents(once: &Once, done: Vec<Document>) -> Result<Vec<Document>, Failure> {
    let of = |id: Bson| doc! { "_id": id, "number": once.number, "at": DateTime::now() };
    let mut record = of(once.session.to_bson());
    let whole = doc! { "done": done };
    let bytes = bson::serialize_to_vec(&whole)?;
    if bytes.len() <= LARGEST_PART {
        record.extend(whole);
        return Ok(vec![record]);
    }
    let mut documents = Vec::new();
    for (part, bytes) in (0..).zip(bytes.chunks(LARGEST_PART)) {
        let mut document = of(part_id(once, part));
        document.insert("bytes", Binary { subtype: BinarySubtype::Generic, bytes: bytes.to_vec() });
        documents.push(document);
    }
    record.insert("parts", i32::try_from(documents.len()).unwrap_or(i32::MAX));
    documents.push(record);
    Ok(documents)
}

/// What a session did last, as far as is kept.
pub(super) fn last(memory: &Memory, session: &SessionId) -> Result<Option<Finished>, Failure> {
    let Some(record) = record(memory, OF_FILES, session)? else { return Ok(None) };
    let is_transaction = record.get_array("done").is_ok_and(Vec::is_empty);
    let how = if is_transaction { How::Committed } else { How::Write };
    Ok(record.get_i64("number").ok().map(|number| Finished { number, how, at: Instant::now() }))
}

/// Removes what was kept before a time.
pub(super) fn sweep(memory: &Memory, before: DateTime) -> Result<(), StoreError> {
    for records in memory.collections_in_files()?.into_iter().filter(|ns| ns.collection == RECORDS) {
        memory.bare(&records)?.delete(&records, (&doc! { "at": { "$lt": before } }).into(), false)?;
    }
    Ok(())
}
