//! A task without `(either t u)`, for planners that read only one type of a thing.
//!
//! A variable of several types is one of type `object`, and a predicate that no action changes says of which objects it may
//! stand. The same is done for a type that has subtypes by way of a second supertype: planners know one.

use std::collections::{HashMap, HashSet};

use crate::formats::Span;
use crate::formats::pddl::ast::{
    Atom, Condition, ConditionKind, Domain, Effect, EffectKind, Init, Modal, Moment, Name, Place, Problem, Signature,
    Term, Type, Typed,
};

/// The type that all objects have.
const OBJECT: &str = "object";

/// The task with one type for each thing; nothing where it is that already.
pub(super) fn single(domain: &Domain, problem: &Problem) -> Option<(Domain, Problem)> {
    let kinds = Kinds::new(&domain.types);
    let mut is_single = kinds.is_tree();
    let mut look =
        |list: &[Typed]| is_single &= !list.iter().any(|typed| typed.kind.as_ref().is_some_and(|kind| kind.len() > 1));
    lists(domain, problem, &mut look);
    if is_single {
        return None;
    }
    let mut writer = Writer::new(kinds, domain);
    let (mut written, mut instance) = (writer.domain(domain), writer.problem(problem));
    for (kind, guard) in &writer.guards {
        written.predicates.push(Signature { name: guard.clone(), parameters: vec![variable("?x", None)] });
        for object in domain.constants.iter().chain(&problem.objects) {
            if writer.kinds.fits(&names(object.kind.as_ref()), kind) {
                instance.init.push(Init::Atom(atom(guard, Term::Name(object.name.clone()))));
            }
        }
    }
    Some((written, instance))
}

/// Calls `each` with every list of things and variables of a task.
fn lists(domain: &Domain, problem: &Problem, each: &mut dyn FnMut(&[Typed])) {
    each(&domain.constants);
    each(&problem.objects);
    let heads = domain.predicates.iter().chain(domain.functions.iter().map(|function| &function.signature));
    heads.for_each(|head| each(&head.parameters));
    for derived in &domain.derived {
        each(&derived.head.parameters);
        lists_of_condition(&derived.condition, each);
    }
    for action in &domain.actions {
        each(&action.parameters);
        each(&action.locals);
        action.precondition.iter().for_each(|condition| lists_of_condition(condition, each));
        action.effect.iter().for_each(|effect| lists_of_effect(effect, each));
    }
    for action in &domain.durative_actions {
        each(&action.parameters);
        action.condition.iter().for_each(|condition| lists_of_condition(condition, each));
        action.effect.iter().for_each(|effect| lists_of_effect(effect, each));
    }
    let conditions = domain.constraints.iter().chain(&problem.constraints).chain(&problem.goal);
    conditions.for_each(|condition| lists_of_condition(condition, each));
}

fn lists_of_condition(condition: &Condition, each: &mut dyn FnMut(&[Typed])) {
    match &condition.kind {
        ConditionKind::Forall(list, inner) | ConditionKind::Exists(list, inner) => {
            each(list);
            lists_of_condition(inner, each);
        }
        ConditionKind::And(parts) | ConditionKind::Or(parts) | ConditionKind::Modal(_, _, parts) => {
            parts.iter().for_each(|part| lists_of_condition(part, each));
        }
        ConditionKind::Imply(left, right) => {
            lists_of_condition(left, each);
            lists_of_condition(right, each);
        }
        ConditionKind::Not(inner) | ConditionKind::Timed(_, inner) | ConditionKind::Preference(_, inner) => {
            lists_of_condition(inner, each);
        }
        ConditionKind::Atom(_) | ConditionKind::Comparison(..) => {}
    }
}

fn lists_of_effect(effect: &Effect, each: &mut dyn FnMut(&[Typed])) {
    match &effect.kind {
        EffectKind::Forall(list, inner) => {
            each(list);
            lists_of_effect(inner, each);
        }
        EffectKind::When(condition, inner) => {
            lists_of_condition(condition, each);
            lists_of_effect(inner, each);
        }
        EffectKind::And(parts) => parts.iter().for_each(|part| lists_of_effect(part, each)),
        EffectKind::Timed(_, inner) => lists_of_effect(inner, each),
        EffectKind::Add(_) | EffectKind::Delete(_) | EffectKind::Assign(..) => {}
    }
}

