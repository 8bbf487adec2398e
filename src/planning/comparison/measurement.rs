//! A planner's run on a task, as it is measured and kept.

use std::time::Duration;

use bson::{Bson, DateTime, Document, doc};

use crate::plan::{hash, reported};
use crate::planner::{Host, Limits, Outcome, Planner, Task, run};

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
    /// The plan's cost by its metric, else its number of steps.
    pub cost: Option<f64>,
    /// How many steps the plan has.
    pub steps: Option<i64>,
    /// The limit of time, in seconds.
    pub timeout: f64,
    /// The message about the outcome.
    pub message: String,
}

impl Setup<'_> {
    /// The key: texts of the task, planner with its version and arguments, limits.
    #[must_use]
    pub fn key(&self, host: &Host<'_>) -> String {
        let planner = self.planner;
        let arguments: Vec<String> =
            planner.command(host).iter().skip(1).map(|word| word.to_string_lossy().into_owned()).collect();
        let parts = [
            self.task.domain.source().text().to_owned(),
            self.task.problem.source().text().to_owned(),
            planner.name().to_owned(),
            planner.version().unwrap_or_default(),
            arguments.join(" "),
            format!("{:?} {:?}", self.limits.time, self.limits.memory),
        ];
        hash(&parts.join("\0"))
    }
}

/// Runs a planner on a task under limits, simulates its plan, and measures.
#[must_use]
pub fn measure(setup: &Setup<'_>, host: &Host<'_>) -> Measurement {
    let mut run = run(setup.planner, &setup.task, &setup.limits, host);
    run.simulate(&setup.task);
    let plan = run.outcome.plan();
    let steps = plan.map(|plan| i64::try_from(plan.steps.len()).unwrap_or(i64::MAX));
    #[expect(clippy::cast_precision_loss, reason = "a number of steps")]
    let length = steps.map(|steps| steps as f64);
    Measurement {
        key: setup.key(host),
        task: setup.name.to_owned(),
        planner: run.planner.clone(),
        outcome: run.outcome.word().to_owned(),
        seconds: run.time.as_secs_f64(),
        cpu: run.cpu.map(|cpu| cpu.as_secs_f64()),
        memory: run.memory.and_then(|bytes| i64::try_from(bytes).ok()),
        cost: plan.and_then(|plan| plan.cost).or(length),
        steps,
        timeout: setup.limits.time.unwrap_or(Duration::MAX).as_secs_f64(),
        message: run.message.lines().next().unwrap_or_default().to_owned(),
    }
}

impl Measurement {
    /// Whether the task is solved: by a valid plan, or by the proof that there is none.
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
            "steps": self.steps,
            "message": (!self.message.is_empty()).then_some(&self.message),
        }
    }

    /// The measurement as it is kept.
    #[must_use]
    pub fn to_document(&self, at: DateTime) -> Document {
        let mut document = doc! { "_id": &self.key, "at": at, "timeout": self.timeout };
        document.extend(self.listed());
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
            memory: document.get_i64("memory").ok(),
            cost: number("cost"),
            steps: document.get_i64("steps").ok(),
            timeout: number("timeout")?,
            message: text("message").unwrap_or_default(),
        })
    }
}

/// The word for a plan.
const SUCCESS: &str = "success";

#[cfg(test)]
mod tests {
    use super::*;

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
            steps: Some(3),
            timeout: 60.0,
            message: String::new(),
        };
        let document = measured.to_document(DateTime::from_millis(0));
        assert_eq!(Measurement::from_document(&document), Some(measured));
        assert_eq!(Measurement::from_document(&doc! { "_id": "k" }), None);
        assert_eq!(crate::planner::Outcome::Plan(crate::pddl::Plan { steps: Vec::new(), cost: None }).word(), SUCCESS);
    }
}
