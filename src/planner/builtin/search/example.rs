//! Small tasks for tests.

use super::number::{self, Change, Comparator, Comparison, Expression, Numbers, NumericEffect};
use super::task::{Effect, Fact, Operator, Task};

/// A variable and its value.
type Value = (usize, u32);

/// A task of variables with so many values each, and operators by name, condition and effects.
pub(super) fn task(domains: &[u32], init: &[u32], goal: &[Value], operators: &[(&str, &[Value], &[Value])]) -> Task {
    let mut task = Task { offsets: vec![0], ..Task::default() };
    for (variable, size) in domains.iter().enumerate() {
        task.variables.extend((0..*size).map(|_| variable as u32));
        task.predicates.extend((0..*size).map(|_| Some(variable as u32)));
        task.offsets.push(task.variables.len() as Fact);
        task.is_derived.push(false);
    }
    task.relaxed_facts = task.facts();
    let facts = |values: &[Value]| {
        let mut facts: Vec<Fact> = values.iter().map(|(variable, value)| task.offsets[*variable] + value).collect();
        facts.sort_unstable();
        facts
    };
    task.init = init.iter().enumerate().map(|(variable, value)| task.offsets[variable] + value).collect();
    task.goal = facts(goal);
    task.operators = operators
        .iter()
        .enumerate()
        .map(|(number, (_, condition, effects))| Operator {
            name: vec![number as u32],
            condition: facts(condition),
            effects: facts(effects).into_iter().map(|fact| Effect { condition: Vec::new(), fact }).collect(),
            amounts: Vec::new(),
            cost: 1.0,
        })
        .collect();
    task.words = operators.iter().map(|(name, ..)| (*name).to_owned()).collect();
    task
}

/// A key is fetched, a door is opened with it, and one goes through.
///
/// Variables: 0 where one is (hall, store, room), 1 whether one has the key, 2 whether the door is open.
pub(super) fn door() -> Task {
    task(
        &[3, 2, 2],
        &[0, 0, 0],
        &[(0, 2)],
        &[
            ("hall-store", &[(0, 0)], &[(0, 1)]),
            ("store-hall", &[(0, 1)], &[(0, 0)]),
            ("take", &[(0, 1), (1, 0)], &[(1, 1)]),
            ("open", &[(0, 0), (1, 1), (2, 0)], &[(2, 1)]),
            ("enter", &[(0, 0), (2, 1)], &[(0, 2)]),
        ],
    )
}

/// A counter that starts at nothing and is to be at least ten: one step adds one, three more add three, and what was
/// reached can be set back.
pub(super) fn counter() -> Task {
    let mut task = task(
        &[2, 2],
        &[1, 0],
        &[(0, 0)],
        &[("one", &[], &[]), ("load", &[(1, 0)], &[(1, 1)]), ("three", &[(1, 1)], &[])],
    );
    let add = |amount: f64| NumericEffect {
        condition: Vec::new(),
        variable: 0,
        change: Change::Increase,
        amount: Expression::Number(amount),
    };
    task.operators[0].amounts = vec![add(1.0)];
    task.operators[2].amounts = vec![add(3.0)];
    let (left, right) = (Expression::Variable(0), Expression::Number(10.0));
    let comparison = Comparison { comparator: Comparator::AtLeast, left, right, fact: 0, is_partial: false };
    task.numbers = Numbers { count: 1, comparisons: vec![comparison], uses: vec![vec![0]], ..Numbers::default() };
    task.init.extend(number::words(0.0));
    task.relaxed_facts += 2;
    task
}

/// The names of operators.
pub(super) fn names(task: &Task, operators: &[u32]) -> Vec<String> {
    operators.iter().map(|operator| task.name(*operator).collect::<Vec<_>>().join(" ")).collect()
}

/// Numbers that look random and are the same in every run.
pub(super) struct Dice(u64);

impl Dice {
    pub(super) fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(2_862_933_555_777_941_757).wrapping_add(3_037_000_493))
    }

    /// A number below `sides`.
    pub(super) fn roll(&mut self, sides: u32) -> u32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) % u64::from(sides)) as u32
    }
}

/// A task with conditional effects and an axiom, of which nothing is known but that it is well-formed.
pub(super) fn random(seed: u64) -> Task {
    let mut dice = Dice::new(seed);
    let domains: Vec<u32> = (0..4 + dice.roll(3)).map(|_| 2 + dice.roll(3)).collect();
    let pick = |count: u32, dice: &mut Dice| {
        let mut values: Vec<Value> = Vec::new();
        for _ in 0..count {
            let variable = dice.roll(domains.len() as u32) as usize;
            if values.iter().all(|(known, _)| *known != variable) {
                values.push((variable, dice.roll(domains[variable])));
            }
        }
        values
    };
    let init: Vec<u32> = domains.iter().map(|size| dice.roll(*size)).collect();
    let goal = pick(3, &mut dice);
    let operators: Vec<(Vec<Value>, Vec<Value>)> =
        (0..6 + dice.roll(8)).map(|_| (pick(2, &mut dice), pick(2, &mut dice))).collect();
    let borrowed: Vec<(&str, &[Value], &[Value])> =
        operators.iter().map(|(condition, effects)| ("step", condition.as_slice(), effects.as_slice())).collect();
    let mut task = task(&domains, &init, &goal, &borrowed);
    for operator in &mut task.operators {
        operator.cost = f64::from(1 + dice.roll(5));
        let condition = pick(1, &mut dice);
        for effect in operator.effects.iter_mut().skip(1) {
            effect.condition = condition.iter().map(|(variable, value)| task.offsets[*variable] + value).collect();
        }
    }
    task
}
