//! Drops what is never applicable, what is always true, and what no goal depends on.

use super::super::hash::NumberMap;
use super::super::number;
use super::formula::{GroundAxiom, Literal};
use super::instance::{Instances, NumericChange, Operator};
use super::ledger::Compared;

/// Conjunctions of literals that lead to literals: a delete-relaxed task in which "not" can be reached as well.
struct Relaxed {
    /// How many conditions are open, and what follows.
    open: Vec<(u32, Literal)>,
    /// The rules in whose conditions a literal is.
    uses: Vec<Vec<u32>>,
}

impl Relaxed {
    fn new(instances: &Instances) -> Self {
        let literals = instances.init.len() * 2;
        let mut relaxed = Self { open: Vec::new(), uses: vec![Vec::new(); literals] };
        for operator in &instances.operators {
            for change in &operator.changes {
                let head = change.atom << 1 | u32::from(!change.adds);
                relaxed.rule(operator.condition.iter().chain(&change.condition), head);
            }
        }
        for axiom in &instances.axioms {
            relaxed.rule(axiom.body.iter(), axiom.head << 1);
        }
        relaxed
    }

    fn rule<'l>(&mut self, body: impl Iterator<Item = &'l Literal>, head: Literal) {
        let number = self.open.len() as u32;
        let mut count = 0;
        for literal in body {
            self.uses[*literal as usize].push(number);
            count += 1;
        }
        self.open.push((count, head));
    }

    /// Which literals can be true at some time.
    fn reach(mut self, instances: &Instances) -> Vec<bool> {
        let mut reached = vec![false; self.uses.len()];
        let mut queue: Vec<Literal> = Vec::new();
        let mut add = |literal: Literal, queue: &mut Vec<Literal>| {
            if !std::mem::replace(&mut reached[literal as usize], true) {
                queue.push(literal);
            }
        };
        for atom in changing(instances) {
            add(atom << 1, &mut queue);
            add(atom << 1 | 1, &mut queue);
        }
        // Derived atoms are false at first, unless they follow from nothing.
        let mut is_derived = vec![false; instances.init.len()];
        instances.axioms.iter().for_each(|axiom| is_derived[axiom.head as usize] = true);
        let mut is_certain = vec![false; instances.init.len()];
        for axiom in instances.axioms.iter().filter(|axiom| axiom.body.is_empty()) {
            is_certain[axiom.head as usize] = true;
            add(axiom.head << 1, &mut queue);
        }
        // What cannot be computed does not hold, nor does its negation.
        let ledger = &instances.ledger;
        let undefined = ledger.comparisons.iter().filter(|compared| ledger.outcome(compared).is_none());
        undefined.for_each(|compared| is_certain[compared.atom as usize] = true);
        for (atom, is_true) in instances.init.iter().enumerate() {
            if !is_certain[atom] {
                add((atom as u32) << 1 | u32::from(!is_true), &mut queue);
            }
            if is_derived[atom] && !is_certain[atom] {
                add((atom as u32) << 1 | 1, &mut queue);
            }
        }
        for (count, head) in &self.open {
            if *count == 0 {
                add(*head, &mut queue);
            }
        }
        while let Some(literal) = queue.pop() {
            for rule in &self.uses[literal as usize] {
                let (count, head) = &mut self.open[*rule as usize];
                *count -= 1;
                if *count == 0 {
                    add(*head, &mut queue);
                }
            }
        }
        reached
    }
}

/// Drops operators, changes and literals; returns which atoms matter.
pub(super) fn simplify(instances: &mut Instances) -> Vec<bool> {
    let certain = |instances: &Instances| instances.axioms.iter().filter(|axiom| axiom.body.is_empty()).count();
    loop {
        let before = certain(instances);
        constants(instances);
        if certain(instances) == before {
            return relevant(instances);
        }
    }
}

/// The comparisons of what some operator changes.
fn changing(instances: &Instances) -> Vec<u32> {
    let mut is_changed = vec![false; instances.ledger.init.len()];
    for amount in instances.operators.iter().flat_map(|operator| &operator.amounts) {
        is_changed[amount.variable as usize] = true;
    }
    let comparisons = instances.ledger.comparisons.iter();
    let changing = comparisons.filter(|compared| read(compared).iter().any(|read| is_changed[*read as usize]));
    changing.map(|compared| compared.atom).collect()
}

/// The variables that a comparison reads.
fn read(compared: &Compared) -> Vec<u32> {
    let mut found = Vec::new();
    compared.left.variables(&mut found);
    compared.right.variables(&mut found);
    found
}

