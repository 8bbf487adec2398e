//! Landmarks and the orders between them.

use super::super::hash::NumberMap;
use super::super::task::Fact;

/// How sure it is that one landmark comes before another (Hoffmann, Porteous and Sebastia 2004).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(in super::super) enum Order {
    /// Otherwise, the second would have to be made true again.
    Reasonable,
    /// At some time before.
    Natural,
    /// Directly before the second is true for the first time.
    GreedyNecessary,
}

/// Facts of which one must be true at some time.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in super::super) struct Landmark {
    /// In order; only one of a simple landmark.
    pub(in super::super) facts: Vec<Fact>,
    pub(in super::super) is_goal: bool,
    /// What comes before.
    pub(in super::super) before: Vec<(u32, Order)>,
    /// What comes after.
    pub(in super::super) after: Vec<(u32, Order)>,
    /// Whether a stronger landmark has taken its place.
    pub(in super::super) is_gone: bool,
}

/// The landmarks of a task.
#[derive(Debug, Clone, Default)]
pub(in super::super) struct Graph {
    pub(in super::super) landmarks: Vec<Landmark>,
    simple: NumberMap<Fact, u32>,
    disjunctive: NumberMap<Fact, u32>,
}

impl Graph {
    /// Returns the simple landmark of a fact.
    pub(in super::super) fn simple(&self, fact: Fact) -> Option<u32> {
        self.simple.get(&fact).copied()
    }

    /// Adds a simple landmark; says its number and whether it is new.
    pub(in super::super) fn add_simple(&mut self, fact: Fact) -> (u32, bool) {
        if let Some(number) = self.simple(fact) {
            return (number, false);
        }
        // It is stronger than a disjunction that it is part of.
        if let Some(weaker) = self.disjunctive.get(&fact).copied() {
            self.remove(weaker);
        }
        let number = self.push(vec![fact]);
        self.simple.insert(fact, number);
        (number, true)
    }

    /// Adds a disjunctive landmark; `None` where one of its facts is in another.
    pub(in super::super) fn add_disjunctive(&mut self, facts: Vec<Fact>) -> Option<(u32, bool)> {
        if facts.iter().any(|fact| self.simple.contains_key(fact)) {
            return None;
        }
        if let Some(known) = facts.iter().find_map(|fact| self.disjunctive.get(fact).copied()) {
            return (self.landmarks[known as usize].facts == facts).then_some((known, false));
        }
        let number = self.push(facts.clone());
        self.disjunctive.extend(facts.into_iter().map(|fact| (fact, number)));
        Some((number, true))
    }

    fn push(&mut self, facts: Vec<Fact>) -> u32 {
        let landmark = Landmark { facts, is_goal: false, before: Vec::new(), after: Vec::new(), is_gone: false };
        self.landmarks.push(landmark);
        self.landmarks.len() as u32 - 1
    }

    fn remove(&mut self, number: u32) {
        let landmark = &mut self.landmarks[number as usize];
        landmark.is_gone = true;
        let (facts, before, after) =
            (landmark.facts.clone(), std::mem::take(&mut landmark.before), std::mem::take(&mut landmark.after));
        for fact in &facts {
            self.disjunctive.remove(fact);
        }
        for (other, _) in before {
            self.landmarks[other as usize].after.retain(|(place, _)| *place != number);
        }
        for (other, _) in after {
            self.landmarks[other as usize].before.retain(|(place, _)| *place != number);
        }
    }

    /// Adds an order, or makes one stronger.
    pub(in super::super) fn order(&mut self, first: u32, second: u32, order: Order) {
        let is_gone = self.landmarks[first as usize].is_gone || self.landmarks[second as usize].is_gone;
        if first == second || is_gone {
            return;
        }
        let set = |list: &mut Vec<(u32, Order)>, other: u32| match list.iter_mut().find(|(known, _)| *known == other) {
            Some((_, known)) => *known = order.max(*known),
            None => list.push((other, order)),
        };
        set(&mut self.landmarks[first as usize].after, second);
        set(&mut self.landmarks[second as usize].before, first);
    }

    fn forget(&mut self, first: u32, second: u32) {
        self.landmarks[first as usize].after.retain(|(place, _)| *place != second);
        self.landmarks[second as usize].before.retain(|(place, _)| *place != first);
    }

    /// Drops the weakest order of each cycle.
    pub(in super::super) fn break_cycles(&mut self) {
        let mut is_done = vec![false; self.landmarks.len()];
        for start in 0..self.landmarks.len() as u32 {
            while let Some((first, second)) = self.cycle(start, &mut is_done) {
                self.forget(first, second);
            }
        }
    }

    /// The weakest order of a cycle that is reached from a landmark. What is done leads to none.
    fn cycle(&self, start: u32, is_done: &mut [bool]) -> Option<(u32, u32)> {
        let mut path: Vec<(u32, usize)> = vec![(start, 0)];
        let mut is_on_path = vec![false; self.landmarks.len()];
        is_on_path[start as usize] = true;
        while let Some((place, next)) = path.last_mut() {
            let after = &self.landmarks[*place as usize].after;
            if is_done[*place as usize] || *next == after.len() {
                is_done[*place as usize] = true;
                is_on_path[*place as usize] = false;
                path.pop();
                continue;
            }
            let (child, _) = after[*next];
            *next += 1;
            if is_on_path[child as usize] {
                let first = path.iter().position(|(place, _)| *place == child).unwrap_or_default();
                let edges = path[first..].iter().map(|(place, next)| {
                    let (child, order) = self.landmarks[*place as usize].after[next - 1];
                    (order, *place, child)
                });
                return edges.min().map(|(_, first, second)| (first, second));
            }
            if !is_done[child as usize] {
                is_on_path[child as usize] = true;
                path.push((child, 0));
            }
        }
        None
    }
}
