//! Names as the memory has them, and JSON, in the commands about plans.

use serde_json::{Value, json};

use super::parsed;
use crate::lab::{Lab, assert_run};

/// A memory with lamps whose names are no names of PDDL, and a plan to light them.
fn lamps() -> Lab {
    let lab = Lab::new().env("RMEM_MEMORY", "file:m.rmem");
    lab.write(
        "domain.pddl",
        "(define (domain lamps) (:predicates (wick ?x) (lit ?x))
         (:action light :parameters (?x) :precondition (wick ?x) :effect (lit ?x)))",
    );
    lab.write(
        "p.j2",
        "(define (problem p) (:domain lamps) (:objects {% for l in query('a.b', {'name': lamp}) %}{{ l.name }} {% endfor %})
         (:init {% for l in query('a.b', {'name': lamp}) %}(wick {{ lamp }}) {% endfor %}) (:goal {{ goal }}))",
    );
    lab.rmem(&["insert", "-q", "a.b", "{name: 'box #18'}", "{name: 'box#17'}"]).success();
    lab
}

#[test]
fn names_of_parameters_and_steps_are_those_of_the_memory() {
    let lab = lamps();
    for (lamp, goal, step) in
        [("box #18", "(lit \"box #18\")", "(light \"box #18\")"), ("box#17", "(lit box#17)", "(LIGHT box#17)")]
    {
        let parameter = format!("lamp={lamp}");
        let task = ["plan", "-d", "domain.pddl", "-t", "p.j2", "-D", &parameter, "--goal", goal];
        let plan = lab.rmem(&task).success();
        assert!(plan.starts_with(&step.to_lowercase()), "{plan}");
        let words = [
            "gen-problem",
            "-t",
            "p.j2",
            "-D",
            &parameter,
            "--goal",
            goal,
            "--explain",
            &step.replace("light", "wick").replace("LIGHT", "wick"),
        ];
        assert!(lab.rmem(&words).success().contains("p.j2:2:"));
        let done = lab.rmem(&["plan", "step", "last", step, "--done"]).exits(0);
        assert!(done.stderr.ends_with(&format!("is done: {}\n", step.to_lowercase())), "{done}");
        let again = parsed(&lab.rmem(&["plan", "step", "last", "1", "--failed", "--format", "json"]).success());
        assert_eq!(
            (&again["status"], &again["list"], &again["args"]["x"]),
            (&json!("failed"), &json!([lamp]), &json!(lamp))
        );
    }
    let unknown = lab.rmem(&["plan", "step", "last", "(light box)", "--done"]).exits(2);
    assert!(unknown.stderr.contains("it has (light box#17)"), "{unknown}");
    let typed = lab.rmem(&["gen-problem", "-t", "p.j2", "-D", "lamp:={$ne: 'box#17'}", "--goal", "(lit a)"]);
    assert_eq!(typed.exits(3).stdout, "", "a document has no name");
}

#[test]
fn json_is_json_for_every_command_about_plans() {
    let lab = lamps();
    lab.rmem(&["plan", "-d", "domain.pddl", "-t", "p.j2", "-D", "lamp=box#17", "--goal", "(lit box#17)"]).success();
    let why = parsed(&lab.rmem(&["plan", "why", "last", "--format", "json"]).success());
    assert_eq!((&why["outcome"], &why["goal"]), (&json!("success"), &json!("(lit box#17)")));
    assert_eq!((&why["domain"]["file"], &why["domain"]["changed"]), (&json!("domain.pddl"), &json!(false)));
    assert_eq!((&why["queries"][0]["count"], &why["execution"]["steps"]), (&json!(1), &json!(1)));
    assert!(why.get("sources").is_none(), "{why}");
    let task = ["-d", "domain.pddl", "-t", "p.j2", "-D", "lamp=box#17", "--goal", "(lit box#17)", "--format", "json"];
    lab.write("plan.txt", "(light box#17)\n");
    let imported = parsed(&lab.rmem(&[&["plan", "import", "plan.txt"], &task[..]].concat()).success());
    assert_eq!((&imported["planner"], &imported["steps"][0]["list"]), (&json!("import"), &json!(["box#17"])));
    lab.write("wrong.txt", "(light box#18)\n");
    let refused = parsed(&lab.rmem(&[&["plan", "import", "wrong.txt"], &task[..]].concat()).exits(1).stdout);
    assert_eq!((&refused["outcome"], &refused["exit"], &refused["id"]), (&json!("invalid"), &json!(1), &Value::Null));
    for command in [["plan", "why"], ["plan", "step"], ["plan", "import"], ["plan", "list"]] {
        let help = lab.rmem(&[&command[..], &["--help"]].concat()).success();
        assert!(help.contains("Output format: ") && help.contains("json"), "{help}");
    }
}

