//! Lazy best-first search with several open lists (Richter and Westphal 2010, "The LAMA planner: guiding cost-based
//! anytime planning with landmarks"): greedy for a first plan, weighted A* for better ones.
//!
//! A state is made and estimated only when it is taken from an open list, where it waits with the estimates of the
//! state before it. There is an open list for each heuristic, and another one for each with the successors by preferred
//! operators only; they are asked in turn, and those of preferred operators are asked more often after progress.

use super::axiom::Axioms;
use super::landmark::accepted::Accepted;
use super::landmark::count::{Achieved, Counter};
use super::open::OpenList;
use super::preferred::Preferred;
use super::relaxed::Relaxed;
use super::state::{NO_STATE, Space, StateId};
use super::successor::{Generator, apply, holds};
use super::task::{Fact, OperatorId, Task};
use super::ways::Ways;

/// How many turns an open list of preferred operators gets for progress.
const BOOST: i64 = 1000;

/// The operator that leads to the first state.
const ROOT: OperatorId = OperatorId::MAX;

/// What became of a search, or of a slice of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Step {
    /// It found a plan.
    Plan(Vec<OperatorId>),
    /// There is nothing left to look at, and nothing was left out but what is too expensive.
    Exhausted,
    /// Its work is done; it may go on.
    Spent,
    /// It may not remember more.
    Full,
}

/// What a search looks for.
#[derive(Debug, Clone)]
pub(super) struct Aim {
    /// Where it starts; derived variables have their values.
    pub(super) init: Vec<Fact>,
    pub(super) goal: Vec<Fact>,
    /// How much an estimate counts against what was paid so far; without a weight, the search is greedy.
    pub(super) weight: Option<u32>,
    /// Plans must be cheaper than this.
    pub(super) bound: u64,
    /// Which of equals come first.
    pub(super) ties: Ties,
}

/// Which of equals come first: operators that are estimated alike, and supporters of a fact that cost the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Ties {
    /// Those that the task names first.
    First,
    /// The operators that it names first; supporters are drawn, anew for each state.
    Drawn,
    /// The operators that it names last; supporters are drawn, too.
    Last,
}

/// The search, which can be continued.
pub(super) struct Lazy<'t> {
    task: &'t Task,
    generator: &'t Generator,
    counter: &'t Counter,
    /// What each operator costs, for plans with a bound.
    costs: &'t [u32],
    axioms: Axioms,
    relaxed: Relaxed,
    aim: Aim,
    space: Space,
    ways: Ways,
    /// What was paid for each state, where that matters.
    paid: Vec<u64>,
    accepted: Accepted,
    /// By estimate: all and preferred operators, first of the relaxed plan, then of the landmarks. The operators of a state
    /// wait as one entry: all of them as the state, those that are preferred as their place in `preferred`.
    lists: [OpenList; 4],
    preferred: Preferred,
    /// The operators of the state that is next in each of the lists of all operators.
    next: [Successors; 2],
    best: [u32; 2],
    /// Work besides the relaxed task's.
    work: u64,
    /// How many states were estimated.
    pub(super) evaluated: usize,
    scratch: Scratch,
}

/// The operators that are applicable in a state.
struct Successors {
    state: StateId,
    operators: Vec<OperatorId>,
}

#[derive(Default)]
struct Scratch {
    state: Vec<Fact>,
    applicable: Vec<OperatorId>,
    accepted: Vec<u64>,
    is_preferred: Vec<bool>,
}

impl<'t> Lazy<'t> {
    pub(super) fn new(
        task: &'t Task,
        generator: &'t Generator,
        counter: &'t Counter,
        costs: &'t [u32],
        mut relaxed: Relaxed,
        aim: Aim,
    ) -> Self {
        let mut lists: [OpenList; 4] = Default::default();
        lists[0].push(0, NO_STATE);
        if aim.ties != Ties::First {
            relaxed.draw();
        }
        let scratch = Scratch {
            state: aim.init.clone(),
            applicable: Vec::new(),
            accepted: vec![0; counter.words()],
            is_preferred: vec![false; task.operators.len()],
        };
        Self {
            task,
            generator,
            counter,
            costs,
            axioms: Axioms::new(task),
            relaxed,
            aim,
            space: Space::new(task),
            ways: Ways::default(),
            paid: Vec::new(),
            accepted: Accepted::new(counter),
            lists,
            preferred: Preferred::default(),
            next: [(); 2].map(|()| Successors { state: NO_STATE, operators: vec![ROOT] }),
            best: [u32::MAX; 2],
            work: 0,
            evaluated: 0,
            scratch,
        }
    }

    /// Returns the relaxed task, to be used by another search.
    pub(super) fn into_relaxed(self) -> Relaxed {
        self.relaxed
    }

    /// Returns how many states were reached.
    pub(super) fn states(&self) -> usize {
        self.space.len()
    }

