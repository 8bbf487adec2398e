//! Derived predicates: the least set of facts that the rules make of a state.
//!
//! Rules are applied stratum by stratum, so that a predicate is complete before one that is not needed for it looks at it.
//! Within a stratum, a rule is applied again only to facts that the last round has found, joined with all others (the
//! semi-naive evaluation of Bancilhon, 1986).

use std::collections::{HashMap, HashSet};
use std::rc::Rc;

use super::error::EvaluationError;
use super::index::Index;
use super::join::{Join, News};
use super::program::{Body, Prepared, prepare};
use super::state::{Bindings, Ground, State, UNBOUND};
use super::stratum::predicates;
use crate::pddl::model::Formula;
use crate::pddl::types::TypeSet;

/// The most facts that a rule may derive at once: what a state has to hold in memory.
const MOST_FACTS: usize = 4_000_000;

/// The most facts and objects that are tried for a rule, which takes seconds.
const MOST_TRIED: u64 = 1_000_000_000;

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
        let program = self.program.get_or_init(|| prepare(self.domain).map(Rc::new)).clone()?;
        let mut index = self.index();
        for stratum in program.iter() {
            let mut news = HashSet::new();
            for rule in stratum {
                self.apply_rule(rule, &index, None, &mut news)?;
            }
            while !news.is_empty() {
                let older = self.keep(std::mem::take(&mut news), &mut index);
                for rule in stratum {
                    if rule.tested.iter().any(|predicate| older.contains_key(predicate)) {
                        self.apply_rule(rule, &index, None, &mut news)?;
                        continue;
                    }
                    for (pivot, _) in rule.pivots.iter().filter(|(_, predicate)| older.contains_key(predicate)) {
                        let pivot = News { pivot: *pivot, older: &older };
                        self.apply_rule(rule, &index, Some(pivot), &mut news)?;
                    }
                }
            }
        }
        Ok(())
    }

    /// Adds facts to those that are derived, and says how many there were before, for each predicate that has new ones.
    fn keep(&self, news: HashSet<Ground>, index: &mut Index) -> HashMap<u32, usize> {
        let mut older = HashMap::new();
        for fact in &news {
            let predicate = fact.first().copied().unwrap_or(UNBOUND);
            older.entry(predicate).or_insert_with(|| index.count(predicate));
            index.add(fact);
        }
        if let Some(derived) = self.derived.borrow_mut().as_mut() {
            derived.extend(news);
        }
        older
    }

    /// The facts of the predicates that rules look at.
    fn index(&self) -> Index {
        let mut index = Index::default();
        self.looked_at.iter().for_each(|predicate| index.watch(*predicate));
        self.facts.iter().for_each(|fact| index.add(fact));
        index
    }

    /// The facts of the predicates that a condition looks at, the derived ones among them.
    pub(super) fn index_of(&self, condition: &Formula) -> Result<Index, EvaluationError> {
        let mut index = Index::default();
        predicates(condition, &mut |predicate, _| index.watch(predicate));
        if index.predicates().any(|predicate| self.domain.derived.contains(&predicate)) {
            self.derive()?;
        }
        let derived = self.derived.borrow();
        self.facts.iter().for_each(|fact| index.add(fact));
        derived.iter().flatten().for_each(|fact| index.add(fact));
        // Of several ways to mend a plan, the same one is found every time.
        index.sort();
        Ok(index)
    }

    fn apply_rule(
        &self,
        rule: &Prepared,
        index: &Index,
        pivot: Option<News<'_>>,
        news: &mut HashSet<Ground>,
    ) -> Result<(), EvaluationError> {
        let kinds: Vec<&TypeSet> = rule.kinds.iter().collect();
        let mut bindings: Bindings = vec![UNBOUND; kinds.len()];
        let head: Vec<u32> = (0_u32..).take(kinds.len()).collect();
        let join = Join::new(self, index, pivot, MOST_TRIED);
        let mut fact = Vec::with_capacity(kinds.len() + 1);
        let mut emit = |bindings: &mut Bindings| {
            fact.clear();
            fact.push(rule.predicate);
            fact.extend(bindings.iter().take(kinds.len()));
            let is_known = |facts: &HashSet<Ground>| facts.contains(fact.as_slice());
            if !self.derived.borrow().as_ref().is_some_and(is_known) && !is_known(news) {
                if news.len() >= MOST_FACTS {
                    return Err(self.too_many(rule.predicate, "facts", MOST_FACTS));
                }
                news.insert(fact.clone().into_boxed_slice());
            }
            Ok(false)
        };
        let ended = match &rule.body {
            Body::Join(goal) => join
                .solve(goal, &kinds, &mut bindings, &mut |bindings| join.enumerate(&head, &kinds, bindings, &mut emit)),
            Body::Test(condition) => join.enumerate(&head, &kinds, &mut bindings, &mut |bindings| {
                if self.is_true(condition, bindings)? { emit(bindings) } else { Ok(false) }
            }),
        };
        match join.is_spent() {
            true => Err(self.too_many(rule.predicate, "objects to be tried", MOST_TRIED)),
            false => ended.map(drop),
        }
    }

    fn too_many(&self, predicate: u32, what: &str, most: impl std::fmt::Display) -> EvaluationError {
        let name = self.domain.vocabulary.predicates.get(predicate).map_or("", |predicate| predicate.name.as_str());
        EvaluationError::Unchecked(format!("the derived predicate `{name}` has more than {most} {what}"))
    }
}

#[cfg(test)]
mod tests;
