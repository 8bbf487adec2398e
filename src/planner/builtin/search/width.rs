//! Best-first width search (Lipovetzky and Geffner 2017, "Best-first width search: exploration and exploitation in
//! classical planning"): BFWS(f5), where the first aim is novelty and the second one is the number of landmarks left.
//!
//! A state is as novel as the smallest set of facts that no state before it had, among the states with the same number
//! of landmarks left and the same number of facts achieved of the last relaxed plan. Relaxed plans are made only where the
//! number of landmarks falls, so that a state costs little.

use super::axiom::Axioms;
use super::hash::NumberMap;
use super::landmark::count::Counter;
use super::lazy::Step;
use super::open::OpenList;
use super::relaxed::Relaxed;
use super::state::{NO_STATE, Space, StateId};
use super::successor::{Generator, apply, holds};
use super::task::{Fact, OperatorId, Task};

/// Words of the set of achieved facts of a relaxed plan; those of longer plans share bits.
const WORDS: usize = 4;

/// Most facts of a task whose pairs are remembered.
const PAIRED: usize = 1_500;

/// Most bytes for pairs.
const PAIR_BYTES: usize = 256 << 20;

/// No number.
const NONE: u32 = u32::MAX;

/// A set of facts, or of pairs.
type Bits = Vec<u64>;

#[derive(Debug, Clone, Copy)]
struct Node {
    /// Landmarks left.
    left: u32,
    /// The relaxed plan that counts.
    plan: u32,
    achieved: [u64; WORDS],
}

/// The search, which can be continued.
pub(super) struct Width<'t> {
    task: &'t Task,
    generator: &'t Generator,
    counter: &'t Counter,
    axioms: Axioms,
    relaxed: Relaxed,
    space: Space,
    nodes: Vec<Node>,
    accepted: Vec<u64>,
    /// For each relaxed plan, the bits of its facts.
    plans: Vec<NumberMap<Fact, u32>>,
    /// By landmarks left and achieved facts.
    seen: NumberMap<u64, (Bits, Option<Bits>)>,
    pair_bytes: usize,
    /// By novelty.
    lists: [OpenList; 3],
    work: u64,
    state: Vec<Fact>,
    before: Vec<Fact>,
    marks: Vec<u64>,
}

impl<'t> Width<'t> {
    pub(super) fn new(task: &'t Task, generator: &'t Generator, counter: &'t Counter, relaxed: Relaxed) -> Self {
        let mut search = Self {
            task,
            generator,
            counter,
            axioms: Axioms::new(task),
            relaxed,
            space: Space::new(task),
            nodes: Vec::new(),
            accepted: Vec::new(),
            plans: Vec::new(),
            seen: NumberMap::default(),
            pair_bytes: 0,
            lists: Default::default(),
            work: 0,
            state: task.init.clone(),
            before: task.init.clone(),
            marks: vec![0; counter.words()],
        };
        let mut state = task.init.clone();
        search.axioms.derive(task, &mut state);
        search.counter.start(task, &state, &mut search.marks);
        search.enter(NO_STATE, OperatorId::MAX, &state, &[]);
        search
    }

    fn bytes(&self) -> usize {
        let entries: usize = self.lists.iter().map(OpenList::len).sum();
        let sets = self.seen.len() * (self.task.facts() / 8 + 64) + self.pair_bytes;
        self.space.bytes()
            + self.nodes.capacity() * size_of::<Node>()
            + self.accepted.capacity() * 8
            + entries * 12
            + sets
    }

    /// Returns how much work was done.
    pub(super) fn work(&self) -> u64 {
        self.relaxed.work + self.work
    }

    /// Returns how many states were reached.
    pub(super) fn states(&self) -> usize {
        self.space.len()
    }

    /// Searches until so much work is done, in so many bytes.
    pub(super) fn run(&mut self, work: u64, memory: usize) -> Step {
        let start = self.work();
        let mut count = 0_usize;
        while self.work() - start < work {
            let Some((id, _)) = self.lists.iter_mut().find_map(OpenList::pop) else { return Step::Exhausted };
            if let Some(plan) = self.expand(id) {
                return Step::Plan(plan);
            }
            count += 1;
            if count.is_multiple_of(64) && self.bytes() > memory {
                return Step::Full;
            }
        }
        Step::Spent
    }