/// The types of a domain, in lower case.
struct Kinds {
    /// What each belongs to directly.
    parents: HashMap<String, Vec<String>>,
}

impl Kinds {
    fn new(types: &[Typed]) -> Self {
        let mut parents: HashMap<String, Vec<String>> = HashMap::new();
        for typed in types {
            let above = parents.entry(typed.name.as_str().to_ascii_lowercase()).or_default();
            for parent in typed.kind.iter().flat_map(|kind| kind.iter()).map(|name| name.as_str().to_ascii_lowercase())
            {
                if parent != OBJECT && !above.contains(&parent) {
                    above.push(parent);
                }
            }
        }
        Self { parents }
    }

    /// Whether each type has one supertype at most.
    fn is_tree(&self) -> bool {
        self.parents.values().all(|above| above.len() < 2)
    }

    /// The first supertype of a type, the one that is sent.
    fn first(&self, kind: &str) -> Option<&String> {
        self.parents.get(kind)?.first()
    }

    /// Whether everything of a type is of another one, by way of all supertypes or of the first ones.
    fn is_below(&self, kind: &str, other: &str, by_all: bool) -> bool {
        let (mut seen, mut pending) = (HashSet::new(), vec![kind]);
        while let Some(kind) = pending.pop() {
            if kind == other || other == OBJECT {
                return true;
            }
            if seen.insert(kind) {
                let above = self.parents.get(kind).map_or(&[][..], Vec::as_slice);
                pending.extend(above.iter().take(if by_all { usize::MAX } else { 1 }).map(String::as_str));
            }
        }
        false
    }

    /// Whether everything of one kind is of another.
    fn fits(&self, given: &[String], wanted: &[String]) -> bool {
        given.iter().all(|given| wanted.iter().any(|wanted| self.is_below(given, wanted, true)))
    }

    /// Whether the first supertypes say all that there is of a kind.
    fn is_single(&self, kind: &[String]) -> bool {
        let [kind] = kind else { return kind.is_empty() };
        let is_told = |below: &String| !self.is_below(below, kind, true) || self.is_below(below, kind, false);
        kind == OBJECT || self.parents.keys().all(is_told)
    }
}

/// What is written after a dash, in lower case.
fn names(kind: Option<&Type>) -> Vec<String> {
    match kind {
        Some(kind) => kind.iter().map(|name| name.as_str().to_ascii_lowercase()).collect(),
        None => vec![OBJECT.to_owned()],
    }
}

fn variable(name: &str, kind: Option<Type>) -> Typed {
    Typed { name: Name::from(name), kind }
}

fn atom(name: &Name, term: Term) -> Atom {
    Atom { name: name.clone(), arguments: vec![term], place: Place(Span::default()) }
}

fn condition(kind: ConditionKind) -> Condition {
    Condition { kind, place: Place(Span::default()) }
}

/// Writes the parts of a task with one type for each thing.
struct Writer {
    kinds: Kinds,
    /// The predicates that stand for kinds.
    guards: Vec<(Vec<String>, Name)>,
    taken: HashSet<String>,
}

impl Writer {
    fn new(kinds: Kinds, domain: &Domain) -> Self {
        let heads = domain.predicates.iter().chain(domain.derived.iter().map(|derived| &derived.head));
        let heads = heads.chain(domain.functions.iter().map(|function| &function.signature));
        let taken = heads.map(|head| head.name.as_str().to_ascii_lowercase()).collect();
        Self { kinds, guards: Vec::new(), taken }
    }

    fn domain(&mut self, domain: &Domain) -> Domain {
        let mut domain = domain.clone();
        domain.types = self.types(&domain.types);
        domain.constants = self.things(&domain.constants);
        for head in &mut domain.predicates {
            head.parameters = self.variables(&head.parameters).0;
        }
        for function in &mut domain.functions {
            function.signature.parameters = self.variables(&function.signature.parameters).0;
        }
        domain.constraints = domain.constraints.as_ref().map(|constraints| self.condition(constraints));
        for derived in &mut domain.derived {
            let (parameters, guards) = self.variables(&derived.head.parameters);
            derived.head.parameters = parameters;
            derived.condition = all(guards, self.condition(&derived.condition));
        }
        for action in &mut domain.actions {
            let (parameters, mut guards) = self.variables(&action.parameters);
            let (locals, more) = self.variables(&action.locals);
            guards.extend(more);
            (action.parameters, action.locals) = (parameters, locals);
            action.precondition = self.guarded(guards, action.precondition.as_ref());
            action.effect = action.effect.as_ref().map(|effect| self.effect(effect));
        }
        for action in &mut domain.durative_actions {
            let (parameters, guards) = self.variables(&action.parameters);
            action.parameters = parameters;
            let timed = |guard| condition(ConditionKind::Timed(Moment::Start, Box::new(guard)));
            action.condition = self.guarded(guards.into_iter().map(timed).collect(), action.condition.as_ref());
            action.effect = action.effect.as_ref().map(|effect| self.effect(effect));
        }
        domain
    }

