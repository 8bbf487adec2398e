//! Plans whose steps overlap: each starts as early as what it touches is free, and the search looks for plans that end
//! early.
//!
//! Where no action needs another one to happen within it, every plan of a temporal task is a sequential plan whose
//! steps were moved (Coles, Fox, Long and Smith 2009, "Managing concurrency in temporal planning using planner-scheduler
//! interaction"; Edelkamp 2003 for the critical path). So a best-first search over sequential plans is guided by the time
//! at which their steps end, not by their number.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

use super::axiom::Axioms;
use super::relaxed::{Costs, Relaxed};
use super::reservoir::{Draw, Reservoir};
use super::state::{NO_STATE, Space, StateId};
use super::successor::{Generator, apply, holds};
use super::task::{Fact, OperatorId, Task};
use super::ways::Ways;

/// The work of the first round of searches.
const ROUND: u64 = 30_000_000;

/// Of so many states, one is expanded by all operators, and the others by preferred ones.
const TURNS: u64 = 8;

/// How much an estimate counts against the time so far, in quarters: first to find plans, then to find short ones.
const WEIGHTS: [u64; 6] = [400, 40, 16, 8, 4, 1];

/// The end of no plan, later than that of any.
const NO_END: u64 = u64::MAX;

/// A resource, and from when to when an operator touches it, after its start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Touch {
    /// The number of the resource.
    pub resource: u32,
    /// The first moment.
    pub from: u64,
    /// The last moment.
    pub to: u64,
}

/// How long operators take and what they touch. Times are in whole units.
#[derive(Debug, Clone, Default)]
pub struct Timing {
    /// How long each operator takes.
    pub durations: Vec<u64>,
    /// What each operator needs unchanged.
    pub reads: Vec<Vec<Touch>>,
    /// What each operator changes.
    pub writes: Vec<Vec<Touch>>,
    /// From when to when an operator may start, where it may not at any time; windows in order.
    pub windows: HashMap<OperatorId, Vec<(u64, u64)>>,
    /// Whether each operator has to be kept from running twice at once, as nothing that it changes does so; none of those
    /// that are not listed.
    pub alone: Vec<bool>,
    /// How many resources there are.
    pub resources: usize,
    /// What each operator does to numbers that it shares; none of those that are not listed.
    pub draws: Vec<Vec<Draw>>,
    /// What these numbers are at first.
    pub levels: Vec<f64>,
    /// The operators that are no actions, but happen by themselves: no plan ends later for them.
    pub happening: Vec<OperatorId>,
    /// How much time a unit of the operators' costs stands for.
    pub unit: u64,
    /// The least time between two operators of which one changes what the other touches.
    pub gap: u64,
    /// By what plans are measured, where that is not their end.
    pub prices: Option<Prices>,
}

/// What time and operators cost, in one unit.
#[derive(Debug, Clone)]
pub struct Prices {
    /// What a unit of time costs.
    pub time: u64,
    /// What each operator costs.
    pub operators: Vec<u64>,
}

/// From when each resource is free of what reads and of what writes it.
#[derive(Debug, Clone)]
struct Times {
    read: Vec<u64>,
    written: Vec<u64>,
    reservoirs: Vec<Reservoir>,
    /// From when the operators that are kept from running twice at once may start again, of those that ran. There are few
    /// on the way to a state, and many in a task.
    again: Vec<(OperatorId, u64)>,
    end: u64,
    /// What the operators cost.
    price: u64,
}

impl Timing {
    fn begin(&self) -> Times {
        Times {
            read: vec![0; self.resources],
            written: vec![0; self.resources],
            reservoirs: self.levels.iter().map(|level| Reservoir::new(*level)).collect(),
            again: Vec::new(),
            end: 0,
            price: 0,
        }
    }

