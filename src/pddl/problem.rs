//! Problems: objects, the initial state, the goal — resolved and checked against a domain.

use super::domain::{Domain, check_requirements};
use super::feature::{Feature, Use, Uses};
use super::model::{Arg, Fact, Fluent, Formula, Number};
use super::report::{Report, foreign_or};
use super::resolve::Resolver;
use super::table::Table;
use super::vocabulary::{ObjectEntry, add_objects};
use crate::formats::pddl::ast::{self, Assigner, Atom, Expression, Init, Place, Term};
use crate::formats::pddl::{Dialect, read_problem};
use crate::formats::{Diagnostic, Source};

/// A problem whose names are all resolved against its domain.
#[derive(Debug, Clone)]
pub struct Problem {
    source: Source,
    tree: ast::Problem,
    /// The domain's constants, then the problem's objects.
    pub(super) objects: Table<ObjectEntry>,
    constants: usize,
    kinds: Vec<String>,
    pub(super) start: Start,
    pub(super) goal: Formula,
    pub(super) metric: Option<Number>,
    /// Whether `:constraints` demands something of every plan.
    pub(super) is_constrained: bool,
    features: Vec<Use>,
    warnings: Vec<Diagnostic>,
}

/// The state before the first action, by numbers: a predicate or function, then its arguments.
#[derive(Debug, Clone, Default)]
pub(super) struct Start {
    pub(super) facts: Vec<Box<[u32]>>,
    pub(super) values: Vec<(Box<[u32]>, f64)>,
    /// Timed literals: when, whether it becomes true, what.
    pub(super) timed: Vec<(f64, bool, Box<[u32]>)>,
}

/// An object of a problem.
#[derive(Debug, Clone, PartialEq)]
pub struct Object<'a> {
    /// The name in its original spelling.
    pub name: &'a str,
    /// Its type as written: `block`, `(either block crate)`, `object` where none is given.
    pub kind: &'a str,
}

impl Problem {
    /// Reads a problem and checks it against its domain.
    ///
    /// # Errors
    /// Everything that is wrong with it, in the order of the text, up to a bound; a text
    /// that is no problem at all gives one complaint.
    pub fn read(source: &Source, domain: &Domain, dialect: Dialect) -> Result<Self, Vec<Diagnostic>> {
        Self::resolve(source, domain, dialect).map_err(|wrong| foreign_or(source, wrong))
    }

    fn resolve(source: &Source, domain: &Domain, dialect: Dialect) -> Result<Self, Vec<Diagnostic>> {
        let mut tree = read_problem(source, dialect).map_err(|diagnostic| vec![diagnostic])?;
        let mut report = Report::new(source);
        report.warn_of_dashes();
        let mut uses = Uses::default();
        check_head(&tree, domain, &mut report);
        let types = &domain.vocabulary.types;
        let mut objects = domain.constants.clone();
        let repeated = add_objects(&mut objects, "object", &tree.objects, types, &mut report);
        tree.objects.retain(|object| !repeated.contains(&object.name.span()));
        let mut resolver = Resolver {
            vocabulary: &domain.vocabulary,
            objects: &objects,
            report: &mut report,
            uses: &mut uses,
            scope: Vec::new(),
            durative: false,
            derived: &domain.derived,
            preferences: domain.preferences.clone(),
        };
        let mut start = Start::default();
        tree.init.iter().for_each(|element| start.add(element, &mut resolver));
        let goal = match &tree.goal {
            Some(goal) => resolver.condition(goal, false),
            None => {
                let place = ast::Place(crate::formats::Span::at(tree.place.0.end.saturating_sub(1)));
                resolver.report.error_with(place.0, "the problem has no goal", "add (:goal (and …))".to_owned());
                Formula::truth()
            }
        };
        let mut is_constrained = false;
        if let Some(constraints) = &tree.constraints {
            resolver.uses.note(Feature::Constraints, constraints.place.0);
            is_constrained = resolver.condition(constraints, false).is_constraint();
        }
        let metric = tree.metric.as_ref().map(|metric| {
            let number = resolver.number(&metric.expression);
            if !is_cost(&number, domain) {
                resolver.uses.note(Feature::NumericFluents, metric.place.0);
            }
            number
        });
        let features = uses.finish();
        let warnings = report.finish()?;
        let constants = domain.constants.items().len();
        let kinds = kind_texts(&objects, domain);
        let source = source.clone();
        Ok(Self { source, tree, objects, constants, kinds, start, goal, metric, is_constrained, features, warnings })
    }

    /// The times of its timed initial literals, in no order.
    pub fn timed(&self) -> impl Iterator<Item = f64> {
        self.start.timed.iter().map(|(time, _, _)| *time)
    }

    /// The name in its original spelling.
    #[must_use]
    pub fn name(&self) -> &str {
        self.tree.name.as_str()
    }

    /// The text it was read from.
    #[must_use]
    pub fn source(&self) -> &Source {
        &self.source
    }

    /// The syntax tree it was read from, with `init`, `goal` and `metric`.
    #[must_use]
    pub fn tree(&self) -> &ast::Problem {
        &self.tree
    }

