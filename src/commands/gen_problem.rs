//! `rmem gen-problem --template T`: a PDDL problem from a template whose sections are queries.

use std::path::Path;

use bson::Bson;

use super::{Context, WrongInput, explanation};
use crate::cli::{Definition, GenProblem, TemplateOptions, TemplateSyntax};
use crate::exit::Exit;
use crate::formats::{Diagnostic, Diagnostics, Source, pddl::Dialect, shell};
use crate::pddl::Domain;
use crate::problem::{self, Generated, Request, Syntax};

pub(super) fn run(args: &GenProblem, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let domain = args.domain.as_deref().map(|path| read_domain(path, args.options.lenient, context)).transpose()?;
    let template = context.read(&args.template)?;
    let memory = context.memory()?;
    let request = request(template, &args.options, context)?;
    let generated = problem::generate(&request, &memory)?;
    report(&generated, args.options.strict, context)?;
    if let Some(domain) = &domain {
        generated.check(domain, Dialect { lenient: args.options.lenient }).map_err(Diagnostics)?;
    }
    if let Some(atom) = &args.explain {
        return explanation::tell(atom, &generated, Dialect { lenient: args.options.lenient }, &memory, context);
    }
    context.output.write_file(&args.output, generated.text.as_bytes())?;
    Ok(Exit::Done)
}

/// Reads and checks a domain.
pub(super) fn read_domain(path: &Path, lenient: bool, context: &mut Context<'_>) -> anyhow::Result<Domain> {
    let source = context.read(path)?;
    Ok(Domain::read(&source, Dialect { lenient }).map_err(Diagnostics)?)
}

/// What a template is to be rendered with.
pub(super) fn request(
    template: Source,
    options: &TemplateOptions,
    context: &Context<'_>,
) -> Result<Request, Diagnostic> {
    Ok(Request {
        template,
        syntax: match options.syntax {
            TemplateSyntax::Auto => Syntax::Auto,
            TemplateSyntax::Minijinja => Syntax::Minijinja,
            TemplateSyntax::Marker => Syntax::Marker,
        },
        collection: context.settings.collection.value.clone(),
        goal: options.goal.clone(),
        parameters: options.definitions.iter().map(parameter).collect::<Result<_, _>>()?,
        lenient: options.lenient,
    })
}

fn parameter(definition: &Definition) -> Result<(String, Bson), Diagnostic> {
    let value = if definition.typed {
        shell::parse_value(&Source::new(format!("-D {}", definition.name), definition.value.as_str()))?
    } else {
        Bson::String(definition.value.clone())
    };
    Ok((definition.name.clone(), value))
}

/// Reports how many documents each section of a template matched; none is a warning, or an error if `strict`.
pub(super) fn report(generated: &Generated, strict: bool, context: &mut Context<'_>) -> anyhow::Result<()> {
    let mut empty = Vec::new();
    for section in &generated.sections {
        let plural = if section.matched == 1 { "document" } else { "documents" };
        let line =
            format!("line {}: {} in {}: {} {plural}", section.line, section.name, section.namespace, section.matched);
        if section.matched == 0 {
            context.output.warn(&line);
            empty.push(format!("line {}: {}", section.line, section.name));
        } else {
            context.output.note(&line);
        }
    }
    if strict && !empty.is_empty() {
        return Err(WrongInput::new(format!("sections that match no document: {}", empty.join("; "))).into());
    }
    Ok(())
}
