//! What is true, what has which value, and the objects there are.

use std::cell::{Cell, OnceCell, RefCell};
use std::collections::{HashMap, HashSet};
use std::rc::Rc;

use super::error::EvaluationError;
use super::program::Program;
use super::record::{Pending, Violations, counts_violations};
use super::stratum::{compares, predicates};
use super::trace::Happening;
use crate::formats::pddl::Seeded;
use crate::pddl::domain::Domain;
use crate::pddl::facts::Facts;
use crate::pddl::model::{Arg, Formula};
use crate::pddl::problem::Problem;
use crate::pddl::types::TypeSet;

/// A predicate or function with its arguments, by their numbers.
pub(in crate::pddl) type Ground = Box<[u32]>;

/// The slot of a variable without a value.
pub(in crate::pddl) const UNBOUND: u32 = u32::MAX;

/// How far two numbers may be apart and still be equal.
pub(super) const TOLERANCE: f64 = 1e-6;

/// Values of variables, by slot.
pub(in crate::pddl) type Bindings = Vec<u32>;

/// A state, and the task it belongs to.
pub(in crate::pddl) struct State<'a> {
    pub(in crate::pddl) domain: &'a Domain,
    pub(in crate::pddl) problem: &'a Problem,
    pub(in crate::pddl) facts: Facts<'a>,
    pub(super) values: HashMap<Ground, f64, Seeded>,
    /// What the rules derive from the facts, where a condition has asked.
    pub(super) derived: RefCell<Option<HashSet<Ground>>>,
    /// The rules as they are applied.
    pub(super) program: OnceCell<Result<Rc<Program>, EvaluationError>>,
    /// The predicates that rules look at.
    pub(super) looked_at: HashSet<u32>,
    /// Whether rules look at numbers.
    pub(super) rules_compute: bool,
    /// Whether the rules are being applied; then what they have derived so far is what holds.
    pub(super) deriving: Cell<bool>,
    members: RefCell<HashMap<TypeSet, Rc<[u32]>>>,
    /// The duration of the action looked at.
    pub(super) duration: Option<f64>,
    /// When the last thing happened.
    pub(super) time: f64,
    /// How far two numbers may be apart and still be equal.
    pub(super) tolerance: f64,
    /// What each fact owes its truth or falsehood to, where that is wanted.
    pub(super) history: Option<History>,
    /// Conditional effects of running actions that wait for their ends, by step.
    pub(super) pending: HashMap<usize, Vec<Pending>>,
    /// How often preferences were violated, where the metric counts that.
    pub(super) violations: Option<Violations>,
    /// What happened so far, where that is kept.
    pub(super) trace: Option<Vec<Happening>>,
    /// The parts of a condition that were found to be false, with the values of their variables.
    pub(super) blamed: RefCell<Vec<(Formula, Bindings)>>,
}

/// What happened to a fact last: the step, or none where it was a timed literal, and whether that made it true.
pub(super) type History = HashMap<Ground, (Option<usize>, bool)>;

impl<'a> State<'a> {
    /// The initial state. Costs begin at zero unless the problem sets them, as in every planner that counts them.
    pub(in crate::pddl) fn new(domain: &'a Domain, problem: &'a Problem) -> Self {
        let functions = &domain.vocabulary.functions;
        let mut values: HashMap<Ground, f64, Seeded> = HashMap::default();
        if let Some(cost) = functions.find("total-cost") {
            values.insert([cost].into(), 0.0);
        }
        values.extend(problem.start.values.iter().cloned());
        let mut looked_at = HashSet::new();
        for rule in &domain.rules {
            predicates(&rule.condition, &mut |predicate, _| {
                looked_at.insert(predicate);
            });
        }
        Self {
            domain,
            problem,
            looked_at,
            rules_compute: domain.rules.iter().any(|rule| compares(&rule.condition)),
            facts: Facts::new(&problem.start.facts, problem.start.table()),
            values,
            derived: RefCell::new(None),
            program: OnceCell::new(),
            deriving: Cell::new(false),
            members: RefCell::new(HashMap::new()),
            duration: None,
            time: 0.0,
            tolerance: TOLERANCE,
            history: None,
            pending: HashMap::new(),
            violations: problem.metric.as_ref().is_some_and(counts_violations).then(Violations::default),
            trace: None,
            blamed: RefCell::default(),
        }
    }

    /// Keeps the false parts of a condition, and gives them as PDDL.
    pub(super) fn blame(&self, parts: &[(&Formula, Bindings)]) -> Vec<String> {
        let kept = parts.iter().map(|(formula, bindings)| ((*formula).clone(), bindings.clone()));
        self.blamed.replace(kept.collect());
        parts.iter().map(|(formula, bindings)| self.text(formula, bindings)).collect()
    }

    /// The objects of a kind.
    pub(in crate::pddl) fn members(&self, kind: &TypeSet) -> Rc<[u32]> {
        if let Some(known) = self.members.borrow().get(kind) {
            return known.clone();
        }
        let types = &self.domain.vocabulary.types;
        let members: Rc<[u32]> = (0_u32..)
            .zip(self.problem.objects.items())
            .filter(|(_, object)| types.fits(&object.kind, kind))
            .map(|(number, _)| number)
            .collect();
        self.members.borrow_mut().insert(kind.clone(), members.clone());
        members
    }

    /// Whether an object is of a kind.
    pub(in crate::pddl) fn is_member(&self, object: u32, kind: &TypeSet) -> bool {
        let object = self.problem.objects.get(object);
        object.is_some_and(|object| self.domain.vocabulary.types.fits(&object.kind, kind))
    }

    /// A predicate or function with the values of its arguments.
    pub(in crate::pddl) fn ground(
        &self,
        head: u32,
        arguments: &[Arg],
        bindings: &Bindings,
    ) -> Result<Ground, EvaluationError> {
        let mut ground = Vec::with_capacity(arguments.len() + 1);
        ground.push(head);
        for argument in arguments {
            ground.push(value(*argument, bindings)?);
        }
        Ok(ground.into_boxed_slice())
    }

    /// Whether a ground fact holds.
    pub(super) fn holds(&self, fact: &Ground) -> Result<bool, EvaluationError> {
        let is_derived = fact.first().is_some_and(|predicate| self.domain.derived.contains(predicate));
        if !is_derived {
            return Ok(self.facts.contains(fact.as_ref()));
        }
        self.derive()?;
        Ok(self.derived.borrow().as_ref().is_some_and(|derived| derived.contains(fact)))
    }
}

/// Goes on to the next choice of one of each list, the last list first; false where there is none.
pub(super) fn choose_next(chosen: &mut [usize], members: &[Rc<[u32]>]) -> bool {
    for (choice, members) in chosen.iter_mut().zip(members).rev() {
        *choice += 1;
        if *choice < members.len() {
            return true;
        }
        *choice = 0;
    }
    false
}

/// The object an argument stands for.
pub(super) fn value(argument: Arg, bindings: &Bindings) -> Result<u32, EvaluationError> {
    match argument {
        Arg::Object(number) => Ok(number),
        Arg::Slot(slot) => Ok(bindings.get(slot as usize).copied().unwrap_or(UNBOUND)),
        Arg::Fluent => Err(EvaluationError::Unchecked("object fluents are not simulated".to_owned())),
    }
}
