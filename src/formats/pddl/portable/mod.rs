//! Names that every planner understands, and the way back.
//!
//! FF drops characters it does not know, so that objects `1a` and `2a` both become
//! `A`; other planners stop at a dot. What is sent has only names `[a-z][a-z0-9_-]*`.
//! Names that are that already, but for case, stay; others get a name of their own. What some planners do not
//! read is written as all do: a function without arguments has its brackets, what is false at the
//! beginning is left out, and a number below zero is `-5`, not `(- 5)`.
//! The plan comes back in the spelling of the domain and the problem; where they
//! differ, the problem's wins.

mod alike;
mod costs;
mod durative;
mod either;
pub(crate) mod moments;
mod names;
mod rewrite;

use std::borrow::Cow;
use std::collections::HashMap;
use std::sync::atomic::AtomicBool;

use crate::formats::pddl::ast::{Domain, Expression, Init, Operator, Problem};
use crate::formats::plan::Action;
use alike::is_alike;
use names::Names;

/// A task as it is sent, and the way back.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Sent {
    /// The domain's text.
    pub domain: String,
    /// The problem's text.
    pub problem: String,
    actions: HashMap<String, String>,
    objects: HashMap<String, String>,
}

/// Writes a task in names that every planner understands. Of the requirements only those
/// in `known` are written, where that is given; keywords count without regard to case.
#[must_use]
pub fn send(domain: &Domain, problem: &Problem, known: Option<&[&str]>) -> Sent {
    // What is never interrupted is always written.
    try_send(domain, problem, known, &AtomicBool::new(false)).unwrap_or_default()
}

/// As [`send`]; nothing where `interrupted` becomes true before it is done.
pub(crate) fn try_send(
    domain: &Domain,
    problem: &Problem,
    known: Option<&[&str]>,
    interrupted: &AtomicBool,
) -> Option<Sent> {
    let mut names = Names::new(domain, problem, known);
    let domain_text = rewrite::domain(&mut names, domain, interrupted)?;
    let problem_text = rewrite::problem(&mut names, with_plain_init(problem).as_ref(), interrupted)?;
    let actions = domain.actions.iter().map(|action| &action.name);
    let actions = actions.chain(domain.durative_actions.iter().map(|action| &action.name));
    let constants = domain.constants.iter().map(|constant| &constant.name);
    let objects = constants.chain(problem.objects.iter().map(|object| &object.name));
    let back = |name: &str| (names.sent(name), name.to_owned());
    Some(Sent {
        actions: actions.map(|name| back(name.as_str())).collect(),
        objects: objects.map(|name| back(name.as_str())).collect(),
        domain: domain_text,
        problem: problem_text,
    })
}

/// The task without `(either t u)`, with one supertype for each type, and with durative actions that are lists of moments:
/// some planners read no other form.
#[must_use]
pub fn simplified<'t>(domain: &'t Domain, problem: &'t Problem) -> (Cow<'t, Domain>, Cow<'t, Problem>) {
    let (domain, problem) = match either::single(domain, problem) {
        Some((domain, problem)) => (Cow::Owned(domain), Cow::Owned(problem)),
        None => (Cow::Borrowed(domain), Cow::Borrowed(problem)),
    };
    match durative::simple(&domain) {
        Some(simple) => (Cow::Owned(simple), problem),
        None => (domain, problem),
    }
}

/// As [`try_send`], without the costs of actions. Only for a task that has no other numbers.
pub(crate) fn try_send_without_costs(
    domain: &Domain,
    problem: &Problem,
    known: Option<&[&str]>,
    interrupted: &AtomicBool,
) -> Option<Sent> {
    try_send(&costs::domain(domain), &costs::problem(problem), known, interrupted)
}

impl Sent {
    /// Whether it differs from the texts of a task only in white space, comments, letter case and how often types are named,
    /// so that a planner which does not tell letter cases apart reads the same.
    pub(crate) fn reads_as(&self, domain: &str, problem: &str) -> bool {
        is_alike(&self.domain, domain) && is_alike(&self.problem, problem)
    }

    /// An action of the planner's in the task's own spelling. A name that was never sent
    /// stays as it is.
    #[must_use]
    pub fn restore(&self, action: &Action) -> Action {
        let back = |names: &HashMap<String, String>, name: &String| {
            names.get(&name.to_ascii_lowercase()).cloned().unwrap_or_else(|| name.clone())
        };
        Action {
            name: back(&self.actions, &action.name),
            arguments: action.arguments.iter().map(|argument| back(&self.objects, argument)).collect(),
            start: action.start,
            duration: action.duration,
            line: action.line,
        }
    }
}

