//! Derived predicates: the least set of facts that the rules make of a state.
//!
//! Rules are applied stratum by stratum, so that a predicate is complete before
//! another looks at its absence. A rule's body is solved as a join: the facts
//! there are give the variables their values, and only variables that no positive
//! fact mentions run through all objects of their type.

use std::cell::Cell;
use std::collections::{HashMap, HashSet};

use super::error::EvaluationError;
use super::state::{Bindings, Ground, State, UNBOUND};
use super::stratum::{free_slots, predicates, size, strata};
use crate::pddl::model::{Arg, Fact, Formula, Rule, Variable};
use crate::pddl::types::TypeSet;

/// How many nodes a rule's body may have to be solved as a join, whose recursion is as deep.
const JOIN_LIMIT: usize = 200;

/// Facts by predicate.
pub(super) type Index = HashMap<u32, Vec<Ground>>;

/// What to do with each solution.
type Visit<'v> = dyn FnMut(&mut Bindings) -> Result<(), EvaluationError> + 'v;

impl State<'_> {
    /// Makes sure that what the rules derive is there.
    pub(super) fn derive(&self) -> Result<(), EvaluationError> {
        if self.deriving.get() || self.derived.borrow().is_some() {
            return Ok(());
        }
        self.deriving.set(true);
        self.derived.replace(Some(HashSet::new()));
        let result = self.apply_rules();
        self.deriving.set(false);
        if result.is_err() {
            self.derived.replace(None);
        }
        result
    }

    fn apply_rules(&self) -> Result<(), EvaluationError> {
        let mut index = self.index();
        for stratum in strata(&self.domain.rules, &self.domain.derived)? {
            loop {
                let mut news = HashSet::new();
                for rule in &stratum {
                    self.apply_rule(rule, &index, &mut news)?;
                }
                if news.is_empty() {
                    break;
                }
                for fact in &news {
                    index.entry(fact.first().copied().unwrap_or(UNBOUND)).or_default().push(fact.clone());
                }
                if let Some(derived) = self.derived.borrow_mut().as_mut() {
                    derived.extend(news);
                }
            }
        }
        Ok(())
    }

    /// The facts of the predicates that rules look at.
    fn index(&self) -> Index {
        let mut index = Index::new();
        for rule in &self.domain.rules {
            predicates(&rule.condition, &mut |predicate, _| {
                index.entry(predicate).or_default();
            });
        }
        for fact in &self.facts {
            if let Some(facts) = fact.first().and_then(|predicate| index.get_mut(predicate)) {
                facts.push(fact.clone());
            }
        }
        index
    }

    /// The facts of the predicates that a condition looks at, the derived ones among them.
    pub(super) fn index_of(&self, condition: &Formula) -> Result<Index, EvaluationError> {
        let mut index = Index::new();
        predicates(condition, &mut |predicate, _| {
            index.entry(predicate).or_default();
        });
        if index.keys().any(|predicate| self.domain.derived.contains(predicate)) {
            self.derive()?;
        }
        let derived = self.derived.borrow();
        for fact in self.facts.iter().chain(derived.iter().flatten()) {
            if let Some(facts) = fact.first().and_then(|predicate| index.get_mut(predicate)) {
                facts.push(fact.clone());
            }
        }
        // Of several ways to mend a plan, the same one is found every time.
        index.values_mut().for_each(|facts| facts.sort_unstable());
        Ok(index)
    }

    fn apply_rule(&self, rule: &Rule, index: &Index, news: &mut HashSet<Ground>) -> Result<(), EvaluationError> {
        let mut bindings: Bindings = vec![UNBOUND; rule.variables.len()];
        let join = Join { state: self, index, budget: None };
        let mut kinds: Vec<TypeSet> = rule.variables.iter().map(|variable| variable.kind.clone()).collect();
        let head: Vec<u32> = (0_u32..).take(rule.variables.len()).collect();
        let mut emit = |bindings: &mut Bindings| {
            let mut fact = vec![rule.predicate];
            fact.extend(bindings.iter().take(rule.variables.len()));
            let fact = fact.into_boxed_slice();
            if !self.derived.borrow().as_ref().is_some_and(|derived| derived.contains(&fact)) {
                news.insert(fact);
            }
            Ok(())
        };
        if size(&rule.condition) > JOIN_LIMIT {
            return join.enumerate(&head, &kinds.clone(), &mut bindings, &mut |bindings| {
                if self.is_true(&rule.condition, bindings)? { emit(bindings) } else { Ok(()) }
            });
        }
        let all = kinds.clone();
        join.solve(&rule.condition, &mut kinds, &mut bindings, &mut |bindings| {
            join.enumerate(&head, &all, bindings, &mut emit)
        })
    }
}

