//! What a search for a plan gave: the plan, or why there is none, and how it is stored.

use std::time::Duration;

use bson::{Bson, Document, doc};

use super::lineage::lineage;
use super::{PlanRequest, PlanningError, PlanningTask};
use crate::memory::Memory;
use crate::pddl::{Feature, Structure};
use crate::plan::{self, Lineage, PrintedPlan, Record, Repository};
use crate::planner::{Outcome, Race, Run};
use crate::problem::names;
use crate::store::{Namespace, metadata};

/// What a search gave.
pub struct PlanResult<'a> {
    request: &'a PlanRequest,
    task: PlanningTask,
    race: Race,
    run: Run,
    time: Duration,
    /// That of the task.
    lineage: Lineage,
    document: Document,
}

/// Messages about a search, beside its result.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Note {
    /// How it went.
    Info(String),
    /// What the user should be careful about.
    Warning(String),
}

impl<'a> PlanResult<'a> {
    pub(super) fn new(
        request: &'a PlanRequest,
        task: PlanningTask,
        lineage: Lineage,
        race: Race,
        run: Run,
        time: Duration,
    ) -> Self {
        let layout = request.options.layout;
        let document = match &run.outcome {
            Outcome::Plan(plan) => plan::to_document(plan, request.domain.tree(), layout, &|name| task.value(name)),
            other => plan::failure(other.word(), layout),
        };
        Self { request, task, race, run, time, lineage, document }
    }

    /// The problem that was planned for.
    #[must_use]
    pub fn task(&self) -> &PlanningTask {
        &self.task
    }

    /// Where the plan is stored, if it is.
    #[must_use]
    pub fn namespace(&self) -> Option<&Namespace> {
        self.request.options.into.as_ref()
    }

    /// The run whose outcome counts.
    #[must_use]
    pub fn run(&self) -> &Run {
        &self.run
    }

    /// Whether an interruption ended the search; there is a plan where one was found until then.
    #[must_use]
    pub fn is_interrupted(&self) -> bool {
        self.race.is_interrupted
    }

    /// Wall time of the search.
    #[must_use]
    pub fn time(&self) -> Duration {
        self.time
    }

    /// The plan's document, or the document of a failure, without metadata.
    #[must_use]
    pub fn document(&self) -> &Document {
        &self.document
    }

    /// The messages beside the result: what each of several planners did, whether the plan was not
    /// simulated, whether its actions were moved apart.
    #[must_use]
    pub fn notes(&self) -> Vec<Note> {
        let race = (self.race.runs.len() > 1).then(|| Note::Info(self.race.to_string()));
        let unjudged = self.run.unjudged.as_ref();
        let unjudged = unjudged.map(|reason| Note::Warning(format!("the plan was not wholly checked: {reason}")));
        let spaced = || Note::Info(format!("{} lets actions touch; the plan has them apart", self.run.planner));
        let without_costs = |run: &&Run| run.is_without_costs;
        let costless = self.race.runs.iter().filter(without_costs).map(|run| {
            Note::Info(format!("{} knows no costs of actions; it was sent the task without them", run.planner))
        });
        let cut_short = || Note::Info("interrupted; this is the best plan that was found until then".to_owned());
        let wrong = self.race.wrong_claims().map(|run| {
            let text = format!(
                "{} says that no plan exists, which is wrong: {} has a valid plan",
                run.planner, self.run.planner
            );
            Note::Warning(text)
        });
        let notes = race
            .into_iter()
            .chain(wrong)
            .chain(unjudged)
            .chain(self.run.is_spaced.then(spaced))
            .chain(self.ended_early());
        let is_cut_short = self.race.is_interrupted && self.run.outcome.plan().is_some();
        notes.chain(costless).chain(is_cut_short.then(cut_short)).collect()
    }

    /// Where the time was for better plans, but a planner with a plan did not use it.
    fn ended_early(&self) -> Option<Note> {
        let options = &self.request.options;
        let is_early = |run: &&Run| run.outcome.plan().is_some() && run.time < options.timeout.mul_f64(0.9);
        let early = self.race.runs.iter().filter(is_early);
        let names: Vec<String> =
            early.map(|run| format!("{} ended after {:.1} s", run.planner, run.time.as_secs_f64())).collect();
        let is_told = options.anytime && !self.race.is_interrupted && !names.is_empty();
        // Others may have used all of the time.
        let is_over = self.time < options.timeout.mul_f64(0.9);
        let rest = match is_over {
            true if !self.is_searched_through() => "; no better plan is looked for any more, but there may be one",
            true => "; no better plan is looked for any more",
            false => ", the others went on",
        };
        is_told.then(|| Note::Info(format!("--anytime: {}{rest}", names.join(", "))))
    }

