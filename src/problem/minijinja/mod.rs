//! Renders minijinja templates.

mod blocks;
mod bound;
mod call;
mod context;
mod documents;
mod fixed;
mod function;
mod hint;
mod instrument;
mod limits;
mod method;
mod signature;
mod tags;
mod value;

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread;

use minijinja::value::Value;
use minijinja::{AutoEscape, Environment, Error, ErrorKind, UndefinedBehavior};

use super::answer;
use super::assembly::{Assembled, Assembler, Literal};
use super::taken::Taken;
use super::{Generated, ProblemError, Request, SectionReport};
use crate::formats::{Diagnostic, Source, Span};
use crate::memory::Memory;
pub(super) use blocks::{Around, around};
use context::{Context, Piece, pieces};
use function::register;
pub(super) use instrument::PLACED;
use instrument::{Instrumented, instrument};
use value::{CLOSE, OPEN, from_bson};

/// How many steps of the engine a template may take: enough for millions of documents.
const FUEL: u64 = 500_000_000;
/// How deep macros may call each other.
const RECURSION: usize = 200;
/// The stack of the thread that renders, for that depth.
const STACK: usize = 32 << 20;

/// Renders the template over the memory.
pub(super) fn render(request: &Request, goal: Option<&str>, memory: &Memory) -> Result<Generated, ProblemError> {
    let template = &request.template;
    if let Some(offset) = template.text().find([OPEN, CLOSE]) {
        return Err(Diagnostic::new(template, Span::at(offset), "a template cannot hold this character").into());
    }
    bound::check(template)?;
    let mut instrumented = instrument(template.text());
    let (asker, answerer) = answer::pair();
    let context = Arc::new(Context::new(asker, std::mem::take(&mut instrumented.sites)));
    let variables = variables(request, goal);
    // The memory stays here; the thread has what asks it, and goes with it.
    let rendered = thread::scope(|scope| {
        let shared = Arc::clone(&context);
        let text = instrumented.text.as_str();
        let name = template.name();
        let work = move || {
            // Sent on every way out.
            let _end = End(&shared);
            run(name, text, variables, &shared)
        };
        let thread = thread::Builder::new().stack_size(STACK).spawn_scoped(scope, work);
        thread.map(|thread| {
            answerer.serve(memory);
            thread.join()
        })
    });
    let place = |message: &str| ProblemError::Template(Diagnostic::new(template, Span::default(), message));
    let rendered = rendered.map_err(|error| place(&format!("no thread to render it: {error}")))?;
    let rendered = rendered.map_err(|_| place("the template environment failed"))?;
    match rendered {
        Ok(text) => assemble(request, &context, &instrumented, &text),
        Err(error) => Err(explain(template, &instrumented, &context, &error)),
    }
}

/// What the template takes from outside.
pub(super) fn taken(request: &Request) -> Taken {
    let text = request.template.text();
    let environment = Environment::new();
    let Ok(template) = environment.template_from_named_str(request.template.name(), text) else {
        return Taken::unknown();
    };
    let mut names: BTreeSet<String> = template.undeclared_variables(false).into_iter().collect();
    let takes_goal = names.remove("goal");
    names.retain(|name| !hint::FUNCTIONS.contains(&name.as_str()));
    let mut taken = Taken { names, takes_goal, is_unknown: false };
    for tag in tags::tags(text) {
        for (at, _) in tag.words().into_iter().filter(|(_, word)| *word == "param") {
            let rest = tag.code().get(at + "param".len()..).unwrap_or_default().trim_start();
            let argument = rest.strip_prefix('(').unwrap_or(rest).trim_start();
            match argument.strip_prefix(['"', '\'']).and_then(|name| name.split(['"', '\'']).next()) {
                Some(name) => drop(taken.names.insert(name.to_owned())),
                None => taken.is_unknown = true,
            }
        }
    }
    taken
}

/// Ends the answering when it goes.
struct End<'a>(&'a Context);

impl Drop for End<'_> {
    fn drop(&mut self) {
        self.0.end();
    }
}

/// The parameters and the goal.
fn variables(request: &Request, goal: Option<&str>) -> Vec<(String, Value)> {
    let value = |(name, value): &(String, bson::Bson)| (name.clone(), from_bson(value, &Arc::default()));
    let mut variables: Vec<(String, Value)> = request.parameters.iter().map(value).collect();
    if let Some(goal) = goal {
        variables.push(("goal".to_owned(), Value::from_safe_string(goal.to_owned())));
    }
    variables
}

fn run(name: &str, text: &str, variables: Vec<(String, Value)>, context: &Arc<Context>) -> Result<String, Error> {
    let mut environment = Environment::new();
    environment.set_debug(true);
    environment.set_undefined_behavior(UndefinedBehavior::Strict);
    environment.set_fuel(Some(FUEL));
    environment.set_recursion_limit(RECURSION);
    let mut syntax = minijinja::syntax::SyntaxConfig::builder();
    environment.set_syntax(syntax.keep_trailing_newline(true).build()?);
    // Rendered parts (macros, blocks) are "safe", and values are not; no filter makes a value safe.
    environment.set_auto_escape_callback(|_| AutoEscape::Custom("pddl".into()));
    environment.remove_filter("safe");
    // It shows the engine's inside, as one name.
    environment.remove_global("debug");
    let shared = Arc::clone(context);
    let goal = variables.iter().find(|(name, _)| name == "goal").map(|(_, goal)| goal.clone());
    environment.set_formatter(move |out, _, value| {
        if let Some(text) = value.as_str().filter(|_| value.is_safe()) {
            if goal.as_ref().is_some_and(|goal| goal.is_safe() && goal.as_str() == Some(text)) {
                return shared.emit_goal(text, out);
            }
            return out.write_str(text).map_err(Error::from);
        }
        // The end of an `if` without `else`.
        if value.is_undefined() {
            return Ok(());
        }
        shared.emit(value, out)
    });
    let given = variables.iter().filter(|(name, _)| name != "goal").cloned().collect();
    limits::register(&mut environment);
    register(&mut environment, context, given);
    let template = environment.template_from_named_str(name, text)?;
    template.render(Value::from_pairs(variables))
}

