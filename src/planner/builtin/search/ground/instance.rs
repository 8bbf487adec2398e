//! The ground operators: the instances of schemas, with conditions over ground atoms.

use super::super::hash::NumberMap;
use super::super::lifted::{Amount, Condition, Object, Schema, Term};
use super::formula::{Atoms, Ground, GroundAxiom, Literal};
use super::reach::Reached;
use super::refusal::Refusal;
use super::rule::{OPEN, Rule};

/// What an operator changes under a condition.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Change {
    pub(super) condition: Vec<Literal>,
    pub(super) atom: u32,
    pub(super) adds: bool,
}

/// An action with its objects.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Operator {
    pub(super) schema: usize,
    pub(super) arguments: Vec<Object>,
    pub(super) condition: Vec<Literal>,
    pub(super) changes: Vec<Change>,
    pub(super) cost: f64,
}

/// A task over ground atoms.
pub(super) struct Instances {
    pub(super) operators: Vec<Operator>,
    pub(super) axioms: Vec<GroundAxiom>,
    pub(super) goal: Vec<Literal>,
    /// Whether the goal is false whatever happens.
    pub(super) is_hopeless: bool,
    /// Which atoms are true at first.
    pub(super) init: Vec<bool>,
}

/// Instantiates all schemas, within so many bytes.
pub(super) fn instantiate(reached: &mut Reached<'_>, atoms: &mut Atoms, memory: usize) -> Result<Instances, Refusal> {
    let lifted = reached.lifted;
    let mut values: NumberMap<(usize, Vec<Object>), f64> = NumberMap::default();
    values.extend(lifted.values.iter().cloned());
    let mut operators = Vec::new();
    let mut size = 0;
    for (number, schema) in lifted.schemas.iter().enumerate() {
        let rules = effects(reached, number, schema);
        let first = operators.len();
        for id in 0..reached.relations.get(reached.instances(number)).len() as u32 {
            one(reached, atoms, number, id, &rules, &values, &mut operators);
            if size * 4 > memory {
                let (action, instances) = (schema.name.clone(), operators.len() - first);
                return Err(Refusal::Explosion { action, instances });
            }
            size += operators.last().map_or(0, weight);
        }
    }
    for (number, axiom) in lifted.axioms.iter().enumerate() {
        let number = lifted.schemas.len() + number;
        for id in 0..reached.relations.get(reached.instances(number)).len() as u32 {
            let mut binding = binding(reached, number, id, axiom.slots.len());
            let body = atoms.ground(reached, &axiom.condition, &mut binding, &axiom.slots);
            let Some(head) = atoms.number(reached, &axiom.head, &binding) else { continue };
            let bodies = atoms.split(body);
            atoms.axioms.extend(bodies.into_iter().map(|body| GroundAxiom { head, body }));
        }
    }
    let mut binding = vec![OPEN; lifted.goal_slots.len()];
    let goal = atoms.ground(reached, &lifted.goal, &mut binding, &lifted.goal_slots);
    let goals = atoms.alternatives(goal, 1);
    let mut init = vec![false; atoms.count as usize];
    for (predicate, tuple) in &lifted.init {
        let terms = tuple.iter().map(|object| Term::Object(*object)).collect();
        let atom = super::super::lifted::Atom { predicate: *predicate, terms };
        if let Some(number) = atoms.number(reached, &atom, &[]) {
            init[number as usize] = true;
        }
    }
    let is_hopeless = goals.is_empty();
    let goal = goals.into_iter().next().unwrap_or_default();
    Ok(Instances { operators, axioms: std::mem::take(&mut atoms.axioms), goal, is_hopeless, init })
}

/// About how much memory an operator takes, in words of four bytes.
fn weight(operator: &Operator) -> usize {
    30 + operator.condition.len() + operator.changes.iter().map(|change| 10 + change.condition.len()).sum::<usize>()
}

