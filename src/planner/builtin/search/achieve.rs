//! How numeric conditions become true in the relaxed task.
//!
//! What is reached is monotone, as in the relaxed planning graph of Hoffmann (2003, "The Metric-FF planning system:
//! translating 'ignoring delete lists' to numeric state variables"): what brings a value nearer to a bound counts, what
//! takes it away does not. An operator is applied as often as the difference takes: the estimate counts
//! each repetition, as that of Scala, Haslum and Thiébaux (2016, "Heuristics for numeric planning via subgoaling").
//!
//! An achiever is an operator that may bring one comparison nearer to its goal. Where how near depends on another
//! variable, there is another achiever that first lets that variable rise or fall, once.

use std::rc::Rc;

use super::number::{Change, Comparison, NumericEffect, advance, value};
use super::task::{Fact, Operator, OperatorId, Task};

/// How often an operator is taken to be applied where that is not known.
const FAR: u32 = 100;

/// The most repetitions that are told apart.
const MOST: f64 = 10_000.0;

/// Which comparison is to hold or not to hold, and what an operator does for that.
#[derive(Debug, Clone)]
struct Achiever {
    comparison: u32,
    truth: bool,
    /// The part of its way to the goal, where that is always the same.
    step: Option<f64>,
    /// Whether more than one application is of no more use.
    is_fixed: bool,
    /// That a variable rises or falls first.
    helper: Option<Fact>,
}

/// A rule of the relaxed task.
#[derive(Debug, Clone)]
pub(super) struct Rule {
    pub(super) operator: OperatorId,
    pub(super) condition: Vec<Fact>,
    pub(super) fact: Fact,
    achiever: Option<Achiever>,
    /// The effects on numbers that hold together.
    effects: Rc<[NumericEffect]>,
}

/// The effects of an operator that hold under one condition.
struct Group {
    condition: Vec<Fact>,
    effects: Rc<[NumericEffect]>,
}

fn groups(operator: &Operator) -> Vec<Group> {
    let mut conditions: Vec<&Vec<Fact>> = operator.amounts.iter().map(|effect| &effect.condition).collect();
    conditions.sort_unstable();
    conditions.dedup();
    let group = |condition: &Vec<Fact>| {
        let hold = |effect: &&NumericEffect| effect.condition.is_empty() || &effect.condition == condition;
        let effects = operator.amounts.iter().filter(hold).cloned().collect();
        let mut all = [operator.condition.as_slice(), condition].concat();
        all.sort_unstable();
        all.dedup();
        Group { condition: all, effects }
    };
    conditions.into_iter().map(group).collect()
}

/// That a variable has risen, or has fallen, in the relaxed task.
fn moved(task: &Task, variable: u32, rises: bool) -> Fact {
    (task.relaxed_facts - task.numbers.count * 2) as Fact + variable * 2 + Fact::from(!rises)
}

/// Makes the rules: for the facts that are wanted.
pub(super) fn rules(task: &Task, wanted: &[bool]) -> Vec<Rule> {
    let mut rules = Vec::new();
    let mut is_helper = vec![false; task.numbers.count];
    for (number, operator) in task.operators.iter().enumerate() {
        for group in groups(operator) {
            let mut comparisons: Vec<u32> =
                group.effects.iter().flat_map(|effect| &task.numbers.uses[effect.variable as usize]).copied().collect();
            comparisons.sort_unstable();
            comparisons.dedup();
            for comparison in comparisons {
                for truth in [true, false] {
                    let fact = task.numbers.comparisons[comparison as usize].fact + Fact::from(!truth);
                    if wanted[fact as usize] {
                        achieve(task, number as OperatorId, &group, (comparison, truth), &mut is_helper, &mut rules);
                    }
                }
            }
        }
    }
    for (number, operator) in task.operators.iter().enumerate() {
        for group in groups(operator) {
            for effect in group.effects.iter().filter(|effect| is_helper[effect.variable as usize]) {
                for rises in [true, false].into_iter().filter(|rises| may_move(effect, *rises)) {
                    let (condition, effects) = (group.condition.clone(), group.effects.clone());
                    let fact = moved(task, effect.variable, rises);
                    let operator = number as OperatorId;
                    rules.push(Rule { operator, condition, fact, achiever: None, effects });
                }
            }
        }
    }
    rules
}

fn may_move(effect: &NumericEffect, rises: bool) -> bool {
    match (effect.change, effect.amount.constant()) {
        (Change::Increase, Some(amount)) => (amount > 0.0) == rises,
        (Change::Decrease, Some(amount)) => (amount < 0.0) == rises,
        _ => true,
    }
}

