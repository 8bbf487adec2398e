//! `rmem restore PATH`: a dump into the memory.

use std::path::Path;

use bson::{Document, doc};

use super::{Context, UsageError};
use crate::cli::Restore;
use crate::exit::Exit;
use crate::memory::dumped::Dumped;
use crate::memory::restore::{Manner, RestoreError, Restored, restore};

pub(super) fn run(args: &Restore, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let mut dumped = match args.path == Path::new("-") {
        true => Dumped::world(&context.read(&args.path)?)?,
        false => Dumped::open(&args.path)?,
    };
    if let Some(namespace) = &args.into {
        dumped = dumped.into(namespace).map_err(|found| {
            let found: Vec<String> = found.iter().map(ToString::to_string).collect();
            UsageError::new(format!(
                "--into takes a dump of one namespace, and {} has {}",
                args.path.display(),
                if found.is_empty() { "none".to_owned() } else { found.join(", ") }
            ))
        })?;
    }
    let memory = context.memory_to_fill()?;
    // What is staged has to be removed again; what is merged stays as far as it got.
    let patience = (args.drop && !args.dry_run).then(crate::Patience::new);
    let stop = patience.as_ref().map(crate::Patience::interrupted);
    let temporary = context.temporary();
    let manner = Manner { drop: args.drop, dry_run: args.dry_run, temporary: Some(&temporary), stop };
    let restored = match restore(&memory, &dumped, manner) {
        Err(interrupted @ RestoreError::Interrupted) => {
            context.output.error(&interrupted.to_string());
            return Ok(Exit::Interrupted);
        }
        restored => restored?,
    };
    for note in &dumped.notes {
        context.output.warn(note);
    }
    for restored in &restored {
        for index in &restored.without {
            context.output.warn(&format!("{}: {index}", restored.namespace));
        }
    }
    context.print_documents(restored.iter().map(|restored| Ok(report(restored))))?;
    if args.dry_run {
        context.output.note("nothing was changed: --dry-run");
    }
    Ok(Exit::Done)
}

fn report(restored: &Restored) -> Document {
    let count = |number: u64| i64::try_from(number).unwrap_or(i64::MAX);
    let mut report = doc! {
        "namespace": restored.namespace.to_string(),
        "inserted": count(restored.inserted),
        "replaced": count(restored.replaced),
        "skipped": count(restored.skipped),
    };
    if let Some(dropped) = restored.dropped {
        report.insert("dropped", count(dropped));
    }
    report
}
