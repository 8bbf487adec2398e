//! The tasks that planners are compared on: files, folders, and those of stored plans.

use std::collections::HashSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crate::commands::{Context, UsageError, WrongInput};
use crate::error::{Context as _, Error, Result};
use crate::fault::Fault;
use crate::formats::pddl::Dialect;
use crate::formats::{Diagnostics, Source};
use crate::memory::Memory;
use crate::pddl::{Domain, Problem};
use crate::plan::{Input, Repository, TaskSource};
use crate::planning::PlanningTask;
use crate::planning::comparison::{TaskFiles, tasks};
use crate::store::Namespace;

/// Where tasks are looked for.
pub(super) enum TaskLocation<'a> {
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
    /// A domain and a problem.
    Files(PathBuf, PathBuf),
    /// The texts of a stored plan.
    Plan(Box<TaskSource>),
}

/// The tasks that were found.
pub(super) struct Found {
    pub(super) tasks: Vec<Named>,
    /// How many of them were named once more.
    pub(super) repeated: usize,
}

/// Finds the tasks that the command line names.
pub(super) fn find(place: &TaskLocation<'_>, only: &str, memory: &Memory) -> Result<Found> {
    let Found { tasks: mut found, repeated } = match place {
        TaskLocation::Plans(ns) => Found { tasks: of_plans(ns, memory)?, repeated: 0 },
        TaskLocation::Paths(paths) => of_paths(paths)?,
    };
    found.retain(|named| named.name.contains(only));
    if found.is_empty() {
        let place = match place {
            TaskLocation::Plans(ns) => format!("{ns} has no plan"),
            TaskLocation::Paths(_) => {
                "there is no task here; expected folders with domain.pddl and problems".to_owned()
            }
        };
        let only = if only.is_empty() { String::new() } else { format!(" with `{only}` in its name") };
        return Err(WrongInput::new(format!("{place}{only}")).into());
    }
    Ok(Found { tasks: found, repeated })
}

fn of_paths(paths: &[PathBuf]) -> Result<Found> {
    let mut found: Vec<Named> = Vec::new();
    let mut domain: Option<&Path> = None;
    let mut is_alone = true;
    for path in paths {
        if !path.exists() {
            return Err(WrongInput::new(format!("there is no file or folder {}", path.display())).into());
        }
        if path.is_dir() {
            let of_folder = tasks(path).with_context(|| format!("cannot read {}", path.display()))?;
            if of_folder.is_empty() {
                let problems = problems(path).with_context(|| format!("cannot read {}", path.display()))?;
                let Some(domain) = domain.filter(|_| !problems.is_empty()) else { return Err(no_task(path).into()) };
                is_alone = false;
                found.extend(problems.into_iter().map(|problem| Named::of_files(domain, &problem)));
                continue;
            }
            let named = |task: TaskFiles| Named { name: task.name, from: From::Files(task.domain, task.problem) };
            found.extend(of_folder.into_iter().map(named));
            continue;
        }
        match domain {
            None => domain = Some(path),
            Some(domain) => {
                is_alone = false;
                found.push(Named::of_files(domain, path));
            }
        }
    }
    if let (true, Some(domain)) = (is_alone, domain) {
        let message = format!("{} is a file without problems; expected DOMAIN PROBLEM… or a folder", domain.display());
        return Err(UsageError::new(message).into());
    }
    let count = found.len();
    let tasks = distinct(once(found));
    Ok(Found { repeated: count - tasks.len(), tasks })
}

