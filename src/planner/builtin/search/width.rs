//! Best-first width search (Lipovetzky and Geffner 2017, "Best-first width search: exploration and exploitation in
//! classical planning"): BFWS(f5), where the first aim is novelty and the second one is the number of landmarks left.
//!
//! A state is as novel as the smallest set of facts that no state before it had, among the states with the same number
//! of landmarks left and the same number of facts achieved of the last relaxed plan. Relaxed plans are made only where the
//! number of landmarks falls, so that a state costs little.

use super::axiom::Axioms;
use super::hash::NumberMap;
use super::landmark::accepted::Accepted;
use super::landmark::count::Counter;
use super::lazy::Step;
use super::open::OpenList;
use super::relaxed::Relaxed;
use super::state::{Space, StateId};
use super::successor::{Generator, apply, holds};
use super::task::{Fact, OperatorId, Task};
use super::ways::Expansions;

/// Words of the set of achieved facts of a relaxed plan; those of longer plans share bits.
const WORDS: usize = 4;

/// Most facts of a task whose pairs are remembered.
const PAIRED: usize = 1_500;

/// Most bytes for pairs.
const PAIR_BYTES: usize = 128 << 20;

/// No number.
const NONE: u32 = u32::MAX;

/// A set of facts, or of pairs.
type Bits = Vec<u64>;

/// The facts that a relaxed plan achieves, in order.
enum Planned {
    List(Box<[Fact]>),
    Set(Box<[u64]>),
}

impl Planned {
    /// Keeps facts in whichever form is smaller.
    fn new(mut facts: Vec<Fact>, count: usize) -> Self {
        if facts.len() * size_of::<Fact>() <= count / 8 {
            facts.sort_unstable();
            return Self::List(facts.into());
        }
        let mut bits = vec![0; count.div_ceil(64)];
        facts.iter().for_each(|fact| bits[*fact as usize / 64] |= 1 << (fact % 64));
        Self::Set(bits.into())
    }

    fn bytes(&self) -> usize {
        let parts = match self {
            Self::List(facts) => size_of_val::<[Fact]>(facts),
            Self::Set(bits) => size_of_val::<[u64]>(bits),
        };
        size_of::<Self>() + parts
    }

    /// Returns the place of a fact, where it is one of them.
    fn place(&self, fact: Fact) -> Option<usize> {
        match self {
            Self::List(facts) => facts.binary_search(&fact).ok(),
            Self::Set(bits) => {
                let (word, bit) = (fact as usize / 64, 1_u64 << (fact % 64));
                let before = |bits: &[u64]| bits.iter().map(|bits| bits.count_ones() as usize).sum::<usize>();
                (bits[word] & bit != 0).then(|| before(&bits[..word]) + (bits[word] & (bit - 1)).count_ones() as usize)
            }
        }
    }
}

/// What was achieved of a relaxed plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Mark {
    /// The relaxed plan that counts.
    plan: u32,
    achieved: [u64; WORDS],
}

impl Mark {
    fn count(&self) -> u32 {
        self.achieved.iter().map(|word| word.count_ones()).sum()
    }
}

/// Marks, one after another: of each its plan, and its words without the last ones that are empty.
#[derive(Debug, Default)]
struct Marks {
    words: Vec<u64>,
}

impl Marks {
    /// Adds a mark; returns its place.
    fn push(&mut self, mark: Mark) -> u32 {
        let place = self.words.len() as u32;
        let count = mark.achieved.iter().rposition(|word| *word != 0).map_or(0, |last| last + 1);
        self.words.push(u64::from(mark.plan) << 32 | count as u64);
        self.words.extend_from_slice(&mark.achieved[..count]);
        place
    }

    fn get(&self, place: u32) -> Mark {
        let place = place as usize;
        let (plan, count) = ((self.words[place] >> 32) as u32, self.words[place] as u32 as usize);
        let mut achieved = [0; WORDS];
        achieved[..count].copy_from_slice(&self.words[place + 1..place + 1 + count]);
        Mark { plan, achieved }
    }
}

/// What a state is compared to: the state before it.
#[derive(Debug, Clone, Copy)]
struct Above {
    /// Landmarks left.
    left: u32,
    /// The place of what is achieved.
    place: u32,
    mark: Mark,
}

