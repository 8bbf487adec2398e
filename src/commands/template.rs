//! Templates on the command line: what they are given, and what is reported of their sections.

use std::path::{Path, PathBuf};

use bson::{Bson, Document};
use clap::{Args, ValueEnum};

use super::context::STDIN;
use super::{Context, missing};
use crate::error::Result;
use crate::formats::{Diagnostic, Diagnostics, Source, command_line, pddl::Dialect, shell};
use crate::memory::Memory;
use crate::pddl::Domain;
use crate::problem::{self, Generated, Request, SectionReport, Streamed, Syntax, check_use, read_parts, takes_goal};
use crate::store::Namespace;

/// The arguments of a template.
#[derive(Debug, Clone, Default, Args)]
pub struct TemplateArgs {
    /// The problem's goal, as PDDL
    #[arg(long, value_name = "GOAL", allow_hyphen_values = true)]
    pub goal: Option<String>,
    /// A parameter: NAME=TEXT, or NAME:=JSON for other types (can be repeated)
    #[arg(short = 'D', long = "define", value_name = "NAME=VALUE", value_parser = definition)]
    pub definitions: Vec<Definition>,
    /// Folder of templates that the template includes, extends or imports, after its own folder (can be repeated)
    #[arg(long, value_name = "DIR")]
    pub template_path: Vec<PathBuf>,
    /// Syntax of the template: auto, minijinja, marker
    #[arg(long, value_name = "SYNTAX", default_value = "auto", hide_possible_values = true)]
    pub syntax: TemplateSyntax,
    /// Accept what Fawkes accepted: unknown keys are empty, `//` begins a comment
    #[arg(long)]
    pub lenient: bool,
    /// Fail where a section matches no document
    #[arg(long)]
    pub strict: bool,
}

/// The syntax of a template.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum TemplateSyntax {
    /// By its content.
    #[default]
    Auto,
    /// `{{ … }}`, `{% … %}`
    Minijinja,
    /// `<<#NAME|{query}>> … <</NAME>>`
    Marker,
}

/// `-D NAME=TEXT` or `-D NAME:=JSON`
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Definition {
    /// The parameter.
    pub name: String,
    /// Its value, as it was written.
    pub value: String,
    /// Whether the value is typed (`:=`).
    pub typed: bool,
}

fn definition(text: &str) -> Result<Definition, String> {
    let Some((name, value)) = text.split_once('=') else {
        return Err("expected NAME=TEXT or NAME:=JSON".to_owned());
    };
    let (name, typed) = name.strip_suffix(':').map_or((name, false), |name| (name, true));
    let legal = |c: char| c.is_ascii_alphanumeric() || c == '_';
    if name.is_empty() || !name.chars().all(legal) || name.starts_with(|c: char| c.is_ascii_digit()) {
        return Err(format!("`{name}` is not a parameter's name; expected letters, digits and _"));
    }
    Ok(Definition { name: name.to_owned(), value: value.to_owned(), typed })
}

/// Reads and checks a domain.
pub(super) fn read_domain(path: &Path, lenient: bool, context: &mut Context<'_>) -> Result<Domain> {
    let source = context.read_pddl(path)?;
    let domain = Domain::read(&source, Dialect { lenient }).map_err(Diagnostics)?;
    warn(domain.warnings(), context);
    Ok(domain)
}

/// Prints what is odd but not wrong in a domain or a problem.
pub(super) fn warn(warnings: &[Diagnostic], context: &mut Context<'_>) {
    warnings.iter().for_each(|warning| context.output.warn(&warning.to_string()));
}

/// Whether a domain is a template, by the end of its name.
pub(super) fn is_template(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "j2" || extension == "tmpl")
}

/// Renders a domain that is a template, with the parameters of the problem's, and checks it. Returns its text, which
/// goes by the template's name, and what it was rendered with.
pub(super) fn render_domain(
    path: &Path,
    options: &TemplateArgs,
    memory: &Memory,
    context: &mut Context<'_>,
) -> Result<(Source, Request)> {
    let template = context.read(path)?;
    let request = unchecked(template, &TemplateArgs { goal: None, ..options.clone() }, context)?;
    let generated = problem::generate(&request, memory)?;
    report(&Asked::from(&generated), memory, context);
    let dialect = Dialect { lenient: options.lenient };
    generated.check_domain(dialect).map_err(Diagnostics)?;
    if options.strict {
        require(&generated.sections)?;
    }
    Ok((Source::new(request.template.name(), generated.text), request))
}

/// What a template is to be rendered with. `domain` is that of a domain which is a template, too, and has the same parameters.
pub(super) fn request(
    template: Source,
    options: &TemplateArgs,
    domain: Option<&Request>,
    context: &Context<'_>,
) -> Result<Request, Diagnostic> {
    let mut request = unchecked(template, options, context)?;
    check_use(&request, domain.as_slice())?;
    // What the template takes no notice of is not the goal of its problem.
    if request.goal.is_some() && !takes_goal(&request) {
        request.goal = None;
    }
    Ok(request)
}

