//! A planner's run on a task, as it is measured and kept.

use std::time::Duration;

use bson::{Bson, DateTime, Document, doc};

use crate::pddl::Plan;
use crate::plan::{hash, reported, whole};
use crate::planner::{Host, Limits, Outcome, Planner, Run, Task, run};
use crate::saturate::to_i64;

/// A run to be measured: what makes it the same as another.
pub struct Setup<'a> {
    /// What the task is called.
    pub name: &'a str,
    /// The planner.
    pub planner: &'a dyn Planner,
    /// The task.
    pub task: Task<'a>,
    /// The limits of the run.
    pub limits: Limits,
    /// Whether the planner may use all of the time.
    pub anytime: bool,
    /// How often the planner runs on the task; the run of median time is taken.
    pub repeats: usize,
    /// The files that the planner's command names: its program and scripts among its arguments, with what tells
    /// whether they have changed.
    pub program: &'a [String],
}

/// What a planner did on a task.
#[derive(Debug, Clone, PartialEq)]
pub struct Measurement {
    /// The key of the run.
    pub key: String,
    /// What the task is called.
    pub task: String,
    /// The planner's name.
    pub planner: String,
    /// The outcome, as a word.
    pub outcome: String,
    /// Wall time, in seconds.
    pub seconds: f64,
    /// Processor time of all its processes, in seconds.
    pub cpu: Option<f64>,
    /// The most memory that its processes had resident, in bytes: of one of them, or of all at once as far as it was seen.
    pub memory: Option<i64>,
    /// The plan's value by the problem's metric; without a metric its makespan, or its number of steps.
    pub cost: Option<f64>,
    /// Whether the metric is to be maximized, so that more is better.
    pub maximize: bool,
    /// When the last action of a plan with times ends.
    pub makespan: Option<f64>,
    /// Whether the plan was simulated, so that there is one whatever other planners say.
    pub is_simulated: bool,
    /// How many steps the plan has.
    pub steps: Option<i64>,
    /// The limit of time, in seconds.
    pub timeout: f64,
    /// The exit code of the planner's program; none where a signal or a limit ended it.
    pub code: Option<i32>,
    /// The message about the outcome.
    pub message: String,
    /// What was run: the planner's version and command, its limits, and the hashes of domain and problem.
    pub provenance: Document,
}

impl Setup<'_> {
    /// The key: texts of the task, planner with its version, program and arguments, limits.
    #[must_use]
    pub fn key(&self, host: &Host<'_>) -> String {
        let planner = self.planner;
        let arguments: Vec<String> =
            planner.command(host).iter().skip(1).map(|word| word.to_string_lossy().into_owned()).collect();
        let mut parts = vec![
            self.task.domain.source().text().to_owned(),
            self.task.problem.source().text().to_owned(),
            planner.name().to_owned(),
            planner.version().unwrap_or_default(),
            arguments.join(" "),
            self.program.join("\n"),
            format!("{:?} {:?} {}", self.limits.time, self.limits.memory, self.anytime),
        ];
        // Runs that are kept from before stay valid.
        if self.repeats > 1 {
            parts.push(self.repeats.to_string());
        }
        hash(&parts.join("\0"))
    }

    /// What is run, as it is kept with the measurement.
    fn provenance(&self, run: &Run) -> Document {
        let limit = self.limits.memory.and_then(|bytes| i64::try_from(bytes).ok()).filter(|bytes| *bytes < i64::MAX);
        doc! {
            "version": run.version.clone(),
            "command": run.command.clone(),
            "program": self.program.to_vec(),
            "memory_limit": limit,
            "anytime": self.anytime,
            "repeats": to_i64(self.repeats),
            "domain": hash(self.task.domain.source().text()),
            "problem": hash(self.task.problem.source().text()),
        }
    }
}

/// Runs a planner on a task under limits, simulates its plan, and measures. Of several runs, it is that of median time, where
/// those that did not solve the task come behind those that did; of an even number, the faster of the two in the middle.
#[must_use]
pub fn measure(setup: &Setup<'_>, host: &Host<'_>) -> Measurement {
    let first = measure_once(setup, host);
    let more = (1..setup.repeats).take_while(|_| !host.is_interrupted()).map(|_| measure_once(setup, host));
    let runs: Vec<Measurement> = std::iter::once(first.clone()).chain(more).collect();
    let failures = failures(&runs);
    let mut taken = median(runs).unwrap_or(first);
    if let Some(failures) = failures {
        taken.message = if taken.message.is_empty() { failures } else { format!("{failures}: {}", taken.message) };
    }
    taken
}

