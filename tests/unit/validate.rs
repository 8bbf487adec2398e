//! Domains and problems checked, plans validated.

use std::fs;
use std::path::{Path, PathBuf};

use rmem::formats::Source;
use rmem::formats::pddl::Dialect;
use rmem::pddl::{Domain, Failure, Feature, Problem, Step, Validation, validate};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/pddl").join(name)
}

fn source(name: &str) -> Source {
    Source::new(name, fs::read_to_string(fixture(name)).expect("the fixture"))
}

/// What is wrong with a text, one complaint after the other.
fn complaints<T>(read: Result<T, Vec<rmem::formats::Diagnostic>>) -> String {
    let complaints = read.err().expect("complaints");
    complaints.iter().map(|complaint| format!("{complaint}\n")).collect()
}

fn domain(text: &str) -> Domain {
    Domain::read(&Source::new("d.pddl", text), Dialect::default()).unwrap_or_else(|errors| panic!("{}", errors[0]))
}

fn problem(domain: &Domain, text: &str) -> Problem {
    Problem::read(&Source::new("p.pddl", text), domain, Dialect::default())
        .unwrap_or_else(|errors| panic!("{}", errors[0]))
}

/// The steps of `(a b c)`, `1.5: (a b c) [2]`, one per line.
fn plan(text: &str) -> Vec<Step> {
    let steps = text.lines().map(|line| line.split(';').next().unwrap_or_default()).filter(|line| line.contains('('));
    steps
        .map(|line| {
            let (start, rest) = line.split_once('(').expect("a step");
            let (words, end) = rest.split_once(')').expect("a step");
            let mut words = words.split_whitespace().map(str::to_owned);
            Step {
                action: words.next().expect("an action"),
                arguments: words.collect(),
                start: start.trim().strip_suffix(':').map(|start| start.trim().parse().expect("a time")),
                duration: end.trim().strip_prefix('[').map(|end| end.trim_end_matches(']').parse().expect("a time")),
            }
        })
        .collect()
}

/// The verdict on a plan, by texts.
fn verdict(domain_text: &str, problem_text: &str, plan_text: &str) -> Validation {
    let domain = domain(domain_text);
    let problem = problem(&domain, problem_text);
    validate(&domain, &problem, &plan(plan_text))
}

fn printed(domain_text: &str, problem_text: &str, plan_text: &str) -> String {
    verdict(domain_text, problem_text, plan_text).to_string()
}

fn task(domain_name: &str, problem_name: &str) -> (Domain, Problem) {
    let domain = Domain::read(&source(domain_name), Dialect::default()).expect("a domain");
    let problem = Problem::read(&source(problem_name), &domain, Dialect::default()).expect("a problem");
    (domain, problem)
}

#[test]
fn the_verdicts_are_those_of_val() {
    let (domain, problem) = task("tasks/dom.pddl", "tasks/p_plan.pddl");
    let mut seen = Vec::new();
    for case in ["ok", "upper", "timed", "bad", "empty", "goalnot", "noaction", "type", "undef"] {
        let recorded = fs::read_to_string(fixture(&format!("val/{case}.txt"))).expect("a recording");
        let steps = plan(&fs::read_to_string(fixture(&format!("tasks/plan_{case}.txt"))).expect("a plan"));
        let verdict = validate(&domain, &problem, &steps);
        assert_eq!(verdict.is_valid(), recorded.contains("Plan valid"), "{case}: {verdict}");
        if let Validation::Valid { value: Some(value) } = verdict {
            assert!(recorded.contains(&format!("Final value: {value} ")), "{case}: {value}");
        }
        seen.push(format!("{case}: {verdict}"));
    }
    insta::assert_snapshot!(seen.join("\n"), @r"
    ok: the plan is valid, value 10
    upper: the plan is valid, value 10
    timed: the plan is valid, value 10
    bad: the plan is invalid: step 6: (pick r2 cup k) is not applicable: (at r2 k) is false
    empty: the plan is invalid: the goal is not reached: (in cup b), (in ball b) are false
    goalnot: the plan is invalid: the goal is not reached: (in cup b) is false
    noaction: the plan is invalid: step 1: the domain has no action `fly`
    type: the plan is invalid: step 2: `ball` is of type `object`, but `pick` wants `robot` for `?r`
    undef: the plan is invalid: step 11: action `drop` names `nosuch`, which is not an object
    ");
}

#[test]
fn a_wrong_number_of_arguments_is_said_where_val_crashes() {
    let (domain, problem) = task("tasks/dom.pddl", "tasks/p_plan.pddl");
    let steps = plan(&fs::read_to_string(fixture("tasks/plan_arity.txt")).expect("a plan"));
    let verdict = validate(&domain, &problem, &steps);
    assert_eq!(verdict.to_string(), "the plan is invalid: step 1: action `move` takes 3 arguments, found 2");
}

#[test]
fn a_temporal_plan_is_judged_as_val_does() {
    let (domain, problem) = task("tasks/durdom.pddl", "tasks/durp.pddl");
    let check = |text: &str| validate(&domain, &problem, &plan(text)).to_string();
    assert_eq!(check("0: (go a b) [5]\n5.001: (go b c) [5]"), "the plan is valid, value 10.001");
    assert_eq!(
        check("0: (go a b) [5]\n4.9: (go b c) [5]"),
        "the plan is invalid: step 2: (go b c) is not applicable: (at b) is false"
    );
    assert_eq!(
        check("0: (go a b) [4]\n5.001: (go b c) [5]"),
        "the plan is invalid: step 1: the duration of (go a b) is 4, it must be 5"
    );
    assert_eq!(
        check("0: (go a b) [5]\n5: (go b c) [5]"),
        "the plan is invalid: step 2: (go b c) is not applicable: (at b) is false; the end of step 1, (go a b), makes it \
         true at this very moment, and what needs it has to start later, if only by 0.001"
    );
    assert_eq!(check("0: (go a b) [5]"), "the plan is invalid: the goal is not reached: (at c) is false");
    assert_eq!(
        check("(go a b)"),
        "the plan is invalid: step 1: action `go`: it takes time, but the plan does not say when it begins"
    );
}

#[test]
fn costs_and_numbers_are_added_up() {
    let (domain, problem) = task("tasks/acdom.pddl", "tasks/acp.pddl");
    assert_eq!(validate(&domain, &problem, &plan("(go a b)\n(go b c)")), Validation::Valid { value: Some(4.0) });
    assert_eq!(validate(&domain, &problem, &plan("(GO A C)")), Validation::Valid { value: Some(9.0) });
    let (domain, problem) = task("tasks/ndom.pddl", "tasks/np.pddl");
    let good = "(drive t1 a b)\n(refuel t1)\n(drive t1 b c)";
    assert_eq!(validate(&domain, &problem, &plan(good)), Validation::Valid { value: Some(7.0) });
    let dry = validate(&domain, &problem, &plan("(drive t1 a b)\n(drive t1 b c)")).to_string();
    assert_eq!(
        dry,
        "the plan is invalid: step 2: (drive t1 b c) is not applicable: (>= (fuel t1) (dist b c)) is false"
    );
    let nowhere = validate(&domain, &problem, &plan("(drive t1 c a)")).to_string();
    assert!(nowhere.ends_with("(at t1 c) is false"), "{nowhere}");
}

#[test]
fn conditional_and_universal_effects_look_at_the_state_before() {
    let (domain, problem) = task("tasks/adldom.pddl", "tasks/adlp.pddl");
    let good = "(load b1 r1)\n(go r1 r2)\n(load b2 r2)\n(go r2 r3)\n(unload b1)\n(unload b2)\n(go r3 r2)\n(clean r2)";
    assert_eq!(validate(&domain, &problem, &plan(good)), Validation::Valid { value: Some(8.0) });
    let early = validate(&domain, &problem, &plan("(go r1 r2)\n(clean r2)")).to_string();
    assert_eq!(early, "the plan is invalid: step 2: (clean r2) is not applicable: (not (in b2 r2)) is false");
    let dirty = validate(&domain, &problem, &plan("(go r1 r2)\n(load b2 r2)")).to_string();
    assert_eq!(
        dirty,
        "the plan is invalid: step 2: (load b2 r2) is not applicable: \
         (imply (dirty r2) (exists (?y - box) (loaded ?y))) is false"
    );
    let (domain, problem) = task("tasks/ffbug_dom2.pddl", "tasks/ffbug_p1.pddl");
    let same = "(go r2 r2)\n(clean r2)";
    let verdict = validate(&domain, &problem, &plan(same)).to_string();
    assert!(verdict.ends_with("(not (in b1 r2)) is false"), "adds win over deletes: {verdict}");
}

const SWAP: &str = "(define (domain d) (:predicates (p) (q)) (:functions (x) (y) (z))
    (:action swap :effect (and (when (p) (and (not (p)) (q))) (when (q) (and (not (q)) (p)))))
    (:action exchange :effect (and (assign (x) (y)) (assign (y) (x))))
    (:action twice :effect (and (increase (x) 1) (increase (x) (y)) (scale-up (y) 3)))
    (:action clash :effect (and (assign (x) 1) (increase (x) 1)))
    (:action halve :effect (scale-down (x) (- (y) 2)))
    (:action unset :effect (increase (z) 1)))";

