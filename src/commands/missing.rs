//! The message about a collection that does not exist.

use super::{Context, WrongInput};
use crate::error::Result;
use crate::formats::{mongosh, nearest};
use crate::memory::Memory;
use crate::store::{Namespace, StoreError};

/// Refuses a collection that does not exist, for `--strict`.
pub(super) fn refuse(namespace: &Namespace, memory: &Memory, context: &Context<'_>) -> Result<()> {
    match look(namespace, memory, context)? {
        Some(message) => Err(WrongInput::new(message).into()),
        None => Ok(()),
    }
}

/// Warns, after an empty result, if the collection does not exist; returns whether it does not.
pub(super) fn warn(namespace: &Namespace, memory: &Memory, context: &mut Context<'_>) -> bool {
    let message = message(namespace, memory, context);
    message.iter().for_each(|message| context.output.warn(message));
    message.is_some()
}

/// The same where a collection of a similar name exists: another may be there later.
pub(super) fn warn_of_nearest(namespace: &Namespace, memory: &Memory, context: &mut Context<'_>) -> bool {
    let message = message(namespace, memory, context).filter(|message| message.ends_with('?'));
    message.iter().for_each(|message| context.output.warn(message));
    message.is_some()
}

/// `no collection robmem.worldmodl; did you mean robmem.worldmodel?`
///
/// None where the store fails: a hint is not worth an error.
pub(super) fn message(namespace: &Namespace, memory: &Memory, context: &Context<'_>) -> Option<String> {
    look(namespace, memory, context).ok().flatten()
}

/// The same message.
///
/// # Errors
/// Where the store fails.
pub(super) fn look(
    namespace: &Namespace,
    memory: &Memory,
    context: &Context<'_>,
) -> Result<Option<String>, StoreError> {
    if memory.computables()?.0.iter().any(|computable| computable.definition.namespace == *namespace) {
        return Ok(None);
    }
    let names = memory.collections_beside(namespace)?;
    let names: Vec<String> = names.iter().map(ToString::to_string).collect();
    let name = namespace.to_string();
    if names.contains(&name) {
        return Ok(None);
    }
    if let Some(command) = mongosh::command(&name, &context.settings.collection.value.database) {
        return Ok(Some(format!("no collection {name}; write: {command}")));
    }
    let known = || names.iter().map(String::as_str);
    let elsewhere = || known().find(|known| known.ends_with(&format!(".{}", namespace.collection)));
    let hint = match nearest(&name, known()).or_else(elsewhere) {
        Some(nearest) => format!("did you mean {nearest}?"),
        None if names.is_empty() => "the memory is empty".to_owned(),
        None => "`rmem collections` lists those there are".to_owned(),
    };
    Ok(Some(format!("no collection {name}; {hint}")))
}