    fn expand(&mut self, id: StateId) -> Option<Vec<OperatorId>> {
        let task = self.task;
        let (mut before, mut state) = (std::mem::take(&mut self.before), std::mem::take(&mut self.state));
        self.space.state(id, &mut before);
        let mut applicable = Vec::new();
        self.generator.applicable(task, &before, &mut applicable);
        let mut plan = None;
        let words = self.counter.words();
        for operator in applicable {
            state.copy_from_slice(&before);
            apply(task, &mut self.axioms, &task.operators[operator as usize], &mut state);
            self.work += (task.len() / 4 + task.axioms.len() + 16) as u64;
            let (child, is_new) = self.space.insert(&state, id, operator);
            if !is_new {
                continue;
            }
            if holds(task, &state, &task.goal) {
                plan = Some(self.space.plan(child));
                break;
            }
            let start = id as usize * words;
            let mut marks = std::mem::take(&mut self.marks);
            self.counter.accept(task, &state, &self.accepted[start..start + words], &mut marks);
            self.marks = marks;
            self.work += words as u64 * 24;
            self.rate(id, child, &state, &before);
        }
        (self.before, self.state) = (before, state);
        plan
    }

    /// Adds the first state.
    fn enter(&mut self, parent: StateId, operator: OperatorId, state: &[Fact], before: &[Fact]) {
        let (id, _) = self.space.insert(state, parent, operator);
        self.rate(parent, id, state, before);
    }

    /// Decides how novel a new state is, and where it waits.
    fn rate(&mut self, parent: StateId, id: StateId, state: &[Fact], before: &[Fact]) {
        let task = self.task;
        let left = self.counter.count(task, state, &self.marks);
        self.accepted.extend_from_slice(&self.marks);
        let above = (parent != NO_STATE).then(|| self.nodes[parent as usize]);
        let node = match above {
            Some(above) if left >= above.left => {
                let mut achieved = above.achieved;
                if let Some(plan) = self.plans.get(above.plan as usize) {
                    let new = state[..task.len()].iter().zip(before).filter(|(fact, old)| fact != old);
                    for bit in new.filter_map(|(fact, _)| plan.get(fact)) {
                        achieved[*bit as usize / 64 % WORDS] |= 1 << (bit % 64);
                    }
                }
                Node { left, plan: above.plan, achieved }
            }
            _ => {
                let estimate = self.relaxed.estimate(state, &task.goal);
                if estimate.value.is_none() {
                    // No plan leads on from here.
                    self.nodes.push(Node { left, plan: NONE, achieved: [0; WORDS] });
                    return;
                }
                let facts = self
                    .relaxed
                    .planned()
                    .iter()
                    .filter(|fact| (**fact as usize) < task.facts() && state[task.variable(**fact)] != **fact);
                let mut plan: NumberMap<Fact, u32> = NumberMap::default();
                plan.extend(facts.enumerate().map(|(place, fact)| (*fact, place as u32)));
                self.plans.push(plan);
                Node { left, plan: self.plans.len() as u32 - 1, achieved: [0; WORDS] }
            }
        };
        self.nodes.push(node);
        let count: u32 = node.achieved.iter().map(|word| word.count_ones()).sum();
        let is_alike = above.is_some_and(|above| {
            above.left == left && above.achieved.iter().map(|word| word.count_ones()).sum::<u32>() == count
        });
        let novelty = self.novelty(u64::from(left) << 16 | u64::from(count), state, is_alike.then_some(before));
        self.lists[novelty].push(left, (id, 0));
    }

    /// Returns 0 where a fact is new among alike states, 1 where a pair is, and 2 otherwise. Where the state before is
    /// alike, only what has changed can be new.
    fn novelty(&mut self, key: u64, state: &[Fact], before: Option<&[Fact]>) -> usize {
        let (facts, state) = (self.task.facts(), &state[..self.task.len()]);
        let (singles, pairs) = self.seen.entry(key).or_insert_with(|| (vec![0; facts.div_ceil(64)], None));
        let mut novelty = 2;
        let changed: Vec<Fact> = match before {
            Some(before) => state.iter().zip(before).filter(|(fact, old)| fact != old).map(|(fact, _)| *fact).collect(),
            None => state.to_vec(),
        };
        for fact in &changed {
            if set(singles, *fact as usize) {
                novelty = 0;
            }
        }
        let bytes = facts * facts / 8;
        if facts > PAIRED || pairs.is_none() && self.pair_bytes + bytes > PAIR_BYTES {
            return novelty;
        }
        let pairs = pairs.get_or_insert_with(|| {
            self.pair_bytes += bytes;
            vec![0; (facts * facts).div_ceil(64)]
        });
        self.work += (changed.len() * state.len() / 4) as u64;
        for fact in &changed {
            for other in state {
                let (low, high) = (*fact.min(other) as usize, *fact.max(other) as usize);
                if set(pairs, low * facts + high) && novelty == 2 {
                    novelty = 1;
                }
            }
        }
        novelty
    }
}

/// Adds to a set; says whether it was not there.
fn set(bits: &mut Bits, place: usize) -> bool {
    let (word, bit) = (&mut bits[place / 64], 1 << (place % 64));
    let is_new = *word & bit == 0;
    *word |= bit;
    is_new
}
