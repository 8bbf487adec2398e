//! plan show: the printed forms of stored plans, and their drawings.

use crate::lab::{Lab, assert_run, plan};

#[test]
fn a_stored_plan_is_shown_in_every_format() {
    let lab = Lab::new();
    let text = plan(&lab, &["-q"]).success();
    assert_eq!(lab.rmem(&["plan", "show", "last"]).success(), text);
    let show = |format| lab.rmem(&["plan", "show", "last", "--format", format]);
    assert_run!(show("document"), @r#"
    {"_id":{"$oid":"[ID]"},"plan":"success","1":{"action":"stack","x":"B","y":"C"},"2":{"action":"unstack","x":"D","y":"A"},"3":{"action":"putdown","x":"D"},"4":{"action":"pickup","x":"A"},"5":{"action":"stack","x":"A","y":"B"}}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(show("dot"), @r#"
    digraph "[ID]" {
      node [shape=box];
      init [shape=circle, label=""];
      s1 [label="1: (stack B C)"];
      s2 [label="2: (unstack D A)"];
      s3 [label="3: (putdown D)"];
      s4 [label="4: (pickup A)"];
      s5 [label="5: (stack A B)"];
      goal [shape=doublecircle, label=""];
      s1 -> s2 [label="(hand-empty)"];
      s2 -> s3 [label="(holding D)"];
      s3 -> s4 [label="(hand-empty)"];
      s4 -> s5 [label="(holding A)"];
      init -> s1;
      s5 -> goal;
    }
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(show("clips"), @r"
    (plan (id [ID]) (cost 5.0))
    (plan-action (id 1) (plan-id [ID]) (name stack) (arguments B C) (status FORMULATED))
    (plan-action (id 2) (plan-id [ID]) (name unstack) (arguments D A) (status FORMULATED))
    (plan-action (id 3) (plan-id [ID]) (name putdown) (arguments D) (status FORMULATED))
    (plan-action (id 4) (plan-id [ID]) (name pickup) (arguments A) (status FORMULATED))
    (plan-action (id 5) (plan-id [ID]) (name stack) (arguments A B) (status FORMULATED))
    ------- stderr -------
    [exit code: 0]
    ");
    assert_run!(show("ff"), @r"
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
    for (format, mark) in [("json", "{\"id\":"), ("svg", "<svg ")] {
        let shown = show(format).success();
        assert!(shown.contains(mark), "{format}: {shown}");
    }
}

#[test]
fn a_plan_is_drawn_in_lanes_with_its_causal_links() {
    let lab = Lab::new();
    plan(&lab, &[]).exits(0);
    lab.rmem(&["plan", "step", "last", "1", "--started"]).exits(0);
    lab.rmem(&["plan", "step", "last", "1", "--done"]).exits(0);
    let svg = lab.rmem(&["plan", "show", "last", "--format", "svg"]).success();
    for part in [
        "5 steps",
        ">1 stack<",
        ">makes true what is needed<",
        "fill=\"#c3e6d8\"",
        "marker-end=\"url(#arrow)\"",
        "<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>",
    ] {
        assert!(svg.contains(part), "no {part} in {svg}");
    }
    // Block B is put on C once: three blocks are moved, and each has a lane.
    assert_eq!(svg.matches("font-weight=\"bold\">A<").count(), 1, "{svg}");
    assert_run!(lab.rmem(&["plan", "show", "last", "--format", "svg", "--lanes", "nope"]), @r"
    ------- stderr -------
    error: --lanes: no step has a `nope`; expected one of x, y, action
    [exit code: 3]
    ");
    let lanes = lab.rmem(&["plan", "show", "last", "--format", "svg", "--lanes", "action"]).success();
    assert!(lanes.contains("font-weight=\"bold\">unstack<"), "{lanes}");
    let timeline = lab.rmem(&["plan", "show", "last", "--format", "timeline"]).success();
    assert!(timeline.contains(">planned<") && timeline.contains(">done<"), "{timeline}");
}

#[test]
fn the_graph_of_a_plan_is_its_partial_order() {
    let lab = Lab::new();
    plan(&lab, &[]).exits(0);
    let dot = lab.rmem(&["plan", "show", "last", "--format", "dot"]).success();
    // (unstack D A) needs the hand that (stack B C) leaves empty.
    assert!(dot.contains("s1 -> s2 [label="), "{dot}");
    assert!(dot.contains("init -> s1;") && dot.contains("s5 -> goal;"), "{dot}");
    assert!(!dot.contains("s1 -> s5"), "what follows from others is left out: {dot}");
}

/// The slots that executives have for plans, in deftemplates of our own.
const EXECUTIVES: &str = "(deftemplate plan (slot id (type SYMBOL)) (slot goal-id (type SYMBOL)) (slot cost (type FLOAT)))
(deftemplate plan-action
  (slot id (type INTEGER)) (slot plan-id (type SYMBOL)) (slot goal-id (type SYMBOL)) (slot action-name (type SYMBOL))
  (multislot param-names (type SYMBOL)) (multislot param-values) (slot duration (type FLOAT)) (slot dispatch-time (type FLOAT))
  (slot state (type SYMBOL) (allowed-values FORMULATED PENDING RUNNING FINAL FAILED)))
(deftemplate pddl-plan (slot id (type SYMBOL)) (slot instance (type SYMBOL)))
(deftemplate pddl-action
  (slot instance (type SYMBOL)) (slot id (type SYMBOL)) (slot plan (type SYMBOL)) (slot name (type SYMBOL))
  (multislot params (type SYMBOL)) (slot planned-start-time (type FLOAT)) (slot planned-duration (type FLOAT)))
";

#[test]
fn facts_fit_the_deftemplates_of_executives() {
    let lab = Lab::new();
    plan(&lab, &["-q"]).success();
    lab.write("executives.clp", EXECUTIVES);
    let show = |more: &[&str]| lab.rmem(&[&["plan", "show", "last", "--format", "clips", "--layout"], more].concat());
    let fawkes = show(&["fawkes", "--goal-id", "G1"]);
    assert_run!(fawkes, @r"
    (plan (id [ID]) (goal-id G1) (cost 5.0))
    (plan-action (id 1) (plan-id [ID]) (goal-id G1) (action-name stack) (param-names x y) (param-values B C) (state FORMULATED))
    (plan-action (id 2) (plan-id [ID]) (goal-id G1) (action-name unstack) (param-names x y) (param-values D A) (state FORMULATED))
    (plan-action (id 3) (plan-id [ID]) (goal-id G1) (action-name putdown) (param-names x) (param-values D) (state FORMULATED))
    (plan-action (id 4) (plan-id [ID]) (goal-id G1) (action-name pickup) (param-names x) (param-values A) (state FORMULATED))
    (plan-action (id 5) (plan-id [ID]) (goal-id G1) (action-name stack) (param-names x y) (param-values A B) (state FORMULATED))
    ------- stderr -------
    [exit code: 0]
    ");
    let cx = show(&["cx", "--instance", "test"]);
    // The first line and the first action.
    let start = |text: &str| text.lines().take(2).collect::<Vec<_>>().join("\n").replace(&id(text), "ID");
    assert_eq!(
        start(&cx.stdout),
        "(pddl-plan (id ID) (instance test))\n\
         (pddl-action (instance test) (id ID-1) (plan ID) (name stack) (params B C) (planned-start-time 0.0))"
    );
    for (facts, count) in [(fawkes.stdout, 6), (cx.stdout, 6)] {
        let import = ["clips", "import", "-", "--into", "robmem.facts", "--deftemplates", "executives.clp", "--strict"];
        let report = lab.rmem_with(&import, &facts).success();
        assert!(report.starts_with(&format!("{{\"inserted\":{count},")), "{report}");
    }
    assert_run!(lab.rmem(&["plan", "show", "last", "--layout", "cx"]), @r"
    ------- stderr -------
    error: --layout is for facts; add --format clips
    [exit code: 2]
    ");
}

/// The id of a plan, from its first fact.
fn id(facts: &str) -> String {
    facts.split_once("(id ").and_then(|(_, rest)| rest.split(')').next()).unwrap().to_owned()
}

#[test]
fn options_of_another_layout_are_refused() {
    let lab = Lab::new();
    plan(&lab, &["-q"]).success();
    let show = |more: &[&'static str]| [&["plan", "show", "last"], more].concat();
    let commands = [
        show(&["--format", "clips", "--layout", "cx", "--goal-id", "G"]),
        show(&["--goal-id", "G"]),
        show(&["--format", "clips", "--layout", "fawkes", "--instance", "I"]),
    ];
    assert_run!(lab.transcript(&commands.each_ref().map(|args| &args[..])), @r"
    $ rmem plan show last --format clips --layout cx --goal-id G
    ------- stderr -------
    error: --goal-id is for --format clips --layout fawkes; facts for cx have an --instance
    [exit code: 2]
    $ rmem plan show last --goal-id G
    ------- stderr -------
    error: --goal-id is for --format clips --layout fawkes
    [exit code: 2]
    $ rmem plan show last --format clips --layout fawkes --instance I
    ------- stderr -------
    error: --instance is for --format clips --layout cx
    [exit code: 2]
    ");
}

/// A robot that drives, with times.
const DRIVE: &str =
    "(define (domain d) (:requirements :typing :durative-actions) (:types r p) (:predicates (at ?r - r ?p - p))
  (:durative-action drive :parameters (?r - r ?a ?b - p) :duration (= ?duration 4) :condition (at start (at ?r ?a))
    :effect (and (at start (not (at ?r ?a))) (at end (at ?r ?b)))))";

#[test]
fn a_graph_has_the_names_of_the_plan() {
    let lab = Lab::new();
    lab.write("d.pddl", DRIVE);
    lab.write(
        "p.pddl",
        "(define (problem p) (:domain d) (:objects R1 - r A B C - p) (:init (at R1 A)) (:goal (at R1 C)))",
    );
    lab.write("t.plan", "0: (drive R1 A B) [4]\n4.1: (drive R1 B C) [4]\n");
    lab.rmem(&["plan", "import", "t.plan", "-d", "d.pddl", "-p", "p.pddl"]).success();
    let dot = lab.rmem(&["plan", "show", "last", "--format", "dot"]).success();
    assert!(dot.contains("s1 -> s2 [label=\"(at R1 B)\"]"), "{dot}");
}

#[test]
fn a_plan_with_times_but_without_steps_has_a_makespan() {
    let lab = Lab::new();
    lab.write("d.pddl", DRIVE);
    let task = "(define (problem p) (:domain d) (:objects R1 - r A - p) (:init (at R1 A)) (:goal (at R1 A)) METRIC)";
    for metric in ["(:metric minimize (total-time))", ""] {
        lab.write("p.pddl", &task.replace("METRIC", metric));
        let plan = ["plan", "-q", "-d", "d.pddl", "-p", "p.pddl"];
        assert_eq!(lab.rmem(&plan).success(), "; makespan = 0\n");
        assert_eq!(lab.rmem(&["plan", "show", "last"]).success(), "; makespan = 0\n");
        let report = lab.rmem(&[&plan[..], &["--format", "json"]].concat()).success();
        assert_eq!(super::parsed(&report)["makespan"], 0, "{report}");
    }
}

#[test]
fn a_name_that_a_format_cannot_write_is_refused_before_the_plan_is_stored() {
    let lab = Lab::new();
    lab.write("d.pddl", DRIVE);
    lab.write(
        "p.j2",
        "(define (problem p) (:domain d) (:objects {{ to }} A - p R1 - r) (:init (at R1 A)) (:goal (at R1 {{ to }})))",
    );
    let run = ["plan", "-d", "d.pddl", "-t", "p.j2", "-D", "to:=\"two\\nlines\"", "--format", "shell"];
    let refused = lab.rmem(&run).exits(3);
    assert!(!refused.stderr.contains("stored in"), "{refused}");
    assert_eq!(lab.rmem(&["count", "robmem.plans"]).success(), "0\n");
}
