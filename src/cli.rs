//! The command line as types; no behaviour.
//!
//! The doc comment of a type is its help text. What a flag means beyond its
//! spelling is decided in `commands/`; how it is layered over the environment
//! and `rmem.toml`, in `settings`.

mod backend;
mod bench;
mod clips_run;
mod computables;
mod expire;
mod import_problem;
mod index;
mod plan;
pub mod quantity;
mod watch;

use std::path::PathBuf;
use std::time::Duration;

use clap::builder::NonEmptyStringValueParser;
use clap::{Args, CommandFactory as _, Parser, Subcommand, ValueEnum};

use crate::exit::TABLE;
use crate::output::Format;
use crate::store::Namespace;

pub use backend::{Backend, BackendCommand, BackendName, BackendUp};
pub use bench::Bench;
pub use clips_run::{ClipsRun, HELP as CLIPS_RUN_HELP, WORLD};
pub use computables::Computables;
pub use expire::Expire;
pub use import_problem::ImportProblem;
pub use index::Index;
pub use plan::{
    Layout, Plan, PlanCheck, PlanCommand, PlanEffort, PlanImport, PlanList, PlanRerun, PlanSearch, PlanShow, PlanState,
    PlanStep, PlanTask,
};
pub use watch::Watch;

/// A document-oriented robot memory: PDDL problems from queries, plans back into the memory
#[derive(Debug, Parser)]
#[command(name = "rmem", version, propagate_version = true, max_term_width = 100, disable_help_subcommand = false)]
#[command(after_help = "Exit codes: rmem help exit-codes")]
pub struct Cli {
    /// What holds for every command.
    #[command(flatten)]
    pub global: Global,
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The command line with the parts of its help that are computed.
#[must_use]
pub fn command() -> clap::Command {
    let codes: Vec<String> = TABLE.iter().map(|(exit, meaning)| format!("{:>5}  {meaning}", exit.code())).collect();
    Cli::command().mut_subcommand("exit-codes", |command| {
        let about = format!("Print the table of exit codes\n\n{}", codes.join("\n"));
        command.long_about(about).after_help("Example:\n  rmem help exit-codes")
    })
}

/// What holds for every command.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Global options")]
pub struct Global {
    /// The local store: file:PATH, mem:, or mongodb://… [env: RMEM_MEMORY]
    #[arg(long, global = true, value_name = "URI")]
    pub memory: Option<String>,
    /// The store of shared databases [env: RMEM_SHARED]
    #[arg(long, global = true, value_name = "URI")]
    pub shared: Option<String>,
    /// Settings; else the nearest rmem.toml upwards, then the user's [env: RMEM_CONFIG]
    #[arg(long, global = true, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Put a world file into the memory before the command runs (can be repeated)
    #[arg(long, global = true, value_name = "WORLD")]
    pub load: Vec<PathBuf>,
    /// How results are printed [env: RMEM_FORMAT]
    #[arg(long, global = true, value_name = "FORMAT", hide_possible_values = true)]
    pub format: Option<Format>,
    /// The namespace where none is given [env: RMEM_COLLECTION]
    #[arg(long, global = true, value_name = "NS")]
    pub collection: Option<String>,
    /// Say nothing but errors
    #[arg(short, long, global = true, conflicts_with = "verbose", overrides_with = "quiet")]
    pub quiet: bool,
    /// Say each operation and how long it took
    #[arg(short, long, global = true, overrides_with = "verbose")]
    pub verbose: bool,
    /// Colour messages: auto, always, never [env: NO_COLOR]
    #[arg(long, global = true, value_name = "WHEN", hide_possible_values = true)]
    pub color: Option<Color>,
    /// Append each operation to FILE as JSON lines [env: RMEM_LOG]
    #[arg(long, global = true, value_name = "FILE")]
    pub log: Option<PathBuf>,
}

/// When to colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Color {
    /// On a terminal.
    Auto,
    /// Always.
    Always,
    /// Never.
    Never,
}

