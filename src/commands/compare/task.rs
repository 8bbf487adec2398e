//! The tasks that planners are compared on: files, folders, and those of stored plans.

use std::path::{Path, PathBuf};

use crate::commands::{Context, UsageError, WrongInput};
use crate::error::{Context as _, Result};
use crate::formats::pddl::Dialect;
use crate::formats::{Diagnostics, Source};
use crate::memory::Memory;
use crate::pddl::{Domain, Problem};
use crate::plan::{Input, Repository, TaskSource};
use crate::planning::PlanningTask;
use crate::planning::comparison::{TaskFiles, tasks};
use crate::store::Namespace;

/// Where tasks are looked for.
pub(super) enum Place<'a> {
    /// Folders; a domain and its problems.
    Paths(&'a [PathBuf]),
    /// The plans of a collection.
    Plans(&'a Namespace),
}

/// A task, and where it comes from.
pub(super) struct Named {
    pub(super) name: String,
    from: From,
}

enum From {
    /// Files that were named: a mistake in them is an error.
    Files(PathBuf, PathBuf),
    /// Files of a folder: those with a mistake are left out.
    Folder(PathBuf, PathBuf),
    /// The texts of a stored plan.
    Plan(Box<TaskSource>),
}

/// Finds the tasks that the command line names.
pub(super) fn find(place: &Place<'_>, only: &str, memory: &Memory) -> Result<Vec<Named>> {
    let mut found = match place {
        Place::Plans(ns) => of_plans(ns, memory)?,
        Place::Paths(paths) => of_paths(paths)?,
    };
    found.retain(|named| named.name.contains(only));
    if found.is_empty() {
        let place = match place {
            Place::Plans(ns) => format!("{ns} has no plan"),
            Place::Paths(_) => "there is no task here; expected folders with domain.pddl and problems".to_owned(),
        };
        let only = if only.is_empty() { String::new() } else { format!(" with `{only}` in its name") };
        return Err(WrongInput::new(format!("{place}{only}")).into());
    }
    Ok(found)
}

fn of_paths(paths: &[PathBuf]) -> Result<Vec<Named>> {
    let mut found = Vec::new();
    let mut domain: Option<&Path> = None;
    for path in paths {
        if !path.exists() {
            return Err(WrongInput::new(format!("there is no file or folder {}", path.display())).into());
        }
        if path.is_dir() {
            let of_folder = tasks(path).with_context(|| format!("cannot read {}", path.display()))?;
            found.extend(
                of_folder
                    .into_iter()
                    .map(|TaskFiles { name, domain, problem, .. }| Named { name, from: From::Folder(domain, problem) }),
            );
            continue;
        }
        match domain {
            None => domain = Some(path),
            Some(domain) => found.push(Named {
                name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
                from: From::Files(domain.to_owned(), path.clone()),
            }),
        }
    }
    let is_alone = domain.is_some() && !found.iter().any(|named| matches!(named.from, From::Files(..)));
    if let (true, Some(domain)) = (is_alone, domain) {
        let message = format!("{} is a file without problems; expected DOMAIN PROBLEM… or a folder", domain.display());
        return Err(UsageError::new(message).into());
    }
    Ok(distinct(found))
}

/// The tasks of stored plans, the same task once.
fn of_plans(ns: &Namespace, memory: &Memory) -> Result<Vec<Named>> {
    let (mut found, mut sources): (Vec<Named>, Vec<TaskSource>) = (Vec::new(), Vec::new());
    for record in Repository::new(memory, ns).newest(0)? {
        let record = record?;
        // An imported plan has no task.
        let Ok(source) = record.source() else { continue };
        if !sources.contains(&source) {
            found.push(Named { name: record.id(), from: From::Plan(Box::new(source.clone())) });
            sources.push(source);
        }
    }
    found.reverse();
    Ok(found)
}

/// Gives tasks of one name the numbers 2, 3, … as well.
fn distinct(mut found: Vec<Named>) -> Vec<Named> {
    let mut seen: std::collections::HashMap<String, usize> = std::collections::HashMap::new();
    for named in &mut found {
        let count = seen.entry(named.name.clone()).or_default();
        *count += 1;
        if *count > 1 {
            named.name = format!("{} ({count})", named.name);
        }
    }
    found
}

impl Named {
    /// Reads the task; none where it is one of a folder and wrong.
    pub(super) fn read(&self, memory: &Memory, context: &mut Context<'_>) -> Result<Option<(Domain, Problem)>> {
        match &self.from {
            From::Files(domain, problem) => read(domain, problem, context).map(Some),
            From::Folder(domain, problem) => match read(domain, problem, context) {
                Ok(task) => Ok(Some(task)),
                Err(error) => {
                    context.output.warn(&format!("{} is left out: {error}", self.name));
                    Ok(None)
                }
            },
            From::Plan(source) => {
                let domain = source.read_domain()?;
                let task = PlanningTask::instantiate(source, None, &domain, memory);
                let task = task.with_context(|| format!("the task of the plan {}", self.name))?;
                Ok(Some((domain, task.problem)))
            }
        }
    }
}

fn read(domain: &Path, problem: &Path, context: &mut Context<'_>) -> Result<(Domain, Problem)> {
    let input = Input::Problem(context.read(problem)?);
    let source = TaskSource { domain: context.read(domain)?, input, lenient: false };
    let domain = source.read_domain()?;
    let text: &Source = source.input.text();
    let problem = Problem::read(text, &domain, Dialect::default()).map_err(Diagnostics)?;
    Ok((domain, problem))
}
