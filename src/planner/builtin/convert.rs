//! ferroplan's reading of a task as one of the search's: names become numbers.

use std::collections::{HashMap, HashSet};

use ferroplan::types::{self as pddl, AssignOp, CompOp, Domain, Expr, Formula, MetricDir, Problem};

use super::compared;
use super::measure::COST;
use super::search::lifted::{Amount, Atom, Axiom, Condition, Effect, Lifted, NumericEffect, Object, Schema, Term};
use super::search::number::{Change, Comparator};

/// The type that all objects have.
const OBJECT: &str = "OBJECT";

/// The function whose value is zero at first.
const TOTAL_COST: &str = "TOTAL-COST";

/// Returns the task for the search, or why it is none, as with costs that depend on the state.
///
/// # Errors
///
/// The reason, in words.
pub fn convert(domain: &Domain, problem: &Problem) -> Result<Lifted, String> {
    let names = Names::new(domain, problem);
    let mut task = Lifted { types: names.types(domain, problem), ..Lifted::default() };
    task.has_costs = names.metric.is_some();
    task.is_weighted = names.metric.as_deref() == Some(COST);
    task.has_numbers = !names.compared.is_empty();
    task.objects = names.all.clone();
    task.predicates = names.predicates.clone();
    task.functions = vec![String::new(); names.functions.len()];
    names.functions.iter().for_each(|(name, number)| task.functions[*number].clone_from(name));
    for action in &domain.actions {
        task.schemas.push(names.schema(action)?);
    }
    for rule in &domain.derived {
        task.axioms.push(names.axiom(rule)?);
    }
    for (predicate, arguments) in &problem.init_atoms {
        let arguments: Option<Vec<Object>> = arguments.iter().map(|name| names.objects.get(name).copied()).collect();
        let arguments = arguments.ok_or_else(|| format!("{predicate} in the initial state has an unknown object"))?;
        // What no action, no axiom and no goal mentions does not matter.
        if let Some(predicate) = names.number(predicate, arguments.len()) {
            task.init.push((predicate, arguments));
        }
    }
    // Costs begin at zero unless the problem sets them, as the validator has it.
    if let Some(function) = names.functions.get(TOTAL_COST)
        && !problem.init_fluents.iter().any(|((name, _), _)| name == TOTAL_COST)
    {
        task.values.push(((*function, Vec::new()), 0.0));
    }
    for ((function, arguments), value) in &problem.init_fluents {
        let arguments: Option<Vec<Object>> = arguments.iter().map(|name| names.objects.get(name).copied()).collect();
        if let (Some(function), Some(arguments)) = (names.functions.get(function), arguments) {
            task.values.push(((*function, arguments), *value));
        }
    }
    let mut scope = Scope { names: &names, variables: Vec::new(), slots: Vec::new() };
    task.goal = scope.condition(&problem.goal, false)?;
    task.goal_slots = scope.slots;
    Ok(task)
}

struct Names {
    all: Vec<String>,
    objects: HashMap<String, Object>,
    kinds: HashMap<String, usize>,
    predicates: Vec<(String, usize)>,
    by_predicate: HashMap<(String, usize), usize>,
    functions: HashMap<String, usize>,
    /// The function that measures plans.
    metric: Option<String>,
    /// The functions that actions change.
    changed: HashSet<String>,
    /// The functions that conditions compare, and those that change them.
    compared: HashSet<String>,
}

impl Names {
    fn new(domain: &Domain, problem: &Problem) -> Self {
        let mut all: Vec<String> = Vec::new();
        let mut objects = HashMap::new();
        for (name, _) in domain.constants.iter().chain(&problem.objects) {
            if let std::collections::hash_map::Entry::Vacant(entry) = objects.entry(name.clone()) {
                entry.insert(all.len() as Object);
                all.push(name.clone());
            }
        }
        let mut kinds: HashMap<String, usize> = HashMap::from([(OBJECT.to_owned(), 0)]);
        let mentioned =
            domain.types.iter().chain(domain.type_parent.iter().flat_map(|(child, parent)| [child, parent]));
        let of_objects = domain.constants.iter().chain(&problem.objects).map(|(_, kind)| kind);
        for kind in mentioned.chain(of_objects) {
            let next = kinds.len();
            kinds.entry(kind.clone()).or_insert(next);
        }
        let mut names = Self {
            all,
            objects,
            kinds,
            predicates: Vec::new(),
            by_predicate: HashMap::new(),
            functions: HashMap::new(),
            metric: metric(problem),
            changed: HashSet::new(),
            compared: compared::functions(domain, problem),
        };
        names.declare(domain, problem);
        names
    }