/// How many of several runs failed, and with which outcomes.
fn failures(runs: &[Measurement]) -> Option<String> {
    let failed = runs.iter().filter(|run| !run.is_solved());
    let mut outcomes: Vec<&str> = failed.map(|run| run.outcome.as_str()).collect();
    let (count, of) = (outcomes.len(), runs.len());
    outcomes.sort_unstable();
    outcomes.dedup();
    (of > 1 && count > 0).then(|| format!("{count} of {of} runs failed ({})", outcomes.join(", ")))
}

/// The run of median time.
fn median(mut runs: Vec<Measurement>) -> Option<Measurement> {
    runs.sort_by(|one, other| {
        one.is_solved().cmp(&other.is_solved()).reverse().then(one.seconds.total_cmp(&other.seconds))
    });
    let middle = runs.len().saturating_sub(1) / 2;
    (middle < runs.len()).then(|| runs.swap_remove(middle))
}

fn measure_once(setup: &Setup<'_>, host: &Host<'_>) -> Measurement {
    let mut run = run(setup.planner, &setup.task, &setup.limits, host);
    run.simulate(&setup.task);
    let plan = run.outcome.plan();
    let steps = plan.map(|plan| to_i64(plan.steps.len()));
    #[expect(clippy::cast_precision_loss, reason = "a number of steps")]
    let length = steps.map(|steps| steps as f64);
    let makespan = plan.and_then(Plan::makespan);
    let metric = setup.task.problem.tree().metric.as_ref();
    // An unchecked plan solves nothing.
    let unchecked = run.unjudged.as_ref().filter(|_| plan.is_some());
    let cost = match metric {
        _ if unchecked.is_some() => None,
        Some(_) => plan.and_then(|plan| plan.cost),
        None => makespan.or(length),
    };
    Measurement {
        key: setup.key(host),
        task: setup.name.to_owned(),
        planner: run.planner.clone(),
        outcome: if unchecked.is_some() { UNCHECKED.to_owned() } else { run.outcome.word().to_owned() },
        seconds: run.time.as_secs_f64(),
        cpu: run.cpu.map(|cpu| cpu.as_secs_f64()),
        memory: run.memory.and_then(|bytes| i64::try_from(bytes).ok()),
        cost,
        maximize: metric.is_some_and(|metric| !metric.minimize),
        makespan,
        is_simulated: plan.is_some() && run.unjudged.is_none(),
        steps,
        timeout: setup.limits.time.unwrap_or(Duration::MAX).as_secs_f64(),
        code: run.code,
        message: match unchecked {
            Some(reason) => format!("the plan was not checked: {reason}"),
            None => run.message.lines().next().unwrap_or_default().to_owned(),
        },
        provenance: setup.provenance(&run),
    }
}

impl Measurement {
    /// A run that was not made, as the task cannot be read.
    #[must_use]
    pub fn unreadable(task: &str, planner: &str, timeout: Duration, message: &str) -> Self {
        Self {
            key: String::new(),
            task: task.to_owned(),
            planner: planner.to_owned(),
            outcome: UNREADABLE.to_owned(),
            seconds: 0.0,
            cpu: None,
            memory: None,
            cost: None,
            maximize: false,
            makespan: None,
            is_simulated: false,
            steps: None,
            timeout: timeout.as_secs_f64(),
            code: None,
            message: message.lines().next().unwrap_or_default().to_owned(),
            provenance: Document::new(),
        }
    }

    /// Whether the planner says that there is no plan, and nothing refutes it.
    #[must_use]
    pub fn is_unsolvable(&self) -> bool {
        self.outcome == Outcome::Unsolvable.word()
    }

    /// Marks the word that there is no plan as wrong, as another planner has a plan.
    pub fn refute(&mut self, other: &str) {
        self.outcome = WRONG.to_owned();
        self.message = format!("it says that no plan exists, but {other} has a valid plan");
    }

    /// Whether the task is solved: by a valid plan, or by the word that there is none, which no plan refutes.
    #[must_use]
    pub fn is_solved(&self) -> bool {
        [Outcome::Unsolvable.word(), SUCCESS].contains(&self.outcome.as_str())
    }

    /// Whether the outcome would be the same again: nothing kept the planner from running.
    #[must_use]
    pub fn is_final(&self) -> bool {
        ![Outcome::Interrupted.word(), Outcome::NotFound.word()].contains(&self.outcome.as_str())
    }

    /// The measurement as a document, for people and programs.
    #[must_use]
    pub fn listed(&self) -> Document {
        let millis = |seconds: f64| (seconds * 1e3).round() / 1e3;
        doc! {
            "task": &self.task,
            "planner": &self.planner,
            "outcome": &self.outcome,
            "seconds": millis(self.seconds),
            "cpu": self.cpu.map(millis),
            "memory": self.memory,
            "cost": self.cost.map(reported),
            "makespan": self.makespan.map(reported),
            "steps": self.steps,
            "exit_code": self.code,
            "message": (!self.message.is_empty()).then_some(&self.message),
        }
    }

