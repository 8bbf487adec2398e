//! A task whose durative actions need no concurrency, by the search for classical tasks.
//!
//! Each durative action becomes an action that happens at once (`compress`). The plan is a right one, one step after the
//! other; then the steps are moved to where they may start first, by what they touch (`clock`, `shared`) and by when timed
//! facts hold (`windows`). Where ferroplan finds no plan for a task with timed literals about what actions change, or the
//! goal asks for, these are steps as well (`happen`).

mod asked;
mod clock;
mod compress;
mod happen;
mod shared;
mod snap;
mod windows;

use std::collections::{HashMap, HashSet};

use ferroplan::types::{Action, Domain, Effect, Formula, Problem};
use ferroplan::{Plan, Step};

pub(super) use asked::without_own;
use clock::Clock;
use compress::compressed;
use happen::World;
use snap::snapped;
use windows::{UNITS, Windows};

use super::classical::{self, Message, NUMERIC_WORK, Numeric};
use super::compared;
use super::convert::convert;
use super::ff_output::NoPlan;
use super::measure::Measure;
use super::options::Options;
use super::search::makespan::{Prices, Timing, WorkLimits, hasten};
use super::search::task::{OperatorId, Task};
use super::search::{End, Event, Ground, Improvement, Settings, ground, solve};

/// The length of the longest action in estimates.
const FINENESS: u64 = 16;

/// A unit of the metric has so many parts.
const FRACTIONS: f64 = 1_000_000.0;

/// The most that an action may cost.
const MOST: f64 = 1e6;

/// The work for a plan, after which ferroplan has its turn.
const WORK: u64 = 2_000_000_000;

/// The same where timed literals are steps of the plan. Ferroplan had its turn before, so this is what the answer that no
/// plan was found waits for: a few seconds, as for a proof.
const TIMED_WORK: u64 = 200_000_000;

/// The work for a plan that ends earlier, where improvement is bounded: about a third of a second.
const HASTE: u64 = 12_000_000;

