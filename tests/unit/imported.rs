//! Problems as documents, and the templates that make equal problems of them.

use std::path::Path;

use rmem::formats::Source;
use rmem::formats::pddl::{Dialect, ast, read_problem};
use rmem::memory::Memory;
use rmem::problem::import::import;
use rmem::problem::{Request, Syntax, generate};
use rmem::store::{Embedded, Namespace};

use crate::content::content;

fn namespace() -> Namespace {
    Namespace::parse("lab.imported").unwrap()
}

fn read(name: &str, text: &str) -> ast::Problem {
    read_problem(&Source::new(name, text), Dialect { lenient: true }).unwrap_or_else(|error| panic!("{error}"))
}

/// From PDDL to documents to PDDL.
fn round(name: &str, text: &str) -> String {
    let source = Source::new(name, text);
    let imported = import(&source, read(name, text)).unwrap_or_else(|error| panic!("{error}"));
    let memory = Memory::new(Box::new(Embedded::in_memory().unwrap()), None, Vec::new());
    memory.insert(&namespace(), imported.documents.clone()).unwrap();
    let template = imported.template(&namespace());
    let request = Request {
        template: Source::new("t.j2", template.as_str()),
        parts: Vec::new(),
        syntax: Syntax::Auto,
        collection: namespace(),
        goal: None,
        parameters: Vec::new(),
        lenient: false,
    };
    generate(&request, &memory).unwrap_or_else(|error| panic!("{name}: {error}\n{template}")).text
}

fn assert_same(name: &str, text: &str) {
    let again = round(name, text);
    assert_eq!(content(&read(name, &again)), content(&read(name, text)), "{name}:\n{again}");
}

#[test]
fn the_problems_of_the_tasks_are_made_again() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/tasks");
    let mut count = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path().join("problem.pddl");
        let Ok(text) = std::fs::read_to_string(&path) else { continue };
        assert_same(&path.display().to_string(), &text);
        count += 1;
    }
    assert!(count >= 13, "{count} tasks");
}

#[test]
fn every_part_of_the_language_is_made_again() {
    assert_same(
        "all",
        "(define (problem every-part) (:domain d) (:requirements :adl :preferences)
         (:objects a b - t c d e - (either t u) |x.y| 3rd)
         (:init (p a B) (not (p b a)) (q) (= (f a) 2.5) (= (f b) -3) (= (total) 0) (= (home a) c) (= (g a) (- 4))
                (at 5 (p a a)) (at 7.25 (not (p a a))) (p A b) (far (home a) c))
         (:goal (and (p a b) (or (q) (not (p b b))) (imply (q) (p a a)) (forall (?x - t ?y - (either t u)) (p ?x ?y))
                 (exists (?z) (and)) (preference first (p a b)) (preference (q)) (= a b) (<= (+ (f a) (* 2 (f b))) 10)
                 (> (f a) (- (f b))) (>= 1 2) (< (/ 4 2) (f a)) (= (f a) (- (f b) 1))))
         (:constraints (and (always (q)) (sometime (p a b)) (within 5 (q)) (hold-during 1.5 2 (q)) (always-within 3 (q) (p a a))
                 (at-most-once (q)) (sometime-after (q) (q)) (sometime-before (q) (q)) (hold-after 4 (q)) (at end (q))))
         (:metric minimize (+ (* 2 (total-time)) (is-violated first) total-cost))
         (:length (:serial 3)))",
    );
}

#[test]
fn a_goal_that_is_no_conjunction_stays_one_and_an_empty_one_stays_empty() {
    for goal in ["(p a)", "(and)", "(or (p a) (p b))", "(and (p a))", "(not (p a))"] {
        assert_same(goal, &format!("(define (problem g) (:domain d) (:objects a b) (:init) (:goal {goal}))"));
    }
}

#[test]
fn a_goal_that_is_given_takes_the_place_of_the_problems() {
    let text = "(define (problem g) (:domain d) (:objects a b) (:init (p a)) (:goal (p b)))";
    let source = Source::new("p", text);
    let imported = import(&source, read("p", text)).unwrap();
    let memory = Memory::new(Box::new(Embedded::in_memory().unwrap()), None, Vec::new());
    memory.insert(&namespace(), imported.documents.clone()).unwrap();
    let request = Request {
        template: Source::new("t.j2", imported.template(&namespace())),
        parts: Vec::new(),
        syntax: Syntax::Minijinja,
        collection: namespace(),
        goal: Some("(p a)".to_owned()),
        parameters: Vec::new(),
        lenient: false,
    };
    let made = read("made", &generate(&request, &memory).unwrap().text);
    assert_eq!(made.goal.unwrap().to_string(), "(p a)");
}

#[test]
fn a_name_of_the_domain_that_no_template_writes_is_refused_at_its_place() {
    let text = "(define (problem g) (:domain d) (:objects a)\n (:init (p a x.y)) (:goal (p a a)))";
    let error = import(&Source::new("p", text), read("p", text)).unwrap_err();
    assert_eq!(error.position(), (2, 14), "{error}");
}
