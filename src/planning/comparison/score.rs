//! What the measurements of a planner come to.
//!
//! Scores of the International Planning Competition (2018, 2023): *satisficing*, the cost of the best plan that any of the
//! planners found divided by that of this one (where a metric is to be maximized: its value divided by the best one);
//! *agile*, 1 within a second, else 1 − log T / log L with the limit L. PAR10 (Hutter et al. 2009) is the mean time,
//! with ten times the limit for a task that is not solved.

use bson::{Document, doc};

use super::Measurement;
use crate::saturate::to_i64;

/// The score of a planner.
#[derive(Debug, Clone, PartialEq)]
pub struct Score {
    /// The planner.
    pub planner: String,
    /// On how many tasks it was run.
    pub tasks: usize,
    /// How many of them it solved.
    pub solved: usize,
    /// The sum of satisficing scores, without tasks whose plans have costs below 0 ([`unscored`]).
    pub satisficing: f64,
    /// The sum of agile scores.
    pub agile: f64,
    /// The penalised mean time, in seconds.
    pub par10: f64,
    /// The most memory of a run, in bytes.
    pub memory: Option<i64>,
}

/// Returns the scores of the planners, in the order in which they first come.
#[must_use]
pub fn scores(measurements: &[Measurement]) -> Vec<Score> {
    let mut planners: Vec<&str> = Vec::new();
    for measured in measurements {
        if !planners.contains(&measured.planner.as_str()) {
            planners.push(&measured.planner);
        }
    }
    planners.into_iter().map(|planner| score(planner, measurements)).collect()
}

fn score(planner: &str, all: &[Measurement]) -> Score {
    let own: Vec<&Measurement> = all.iter().filter(|measured| measured.planner == planner).collect();
    let solved: Vec<&Measurement> = own.iter().copied().filter(|measured| measured.is_solved()).collect();
    let time = |measured: &&Measurement| match measured.is_solved() {
        true => measured.seconds,
        false => 10.0 * measured.timeout,
    };
    #[expect(clippy::cast_precision_loss, reason = "a number of tasks")]
    let count = own.len() as f64;
    Score {
        planner: planner.to_owned(),
        tasks: own.len(),
        solved: solved.len(),
        satisficing: total(solved.iter().map(|measured| satisficing(measured, all))),
        agile: total(solved.iter().map(|measured| agile(measured))),
        par10: own.iter().map(time).sum::<f64>() / count.max(1.0),
        memory: own.iter().filter_map(|measured| measured.memory).max(),
    }
}

/// The sum, which is 0 for no numbers; that of the standard library is −0.
fn total(numbers: impl Iterator<Item = f64>) -> f64 {
    numbers.fold(0.0, |sum, number| sum + number)
}

/// The satisficing score: 1 for the best plan and for a right word that there is none; 0 where no ratio has a meaning.
fn satisficing(measured: &Measurement, all: &[Measurement]) -> f64 {
    if measured.is_unsolvable() {
        return 1.0;
    }
    let (Some(cost), Some(best)) = (measured.cost, best(&measured.task, all)) else { return 0.0 };
    match measured.maximize {
        _ if cost == best => 1.0,
        true => cost / best,
        false => best / cost,
    }
}

/// The best cost of the plans for a task; none where one of them has none, or a negative one, as ratios of those have
/// no meaning.
fn best(task: &str, all: &[Measurement]) -> Option<f64> {
    let plans = || all.iter().filter(|other| other.task == task && other.is_solved() && !other.is_unsolvable());
    let costs: Vec<f64> = plans().map(|plan| plan.cost.filter(|cost| *cost >= 0.0)).collect::<Option<_>>()?;
    let is_better = if plans().any(|plan| plan.maximize) { f64::max } else { f64::min };
    costs.into_iter().reduce(is_better)
}

/// The tasks that are solved by plans without a satisficing score: a cost is negative, or not known.
#[must_use]
pub fn unscored(measurements: &[Measurement]) -> Vec<&str> {
    let mut tasks: Vec<&str> = Vec::new();
    for measured in measurements.iter().filter(|measured| measured.is_solved() && !measured.is_unsolvable()) {
        if !tasks.contains(&measured.task.as_str()) && best(&measured.task, measurements).is_none() {
            tasks.push(&measured.task);
        }
    }
    tasks
}

/// Marks as wrong who says that a task has no plan where another planner has one that was simulated; returns the places.
pub fn refute(measurements: &mut [Measurement]) -> Vec<usize> {
    let mut wrong = Vec::new();
    for place in 0..measurements.len() {
        let claim = measurements.get(place).filter(|measured| measured.is_unsolvable());
        let Some(task) = claim.map(|claim| claim.task.clone()) else { continue };
        let other = measurements.iter().find(|other| other.task == task && other.is_simulated);
        let other = other.map(|other| other.planner.clone());
        if let (Some(other), Some(claim)) = (other, measurements.get_mut(place)) {
            claim.refute(&other);
            wrong.push(place);
        }
    }
    wrong
}