/// The commands, in the order of the help.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Store documents; prints their ids
    #[command(after_help = "Example:\n  rmem insert robmem.worldmodel \"{relation: 'on-table', object: 'A'}\"")]
    Insert(Insert),
    /// Print the documents that match
    #[command(after_help = "Example:\n  rmem query robmem.worldmodel \"{relation: 'on'}\" --sort '{object_top: 1}'")]
    Query(Query),
    /// Count the documents that match
    #[command(after_help = "Example:\n  rmem count robmem.worldmodel \"{relation: 'on'}\"")]
    Count(Count),
    /// Print the distinct values of a field
    #[command(after_help = "Example:\n  rmem distinct robmem.worldmodel object \"{relation: 'on-table'}\"")]
    Distinct(Distinct),
    /// Run an aggregation pipeline
    #[command(
        after_help = "Example:\n  rmem aggregate robmem.worldmodel \"[{\\$group: {_id: '\\$relation', n: {\\$sum: 1}}}]\""
    )]
    Aggregate(Aggregate),
    /// Change documents: operators, a replacement, or a pipeline
    #[command(
        after_help = "Example:\n  rmem update robmem.worldmodel \"{object: 'A'}\" \"{\\$set: {color: 'red'}}\" --many"
    )]
    Update(Update),
    /// Remove the documents that match
    #[command(after_help = "Example:\n  rmem delete robmem.worldmodel \"{relation: 'holding'}\"")]
    Delete(Delete),
    /// Make an index, remove one, or list them
    #[command(
        after_help = "Examples:\n  rmem index robmem.objects '{name: 1}' --unique\n  rmem index robmem.sightings '{seen: 1}' --ttl 1h\n  rmem index robmem.objects\n  rmem index robmem.objects '{name: 1}' --drop\n\n\
Prints the name of the index. A unique index refuses documents whose key is taken (exit code 5), and\n\
is not made where two documents have one already. What became due by --ttl is removed by later\n\
writers and by rmem expire; on MongoDB, by the server."
    )]
    Index(Index),
    /// List the collections
    #[command(after_help = "Example:\n  rmem collections")]
    Collections,
    /// Remove a whole collection
    #[command(after_help = "Example:\n  rmem drop robmem.worldmodel")]
    Drop(Drop),
    /// Write namespaces as a world file, or as a folder that MongoDB's tools read
    #[command(
        after_help = "Examples:\n  rmem dump robmem.worldmodel -o world.json\n  rmem dump --all -o backup --gzip\n  rmem dump --all -o backup.archive --archive\n\n\
A path that ends in .json, and -, is a world file; any other path is a folder with\n\
DATABASE/COLLECTION.bson and .metadata.json, as mongodump writes it. The folder may not be\n\
there yet, and appears whole or not at all. It keeps documents with their metadata; a world\n\
file leaves out when they were stored and changed. What computables made is left out."
    )]
    Dump(Dump),
    /// Put a dump into the memory: verified first, whoever wrote it
    #[command(
        after_help = "Examples:\n  rmem restore world.json\n  rmem restore backup --dry-run\n  rmem restore dump/robmem/blocks.bson --into robmem.copy --drop\n\n\
Reads world files, folders of rmem and of mongodump (also the folder of one database, or one\n\
.bson file), archives, plain or packed with gzip. Nothing is changed where anything in them is wrong.\n\
Documents are put beside those that are there: new ones are inserted, different ones replace\n\
what has their _id, equal ones are skipped. With --drop, each collection is replaced as a\n\
whole, with its indexes, once everything is stored. Metadata is restored, but for the dates:\n\
a document counts as inserted when it is restored."
    )]
    Restore(Restore),
    /// Compare two world files, dumps or memories
    #[command(after_help = "Example:\n  rmem diff world.json file:robot.rmem\n\n\