/// Adds the rules by which an operator may achieve that a comparison holds or does not.
fn achieve(
    task: &Task,
    operator: OperatorId,
    group: &Group,
    (comparison, truth): (u32, bool),
    is_helper: &mut [bool],
    rules: &mut Vec<Rule>,
) {
    let compared = &task.numbers.comparisons[comparison as usize];
    let fact = compared.fact + Fact::from(!truth);
    let variables = compared.variables();
    let touching = || group.effects.iter().filter(|effect| variables.contains(&effect.variable));
    let is_step = |effect: &NumericEffect| {
        matches!(effect.change, Change::Increase | Change::Decrease) && effect.amount.constant().is_some()
    };
    let is_linear = compared.left.is_linear() && compared.right.is_linear();
    let is_equality = compared.comparator == super::number::Comparator::Equal;
    let step =
        (is_linear && !is_equality && touching().all(is_step)).then(|| step(task, compared, truth, &group.effects));
    if step.is_some_and(|step| step <= 0.0) {
        return;
    }
    let is_fixed = touching().all(|effect| effect.change == Change::Assign);
    let mut push = |helper: Option<Fact>| {
        let mut condition = group.condition.clone();
        condition.extend(helper);
        let achiever = Some(Achiever { comparison, truth, step, is_fixed, helper });
        rules.push(Rule { operator, condition, fact, achiever, effects: group.effects.clone() });
    };
    push(None);
    if step.is_some() {
        return;
    }
    // How near it brings the goal depends on what its effects read, and on the other variables where it assigns.
    let mut others: Vec<u32> = Vec::new();
    touching().for_each(|effect| effect.amount.variables(&mut others));
    if touching().any(|effect| effect.change == Change::Assign) {
        variables.iter().for_each(|variable| {
            if !others.contains(variable) {
                others.push(*variable);
            }
        });
        let is_set = |variable: &u32| {
            touching()
                .any(|effect| effect.variable == *variable && effect.change == Change::Assign && is_constant(effect))
        };
        others.retain(|variable| !is_set(variable));
    }
    for variable in others {
        is_helper[variable as usize] = true;
        push(Some(moved(task, variable, true)));
        push(Some(moved(task, variable, false)));
    }
}

fn is_constant(effect: &NumericEffect) -> bool {
    effect.amount.constant().is_some()
}

/// How much nearer effects that are always the same bring a goal.
fn step(task: &Task, compared: &Comparison, truth: bool, effects: &[NumericEffect]) -> f64 {
    let mut values = vec![0.0; task.numbers.count];
    let before = compared.gap(truth, &|variable| values[variable as usize]);
    advance(effects.iter(), &mut values);
    before - compared.gap(truth, &|variable| values[variable as usize])
}

/// The numbers of the relaxed task.
#[derive(Debug, Clone)]
pub(super) struct Repetitions {
    comparisons: Rc<[Comparison]>,
    rules: Rc<[Rule]>,
    /// The number of the first of the rules.
    first: u32,
    values: Vec<f64>,
    scratch: Vec<f64>,
}

impl Repetitions {
    pub(super) fn new(task: &Task, rules: Vec<Rule>, first: usize) -> Self {
        let values = vec![0.0; task.numbers.count];
        let comparisons = task.numbers.comparisons.clone().into();
        Self { comparisons, rules: rules.into(), first: first as u32, scratch: values.clone(), values }
    }

    /// Reads the values of a state.
    pub(super) fn start(&mut self, task_len: usize, state: &[Fact]) {
        for (variable, known) in self.values.iter_mut().enumerate() {
            *known = value(task_len, state, variable as u32);
        }
    }

    /// Whether a rule is one of these.
    pub(super) fn is_numeric(&self, rule: u32) -> bool {
        rule >= self.first && ((rule - self.first) as usize) < self.rules.len()
    }

    /// Returns how often the operator of a rule must be applied; `None` where that is of no use.
    pub(super) fn count(&mut self, rule: u32, supporters: &[u32]) -> Option<u32> {
        if !self.is_numeric(rule) {
            return Some(1);
        }
        let Rule { achiever: Some(achiever), effects, .. } = &self.rules[(rule - self.first) as usize] else {
            return Some(1);
        };
        let compared = &self.comparisons[achiever.comparison as usize];
        let truth = achiever.truth;
        if let Some(step) = achiever.step {
            let gap = compared.gap(truth, &|variable| self.values[variable as usize]);
            // Something else gives it a value first.
            if gap.is_nan() {
                return Some(FAR);
            }
            return Some(times(gap, step, compared.is_strict(truth)));
        }
        self.scratch.copy_from_slice(&self.values);
        let helper = achiever.helper.and_then(|fact| supporters.get(fact as usize)).copied();
        if let Some(rule) = helper.filter(|rule| self.is_numeric(*rule)) {
            advance(self.rules[(rule - self.first) as usize].effects.iter(), &mut self.scratch);
        }
        let before = compared.gap(truth, &|variable| self.scratch[variable as usize]);
        advance(effects.iter(), &mut self.scratch);
        let value = |variable: u32| self.scratch[variable as usize];
        match compared.holds(&value) {
            Some(holds) if holds == truth => return Some(1),
            // From no value to one, or from one to none: what follows is not known.
            Some(_) if before.is_nan() && !achiever.is_fixed => return Some(FAR),
            None => return Some(FAR),
            Some(_) => {}
        }
        let step = before - compared.gap(truth, &value);
        match (step > 0.0 && !achiever.is_fixed, achiever.helper) {
            (true, _) => Some(times(before, step, compared.is_strict(truth))),
            (false, Some(_)) => Some(FAR),
            (false, None) => None,
        }
    }
}