#[test]
fn effects_happen_at_once() {
    let start = "(define (problem t) (:domain d) (:init (p) (= (x) 1) (= (y) 2)) (:goal ";
    let check = |goal: &str, steps: &str| printed(SWAP, &format!("{start}{goal}))"), steps);
    assert_eq!(check("(and (q) (not (p)))", "(swap)"), "the plan is valid, value 1");
    assert_eq!(check("(and (p) (not (q)))", "(swap)\n(swap)"), "the plan is valid, value 2");
    assert_eq!(check("(and (= (x) 2) (= (y) 1))", "(exchange)"), "the plan is valid, value 1");
    assert_eq!(check("(and (= (x) 4) (= (y) 6))", "(twice)"), "the plan is valid, value 1");
    assert_eq!(
        check("(and)", "(clash)"),
        "the plan is invalid: step 1: (clash) is not applicable: (x) is changed in two ways at once"
    );
    assert_eq!(check("(and)", "(halve)"), "the plan is invalid: step 1: (halve) is not applicable: a division by zero");
    assert_eq!(check("(and)", "(unset)"), "the plan is invalid: step 1: (unset) is not applicable: (z) has no value");
    assert_eq!(check("(> (z) 0)", ""), "the plan is invalid: the goal cannot be computed: (z) has no value");
    assert_eq!(
        check("(and (p) (q) (or (q) (> (x) 1)))", ""),
        "the plan is invalid: the goal is not reached: (q), (or (q) (> (x) 1)) are false"
    );
}

#[test]
fn derived_predicates_follow_the_facts() {
    let blocks = "(define (domain d) (:requirements :derived-predicates)
        (:predicates (on ?a ?b) (above ?a ?b) (clear ?a) (lonely ?a))
        (:derived (above ?a ?b) (or (on ?a ?b) (exists (?c) (and (on ?a ?c) (above ?c ?b)))))
        (:derived (clear ?a) (forall (?b) (not (on ?b ?a))))
        (:derived (lonely ?a) (and (clear ?a) (not (exists (?b) (above ?a ?b)))))
        (:action lift :parameters (?a ?b) :precondition (and (clear ?a) (on ?a ?b)) :effect (not (on ?a ?b))))";
    let start = "(define (problem t) (:domain d) (:objects a b c e) (:init (on a b) (on b c) (on c e)) (:goal ";
    let check = |goal: &str, steps: &str| printed(blocks, &format!("{start}{goal}))"), steps);
    assert_eq!(check("(and (above a e) (not (above e a)) (clear a))", ""), "the plan is valid, value 0");
    assert_eq!(
        check("(and (clear b) (lonely a) (above b e) (not (above a e)))", "(lift a b)"),
        "the plan is valid, value 1"
    );
    assert_eq!(
        check("(lonely b)", "(lift b c)"),
        "the plan is invalid: step 1: (lift b c) is not applicable: (clear b) is false"
    );
    for paradox in ["(:derived (p) (not (p)))", "(:derived (p) (not (q))) (:derived (q) (p))"] {
        let text = format!("(define (domain d) (:requirements :derived-predicates) (:predicates (p) (q)) {paradox})");
        let said = complaints(Domain::read(&Source::new("d", text), Dialect::default()));
        assert!(said.contains("`p` depends on its own negation"), "{said}");
    }
}