fn agile(measured: &Measurement) -> f64 {
    if measured.seconds <= 1.0 {
        return 1.0;
    }
    let share = measured.seconds.ln() / measured.timeout.ln();
    if share.is_finite() { (1.0 - share).clamp(0.0, 1.0) } else { 0.0 }
}

impl Score {
    /// The score as a document.
    #[must_use]
    pub fn listed(&self) -> Document {
        let count = to_i64::<usize>;
        let rounded = |number: f64| (number * 1e3).round() / 1e3;
        #[expect(clippy::cast_precision_loss, reason = "numbers of tasks")]
        let coverage = self.solved as f64 / (self.tasks as f64).max(1.0);
        doc! {
            "planner": &self.planner,
            "tasks": count(self.tasks),
            "solved": count(self.solved),
            "coverage": rounded(coverage),
            "ipc_satisficing": rounded(self.satisficing),
            "ipc_agile": rounded(self.agile),
            "par10": rounded(self.par10),
            "memory": self.memory,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured(task: &str, planner: &str, outcome: &str, seconds: f64, cost: Option<f64>) -> Measurement {
        Measurement {
            key: String::new(),
            task: task.to_owned(),
            planner: planner.to_owned(),
            outcome: outcome.to_owned(),
            seconds,
            cpu: None,
            memory: None,
            cost,
            maximize: false,
            makespan: None,
            is_simulated: outcome == "success",
            steps: None,
            timeout: 100.0,
            code: None,
            message: String::new(),
            provenance: Document::new(),
        }
    }

    #[test]
    fn a_planner_that_solves_nothing_scores_0() {
        let scores = scores(&[measured("one", "a", "timeout", 100.0, None)]);
        assert_eq!(scores[0].listed().get_f64("ipc_agile").unwrap().to_string(), "0");
    }

    #[test]
    fn a_metric_to_be_maximized_prefers_more() {
        let most =
            |planner, cost| Measurement { maximize: true, ..measured("one", planner, "success", 1.0, Some(cost)) };
        let satisficing = |all: &[Measurement]| scores(all).iter().map(|score| score.satisficing).collect::<Vec<_>>();
        assert_eq!(satisficing(&[most("a", 10.0), most("b", 5.0), most("c", 0.0)]), [1.0, 0.5, 0.0]);
        let mixed = [most("a", 10.0), most("b", -5.0)];
        assert_eq!((satisficing(&mixed), unscored(&mixed)), (vec![0.0, 0.0], vec!["one"]));
        let costs = [Some(0.0), Some(4.0)].map(|cost| measured("one", "a", "success", 1.0, cost));
        assert_eq!((satisficing(&costs), unscored(&costs)), (vec![1.0], Vec::<&str>::new()));
    }

    #[test]
    fn a_plan_refutes_who_says_that_there_is_none() {
        let mut all = [
            measured("one", "a", "unsolvable", 0.1, None),
            measured("one", "b", "success", 10.0, Some(8.0)),
            measured("two", "a", "unsolvable", 0.1, None),
        ];
        assert_eq!(refute(&mut all), [0]);
        assert_eq!(all[0].message, "it says that no plan exists, but b has a valid plan");
        let scores = scores(&all);
        assert_eq!((scores[0].solved, scores[0].satisficing, scores[0].agile), (1, 1.0, 1.0));
        all[1].is_simulated = false;
        "unsolvable".clone_into(&mut all[0].outcome);
        assert!(refute(&mut all).is_empty(), "a plan that was not simulated refutes nothing");
    }

    #[test]
    fn scores_are_those_of_the_competitions() {
        let all = [
            measured("one", "a", "success", 0.5, Some(10.0)),
            measured("one", "b", "success", 10.0, Some(8.0)),
            measured("two", "a", "timeout", 100.0, None),
            measured("two", "b", "unsolvable", 100.0, None),
            measured("three", "a", "success", 1.0, Some(0.0)),
            measured("three", "b", "invalid", 1.0, None),
        ];
        let scores = scores(&all);
        assert_eq!(scores.iter().map(|score| score.planner.as_str()).collect::<Vec<_>>(), ["a", "b"]);
        let a = &scores[0];
        assert_eq!((a.tasks, a.solved, a.satisficing, a.agile), (3, 2, 0.8 + 1.0, 2.0));
        assert!((a.par10 - (0.5 + 1000.0 + 1.0) / 3.0).abs() < 1e-9);
        let b = &scores[1];
        assert_eq!((b.solved, b.satisficing), (2, 2.0));
        assert!((b.agile - 0.5).abs() < 1e-9, "{}", b.agile);
        assert!((b.par10 - (10.0 + 100.0 + 1000.0) / 3.0).abs() < 1e-9);
    }
}
