//! Better and better plans: weighted A* with falling weights, each bounded by the best cost so far (Richter and Westphal
//! 2010, section 6), in turn with searches in the neighbourhood of the plan, of which windows are replaced by cheaper
//! ways between the same states (Nakhost and Müller 2010; Siddiqui and Haslum 2015 for windows).

use super::axiom::Axioms;
use super::landmark::count::Counter;
use super::lazy::{Aim, Lazy, Step, Ties};
use super::relaxed::{Costs, Relaxed};
use super::shorten::eliminate;
use super::successor::{Generator, apply};
use super::task::{Fact, OperatorId, Task};

/// From greedy to optimal.
const WEIGHTS: [u32; 4] = [5, 3, 2, 1];

/// The work of the first slice of a search.
const SLICE: u64 = 100_000_000;

/// The steps of the first windows.
const WINDOW: usize = 10;

/// A plan that is made better.
pub(super) struct Improver<'t> {
    pub(super) task: &'t Task,
    pub(super) generator: &'t Generator,
    pub(super) counter: &'t Counter,
    pub(super) costs: &'t [u32],
    pub(super) init: Vec<Fact>,
    pub(super) memory: usize,
    pub(super) plan: Vec<OperatorId>,
    /// Says each better plan.
    pub(super) found: &'t mut dyn FnMut(&[OperatorId]),
}

impl Improver<'_> {
    fn cost(&self, plan: &[OperatorId]) -> u64 {
        plan.iter().map(|operator| u64::from(self.costs[*operator as usize])).sum()
    }

    /// Takes a plan where it is cheaper; says so.
    fn take(&mut self, plan: Vec<OperatorId>) -> bool {
        let plan = eliminate(self.task, &self.init, &plan);
        let is_better = self.cost(&plan) < self.cost(&self.plan);
        if is_better {
            self.plan = plan;
            (self.found)(&self.plan);
        }
        is_better
    }

    /// Improves the plan until it is known to be the cheapest one, until there is no more room, or until so much
    /// work is done.
    pub(super) fn run(&mut self, relaxed: Relaxed, limit: u64) {
        let (mut weight, mut work, mut size) = (0, SLICE.min(limit), WINDOW);
        let mut left = limit;
        let mut search = self.search(relaxed, weight);
        while self.cost(&self.plan) > 0 && left > 0 {
            let before = search.work();
            let step = search.run(work.min(left), self.memory);
            left = left.saturating_sub(search.work() - before);
            match step {
                Step::Plan(plan) => {
                    self.take(plan);
                    weight = (weight + 1).min(WEIGHTS.len() - 1);
                    search = self.search(search.into_relaxed(), weight);
                    continue;
                }
                // Nothing is cheaper.
                Step::Exhausted => return,
                Step::Spent => {}
                Step::Full if weight + 1 < WEIGHTS.len() => {
                    weight += 1;
                    search = self.search(search.into_relaxed(), weight);
                }
                Step::Full => break,
            }
            let share = work.min(left);
            left = left.saturating_sub(share);
            self.windows(size, share);
            (work, size) = (work.saturating_mul(2), size.saturating_mul(2));
        }
        // Without room for all states, the neighbourhood of the plan is what is left.
        drop(search);
        while left > 0 && (self.windows(size, work.min(left)) || size < self.plan.len()) {
            left = left.saturating_sub(work);
            (work, size) = (work.saturating_mul(2), size.saturating_mul(2));
        }
    }

    fn search<'s>(&self, relaxed: Relaxed, weight: usize) -> Lazy<'s>
    where
        Self: 's,
    {
        let aim = Aim {
            init: self.init.clone(),
            goal: self.task.goal.clone(),
            weight: Some(WEIGHTS[weight]),
            bound: self.cost(&self.plan),
            ties: Ties::First,
        };
        Lazy::new(self.task, self.generator, self.counter, self.costs, relaxed, aim)
    }

    /// Replaces windows of so many steps; says whether the plan is better.
    fn windows(&mut self, size: usize, work: u64) -> bool {
        // A window would have to end with the same numbers.
        if self.task.numbers.count > 0 {
            return false;
        }
        let no_landmarks = Counter::default();
        let mut relaxed = Relaxed::new(self.task, Costs::PlusOne);
        let (mut start, mut is_better) = (0, false);
        let count = (self.plan.len() / size.max(1) * 2 + 1) as u64;
        while start < self.plan.len() {
            let end = (start + size).min(self.plan.len());
            let aim = self.window(start, end);
            let bound = aim.bound;
            if bound > 0 {
                let mut search = Lazy::new(self.task, self.generator, &no_landmarks, self.costs, relaxed, aim);
                if let Step::Plan(part) = search.run(work / count, self.memory / 2) {
                    let plan = [&self.plan[..start], &part, &self.plan[end..]].concat();
                    is_better |= self.take(plan);
                }
                relaxed = search.into_relaxed();
            }
            start += size.div_ceil(2);
        }
        is_better
    }

    /// The task of a window: from its first state to what the rest of the plan needs.
    fn window(&self, start: usize, end: usize) -> Aim {
        let task = self.task;
        let mut axioms = Axioms::new(task);
        let mut state = self.init.clone();
        for operator in &self.plan[..start] {
            apply(task, &mut axioms, &task.operators[*operator as usize], &mut state);
        }
        let init = state.clone();
        for operator in &self.plan[start..end] {
            apply(task, &mut axioms, &task.operators[*operator as usize], &mut state);
        }
        let goal = self.needed(&state, end);
        Aim { init, goal, weight: Some(1), bound: self.cost(&self.plan[start..end]), ties: Ties::First }
    }

    /// What must hold before the rest of a plan, of what holds.
    fn needed(&self, state: &[Fact], from: usize) -> Vec<Fact> {
        let task = self.task;
        // What derived facts and conditional effects come from is not known: all of the state is kept.
        let is_simple = task.axioms.is_empty()
            && self.plan[from..].iter().all(|operator| {
                task.operators[*operator as usize].effects.iter().all(|effect| effect.condition.is_empty())
            });
        if !is_simple {
            return (0..task.len())
                .filter(|variable| !task.is_derived[*variable])
                .map(|variable| state[variable])
                .collect();
        }
        let mut needed = vec![false; task.len()];
        task.goal.iter().for_each(|fact| needed[task.variable(*fact)] = true);
        for operator in self.plan[from..].iter().rev().map(|operator| &task.operators[*operator as usize]) {
            operator.effects.iter().for_each(|effect| needed[task.variable(effect.fact)] = false);
            operator.condition.iter().for_each(|fact| needed[task.variable(*fact)] = true);
        }
        (0..task.len()).filter(|variable| needed[*variable]).map(|variable| state[variable]).collect()
    }
}
