//! rmem: a document-oriented robot memory on the command line.
//!
//! The story, in the order data flows: a command line ([`cli`]) and settings
//! ([`settings`]) become a command ([`commands`]). It asks a [`memory`], which
//! routes operations to [`store`]s that answer MongoDB's languages ([`query`]);
//! servers that a robot runs itself are started by `backend`.
//! Templates whose sections are queries become PDDL problems ([`problem`]),
//! checked against a domain ([`pddl`]); a [`planner`], a program run as a [`process`],
//! turns a problem into a [`plan`], which is simulated, stored as a document and printed. Documents
//! become [`facts`] of CLIPS, and facts documents; `engine` is a CLIPS that works on the memory by itself. Text on either side is read
//! and written in [`formats`]. What rmem is given comes through [`input`], what
//! the user sees goes through [`output`], and a command ends with a code of
//! [`exit`].
//!
//! The library is silent: it prints, reads the environment and exits only
//! through what [`run`] is given.

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

pub mod formats;

pub mod input;
pub mod output;

pub mod exit;
pub mod interrupt;

use std::ffi::OsString;
use std::io::{BufRead, Write};
use std::path::PathBuf;

use clap::FromArgMatches as _;

use commands::Context;
use exit::Exit;
use output::Output;
use process::supervisor;
use settings::{Environment, Settings};

/// What a process gives to [`run`]: its streams and surroundings, as values.
pub struct Process<'a> {
    /// Standard input.
    pub stdin: &'a mut dyn BufRead,
    /// Standard output: the product.
    pub stdout: &'a mut dyn Write,
    /// Standard error: what is said about it.
    pub stderr: &'a mut dyn Write,
    /// Whether stdout is a terminal: tables instead of JSON lines.
    pub stdout_is_terminal: bool,
    /// Whether stderr is a terminal: colours.
    pub stderr_is_terminal: bool,
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
    let parsed = cli::command().try_get_matches_from(args).and_then(|matches| cli::Cli::from_arg_matches(&matches));
    let cli = match parsed {
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
    let mut context = Context::new(
        settings,
        output,
        process.stdin,
        process.stdout_is_terminal,
        process.executable,
        process.environment,
        cli::command,
    );
    let result = commands::run(&cli.command, &mut context);
    context.output.tell_operations();
    let result = result.and_then(|exit| context.output.flush().map(|()| exit).map_err(Into::into));
    match result {
        Ok(exit) => exit,
        Err(error) => report(&error, &mut context.output),
    }
}

/// Help and version go to stdout; mistakes, to stderr.
fn explain(error: &clap::Error, output: &mut Output<'_>) -> Exit {
    let text = error.render();
    if error.use_stderr() {
        output.error(text.to_string().trim_start_matches("error: ").trim_end());
        return Exit::Usage;
    }
    let written = output.stdout().write_all(text.to_string().as_bytes()).and_then(|()| output.flush());
    match written {
        Ok(()) => Exit::Done,
        Err(error) => report(&error.into(), output),
    }
}

/// Says what went wrong, its causes each on a line.
fn report(error: &anyhow::Error, output: &mut Output<'_>) -> Exit {
    if output::is_broken_pipe(error) {
        // The reader of stdout has seen enough: a graceful end.
        return Exit::Done;
    }
    // What was found before the failure is still the product.
    let _ = output.flush();
    if let Some(formats::Diagnostics(complaints)) = error.downcast_ref() {
        for complaint in complaints {
            output.error(&complaint.to_string());
        }
        return Exit::of(error);
    }
    let mut text = error.to_string();
    for cause in error.chain().skip(1) {
        let cause = cause.to_string();
        if !text.contains(&cause) {
            text.push_str("\n  caused by: ");
            text.push_str(&cause);
        }
    }
    output.error(&text);
    Exit::of(error)
}
