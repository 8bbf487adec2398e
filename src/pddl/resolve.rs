//! Syntax tree → resolved conditions and effects, with complaints and the features in use.
//!
//! Recursion is as deep as the brackets, which the reader of the syntax bounds.
//! After a complaint a stand-in takes the place of what could not be resolved, so
//! that the rest is looked at too.

use super::feature::{Feature, Uses};
use super::model::{Arg, Change, Fact, Fluent, Formula, Number, Quantifier, Variable};
use super::report::Report;
use super::table::{Table, nearest, suggestion};
use super::types::Kind;
use super::vocabulary::{FunctionEntry, ObjectEntry, Vocabulary, variables};
use crate::formats::Span;
use crate::formats::pddl::ast::{
    self, Assigner, Atom, Comparator, Condition, ConditionKind, Effect, EffectKind, Expression, Moment, Name, Term,
};

/// Names to resolve against, and where complaints and features go.
pub(super) struct Resolver<'a, 'r, 's> {
    pub(super) vocabulary: &'a Vocabulary,
    pub(super) objects: &'a Table<ObjectEntry>,
    pub(super) report: &'r mut Report<'s>,
    pub(super) uses: &'r mut Uses,
    /// Variables in scope; their places are their slots.
    pub(super) scope: Vec<Variable>,
    /// Whether `?duration` and `#t` mean something here.
    pub(super) durative: bool,
    /// The predicates that rules derive.
    pub(super) derived: &'a [u32],
    /// Preferences that have a name, for `is-violated`.
    pub(super) preferences: Vec<Name>,
}

