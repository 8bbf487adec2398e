//! Scenarios from end to end: facts of CLIPS, a template in the spelling of Fawkes, a plan, and facts again.

use super::lab;
use crate::lab::assert_run;

#[test]
fn the_world_of_an_executive_becomes_a_plan() {
    let lab = lab();
    let world = "fixtures/clips/executive/world.clp";
    assert_run!(lab.rmem(&["clips", "import", world, "--into", "robmem.clipswm"]), @r#"
    {"inserted":6,"replaced":0,"unchanged":0}
    ------- stderr -------
    1 fact was in the text more than once; each was imported once
    used the values of 1 defglobal: ?*HELLO*
    passed over 1 printout
    [exit code: 0]
    "#);
    let goal = "(and (said PEGGY HELLO) (said PEGGY GOODBYE))";
    let template = ["--template", "fixtures/clips/executive/problem.pddl", "--collection", "robmem.clipswm"];
    let task = [&["--domain", "fixtures/clips/executive/domain.pddl", "--goal", goal], &template[..]].concat();
    let problem = lab.rmem(&[&["gen-problem"], &task[..]].concat()).success();
    for part in ["PEGGY - person\n", "GOODBYE - word\n", "(opening  HELLO)\n", "(said  BOB HELLO)\n"] {
        assert!(problem.contains(part), "{problem}");
    }
    assert_run!(lab.rmem(&[&["plan", "--layout", "fawkes"], &task[..]].concat()), @r"
    (open PEGGY HELLO)
    (go-on PEGGY HELLO GOODBYE)
    ; cost = 2 (unit cost)
    ------- stderr -------
    `param_values` was found as `param-values`
    stored in robmem.plans as [ID]
    [exit code: 0]
    ");
    let stored = "{\"plan\":1,\"actions\":[{\"name\":\"open\",\"args\":[\"PEGGY\",\"HELLO\"]},\
                  {\"name\":\"go-on\",\"args\":[\"PEGGY\",\"HELLO\",\"GOODBYE\"]}]}\n";
    assert_eq!(lab.rmem(&["query", "robmem.plans", "--fields", "{_id: 0}"]).success(), stored);
    let export = ["clips", "export", "robmem.clipswm", "{relation: 'domain-fact'}", "--deftemplates", world];
    let facts =
        "(domain-fact (name opening) (param-values HELLO))\n(domain-fact (name said) (param-values BOB HELLO))\n";
    assert_eq!(lab.rmem(&export).success(), facts);
}

#[test]
#[cfg(feature = "clips-engine")]
fn an_executive_keeps_the_memory_plans_and_acts() {
    let lab = lab();
    let programs = ["clips", "run", "fixtures/clips/executive/world.clp", "fixtures/clips/executive/agent.clp"];
    assert_run!(lab.rmem(&[&programs[..], &["--collection", "robmem.clipswm"]].concat()), @r"
    planning for (and (said PEGGY HELLO) (said PEGGY GOODBYE))
    open PEGGY HELLO
    go-on PEGGY HELLO GOODBYE
    ------- stderr -------
    loading the world
    `param_values` was found as `param-values`
    [exit code: 0]
    ");
    let facts = "{relation: 'domain-fact', name: 'said'}";
    let query = ["query", "robmem.clipswm", facts, "--fields", "{_id: 0}", "--sort", "{'param-values': 1}"];
    let stored = "{\"relation\":\"domain-fact\",\"name\":\"said\",\"param-values\":[\"BOB\",\"HELLO\"]}
{\"relation\":\"domain-fact\",\"name\":\"said\",\"param-values\":[\"PEGGY\",\"GOODBYE\"]}
{\"relation\":\"domain-fact\",\"name\":\"said\",\"param-values\":[\"PEGGY\",\"HELLO\"]}\n";
    assert_eq!(lab.rmem(&query).success(), stored);
}

#[test]
fn facts_of_a_game_become_a_plan_by_the_template_of_the_league() {
    let lab = lab();
    let (facts, globals) = ("fixtures/clips/rcll/facts.clp", "fixtures/clips/rcll/globals.clp");
    let import = ["clips", "import", facts, "--deftemplates", globals];
    assert_run!(lab.rmem(&import), @r#"
    {"inserted":7,"replaced":0,"unchanged":0}
    ------- stderr -------
    passed over 1 unwatch
    [exit code: 0]
    "#);
    let task = ["--domain", "domains/rcll/domain.pddl", "--template", "templates/rcll/problem.pddl.tmpl"];
    assert_run!(lab.rmem(&[&["plan", "-q", "--goal", "(fulfilled O2)"], &task[..]].concat()), @r"
    (enter R-1 C-BS OUTPUT)
    (dispense C-BS WP1 O2 BASE_BLACK)
    (move R-1 C-BS OUTPUT C-CS1 INPUT)
    (buffer-cap R-1 C-CS1 N3 N2)
    (move R-1 C-CS1 INPUT C-CS1 OUTPUT)
    (pick-carrier R-1 C-CS1)
    (move R-1 C-CS1 OUTPUT C-BS OUTPUT)
    (discard R-1)
    (pick R-1 WP1 C-BS)
    (move R-1 C-BS OUTPUT C-CS1 INPUT)
    (mount-cap R-1 C-CS1 WP1 O2 CAP_BLACK C0)
    (move R-1 C-CS1 INPUT C-CS1 OUTPUT)
    (pick R-1 WP1 C-CS1)
    (move R-1 C-CS1 OUTPUT C-DS INPUT)
    (deliver R-1 C-DS WP1 O2 GATE-1)
    ; cost = 15 (unit cost)
    ------- stderr -------
    [exit code: 0]
    ");
    assert_run!(lab.rmem(&import), @r#"
    {"inserted":0,"replaced":0,"unchanged":7}
    ------- stderr -------
    7 facts were in robmem.worldmodel already
    passed over 1 unwatch
    [exit code: 0]
    "#);
    let exported = "(machine (name C-BS) (mtype BS) (x 0.5) (team CYAN))
(machine (name C-CS1) (mtype CS) (x -2.5) (team CYAN))
(machine (name C-DS) (mtype DS) (x -7.0) (team CYAN))
(order (id 2) (complexity C0) (base BASE_BLACK) (rings) (cap CAP_BLACK) (gate GATE-1) (delivered FALSE))\n";
    let export = ["clips", "export", "robmem.worldmodel", "{relation: {$in: ['machine', 'order']}}"];
    assert_eq!(lab.rmem(&export).success(), exported);
}