    /// Whether the task has neither time nor numbers nor preferences: of those, the built-in planner does not look at all plans.
    fn is_searched_through(&self) -> bool {
        const NOT: [Feature; 3] = [Feature::NumericFluents, Feature::Preferences, Feature::Constraints];
        let domain = &self.request.domain;
        let mut used = domain.features().iter().chain(self.task.problem.features());
        !self.task.problem.is_timed(domain) && !used.any(|used| NOT.contains(&used.feature))
    }

    /// Stores the document with its lineage and returns its id. A search that was interrupted says nothing about
    /// the task, and is not stored; nor is anything where the request does not say where.
    ///
    /// # Errors
    /// Where the store fails.
    pub fn store(&self, memory: &Memory) -> Result<Option<String>, PlanningError> {
        let Some(into) = &self.request.options.into else { return Ok(None) };
        if self.run.outcome == Outcome::Interrupted {
            return Ok(None);
        }
        Repository::new(memory, into).store(self.record(None).document).map(Some).map_err(PlanningError::Storing)
    }

    /// The plan or the failure with its lineage, as it is stored under an id.
    #[must_use]
    pub fn record(&self, id: Option<&str>) -> Record {
        let lineage = lineage(self.lineage.clone(), self.request, &self.race, &self.run);
        let mut document: Document = id.map(|id| ("_id".to_owned(), id.into())).into_iter().collect();
        document.extend(self.document.clone());
        document.insert(metadata::INFO, doc! { "lineage": lineage.to_document() });
        Record { document }
    }

    /// The plan as it is printed, where there is one. `value` is [`PlanningTask::value`] of the task.
    #[must_use]
    pub fn printed<'b>(&'b self, id: &'b str, value: &'b dyn Fn(&str) -> Bson) -> Option<PrintedPlan<'b>> {
        let plan = self.run.outcome.plan()?;
        let has_metric = self.task.problem.tree().metric.is_some();
        let document = &self.document;
        let is_temporal = self.request.domain.is_temporal();
        let structure = None;
        Some(PrintedPlan { plan, document, statuses: &[], id, value, structure, has_metric, is_temporal, lanes: None })
    }

    /// Which step of the plan needs which, for drawings of it. Empty where there is no plan.
    #[must_use]
    pub fn structure(&self) -> Structure {
        let steps = self.run.outcome.plan().map(|plan| plan.steps.as_slice()).unwrap_or_default();
        self.request.domain.structure(steps)
    }

    /// Why there is no plan, in the memory's names: the outcome, the planner's words, and what keeps the goal from
    /// being reached. None where there is a plan.
    #[must_use]
    pub fn failure(&self) -> Option<String> {
        let run = &self.run;
        // Planners of FF's kind begin their messages so; which planner it was is said anyway.
        let message = run.message.strip_prefix("ff: ").unwrap_or(&run.message);
        let text = match (&run.outcome, message) {
            (Outcome::Plan(_), _) => return None,
            (outcome, message) if is_broken(outcome) && !message.is_empty() => format!("{}: {message}", run.planner),
            (Outcome::Unsolvable, message) => {
                let colon = if message.is_empty() { "" } else { ": " };
                let claim = if run.is_proven { ": proven: no plan exists" } else { " says that no plan exists" };
                format!("{}{claim}{colon}{message}", run.planner)
            }
            (outcome, "") => format!("{}: {}", run.planner, outcome.sentence()),
            (outcome, message) => format!("{}: {}: {message}", run.planner, outcome.sentence()),
        };
        let text = names::readable(&text);
        let tail = run.tail();
        Some(match run.outcome {
            ref outcome if is_broken(outcome) && !tail.is_empty() => {
                format!("{text}\n  the last lines it printed:\n{}", indent(&tail))
            }
            _ => text,
        })
    }

    /// What keeps the goal from being reached, in the memory's names, where that was found.
    #[must_use]
    pub fn why(&self) -> Option<String> {
        let why = self.run.why.as_ref()?;
        let is_claim = self.run.outcome == Outcome::Unsolvable && !self.run.is_proven && !why.is_proof();
        Some(match is_claim && !why.is_unknown {
            true => format!(
                "why: {} claims it, and rmem has no proof of it: each condition of the goal could be reached if nothing \
                 were ever undone, so what actions delete, numbers or times would have to stand in the way",
                self.run.planner
            ),
            false => names::readable(&why.to_string()),
        })
    }
}

/// Whether the planner did not do what planners do, so that its own words are worth printing.
fn is_broken(outcome: &Outcome) -> bool {
    matches!(outcome, Outcome::Failed | Outcome::NoPlan | Outcome::NotExecutable | Outcome::Invalid)
}

/// A planner's output with control characters made visible, so that they do not reach the terminal.
fn indent(text: &str) -> String {
    let visible = |c: char| if c.is_control() && c != '\t' { c.escape_debug().to_string() } else { c.to_string() };
    text.lines()
        .map(|line| format!("    {}", line.chars().map(visible).collect::<String>()))
        .collect::<Vec<_>>()
        .join("\n")
}
