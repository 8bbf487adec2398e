//! Plays a plan on the lifted task, by the meaning of PDDL and nothing else: what the tests hold the search to.

use std::collections::{HashMap, HashSet};

use super::lifted::{Amount, Atom, Condition, Lifted, Object, Term};
use super::number::Change;

/// What is true, and the values of functions.
#[derive(Default)]
struct Facts {
    true_ones: HashSet<(usize, Vec<Object>)>,
    values: HashMap<(usize, Vec<Object>), f64>,
}

impl Facts {
    /// The value of an expression; not a number where a function has none.
    fn value(&self, amount: &Amount, binding: &[Object]) -> f64 {
        let value = amount.value(binding, &|function, objects| self.values.get(&(function, objects)).copied());
        value.unwrap_or(f64::NAN)
    }
}

/// Says what is wrong with a plan, given as names and arguments.
pub(crate) fn check(task: &Lifted, plan: &[(String, Vec<String>)]) -> Result<(), String> {
    let mut facts =
        Facts { true_ones: task.init.iter().cloned().collect(), values: task.values.iter().cloned().collect() };
    derive(task, &mut facts);
    for (step, (name, arguments)) in plan.iter().enumerate() {
        let schema = task.schemas.iter().find(|schema| &schema.name == name).ok_or("no such action")?;
        let object = |name: &String| task.objects.iter().position(|known| known == name).map(|place| place as Object);
        let mut binding: Vec<Object> = arguments.iter().map(object).collect::<Option<_>>().ok_or("no such object")?;
        if binding.len() != schema.parameters {
            return Err(format!("step {step}: the number of arguments is wrong"));
        }
        if binding.iter().zip(&schema.slots).any(|(object, kind)| !task.types[*kind].contains(object)) {
            return Err(format!("step {step}: an argument has the wrong type"));
        }
        binding.resize(schema.slots.len(), Object::MAX);
        if !holds(task, &facts, &schema.condition, &mut binding, &schema.slots) {
            return Err(format!("step {step}: {name} {arguments:?} is not applicable"));
        }
        let (mut added, mut deleted) = (Vec::new(), Vec::new());
        for effect in &schema.effects {
            let mut each = |binding: &mut Vec<Object>| {
                if holds(task, &facts, &effect.condition, binding, &schema.slots) {
                    if effect.adds { &mut added } else { &mut deleted }.push(ground(&effect.atom, binding));
                }
            };
            bindings(task, &effect.slots, &schema.slots, &mut binding, &mut each);
        }
        let mut changed = Vec::new();
        for effect in &schema.numeric {
            let mut each = |binding: &mut Vec<Object>| {
                if holds(task, &facts, &effect.condition, binding, &schema.slots) {
                    let atom = Atom { predicate: effect.function, terms: effect.terms.clone() };
                    changed.push((ground(&atom, binding), effect.change, facts.value(&effect.amount, binding)));
                }
            };
            bindings(task, &effect.slots, &schema.slots, &mut binding, &mut each);
        }
        for (function, change, amount) in changed {
            let value = facts.values.entry(function).or_insert(f64::NAN);
            match change {
                Change::Assign => *value = amount,
                Change::Increase => *value += amount,
                Change::Decrease => *value -= amount,
                Change::ScaleUp => *value *= amount,
                Change::ScaleDown => *value /= amount,
            }
        }
        for fact in &deleted {
            facts.true_ones.remove(fact);
        }
        facts.true_ones.extend(added);
        derive(task, &mut facts);
    }
    let mut binding = vec![Object::MAX; task.goal_slots.len()];
    if holds(task, &facts, &task.goal, &mut binding, &task.goal_slots) {
        Ok(())
    } else {
        Err("the goal is not reached".to_owned())
    }
}

fn ground(atom: &Atom, binding: &[Object]) -> (usize, Vec<Object>) {
    let objects = atom.terms.iter().map(|term| match term {
        Term::Slot(slot) => binding[*slot],
        Term::Object(object) => *object,
    });
    (atom.predicate, objects.collect())
}