    /// The measurement as it is kept.
    #[must_use]
    pub fn to_document(&self, at: DateTime) -> Document {
        let mut document = doc! { "_id": &self.key, "at": at, "timeout": self.timeout };
        document.extend(self.listed());
        document.extend(doc! { "maximize": self.maximize, "simulated": self.is_simulated, "run": &self.provenance });
        document
    }

    /// Reads what [`Measurement::to_document`] wrote; none where it is not whole.
    #[must_use]
    pub fn from_document(document: &Document) -> Option<Self> {
        let text = |key: &str| document.get_str(key).ok().map(str::to_owned);
        let number = |key: &str| match document.get(key) {
            Some(Bson::Double(number)) => Some(*number),
            Some(Bson::Int32(number)) => Some(f64::from(*number)),
            #[expect(clippy::cast_precision_loss, reason = "written from a double")]
            Some(Bson::Int64(number)) => Some(*number as f64),
            _ => None,
        };
        Some(Self {
            key: text("_id")?,
            task: text("task")?,
            planner: text("planner")?,
            outcome: text("outcome")?,
            seconds: number("seconds")?,
            cpu: number("cpu"),
            memory: whole(document, "memory"),
            cost: number("cost"),
            maximize: document.get_bool("maximize").ok()?,
            makespan: number("makespan"),
            is_simulated: document.get_bool("simulated").ok()?,
            steps: whole(document, "steps"),
            timeout: number("timeout")?,
            code: document.get_i32("exit_code").ok(),
            message: text("message").unwrap_or_default(),
            provenance: document.get_document("run").cloned().unwrap_or_default(),
        })
    }
}

/// The word for a task that cannot be read.
const UNREADABLE: &str = "unreadable";
/// The word for a planner that says that there is no plan where another one has a plan.
const WRONG: &str = "wrong";
/// The word for a plan that could not be simulated.
const UNCHECKED: &str = "unchecked";
/// The word for a plan.
const SUCCESS: &str = "success";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_run_of_median_time_is_taken() {
        let run = |outcome: &str, seconds: f64| Measurement {
            outcome: outcome.to_owned(),
            seconds,
            ..Measurement::unreadable("t", "p", Duration::from_secs(60), "")
        };
        let taken = |runs: Vec<Measurement>| median(runs).map(|run| (run.outcome, run.seconds));
        let (solved, crashed) = (|seconds| run(SUCCESS, seconds), |seconds| run("crashed", seconds));
        let of = |outcome: &str, seconds| Some((outcome.to_owned(), seconds));
        assert_eq!(taken(vec![solved(3.0), solved(1.0), solved(2.0)]), of(SUCCESS, 2.0));
        assert_eq!(taken(vec![solved(3.0), solved(1.0)]), of(SUCCESS, 1.0));
        assert_eq!(taken(vec![crashed(0.1), solved(3.0), solved(1.0)]), of(SUCCESS, 3.0));
        assert_eq!(taken(vec![crashed(0.1), solved(3.0), crashed(0.2)]), of("crashed", 0.1));
        assert_eq!(taken(Vec::new()), None);
        let all = [crashed(1.0), solved(1.0), run("no-plan", 1.0), crashed(1.0)];
        assert_eq!(failures(&all).as_deref(), Some("3 of 4 runs failed (crashed, no-plan)"));
        assert_eq!((failures(&all[..1]), failures(&all[1..2])), (None, None));
    }

    #[test]
    fn a_measurement_is_read_as_it_was_written() {
        let measured = Measurement {
            key: "k".to_owned(),
            task: "blocks/p01".to_owned(),
            planner: "builtin".to_owned(),
            outcome: "success".to_owned(),
            seconds: 1.5,
            cpu: None,
            memory: Some(1 << 33),
            cost: Some(3.0),
            maximize: true,
            makespan: Some(4.5),
            is_simulated: true,
            steps: Some(3),
            timeout: 60.0,
            code: Some(0),
            message: String::new(),
            provenance: doc! { "anytime": false },
        };
        let document = measured.to_document(DateTime::from_millis(0));
        assert_eq!(Measurement::from_document(&document), Some(measured.clone()));
        // As it is read from relaxed text.
        let mut narrow = document;
        narrow.insert("steps", 3_i32);
        assert_eq!(Measurement::from_document(&narrow), Some(measured));
        assert_eq!(Measurement::from_document(&doc! { "_id": "k" }), None);
        assert_eq!(crate::planner::Outcome::Plan(crate::pddl::Plan { steps: Vec::new(), cost: None }).word(), SUCCESS);
    }
}
