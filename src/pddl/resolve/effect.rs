//! Effects.

use super::Resolver;
use crate::formats::Span;
use crate::formats::pddl::ast::{self, Assigner, Atom, Effect, EffectKind, Expression, Moment, Name, Term};
use crate::formats::pddl::portable::moments;
use crate::pddl::feature::Feature;
use crate::pddl::model::{Change, Fact, Variable};

impl Resolver<'_, '_, '_> {
    pub(in crate::pddl) fn effect(&mut self, effect: &Effect) -> Change {
        let span = effect.place.0;
        match &effect.kind {
            EffectKind::Add(atom) => Change::Add(self.changed_fact(atom)),
            EffectKind::Delete(atom) => Change::Delete(self.changed_fact(atom)),
            EffectKind::And(parts) => Change::And(parts.iter().map(|part| self.effect(part)).collect()),
            EffectKind::Forall(list, inner) => {
                self.uses.note(Feature::ConditionalEffects, span);
                let (quantifier, inner) = self.quantified(list, |this| this.effect(inner));
                Change::Forall(quantifier, Box::new(inner))
            }
            EffectKind::When(condition, inner) => {
                self.uses.note(Feature::ConditionalEffects, span);
                if self.durative
                    && moments::names_moment(condition)
                    && moments::joint_moment(condition, inner).is_none()
                {
                    self.uses.note(Feature::TimedConditionalEffects, span);
                }
                let condition = self.condition(condition, false);
                Change::When(Box::new(condition), Box::new(self.effect(inner)))
            }
            EffectKind::Timed(moment, inner) => {
                if *moment == Moment::All {
                    self.report.error(span, "an effect happens `at start` or `at end`, not `over all`");
                }
                Change::Timed(*moment, Box::new(self.effect(inner)))
            }
            EffectKind::Assign(assigner, target, value) => self.assignment(*assigner, target, value, span),
        }
    }

    pub(super) fn changed_fact(&mut self, atom: &Atom) -> Fact {
        let fact = self.fact(atom);
        if self.derived.contains(&fact.predicate) {
            self.report.error(atom.place.0, format!("`{}` is derived; no effect can change it", atom.name));
        }
        fact
    }

    pub(super) fn assignment(&mut self, assigner: Assigner, target: &Term, value: &Expression, span: Span) -> Change {
        let atom = match target {
            Term::Call(atom) => (**atom).clone(),
            Term::Name(name) | Term::Variable(name) => {
                Atom { name: name.clone(), arguments: Vec::new(), place: ast::Place(name.span()) }
            }
        };
        if self.function(&atom.name).is_some_and(|function| function.values.is_some()) {
            return self.object_assignment(assigner, &atom, value);
        }
        let is_cost = assigner == Assigner::Increase && atom.name.is("total-cost") && !self.durative;
        self.uses.note(if is_cost { Feature::ActionCosts } else { Feature::NumericFluents }, span);
        if assigner == Assigner::ScaleDown {
            self.check_divisor(value);
        }
        let fluent = self.fluent(&atom);
        let value = self.number(value);
        fluent.map_or(Change::AssignObject, |fluent| Change::Assign(assigner, fluent, value))
    }

    pub(in crate::pddl) fn object_assignment(&mut self, assigner: Assigner, atom: &Atom, value: &Expression) -> Change {
        let (_, wanted) = self.object_fluent(atom);
        if assigner != Assigner::Assign {
            self.report.error(atom.place.0, format!("`{assigner}` needs a number, but `{}` is an object", atom.name));
        }
        match value {
            Expression::Term(Term::Name(name)) if name.is("undefined") => {}
            Expression::Term(term) => {
                let (_, given) = self.argument(term);
                if let (Some(given), Some(wanted)) = (given, wanted) {
                    let value = Variable { name: Name::from("its value"), kind: wanted };
                    self.check_kind(term, &given, &value, "function", &atom.name);
                }
            }
            other => self.report.error(other.span(), "expected an object, found a number"),
        }
        Change::AssignObject
    }
}