#[test]
fn quantifiers_range_over_the_objects_of_their_type() {
    let text = "(define (domain d) (:requirements :adl) (:types dog cat - animal animal stone)
        (:constants rex - dog) (:predicates (fed ?a - animal) (seen ?x))
        (:action feed :parameters (?a - (either dog cat)) :effect (fed ?a))
        (:action look :effect (forall (?x) (seen ?x))))";
    let start = "(define (problem t) (:domain d) (:objects tom - cat pebble - stone) (:init) (:goal ";
    let check = |goal: &str, steps: &str| printed(text, &format!("{start}{goal}))"), steps);
    let all = "(forall (?a - animal) (fed ?a))";
    assert_eq!(check(all, "(feed rex)\n(feed tom)"), "the plan is valid, value 2");
    assert_eq!(check(all, "(feed rex)"), "the plan is invalid: the goal is not reached: (fed tom) is false");
    assert_eq!(
        check(all, "(feed pebble)"),
        "the plan is invalid: step 1: `pebble` is of type `stone`, but `feed` wants `(either dog cat)` for `?a`"
    );
    assert_eq!(check("(exists (?x - stone) (seen ?x))", "(look)"), "the plan is valid, value 1");
    assert_eq!(check("(not (= tom rex))", ""), "the plan is valid, value 0");
    assert_eq!(
        check("(and)", "(feed tim)"),
        "the plan is invalid: step 1: action `feed` names `tim`, which is not an object; did you mean `tom`?"
    );
}

#[test]
fn what_is_not_simulated_is_neither_valid_nor_invalid() {
    let unjudged = |domain: &str, problem: &str, plan: &str| {
        let verdict = verdict(domain, problem, plan);
        assert!(matches!(verdict, Validation::Unchecked(_)), "{verdict}");
    };
    let plain = "(define (domain d) (:predicates (p)) (:action a :effect (p)))";
    let nested = "(define (problem t) (:domain d) (:goal (p)) (:constraints (always (sometime (p)))))";
    unjudged(plain, nested, "(a)");
    // What can be simulated is.
    assert_eq!(printed(plain, nested, ""), "the plan is invalid: the goal is not reached: (p) is false");
    let fluents = "(define (domain d) (:types t) (:predicates (p)) (:functions (f) - t)
        (:action a :precondition (= (f) (f)) :effect (p)))";
    unjudged(fluents, "(define (problem t) (:domain d) (:goal (p)))", "(a)");
    let continuous = "(define (domain d) (:predicates (p)) (:functions (x)) (:durative-action a :parameters ()
        :duration (= ?duration 1) :effect (and (at end (p)) (increase (x) (* #t 1)))))";
    unjudged(continuous, "(define (problem t) (:domain d) (:init (= (x) 0)) (:goal (p)))", "0: (a) [1]");
}

#[test]
fn preferences_never_make_a_plan_invalid() {
    let plain = "(define (domain d) (:predicates (p) (q)) (:action a :effect (p)))";
    let goal = "(define (problem t) (:domain d) (:goal (and (p) (preference x (q))))
        (:constraints (preference y (always (q)))) (:metric minimize (is-violated x)))";
    assert_eq!(verdict(plain, goal, "(a)"), Validation::Valid { value: Some(1.0) });
    // A precondition may have one as well, and the metric counts how often the plan goes against it.
    let inner = "(define (domain d) (:predicates (p) (q)) (:action a :precondition (preference z (q)) :effect (p)))";
    let goal = "(define (problem t) (:domain d) (:goal (p)) (:metric minimize (is-violated z)))";
    assert_eq!(verdict(inner, goal, "(a)\n(a)"), Validation::Valid { value: Some(2.0) });
}

const TEMPORAL: &str = "(define (domain d) (:requirements :durative-actions)
    (:predicates (lit) (busy) (done) (open)) (:functions (n))
    (:durative-action work :parameters () :duration (and (>= ?duration 2) (<= ?duration 4))
      :condition (and (at start (not (busy))) (over all (lit)) (at end (open)))
      :effect (and (at start (busy)) (at end (not (busy))) (at end (done)) (at end (increase (n) ?duration))))
    (:durative-action light :parameters () :duration (= ?duration 3)
      :effect (and (at start (lit)) (at end (not (lit)))))
    (:action switch :effect (not (lit))))";

#[test]
fn durative_actions_keep_their_conditions_and_literals_come_in_time() {
    let task = "(define (problem t) (:domain d) (:init (= (n) 0) (at 1 (open)) (at 9 (not (open)))) (:goal (done))
        (:metric minimize (+ (n) (total-time))))";
    let check = |steps: &str| printed(TEMPORAL, task, steps);
    assert_eq!(check("0: (light) [3]\n0.001: (work) [2.5]"), "the plan is valid, value 5.5");
    assert_eq!(
        check("0: (light) [3]\n0.001: (work) [3.5]"),
        "the plan is invalid: step 2: (work) is not applicable: (lit) is false"
    );
    assert_eq!(
        check("0: (light) [3]\n0.001: (work) [2.5]\n1.5: (switch)"),
        "the plan is invalid: step 2: (work) is not applicable: (lit) is false"
    );
    assert_eq!(
        check("0: (light) [3]\n0.001: (work) [2.5]\n1: (work) [2]"),
        "the plan is invalid: step 3: (work) is not applicable: (not (busy)) is false"
    );
    assert_eq!(
        check("8: (light) [3]\n8.001: (work) [2]"),
        "the plan is invalid: step 2: (work) is not applicable: (open) is false"
    );
    assert_eq!(
        check("0: (light) [3]\n3: (switch)\n3.001: (light) [3]\n3.002: (work) [2]"),
        "the plan is valid, value 8.001"
    );
    assert_eq!(
        check("0: (light) [3]\n0: (switch)"),
        "the plan is invalid: step 2: (switch) cannot happen at the same time as (light)"
    );
    assert_eq!(
        check("0: (light) [3]\n0.001: (work) [5]"),
        "the plan is invalid: step 2: the duration of (work) is 5, it must be at most 4"
    );
}

#[test]
fn a_long_plan_over_a_large_state_is_quick() {
    let text = "(define (domain d) (:predicates (next ?a ?b) (at ?a))
        (:action go :parameters (?a ?b) :precondition (and (at ?a) (next ?a ?b)) :effect (and (not (at ?a)) (at ?b))))";
    let count = 20_000;
    let mut task = "(define (problem t) (:domain d) (:objects".to_owned();
    (0..count).for_each(|index| task.push_str(&format!(" o{index}")));
    task.push_str(") (:init (at o0)");
    (0..count - 1).for_each(|index| task.push_str(&format!(" (next o{index} o{})", index + 1)));
    task.push_str(&format!(") (:goal (at o{})))", count - 1));
    let steps: String = (0..count - 1).map(|index| format!("(go o{index} O{})\n", index + 1)).collect();
    assert_eq!(printed(text, &task, &steps), format!("the plan is valid, value {}", count - 1));
}

