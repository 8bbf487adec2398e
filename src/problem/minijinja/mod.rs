//! Renders minijinja templates.

mod advice;
mod blocks;
mod bound;
mod call;
mod casing;
mod compare;
mod compared;
mod comparisons;
mod context;
mod direct;
mod documents;
mod files;
mod fixed;
mod function;
mod hint;
mod instrument;
mod join;
mod limits;
mod method;
mod mistake;
mod naming;
mod operands;
mod pieces;
mod plan;
mod rows;
mod signature;
mod source_lines;
mod tags;
mod value;

use std::collections::HashMap;
use std::fs::File;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use minijinja::value::{Object, Value};
use minijinja::{AutoEscape, Environment, Error, ErrorKind, UndefinedBehavior};

use super::answer::{self, Answerer};
use super::assembly::{Assembled, Assembler, Literal};
use super::stream::{Stream, Streamed};
use super::taken::Taken;
use super::{Generated, ProblemError, Request, SectionReport};
use crate::formats::Texts;
use crate::formats::pddl::Dialect;
use crate::formats::{Diagnostic, Span, shell};
use crate::memory::Memory;
use crate::pddl::Domain;
pub(super) use blocks::{Around, around};
use context::{Asked, Context};
use direct::Sink;
use files::Files;
use function::register;
pub(super) use instrument::PLACED;
use mistake::explain;
use naming::Naming;
pub(super) use naming::{computes_names, is_inside, quoted_texts, references};
use pieces::{Piece, bracketed, pieces};
use rows::Rows;
use source_lines::SourceLines;
use value::from_bson;

/// How deep macros may call each other.
const RECURSION: usize = 200;
/// The stack of the thread that renders, for that depth.
const STACK: usize = 32 << 20;

/// Renders the template over the memory.
pub(super) fn render(request: &Request, goal: Option<&str>, memory: &Memory) -> Result<Generated, ProblemError> {
    let (files, mut numbered) = Files::read(request, true)?;
    let (asker, answerer) = answer::pair();
    let fixed_texts = std::mem::take(&mut numbered.texts);
    let mut context = Context::new(asker, numbered);
    context.compared.given = numeric_texts(request);
    let context = Arc::new(context);
    let variables = Variables::of(request, goal);
    let is_goal_used = Arc::clone(&variables.is_goal_used);
    match run_beside(memory, answerer, &files, variables, &context)? {
        Ok(text) => {
            let generated = assemble(files.texts, &context, &fixed_texts, &text)?;
            Ok(Generated { is_goal_unused: goal.is_some() && !is_goal_used.load(Ordering::Relaxed), ..generated })
        }
        Err(error) => Err(explain(&files, &context, &error)),
    }
}

/// The parameters that are texts and read as numbers.
fn numeric_texts(request: &Request) -> Vec<(String, String)> {
    let texts = request.parameters.iter().filter_map(|(name, value)| Some((name, value.as_str()?.trim())));
    let numbers = texts.filter(|(_, text)| shell::parse_number(text).is_some());
    numbers.map(|(name, text)| (name.clone(), text.to_owned())).collect()
}

/// Renders the template into a file; nothing where that is doubtful.
pub(super) fn stream(
    request: &Request,
    goal: Option<&str>,
    memory: &Memory,
    (domain, dialect): (Option<&Domain>, Dialect),
    file: Option<File>,
) -> Result<Option<Streamed>, ProblemError> {
    let (files, numbered) = Files::read(request, false)?;
    let (asker, answerer) = answer::pair();
    let stream = Stream::new(&files.texts, domain, file);
    let context = Arc::new(Context::streaming(asker, numbered, stream));
    let variables = Variables::of(request, goal);
    let is_goal_used = Arc::clone(&variables.is_goal_used);
    if let Err(error) = run_beside(memory, answerer, &files, variables, &context)? {
        // The template's own mistakes are explained when it is rendered again.
        let is_plain = context.has_failed() || error.kind() == ErrorKind::OutOfFuel;
        return if is_plain { Err(explain(&files, &context, &error)) } else { Ok(None) };
    }
    if context.compared.is_mixed() {
        return Ok(None);
    }
    let stream = context.direct.as_ref().and_then(|direct| direct.take().ok());
    let Some(file) = stream.and_then(|stream| stream.finish(domain, dialect).ok()) else { return Ok(None) };
    Ok(Some(Streamed {
        sections: sections(&context, &files.texts),
        namespaces: context.namespaces(),
        respelled: context.looked.respelled.take(),
        is_goal_unused: goal.is_some() && !is_goal_used.load(Ordering::Relaxed),
        file,
    }))
}

