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
use crate::store::{Checked, StoreError};

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
    let settings = context.settings.file.as_ref().map_or("none".to_owned(), |path| path.display().to_string());
    report.add(Row::fact("settings", None, &settings), context)?;

    let stores = open(context);
    let is_open = stores.iter().all(|store| store.counted.is_ok());
    let deep = if args.deep && is_open { Some(Deep::check(context)?) } else { None };
    let is_sound = deep.as_ref().is_none_or(Deep::is_sound);
    let healthy = is_open && is_sound;
    for Opened { check, address, counted } in stores {
        let is_fine = counted.is_ok() && is_sound;
        let word = if is_fine { "ok" } else { "damaged" };
        let state =
            counted.map_or_else(|error| error, |count| format!("{word}, {}", amount(count as u64, "collection")));
        report.add(Row { is_fine: Some(is_fine), ..Row::fact(check, Some(&address), &state) }, context)?;
    }
    #[cfg(feature = "serve")]
    if let Some(server) = super::serve::server(&context.settings) {
        let state = format!("by process {} at {}", server.process, server.uris);
        report.add(Row::fact("served", None, &state), context)?;
    }

    if let Some(deep) = deep {
        deep.tell(&mut report, context)?;
    }

    let memory = if healthy { context.memory().ok() } else { None };
    let computables = trial::computables(&asked, memory.as_ref(), context);
    let files = trial::files(&args.domain, &args.template, &args.options, memory.as_ref(), context)?;
    let planners = trial::planners(context)?;
    let mut is_fine = true;
    for Trial { check, name, state, is_fine: is_well } in [computables, files, planners].into_iter().flatten() {
        report.add(Row { is_fine: Some(is_well), ..Row::fact(check, Some(&name), &state) }, context)?;
        is_fine &= is_well;
    }
    report.end(context)?;
    Ok(match (healthy, is_fine) {
        (false, _) => Exit::Store,
        (true, false) => Exit::No,
        (true, true) => Exit::Done,
    })
}

/// A store that was opened.
struct Opened {
    check: &'static str,
    address: String,
    /// How many collections it has, or why that is not known.
    counted: Result<usize, String>,
}

/// Opens the private store and, where databases are shared, the shared one.
fn open(context: &mut Context<'_>) -> Vec<Opened> {
    let memory = match context.memory() {
        Ok(memory) => memory,
        Err(error) => {
            let address = context.settings.memory.value.as_deref().map_or("none".to_owned(), super::config::address);
            return vec![Opened { check: "memory", address, counted: Err(format!("{error:#}")) }];
        }
    };
    let stores = ["memory", "shared"].into_iter().zip(memory.collection_counts());
    stores
        .map(|(check, (address, counted))| Opened {
            check,
            address,
            counted: counted.map_err(|error| error.to_string()),
        })
        .collect()
}

/// What a check of all data found.
struct Deep {
    damages: Vec<String>,
    checked: Result<Vec<(String, Option<Checked>)>, StoreError>,
}

impl Deep {
    /// Checks the stores.
    fn check(context: &mut Context<'_>) -> Result<Self> {
        let mut damages = Vec::new();
        let checked = context.memory()?.check(|damage| damages.push(damage.to_owned()));
        Ok(Self { damages, checked })
    }

    /// Whether nothing is damaged.
    fn is_sound(&self) -> bool {
        self.damages.is_empty() && self.checked.is_ok()
    }

    fn tell(self, report: &mut Report, context: &mut Context<'_>) -> Result<()> {
        for damage in &self.damages {
            report.add(Row { is_fine: Some(false), ..Row::fact("damage", None, damage) }, context)?;
        }
        for (address, checked) in self.checked? {
            let Some(checked) = checked else {
                report.add(Row::fact("checked", Some(&address), "not here; a server checks itself"), context)?;
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
            report.add(Row::fact("checked", Some(&address), &counts), context)?;
        }
        Ok(())
    }
}

/// Something that was looked at; a line like `planner    ff: ok`.
struct Row<'a> {
    check: &'a str,
    /// Which one, where there are several.
    name: Option<&'a str>,
    state: &'a str,
    /// Whether it is well, where that is a question.
    is_fine: Option<bool>,
}

impl<'a> Row<'a> {
    /// A row that is neither well nor wrong.
    fn fact(check: &'a str, name: Option<&'a str>, state: &'a str) -> Self {
        Self { check, name, state, is_fine: None }
    }
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

    fn add(&mut self, row: Row<'_>, context: &mut Context<'_>) -> Result<()> {
        let Row { check, name, state, is_fine } = row;
        if self.is_json {
            self.found.push(doc! { "check": check, "name": name, "ok": is_fine, "state": state }.into());
            return Ok(());
        }
        let name = name.map(|name| format!("{name}: ")).unwrap_or_default();
        Ok(context.output.line(&format!("{check:<10} {name}{state}"))?)
    }

    fn end(self, context: &mut Context<'_>) -> Result<()> {
        if self.is_json {
            context.output.line(&shell::pretty(&Bson::Array(self.found)))?;
        }
        Ok(())
    }
}
