//! Relaxed reachability: which atoms can become true, and which instances of actions can become applicable, if nothing
//! ever became false (Helmert 2009). It is the fixpoint of rules, computed tuple by tuple.
//!
//! Each schema and each axiom has a relation of its own for its instances, with its parameters and the variables of
//! the existential quantifiers that are hoisted from its condition.

use super::super::lifted::{Amount, Atom, Condition, Lifted, Object, Term};
use super::refusal::Refusal;
use super::relation::Relations;
use super::rule::{Join, Kinds, OPEN, Rule, split};

/// What the fixpoint is made of, and what became of it.
pub(super) struct Reached<'l> {
    pub(super) lifted: &'l Lifted,
    pub(super) relations: Relations,
    pub(super) kinds: Kinds,
    /// Whether actions or axioms change a predicate.
    pub(super) is_fluent: Vec<bool>,
    /// The slots of the instances of each schema, then of each axiom.
    pub(super) columns: Vec<Vec<usize>>,
}

/// Most parts of a disjunction that are looked at one by one.
const CASES: usize = 8;

/// So many more instances are worth a word.
const REPORT_INTERVAL: usize = 1 << 20;

/// Bytes that an instance and what it leads to take at least.
const INSTANCE: usize = 100;

impl<'l> Reached<'l> {
    /// Computes the fixpoint within so many bytes, and reports from time to time what has how many instances.
    pub(super) fn new(lifted: &'l Lifted, memory: usize, report: &mut dyn FnMut(&str, usize)) -> Result<Self, Refusal> {
        let columns: Vec<Vec<usize>> = lifted
            .schemas
            .iter()
            .map(|schema| columns(schema.parameters, &schema.condition))
            .chain(lifted.axioms.iter().map(|axiom| columns(axiom.head.terms.len(), &axiom.condition)))
            .collect();
        let predicates = lifted.predicates.iter().map(|(_, arity)| (*arity, false));
        let schemas = lifted.schemas.iter().map(|schema| &schema.condition);
        let conditions = schemas.chain(lifted.axioms.iter().map(|axiom| &axiom.condition));
        // Each instance is found once, from the last of the atoms that it needs, unless it may be found in several cases.
        let is_distinct = conditions.map(|condition| condition.cases(CASES).len() == 1);
        let arities = predicates.chain(columns.iter().map(Vec::len).zip(is_distinct));
        let relations = Relations::new(lifted.objects.len(), arities).ok_or(Refusal::Wide)?;
        let mut is_fluent = vec![false; lifted.predicates.len()];
        for effect in lifted.schemas.iter().flat_map(|schema| &schema.effects) {
            is_fluent[effect.atom.predicate] = true;
        }
        for axiom in &lifted.axioms {
            is_fluent[axiom.head.predicate] = true;
        }
        let kinds = Kinds::new(&lifted.types, lifted.objects.len());
        let mut reached = Self { lifted, relations, kinds, is_fluent, columns };
        let rules = reached.rules();
        if rules.iter().any(|rule| rule.slots.len() > 64) {
            return Err(Refusal::Wide);
        }
        reached.run(&rules, memory, report)?;
        Ok(reached)
    }

    /// The relation of the instances of a schema, or of an axiom after all schemas.
    pub(super) fn instances(&self, schema: usize) -> usize {
        self.lifted.predicates.len() + schema
    }

    /// The head of the rule for the instances of a schema.
    fn instance(&self, schema: usize) -> Atom {
        let terms = self.columns[schema].iter().map(|slot| Term::Slot(*slot)).collect();
        Atom { predicate: self.instances(schema), terms }
    }

    fn rules(&self) -> Vec<Rule> {
        let mut rules = Vec::new();
        let is_static = |predicate: usize| !self.is_fluent[predicate];
        let lifted = self.lifted;
        let mut instances = |number: usize, slots: &[usize], condition: &Condition| {
            // The parts of a disjunction often have what never changes, which leaves few instances.
            for case in condition.cases(CASES) {
                let (body, filters) = split(&case, &is_static);
                let wanted = self.columns[number].clone();
                rules.push(Rule { slots: slots.to_vec(), wanted, body, filters, head: self.instance(number) });
            }
        };
        for (number, schema) in lifted.schemas.iter().enumerate() {
            instances(number, &schema.slots, &schema.condition);
        }
        for (number, axiom) in lifted.axioms.iter().enumerate() {
            instances(lifted.schemas.len() + number, &axiom.slots, &axiom.condition);
        }
        for (number, schema) in lifted.schemas.iter().enumerate() {
            for effect in schema.effects.iter().filter(|effect| effect.adds) {
                rules.push(self.effect(number, &schema.slots, &effect.condition, &effect.atom));
            }
        }
        for (number, axiom) in lifted.axioms.iter().enumerate() {
            rules.push(self.effect(lifted.schemas.len() + number, &axiom.slots, &Condition::True, &axiom.head));
        }
        rules
    }