    fn problem(&mut self, problem: &Problem) -> Problem {
        let mut problem = problem.clone();
        problem.objects = self.things(&problem.objects);
        problem.goal = problem.goal.as_ref().map(|goal| self.condition(goal));
        problem.constraints = problem.constraints.as_ref().map(|constraints| self.condition(constraints));
        problem
    }

    fn guarded(&mut self, guards: Vec<Condition>, part: Option<&Condition>) -> Option<Condition> {
        let part = part.map(|part| self.condition(part));
        if guards.is_empty() {
            return part;
        }
        Some(all(guards, part.unwrap_or_else(|| condition(ConditionKind::And(Vec::new())))))
    }

    /// The types, each with its first supertype.
    fn types(&self, types: &[Typed]) -> Vec<Typed> {
        let (mut written, mut known) = (Vec::new(), HashSet::new());
        for typed in types {
            let name = typed.name.as_str().to_ascii_lowercase();
            let first = self.kinds.first(&name);
            if known.insert(name.clone()) {
                let kind = first.map(|first| [Name::from(first.as_str())].into());
                written.push(Typed { name: typed.name.clone(), kind });
            }
        }
        written
    }

    /// Objects, each with the lowest type that all of its own belong to.
    fn things(&self, things: &[Typed]) -> Vec<Typed> {
        let thing = |typed: &Typed| {
            let kind = names(typed.kind.as_ref());
            if kind.len() < 2 {
                return typed.clone();
            }
            let mut common = kind.first();
            while let Some(above) = common
                && !kind.iter().all(|own| self.kinds.is_below(own, above, false))
            {
                common = self.kinds.first(above);
            }
            Typed { name: typed.name.clone(), kind: common.map(|common| [Name::from(common.as_str())].into()) }
        };
        things.iter().map(thing).collect()
    }

    /// Variables of one type each, and what says of which objects they may stand.
    fn variables(&mut self, variables: &[Typed]) -> (Vec<Typed>, Vec<Condition>) {
        let mut guards = Vec::new();
        let single = |typed: &Typed| {
            let kind = names(typed.kind.as_ref());
            if self.kinds.is_single(&kind) {
                return typed.clone();
            }
            let guard = self.guard(kind);
            guards.push(condition(ConditionKind::Atom(atom(&guard, Term::Variable(typed.name.clone())))));
            variable(typed.name.as_str(), None)
        };
        (variables.iter().map(single).collect(), guards)
    }

    /// The predicate for a kind.
    fn guard(&mut self, kind: Vec<String>) -> Name {
        if let Some((_, guard)) = self.guards.iter().find(|(known, _)| *known == kind) {
            return guard.clone();
        }
        let stem = format!("either-{}", kind.join("-"));
        let mut name = stem.clone();
        let mut number = 1;
        while !self.taken.insert(name.clone()) {
            number += 1;
            name = format!("{stem}-{number}");
        }
        let guard = Name::from(name.as_str());
        self.guards.push((kind, guard.clone()));
        guard
    }

    fn condition(&mut self, whole: &Condition) -> Condition {
        let mut each = |parts: &[Condition]| parts.iter().map(|part| self.condition(part)).collect::<Vec<_>>();
        let kind = match &whole.kind {
            ConditionKind::And(parts) => ConditionKind::And(each(parts)),
            ConditionKind::Or(parts) => ConditionKind::Or(each(parts)),
            ConditionKind::Modal(modal, numbers, parts) => ConditionKind::Modal(*modal, numbers.clone(), each(parts)),
            ConditionKind::Not(inner) => ConditionKind::Not(Box::new(self.condition(inner))),
            ConditionKind::Imply(left, right) => {
                ConditionKind::Imply(Box::new(self.condition(left)), Box::new(self.condition(right)))
            }
            ConditionKind::Timed(moment, inner) => ConditionKind::Timed(*moment, Box::new(self.condition(inner))),
            ConditionKind::Preference(name, inner) => {
                ConditionKind::Preference(name.clone(), Box::new(self.condition(inner)))
            }
            ConditionKind::Forall(variables, inner) => {
                let (variables, guards) = self.variables(variables);
                let inner = self.condition(inner);
                ConditionKind::Forall(variables, Box::new(where_all(&guards, inner)))
            }
            ConditionKind::Exists(variables, inner) => {
                let (variables, guards) = self.variables(variables);
                let inner = self.condition(inner);
                ConditionKind::Exists(variables, Box::new(all(guards, inner)))
            }
            other @ (ConditionKind::Atom(_) | ConditionKind::Comparison(..)) => other.clone(),
        };
        Condition { kind, place: whole.place }
    }

