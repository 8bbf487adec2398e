//! Which operators are applicable in a state, and which state they lead to.
//!
//! The operators are the leaves of a tree that is descended along the values of the state (Helmert 2006, "The Fast
//! Downward planning system", section 5.3.1), so that only few conditions are looked at.

use super::axiom::Axioms;
use super::number;
use super::task::{Fact, Operator, OperatorId, Task};

/// No node.
const NONE: u32 = u32::MAX;

/// A node of the tree: the operators whose conditions are met, and the variables that decide what comes next.
#[derive(Debug, Default)]
struct Node {
    operators: std::ops::Range<u32>,
    switches: std::ops::Range<u32>,
}

/// The tree.
#[derive(Debug, Default)]
pub(super) struct Generator {
    nodes: Vec<Node>,
    operators: Vec<OperatorId>,
    /// A variable, and where the nodes for its values are.
    switches: Vec<(u32, u32)>,
    children: Vec<u32>,
    /// Which operators may not be applicable though their conditions hold; empty where none is.
    is_fallible: Vec<bool>,
}

impl Generator {
    pub(super) fn new(task: &Task) -> Self {
        Self::of(task, (0..task.operators.len() as OperatorId).collect())
    }

    /// The tree of some operators.
    pub(super) fn of(task: &Task, operators: Vec<OperatorId>) -> Self {
        let condition = |operator: OperatorId| &task.operators[operator as usize].condition;
        // The first two facts decide most comparisons, and lie side by side.
        let first = |operator: OperatorId| {
            let fact = |place: usize| condition(operator).get(place).map_or(0, |fact| u64::from(*fact) + 1);
            fact(0) << 32 | fact(1)
        };
        let mut keyed: Vec<(u64, OperatorId)> =
            operators.into_iter().map(|operator| (first(operator), operator)).collect();
        keyed.sort_unstable_by(|(one, a), (other, b)| {
            one.cmp(other).then_with(|| condition(*a).cmp(condition(*b))).then(a.cmp(b))
        });
        let order: Vec<OperatorId> = keyed.into_iter().map(|(_, operator)| operator).collect();
        let mut generator = Self::default();
        generator.node(task, &order, 0);
        generator.is_fallible = fallible(task);
        generator
    }

    /// Makes the node for operators that agree on the first facts of their conditions.
    fn node(&mut self, task: &Task, order: &[OperatorId], depth: usize) -> u32 {
        let number = self.nodes.len();
        self.nodes.push(Node::default());
        let condition = |operator: OperatorId| &task.operators[operator as usize].condition;
        let met = order.partition_point(|operator| condition(*operator).len() == depth);
        let first = self.operators.len() as u32;
        self.operators.extend_from_slice(&order[..met]);
        self.nodes[number].operators = first..self.operators.len() as u32;
        let rest = &order[met..];
        let variable = |operator: OperatorId| task.variables[condition(operator)[depth] as usize];
        let groups: Vec<&[OperatorId]> = rest.chunk_by(|a, b| variable(*a) == variable(*b)).collect();
        let first = self.switches.len();
        for group in &groups {
            let variable = variable(group[0]);
            self.switches.push((variable, self.children.len() as u32));
            self.children.extend(task.domain(variable as usize).map(|_| NONE));
        }
        self.nodes[number].switches = first as u32..self.switches.len() as u32;
        for (place, group) in groups.into_iter().enumerate() {
            let (variable, children) = self.switches[first + place];
            for same in group.chunk_by(|a, b| condition(*a)[depth] == condition(*b)[depth]) {
                let value = condition(same[0])[depth] - task.offsets[variable as usize];
                self.children[(children + value) as usize] = self.node(task, same, depth + 1);
            }
        }
        number as u32
    }

    /// Appends the operators that are applicable, in an order that depends on the task alone.
    pub(super) fn applicable(&self, task: &Task, state: &[Fact], found: &mut Vec<OperatorId>) {
        let (mut stack, start) = (vec![0], found.len());
        while let Some(number) = stack.pop() {
            let node: &Node = &self.nodes[number as usize];
            found.extend_from_slice(&self.operators[node.operators.start as usize..node.operators.end as usize]);
            for (variable, children) in &self.switches[node.switches.start as usize..node.switches.end as usize] {
                let value = state[*variable as usize] - task.offsets[*variable as usize];
                let child = self.children[(children + value) as usize];
                if child != NONE {
                    stack.push(child);
                }
            }
        }
        if !self.is_fallible.is_empty() {
            let mut place = 0;
            found.retain(|number| {
                place += 1;
                let operator = &task.operators[*number as usize];
                place <= start || !self.is_fallible[*number as usize] || computes(task, operator, state)
            });
        }
        found[start..].sort_unstable();
    }
}

