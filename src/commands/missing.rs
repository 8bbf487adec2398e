//! The message about a collection that does not exist.

use super::{Context, WrongInput};
use crate::error::Result;
use crate::formats::nearest;
use crate::memory::Memory;
use crate::store::Namespace;

/// Refuses a collection that does not exist, for `--strict`.
pub(super) fn refuse(namespace: &Namespace, memory: &Memory) -> Result<()> {
    match message(namespace, memory)? {
        Some(message) => Err(WrongInput::new(message).into()),
        None => Ok(()),
    }
}

/// Warns, after an empty result, if the collection does not exist.
pub(super) fn warn(namespace: &Namespace, memory: &Memory, context: &mut Context<'_>) -> Result<()> {
    if let Some(message) = message(namespace, memory)? {
        context.output.warn(&message);
    }
    Ok(())
}

/// `no collection robmem.worldmodl; did you mean robmem.worldmodel?`
fn message(namespace: &Namespace, memory: &Memory) -> Result<Option<String>> {
    // A hint is not worth an error: another store may be unreachable.
    let Ok(names) = memory.collections() else { return Ok(None) };
    let names: Vec<String> = names.iter().map(ToString::to_string).collect();
    let name = namespace.to_string();
    let is_computed = memory.computables().any(|computable| computable.definition.namespace == *namespace);
    if is_computed || names.contains(&name) {
        return Ok(None);
    }
    let hint = match nearest(&name, names.iter().map(String::as_str)) {
        Some(nearest) => format!("did you mean {nearest}?"),
        None if names.is_empty() => "the memory is empty".to_owned(),
        None => "`rmem collections` lists those there are".to_owned(),
    };
    Ok(Some(format!("no collection {name}; {hint}")))
}
