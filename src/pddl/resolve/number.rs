//! Arithmetic.

use super::{Resolver, count};
use crate::formats::pddl::ast::{self, Atom, Expression, Name, Term};
use crate::pddl::feature::Feature;
use crate::pddl::model::{Fluent, Number};
use crate::pddl::table::{nearest, suggestion};

impl Resolver<'_, '_, '_> {
    pub(super) fn unknown_function(&mut self, name: &Name) {
        if self.report.is_full() {
            return;
        }
        let hint = suggestion(self.vocabulary.functions.nearest(name.as_str()));
        self.report.error_with(name.span(), format!("function `{name}` is not declared"), hint);
    }

    pub(in crate::pddl) fn number(&mut self, expression: &Expression) -> Number {
        match expression {
            Expression::Number(value, place) => {
                if value.fract() != 0.0 {
                    self.uses.note(Feature::FractionalNumbers, place.0);
                }
                Number::Constant(*value)
            }
            Expression::Elapsed(place) => {
                self.uses.note(Feature::ContinuousEffects, place.0);
                Number::Elapsed
            }
            Expression::Operation(operator, operands, place) => {
                let fits = operands.len() >= 2 || *operator == ast::Operator::Subtract;
                let binary = matches!(operator, ast::Operator::Subtract | ast::Operator::Divide);
                if !fits || (binary && operands.len() > 2) {
                    self.report.error(place.0, format!("`{operator}` cannot take {}", count(operands.len())));
                }
                if let (ast::Operator::Divide, [_, divisor]) = (operator, operands.as_slice()) {
                    self.check_divisor(divisor);
                }
                Number::Operation(*operator, operands.iter().map(|operand| self.number(operand)).collect())
            }
            Expression::Term(Term::Variable(name)) if self.durative && name.is("?duration") => Number::Duration,
            Expression::Term(Term::Variable(name)) => {
                self.report.error(name.span(), format!("expected a number, found variable `{name}`"));
                Number::Constant(0.0)
            }
            Expression::Term(Term::Name(name)) if self.is_no_number(name) => {
                self.report.error(name.span(), format!("expected a number, found `{name}`"));
                Number::Constant(0.0)
            }
            Expression::Term(Term::Name(name)) => {
                let atom = Atom { name: name.clone(), arguments: Vec::new(), place: ast::Place(name.span()) };
                self.numeric(&atom)
            }
            Expression::Term(Term::Call(atom)) => self.numeric(atom),
        }
    }

    /// Refuses to divide by what is zero in every state.
    pub(super) fn check_divisor(&mut self, divisor: &Expression) {
        if constant(divisor) == Some(0.0) {
            let hint = "what it is part of has no value, so that its action could never be applied".to_owned();
            self.report.error_with(divisor.span(), "a division by zero", hint);
        }
    }

    /// Whether a word without brackets is neither a function nor like one.
    fn is_no_number(&mut self, name: &Name) -> bool {
        !name.is("total-time")
            && self.function(name).is_none()
            && self.vocabulary.functions.nearest(name.as_str()).is_none()
    }

    pub(super) fn numeric(&mut self, atom: &Atom) -> Number {
        if self.function(&atom.name).is_none() {
            if atom.name.is("total-time") && atom.arguments.is_empty() {
                return Number::TotalTime;
            }
            if let ("is-violated", [Term::Name(preference)]) =
                (atom.name.as_str().to_ascii_lowercase().as_str(), atom.arguments.as_slice())
            {
                return self.violations(preference);
            }
        }
        self.fluent(atom).map_or(Number::Constant(0.0), Number::Fluent)
    }

    pub(super) fn violations(&mut self, preference: &Name) -> Number {
        if !self.preferences.iter().any(|known| known.is(preference.as_str())) {
            let hint = suggestion(nearest(preference.as_str(), self.preferences.iter().map(Name::as_str)));
            self.report.error_with(preference.span(), format!("there is no preference `{preference}`"), hint);
        }
        Number::Violations(preference.shared())
    }

    /// A function whose value is a number.
    pub(in crate::pddl) fn fluent(&mut self, atom: &Atom) -> Option<Fluent> {
        let vocabulary = self.vocabulary;
        let Some(number) = vocabulary.functions.find(atom.name.as_str()) else {
            if vocabulary.predicates.find(atom.name.as_str()).is_some() {
                let message = format!("expected a number, but `{}` is a predicate", atom.name);
                self.report.error(atom.place.0, message);
            } else {
                self.unknown_function(&atom.name);
            }
            return None;
        };
        let function = vocabulary.functions.get(number)?;
        if function.values.is_some() {
            self.report.error(atom.place.0, format!("expected a number, but function `{}` is an object", atom.name));
        }
        Some(Fluent { function: number, arguments: self.arguments("function", atom, &function.parameters) })
    }
}

/// The value of an expression of numbers alone.
fn constant(expression: &Expression) -> Option<f64> {
    let Expression::Operation(operator, operands, _) = expression else {
        return if let Expression::Number(value, _) = expression { Some(*value) } else { None };
    };
    let values = operands.iter().map(constant).collect::<Option<Vec<f64>>>()?;
    match (operator, values.as_slice()) {
        (ast::Operator::Add, all) => Some(all.iter().sum()),
        (ast::Operator::Multiply, all) => Some(all.iter().product()),
        (ast::Operator::Subtract, [only]) => Some(-only),
        (ast::Operator::Subtract, [left, right]) => Some(left - right),
        (ast::Operator::Divide, [left, right]) => Some(left / right),
        _ => None,
    }
}