fn bindings(
    task: &Lifted,
    open: &[usize],
    slots: &[usize],
    binding: &mut Vec<Object>,
    each: &mut dyn FnMut(&mut Vec<Object>),
) {
    let Some((slot, rest)) = open.split_first() else { return each(binding) };
    for object in &task.types[slots[*slot]] {
        binding[*slot] = *object;
        bindings(task, rest, slots, binding, each);
    }
    binding[*slot] = Object::MAX;
}

fn holds(task: &Lifted, facts: &Facts, condition: &Condition, binding: &mut Vec<Object>, slots: &[usize]) -> bool {
    match condition {
        Condition::True => true,
        Condition::False => false,
        Condition::Compare(comparator, left, right, negated) => {
            comparator.compare(facts.value(left, binding), facts.value(right, binding)) != *negated
        }
        Condition::Literal(atom, negated) => facts.true_ones.contains(&ground(atom, binding)) != *negated,
        Condition::Equal(left, right, negated) => {
            let value = |term: &Term| match term {
                Term::Slot(slot) => binding[*slot],
                Term::Object(object) => *object,
            };
            (value(left) == value(right)) != *negated
        }
        Condition::And(parts) => parts.iter().all(|part| holds(task, facts, part, binding, slots)),
        Condition::Or(parts) => parts.iter().any(|part| holds(task, facts, part, binding, slots)),
        Condition::Forall(open, inner) | Condition::Exists(open, inner) => {
            // The variables of a hoisted quantifier are bound already.
            let open: Vec<usize> = open.iter().copied().filter(|slot| binding[*slot] == Object::MAX).collect();
            let (mut all, mut any) = (true, false);
            bindings(task, &open, slots, binding, &mut |binding| {
                let is_true = holds(task, facts, inner, binding, slots);
                all &= is_true;
                any |= is_true;
            });
            if matches!(condition, Condition::Forall(..)) { all } else { any }
        }
    }
}

/// The least fixpoint of the axioms, stratum by stratum: a predicate is computed after those it negates.
fn derive(task: &Lifted, facts: &mut Facts) {
    if task.axioms.is_empty() {
        return;
    }
    let derived: HashSet<usize> = task.axioms.iter().map(|axiom| axiom.head.predicate).collect();
    facts.true_ones.retain(|(predicate, _)| !derived.contains(predicate));
    let mut stratum = vec![0; task.predicates.len()];
    for _ in 0..=task.predicates.len() {
        for axiom in &task.axioms {
            let mut least = 0;
            literals(&axiom.condition, &mut |atom, negated| {
                if derived.contains(&atom.predicate) {
                    least = least.max(stratum[atom.predicate] + usize::from(negated));
                }
            });
            let head = &mut stratum[axiom.head.predicate];
            *head = least.max(*head);
        }
    }
    for level in 0..=stratum.iter().copied().max().unwrap_or(0) {
        loop {
            let mut new = Vec::new();
            for axiom in task.axioms.iter().filter(|axiom| stratum[axiom.head.predicate] == level) {
                let mut binding = vec![Object::MAX; axiom.slots.len()];
                let open: Vec<usize> = (0..axiom.head.terms.len()).collect();
                bindings(task, &open, &axiom.slots, &mut binding, &mut |binding| {
                    let fact = ground(&axiom.head, binding);
                    if !facts.true_ones.contains(&fact) && holds(task, facts, &axiom.condition, binding, &axiom.slots) {
                        new.push(fact);
                    }
                });
            }
            if new.is_empty() {
                break;
            }
            facts.true_ones.extend(new);
        }
    }
}

fn literals(condition: &Condition, each: &mut dyn FnMut(&Atom, bool)) {
    match condition {
        Condition::Literal(atom, negated) => each(atom, *negated),
        Condition::And(parts) | Condition::Or(parts) => parts.iter().for_each(|part| literals(part, each)),
        Condition::Forall(_, inner) | Condition::Exists(_, inner) => literals(inner, each),
        _ => {}
    }
}