Prints a line a document that is only in A (-), only in B (+), or different (~); exits with 0\n\
where there is none, else with 1. Documents are paired by namespace and _id; metadata does\n\
not count. A and B are files, folders, or URIs: file:PATH, mongodb://…, mem:.")]
    Diff(Diff),
    /// Lock a name, so that no other robot does
    #[command(
        after_help = "Examples:\n  rmem lock table --owner r1 --ttl 30s\n  rmem lock table --owner r1 --wait 1m && { pick-up; rmem unlock table --owner r1; }\n\n\
The owner who holds the lock may lock again, which renews it. Where it is held by another,\n\
exits with 5. Without --owner it is $USER@$HOSTNAME from the environment, and where these are\n\
not set, it has to be given; two processes with one owner do not exclude each other. Locks\n\
are documents {_id: NAME, locked, \"locked-by\", \"lock-time\", \"lock-until\"} in the collection\n\
mutexes of the first of shared_databases, or of robmem where none is shared."
    )]
    Lock(Lock),
    /// Unlock a name
    #[command(
        after_help = "Example:\n  rmem unlock table --owner r1\n\nExits with 5 where another owner holds it, with 1 where nobody does. About --owner, see rmem help lock."
    )]
    Unlock(Unlock),
    /// Follow the changes of a collection: triggers
    #[command(after_help = watch::HELP)]
    Watch(Watch),
    /// Start, look at and stop the mongod processes of this robot
    #[command(
        after_help = "Examples:\n  rmem backend up\n  rmem backend status --format table\n  rmem backend down shared"
    )]
    Backend(Backend),
    /// List the computables, or say which would run for a query
    #[command(
        after_help = "Examples:\n  rmem computables\n  rmem computables --check robmem.blocks \"{relation: 'on-table'}\"\n\n\
Computables are [[computable]] tables in rmem.toml: a name, a collection, a spec, and a pipeline, a\n\
command or a builtin (transform, nearest). One runs when a query, count, distinct, aggregate or template\n\
asks its collection a query that, as a document, matches its spec; its documents are stored there, and\n\
for the time of its cache an equal query computes nothing, unless they were changed or removed.\n\
--check computes nothing.\n\n\
A pipeline may use the asked query: '$$query.KEY' is the value of a key in an expression, nothing\n\
where the query has no such key; in a filter or $limit it stands for the value as it is:\n\n\
[[computable]]\n\
name = \"below\"\n\
collection = \"robmem.blocks\"\n\
spec = \"{below: {$exists: true}}\"\n\
pipeline = \"[{$match: {z: {$lt: '$$query.below'}}}, {$project: {_id: 0, block: 1, below: '$$query.below'}}]\""
    )]
    Computables(Computables),
    /// Generate a PDDL problem from a template whose sections are queries
    #[command(
        after_help = "Examples:\n  rmem gen-problem --template problem.pddl.j2 --domain domain.pddl --goal '(on A B)' -o problem.pddl\n  rmem gen-problem --template problem.pddl.j2 --explain '(on A B)'\n\n\
--explain names the line of the template, the query and the document behind each place where the\n\
problem says so; exits with 1 where it does not."
    )]
    GenProblem(GenProblem),
    /// Turn a PDDL problem into documents, and a template that makes an equal problem of them
    #[command(after_help = import_problem::HELP)]
    ImportProblem(ImportProblem),
    /// Find a plan, check it, store it, print it
    #[command(
        after_help = "Examples:\n  rmem plan --domain domain.pddl --template problem.pddl.j2 --goal '(on A B)'\n  rmem gen-problem --template problem.pddl.j2 | rmem plan --domain domain.pddl --problem -\n  rmem plan --domain domain.pddl --template problem.pddl.j2 --watch\n\n\
With --watch, rmem prints a plan and stays. When a collection changes that the template asks, or that\n\
pipelines of its computables are made from, or a step is noted as ended, the steps that are not done\n\
are simulated from the memory as it is then; a plan that holds is left alone, any other is replaced\n\
by a new one, stored and printed. While a step is noted as begun (plan step ID N --started), the\n\
world is in between, and nothing is done until it is noted as ended. Ends when it is interrupted."
    )]
    Plan(Plan),
    /// Run the built-in planner, speaking FF
    #[command(after_help = "Example:\n  rmem ff -o domain.pddl -f problem.pddl")]
    Ff(Ff),
    /// Check a domain, a problem, and simulate a plan
    #[command(after_help = "Example:\n  rmem validate domain.pddl problem.pddl plan.txt")]
    Validate(Validate),
    /// Turn documents into CLIPS facts, and facts into documents
    #[command(
        after_help = "Examples:\n  rmem clips export robmem.worldmodel \"{relation: 'on'}\" --as deffacts world -o world.clp\n  rmem clips import facts.txt --into robmem.worldmodel"
    )]
    Clips(Clips),
    /// Remove what decayed, and what is not to outlive a restart
    #[command(
        after_help = "Example:\n  rmem insert robmem.sightings \"{object: 'cup', _robmem_info: {decay_time: ISODate('2030-01-01')}}\"\n  rmem expire\n  rmem expire --restart\n\n\
Removes documents whose _robmem_info.decay_time is past, what computables made and may not be\n\
used any more, and what is due by rmem index --ttl; with --restart, also what was stored with\n\
_robmem_info: {persistent: false}. Prints how many, a line a collection. What decayed is invisible\n\
without it: it is removed by later writers, on MongoDB by the server, within a minute or so."
    )]
    Expire(Expire),
    /// Measure how fast the memory is
    #[command(
        after_help = "Examples:\n  rmem bench\n  rmem bench --against mongodb://127.0.0.1:27017 --plot figures\n\n\
Times the work of a robot that tidies up, side by side on an embedded memory and, with --against, on a\n\
MongoDB server: through the driver alone with journaled writes, and through rmem. Prints medians in\n\
microseconds, how many times faster the embedded memory is than the server, and by how many percent\n\
rmem on the server is slower than the driver alone."
    )]
    Bench(Bench),
    /// Print the settings in force, and where each came from
    #[command(after_help = "Example:\n  rmem config")]
    Config,
    /// Say whether store, planners and settings are in order
    #[command(after_help = "Example:\n  rmem doctor")]
    Doctor,
    /// Print a shell's completion script
    #[command(after_help = "Example:\n  rmem completions bash > ~/.local/share/bash-completion/completions/rmem")]
    Completions(Completions),
    /// Print the manual page
    #[command(after_help = "Example:\n  rmem man > rmem.1")]
    Man,
    /// Print the table of exit codes
    ExitCodes,
}

