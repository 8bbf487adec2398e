//! plan: the problem, the search, the stored document, the exit code.

mod check;
mod find;
mod holds;
mod import;
mod limits;
mod list;
mod names;
mod portfolio;
mod rerun;
mod show;
mod step;
mod unsolvable;
mod watch;
mod why;

use serde_json::{Value, json};

use crate::lab::{Lab, assert_run, plan};

/// The world in which the blocks are stacked by hand, one action at a time.
const STACKED: [&str; 3] = [
    "rmem update robmem.worldmodel \"{relation: 'holding'}\" \"{\\$set: {relation: 'on', object_top: 'B', object_bottom: 'C'}, \\$unset: {object: 1}}\"",
    "rmem delete robmem.worldmodel \"{relation: 'clear', object: 'C'}\"",
    "rmem insert robmem.worldmodel \"{relation: 'clear', object: 'B'}\" \"{relation: 'hand-empty'}\"",
];

#[test]
fn from_memory_to_plan_to_memory() {
    let lab = Lab::new();
    let text = plan(&lab, &[]).success();
    assert!(text.lines().next().unwrap().starts_with('('), "{text}");
    assert!(text.lines().last().unwrap().starts_with("; cost = "), "{text}");
    let stored = lab.rmem(&["query", "robmem.plans", "{plan: 'success'}", "--fields", "{_id: 0}"]).success();
    let document: Value = serde_json::from_str(stored.trim()).unwrap();
    assert_eq!(document["plan"], "success");
    let steps = text.lines().filter(|line| line.starts_with('(')).count();
    assert!(document.get(steps.to_string()).is_some() && document.get((steps + 1).to_string()).is_none(), "{stored}");
    assert!(document["1"]["action"].is_string(), "{stored}");
}