    /// Returns how much work was done, by this search and those that had its relaxed task before.
    pub(super) fn work(&self) -> u64 {
        self.relaxed.work + self.work
    }

    fn bytes(&self) -> usize {
        let entries: usize = self.lists.iter().map(OpenList::bytes).sum();
        let states = self.space.bytes() + self.ways.bytes() + self.accepted.bytes();
        states + size_of_val(self.paid.as_slice()) + entries + self.preferred.bytes()
    }

    /// Searches until so much work is done, in so many bytes.
    pub(super) fn run(&mut self, work: u64, memory: usize) -> Step {
        let start = self.work();
        while self.work() - start < work {
            let Some(list) = self.next_list() else { return Step::Exhausted };
            self.lists[list].priority += 1;
            let Some((parent, operator)) = self.take(list) else { return Step::Exhausted };
            self.work += 4;
            if let Some(plan) = self.visit(parent, operator) {
                return Step::Plan(plan);
            }
            if self.evaluated.is_multiple_of(256) && self.bytes() > memory {
                return Step::Full;
            }
        }
        Step::Spent
    }

    /// The list whose turn it is.
    fn next_list(&self) -> Option<usize> {
        let open = (0..self.lists.len()).filter(|list| !self.lists[*list].is_empty());
        open.min_by_key(|list| self.lists[*list].priority)
    }

    /// Takes what is next from a list.
    fn take(&mut self, list: usize) -> Option<(StateId, OperatorId)> {
        let (entry, taken) = self.lists[list].front()?;
        let (found, is_last) = if list % 2 == 1 {
            self.preferred.get(entry, *taken)
        } else {
            let next = &mut self.next[list / 2];
            if next.state != entry {
                let facts = &mut self.scratch.state;
                self.space.state(entry, facts);
                next.state = entry;
                applicable(self.task, self.generator, self.aim.ties, facts, &mut next.operators);
            }
            ((entry, next.operators[*taken as usize]), *taken as usize + 1 == next.operators.len())
        };
        *taken += 1;
        if is_last {
            self.lists[list].pop();
        }
        Some(found)
    }

    /// Makes the state that an operator leads to, and expands it; returns a plan where it is a goal.
    fn visit(&mut self, parent: StateId, operator: OperatorId) -> Option<Vec<OperatorId>> {
        let paid = match parent {
            NO_STATE => 0,
            _ if self.aim.weight.is_none() => 0,
            _ => self.paid[parent as usize] + u64::from(self.costs[operator as usize]),
        };
        if paid >= self.aim.bound {
            return None;
        }
        let mut state = std::mem::take(&mut self.scratch.state);
        self.enter(parent, operator, &mut state);
        let (id, is_new) = self.space.insert(&state);
        let is_better = !is_new && self.aim.weight.is_some() && paid < self.paid[id as usize];
        let plan = if is_new || is_better { self.look(parent, operator, id, paid, is_new, &state) } else { None };
        self.scratch.state = state;
        plan
    }

    fn enter(&mut self, parent: StateId, operator: OperatorId, state: &mut [Fact]) {
        if parent == NO_STATE {
            state.copy_from_slice(&self.aim.init);
            return;
        }
        self.space.state(parent, state);
        let operator = &self.task.operators[operator as usize];
        apply(self.task, &mut self.axioms, operator, state);
        self.work += (self.task.len() / 8 + self.task.axioms.len() + operator.effects.len() + 8) as u64;
    }

    /// Estimates a state that is new, or was reached at less cost.
    fn look(
        &mut self,
        parent: StateId,
        operator: OperatorId,
        id: StateId,
        paid: u64,
        is_new: bool,
        state: &[Fact],
    ) -> Option<Vec<OperatorId>> {
        if is_new {
            self.ways.push(parent, operator);
            self.paid.extend(self.aim.weight.map(|_| paid));
        } else {
            self.ways.set(id, parent, operator);
            self.paid[id as usize] = paid;
        }
        self.advance(parent, id, is_new, state);
        if holds(self.task, state, &self.aim.goal) {
            return Some(self.ways.plan(id));
        }
        self.evaluated += 1;
        let estimate = self.relaxed.estimate(state, &self.aim.goal);
        let relaxed = estimate.value?;
        let landmarks = self.counter.count(self.task, state, &self.scratch.accepted);
        self.work += self.counter.words() as u64 * 64;
        let estimates = [relaxed, landmarks];
        let mut is_progress = false;
        for (best, value) in self.best.iter_mut().zip(estimates) {
            is_progress |= value < *best;
            *best = value.min(*best);
        }
        if is_progress {
            self.lists[1].priority -= BOOST;
            self.lists[3].priority -= BOOST;
        }
        let keys = estimates.map(|estimate| match self.aim.weight {
            None => estimate,
            Some(weight) => u32::try_from(paid).unwrap_or(u32::MAX).saturating_add(estimate.saturating_mul(weight)),
        });
        self.expand(id, state, &estimate.preferred, keys);
        None
    }

