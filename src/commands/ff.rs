//! `rmem ff -o DOMAIN -f PROBLEM`: the built-in planner, speaking FF.
//!
//! Programs written for FF call it as they call FF: options that do not change what is
//! asked are taken and ignored. A task that is ill-formed is an error at its place, never
//! an answer.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use clap::Args;

use super::Context;
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::{Diagnostics, Source, pddl::Dialect};
use crate::pddl::{Domain, Problem};
use crate::planner::{Task, builtin};

/// Run the built-in planner as the program ff is run
#[derive(Debug, Args)]
#[command(disable_help_flag = true, after_help = "Example:\n  rmem ff -o domain.pddl -f problem.pddl")]
pub struct FfArgs {
    /// The domain (FF's operator file)
    #[arg(short = 'o', value_name = "DOMAIN")]
    pub domain: PathBuf,
    /// The problem (FF's fact file)
    #[arg(short = 'f', value_name = "PROBLEM")]
    pub problem: PathBuf,
    /// Prefix of both file names, like a folder with its `/`
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
    /// Print the first plan at once, then every better one
    #[arg(long)]
    pub anytime: bool,
    /// The files are a task that rmem has checked and written
    #[arg(long, hide = true)]
    pub checked: bool,
    /// Print help
    #[arg(long, action = clap::ArgAction::HelpLong)]
    pub help: Option<bool>,
}

pub(super) fn run(args: &FfArgs, context: &mut Context<'_>) -> Result<Exit> {
    let ignored = ignored(args);
    if !ignored.is_empty() {
        context.output.note(&format!("ff: the built-in planner searches in its own way; ignored: {ignored}"));
    }
    let domain = context.read_pddl(&prefixed(args, &args.domain))?;
    let problem = context.read_pddl(&prefixed(args, &args.problem))?;
    let options = builtin::Options { anytime: args.anytime, streamed: args.checked, ..builtin::Options::default() };
    let mut written = Ok(());
    // Each piece is passed on at once: a caller that stops this process has the plans found until then.
    let mut say = |text: &str| {
        if written.is_ok() {
            written = context.output.stdout().write_all(text.as_bytes()).and_then(|()| context.output.flush());
        }
    };
    let code = match args.checked {
        true => builtin::child(domain.text(), problem.text(), options, &mut say),
        false => checked(&domain, &problem, options, &mut say)?,
    };
    written?;
    Ok(Exit::Passed(u8::try_from(code).unwrap_or(Exit::PlannerBroken.code())))
}

fn checked(
    domain: &Source,
    problem: &Source,
    options: builtin::Options,
    say: &mut dyn FnMut(&str),
) -> Result<i32, Diagnostics> {
    let domain = Domain::read(domain, Dialect::default()).map_err(Diagnostics)?;
    let problem = Problem::read(problem, &domain, Dialect::default()).map_err(Diagnostics)?;
    Ok(builtin::solve(&Task { domain: &domain, problem: &problem }, options, say))
}

/// The path of a file: as FF does it, `-p` and the name without anything between them.
fn prefixed(args: &FfArgs, name: &Path) -> PathBuf {
    let mut path = args.path.as_ref().map_or_else(OsString::new, |prefix| prefix.clone().into_os_string());
    path.push(name);
    path.into()
}

/// The search settings of FF's that were given.
fn ignored(args: &FfArgs) -> String {
    let valued = [
        ("-s", &args.search),
        ("-g", &args.so_far),
        ("-h", &args.estimate),
        ("-w", &args.weight),
        ("-r", &args.restarts),
    ];
    let switches = [("-E", args.climbing), ("-O", args.criterion), ("-C", args.costs)];
    let valued = valued.into_iter().filter_map(|(option, value)| Some(format!("{option} {}", value.as_deref()?)));
    let switches = switches.into_iter().filter(|(_, given)| *given).map(|(option, _)| option.to_owned());
    valued.chain(switches).collect::<Vec<_>>().join(" ")
}
