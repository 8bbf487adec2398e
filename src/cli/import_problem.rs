//! `import-problem`: from PDDL to the memory.

use std::path::PathBuf;

use clap::Args;

use crate::store::Namespace;

/// What stands below the help of `import-problem`.
pub const HELP: &str = "\
Examples:
  rmem import-problem problem.pddl --into robmem.worldmodel
  rmem import-problem problem.pddl --into robmem.worldmodel --template problem.pddl.j2
  rmem gen-problem --template problem.pddl.j2

Objects, initial state, goal and metric become documents: {relation: 'domain-object', name, type},
{relation: 'domain-fact', name, param_values}, 'domain-function' with a value, 'domain-timed-fact'
with a time, 'domain-goal' with a condition, and 'domain-metric' with an expression. The template
makes an equal problem of them, with the goal of --goal where one is given. Nothing is stored
where the collection has such documents already, unless they are to be replaced.";

/// `import-problem`
#[derive(Debug, Args)]
pub struct ImportProblem {
    /// The problem; - is stdin
    #[arg(value_name = "PROBLEM")]
    pub problem: PathBuf,
    /// Where the documents go
    #[arg(long, value_name = "NS")]
    pub into: Namespace,
    /// Check the problem against this domain first
    #[arg(short, long, value_name = "FILE")]
    pub domain: Option<PathBuf>,
    /// Write a template that makes an equal problem of the documents
    #[arg(short, long, value_name = "FILE")]
    pub template: Option<PathBuf>,
    /// Remove what an earlier import stored there
    #[arg(long)]
    pub replace: bool,
    /// Take `//` to the end of a line as a comment
    #[arg(long)]
    pub lenient: bool,
}
