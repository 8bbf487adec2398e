//! Trying what the settings name: planners on a tiny task, computables, templates and domains.

use std::path::{Path, PathBuf};
use std::time::Duration;

use bson::Document;

use crate::commands::template::{self, TemplateArgs, read_domain};
use crate::commands::{Context, UsageError};
use crate::error::Result;
use crate::formats::Diagnostics;
use crate::formats::Source;
use crate::formats::pddl::Dialect;
use crate::formats::shell;
use crate::interrupt::InterruptGuard;
use crate::memory::Memory;
use crate::memory::computables::{BodyKind, Definition};
use crate::output::amount;
use crate::pddl::{Domain, Problem};
use crate::planner::{Host, Limits, Outcome, Registry, Task, run};
use crate::problem;
use crate::store::{Embedded, Index, StoreError};

/// The task that every planner has to solve, as small as can be.
const DOMAIN: &str = "(define (domain lamps) (:requirements :strips) (:predicates (lit ?lamp) (dark ?lamp))
  (:action switch-on :parameters (?lamp) :precondition (dark ?lamp) :effect (and (lit ?lamp) (not (dark ?lamp)))))";
const PROBLEM: &str = "(define (problem evening) (:domain lamps) (:objects hall porch) (:init (dark hall) (dark porch)) (:goal (lit porch)))";
/// How long a planner may take for it.
const TIMEOUT: Duration = Duration::from_secs(10);

/// What a trial gave.
pub(super) struct Trial {
    /// The kind of what was tried: `planner`.
    pub(super) check: &'static str,
    /// What was tried.
    pub(super) name: String,
    /// How it went.
    pub(super) state: String,
    /// Whether it went well, or is not needed.
    pub(super) is_fine: bool,
}

impl Trial {
    fn of(check: &'static str, name: &str, result: Result<String, String>) -> Self {
        let (state, is_fine) = match result {
            Ok(state) => (format!("ok, {state}"), true),
            Err(state) => (state, false),
        };
        Self { check, name: name.to_owned(), state, is_fine }
    }
}

/// Runs each planner on the tiny task.
pub(super) fn planners(context: &Context<'_>) -> Result<Vec<Trial>> {
    let registry = context.planners();
    let (domain, problem) = tiny()?;
    let task = Task { domain: &domain, problem: &problem };
    let guard = InterruptGuard::new();
    let host = Host { interrupted: guard.interrupted(), ..context.host() };
    let names: Vec<String> = registry.names().map(str::to_owned).collect();
    names.iter().map(|name| planner(name, &registry, &task, &host, context)).collect()
}

/// The tiny task, read.
fn tiny() -> Result<(Domain, Problem), Diagnostics> {
    let domain = Domain::read(&Source::new("domain", DOMAIN), Dialect::default()).map_err(Diagnostics)?;
    let problem = Problem::read(&Source::new("problem", PROBLEM), &domain, Dialect::default()).map_err(Diagnostics)?;
    Ok((domain, problem))
}

fn planner(name: &str, registry: &Registry, task: &Task<'_>, host: &Host<'_>, context: &Context<'_>) -> Result<Trial> {
    let planner = registry.get(name, false)?;
    let limits = Limits { time: Some(TIMEOUT), ..Limits::default() };
    let mut run = run(planner.as_ref(), task, &limits, host);
    run.simulate(task);
    let program = planner.command(host).first().map(|word| word.to_string_lossy().into_owned()).unwrap_or_default();
    let is_configured = context.settings.planners.iter().any(|planner| planner.name == name);
    Ok(match &run.outcome {
        Outcome::Plan(_) => {
            let place = match context.program(&program) {
                Some(path) if name != "builtin" => format!(", {}", path.display()),
                _ => String::new(),
            };
            Trial::of("planner", name, Ok(format!("solves a tiny task in {:.3} s{place}", run.time.as_secs_f64())))
        }
        // Planners that are not configured are only offered.
        Outcome::NotFound if !is_configured => {
            let state = format!("the program `{program}` is not installed");
            Trial { check: "planner", name: name.to_owned(), state, is_fine: true }
        }
        outcome => Trial::of("planner", name, Err(failure(outcome, &run.message, &run.tail()))),
    })
}

fn failure(outcome: &Outcome, message: &str, tail: &str) -> String {
    let mut text = format!("does not solve a tiny task: {}", outcome.sentence());
    for part in [message, tail].into_iter().filter_map(|part| part.lines().next()).filter(|part| !part.is_empty()) {
        text.push_str("; ");
        text.push_str(part);
    }
    text
}

/// Tries each computable, without storing what it computes: pipelines and programs run.
pub(super) fn computables(asked: &[Document], memory: Option<&Memory>, context: &Context<'_>) -> Vec<Trial> {
    let tried = |definition: &Definition| {
        Trial::of("computable", &definition.name, computable(definition, asked, memory, context))
    };
    match memory.map(Memory::computables).transpose() {
        Ok(None) => context.settings.computables.iter().map(tried).collect(),
        Ok(Some((all, wrong))) => {
            let wrong = wrong.into_iter().map(|wrong| Trial::of("computable", "kept in the memory", Err(wrong)));
            all.iter().map(|computable| tried(&computable.definition)).chain(wrong).collect()
        }
        Err(error) => vec![Trial::of("computable", "kept in the memory", Err(error.to_string()))],
    }
}