    fn declare(&mut self, domain: &Domain, problem: &Problem) {
        for (name, kinds) in &domain.predicates {
            self.predicate(name, kinds.len());
        }
        for rule in &domain.derived {
            self.predicate(&rule.head, rule.params.len());
        }
        for (name, arguments) in &problem.init_atoms {
            self.predicate(name, arguments.len());
        }
        for name in
            domain.functions.iter().map(|(name, _)| name).chain(problem.init_fluents.iter().map(|((name, _), _)| name))
        {
            let next = self.functions.len();
            self.functions.entry(name.clone()).or_insert(next);
        }
        for action in &domain.actions {
            changed(&action.effect, &mut self.changed);
        }
    }

    fn predicate(&mut self, name: &str, arity: usize) {
        let next = self.predicates.len();
        let entry = self.by_predicate.entry((name.to_owned(), arity)).or_insert(next);
        if *entry == next {
            self.predicates.push((name.to_owned(), arity));
        }
    }

    fn number(&self, predicate: &str, arity: usize) -> Option<usize> {
        self.by_predicate.get(&(predicate.to_owned(), arity)).copied()
    }

    /// The objects of each type, with those of its subtypes.
    fn types(&self, domain: &Domain, problem: &Problem) -> Vec<Vec<Object>> {
        let parents: HashMap<&str, &str> =
            domain.type_parent.iter().map(|(child, parent)| (child.as_str(), parent.as_str())).collect();
        let mut members: Vec<Vec<Object>> = vec![Vec::new(); self.kinds.len()];
        for (name, kind) in domain.constants.iter().chain(&problem.objects) {
            let Some(object) = self.objects.get(name) else { continue };
            let (mut kind, mut seen) = (kind.as_str(), vec![0]);
            members[0].push(*object);
            // A cycle of types ends where it begins.
            while let Some(number) = self.kinds.get(kind).copied().filter(|number| !seen.contains(number)) {
                members[number].push(*object);
                seen.push(number);
                kind = parents.get(kind).copied().unwrap_or(OBJECT);
            }
        }
        for list in &mut members {
            list.sort_unstable();
            list.dedup();
        }
        members
    }

    fn schema(&self, action: &pddl::Action) -> Result<Schema, String> {
        let mut scope = Scope { names: self, variables: Vec::new(), slots: Vec::new() };
        scope.declare(&action.params)?;
        let condition = scope.condition(&action.precond, false)?;
        let mut changes = Changes::default();
        scope.effect(&action.effect, &mut Vec::new(), &mut Vec::new(), &mut changes)?;
        let cost = match self.metric {
            Some(_) => Amount::Sum(changes.cost),
            None => Amount::Number(1.0),
        };
        let (name, parameters) = (action.name.clone(), action.params.len());
        Ok(Schema {
            name,
            parameters,
            slots: scope.slots,
            condition,
            effects: changes.effects,
            numeric: changes.numeric,
            cost,
        })
    }

    fn axiom(&self, rule: &pddl::DerivedRule) -> Result<Axiom, String> {
        let mut scope = Scope { names: self, variables: Vec::new(), slots: Vec::new() };
        scope.declare(&rule.params)?;
        let predicate = self.number(&rule.head, rule.params.len()).ok_or("an axiom has no head")?;
        let head = Atom { predicate, terms: (0..rule.params.len()).map(Term::Slot).collect() };
        let condition = scope.condition(&rule.body, false)?;
        Ok(Axiom { head, slots: scope.slots, condition })
    }
}

/// The function of a metric that minimises it, where it has a value.
fn metric(problem: &Problem) -> Option<String> {
    let has_value =
        |name: &String| name == TOTAL_COST || problem.init_fluents.iter().any(|((known, _), _)| known == name);
    match &problem.metric {
        Some((MetricDir::Minimize, Expr::Fluent(name, terms))) if terms.is_empty() && has_value(name) => {
            Some(name.clone())
        }
        _ => None,
    }
}

fn changed(effect: &pddl::Effect, names: &mut HashSet<String>) {
    match effect {
        pddl::Effect::Num(_, name, ..) => drop(names.insert(name.clone())),
        pddl::Effect::And(parts) => parts.iter().for_each(|part| changed(part, names)),
        pddl::Effect::When(_, inner) | pddl::Effect::Forall(_, inner) => changed(inner, names),
        pddl::Effect::Add(..) | pddl::Effect::Del(..) => {}
    }
}

