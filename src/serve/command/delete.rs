//! `delete`

use bson::{Document, doc};

use super::definition::Command;
use super::write::{COMMON, Outcome, changes, check_repeatable, is_ordered};
use crate::memory::Memory;
use crate::serve::call::Call;
use crate::serve::effect::Effect;
use crate::serve::failure::{Answer, Failure, codes};
use crate::serve::fields::Fields;
use crate::store::{Modifiers, Namespace, Query};

pub(super) const COMMANDS: &[Command] = &[Command::write("delete", delete).transactional()];

fn delete(memory: &Memory, call: &Call) -> Answer {
    let (ns, fields) = (call.request.namespace()?, call.request.fields());
    fields.known(&[&COMMON[..], &["deletes", "let"]].concat())?;
    let variables = fields.document_or_empty("let")?;
    let (ordered, mut outcome) = (is_ordered(call)?, Outcome::default());
    let statements = changes(call, ("deletes", "delete.deletes"))?;
    // A malformed one fails the command before anything is done.
    statements.iter().try_for_each(|statement| is_of_one(*statement).map(drop))?;
    for (index, statement) in statements.into_iter().enumerate() {
        if outcome.repeated(call, index).is_some() {
            outcome.n += 1;
            continue;
        }
        match delete_one(memory, call, &ns, statement, &variables) {
            Ok(0) => {}
            Ok(count) => {
                outcome.n += count;
                call.statements.note(index..index + 1, &Effect::Deleted);
            }
            Err(failure) if failure.is_malformed => return Err(failure),
            Err(failure) => {
                if !outcome.fail(index, failure, ordered)? {
                    break;
                }
            }
        }
    }
    outcome.reply(doc! {})
}

fn delete_one(
    memory: &Memory,
    call: &Call,
    ns: &Namespace,
    fields: Fields<'_>,
    variables: &Document,
) -> Result<u64, Failure> {
    fields.known_inside(&["q", "limit", "hint", "collation"])?;
    let modifiers = Modifiers { variables: variables.clone(), ..fields.modifiers()? };
    let filter = fields.document("q")?.ok_or_else(|| fields.missing("q"))?;
    let first_only = is_of_one(fields)?;
    check_repeatable(call, !first_only, "limit=0")?;
    Ok(call.access(memory).delete(ns, Query { filter, modifiers: &modifiers }, first_only)?)
}

/// Whether a statement removes the first document that matches, and not all.
fn is_of_one(fields: Fields<'_>) -> Result<bool, Failure> {
    match fields.whole("limit")? {
        Some(0) => Ok(false),
        Some(1) => Ok(true),
        Some(other) => {
            let message = format!("The limit field in delete objects must be 0 or 1. Got {other}");
            Err(Failure::new(codes::FAILED_TO_PARSE, message))
        }
        None => Err(fields.missing("limit")),
    }
}