/// Renders in a thread of its own, and answers its questions meanwhile.
fn run_beside(
    memory: &Memory,
    answerer: Answerer,
    files: &Files,
    variables: Variables,
    context: &Arc<Context>,
) -> Result<Result<String, Error>, ProblemError> {
    // The memory stays here; the thread has what asks it, and goes with it.
    let rendered = thread::scope(|scope| {
        let shared = Arc::clone(context);
        let work = move || {
            // Sent on every way out.
            let _end = End(&shared);
            run(files, variables, &shared)
        };
        let thread = thread::Builder::new().stack_size(STACK).spawn_scoped(scope, work);
        thread.map(|thread| {
            answerer.serve(memory);
            thread.join()
        })
    });
    let place = |message: &str| ProblemError::Template(files.texts.complain(Span::default(), message));
    let rendered = rendered.map_err(|error| place(&format!("no thread to render it: {error}")))?;
    rendered.map_err(|_| place("the template environment failed"))
}

/// What the template, and those that it names, take from outside.
pub(super) fn taken(request: &Request) -> Taken {
    let environment = Environment::new();
    let mut all = Taken::default();
    for source in std::iter::once(&request.template).chain(request.parts.iter().map(|part| &part.source)) {
        // What is too long is refused where it is rendered.
        if bound::check(source).is_err() {
            return Taken::unknown();
        }
        let Ok(template) = environment.template_from_named_str(source.name(), source.text()) else {
            return Taken::unknown();
        };
        all.names.extend(template.undeclared_variables(false));
        for tag in tags::tags(source.text()) {
            if let Some(naming) = Naming::of(&tag) {
                // minijinja does not look into these either.
                all.names.extend(tags::words(naming.expression).into_iter().map(|(_, word)| word.to_owned()));
            }
            if tag.word() == "filter" {
                // minijinja does not list these; its arguments are in brackets.
                let at = tag.code().find('(').unwrap_or(tag.code().len());
                let arguments = tag.words().into_iter().filter(|(start, _)| *start > at);
                let names = arguments.filter(|(_, word)| !word.starts_with(|c: char| c.is_ascii_digit()));
                all.names.extend(names.map(|(_, word)| word.to_owned()));
            }
            for (at, _) in tag.words().into_iter().filter(|(_, word)| *word == "param") {
                let rest = tag.code().get(at + "param".len()..).unwrap_or_default().trim_start();
                let argument = rest.strip_prefix('(').unwrap_or(rest).trim_start();
                match argument.strip_prefix(['"', '\'']).and_then(|name| name.split(['"', '\'']).next()) {
                    Some(name) => drop(all.names.insert(name.to_owned())),
                    None => all.is_unknown = true,
                }
            }
        }
    }
    all.takes_goal = all.names.remove("goal");
    all.names.retain(|name| !hint::FUNCTIONS.contains(&name.as_str()));
    all
}

/// What a template is given, by name.
#[derive(Debug)]
struct Variables {
    values: Vec<(String, Value)>,
    /// Set once the goal was looked at.
    is_goal_used: Arc<AtomicBool>,
}

impl Variables {
    /// The parameters and the goal.
    fn of(request: &Request, goal: Option<&str>) -> Self {
        let value = |(name, value): &(String, bson::Bson)| (name.clone(), from_bson(value, &Arc::default()));
        let mut values: Vec<(String, Value)> = request.parameters.iter().map(value).collect();
        if let Some(goal) = goal {
            values.push(("goal".to_owned(), Value::from_safe_string(goal.to_owned())));
        }
        Self { values, is_goal_used: Arc::default() }
    }
}

impl Object for Variables {
    fn get_value(self: &Arc<Self>, key: &Value) -> Option<Value> {
        let key = key.as_str()?;
        if key == "goal" {
            self.is_goal_used.store(true, Ordering::Relaxed);
        }
        self.values.iter().find(|(name, _)| name == key).map(|(_, value)| value.clone())
    }
}

/// Ends the answering when it goes.
struct End<'a>(&'a Context);

impl Drop for End<'_> {
    fn drop(&mut self) {
        self.0.end();
    }
}

