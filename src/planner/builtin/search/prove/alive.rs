//! Which pairs of facts a state on the way from the first state to a goal can have.
//!
//! First the pairs that are reached from the first state, then those among them from which a goal can be reached, by the
//! operators the other way round, and so on until nothing changes. After each turn, operators and the goal get what
//! follows from their facts: the only value of a variable that goes with them (Alcázar and Torralba 2015, "A reminder
//! about the importance of computing and exploiting invariants in planning").
//!
//! The values of derived variables are left open: they count neither in conditions nor in states.

use super::super::task::{Fact, Operator, OperatorId, Task};
use super::fixpoint::{Fixpoint, Rule};
use super::pairs::{Pairs, contains, insert};

/// The most facts of a task whose pairs are looked at; a set of pairs then takes 32 MB.
const FACTS: usize = 1 << 14;

/// What is known of a task.
#[derive(Debug)]
pub(super) enum Known {
    /// It has no plan.
    Unsolvable,
    /// What plans can be made of.
    Alive(Alive),
    /// The work did not suffice.
    Nothing,
    /// It has too many facts.
    TooLarge,
}

/// What plans can be made of.
#[derive(Debug)]
pub(super) struct Alive {
    /// The pairs that are reached, but not on the way to a goal.
    pub(super) dead: Pairs,
    /// The operators that can be part of a plan.
    pub(super) operators: Vec<OperatorId>,
}

/// Finds out what it can with so much work.
pub(super) fn alive(task: &Task, work: u64) -> Known {
    if task.facts() > FACTS {
        return Known::TooLarge;
    }
    let mut turns = Turns::new(task, work);
    let mut reached: Option<Pairs> = None;
    let mut is_forward = true;
    loop {
        match turns.turn(is_forward) {
            Turn::Unsolvable => return Known::Unsolvable,
            Turn::Spent | Turn::Same => break,
            Turn::New => {}
        }
        if reached.is_none() {
            reached.clone_from(&turns.alive);
        }
        is_forward = !is_forward;
    }
    match (reached, turns.alive) {
        (Some(mut dead), Some(alive)) => {
            dead.remove_all(&alive);
            Known::Alive(Alive { dead, operators: turns.sides.iter().map(|sides| sides.operator).collect() })
        }
        _ => Known::Nothing,
    }
}

/// What becomes of a turn.
enum Turn {
    Unsolvable,
    /// It found fewer pairs than the turn before.
    New,
    Same,
    Spent,
}

/// What is known of the states before and after an operator.
#[derive(Debug)]
struct Sides {
    operator: OperatorId,
    before: Vec<Fact>,
    after: Vec<Fact>,
}

struct Turns<'t> {
    task: &'t Task,
    init: Vec<Fact>,
    goal: Vec<Fact>,
    sides: Vec<Sides>,
    /// The pairs that the last turn left; none before the first one.
    alive: Option<Pairs>,
    work: u64,
}

impl<'t> Turns<'t> {
    fn new(task: &'t Task, work: u64) -> Self {
        let sides = |(number, operator): (usize, &Operator)| {
            let before = open(task, &operator.condition);
            let stays = |fact: &&Fact| operator.effects.iter().all(|effect| !is_same(task, effect.fact, **fact));
            let mut after: Vec<Fact> = before.iter().filter(stays).copied().collect();
            for (place, effect) in operator.effects.iter().enumerate() {
                let is_last = operator.effects[place + 1..].iter().all(|later| !is_same(task, later.fact, effect.fact));
                if is_last && effect.condition.is_empty() {
                    after.push(effect.fact);
                }
            }
            after.sort_unstable();
            Sides { operator: number as OperatorId, before, after }
        };
        let sides = task.operators.iter().enumerate().map(sides).collect();
        Self { task, init: open(task, &task.init), goal: open(task, &task.goal), sides, alive: None, work }
    }

