//! `rmem doctor`: whether settings, stores and planners are in order.

mod trial;

use std::path::PathBuf;

use bson::{Bson, doc};
use clap::Args;

use self::trial::Trial;
use super::query::argument;
use super::template::TemplateArgs;
use super::{Context, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::shell;
use crate::output::Format;
use crate::output::amount;
use crate::store::Checked;

/// What stands below the help of `doctor`.
const HELP: &str = "\
Examples:
  rmem doctor
  rmem doctor --domain domain.pddl --template problem.pddl.j2
  rmem doctor --ask \"{compute: 'sum', x: 1, y: 2}\"
  rmem doctor --deep

Runs each planner on a tiny task, each pipeline of a computable, and each program of one: it is asked a query that the \
spec matches, with made-up values where the spec leaves them open, or the query of --ask. A program has at most 10 s. What \
it computes is not stored. Exits with 1 if something that rmem.toml or the command line names does not work. Planners that are not installed are listed.

--deep checks all data in the file of the memory: SQLite's own check, the checksum of every document, every index \
against the documents, and the log of changes. Each damage is a line on stdout, and the command exits with 4; rmem \
repair saves what can be saved. For a MongoDB server, use db.c.validate() in mongosh.";

/// Try the memory, planners, computables, templates and domains
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::TEXT))]
pub struct DoctorArgs {
    /// Read and check all data in the file of the memory
    #[arg(long)]
    pub deep: bool,
    /// Read and check a domain (can be repeated)
    #[arg(long, value_name = "FILE")]
    pub domain: Vec<PathBuf>,
    /// Query for the programs of computables whose spec matches it (can be repeated)
    #[arg(long, value_name = "QUERY")]
    pub ask: Vec<String>,
    /// Render a template from the memory (can be repeated)
    #[arg(long, value_name = "FILE")]
    pub template: Vec<PathBuf>,
    /// What the templates are given.
    #[command(flatten)]
    pub options: TemplateArgs,
}

pub(super) fn run(args: &DoctorArgs, context: &mut Context<'_>) -> Result<Exit> {
    let asked = args.ask.iter().map(|text| argument("<ask>", text)).collect::<Result<Vec<_>, _>>()?;
    let mut report = Report::new(context.format(&formats::TEXT)? == Format::Json);
    let mut healthy = true;
    let settings = context.settings.file.as_ref().map_or("none".to_owned(), |path| path.display().to_string());
    report.add(&format!("settings   {settings}"), context)?;

    let address = context.settings.memory.value.as_deref().map_or("none".to_owned(), super::config::address);
    let state = match context.memory().and_then(|memory| Ok(memory.collections()?.len())) {
        Ok(count) => format!("ok, {}", amount(count as u64, "collection")),
        Err(error) => {
            healthy = false;
            format!("{error:#}")
        }
    };
    report.add(&format!("memory     {address}: {state}"), context)?;
    #[cfg(feature = "serve")]
    if let Some(server) = super::serve::server(&context.settings) {
        report.add(&format!("served     by process {} at {}", server.process, server.uris), context)?;
    }

    if args.deep && healthy {
        healthy = deep(&mut report, context)?;
    }

    let memory = if healthy { context.memory().ok() } else { None };
    let computables = trial::computables(&asked, memory.as_ref(), context);
    let files = trial::files(&args.domain, &args.template, &args.options, memory.as_ref(), context)?;
    let planners = trial::planners(context)?;
    let mut is_fine = print("computable ", &computables, &mut report, context)?;
    is_fine &= print("", &files, &mut report, context)?;
    is_fine &= print("planner    ", &planners, &mut report, context)?;
    report.end(context)?;
    Ok(match (healthy, is_fine) {
        (false, _) => Exit::Store,
        (true, false) => Exit::No,
        (true, true) => Exit::Done,
    })
}

/// Prints trials; returns whether all went well.
fn print(kind: &str, trials: &[Trial], report: &mut Report, context: &mut Context<'_>) -> Result<bool> {
    for Trial { name, state, .. } in trials {
        report.add(&format!("{kind}{name}: {state}"), context)?;
    }
    Ok(trials.iter().all(|trial| trial.is_fine))
}

/// Checks the stores; says whether nothing is damaged.
fn deep(report: &mut Report, context: &mut Context<'_>) -> Result<bool> {
    let memory = context.memory()?;
    let mut damages = Vec::new();
    let checked = memory.check(|damage| damages.push(damage.to_owned()));
    for damage in &damages {
        report.add(&format!("damage     {damage}"), context)?;
    }
    for (address, checked) in checked? {
        let Some(checked) = checked else {
            report.add(&format!("checked    {address}: not here; a server checks itself"), context)?;
            continue;
        };
        let Checked { collections, documents, unsealed, indexes } = checked;
        let old = match unsealed {
            0 => String::new(),
            count => format!(", {count} of them without a checksum (stored by an earlier rmem)"),
        };
        let counts = format!(
            "{}, {}{old}, {}",
            amount(collections, "collection"),
            amount(documents, "document"),
            amount(indexes, "index")
        );
        report.add(&format!("checked    {address}: {counts}"), context)?;
    }
    Ok(damages.is_empty())
}

/// What was found: lines as they come, or documents that are printed as one array.
struct Report {
    is_json: bool,
    found: Vec<Bson>,
}

impl Report {
    fn new(is_json: bool) -> Self {
        Self { is_json, found: Vec::new() }
    }

    /// Adds a line like `planner    ff: ok`: what was looked at, its name, and its state.
    fn add(&mut self, line: &str, context: &mut Context<'_>) -> Result<()> {
        if !self.is_json {
            return Ok(context.output.line(line)?);
        }
        let (check, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let rest = rest.trim_start();
        let (name, state) = rest.split_once(": ").map_or((None, rest), |(name, state)| (Some(name), state));
        let is_trial = !["settings", "served", "checked"].contains(&check);
        let is_fine = is_trial.then(|| state == "ok" || state.starts_with("ok, "));
        self.found.push(doc! { "check": check, "name": name, "ok": is_fine, "state": state }.into());
        Ok(())
    }

    fn end(self, context: &mut Context<'_>) -> Result<()> {
        if self.is_json {
            context.output.line(&shell::pretty(&Bson::Array(self.found)))?;
        }
        Ok(())
    }
}