/// The problems of a folder that has no domain of its own: files of PDDL that define one.
fn problems(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in folder.read_dir()? {
        let path = entry?.path();
        let is_problem = |text: String| text.to_ascii_lowercase().contains("(problem");
        let is_pddl = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("pddl"));
        if is_pddl && fs::read_to_string(&path).is_ok_and(is_problem) {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

fn no_task(folder: &Path) -> WrongInput {
    WrongInput::new(format!(
        "there is no task in {}; expected a domain.pddl with problems, or problems, with their domain in front of the folder",
        folder.display()
    ))
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

/// Leaves out tasks whose files were there already.
fn once(found: Vec<Named>) -> Vec<Named> {
    let mut seen = HashSet::new();
    let whole = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let is_new = |named: &Named| match &named.from {
        From::Files(domain, problem) => seen.insert((whole(domain), whole(problem))),
        From::Plan(_) => true,
    };
    found.into_iter().filter(is_new).collect::<Vec<_>>()
}

/// Gives tasks of one name the end of their problem's path that is as long as is needed to tell them apart; and, where one
/// problem is for several domains, the domain as well.
fn distinct(mut found: Vec<Named>) -> Vec<Named> {
    let names: Vec<String> = found.iter().map(|named| named.name.clone()).collect();
    for (place, name) in names.iter().enumerate() {
        let Some(From::Files(domain, problem)) = found.get(place).map(|named| &named.from) else { continue };
        let others: Vec<Vec<String>> = (0..names.len())
            .filter(|other| *other != place && names.get(*other) == Some(name))
            .filter_map(|other| found.get(other)?.from.parts())
            .collect();
        if others.is_empty() {
            continue;
        }
        let own = parts(problem);
        let end = |parts: &[String], length: usize| parts[parts.len().saturating_sub(length)..].join("/");
        let is_distinct = |length: &usize| others.iter().all(|other| end(other, *length) != end(&own, *length));
        let name = match (1..=own.len()).find(is_distinct) {
            Some(length) => end(&own, length.max(name.split('/').count())),
            None => format!("{name} ({})", domain.display()),
        };
        if let Some(named) = found.get_mut(place) {
            named.name = name;
        }
    }
    found
}

impl From {
    /// The parts of the problem's path.
    fn parts(&self) -> Option<Vec<String>> {
        match self {
            Self::Files(_, problem) => Some(parts(problem)),
            Self::Plan(_) => None,
        }
    }
}

/// The parts of a file's whole path, without the ending of its name.
fn parts(path: &Path) -> Vec<String> {
    let whole = path.canonicalize().unwrap_or_else(|_| path.to_owned()).with_extension("");
    whole.iter().map(|part| part.to_string_lossy().into_owned()).collect()
}

impl Named {
    /// The task of a domain and a problem, which gives it its name.
    fn of_files(domain: &Path, problem: &Path) -> Self {
        let name = problem.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Self { name, from: From::Files(domain.to_owned(), problem.to_owned()) }
    }

    /// Reads the task; the inner error is that of a task that cannot be read, which keeps no other from being measured.
    pub(super) fn read(
        &self,
        memory: &Memory,
        context: &mut Context<'_>,
    ) -> Result<std::result::Result<(Domain, Problem), Error>> {
        match &self.from {
            From::Files(domain, problem) => Ok(read(domain, problem, context)),
            From::Plan(source) => match of_plan(source, memory) {
                Err(error) if !matches!(error.fault(), Fault::Input | Fault::Unsupported) => Err(error),
                read => Ok(read),
            },
        }
    }
}

fn of_plan(source: &TaskSource, memory: &Memory) -> Result<(Domain, Problem)> {
    let domain = source.read_domain()?;
    let task = PlanningTask::instantiate(source, None, &domain, memory)?;
    Ok((domain, task.problem))
}

fn read(domain: &Path, problem: &Path, context: &mut Context<'_>) -> Result<(Domain, Problem)> {
    let input = Input::Problem(context.read_pddl(problem)?);
    let source = TaskSource { domain: context.read_pddl(domain)?, input, lenient: false };
    let domain = source.read_domain()?;
    let text: &Source = source.input.text();
    let problem = Problem::read(text, &domain, Dialect::default()).map_err(Diagnostics)?;
    Ok((domain, problem))
}