    /// Computes the accepted landmarks of a state.
    fn advance(&mut self, parent: StateId, id: StateId, is_new: bool, state: &[Fact]) {
        let accepted = &mut self.scratch.accepted;
        match parent {
            NO_STATE => self.counter.start(self.task, state, accepted),
            _ => self.counter.accept(self.task, state, self.accepted.get(parent), accepted),
        }
        if is_new {
            self.accepted.push(accepted);
        } else {
            // What is achieved on one way to a state but not on another is still to be achieved (Karpas and Domshlak 2009).
            self.accepted.meet(id, accepted);
        }
    }

    /// Appends what is applicable to the open lists.
    fn expand(&mut self, id: StateId, state: &[Fact], preferred: &[OperatorId], keys: [u32; 2]) {
        let Scratch { applicable: operators, is_preferred, accepted, .. } = &mut self.scratch;
        applicable(self.task, self.generator, self.aim.ties, state, operators);
        self.work += operators.len() as u64 * 2 + 16;
        if operators.is_empty() {
            return;
        }
        preferred.iter().for_each(|operator| is_preferred[*operator as usize] = true);
        let achieves = |operator: &OperatorId| {
            self.counter.achieves(self.task, state, accepted, &self.task.operators[*operator as usize])
        };
        let achieved: Vec<Achieved> = operators.iter().map(achieves).collect();
        // Disjunctive landmarks count where no simple one can be achieved.
        let most = achieved.iter().copied().max().unwrap_or(Achieved::Nothing);
        let is_wanted = |(operator, achieved): &(&OperatorId, &Achieved)| {
            let is_next = most > Achieved::Nothing && **achieved == most;
            is_next || is_preferred[**operator as usize]
        };
        let wanted = operators.iter().zip(&achieved).filter(is_wanted).map(|(operator, _)| *operator);
        let wanted = self.preferred.push(id, wanted);
        let heuristics = if self.counter.words() > 0 { 2 } else { 1 };
        for (place, key) in keys.into_iter().enumerate().take(heuristics) {
            self.lists[place * 2].push(key, id);
            wanted.into_iter().for_each(|entry| self.lists[place * 2 + 1].push(key, entry));
        }
        preferred.iter().for_each(|operator| is_preferred[*operator as usize] = false);
    }
}

/// Finds the operators that are applicable in a state, in the order in which they are tried.
fn applicable(task: &Task, generator: &Generator, ties: Ties, state: &[Fact], found: &mut Vec<OperatorId>) {
    found.clear();
    generator.applicable(task, state, found);
    if ties == Ties::Last {
        found.reverse();
    }
}

#[cfg(test)]
mod tests {
    use super::super::example::task;
    use super::super::relaxed::Costs;
    use super::*;

    #[test]
    fn of_equals_the_first_or_the_last_comes_first() {
        let task = task(&[2, 2], &[0, 0], &[(0, 1), (1, 1)], &[("one", &[], &[(0, 1)]), ("two", &[], &[(1, 1)])]);
        let (generator, counter) = (Generator::new(&task), Counter::default());
        let plan = |ties| {
            let (init, goal) = (task.init.clone(), task.goal.clone());
            let aim = Aim { init, goal, weight: None, bound: u64::MAX, ties };
            Lazy::new(&task, &generator, &counter, &[1, 1], Relaxed::new(&task, Costs::Unit), aim).run(1000, 1 << 20)
        };
        assert_eq!(plan(Ties::First), Step::Plan(vec![0, 1]));
        assert_eq!(plan(Ties::Drawn), Step::Plan(vec![0, 1]));
        assert_eq!(plan(Ties::Last), Step::Plan(vec![1, 0]));
    }

    #[test]
    fn equal_supporters_are_drawn_where_that_is_asked_for() {
        let ways = [("one", &[][..], &[(0, 1)][..]), ("two", &[], &[(0, 1)])];
        let task = task(&[2], &[0], &[(0, 1)], &ways);
        let (generator, counter) = (Generator::new(&task), Counter::default());
        for (ties, count) in [(Ties::First, 1), (Ties::Drawn, 2), (Ties::Last, 2)] {
            let aim = Aim { init: task.init.clone(), goal: task.goal.clone(), weight: None, bound: u64::MAX, ties };
            let mut search = Lazy::new(&task, &generator, &counter, &[1, 1], Relaxed::new(&task, Costs::Unit), aim);
            let preferred = (0..64).map(|_| search.relaxed.estimate(&task.init, &task.goal).preferred);
            assert_eq!(preferred.collect::<std::collections::HashSet<_>>().len(), count, "{ties:?}");
        }
    }
}