#[test]
fn several_complaints_come_at_once_with_what_was_meant() {
    let text = "(define (domain d) (:requirements :stripps) (:types block - thing table - nothing)
        (:constants A a - block) (:predicates (on ?x - block ?y - block) (ON ?z - block) (flat ?t - table) (soft ?b - blok))
        (:action move :parameters (?x ?y - block ?t - table)
          :precondition (and (onn ?x ?y) (on ?x) (on ?x ?t) (on ?x ?q) (flat table1) (flat t))
          :effect (and (on ?y B) (increase (cost) 1)))
        (:action MOVE))";
    let complaints = complaints(Domain::read(&Source::new("d.pddl", text), Dialect::default()));
    insta::assert_snapshot!(complaints, @r"
    d.pddl:1:35: there is no requirement `:stripps`
      |
    1 | (define (domain d) (:requirements :stripps) (:types block - thing table - nothing)
      |                                   ^^^^^^^^
      = hint: did you mean `:strips`?
    d.pddl:2:23: constant `a` is declared twice
      |
    2 |         (:constants A a - block) (:predicates (on ?x - block ?y - block) (ON ?z - block) (flat ?t -
      |                       ^
      = hint: the first one is `A` at 2:21; PDDL does not tell upper and lower case apart
    d.pddl:2:75: predicate `ON` is declared twice
      |
    2 | …(:constants A a - block) (:predicates (on ?x - block ?y - block) (ON ?z - block) (flat ?t - table) (
      |                                                                    ^^
      = hint: the first one is `on` at 2:48; PDDL does not tell upper and lower case apart
    d.pddl:2:119: type `blok` is not declared
      |
    2 | … - block ?y - block) (ON ?z - block) (flat ?t - table) (soft ?b - blok))
      |                                                                    ^^^^
      = hint: did you mean `block`?
    d.pddl:4:31: predicate `onn` is not declared
      |
    4 |           :precondition (and (onn ?x ?y) (on ?x) (on ?x ?t) (on ?x ?q) (flat table1) (flat t))
      |                               ^^^
      = hint: did you mean `on`?
    d.pddl:4:42: predicate `on` takes 2 arguments, found 1
      |
    4 |           :precondition (and (onn ?x ?y) (on ?x) (on ?x ?t) (on ?x ?q) (flat table1) (flat t))
      |                                          ^^^^^^^
      = hint: it is declared as (on ?x - block ?y - block)
    d.pddl:4:57: `?t` is of type `table`, but predicate `on` wants `block` for `?y`
      |
    4 |           :precondition (and (onn ?x ?y) (on ?x) (on ?x ?t) (on ?x ?q) (flat table1) (flat t))
      |                                                         ^^
    d.pddl:4:68: variable `?q` is not a parameter here
      |
    4 | …         :precondition (and (onn ?x ?y) (on ?x) (on ?x ?t) (on ?x ?q) (flat table1) (flat t))
      |                                                                    ^^
    d.pddl:4:78: object `table1` is not declared
      |
    4 | …precondition (and (onn ?x ?y) (on ?x) (on ?x ?t) (on ?x ?q) (flat table1) (flat t))
      |                                                                    ^^^^^^
    d.pddl:4:92: object `t` is not declared
      |
    4 | …and (onn ?x ?y) (on ?x) (on ?x ?t) (on ?x ?q) (flat table1) (flat t))
      |                                                                    ^
      = hint: did you mean `?t`?
    d.pddl:5:31: object `B` is not declared
      |
    5 |           :effect (and (on ?y B) (increase (cost) 1)))
      |                               ^
    d.pddl:5:45: function `cost` is not declared
      |
    5 |           :effect (and (on ?y B) (increase (cost) 1)))
      |                                             ^^^^
    d.pddl:6:18: action `MOVE` is declared twice
      |
    6 |         (:action MOVE))
      |                  ^^^^
      = hint: the first one is `move` at 3:18; PDDL does not tell upper and lower case apart
    ");
}

#[test]
fn a_problem_is_checked_against_its_domain() {
    let domain = domain(
        "(define (domain d) (:types block table) (:constants t - table) (:predicates (on ?x ?y - block))
         (:functions (weight ?x - block)))",
    );
    let text = "(define (problem p) (:domain e) (:objects b B - block T - table c - blok)
        (:init (on b t) (on b) (= (weight b) (weight b)) (= (wieght b) 1) (on b missing)))";
    let complaints = complaints(Problem::read(&Source::new("p.pddl", text), &domain, Dialect::default()));
    insta::assert_snapshot!(complaints, @r"
    p.pddl:1:30: the problem is for domain `e`, but the domain is `d`
      |
    1 | (define (problem p) (:domain e) (:objects b B - block T - table c - blok)
      |                              ^
      = hint: write (:domain d), or give the other domain
    p.pddl:1:45: object `B` is declared twice
      |
    1 | (define (problem p) (:domain e) (:objects b B - block T - table c - blok)
      |                                             ^
      = hint: the first one is `b` at 1:43; PDDL does not tell upper and lower case apart
    p.pddl:1:69: type `blok` is not declared
      |
    1 | …efine (problem p) (:domain e) (:objects b B - block T - table c - blok)
      |                                                                    ^^^^
      = hint: did you mean `block`?
    p.pddl:2:22: `t` is of type `table`, but predicate `on` wants `block` for `?y`
      |
    2 |         (:init (on b t) (on b) (= (weight b) (weight b)) (= (wieght b) 1) (on b missing)))
      |                      ^
    p.pddl:2:25: predicate `on` takes 2 arguments, found 1
      |
    2 |         (:init (on b t) (on b) (= (weight b) (weight b)) (= (wieght b) 1) (on b missing)))
      |                         ^^^^^^
      = hint: it is declared as (on ?x - block ?y - block)
    p.pddl:2:46: expected a number; the initial state is not computed
      |
    2 |         (:init (on b t) (on b) (= (weight b) (weight b)) (= (wieght b) 1) (on b missing)))
      |                                              ^^^^^^^^^^
    p.pddl:2:62: function `wieght` is not declared
      |
    2 |         (:init (on b t) (on b) (= (weight b) (weight b)) (= (wieght b) 1) (on b missing)))
      |                                                              ^^^^^^
      = hint: did you mean `weight`?
    p.pddl:2:81: object `missing` is not declared
      |
    2 | … (on b t) (on b) (= (weight b) (weight b)) (= (wieght b) 1) (on b missing)))
      |                                                                    ^^^^^^^
    p.pddl:2:90: the problem has no goal
      |
    2 | … (on b) (= (weight b) (weight b)) (= (wieght b) 1) (on b missing)))
      |                                                                    ^
      = hint: add (:goal (and …))
    ");
}

#[test]
fn complaints_are_not_without_end() {
    let atoms = "(p)".repeat(1000);
    let text = format!("(define (domain d) (:action a :precondition (and {atoms})))");
    let complaints = Domain::read(&Source::new("d", text), Dialect::default()).expect_err("complaints");
    assert_eq!(complaints.len(), 50);
}

