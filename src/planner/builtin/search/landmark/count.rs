//! The landmark count: how many landmarks are still to be achieved on the way to a state (Richter, Helmert and
//! Westphal 2008; Richter and Westphal 2010, section 5).
//!
//! A landmark is accepted once it was true, whatever comes before it reasonably; it is counted as long as that was not
//! true (a simplification of past and future landmarks: Büchner, Keller, Eriksson and Helmert 2023, "Landmarks Progression
//! in Heuristic Search").

use super::super::successor::holds;
use super::super::task::{Fact, Operator, Task};
use super::graph::{Graph, Order};

/// The landmarks of a task, made ready to be counted.
#[derive(Debug, Default)]
pub(in super::super) struct Counter {
    landmarks: Vec<Entry>,
    /// The landmark that a fact is in: [`NONE`] for none.
    by_fact: Vec<u32>,
    words: usize,
}

#[derive(Debug)]
struct Entry {
    facts: Vec<Fact>,
    is_goal: bool,
    before: Vec<u32>,
    /// What comes before it only reasonably.
    reasonable: Vec<u32>,
    /// What needs it directly before.
    needed_by: Vec<u32>,
}

/// No landmark.
const NONE: u32 = u32::MAX;

impl Counter {
    pub(in super::super) fn new(task: &Task, graph: &Graph) -> Self {
        let mut numbers = vec![NONE; graph.landmarks.len()];
        let kept = graph.landmarks.iter().enumerate().filter(|(_, landmark)| !landmark.is_gone);
        for (next, (number, _)) in kept.clone().enumerate() {
            numbers[number] = next as u32;
        }
        let mut by_fact = vec![NONE; task.facts()];
        let mut landmarks = Vec::new();
        for (_, landmark) in kept {
            for fact in &landmark.facts {
                by_fact[*fact as usize] = landmarks.len() as u32;
            }
            let reasonable = landmark.before.iter().filter(|(_, order)| *order == Order::Reasonable);
            let strict = landmark.after.iter().filter(|(_, order)| *order == Order::GreedyNecessary);
            landmarks.push(Entry {
                facts: landmark.facts.clone(),
                is_goal: landmark.is_goal,
                before: landmark.before.iter().map(|(before, _)| numbers[*before as usize]).collect(),
                reasonable: reasonable.map(|(before, _)| numbers[*before as usize]).collect(),
                needed_by: strict.map(|(after, _)| numbers[*after as usize]).collect(),
            });
        }
        let words = landmarks.len().div_ceil(64);
        Self { landmarks, by_fact, words }
    }

    /// Returns how many words the set of accepted landmarks takes.
    pub(in super::super) fn words(&self) -> usize {
        self.words
    }

    fn is_true(&self, task: &Task, state: &[Fact], number: usize) -> bool {
        self.landmarks[number].facts.iter().any(|fact| state[task.variable(*fact)] == *fact)
    }

    /// Computes which landmarks are accepted at first: those that are true.
    pub(in super::super) fn start(&self, task: &Task, state: &[Fact], accepted: &mut [u64]) {
        let none = vec![0; accepted.len()];
        self.accept(task, state, &none, accepted);
    }

    /// Adds the landmarks that a state achieves, given those that were accepted before it.
    pub(in super::super) fn accept(&self, task: &Task, state: &[Fact], before: &[u64], accepted: &mut [u64]) {
        accepted.copy_from_slice(before);
        for (word, bits) in before.iter().enumerate() {
            let mut open = !bits;
            while open != 0 {
                let number = word * 64 + open.trailing_zeros() as usize;
                open &= open - 1;
                if number >= self.landmarks.len() {
                    break;
                }
                if self.is_true(task, state, number) {
                    accepted[word] |= 1 << (number % 64);
                }
            }
        }
    }

    /// Returns how many landmarks are not accepted, or have to be achieved again: goals, what others need next, and what
    /// was achieved before what reasonably comes before it.
    pub(in super::super) fn count(&self, task: &Task, state: &[Fact], accepted: &[u64]) -> u32 {
        let is_open = |number: &usize| {
            let landmark = &self.landmarks[*number];
            let is_needed = || landmark.is_goal || landmark.needed_by.iter().any(|after| !has(accepted, *after));
            let is_early = || landmark.reasonable.iter().any(|before| !has(accepted, *before));
            !has(accepted, *number as u32) || !self.is_true(task, state, *number) && is_needed() || is_early()
        };
        (0..self.landmarks.len()).filter(is_open).count() as u32
    }
}

impl Counter {
    /// Says what an operator that is applicable achieves of the landmarks that are next.
    pub(in super::super) fn achieves(
        &self,
        task: &Task,
        state: &[Fact],
        accepted: &[u64],
        operator: &Operator,
    ) -> Achieved {
        let mut best = Achieved::Nothing;
        for effect in &operator.effects {
            let Some(number) = self.by_fact.get(effect.fact as usize).copied().filter(|number| *number != NONE) else {
                continue;
            };
            let landmark = &self.landmarks[number as usize];
            let is_next = || landmark.before.iter().all(|before| has(accepted, *before));
            if !has(accepted, number) && is_next() && holds(task, state, &effect.condition) {
                best = best.max(if landmark.facts.len() == 1 { Achieved::Simple } else { Achieved::Disjunctive });
            }
        }
        best
    }
}

/// What an operator achieves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(in super::super) enum Achieved {
    /// No landmark.
    Nothing,
    /// One of several facts.
    Disjunctive,
    /// A fact of its own.
    Simple,
}

fn has(set: &[u64], number: u32) -> bool {
    set[number as usize / 64] >> (number % 64) & 1 == 1
}
