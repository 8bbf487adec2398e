//! `plan`: finding plans, and what is done with those that are stored.

use std::path::PathBuf;
use std::time::Duration;

use clap::error::ErrorKind;
use clap::{ArgMatches, Args, Command, Error, FromArgMatches, Subcommand, ValueEnum};

use super::TemplateOptions;
use crate::formats::quantity;
use crate::store::Namespace;

/// `plan`: a search, or a command about stored plans.
#[derive(Debug)]
pub enum Plan {
    /// Find a plan.
    Search(Box<PlanSearch>),
    /// Do something with plans that are stored.
    Stored(PlanCommand),
}

// By hand, because a derived enum would need a word in front of the search.
impl Args for Plan {
    fn augment_args(command: Command) -> Command {
        PlanCommand::augment_subcommands(PlanSearch::augment_args(command)).subcommand_negates_reqs(true)
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for Plan {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, Error> {
        if matches.subcommand_name().is_none() {
            return PlanSearch::from_arg_matches(matches).map(|search| Self::Search(Box::new(search)));
        }
        if matches.contains_id("domain") || matches.contains_id("problem") || matches.contains_id("template") {
            let message = "what is to be planned is said without a command: rmem plan --domain FILE …\n";
            return Err(Error::raw(ErrorKind::ArgumentConflict, message));
        }
        PlanCommand::from_arg_matches(matches).map(Self::Stored)
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

/// The commands about stored plans.
#[derive(Debug, Subcommand)]
pub enum PlanCommand {
    /// Does the rest of a stored plan still reach its goal, from the memory as it is now?
    #[command(
        after_help = "Examples:\n  rmem plan check last\n  rmem plan check 65f0 --format json\n  rmem gen-problem -t now.j2 | rmem plan check last --problem -\n\n\
Exits with 0 where it does, else with 1 and the first broken step and what is false there. The\n\
problem is generated again from the domain, the template, the goal and the parameters that are\n\
kept with the plan; steps that are done are not simulated. The plan of a problem that was a\n\
file says nothing about the memory: give the problem of now with --problem."
    )]
    Check(PlanCheck),
    /// Note how the execution of a step went
    #[command(after_help = "Examples:\n  rmem plan step last 1 --started\n  rmem plan step last 1 --done\n\n\
Steps count from 1; `next` is the first that is not done. In the plan's document, the step gets\n\
the keys _status (running, done, failed), _started and _ended (dates).")]
    Step(PlanStep),
    /// Print a stored plan
    #[command(
        after_help = "Examples:\n  rmem plan show last\n  rmem plan show last --format dot | dot -Tpng > plan.png\n  rmem plan show 65f0 --format svg > plan.svg\n\n\
Formats: text (as in planning competitions), json, dot, svg, clips, ff."
    )]
    Show(PlanShow),
    /// Tell where a stored plan comes from
    #[command(after_help = "Example:\n  rmem plan why last")]
    Why(PlanShow),
    /// List the stored plans, the newest first
    #[command(after_help = "Example:\n  rmem plan list --limit 5")]
    List(PlanList),
    /// Store a plan from a file, after it is validated
    #[command(
        after_help = "Examples:\n  rmem plan import plan.txt --domain domain.pddl --template problem.pddl.j2 --goal '(on A B)'\n  ff -o domain.pddl -f problem.pddl | rmem plan import - --domain domain.pddl --problem problem.pddl\n\n\
Reads what FF prints, plans as in planning competitions, and temporal plans. A plan that does\n\
not reach the goal is not stored; exits with 1 then."
    )]
    Import(PlanImport),
    /// Plan again for the task of a stored plan, from the memory as it is now
    #[command(after_help = "Examples:\n  rmem plan rerun last\n  rmem plan rerun last --timeout 5s")]
    Rerun(PlanRerun),
}

/// A stored plan.
#[derive(Debug, Clone, Args)]
pub struct PlanShow {
    /// The plan: its id, what only its id begins with, or last
    #[arg(value_name = "ID")]
    pub id: String,
    /// Where the plans are
    #[arg(long = "in", value_name = "NS", default_value = "robmem.plans")]
    pub namespace: Namespace,
}

/// `plan check`
#[derive(Debug, Args)]
pub struct PlanCheck {
    /// Which plan.
    #[command(flatten)]
    pub plan: PlanShow,
    /// The problem as it is now, instead of the memory; - is stdin
    #[arg(short, long, value_name = "FILE")]
    pub problem: Option<PathBuf>,
}