/// Which operators change numbers in ways that are not possible in every state; empty where none does.
fn fallible(task: &Task) -> Vec<bool> {
    if task.numbers.count == 0 {
        return Vec::new();
    }
    let lacks = |variable: u32| number::value(task.len(), &task.init, variable).is_nan();
    let is_undefined =
        |fact: &Fact| task.numbers.undefined.iter().any(|known| task.variable(*known) == task.variable(*fact));
    let may_fail = |operator: &Operator| {
        let changes: Vec<_> =
            operator.amounts.iter().map(|effect| (effect.variable, effect.change, &effect.amount)).collect();
        number::fallible(&changes, &lacks).contains(&true)
            || !task.numbers.undefined.is_empty() && conditions(operator).any(is_undefined)
    };
    let is_fallible: Vec<bool> = task.operators.iter().map(may_fail).collect();
    if is_fallible.contains(&true) { is_fallible } else { Vec::new() }
}

/// The facts of the conditions of effects.
fn conditions(operator: &Operator) -> impl Iterator<Item = &Fact> {
    let effects = operator.effects.iter().flat_map(|effect| &effect.condition);
    effects.chain(operator.amounts.iter().flat_map(|effect| &effect.condition))
}

/// Whether what an operator changes can be computed in a state.
fn computes(task: &Task, operator: &Operator, state: &[Fact]) -> bool {
    let is_undefined = |fact: &Fact| task.numbers.undefined.binary_search(&state[task.variable(*fact)]).is_ok();
    (task.numbers.undefined.is_empty() || !conditions(operator).any(is_undefined))
        && changed(task, operator, state).is_some()
}

/// Whether an operator is applicable in a state.
pub(super) fn is_applicable(task: &Task, operator: &Operator, state: &[Fact]) -> bool {
    holds(task, state, &operator.condition) && (task.numbers.count == 0 || computes(task, operator, state))
}

/// Whether a conjunction of facts holds in a state.
pub(super) fn holds(task: &Task, state: &[Fact], facts: &[Fact]) -> bool {
    facts.iter().all(|fact| state[task.variable(*fact)] == *fact)
}

/// Changes a state by an operator that is applicable in it.
pub(super) fn apply(task: &Task, axioms: &mut Axioms, operator: &Operator, state: &mut [Fact]) {
    let numbers = if operator.amounts.is_empty() { None } else { changed(task, operator, state) };
    let is_simple = operator.effects.iter().all(|effect| effect.condition.is_empty());
    if is_simple {
        operator.effects.iter().for_each(|effect| state[task.variable(effect.fact)] = effect.fact);
    } else {
        // All conditions are looked at before anything is changed.
        let before = state.to_vec();
        for effect in operator.effects.iter().filter(|effect| holds(task, &before, &effect.condition)) {
            state[task.variable(effect.fact)] = effect.fact;
        }
    }
    set(task, state, &numbers.unwrap_or_default());
    axioms.derive(task, state);
}

/// The values that an operator leads to, of the variables that it changes; `None` where that is not possible.
fn changed(task: &Task, operator: &Operator, state: &[Fact]) -> Option<Vec<(u32, f64)>> {
    let effects = operator.amounts.iter().filter(|effect| holds(task, state, &effect.condition));
    number::changes(effects, &|variable| number::value(task.len(), state, variable))
}

/// Sets values in a state, and the facts of the comparisons that read them.
fn set(task: &Task, state: &mut [Fact], values: &[(u32, f64)]) {
    for (variable, value) in values {
        let place = task.len() + *variable as usize * 2;
        state[place..place + 2].copy_from_slice(&number::words(*value));
    }
    for number in values.iter().flat_map(|(variable, _)| &task.numbers.uses[*variable as usize]) {
        let comparison = &task.numbers.comparisons[*number as usize];
        state[task.variable(comparison.fact)] =
            comparison.truth(&|variable| number::value(task.len(), state, variable));
    }
}

#[cfg(test)]
mod tests {
    use super::super::example::{door, names, random};
    use super::*;

    #[test]
    fn the_tree_finds_exactly_the_operators_whose_conditions_hold() {
        for task in (0..200).map(random) {
            let generator = Generator::new(&task);
            let mut state = task.init.clone();
            let mut axioms = Axioms::new(&task);
            for operator in &task.operators {
                let mut found = Vec::new();
                generator.applicable(&task, &state, &mut found);
                let is_applicable = |number: &u32| holds(&task, &state, &task.operators[*number as usize].condition);
                let expected: Vec<u32> = (0..task.operators.len() as u32).filter(is_applicable).collect();
                assert_eq!(found, expected);
                apply(&task, &mut axioms, operator, &mut state);
            }
        }
    }

    #[test]
    fn in_the_store_one_can_go_back_or_take_the_key() {
        let task = door();
        let mut found = Vec::new();
        Generator::new(&task).applicable(&task, &[1, 3, 5], &mut found);
        assert_eq!(names(&task, &found), ["store-hall", "take"]);
    }

    #[test]
    fn the_conditions_of_effects_are_those_before_the_operator() {
        let mut task = super::super::example::task(&[2, 2], &[0, 0], &[], &[("swap", &[], &[(0, 1), (1, 1)])]);
        task.operators[0].effects[1].condition = vec![1];
        let mut state = task.init.clone();
        apply(&task, &mut Axioms::new(&task), &task.operators[0], &mut state);
        assert_eq!(state, [1, 2]);
    }
}