    /// Adds an operator as early as it may start; returns when that is, or `None` where it is too late for it.
    fn add(&self, times: &mut Times, operator: OperatorId) -> Option<u64> {
        let number = operator as usize;
        // A part of an operator comes after all that those before it did to what it touches.
        let written = |touch: &Touch| times.written[touch.resource as usize];
        let touched = |touch: &Touch| written(touch).max(times.read[touch.resource as usize]);
        let reads = self.reads[number].iter().map(|touch| written(touch).saturating_sub(touch.from));
        let writes = self.writes[number].iter().map(|touch| touched(touch).saturating_sub(touch.from));
        let again = times.again.iter().filter(|(other, _)| *other == operator).map(|(_, from)| *from);
        let earliest = reads.chain(writes).chain(again).max().unwrap_or(0);
        let start = self.start(times, operator, earliest)?;
        for touch in &self.reads[number] {
            let read = &mut times.read[touch.resource as usize];
            *read = (start + touch.to + self.gap).max(*read);
        }
        for touch in &self.writes[number] {
            times.written[touch.resource as usize] = start + touch.to + self.gap;
        }
        if self.alone.get(number).is_some_and(|is_alone| *is_alone) {
            times.again.retain(|(other, _)| *other != operator);
            times.again.push((operator, start + self.durations[number] + self.gap));
        }
        for draw in self.draws(operator) {
            times.reservoirs[draw.number as usize].add(draw, start, self.durations[number], self.gap);
        }
        if !self.happening.contains(&operator) {
            // What takes no time happens all the same: at the end, it was.
            times.end = times.end.max(start + self.durations[number].max(1));
        }
        let price = self.prices.as_ref().and_then(|prices| prices.operators.get(number));
        times.price = times.price.saturating_add(price.copied().unwrap_or(0));
        Some(start)
    }

    /// The first moment from `earliest` on that windows and shared numbers leave for an operator.
    fn start(&self, times: &Times, operator: OperatorId, earliest: u64) -> Option<u64> {
        let mut earliest = earliest;
        loop {
            let start = match self.windows.get(&operator) {
                None => earliest,
                Some(windows) => windows.iter().find(|(_, to)| earliest <= *to)?.0.max(earliest),
            };
            let duration = self.durations[operator as usize];
            earliest = self.draws(operator).iter().try_fold(start, |start, draw| {
                times.reservoirs[draw.number as usize].earliest(draw, start, duration, self.gap)
            })?;
            if earliest == start {
                return Some(start);
            }
        }
    }

    fn draws(&self, operator: OperatorId) -> &[Draw] {
        self.draws.get(operator as usize).map_or(&[], Vec::as_slice)
    }

    /// Returns when each step of a plan starts, and when the last one ends; `None` where one misses its windows.
    #[must_use]
    pub fn schedule(&self, plan: &[OperatorId]) -> Option<(Vec<u64>, u64)> {
        let mut times = self.begin();
        let starts = plan.iter().map(|operator| self.add(&mut times, *operator)).collect::<Option<_>>()?;
        Some((starts, times.end))
    }

    /// Returns what a plan is measured by, of which less is better: its end, or what it costs; `None` where a step misses its
    /// windows.
    #[must_use]
    pub fn measured(&self, plan: &[OperatorId]) -> Option<u64> {
        let mut times = self.begin();
        plan.iter().try_for_each(|operator| self.add(&mut times, *operator).map(drop))?;
        Some(self.value(&times))
    }

    /// What an operator adds to that by itself.
    #[must_use]
    pub fn worth(&self, operator: usize) -> u64 {
        let duration = self.durations[operator];
        self.prices
            .as_ref()
            .map_or(duration, |prices| duration.saturating_mul(prices.time).saturating_add(prices.operators[operator]))
    }

    fn value(&self, times: &Times) -> u64 {
        let price = |prices: &Prices| times.end.saturating_mul(prices.time).saturating_add(times.price);
        self.prices.as_ref().map_or(times.end, price)
    }
}

/// The limits of the work.
#[derive(Debug, Clone, Copy)]
pub struct WorkLimits {
    /// Until there is a plan.
    pub first: u64,
    /// Then, until a better one is no longer looked for.
    pub better: u64,
}

/// Looks for plans that are better than `known`, the value of one that is known ([`Timing::measured`]), and says each. Costs
/// of operators, and one more, are what they are worth in [`Timing::unit`]s.
pub fn hasten(
    task: &Task,
    timing: &Timing,
    known: Option<u64>,
    limits: WorkLimits,
    memory: usize,
    found: &mut dyn FnMut(&[OperatorId]),
) {
    let generator = Generator::new(task);
    let mut relaxed = Relaxed::new(task, Costs::PlusOne);
    let mut best = known.unwrap_or(NO_END);
    let mut limit = if known.is_some() { limits.better } else { limits.first };
    let mut round = ROUND.min(limit);
    // What one round does not find, a longer one may.
    while relaxed.work < limit {
        let mut is_full = true;
        for weight in WEIGHTS {
            let (slice, is_first) = (relaxed.work + round / WEIGHTS.len() as u64, best == NO_END);
            let mut search = Search::new(task, timing, &generator, &mut relaxed, weight);
            is_full &= search.run(&mut best, slice, memory, found);
            if is_first && best < NO_END {
                limit = relaxed.work.saturating_add(limits.better);
            }
        }
        if is_full {
            return;
        }
        round = round.saturating_mul(2);
    }
}