/// How many steps a gap takes.
fn times(gap: f64, step: f64, is_strict: bool) -> u32 {
    let steps = gap / step;
    // Both are endless.
    if steps.is_nan() {
        return FAR;
    }
    let steps = if is_strict { (steps + 1e-9).floor() + 1.0 } else { (steps - 1e-6).ceil() };
    steps.clamp(1.0, MOST) as u32
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::axiom::Axioms;
    use super::super::example::{counter, names};
    use super::super::number::{self, Comparator, Expression};
    use super::super::relaxed::{Costs, Relaxed};
    use super::super::state::Space;
    use super::super::successor::{apply, holds};
    use super::*;

    #[test]
    fn repetitions_count() {
        let task = counter();
        // Ten times one are ten steps; to load and four times three are five.
        let estimate = Relaxed::new(&task, Costs::Unit).estimate(&task.init, &task.goal);
        assert_eq!(estimate.value, Some(5));
        assert_eq!(names(&task, &estimate.preferred), ["load"]);
    }

    #[test]
    fn the_estimate_falls_with_each_step_and_is_nothing_at_the_goal() {
        let task = counter();
        let (mut state, mut axioms) = (task.init.clone(), Axioms::new(&task));
        let mut relaxed = Relaxed::new(&task, Costs::Unit);
        let mut estimates = Vec::new();
        for operator in [1, 2, 2, 2, 2] {
            apply(&task, &mut axioms, &task.operators[operator], &mut state);
            estimates.push(relaxed.estimate(&state, &task.goal).value.unwrap());
            assert_eq!(estimates.last() == Some(&0), holds(&task, &state, &task.goal));
        }
        // From nine, both another one and another three are one step.
        assert_eq!(estimates, [4, 3, 2, 1, 0]);
        assert_eq!(number::value(task.len(), &state, 0).to_bits(), 12.0_f64.to_bits());
    }

    #[test]
    fn a_change_by_another_variable_lets_that_one_rise_first() {
        let mut task = counter();
        // Instead of three, the second variable, which is zero until one is loaded.
        task.numbers.count = 2;
        task.numbers.uses.push(Vec::new());
        task.init.extend(number::words(0.0));
        task.relaxed_facts += 2;
        task.operators.remove(0);
        let amount = Expression::Number(5.0);
        task.operators[0].amounts =
            vec![NumericEffect { condition: Vec::new(), variable: 1, change: Change::Increase, amount }];
        task.operators[1].amounts[0].amount = Expression::Variable(1);
        // Load once, and add five twice.
        assert_eq!(Relaxed::new(&task, Costs::Unit).estimate(&task.init, &task.goal).value, Some(3));
    }

    #[test]
    fn what_leads_away_from_a_goal_does_not_achieve_it() {
        let mut task = counter();
        for operator in &mut task.operators {
            operator.amounts.iter_mut().for_each(|effect| effect.change = Change::Decrease);
        }
        assert_eq!(Relaxed::new(&task, Costs::Unit).estimate(&task.init, &task.goal).value, None);
    }

    #[test]
    fn numbers_are_as_near_as_the_validator_has_it() {
        assert!(Comparator::AtLeast.compare(0.3, 0.1 + 0.2) && Comparator::Equal.compare(0.1 + 0.2, 0.3));
        for (left, right) in [(0.3, 0.1 + 0.2), (1.0, 1.0), (1.0, 1.0 + 2e-6), (2.0, 1.0)] {
            let compare = |comparator: Comparator| comparator.compare(left, right);
            assert_eq!(compare(Comparator::Less), !compare(Comparator::AtLeast), "{left} {right}");
            assert_eq!(compare(Comparator::Greater), !compare(Comparator::AtMost), "{left} {right}");
            assert_eq!(compare(Comparator::Equal), compare(Comparator::AtLeast) && compare(Comparator::AtMost));
        }
    }

    #[test]
    fn steps_to_a_bound() {
        assert_eq!([times(10.0, 3.0, false), times(9.0, 3.0, false), times(9.0, 3.0, true)], [4, 3, 4]);
    }

    proptest! {
        #[test]
        fn states_with_numbers_unpack_to_what_was_packed(values in prop::collection::vec(any::<f64>(), 1..6)) {
            let mut task = counter();
            task.numbers.count = values.len();
            task.init.truncate(task.len());
            task.init.extend(values.iter().flat_map(|value| number::words(*value)));
            let mut space = Space::new(&task);
            let (id, _) = space.insert(&task.init);
            let mut state = vec![0; task.init.len()];
            space.state(id, &mut state);
            prop_assert_eq!(&state, &task.init);
        }
    }
}