impl Resolver<'_, '_, '_> {
    // Conditions

    /// Resolves a condition; `negated` says whether an odd number of `not` is around it.
    pub(super) fn condition(&mut self, condition: &Condition, negated: bool) -> Formula {
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
                self.preferences.extend(name.clone());
                Formula::Preference(Box::new(self.condition(inner, negated)))
            }
            ConditionKind::Modal(_, _, parts) => {
                self.uses.note(Feature::Constraints, span);
                for part in parts {
                    self.condition(part, negated);
                }
                Formula::Modal
            }
        }
    }

    /// Resolves what stands under a quantifier with its variables in scope.
    fn quantified<T>(&mut self, list: &[ast::Typed], inner: impl FnOnce(&mut Self) -> T) -> (Quantifier, T) {
        let variables = variables(&self.vocabulary.types, list, self.report);
        let first = self.scope.len();
        self.scope.extend(variables.iter().cloned());
        let inner = inner(self);
        self.scope.truncate(first);
        (Quantifier { first: u32::try_from(first).unwrap_or(u32::MAX), variables }, inner)
    }

    /// `=` compares objects or numbers; everything else compares numbers.
    fn comparison(&mut self, comparator: Comparator, left: &Expression, right: &Expression, span: Span) -> Formula {
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

    fn is_duration(&self, expression: &Expression) -> bool {
        self.durative && matches!(expression, Expression::Term(Term::Variable(name)) if name.is("?duration"))
    }

    /// The term, if what is written stands for an object.
    fn object_term<'e>(&self, expression: &'e Expression) -> Option<&'e Term> {
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

    // Atoms and terms

    fn function(&self, name: &Name) -> Option<&FunctionEntry> {
        self.vocabulary.functions.find(name.as_str()).and_then(|number| self.vocabulary.functions.get(number))
    }

    pub(super) fn fact(&mut self, atom: &Atom) -> Fact {
        let vocabulary = self.vocabulary;
        let Some(number) = vocabulary.predicates.find(atom.name.as_str()) else {
            self.unknown_predicate(&atom.name);
            return Fact { predicate: 0, arguments: atom.arguments.iter().map(|term| self.argument(term).0).collect() };
        };
        let parameters = vocabulary.predicates.get(number).map_or(&[][..], |entry| &entry.parameters);
        Fact { predicate: number, arguments: self.arguments("predicate", atom, parameters) }
    }

    fn unknown_predicate(&mut self, name: &Name) {
        if self.report.is_full() {
            return;
        }
        let known = &self.vocabulary.predicates;
        let hint = if self.function(name).is_some() {
            format!("`{name}` is a function; its value can be compared, as in (>= ({name} …) 1)")
        } else {
            suggestion(known.nearest(name.as_str()))
        };
        self.report.error_with(name.span(), format!("predicate `{name}` is not declared"), hint);
    }

    /// Resolves arguments against the parameters they are for.
    fn arguments(&mut self, what: &str, atom: &Atom, parameters: &[Variable]) -> Box<[Arg]> {
        let (given, wanted) = (atom.arguments.len(), parameters.len());
        if given != wanted {
            let usage: Vec<String> = parameters.iter().map(|variable| self.parameter_text(variable)).collect();
            let usage = if usage.is_empty() { String::new() } else { format!(" {}", usage.join(" ")) };
            self.report.error_with(
                atom.place.0,
                format!("{what} `{}` takes {}, found {given}", atom.name, count(wanted)),
                format!("it is declared as ({}{usage})", atom.name),
            );
        }
        let mut resolved = Vec::with_capacity(given);
        for (position, term) in atom.arguments.iter().enumerate() {
            let (argument, kind) = self.argument(term);
            if let (Some(kind), Some(parameter)) = (kind, parameters.get(position)) {
                self.check_kind(term, &kind, parameter, what, &atom.name);
            }
            resolved.push(argument);
        }
        resolved.into_boxed_slice()
    }

    fn parameter_text(&self, variable: &Variable) -> String {
        format!("{} - {}", variable.name, self.vocabulary.types.kind_text(&variable.kind))
    }

    fn check_kind(&mut self, term: &Term, given: &Kind, wanted: &Variable, what: &str, name: &Name) {
        let types = &self.vocabulary.types;
        if std::sync::Arc::ptr_eq(given, &wanted.kind) || types.fits(given, &wanted.kind) {
            return;
        }
        let (is, must) = (types.kind_text(given), types.kind_text(&wanted.kind));
        let message = format!("`{term}` is of type `{is}`, but {what} `{name}` wants `{must}` for `{}`", wanted.name);
        let may_be = matches!(term, Term::Variable(_) | Term::Call(_)) && types.overlap(given, &wanted.kind);
        if may_be {
            self.report.warning(term.span(), message);
        } else {
            self.report.error(term.span(), message);
        }
    }

    /// An argument and its kind; no kind where the complaint has been made.
    fn argument(&mut self, term: &Term) -> (Arg, Option<Kind>) {
        match term {
            Term::Variable(name) => match self.scope.iter().rposition(|variable| variable.name.is(name.as_str())) {
                Some(slot) => {
                    let kind = self.scope.get(slot).map(|variable| variable.kind.clone());
                    (Arg::Slot(u32::try_from(slot).unwrap_or(u32::MAX)), kind)
                }
                None if self.report.is_full() => (Arg::Slot(0), None),
                None => {
                    let near = nearest(name.as_str(), self.scope.iter().map(|variable| variable.name.as_str()));
                    let hint = suggestion(near);
                    self.report.error_with(name.span(), format!("variable `{name}` is not a parameter here"), hint);
                    (Arg::Slot(0), None)
                }
            },
            Term::Name(name) => match self.objects.find(name.as_str()) {
                Some(number) => (Arg::Object(number), self.objects.get(number).map(|object| object.kind.clone())),
                None if self.function(name).is_some_and(|function| function.values.is_some()) => {
                    let atom = Atom { name: name.clone(), arguments: Vec::new(), place: ast::Place(name.span()) };
                    self.object_fluent(&atom)
                }
                None => {
                    self.unknown_object(name);
                    (Arg::Object(0), None)
                }
            },
            Term::Call(atom) => self.object_fluent(atom),
        }
    }

    fn unknown_object(&mut self, name: &Name) {
        if self.report.is_full() {
            return;
        }
        let variable = format!("?{name}");
        let hint = if self.scope.iter().any(|known| known.name.is(&variable)) {
            format!("did you mean `{variable}`?")
        } else {
            suggestion(self.objects.nearest(name.as_str()))
        };
        self.report.error_with(name.span(), format!("object `{name}` is not declared"), hint);
    }

    fn object_fluent(&mut self, atom: &Atom) -> (Arg, Option<Kind>) {
        self.uses.note(Feature::ObjectFluents, atom.place.0);
        let vocabulary = self.vocabulary;
        let Some(number) = vocabulary.functions.find(atom.name.as_str()) else {
            self.unknown_function(&atom.name);
            return (Arg::Fluent, None);
        };
        let Some(function) = vocabulary.functions.get(number) else { return (Arg::Fluent, None) };
        self.arguments("function", atom, &function.parameters);
        if function.values.is_none() {
            self.report.error(atom.place.0, format!("expected an object, but function `{}` is a number", atom.name));
        }
        (Arg::Fluent, function.values.clone())
    }

    // Numbers

    fn unknown_function(&mut self, name: &Name) {
        if self.report.is_full() {
            return;
        }
        let hint = suggestion(self.vocabulary.functions.nearest(name.as_str()));
        self.report.error_with(name.span(), format!("function `{name}` is not declared"), hint);
    }

    pub(super) fn number(&mut self, expression: &Expression) -> Number {
        match expression {
            Expression::Number(value, _) => Number::Constant(*value),
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
                Number::Operation(*operator, operands.iter().map(|operand| self.number(operand)).collect())
            }
            Expression::Term(Term::Variable(name)) if self.durative && name.is("?duration") => Number::Duration,
            Expression::Term(Term::Variable(name)) => {
                self.report.error(name.span(), format!("expected a number, found variable `{name}`"));
                Number::Constant(0.0)
            }
            Expression::Term(Term::Name(name)) => {
                let atom = Atom { name: name.clone(), arguments: Vec::new(), place: ast::Place(name.span()) };
                self.numeric(&atom)
            }
            Expression::Term(Term::Call(atom)) => self.numeric(atom),
        }
    }

    fn numeric(&mut self, atom: &Atom) -> Number {
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

    fn violations(&mut self, preference: &Name) -> Number {
        if !self.preferences.iter().any(|known| known.is(preference.as_str())) {
            let hint = suggestion(nearest(preference.as_str(), self.preferences.iter().map(Name::as_str)));
            self.report.error_with(preference.span(), format!("there is no preference `{preference}`"), hint);
        }
        Number::Violations(preference.shared())
    }

    /// A function whose value is a number.
    pub(super) fn fluent(&mut self, atom: &Atom) -> Option<Fluent> {
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

    // Effects

    pub(super) fn effect(&mut self, effect: &Effect) -> Change {
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

    fn changed_fact(&mut self, atom: &Atom) -> Fact {
        let fact = self.fact(atom);
        if self.derived.contains(&fact.predicate) {
            self.report.error(atom.place.0, format!("`{}` is derived; no effect can change it", atom.name));
        }
        fact
    }

    fn assignment(&mut self, assigner: Assigner, target: &Term, value: &Expression, span: Span) -> Change {
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
        let fluent = self.fluent(&atom);
        let value = self.number(value);
        fluent.map_or(Change::AssignObject, |fluent| Change::Assign(assigner, fluent, value))
    }

    pub(super) fn object_assignment(&mut self, assigner: Assigner, atom: &Atom, value: &Expression) -> Change {
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

fn quantified(universal: bool) -> Feature {
    if universal { Feature::UniversalPreconditions } else { Feature::ExistentialPreconditions }
}

/// `no arguments`, `1 argument`, `2 arguments`.
pub(super) fn count(number: usize) -> String {
    match number {
        0 => "no arguments".to_owned(),
        1 => "1 argument".to_owned(),
        more => format!("{more} arguments"),
    }
}
