//! Reasonable orders: where one landmark would be destroyed by achieving another one that is needed before it is used,
//! the other one comes first (Hoffmann, Porteous and Sebastia 2004; Richter and Westphal 2010, section 5.3).

use super::super::relaxed::{Lists, Relaxed};
use super::super::task::{Fact, Task};
use super::graph::{Graph, Order};

/// Most pairs of landmarks that are looked at.
const PAIRS: usize = 2_000_000;

/// Which facts exclude each other.
pub(in super::super) struct Mutexes<'a> {
    task: &'a Task,
    groups: Vec<Vec<u32>>,
}

impl<'a> Mutexes<'a> {
    pub(in super::super) fn new(task: &'a Task) -> Self {
        let mut groups = vec![Vec::new(); task.facts()];
        for (number, facts) in task.mutexes.iter().enumerate() {
            facts.iter().for_each(|fact| groups[*fact as usize].push(number as u32));
        }
        Self { task, groups }
    }

    /// Whether two facts are never true together.
    pub(in super::super) fn exclude(&self, one: Fact, other: Fact) -> bool {
        let share = |one: Fact, other: Fact| {
            self.groups[one as usize].iter().any(|group| self.groups[other as usize].binary_search(group).is_ok())
        };
        one != other && (self.task.variable(one) == self.task.variable(other) || share(one, other))
    }
}

/// Adds reasonable orders and breaks cycles.
pub(in super::super) fn order(task: &Task, relaxed: &Relaxed, graph: &mut Graph) {
    let mutexes = Mutexes::new(task);
    let achievers = relaxed.achievers();
    let effects: Vec<Vec<Fact>> = graph
        .landmarks
        .iter()
        .map(|landmark| match landmark.facts[..] {
            [fact] => common(task, relaxed, &achievers, fact),
            _ => Vec::new(),
        })
        .collect();
    let mut orders: Vec<(u32, u32)> = Vec::new();
    let goals: Vec<u32> =
        (0..graph.landmarks.len() as u32).filter(|number| graph.landmarks[*number as usize].is_goal).collect();
    let mut pairs = 0;
    for number in 0..graph.landmarks.len() as u32 {
        let landmark = &graph.landmarks[number as usize];
        let [fact] = landmark.facts[..] else { continue };
        if landmark.is_gone {
            continue;
        }
        let mut others: Vec<u32> = if landmark.is_goal { goals.clone() } else { Vec::new() };
        for (next, _) in landmark.after.iter().filter(|(_, order)| *order == Order::GreedyNecessary) {
            ancestors(graph, *next, &mut others);
        }
        others.sort_unstable();
        others.dedup();
        for other in others.into_iter().filter(|other| *other != number) {
            pairs += 1;
            if pairs < PAIRS && interferes(graph, &mutexes, &effects, other, fact) {
                orders.push((other, number));
            }
        }
    }
    for (first, second) in orders {
        graph.order(first, second, Order::Reasonable);
    }
    graph.break_cycles();
}

/// What comes before a landmark, for sure.
fn ancestors(graph: &Graph, number: u32, found: &mut Vec<u32>) {
    let mut queue = vec![number];
    let mut seen = vec![false; graph.landmarks.len()];
    while let Some(number) = queue.pop() {
        for (before, order) in &graph.landmarks[number as usize].before {
            if *order >= Order::Natural && !std::mem::replace(&mut seen[*before as usize], true) {
                found.push(*before);
                queue.push(*before);
            }
        }
    }
}

/// Whether a simple landmark cannot be achieved while a fact stays true.
fn interferes(graph: &Graph, mutexes: &Mutexes<'_>, effects: &[Vec<Fact>], other: u32, fact: Fact) -> bool {
    let landmark = &graph.landmarks[other as usize];
    let [achieved] = landmark.facts[..] else { return false };
    if landmark.is_gone || achieved == fact {
        return false;
    }
    // What both need directly before them is no reason: it comes before either of them, and to order all pairs of a chain
    // in this way would hide what is achieved in the other order.
    let precedes = |before: u32| {
        let mut after = graph.landmarks[before as usize].after.iter();
        after.any(|(next, order)| *order == Order::GreedyNecessary && graph.landmarks[*next as usize].facts == [fact])
    };
    let needs = |(before, order): &(u32, Order)| match graph.landmarks[*before as usize].facts[..] {
        [needed] => {
            *order == Order::GreedyNecessary && needed != fact && mutexes.exclude(needed, fact) && !precedes(*before)
        }
        _ => false,
    };
    mutexes.exclude(achieved, fact)
        || effects[other as usize].iter().any(|effect| *effect != fact && mutexes.exclude(*effect, fact))
        || landmark.before.iter().any(needs)
}

/// What all operators that achieve a fact achieve besides.
fn common(task: &Task, relaxed: &Relaxed, achievers: &Lists, fact: Fact) -> Vec<Fact> {
    let mut common: Option<Vec<Fact>> = None;
    for rule in achievers.get(fact as usize) {
        let Some(operator) = relaxed.operator(*rule) else { return Vec::new() };
        let effects = task.operators[operator as usize].effects.iter();
        let sure: Vec<Fact> = effects.filter(|effect| effect.condition.is_empty()).map(|effect| effect.fact).collect();
        match &mut common {
            None => common = Some(sure),
            Some(common) => common.retain(|fact| sure.contains(fact)),
        }
        if common.as_ref().is_some_and(Vec::is_empty) {
            break;
        }
    }
    let mut common = common.unwrap_or_default();
    common.retain(|other| *other != fact);
    common
}