fn unchecked(template: Source, options: &TemplateArgs, context: &Context<'_>) -> Result<Request, Diagnostic> {
    let mut request = Request {
        template: template.without_mark(),
        parts: Vec::new(),
        syntax: match options.syntax {
            TemplateSyntax::Auto => Syntax::Auto,
            TemplateSyntax::Minijinja => Syntax::Minijinja,
            TemplateSyntax::Marker => Syntax::Marker,
        },
        collection: context.settings.collection.value.clone(),
        goal: options.goal.clone(),
        parameters: options.definitions.iter().map(parameter).collect::<Result<_, _>>()?,
        lenient: options.lenient,
    };
    request.parts = read_parts(&request, &folders(&request.template, options, context))?;
    Ok(request)
}

/// The folders of the templates that a template names: its own, those of `--template-path`, those of the settings.
fn folders(template: &Source, options: &TemplateArgs, context: &Context<'_>) -> Vec<PathBuf> {
    let own = (template.name() != STDIN).then(|| Path::new(template.name()).parent().map(Path::to_path_buf));
    let settings = context.settings.template_path.value.iter().cloned();
    own.flatten().into_iter().chain(options.template_path.iter().cloned()).chain(settings).collect()
}

fn parameter(definition: &Definition) -> Result<(String, Bson), Diagnostic> {
    let value = if definition.typed {
        shell::parse_value(&Source::new(format!("-D {}", definition.name), definition.value.as_str()))?
    } else {
        Bson::String(definition.value.clone())
    };
    Ok((definition.name.clone(), value))
}

/// What was asked for a problem.
pub(super) struct Asked<'g> {
    pub(super) sections: &'g [SectionReport],
    namespaces: &'g [Namespace],
    respelled: &'g [String],
    remarks: &'g [Diagnostic],
    is_goal_unused: bool,
}

impl<'g> From<&'g Generated> for Asked<'g> {
    fn from(generated: &'g Generated) -> Self {
        let Generated { sections, namespaces, respelled, remarks, is_goal_unused, .. } = generated;
        Self { sections, namespaces, respelled, remarks, is_goal_unused: *is_goal_unused }
    }
}

impl<'g> From<&'g Streamed> for Asked<'g> {
    fn from(streamed: &'g Streamed) -> Self {
        let Streamed { sections, namespaces, respelled, is_goal_unused, .. } = streamed;
        Self { sections, namespaces, respelled, remarks: &[], is_goal_unused: *is_goal_unused }
    }
}

/// Reports how many documents each section of a template matched, under `-v`. One that matched none is a warning with
/// the reason; so is a collection that does not exist.
pub(super) fn report(asked: &Asked<'_>, memory: &Memory, context: &mut Context<'_>) {
    let mut warned: Vec<&Namespace> = Vec::new();
    for section in asked.sections {
        let plural = if section.matched == 1 { "document" } else { "documents" };
        let line =
            format!("{}: {} in {}: {} {plural}", section.place(), section.name, section.namespace, section.matched);
        if section.matched > 0 {
            context.output.detail(&line);
            continue;
        }
        context.output.warn(&line);
        let is_warned = warned.contains(&&section.namespace);
        if !is_warned && context.output.shows_notes() {
            why(section, memory, context);
        }
        if missing::message(&section.namespace, memory, context).is_some() {
            warned.push(&section.namespace);
        }
    }
    if asked.is_goal_unused {
        let message = "the goal is not in the problem: the part of the template that uses it was left out";
        context.output.warn(message);
    }
    asked.respelled.iter().for_each(|name| context.output.note(name));
    warn(asked.remarks, context);
    for namespace in asked.namespaces {
        if !warned.contains(&namespace) && !asked.sections.iter().any(|section| section.namespace == *namespace) {
            missing::warn(namespace, memory, context);
        }
    }
}

/// Refuses what was made from sections of which one matched no document.
pub(super) fn require(sections: &[SectionReport]) -> Result<()> {
    let empty = sections.iter().filter(|section| section.matched == 0);
    let empty: Vec<Diagnostic> = empty.map(|section| section.unmatched.clone()).collect();
    if empty.is_empty() { Ok(()) } else { Err(Diagnostics(empty).into()) }
}

/// In larger collections, why a section matched nothing is looked into under `-v` only: a plan is not to wait for it.
const DIAGNOSED: u64 = 10_000;

/// Explains why a section matched nothing: the collection does not exist, or which condition no document meets.
fn why(section: &SectionReport, memory: &Memory, context: &mut Context<'_>) {
    if let Some(message) = missing::message(&section.namespace, memory, context) {
        context.output.note(&format!("  {message}"));
        return;
    }
    let Some(filter) = section.filter().filter(|filter| !filter.is_empty()) else { return };
    // The template was rendered: what a diagnosis meets now is no error of it.
    let documents = memory.count_stored(&section.namespace, &Document::new()).unwrap_or_default();
    if documents > DIAGNOSED && !context.output.is_verbose() {
        let query = command_line::word(&shell::relaxed(&filter));
        context.output.note(&format!("  rmem query {} {query} --why says why", section.namespace));
        return;
    }
    let Ok(diagnosis) = memory.diagnose(&section.namespace, &filter) else { return };
    if diagnosis.is_telling() {
        diagnosis.lines().iter().for_each(|line| context.output.note(&format!("  {line}")));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn definitions_are_text_or_typed() {
        assert_eq!(
            definition("robot=R2=D2"),
            Ok(Definition { name: "robot".into(), value: "R2=D2".into(), typed: false })
        );
        assert!(definition("n:=3").unwrap().typed);
        for text in ["", "x", "=1", "1x=2", "a b=3", "a-b=1"] {
            assert!(definition(text).is_err(), "{text}");
        }
    }
}