/// Drops what cannot be, and conditions that always hold.
fn constants(instances: &mut Instances) {
    let reached = Relaxed::new(instances).reach(instances);
    let may_hold = |literals: &[Literal]| literals.iter().all(|literal| reached[*literal as usize]);
    // A literal whose negation is never true always is.
    let trim = |literals: &mut Vec<Literal>| literals.retain(|literal| reached[*literal as usize ^ 1]);
    instances.operators.retain(|operator| may_hold(&operator.condition));
    for operator in &mut instances.operators {
        operator.changes.retain(|change| {
            may_hold(&change.condition) && reached[change.atom as usize * 2] && reached[change.atom as usize * 2 + 1]
        });
        trim(&mut operator.condition);
        operator.changes.iter_mut().for_each(|change| trim(&mut change.condition));
        operator.amounts.retain(|amount| may_hold(&amount.condition));
        operator.amounts.iter_mut().for_each(|amount| trim(&mut amount.condition));
    }
    instances.axioms.retain(|axiom| may_hold(&axiom.body));
    instances.axioms.iter_mut().for_each(|axiom| trim(&mut axiom.body));
    instances.is_hopeless |= !may_hold(&instances.goal);
    trim(&mut instances.goal);
}

/// The changes of numbers that are not possible in every state.
fn fallible<'i>(instances: &'i Instances, operator: &'i Operator) -> impl Iterator<Item = &'i NumericChange> {
    let changes: Vec<_> =
        operator.amounts.iter().map(|amount| (amount.variable, amount.change, &amount.amount)).collect();
    let may_fail = number::fallible(&changes, &|variable| instances.ledger.lacks(variable));
    operator.amounts.iter().zip(may_fail).filter_map(|(amount, may_fail)| may_fail.then_some(amount))
}

/// Which atoms the goal depends on; operators and changes that concern no such atom are dropped.
fn relevant(instances: &mut Instances) -> Vec<bool> {
    let atoms = instances.init.len();
    let mut changed_by: Vec<Vec<(u32, u32)>> = vec![Vec::new(); atoms];
    for (number, operator) in instances.operators.iter().enumerate() {
        for (place, change) in operator.changes.iter().enumerate() {
            changed_by[change.atom as usize].push((number as u32, place as u32));
        }
    }
    let mut counted_by: Vec<Vec<(u32, u32)>> = vec![Vec::new(); instances.ledger.init.len()];
    for (number, operator) in instances.operators.iter().enumerate() {
        for (place, amount) in operator.amounts.iter().enumerate() {
            counted_by[amount.variable as usize].push((number as u32, place as u32));
        }
    }
    let mut compared_by: NumberMap<u32, Vec<u32>> = NumberMap::default();
    compared_by.extend(instances.ledger.comparisons.iter().map(|compared| (compared.atom, read(compared))));
    let mut is_read = vec![false; instances.ledger.init.len()];
    let mut derived_by: Vec<Vec<u32>> = vec![Vec::new(); atoms];
    for (number, axiom) in instances.axioms.iter().enumerate() {
        derived_by[axiom.head as usize].push(number as u32);
    }
    let mut is_relevant = vec![false; atoms];
    let mut is_done = vec![false; instances.operators.len()];
    let mut queue: Vec<u32> = Vec::new();
    let mut add = |literals: &[Literal], queue: &mut Vec<u32>| {
        for literal in literals {
            if !std::mem::replace(&mut is_relevant[(literal >> 1) as usize], true) {
                queue.push(literal >> 1);
            }
        }
    };
    add(&instances.goal, &mut queue);
    while let Some(atom) = queue.pop() {
        let mut operators: Vec<u32> = Vec::new();
        for (number, place) in &changed_by[atom as usize] {
            operators.push(*number);
            let operator = &instances.operators[*number as usize];
            add(&operator.changes[*place as usize].condition, &mut queue);
        }
        let mut variables = compared_by.get(&atom).cloned().unwrap_or_default();
        loop {
            for number in operators.drain(..) {
                if std::mem::replace(&mut is_done[number as usize], true) {
                    continue;
                }
                let operator = &instances.operators[number as usize];
                add(&operator.condition, &mut queue);
                // Whether these can be computed decides whether it is applicable.
                for amount in fallible(instances, operator) {
                    add(&amount.condition, &mut queue);
                    variables.push(amount.variable);
                    amount.amount.variables(&mut variables);
                }
            }
            let Some(variable) = variables.pop() else { break };
            if std::mem::replace(&mut is_read[variable as usize], true) {
                continue;
            }
            for (number, place) in &counted_by[variable as usize] {
                operators.push(*number);
                let amount = &instances.operators[*number as usize].amounts[*place as usize];
                add(&amount.condition, &mut queue);
                amount.amount.variables(&mut variables);
            }
        }
        for number in &derived_by[atom as usize] {
            add(&instances.axioms[*number as usize].body, &mut queue);
        }
    }
    for operator in &mut instances.operators {
        operator.changes.retain(|change| is_relevant[change.atom as usize]);
        operator.amounts.retain(|amount| is_read[amount.variable as usize]);
    }
    instances.operators.retain(|operator| !operator.changes.is_empty() || !operator.amounts.is_empty());
    instances.axioms.retain(|axiom: &GroundAxiom| is_relevant[axiom.head as usize]);
    instances.is_read = is_read;
    is_relevant
}
