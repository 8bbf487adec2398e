//! Atoms and their arguments.

use std::sync::Arc;

use super::{Resolver, count};
use crate::formats::pddl::ast::{self, Atom, Name, Term};
use crate::pddl::feature::Feature;
use crate::pddl::model::{Arg, Fact, Variable};
use crate::pddl::table::{nearest, suggestion};
use crate::pddl::types::TypeSet;
use crate::pddl::vocabulary::FunctionEntry;

impl Resolver<'_, '_, '_> {
    pub(super) fn function(&self, name: &Name) -> Option<&FunctionEntry> {
        self.vocabulary.functions.find(name.as_str()).and_then(|number| self.vocabulary.functions.get(number))
    }

    pub(in crate::pddl) fn fact(&mut self, atom: &Atom) -> Fact {
        let vocabulary = self.vocabulary;
        let Some(number) = vocabulary.predicates.find(atom.name.as_str()) else {
            self.unknown_predicate(&atom.name);
            return Fact { predicate: 0, arguments: atom.arguments.iter().map(|term| self.argument(term).0).collect() };
        };
        let parameters = vocabulary.predicates.get(number).map_or(&[][..], |entry| &entry.parameters);
        Fact { predicate: number, arguments: self.arguments("predicate", atom, parameters) }
    }

    pub(super) fn unknown_predicate(&mut self, name: &Name) {
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
    pub(super) fn arguments(&mut self, what: &str, atom: &Atom, parameters: &[Variable]) -> Box<[Arg]> {
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

    pub(super) fn parameter_text(&self, variable: &Variable) -> String {
        format!("{} - {}", variable.name, self.vocabulary.types.kind_text(&variable.kind))
    }

    pub(super) fn check_kind(&mut self, term: &Term, given: &TypeSet, wanted: &Variable, what: &str, name: &Name) {
        let types = &self.vocabulary.types;
        if Arc::ptr_eq(given, &wanted.kind) || types.fits(given, &wanted.kind) {
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
    pub(super) fn argument(&mut self, term: &Term) -> (Arg, Option<TypeSet>) {
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

    pub(super) fn unknown_object(&mut self, name: &Name) {
        if self.report.is_full() {
            return;
        }
        let variable = format!("?{name}");
        let hint = if self.scope.iter().any(|known| known.name.is(&variable)) {
            format!("did you mean `{variable}`?")
        } else {
            suggestion(self.objects.nearest(name.as_str()))
        };
        self.report.missing(name.span(), format!("object `{name}` is not declared"), hint);
    }

    pub(super) fn object_fluent(&mut self, atom: &Atom) -> (Arg, Option<TypeSet>) {
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
}