#[test]
fn types_that_belong_to_themselves_are_an_error() {
    let text = "(define (domain d) (:types a - b b - c c - a))";
    let complaints = complaints(Domain::read(&Source::new("d", text), Dialect::default()));
    assert!(complaints.contains("type `c` belongs to itself by way of `a`"), "{complaints}");
}

#[test]
fn features_are_what_is_used_not_what_is_announced() {
    let features = |text: &str| domain(text).features().iter().map(|used| used.feature).collect::<Vec<_>>();
    let all = "(define (domain d) (:requirements :adl :fluents :durative-actions) (:predicates (p)))";
    assert_eq!(features(all), []);
    let costs = "(define (domain d) (:functions (total-cost)) (:action a :effect (increase (total-cost) 2)))";
    assert_eq!(features(costs), [Feature::ActionCosts]);
    let negated = "(define (domain d) (:predicates (p) (q))
        (:action a :parameters (?x ?y) :precondition (and (not (= ?x ?y)) (not (and (p) (q)))) :effect (when (p) (q))))";
    assert_eq!(
        features(negated),
        [
            Feature::Equality,
            Feature::NegativePreconditions,
            Feature::DisjunctivePreconditions,
            Feature::ConditionalEffects
        ]
    );
    let domain = domain(negated);
    let used = domain.features().last().expect("a feature");
    assert_eq!(domain.source().slice(used.span), "(when (p) (q))");
    assert_eq!(domain.warnings().len(), 4);
}

#[test]
fn a_domain_with_everything_in_it_is_understood() {
    let (domain, problem) = task("language/temporal_domain.pddl", "language/temporal_problem.pddl");
    assert_eq!(domain.name(), "kitchen");
    let drive = domain.action("DRIVE").expect("an action");
    let names: Vec<&str> = drive.parameters().iter().map(|parameter| parameter.name.as_str()).collect();
    assert_eq!(names, ["r", "a", "b"]);
    assert!(drive.is_durative());
    let objects: Vec<String> = problem.objects().map(|object| format!("{}-{}", object.name, object.kind)).collect();
    assert_eq!(objects, ["Mug-cup", "stove-place"]);
    assert_eq!(problem.object("MUG").expect("an object").name, "Mug");
    let features: Vec<Feature> = problem.features().iter().map(|used| used.feature).collect();
    assert!(features.contains(&Feature::TimedInitialLiterals) && features.contains(&Feature::Preferences));
}

#[test]
fn the_first_wrong_step_is_named() {
    let text = "(define (domain d) (:predicates (p)) (:action a :precondition (p)))";
    let task = "(define (problem t) (:domain d) (:init (p)) (:goal (not (p))))";
    let Validation::Invalid(failure) = verdict(text, task, "(a)\n(a)\n(aa)") else { panic!("not invalid") };
    assert_eq!(failure.step(), Some(2));
    assert!(matches!(failure, Failure::UnknownAction { nearest: Some(_), .. }), "{failure}");
    let Validation::Invalid(failure) = verdict(text, task, "(a)") else { panic!("not invalid") };
    assert_eq!(failure.step(), None);
}

#[test]
fn very_many_mistakes_are_no_more_work_than_a_few() {
    let domain = domain("(define (domain d) (:predicates (p ?x)))");
    let objects: String = (0..2_000).map(|index| format!(" o{index} O{index}")).collect();
    let facts: String = (0..20_000).map(|index| format!("(p x{index}) (q{index}) ")).collect();
    let text = format!("(define (problem p) (:domain d) (:objects{objects}) (:init {facts}) (:goal (and)))");
    let complaints = Problem::read(&Source::new("p", text), &domain, Dialect::default()).expect_err("complaints");
    assert_eq!(complaints.len(), 50);
}

#[test]
fn every_recorded_task_is_accepted_or_its_mistake_is_named() {
    let mut seen = Vec::new();
    for (domain_name, problem_names) in [
        ("dom", "p_arity p_disj p_exists p_goalfalse_static p_goalfalse_unreach p_goaltrue p_goaltrue_empty"),
        ("dom", "p_init_typemismatch p_neg p_plan p_typemismatch p_undeclared_obj p_undeclared_pred p_unsolv_search"),
        ("dom", "p_wrongdomain"),
        ("dom_types", "p_plan"),
        ("dom_undeclpred", ""),
        ("dom_undeclvar", ""),
        ("dom_unktype", ""),
        ("acdom", "acp"),
        ("adldom", "adlp"),
        ("adl_m", "adl_mp"),
        ("adl_neither", "adlp"),
        ("adl_noforall", "adlp"),
        ("adl_noimply", "adlp"),
        ("durdom", "durp"),
        ("ffbug_dom", "ffbug_p1 ffbug_p2 ffbug_p3"),
        ("ffbug_dom2", "ffbug_p1 ffbug_p2 ffbug_p3"),
        ("names_dom", "names_p names_p2 names_p3"),
        ("ndom", "np np_unreach"),
    ] {
        let domain = match Domain::read(&source(&format!("tasks/{domain_name}.pddl")), Dialect::default()) {
            Ok(domain) => domain,
            Err(errors) => {
                seen.extend(errors);
                continue;
            }
        };
        for name in problem_names.split_whitespace() {
            let problem = Problem::read(&source(&format!("tasks/{name}.pddl")), &domain, Dialect::default());
            seen.extend(problem.err().into_iter().flatten());
        }
    }
    let seen: Vec<String> =
        seen.iter().map(|error| format!("{}:{}: {}", error.name(), error.position().0, error.message())).collect();
    insta::assert_snapshot!(seen.join("\n"), @r"
    tasks/p_arity.pddl:4: predicate `in` takes 2 arguments, found 1
    tasks/p_init_typemismatch.pddl:3: `cup` is of type `object`, but predicate `in` wants `room` for `?x`
    tasks/p_typemismatch.pddl:4: `cup` is of type `object`, but predicate `in` wants `room` for `?x`
    tasks/p_undeclared_obj.pddl:4: object `nosuch` is not declared
    tasks/p_undeclared_pred.pddl:4: predicate `nopred` is not declared
    tasks/p_wrongdomain.pddl:1: the problem is for domain `other`, but the domain is `robo`
    tasks/dom_undeclpred.pddl:9: predicate `fre` is not declared
    tasks/dom_undeclvar.pddl:9: variable `?zz` is not a parameter here
    tasks/dom_unktype.pddl:4: type `objekt` is not declared
    ");
}

#[test]
fn depth_that_is_read_is_also_judged() {
    let depth = rmem::formats::pddl::MAX_DEPTH - 4;
    let plain = "(define (domain d) (:types t) (:predicates (p) (q)) (:derived (q) (p)) (:action a :effect (p)))";
    for open in ["(not ", "(and ", "(forall (?x - t) ", "(exists (?x - t) "] {
        let goal = format!("{}(q){}", open.repeat(depth), ")".repeat(depth));
        let task = format!("(define (problem p) (:domain d) (:objects o - t) (:goal {goal}))");
        assert!(verdict(plain, &task, "(a)").is_valid(), "{open}");
        let failed = printed(plain, &task, "");
        assert!(failed.starts_with("the plan is invalid: the goal is not reached: ("), "{failed}");
    }
    let effect = format!("{}(p){}", "(when (and) ".repeat(depth), ")".repeat(depth));
    let text = format!("(define (domain d) (:predicates (p)) (:action a :effect {effect}))");
    assert!(verdict(&text, "(define (problem p) (:domain d) (:goal (p)))", "(a)").is_valid());
    let rule = format!("{}(p){}", "(exists (?x) ".repeat(depth), ")".repeat(depth));
    let text = format!("(define (domain d) (:predicates (p) (q)) (:derived (q) {rule}))");
    let task = "(define (problem p) (:domain d) (:objects o) (:init (p)) (:goal (q)))";
    assert!(verdict(&text, task, "").is_valid());
}

#[test]
fn what_divides_by_zero_in_every_state_is_refused_at_its_place() {
    let refused = |condition: &str, effect: &str| {
        let text = format!(
            "(define (domain d) (:requirements :fluents) (:predicates (done)) (:functions (f))
            (:action a :parameters () :precondition {condition} :effect (and (done) {effect})))"
        );
        Domain::read(&Source::new("d.pddl", text), Dialect::default())
            .map(drop)
            .map_err(|errors| errors.first().map(ToString::to_string).unwrap_or_default())
    };
    for (condition, effect, place) in [
        ("(> (/ (f) 0) 1)", "", "d.pddl:2:63: a division by zero"),
        ("(> (/ (f) (- 2 2)) 1)", "", "d.pddl:2:63: a division by zero"),
        ("()", "(scale-down (f) 0)", "d.pddl:2:92: a division by zero"),
    ] {
        let error = refused(condition, effect).unwrap_err();
        assert!(error.contains(place), "{error}");
    }
    assert_eq!(refused("(> (/ 0 (f)) 1)", "(increase (f) (/ 1 2))"), Ok(()));
}

