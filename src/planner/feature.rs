//! What a task asks of a planner beyond STRIPS and ADL, and where it first asks.

use std::fmt;

use crate::formats::Span;
use crate::formats::pddl::ast::{
    Action, Condition, ConditionKind, Domain, DurativeAction, Effect, EffectKind, Expression, Init, Name, Problem, Term,
};

/// Something that not every planner can do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Feature {
    /// `(increase (total-cost) …)`
    ActionCosts,
    /// Numbers in conditions, effects on other numbers than the total cost.
    NumericFluents,
    /// Functions whose values are objects.
    ObjectFluents,
    /// `(when …)`
    ConditionalEffects,
    /// `(:derived …)`
    DerivedPredicates,
    /// `(:durative-action …)`
    DurativeActions,
    /// `#t`
    ContinuousEffects,
    /// `(at 5 (open))` in `:init`
    TimedInitialLiterals,
    /// `(preference …)`
    Preferences,
    /// `(:constraints …)`
    TrajectoryConstraints,
    /// `(within 5 …)` and the like
    TimedConstraints,
}

impl fmt::Display for Feature {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::ActionCosts => "action costs",
            Self::NumericFluents => "numeric fluents",
            Self::ObjectFluents => "object fluents",
            Self::ConditionalEffects => "conditional effects",
            Self::DerivedPredicates => "derived predicates",
            Self::DurativeActions => "durative actions",
            Self::ContinuousEffects => "continuous effects",
            Self::TimedInitialLiterals => "timed initial literals",
            Self::Preferences => "preferences",
            Self::TrajectoryConstraints => "trajectory constraints",
            Self::TimedConstraints => "timed trajectory constraints",
        })
    }
}

/// Where a feature is first used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Use {
    /// What is used.
    pub feature: Feature,
    /// Where, in the domain's text or the problem's.
    pub span: Span,
    /// Which of the two.
    pub in_problem: bool,
}

/// The features that a task uses, each with its first place.
#[must_use]
pub fn features(domain: &Domain, problem: &Problem) -> Vec<Use> {
    let mut survey = Survey { domain, uses: Vec::new(), in_problem: false };
    survey.domain(domain);
    survey.in_problem = true;
    survey.problem(problem);
    survey.uses
}

/// The walk over a task. Its depth is that of the texts' brackets, which their reader bounds.
struct Survey<'a> {
    domain: &'a Domain,
    uses: Vec<Use>,
    in_problem: bool,
}

impl Survey<'_> {
    fn note(&mut self, feature: Feature, span: Span) {
        if !self.uses.iter().any(|known| known.feature == feature) {
            self.uses.push(Use { feature, span, in_problem: self.in_problem });
        }
    }

    fn domain(&mut self, domain: &Domain) {
        for function in &domain.functions {
            let number = |kind: &[Name]| kind.iter().all(|name| name.is("number"));
            if function.kind.as_deref().is_some_and(|kind| !number(kind)) {
                self.note(Feature::ObjectFluents, function.signature.name.span());
            }
        }
        for derived in &domain.derived {
            self.note(Feature::DerivedPredicates, derived.place.0);
            self.condition(&derived.condition);
        }
        self.constraints(domain.constraints.as_ref());
        domain.actions.iter().for_each(|action| self.action(action));
        domain.durative_actions.iter().for_each(|action| self.durative(action));
    }

    fn problem(&mut self, problem: &Problem) {
        for init in &problem.init {
            if let Init::At(_, _, atom) = init {
                self.note(Feature::TimedInitialLiterals, atom.place.0);
            }
        }
        if let Some(goal) = &problem.goal {
            self.condition(goal);
        }
        self.constraints(problem.constraints.as_ref());
    }

    fn constraints(&mut self, constraints: Option<&Condition>) {
        let Some(constraints) = constraints else { return };
        let none = matches!(&constraints.kind, ConditionKind::And(parts) if parts.is_empty());
        if !none {
            self.note(Feature::TrajectoryConstraints, constraints.place.0);
            self.condition(constraints);
        }
    }

    fn action(&mut self, action: &Action) {
        if let Some(condition) = &action.precondition {
            self.condition(condition);
        }
        if let Some(effect) = &action.effect {
            self.effect(effect);
        }
    }

    fn durative(&mut self, action: &DurativeAction) {
        self.note(Feature::DurativeActions, action.place.0);
        if let Some(condition) = &action.condition {
            self.condition(condition);
        }
        if let Some(effect) = &action.effect {
            self.effect(effect);
        }
    }

    fn condition(&mut self, condition: &Condition) {
        match &condition.kind {
            ConditionKind::Atom(_) => {}
            ConditionKind::Comparison(_, left, right) => {
                if self.is_number(left) || self.is_number(right) {
                    self.note(Feature::NumericFluents, condition.place.0);
                }
            }
            ConditionKind::Not(inner)
            | ConditionKind::Forall(_, inner)
            | ConditionKind::Exists(_, inner)
            | ConditionKind::Timed(_, inner) => self.condition(inner),
            ConditionKind::And(parts) | ConditionKind::Or(parts) => parts.iter().for_each(|part| self.condition(part)),
            ConditionKind::Imply(left, right) => {
                self.condition(left);
                self.condition(right);
            }
            ConditionKind::Preference(_, inner) => {
                self.note(Feature::Preferences, condition.place.0);
                self.condition(inner);
            }
            ConditionKind::Modal(_, numbers, parts) => {
                let feature =
                    if numbers.is_empty() { Feature::TrajectoryConstraints } else { Feature::TimedConstraints };
                self.note(feature, condition.place.0);
                parts.iter().for_each(|part| self.condition(part));
            }
        }
    }

    fn effect(&mut self, effect: &Effect) {
        match &effect.kind {
            EffectKind::Add(_) | EffectKind::Delete(_) => {}
            EffectKind::And(parts) => parts.iter().for_each(|part| self.effect(part)),
            EffectKind::Forall(_, inner) | EffectKind::Timed(_, inner) => self.effect(inner),
            EffectKind::When(condition, inner) => {
                self.note(Feature::ConditionalEffects, effect.place.0);
                self.condition(condition);
                self.effect(inner);
            }
            EffectKind::Assign(_, target, value) => {
                let feature = match is_total_cost(target) {
                    true => Feature::ActionCosts,
                    false => Feature::NumericFluents,
                };
                self.note(feature, effect.place.0);
                if has_elapsed(value) {
                    self.note(Feature::ContinuousEffects, effect.place.0);
                }
            }
        }
    }

    /// Whether a side of a comparison is a number and not an object.
    fn is_number(&self, side: &Expression) -> bool {
        match side {
            Expression::Number(..) | Expression::Elapsed(_) | Expression::Operation(..) => true,
            Expression::Term(Term::Call(_)) => true,
            Expression::Term(Term::Name(name)) => {
                self.domain.functions.iter().any(|known| name.is(known.signature.name.as_str()))
            }
            Expression::Term(Term::Variable(_)) => false,
        }
    }
}

fn is_total_cost(target: &Term) -> bool {
    match target {
        Term::Name(name) => name.is("total-cost"),
        Term::Call(atom) => atom.name.is("total-cost"),
        Term::Variable(_) => false,
    }
}

fn has_elapsed(value: &Expression) -> bool {
    match value {
        Expression::Elapsed(_) => true,
        Expression::Operation(_, operands, _) => operands.iter().any(has_elapsed),
        Expression::Number(..) | Expression::Term(_) => false,
    }
}