    /// The rule that an instance, under a condition, leads to an atom.
    pub(super) fn effect(&self, schema: usize, slots: &[usize], condition: &Condition, head: &Atom) -> Rule {
        let (atoms, filters) = split(condition, &|predicate| !self.is_fluent[predicate]);
        let body = std::iter::once(self.instance(schema)).chain(atoms).collect();
        let wanted = head.terms.iter().filter_map(|term| match term {
            Term::Slot(slot) => Some(*slot),
            Term::Object(_) => None,
        });
        Rule { slots: slots.to_vec(), wanted: wanted.collect(), body, filters, head: head.clone() }
    }

    fn run(&mut self, rules: &[Rule], memory: usize, report: &mut dyn FnMut(&str, usize)) -> Result<(), Refusal> {
        let mut queue: Vec<usize> = Vec::new();
        for (predicate, tuple) in &self.lifted.init {
            if self.relations.insert(*predicate, tuple).is_some() {
                queue.push(*predicate);
            }
        }
        let mut triggers: Vec<Vec<(usize, usize)>> =
            vec![Vec::new(); self.lifted.predicates.len() + self.columns.len()];
        for (number, rule) in rules.iter().enumerate() {
            for (place, atom) in rule.body.iter().enumerate().filter(|(_, atom)| self.triggers(atom)) {
                triggers[atom.predicate].push((number, place));
            }
        }
        // Facts of predicates that never change are visible before the first join.
        let (fixed, rest): (Vec<usize>, Vec<usize>) = queue.iter().partition(|predicate| !self.is_fluent[**predicate]);
        fixed.iter().for_each(|predicate| self.relations.show(*predicate));
        queue = rest;
        let mut found = Vec::new();
        for rule in rules {
            if rule.body.iter().any(|atom| self.triggers(atom)) {
                continue;
            }
            let mut join = self.join(rule);
            join.left = memory / INSTANCE;
            join.extend(0, &mut |binding| head(rule, binding, &mut found));
            if join.left == 0 {
                return Err(explosion(self.named(rule), memory / INSTANCE, report));
            }
            self.add(rule, &mut found, &mut queue);
        }
        let (mut next, mut instances, mut reported) = (0, 0, 0);
        let mut shown = vec![0_u32; triggers.len()];
        while next < queue.len() {
            let predicate = queue[next];
            next += 1;
            self.relations.show(predicate);
            let id = shown[predicate];
            shown[predicate] += 1;
            for (number, place) in &triggers[predicate] {
                let rule = &rules[*number];
                let mut join = self.join(rule);
                join.left = memory / INSTANCE;
                join.from(*place, id, &mut |binding| head(rule, binding, &mut found));
                if join.left == 0 {
                    return Err(explosion(self.named(rule), memory / INSTANCE, report));
                }
                instances += self.add(rule, &mut found, &mut queue);
            }
            if instances * INSTANCE > memory {
                let (of, instances) = self.largest();
                return Err(explosion(of, instances, report));
            }
            if instances >= reported + REPORT_INTERVAL {
                let (of, instances) = self.largest();
                report(&of, instances);
                reported = instances.max(reported + REPORT_INTERVAL);
            }
        }
        Ok(())
    }

    /// Whether a new tuple of an atom may complete a body: predicates that never change have none.
    fn triggers(&self, atom: &Atom) -> bool {
        self.is_fluent.get(atom.predicate).copied().unwrap_or(true)
    }

    pub(super) fn join<'a>(&'a mut self, rule: &'a Rule) -> Join<'a> {
        let binding = vec![OPEN; rule.slots.len()];
        Join {
            relations: &mut self.relations,
            kinds: &self.kinds,
            rule,
            start: None,
            binding,
            ids: Vec::new(),
            left: usize::MAX,
        }
    }

