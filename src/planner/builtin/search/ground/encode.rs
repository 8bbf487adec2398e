//! The ground task with finite domains: each variable is a set of atoms of which at most one is true.

use std::collections::BinaryHeap;

use super::super::hash::{self, NumberMap};
use super::super::lifted::Lifted;
use super::super::number::{self, Comparison, Expression, Numbers, NumericEffect};
use super::super::task::{Axiom, Effect, Fact, Operator, Task};
use super::formula::{Atoms, Literal};
use super::instance::{Change, Instances, NumericChange};
use super::reach::Reached;

/// No fact.
const NONE: Fact = Fact::MAX;

struct Encoder<'a> {
    instances: &'a Instances,
    task: Task,
    /// The facts of each atom and of its negation.
    facts: Vec<[Fact; 2]>,
    /// A second variable of an atom, whose facts are "true" and "false".
    extra: Vec<[Fact; 2]>,
    /// The numeric variables by their numbers in the ledger, and their values at first.
    renamed: Vec<u32>,
    values: Vec<f64>,
}

/// Makes the task.
pub(super) fn encode(
    reached: &Reached<'_>,
    atoms: &Atoms,
    instances: &Instances,
    is_relevant: &[bool],
    groups: Vec<Vec<u32>>,
) -> Task {
    let count = instances.init.len();
    let Lifted { has_costs, is_weighted, .. } = *reached.lifted;
    let task = Task { has_costs, is_weighted, words: words(reached.lifted), ..Task::default() };
    let facts = vec![[NONE; 2]; count];
    let mut encoder = Encoder { instances, task, extra: facts.clone(), facts, renamed: Vec::new(), values: Vec::new() };
    let predicate = |atom: u32| atoms.tuple(reached, atom).map(|(predicate, _)| predicate as u32);
    let mut is_open: Vec<bool> = is_relevant.to_vec();
    instances.axioms.iter().for_each(|axiom| is_open[axiom.head as usize] = false);
    instances.ledger.comparisons.iter().for_each(|compared| is_open[compared.atom as usize] = false);
    let needs_none = encoder.deleters();
    for group in cover(&groups, &mut is_open) {
        encoder.group(&group, &needs_none, &predicate);
    }
    for atom in (0..count as u32).filter(|atom| is_open[*atom as usize]) {
        encoder.binary(atom, &predicate);
    }
    encoder.numbers(is_relevant, reached.lifted);
    encoder.negations(is_relevant);
    encoder.derived(&predicate, is_relevant);
    encoder.finish(reached, &groups)
}

/// The names of the schemas, then of the objects.
fn words(lifted: &Lifted) -> Vec<String> {
    lifted.schemas.iter().map(|schema| schema.name.clone()).chain(lifted.objects.iter().cloned()).collect()
}

/// Chooses groups, always the one with the most atoms that no other has; returns those atoms.
fn cover(groups: &[Vec<u32>], is_open: &mut [bool]) -> Vec<Vec<u32>> {
    let open = |group: &[u32], is_open: &[bool]| -> Vec<u32> {
        group.iter().copied().filter(|atom| is_open[*atom as usize]).collect()
    };
    let mut heap: BinaryHeap<(usize, std::cmp::Reverse<usize>)> =
        groups.iter().enumerate().map(|(number, group)| (group.len(), std::cmp::Reverse(number))).collect();
    let mut chosen = Vec::new();
    while let Some((size, number)) = heap.pop() {
        let left = open(&groups[number.0], is_open);
        if left.len() < 2 {
            continue;
        }
        if left.len() < size {
            heap.push((left.len(), number));
            continue;
        }
        left.iter().for_each(|atom| is_open[*atom as usize] = false);
        chosen.push(left);
    }
    chosen
}