#[test]
fn nothing_exists_of_a_type_without_objects() {
    let domain = |rule: &str| {
        format!(
            "(define (domain d) (:requirements :adl :derived-predicates) (:types t) (:predicates (p) (q))
            (:derived (q) {rule}) (:action a :effect (p)))"
        )
    };
    let problem = "(define (problem t) (:domain d) (:init) (:goal (not (q))))";
    assert_eq!(printed(&domain("(exists (?x - t) (p))"), problem, "(a)"), "the plan is valid, value 1");
    assert_eq!(printed(&domain("(or (exists (?x - t) (p)) (not (p)))"), problem, "(a)"), "the plan is valid, value 1");
    let all = printed(&domain("(forall (?x - t) (not (p)))"), problem, "(a)");
    assert!(all.ends_with("(not (q)) is false"), "{all}");
}

const SEEN: &str = "(define (domain d) (:requirements :durative-actions :constraints :conditional-effects)
    (:types t) (:predicates (p ?o - t) (q ?o - t) (r ?o - t))
    (:durative-action mk :parameters (?o - t) :duration (>= ?duration 0.01) :effect (at end (p ?o)))
    (:action ip :parameters (?o - t) :effect (p ?o)) (:action iq :parameters (?o - t) :effect (q ?o))
    (:action dp :parameters (?o - t) :effect (not (p ?o))))";

/// The verdict on a plan for a task with a trajectory constraint.
fn constrained(constraint: &str, steps: &str) -> String {
    let start = "(define (problem t) (:domain d) (:objects a b - t) (:init) (:goal (and))";
    printed(SEEN, &format!("{start} (:constraints {constraint}))"), steps)
}

#[test]
fn trajectory_constraints_are_those_of_pddl_3() {
    for (constraint, good, bad) in [
        ("(always (not (p a)))", "(ip b)", "(ip a)\n(dp a)"),
        ("(sometime (p a))", "(ip a)\n(dp a)", "(ip b)"),
        ("(at end (not (p a)))", "(ip a)\n(dp a)", "(ip a)"),
        ("(at-most-once (p a))", "(ip a)\n(ip a)\n(dp a)", "(ip a)\n(dp a)\n(ip a)"),
        ("(sometime-before (p a) (q a))", "(iq a)\n(ip a)", "(ip a)\n(iq a)"),
        ("(sometime-before (p a) (q a))", "1: (iq a)\n2: (ip a)", "1: (iq a)\n1: (ip a)"),
        ("(sometime-after (p a) (q a))", "(ip a)\n(iq a)", "(ip a)"),
        ("(sometime-after (p a) (q a))", "(iq a)\n(ip a)", "(ip a)\n(iq b)"),
        ("(within 3 (p a))", "0: (mk a) [3]", "0: (mk a) [3.5]"),
        ("(hold-during 2 4 (p a))", "1: (ip a)\n5: (dp a)", "2.5: (ip a)\n5: (dp a)"),
        ("(hold-during 2 4 (p a))", "1: (ip a)\n4: (dp a)", "1: (ip a)\n3: (dp a)\n3.5: (ip a)"),
        ("(hold-after 4 (p a))", "1: (ip a)\n5: (iq a)", "1: (ip a)\n5: (dp a)"),
        ("(hold-after 4 (p a))", "1: (ip a)", "5: (ip a)"),
        ("(always-within 2 (p a) (q a))", "1: (ip a)\n3: (iq a)", "1: (ip a)\n3.5: (iq a)"),
        ("(forall (?o - t) (always (not (p ?o))))", "(iq b)", "(ip b)"),
        ("(and (sometime (p a)) (sometime (p b)))", "(ip a)\n(ip b)", "(ip a)"),
    ] {
        let said = constrained(constraint, good);
        assert!(said.starts_with("the plan is valid"), "{constraint} {good}: {said}");
        let said = constrained(constraint, bad);
        assert!(said.contains("the constraint (") && said.contains("is not satisfied"), "{constraint} {bad}: {said}");
    }
    assert_eq!(
        constrained("(forall (?o - t) (always (not (p ?o))))", "(iq a)\n(ip b)"),
        "the plan is invalid: step 2: the constraint (always (not (p b))) is not satisfied"
    );
}

