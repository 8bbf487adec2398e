//! `findAndModify`

use bson::{Document, doc};

use super::definition::{Command, raw};
use super::update::{array_filters, spec};
use crate::memory::Memory;
use crate::query::QueryError;
use crate::serve::call::Call;
use crate::serve::effect::Effect;
use crate::serve::failure::{Answer, Failure, codes};
use crate::serve::fields::{Fields, number};
use crate::store::{FindAndModify, Modification};

pub(super) const COMMANDS: &[Command] = &[Command::write("findAndModify", modify).transactional()];

const TAKEN: [&str; 14] = [
    "query",
    "sort",
    "remove",
    "update",
    "new",
    "fields",
    "upsert",
    "arrayFilters",
    "hint",
    "collation",
    "let",
    "bypassDocumentValidation",
    "stmtId",
    "runtimeConstants",
];

fn modify(memory: &Memory, call: &Call) -> Answer {
    let (ns, fields) = (call.request.namespace()?, call.request.fields());
    fields.known(&TAKEN)?;
    let request = request(fields)?;
    let removes = matches!(request.modification, Modification::Remove);
    if let Some((statement, effect)) = call.statements.repeated(0) {
        let mut reply = effect.modified(removes)?;
        reply.insert("retriedStmtId", number(statement));
        return raw(&reply);
    }
    let access = call.access(memory);
    let modified = access.find_and_modify(&ns, &request).map_err(|error| {
        let failure = Failure::from(error);
        let is_wrong = || access.find_and_modify(&ns, &of_nothing(&request)).is_err();
        explained(failure, is_wrong)
    })?;
    let value = modified.document.map(|raw| Document::try_from(&*raw)).transpose().map_err(QueryError::from)?;
    let mut last = doc! { "n": i32::from(modified.is_found || modified.upserted.is_some()) };
    if !removes {
        last.insert("updatedExisting", modified.is_found);
    }
    last.extend(modified.upserted.map(|id| ("upserted".to_owned(), id)));
    let reply = doc! { "lastErrorObject": last, "value": value };
    let answer = raw(&reply);
    if modified.is_changed {
        // It is known when the command is sent again.
        let effect = if removes { Effect::Removed(reply) } else { Effect::Modified(reply) };
        call.statements.note(0..1, &effect);
    }
    answer
}

fn request(fields: Fields<'_>) -> Result<FindAndModify, Failure> {
    let (filter, sort) = (fields.document_or_empty("query")?, fields.document_or_empty("sort")?);
    let projection = fields.document_or_empty("fields")?;
    let (update, array_filters) = (spec(fields, "update")?, array_filters(fields)?);
    let (new, upsert, modifiers) = (fields.flag("new")?, fields.flag("upsert")?, fields.modifiers()?);
    let wrong = |message: &str| Err(Failure::new(codes::FAILED_TO_PARSE, message));
    let modification = match (fields.flag("remove")?, update) {
        (true, Some(_)) => return wrong("Cannot specify both an update and remove=true"),
        (false, None) => return wrong("Either an update or remove=true must be specified"),
        (true, None) if upsert => return wrong("Cannot specify both upsert=true and remove=true"),
        (true, None) if new => {
            return wrong("Cannot specify both new=true and remove=true; 'remove' always returns the deleted document");
        }
        (true, None) => Modification::Remove,
        (false, Some(update)) => Modification::Update { update, array_filters, upsert },
    };
    Ok(FindAndModify { filter, sort, modification, new, projection, modifiers })
}

/// The same for no document at all.
fn of_nothing(request: &FindAndModify) -> FindAndModify {
    let filter = doc! { "$and": [request.filter.clone(), { "_id": { "$in": [] } }] };
    let mut nothing = FindAndModify { filter, ..request.clone() };
    if let Modification::Update { upsert, .. } = &mut nothing.modification {
        *upsert = false;
    }
    nothing
}

/// Why it failed, as MongoDB says it: what is wrong whatever the documents are, that refuses before it looks for one.
fn explained(failure: Failure, is_wrong: impl FnOnce() -> bool) -> Failure {
    // A MongoDB server has said so of its query.
    let is_said = failure.message.contains("xecutor error during");
    if failure.is_of_server() || is_said || is_wrong() {
        return failure;
    }
    failure.caused("Plan executor error during findAndModify")
}