/// The search, which can be continued.
pub(super) struct Width<'t> {
    task: &'t Task,
    generator: &'t Generator,
    counter: &'t Counter,
    axioms: Axioms,
    relaxed: Relaxed,
    space: Space,
    expansions: Expansions,
    accepted: Accepted,
    /// For each state the place of what is achieved: shared with the state before where nothing is added.
    places: Vec<u32>,
    achieved: Marks,
    plans: Vec<Planned>,
    /// By landmarks left and achieved facts.
    seen: NumberMap<u64, (Bits, Option<Bits>)>,
    /// The bytes of pairs and of relaxed plans.
    pair_bytes: usize,
    plan_bytes: usize,
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
            expansions: Expansions::default(),
            accepted: Accepted::new(counter),
            places: Vec::new(),
            achieved: Marks::default(),
            plans: Vec::new(),
            seen: NumberMap::default(),
            pair_bytes: 0,
            plan_bytes: 0,
            lists: Default::default(),
            work: 0,
            state: task.init.clone(),
            before: task.init.clone(),
            marks: vec![0; counter.words()],
        };
        let mut state = task.init.clone();
        search.axioms.derive(task, &mut state);
        search.counter.start(task, &state, &mut search.marks);
        search.space.insert(&state);
        search.rate(None, 0, &state, &[]);
        search
    }

    fn bytes(&self) -> usize {
        let entries: usize = self.lists.iter().map(OpenList::bytes).sum();
        let sets = self.seen.len() * (self.task.facts() / 8 + 64) + self.pair_bytes + self.plan_bytes;
        let states = self.space.bytes() + self.expansions.bytes() + self.accepted.bytes();
        let marks = size_of_val(self.places.as_slice()) + size_of_val(self.achieved.words.as_slice());
        states + marks + entries + sets
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
            let Some(id) = self.lists.iter_mut().find_map(OpenList::pop) else { return Step::Exhausted };
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
        self.expansions.push(id, self.space.len() as StateId);
        let left = self.counter.count(task, &before, self.accepted.get(id));
        let place = self.places[id as usize];
        let above = Above { left, place, mark: self.achieved.get(place) };
        let mut plan = None;
        for operator in applicable {
            state.copy_from_slice(&before);
            apply(task, &mut self.axioms, &task.operators[operator as usize], &mut state);
            self.work += (task.len() / 4 + task.axioms.len() + 16) as u64;
            let (child, is_new) = self.space.insert(&state);
            if !is_new {
                continue;
            }
            if holds(task, &state, &task.goal) {
                plan = Some(self.expansions.plan(task, self.generator, &self.space, child));
                break;
            }
            self.counter.accept(task, &state, self.accepted.get(id), &mut self.marks);
            self.work += self.counter.words() as u64 * 24;
            self.rate(Some(above), child, &state, &before);
        }
        (self.before, self.state) = (before, state);
        plan
    }

    /// Decides how novel a new state is, and where it waits.
    fn rate(&mut self, above: Option<Above>, id: StateId, state: &[Fact], before: &[Fact]) {
        let task = self.task;
        let left = self.counter.count(task, state, &self.marks);
        self.accepted.push(&self.marks);
        let mark = match above {
            Some(above) if left >= above.left => {
                let mut mark = above.mark;
                if let Some(plan) = self.plans.get(mark.plan as usize) {
                    let new = state[..task.len()].iter().zip(before).filter(|(fact, old)| fact != old);
                    for bit in new.filter_map(|(fact, _)| plan.place(*fact)) {
                        mark.achieved[bit / 64 % WORDS] |= 1 << (bit % 64);
                    }
                }
                mark
            }
            _ => {
                let estimate = self.relaxed.estimate(state, &task.goal);
                if estimate.value.is_none() {
                    // No plan leads on from here.
                    self.note(above, Mark { plan: NONE, achieved: [0; WORDS] });
                    return;
                }
                let facts = self
                    .relaxed
                    .planned()
                    .iter()
                    .copied()
                    .filter(|fact| (*fact as usize) < task.facts() && state[task.variable(*fact)] != *fact);
                let plan = Planned::new(facts.collect(), task.facts());
                self.plan_bytes += plan.bytes();
                self.plans.push(plan);
                Mark { plan: self.plans.len() as u32 - 1, achieved: [0; WORDS] }
            }
        };
        let before_it = above.map(|above| (above.left, above.mark.count()));
        let count = mark.count();
        self.note(above, mark);
        let is_alike = before_it == Some((left, count));
        let novelty = self.novelty(u64::from(left) << 16 | u64::from(count), state, is_alike.then_some(before));
        self.lists[novelty].push(left, id);
    }

    /// Keeps what is known of a new state.
    fn note(&mut self, above: Option<Above>, mark: Mark) {
        let known = above.filter(|above| above.mark == mark).map(|above| above.place);
        let place = known.unwrap_or_else(|| self.achieved.push(mark));
        self.places.push(place);
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
        // Of each pair, the larger fact comes first: half of a square.
        let count = facts * facts.saturating_sub(1) / 2;
        let bytes = count / 8;
        if facts > PAIRED || pairs.is_none() && self.pair_bytes + bytes > PAIR_BYTES {
            return novelty;
        }
        let pairs = pairs.get_or_insert_with(|| {
            self.pair_bytes += bytes;
            vec![0; count.div_ceil(64)]
        });
        self.work += (changed.len() * state.len() / 4) as u64;
        for fact in &changed {
            for other in state {
                let (low, high) = (*fact.min(other) as usize, *fact.max(other) as usize);
                if low < high && set(pairs, high * (high - 1) / 2 + low) && novelty == 2 {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_come_back_as_they_were() {
        let of = |plan, achieved| Mark { plan, achieved };
        let kept = [of(0, [0; WORDS]), of(NONE, [0; WORDS]), of(7, [0, 5, 0, 0]), of(8, [1, 2, 3, u64::MAX])];
        let mut marks = Marks::default();
        let places = kept.map(|mark| marks.push(mark));
        assert_eq!(places.map(|place| marks.get(place)), kept);
        assert_eq!(marks.words.len(), 1 + 1 + 3 + 5);
    }

    #[test]
    fn facts_of_a_plan_have_their_places_in_order_in_either_form() {
        let facts: Vec<Fact> = vec![130, 3, 64, 20, 63, 10, 199];
        for count in [200, 2000] {
            let plan = Planned::new(facts.clone(), count);
            assert_eq!(matches!(plan, Planned::List(_)), count == 2000);
            let places: Vec<_> =
                [3, 10, 20, 63, 64, 130, 199, 4, 65].into_iter().map(|fact| plan.place(fact)).collect();
            assert_eq!(places, [Some(0), Some(1), Some(2), Some(3), Some(4), Some(5), Some(6), None, None]);
        }
    }
}