struct Search<'a> {
    task: &'a Task,
    timing: &'a Timing,
    generator: &'a Generator,
    relaxed: &'a mut Relaxed,
    axioms: Axioms,
    space: Space,
    ways: Ways,
    nodes: Vec<Node>,
    /// The states to be expanded by preferred operators, and by all.
    queues: [BinaryHeap<Reverse<(u64, u64, StateId)>>; 2],
    weight: u64,
    count: u64,
}

struct Node {
    times: Times,
    /// The estimate; none where no plan leads on.
    left: Option<u32>,
}

impl<'a> Search<'a> {
    fn new(
        task: &'a Task,
        timing: &'a Timing,
        generator: &'a Generator,
        relaxed: &'a mut Relaxed,
        weight: u64,
    ) -> Self {
        Self {
            task,
            timing,
            generator,
            relaxed,
            axioms: Axioms::new(task),
            space: Space::new(task),
            ways: Ways::default(),
            nodes: Vec::new(),
            queues: Default::default(),
            weight,
            count: 0,
        }
    }

    /// Searches; says whether it has nothing left to do, or no room for it.
    fn run(&mut self, best: &mut u64, limit: u64, memory: usize, found: &mut dyn FnMut(&[OperatorId])) -> bool {
        let task = self.task;
        let mut state = task.init.clone();
        self.axioms.derive(task, &mut state);
        self.reach(NO_STATE, 0, &state, self.timing.begin(), *best, found);
        let size = self.timing.resources * 16 + self.timing.levels.len() * 64 + task.len() / 8 + 100;
        let mut next = state.clone();
        let mut applicable = Vec::new();
        let mut turn = 0;
        while let Some((id, is_preferring)) = self.next(&mut turn) {
            if self.nodes.len() * size > memory {
                return true;
            }
            if self.relaxed.work > limit {
                return false;
            }
            if self.timing.value(&self.nodes[id as usize].times) >= *best {
                continue;
            }
            self.space.state(id, &mut state);
            applicable.clear();
            self.generator.applicable(task, &state, &mut applicable);
            if is_preferring {
                let preferred = self.relaxed.estimate(&state, &task.goal).preferred;
                applicable.retain(|operator| preferred.binary_search(operator).is_ok());
            }
            self.relaxed.work += (applicable.len() * 8) as u64;
            for operator in &applicable {
                let mut times = self.nodes[id as usize].times.clone();
                if self.timing.add(&mut times, *operator).is_none() || self.timing.value(&times) >= *best {
                    continue;
                }
                next.copy_from_slice(&state);
                apply(task, &mut self.axioms, &task.operators[*operator as usize], &mut next);
                if let Some(value) = self.reach(id, *operator, &next, times, *best, found) {
                    *best = value;
                }
            }
        }
        true
    }

    /// The next state, and whether only preferred operators are to be applied in it.
    fn next(&mut self, turn: &mut u64) -> Option<(StateId, bool)> {
        *turn += 1;
        let [preferring, all] = &mut self.queues;
        let (first, second) = if turn.is_multiple_of(TURNS) { (all, preferring) } else { (preferring, all) };
        let is_first = !first.is_empty();
        let Reverse((_, _, id)) = first.pop().or_else(|| second.pop())?;
        Some((id, is_first != turn.is_multiple_of(TURNS)))
    }