    /// The problem's own objects, in the order of the text; the domain's constants are not among them.
    pub fn objects(&self) -> impl Iterator<Item = Object<'_>> {
        self.objects
            .items()
            .iter()
            .zip(&self.kinds)
            .skip(self.constants)
            .map(|(entry, kind)| Object { name: entry.name.as_str(), kind })
    }

    /// The original spelling of an object or constant, and its type.
    #[must_use]
    pub fn object(&self, name: &str) -> Option<Object<'_>> {
        let number = self.objects.find(name)?;
        let entry = self.objects.get(number)?;
        Some(Object { name: entry.name.as_str(), kind: self.kinds.get(number as usize)? })
    }

    /// The parts of the language that the problem itself uses.
    #[must_use]
    pub fn features(&self) -> &[Use] {
        &self.features
    }

    /// What is odd but not wrong.
    #[must_use]
    pub fn warnings(&self) -> &[Diagnostic] {
        &self.warnings
    }
}

fn kind_texts(objects: &Table<ObjectEntry>, domain: &Domain) -> Vec<String> {
    objects.items().iter().map(|entry| domain.vocabulary.types.kind_text(&entry.kind)).collect()
}

fn check_head(tree: &ast::Problem, domain: &Domain, report: &mut Report<'_>) {
    match &tree.domain {
        Some(name) if !name.is(domain.name()) => report.error_with(
            name.span(),
            format!("the problem is for domain `{name}`, but the domain is `{}`", domain.name()),
            format!("write (:domain {}), or give the other domain", domain.name()),
        ),
        Some(_) => {}
        None => {
            let hint = format!("add (:domain {})", domain.name());
            report.error_with(tree.name.span(), "the problem does not say for which domain it is", hint);
        }
    }
    check_requirements(&tree.requirements, report);
}

/// Whether a metric only counts `total-cost`.
fn is_cost(number: &Number, domain: &Domain) -> bool {
    match number {
        Number::Fluent(fluent) => {
            let function = domain.vocabulary.functions.get(fluent.function);
            function.is_some_and(|function| function.name.is("total-cost"))
        }
        Number::Constant(_) | Number::TotalTime | Number::Violations(_) => true,
        Number::Operation(_, operands) => operands.iter().all(|operand| is_cost(operand, domain)),
        Number::Duration | Number::Elapsed => false,
    }
}

impl Start {
    fn add(&mut self, element: &Init, resolver: &mut Resolver<'_, '_, '_>) {
        match element {
            Init::Atom(atom) => self.facts.extend(ground_fact(atom, resolver)),
            Init::Not(atom) => {
                ground_fact(atom, resolver);
            }
            Init::At(time, becomes, atom) => {
                resolver.uses.note(Feature::TimedInitialLiterals, atom.place.0);
                if let Some(fact) = ground_fact(atom, resolver) {
                    self.timed.push((*time, *becomes, fact));
                }
            }
            Init::Value(target, value) => self.add_value(target, value, resolver),
        }
    }

    fn add_value(&mut self, target: &Term, value: &Expression, resolver: &mut Resolver<'_, '_, '_>) {
        let atom = match target {
            Term::Call(atom) => (**atom).clone(),
            Term::Name(name) | Term::Variable(name) => {
                Atom { name: name.clone(), arguments: Vec::new(), place: Place(name.span()) }
            }
        };
        let functions = &resolver.vocabulary.functions;
        let function = functions.find(atom.name.as_str()).and_then(|number| functions.get(number));
        if function.is_some_and(|function| function.values.is_some()) {
            resolver.object_assignment(Assigner::Assign, &atom, value);
            return;
        }
        let fluent = resolver.fluent(&atom);
        match constant(&resolver.number(value)) {
            Some(value) => {
                if let Some(fluent) = fluent.and_then(|Fluent { function, arguments }| ground(function, &arguments)) {
                    self.values.push((fluent, value));
                }
            }
            None => resolver.report.error(value.span(), "expected a number; the initial state is not computed"),
        }
    }
}

/// The value of an expression without functions.
fn constant(number: &Number) -> Option<f64> {
    match number {
        Number::Constant(value) => Some(*value),
        Number::Operation(ast::Operator::Subtract, operands) => match operands.as_slice() {
            [only] => constant(only).map(|value| -value),
            _ => None,
        },
        _ => None,
    }
}

/// A fact of objects alone; nothing where that was complained about.
fn ground_fact(atom: &Atom, resolver: &mut Resolver<'_, '_, '_>) -> Option<Box<[u32]>> {
    let Fact { predicate, arguments } = resolver.fact(atom);
    if resolver.derived.contains(&predicate) {
        resolver.report.warning(atom.place.0, format!("`{}` is derived; stating it has no effect", atom.name));
        return None;
    }
    ground(predicate, &arguments)
}

fn ground(head: u32, arguments: &[Arg]) -> Option<Box<[u32]>> {
    let objects = arguments.iter().map(|argument| match argument {
        Arg::Object(number) => Some(*number),
        Arg::Slot(_) | Arg::Fluent => None,
    });
    std::iter::once(Some(head)).chain(objects).collect()
}
