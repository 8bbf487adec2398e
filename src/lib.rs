//! rmem: a document-oriented robot memory on the command line.
//!
//! In the order data flows: a command line ([`cli`]) and settings ([`settings`]) become a command ([`commands`]). It uses a
//! [`memory`], which routes operations to [`store`]s that answer MongoDB's languages ([`query`]). Templates whose sections
//! are queries become PDDL problems ([`problem`]), checked against a domain ([`pddl`]). A [`planner`], a program run as a
//! [`process`], turns a problem into a [`plan`], which is simulated, stored as a document and printed; [`planning`] is
//! that workflow. [`clips`] turns documents into CLIPS facts and back, [`scene`] into what a motion planner has to know and
//! back. [`formats`] read and write all external texts. What
//! rmem is given comes through [`input`], what the user sees goes through [`output`], and a command ends with a
//! code of [`exit`]: each error type says whose [`fault`] it is, and commands fail with an [`error`] that knows it.
//!
//! The library is silent: it prints, reads the environment and exits only through what [`run`] is given.
//!
//! # A memory
//!
//! [`store::open`] opens a store by its URI, [`memory::Memory`] works on stores:
//!
//! ```
//! use bson::doc;
//! use rmem::memory::Memory;
//! use rmem::store::{Find, Namespace, Role, StoreUri, open};
//!
//! let store = open(&StoreUri::parse("mem:")?, Role::Local)?;
//! let memory = Memory::new(store, None, Vec::new());
//! let blocks = Namespace::parse("robmem.blocks")?;
//! memory.insert(&blocks, vec![doc! { "_id": 1, "name": "A", "on": "B" }, doc! { "_id": 2, "name": "B" }])?;
//!
//! let find = Find { filter: doc! { "on": { "$exists": true } }, ..Find::default() };
//! for document in memory.find(&blocks, &find)? {
//!     assert_eq!(document?.get_str("name")?, "A");
//! }
//! assert_eq!(memory.count(&blocks, &doc! {})?, 2);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # A problem from a template
//!
//! [`problem::generate`] renders a template over a memory:
//!
//! ```
//! # use bson::doc;
//! # use rmem::memory::Memory;
//! # use rmem::store::{Namespace, Role, StoreUri, open};
//! use rmem::formats::Source;
//! use rmem::problem::{Request, Syntax, generate};
//!
//! # let memory = Memory::new(open(&StoreUri::parse("mem:")?, Role::Local)?, None, Vec::new());
//! # let blocks = Namespace::parse("robmem.blocks")?;
//! # memory.insert(&blocks, vec![doc! { "_id": 1, "name": "A", "on": "B" }, doc! { "_id": 2, "name": "B" }])?;
//! let template = "{% for b in query('robmem.blocks', '{on: {$exists: true}}') %}(on {{ b.name }} {{ b.on }}){% endfor %}";
//! let request = Request {
//!     template: Source::new("example.j2", template),
//!     parts: Vec::new(),
//!     syntax: Syntax::Auto,
//!     collection: blocks,
//!     goal: None,
//!     parameters: Vec::new(),
//!     lenient: false,
//! };
//! let generated = generate(&request, &memory)?;
//! assert_eq!(generated.text, "(on A B)");
//! assert_eq!(generated.sections[0].matched, 1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # A plan, validated
//!
//! [`planner::builtin::solve`] is the built-in planner in this process, which prints as FF does; [`planner::run`] runs
//! any planner in a process of its own, under limits. [`pddl::validate`] simulates a plan:
//!
//! ```
//! use rmem::formats::{Source, pddl::Dialect, plan::ff};
//! use rmem::pddl::{Domain, Problem, Step, Validation, validate};
//! use rmem::planner::{Task, builtin};
//!
//! let domain = "(define (domain lamps) (:requirements :strips)
//!   (:predicates (lit ?lamp))
//!   (:action switch-on :parameters (?lamp) :precondition (and) :effect (lit ?lamp)))";
//! let problem = "(define (problem evening) (:domain lamps) (:objects hall porch) (:init (lit hall)) (:goal (lit porch)))";
//! let domain = Domain::read(&Source::new("domain.pddl", domain), Dialect::default()).unwrap();
//! let problem = Problem::read(&Source::new("problem.pddl", problem), &domain, Dialect::default()).unwrap();
//!
//! let mut printed = String::new();
//! let task = Task { domain: &domain, problem: &problem };
//! let code = builtin::solve(&task, builtin::Options::default(), &mut |text| printed.push_str(text));
//! assert_eq!(code, 0);
//!
//! let steps: Vec<Step> = ff::read(&printed, "").actions.into_iter().map(Step::from).collect();
//! assert_eq!(steps.len(), 1);
//! assert_eq!(validate(&domain, &problem, &steps), Validation::Valid { value: Some(1.0) });
//! assert!(matches!(validate(&domain, &problem, &[]), Validation::Invalid(_)));
//! ```

