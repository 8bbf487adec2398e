//! Writes on a MongoDB server, confirmed as their client says (`writeConcern`).

use bson::raw::cstr;
use bson::{Document, RawDocumentBuf, rawbson};

use super::code;
use super::failure::{Answer, RETRYABLE};
use super::request::Request;
use crate::memory::Memory;
use crate::store::Namespace;

/// MongoDB's codes of failures that pass, behind which a driver sends a write with a number again.
const PASSING: [i32; 12] = [6, 7, 89, 91, 189, 262, 9001, 10_107, 11_600, 11_602, 13_435, 13_436];

/// Writes, and waits until the members that the client names have it. Where they do not, the answer says so.
pub(super) fn confirmed(
    memory: &Memory,
    ns: &Namespace,
    request: &Request,
    work: impl FnOnce(&Memory) -> Answer,
) -> Answer {
    if memory.is_current(ns)? {
        return work(memory);
    }
    let concern = request.write_concern.clone();
    let (mut work, mut answer) = (Some(work), None);
    let unconfirmed = memory.bare(ns)?.confirmed(ns, concern.as_ref(), &mut || {
        answer = work.take().map(|work| work(memory));
        matches!(answer, Some(Ok(_)))
    })?;
    let mut reply = answer.unwrap_or_else(|| Ok(RawDocumentBuf::new()))?;
    if let Some(error) = unconfirmed {
        let is_passing = error.get_i32("code").is_ok_and(|code| PASSING.contains(&code));
        reply.append(cstr!("writeConcernError"), RawDocumentBuf::try_from(&named(error))?);
        if is_passing && request.transaction.is_some() {
            reply.append(cstr!("errorLabels"), rawbson!([RETRYABLE]));
        }
    }
    Ok(reply)
}

/// The error with the name of its code.
fn named(mut error: Document) -> Document {
    if let Ok(number) = error.get_i32("code") {
        error.entry("codeName").or_insert_with(|| code::name(number).into());
    }
    error
}