fn computable(
    definition: &Definition,
    asked: &[Document],
    memory: Option<&Memory>,
    context: &Context<'_>,
) -> Result<String, String> {
    match &definition.body {
        BodyKind::Command { words, folder, .. } => {
            let found = program(words, folder, context)?;
            Ok(ask(definition, asked, memory, context)?.unwrap_or(found))
        }
        BodyKind::Builtin { name, .. } => Ok(format!("builtin {name}")),
        BodyKind::Pipeline { from, stages } => {
            let Some(memory) = memory else {
                return Ok("a pipeline; not tried, for the memory is not there".to_owned());
            };
            // What the query says is not known here.
            if stages.iter().any(|stage| stage.to_string().contains("$$query")) {
                return Ok("a pipeline that depends on the query".to_owned());
            }
            let found = memory.aggregate(from, stages).and_then(|found| found.collect::<Result<Vec<_>, _>>());
            let found = found.map_err(|error| error.to_string())?;
            let documents = found.iter().filter_map(|document| Document::try_from(&**document).ok());
            storable(documents.collect(), definition, memory)?;
            Ok(format!("its pipeline gives {}", amount(found.len() as u64, "document")))
        }
    }
}

/// Asks the program of a computable: the first of the queries that its spec matches, else one that is made up. None
/// where there is no such query.
fn ask(
    definition: &Definition,
    asked: &[Document],
    memory: Option<&Memory>,
    context: &Context<'_>,
) -> Result<Option<String>, String> {
    let given = asked.iter().find(|query| definition.answers(query)).cloned();
    let is_given = given.is_some();
    let Some(query) = given.or_else(|| definition.example()) else { return Ok(None) };
    let Some(answer) = definition.ask_program(&query, TIMEOUT, &context.host()) else { return Ok(None) };
    let text = shell::relaxed(&query);
    let documents = answer.map_err(|words| {
        let hint = if is_given { "" } else { "\n  the query is made up; --ask QUERY asks another" };
        format!("does not answer {text}: {words}{hint}")
    })?;
    let count = amount(documents.len() as u64, "document");
    memory.map_or(Ok(()), |memory| storable(documents, definition, memory))?;
    Ok(Some(format!("answers {text} with {count}")))
}

/// Refuses computed documents that have the same values in a unique index of their collection.
fn storable(documents: Vec<Document>, definition: &Definition, memory: &Memory) -> Result<(), String> {
    let namespace = &definition.namespace;
    let indexes = memory.indexes(namespace).unwrap_or_default();
    let unique: Vec<Index> = indexes.into_iter().filter(|index| index.unique && index.name != "_id_").collect();
    if unique.is_empty() || definition.adds.is_some() {
        return Ok(());
    }
    // A copy of the collection without its documents tells what the index takes for the same.
    let copy = Embedded::in_memory().map_err(|error| error.to_string())?;
    let copy = Memory::new(Box::new(copy), None, Vec::new());
    for index in &unique {
        copy.create_index(namespace, index).map_err(|error| error.to_string())?;
    }
    match copy.insert(namespace, documents) {
        Err(StoreError::Duplicate { key, .. }) if key.index().is_some() => Err(format!(
            "cannot be stored: two of the documents that it gives have {key} of {namespace}; give each a value of its own"
        )),
        _ => Ok(()),
    }
}

/// Looks for a program and the scripts that its arguments name.
fn program(words: &[String], folder: &Path, context: &Context<'_>) -> Result<String, String> {
    let (program, arguments) = words.split_first().ok_or("it names no program")?;
    let local = folder.join(program);
    let found = if program.contains('/') { local.is_file().then_some(local) } else { context.program(program) };
    let found = found.ok_or_else(|| format!("the program `{program}` is not there"))?;
    if rustix::fs::access(&found, rustix::fs::Access::EXEC_OK).is_err() {
        return Err(format!("{} cannot be executed; chmod +x it", found.display()));
    }
    match arguments.iter().find(|word| is_script(word) && !folder.join(word).exists()) {
        Some(missing) => Err(format!("there is no file {missing} in {}", folder.display())),
        None => Ok(found.display().to_string()),
    }
}

/// Whether an argument names a script: it ends as one, and is no option.
fn is_script(word: &str) -> bool {
    let ends = [".py", ".sh", ".rb", ".pl", ".js", ".lua", ".jar"];
    !word.starts_with('-') && !word.contains(char::is_whitespace) && ends.iter().any(|end| word.ends_with(end))
}

/// Reads domains, and renders templates from the memory as it is now.
pub(super) fn files(
    domains: &[PathBuf],
    templates: &[PathBuf],
    options: &TemplateArgs,
    memory: Option<&Memory>,
    context: &mut Context<'_>,
) -> Result<Vec<Trial>> {
    let mut trials = Vec::new();
    for path in domains {
        let read = read_domain(path, options.lenient, context).map(|domain| {
            let tree = domain.tree();
            amount((tree.actions.len() + tree.durative_actions.len()) as u64, "action")
        });
        trials.push(Trial::of("domain", &path.display().to_string(), read.map_err(|error| format!("{error:#}"))));
    }
    for path in templates {
        let missing = || UsageError::new("a template is rendered from the memory, which is not there").into();
        let rendered = memory.ok_or_else(missing).and_then(|memory| render(path, options, memory, context));
        let rendered = rendered.map_err(|error| format!("{error:#}"));
        trials.push(Trial::of("template", &path.display().to_string(), rendered));
    }
    Ok(trials)
}

fn render(path: &Path, options: &TemplateArgs, memory: &Memory, context: &mut Context<'_>) -> Result<String> {
    let template = context.read(path)?;
    let request = template::request(template, options, None, context)?;
    let generated = problem::generate(&request, memory)?;
    let empty: Vec<String> = generated
        .sections
        .iter()
        .filter(|section| section.matched == 0)
        .map(|section| section.line.to_string())
        .collect();
    Ok(match empty.as_slice() {
        [] => format!("{} lines, {} queries", generated.text.lines().count(), generated.sections.len()),
        lines => format!("renders, but the queries in these lines match nothing: {}", lines.join(", ")),
    })
}