/// `insert`
#[derive(Debug, Args)]
pub struct Insert {
    /// Where: DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// Documents in shell syntax or Extended JSON; none or - reads stdin
    #[arg(value_name = "DOC")]
    pub documents: Vec<String>,
    /// Read documents from FILE
    #[arg(short, long, value_name = "FILE", conflicts_with = "documents")]
    pub file: Option<PathBuf>,
}

/// `query`
#[derive(Debug, Args)]
pub struct Query {
    /// Where: DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// Which documents; all where it is left out
    #[arg(value_name = "QUERY", default_value = "{}", hide_default_value = true)]
    pub query: String,
    /// Keys with 1 or -1
    #[arg(long, value_name = "SORT")]
    pub sort: Option<String>,
    /// At most N documents
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    pub limit: u64,
    /// Pass over the first N
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    pub skip: u64,
    /// Which fields: {name: 1} or {name: 0}
    #[arg(long, value_name = "PROJECTION")]
    pub fields: Option<String>,
    /// Show the memory's metadata, `_robmem_info`
    #[arg(long)]
    pub meta: bool,
    /// Instead of documents, say how they are found: by which index, and how much was looked at
    #[arg(long)]
    pub explain: bool,
}

/// `count`
#[derive(Debug, Args)]
pub struct Count {
    /// Where: DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// Which documents; all where it is left out
    #[arg(value_name = "QUERY", default_value = "{}", hide_default_value = true)]
    pub query: String,
}

/// `distinct`
#[derive(Debug, Args)]
pub struct Distinct {
    /// Where: DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// A field, or a path with dots
    #[arg(value_name = "FIELD")]
    pub field: String,
    /// Among which documents; all where it is left out
    #[arg(value_name = "QUERY", default_value = "{}", hide_default_value = true)]
    pub query: String,
}

/// `aggregate`
#[derive(Debug, Args)]
pub struct Aggregate {
    /// Where: DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// An array of stages
    #[arg(value_name = "PIPELINE")]
    pub pipeline: String,
}

