//! Domains: what was declared, resolved and checked.

use std::collections::HashMap;

use super::axiom::first_changing;
use super::feature::{Feature, REQUIREMENTS, Use, Uses};
use super::model::{Body, Change, Formula, Rule, Variable};
use super::report::{Report, foreign_or};
use super::resolve::Resolver;
use super::table::{Named, Table, lower, nearest, suggestion};
use super::types::{OBJECT, TypeSet};
use super::validation::negative_cycle;
use super::vocabulary::{ObjectEntry, Vocabulary, add_objects, check_doubles, twice, variables};
use crate::formats::pddl::ast::{self, Name};
use crate::formats::pddl::portable::moments;
use crate::formats::pddl::{Dialect, read_domain};
use crate::formats::{Diagnostic, Source, Span};

/// A domain whose names are all resolved.
#[derive(Debug, Clone)]
pub struct Domain {
    source: Source,
    tree: ast::Domain,
    pub(super) vocabulary: Vocabulary,
    pub(super) constants: Table<ObjectEntry>,
    actions: Table<Action>,
    pub(super) rules: Vec<Rule>,
    /// The predicates that rules derive.
    pub(super) derived: Vec<u32>,
    /// What `:constraints` demands of every plan.
    pub(super) constraints: Formula,
    /// Preferences with a name, in `:constraints` and in preconditions.
    pub(super) preferences: Vec<Name>,
    features: Vec<Use>,
    warnings: Vec<Diagnostic>,
}

/// An action or durative action.
#[derive(Debug, Clone)]
pub struct Action {
    name: Name,
    parameters: Vec<Parameter>,
    span: Span,
    pub(super) variables: Vec<Variable>,
    /// Whether it has `:vars`.
    pub(super) has_locals: bool,
    pub(super) body: Body,
}

/// A parameter of an action or predicate.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Its name without the `?`, in its original spelling.
    pub name: String,
    /// Its type as written: `block`, `(either block crate)`, `object` where none is given.
    pub kind: String,
}

/// A predicate as declared.
#[derive(Debug, Clone, PartialEq)]
pub struct Predicate {
    /// Its name in its original spelling.
    pub name: String,
    /// Its parameters.
    pub parameters: Vec<Parameter>,
}

impl Named for Action {
    fn name(&self) -> &Name {
        &self.name
    }
}

impl Action {
    /// The name in its original spelling.
    #[must_use]
    pub fn name(&self) -> &str {
        self.name.as_str()
    }

    /// The parameters, in order.
    #[must_use]
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// Whether it takes time.
    #[must_use]
    pub fn is_durative(&self) -> bool {
        self.body.duration.is_some()
    }

    /// Where it stands in the domain's text.
    #[must_use]
    pub fn span(&self) -> Span {
        self.span
    }
}

impl Domain {
    /// Reads and checks a domain.
    ///
    /// # Errors
    /// Everything that is wrong with it, in the order of the text, up to a bound; a text
    /// that is not a domain at all gives one complaint.
    pub fn read(source: &Source, dialect: Dialect) -> Result<Self, Vec<Diagnostic>> {
        Self::resolve(source, dialect).map_err(|wrong| foreign_or(source, wrong))
    }

