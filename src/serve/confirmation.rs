//! Writes on a MongoDB server, confirmed as their client says (`writeConcern`).

use bson::raw::cstr;
use bson::{Document, RawDocumentBuf};

use super::code;
use super::failure::Answer;
use super::request::Request;
use crate::memory::Memory;
use crate::store::Namespace;

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
        reply.append(cstr!("writeConcernError"), RawDocumentBuf::try_from(&named(error))?);
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
