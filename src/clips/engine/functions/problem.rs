//! Problems from templates, and plans for them.

use std::path::{Path, PathBuf};

use super::arguments::Arguments;
use super::failure::Failure;
use super::function::{Function, function, open};
use crate::clips::engine::native::{Environment, Value};
use crate::clips::engine::planning::{self, PlanCall};
use crate::clips::engine::state::State;
use crate::formats::Source;
use crate::problem::{Request, Syntax, check_use, read_parts};

pub(super) const FUNCTIONS: &[Function] = &[open(&["rm-gen-problem"], 1, generate), function(&["rm-plan"], 2, 4, plan)];

fn read(path: &str) -> Result<Source, Failure> {
    let failed = |error: std::io::Error| Failure::declined(crate::input::unreadable(path, &error));
    let bytes = std::fs::read(Path::new(path)).map_err(failed)?;
    crate::input::decode(path, bytes).map_err(Failure::declined)
}

/// `(rm-gen-problem TEMPLATE [GOAL [NAME VALUE]…])`: the problem as a string.
fn generate(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let mut parameters = Vec::new();
    let mut nth = 3;
    while arguments.get(nth).is_some() {
        parameters.push((arguments.text(nth)?.to_owned(), arguments.value(nth + 1, state)?));
        nth += 2;
    }
    let goal = arguments.get(2).map(|_| arguments.text(2)).transpose()?.filter(|goal| !goal.trim().is_empty());
    let path = Path::new(arguments.text(1)?);
    let mut request = Request {
        template: read(arguments.text(1)?)?,
        parts: Vec::new(),
        syntax: Syntax::Auto,
        collection: state.job.collection.clone(),
        goal: goal.map(str::to_owned),
        parameters,
        lenient: false,
    };
    let folders: Vec<PathBuf> = path.parent().map(Path::to_path_buf).into_iter().collect();
    request.parts = read_parts(&request, &folders).map_err(Failure::declined)?;
    check_use(&request, &[]).map_err(Failure::declined)?;
    let (text, notes) = state.planning.generate(request, state.memory).map_err(Failure::declined)?;
    notes.into_iter().for_each(|note| state.sender().note(note));
    Ok(Value::Text(text))
}

/// `(rm-plan DOMAIN PROBLEM [PLANNER [SECONDS]])`: a problem is a path, or the text itself. Gives the id
/// of the plan and asserts its facts, or gives FALSE.
fn plan(state: &State<'_>, clips: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let domain = read(arguments.text(1)?)?;
    let problem = match arguments.text(2)? {
        text if text.contains('(') => Source::new("<problem>", text),
        path => read(path)?,
    };
    let planner = arguments.get(3).map(|_| arguments.text(3)).transpose()?.unwrap_or("builtin");
    let seconds = arguments.get(4).map(|_| arguments.integer(4)).transpose()?;
    let seconds = seconds.and_then(|seconds| u64::try_from(seconds).ok());
    let found = planning::plan(PlanCall { domain, problem, planner, seconds }, state, clips)
        .map_err(|error| Failure::chained(&error))?;
    Ok(found.unwrap_or_else(|| Value::truth(false)))
}
