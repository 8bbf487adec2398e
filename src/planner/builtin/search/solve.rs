//! Searches in turn, in slices of work.
//!
//! Where one search finds a plan in a blink, another may not find any: so each works for a while, remembers where it was,
//! and goes on twice as long when it is its turn again. Work is counted, in rules of the relaxed task that were touched
//! for the most part: the same task has the same plan everywhere. What two searches have not found in their first slices
//! may not be there: from then on, a proof of that is looked for as well.

use super::axiom::Axioms;
use super::improve::Improver;
use super::landmark::{back, count::Counter, reasonable};
use super::lazy::{Aim, Lazy, Step};
use super::prove::{Prover, obstacle};
use super::relaxed::{Costs, Relaxed};
use super::shorten::eliminate;
use super::successor::{Generator, holds};
use super::task::{Fact, OperatorId, Task};
use super::width::Width;

/// The work of the first slices.
const SLICE: u64 = 20_000_000;

/// The work for a better plan where that is bounded.
const BOUNDED: std::ops::Range<u64> = 4_000_000..50_000_000;

/// What to look for, and with how much.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Settings {
    /// How long to look for better plans after the first one.
    pub improvement: Improvement,
    /// How many bytes the states may take.
    pub memory: usize,
    /// The work after which the search for a first plan gives up.
    pub work: u64,
}

/// How long to look for better plans.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Improvement {
    /// Only drop what a plan does not need.
    Brief,
    /// A part of what the first plan took.
    Bounded,
    /// Until there is none.
    Unbounded,
}

/// What happens during a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Event<'p> {
    /// A plan, better than those before.
    Plan(&'p [OperatorId]),
    /// How many states were reached so far.
    States(usize),
    /// What no state can have, as PDDL: the task has no plan.
    Obstacle(&'p str),
}

/// How a search ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// With the plans that were reported.
    Solved,
    /// All states were looked at, or shown to lead nowhere, or facts that a plan needs are never true together.
    Unsolvable,
    /// There is no room for more states.
    Full,
    /// The work is done.
    Spent,
}

