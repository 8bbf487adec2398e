//! The facts that could come true if nothing were ever undone.

use std::cell::Cell;
use std::collections::{HashMap, HashSet};
use std::ops::Range;

use super::rule::{Makes, Rule, changing, is_constant, is_of_another};
use crate::formats::pddl::ast::Moment;
use crate::pddl::domain::Domain;
use crate::pddl::model::{Arg, Change, Fact, Formula, Number};
use crate::pddl::problem::Problem;
use crate::pddl::validation::{Bindings, EvaluationError, Ground, State, UNBOUND};

/// What can be reached, in the order in which it was.
pub(super) struct Relaxed<'a> {
    pub(super) state: State<'a>,
    pub(super) rules: Vec<Rule<'a>>,
    /// The facts that can become true; their places are their numbers.
    facts: Vec<Ground>,
    numbers: HashMap<Ground, usize>,
    /// The numbers of a predicate's facts, ascending.
    by_predicate: HashMap<u32, Vec<usize>>,
    /// The same by predicate, position and object.
    by_argument: HashMap<(u32, usize, u32), Vec<usize>>,
    /// The facts that some action deletes.
    gone: HashSet<Ground>,
    changing: Vec<u32>,
    steps: Cell<u64>,
    limit: u64,
}

/// A rule with its objects that waits for something.
struct Instance {
    rule: usize,
    objects: Bindings,
}

impl<'a> Relaxed<'a> {
    /// Collects what can be reached, until there is nothing new or more than `limit` facts were tried.
    pub(super) fn collect(domain: &'a Domain, problem: &'a Problem, limit: u64) -> Result<Self, EvaluationError> {
        let changing = changing(domain);
        let mut relaxed = Self {
            state: State::new(domain, problem),
            rules: Rule::all(domain, problem, &changing),
            facts: Vec::new(),
            numbers: HashMap::new(),
            by_predicate: HashMap::new(),
            by_argument: HashMap::new(),
            gone: HashSet::new(),
            changing,
            steps: Cell::new(0),
            limit,
        };
        if domain.actions().iter().any(|action| action.has_locals) {
            return Err(EvaluationError::Unchecked("`:vars` are not simulated".to_owned()));
        }
        for fact in &problem.start.facts {
            relaxed.add(fact.clone());
        }
        for (_, becomes, fact) in &problem.start.timed {
            match becomes {
                true => relaxed.add(fact.clone()),
                false => drop(relaxed.gone.insert(fact.clone())),
            }
        }
        relaxed.saturate()?;
        Ok(relaxed)
    }

    /// Whether the attempt was given up.
    pub(super) fn is_cut(&self) -> bool {
        self.steps.get() > self.limit
    }

    fn saturate(&mut self) -> Result<(), EvaluationError> {
        let mut waiting: Vec<Instance> = Vec::new();
        let mut known = 0;
        for round in 0_usize.. {
            let news = known..self.facts.len();
            let gone = self.gone.len();
            known = news.end;
            for rule in 0..self.rules.len() {
                self.instances(rule, &news, round == 0, &mut waiting)?;
            }
            let mut still = Vec::new();
            for instance in waiting {
                if self.is_cut() {
                    return Ok(());
                }
                if !self.apply(&instance)? {
                    still.push(instance);
                }
            }
            waiting = still;
            if self.facts.len() == known && self.gone.len() == gone {
                break;
            }
        }
        Ok(())
    }

    /// Finds the objects for which a rule's facts hold, one of them at least among the new ones.
    fn instances(
        &self,
        rule: usize,
        news: &Range<usize>,
        is_first: bool,
        found: &mut Vec<Instance>,
    ) -> Result<(), EvaluationError> {
        let Some(Rule { facts, variables, .. }) = self.rules.get(rule) else { return Ok(()) };
        let mut emit = |objects: &Bindings| found.push(Instance { rule, objects: objects.clone() });
        if facts.is_empty() {
            return if is_first { self.fill(rule, 0, &mut vec![UNBOUND; variables.len()], &mut emit) } else { Ok(()) };
        }
        for pivot in 0..facts.len() {
            // Facts before the pivot are old, so that each choice is found once.
            let among: Vec<(&Fact, Range<usize>)> = facts
                .iter()
                .enumerate()
                .map(|(place, fact)| match place {
                    place if place < pivot => (*fact, 0..news.start),
                    place if place == pivot => (*fact, news.clone()),
                    _ => (*fact, 0..news.end),
                })
                .collect();
            self.join(rule, among, &mut vec![UNBOUND; variables.len()], &mut emit)?;
        }
        Ok(())
    }

