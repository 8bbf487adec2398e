//! Landmarks by going back from the goals.

use super::super::hash::NumberMap;
use super::super::relaxed::{Lists, Relaxed};
use super::super::task::{Fact, Task};
use super::graph::{Graph, Order};
use super::transition::Transitions;

/// Most facts of a disjunctive landmark (Richter and Westphal 2010).
const DISJUNCTION: usize = 4;

/// Most rules that are touched to find landmarks; what is found until then is used.
const WORK: u64 = 2_000_000_000;

/// Finds the landmarks of a task, with natural and greedy-necessary orders.
pub(in super::super) fn landmarks(task: &Task, relaxed: &mut Relaxed) -> Graph {
    let achievers = relaxed.achievers();
    let sure = relaxed.sure(task);
    let transitions = Transitions::new(task);
    let mut finder = Finder {
        task,
        relaxed,
        achievers,
        sure,
        transitions,
        graph: Graph::default(),
        queue: Vec::new(),
        later: Vec::new(),
    };
    for goal in &task.goal {
        let (number, _) = finder.graph.add_simple(*goal);
        finder.graph.landmarks[number as usize].is_goal = true;
        finder.queue.push(number);
    }
    finder.run();
    finder.graph
}

struct Finder<'a> {
    task: &'a Task,
    relaxed: &'a mut Relaxed,
    achievers: Lists,
    sure: Vec<bool>,
    transitions: Transitions,
    graph: Graph,
    queue: Vec<u32>,
    /// Facts that are not reachable before a landmark.
    later: Vec<(u32, Vec<Fact>)>,
}

impl Finder<'_> {
    fn run(&mut self) {
        let mut reached = vec![false; self.task.relaxed_facts.max(self.task.facts())];
        let init = self.task.init.clone();
        let start = self.relaxed.work;
        let mut next = 0;
        while next < self.queue.len() && self.relaxed.work - start < WORK {
            let number = self.queue[next];
            next += 1;
            let landmark = &self.graph.landmarks[number as usize];
            let facts = landmark.facts.clone();
            if landmark.is_gone || facts.iter().any(|fact| init[self.task.variable(*fact)] == *fact) {
                continue;
            }
            self.relaxed.reach_before(&init, &facts, &self.achievers, &self.sure, &mut reached);
            self.before(number, &facts, &reached);
            if let [fact] = facts[..] {
                for value in self.transitions.between(self.task, init[self.task.variable(fact)], fact, &reached) {
                    self.simple(value, number, Order::Natural);
                }
            }
            let late = (0..self.task.facts() as Fact).filter(|fact| !reached[*fact as usize] && !facts.contains(fact));
            self.later.push((number, late.collect()));
        }
        for (number, late) in std::mem::take(&mut self.later) {
            let others: Vec<u32> = late.into_iter().filter_map(|fact| self.graph.simple(fact)).collect();
            for other in others {
                self.graph.order(number, other, Order::Natural);
            }
        }
    }

    /// Adds what the first achievers of a landmark need.
    fn before(&mut self, number: u32, facts: &[Fact], reached: &[bool]) {
        let rules: Vec<u32> = facts.iter().flat_map(|fact| self.achievers.get(*fact as usize)).copied().collect();
        let may_be_first = |rule: &u32| self.relaxed.condition(*rule).iter().all(|fact| reached[*fact as usize]);
        let first: Vec<u32> = rules.into_iter().filter(may_be_first).collect();
        let Some((one, rest)) = first.split_first() else { return };
        let mut shared: Vec<Fact> = self.relaxed.condition(*one).to_vec();
        for rule in rest {
            let condition = self.relaxed.condition(*rule);
            shared.retain(|fact| condition.binary_search(fact).is_ok());
        }
        let known = self.task.facts();
        shared.retain(|fact| (*fact as usize) < known);
        for fact in &shared {
            self.simple(*fact, number, Order::GreedyNecessary);
        }
        for facts in self.disjunctions(&first, &shared) {
            if let Some((before, is_new)) = self.graph.add_disjunctive(facts) {
                self.graph.order(before, number, Order::GreedyNecessary);
                self.queue.extend(is_new.then_some(before));
            }
        }
    }

    fn simple(&mut self, fact: Fact, after: u32, order: Order) {
        let (number, is_new) = self.graph.add_simple(fact);
        self.graph.order(number, after, order);
        self.queue.extend(is_new.then_some(number));
    }

    /// Small sets of facts of one predicate, of which each rule needs one and none is true at first.
    fn disjunctions(&self, rules: &[u32], shared: &[Fact]) -> Vec<Vec<Fact>> {
        let task = self.task;
        let mut sets: NumberMap<u32, (usize, Vec<Fact>)> = NumberMap::default();
        let mut order: Vec<u32> = Vec::new();
        for (place, rule) in rules.iter().enumerate() {
            for fact in self.relaxed.condition(*rule).iter().filter(|fact| (**fact as usize) < task.facts()) {
                let Some(predicate) = task.predicates[*fact as usize] else { continue };
                let (count, facts) = sets.entry(predicate).or_insert_with(|| {
                    order.push(predicate);
                    (0, Vec::new())
                });
                // Each rule so far has had a fact of the predicate, or the set is no landmark.
                if *count == place {
                    *count += 1;
                }
                if facts.len() <= DISJUNCTION && !facts.contains(fact) {
                    facts.push(*fact);
                }
            }
        }
        let found = order.into_iter().filter_map(|predicate| {
            let (count, facts) = sets.get_mut(&predicate)?;
            let fits = *count == rules.len() && (2..=DISJUNCTION).contains(&facts.len());
            let is_new = |fact: &Fact| !shared.contains(fact) && task.init[task.variable(*fact)] != *fact;
            facts.sort_unstable();
            (fits && facts.iter().all(is_new)).then(|| facts.clone())
        });
        found.collect()
    }
}
