//! Whether a plan holds by the rules of the validator, before it is given out.
//!
//! ferroplan and the searches compress time and relax numbers; where one of their plans does not hold, the plan before it
//! is still the best one.

use std::cell::OnceCell;

use ferroplan::Plan;

use super::ff_output;
use crate::formats::Source;
use crate::formats::pddl::Dialect;
use crate::formats::plan::ff;
use crate::pddl::{self, Domain, Problem, Step, Validation, validate};
use crate::planner::run::spaced;
use crate::planner::task::Task;

/// How many steps are simulated to find out which a plan does not need.
const WORK: usize = 50_000;

/// Judges the plans for a task.
pub(super) struct Judge<'t> {
    domain: &'t str,
    problem: &'t str,
    /// The task as the validator reads it, where it does.
    read: OnceCell<Option<(Domain, Problem)>>,
    /// Whether a plan was found to hold.
    pub(super) has_plan: bool,
    /// What was wrong with the last plan that did not hold.
    pub(super) fault: Option<String>,
}

impl<'t> Judge<'t> {
    /// For the texts of a task.
    pub(super) fn new(domain: &'t str, problem: &'t str) -> Self {
        Self { domain, problem, read: OnceCell::new(), has_plan: false, fault: None }
    }

    /// Whether a plan of this task holds, as it is printed; one that cannot be simulated is taken to hold.
    pub(super) fn allows(&mut self, plan: &Plan) -> bool {
        match self.wrong(plan) {
            None => self.has_plan = true,
            fault => {
                self.fault = fault;
                return false;
            }
        }
        true
    }

    /// Whether a plan was simulated, and holds.
    #[cfg(test)]
    pub(super) fn is_valid(&self, plan: &Plan) -> bool {
        let Some((domain, problem)) = self.read.get_or_init(|| self.read()) else { return false };
        matches!(validate(domain, problem, &steps(plan)), Validation::Valid { .. })
    }

    /// The plan without the actions that it does not need: each with what cannot be applied without it (Nakhost and
    /// Müller 2010), where the rest holds and is not worse. None where it needs all, has no times, or is not simulated.
    pub(super) fn without_needless(&self, plan: &Plan) -> Option<Plan> {
        let (domain, problem) = self.read.get_or_init(|| self.read()).as_ref()?;
        let mut plan = plan.clone();
        plan.steps.sort_by(|one, other| one.time.unwrap_or_default().total_cmp(&other.time.unwrap_or_default()));
        let mut steps = steps(&plan);
        if steps.len() != plan.steps.len() || steps.iter().any(|step| step.start.is_none()) {
            return None;
        }
        let Validation::Valid { value: Some(mut value) } = validate(domain, problem, &steps) else { return None };
        let sign = if problem.tree().metric.as_ref().is_some_and(|metric| !metric.minimize) { -1.0 } else { 1.0 };
        let (mut place, mut work, count) = (0, 0, steps.len());
        while place < steps.len() && work < WORK {
            let mut kept: Vec<usize> = (0..steps.len()).filter(|index| *index != place).collect();
            let better = loop {
                let rest: Vec<Step> = kept.iter().filter_map(|index| steps.get(*index)).cloned().collect();
                work += rest.len() + 1;
                match validate(domain, problem, &rest) {
                    Validation::Valid { value: Some(now) } if sign * now <= sign * value => break Some((rest, now)),
                    Validation::Invalid(fault) if work < WORK => match fault.step().filter(|step| *step < kept.len()) {
                        Some(step) => drop(kept.remove(step)),
                        None => break None,
                    },
                    _ => break None,
                }
            };
            match better {
                Some((rest, now)) => {
                    (steps, value) = (rest, now);
                    plan.steps = kept.iter().filter_map(|index| plan.steps.get(*index)).cloned().collect();
                }
                None => place += 1,
            }
        }
        if steps.len() == count {
            return None;
        }
        plan.steps.iter_mut().enumerate().for_each(|(index, step)| step.index = index);
        plan.length = plan.steps.len();
        plan.metric = plan.metric.map(|_| value);
        let ends = plan.steps.iter().map(|step| step.time.unwrap_or_default() + step.duration.unwrap_or_default());
        plan.makespan = plan.makespan.map(|_| ends.fold(0.0, f64::max));
        Some(plan)
    }