#[test]
fn explanations_checks_and_drawings_have_names_as_the_memory_has_them() {
    let lab = lamps();
    let task = ["plan", "-d", "domain.pddl", "-t", "p.j2", "-D", "lamp=box #18", "--goal"];
    let words = |more: &[&'static str]| [&task[..], more].concat();
    assert_run!(lab.rmem(&words(&["(lit \"box #18\")", "-q", "--format", "dot"])), @r#"
    digraph "[ID]" {
      node [shape=box];
      init [shape=circle, label=""];
      s1 [label="1: (light \"box #18\")"];
      goal [shape=doublecircle, label=""];
      init -> s1;
      s1 -> goal;
    }
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&words(&["(wick ä)"])), @r#"
    ------- stderr -------
    error: p.j2:2:99: object `ä` is not declared
      |
    2 | …y('a.b', {'name': lamp}) %}(wick {{ lamp }}) {% endfor %}) (:goal {{ goal }}))
      |                                                                    ^^^^^^^^^^
      = hint: the goal is (wick ä)
      = hint: it became line 2 of the problem: (:init (wick "box #18") ) (:goal (wick ä)))
    [exit code: 3]
    "#);
    lab.rmem(&["delete", "-q", "a.b", "{name: 'box #18'}"]).success();
    lab.rmem(&["insert", "-q", "a.c", "{name: 'box #18'}"]).success();
    lab.write("p.j2", &lab.read("p.j2").replacen("query('a.b'", "query('a.c'", 1));
    lab.rmem(&["insert", "-q", "a.b", "{name: 'box #18'}"]).success();
    lab.rmem(&words(&["(lit \"box #18\")", "-q"])).success();
    lab.rmem(&["delete", "-q", "a.b", "{name: 'box #18'}"]).success();
    assert_run!(lab.rmem(&["plan", "check", "last"]), @r#"
    [ID] does not hold: step 1: (light "box #18") is not applicable: (wick "box #18") is false
      p.j2:2: not in the problem; it would be written by (:init {% for l in query('a.b', {'name': lamp}) %}(wick {{ lamp }}) {% endfor %}) (:goal {{ goal }}))
        line 2: query('a.b', {'name': lamp}) asks {"name":"box #18"} in a.b: 0 documents
      (wick "box #18"): false in the initial state
        no action makes it true; it has to hold in the initial state
    ------- stderr -------
    [exit code: 1]
    "#);
    assert_run!(lab.rmem(&words(&["(lit \"box #18\")", "--no-store"])), @r#"
    ------- stderr -------
    warning: line 2: query('a.b', {'name': lamp}) in a.b: 0 documents
      a.b: 1 document, 0 match
        alone  together  condition
            0         0  {"name":"box #18"}
                         {name: "box#17"} matches 1 document
    error: builtin: proven: no plan exists: goal can be simplified to FALSE. No plan will solve it
    why: the goal asks for (lit "box #18"), which can never hold
           (light "box #18") would make it true, but needs (wick "box #18")
         and (wick "box #18"), which can never hold: no action makes it true
    never true, in the initial state or by an action: wick
    change the goal, or what the memory says: `rmem gen-problem --explain ATOM` shows where a fact comes from
    [exit code: 11]
    "#);
}

#[test]
fn names_that_are_operators_variables_or_keywords_are_printed_in_quotes_and_read_back() {
    let lab = lamps();
    lab.write(
        "all.j2",
        "(define (problem p) (:domain lamps) (:objects {% for l in query('a.b') %}{{ l.name }} {% endfor %})
         (:init {% for l in query('a.b') %}(wick {{ l.name }}) {% endfor %}) (:goal (lit {{ lamp }})))",
    );
    for name in ["*", "+", "-", "/", "=", "<", ">=", "?x", ":a", "x--a--x", "not"] {
        lab.rmem(&["insert", "-q", "a.b", &format!("{{name: '{name}'}}")]).success();
        let parameter = format!("lamp={name}");
        let task = ["-d", "domain.pddl", "-t", "all.j2", "-D", &parameter];
        let plan = lab.rmem(&[&["plan", "-q"], &task[..]].concat()).success();
        let step = format!("(light \"{name}\")");
        assert_eq!(plan.lines().next(), Some(step.as_str()));
        lab.write("p", &plan);
        lab.rmem(&[&["plan", "import", "-q", "p"], &task[..]].concat()).success();
        lab.write("p.pddl", &lab.rmem(&[&["gen-problem", "-q"], &task[2..]].concat()).success());
        lab.rmem(&["validate", "domain.pddl", "p.pddl", "p"]).success();
        lab.rmem(&["plan", "step", "last", &step, "--done"]).success();
        let goal = format!("(lit \"{name}\")");
        lab.rmem(&["plan", "-q", "-d", "domain.pddl", "-t", "p.j2", "-D", &parameter, "--goal", &goal]).success();
    }
}