    fn join(
        &self,
        rule: usize,
        mut facts: Vec<(&Fact, Range<usize>)>,
        objects: &mut Bindings,
        emit: &mut dyn FnMut(&Bindings),
    ) -> Result<(), EvaluationError> {
        // The fact with the fewest candidates next.
        let fewest = |(_, (fact, range)): &(usize, &(&Fact, Range<usize>))| self.candidates(fact, range, objects).len();
        let Some((place, _)) = facts.iter().enumerate().min_by_key(fewest) else {
            return self.fill(rule, 0, objects, emit);
        };
        let (fact, range) = facts.swap_remove(place);
        for number in self.candidates(fact, &range, objects) {
            if self.step() {
                return Ok(());
            }
            let Some(candidate) = self.facts.get(*number) else { continue };
            let before = objects.clone();
            if self.unify(rule, fact, candidate, objects) {
                self.join(rule, facts.clone(), objects, emit)?;
            }
            *objects = before;
        }
        Ok(())
    }

    /// Gives the variables that no fact mentions every object of their types.
    fn fill(
        &self,
        rule: usize,
        slot: usize,
        objects: &mut Bindings,
        emit: &mut dyn FnMut(&Bindings),
    ) -> Result<(), EvaluationError> {
        if self.step() {
            return Ok(());
        }
        let variable = self.rules.get(rule).and_then(|rule| rule.variables.get(slot));
        let (Some(variable), Some(value)) = (variable, objects.get(slot).copied()) else {
            emit(objects);
            return Ok(());
        };
        if value != UNBOUND {
            return self.fill(rule, slot + 1, objects, emit);
        }
        for object in self.state.members(&variable.kind).iter() {
            objects[slot] = *object;
            self.fill(rule, slot + 1, objects, emit)?;
        }
        objects[slot] = UNBOUND;
        Ok(())
    }

    /// Counts a step; true when there were too many.
    fn step(&self) -> bool {
        self.steps.set(self.steps.get() + 1);
        self.is_cut()
    }

    /// The numbers of facts that may be this one: the shortest list that its known objects give.
    fn candidates(&self, fact: &Fact, range: &Range<usize>, objects: &Bindings) -> &[usize] {
        let by_argument = fact.arguments.iter().enumerate().filter_map(|(position, argument)| {
            let object = match argument {
                Arg::Object(number) => *number,
                Arg::Slot(slot) => objects.get(*slot as usize).copied().filter(|object| *object != UNBOUND)?,
                Arg::Fluent => return None,
            };
            let known = self.by_argument.get(&(fact.predicate, position, object));
            Some(known.map_or(&[][..], Vec::as_slice))
        });
        let all = self.by_predicate.get(&fact.predicate).map_or(&[][..], Vec::as_slice);
        let list = by_argument.chain([all]).min_by_key(|list| list.len()).unwrap_or_default();
        let place = |number: usize| list.partition_point(|other| *other < number);
        list.get(place(range.start)..place(range.end)).unwrap_or_default()
    }

    fn unify(&self, rule: usize, fact: &Fact, candidate: &Ground, objects: &mut Bindings) -> bool {
        let Some(rule) = self.rules.get(rule) else { return false };
        fact.arguments.iter().zip(candidate.iter().skip(1)).all(|(argument, object)| match argument {
            Arg::Object(number) => number == object,
            Arg::Fluent => false,
            Arg::Slot(slot) => match (objects.get_mut(*slot as usize), rule.variables.get(*slot as usize)) {
                (Some(value), Some(variable)) if *value == UNBOUND => {
                    *value = *object;
                    self.state.is_member(*object, &variable.kind)
                }
                (Some(value), _) => value == object,
                (None, _) => false,
            },
        })
    }

