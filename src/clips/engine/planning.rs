//! Problems and plans inside a program of CLIPS.

use std::time::{Duration, Instant};

use super::exchange;
use super::native::{Environment, Value};
use super::state::State;
use crate::error::Result;
use crate::formats::Source;
use crate::formats::clips::{Body, Item, Reader};
use crate::input::WrongInput;
use crate::plan::{self, Input, Layout, TaskSource};
use crate::planning::{self, DEFAULT_TIMEOUT, Note, PlanRequest, PlanResult, SearchOptions};
use crate::store::Namespace;

/// Where plans are stored, as `rmem plan` does it.
const PLANS: &str = "robmem.plans";

/// A call of `rm-plan`.
pub(super) struct PlanCall<'a> {
    pub(super) domain: Source,
    pub(super) problem: Source,
    pub(super) planner: &'a str,
    pub(super) seconds: Option<u64>,
}

/// Finds a plan, stores it, and asserts its facts; gives its id. Where there is none, that is stored, and is an
/// error.
pub(super) fn plan(call: PlanCall<'_>, state: &State<'_>, clips: &Environment) -> Result<Option<Value>> {
    let request = request(call, state)?;
    let prepared = planning::prepare(&request, state.memory, &state.job.host)?;
    let result = prepared.search(state.memory, &state.job.host)?;
    report(&result, state);
    let id = result.store(state.memory)?;
    if let Some(failure) = result.failure() {
        let why = result.why().map(|why| format!("\n{why}")).unwrap_or_default();
        return Err(WrongInput::new(format!("{failure}{why}")).into());
    }
    let value = |name: &str| result.task().value(name);
    match result.printed(id.as_deref().unwrap_or("plan"), &value) {
        Some(printed) => assert(&printed.print(plan::Format::Clips)?, clips),
        None => Ok(None),
    }
}

/// The request of a call. A problem that the program has generated is known with its names and sections.
fn request(call: PlanCall<'_>, state: &State<'_>) -> Result<PlanRequest> {
    let options = SearchOptions {
        anytime: false,
        timeout: timeout(call.seconds, state),
        memory_limit: None,
        into: Some(Namespace::parse(PLANS)?),
        layout: Layout::Numbered,
    };
    let planner = state.job.planners.get(call.planner, options.anytime)?;
    let last = state.planning.last.borrow();
    let known = last.as_ref().filter(|(_, generated)| generated.text == call.problem.text());
    let input = match known {
        Some((request, _)) => Input::Template(Box::new(request.clone())),
        None => Input::Problem(call.problem),
    };
    let source = TaskSource { domain: call.domain, input, lenient: false };
    let mut request = PlanRequest::new(source, vec![planner], options)?;
    request.generated = known.map(|(_, generated)| generated.clone());
    Ok(request)
}

/// How long the planner may run: no longer than the program itself.
fn timeout(seconds: Option<u64>, state: &State<'_>) -> Duration {
    let left = state.stop().deadline().map(|deadline| deadline.saturating_duration_since(Instant::now()));
    seconds.map_or(DEFAULT_TIMEOUT, Duration::from_secs).min(left.unwrap_or(Duration::MAX))
}

fn report(result: &PlanResult<'_>, state: &State<'_>) {
    for note in result.notes() {
        match note {
            Note::Info(text) => state.sender().note(text),
            Note::Warning(text) => state.sender().warn(text),
        }
    }
}

/// Asserts the facts of a plan, with those of their slots that the program's templates have. A program
/// that has none of these templates gets none of the facts. Gives the id as the facts have it.
fn assert(facts: &str, clips: &Environment) -> Result<Option<Value>> {
    let mut id = None;
    let schema = exchange::schema(clips, ["plan", "plan-action"]);
    let source = Source::new("<plan>", facts);
    for item in Reader::new(&source, []) {
        let Item::Fact(fact) = item? else { continue };
        let Body::Slots(slots) = &fact.body else { continue };
        if fact.name == "plan" {
            let named = exchange::filled(slots, &schema, &fact.name).into_iter().find(|(slot, _)| slot == "id");
            id = named.map(|(_, value)| value);
        }
        let Some(template) = schema.get(&fact.name) else { continue };
        let slots: Vec<_> = slots.iter().filter(|slot| template.slot(&slot.name).is_some()).cloned().collect();
        let slots = exchange::filled(&slots, &schema, &fact.name);
        clips.assert(&fact.name, &slots).map_err(WrongInput::new)?;
    }
    Ok(id)
}
