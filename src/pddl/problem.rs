//! Problems: objects, the initial state, the goal — resolved and checked against a domain.

use std::borrow::Cow;
use std::cmp::Ordering;
use std::collections::{HashMap, HashSet};
use std::sync::OnceLock;

use super::domain::{Domain, check_requirements};
use super::facts::FactTable;
use super::feature::{Feature, Use, Uses};
use super::model::{Arg, Fact, Fluent, Formula, Number};
use super::report::{Report, foreign_or};
use super::resolve::Resolver;
use super::table::Table;
use super::vocabulary::{ObjectEntry, add_objects};
use crate::formats::pddl::ast::{self, Assigner, Atom, Expression, Init, Place, Term};
use crate::formats::pddl::{Dialect, RESERVED, Seeded, read_problem};
use crate::formats::{Diagnostic, Source, Span};

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
    /// What `:constraints` demands of every plan.
    pub(super) constraints: Formula,
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
    /// What is said to be false.
    denied: Vec<Box<[u32]>>,
    /// Where the facts are, once a plan is simulated.
    table: OnceLock<FactTable>,
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
    /// that is not a problem at all gives one complaint.
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
        start.check(&tree.init, resolver.report);
        let goal = match &tree.goal {
            Some(goal) => resolver.condition(goal, false),
            None => {
                let place = ast::Place(crate::formats::Span::at(tree.place.0.end.saturating_sub(1)));
                resolver.report.error_with(place.0, "the problem has no goal", "add (:goal (and …))".to_owned());
                Formula::truth()
            }
        };
        let mut trajectories = Formula::truth();
        if let Some(constraints) = &tree.constraints {
            resolver.uses.note(Feature::Constraints, constraints.place.0);
            trajectories = resolver.condition(constraints, false);
        }
        let metric = tree.metric.as_ref().map(|metric| {
            let number = resolver.number(&metric.expression);
            if !is_cost(&number, domain) {
                resolver.uses.note(Feature::NumericFluents, metric.place.0);
            }
            if !(metric.minimize && matches!(number, Number::Fluent(_)) && is_cost(&number, domain)) {
                resolver.uses.note(Feature::OtherMetrics, metric.place.0);
            }
            number
        });
        let features = uses.finish();
        let warnings = report.finish()?;
        let constants = domain.constants.items().len();
        let kinds = kind_texts(&objects, domain);
        let source = source.clone();
        Ok(Self {
            source,
            tree,
            objects,
            constants,
            kinds,
            start,
            goal,
            metric,
            constraints: trajectories,
            features,
            warnings,
        })
    }

    /// Whether time is a part of the task: actions take some, something happens by itself or has to be done within some, or
    /// plans that end early are better.
    #[must_use]
    pub fn is_timed(&self, domain: &Domain) -> bool {
        let mut used = domain.features().iter().chain(self.features());
        domain.is_temporal()
            || !self.start.timed.is_empty()
            || used.any(|used| used.feature == Feature::Constraints)
            || self.metric.as_ref().is_some_and(counts_time)
    }

    /// Does now, perhaps in another thread, what the first simulation of a plan would have to do before it.
    pub fn prepare(&self) {
        self.start.table();
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

/// Complains about each element that says another thing of the same subject than one before it, and names the place of that.
fn contradictions(
    elements: impl Iterator<Item = (String, String, Span)>,
    report: &mut Report<'_>,
    message: impl Fn(&str) -> String,
) {
    let mut said: HashMap<String, (String, Span)> = HashMap::new();
    for (what, value, span) in elements {
        match said.get(&what.to_lowercase()) {
            Some((before, first)) if *before != value => {
                let hint = format!("the other one is at {}", report.position(*first));
                report.error_with(span, message(&what), hint);
            }
            Some(_) => {}
            None => {
                said.insert(what.to_lowercase(), (value, span));
            }
        }
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

/// Whether a metric has a part that is the time of the plan.
fn counts_time(number: &Number) -> bool {
    match number {
        Number::TotalTime => true,
        Number::Operation(_, operands) => operands.iter().any(counts_time),
        _ => false,
    }
}

impl Start {
    /// Where its facts are.
    pub(super) fn table(&self) -> &FactTable {
        self.table.get_or_init(|| FactTable::new(&self.facts))
    }

    fn add(&mut self, element: &Init, resolver: &mut Resolver<'_, '_, '_>) {
        if let Init::Atom(atom) = element
            && let Some(fact) = plain_fact(atom, resolver)
        {
            self.facts.push(fact);
            return;
        }
        match element {
            Init::Atom(atom) if is_formula(atom, resolver) => {
                let message = format!("`{}` cannot stand in `:init`, which lists facts and values", atom.name);
                let hint = "write them one after the other: (:init (NAME OBJECT …) (= (FUNCTION OBJECT …) NUMBER) …)";
                resolver.report.error_with(atom.name.span(), message, hint.to_owned());
            }
            Init::Atom(atom) => self.facts.extend(ground_fact(atom, resolver)),
            Init::Not(atom) => self.denied.extend(ground_fact(atom, resolver)),
            Init::At(time, becomes, atom) => {
                if *time < 0.0 {
                    let message = format!("the time {time} of this literal is before the plan begins, at 0");
                    resolver.report.error(atom.place.0, message);
                }
                resolver.uses.note(Feature::TimedInitialLiterals, atom.place.0);
                if let Some(fact) = ground_fact(atom, resolver) {
                    self.timed.push((*time, *becomes, fact));
                }
            }
            Init::Value(target, value) => self.add_value(target, value, resolver),
        }
    }

    /// Complains about what contradicts itself: two values of a function, a fact that is there and is not, a timed
    /// literal that becomes true and false at once.
    fn check(&self, init: &[Init], report: &mut Report<'_>) {
        let mut values: HashMap<&[u32], f64, Seeded> =
            HashMap::with_capacity_and_hasher(self.values.len(), Seeded::default());
        let is_contradictory = self.values.iter().any(|(fluent, value)| {
            values.insert(fluent, *value).is_some_and(|before| before.partial_cmp(value) != Some(Ordering::Equal))
        });
        if is_contradictory {
            let values = init.iter().filter_map(|element| match element {
                Init::Value(target, value) => Some((target.to_string(), value.to_string(), target.span())),
                _ => None,
            });
            contradictions(values, report, |what| format!("{what} has another value already"));
        }
        let denied: HashSet<&[u32], Seeded> = self.denied.iter().map(AsRef::as_ref).collect();
        if !denied.is_empty() && self.facts.iter().any(|fact| denied.contains(fact.as_ref())) {
            let facts = init.iter().filter_map(|element| match element {
                Init::Atom(atom) => Some((atom.to_string(), String::new(), atom.place.0)),
                Init::Not(atom) => Some((atom.to_string(), "not".to_owned(), atom.place.0)),
                _ => None,
            });
            contradictions(facts, report, |what| format!("{what} is both true and false at the beginning"));
        }
        let mut timed: HashMap<(&[u32], u64), bool> = HashMap::with_capacity(self.timed.len());
        let is_contradictory = self.timed.iter().any(|(time, becomes, fact)| {
            timed.insert((fact, time.to_bits()), *becomes).is_some_and(|before| before != *becomes)
        });
        if is_contradictory {
            let literals = init.iter().filter_map(|element| match element {
                Init::At(time, becomes, atom) => Some((format!("{atom} at {time}"), becomes.to_string(), atom.place.0)),
                _ => None,
            });
            contradictions(literals, report, |what| format!("{what} becomes both true and false"));
        }
    }

    fn add_value(&mut self, target: &Term, value: &Expression, resolver: &mut Resolver<'_, '_, '_>) {
        let atom = match target {
            Term::Call(atom) => Cow::Borrowed(&**atom),
            Term::Name(name) | Term::Variable(name) => {
                Cow::Owned(Atom { name: name.clone(), arguments: Vec::new(), place: Place(name.span()) })
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

/// Whether what stands for a fact begins with a word of conditions or effects.
fn is_formula(atom: &Atom, resolver: &Resolver<'_, '_, '_>) -> bool {
    RESERVED.iter().any(|word| atom.name.is(word)) && resolver.vocabulary.predicates.find(atom.name.as_str()).is_none()
}

/// A fact of objects alone; nothing where that was complained about.
fn ground_fact(atom: &Atom, resolver: &mut Resolver<'_, '_, '_>) -> Option<Box<[u32]>> {
    let plain = plain_fact(atom, resolver);
    if plain.is_some() {
        return plain;
    }
    let Fact { predicate, arguments } = resolver.fact(atom);
    if resolver.derived.contains(&predicate) {
        resolver.report.warning(atom.place.0, format!("`{}` is derived; stating it has no effect", atom.name));
        return None;
    }
    ground(predicate, &arguments)
}

/// A fact with nothing to say about, as most are: of a predicate that no rule derives, and of objects that fit.
fn plain_fact(atom: &Atom, resolver: &Resolver<'_, '_, '_>) -> Option<Box<[u32]>> {
    let predicate = resolver.vocabulary.predicates.find(atom.name.as_str())?;
    let parameters = &resolver.vocabulary.predicates.get(predicate)?.parameters;
    if parameters.len() != atom.arguments.len() || resolver.derived.contains(&predicate) {
        return None;
    }
    let mut numbers = Vec::with_capacity(parameters.len() + 1);
    numbers.push(predicate);
    for (term, parameter) in atom.arguments.iter().zip(parameters) {
        let Term::Name(name) = term else { return None };
        let number = resolver.objects.find(name.as_str())?;
        let kind = &resolver.objects.get(number)?.kind;
        if kind != &parameter.kind && !resolver.vocabulary.types.fits(kind, &parameter.kind) {
            return None;
        }
        numbers.push(number);
    }
    Some(numbers.into_boxed_slice())
}

fn ground(head: u32, arguments: &[Arg]) -> Option<Box<[u32]>> {
    let mut numbers = Vec::with_capacity(arguments.len() + 1);
    numbers.push(head);
    for argument in arguments {
        match argument {
            Arg::Object(number) => numbers.push(*number),
            Arg::Slot(_) | Arg::Fluent => return None,
        }
    }
    Some(numbers.into_boxed_slice())
}