    /// Lets a rule do what it does; false where some of that has to wait.
    fn apply(&mut self, instance: &Instance) -> Result<bool, EvaluationError> {
        self.step();
        let (mut adds, mut deletes) = (Vec::new(), Vec::new());
        let is_done = {
            let Some(rule) = self.rules.get(instance.rule) else { return Ok(true) };
            let mut objects = instance.objects.clone();
            for condition in &rule.rest {
                if !self.can_hold(condition, &mut objects)? {
                    return Ok(false);
                }
            }
            match &rule.makes {
                Makes::Derived(head) => {
                    adds.push(self.state.ground(head.predicate, &head.arguments, &objects)?);
                    true
                }
                Makes::Effect(change, moment) => self.happen(change, *moment, &mut objects, &mut adds, &mut deletes)?,
            }
        };
        adds.into_iter().for_each(|fact| self.add(fact));
        self.gone.extend(deletes);
        Ok(is_done)
    }

    fn happen(
        &self,
        change: &Change,
        moment: Option<Moment>,
        objects: &mut Bindings,
        adds: &mut Vec<Ground>,
        deletes: &mut Vec<Ground>,
    ) -> Result<bool, EvaluationError> {
        match change {
            Change::Add(fact) => adds.push(self.state.ground(fact.predicate, &fact.arguments, objects)?),
            Change::Delete(fact) => deletes.push(self.state.ground(fact.predicate, &fact.arguments, objects)?),
            Change::And(parts) => {
                let mut is_done = true;
                for part in parts {
                    is_done &= self.happen(part, moment, objects, adds, deletes)?;
                }
                return Ok(is_done);
            }
            Change::Timed(at, _) if is_of_another(*at, moment) => {}
            Change::Timed(_, inner) => return self.happen(inner, moment, objects, adds, deletes),
            Change::When(condition, inner) => {
                self.step();
                return Ok(self.can_hold(condition, objects)? && self.happen(inner, moment, objects, adds, deletes)?);
            }
            Change::Forall(quantifier, inner) => {
                let mut is_done = true;
                self.state.each(quantifier, objects, |objects| {
                    self.step();
                    is_done &= self.happen(inner, moment, objects, adds, deletes)?;
                    Ok(self.is_cut())
                })?;
                return Ok(is_done);
            }
            Change::Assign(..) | Change::AssignObject => {}
        }
        Ok(true)
    }

    fn add(&mut self, fact: Ground) {
        let number = self.facts.len();
        let Some((predicate, arguments)) = fact.split_first() else { return };
        if self.numbers.contains_key(&fact) {
            return;
        }
        self.by_predicate.entry(*predicate).or_default().push(number);
        for (position, object) in arguments.iter().enumerate() {
            self.by_argument.entry((*predicate, position, *object)).or_default().push(number);
        }
        self.numbers.insert(fact.clone(), number);
        self.facts.push(fact);
    }

    /// The reachable facts that may be this one, given the objects that are known.
    pub(super) fn matches(&self, fact: &Fact, objects: &Bindings) -> impl Iterator<Item = &Ground> {
        self.candidates(fact, &(0..self.facts.len()), objects).iter().filter_map(|number| self.facts.get(*number))
    }

    /// Whether any fact of a predicate can be reached.
    pub(super) fn is_filled(&self, predicate: u32) -> bool {
        self.by_predicate.contains_key(&predicate)
    }

    /// Whether a condition can come true.
    pub(super) fn can_hold(&self, formula: &Formula, objects: &mut Bindings) -> Result<bool, EvaluationError> {
        match formula {
            Formula::Fact(fact) if fact.arguments.contains(&Arg::Fluent) => Ok(true),
            Formula::Fact(fact) => {
                Ok(self.numbers.contains_key(&self.state.ground(fact.predicate, &fact.arguments, objects)?))
            }
            Formula::Same(Arg::Fluent, _) | Formula::Same(_, Arg::Fluent) => Ok(true),
            Formula::Same(..) => self.state.is_true(formula, objects),
            Formula::Compare(_, left, right) => self.compares(formula, [left, right], objects, true),
            Formula::Not(inner) => self.can_fail(inner, objects),
            Formula::And(parts) => all(parts, |part| self.can_hold(part, objects)),
            Formula::Or(parts) => any(parts, |part| self.can_hold(part, objects)),
            Formula::Imply(left, right) => Ok(self.can_fail(left, objects)? || self.can_hold(right, objects)?),
            Formula::Forall(quantifier, inner) => Ok(!self
                .state
                .each(quantifier, objects, |objects| Ok(self.step() || !self.can_hold(inner, objects)?))?),
            Formula::Exists(quantifier, inner) => {
                self.state.each(quantifier, objects, |objects| Ok(self.step() || self.can_hold(inner, objects)?))
            }
            Formula::Timed(_, inner) => self.can_hold(inner, objects),
            Formula::Preference(..) | Formula::Modal(..) => Ok(true),
        }
    }