    /// What is wrong with a plan.
    fn wrong(&self, plan: &Plan) -> Option<String> {
        let (domain, problem) = self.read.get_or_init(|| self.read()).as_ref()?;
        let steps = steps(plan);
        match validate(domain, problem, &steps) {
            Validation::Invalid(fault) => {
                let plan = pddl::Plan { steps, cost: None };
                spaced(&plan, &Task { domain, problem }).is_none().then(|| fault.to_string())
            }
            Validation::Valid { .. } | Validation::Unchecked(_) => None,
        }
    }

    fn read(&self) -> Option<(Domain, Problem)> {
        let domain = Domain::read(&Source::new("domain", self.domain), Dialect::default()).ok()?;
        let problem = Problem::read(&Source::new("problem", self.problem), &domain, Dialect::default()).ok()?;
        Some((domain, problem))
    }
}

/// The steps of a plan as it is printed, in order of time.
fn steps(plan: &Plan) -> Vec<Step> {
    let printed = ff::read(&ff_output::plan(plan, None), "");
    let mut steps: Vec<Step> = printed.actions.into_iter().map(Step::from).collect();
    steps.sort_by(|one, other| one.start.unwrap_or_default().total_cmp(&other.start.unwrap_or_default()));
    steps
}

#[cfg(test)]
mod tests {
    use ferroplan::Step;

    use super::*;

    const DOMAIN: &str = "(define (domain d) (:requirements :strips :typing :fluents :durative-actions) (:types r p)
        (:predicates (at ?r - r ?p - p) (cleaned ?p - p)) (:functions (battery ?r - r))
        (:durative-action drive :parameters (?r - r ?a ?b - p) :duration (= ?duration 4)
          :condition (and (at start (at ?r ?a)) (at start (>= (battery ?r) 1)))
          :effect (and (at start (not (at ?r ?a))) (at start (decrease (battery ?r) 1)) (at end (at ?r ?b))))
        (:durative-action clean :parameters (?r - r ?p - p) :duration (= ?duration 2) :condition (over all (at ?r ?p))
          :effect (at end (cleaned ?p))))";

    /// The steps that are left of a plan, and its end.
    fn left(metric: &str, steps: &[(f64, &str, &[&str])]) -> Option<(Vec<String>, Option<f64>)> {
        let problem = format!(
            "(define (problem p) (:domain d) (:objects r - r a b - p) (:init (at r a) (= (battery r) 9))
             (:goal (cleaned b)) {metric})"
        );
        let step = |(index, (time, action, args)): (usize, &(f64, &str, &[&str]))| Step {
            index,
            action: (*action).to_owned(),
            args: args.iter().map(|name| (*name).to_owned()).collect(),
            time: Some(*time),
            duration: Some(if *action == "drive" { 4.0 } else { 2.0 }),
        };
        let steps: Vec<Step> = steps.iter().enumerate().map(step).collect();
        let end = steps.iter().filter_map(|step| Some(step.time? + step.duration?)).fold(0.0, f64::max);
        let plan = Plan { length: steps.len(), steps, metric: None, makespan: Some(end) };
        let plan = Judge::new(DOMAIN, &problem).without_needless(&plan)?;
        let words = plan.steps.iter().map(|step| format!("{} {}", step.action, step.args.join(" ")));
        Some((words.collect(), plan.makespan))
    }

    #[test]
    fn a_drive_away_and_back_is_left_out() {
        let needed: [(f64, &str, &[&str]); 2] = [(0.0, "drive", &["r", "a", "b"]), (4.1, "clean", &["r", "b"])];
        let wanted = || Some((vec!["drive r a b".to_owned(), "clean r b".to_owned()], Some(6.1)));
        for metric in ["", "(:metric minimize (total-time))"] {
            assert_eq!(left(metric, &needed), None, "it needs both");
            let behind: [(f64, &str, &[&str]); 2] =
                [(6.2, "drive", &["r", "b", "a"]), (10.3, "drive", &["r", "a", "b"])];
            assert_eq!(left(metric, &[&needed[..], &behind].concat()), wanted());
            assert_eq!(left(metric, &[&needed[..], &behind[..1]].concat()), wanted());
        }
        let behind: [(f64, &str, &[&str]); 1] = [(6.2, "drive", &["r", "b", "a"])];
        let battery = "(:metric minimize (battery r))";
        assert_eq!(left(battery, &[&needed[..], &behind].concat()), None, "what makes the metric better stays");
    }
}