    /// Computes the pairs of one direction among those that are left.
    fn turn(&mut self, is_forward: bool) -> Turn {
        let mut fixpoint = Fixpoint::new(self.task, self.alive.as_ref());
        if is_forward {
            fixpoint.start(&self.set(&self.init));
        } else {
            let mut last = self.set(&open(self.task, &(0..self.task.facts() as Fact).collect::<Vec<_>>()));
            self.alive.iter().for_each(|alive| alive.meet(&self.goal, &mut last));
            fixpoint.start(&last);
        }
        let rule = |sides: &Sides| if is_forward { forward(self.task, sides) } else { backward(self.task, sides) };
        let rules: Vec<Rule> = self.sides.iter().map(rule).collect();
        if !fixpoint.run(&rules, &mut self.work) {
            return Turn::Spent;
        }
        let pairs = fixpoint.reached;
        if self.alive.as_ref() == Some(&pairs) {
            return Turn::Same;
        }
        let single = pairs.single();
        if !pairs.has_all(&self.init) && !is_forward || !complete(self.task, &pairs, &single, &mut self.goal) {
            return Turn::Unsolvable;
        }
        let cost = (self.task.facts() + self.task.len()) as u64 * self.sides.len() as u64;
        // What follows for the operators is of use for another turn only.
        if cost < self.work {
            let task = self.task;
            self.sides.retain_mut(|sides| {
                complete(task, &pairs, &single, &mut sides.before) && complete(task, &pairs, &single, &mut sides.after)
            });
        }
        self.work = self.work.saturating_sub(cost);
        self.alive = Some(pairs);
        if self.work == 0 { Turn::Spent } else { Turn::New }
    }

    fn set(&self, facts: &[Fact]) -> Vec<u64> {
        let mut set = vec![0; self.task.facts().div_ceil(64)];
        facts.iter().for_each(|fact| _ = insert(&mut set, *fact));
        set
    }
}

/// Those facts whose variables are not derived.
fn open(task: &Task, facts: &[Fact]) -> Vec<Fact> {
    facts.iter().filter(|fact| !task.is_derived[task.variable(**fact)]).copied().collect()
}

fn is_same(task: &Task, one: Fact, other: Fact) -> bool {
    task.variable(one) == task.variable(other)
}

fn is_changed(task: &Task, operator: &Operator, fact: Fact) -> bool {
    operator.effects.iter().any(|effect| is_same(task, effect.fact, fact))
}

/// The facts of one side, with those of the other one that an operator does not change.
fn side(task: &Task, operator: &Operator, one: &[Fact], other: &[Fact]) -> Vec<Fact> {
    let stays = other.iter().filter(|fact| !is_changed(task, operator, **fact));
    let mut all: Vec<Fact> = one.iter().chain(stays).copied().collect();
    all.sort_unstable();
    all.dedup();
    all
}

fn forward(task: &Task, sides: &Sides) -> Rule {
    let operator = &task.operators[sides.operator as usize];
    let certain = operator.effects.iter().filter(|effect| effect.condition.is_empty());
    Rule {
        needs: side(task, operator, &sides.before, &sides.after),
        certain: side(task, operator, &sides.after, &sides.before),
        adds: operator.effects.iter().map(|effect| (effect.fact, open(task, &effect.condition))).collect(),
        changed: certain.map(|effect| task.variables[effect.fact as usize]).collect(),
    }
}

/// The rule from the states after an operator to those before it: a variable that it changes may have had any value, if
/// its condition does not say which one.
fn backward(task: &Task, sides: &Sides) -> Rule {
    let operator = &task.operators[sides.operator as usize];
    let mut changed: Vec<u32> = operator.effects.iter().map(|effect| task.variables[effect.fact as usize]).collect();
    changed.sort_unstable();
    changed.dedup();
    let mut adds = Vec::new();
    for variable in &changed {
        let domain = task.domain(*variable as usize);
        match sides.before.iter().find(|fact| domain.contains(fact)) {
            Some(fact) => adds.push((*fact, Vec::new())),
            None => adds.extend(domain.map(|fact| (fact, Vec::new()))),
        }
    }
    Rule {
        needs: side(task, operator, &sides.after, &sides.before),
        certain: side(task, operator, &sides.before, &sides.after),
        adds,
        changed,
    }
}

/// Adds the facts that follow from a conjunction; says whether it can hold. Those that are possible are `single`.
fn complete(task: &Task, pairs: &Pairs, single: &[u64], conjunction: &mut Vec<Fact>) -> bool {
    if !pairs.has_all(conjunction) {
        return false;
    }
    let mut fits = single.to_vec();
    pairs.meet(conjunction, &mut fits);
    for variable in (0..task.len()).filter(|variable| !task.is_derived[*variable]) {
        let domain = task.domain(variable);
        let mut values = domain.clone().filter(|fact| contains(&fits, *fact));
        match (values.next(), values.next()) {
            (None, _) => return false,
            (Some(fact), None) if !conjunction.iter().any(|known| domain.contains(known)) => conjunction.push(fact),
            _ => {}
        }
    }
    conjunction.sort_unstable();
    true
}