/// Solves conditions over indexed facts.
pub(super) struct Join<'j> {
    state: &'j State<'j>,
    index: &'j Index,
    /// How many facts and objects may still be tried.
    budget: Option<Cell<u64>>,
}

impl<'j> Join<'j> {
    /// A join that gives up after so many facts and objects were tried.
    pub(super) fn bounded(state: &'j State<'j>, index: &'j Index, budget: u64) -> Self {
        Self { state, index, budget: Some(Cell::new(budget)) }
    }

    /// Values of the variables under which `formula` holds, those of `slots` among them.
    pub(super) fn first(
        &self,
        formula: &Formula,
        slots: &[u32],
        mut kinds: Vec<TypeSet>,
        mut bindings: Bindings,
    ) -> Result<Option<Bindings>, EvaluationError> {
        let (mut found, all) = (None, kinds.clone());
        let ended = self.solve(formula, &mut kinds, &mut bindings, &mut |bindings| {
            self.enumerate(slots, &all, bindings, &mut |bindings| {
                found = Some(bindings.clone());
                Err(EvaluationError::Unchecked("one is enough".to_owned()))
            })
        });
        match found {
            Some(found) => Ok(Some(found)),
            None => ended.map(|()| None),
        }
    }

    fn spend(&self) -> Result<(), EvaluationError> {
        let Some(budget) = &self.budget else { return Ok(()) };
        match budget.get().checked_sub(1) {
            Some(rest) => {
                budget.set(rest);
                Ok(())
            }
            None => Err(EvaluationError::Unchecked("too much was tried".to_owned())),
        }
    }

    /// Visits values of the variables under which `formula` holds; some may stay unbound.
    fn solve(
        &self,
        formula: &Formula,
        kinds: &mut Vec<TypeSet>,
        bindings: &mut Bindings,
        visit: &mut Visit<'_>,
    ) -> Result<(), EvaluationError> {
        match formula {
            Formula::And(parts) => self.solve_all(&parts.iter().collect::<Vec<_>>(), kinds, bindings, visit),
            Formula::Or(parts) => parts.iter().try_for_each(|part| self.solve(part, kinds, bindings, visit)),
            Formula::Fact(fact) => self.solve_fact(fact, kinds, bindings, visit),
            Formula::Exists(quantifier, inner) => {
                // A variable that no condition mentions wants an object, too.
                if quantifier.variables.iter().any(|variable| self.state.members(&variable.kind).is_empty()) {
                    return Ok(());
                }
                let first = quantifier.first as usize;
                let end = first + quantifier.variables.len();
                let (outer_bindings, outer_kinds) = (bindings.clone(), kinds.clone());
                bindings.resize(end.max(bindings.len()), UNBOUND);
                bindings[first..end].fill(UNBOUND);
                kinds.truncate(first);
                kinds.extend(quantifier.variables.iter().map(|variable: &Variable| variable.kind.clone()));
                let result = self.solve(inner, kinds, bindings, visit);
                *kinds = outer_kinds;
                *bindings = outer_bindings;
                result
            }
            other => {
                let mut slots = Vec::new();
                free_slots(other, u32::try_from(kinds.len()).unwrap_or(u32::MAX), &mut slots);
                slots.retain(|slot| bindings.get(*slot as usize).is_none_or(|value| *value == UNBOUND));
                let kinds = kinds.clone();
                self.enumerate(&slots, &kinds, bindings, &mut |bindings| {
                    if self.state.is_true(other, bindings)? { visit(bindings) } else { Ok(()) }
                })
            }
        }
    }