impl Encoder<'_> {
    /// The operators that may delete an atom, and the place of the change.
    fn deleters(&self) -> Vec<Vec<(u32, u32)>> {
        let mut deleters = vec![Vec::new(); self.facts.len()];
        for (number, operator) in self.instances.operators.iter().enumerate() {
            for (place, change) in operator.changes.iter().enumerate().filter(|(_, change)| !change.adds) {
                deleters[change.atom as usize].push((number as u32, place as u32));
            }
        }
        deleters
    }

    fn variable(&mut self, predicates: Vec<Option<u32>>, init: usize, is_derived: bool) -> Fact {
        let first = self.task.variables.len() as Fact;
        let number = self.task.is_derived.len() as u32;
        self.task.offsets.push(first);
        self.task.variables.extend(predicates.iter().map(|_| number));
        self.task.predicates.extend(predicates);
        self.task.init.push(first + init as Fact);
        self.task.is_derived.push(is_derived);
        first
    }

    /// A variable for atoms of which at most one is true.
    fn group(&mut self, group: &[u32], deleters: &[Vec<(u32, u32)>], predicate: &dyn Fn(u32) -> Option<u32>) {
        let mut number = NumberMap::default();
        number.extend(group.iter().enumerate().map(|(place, atom)| (*atom, place)));
        let is_emptied = |(operator, place): &(u32, u32)| {
            let operator = &self.instances.operators[*operator as usize];
            let delete = &operator.changes[*place as usize];
            let replaces = |change: &Change| {
                let is_sure = change.condition.iter().all(|literal| delete.condition.binary_search(literal).is_ok());
                change.adds && number.contains_key(&change.atom) && is_sure
            };
            !operator.changes.iter().any(replaces)
        };
        let init = group.iter().position(|atom| self.instances.init[*atom as usize]);
        let has_none = init.is_none() || group.iter().any(|atom| deleters[*atom as usize].iter().any(is_emptied));
        let mut predicates: Vec<_> = group.iter().map(|atom| predicate(*atom)).collect();
        predicates.extend(has_none.then_some(None));
        let first = self.variable(predicates, init.unwrap_or(group.len()), false);
        for (place, atom) in group.iter().enumerate() {
            self.facts[*atom as usize][0] = first + place as Fact;
        }
        if let ([one, other], false) = (group, has_none) {
            self.facts[*one as usize][1] = first + 1;
            self.facts[*other as usize][1] = first;
        }
    }

    fn binary(&mut self, atom: u32, predicate: &dyn Fn(u32) -> Option<u32>) {
        let init = usize::from(!self.instances.init[atom as usize]);
        let first = self.variable(vec![predicate(atom), None], init, false);
        self.facts[atom as usize] = [first, first + 1];
    }

    /// A variable for each comparison, and the numeric variables, which are numbered anew.
    fn numbers(&mut self, is_relevant: &[bool], lifted: &Lifted) {
        let instances = self.instances;
        let ledger = &instances.ledger;
        let kept = (0..ledger.init.len() as u32).filter(|variable| instances.is_read[*variable as usize]);
        let mut renamed = vec![u32::MAX; ledger.init.len()];
        let (keys, mut names) = (ledger.keys(), Vec::new());
        for variable in kept {
            renamed[variable as usize] = self.values.len() as u32;
            self.values.push(ledger.init[variable as usize]);
            let (function, objects) = &keys[variable as usize];
            let objects = objects.iter().map(|object| lifted.objects[*object as usize].as_str());
            let words: Vec<&str> = std::iter::once(lifted.functions[*function].as_str()).chain(objects).collect();
            names.push(format!("({})", words.join(" ")));
        }
        self.renamed = renamed;
        let mut numbers = Numbers {
            count: self.values.len(),
            uses: vec![Vec::new(); self.values.len()],
            names,
            ..Numbers::default()
        };
        for compared in ledger.comparisons.iter().filter(|compared| is_relevant[compared.atom as usize]) {
            let lacks = |variable: u32| ledger.lacks(variable);
            let is_partial = compared.left.may_lack(&lacks) || compared.right.may_lack(&lacks);
            let init = ledger.outcome(compared).map_or(if is_partial { 2 } else { 1 }, |holds| usize::from(!holds));
            let fact = self.variable(vec![None; if is_partial { 3 } else { 2 }], init, false);
            self.facts[compared.atom as usize] = [fact, fact + 1];
            if is_partial {
                numbers.undefined.push(fact + 2);
            }
            let (left, right) = (self.renamed(&compared.left), self.renamed(&compared.right));
            let comparison = Comparison { comparator: compared.comparator, left, right, fact, is_partial };
            for variable in comparison.variables() {
                numbers.uses[variable as usize].push(numbers.comparisons.len() as u32);
            }
            numbers.comparisons.push(comparison);
        }
        self.task.numbers = numbers;
    }

    fn renamed(&self, expression: &Expression) -> Expression {
        let both =
            |left: &Expression, right: &Expression| (Box::new(self.renamed(left)), Box::new(self.renamed(right)));
        match expression {
            Expression::Number(number) => Expression::Number(*number),
            Expression::Variable(variable) => Expression::Variable(self.renamed[*variable as usize]),
            Expression::Sum(parts) => Expression::Sum(parts.iter().map(|part| self.renamed(part)).collect()),
            Expression::Product(left, right) => {
                let (left, right) = both(left, right);
                Expression::Product(left, right)
            }
            Expression::Quotient(left, right) => {
                let (left, right) = both(left, right);
                Expression::Quotient(left, right)
            }
        }
    }

    /// The changes of numbers by an operator whose condition is known.
    fn amounts(&self, known: &[Fact], amounts: &[NumericChange]) -> Vec<NumericEffect> {
        let effects = amounts.iter().filter_map(|amount| {
            let condition = self.conjunction(amount.condition.iter())?;
            let mut when = Effect { condition, fact: NONE };
            self.tidy(known, &mut when).then(|| NumericEffect {
                condition: when.condition,
                variable: self.renamed[amount.variable as usize],
                change: amount.change,
                amount: self.renamed(&amount.amount),
            })
        });
        effects.collect()
    }

    /// Second variables for the atoms of larger groups whose negations occur.
    fn negations(&mut self, is_relevant: &[bool]) {
        let instances = self.instances;
        let mut is_negated = vec![false; self.facts.len()];
        let of_operators = instances.operators.iter().flat_map(|operator| {
            operator.condition.iter().chain(operator.changes.iter().flat_map(|change| &change.condition))
        });
        let of_axioms = instances.axioms.iter().flat_map(|axiom| &axiom.body);
        for literal in of_operators.chain(of_axioms).chain(&instances.goal).filter(|literal| *literal & 1 == 1) {
            is_negated[(literal >> 1) as usize] = true;
        }
        for atom in 0..self.facts.len() {
            let [fact, negation] = self.facts[atom];
            if is_relevant[atom] && is_negated[atom] && fact != NONE && negation == NONE {
                let init = usize::from(!instances.init[atom]);
                let first = self.variable(vec![None, None], init, false);
                self.facts[atom][1] = first + 1;
                self.extra[atom] = [first, first + 1];
            }
        }
    }

    fn derived(&mut self, predicate: &dyn Fn(u32) -> Option<u32>, is_relevant: &[bool]) {
        let instances = self.instances;
        for axiom in &instances.axioms {
            let atom = axiom.head as usize;
            if is_relevant[atom] && self.facts[atom][0] == NONE {
                let first = self.variable(vec![None, predicate(axiom.head)], 0, true);
                self.facts[atom] = [first + 1, first];
            }
        }
    }

    /// The facts of literals, in order; `None` where two exclude each other. A literal whose atom has no variable is
    /// false where it is positive.
    fn conjunction<'l>(&self, literals: impl Iterator<Item = &'l Literal>) -> Option<Vec<Fact>> {
        let mut facts = Vec::new();
        for literal in literals {
            match self.facts[(literal >> 1) as usize][(literal & 1) as usize] {
                NONE if literal & 1 == 0 => return None,
                NONE => {}
                fact => facts.push(fact),
            }
        }
        facts.sort_unstable();
        facts.dedup();
        let clash = facts.windows(2).any(|pair| self.task.variable(pair[0]) == self.task.variable(pair[1]));
        (!clash).then_some(facts)
    }

    /// The effects of an operator whose condition is known.
    fn effects(&self, known: &[Fact], changes: &[Change]) -> Vec<Effect> {
        let mut effects: Vec<Effect> = Vec::new();
        let certain: Vec<usize> = changes
            .iter()
            .filter(|change| change.adds && change.condition.is_empty())
            .map(|change| self.task.variable(self.facts[change.atom as usize][0]))
            .collect();
        for change in changes.iter().filter(|change| !change.adds) {
            let Some(condition) = self.conjunction(change.condition.iter()) else { continue };
            let [_, gone] = self.extra[change.atom as usize];
            if gone != NONE {
                effects.push(Effect { condition: condition.clone(), fact: gone });
            }
            let fact = self.facts[change.atom as usize][0];
            let variable = self.task.variable(fact);
            if certain.contains(&variable) {
                continue;
            }
            let domain = self.task.domain_so_far(variable);
            let last = domain.end - 1;
            // Without a value for "none", another effect replaces the atom.
            if self.task.predicates[last as usize].is_some() {
                continue;
            }
            let mut condition = condition;
            if domain.len() > 2 {
                condition.push(fact);
            }
            effects.push(Effect { condition, fact: last });
        }
        for change in changes.iter().filter(|change| change.adds) {
            let Some(condition) = self.conjunction(change.condition.iter()) else { continue };
            let [there, _] = self.extra[change.atom as usize];
            if there != NONE {
                effects.push(Effect { condition: condition.clone(), fact: there });
            }
            effects.push(Effect { condition, fact: self.facts[change.atom as usize][0] });
        }
        effects.retain_mut(|effect| self.tidy(known, effect));
        effects.dedup();
        effects
    }

    /// Drops what the operator's condition makes certain; `false` where it makes the effect impossible.
    fn tidy(&self, known: &[Fact], effect: &mut Effect) -> bool {
        effect.condition.sort_unstable();
        effect.condition.dedup();
        let excluded = effect.condition.iter().any(|fact| {
            known.iter().any(|other| other != fact && self.task.variable(*other) == self.task.variable(*fact))
        });
        let clash = effect.condition.windows(2).any(|pair| self.task.variable(pair[0]) == self.task.variable(pair[1]));
        effect.condition.retain(|fact| known.binary_search(fact).is_err());
        !excluded && !clash
    }

    fn finish(mut self, reached: &Reached<'_>, groups: &[Vec<u32>]) -> Task {
        self.task.offsets.push(self.task.variables.len() as Fact);
        self.task.init.extend(self.values.iter().flat_map(|value| number::words(*value)));
        let instances = self.instances;
        self.task.goal = match self.conjunction(instances.goal.iter()) {
            Some(goal) => goal,
            None => vec![0, NONE],
        };
        let schemas = reached.lifted.schemas.len() as u32;
        let mut known: NumberMap<u64, usize> = NumberMap::default();
        let mut operators: Vec<Operator> = Vec::new();
        for operator in &instances.operators {
            let Some(condition) = self.conjunction(operator.condition.iter()) else { continue };
            let effects = self.effects(&condition, &operator.changes);
            let amounts = self.amounts(&condition, &operator.amounts);
            if effects.is_empty() && amounts.is_empty() {
                continue;
            }
            let name =
                std::iter::once(operator.schema as u32).chain(operator.arguments.iter().map(|object| schemas + object));
            let new = Operator { name: name.collect(), condition, effects, amounts, cost: operator.cost };
            let next = operators.len();
            let same = match reached.lifted.keeps_equals {
                true => next,
                false => *known.entry(digest(&new)).or_insert(next),
            };
            match operators.get_mut(same) {
                Some(other)
                    if other.condition == new.condition
                        && other.effects == new.effects
                        && other.amounts == new.amounts =>
                {
                    // Of operators that do the same, the cheapest.
                    if new.cost < other.cost {
                        *other = new;
                    }
                }
                _ => operators.push(new),
            }
        }
        self.task.operators = operators;
        for axiom in &instances.axioms {
            let fact = self.facts[axiom.head as usize][0];
            if let (Some(condition), true) = (self.conjunction(axiom.body.iter()), fact != NONE) {
                self.task.axioms.push(Axiom { condition, fact, layer: 0 });
            }
        }
        let facts = groups.iter().map(|group| {
            group.iter().map(|atom| self.facts[*atom as usize][0]).filter(|fact| *fact != NONE).collect::<Vec<_>>()
        });
        let mutexes: Vec<Vec<Fact>> = facts.filter(|facts| facts.len() > 1).collect();
        let is_new =
            |facts: &Vec<Fact>| facts.iter().any(|fact| self.task.variable(*fact) != self.task.variable(facts[0]));
        let mutexes = mutexes.into_iter().filter(is_new).collect();
        self.task.mutexes = mutexes;
        self.task.relaxed_facts = self.task.facts();
        self.task
    }
}

impl Task {
    /// The facts of a variable, also of the last one of a task that is being made.
    fn domain_so_far(&self, variable: usize) -> std::ops::Range<Fact> {
        let end = self.offsets.get(variable + 1).copied().unwrap_or(self.variables.len() as Fact);
        self.offsets[variable]..end
    }
}

/// A number that is the same for operators that do the same.
fn digest(operator: &Operator) -> u64 {
    let effects = operator.effects.iter().flat_map(|effect| effect.condition.iter().chain([&effect.fact]));
    let numbers = operator.condition.iter().chain([&NONE]).chain(effects).map(|fact| u64::from(*fact));
    numbers.fold(0, |sum, number| hash::words(&[sum, number]))
}