pub mod cli;
pub mod settings;

pub mod commands;

pub mod bench;
#[cfg(feature = "serve")]
pub mod serve;

pub mod memory;
pub mod store;

#[cfg(feature = "mongodb")]
pub mod backend;

pub mod query;

pub mod problem;

pub mod pddl;

pub mod planner;

pub mod planning;

pub mod plan;

pub mod process;

pub mod clips;

pub mod scene;
pub mod views;

mod calendar;

pub mod formats;

pub mod input;
pub mod output;

mod deadline;
pub mod error;
pub mod exit;
pub mod fault;
pub mod interrupt;
mod monotonic;
mod saturate;

use std::ffi::OsString;
use std::io::{BufRead, Write};
use std::path::{Path, PathBuf};

use clap::error::{ContextKind, ContextValue, ErrorKind};
use commands::{Context, report};
use exit::Exit;
use formats::mongosh::DATABASE;
use output::Output;
use process::supervisor;
use settings::{Environment, Flags, Origin, Settings};

/// What a process gives to [`run`]: its streams and surroundings, as values.
pub struct Process<'a> {
    /// Standard input.
    pub stdin: &'a mut dyn BufRead,
    /// Standard output: the product.
    pub stdout: &'a mut dyn Write,
    /// Standard error: messages.
    pub stderr: &'a mut dyn Write,
    /// Writes a message to standard error while something else is waited for, from any thread.
    pub tell_at_once: fn(&str),
    /// Whether stdout is a terminal: tables instead of JSON lines.
    pub stdout_is_terminal: bool,
    /// Whether the reader of stdout has closed it.
    pub stdout_is_closed: fn() -> bool,
    /// Whether stderr is a terminal: colours.
    pub stderr_is_terminal: bool,
    /// Width of the terminal that stdout is, in columns.
    pub stdout_columns: Option<usize>,
    /// The environment variables.
    pub environment: Environment,
    /// The working directory.
    pub directory: PathBuf,
    /// The program itself, for child processes.
    pub executable: PathBuf,
}