/// Searches for plans, and says them as they are found.
pub fn solve(task: &Task, settings: Settings, report: &mut dyn FnMut(Event<'_>)) -> End {
    let mut init = task.init.clone();
    Axioms::new(task).derive(task, &mut init);
    if holds(task, &init, &task.goal) {
        report(Event::Plan(&[]));
        return End::Solved;
    }
    if is_refuted(task, &init, report) {
        return End::Unsolvable;
    }
    let generator = Generator::new(task);
    let mut relaxed = Relaxed::new(task, Costs::Unit);
    if !relaxed.explore(&init, &task.goal) {
        // What the estimates make of numbers is no proof.
        return if task.numbers.count == 0 { End::Unsolvable } else { prove(task, settings, report) };
    }
    let mut graph = back::landmarks(task, &mut relaxed);
    reasonable::order(task, &relaxed, &mut graph);
    let counter = Counter::new(task, &graph);
    drop(graph);
    let costs = scaled(task);
    let (plan, spent) = match first(task, &generator, &counter, &costs, relaxed, &init, settings, report) {
        Ok(plan) => plan,
        Err(end) => return end,
    };
    let plan = eliminate(task, &init, &plan);
    report(Event::Plan(&plan));
    let work = match settings.improvement {
        Improvement::Brief => 0,
        Improvement::Bounded => (spent / 4).clamp(BOUNDED.start, BOUNDED.end),
        Improvement::Unbounded => u64::MAX,
    };
    if work > 0 {
        let found = &mut |plan: &[OperatorId]| report(Event::Plan(plan));
        let memory = settings.memory;
        let (counter, costs) = (&counter, costs.as_slice());
        let mut improver = Improver { task, generator: &generator, counter, costs, init, memory, plan, found };
        improver.run(Relaxed::new(task, Costs::PlusOne), work);
    }
    End::Solved
}

/// Looks for a proof that there is no plan, and for nothing else; where there is a plan, it may be found on the way.
pub fn prove(task: &Task, settings: Settings, report: &mut dyn FnMut(Event<'_>)) -> End {
    let mut init = task.init.clone();
    Axioms::new(task).derive(task, &mut init);
    if holds(task, &init, &task.goal) {
        report(Event::Plan(&[]));
        return End::Solved;
    }
    if is_refuted(task, &init, report) {
        return End::Unsolvable;
    }
    let mut prover = Prover::new(task);
    let mut left = settings.work;
    loop {
        let work = left.min(SLICE);
        match prover.run(work, settings.memory) {
            Step::Plan(plan) => {
                report(Event::Plan(&plan));
                return End::Solved;
            }
            Step::Exhausted => return End::Unsolvable,
            Step::Full => return End::Full,
            Step::Spent if left == work => return End::Spent,
            Step::Spent => {}
        }
        report(Event::States(prover.states()));
        left -= work;
    }
}

/// Whether the bounds of numbers show that there is no plan.
fn is_refuted(task: &Task, init: &[Fact], report: &mut dyn FnMut(Event<'_>)) -> bool {
    let found = if task.numbers.count > 0 { obstacle(task, init, SLICE) } else { None };
    found.iter().for_each(|text| report(Event::Obstacle(text)));
    found.is_some()
}

#[allow(clippy::too_many_arguments)]
fn first(
    task: &Task,
    generator: &Generator,
    counter: &Counter,
    costs: &[u32],
    relaxed: Relaxed,
    init: &[Fact],
    settings: Settings,
    report: &mut dyn FnMut(Event<'_>),
) -> Result<(Vec<OperatorId>, u64), End> {
    let aim = Aim { init: init.to_vec(), goal: task.goal.clone(), weight: None, bound: u64::MAX };
    let mut lazy = Lazy::new(task, generator, counter, costs, relaxed.clone(), aim);
    let mut width: Option<Width<'_>> = None;
    let mut prover = Prover::new(task);
    let memory = settings.memory / 4;
    let (mut work, mut is_full) = (SLICE, [false; 3]);
    // These searches leave out what the estimates make of numbers.
    let is_proof = task.numbers.count == 0;
    while is_full.contains(&false) {
        if !is_full[0] {
            match lazy.run(work, memory * 2) {
                Step::Plan(plan) => return Ok((plan, lazy.work())),
                Step::Exhausted if is_proof => return Err(End::Unsolvable),
                Step::Spent => {}
                Step::Exhausted | Step::Full => is_full[0] = true,
            }
        }
        let search = width.get_or_insert_with(|| Width::new(task, generator, counter, relaxed.clone()));
        if !is_full[1] {
            match search.run(work / 2, memory) {
                Step::Plan(plan) => return Ok((plan, search.work())),
                Step::Exhausted if is_proof => return Err(End::Unsolvable),
                Step::Spent => {}
                Step::Exhausted | Step::Full => is_full[1] = true,
            }
        }
        if !is_full[2] {
            match prover.run(work / 8, memory) {
                Step::Plan(plan) => return Ok((plan, lazy.work())),
                Step::Exhausted => return Err(End::Unsolvable),
                Step::Spent => {}
                Step::Full => is_full[2] = true,
            }
        }
        report(Event::States(lazy.states() + search.states() + prover.states()));
        if work > settings.work {
            return Err(End::Spent);
        }
        work = work.saturating_mul(2);
    }
    Err(End::Full)
}

/// The costs of operators as whole numbers, in thousandths where they have fractions.
fn scaled(task: &Task) -> Vec<u32> {
    let has_fractions = task.operators.iter().any(|operator| operator.cost.fract() != 0.0);
    let factor = if has_fractions { 1000.0 } else { 1.0 };
    task.operators
        .iter()
        .map(|operator| (operator.cost * factor).round().clamp(0.0, f64::from(u32::MAX >> 8)) as u32)
        .collect()
}
