//! `rmem import-problem PROBLEM --into NS`: a PDDL problem as documents, and a template for them.

use std::path::PathBuf;

use bson::{Document, doc};
use clap::Args;

use super::template::read_domain;
use super::{Context, WrongInput, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::Diagnostics;
use crate::formats::pddl::{Dialect, read_problem};
use crate::memory::Memory;
use crate::pddl::Problem;
use crate::problem::import::{RELATIONS, import};
use crate::saturate::to_i64;
use crate::store::Namespace;

/// How many documents are stored in one transaction.
const BATCH: usize = 10_000;

/// What stands below the help of `import-problem`.
const HELP: &str = "\
Examples:
  rmem import-problem problem.pddl --into robmem.worldmodel
  rmem import-problem problem.pddl --into robmem.worldmodel --template problem.pddl.j2
  rmem gen-problem --template problem.pddl.j2

Objects, initial state, goal and metric become documents: {relation: 'domain-object', name, type},
{relation: 'domain-fact', name, param_values}, 'domain-function' with a value, 'domain-timed-fact'
with a time, 'domain-goal' with a condition, and 'domain-metric' with an expression. The template
generates an equal problem from them, or one with the goal of --goal. A collection that has such
documents already is refused; --replace replaces them.";

/// Turn a PDDL problem into documents and a template
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::TEXT))]
pub struct ImportProblemArgs {
    /// The problem; - is stdin
    #[arg(value_name = "PROBLEM")]
    pub problem: PathBuf,
    /// Collection to store into
    #[arg(long, value_name = "NS")]
    pub into: Namespace,
    /// Check the problem against this domain first
    #[arg(short, long, value_name = "FILE")]
    pub domain: Option<PathBuf>,
    /// Write a template that generates an equal problem from the documents
    #[arg(short, long, value_name = "FILE")]
    pub template: Option<PathBuf>,
    /// Remove what an earlier import stored there
    #[arg(long)]
    pub replace: bool,
    /// Take `//` to the end of a line as a comment
    #[arg(long)]
    pub lenient: bool,
}

pub(super) fn run(args: &ImportProblemArgs, context: &mut Context<'_>) -> Result<Exit> {
    context.format(&formats::TEXT)?;
    let dialect = Dialect { lenient: args.lenient };
    let domain = args.domain.as_deref().map(|path| read_domain(path, args.lenient, context)).transpose()?;
    let source = context.read_pddl(&args.problem)?;
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
    let template = args.template.as_ref().map(|path| path.display().to_string());
    let stored = to_i64(count);
    context.print_report([], doc! { "ns": args.into.to_string(), "stored": stored, "template": template })?;
    if let Some(path) = &args.template {
        context.output.write_file(path, imported.template(&args.into).as_bytes())?;
    }
    Ok(Exit::Done)
}

/// Removes an earlier import, or refuses: two problems in one collection cannot be distinguished.
fn make_room(args: &ImportProblemArgs, memory: &Memory) -> Result<()> {
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
