//! What the commands that write have in common: several statements, each of which may fail.

use bson::{Bson, Document, RawDocumentBuf, doc};

use super::handshake::MAX_BATCH;
use crate::query::QueryError;
use crate::serve::call::Call;
use crate::serve::effect::Effect;
use crate::serve::failure::{Answer, Failure, codes};
use crate::serve::fields::{Fields, number};

/// So many bytes at most say in one answer why documents do not pass the validator of their collection.
const MAX_EXPLAINED: usize = 16 << 20;

/// So many bytes of messages at most say in one answer what is wrong with statements, as with MongoDB; …
const MAX_MESSAGES: usize = 1 << 20;
/// … and so many bytes of keys, which were taken: an answer has room for 48 MB.
const MAX_KEYS: usize = 16 << 20;

/// What came of the statements of a command.
#[derive(Default)]
pub(super) struct Outcome {
    pub(super) n: u64,
    errors: Vec<Document>,
    /// How many bytes say why documents do not pass the validator of their collection.
    explained: usize,
    /// How many bytes of messages and of keys there are.
    described: (usize, usize),
    /// The numbers of statements that were done when they were sent before.
    retried: Vec<Bson>,
}

impl Outcome {
    /// What a statement did, where it was done when it was sent before.
    pub(super) fn repeated(&mut self, call: &Call, place: usize) -> Option<Effect> {
        let (statement, effect) = call.statements.repeated(place)?;
        self.retried.push(number(statement));
        Some(effect)
    }

    /// Notes that a statement failed; says whether those behind it are to be done.
    ///
    /// # Errors
    /// Where a server is not reached before anything was done, or the command is to end: it has failed as a whole then.
    pub(super) fn fail(&mut self, index: usize, failure: Failure, is_ordered: bool) -> Result<bool, Failure> {
        let is_unreachable = failure.code == codes::UNREACHABLE;
        if is_unreachable && self.n == 0 && self.errors.is_empty() {
            return Err(failure);
        }
        if QueryError::is_interruption(failure.code) {
            return Err(if self.n == 0 { failure } else { failure.after_the_rest() });
        }
        let mut error = failure.write_error(index);
        if let Ok(info) = error.get_document_mut("errInfo") {
            self.explained += RawDocumentBuf::try_from(&*info).map_or(0, |raw| raw.as_bytes().len());
            if self.explained > MAX_EXPLAINED {
                info.remove("details");
                info.insert("note", "detailed error was too large");
            }
        }
        self.shorten(&mut error);
        self.errors.push(error);
        Ok(!is_ordered && !is_unreachable)
    }

    /// Leaves out of an error what would be too much with the others.
    fn shorten(&mut self, error: &mut Document) {
        let (messages, keys) = &mut self.described;
        *messages += error.get_str("errmsg").map_or(0, str::len);
        if *messages > MAX_MESSAGES {
            error.insert("errmsg", "");
        }
        *keys += error.get_document("keyValue").map_or(0, |key| bson::serialize_to_vec(key).map_or(0, |key| key.len()));
        if *keys > MAX_KEYS {
            error.remove("keyValue");
        }
    }

    /// The answer, with what belongs to it.
    pub(super) fn reply(self, more: Document) -> Answer {
        let mut reply = doc! { "n": i32::try_from(self.n).unwrap_or(i32::MAX) };
        if !self.errors.is_empty() {
            reply.insert("writeErrors", self.errors);
        }
        if !self.retried.is_empty() {
            reply.insert("retriedStmtIds", self.retried);
        }
        reply.extend(more);
        Ok(RawDocumentBuf::try_from(&reply)?)
    }
}

/// Whether a statement that fails keeps those behind it from being done; in a transaction it does so always.
pub(super) fn is_ordered(call: &Call) -> Result<bool, Failure> {
    let asked = call.request.fields().boolean("ordered")?.unwrap_or(true);
    Ok(asked || call.request.is_in_transaction())
}

/// The statements of a command, of which there has to be one at least.
pub(super) fn statements<'a>(fields: Fields<'a>, name: &str) -> Result<Vec<&'a Document>, Failure> {
    let statements = fields.documents(name)?.ok_or_else(|| fields.missing(name))?;
    match statements.len() {
        1..=MAX_BATCH => Ok(statements),
        count => {
            let message = format!("Write batch sizes must be between 1 and {MAX_BATCH}. Got {count} operations.");
            Err(Failure::new(codes::INVALID_LENGTH, message))
        }
    }
}

/// The statements of an update or of a removal.
pub(super) fn changes<'a>(call: &'a Call, (name, context): (&str, &'static str)) -> Result<Vec<Fields<'a>>, Failure> {
    let statements = statements(call.request.fields(), name)?;
    Ok(statements.into_iter().map(|one| Fields::new(context, one)).collect())
}

/// Refuses a write of many documents that the client may repeat: only one of one document is known again.
pub(super) fn check_repeatable(call: &Call, is_many: bool, option: &str) -> Result<(), Failure> {
    match call.request.transaction {
        Some(part) if is_many && !part.is_multi => {
            let message = format!("Cannot use (or request) retryable writes with {option}");
            Err(Failure::new(codes::INVALID_OPTIONS, message))
        }
        _ => Ok(()),
    }
}

/// Fields that say how a write is made, and that every one may have.
pub(super) const COMMON: [&str; 5] = ["ordered", "bypassDocumentValidation", "stmtId", "stmtIds", "runtimeConstants"];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_server_that_is_not_reached_fails_the_command_where_nothing_was_done() {
        let unreachable = || Failure::new(codes::UNREACHABLE, "gone");
        assert!(Outcome::default().fail(0, unreachable(), false).is_err());
        let mut some = Outcome { n: 1, ..Outcome::default() };
        assert_eq!(some.fail(1, unreachable(), false), Ok(false));
        assert_eq!(some.fail(2, Failure::new(codes::DUPLICATE, "taken"), false), Ok(true));
    }

    #[test]
    fn many_errors_fit_into_an_answer() {
        let mut outcome = Outcome::default();
        let id = "x".repeat(900);
        for index in 0..50_000 {
            let mut taken = Failure::new(codes::DUPLICATE, format!("{id} is taken"));
            taken.details.insert("keyValue", doc! { "_id": &id });
            assert_eq!(outcome.fail(index, taken, false), Ok(true));
        }
        let reply = outcome.reply(doc! {}).unwrap();
        assert!(reply.as_bytes().len() < 24 << 20, "{}", reply.as_bytes().len());
        let errors = reply.get_array("writeErrors").unwrap();
        assert_eq!(errors.into_iter().count(), 50_000);
    }
}
