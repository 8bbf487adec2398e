//! clips import: programs as they are, with globals, equal facts and keys.

use super::lab;
use crate::lab::assert_run;

/// Globals of a game, in a file of their own.
const GLOBALS: &str = "(defglobal MAIN ?*EAST* = 1.5 ?*COLORS* = (create$ RED BLACK)
  ?*START* = (now))\n(defglobal ?*WEST* = (* ?*EAST* 2))\n";

#[test]
fn facts_have_the_values_of_globals() {
    let lab = lab();
    lab.write("globals.clp", GLOBALS);
    lab.write(
        "facts.clp",
        "(defglobal ?*TEAM* = \"CYAN\" ?*NAME* = (str-cat ?*TEAM* \"-1\"))
(deftemplate station (slot name) (slot x) (multislot colors) (slot team (default ?*TEAM*)))
(deffacts stations
  (station (name ?*NAME*) (x ?*EAST*) (colors ?*COLORS* WHITE))
  (at ?*WEST* (+ 1 ?*EAST*)))\n",
    );
    assert_run!(lab.rmem(&["clips", "import", "facts.clp", "--deftemplates", "globals.clp"]), @r#"
    {"inserted":2,"replaced":0,"unchanged":0}
    ------- stderr -------
    used the values of 2 defglobal: ?*TEAM*, ?*NAME*
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&["clips", "export"]), @r#"
    (station (name "CYAN-1") (x 1.5) (colors RED BLACK WHITE) (team "CYAN"))
    (at 3.0 2.5)
    ------- stderr -------
    2 facts
    [exit code: 0]
    "#);
}

