//! From a goal to a stored plan and its facts, inside a program.

use std::time::{Duration, Instant};

use anyhow::Context as _;
use bson::{Bson, DateTime, Document, doc};

use super::exchange;
use super::native::{Environment, Value};
use super::state::State;
use crate::formats::clips::{Body, Item, Reader};
use crate::formats::pddl::Dialect;
use crate::formats::{Diagnostics, Source, shell};
use crate::input::WrongInput;
use crate::pddl::{Domain, Problem};
use crate::plan::{self, Input, Layout, Lineage, PrintedPlan, TaskSource};
use crate::planner::{self, Limits, Outcome, Planner, Portfolio, Run, Task};
use crate::problem::names;
use crate::store::{Namespace, metadata};

/// Where plans are stored, as `rmem plan` does it.
const PLANS: &str = "robmem.plans";
/// How long a planner may take by default.
const DEFAULT_TIMEOUT: Duration = Duration::from_secs(60);
/// What a planner may print.
const MOST_OUTPUT: u64 = 16 << 20;

/// A plan wanted.
pub(super) struct PlanRequest<'a> {
    pub(super) domain: Source,
    pub(super) problem: Source,
    pub(super) planner: &'a str,
    pub(super) seconds: Option<u64>,
}

/// Finds a plan, stores it, and asserts its facts; returns its id. Where there is none, that is stored,
/// and said.
pub(super) fn plan(wish: PlanRequest<'_>, state: &State<'_>, clips: &Environment) -> anyhow::Result<Option<Value>> {
    let last = state.planning.last.borrow();
    let made = last.as_ref().filter(|(_, generated)| generated.text == wish.problem.text());
    let (started, clock, dialect) = (DateTime::now(), Instant::now(), Dialect::default());
    let domain = Domain::read(&wish.domain, dialect).map_err(Diagnostics)?;
    let problem = match made {
        Some((_, generated)) => generated.check(&domain, dialect),
        None => Problem::read(&wish.problem, &domain, dialect),
    };
    let problem = problem.map_err(Diagnostics)?;
    let given = match made {
        Some((request, _)) => Input::Template(Box::new(request.clone())),
        None => Input::Problem(wish.problem.clone()),
    };
    let value = |name: &str| match made {
        Some((_, generated)) => generated.value(name),
        None => Bson::String(names::restore(name)),
    };
    let recipe = TaskSource { domain: wish.domain.clone(), task: given, lenient: false };
    let sections = made.map_or(&[][..], |(_, generated)| &generated.sections);
    let mut lineage = Lineage::of(recipe, &problem, sections);
    (lineage.started, lineage.times) = (Some(started), vec![("pose".to_owned(), clock.elapsed())]);
    let task = Task { domain: &domain, problem: &problem };
    let (run, limit) = search(&wish, &task, state)?;
    lineage = lineage.with_run(&run);
    (lineage.planners, lineage.timeout) = (vec![wish.planner.to_owned()], Some(limit));
    let mut document = match &run.outcome {
        Outcome::Plan(plan) => plan::to_document(plan, domain.tree(), Layout::Numbered, &value),
        other => plan::failure(other.word(), Layout::Numbered),
    };
    document.insert(metadata::INFO, doc! { "lineage": lineage.to_document() });
    let id = store(&document, state)?;
    let Outcome::Plan(plan) = &run.outcome else {
        let said = if run.message.is_empty() { run.outcome.sentence().to_owned() } else { run.message.clone() };
        anyhow::bail!("{}: {said}", run.planner);
    };
    let page = PrintedPlan { plan, document: &document, statuses: &[], id: &id, value: &value };
    tell(&page.print(plan::Format::Clips)?, clips)
}

fn search(wish: &PlanRequest<'_>, task: &Task<'_>, state: &State<'_>) -> anyhow::Result<(Run, Duration)> {
    let configured = state.job.planners.iter().find(|planner| planner.name == wish.planner).cloned();
    let planner: Box<dyn Planner> = match configured {
        Some(configured) => Box::new(configured),
        None => planner::by_name(wish.planner, false)
            .ok_or_else(|| WrongInput::new(format!("there is no planner `{}`", wish.planner)))?,
    };
    let left = state.stop().deadline().map(|deadline| deadline.saturating_duration_since(Instant::now()));
    let limit = wish.seconds.map_or(DEFAULT_TIMEOUT, Duration::from_secs).min(left.unwrap_or(Duration::MAX));
    let limits = Limits { time: Some(limit), memory: None, output: MOST_OUTPUT };
    let host = &state.job.host;
    let race = Portfolio::new(&[planner], &limits, host).race(task, host, || ());
    let mut run = race.as_ref().and_then(planner::Race::winner).context("the planner did not run")?.clone();
    run.explain(task);
    Ok((run, limit))
}

fn store(document: &Document, state: &State<'_>) -> anyhow::Result<String> {
    let inserted = state.memory.insert(&Namespace::parse(PLANS)?, vec![document.clone()]);
    let inserted = inserted.context("storing the plan")?;
    Ok(match inserted.ids.first() {
        Some(Bson::ObjectId(id)) => id.to_hex(),
        other => other.map(shell::relaxed_value).unwrap_or_default(),
    })
}

/// Asserts the facts of a plan, with those of their slots that the program's templates have. A program
/// that has none of these templates gets none of the facts. Gives the id as the facts have it.
fn tell(facts: &str, clips: &Environment) -> anyhow::Result<Option<Value>> {
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