    fn solve_all(
        &self,
        parts: &[&Formula],
        kinds: &mut Vec<TypeSet>,
        bindings: &mut Bindings,
        visit: &mut Visit<'_>,
    ) -> Result<(), EvaluationError> {
        let next = parts.iter().enumerate().min_by_key(|(_, part)| (rank(part), open(part, bindings)));
        let Some((place, first)) = next else { return visit(bindings) };
        let rest: Vec<&Formula> =
            parts.iter().enumerate().filter(|(other, _)| *other != place).map(|(_, part)| *part).collect();
        let outer = kinds.clone();
        self.solve(first, kinds, bindings, &mut |bindings| self.solve_all(&rest, &mut outer.clone(), bindings, visit))
    }

    fn solve_fact(
        &self,
        fact: &Fact,
        kinds: &[TypeSet],
        bindings: &mut Bindings,
        visit: &mut Visit<'_>,
    ) -> Result<(), EvaluationError> {
        let ground = self.state.ground(fact.predicate, &fact.arguments, bindings)?;
        if !ground.contains(&UNBOUND) {
            return if self.state.holds(&ground)? { visit(bindings) } else { Ok(()) };
        }
        let Some(known) = self.index.get(&fact.predicate) else { return Ok(()) };
        for candidate in known {
            self.spend()?;
            let outer = bindings.clone();
            if self.unify(fact, candidate, kinds, bindings) {
                visit(bindings)?;
            }
            *bindings = outer;
        }
        Ok(())
    }

    fn unify(&self, fact: &Fact, candidate: &Ground, kinds: &[TypeSet], bindings: &mut Bindings) -> bool {
        fact.arguments.iter().zip(candidate.iter().skip(1)).all(|(argument, object)| match argument {
            Arg::Object(number) => number == object,
            Arg::Fluent => false,
            Arg::Slot(slot) => match (bindings.get_mut(*slot as usize), kinds.get(*slot as usize)) {
                (Some(value), Some(kind)) if *value == UNBOUND => {
                    *value = *object;
                    self.state.is_member(*object, kind)
                }
                (Some(value), _) => value == object,
                (None, _) => false,
            },
        })
    }

    /// Visits every choice of values for those of `slots` that have none.
    fn enumerate(
        &self,
        slots: &[u32],
        kinds: &[TypeSet],
        bindings: &mut Bindings,
        visit: &mut Visit<'_>,
    ) -> Result<(), EvaluationError> {
        let open: Vec<usize> = slots
            .iter()
            .map(|slot| *slot as usize)
            .filter(|slot| bindings.get(*slot).is_some_and(|value| *value == UNBOUND))
            .collect();
        let members: Vec<_> =
            open.iter().filter_map(|slot| kinds.get(*slot)).map(|kind| self.state.members(kind)).collect();
        if members.len() != open.len() || members.iter().any(|members| members.is_empty()) {
            return Ok(());
        }
        let mut chosen = vec![0_usize; open.len()];
        'choices: loop {
            for ((slot, members), choice) in open.iter().zip(&members).zip(&chosen) {
                bindings[*slot] = members[*choice];
            }
            self.spend()?;
            visit(bindings)?;
            for (choice, members) in chosen.iter_mut().zip(&members).rev() {
                *choice += 1;
                if *choice < members.len() {
                    continue 'choices;
                }
                *choice = 0;
            }
            break;
        }
        for slot in open {
            bindings[slot] = UNBOUND;
        }
        Ok(())
    }
}

/// How many of a fact's arguments have no value yet: the fewer, the fewer facts fit.
fn open(formula: &Formula, bindings: &Bindings) -> usize {
    let Formula::Fact(fact) = formula else { return 0 };
    let is_open = |argument: &&Arg| match argument {
        Arg::Slot(slot) => bindings.get(*slot as usize).is_none_or(|value| *value == UNBOUND),
        Arg::Object(_) | Arg::Fluent => false,
    };
    fact.arguments.iter().filter(is_open).count()
}

/// What binds most comes first; what binds nothing comes last.
fn rank(formula: &Formula) -> u8 {
    match formula {
        Formula::Fact(_) => 0,
        Formula::And(_) | Formula::Exists(..) => 1,
        Formula::Or(_) => 2,
        _ => 3,
    }
}
