//! The ground operators: the instances of schemas, with conditions over ground atoms.

use super::super::lifted::{self, Condition, Object, Schema, Term};
use super::super::number::{self, Expression};
use super::formula::{Atoms, Ground, GroundAxiom, Literal};
use super::ledger::Ledger;
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

/// How an operator changes a number under a condition.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct NumericChange {
    pub(super) condition: Vec<Literal>,
    pub(super) variable: u32,
    pub(super) change: number::Change,
    pub(super) amount: Expression,
}

/// An action with its objects.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Operator {
    pub(super) schema: usize,
    pub(super) arguments: Vec<Object>,
    pub(super) condition: Vec<Literal>,
    pub(super) changes: Vec<Change>,
    pub(super) amounts: Vec<NumericChange>,
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
    /// The numeric variables and comparisons.
    pub(super) ledger: Ledger,
    /// Which numeric variables matter.
    pub(super) is_read: Vec<bool>,
}

/// Instantiates all schemas, within so many bytes.
pub(super) fn instantiate(reached: &mut Reached<'_>, atoms: &mut Atoms, memory: usize) -> Result<Instances, Refusal> {
    let lifted = reached.lifted;
    let mut operators = Vec::new();
    let mut size = 0;
    for (number, schema) in lifted.schemas.iter().enumerate() {
        let rules = (effects(reached, number, schema), numeric(reached, number, schema));
        let first = operators.len();
        for id in 0..reached.relations.get(reached.instances(number)).len() as u32 {
            one(reached, atoms, number, id, &rules, &mut operators);
            if size * 4 > memory {
                let (of, instances) = (format!("the action {}", schema.name), operators.len() - first);
                return Err(Refusal::Explosion { of, instances });
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
    let ledger = std::mem::take(&mut atoms.ledger);
    for comparison in &ledger.comparisons {
        init[comparison.atom as usize] = ledger.outcome(comparison) == Some(true);
    }
    let is_hopeless = goals.is_empty();
    let goal = goals.into_iter().next().unwrap_or_default();
    Ok(Instances {
        operators,
        axioms: std::mem::take(&mut atoms.axioms),
        goal,
        is_hopeless,
        init,
        ledger,
        is_read: Vec::new(),
    })
}

/// About how much memory an operator takes, in words of four bytes.
fn weight(operator: &Operator) -> usize {
    30 + operator.amounts.len() * 20
        + operator.condition.len()
        + operator.changes.iter().map(|change| 10 + change.condition.len()).sum::<usize>()
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

/// As [`effects`], for effects on numbers.
fn numeric(reached: &Reached<'_>, number: usize, schema: &Schema) -> Vec<Option<Rule>> {
    let rule = |effect: &lifted::NumericEffect| {
        if effect.slots.is_empty() {
            return None;
        }
        let terms = effect.slots.iter().map(|slot| Term::Slot(*slot)).collect();
        let bound = lifted::Atom { predicate: 0, terms };
        Some(reached.effect(number, &schema.slots, &effect.condition, &bound))
    };
    schema.numeric.iter().map(rule).collect()
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
    (rules, numeric_rules): &(Vec<Option<Rule>>, Vec<Option<Rule>>),
    operators: &mut Vec<Operator>,
) {
    let schema = &reached.lifted.schemas[number];
    let mut bound = binding(reached, number, id, schema.slots.len());
    let condition = atoms.ground(reached, &schema.condition, &mut bound, &schema.slots);
    if condition == Ground::False {
        return;
    }
    let Some(cost) = atoms.ledger.cost(&schema.cost, &bound) else { return };
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
    let mut amounts = Vec::new();
    for (effect, rule) in schema.numeric.iter().zip(numeric_rules) {
        let mut bindings = vec![bound.clone()];
        if let Some(rule) = rule {
            bindings.clear();
            reached.join(rule).from(0, id, &mut |binding| bindings.push(binding.to_vec()));
        }
        for mut bound in bindings {
            let condition = atoms.ground(reached, &effect.condition, &mut bound, &schema.slots);
            // An effect counts once, in whichever way its condition holds.
            let Some(condition) = atoms.alternatives(condition, 1).into_iter().next() else { continue };
            // What has no value cannot be computed, nor can the action be applied where the condition holds.
            let amount = match atoms.ledger.expression(&effect.amount, &bound) {
                Some(amount) => amount,
                None if condition.is_empty() => return,
                None => Expression::Number(f64::NAN),
            };
            let variable = atoms.ledger.variable(effect.function, &effect.terms, &bound);
            amounts.push(NumericChange { condition, variable, change: effect.change, amount });
        }
    }
    let arguments = bound[..schema.parameters].to_vec();
    for condition in conditions {
        let changes = effective(&condition, changes.clone());
        let amounts = sure(&condition, amounts.clone());
        operators.push(Operator { schema: number, arguments: arguments.clone(), condition, changes, amounts, cost });
    }
}

/// The changes of numbers without what the operator's condition makes certain or impossible.
fn sure(known: &[Literal], mut amounts: Vec<NumericChange>) -> Vec<NumericChange> {
    for amount in &mut amounts {
        amount.condition.retain(|literal| known.binary_search(literal).is_err());
    }
    amounts.retain(|amount| !amount.condition.iter().any(|literal| known.binary_search(&(literal ^ 1)).is_ok()));
    amounts
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
