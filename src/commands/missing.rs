//! The message about a collection that does not exist.

use super::{Context, WrongInput};
use crate::formats::{mongosh, nearest};
use crate::memory::Memory;
use crate::store::Namespace;

/// Refuses a collection that does not exist, for `--strict`.
pub(super) fn refuse(namespace: &Namespace, memory: &Memory, context: &Context<'_>) -> Result<(), WrongInput> {
    match message(namespace, memory, context) {
        Some(message) => Err(WrongInput::new(message)),
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
pub(super) fn message(namespace: &Namespace, memory: &Memory, context: &Context<'_>) -> Option<String> {
    // A hint is not worth an error.
    if memory.computables().ok()?.0.iter().any(|computable| computable.definition.namespace == *namespace) {
        return None;
    }
    let names = memory.collections_beside(namespace).ok()?;
    let names: Vec<String> = names.iter().map(ToString::to_string).collect();
    let name = namespace.to_string();
    if names.contains(&name) {
        return None;
    }
    if let Some(command) = mongosh::command(&name, &context.settings.collection.value.database) {
        return Some(format!("no collection {name}; write: {command}"));
    }
    let known = || names.iter().map(String::as_str);
    let elsewhere = || known().find(|known| known.ends_with(&format!(".{}", namespace.collection)));
    let hint = match nearest(&name, known()).or_else(elsewhere) {
        Some(nearest) => format!("did you mean {nearest}?"),
        None if names.is_empty() => "the memory is empty".to_owned(),
        None => "`rmem collections` lists those there are".to_owned(),
    };
    Some(format!("no collection {name}; {hint}"))
}
