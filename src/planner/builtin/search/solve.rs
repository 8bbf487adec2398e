//! Searches in turn, in slices of work.
//!
//! Where one search finds a plan in a blink, another may not find any: so each works for a while, remembers where it was,
//! and goes on twice as long when it is its turn again. Work is counted, in rules of the relaxed task that were touched
//! for the most part: the same task has the same plan everywhere. What two searches have not found in their first slices
//! may not be there: from then on, a proof of that is looked for as well.

use super::axiom::Axioms;
use super::improve::Improver;
use super::landmark::{back, count::Counter, reasonable};
use super::lazy::{Aim, Lazy, Step, Ties};
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
    let init = match begin(task, report) {
        Ok(init) => init,
        Err(end) => return end,
    };
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
    let mut searches = Searches {
        task,
        generator: &generator,
        counter: &counter,
        costs: &costs,
        relaxed,
        init: &init,
        lazy: [None, None, None],
        width: None,
        prover: Prover::new(task),
        is_over: Vec::new(),
    };
    let (plan, spent) = match searches.plan(settings, report) {
        Ok(found) => found,
        Err(end) => return end,
    };
    let plan = eliminate(task, &init, &plan);
    report(Event::Plan(&plan));
    drop(searches);
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

/// The first state with what its axioms give; the end where it is a goal, or shows that there is no plan.
fn begin(task: &Task, report: &mut dyn FnMut(Event<'_>)) -> Result<Vec<Fact>, End> {
    let mut init = task.init.clone();
    Axioms::new(task).derive(task, &mut init);
    if holds(task, &init, &task.goal) {
        report(Event::Plan(&[]));
        return Err(End::Solved);
    }
    match is_refuted(task, &init, report) {
        true => Err(End::Unsolvable),
        false => Ok(init),
    }
}

/// Looks for a proof that there is no plan, and for nothing else; where there is a plan, it may be found on the way.
pub fn prove(task: &Task, settings: Settings, report: &mut dyn FnMut(Event<'_>)) -> End {
    if let Err(end) = begin(task, report) {
        return end;
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

/// The searches for a first plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Search {
    /// Lazy greedy search, where of equals the first count, or the last, or what is drawn: which of them lead astray
    /// depends on how a domain was written, and diversity helps (Imai and Kishimoto 2011, "A novel technique for
    /// avoiding plateaus of greedy best-first search in satisficing planning").
    Lazy(Ties),
    Width,
    Proof,
}

/// In which order searches work at first, and their part of a slice, in eighths.
const SOON: [(Search, u64); 7] = [
    (Search::Lazy(Ties::First), 2),
    (Search::Lazy(Ties::Last), 2),
    (Search::Lazy(Ties::Drawn), 2),
    (Search::Lazy(Ties::First), 4),
    (Search::Lazy(Ties::Drawn), 2),
    (Search::Width, 4),
    (Search::Proof, 1),
];

/// As [`SOON`], for the slices after the first.
const LATER: [(Search, u64); 5] = [
    (Search::Lazy(Ties::First), 4),
    (Search::Lazy(Ties::Drawn), 4),
    (Search::Lazy(Ties::Last), 2),
    (Search::Width, 4),
    (Search::Proof, 1),
];

/// What the searches for a first plan share, and how far they are.
struct Searches<'t> {
    task: &'t Task,
    generator: &'t Generator,
    counter: &'t Counter,
    costs: &'t [u32],
    relaxed: Relaxed,
    init: &'t [Fact],
    lazy: [Option<Lazy<'t>>; 3],
    width: Option<Width<'t>>,
    prover: Prover<'t>,
    /// The searches that have no more room, or have come to an end that proves nothing.
    is_over: Vec<Search>,
}

impl<'t> Searches<'t> {
    /// Lets a search go on; returns what it came to, and the work of a search that found a plan.
    fn run(&mut self, search: Search, work: u64, memory: usize) -> (Step, u64) {
        let (task, generator, counter) = (self.task, self.generator, self.counter);
        match search {
            Search::Lazy(ties) => {
                let lazy = self.lazy[ties as usize].get_or_insert_with(|| {
                    let (init, goal) = (self.init.to_vec(), task.goal.clone());
                    let aim = Aim { init, goal, weight: None, bound: u64::MAX, ties };
                    Lazy::new(task, generator, counter, self.costs, self.relaxed.clone(), aim)
                });
                (lazy.run(work, memory / 5), lazy.work())
            }
            Search::Width => {
                let width =
                    self.width.get_or_insert_with(|| Width::new(task, generator, counter, self.relaxed.clone()));
                (width.run(work, memory / 5), width.work())
            }
            Search::Proof => (self.prover.run(work, memory / 5), 0),
        }
    }

    /// Returns how many states were reached.
    fn states(&self) -> usize {
        let lazy = self.lazy.iter().flatten().map(Lazy::states);
        lazy.chain(self.width.iter().map(Width::states)).sum::<usize>() + self.prover.states()
    }

    /// Looks for a plan; returns it with the work of its search.
    fn plan(&mut self, settings: Settings, report: &mut dyn FnMut(Event<'_>)) -> Result<(Vec<OperatorId>, u64), End> {
        // What the estimates leave out of a task with numbers may lead to a goal.
        let has_numbers = self.task.numbers.count > 0;
        let proves = |search: Search| search == Search::Proof || !has_numbers;
        let mut work = SLICE;
        let mut turns = SOON.as_slice();
        while self.is_over.len() < LATER.len() {
            for (search, part) in turns {
                if self.is_over.contains(search) {
                    continue;
                }
                match self.run(*search, work / 8 * part, settings.memory) {
                    (Step::Plan(plan), spent) => return Ok((plan, spent)),
                    (Step::Exhausted, _) if proves(*search) => return Err(End::Unsolvable),
                    (Step::Exhausted | Step::Full, _) => self.is_over.push(*search),
                    (Step::Spent, _) => {}
                }
            }
            report(Event::States(self.states()));
            if work > settings.work {
                return Err(End::Spent);
            }
            (work, turns) = (work.saturating_mul(2), &LATER);
        }
        Err(End::Full)
    }
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
