//! `rmem gen-problem --template T`: a PDDL problem from a template whose sections are queries.

use std::path::PathBuf;

use clap::Args;

use super::at::AtArgs;
use super::template::{TemplateArgs, read_domain, report, request};
use super::{Context, explanation};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::{Diagnostics, pddl::Dialect};
use crate::problem;

/// Generate a PDDL problem from a template with queries
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  rmem gen-problem --template problem.pddl.j2 --domain domain.pddl --goal '(on A B)' -o problem.pddl\n  rmem gen-problem --template problem.pddl.j2 --explain '(on A B)'\n\n\
--explain names the line of the template, the query and the document behind each place where the\n\
problem contains the atom; if there is none, the lines that could write it and their queries, and exits with 1."
)]
pub struct GenProblemArgs {
    /// The template; - is stdin
    #[arg(short, long, value_name = "FILE")]
    pub template: PathBuf,
    /// Check the problem against this domain
    #[arg(short, long, value_name = "FILE")]
    pub domain: Option<PathBuf>,
    /// The template's arguments.
    #[command(flatten)]
    pub options: TemplateArgs,
    /// The memory as it was.
    #[command(flatten)]
    pub past: AtArgs,
    /// File to write the problem to; - is stdout
    #[arg(short, long, value_name = "FILE", default_value = "-")]
    pub output: PathBuf,
    /// Print where an atom like '(on A B)', a number, or an object comes from, instead of the problem
    #[arg(long, value_name = "ATOM", conflicts_with = "output")]
    pub explain: Option<String>,
}

pub(super) fn run(args: &GenProblemArgs, context: &mut Context<'_>) -> Result<Exit> {
    let domain = args.domain.as_deref().map(|path| read_domain(path, args.options.lenient, context)).transpose()?;
    let template = context.read(&args.template)?;
    let memory = args.past.memory(context)?;
    let request = request(template, &args.options, context)?;
    let generated = problem::generate(&request, &memory)?;
    report(&generated, args.options.strict, &memory, context)?;
    if let Some(domain) = &domain {
        generated.check(domain, Dialect { lenient: args.options.lenient }).map_err(Diagnostics)?;
    }
    if let Some(atom) = &args.explain {
        return explanation::print(atom, &generated, Dialect { lenient: args.options.lenient }, &memory, context);
    }
    context.output.write_file(&args.output, generated.text.as_bytes())?;
    Ok(Exit::Done)
}