/// `update`
#[derive(Debug, Args)]
pub struct Update {
    /// Where: DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// Which documents
    #[arg(value_name = "QUERY")]
    pub query: String,
    /// Operators, a replacement, or a pipeline
    #[arg(value_name = "UPDATE")]
    pub update: String,
    /// All matches, not only the first
    #[arg(long)]
    pub many: bool,
    /// Insert where nothing matches
    #[arg(long)]
    pub upsert: bool,
    /// What `$[identifier]` stands for (can be repeated)
    #[arg(long = "array-filter", value_name = "QUERY")]
    pub array_filters: Vec<String>,
}

/// `delete`
#[derive(Debug, Args)]
pub struct Delete {
    /// Where: DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// Which documents; an empty query needs --all
    #[arg(value_name = "QUERY", default_value = "{}", hide_default_value = true)]
    pub query: String,
    /// The first match only
    #[arg(long)]
    pub one: bool,
    /// Really all documents of the collection
    #[arg(long, conflicts_with = "one")]
    pub all: bool,
}

/// `drop`
#[derive(Debug, Args)]
pub struct Drop {
    /// Which collection: DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
}

/// `dump`
#[derive(Debug, Args)]
pub struct Dump {
    /// Which collections
    #[arg(value_name = "NS", required_unless_present = "all")]
    pub namespaces: Vec<Namespace>,
    /// Every collection
    #[arg(long, conflicts_with = "namespaces")]
    pub all: bool,
    /// A world file (.json, or - for stdout), or a folder
    #[arg(short, long, value_name = "PATH", default_value = "-")]
    pub output: PathBuf,
    /// Write one file, as mongodump --archive does
    #[arg(long)]
    pub archive: bool,
    /// Pack the files of a folder, or the archive
    #[arg(long)]
    pub gzip: bool,
}

/// `restore`
#[derive(Debug, Args)]
pub struct Restore {
    /// A world file, a folder, an archive, or a .bson file; - is a world file on stdin
    #[arg(value_name = "PATH")]
    pub path: PathBuf,
    /// Where the dump of one collection goes instead
    #[arg(long, value_name = "NS")]
    pub into: Option<Namespace>,
    /// Replace collections as a whole
    #[arg(long)]
    pub drop: bool,
    /// Only say what would be done
    #[arg(long)]
    pub dry_run: bool,
}

/// `diff`
#[derive(Debug, Args)]
pub struct Diff {
    /// The first: a world file, a dump, or the URI of a memory
    #[arg(value_name = "A")]
    pub first: String,
    /// The second
    #[arg(value_name = "B")]
    pub second: String,
}

/// `lock`
#[derive(Debug, Args)]
pub struct Lock {
    /// What is locked
    #[arg(value_name = "NAME", value_parser = NonEmptyStringValueParser::new())]
    pub name: String,
    /// Who locks and where; shared with `unlock`.
    #[command(flatten)]
    pub holder: HolderOptions,
    /// The lock expires after so long
    #[arg(long, value_name = "DURATION", value_parser = quantity::duration)]
    pub ttl: Option<Duration>,
    /// Wait so long for whoever holds it
    #[arg(long, value_name = "DURATION", value_parser = quantity::duration)]
    pub wait: Option<Duration>,
}

/// `unlock`
#[derive(Debug, Args)]
pub struct Unlock {
    /// What is unlocked
    #[arg(value_name = "NAME", value_parser = NonEmptyStringValueParser::new())]
    pub name: String,
    /// Who unlocks and where; shared with `lock`.
    #[command(flatten)]
    pub holder: HolderOptions,
}

/// Who locks, and in which collection.
#[derive(Debug, Clone, Default, Args)]
pub struct HolderOptions {
    /// Who holds the lock
    #[arg(long, value_name = "OWNER", value_parser = NonEmptyStringValueParser::new())]
    pub owner: Option<String>,
    /// The collection of locks
    #[arg(long, value_name = "NS")]
    pub into: Option<Namespace>,
}