/// The problem whose initial state lists what is there, and numbers: without the facts of which it says that they are not
/// there, as if others were.
fn with_plain_init(problem: &Problem) -> Cow<'_, Problem> {
    let is_plain = |fact: &Init| match fact {
        Init::Not(_) => false,
        Init::Value(_, value) => !matches!(value, Expression::Operation(..)),
        Init::Atom(_) | Init::At(..) => true,
    };
    if problem.init.iter().all(is_plain) {
        return Cow::Borrowed(problem);
    }
    let plain = |fact: &Init| match fact {
        Init::Not(_) => None,
        Init::Value(target, value) => Some(Init::Value(target.clone(), computed(value))),
        other => Some(other.clone()),
    };
    Cow::Owned(Problem {
        name: problem.name.clone(),
        domain: problem.domain.clone(),
        requirements: problem.requirements.clone(),
        objects: problem.objects.clone(),
        init: problem.init.iter().filter_map(plain).collect(),
        goal: problem.goal.clone(),
        constraints: problem.constraints.clone(),
        metric: problem.metric.clone(),
        length: problem.length.clone(),
        place: problem.place,
    })
}

/// The number that `(- NUMBER)` is; anything else as it is.
fn computed(value: &Expression) -> Expression {
    if let Expression::Operation(Operator::Subtract, operands, place) = value
        && let [only] = operands.as_slice()
        && let Expression::Number(number, _) = computed(only)
    {
        return Expression::Number(-number, *place);
    }
    value.clone()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::Source;
    use crate::formats::pddl::{Dialect, read_domain, read_problem};

    fn task(domain: &str, problem: &str) -> (Domain, Problem) {
        let domain = read_domain(&Source::new("d", domain), Dialect::default()).unwrap();
        (domain, read_problem(&Source::new("p", problem), Dialect::default()).unwrap())
    }

    const DOMAIN: &str = "(define (domain nm) (:requirements :strips :typing :action-costs) (:types t)
        (:constants Base - t) (:predicates (p ?x - t) (q ?x - t))
        (:action Go-To :parameters (?X - t) :precondition (p ?X) :effect (q ?X)))";

    #[test]
    fn distinct_names_stay_distinct() {
        let (domain, problem) = task(
            DOMAIN,
            "(define (problem n) (:domain nm) (:objects r1a x.y x_y G-h - t) (:init (p x.y)) (:goal (q x_y)))",
        );
        let sent = send(&domain, &problem, None);
        assert!(sent.problem.contains("(p x_y-2)") && sent.problem.contains("(q x_y)"), "{}", sent.problem);
        assert!(sent.problem.contains("g-h"), "{}", sent.problem);
    }

    #[test]
    fn only_the_case_of_ascii_letters_is_no_difference() {
        let text = "(define (problem n) (:domain nm) (:objects \u{c9} \u{e9} \u{212a} k - t) (:init (p \u{c9})) (:goal (q k)))";
        let (domain, problem) = task(DOMAIN, text);
        let sent = send(&domain, &problem, None);
        assert!(sent.problem.contains("(:objects n n-2 n-3 k - t)"), "{}", sent.problem);
        let arguments = ["N", "n-2", "n-3", "K"].map(str::to_owned).to_vec();
        let action = Action { name: "go-to".to_owned(), arguments, start: None, duration: None, line: 1 };
        assert_eq!(sent.restore(&action).arguments, ["\u{c9}", "\u{e9}", "\u{212a}", "k"]);
    }

    #[test]
    fn a_plan_comes_back_in_the_tasks_spelling() {
        let (domain, problem) =
            task(DOMAIN, "(define (problem n) (:domain nm) (:objects x.y G-h - t) (:init) (:goal (q G-h)))");
        let sent = send(&domain, &problem, None);
        let action = |name: &str, argument: &str| Action {
            name: name.to_owned(),
            arguments: vec![argument.to_owned()],
            start: None,
            duration: None,
            line: 1,
        };
        let step = sent.restore(&action("GO-TO", "G-H"));
        assert_eq!((step.name.as_str(), step.arguments[0].as_str()), ("Go-To", "G-h"));
        assert_eq!(sent.restore(&action("go-to", "x_y")).arguments, ["x.y"]);
        assert_eq!(sent.restore(&action("go-to", "BASE")).arguments, ["Base"]);
        assert_eq!(sent.restore(&action("go-to", "NEVER")).arguments, ["NEVER"]);
    }

    #[test]
    fn unknown_requirements_are_dropped() {
        let (domain, problem) = task(DOMAIN, "(define (problem n) (:domain nm) (:init) (:goal (and)))");
        let sent = send(&domain, &problem, Some(&[":strips", ":typing"]));
        assert!(sent.domain.contains("(:requirements :strips :typing)"), "{}", sent.domain);
        let sent = send(&domain, &problem, Some(&[":none"]));
        assert!(sent.domain.contains("(:requirements :strips)"), "{}", sent.domain);
    }

    #[test]
    fn numbers_stay_numbers_and_names_of_digits_become_names() {
        let (domain, problem) = task(
            "(define (domain d) (:requirements :timed-initial-literals :fluents) (:predicates (at ?x) (open))
               (:functions (f ?x)) (:action reach-goal :parameters (?a) :effect (increase (f ?a) 2)))",
            "(define (problem n) (:domain d) (:objects 1a 7up) (:init (at 5 (open)) (= (f 1a) 5) (at 7up)) (:goal (open)))",
        );
        let sent = send(&domain, &problem, None);
        assert!(!sent.problem.contains("1a 7up"), "{}", sent.problem);
        assert!(sent.problem.contains("(at 5 (open))") && sent.problem.contains("(= (f n1a) 5)"), "{}", sent.problem);
        assert!(sent.domain.contains("(:action reach-goal-2") && sent.domain.contains("(increase (f ?a) 2)"));
    }

    #[test]
    fn a_type_that_is_called_number_is_not_the_one_of_functions() {
        let (domain, problem) = task(
            "(define (domain d) (:requirements :typing :fluents) (:types number place) (:predicates (near ?n - number))
               (:functions (f ?n - number) - number) (:action a :parameters (?n - number) :effect (near ?n)))",
            "(define (problem n) (:domain d) (:objects one - number) (:init (= (f one) 5)) (:goal (near one)))",
        );
        let sent = send(&domain, &problem, None);
        assert!(
            sent.domain.contains("number-2 place") && sent.domain.contains("(f ?n - number-2) - number"),
            "{}",
            sent.domain
        );
        assert!(sent.problem.contains("one - number-2"), "{}", sent.problem);
    }

    #[test]
    fn what_some_planners_do_not_read_is_written_as_all_do() {
        let (domain, problem) = task(
            "(define (domain d) (:requirements :fluents) (:predicates (p) (q)) (:functions (used) (unused))
               (:action a :parameters () :precondition (< used 5) :effect (and (p) (increase Used (+ used 1)))))",
            "(define (problem n) (:domain d) (:objects unused) (:init (not (p)) (q) (= used 0)) (:goal (p)) (:metric minimize used))",
        );
        let sent = send(&domain, &problem, None);
        assert!(
            sent.domain.contains("(< (used) 5)") && sent.domain.contains("(increase (used) (+ (used) 1))"),
            "{}",
            sent.domain
        );
        assert!(sent.problem.contains("(= (used) 0)") && sent.problem.contains("minimize (used)"), "{}", sent.problem);
        assert!(!sent.problem.contains("not"), "{}", sent.problem);
        assert!(sent.problem.contains("(q)") && sent.problem.contains(":objects unused"), "{}", sent.problem);
    }

    #[test]
    fn a_number_below_zero_is_written_as_one_word() {
        let (domain, problem) = task(
            "(define (domain d) (:requirements :fluents) (:predicates (p)) (:functions (f) (g) (h))
               (:action a :parameters () :precondition (< (f) 0) :effect (p)))",
            "(define (problem n) (:domain d) (:init (= (f) (- 5)) (= (g) (- (- 2.5))) (= (h) -1)) (:goal (p)))",
        );
        let sent = send(&domain, &problem, None);
        for value in ["(= (f) -5)", "(= (g) 2.5)", "(= (h) -1)"] {
            assert!(sent.problem.contains(value), "{}", sent.problem);
        }
    }

    #[test]
    fn a_function_may_be_called_as_anything_else_is() {
        let (domain, problem) = task(
            "(define (domain d) (:requirements :typing :fluents) (:types fuel place) (:predicates (p))
               (:functions (fuel) (used) (minimize))
               (:action a :parameters (?x - place) :precondition (and (>= fuel 1) (< USED 3)) :effect (decrease fuel 1)))",
            "(define (problem n) (:domain d) (:objects used - place) (:init (= (used) 0)) (:goal (p))
               (:metric minimize (+ minimize total-time)))",
        );
        let sent = send(&domain, &problem, None);
        assert!(sent.domain.contains("(>= (fuel) 1)") && sent.domain.contains("(< (used) 3)"), "{}", sent.domain);
        assert!(sent.domain.contains("(decrease (fuel) 1)") && sent.domain.contains("fuel place"), "{}", sent.domain);
        assert!(sent.problem.contains("(:metric minimize (+ (minimize) (total-time)))"), "{}", sent.problem);
    }

    #[test]
    fn a_long_task_is_rewritten_as_a_short_one() {
        let objects: Vec<String> = (0..40_000).map(|number| format!("Ob.{number} x{number}")).collect();
        let text =
            format!("(define (problem n) (:domain nm) (:objects {} - t) (:init) (:goal (q x7)))", objects.join(" "));
        let (domain, problem) = task(DOMAIN, &text);
        let sent = send(&domain, &problem, None);
        assert!(sent.problem.len() > 4 * rewrite::PIECE);
        let (_, read) = task(&sent.domain, &sent.problem);
        let names: Vec<String> = (0..40_000).map(|number| format!("ob_{number} x{number}")).collect();
        let read: Vec<&str> = read.objects.iter().map(|object| object.name.as_str()).collect();
        assert_eq!(read.join(" "), names.join(" "));
    }

    #[test]
    fn what_is_written_in_the_same_words_reads_as_the_task_does() {
        let text = "(define (problem n) (:domain nm) ; a comment\n (:objects X Y - t) (:init (P X)) (:goal (q Y)))";
        let (domain, problem) = task(DOMAIN, text);
        let sent = send(&domain, &problem, None);
        assert!(sent.reads_as(DOMAIN, text), "{}", sent.problem);
        assert!(sent.reads_as(DOMAIN, &text.replace("X Y - t", "X - t Y - T")), "{}", sent.problem);
        assert!(!sent.reads_as(DOMAIN, &text.replace("X Y - t", "X Y")), "{}", sent.problem);
        for other in [text.replace("(P X)", "(P Y)"), text.replace("(P X)", "(P X) (P Y)"), text.replace("))", ")")] {
            assert!(!sent.reads_as(DOMAIN, &other), "{other}");
        }
        let (domain, problem) = task(DOMAIN, &text.replace('X', "x.y"));
        assert!(!send(&domain, &problem, None).reads_as(DOMAIN, &text.replace('X', "x.y")));
    }

    #[test]
    fn writing_ends_when_it_is_interrupted() {
        let objects: Vec<String> = (0..40_000).map(|number| format!("x{number}")).collect();
        let text =
            format!("(define (problem n) (:domain nm) (:objects {} - t) (:init) (:goal (q x7)))", objects.join(" "));
        let (domain, problem) = task(DOMAIN, &text);
        assert_eq!(try_send(&domain, &problem, None, &AtomicBool::new(true)), None);
        assert!(try_send(&domain, &problem, None, &AtomicBool::new(false)).is_some());
    }

    #[test]
    fn costs_are_left_out_with_all_that_is_about_them() {
        let (domain, problem) = task(
            "(define (domain d) (:requirements :strips :action-costs) (:predicates (p) (q ?x))
               (:functions (total-cost) - number (price ?x))
               (:action a :parameters (?x) :effect (and (p) (increase (total-cost) (price ?x))))
               (:action b :parameters () :effect (increase (total-cost) 1))
               (:action c :parameters () :effect (forall (?x) (when (q ?x) (and (not (q ?x)) (increase (total-cost) 2))))))",
            "(define (problem n) (:domain d) (:objects o) (:init (= (total-cost) 0) (= (price o) 3)) (:goal (p))
               (:metric minimize (total-cost)))",
        );
        let sent = try_send_without_costs(&domain, &problem, None, &AtomicBool::new(false)).unwrap();
        for word in ["cost", "price", "increase", "metric", "functions"] {
            assert!(!sent.domain.contains(word) && !sent.problem.contains(word), "{word}: {sent:?}");
        }
        let (read, _) = task(&sent.domain, &sent.problem);
        assert_eq!((read.actions.len(), read.actions[1].effect.is_none()), (3, true), "{}", sent.domain);
        assert!(sent.domain.contains("(when (q ?x)"), "{}", sent.domain);
    }

    #[test]
    fn what_is_sent_reads_back() {
        let (domain, problem) = task(
            DOMAIN,
            "(define (problem n) (:domain nm) (:objects x.y G-h - t) (:init (p x.y)) (:goal (not (q G-h))))",
        );
        let sent = send(&domain, &problem, None);
        let _ = task(&sent.domain, &sent.problem);
    }
}