/// `plan step`
#[derive(Debug, Args)]
pub struct PlanStep {
    /// The plan: its id, what only its id begins with, or last
    #[arg(value_name = "ID")]
    pub id: String,
    /// The step, from 1; next is the first that is not done
    #[arg(value_name = "N")]
    pub step: String,
    /// What became of it.
    #[command(flatten)]
    pub state: PlanState,
    /// Where the plans are
    #[arg(long = "in", value_name = "NS", default_value = "robmem.plans")]
    pub namespace: Namespace,
}

/// What became of a step.
#[derive(Debug, Clone, Copy, Args)]
#[group(required = true, multiple = false)]
pub struct PlanState {
    /// It has begun
    #[arg(long)]
    pub started: bool,
    /// It has ended well
    #[arg(long)]
    pub done: bool,
    /// It has ended badly
    #[arg(long)]
    pub failed: bool,
    /// Forget what was noted of it
    #[arg(long)]
    pub open: bool,
}

/// `plan list`
#[derive(Debug, Args)]
pub struct PlanList {
    /// Where the plans are
    #[arg(long = "in", value_name = "NS", default_value = "robmem.plans")]
    pub namespace: Namespace,
    /// At most so many; 0 is all
    #[arg(long, value_name = "N", default_value_t = 20)]
    pub limit: u64,
}

/// `plan import`
#[derive(Debug, Args)]
pub struct PlanImport {
    /// The plan; - is stdin
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// What it is a plan for.
    #[command(flatten)]
    pub task: PlanTask,
    /// Where the plan is stored
    #[arg(long, value_name = "NS", default_value = "robmem.plans")]
    pub into: Namespace,
    /// How the plan document is laid out: numbered, fawkes
    #[arg(long, value_name = "LAYOUT", default_value = "numbered", hide_possible_values = true)]
    pub layout: Layout,
}

/// `plan rerun`
#[derive(Debug, Args)]
pub struct PlanRerun {
    /// Which plan.
    #[command(flatten)]
    pub plan: PlanShow,
    /// Another planner than the plan's; several race each other
    #[arg(long, value_name = "NAME")]
    pub planner: Vec<String>,
    /// Another limit of time than the plan's
    #[arg(long, value_name = "DURATION", value_parser = quantity::duration)]
    pub timeout: Option<Duration>,
    /// Another limit of memory than the plan's
    #[arg(long, value_name = "SIZE", value_parser = quantity::size)]
    pub memory_limit: Option<u64>,
    /// Do not store the plan
    #[arg(long)]
    pub no_store: bool,
}

/// What is planned, and how.
#[derive(Debug, Clone, Args)]
pub struct PlanSearch {
    /// What is planned.
    #[command(flatten)]
    pub task: PlanTask,
    /// How.
    #[command(flatten)]
    pub effort: PlanEffort,
    /// Go on: plan again whenever the memory changes and the plan does not hold any more
    #[arg(long, requires = "template", conflicts_with = "no_store")]
    pub watch: bool,
}

/// What a plan is for.
#[derive(Debug, Clone, Args)]
pub struct PlanTask {
    /// The domain
    #[arg(short, long, value_name = "FILE")]
    pub domain: PathBuf,
    /// A problem; - is stdin
    #[arg(short, long, value_name = "FILE", required_unless_present = "template", conflicts_with = "template")]
    pub problem: Option<PathBuf>,
    /// A template to generate the problem from; - is stdin
    #[arg(short, long, value_name = "FILE")]
    pub template: Option<PathBuf>,
    /// What the template is given.
    #[command(flatten)]
    pub options: TemplateOptions,
}

/// How a plan is looked for, and where it goes.
#[derive(Debug, Clone, Args)]
pub struct PlanEffort {
    /// builtin, ff, fast-downward, or a [planner.NAME] of rmem.toml; several race each other
    #[arg(long, value_name = "NAME", default_value = "builtin")]
    pub planner: Vec<String>,
    /// How long the planner may run
    #[arg(long, value_name = "DURATION", default_value = "60s", value_parser = quantity::duration)]
    pub timeout: Duration,
    /// Use all of that time for better plans, and take the best
    #[arg(long)]
    pub anytime: bool,
    /// How much memory the planner may use
    #[arg(long, value_name = "SIZE", value_parser = quantity::size)]
    pub memory_limit: Option<u64>,
    /// Where the plan is stored
    #[arg(long, value_name = "NS", default_value = "robmem.plans")]
    pub into: Namespace,
    /// How the plan document is laid out: numbered, fawkes
    #[arg(long, value_name = "LAYOUT", default_value = "numbered", hide_possible_values = true)]
    pub layout: Layout,
    /// Do not store the plan
    #[arg(long)]
    pub no_store: bool,
}

/// The layouts of a plan document.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum Layout {
    /// One numbered key a step.
    #[default]
    Numbered,
    /// An array of actions, as Fawkes stores them.
    Fawkes,
}