#[test]
fn computed_integers_go_into_slots_for_floats() {
    let lab = lab();
    let template = "(deftemplate pose (multislot at (type FLOAT)))";
    let program = format!("(defglobal ?*NORTH* = 0)\n{template}\n(deffacts f (pose (at 1.5 ?*NORTH* (+ 1 1))))");
    lab.rmem_with(&["clips", "import"], &program).success();
    assert_eq!(lab.rmem(&["clips", "export"]).success(), "(pose (at 1.5 0.0 2.0))\n");
    assert_run!(lab.rmem_with(&["clips", "import"], &format!("{template}\n(deffacts f (pose (at 1)))")), @r"
    ------- stderr -------
    error: <stdin>:2:19: the slot `at` expected FLOAT, found INTEGER `1`; write 1.0
      |
    2 | (deffacts f (pose (at 1)))
      |                   ^^^^^^
    [exit code: 3]
    ");
}

#[test]
fn a_global_without_a_known_value_is_an_error_where_it_is_used() {
    let lab = lab();
    lab.write("globals.clp", GLOBALS);
    let import = ["clips", "import", "-", "--deftemplates", "globals.clp"];
    assert_run!(lab.rmem_with(&import, "(deffacts f\n  (at ?*START*))"), @r"
    ------- stderr -------
    error: <stdin>:2:7: the value of `?*START*` is known only to a running CLIPS
      |
    2 |   (at ?*START*))
      |       ^^^^^^^^
      = hint: in its defglobal: expected `create$` or arithmetic, found the function `now`
    [exit code: 3]
    ");
    assert_run!(lab.rmem_with(&import, "(deffacts f\n  (at ?*NORTH*))"), @r"
    ------- stderr -------
    error: <stdin>:2:7: expected a value, found the variable `?*NORTH*`
      |
    2 |   (at ?*NORTH*))
      |       ^^^^^^^^
      = hint: no defglobal before this place, or in --deftemplates, defines `?*NORTH*`
    [exit code: 3]
    ");
    assert_run!(lab.rmem_with(&import, "(at ?*EAST*)"), @r"
    ------- stderr -------
    error: <stdin>:1:5: expected a value, found the variable `?*EAST*`
      |
    1 | (at ?*EAST*)
      |     ^^^^^^^
      = hint: a fact holds constants only
    [exit code: 3]
    ");
}

#[test]
fn comments_may_have_any_bytes_and_strings_may_not() {
    let lab = lab();
    let write = |name: &str, bytes: &[u8]| std::fs::write(lab.path().join(name), bytes).unwrap();
    write("facts.clp", b"; Gr\xfc\xdfe\n(deffacts f (at \"a;b\")) ; \xe4 \"\n(at c) ;\xff");
    write("templates.clp", b";\xfc\n(deftemplate x (slot a))");
    lab.rmem(&["clips", "import", "facts.clp", "--deftemplates", "templates.clp"]).success();
    assert_eq!(lab.rmem(&["clips", "export"]).success(), "(at \"a;b\")\n(at c)\n");
    write("text.clp", b"; \xfc\n(at \"cup\xe9; x\") ; \xfc\n");
    assert_run!(lab.rmem(&["clips", "import", "text.clp"]), @r#"
    ------- stderr -------
    error: text.clp:2:9: expected UTF-8 text, found invalid UTF-8
      |
    2 | (at "cup�; x") ; �
      |         ^
      = hint: if this is Latin-1, convert it by iconv -f latin1 -t utf-8 text.clp
    [exit code: 3]
    "#);
}

#[test]
fn a_comment_of_another_language_gets_a_hint() {
    assert_run!(lab().rmem_with(&["clips", "import"], "/* it's Jess */\n(a 1)"), @r"
    ------- stderr -------
    error: <stdin>:1:1: expected a fact or a construct `(…)`, found `/*`
      |
    1 | /* it's Jess */
      | ^^
      = hint: a comment in CLIPS begins with `;` and goes to the end of its line
    [exit code: 3]
    ");
    for text in ["/* a \"b */ (a 1)", "(a 1)\n// b\n(b 2)", "(a /* b */ 1)"] {
        let run = lab().rmem_with(&["clips", "import"], text);
        assert_eq!(run.stderr.contains("a comment in CLIPS begins with `;`"), !text.starts_with("(a /"), "{run}");
    }
}

#[test]
fn equal_facts_are_one_fact() {
    let lab = lab();
    let facts =
        "(on a b)\n(t (x 1) (y \"a\"))\n(on a b)\n(t (y \"a\") (x 1))\n(t (x 1.0) (y \"a\"))\n(t (x 1) (y a))\n";
    assert_run!(lab.rmem_with(&["clips", "import"], facts), @r#"
    {"inserted":4,"replaced":0,"unchanged":0}
    ------- stderr -------
    2 facts were in the text more than once; each was imported once
    [exit code: 0]
    "#);
    assert_run!(lab.rmem_with(&["clips", "import"], "(on a b)\n(t (y a) (x 1))\n(on a \"b\")\n(on a)"), @r#"
    {"inserted":2,"replaced":0,"unchanged":2}
    ------- stderr -------
    2 facts were in robmem.worldmodel already
    [exit code: 0]
    "#);
    let stored = "(on a b)\n(t (x 1) (y \"a\"))\n(t (x 1.0) (y \"a\"))\n(t (x 1) (y a))\n(on a \"b\")\n(on a)\n";
    assert_eq!(lab.rmem(&["clips", "export"]).success(), stored);
}

#[test]
fn several_keys_identify_facts_together() {
    let lab = lab();
    let import = ["clips", "import", "--key", "name,team"];
    lab.rmem_with(&import, "(m (name A) (team C) (v 1))\n(m (name A) (team M) (v 1))").success();
    let report = lab
        .rmem_with(
            &["clips", "import", "--key", "name", "--key", "team"],
            "(m (name A) (team M) (v 2))\n(m (name B) (team M) (v 2))",
        )
        .success();
    assert_eq!(report, "{\"inserted\":1,\"replaced\":1,\"unchanged\":0}\n");
    let stored = "(m (name A) (team C) (v 1))\n(m (name A) (team M) (v 2))\n(m (name B) (team M) (v 2))\n";
    assert_eq!(lab.rmem(&["clips", "export"]).success(), stored);
    assert_run!(lab.rmem_with(&import, "(m (name A) (team C) (v 1))\n(n (name A) (team C))"), @r#"
    ------- stderr -------
    error: <stdin>:2:1: another fact has the key `name` "A", `team` "C"
      |
    2 | (n (name A) (team C))
      | ^^^^^^^^^^^^^^^^^^^^^
      = hint: the other fact is at 1:1
    [exit code: 3]
    "#);
    assert_run!(lab.rmem_with(&import, "(m (name A))"), @r"
    ------- stderr -------
    error: <stdin>:1:1: expected the slot `team`, the key
      |
    1 | (m (name A))
      | ^^^^^^^^^^^^
      = hint: import facts that have no such slot from a file of their own, without --key
    [exit code: 3]
    ");
}

#[test]
fn commands_of_a_program_are_skipped_and_counted() {
    let program = "(load* \"utils.clp\")
(printout t \"loading\" crlf)
(deftemplate t (slot a))
(defglobal MAIN ?*A* = 1 ?*B* = (now))
(do-for-fact ((?f t)) (eq ?f:a ?*A*) (retract ?f))
(if (not (member$ X (get-defglobal-list))) then (build \"(defglobal ?*X* = 1)\"))
(deffunction init (?x) ?x)
(init 3)
(blackboard-open-reading \"SkillerInterface\" \"Skiller\")
(t (a 1))
(assert (at r1 ?*A*))
(reset)
(run)\n";
    assert_run!(lab().rmem_with(&["clips", "import"], program), @r#"
    {"inserted":2,"replaced":0,"unchanged":0}
    ------- stderr -------
    used the values of 1 defglobal: ?*A*
    passed over 1 blackboard-open-reading
    passed over 1 deffunction: init
    passed over 1 defglobal: ?*B*
    passed over 1 do-for-fact
    passed over 1 if
    passed over 1 init
    passed over 1 load*: "utils.clp"
    passed over 1 printout
    passed over 1 reset
    passed over 1 run
    [exit code: 0]
    "#);
    // Without constructs these are facts.
    assert_run!(lab().rmem_with(&["clips", "import"], "(run 1)\n(watch r1 c1)"), @r#"
    {"inserted":2,"replaced":0,"unchanged":0}
    ------- stderr -------
    [exit code: 0]
    "#);
}

#[test]
fn a_misspelt_construct_is_an_error() {
    let lab = lab();
    assert_run!(lab.rmem_with(&["clips", "import"], "(defrule a => )\n(defffunction f (?x) ?x)"), @r"
    ------- stderr -------
    error: <stdin>:2:2: expected a fact or a construct, found `defffunction`
      |
    2 | (defffunction f (?x) ?x)
      |  ^^^^^^^^^^^^
      = hint: did you mean `deffunction`?
    [exit code: 3]
    ");
    lab.write("t.clp", "(deftemplat t (slot a (type FLOAT)))");
    assert_run!(lab.rmem_with(&["clips", "import", "--deftemplates", "t.clp"], "(t (a 1))"), @r"
    ------- stderr -------
    error: t.clp:1:2: expected a fact or a construct, found `deftemplat`
      |
    1 | (deftemplat t (slot a (type FLOAT)))
      |  ^^^^^^^^^^
      = hint: did you mean `deftemplate`?
    [exit code: 3]
    ");
}

#[test]
fn a_call_is_not_taken_for_a_slot() {
    assert_run!(lab().rmem_with(&["clips", "import"], "(deffacts t\n  (last-seen (now))\n  (init (time)))"), @r"
    ------- stderr -------
    error: <stdin>:2:14: expected `create$` or arithmetic, found the function `now`
      |
    2 |   (last-seen (now))
      |              ^^^^
      = hint: no deftemplate `last-seen` is known, so this is a call of a function, as in CLIPS; if it is a slot, name the file of the deftemplate: --deftemplates FILE
    [exit code: 3]
    ");
    assert_run!(lab().rmem_with(&["clips", "import"], "(deffacts t (limit (max 3)) (on (a 1)))"), @r#"
    {"inserted":2,"replaced":0,"unchanged":0}
    ------- stderr -------
    warning: no deftemplate `limit`: took `max` for a slot; CLIPS would call the function `max`
    [exit code: 0]
    "#);
    // Facts as CLIPS prints them have no calls.
    assert_run!(lab().rmem_with(&["clips", "import"], "(limit (max 3) (now))"), @r#"
    {"inserted":1,"replaced":0,"unchanged":0}
    ------- stderr -------
    [exit code: 0]
    "#);
}

#[test]
fn what_deftemplates_do_not_say_is_said() {
    let lab = lab();
    lab.write("t.clp", "(deftemplate machine (slot name) (slot seen (default-dynamic (now))))");
    lab.write("rules.clp", "(defrule r (a) =>)");
    let import = |file: &'static str| ["clips", "import", "--deftemplates", file];
    assert_run!(lab.rmem_with(&import("t.clp"), "(machine (name A)) (machin (name B)) (machine (name C)) (at A)"), @r#"
    {"inserted":4,"replaced":0,"unchanged":0}
    ------- stderr -------
    warning: no deftemplate `machin`; its facts were not checked; did you mean `machine`?
    the slot `seen` of `machine` was left out where a fact does not give it: its default is computed by CLIPS
    [exit code: 0]
    "#);
    assert_run!(lab.rmem_with(&import("rules.clp"), "(a 1)"), @r"
    ------- stderr -------
    error: --deftemplates: rules.clp has no deftemplate
    [exit code: 3]
    ");
}

#[test]
fn instances_are_not_imported_and_named() {
    let instances = "(definstances robots (R1 of ROBOT))";
    assert_run!(lab().rmem_with(&["clips", "import"], instances), @r"
    ------- stderr -------
    error: <stdin>: instances of classes cannot be imported, only facts; nothing was imported
    [exit code: 3]
    ");
    assert_run!(lab().rmem_with(&["clips", "import"], &format!("{instances} (a 1)")), @r#"
    {"inserted":1,"replaced":0,"unchanged":0}
    ------- stderr -------
    warning: instances of classes cannot be imported, only facts
    passed over 1 definstances: robots
    [exit code: 0]
    "#);
    assert_run!(lab().rmem_with(&["clips", "import"], "([R1] of ROBOT (x 1))"), @r"
    ------- stderr -------
    error: <stdin>:1:2: expected the name of a template, found `[R1]`
      |
    1 | ([R1] of ROBOT (x 1))
      |  ^^^^
      = hint: instances of classes cannot be imported
    [exit code: 3]
    ");
}

#[test]
fn two_imports_at_once_store_each_fact_once() {
    let lab = lab();
    let facts: String = (0..300).map(|n| format!("(block (id {n}) (at \"place {n}\"))\n")).collect();
    lab.write("facts.clp", &facts);
    for (namespace, more) in [("a.equal", &[][..]), ("a.keyed", &["--key", "id"])] {
        let import = || lab.rmem(&[&["clips", "import", "facts.clp", "--into", namespace], more].concat()).success();
        std::thread::scope(|scope| {
            let both = [scope.spawn(import), scope.spawn(import)].map(|run| run.join().unwrap());
            assert_eq!(both.iter().filter(|report| report.contains("\"inserted\":300")).count(), 1, "{both:?}");
        });
        assert_eq!(lab.rmem(&["count", namespace]).success(), "300\n", "{namespace}");
    }
}