#[derive(Default)]
struct Changes {
    effects: Vec<Effect>,
    numeric: Vec<NumericEffect>,
    cost: Vec<Amount>,
}

/// The variables of a schema that are visible at a place in it.
struct Scope<'n> {
    names: &'n Names,
    variables: Vec<(String, usize)>,
    slots: Vec<usize>,
}

impl Scope<'_> {
    /// Gives each variable a slot.
    fn declare(&mut self, variables: &[(String, String)]) -> Result<Vec<usize>, String> {
        let mut slots = Vec::new();
        for (name, kind) in variables {
            let kind = self.names.kinds.get(kind).ok_or_else(|| format!("{kind} is not a type"))?;
            self.variables.push((name.clone(), self.slots.len()));
            slots.push(self.slots.len());
            self.slots.push(*kind);
        }
        Ok(slots)
    }

    fn leave(&mut self, slots: &[usize]) {
        self.variables.truncate(self.variables.len() - slots.len());
    }

    fn term(&self, term: &pddl::Term) -> Result<Term, String> {
        let found = match term {
            pddl::Term::Var(name) => {
                let variable = self.variables.iter().rev().find(|(known, _)| known == name);
                variable.map(|(_, slot)| Term::Slot(*slot)).ok_or(name)
            }
            pddl::Term::Const(name) => self.names.objects.get(name).map(|object| Term::Object(*object)).ok_or(name),
        };
        found.map_err(|name| format!("{name} is unknown"))
    }

    fn terms(&self, terms: &[pddl::Term]) -> Result<Vec<Term>, String> {
        terms.iter().map(|term| self.term(term)).collect()
    }

    fn atom(&self, predicate: &str, terms: &[pddl::Term]) -> Result<Atom, String> {
        let number =
            self.names.number(predicate, terms.len()).ok_or_else(|| format!("{predicate} is not a predicate"))?;
        Ok(Atom { predicate: number, terms: self.terms(terms)? })
    }

    /// The formula or its negation, in negation normal form.
    fn condition(&mut self, formula: &Formula, negated: bool) -> Result<Condition, String> {
        let truth = |truth: bool| if truth { Condition::True } else { Condition::False };
        Ok(match formula {
            Formula::True | Formula::Pref(..) => truth(!negated),
            Formula::False => truth(negated),
            Formula::Not(inner) => self.condition(inner, !negated)?,
            Formula::Atom(predicate, terms) => Condition::Literal(self.atom(predicate, terms)?, negated),
            Formula::Eq(left, right) => Condition::Equal(self.term(left)?, self.term(right)?, negated),
            Formula::And(parts) if !negated => Condition::all(self.conditions(parts, negated)?),
            Formula::Or(parts) if negated => Condition::all(self.conditions(parts, negated)?),
            Formula::And(parts) | Formula::Or(parts) => Condition::any(self.conditions(parts, negated)?),
            Formula::Forall(variables, inner) => self.quantified(variables, inner, negated, !negated)?,
            Formula::Exists(variables, inner) => self.quantified(variables, inner, negated, negated)?,
            Formula::Comp(operator, left, right) => {
                let comparator = match operator {
                    CompOp::Lt => Comparator::Less,
                    CompOp::Le => Comparator::AtMost,
                    CompOp::Eq => Comparator::Equal,
                    CompOp::Ge => Comparator::AtLeast,
                    CompOp::Gt => Comparator::Greater,
                };
                Condition::Compare(comparator, self.amount(left)?, self.amount(right)?, negated)
            }
        })
    }

    fn conditions(&mut self, parts: &[Formula], negated: bool) -> Result<Vec<Condition>, String> {
        parts.iter().map(|part| self.condition(part, negated)).collect()
    }

    fn quantified(
        &mut self,
        variables: &[(String, String)],
        inner: &Formula,
        negated: bool,
        for_all: bool,
    ) -> Result<Condition, String> {
        let slots = self.declare(variables)?;
        let inner = Box::new(self.condition(inner, negated)?);
        self.leave(&slots);
        Ok(if for_all { Condition::Forall(slots, inner) } else { Condition::Exists(slots, inner) })
    }

    fn effect(
        &mut self,
        effect: &pddl::Effect,
        slots: &mut Vec<usize>,
        conditions: &mut Vec<Condition>,
        changes: &mut Changes,
    ) -> Result<(), String> {
        match effect {
            pddl::Effect::Add(predicate, terms) | pddl::Effect::Del(predicate, terms) => {
                let condition = Condition::all(conditions.clone());
                let adds = matches!(effect, pddl::Effect::Add(..));
                let atom = self.atom(predicate, terms)?;
                let slots = slots.iter().copied().chain(condition.hoisted()).collect();
                changes.effects.push(Effect { slots, condition, atom, adds });
            }
            pddl::Effect::And(parts) => {
                for part in parts {
                    self.effect(part, slots, conditions, changes)?;
                }
            }
            pddl::Effect::When(formula, inner) => {
                conditions.push(self.condition(formula, false)?);
                self.effect(inner, slots, conditions, changes)?;
                conditions.pop();
            }
            pddl::Effect::Forall(variables, inner) => {
                let new = self.declare(variables)?;
                slots.extend(&new);
                self.effect(inner, slots, conditions, changes)?;
                slots.truncate(slots.len() - new.len());
                self.leave(&new);
            }
            pddl::Effect::Num(operation, function, terms, amount) => {
                let is_cost = self.names.metric.as_ref() == Some(function);
                if is_cost {
                    if !conditions.is_empty() || !slots.is_empty() {
                        return Err("costs under a condition".to_owned());
                    }
                    if *operation != AssignOp::Increase {
                        return Err("costs that do not only grow".to_owned());
                    }
                    if self.depends(amount) {
                        return Err("costs that depend on the state".to_owned());
                    }
                    changes.cost.push(self.amount(amount)?);
                }
                // Values that no condition reads matter where they cannot be computed: the search finds out which.
                match self.numeric(*operation, function, terms, amount, slots, conditions) {
                    Err(reason) if self.names.compared.contains(function) => return Err(reason),
                    Ok(effect) if !is_cost || self.names.compared.contains(function) => changes.numeric.push(effect),
                    Ok(_) | Err(_) => {}
                }
            }
        }
        Ok(())
    }

    fn numeric(
        &self,
        operation: AssignOp,
        function: &str,
        terms: &[pddl::Term],
        amount: &Expr,
        slots: &[usize],
        conditions: &[Condition],
    ) -> Result<NumericEffect, String> {
        let condition = Condition::all(conditions.to_vec());
        // What holds for several objects would count several times.
        if !condition.hoisted().is_empty() {
            return Err("a numeric effect under an existential condition".to_owned());
        }
        let change = match operation {
            AssignOp::Assign => Change::Assign,
            AssignOp::Increase => Change::Increase,
            AssignOp::Decrease => Change::Decrease,
            AssignOp::ScaleUp => Change::ScaleUp,
            AssignOp::ScaleDown => Change::ScaleDown,
        };
        let function = *self.names.functions.get(function).ok_or_else(|| format!("{function} is not a function"))?;
        let (terms, amount) = (self.terms(terms)?, self.amount(amount)?);
        Ok(NumericEffect { slots: slots.to_vec(), condition, function, terms, change, amount })
    }

    /// Whether the value of an expression changes.
    fn depends(&self, expression: &Expr) -> bool {
        let mut found = HashSet::new();
        compared::of_expression(expression, &mut found);
        found.iter().any(|name| self.names.changed.contains(name))
    }

    fn amount(&self, expression: &Expr) -> Result<Amount, String> {
        let both = |left: &Expr, right: &Expr| Ok::<_, String>((self.amount(left)?, self.amount(right)?));
        let minus = |amount: Amount| Amount::Product(Box::new(Amount::Number(-1.0)), Box::new(amount));
        Ok(match expression {
            Expr::Num(number) => Amount::Number(*number),
            Expr::Fluent(name, terms) => {
                let function = self.names.functions.get(name).ok_or_else(|| format!("{name} is not a function"))?;
                Amount::Function(*function, self.terms(terms)?)
            }
            Expr::Add(left, right) => both(left, right).map(|(left, right)| Amount::Sum(vec![left, right]))?,
            Expr::Sub(left, right) => both(left, right).map(|(left, right)| Amount::Sum(vec![left, minus(right)]))?,
            Expr::Mul(left, right) => {
                both(left, right).map(|(left, right)| Amount::Product(Box::new(left), Box::new(right)))?
            }
            Expr::Div(left, right) => {
                both(left, right).map(|(left, right)| Amount::Quotient(Box::new(left), Box::new(right)))?
            }
            Expr::Neg(inner) => minus(self.amount(inner)?),
        })
    }
}