/// What a template needs; shared by `gen-problem` and `plan`.
#[derive(Debug, Clone, Default, Args)]
pub struct TemplateOptions {
    /// The problem's goal, as PDDL
    #[arg(long, value_name = "GOAL", allow_hyphen_values = true)]
    pub goal: Option<String>,
    /// A parameter: NAME=TEXT, or NAME:=JSON for other types (can be repeated)
    #[arg(short = 'D', long = "define", value_name = "NAME=VALUE", value_parser = definition)]
    pub definitions: Vec<Definition>,
    /// How the template is spelled: auto, minijinja, marker
    #[arg(long, value_name = "SYNTAX", default_value = "auto", hide_possible_values = true)]
    pub syntax: TemplateSyntax,
    /// Take what is wrong as the Fawkes original did: unknown keys are empty
    #[arg(long)]
    pub lenient: bool,
    /// A section that matches no document is an error
    #[arg(long)]
    pub strict: bool,
}

/// How a template is spelled.
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

/// `gen-problem`
#[derive(Debug, Args)]
pub struct GenProblem {
    /// The template; - is stdin
    #[arg(short, long, value_name = "FILE")]
    pub template: PathBuf,
    /// Check the problem against this domain
    #[arg(short, long, value_name = "FILE")]
    pub domain: Option<PathBuf>,
    /// What the template is given.
    #[command(flatten)]
    pub options: TemplateOptions,
    /// The problem file to write, whole or not at all
    #[arg(short, long, value_name = "FILE", default_value = "-")]
    pub output: PathBuf,
    /// Instead of the problem, tell what is behind an atom like '(on A B)', a number, or an object
    #[arg(long, value_name = "ATOM", conflicts_with = "output")]
    pub explain: Option<String>,
}

/// `ff`
#[derive(Debug, Args)]
#[command(disable_help_flag = true)]
pub struct Ff {
    /// The domain (FF's operator file)
    #[arg(short = 'o', value_name = "DOMAIN")]
    pub domain: PathBuf,
    /// The problem (FF's fact file)
    #[arg(short = 'f', value_name = "PROBLEM")]
    pub problem: PathBuf,
    /// What both names of files begin with, like a folder and its `/`
    #[arg(short = 'p', value_name = "PATH")]
    pub path: Option<PathBuf>,
    /// FF's level of information; ignored
    #[arg(short = 'i', value_name = "N")]
    pub information: Option<String>,
    /// FF's search; ignored, the built-in planner has its own
    #[arg(short = 's', value_name = "N")]
    pub search: Option<String>,
    /// FF's weight of the cost so far; ignored
    #[arg(short = 'g', value_name = "N")]
    pub so_far: Option<String>,
    /// FF's weight of the estimate; ignored
    #[arg(short = 'h', value_name = "N")]
    pub estimate: Option<String>,
    /// FF's weight of the search; ignored
    #[arg(short = 'w', value_name = "N")]
    pub weight: Option<String>,
    /// FF's seed or restarts; ignored
    #[arg(short = 'r', value_name = "N")]
    pub restarts: Option<String>,
    /// FF's switch of enforced hill-climbing; ignored
    #[arg(short = 'E')]
    pub climbing: bool,
    /// FF's switch of its optimization criterion; ignored
    #[arg(short = 'O')]
    pub criterion: bool,
    /// FF's switch of cost minimization; ignored
    #[arg(short = 'C')]
    pub costs: bool,
    /// Print the first plan at once and every better one after it, for as long as there may be one
    #[arg(long)]
    pub anytime: bool,
    /// The files are a task that rmem has checked and written
    #[arg(long, hide = true)]
    pub checked: bool,
    /// Print help
    #[arg(long, action = clap::ArgAction::HelpLong)]
    pub help: Option<bool>,
}

/// `validate`
#[derive(Debug, Args)]
pub struct Validate {
    /// The domain
    #[arg(value_name = "DOMAIN")]
    pub domain: PathBuf,
    /// A problem of it; - is stdin
    #[arg(value_name = "PROBLEM")]
    pub problem: Option<PathBuf>,
    /// A plan for it; - is stdin
    #[arg(value_name = "PLAN")]
    pub plan: Option<PathBuf>,
    /// Take `//` to the end of a line as a comment
    #[arg(long)]
    pub lenient: bool,
}

