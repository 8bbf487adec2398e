//! Conditions.

use super::Resolver;
use crate::formats::Span;
use crate::formats::pddl::ast::{self, Comparator, Condition, ConditionKind, Expression, Name, Term};
use crate::pddl::feature::Feature;
use crate::pddl::model::{Formula, Quantifier};
use crate::pddl::vocabulary::variables;

impl Resolver<'_, '_, '_> {
    /// Resolves a condition; `negated` says whether an odd number of `not` is around it.
    pub(in crate::pddl) fn condition(&mut self, condition: &Condition, negated: bool) -> Formula {
        let span = condition.place.0;
        match &condition.kind {
            ConditionKind::Atom(atom) => {
                if negated {
                    self.uses.note(Feature::NegativePreconditions, span);
                }
                Formula::Fact(self.fact(atom))
            }
            ConditionKind::Comparison(comparator, left, right) => self.comparison(*comparator, left, right, span),
            ConditionKind::Not(inner) => Formula::Not(Box::new(self.condition(inner, !negated))),
            ConditionKind::And(parts) => {
                if negated && parts.len() > 1 {
                    self.uses.note(Feature::DisjunctivePreconditions, span);
                }
                Formula::And(parts.iter().map(|part| self.condition(part, negated)).collect())
            }
            ConditionKind::Or(parts) => {
                if !negated {
                    self.uses.note(Feature::DisjunctivePreconditions, span);
                }
                Formula::Or(parts.iter().map(|part| self.condition(part, negated)).collect())
            }
            ConditionKind::Imply(left, right) => {
                if !negated {
                    self.uses.note(Feature::DisjunctivePreconditions, span);
                }
                let left = self.condition(left, !negated);
                Formula::Imply(Box::new(left), Box::new(self.condition(right, negated)))
            }
            ConditionKind::Forall(list, inner) => {
                self.uses.note(quantified(!negated), span);
                let (quantifier, inner) = self.quantified(list, |this| this.condition(inner, negated));
                Formula::Forall(quantifier, Box::new(inner))
            }
            ConditionKind::Exists(list, inner) => {
                self.uses.note(quantified(negated), span);
                let (quantifier, inner) = self.quantified(list, |this| this.condition(inner, negated));
                Formula::Exists(quantifier, Box::new(inner))
            }
            ConditionKind::Timed(moment, inner) => Formula::Timed(*moment, Box::new(self.condition(inner, negated))),
            ConditionKind::Preference(name, inner) => {
                self.uses.note(Feature::Preferences, span);
                if self.durative {
                    self.uses.note(Feature::TimedPreferences, span);
                }
                self.preferences.extend(name.clone());
                let name = name.as_ref().map(Name::shared);
                Formula::Preference(name, Box::new(self.condition(inner, negated)))
            }
            ConditionKind::Modal(modal, numbers, parts) => {
                self.uses.note(Feature::Constraints, span);
                let parts = parts.iter().map(|part| self.condition(part, negated)).collect();
                Formula::Modal(*modal, numbers.clone(), parts)
            }
        }
    }

    /// Resolves what stands under a quantifier with its variables in scope.
    pub(super) fn quantified<T>(&mut self, list: &[ast::Typed], inner: impl FnOnce(&mut Self) -> T) -> (Quantifier, T) {
        let variables = variables(&self.vocabulary.types, list, self.report);
        let first = self.scope.len();
        self.scope.extend(variables.iter().cloned());
        let inner = inner(self);
        self.scope.truncate(first);
        (Quantifier { first: u32::try_from(first).unwrap_or(u32::MAX), variables }, inner)
    }

    /// `=` compares objects or numbers; everything else compares numbers.
    pub(super) fn comparison(
        &mut self,
        comparator: Comparator,
        left: &Expression,
        right: &Expression,
        span: Span,
    ) -> Formula {
        if comparator == Comparator::Equal {
            let terms = (self.object_term(left), self.object_term(right));
            if let (Some(left), Some(right)) = terms {
                self.uses.note(Feature::Equality, span);
                let (left, _) = self.argument(left);
                return Formula::Same(left, self.argument(right).0);
            }
        }
        if !self.is_duration(left) && !self.is_duration(right) {
            self.uses.note(Feature::NumericFluents, span);
        }
        Formula::Compare(comparator, self.number(left), self.number(right))
    }

    pub(super) fn is_duration(&self, expression: &Expression) -> bool {
        self.durative && matches!(expression, Expression::Term(Term::Variable(name)) if name.is("?duration"))
    }

    /// The term, if what is written stands for an object.
    pub(super) fn object_term<'e>(&self, expression: &'e Expression) -> Option<&'e Term> {
        let Expression::Term(term) = expression else { return None };
        let is_object = match term {
            Term::Variable(name) => !(self.durative && name.is("?duration")),
            Term::Name(name) => {
                self.objects.find(name.as_str()).is_some() || (self.function(name).is_none() && !name.is("total-time"))
            }
            Term::Call(atom) => self.function(&atom.name).is_some_and(|function| function.values.is_some()),
        };
        is_object.then_some(term)
    }
}

fn quantified(universal: bool) -> Feature {
    if universal { Feature::UniversalPreconditions } else { Feature::ExistentialPreconditions }
}
