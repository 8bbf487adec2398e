//! `rmem gen-problem --template T`: a PDDL problem from a template whose sections are queries.

use std::path::{Path, PathBuf};

use bson::{Bson, Document, doc};
use clap::Args;

use super::at::AtArgs;
use super::template::{Asked, TemplateArgs, is_template, read_domain, render_domain, report, request, require, warn};
use super::{Context, UsageError, explanation, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::{Diagnostics, pddl::Dialect, shell};
use crate::memory::Memory;
use crate::output::{Format, is_stdout};
use crate::pddl::Domain;
use crate::problem::{self, Request, SectionReport, Streamed};
use crate::saturate::to_i64;
use crate::settings::Origin;

/// Generate a PDDL problem from a template with queries
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  rmem gen-problem --template problem.pddl.j2 --domain domain.pddl --goal '(on A B)' -o problem.pddl\n  rmem gen-problem --template problem.pddl.j2 --explain '(on A B)'\n\n\
--explain names the line of the template, the query and the document behind each place where the\n\
problem contains the atom; if there is none, the lines that could write it and their queries, and exits with 1.\n\n\
--format json prints the problem's text and the sections of the template with their queries and how many documents\n\
matched; with --output, the text is in the file only."
)]
#[command(arg = formats::argument(&formats::PROBLEM))]
pub struct GenProblemArgs {
    /// The template; - is stdin
    #[arg(short, long, value_name = "FILE")]
    pub template: PathBuf,
    /// Check the problem against this domain; one that ends in .j2 or .tmpl is a template, too
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
    #[arg(long, value_name = "ATOM", conflicts_with_all = ["output", "format"])]
    pub explain: Option<String>,
}

pub(super) fn run(args: &GenProblemArgs, context: &mut Context<'_>) -> Result<Exit> {
    // Where it is not asked for by the flag, a problem is PDDL: programs read it.
    let is_asked = matches!(context.settings.format.origin, Origin::Flag(_));
    let is_json = context.format(&formats::PROBLEM)? == Format::Json && is_asked;
    let dialect = Dialect { lenient: args.options.lenient };
    let rendered = args.domain.as_deref().filter(|path| is_template(path));
    let plain = args.domain.as_deref().filter(|path| !is_template(path));
    let mut domain = plain.map(|path| read_domain(path, args.options.lenient, context)).transpose()?;
    let template = context.read(&args.template)?;
    let memory = args.past.memory(context)?;
    let rendered = rendered.map(|path| render_domain(path, &args.options, &memory, context)).transpose()?;
    if let Some((text, _)) = &rendered {
        domain = Some(Domain::read(text, dialect).map_err(Diagnostics)?);
    }
    let request = request(template, &args.options, rendered.as_ref().map(|(_, request)| request), context)?;
    let parts = request.parts.iter().map(|part| PathBuf::from(part.source.name()));
    keep(&args.output, std::iter::once(args.template.clone()).chain(args.domain.clone()).chain(parts))?;
    let is_file = !is_stdout(&args.output);
    // Where only the text is asked for, it is written as it is made.
    if args.explain.is_none()
        && (is_file || !is_json)
        && let Some(streamed) = write_as_made(args, &request, &memory, domain.as_ref(), context)?
    {
        if is_json {
            context.output.line(&shell::pretty(&Bson::Document(summary(&streamed.sections, None))))?;
        }
        return Ok(Exit::Done);
    }
    let generated = problem::generate(&request, &memory)?;
    report(&Asked::from(&generated), &memory, context);
    if let Some(domain) = &domain {
        let problem = generated.check(domain, dialect).map_err(Diagnostics)?;
        warn(&generated.explain(problem.warnings().to_vec()), context);
    }
    warn(&problem::unchecked(&generated), context);
    if args.options.strict {
        require(&generated.sections)?;
    }
    if let Some(atom) = &args.explain {
        return explanation::print(atom, &generated, dialect, &memory, context);
    }
    if !is_json || is_file {
        context.output.write_file(&args.output, generated.text.as_bytes())?;
    }
    if is_json {
        let text = (!is_file).then(|| generated.text.clone());
        context.output.line(&shell::pretty(&Bson::Document(summary(&generated.sections, text))))?;
    }
    Ok(Exit::Done)
}

/// Refuses to write the problem over a file that it is made from.
fn keep(output: &Path, mut sources: impl Iterator<Item = PathBuf>) -> Result<(), UsageError> {
    let Ok(whole) = output.canonicalize() else { return Ok(()) };
    match sources.find(|source| source.canonicalize().is_ok_and(|source| source == whole)) {
        Some(source) => {
            let message = "the problem is made from it; expected another file for --output";
            Err(UsageError::new(format!("cannot write the problem to {}: {message}", source.display())))
        }
        None => Ok(()),
    }
}

/// Writes the problem while it is made, where it can be: not where anything is wrong with it, or odd.
fn write_as_made(
    args: &GenProblemArgs,
    request: &Request,
    memory: &Memory,
    domain: Option<&Domain>,
    context: &mut Context<'_>,
) -> Result<Option<Streamed>> {
    let dialect = Dialect { lenient: args.options.lenient };
    let pending = context.output.begin_file(&args.output);
    let file = pending.as_ref().and_then(|pending| pending.file().try_clone().ok());
    let Some(mut streamed) = problem::stream(request, memory, domain, dialect, file)? else { return Ok(None) };
    report(&Asked::from(&streamed), memory, context);
    if args.options.strict {
        require(&streamed.sections)?;
    }
    match pending.filter(|_| streamed.is_in_place()) {
        Some(pending) => context.output.finish_file(&args.output, pending)?,
        None => context.output.write_with(&args.output, |out| Ok(streamed.copy_to(out)?))?,
    }
    Ok(Some(streamed))
}

/// The text of a problem, and what the sections of its template matched.
fn summary(sections: &[SectionReport], text: Option<String>) -> Document {
    let section = |section: &SectionReport| {
        let mut part: Document = section.part.iter().map(|part| ("part".to_owned(), part.into())).collect();
        part.extend(doc! {
            "line": to_i64(section.line),
            "name": &section.name,
            "namespace": section.namespace.to_string(),
            "query": shell::relaxed(&section.query),
            "documents": to_i64(section.matched),
        });
        part
    };
    let mut summary: Document = text.map(|text| ("problem".to_owned(), text.into())).into_iter().collect();
    summary.insert("sections", sections.iter().map(section).collect::<Vec<_>>());
    summary
}