    /// Whether a condition can come not to hold.
    fn can_fail(&self, formula: &Formula, objects: &mut Bindings) -> Result<bool, EvaluationError> {
        match formula {
            Formula::Fact(fact) if fact.arguments.contains(&Arg::Fluent) => Ok(true),
            Formula::Fact(fact) => {
                let ground = self.state.ground(fact.predicate, &fact.arguments, objects)?;
                let is_derived = self.state.domain.derived.contains(&fact.predicate);
                Ok(is_derived || !self.state.facts.contains(ground.as_ref()) || self.gone.contains(&ground))
            }
            Formula::Same(Arg::Fluent, _) | Formula::Same(_, Arg::Fluent) => Ok(true),
            Formula::Same(..) => Ok(!self.state.is_true(formula, objects)?),
            Formula::Compare(_, left, right) => self.compares(formula, [left, right], objects, false),
            Formula::Not(inner) => self.can_hold(inner, objects),
            Formula::And(parts) => any(parts, |part| self.can_fail(part, objects)),
            Formula::Or(parts) => all(parts, |part| self.can_fail(part, objects)),
            Formula::Imply(left, right) => Ok(self.can_hold(left, objects)? && self.can_fail(right, objects)?),
            Formula::Forall(quantifier, inner) => {
                self.state.each(quantifier, objects, |objects| Ok(self.step() || self.can_fail(inner, objects)?))
            }
            Formula::Exists(quantifier, inner) => Ok(!self
                .state
                .each(quantifier, objects, |objects| Ok(self.step() || !self.can_fail(inner, objects)?))?),
            Formula::Timed(_, inner) => self.can_fail(inner, objects),
            Formula::Preference(..) | Formula::Modal(..) => Ok(true),
        }
    }

    /// Whether a comparison can have that result. Numbers that actions change may be anything, and one
    /// without a value makes no comparison hold.
    fn compares(
        &self,
        formula: &Formula,
        numbers: [&Number; 2],
        objects: &mut Bindings,
        result: bool,
    ) -> Result<bool, EvaluationError> {
        if self.fault(numbers, objects)?.is_some() {
            return Ok(!result);
        }
        if !numbers.into_iter().all(|number| is_constant(number, &self.changing)) {
            return Ok(true);
        }
        Ok(self.state.is_true(formula, objects)? == result)
    }

    /// Why one of these numbers can never be computed.
    pub(super) fn fault(&self, numbers: [&Number; 2], objects: &Bindings) -> Result<Option<String>, EvaluationError> {
        for number in numbers {
            if is_constant(number, &self.changing) {
                match self.state.number(number, objects) {
                    Ok(_) => {}
                    Err(EvaluationError::Wrong(reason)) => return Ok(Some(reason)),
                    Err(error) => return Err(error),
                }
            }
        }
        Ok(None)
    }
}

fn all(
    parts: &[Formula],
    mut test: impl FnMut(&Formula) -> Result<bool, EvaluationError>,
) -> Result<bool, EvaluationError> {
    for part in parts {
        if !test(part)? {
            return Ok(false);
        }
    }
    Ok(true)
}

fn any(
    parts: &[Formula],
    mut test: impl FnMut(&Formula) -> Result<bool, EvaluationError>,
) -> Result<bool, EvaluationError> {
    for part in parts {
        if test(part)? {
            return Ok(true);
        }
    }
    Ok(false)
}