fn run(files: &Files, variables: Variables, context: &Arc<Context>) -> Result<String, Error> {
    let mut environment = Environment::new();
    environment.set_debug(true);
    environment.set_undefined_behavior(UndefinedBehavior::Strict);
    environment.set_fuel(Some(limits::FUEL));
    environment.set_recursion_limit(RECURSION);
    let mut syntax = minijinja::syntax::SyntaxConfig::builder();
    environment.set_syntax(syntax.keep_trailing_newline(true).build()?);
    // Rendered parts (macros, blocks) are "safe", and values are not; no filter makes a value safe.
    environment.set_auto_escape_callback(|_| AutoEscape::Custom("pddl".into()));
    environment.remove_filter("safe");
    // It shows minijinja's inside, as one name.
    environment.remove_global("debug");
    let shared = Arc::clone(context);
    let goal = variables.values.iter().find(|(name, _)| name == "goal").map(|(_, goal)| goal.clone());
    let written = limits::Written::default();
    environment.set_formatter(move |out, _, value| {
        written.count(value)?;
        if let Some((rows, direct)) = value.downcast_object_ref::<Rows>().zip(shared.direct.as_ref()) {
            return rows.write(&shared, direct, out);
        }
        let written = shared.take_written();
        if let Some(joined) = shared.joined(value) {
            return shared.emit_joined(&joined, out);
        }
        if let Some(text) = value.as_str().filter(|_| value.is_safe()) {
            if goal.as_ref().is_some_and(|goal| goal.is_safe() && goal.as_str() == Some(text)) {
                return shared.emit_goal(text, out);
            }
            return match written {
                Some(site) => out.write_str(&bracketed(site, text)).map_err(Error::from),
                None => out.write_str(text).map_err(Error::from),
            };
        }
        // The end of an `if` without `else`.
        if value.is_undefined() {
            return Ok(());
        }
        shared.emit(value, out)
    });
    let given = variables.values.iter().filter(|(name, _)| name != "goal").cloned().collect();
    limits::register(&mut environment);
    register(&mut environment, context, given);
    let mut named = files.named();
    let (name, text) = named.next().unwrap_or_default();
    for (name, text) in named {
        environment.add_template(name, text)?;
    }
    let template = environment.template_from_named_str(name, text)?;
    let variables = Value::from_object(variables);
    match &context.direct {
        Some(direct) => template.render_captured_to(variables, Sink(Arc::clone(direct))).map(|_| String::new()),
        None => {
            let mut text = limits::Rendered::default();
            template.render_captured_to(variables, &mut text)?;
            text.into_text()
        }
    }
}

fn assemble(
    template: Texts,
    context: &Context,
    fixed_texts: &[Span],
    rendered: &str,
) -> Result<Generated, ProblemError> {
    let emitted = context.emitted();
    let mut assembler = Assembler::new(&template);
    // The fixed text that begins here.
    let mut fixed = None;
    // The expressions and filters that write what comes next, the innermost last.
    let mut open: Vec<usize> = Vec::new();
    let mut lines: HashMap<usize, SourceLines<'_>> = HashMap::new();
    for piece in pieces(rendered) {
        let place = fixed.take();
        match piece {
            Piece::Begin(site) => open.push(site),
            Piece::End => drop(open.pop()),
            Piece::Text(text) => match open.last().and_then(|site| Some((*site, *context.sites.get(*site)?))) {
                Some((site, span)) if place.is_none() => {
                    let lines = lines.entry(site).or_insert_with(|| SourceLines::of(span, &template));
                    lines.write(text, &mut assembler)?;
                }
                _ => written(text, place, &template, &mut assembler)?,
            },
            Piece::Mark(number) => fixed = fixed_texts.get(number).copied(),
            Piece::Value(number) => match emitted.get(number) {
                Some(value) if value.goal => assembler.goal(&value.text, value.template)?,
                Some(value) if value.is_placed => assembler.value(value, value.template),
                Some(value) => {
                    let writer = open.last().and_then(|site| context.sites.get(*site)).copied();
                    let template = writer.unwrap_or(value.template);
                    assembler.value(value, template);
                }
                None => {
                    let message = "a filter took rendered text apart; apply it to the values before they are rendered";
                    return Err(template.complain(Span::default(), message).into());
                }
            },
        }
    }
    let Assembled { text, placed, values } = assembler.finish()?;
    let sections = sections(context, &template);
    let (namespaces, respelled) = (context.namespaces(), context.looked.respelled.take());
    let remarks = context.compared.remarks(&template);
    drop(lines);
    Ok(Generated { text, sections, namespaces, respelled, remarks, is_goal_unused: false, template, placed, values })
}

/// The queries that were asked, and what they matched.
fn sections(context: &Context, template: &Texts) -> Vec<SectionReport> {
    let section = |asked: Asked| {
        let span = asked.site.and_then(|site| context.sites.get(site)).copied().unwrap_or_default();
        let (line, column) = template.position(span.start);
        let unmatched = template.complain(span, format!("no document of {} matches this section", asked.namespace));
        SectionReport {
            unmatched,
            name: template.slice(span).split_whitespace().collect::<Vec<_>>().join(" "),
            namespace: asked.namespace.as_ref().clone(),
            query: asked.query,
            matched: asked.matched.load(Ordering::Relaxed),
            part: template.part(span.start),
            line,
            column,
        }
    };
    context.asked().into_iter().map(section).collect()
}

/// Adds text to the problem: that of a stretch of the template, and what follows it.
fn written(text: &str, stretch: Option<Span>, template: &Texts, assembler: &mut Assembler) -> Result<(), Diagnostic> {
    let length = stretch.map_or(0, |span| span.end - span.start);
    match (stretch, text.get(..length), text.get(length..)) {
        (Some(span), Some(head), Some(tail)) if head == template.slice(span) => {
            assembler.literal(head, Literal { start: span.start, document: None })?;
            assembler.text(tail)
        }
        _ => assembler.text(text),
    }
}
