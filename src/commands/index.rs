//! `rmem index NS [KEYS]`: make, remove or list indexes.

use std::time::Duration;

use super::query::{argument, blame};
use super::{Context, UsageError};
use crate::cli;
use crate::exit::Exit;
use crate::memory::Memory;
use crate::store::{Index, Namespace};

pub(super) fn run(args: &cli::Index, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let wanted = args.keys.as_deref().map(|text| index(args, text)).transpose()?;
    let memory = context.memory()?;
    match (wanted, args.drop) {
        (wanted, true) => remove(args, wanted, &memory, context),
        (None, false) if args.unique || args.sparse || args.ttl.is_some() || args.name.is_some() => {
            Err(UsageError::new("an index needs keys; expected KEYS, like '{name: 1}'").into())
        }
        (None, false) => {
            let indexes = memory.indexes(&args.namespace)?;
            context.print_documents(indexes.iter().map(|index| Ok(index.definition())))?;
            Ok(Exit::Done)
        }
        (Some(index), false) => {
            let made = memory.create_index(&args.namespace, &index);
            let made = made.map_err(|error| blame(error, &[("<keys>", args.keys.as_deref().unwrap_or_default())]))?;
            if !made {
                context.output.note(&format!("{} has the index {} already", args.namespace, index.name));
            }
            context.output.line(&index.name)?;
            Ok(Exit::Done)
        }
    }
}

/// The index that the arguments describe.
fn index(args: &cli::Index, keys: &str) -> anyhow::Result<Index> {
    let index = Index::on(argument("<keys>", keys)?);
    Ok(Index {
        name: args.name.clone().unwrap_or(index.name),
        unique: args.unique,
        sparse: args.sparse,
        expire_after: args.ttl.map(seconds).transpose()?,
        ..index
    })
}

/// MongoDB counts in whole seconds.
fn seconds(ttl: Duration) -> Result<i64, UsageError> {
    match i64::try_from(ttl.as_secs()) {
        Ok(seconds) if ttl.subsec_nanos() == 0 && seconds <= i64::from(i32::MAX) => Ok(seconds),
        _ => Err(UsageError::new("--ttl takes whole seconds, at most 2147483647 of them")),
    }
}

fn remove(
    args: &cli::Index,
    wanted: Option<Index>,
    memory: &Memory,
    context: &mut Context<'_>,
) -> anyhow::Result<Exit> {
    let name = match (&args.name, wanted) {
        (Some(name), _) => name.clone(),
        (None, Some(wanted)) => named(memory, &args.namespace, wanted)?,
        (None, None) => {
            return Err(UsageError::new("which index is to be dropped? expected KEYS, like '{name: 1}', or --name NAME, as `rmem index NS` lists them").into());
        }
    };
    if !memory.drop_index(&args.namespace, &name)? {
        context.output.warn(&format!("{} has no index {name}", args.namespace));
    }
    Ok(Exit::Done)
}

/// What the index with these keys is called.
fn named(memory: &Memory, ns: &Namespace, wanted: Index) -> anyhow::Result<String> {
    let with_keys = |index: &Index| index.has_keys(&wanted.keys);
    let found: Vec<String> = memory.indexes(ns)?.into_iter().filter(with_keys).map(|index| index.name).collect();
    match found.as_slice() {
        [] => Ok(wanted.name),
        [name] => Ok(name.clone()),
        names => {
            let text = format!("{} indexes have these keys: {}; expected --name", names.len(), names.join(", "));
            Err(UsageError::new(text).into())
        }
    }
}