fn assemble(
    request: &Request,
    context: &Context,
    instrumented: &Instrumented,
    rendered: &str,
) -> Result<Generated, ProblemError> {
    let template = &request.template;
    let emitted = context.emitted();
    let mut assembler = Assembler::new(template);
    // The fixed text that begins here.
    let mut fixed = None;
    for piece in pieces(rendered) {
        let place = fixed.take();
        match piece {
            Piece::Text(text) => written(text, place, template, &mut assembler)?,
            Piece::Mark(number) => fixed = instrumented.texts.get(number).copied(),
            Piece::Value(number) => match emitted.get(number) {
                Some(value) if value.goal => assembler.goal(&value.text, value.template)?,
                Some(value) => assembler.value(Cow::Borrowed(value)),
                None => {
                    let message = "a filter took rendered text apart; apply it to the values before they are rendered";
                    return Err(Diagnostic::new(template, Span::default(), message).into());
                }
            },
        }
    }
    let Assembled { text, placed, values } = assembler.finish()?;
    let sections = context.asked().into_iter().map(|asked| {
        let span = asked.site.and_then(|site| context.sites.get(site)).copied().unwrap_or_default();
        SectionReport {
            name: template.slice(span).split_whitespace().collect::<Vec<_>>().join(" "),
            namespace: asked.namespace.as_ref().clone(),
            query: asked.query,
            matched: asked.matched.load(Ordering::Relaxed),
            line: template.position(span.start).0,
        }
    });
    let sections = sections.collect();
    let (namespaces, respelled) = (context.namespaces(), context.looked.respelled.take());
    Ok(Generated { text, sections, namespaces, respelled, template: template.clone(), placed, values })
}

/// Adds text to the problem: that of a stretch of the template, and what follows it.
fn written<'a>(
    text: &'a str,
    stretch: Option<Span>,
    template: &Source,
    assembler: &mut Assembler<'a>,
) -> Result<(), Diagnostic> {
    let length = stretch.map_or(0, |span| span.end - span.start);
    match (stretch, text.get(..length), text.get(length..)) {
        (Some(span), Some(head), Some(tail)) if head == template.slice(span) => {
            assembler.literal(head, Literal { start: span.start, document: None })?;
            assembler.text(tail)
        }
        _ => assembler.text(text),
    }
}

/// What went wrong, at its place in the template as it was written.
fn explain(template: &Source, instrumented: &Instrumented, context: &Context, error: &Error) -> ProblemError {
    // The innermost error knows the place; the ones around it say which block or macro it was in.
    let mut innermost = error;
    while let Some(inner) = std::error::Error::source(innermost).and_then(|source| source.downcast_ref::<Error>()) {
        innermost = inner;
    }
    let range = innermost.range().or_else(|| error.range()).unwrap_or(0..0);
    let length = template.text().len();
    let start = instrumented.original(range.start).min(length);
    let end = instrumented.original(range.end).clamp(start, length);
    let mut span = Span::new(start, end);
    if instrumented.is_inserted(range.start) {
        // The complaint is about what was added to an expression, so about its value.
        let around = context.sites.iter().filter(|site| site.start <= start && start <= site.end);
        span = around.min_by_key(|site| site.end - site.start).copied().unwrap_or(span);
    }
    if let Some(failure) = context.failure() {
        return ProblemError::store(template, span, failure);
    }
    let is_block = |detail: &str| detail.contains("end of input") || detail.contains("unknown statement end");
    if innermost.kind() == ErrorKind::SyntaxError
        && innermost.detail().is_some_and(is_block)
        && let Some(unclosed) = blocks::unclosed(template)
    {
        return ProblemError::Template(unclosed);
    }
    let expression = template.slice(span).trim().trim_matches(['{', '}', '-']).trim();
    let detail = innermost.detail().unwrap_or_default();
    let missing =
        context.missing().filter(|missing| expression.trim_end_matches(['"', '\'', ']']).ends_with(&missing.key));
    let message = match innermost.kind() {
        ErrorKind::UnknownFilter if !detail.contains("safe") => format!("unknown filter `{}`", hint::quoted(detail)),
        ErrorKind::UnknownTest => format!("unknown test `{}`", hint::quoted(detail)),
        ErrorKind::UnknownFunction => format!("unknown function `{}`", detail.trim_end_matches(" is unknown")),
        ErrorKind::UndefinedError if detail.starts_with('`') => detail.to_owned(),
        ErrorKind::UndefinedError if !expression.is_empty() && !expression.contains('\n') => {
            format!("`{expression}` is undefined")
        }
        ErrorKind::TemplateNotFound | ErrorKind::BadInclude => {
            "a template cannot include, import or extend another".to_owned()
        }
        ErrorKind::OutOfFuel => "the template does not come to an end".to_owned(),
        ErrorKind::UnknownFilter if detail.contains("safe") => {
            "there is no filter `safe`: values are always names or numbers".to_owned()
        }
        kind if detail.is_empty() => kind.to_string(),
        ErrorKind::InvalidOperation => detail.to_owned(),
        kind => format!("{kind}: {detail}"),
    };
    let hints = hint::hints(innermost, template.text(), expression, missing.as_ref());
    let diagnostic = Diagnostic::new(template, span, message);
    ProblemError::Template(hints.into_iter().fold(diagnostic, Diagnostic::hint))
}
