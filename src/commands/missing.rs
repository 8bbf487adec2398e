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
    let found = find(namespace, memory, context).ok().flatten().filter(|found| found.has_nearest);
    found.iter().for_each(|found| context.output.warn(&found.message));
    found.is_some()
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
    Ok(find(namespace, memory, context)?.map(|found| found.message))
}

/// A collection that does not exist.
struct Missing {
    message: String,
    /// Whether the message names one of a similar name.
    has_nearest: bool,
}

fn find(namespace: &Namespace, memory: &Memory, context: &Context<'_>) -> Result<Option<Missing>, StoreError> {
    if memory.is_computed(namespace)? {
        return Ok(None);
    }
    let names = memory.collections_beside(namespace)?;
    let names: Vec<String> = names.iter().map(ToString::to_string).collect();
    let name = namespace.to_string();
    if names.contains(&name) {
        return Ok(None);
    }
    if let Some(command) = mongosh::command(&name, &context.settings.collection.value.database) {
        let message = format!("no collection {name}; write: {command}");
        return Ok(Some(Missing { message, has_nearest: false }));
    }
    let known = || names.iter().map(String::as_str);
    let elsewhere = || known().find(|known| known.ends_with(&format!(".{}", namespace.collection)));
    let nearest = nearest(&name, known()).or_else(elsewhere);
    let hint = match nearest {
        Some(nearest) => format!("did you mean {nearest}?"),
        None if names.is_empty() => "the memory is empty".to_owned(),
        None => "`rmem collections` lists those there are".to_owned(),
    };
    Ok(Some(Missing { message: format!("no collection {name}; {hint}"), has_nearest: nearest.is_some() }))
}