/// The rules that find the bindings of effects that have conditions or variables of their own.
fn effects(reached: &Reached<'_>, number: usize, schema: &Schema) -> Vec<Option<Rule>> {
    let rule = |effect: &super::super::lifted::Effect| {
        if effect.slots.is_empty() && effect.condition == Condition::True {
            return None;
        }
        let mut rule = reached.effect(number, &schema.slots, &effect.condition, &effect.atom);
        // What is never true cannot become false.
        if !effect.adds {
            rule.body.push(effect.atom.clone());
        }
        rule.wanted.extend(&effect.slots);
        Some(rule)
    };
    schema.effects.iter().map(rule).collect()
}

fn binding(reached: &Reached<'_>, schema: usize, id: u32, slots: usize) -> Vec<Object> {
    let mut binding = vec![OPEN; slots];
    let tuple = reached.relations.get(reached.instances(schema)).tuple(id);
    for (slot, object) in reached.columns[schema].iter().zip(tuple) {
        binding[*slot] = *object;
    }
    binding
}

/// Adds the operators of an instance: one for each of the conjunctions of its condition.
fn one(
    reached: &mut Reached<'_>,
    atoms: &mut Atoms,
    number: usize,
    id: u32,
    rules: &[Option<Rule>],
    values: &NumberMap<(usize, Vec<Object>), f64>,
    operators: &mut Vec<Operator>,
) {
    let schema = &reached.lifted.schemas[number];
    let mut bound = binding(reached, number, id, schema.slots.len());
    let condition = atoms.ground(reached, &schema.condition, &mut bound, &schema.slots);
    if condition == Ground::False {
        return;
    }
    let Some(cost) = cost(&schema.cost, &bound, values) else { return };
    let conditions = atoms.split(condition);
    let mut changes = Vec::new();
    for (effect, rule) in schema.effects.iter().zip(rules) {
        let Some(rule) = rule else {
            if let Some(atom) = atoms.number(reached, &effect.atom, &bound) {
                changes.push(Change { condition: Vec::new(), atom, adds: effect.adds });
            }
            continue;
        };
        let mut bindings: Vec<Vec<Object>> = Vec::new();
        reached.join(rule).from(0, id, &mut |binding| bindings.push(binding.to_vec()));
        for mut bound in bindings {
            let Some(atom) = atoms.number(reached, &effect.atom, &bound) else { continue };
            let condition = atoms.ground(reached, &effect.condition, &mut bound, &schema.slots);
            let conditions = atoms.split(condition);
            changes.extend(conditions.into_iter().map(|condition| Change { condition, atom, adds: effect.adds }));
        }
    }
    let arguments = bound[..schema.parameters].to_vec();
    for condition in conditions {
        let changes = effective(&condition, changes.clone());
        operators.push(Operator { schema: number, arguments: arguments.clone(), condition, changes, cost });
    }
}

fn cost(amount: &Amount, bound: &[Object], values: &NumberMap<(usize, Vec<Object>), f64>) -> Option<f64> {
    amount.value(bound, &|function, objects| values.get(&(function, objects)).copied())
}

/// The changes without what the operator's condition makes certain or impossible: an atom that is added
/// is not deleted, whatever else the effect has (PDDL adds after it deletes).
fn effective(known: &[Literal], mut changes: Vec<Change>) -> Vec<Change> {
    for change in &mut changes {
        change.condition.retain(|literal| known.binary_search(literal).is_err());
    }
    changes.retain(|change| !change.condition.iter().any(|literal| known.binary_search(&(literal ^ 1)).is_ok()));
    let added: Vec<u32> =
        changes.iter().filter(|change| change.adds && change.condition.is_empty()).map(|change| change.atom).collect();
    changes.retain(|change| {
        change.adds || !added.contains(&change.atom) && known.binary_search(&(change.atom << 1 | 1)).is_err()
    });
    // Where nothing deletes what is known to be true, adding it changes nothing.
    let deleted: Vec<u32> = changes.iter().filter(|change| !change.adds).map(|change| change.atom).collect();
    changes.retain(|change| {
        !change.adds || deleted.contains(&change.atom) || known.binary_search(&(change.atom << 1)).is_err()
    });
    changes.sort_by(|a, b| (a.adds, a.atom, &a.condition).cmp(&(b.adds, b.atom, &b.condition)));
    changes.dedup();
    changes
}
