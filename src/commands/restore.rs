//! `rmem restore PATH`: a dump into the memory.

use std::path::Path;

use bson::{Document, doc};

use super::{Context, UsageError};
use crate::cli::Restore;
use crate::exit::Exit;
use crate::memory::dump::read::Dump;
use crate::memory::dump::restore::{RestoreError, RestoreOptions, Restored, restore};

pub(super) fn run(args: &Restore, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let mut dump = match args.path == Path::new("-") {
        true => Dump::world(&context.read(&args.path)?)?,
        false => Dump::open(&args.path)?,
    };
    if let Some(namespace) = &args.into {
        dump = dump.into(namespace).map_err(|found| {
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
    let guard = (args.drop && !args.dry_run).then(crate::InterruptGuard::new);
    let stop = guard.as_ref().map(crate::InterruptGuard::interrupted);
    let temporary = context.temporary();
    let options = RestoreOptions { drop: args.drop, dry_run: args.dry_run, temporary: Some(&temporary), stop };
    let restored = match restore(&memory, &dump, options) {
        Err(interrupted @ RestoreError::Interrupted) => {
            context.output.error(&interrupted.to_string());
            return Ok(Exit::Interrupted);
        }
        restored => restored?,
    };
    for note in &dump.notes {
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
