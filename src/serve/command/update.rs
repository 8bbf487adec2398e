//! `update`

use bson::{Bson, Document, doc};

use super::definition::Command;
use super::write::{COMMON, Outcome, changes, check_repeatable, is_ordered};
use crate::memory::Memory;
use crate::query::Pipeline;
use crate::serve::call::Call;
use crate::serve::effect::Effect;
use crate::serve::failure::{Answer, Failure, codes};
use crate::serve::fields::Fields;
use crate::store::{Modifiers, Namespace, UpdateRequest, UpdateSpec, Updated};

/// What is said of a pipeline with a stage that there is not in any.
const NO_STAGE: [i32; 2] = [codes::UNKNOWN_STAGE, codes::MALFORMED_STAGE];

pub(super) const COMMANDS: &[Command] = &[Command::write("update", update).transactional()];

fn update(memory: &Memory, call: &Call) -> Answer {
    let (ns, fields) = (call.request.namespace()?, call.request.fields());
    fields.known(&[&COMMON[..], &["updates", "let"]].concat())?;
    let variables = fields.document_or_empty("let")?;
    let ordered = is_ordered(call)?;
    let (mut outcome, mut modified, mut upserted, mut unknown) = (Outcome::default(), 0, Vec::new(), None);
    let statements = changes(call, ("updates", "update.updates"))?;
    // A malformed one fails the command before anything is done.
    statements.iter().try_for_each(|statement| {
        check_kind(*statement, "u")?;
        ["multi", "upsert", "upsertSupplied"].iter().try_for_each(|name| statement.boolean(name).map(drop))
    })?;
    for (index, statement) in statements.into_iter().enumerate() {
        let updated = match outcome.repeated(call, index) {
            Some(effect) => Ok(effect.updated()?),
            None => update_one(memory, call, &ns, statement, &variables),
        };
        match updated {
            Ok(updated) => {
                Effect::of(&updated).iter().for_each(|effect| call.statements.note(index..index + 1, effect));
                outcome.n += updated.matched + u64::from(updated.upserted.is_some());
                modified += updated.modified;
                let place = i32::try_from(index).unwrap_or(i32::MAX);
                upserted.extend(updated.upserted.map(|id| doc! { "index": place, "_id": id }));
            }
            // Then the whole command is.
            Err(failure) if failure.is_malformed => return Err(failure),
            // The command fails with it, and what the others do stays.
            Err(failure) if NO_STAGE.contains(&failure.code) => {
                unknown.get_or_insert(failure);
                if ordered {
                    break;
                }
            }
            Err(failure) => {
                if !outcome.fail(index, failure, ordered)? {
                    break;
                }
            }
        }
    }
    if let Some(failure) = unknown {
        return Err(failure.after_the_rest());
    }
    let mut reply = Document::new();
    if !upserted.is_empty() {
        reply.insert("upserted", upserted);
    }
    reply.insert("nModified", i32::try_from(modified).unwrap_or(i32::MAX));
    outcome.reply(reply)
}

fn update_one(
    memory: &Memory,
    call: &Call,
    ns: &Namespace,
    fields: Fields<'_>,
    variables: &Document,
) -> Result<Updated, Failure> {
    let taken = ["q", "u", "c", "arrayFilters", "multi", "upsert", "hint", "collation"];
    fields.known_inside(&[&taken[..], &["upsertSupplied"]].concat())?;
    let is_said = |name| Ok::<_, Failure>(fields.boolean(name)?.unwrap_or(false));
    if is_said("upsertSupplied")? && !is_said("upsert")? {
        let message = "cannot specify 'upsertSupplied: true' for a non-upsert operation";
        return Err(Failure::new(codes::FAILED_TO_PARSE, message));
    }
    fields.refuse(&["upsertSupplied"])?;
    let many = fields.boolean("multi")?.unwrap_or(false);
    check_repeatable(call, many, "multi=true")?;
    let modifiers = Modifiers { variables: variables.clone(), ..fields.modifiers()? };
    let mut request = UpdateRequest {
        filter: fields.document("q")?.cloned().ok_or_else(|| fields.missing("q"))?,
        update: spec(fields, "u")?.ok_or_else(|| fields.missing("u"))?,
        array_filters: array_filters(fields)?,
        many,
        upsert: fields.boolean("upsert")?.unwrap_or(false),
        modifiers,
    };
    request.modifiers.variables.extend(constants(fields)?);
    Ok(call.access(memory).update(ns, &request)?)
}

/// The variables of one statement (`c`): they are values, and no expressions.
fn constants(fields: Fields<'_>) -> Result<Document, Failure> {
    let literal = |(name, value): (String, Bson)| (name, Bson::Document(doc! { "$literal": value }));
    let constants = fields.document_or_empty("c")?;
    if !constants.is_empty() && !matches!(fields.document.get("u"), Some(Bson::Array(_))) {
        let message = "Constant values may only be specified for pipeline updates";
        return Err(Failure::new(51_198, message));
    }
    Ok(constants.into_iter().map(literal).collect())
}

/// How documents are to be changed.
pub(super) fn spec(fields: Fields<'_>, name: &str) -> Result<Option<UpdateSpec>, Failure> {
    match fields.document.get(name) {
        None => Ok(None),
        Some(Bson::Document(update)) => Ok(Some(UpdateSpec::Document(update.clone()))),
        Some(Bson::Array(_)) => {
            let stages = fields.documents(name)?.unwrap_or_default();
            let stages: Vec<Document> = stages.into_iter().cloned().collect();
            stages.iter().try_for_each(check_stage)?;
            Ok(Some(UpdateSpec::Pipeline(stages)))
        }
        Some(_) => check_kind(fields, name).map(|()| None),
    }
}

/// Refuses what cannot say how documents are to be changed.
fn check_kind(fields: Fields<'_>, name: &str) -> Result<(), Failure> {
    match fields.document.get(name) {
        None | Some(Bson::Document(_)) => Ok(()),
        Some(Bson::Array(stages)) if stages.iter().all(|stage| stage.as_document().is_some()) => Ok(()),
        Some(Bson::Array(_)) => {
            let message = "Each element of the 'pipeline' array must be an object".to_owned();
            Err(Failure::malformed(codes::TYPE_MISMATCH, message))
        }
        Some(_) => {
            let message = "Update argument must be either an object or an array".to_owned();
            Err(Failure::malformed(codes::FAILED_TO_PARSE, message))
        }
    }
}

/// Refuses a stage that there is not in any pipeline.
fn check_stage(stage: &Document) -> Result<(), Failure> {
    match Pipeline::parse(std::slice::from_ref(stage)) {
        Err(error) if NO_STAGE.contains(&error.code) => Err(error.into()),
        _ => Ok(()),
    }
}

pub(super) fn array_filters(fields: Fields<'_>) -> Result<Vec<Document>, Failure> {
    Ok(fields.documents("arrayFilters")?.unwrap_or_default().into_iter().cloned().collect())
}