#[test]
fn violated_preferences_count_in_the_metric() {
    let value = |rest: &str, steps: &str| {
        let start = "(define (problem t) (:domain d) (:objects a b - t) (:init)";
        match verdict(SEEN, &format!("{start} {rest})"), steps) {
            Validation::Valid { value } => value,
            other => panic!("{other}"),
        }
    };
    let goal = "(:goal (and (p a) (preference g1 (q a)) (preference G2 (q b))))
        (:metric minimize (+ (* 10 (is-violated g1)) (* 3 (is-violated g2))))";
    assert_eq!(value(goal, "(ip a)\n(iq a)"), Some(3.0));
    let all = "(:goal (forall (?o - t) (preference each (q ?o)))) (:metric minimize (is-violated each))";
    assert_eq!((value(all, ""), value(all, "(iq a)")), (Some(2.0), Some(1.0)));
    let soft = "(:goal (and)) (:constraints (and (preference c (and (sometime (p a)) (sometime (p b))))
        (forall (?o - t) (preference d (always (not (p ?o))))))) (:metric minimize (+ (* 10 (is-violated c)) (is-violated d)))";
    assert_eq!(
        (value(soft, ""), value(soft, "(ip a)"), value(soft, "(ip a)\n(ip b)")),
        (Some(10.0), Some(11.0), Some(2.0))
    );
}

const CLOCKED: &str = "(define (domain d) (:requirements :durative-actions :duration-inequalities :numeric-fluents
    :conditional-effects :derived-predicates :timed-initial-literals) (:types t)
    (:predicates (p) (q) (g) (np) (on ?o - t) (some)) (:functions (x))
    (:derived (np) (not (p))) (:derived (some) (exists (?o - t) (on ?o)))
    (:durative-action dend :parameters () :duration (at end (<= ?duration (x))) :effect (at end (g)))
    (:durative-action dx :parameters () :duration (= ?duration (x)) :effect (at end (g)))
    (:durative-action course :parameters () :duration (= ?duration 4)
      :effect (when (and (at start (p)) (over all (q)) (at end (p))) (at end (g))))
    (:durative-action wrapped :parameters () :duration (= ?duration 4)
      :effect (at start (when (p) (g))))
    (:durative-action late :parameters () :duration (= ?duration 4) :effect (at end (when (at start (p)) (g))))
    (:durative-action start :parameters () :duration (= ?duration 4) :effect (when (at start (p)) (at start (g))))
    (:action ip :parameters () :effect (p)) (:action dp :parameters () :effect (not (p)))
    (:action iq :parameters () :effect (q)) (:action dq :parameters () :effect (not (q)))
    (:action gnp :parameters () :precondition (np) :effect (g))
    (:action gsome :parameters () :precondition (some) :effect (g))
    (:action put :parameters (?o - t) :effect (on ?o))
    (:action set :parameters (?o - t) :effect (assign (x) 5)) (:action more :parameters () :effect (increase (x) 1))
    (:action up :parameters () :effect (scale-up (x) 2)) (:action down :parameters () :effect (scale-down (x) 2))
    (:action scales :parameters () :effect (and (scale-up (x) 2) (scale-down (x) 2)))
    (:action tenth :parameters () :effect (increase (x) 0.1)))";

/// The verdict on a plan whose task begins with these facts beside (x) = 3.
fn clocked(init: &str, goal: &str, steps: &str) -> String {
    let start = "(define (problem t) (:domain d) (:objects a b - t) (:init (= (x) 3)";
    printed(CLOCKED, &format!("{start} {init}) (:goal {goal}))"), steps)
}

#[test]
fn durations_are_checked_at_the_moment_that_they_name() {
    assert_eq!(clocked("", "(g)", "0: (dend) [3]"), "the plan is valid, value 3");
    assert_eq!(
        clocked("", "(g)", "0: (dend) [4]"),
        "the plan is invalid: step 1: the duration of (dend) is 4, it must be at most 3"
    );
    assert_eq!(clocked("", "(g)", "0: (dend) [4]\n1: (more)"), "the plan is valid, value 4");
}

#[test]
fn a_conditional_effect_may_look_at_other_moments_than_its_own() {
    let valid = "the plan is valid, value 4";
    let missed = "the plan is invalid: the goal is not reached: (g) is false";
    assert_eq!(clocked("(p)", "(g)", "0: (start) [4]"), valid);
    assert_eq!(clocked("", "(g)", "0: (start) [4]\n1: (ip)"), missed);
    assert_eq!(clocked("(p)", "(g)", "0: (wrapped) [4]\n1: (dp)"), valid);
    assert_eq!(clocked("", "(g)", "0: (wrapped) [4]\n1: (ip)"), missed);
    assert_eq!(clocked("(p)", "(g)", "0: (late) [4]\n1: (dp)"), valid);
    assert_eq!(clocked("", "(g)", "0: (late) [4]\n1: (ip)"), missed);
    assert_eq!(clocked("(p) (q)", "(g)", "0: (course) [4]\n1: (dp)\n2: (ip)"), valid);
    assert_eq!(clocked("(q)", "(g)", "0: (course) [4]\n1: (ip)"), missed);
    assert_eq!(clocked("(p) (q)", "(g)", "0: (course) [4]\n1: (dq)\n2: (iq)"), missed);
    assert_eq!(clocked("(p) (q)", "(g)", "0: (course) [4]\n1: (dp)"), missed);
}

#[test]
fn what_happens_at_one_moment_must_not_interfere() {
    let wrong = |init: &str, steps: &str| {
        let said = clocked(init, "(and)", steps);
        assert!(said.contains("cannot happen at the same time as"), "{steps}: {said}");
    };
    // A derived predicate is read with what it is derived from.
    wrong("", "1: (gnp)\n1: (ip)");
    wrong("(on a)", "1: (gsome)\n1: (put b)");
    assert_eq!(clocked("", "(g)", "1: (gnp)\n1: (iq)"), "the plan is valid, value 1");
    // The start reads what the duration is compared with.
    wrong("", "0: (dx) [3]\n0: (set a)");
    // Only increases and decreases go together.
    wrong("", "1: (set a)\n1: (set b)");
    wrong("", "1: (up)\n1: (down)");
    wrong("", "1: (up)\n1: (more)");
    assert_eq!(clocked("", "(= (x) 5)", "1: (more)\n1: (more)"), "the plan is valid, value 1");
    let both = clocked("", "(and)", "(scales)");
    assert_eq!(both, "the plan is invalid: step 1: (scales) is not applicable: (x) is changed in two ways at once");
}

