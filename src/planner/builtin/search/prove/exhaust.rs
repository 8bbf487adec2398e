//! Breadth-first search through all states, without estimates: what it has looked at is remembered, and what cannot lead
//! to a goal by the pairs of its facts is left out. Where it comes to its end, there is no plan.

use super::super::axiom::Axioms;
use super::super::lazy::Step;
use super::super::state::{Space, StateId};
use super::super::successor::{Generator, apply, holds};
use super::super::task::{Fact, OperatorId, Task};
use super::super::ways::Expansions;
use super::alive::Alive;
use super::pairs::{Pairs, contains};

/// The search, which can be continued.
pub(super) struct Exhaust<'t> {
    task: &'t Task,
    generator: Generator,
    /// Pairs of facts of states that lead to no goal, and which facts are in one.
    dead: Pairs,
    is_deadly: Vec<bool>,
    axioms: Axioms,
    space: Space,
    expansions: Expansions,
    /// The next state to look at: states have the order in which they were found.
    next: StateId,
    work: u64,
    before: Vec<Fact>,
    state: Vec<Fact>,
    applicable: Vec<OperatorId>,
}

impl<'t> Exhaust<'t> {
    /// Starts a search with what is known of the task.
    pub(super) fn new(task: &'t Task, known: Option<Alive>) -> Self {
        let all = || (0..task.operators.len() as OperatorId).collect();
        let (dead, operators) = known.map_or_else(|| (None, all()), |known| (Some(known.dead), known.operators));
        let is_in_pair = |dead: &Pairs, fact| dead.row(fact).iter().any(|word| *word != 0);
        let is_deadly = |fact| dead.as_ref().is_some_and(|dead| is_in_pair(dead, fact));
        let mut axioms = Axioms::new(task);
        let mut state = task.init.clone();
        axioms.derive(task, &mut state);
        let mut space = Space::new(task);
        space.insert(&state);
        Self {
            task,
            generator: Generator::of(task, operators),
            is_deadly: (0..task.facts() as Fact).map(is_deadly).collect(),
            dead: dead.unwrap_or_else(|| Pairs::none(0)),
            axioms,
            space,
            expansions: Expansions::default(),
            next: 0,
            work: 0,
            before: state.clone(),
            state,
            applicable: Vec::new(),
        }
    }

    /// Returns how many states were reached.
    pub(super) fn states(&self) -> usize {
        self.space.len()
    }

    /// Returns how many states are still to be looked at.
    pub(super) fn waiting(&self) -> usize {
        self.space.len() - self.next as usize
    }

    /// Searches until so much work is done, in so many bytes.
    pub(super) fn run(&mut self, work: u64, memory: usize) -> Step {
        let end = self.work.saturating_add(work);
        while self.work < end {
            if self.waiting() == 0 {
                return Step::Exhausted;
            }
            if let Some(plan) = self.expand(self.next) {
                return Step::Plan(plan);
            }
            self.next += 1;
            if self.next.is_multiple_of(256) && self.space.bytes() + self.expansions.bytes() > memory {
                return Step::Full;
            }
        }
        Step::Spent
    }

    fn expand(&mut self, id: StateId) -> Option<Vec<OperatorId>> {
        let task = self.task;
        self.space.state(id, &mut self.before);
        self.expansions.push(id, self.space.len() as StateId);
        self.applicable.clear();
        self.generator.applicable(task, &self.before, &mut self.applicable);
        self.work += (task.len() / 8 + self.applicable.len() + 8) as u64;
        for operator in &self.applicable {
            self.state.copy_from_slice(&self.before);
            apply(task, &mut self.axioms, &task.operators[*operator as usize], &mut self.state);
            self.work += (task.len() / 4 + task.axioms.len() + 48) as u64;
            let facts = task.len();
            if is_dead(&self.dead, &self.is_deadly, &self.before[..facts], &self.state[..facts]) {
                continue;
            }
            let (child, is_new) = self.space.insert(&self.state);
            if is_new && holds(task, &self.state, &task.goal) {
                return Some(self.expansions.plan(task, &self.generator, &self.space, child));
            }
        }
        None
    }
}

/// Whether the facts of a state have a dead pair that those before did not have.
fn is_dead(dead: &Pairs, is_deadly: &[bool], before: &[Fact], state: &[Fact]) -> bool {
    let new = state.iter().zip(before).filter(|(fact, old)| fact != old && is_deadly[**fact as usize]);
    new.map(|(fact, _)| dead.row(*fact)).any(|row| state.iter().any(|other| contains(row, *other)))
}
