//! `rmem import-problem PROBLEM --into NS`: a PDDL problem as documents, and a template for them.

use bson::{Document, doc};

use super::gen_problem::read_domain;
use super::{Context, WrongInput};
use crate::cli::ImportProblem;
use crate::exit::Exit;
use crate::formats::Diagnostics;
use crate::formats::pddl::{Dialect, read_problem};
use crate::memory::Memory;
use crate::pddl::Problem;
use crate::problem::import::{RELATIONS, import};

/// How many documents are stored at once.
const BATCH: usize = 10_000;

pub(super) fn run(args: &ImportProblem, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let dialect = Dialect { lenient: args.lenient };
    let domain = args.domain.as_deref().map(|path| read_domain(path, args.lenient, context)).transpose()?;
    let source = context.read(&args.problem)?;
    let tree = match domain {
        Some(domain) => Problem::read(&source, &domain, dialect).map_err(Diagnostics)?.tree().clone(),
        None => read_problem(&source, dialect)?,
    };
    let imported = import(&source, tree)?;
    let memory = context.memory_to_fill()?;
    make_room(args, &memory)?;
    let count = imported.documents.len();
    for batch in imported.documents.chunks(BATCH) {
        memory.insert(&args.into, batch.to_vec())?;
    }
    context.output.note(&format!("{count} stored in {}", args.into));
    if let Some(path) = &args.template {
        context.output.write_file(path, imported.template(&args.into).as_bytes())?;
    }
    Ok(Exit::Done)
}

/// Two problems in one collection would be neither.
fn make_room(args: &ImportProblem, memory: &Memory) -> anyhow::Result<()> {
    let ours: Document = doc! { "relation": { "$in": RELATIONS.to_vec() } };
    if args.replace {
        memory.delete(&args.into, &ours, false)?;
        return Ok(());
    }
    match memory.count(&args.into, &ours)? {
        0 => Ok(()),
        count => {
            let message = format!(
                "{} has {count} documents of an imported problem; expected another collection, or --replace",
                args.into
            );
            Err(WrongInput::new(message).into())
        }
    }
}