#[test]
fn a_comparison_and_its_negation_never_both_hold() {
    let steps = "(tenth)\n(tenth)\n(tenth)";
    for (holds, others) in [("=", ["<", ">"]), ("<=", [">", "<"]), (">=", ["<", ">"])] {
        assert_eq!(clocked("", &format!("({holds} (x) 3.3)"), steps), "the plan is valid, value 3");
        for other in others {
            let said = clocked("", &format!("({other} (x) 3.3)"), steps);
            assert!(said.starts_with("the plan is invalid"), "{other}: {said}");
        }
    }
}

#[test]
fn the_time_of_a_plan_ends_with_its_last_action() {
    let task =
        "(define (problem t) (:domain d) (:init (= (x) 3) (at 9 (q))) (:goal (g)) (:metric minimize (total-time)))";
    assert_eq!(printed(CLOCKED, task, "0: (dx) [3]"), "the plan is valid, value 3");
}

#[test]
fn a_beginning_that_contradicts_itself_is_an_error() {
    let domain = domain(CLOCKED);
    for (init, said) in [
        ("(= (x) 1) (p) (= (x) 2)", "p.pddl:1:57: (x) has another value already"),
        ("(p) (not (p))", "(p) is both true and false at the beginning"),
        ("(at -1 (p))", "the time -1 of this literal is before the plan begins, at 0"),
        ("(at 5 (p)) (at 5 (not (p)))", "(p) at 5 becomes both true and false"),
    ] {
        let text = format!("(define (problem t) (:domain d) (:init {init}) (:goal (g)))");
        let complaints = complaints(Problem::read(&Source::new("p.pddl", text), &domain, Dialect::default()));
        assert!(complaints.contains(said), "{complaints}");
    }
    let twice = "(define (problem t) (:domain d) (:init (= (x) 1) (= (x) 1) (p) (p) (not (q)) (at 5 (p)) (at 6 (not (p)))) (:goal (g)))";
    problem(&domain, twice);
}

/// A robot with a battery that drives, and loads while it stands at a door that is open.
const DRIVER: &str = "(define (domain d) (:requirements :typing :fluents :durative-actions) (:types r p)
  (:predicates (at ?r - r ?p - p) (road ?a ?b - p) (open ?p - p) (full ?r - r)) (:functions (battery ?r - r))
  (:durative-action drive :parameters (?r - r ?a ?b - p) :duration (= ?duration 4)
    :condition (and (at start (at ?r ?a)) (at start (>= (battery ?r) 4)) (over all (road ?a ?b)))
    :effect (and (at start (not (at ?r ?a))) (at start (decrease (battery ?r) 4)) (at end (at ?r ?b))))
  (:durative-action load :parameters (?r - r ?p - p) :duration (= ?duration 1)
    :condition (and (over all (at ?r ?p)) (at start (>= (battery ?r) 1)) (at end (open ?p))) :effect (at end (full ?r))))";

#[test]
fn a_running_step_needs_what_comes_after_its_start() {
    let domain = domain(DRIVER);
    let steps = plan("0: (drive r1 a b) [4]\n4.1: (load r1 b) [1]");
    let verdict = |init: &str, running: &[usize]| {
        let text =
            format!("(define (problem p) (:domain d) (:objects r1 - r a b - p) (:init {init}) (:goal (full r1)))");
        rmem::pddl::validate_rest(&domain, &problem(&domain, &text), &steps, running).to_string()
    };
    let begun = "(= (battery r1) 1) (road a b) (open b)";
    assert!(verdict(begun, &[]).contains("(drive r1 a b) is not applicable"), "it has not begun");
    assert!(verdict(begun, &[0]).starts_with("the plan is valid"));
    let not_seen_yet = format!("{begun} (at r1 a)");
    assert!(verdict(&not_seen_yet, &[0]).starts_with("the plan is valid"));
    assert_eq!(
        verdict("(= (battery r1) 1) (open b)", &[0]),
        "the plan is invalid: step 1: (drive r1 a b) is not applicable: (road a b) is false"
    );
    assert_eq!(
        verdict("(= (battery r1) 0) (road a b) (open b)", &[0]),
        "the plan is invalid: step 2: (load r1 b) is not applicable: (>= (battery r1) 1) is false",
        "the battery is as it was measured"
    );
    assert_eq!(
        verdict("(= (battery r1) 1) (road a b)", &[0]),
        "the plan is invalid: step 2: (load r1 b) is not applicable: (open b) is false"
    );
}

#[test]
fn a_running_action_without_duration_has_its_effects_only() {
    let domain = domain(
        "(define (domain d) (:predicates (at ?p) (road ?a ?b) (done))
         (:action go :parameters (?a ?b) :precondition (and (at ?a) (road ?a ?b)) :effect (and (not (at ?a)) (at ?b)))
         (:action work :parameters (?a) :precondition (at ?a) :effect (done)))",
    );
    let text = "(define (problem p) (:domain d) (:objects a b) (:init (road a b)) (:goal (done)))";
    let steps = plan("(go a b)\n(work b)");
    let problem = problem(&domain, text);
    assert!(validate(&domain, &problem, &steps).to_string().contains("(at a) is false"));
    assert!(rmem::pddl::validate_rest(&domain, &problem, &steps, &[0]).is_valid());
}

#[test]
fn the_tolerance_of_durations_makes_no_limit_stricter() {
    for (limit, took) in [("(> ?duration 0)", "0.005"), ("(< ?duration 5)", "4.995"), ("(<= ?duration 5)", "5.005")] {
        let domain = format!(
            "(define (domain d) (:requirements :durative-actions :duration-inequalities) (:predicates (p))
             (:durative-action a :parameters () :duration {limit} :condition () :effect (at end (p))))"
        );
        let problem = "(define (problem t) (:domain d) (:init) (:goal (p)))";
        let verdict = printed(&domain, problem, &format!("0: (a) [{took}]"));
        assert!(verdict.starts_with("the plan is valid"), "{limit} {took}: {verdict}");
    }
}

#[test]
fn a_constraint_on_a_number_without_a_value_does_not_hold_yet() {
    let domain =
        "(define (domain d) (:requirements :fluents :constraints :preferences) (:predicates (g)) (:functions (y))
      (:action s :effect (assign (y) 1)) (:action a :effect (g)))";
    let problem = |constraint: &str| {
        format!(
            "(define (problem t) (:domain d) (:init) (:goal (g)) (:constraints {constraint}) (:metric minimize (is-violated k)))"
        )
    };
    let never = printed(domain, &problem("(preference k (always (> (y) 0)))"), "(a)");
    assert_eq!(never, "the plan is valid, value 1");
    let later = printed(domain, &problem("(preference k (sometime (> (y) 0)))"), "(s)\n(a)");
    assert_eq!(later, "the plan is valid, value 0");
}