/// Runs a command line and says how it ended. Can be called any number of times.
pub fn run(args: impl IntoIterator<Item = OsString>, process: Process<'_>) -> Exit {
    let mut args: Vec<OsString> = args.into_iter().collect();
    if args.get(1).is_some_and(|word| word == supervisor::COMMAND) {
        match supervisor::run(args.into_iter().skip(2), &process.executable) {
            supervisor::Next::Rmem(words) => args = words,
            supervisor::Next::Exit(code) => return Exit::Passed(u8::try_from(code).unwrap_or(u8::MAX)),
        }
    }
    let mut output = Output::new(process.stdout, process.stderr);
    let given: Vec<String> = args.iter().filter_map(|arg| arg.to_str().map(str::to_owned)).collect();
    let database = || default_database(&given, &process.environment, &process.directory);
    let mut cli = match cli::parse(args, database) {
        Ok(cli) => cli,
        Err(error) => return explain(&error, &mut output),
    };
    let flags = cli.global.into();
    let settings = match Settings::resolve(&flags, &process.environment, &process.directory, process.stderr_is_terminal)
    {
        Ok(settings) => settings,
        Err(error) => return report(&error, &mut output),
    };
    if let Err(error) = output.configure(settings.verbosity, settings.color, settings.log.value.as_deref()) {
        return report(&error, &mut output);
    }
    if output.shows_notes() {
        store::embedded::tell_waits(process.tell_at_once);
    }
    output.on_terminal(process.stderr_is_terminal);
    output.stdout_on_terminal(process.stdout_is_terminal);
    output.closed_by(process.stdout_is_closed);
    let mut context = Context::new(
        settings,
        output,
        process.stdin,
        process.stdout_is_terminal,
        process.stdout_columns,
        process.executable,
        process.environment,
        cli::command,
    );
    context.author = format!("rmem {}", cli.name);
    warn_of_format(&cli.name, &cli.formats, &mut context);
    let result = commands::run(&mut cli.command, &mut context);
    context.report_operations();
    let result = result.and_then(|exit| match context.output.flush() {
        // Whoever interrupts a command does not wait for its output, which may have nowhere to go.
        Err(error) if exit != Exit::Interrupted => Err(error.into()),
        _ => Ok(exit),
    });
    match result {
        Ok(exit) => exit,
        Err(error) => report(&error, &mut context.output),
    }
}

/// Warns of a format of the environment that a command does not have. One of `rmem.toml` is for the commands that have it.
fn warn_of_format(command: &str, formats: &[String], context: &mut Context<'_>) {
    let format = &context.settings.format;
    let name = match (format.value, &format.origin) {
        (Some(format), Origin::Environment(_)) if !formats.is_empty() => format.name(),
        _ => return,
    };
    if !formats.iter().any(|own| own == name) {
        let list = formats.join(", ");
        let message = format!("`rmem {command}` has no format `{name}`, which RMEM_FORMAT names; it has {list}");
        context.output.warn(&message);
    }
}

/// The database of the default collection, as far as a command line that cannot be parsed says it.
fn default_database(given: &[String], environment: &Environment, directory: &Path) -> String {
    let value = |flag: &str| {
        let at = given
            .iter()
            .position(|arg| arg.strip_prefix(flag).is_some_and(|rest| rest.is_empty() || rest.starts_with('=')))?;
        match given.get(at)?.split_once('=') {
            Some((_, value)) => Some(value.to_owned()),
            None => given.get(at + 1).cloned(),
        }
    };
    let flags =
        Flags { collection: value("--collection"), config: value("--config").map(PathBuf::from), ..Flags::default() };
    let settings = Settings::resolve(&flags, environment, directory, false);
    settings.map_or_else(|_| DATABASE.to_owned(), |settings| settings.collection.value.database)
}

/// Help and version go to stdout; mistakes, to stderr.
fn explain(error: &clap::Error, output: &mut Output<'_>) -> Exit {
    let text = error.render();
    if error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        // The help is what is missing.
        output.pass_on(text.to_string().as_bytes());
        return Exit::Usage;
    }
    if error.use_stderr() {
        let mut text = text.to_string();
        if let (Some(ContextValue::String(line)), Some(_)) =
            (error.get(ContextKind::InvalidValue), error.get(ContextKind::Suggested))
        {
            // The line is long enough to be said once.
            text = text.replace(&format!("': `{line}` is"), "': it is");
        }
        output.error(text.trim_start_matches("error: ").trim_end());
        return Exit::Usage;
    }
    let written = output.stdout().write_all(text.to_string().as_bytes()).and_then(|()| output.flush());
    match written {
        Ok(()) => Exit::Done,
        Err(error) => report(&error.into(), output),
    }
}