/// Finds plans, each ending before the one before; `false` where there is none, or the task is not one of these.
pub(super) fn plan(
    domain: &Domain,
    problem: &Problem,
    options: Options,
    memory: usize,
    send: &mut dyn FnMut(Message<'_>),
) -> bool {
    let is_timed = !(domain.durative_actions.is_empty() && problem.til.is_empty());
    is_timed && search((domain, problem), None, options, memory, send)
}

/// As [`plan`], where timed literals are about what actions change, or the goal asks for: these are steps of the plan.
pub(super) fn plan_with_literals(
    domain: &Domain,
    problem: &Problem,
    options: Options,
    memory: usize,
    send: &mut dyn FnMut(Message<'_>),
) -> bool {
    let Some(World { domain, problem, moments }) = World::new(domain, problem) else { return false };
    search((&domain, &problem), Some(moments), options, memory, send)
}

/// Finds plans for a task, some of whose actions may happen by themselves at their moments.
fn search(
    (domain, problem): (&Domain, &Problem),
    moments: Option<HashMap<String, u64>>,
    options: Options,
    memory: usize,
    send: &mut dyn FnMut(Message<'_>),
) -> bool {
    if !domain.derived.is_empty() {
        return false;
    }
    let Some(windows) = Windows::new(domain, problem) else { return false };
    let compared = compared::functions(&joined(domain), problem);
    let flat = compressed(domain).or_else(|| compressed(&without_others(domain, &compared)));
    let Some(flat) = flat else { return false };
    let (flat, instance) = windows.opened(flat, problem);
    let grounded = &mut |action: &str, instances| send(Message::Progress(classical::grounding(action, instances)));
    let measured = has_other_metric(domain, problem)
        .then(|| Measure::new(domain, problem))
        .flatten()
        .and_then(|measure| priced(&measure, flat.clone(), instance.clone(), memory, grounded));
    let (mut task, prices) = match measured {
        Some((task, prices)) => (task, Some(prices)),
        None if !compared.is_empty() && has_other_metric(domain, problem) => return false,
        None => {
            let Some(task) = grounded_as(&flat, &Problem { metric: None, ..instance }, memory, grounded) else {
                return false;
            };
            (task, None)
        }
    };
    let work = match task.numbers.count {
        0 if moments.is_some() => TIMED_WORK,
        0 => WORK,
        _ => NUMERIC_WORK,
    };
    let clock = Clock::new(domain, problem, windows, compared, moments.unwrap_or_default());
    let timing = clock.limit(&mut task).and_then(|()| clock.timing(&task));
    let Some(mut timing) = timing else { return false };
    timing.prices = prices;
    let settings = Settings { improvement: Improvement::Brief, memory, work };
    let mut first = None;
    let end = solve(&task, settings, &mut |event| {
        if let Event::Plan(plan) = event {
            first = Some(plan.to_vec());
        }
    });
    let (Some(first), End::Solved) = (first, end) else { return false };
    // A plan that is made without a look at the clock may miss a window.
    let mut has_plan = false;
    let mut send_plan = |plan: Option<Plan>| {
        has_plan |= plan.is_some();
        plan.iter().for_each(|plan| send(Message::Plan(plan)));
    };
    send_plan(report(&task, &timing, &first));
    estimate(&mut task, &mut timing);
    let limits = WorkLimits { first: work, better: if options.anytime { u64::MAX } else { HASTE } };
    let known = timing.measured(&first);
    hasten(&task, &timing, known, limits, memory, &mut |steps| send_plan(report(&task, &timing, steps)));
    has_plan
}

fn grounded_as(
    domain: &Domain,
    problem: &Problem,
    memory: usize,
    grounded: &mut dyn FnMut(&str, usize),
) -> Option<Box<Task>> {
    let mut lifted = convert(domain, problem).ok()?;
    lifted.keeps_equals = true;
    match ground(&lifted, memory, grounded) {
        Ok(Ground::Task(task)) => Some(task),
        _ => None,
    }
}

/// The task whose operators cost what they add to the metric, and the prices; `None` where that is no sum of numbers above
/// zero.
fn priced(
    measure: &Measure,
    mut domain: Domain,
    mut problem: Problem,
    memory: usize,
    grounded: &mut dyn FnMut(&str, usize),
) -> Option<(Box<Task>, Prices)> {
    measure.apply(&mut domain, &mut problem);
    let task = grounded_as(&domain, &problem, memory, grounded)?;
    let price = |cost: f64| (0.0..MOST).contains(&cost).then(|| (cost * FRACTIONS).round() as u64);
    let operators = task.operators.iter().map(|operator| price(operator.cost)).collect::<Option<Vec<u64>>>()?;
    let time = price(measure.rate / UNITS)?;
    Some((task, Prices { time, operators }))
}

/// The domain with all that durative actions ask and do as if it were at one moment.
fn joined(domain: &Domain) -> Domain {
    let mut joined = domain.clone();
    joined.actions.extend(domain.durative_actions.iter().map(|action| Action {
        name: action.name.clone(),
        params: action.params.clone(),
        precond: Formula::And(action.conditions.iter().map(|(_, condition)| condition.clone()).collect()),
        effect: Effect::And(action.effects.iter().map(|(_, effect)| effect.clone()).collect()),
        monitored: false,
    }));
    joined
}

/// The domain whose durative actions change no values but those of some functions.
fn without_others(domain: &Domain, functions: &HashSet<String>) -> Domain {
    fn is_of(effect: &Effect, functions: &HashSet<String>) -> bool {
        match effect {
            Effect::Num(_, name, ..) => functions.contains(name),
            Effect::When(_, inner) | Effect::Forall(_, inner) => is_of(inner, functions),
            Effect::And(_) | Effect::Add(..) | Effect::Del(..) => true,
        }
    }
    fn keep(effect: &mut Effect, functions: &HashSet<String>) {
        match effect {
            Effect::And(parts) => {
                parts.retain(|part| is_of(part, functions));
                parts.iter_mut().for_each(|part| keep(part, functions));
            }
            Effect::When(_, inner) | Effect::Forall(_, inner) => keep(inner, functions),
            Effect::Add(..) | Effect::Del(..) | Effect::Num(..) => {}
        }
    }
    let mut domain = domain.clone();
    for action in &mut domain.durative_actions {
        action.effects.retain(|(_, effect)| is_of(effect, functions));
        action.effects.iter_mut().for_each(|(_, effect)| keep(effect, functions));
    }
    domain
}

/// Whether plans are measured by values that actions change, and not by their time.
fn has_other_metric(domain: &Domain, problem: &Problem) -> bool {
    let mut measured = HashSet::new();
    problem.metric.iter().for_each(|(_, expression)| compared::of_expression(expression, &mut measured));
    let effects = domain.durative_actions.iter().flat_map(|action| action.effects.iter().map(|(_, effect)| effect));
    let mut effects = effects.chain(domain.actions.iter().map(|action| &action.effect));
    effects.any(|effect| compress::changed(effect).iter().any(|name| measured.contains(*name)))
}

/// Why there is no plan, where that is proven in so much work: no order of starts and ends leads to the goal.
pub(super) fn refuted(domain: &Domain, problem: &Problem, memory: usize, work: u64) -> Option<NoPlan> {
    let (flat, instance) = snapped(domain, problem)?;
    let lifted = convert(&flat, &instance).ok()?;
    match ground(&lifted, memory, &mut |_, _| {}).ok()? {
        Ground::GoalFalse => Some(NoPlan::GoalFalse),
        Ground::Task(task) => match classical::refuted(&task, memory, work, &mut |_| {}) {
            Numeric::None(reason) => Some(reason),
            Numeric::Solved | Numeric::Open => None,
        },
    }
}

/// Makes durations, or what counts instead, the costs of operators, in units of which the longest has [`FINENESS`].
fn estimate(task: &mut Task, timing: &mut Timing) {
    let worths: Vec<u64> = (0..task.operators.len()).map(|operator| timing.worth(operator)).collect();
    timing.unit = (worths.iter().copied().max().unwrap_or(0) / FINENESS).max(1);
    for (operator, worth) in task.operators.iter_mut().zip(worths) {
        operator.cost = (worth / timing.unit).saturating_sub(1) as f64;
    }
}

fn report(task: &Task, timing: &Timing, plan: &[OperatorId]) -> Option<Plan> {
    let (starts, end) = timing.schedule(plan)?;
    let steps = starts.into_iter().zip(plan.iter().copied());
    let mut order: Vec<(u64, OperatorId)> = steps.filter(|(_, step)| !timing.happening.contains(step)).collect();
    order.sort_by_key(|(start, _)| *start);
    let step = |(index, (start, operator)): (usize, &(u64, OperatorId))| {
        let mut words = task.name(*operator).map(str::to_owned);
        let duration = timing.durations[*operator as usize] as f64 / UNITS;
        Step {
            index,
            action: words.next().unwrap_or_default(),
            args: words.collect(),
            time: Some(*start as f64 / UNITS),
            duration: Some(duration),
        }
    };
    let steps: Vec<Step> = order.iter().enumerate().map(step).collect();
    // Of plans with a metric, one that ends later may be the better one.
    let metric = timing.prices.as_ref().and_then(|_| timing.measured(plan)).map(|value| value as f64 / FRACTIONS);
    Some(Plan { length: steps.len(), steps, metric, makespan: Some(end as f64 / UNITS) })
}

#[cfg(test)]
mod tests {
    use ferroplan::parser::{parse_domain, parse_problem};

    use super::super::judge::Judge;
    use super::*;

    fn plans(domain: &str, problem: &str) -> Vec<Plan> {
        let mut judge = Judge::new(domain, problem);
        let (domain, problem) = (parse_domain(domain).unwrap(), parse_problem(problem).unwrap());
        let mut plans = Vec::new();
        let send = &mut |message: Message<'_>| {
            if let Message::Plan(plan) = message {
                assert!(judge.allows(plan), "{plan:?}: {:?}", judge.fault);
                plans.push(plan.clone());
            }
        };
        if !plan(&domain, &problem, Options::default(), 1 << 26, send) {
            plan_with_literals(&domain, &problem, Options::default(), 1 << 26, send);
        }
        plans
    }

    fn fixture(name: &str) -> String {
        std::fs::read_to_string(format!("{}/fixtures/tasks/{name}.pddl", env!("CARGO_MANIFEST_DIR"))).unwrap()
    }

    #[test]
    fn two_robots_carry_four_boxes_in_half_the_time_of_one() {
        let plans = plans(&fixture("delivery/domain"), &fixture("delivery/problem"));
        // Twice load, go, unload (3 + 8 + 2), and once back (8), with a thousandth between them.
        assert_eq!(plans.last().and_then(|plan| plan.makespan), Some(34.006));
    }

    #[test]
    fn an_action_that_another_one_has_to_be_within_is_left_to_ferroplan() {
        // There is light only while a match burns.
        let domain =
            "(define (domain cellar) (:requirements :strips :durative-actions) (:predicates (light) (dark) (fixed))
            (:durative-action burn :parameters () :duration (= ?duration 5) :condition (at start (dark))
              :effect (and (at start (light)) (at end (not (light)))))
            (:durative-action fix :parameters () :duration (= ?duration 3) :condition (over all (light))
              :effect (at end (fixed))))";
        let problem = "(define (problem fuse) (:domain cellar) (:init (dark)) (:goal (fixed)))";
        assert_eq!(plans(domain, problem).len(), 0);
    }

    #[test]
    fn what_an_action_itself_brings_about_it_does_not_need() {
        let domain = "(define (domain oven) (:requirements :strips :durative-actions) (:predicates (hot) (baked))
            (:durative-action bake :parameters () :duration (= ?duration 5) :condition (over all (hot))
              :effect (and (at start (hot)) (at end (baked)))))";
        let problem = "(define (problem bread) (:domain oven) (:init) (:goal (baked)))";
        assert_eq!(plans(domain, problem).last().and_then(|plan| plan.makespan), Some(5.0));
    }

    #[test]
    fn a_resource_that_is_given_back_is_used_by_one_at_a_time() {
        let domain = "(define (domain print) (:requirements :strips :typing :durative-actions) (:types page)
            (:predicates (free) (printed ?p - page))
            (:durative-action print :parameters (?p - page) :duration (= ?duration 2) :condition (at start (free))
              :effect (and (at start (not (free))) (at end (free)) (at end (printed ?p)))))";
        let problem = "(define (problem two) (:domain print) (:objects a b - page) (:init (free))
            (:goal (and (printed a) (printed b))))";
        assert_eq!(plans(domain, problem).last().and_then(|plan| plan.makespan), Some(4.001));
    }

    #[test]
    fn what_an_action_takes_away_at_its_start_it_cannot_need_later() {
        let domain = "(define (domain stand) (:requirements :strips :typing :durative-actions) (:types hand)
            (:predicates (free ?h - hand) (held))
            (:durative-action hold :parameters (?a ?b - hand) :duration (= ?duration 2)
              :condition (and (at start (free ?a)) (over all (free ?b)))
              :effect (and (at start (not (free ?a))) (at end (held)))))";
        let problem = |hands: &str, free: &str| {
            format!("(define (problem one) (:domain stand) (:objects {hands} - hand) (:init {free}) (:goal (held)))")
        };
        let with_two = plans(domain, &problem("l r", "(free l) (free r)"));
        let arguments: Vec<_> = with_two.iter().flat_map(|plan| &plan.steps).map(|step| step.args.clone()).collect();
        assert_eq!(arguments, [["R", "L"]]);
        assert_eq!(plans(domain, &problem("l", "(free l)")).len(), 0);
    }

    #[test]
    fn what_an_action_brings_for_its_own_time_does_not_stay() {
        let domain = "(define (domain lamp) (:requirements :strips :typing :durative-actions) (:types lamp)
            (:predicates (lit ?l - lamp))
            (:durative-action swap :parameters (?on ?off - lamp) :duration (= ?duration 2)
              :effect (and (at start (lit ?on)) (at end (not (lit ?off))))))";
        let problem = |lamps: &str| {
            format!("(define (problem one) (:domain lamp) (:objects {lamps} - lamp) (:init) (:goal (lit a)))")
        };
        let with_two = plans(domain, &problem("a b"));
        assert_eq!(with_two.last().map(|plan| plan.steps[0].args.clone()), Some(vec!["A".to_owned(), "B".to_owned()]));
        assert_eq!(plans(domain, &problem("a")).len(), 0);
    }

    /// Rovers that drive as far as their batteries lead them, and take samples.
    fn rovers(battery: f64, metric: &str) -> Vec<f64> {
        let domain = "(define (domain rover) (:requirements :strips :typing :durative-actions :numeric-fluents)
            (:types rover place) (:predicates (at ?r - rover ?p - place) (sampled ?p - place))
            (:functions (battery ?r - rover) (length ?a ?b - place) (used))
            (:durative-action drive :parameters (?r - rover ?a ?b - place) :duration (= ?duration (length ?a ?b))
              :condition (and (at start (at ?r ?a)) (at start (>= (battery ?r) (length ?a ?b))))
              :effect (and (at start (not (at ?r ?a))) (at end (at ?r ?b)) (at end (increase (used) 1))
                (at start (decrease (battery ?r) (length ?a ?b)))))
            (:durative-action sample :parameters (?r - rover ?p - place) :duration (= ?duration 2)
              :condition (over all (at ?r ?p)) :effect (at end (sampled ?p))))";
        let problem = format!(
            "(define (problem two) (:domain rover) (:objects r s - rover a b c - place)
            (:init (at r a) (at s a) (= (battery r) {battery}) (= (battery s) {battery}) (= (used) 0)
              (= (length a b) 3) (= (length b a) 3) (= (length b c) 4) (= (length c b) 4))
            (:goal (and (sampled a) (sampled b) (sampled c))) {metric})"
        );
        plans(domain, &problem).iter().filter_map(|plan| plan.makespan).collect()
    }

    #[test]
    fn what_changes_numbers_overlaps_where_they_are_others() {
        assert_eq!(rovers(20.0, "").last(), Some(&9.002));
        assert_eq!(rovers(7.0, "(:metric minimize (total-time))").last(), Some(&9.002));
        // A battery does not last for both roads.
        assert_eq!(rovers(6.0, "").len(), 0);
    }

    #[test]
    fn numbers_that_no_condition_reads_do_not_matter() {
        let domain = "(define (domain meter) (:requirements :strips :durative-actions :numeric-fluents)
            (:predicates (done)) (:functions (used) (rate))
            (:durative-action work :parameters () :duration (= ?duration 3)
              :effect (and (at start (increase (rate) 1)) (at end (increase (used) (rate))) (at end (done)))))";
        let problem = "(define (problem one) (:domain meter) (:init (= (used) 0) (= (rate) 0)) (:goal (done)))";
        assert_eq!(plans(domain, problem).last().and_then(|plan| plan.makespan), Some(3.0));
    }

    #[test]
    fn a_metric_that_is_a_sum_of_time_and_numbers_is_minimized() {
        // One rover drives twice, or each of two once and then one of them again.
        assert_eq!(rovers(20.0, "(:metric minimize (+ (total-time) (* 10 (used))))").last(), Some(&11.003));
        assert_eq!(rovers(20.0, "(:metric minimize (+ (total-time) (* 0.001 (used))))").last(), Some(&9.002));
        // The battery is worth the more the fuller it is left.
        assert_eq!(rovers(20.0, "(:metric maximize (- (battery r) (* 5 (battery s))))").len(), 0);
    }

    #[test]
    fn actions_that_change_one_value_at_their_ends_overlap() {
        let domain =
            "(define (domain fill) (:requirements :strips :typing :durative-actions :numeric-fluents) (:types pump)
            (:predicates (dry ?p - pump)) (:functions (litres))
            (:durative-action fill :parameters (?p - pump) :duration (= ?duration 2) :condition (at start (dry ?p))
              :effect (at end (increase (litres) 1))))";
        let problem =
            "(define (problem two) (:domain fill) (:objects p q - pump) (:init (dry p) (dry q) (= (litres) 0))
            (:goal (>= (litres) 2)))";
        assert_eq!(plans(domain, problem).last().and_then(|plan| plan.makespan), Some(2.0));
    }

    /// A tank of which two may draw a litre each, with what holds of it meanwhile, and what they do to it.
    fn tank(litres: u8, condition: &str, effects: &str) -> Option<f64> {
        let domain = format!(
            "(define (domain tank) (:requirements :strips :typing :durative-actions :numeric-fluents) (:types pump)
            (:predicates (full ?p - pump)) (:functions (litres))
            (:durative-action draw :parameters (?p - pump) :duration (= ?duration 5)
              :condition (and (at start (>= (litres) 1)) {condition})
              :effect (and {effects} (at end (full ?p)))))"
        );
        let problem = format!(
            "(define (problem two) (:domain tank) (:objects p q - pump) (:init (= (litres) {litres}))
            (:goal (and (full p) (full q))))"
        );
        plans(&domain, &problem).last()?.makespan
    }

    #[test]
    fn what_is_given_back_is_taken_by_as_many_at_once_as_it_is_enough_for() {
        let borrow = "(at start (decrease (litres) 1)) (at end (increase (litres) 1))";
        assert_eq!(tank(1, "", borrow), Some(10.001));
        assert_eq!(tank(2, "", borrow), Some(5.001));
        assert_eq!(tank(2, "(at start (<= (litres) 1))", borrow), None);
        // What is set is no sum.
        assert_eq!(
            tank(2, "", "(at start (decrease (litres) 1)) (at end (full p)) (at end (assign (litres) 2))"),
            None
        );
        assert_eq!(tank(1, "", "(at start (decrease (litres) 1))"), None);
        assert_eq!(tank(2, "", "(at start (decrease (litres) 1))"), Some(5.001));
    }

    #[test]
    fn two_workers_do_three_jobs_in_the_time_of_two() {
        let workshop = |workers: &str, job: &str| {
            let domain = format!(
                "(define (domain workshop) (:requirements :strips :typing :durative-actions :numeric-fluents) (:types job)
                (:predicates (done ?j - job)) (:functions (workers) (need ?j - job))
                (:durative-action work :parameters (?j - job) :duration (= ?duration 3) {job}
                (:action hire :parameters () :precondition (< (workers) 1) :effect (increase (workers) 1)))"
            );
            let problem = format!(
                "(define (problem three) (:domain workshop) (:objects a b c - job)
                (:init (= (workers) {workers}) (= (need a) 1) (= (need b) 1) (= (need c) 2))
                (:goal (and (done a) (done b) (done c))))"
            );
            plans(&domain, &problem).last()?.makespan
        };
        let one = ":condition (at start (<= 1 (workers)))
            :effect (and (at start (decrease (workers) 1)) (at end (increase (workers) 1)) (at end (done ?j))))";
        assert_eq!(workshop("2", one), Some(6.002));
        assert_eq!(workshop("3", one), Some(3.002));
        assert_eq!(workshop("0", one), Some(9.003), "one is hired");
        let needed = ":condition (at start (>= (workers) (need ?j)))
            :effect (and (at start (decrease (workers) (need ?j))) (at end (increase (workers) (need ?j))) (at end (done ?j))))";
        assert_eq!(workshop("2", needed), Some(6.002));
        assert_eq!(workshop("3", needed), Some(6.002));
    }

    #[test]
    fn numbers_that_an_action_changes_and_reads_later_are_left_to_ferroplan() {
        let draw = "(at start (decrease (litres) 1))";
        assert_eq!(tank(5, "(over all (>= (litres) 0))", draw), None);
        assert_eq!(tank(5, "(at end (>= (litres) 0))", draw), None);
        assert_eq!(tank(5, "", &format!("{draw} (at end (increase (litres) (* 2 (litres))))")), None);
        assert_eq!(tank(5, "", &format!("{draw} (at end (assign (litres) 5))")), None);
        assert_eq!(tank(5, "", &format!("{draw} (at end (when (> (litres) 3) (full q)))")), None);
    }

    /// A shop that opens and closes, an hour's work for each order, and robots that fill one each at a time.
    fn shop(robots: &str, opening: &str) -> Vec<f64> {
        let domain = "(define (domain shop) (:requirements :strips :typing :durative-actions :timed-initial-literals)
            (:types robot order) (:predicates (idle ?r - robot) (open) (filled ?o - order))
            (:durative-action fill :parameters (?r - robot ?o - order) :duration (= ?duration 10)
              :condition (and (at start (idle ?r)) (over all (open)))
              :effect (and (at start (not (idle ?r))) (at end (idle ?r)) (at end (filled ?o)))))";
        let idle: String = robots.split(' ').map(|robot| format!("(idle {robot}) ")).collect();
        let problem = format!(
            "(define (problem day) (:domain shop) (:objects {robots} - robot a b - order) (:init {idle}{opening})
            (:goal (and (filled a) (filled b))))"
        );
        let plans = plans(domain, &problem);
        let mut starts: Vec<f64> =
            plans.last().iter().flat_map(|plan| &plan.steps).filter_map(|step| step.time).collect();
        starts.sort_by(f64::total_cmp);
        starts
    }

    #[test]
    fn a_deadline_is_met_or_there_is_no_plan() {
        assert_eq!(shop("r", "(open) (at 30 (not (open)))"), [0.0, 10.001]);
        assert_eq!(shop("r", "(open) (at 15 (not (open)))"), [0.0; 0]);
        assert_eq!(shop("r s", "(open) (at 15 (not (open)))"), [0.0, 0.0]);
        // It closes in the moment in which the second order would be filled.
        assert_eq!(shop("r", "(open) (at 20.001 (not (open)))"), [0.0; 0]);
    }

    #[test]
    fn what_opens_later_is_waited_for() {
        assert_eq!(shop("r s", "(at 5 (open))"), [5.001, 5.001]);
        // The first hours are too short for a second order.
        assert_eq!(shop("r", "(open) (at 12 (not (open))) (at 100 (open))"), [0.0, 100.001]);
    }

    /// A door that closes by itself and is opened by whoever has the time, and a cat that goes through.
    fn door(init: &str, goal: &str) -> Option<Vec<(f64, String)>> {
        let domain = "(define (domain door) (:requirements :strips :durative-actions :timed-initial-literals)
            (:predicates (open) (light) (inside) (outside) (idle))
            (:durative-action push :parameters () :duration (= ?duration 2) :condition (at start (idle))
              :effect (and (at start (not (idle))) (at end (open)) (at end (idle))))
            (:durative-action go :parameters () :duration (= ?duration 3)
              :condition (and (at start (outside)) (over all (open)) (at start (light)))
              :effect (and (at start (not (outside))) (at end (inside)))))";
        let problem = format!("(define (problem cat) (:domain door) (:init (idle) (outside) {init}) (:goal {goal}))");
        let mut steps = plans(domain, &problem).pop()?.steps;
        steps.sort_by(|one, other| one.time.unwrap().total_cmp(&other.time.unwrap()));
        Some(steps.into_iter().map(|step| (step.time.unwrap(), step.action)).collect())
    }

    #[test]
    fn what_time_takes_away_is_made_again_after_it() {
        let step = |time: f64, action: &str| (time, action.to_owned());
        assert_eq!(door("(open) (at 5 (not (open)))", "(open)"), Some(vec![step(3.001, "PUSH")]));
        assert_eq!(door("(open) (at 5 (not (open))) (at 7.5 (open))", "(open)"), Some(Vec::new()));
        assert_eq!(door("(at 1 (open)) (at 9 (not (open)))", "(open)"), Some(vec![step(7.001, "PUSH")]));
        // The cat is through before it closes, or goes when it was opened again.
        let through = door("(light) (open) (at 5 (not (open)))", "(and (inside) (open))");
        assert_eq!(through, Some(vec![step(0.0, "GO"), step(3.001, "PUSH")]));
        let later = door("(open) (at 2 (light)) (at 5 (not (open)))", "(inside)");
        assert_eq!(later, Some(vec![step(3.001, "PUSH"), step(5.002, "GO")]));
    }

    #[test]
    fn what_time_takes_away_for_good_has_no_plan() {
        let refuted = |init: &str, goal: &str| {
            let domain = "(define (domain dusk) (:requirements :strips :durative-actions :timed-initial-literals)
                (:predicates (light) (seen)) (:durative-action look :parameters () :duration (= ?duration 3)
                  :condition (over all (light)) :effect (at end (seen))))";
            let problem = format!("(define (problem day) (:domain dusk) (:init {init}) (:goal {goal}))");
            let (domain, problem) = (parse_domain(domain).unwrap(), parse_problem(&problem).unwrap());
            (super::refuted(&domain, &problem, 1 << 26, 1_000_000)).is_some()
        };
        assert!(refuted("(light) (at 5 (not (light)))", "(and (seen) (light))"));
        assert!(!refuted("(light) (at 5 (not (light))) (at 6 (light))", "(and (seen) (light))"));
        assert!(!refuted("(light) (at 5 (not (light)))", "(seen)"));
    }

    /// Washing takes as long as it takes, and what it needs.
    fn wash(duration: &str, needs: &str, effects: &str, init: &str) -> Option<(f64, f64)> {
        let domain = format!(
            "(define (domain wash) (:requirements :strips :durative-actions :timed-initial-literals
              :duration-inequalities :negative-preconditions) (:predicates (rain) (dirty) (clean) (hung))
            (:durative-action wash :parameters () :duration {duration} :condition (and (at start (dirty)) {needs})
              :effect (and (at end (clean)) {effects}))
            (:durative-action hang :parameters () :duration (= ?duration 1) :condition (at start (clean))
              :effect (at end (hung))))"
        );
        let problem = format!("(define (problem day) (:domain wash) (:init (dirty) {init}) (:goal (hung)))");
        let plans = plans(&domain, &problem);
        let first = plans.last()?.steps.first()?;
        Some((first.time?, first.duration?))
    }

    #[test]
    fn what_takes_no_time_starts_and_ends_at_one_moment() {
        assert_eq!(wash("(= ?duration 0)", "", "", ""), Some((0.0, 0.0)));
        // Its end takes away what its start needs, which does not go at one moment.
        assert_eq!(wash("(= ?duration 0)", "", "(at end (not (dirty)))", ""), None);
        assert_eq!(wash("(= ?duration 0)", "(at end (rain))", "(at start (rain))", ""), None);
        // Between a start and an end at one moment nothing has to hold.
        assert_eq!(wash("(= ?duration 0)", "(over all (rain))", "", ""), Some((0.0, 0.0)));
        // It may take longer.
        assert_eq!(wash("(>= ?duration 0)", "", "(at end (not (dirty)))", ""), Some((0.0, 0.001)));
        assert_eq!(
            wash("(and (>= ?duration 0) (<= ?duration 2))", "", "(at end (not (dirty)))", ""),
            Some((0.0, 0.001))
        );
    }

    #[test]
    fn what_has_to_be_false_is_waited_for() {
        let wash = |moment: &str, init: &str| {
            wash("(= ?duration 4)", &format!("({moment} (not (rain)))"), "", init).map(|(start, _)| start)
        };
        assert_eq!(wash("over all", "(rain) (at 7 (not (rain)))"), Some(7.001));
        assert_eq!(wash("over all", "(at 2 (rain)) (at 7 (not (rain)))"), Some(7.001));
        assert_eq!(wash("at start", "(at 2 (rain)) (at 7 (not (rain)))"), Some(0.0));
        assert_eq!(wash("at end", "(at 2 (rain)) (at 7 (not (rain)))"), Some(3.001));
        assert_eq!(wash("over all", "(rain)"), None);
        assert_eq!(wash("over all", "(at 3 (rain))"), None);
    }

    #[test]
    fn a_timed_fact_that_changes_nothing_is_not_read_at_its_moment() {
        let wash = |moment: &str, init: &str| {
            wash("(= ?duration 4)", &format!("({moment} (rain))"), "", init).map(|(start, _)| start)
        };
        // It rains all the time.
        assert_eq!(wash("over all", "(rain) (at 2 (rain))"), Some(0.0));
        assert_eq!(wash("at start", "(rain) (at 0 (rain))"), Some(0.001));
        assert_eq!(wash("at end", "(rain) (at 4 (rain))"), Some(0.001));
        // What is taken away and brought at once stays.
        assert_eq!(wash("over all", "(rain) (at 2 (not (rain))) (at 2 (rain))"), Some(0.0));
        // At 0.57, which is 569.999… thousandths, it is still to come.
        assert_eq!(wash("at start", "(at 0.57 (rain))"), Some(0.571));
    }
}