    fn effect(&mut self, whole: &Effect) -> Effect {
        let kind = match &whole.kind {
            EffectKind::And(parts) => EffectKind::And(parts.iter().map(|part| self.effect(part)).collect()),
            EffectKind::When(condition, inner) => {
                EffectKind::When(Box::new(self.condition(condition)), Box::new(self.effect(inner)))
            }
            EffectKind::Timed(moment, inner) => EffectKind::Timed(*moment, Box::new(self.effect(inner))),
            EffectKind::Forall(variables, inner) => {
                let (variables, guards) = self.variables(variables);
                let inner = self.effect(inner);
                EffectKind::Forall(variables, Box::new(when_all(&guards, inner)))
            }
            other => other.clone(),
        };
        Effect { kind, place: whole.place }
    }
}

/// All of these, and one more. The conditions of durative actions are one list.
fn all(mut guards: Vec<Condition>, part: Condition) -> Condition {
    if guards.is_empty() {
        return part;
    }
    match part.kind {
        ConditionKind::And(parts) => guards.extend(parts),
        _ => guards.push(part),
    }
    condition(ConditionKind::And(guards))
}

/// A condition that is asked for only where the guards hold.
fn where_all(guards: &[Condition], part: Condition) -> Condition {
    if guards.is_empty() {
        return part;
    }
    let place = part.place;
    let inner = |inner: Box<Condition>| Box::new(where_all(guards, *inner));
    let each = |parts: Vec<Condition>| parts.into_iter().map(|part| where_all(guards, part)).collect();
    let kind = match part.kind {
        ConditionKind::And(parts) => ConditionKind::And(each(parts)),
        ConditionKind::Timed(moment, timed) => ConditionKind::Timed(moment, inner(timed)),
        ConditionKind::Preference(name, preferred) => ConditionKind::Preference(name, inner(preferred)),
        ConditionKind::Forall(variables, of_all) => ConditionKind::Forall(variables, inner(of_all)),
        // The first of these is what the others are asked for after or before.
        ConditionKind::Modal(
            modal @ (Modal::AtMostOnce | Modal::SometimeAfter | Modal::SometimeBefore | Modal::AlwaysWithin),
            numbers,
            parts,
        ) => {
            let mut parts = parts.into_iter();
            let first = parts.next().map(|first| all(guards.to_vec(), first));
            ConditionKind::Modal(modal, numbers, first.into_iter().chain(parts).collect())
        }
        ConditionKind::Modal(modal, numbers, parts) => ConditionKind::Modal(modal, numbers, each(parts)),
        kind => {
            let part = Condition { kind, place };
            let guard = condition(ConditionKind::And(guards.to_vec()));
            ConditionKind::Imply(Box::new(guard), Box::new(part))
        }
    };
    Condition { kind, place }
}