#[test]
fn the_plan_is_spelled_as_the_memory_is() {
    let lab = Lab::new();
    assert_run!(plan(&lab, &[]), @r"
    (stack B C)
    (unstack D A)
    (putdown D)
    (pickup A)
    (stack A B)
    ; cost = 5 (unit cost)
    ------- stderr -------
    stored in robmem.plans as [ID]
    [exit code: 0]
    ");
    let document = plan(&lab, &["--format", "json"]).success();
    let document: Value = serde_json::from_str(&document).unwrap();
    let values = document["steps"][0]["list"].as_array().unwrap();
    let values: Vec<&str> = values.iter().filter_map(|value| value.as_str()).collect();
    assert!(values.iter().all(|value| ["A", "B", "C", "D"].contains(value)), "{values:?}");
}

#[test]
fn lineage_records_where_the_plan_came_from() {
    let lab = Lab::new();
    plan(&lab, &["-q"]).success();
    let stored = lab.rmem(&["query", "robmem.plans", "--meta"]).success();
    let document: Value = serde_json::from_str(stored.trim()).unwrap();
    let lineage = &document["_robmem_info"]["lineage"];
    for key in ["domain", "problem", "template", "goal", "queries", "planner", "version", "outcome", "length", "times"]
    {
        assert!(!lineage[key].is_null(), "{key} is missing: {stored}");
    }
}

#[test]
fn fawkes_layout_is_an_array_of_actions() {
    let lab = Lab::new();
    plan(&lab, &["--layout", "fawkes"]).success();
    let stored = lab.rmem(&["query", "robmem.plans", "{plan: 1}"]).success();
    let document: Value = serde_json::from_str(stored.trim()).unwrap();
    assert!(document["actions"][0]["name"].is_string() && document["actions"][0]["args"].is_array(), "{stored}");
    // An executive reads the same steps as of the other layout.
    let steps = |text: String| serde_json::from_str::<Value>(&text).unwrap()["steps"].clone();
    let other = steps(plan(&lab, &["-q", "--no-store", "--format", "json"]).success());
    assert!(other[0]["args"].as_object().is_some_and(|args| !args.is_empty()), "{other}");
    assert_eq!(steps(lab.rmem(&["plan", "show", "last", "--format", "json"]).success()), other);
    assert_eq!(steps(plan(&lab, &["-q", "--no-store", "--layout", "fawkes", "--format", "json"]).success()), other);
}

#[test]
fn no_store_stores_nothing_and_into_names_the_collection() {
    let lab = Lab::new();
    plan(&lab, &["--no-store"]).success();
    assert_eq!(lab.rmem(&["count", "robmem.plans"]).success(), "0\n");
    plan(&lab, &["--into", "lab.plans"]).success();
    assert_eq!(lab.rmem(&["count", "lab.plans"]).success(), "1\n");
}

#[test]
fn a_pipeline_plans_what_was_generated() {
    let lab = Lab::new();
    let line = "rmem gen-problem --load fixtures/blocksworld.json --template templates/blocksworld/problem.pddl.j2 \
                --goal '(and (on A B) (on B C))' | rmem plan --domain domains/blocksworld/domain.pddl --problem -";
    assert_eq!(lab.shell(line).success(), plan(&lab, &["--no-store"]).success());
}

#[test]
fn every_printed_format_has_the_plan() {
    let lab = Lab::new();
    let print = |format| plan(&lab, &["-q", "--no-store", "--format", format]);
    assert_run!(print("text"), @r"
    (stack B C)
    (unstack D A)
    (putdown D)
    (pickup A)
    (stack A B)
    ; cost = 5 (unit cost)
    ------- stderr -------
    [exit code: 0]
    ");
    assert_run!(print("document"), @r#"
    {"plan":"success","1":{"action":"stack","x":"B","y":"C"},"2":{"action":"unstack","x":"D","y":"A"},"3":{"action":"putdown","x":"D"},"4":{"action":"pickup","x":"A"},"5":{"action":"stack","x":"A","y":"B"}}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(print("clips"), @r"
    (plan (id plan) (cost 5.0))
    (plan-action (id 1) (plan-id plan) (name stack) (arguments B C) (status FORMULATED))
    (plan-action (id 2) (plan-id plan) (name unstack) (arguments D A) (status FORMULATED))
    (plan-action (id 3) (plan-id plan) (name putdown) (arguments D) (status FORMULATED))
    (plan-action (id 4) (plan-id plan) (name pickup) (arguments A) (status FORMULATED))
    (plan-action (id 5) (plan-id plan) (name stack) (arguments A B) (status FORMULATED))
    ------- stderr -------
    [exit code: 0]
    ");
    assert_run!(print("ff"), @r"
    ff: found legal plan as follows

    step    0: stack B C
            1: unstack D A
            2: putdown D
            3: pickup A
            4: stack A B
         
    plan cost: 5.000000
    ------- stderr -------
    [exit code: 0]
    ");
    // The report has times and the drawing has places; their tests are elsewhere.
    for (format, mark) in [("json", "\"outcome\":\"success\""), ("dot", "digraph"), ("svg", "<svg ")] {
        let text = print(format).success();
        assert!(text.contains(mark), "{format}: {text}");
    }
}

#[test]
fn a_goal_that_holds_needs_no_plan() {
    let lab = Lab::new();
    lab.write(
        "d.pddl",
        "(define (domain d) (:predicates (p) (q)) (:action a :parameters () :precondition (p) :effect (q)))",
    );
    lab.write("p.pddl", "(define (problem p) (:domain d) (:init (p)) (:goal (p)))");
    assert_run!(lab.rmem(&["plan", "-d", "d.pddl", "-p", "p.pddl"]), @r"
    ; cost = 0 (unit cost)
    ------- stderr -------
    stored in robmem.plans as [ID]
    [exit code: 0]
    ");
    assert_eq!(lab.rmem(&["query", "robmem.plans", "--fields", "{_id: 0}"]).success(), "{\"plan\":\"success\"}\n");
}

#[test]
fn a_task_without_a_plan_is_11_where_pairs_of_facts_or_all_its_states_prove_it() {
    let lab = Lab::new();
    for task in ["fuel", "tiles", "unsolvable"] {
        let folder = format!("fixtures/tasks/{task}");
        let run = lab.rmem(&["plan", "-d", &format!("{folder}/domain.pddl"), "-p", &format!("{folder}/problem.pddl")]);
        let run = run.exits(11);
        let error =
            "error: builtin: proven: no plan exists: best first search space empty! problem proven unsolvable.\n";
        assert!(run.stdout.is_empty() && run.stderr.contains(error), "{task}: {run}");
    }
}

#[test]
fn no_plan_is_11_where_it_is_proven_and_stored_as_a_failure() {
    let lab = Lab::new();
    lab.write(
        "d.pddl",
        "(define (domain d) (:predicates (p) (q)) (:action a :parameters () :precondition (q) :effect (q)))",
    );
    lab.write("p.pddl", "(define (problem p) (:domain d) (:init (p)) (:goal (q)))");
    assert_run!(lab.rmem(&["plan", "-d", "d.pddl", "-p", "p.pddl"]), @r"
    ------- stderr -------
    stored in robmem.plans as [ID]
    error: builtin: proven: no plan exists: goal can be simplified to FALSE. No plan will solve it
    why: the goal asks for (q), which can never hold
           (a) would make it true, but needs (q)
    never true, in the initial state or by an action: q
    change the goal, the initial state, or the actions of the domain
    [exit code: 11]
    ");
    let stored = lab.rmem(&["query", "robmem.plans", "--fields", "{_id: 0}"]).success();
    assert!(stored.starts_with("{\"plan\":\"fail\",\"outcome\":\"unsolvable\""), "{stored}");
}

#[test]
fn why_there_is_no_plan_is_printed_and_stored() {
    let lab = Lab::new();
    let task = ["-d", "fixtures/tasks/unreachable/domain.pddl", "-p", "fixtures/tasks/unreachable/problem.pddl"];
    assert_run!(lab.rmem(&[&["plan"], &task[..]].concat()), @r"
    ------- stderr -------
    stored in robmem.plans as [ID]
    error: builtin: proven: no plan exists: goal can be simplified to FALSE. No plan will solve it
    why: the goal asks for (lit), which can never hold
           (switch-on ?s) would make it true, but needs (on-stool)
         and (on-stool), which can never hold
           (climb ?s) would make it true, but needs (stool-at ?s)
         and (stool-at ?s), which can never hold
           (push ?from ?to) would make it true, but needs (stool-at ?from)
    never true, in the initial state or by an action: stool-at, on-stool
    change the goal, the initial state, or the actions of the domain
    [exit code: 11]
    ");
    let stored = lab.rmem(&["query", "robmem.plans", "--meta"]).success();
    let document: Value = serde_json::from_str(stored.trim()).unwrap();
    let first = &document["_robmem_info"]["lineage"]["why"]["unreachable"][0];
    assert_eq!((&first["condition"], &first["goal"]), (&"(lit)".into(), &true.into()), "{stored}");
    assert!(first["achievers"][0]["missing"][0].is_string(), "{stored}");
}

#[test]
fn a_planner_that_is_not_there_is_127() {
    assert_run!(plan(&Lab::new().env("PATH", "/nonexistent"), &["--planner", "ff"]), @r"
    ------- stderr -------
    stored in robmem.plans as [ID]
    error: ff: the planner's program was not found: there is no program `ff`; `cargo install ferroplan-cli` installs one, and `--planner builtin` needs none
    [exit code: 127]
    ");
}

#[test]
fn an_unknown_planner_is_2_and_names_the_known_ones() {
    assert_run!(plan(&Lab::new(), &["--planner", "nosuch"]), @r"
    ------- stderr -------
    error: there is no planner `nosuch`; expected one of builtin, ff, fast-downward
    [exit code: 2]
    ");
}

#[test]
fn what_a_planner_cannot_do_is_34_before_it_runs() {
    let lab = Lab::new();
    lab.write("rmem.toml", "");
    lab.write(
        "d.pddl",
        "(define (domain d) (:requirements :fluents) (:predicates (q)) (:functions (fuel))\n\
         (:action a :parameters () :precondition (>= (fuel) 1) :effect (and (q) (decrease (fuel) 1))))",
    );
    lab.write("p.pddl", "(define (problem p) (:domain d) (:init (= (fuel) 3)) (:goal (q)))");
    assert_run!(lab.rmem(&["plan", "-d", "d.pddl", "-p", "p.pddl", "--planner", "fast-downward"]), @r"
    ------- stderr -------
    stored in robmem.plans as [ID]
    error: fast-downward: the planner cannot handle the task: d.pddl:2:41: the planner `fast-downward` cannot handle numeric fluents
      |
    2 | (:action a :parameters () :precondition (>= (fuel) 1) :effect (and (q) (decrease (fuel) 1))))
      |                                         ^^^^^^^^^^^^^
      = hint: name another planner with --planner
    [exit code: 34]
    ");
    lab.rmem(&["plan", "-d", "d.pddl", "-p", "p.pddl"]).exits(0);
    // Its costs are whole numbers.
    lab.write(
        "d.pddl",
        "(define (domain d) (:requirements :action-costs) (:predicates (q)) (:functions (total-cost))\n\
         (:action a :parameters () :precondition () :effect (and (q) (increase (total-cost) 1.5))))",
    );
    lab.write(
        "p.pddl",
        "(define (problem p) (:domain d) (:init (= (total-cost) 0)) (:goal (q)) (:metric minimize (total-cost)))",
    );
    assert_run!(lab.rmem(&["plan", "-d", "d.pddl", "-p", "p.pddl", "--planner", "fast-downward"]), @r"
    ------- stderr -------
    stored in robmem.plans as [ID]
    error: fast-downward: the planner cannot handle the task: d.pddl:2:84: the planner `fast-downward` cannot handle fractional numbers
      |
    2 | …eters () :precondition () :effect (and (q) (increase (total-cost) 1.5))))
      |                                                                    ^^^
      = hint: name another planner with --planner
    [exit code: 34]
    ");
    lab.rmem(&["plan", "-d", "d.pddl", "-p", "p.pddl"]).exits(0);
}

#[test]
fn what_no_planner_can_do_of_a_task_is_refused_at_its_line_before_the_run() {
    let lab = Lab::new();
    lab.write(
        "d.pddl",
        "(define (domain d) (:requirements :strips :action-costs) (:predicates (q)) (:functions (total-cost))
  (:action go :parameters () :precondition () :effect (and (q) (increase (total-cost) 1))))",
    );
    let problem = |metric: &str| {
        format!("(define (problem p) (:domain d) (:init (= (total-cost) 0)) (:goal (q))\n  (:metric {metric}))")
    };
    for metric in ["minimize (* 2 (total-cost))", "maximize (total-cost)"] {
        lab.write("p.pddl", &problem(metric));
        let run = lab.rmem(&["plan", "-d", "d.pddl", "-p", "p.pddl", "--planner", "fast-downward"]).exits(34);
        let place = "p.pddl:2:3: the planner `fast-downward` cannot handle a metric other than `minimize (total-cost)`";
        assert!(run.stderr.contains(place), "{run}");
        lab.rmem(&["plan", "-d", "d.pddl", "-p", "p.pddl"]).exits(0);
    }
    lab.write(
        "t.pddl",
        "(define (domain t) (:requirements :durative-actions :derived-predicates) (:predicates (P) (Ready) (g))
  (:derived (Ready) (P))
  (:durative-action d :parameters () :duration (= ?duration 3) :condition (over all (Ready)) :effect (at end (g)))
  (:durative-action e :parameters () :duration (= ?duration 5) :condition () :effect (at start (P))))",
    );
    lab.write("u.pddl", "(define (problem u) (:domain t) (:init) (:goal (g)))");
    let run = lab.rmem(&["plan", "-d", "t.pddl", "-p", "u.pddl"]).exits(34);
    let words = "cannot handle derived predicates over facts that actions change, beside durative actions";
    assert!(run.stderr.contains("t.pddl:2:") && run.stderr.contains(words), "{run}");
}

#[test]
fn an_action_of_any_duration_is_planned_for() {
    let lab = Lab::new();
    let domain = "(define (domain d) (:requirements :durative-actions) (:predicates (p) (q))
      (:durative-action a :parameters () :duration () :condition () :effect (at end (p)))
      (:durative-action b :parameters () :duration (and) :condition (at start (p)) :effect (at end (q))))";
    lab.write("d.pddl", domain);
    lab.write("p.pddl", "(define (problem x) (:domain d) (:init) (:goal (q)))");
    let run = lab.rmem(&["-q", "plan", "-d", "d.pddl", "-p", "p.pddl", "--no-store"]).exits(0);
    lab.write("plan", &run.stdout);
    lab.rmem(&["validate", "d.pddl", "p.pddl", "plan"]).exits(0);
}

#[test]
fn a_timed_fact_is_waited_for_also_where_no_action_takes_time() {
    let lab = Lab::new();
    let domain = "(define (domain d) (:requirements :timed-initial-literals) (:predicates (p) (g) (q))
      (:action a :parameters () :precondition (and (p) (q)) :effect (g))
      (:action b :parameters () :precondition (and) :effect (q)))";
    lab.write("d.pddl", domain);
    for timed in ["(at 10 (p))", "(at 10 (p)) (at 15 (not (p)))"] {
        lab.write("p.pddl", &format!("(define (problem x) (:domain d) (:init {timed}) (:goal (g)))"));
        let run = lab.rmem(&["-q", "plan", "-d", "d.pddl", "-p", "p.pddl", "--no-store"]).exits(0);
        assert!(run.stdout.starts_with("0.000: (b)") && run.stdout.contains("\n10.001: (a)"), "{run}");
        lab.write("plan", &run.stdout);
        lab.rmem(&["validate", "d.pddl", "p.pddl", "plan"]).exits(0);
    }
}

#[test]
fn what_a_timed_literal_takes_away_from_the_goal_is_made_again_after_it() {
    let lab = Lab::new();
    let domain =
        "(define (domain d) (:requirements :durative-actions :timed-initial-literals) (:predicates (lit) (idle))
      (:durative-action light :parameters () :duration (= ?duration 2) :condition (over all (idle))
        :effect (at end (lit))))";
    lab.write("d.pddl", domain);
    for (timed, plan) in [
        ("(at 10 (not (lit)))", "8.001: (light) [2.000]\n"),
        ("(at 10 (not (lit))) (at 10.5 (not (idle)))", "8.001: (light) [2.000]\n"),
        ("(at 10 (not (lit))) (at 12 (lit))", ""),
    ] {
        lab.write("p.pddl", &format!("(define (problem x) (:domain d) (:init (lit) (idle) {timed}) (:goal (lit)))"));
        let run = lab.rmem(&["-q", "plan", "-d", "d.pddl", "-p", "p.pddl", "--no-store"]).exits(0);
        assert!(run.stdout.starts_with(plan) && run.stdout.contains("light") != plan.is_empty(), "{run}");
        lab.write("plan", &run.stdout);
        lab.rmem(&["validate", "d.pddl", "p.pddl", "plan"]).exits(0);
    }
    // In time there is no plan, which the order of starts and ends does not show.
    let timed = "(at 10 (not (lit))) (at 5 (not (idle)))";
    lab.write("p.pddl", &format!("(define (problem x) (:domain d) (:init (lit) (idle) {timed}) (:goal (lit)))"));
    lab.rmem(&["-q", "plan", "-d", "d.pddl", "-p", "p.pddl", "--no-store"]).exits(12);
    // No action makes it again.
    lab.write("d.pddl", &domain.replace("(at end (lit))", "(at end (idle))"));
    lab.rmem(&["-q", "plan", "-d", "d.pddl", "-p", "p.pddl", "--no-store"]).exits(11);
}

#[test]
fn a_timed_literal_that_changes_nothing_delays_nothing() {
    let lab = Lab::new();
    let domain = "(define (domain d) (:requirements :durative-actions :timed-initial-literals) (:predicates (open) (done))
      (:durative-action work :parameters () :duration (= ?duration 10) :condition (over all (open)) :effect (at end (done))))";
    lab.write("d.pddl", domain);
    let problem = "(define (problem x) (:domain d) (:init (open) (at 5 (open))) (:goal (and (done) (open))))";
    lab.write("p.pddl", problem);
    let run = lab.rmem(&["-q", "plan", "-d", "d.pddl", "-p", "p.pddl", "--no-store"]).exits(0);
    assert!(run.stdout.starts_with("0.000: (work) [10.000]\n"), "{run}");
}

/// The table of `fixtures/tasks/README.md`: task, and the exit codes that the built-in planner may end with.
fn tasks() -> Vec<(String, Vec<i32>)> {
    let table = std::fs::read_to_string(crate::lab::root().join("fixtures/tasks/README.md")).unwrap();
    let rows = table.lines().filter(|line| line.starts_with("| `"));
    rows.map(|row| {
        let cells: Vec<&str> = row.split('|').map(str::trim).collect();
        (cells[1].trim_matches('`').to_owned(), cells[5].split(" or ").map(|code| code.parse().unwrap()).collect())
    })
    .collect()
}

#[test]
fn every_kind_of_task_ends_with_its_exit_code() {
    let lab = Lab::new();
    let tasks = tasks();
    assert!(tasks.len() >= 13);
    for (task, codes) in tasks {
        let folder = format!("fixtures/tasks/{task}");
        let (domain, problem) = (format!("{folder}/domain.pddl"), format!("{folder}/problem.pddl"));
        // Tasks without end are cut off early; the others get all the time a busy machine may need.
        let timeout = if codes.iter().any(|code| [22, 23].contains(code)) { "1s" } else { "60s" };
        let limits = ["--timeout", timeout, "--memory-limit", "2G", "--no-store"];
        let run = lab.rmem(&[&["plan", "-d", &domain, "-p", &problem], &limits[..]].concat());
        assert!(codes.contains(&run.code), "{task}: {codes:?}\n{run}");
        if run.code == 34 {
            assert!(run.stderr.contains(&format!("{domain}:")), "{task}: {run}");
        }
    }
}

#[test]
fn numbers_that_are_names_come_back_as_numbers() {
    let lab = Lab::new();
    lab.write(
        "d.pddl",
        "(define (domain d) (:predicates (at ?x) (done ?x)) (:action go :parameters (?x) :precondition (at ?x) :effect (done ?x)))",
    );
    let template = |name: &str| {
        format!(
            "(define (problem p) (:domain d) (:objects {{% for o in query('lab.o') %}}{{{{ o.n{name} }}}} {{% endfor %}})
             (:init {{% for o in query('lab.o') %}}(at {{{{ o.n{name} }}}}) {{% endfor %}})
             (:goal (and {{% for o in query('lab.o') %}}(done {{{{ o.n{name} }}}}) {{% endfor %}})))"
        )
    };
    lab.write("plain.j2", &template(""));
    lab.write("named.j2", &template("|name"));
    lab.write(
        "markers",
        "(define (problem p) (:domain d) (:objects <<#A|{}>><<n>> <</A>>) (:init <<#A>>(at <<n>>) <</A>>) (:goal (and <<#A>>(done <<n>>) <</A>>)))",
    );
    let values = ["5", "NumberLong(7)", "2.5", "'8'", "'B 1'"];
    for value in values {
        lab.rmem(&["insert", "lab.o", &format!("{{n: {value}}}")]).success();
    }
    for template in ["plain.j2", "named.j2", "markers"] {
        lab.rmem(&["plan", "-d", "d.pddl", "-t", template, "--collection", "lab.o"]).success();
        let stored = lab.rmem(&["query", "robmem.plans", "--format", "canonical", "--sort", "{_id: -1}"]).success();
        let newest = stored.lines().next().unwrap();
        for value in
            ["{\"$numberInt\":\"5\"}", "{\"$numberLong\":\"7\"}", "{\"$numberDouble\":\"2.5\"}", "\"8\"", "\"B 1\""]
        {
            assert!(newest.contains(&format!("\"x\":{value}}}")), "{template}: {value}: {newest}");
        }
        lab.rmem(&["plan", "check", "last"]).exits(0);
        lab.rmem(&["drop", "robmem.plans"]).success();
    }
}

#[test]
fn names_are_written_as_the_memory_has_them() {
    let lab = Lab::new().env("RMEM_MEMORY", "file:m.rmem");
    lab.write(
        "domain.pddl",
        "(define (domain lamps) (:predicates (wick ?x) (lit ?x))
         (:action light :parameters (?x) :precondition (wick ?x) :effect (lit ?x)))",
    );
    lab.write(
        "p.j2",
        "(define (problem p) (:domain lamps) (:objects {% for l in query('a.b') %}{{ l.name }} {% endfor %})
         (:init {% for l in query('a.b') %}(wick {{ l.name }}) {% endfor %}) (:goal {{ goal }}))",
    );
    lab.rmem(&["insert", "a.b", "{name: 'box #18'}", "{name: 'box#17'}"]).success();
    let goal = "(and (lit \"box #18\") (lit box#17))";
    let found = lab.rmem(&["plan", "-d", "domain.pddl", "-t", "p.j2", "--goal", goal]);
    assert_run!(found, @r#"
    (light "box #18")
    (light box#17)
    ; cost = 2 (unit cost)
    ------- stderr -------
    stored in robmem.plans as [ID]
    [exit code: 0]
    "#);
    assert!(lab.rmem(&["plan", "list"]).success().contains("lit box#17"));
    // What was printed is read again.
    lab.write("plan.txt", &found.stdout);
    lab.rmem(&["gen-problem", "-t", "p.j2", "--goal", goal, "-o", "p.pddl"]).success();
    let files = ["validate", "domain.pddl", "p.pddl", "plan.txt", "plan.txt"];
    assert_eq!(lab.rmem(&files).success(), "plan.txt: the plan is valid, value 2\n".repeat(2));
    let verdict = parsed(&lab.rmem(&[&files[..4], &["--format", "json"]].concat()).success());
    assert_eq!((&verdict[0]["valid"], &verdict[0]["steps"]), (&json!(true), &json!(2)));
    let explain = ["gen-problem", "-t", "p.j2", "--goal", goal, "--explain", "(wick \"box #18\")"];
    assert_run!(lab.rmem(&explain), @r#"
    (wick "box #18"): in the initial state, line 2 of the problem
      p.j2:2:44: (:init {% for l in query('a.b') %}(wick {{ l.name }}) {% endfor %}) (:goal {{ goal }}))
      line 2: query('a.b') asks {} in a.b: 2 documents
      {"_id":{"$oid":"[ID]"},"name":"box #18"} in a.b
    ------- stderr -------
    [exit code: 0]
    "#);
}

pub(crate) fn parsed(text: &str) -> Value {
    serde_json::from_str(text.trim()).unwrap()
}

#[test]
fn a_report_is_printed_for_a_plan_and_for_a_failure_also_quietly() {
    let lab = Lab::new();
    let found = parsed(&plan(&lab, &["-q", "--format", "json"]).success());
    assert_eq!((&found["outcome"], &found["exit"], &found["cost"]), (&json!("success"), &json!(0), &json!(5)));
    let step = json!({"index": 1, "action": "stack", "args": {"x": "B", "y": "C"}, "list": ["B", "C"],
        "start": null, "duration": null, "status": "open"});
    assert_eq!(found["steps"][0], step);
    assert_eq!((&found["sections"][0]["line"], &found["namespace"]), (&json!(7), &json!("robmem.plans")));
    let id = found["id"].as_str().unwrap();
    assert_eq!(parsed(&lab.rmem(&["plan", "show", id, "--format", "json"]).success()), found);
    let none = unreachable(&lab);
    assert_eq!((&none["outcome"], &none["exit"], &none["steps"]), (&json!("unsolvable"), &json!(11), &json!([])));
}

/// The report of a task whose goal cannot be reached.
fn unreachable(lab: &Lab) -> Value {
    let task = ["-d", "fixtures/tasks/unreachable/domain.pddl", "-p", "fixtures/tasks/unreachable/problem.pddl"];
    parsed(&lab.rmem(&[&["plan", "-q", "--format", "json"], &task[..]].concat()).exits(11).stdout)
}

#[test]
fn a_plan_command_takes_no_options_of_planning() {
    let lab = Lab::new();
    assert_run!(lab.rmem(&["plan"]), @r"
    ------- stderr -------
    error: the following required arguments were not provided:
      --domain <FILE>
      <--problem <FILE>|--template <FILE>>

    Usage: rmem plan --domain <FILE> <--problem <FILE>|--template <FILE>>

    For more information, try '--help'.
    [exit code: 2]
    ");
    assert_run!(lab.rmem(&["plan", "--goal", "(a)"]), @r"
    ------- stderr -------
    error: the following required arguments were not provided:
      --domain <FILE>
      <--problem <FILE>|--template <FILE>>

    Usage: rmem plan --domain <FILE> --goal <GOAL> <--problem <FILE>|--template <FILE>>

    For more information, try '--help'.
    [exit code: 2]
    ");
    assert_run!(lab.rmem(&["plan", "--domain", "domains/blocksworld/domain.pddl", "list"]), @r"
    ------- stderr -------
    error: --domain, --problem and --template are given without a subcommand: rmem plan --domain FILE …
    [exit code: 2]
    ");
    lab.rmem(&["plan", "--memory", "mem:", "list"]).success();
}