    /// Adds a state, or a better way to it; returns the value of a plan where it is a goal.
    fn reach(
        &mut self,
        parent: StateId,
        operator: OperatorId,
        state: &[Fact],
        times: Times,
        best: u64,
        found: &mut dyn FnMut(&[OperatorId]),
    ) -> Option<u64> {
        let (id, is_new) = self.space.insert(state);
        let value = self.timing.value(&times);
        if is_new {
            let left = self.relaxed.estimate(state, &self.task.goal).value;
            self.ways.push(parent, operator);
            self.nodes.push(Node { times, left });
        } else {
            let node = &mut self.nodes[id as usize];
            let wait = |times: &Times| {
                times.written.iter().sum::<u64>() + times.reservoirs.iter().map(Reservoir::wait).sum::<u64>()
            };
            let rank = |times: &Times| (self.timing.value(times), wait(times));
            if rank(&times) >= rank(&node.times) {
                return None;
            }
            node.times = times;
            self.ways.set(id, parent, operator);
        }
        if holds(self.task, state, &self.task.goal) {
            // The way to a state may have become a better one since: what counts is the plan.
            let plan = self.ways.plan(id);
            let value = self.timing.measured(&plan).filter(|value| *value < best);
            if value.is_some() {
                found(&plan);
            }
            return value;
        }
        if let Some(left) = self.nodes[id as usize].left {
            self.count += 1;
            let left = (self.weight * self.timing.unit).saturating_mul(u64::from(left));
            let key = value.saturating_mul(4).saturating_add(left);
            self.queues.iter_mut().for_each(|queue| queue.push(Reverse((key, self.count, id))));
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::super::example::task;
    use super::*;

    fn touch(resource: u32, from: u64, to: u64) -> Touch {
        Touch { resource, from, to }
    }

    /// Two robots that may each carry any of four boxes, one after the other.
    fn carriers() -> (Task, Timing) {
        let names: Vec<String> = (0..8).map(|number| format!("carry-{}-{}", number / 4, number % 4)).collect();
        let parts: Vec<_> = (0..8).map(|number| (vec![(number % 4, 0)], vec![(number % 4, 1)])).collect();
        let operators: Vec<_> = names
            .iter()
            .zip(&parts)
            .map(|(name, (pre, eff))| (name.as_str(), pre.as_slice(), eff.as_slice()))
            .collect();
        let task = task(&[2; 4], &[0; 4], &[(0, 1), (1, 1), (2, 1), (3, 1)], &operators);
        let writes = (0..8_u32).map(|number| vec![touch(number % 4, 0, 10), touch(4 + number / 4, 0, 10)]).collect();
        let timing = Timing {
            durations: vec![10; 8],
            reads: vec![Vec::new(); 8],
            writes,
            resources: 6,
            unit: 5,
            gap: 1,
            ..Timing::default()
        };
        (task, timing)
    }

    #[test]
    fn what_shares_a_resource_comes_one_after_the_other() {
        let (_, timing) = carriers();
        assert_eq!(timing.schedule(&[0, 1, 6]), Some((vec![0, 11, 0], 21)));
    }

    #[test]
    fn operators_that_change_one_thing_at_their_ends_overlap_and_one_does_not_with_itself() {
        let timing = Timing {
            durations: vec![2, 2],
            reads: vec![Vec::new(); 2],
            writes: vec![vec![touch(0, 2, 2)]; 2],
            alone: vec![true; 2],
            resources: 1,
            gap: 1,
            ..Timing::default()
        };
        assert_eq!(timing.schedule(&[0, 1]), Some((vec![0, 1], 3)));
        assert_eq!(timing.schedule(&[0, 0, 1]), Some((vec![0, 3, 4], 6)));
    }

    #[test]
    fn what_only_reads_overlaps() {
        let timing = Timing {
            durations: vec![10, 20, 5],
            reads: vec![vec![touch(0, 0, 10)], vec![touch(0, 0, 20)], Vec::new()],
            writes: vec![Vec::new(), Vec::new(), vec![touch(0, 0, 5)]],
            resources: 1,
            unit: 1,
            gap: 1,
            ..Timing::default()
        };
        assert_eq!(timing.schedule(&[0, 1, 2, 0]), Some((vec![0, 0, 21, 27], 37)));
    }

    #[test]
    fn what_touches_a_resource_for_a_moment_keeps_others_off_it_for_a_moment() {
        // The first changes it at its start, the second reads it at its end.
        let timing = Timing {
            durations: vec![10, 4],
            reads: vec![Vec::new(), vec![touch(0, 4, 4)]],
            writes: vec![vec![touch(0, 0, 0)], Vec::new()],
            resources: 1,
            unit: 1,
            gap: 1,
            ..Timing::default()
        };
        assert_eq!(timing.schedule(&[0, 0, 1]), Some((vec![0, 1, 0], 11)));
        assert_eq!(timing.schedule(&[1, 0]), Some((vec![0, 5], 15)));
    }

    #[test]
    fn two_robots_share_the_work() {
        let (task, timing) = carriers();
        let mut best = Vec::new();
        let limits = WorkLimits { first: 0, better: 10_000_000 };
        hasten(&task, &timing, Some(44), limits, 1 << 26, &mut |plan| best = plan.to_vec());
        assert_eq!(timing.schedule(&best).map(|(_, end)| end), Some(21));
    }
}