/// An effect that happens only where the guards hold.
fn when_all(guards: &[Condition], part: Effect) -> Effect {
    if guards.is_empty() {
        return part;
    }
    let place = part.place;
    let kind = match part.kind {
        EffectKind::And(parts) => EffectKind::And(parts.into_iter().map(|part| when_all(guards, part)).collect()),
        EffectKind::Timed(moment, inner) => EffectKind::Timed(moment, Box::new(when_all(guards, *inner))),
        EffectKind::Forall(variables, inner) => EffectKind::Forall(variables, Box::new(when_all(guards, *inner))),
        EffectKind::When(wanted, inner) => {
            let wanted = match wanted.kind {
                ConditionKind::Timed(moment, timed) => {
                    condition(ConditionKind::Timed(moment, Box::new(all(guards.to_vec(), *timed))))
                }
                _ => all(guards.to_vec(), *wanted),
            };
            EffectKind::When(Box::new(wanted), inner)
        }
        kind => {
            let guard = condition(ConditionKind::And(guards.to_vec()));
            EffectKind::When(Box::new(guard), Box::new(Effect { kind, place }))
        }
    };
    Effect { kind, place }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::Source;
    use crate::formats::pddl::{Dialect, read_domain, read_problem};

    fn written(types: &str, actions: &str, objects: &str, goal: &str) -> Option<(String, String)> {
        let domain = format!(
            "(define (domain d) (:requirements :adl) (:types {types}) (:predicates (p ?x - object) (q)) {actions})"
        );
        let problem = format!("(define (problem r) (:domain d) (:objects {objects}) (:init (q)) (:goal {goal}))");
        let domain = read_domain(&Source::new("d", domain), Dialect::default()).unwrap();
        let problem = read_problem(&Source::new("p", problem), Dialect::default()).unwrap();
        let (domain, problem) = single(&domain, &problem)?;
        let plain = |text: String| text.split_whitespace().collect::<Vec<_>>().join(" ");
        Some((plain(domain.to_string()), plain(problem.to_string())))
    }

    #[test]
    fn a_task_of_single_types_stays() {
        let action = "(:action a :parameters (?x - t) :effect (forall (?y - u) (p ?y)))";
        assert_eq!(written("t u - object v - t", action, "o - t", "(exists (?x - u) (p ?x))"), None);
    }

    #[test]
    fn variables_of_several_types_are_told_by_a_predicate() {
        let action = "(:action a :parameters (?x - (either t u)) :precondition (q) :effect (p ?x))";
        let (domain, problem) =
            written("t u w - object v - u", action, "o - t o2 - v o3 - w", "(exists (?x - (either t u)) (p ?x))")
                .unwrap();
        assert!(domain.contains(":parameters (?x) :precondition (and (either-t-u ?x) (q))"), "{domain}");
        assert!(problem.contains("(exists (?x) (and (either-t-u ?x) (p ?x)))"), "{problem}");
        assert!(problem.contains("(:init (q) (either-t-u o) (either-t-u o2))"), "{problem}");
    }

    #[test]
    fn the_conditions_of_a_durative_action_stay_one_list() {
        let action = "(:durative-action a :parameters (?x - (either t u)) :duration (= ?duration 1)
            :condition (and (at start (q)) (over all (q))) :effect (at end (p ?x)))";
        let (domain, _) = written("t u", action, "o - t", "(q)").unwrap();
        assert!(domain.contains("(and (at start (either-t-u ?x)) (at start (q)) (over all (q)))"), "{domain}");
    }

    #[test]
    fn what_holds_for_all_is_asked_of_those_alone() {
        let action = "(:action a :parameters () :precondition (forall (?x - (either t u)) (p ?x))
            :effect (forall (?x - (either t u)) (and (p ?x) (when (q) (not (p ?x))))))";
        let (domain, _) = written("t u", action, "o - t", "(q)").unwrap();
        assert!(domain.contains("(forall (?x) (imply (and (either-t-u ?x)) (p ?x)))"), "{domain}");
        assert!(domain.contains("(when (and (either-t-u ?x)) (p ?x))"), "{domain}");
        assert!(domain.contains("(when (and (either-t-u ?x) (q)) (not (p ?x)))"), "{domain}");
    }

    #[test]
    fn a_type_of_two_supertypes_is_written_with_the_first() {
        let action = "(:action a :parameters (?x - t ?y - u ?z - v) :effect (p ?x))";
        let (domain, problem) = written("t u v - object w - (either t u)", action, "o - w o2 - v", "(q)").unwrap();
        assert!(domain.contains("(:types t u v - object w - t)"), "{domain}");
        // The first supertype says all of t; v has no subtypes.
        assert!(domain.contains("(?x - t ?y - object ?z - v) :precondition (and (either-u ?y)"), "{domain}");
        assert!(problem.contains("(either-u o)") && !problem.contains("(either-u o2)"), "{problem}");
    }

    #[test]
    fn an_object_of_several_types_is_of_what_they_have_in_common() {
        let (_, problem) = written("t u - s s v", "", "o - (either t u) o2 - (either t v)", "(q)").unwrap();
        assert!(problem.contains("(:objects o - s o2)"), "{problem}");
    }
}