    fn add(&mut self, rule: &Rule, found: &mut Vec<Object>, queue: &mut Vec<usize>) -> usize {
        let (arity, relation) = (rule.head.terms.len(), rule.head.predicate);
        let mut added = 0;
        if arity == 0 {
            // One mark for each time it was found.
            let is_new = self.relations.get(relation).len() == 0;
            if is_new && !found.is_empty() && self.relations.insert(relation, &[]).is_some() {
                queue.push(relation);
                added += 1;
            }
        } else {
            for tuple in found.chunks_exact(arity) {
                if self.relations.insert(relation, tuple).is_some() {
                    queue.push(relation);
                    added += 1;
                }
            }
        }
        found.clear();
        added
    }

    /// What a rule finds, in words.
    fn named(&self, rule: &Rule) -> String {
        let predicates = self.lifted.predicates.len();
        match rule.head.predicate.checked_sub(predicates) {
            Some(number) => self.owner(number),
            // It is what an action or an axiom leads to.
            None => match rule.body.first().and_then(|atom| atom.predicate.checked_sub(predicates)) {
                Some(number) if number < self.lifted.schemas.len() => {
                    format!("`forall` in an effect of {}", self.owner(number))
                }
                Some(number) => self.owner(number),
                None => format!("the predicate {}", self.lifted.predicates[rule.head.predicate].0),
            },
        }
    }

    /// The schema, or after all of them the axiom, that has instances.
    fn owner(&self, number: usize) -> String {
        let lifted = self.lifted;
        let axiom = || lifted.axioms.get(number - lifted.schemas.len()).map(|axiom| axiom.head.predicate);
        match (lifted.schemas.get(number), number.checked_sub(lifted.schemas.len()).and_then(|_| axiom())) {
            (Some(schema), _) => format!("the action {}", schema.name),
            (None, Some(predicate)) => format!("the derived predicate {}", lifted.predicates[predicate].0),
            (None, None) => "the task".to_owned(),
        }
    }

    /// What has most instances or facts, and how many.
    fn largest(&self) -> (String, usize) {
        let predicates = self.lifted.predicates.len();
        let count = |relation: &usize| self.relations.get(*relation).len();
        let largest = (0..predicates + self.columns.len()).max_by_key(count).unwrap_or_default();
        let of = match largest.checked_sub(predicates) {
            Some(number) => self.owner(number),
            None => format!("the predicate {}", self.lifted.predicates[largest].0),
        };
        (of, count(&largest))
    }
}

/// Too many instances, which are reported for the message of another planner that runs out of memory after this.
fn explosion(of: String, instances: usize, report: &mut dyn FnMut(&str, usize)) -> Refusal {
    report(&of, instances);
    Refusal::Explosion { of, instances }
}

/// Appends the tuple of a head; of a head without terms, a mark.
fn head(rule: &Rule, binding: &[Object], found: &mut Vec<Object>) {
    if rule.head.terms.is_empty() {
        found.push(0);
    }
    found.extend(rule.head.terms.iter().map(|term| match term {
        Term::Slot(slot) => binding[*slot],
        Term::Object(object) => *object,
    }));
}

fn columns(parameters: usize, condition: &Condition) -> Vec<usize> {
    (0..parameters).chain(condition.hoisted()).collect()
}

impl Amount {
    /// Returns the amount for the objects of an instance; `None` where a function has no value.
    pub(in super::super) fn value(
        &self,
        binding: &[Object],
        values: &dyn Fn(usize, Vec<Object>) -> Option<f64>,
    ) -> Option<f64> {
        Some(match self {
            Self::Number(number) => *number,
            Self::Function(function, terms) => {
                let objects = terms.iter().map(|term| match term {
                    Term::Slot(slot) => binding[*slot],
                    Term::Object(object) => *object,
                });
                values(*function, objects.collect())?
            }
            Self::Sum(parts) => parts.iter().map(|part| part.value(binding, values)).sum::<Option<f64>>()?,
            Self::Product(left, right) => left.value(binding, values)? * right.value(binding, values)?,
            Self::Quotient(left, right) => left.value(binding, values)? / right.value(binding, values)?,
        })
    }
}