/// `clips`
#[derive(Debug, Args)]
pub struct Clips {
    /// Which way.
    #[command(subcommand)]
    pub command: ClipsCommand,
}

/// The commands of `clips`.
#[derive(Debug, Subcommand)]
pub enum ClipsCommand {
    /// Write documents as facts
    #[command(
        after_help = "Examples:\n  rmem clips export robmem.worldmodel \"{relation: 'on'}\" > facts.txt\n  rmem clips export --deftemplates templates.clp --as deffacts world -o world.clp"
    )]
    Export(ClipsExport),
    /// Store facts as documents, all or none
    #[command(
        after_help = "Example:\n  rmem clips import facts.txt --into robmem.worldmodel --deftemplates templates.clp --key sync-id"
    )]
    Import(ClipsImport),
    /// Run programs of CLIPS with the memory's functions inside
    #[command(after_help = clips_run::HELP)]
    Run(ClipsRun),
}

/// `clips export`
#[derive(Debug, Args)]
pub struct ClipsExport {
    /// Where the documents are: DATABASE.COLLECTION; else --collection
    #[arg(value_name = "NS")]
    pub namespace: Option<String>,
    /// Which documents; all where it is left out
    #[arg(value_name = "QUERY")]
    pub query: Option<String>,
    /// Documents from a file instead of the memory; - is stdin
    #[arg(long, value_name = "FILE", conflicts_with = "namespace")]
    pub from: Option<PathBuf>,
    /// Texts with deftemplates, which decide types (can be repeated)
    #[arg(long, value_name = "FILE")]
    pub deftemplates: Vec<PathBuf>,
    /// facts, for (load-facts); deffacts NAME, for (load); assert
    #[arg(long = "as", value_name = "FORM", num_args = 1..=2, default_value = "facts", hide_default_value = true)]
    pub form: Vec<String>,
    /// What becomes of nested documents and the like: refuse, flatten, json
    #[arg(long, value_name = "HOW", default_value = "refuse", hide_possible_values = true)]
    pub nested: NestedValues,
    /// Every template has to be known
    #[arg(long)]
    pub strict: bool,
    /// The file to write, whole or not at all
    #[arg(short, long, value_name = "FILE", default_value = "-")]
    pub output: PathBuf,
}

/// What becomes of values that no slot of a fact can hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum NestedValues {
    /// They are errors.
    #[default]
    Refuse,
    /// Keys are joined with `_`.
    Flatten,
    /// They are written as JSON, in a string.
    Json,
}

/// `clips import`
#[derive(Debug, Args)]
pub struct ClipsImport {
    /// Facts, deffacts, or a program; - or nothing is stdin
    #[arg(value_name = "FILE", default_value = "-", hide_default_value = true)]
    pub file: PathBuf,
    /// Where the documents go; else --collection
    #[arg(long, value_name = "NS")]
    pub into: Option<Namespace>,
    /// Texts with deftemplates, which are checked and give defaults (can be repeated)
    #[arg(long, value_name = "FILE")]
    pub deftemplates: Vec<PathBuf>,
    /// A slot that tells facts apart: a fact replaces the document with the same value
    #[arg(long, value_name = "SLOT")]
    pub key: Option<String>,
    /// Every template has to be known
    #[arg(long)]
    pub strict: bool,
}

/// `completions`
#[derive(Debug, Args)]
pub struct Completions {
    /// bash, elvish, fish, powershell or zsh
    #[arg(value_name = "SHELL", hide_possible_values = true)]
    pub shell: clap_complete::Shell,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        command().debug_assert();
    }

    #[test]
    fn every_command_has_an_example() {
        fn check(command: &clap::Command) {
            let help = command.clone().render_long_help().to_string();
            assert!(help.contains("Example"), "{} has no example", command.get_name());
            command.get_subcommands().filter(|inner| inner.get_name() != "help").for_each(check);
        }
        command().get_subcommands().for_each(check);
    }

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