    fn resolve(source: &Source, dialect: Dialect) -> Result<Self, Vec<Diagnostic>> {
        let mut tree = read_domain(source, dialect).map_err(|diagnostic| vec![diagnostic])?;
        let mut report = Report::new(source);
        report.warn_of_dashes();
        remove_repeated(&mut tree.actions, |action| &action.name, &mut report);
        remove_repeated(&mut tree.durative_actions, |action| &action.name, &mut report);
        let mut uses = Uses::default();
        check_requirements(&tree.requirements, &mut report);
        let vocabulary = Vocabulary::read(&tree, &mut report);
        if let Some(typed) = tree.types.first() {
            uses.note(Feature::Typing, typed.name.span());
        }
        let mut constants = Table::new();
        add_objects(&mut constants, "constant", &tree.constants, &vocabulary.types, &mut report);
        let derived: Vec<u32> =
            tree.derived.iter().filter_map(|rule| vocabulary.predicates.find(rule.head.name.as_str())).collect();
        let mut resolver = Resolver {
            vocabulary: &vocabulary,
            objects: &constants,
            report: &mut report,
            uses: &mut uses,
            scope: Vec::new(),
            durative: false,
            derived: &derived,
            preferences: Vec::new(),
        };
        let actions = read_actions(&tree, &mut resolver);
        let rules: Vec<Rule> = tree.derived.iter().filter_map(|rule| read_rule(rule, &mut resolver)).collect();
        if rules.len() == tree.derived.len()
            && let Some(rule) = negative_cycle(&rules).and_then(|place| tree.derived.get(place))
        {
            let name = &rule.head.name;
            let message = format!("`{name}` depends on its own negation, so that it has no defined value");
            let hint = "let what is derived first not look at what is derived from its negation".to_owned();
            resolver.report.error_with(name.span(), message, hint);
        }
        let mut trajectories = Formula::truth();
        if let Some(constraints) = &tree.constraints {
            resolver.uses.note(Feature::Constraints, constraints.place.0);
            trajectories = resolver.condition(constraints, false);
        }
        let preferences = std::mem::take(&mut resolver.preferences);
        if let Some(span) = first_changing(&tree) {
            uses.note(Feature::ChangingDerivedPredicates, span);
            if !tree.durative_actions.is_empty() {
                uses.note(Feature::TimedDerivedPredicates, span);
            }
        }
        let features = uses.finish();
        check_announced(&tree.requirements, &features, &mut report);
        let warnings = report.finish()?;
        let source = source.clone();
        Ok(Self {
            source,
            tree,
            vocabulary,
            constants,
            actions,
            rules,
            derived,
            constraints: trajectories,
            preferences,
            features,
            warnings,
        })
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

    /// The syntax tree it was read from.
    #[must_use]
    pub fn tree(&self) -> &ast::Domain {
        &self.tree
    }

    /// Whether it has actions that take time.
    #[must_use]
    pub fn is_temporal(&self) -> bool {
        self.actions().iter().any(Action::is_durative)
    }

    /// All actions: first those that take no time, then those that do, each in the order of the text.
    #[must_use]
    pub fn actions(&self) -> &[Action] {
        self.actions.items()
    }

    /// The action of a name, without regard to case.
    #[must_use]
    pub fn action(&self, name: &str) -> Option<&Action> {
        self.actions.find(name).and_then(|number| self.actions.get(number))
    }

    /// The action whose name is most like `name`.
    #[must_use]
    pub fn nearest_action(&self, name: &str) -> Option<&str> {
        self.actions.nearest(name)
    }

    /// The predicates, in the order of the text.
    pub fn predicates(&self) -> impl Iterator<Item = Predicate> {
        self.vocabulary.predicates.items().iter().map(|entry| Predicate {
            name: entry.name.as_str().to_owned(),
            parameters: entry.parameters.iter().map(|variable| self.parameter(variable)).collect(),
        })
    }

    /// The constants with their types, in the order of the text.
    pub fn constants(&self) -> impl Iterator<Item = (&str, String)> {
        self.constants.items().iter().map(|entry| (entry.name.as_str(), self.vocabulary.types.kind_text(&entry.kind)))
    }

    /// The names of the types, `object` first.
    pub fn types(&self) -> impl Iterator<Item = &str> {
        self.vocabulary.types.names()
    }

    /// The parts of the language that are really used, whatever `:requirements` says.
    #[must_use]
    pub fn features(&self) -> &[Use] {
        &self.features
    }

    /// What is odd but not wrong.
    #[must_use]
    pub fn warnings(&self) -> &[Diagnostic] {
        &self.warnings
    }

    fn parameter(&self, variable: &Variable) -> Parameter {
        parameter(variable, self.vocabulary.types.kind_text(&variable.kind))
    }
}

fn parameter(variable: &Variable, kind: String) -> Parameter {
    let name = variable.name.as_str();
    Parameter { name: name.strip_prefix('?').unwrap_or(name).to_owned(), kind }
}

/// Complains about requirements that do not exist.
pub(super) fn check_requirements(requirements: &[Name], report: &mut Report<'_>) {
    for name in requirements {
        if !REQUIREMENTS.iter().any(|known| name.is(known)) {
            let hint = suggestion(nearest(name.as_str(), REQUIREMENTS.into_iter()));
            report.error_with(name.span(), format!("there is no requirement `{name}`"), hint);
        }
    }
}

/// Warns of features that no requirement announces.
fn check_announced(requirements: &[Name], features: &[Use], report: &mut Report<'_>) {
    for Use { feature, span } in features {
        let announced = requirements.iter().any(|name| feature.is_announced_by(name.as_str()));
        if !announced
            && !matches!(
                feature,
                Feature::ActionVariables
                    | Feature::FractionalNumbers
                    | Feature::ChangingDerivedPredicates
                    | Feature::TimedDerivedPredicates
                    | Feature::OtherMetrics
                    | Feature::DurationsAtEnd
                    | Feature::TimedPreferences
            )
        {
            let requirement = feature.requirement();
            report.warning(*span, format!("this needs `:{requirement}`, which `:requirements` does not list"));
        }
    }
}

/// Removes actions that are declared again with the same text, with a warning, as Fast Downward does.
fn remove_repeated<A: PartialEq>(actions: &mut Vec<A>, name: impl Fn(&A) -> &Name, report: &mut Report<'_>) {
    let mut kept: Vec<A> = Vec::with_capacity(actions.len());
    let mut places: HashMap<Box<str>, usize> = HashMap::with_capacity(actions.len());
    for action in actions.drain(..) {
        let name_of = name(&action);
        let place = *places.entry(lower(name_of.as_str()).into()).or_insert(kept.len());
        match kept.get(place).filter(|first| **first == action) {
            Some(first) => {
                let first = report.position(name(first).span());
                let message = format!("action `{name_of}` is declared twice, as at {first}; leave one of them out");
                report.warning(name_of.span(), message);
            }
            None => kept.push(action),
        }
    }
    *actions = kept;
}

fn read_actions(tree: &ast::Domain, resolver: &mut Resolver<'_, '_, '_>) -> Table<Action> {
    let mut actions = Table::new();
    for action in &tree.actions {
        let action = read_action(action, resolver);
        add_action(&mut actions, action, resolver.report);
    }
    for action in &tree.durative_actions {
        resolver.uses.note(Feature::DurativeActions, action.name.span());
        let action = read_durative_action(action, resolver);
        add_action(&mut actions, action, resolver.report);
    }
    actions
}

fn add_action(actions: &mut Table<Action>, action: Action, report: &mut Report<'_>) {
    let name = action.name.clone();
    if let Err(first) = actions.add(action) {
        twice("action", &name, &first.name, report);
    }
}

fn read_action(action: &ast::Action, resolver: &mut Resolver<'_, '_, '_>) -> Action {
    let types = &resolver.vocabulary.types;
    let variables = variables(types, &action.parameters, resolver.report);
    let parameters = variables.iter().map(|variable| parameter(variable, types.kind_text(&variable.kind))).collect();
    check_doubles(&variables, resolver.report);
    resolver.scope.clone_from(&variables);
    if let Some(local) = action.locals.first() {
        resolver.uses.note(Feature::ActionVariables, local.name.span());
        let locals = super::vocabulary::variables(types, &action.locals, resolver.report);
        resolver.scope.extend(locals);
    }
    note_typing(&variables, resolver);
    let named = action.precondition.as_ref().and_then(moments::named);
    if let Some(span) = named.or_else(|| action.effect.as_ref().and_then(moments::named_by)) {
        let message = "`at start`, `at end` and `over all` stand in a :durative-action only";
        let hint = "in an :action, conditions hold before it and effects happen at once; leave them out";
        resolver.report.error_with(span, message, hint.to_owned());
    }
    let condition = match &action.precondition {
        Some(condition) => resolver.condition(condition, false),
        None => Formula::truth(),
    };
    let effect = match &action.effect {
        Some(effect) => resolver.effect(effect),
        None => Change::And(Vec::new()),
    };
    resolver.scope.clear();
    let body = Body { duration: None, condition, effect };
    let has_locals = !action.locals.is_empty();
    Action { name: action.name.clone(), parameters, span: action.place.0, variables, has_locals, body }
}

fn read_durative_action(action: &ast::DurativeAction, resolver: &mut Resolver<'_, '_, '_>) -> Action {
    let types = &resolver.vocabulary.types;
    let variables = variables(types, &action.parameters, resolver.report);
    let parameters = variables.iter().map(|variable| parameter(variable, types.kind_text(&variable.kind))).collect();
    check_doubles(&variables, resolver.report);
    resolver.scope.clone_from(&variables);
    resolver.durative = true;
    note_typing(&variables, resolver);
    let duration = match &action.duration {
        Some(duration) => {
            note_inequalities(duration, resolver);
            resolver.condition(duration, false)
        }
        None => {
            resolver.report.error(action.name.span(), format!("durative action `{}` has no `:duration`", action.name));
            Formula::truth()
        }
    };
    if let Some(span) = action.condition.as_ref().and_then(moments::unnamed) {
        let message =
            "no moment is named, so this is asked at the start; write (at start …), (over all …) or (at end …)";
        resolver.report.warning(span, message);
    }
    if let Some(span) = action.effect.as_ref().and_then(moments::unnamed_by) {
        let message = "no moment is named, so this happens at the end; write (at start …) or (at end …)";
        resolver.report.warning(span, message);
    }
    let condition = match &action.condition {
        Some(condition) => resolver.condition(condition, false),
        None => Formula::truth(),
    };
    let effect = match &action.effect {
        Some(effect) => resolver.effect(effect),
        None => Change::And(Vec::new()),
    };
    resolver.durative = false;
    resolver.scope.clear();
    let body = Body { duration: Some(duration), condition, effect };
    Action { name: action.name.clone(), parameters, span: action.place.0, variables, has_locals: false, body }
}

/// A parameter of a type other than `object` uses types.
fn note_typing(variables: &[Variable], resolver: &mut Resolver<'_, '_, '_>) {
    let is_typed = |kind: &TypeSet| kind.as_ref() != [OBJECT];
    if let Some(typed) = variables.iter().find(|variable| is_typed(&variable.kind)) {
        resolver.uses.note(Feature::Typing, typed.name.span());
    }
}

/// `:duration` other than one `(= ?duration …)`, and what it says of the end.
fn note_inequalities(duration: &ast::Condition, resolver: &mut Resolver<'_, '_, '_>) {
    let mut todo = vec![duration];
    while let Some(part) = todo.pop() {
        match &part.kind {
            ast::ConditionKind::And(parts) => todo.extend(parts.iter().rev()),
            ast::ConditionKind::Timed(ast::Moment::Start, _) => {}
            ast::ConditionKind::Timed(..) => resolver.uses.note(Feature::DurationsAtEnd, part.place.0),
            _ => {}
        }
    }
    let mut duration = duration;
    while let ast::ConditionKind::Timed(_, inner) = &duration.kind {
        duration = inner;
    }
    if !matches!(duration.kind, ast::ConditionKind::Comparison(ast::Comparator::Equal, ..)) {
        resolver.uses.note(Feature::DurationInequalities, duration.place.0);
    }
}

fn read_rule(rule: &ast::Derived, resolver: &mut Resolver<'_, '_, '_>) -> Option<Rule> {
    let name = &rule.head.name;
    resolver.uses.note(Feature::DerivedPredicates, name.span());
    let variables = variables(&resolver.vocabulary.types, &rule.head.parameters, resolver.report);
    let arguments = variables.iter().map(|variable| ast::Term::Variable(variable.name.clone())).collect();
    check_doubles(&variables, resolver.report);
    resolver.scope.clone_from(&variables);
    let head = resolver.fact(&ast::Atom { name: name.clone(), arguments, place: ast::Place(name.span()) });
    let condition = resolver.condition(&rule.condition, false);
    resolver.scope.clear();
    resolver.vocabulary.predicates.get(head.predicate)?;
    Some(Rule { predicate: head.predicate, variables, condition })
}
