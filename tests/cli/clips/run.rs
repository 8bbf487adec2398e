//! clips run: programs with the memory's functions.

use std::fmt::Write as _;

use crate::lab::watch::Watch;
use crate::lab::{Finished, Lab, assert_run};

fn lab() -> Lab {
    Lab::new().env("RMEM_MEMORY", "file:m.rmem")
}

/// Runs a program.
#[track_caller]
fn run(lab: &Lab, program: &str, more: &[&str]) -> Finished {
    lab.write("program.clp", program);
    lab.rmem(&[&["clips", "run", "program.clp"], more].concat())
}

/// What a rule prints that does these actions once.
#[track_caller]
fn printed(lab: &Lab, actions: &str) -> String {
    run(lab, &format!("(defrule go => {actions})"), &[]).success()
}

#[test]
fn a_program_runs_until_no_rule_can_fire() {
    let lab = lab();
    lab.write("facts.txt", "(n 3)\n(t (a \"x y\") (m 1 2.5 [i]))\n");
    let program = "(deftemplate t (slot a (type STRING)) (multislot m) (slot d (default 7)))
        (deffacts start (n 1))
        (defrule n (n ?n) => (printout t \"n \" ?n crlf))
        (defrule t (t (a ?a) (m $?m) (d ?d)) => (printout t ?a \" \" ?m \" \" ?d crlf))";
    let text = run(&lab, program, &["--facts", "facts.txt"]).success();
    let mut lines: Vec<&str> = text.lines().collect();
    lines.sort_unstable();
    assert_eq!(lines, ["n 1", "n 3", "x y (1 2.5 [i]) 7"]);
    assert_eq!(run(&lab, program, &["--facts", "facts.txt", "--cycles", "2"]).success().lines().count(), 2);
}

#[test]
fn what_does_not_load_is_reported_with_its_line() {
    let lab = lab();
    let program = "(deftemplate t (slot a))\n\n(defrule r\n  (t (b 1))\n  =>)\n(defrule s (x) => (nofunction))\n";
    assert_run!(run(&lab, program, &[]), @r"
    ------- stderr -------
    error: program.clp:4:3: [TMPLTDEF1] Invalid slot 'b' not defined in corresponding deftemplate 't'.
      |
    4 |   (t (b 1))
      |   ^^^^^^^^^
    error: program.clp:6:1: [EXPRNPSR3] Missing function declaration for 'nofunction'.
      |
    6 | (defrule s (x) => (nofunction))
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    ");
    assert_run!(run(&lab, "(defrule r (x) => (printout t \"x\" crlf)", &[]), @r#"
    ------- stderr -------
    error: program.clp:1:1: [PRNTUTIL2] Syntax Error: Check appropriate syntax for defrule.
      |
    1 | (defrule r (x) => (printout t "x" crlf)
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    "#);
    lab.write("facts.txt", "(t (a 1))\n(t (a \"x\"))\n(u (a 1))\n");
    assert_run!(run(&lab, "(deftemplate t (slot a (type INTEGER)))", &["--facts", "facts.txt"]), @r#"
    ------- stderr -------
    error: facts.txt:2:4: the slot `a` expected INTEGER, found STRING `"x"`
      |
    2 | (t (a "x"))
      |    ^^^^^^^
    [exit code: 3]
    "#);
    let mut deep = "(defrule r => ".to_owned();
    deep.push_str(&"(+ 1 ".repeat(2_000_000));
    // The whole program is in the message's line.
    assert!(run(&lab, &deep, &[]).exits(3).stderr.contains("nested at most"));
}

#[test]
fn a_program_ends_with_its_own_code_or_with_that_of_its_error() {
    let lab = lab();
    assert_eq!(
        run(&lab, "(defrule r => (printout t \"bye\") (exit 7) (printout t \"not\"))", &[]).exits(7).stdout,
        "bye"
    );
    run(&lab, "(defrule r => (exit))", &[]).exits(0);
    run(
        &lab,
        "(deffacts f (a) (b)) (defrule r (a) => (halt)) (defrule s (declare (salience -1)) (b) => (exit 9))",
        &[],
    )
    .exits(0);
    assert_run!(run(&lab, "(defrule r => (bson-get 3 a) (printout t \"not\"))", &[]), @r"
    ------- stderr -------
    [ARGACCES2] Function 'bson-get' expected argument #1 to be of type document (external address).
    [PRCCODE4] Execution halted during the actions of defrule 'r'.
    [exit code: 1]
    ");
    assert_run!(run(&lab, "(defrule r => (rm-insert a.b))", &[]), @r"
    ------- stderr -------
    error: program.clp:1:1: [ARGACCES1] Function 'rm-insert' expected exactly 2 arguments.
      |
    1 | (defrule r => (rm-insert a.b))
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    ");
    run(&lab, "(defrule r => (rm-count \"nothing\"))", &[]).exits(0);
}

#[test]
fn a_program_that_does_not_end_is_stopped() {
    let lab = lab();
    let endless = [
        "(defrule r => (while TRUE do (bind ?x 1)))",
        "(defrule r ?f <- (n ?n) => (retract ?f) (assert (n (+ ?n 1)))) (deffacts f (n 0))",
        "(deffunction f (?n) (if (> ?n 0) then (f (+ ?n 1)) else 0)) (defrule r => (while TRUE do (loop-for-count 5 do (+ 1 1))))",
    ];
    for program in endless {
        run(&lab, program, &["--timeout", "300ms"]).exits(23);
    }
    // CLIPS reports each of the calls.
    let deep = run(&lab, "(deffunction f (?n) (+ 1 (f (+ ?n 1)))) (defrule r => (f 0))", &[]).exits(1);
    assert!(deep.stderr.contains("too deeply"), "{deep}");
    let mutual = "(deffunction g (?n)) (deffunction f (?n) (if (evenp ?n) then (g (+ ?n 1)) else (g (+ ?n 1))))
        (deffunction g (?n) (progn (progn (progn (f (+ ?n 1)))))) (defrule r => (f 0))";
    run(&lab, mutual, &[]).exits(1);
    // As deep as it may reasonably be.
    let sum = "(deffunction f (?n) (if (= ?n 0) then 0 else (+ 1 (f (- ?n 1))))) (defrule r => (printout t (f 10000)))";
    assert_eq!(run(&lab, sum, &[]).success(), "10000");
}

#[test]
fn a_program_reads_stdin_and_prints_to_both_streams() {
    let lab = lab();
    lab.write(
        "p.clp",
        "(defrule r => (printout t \"> \" (readline) \"|\" (readline) \"|\" (readline)) (printout stderr err))",
    );
    assert_run!(lab.rmem_with(&["clips", "run", "p.clp"], "one two\nä\n"), @r"
    > one two|ä|EOF------- stderr -------
    err[exit code: 0]
    ");
}

#[test]
fn documents_are_made_and_read() {
    let lab = lab();
    let text = printed(
        &lab,
        r#"(bind ?d (bson-create)) (bson-append ?d s sym) (bson-append ?d t "a text") (bson-append ?d i 3)
           (bson-append ?d f 3.0) (bson-append ?d b TRUE) (bson-append-array ?d m (create$ 1 two "three"))
           (bind ?e (bson-parse "{x: {y: [1, {z: 'deep'}]}}")) (bson-append ?d sub ?e)
           (bind ?a (bson-array-start)) (bson-array-append ?a 1) (bson-array-append ?a ?e) (bson-array-finish ?d arr ?a)
           (bson-append-time ?d when (create$ 1700000000 250000)) (bson-append-regex ?d re "^a")
           (printout t (bson-tostring ?d) crlf (bson-field-names ?d) crlf)
           (printout t (bson-get ?d s) "|" (bson-get ?d i) "|" (bson-get ?d f) "|" (bson-get ?d b) "|" (bson-get-array ?d m)
             "|" (bson-get ?d "sub.x.y.1.z") "|" (bson-get-time ?d when) "|" (bson-has-field ?d sub.x) (bson-has-field ?d no) crlf)
           (printout t (type (bson-get ?d s)) (type (bson-get ?d b)) (type (bson-get ?d i)) (type (bson-get ?d f)) (type (bson-get ?d sub)) crlf)"#,
    );
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(
        lines,
        [
            r#"{"s":"sym","t":"a text","i":3,"f":3.0,"b":true,"m":[1,"two","three"],"sub":{"x":{"y":[1,{"z":"deep"}]}},"arr":[1,{"x":{"y":[1,{"z":"deep"}]}}],"when":{"$date":"2023-11-14T22:13:20.250Z"},"re":{"$regularExpression":{"pattern":"^a","options":""}}}"#,
            r#"("s" "t" "i" "f" "b" "m" "sub" "arr" "when" "re")"#,
            r#"sym|3|3.0|TRUE|(1 "two" "three")|deep|(1700000000 250000)|TRUEFALSE"#,
            "STRINGSYMBOLINTEGERFLOATEXTERNAL-ADDRESS",
        ]
    );
}

#[test]
fn a_destroyed_document_is_an_error_and_no_crash() {
    let lab = lab();
    let mut errors = String::new();
    for use_it in [
        "(bson-get ?d a)",
        "(rm-insert a.b ?d)",
        "(rm-cursor-next ?d)",
        "(bson-destroy ?d)",
        "(bson-append (bson-create) x ?d)",
    ] {
        let program = format!(
            "(defrule r => (bind ?d (bson-create)) (bson-destroy ?d) (bson-create) {use_it} (printout t \"not\"))"
        );
        errors += &format!("{use_it}\n{}\n", run(&lab, &program, &[]));
    }
    assert_run!(errors, @r"
    (bson-get ?d a)
    ------- stderr -------
    [RMEM1] Function 'bson-get': the address is of something that was destroyed
    [PRCCODE4] Execution halted during the actions of defrule 'r'.
    [exit code: 1]
    (rm-insert a.b ?d)
    ------- stderr -------
    [RMEM1] Function 'rm-insert': the address is of something that was destroyed
    [PRCCODE4] Execution halted during the actions of defrule 'r'.
    [exit code: 1]
    (rm-cursor-next ?d)
    ------- stderr -------
    [RMEM1] Function 'rm-cursor-next': the address is of something that was destroyed
    [PRCCODE4] Execution halted during the actions of defrule 'r'.
    [exit code: 1]
    (bson-destroy ?d)
    ------- stderr -------
    [RMEM1] Function 'bson-destroy': the address is of something that was destroyed
    [PRCCODE4] Execution halted during the actions of defrule 'r'.
    [exit code: 1]
    (bson-append (bson-create) x ?d)
    ------- stderr -------
    [RMEM1] Function 'bson-append': the address is of something that was destroyed
    [PRCCODE4] Execution halted during the actions of defrule 'r'.
    [exit code: 1]
    ");
    assert_run!(run(&lab, "(defrule r => (rm-cursor-next (bson-create)))", &[]), @r"
    ------- stderr -------
    [RMEM1] Function 'rm-cursor-next': expected a cursor, found a document
    [PRCCODE4] Execution halted during the actions of defrule 'r'.
    [exit code: 1]
    ");
}

#[test]
fn documents_without_a_reference_are_freed() {
    let lab = lab();
    let text = printed(
        &lab,
        "(bind ?keep (bson-parse \"{a: 1}\")) (assert (kept ?keep)) (loop-for-count 20000 do (bson-create))
         (printout t (bson-get ?keep a))",
    );
    assert_eq!(text, "1");
}

#[test]
fn the_memory_is_queried_and_changed() {
    let lab = lab();
    let text = printed(
        &lab,
        r#"(rm-insert a.b "{_id: 1, n: 1}") (robmem-insert a.b (bson-parse "{_id: 2, n: 2}"))
           (printout t (rm-insert a.b "{_id: 'x', n: 3}") " " (rm-count a.b) " " (rm-count a.b "{n: {$gt: 1}}") crlf)
           (printout t (rm-update a.b "{n: 10}" "{_id: 1}") (rm-update a.b "{$inc: {n: 5}}" "{_id: 2}") (rm-update a.b "{n: 0}" "{_id: 9}")
             (rm-replace a.b "{m: 1}" "{_id: 'x'}") (rm-upsert a.b "{k: 1}" "{_id: 7}") crlf)
           (bind ?c (rm-query a.b "{}" "{_id: -1}"))
           (while (rm-cursor-more ?c) do (printout t (bson-tostring (rm-cursor-next ?c)) crlf))
           (printout t (rm-cursor-next ?c) (rm-delete a.b "{n: {$exists: true}}") (rm-count a.b) crlf)"#,
    );
    let expected = "x 3 2\n11011\n{\"_id\":\"x\",\"m\":1}\n{\"_id\":7,\"k\":1}\n{\"_id\":2,\"n\":7}\n{\"_id\":1,\"n\":10}\nFALSE22\n";
    assert_eq!(text, expected);
}

#[test]
fn what_can_go_wrong_at_any_time_is_false_with_a_message() {
    let lab = lab();
    let program = r#"(defrule r => (rm-insert a.b "{_id: 1}")
        (printout t (rm-insert a.b "{_id: 1}") (rm-query a.b "{x: {$no: 1}}") (rm-query a.b "{x") (rm-count nodot)
          (rm-plan nofile.pddl nofile.pddl) (rm-restore nofile) (rm-gen-problem nofile) (bson-tostring (bson-parse "warbagarbl")) crlf))"#;
    assert_run!(run(&lab, program, &[]), @r"
    FALSEFALSEFALSEFALSEFALSEFALSEFALSE{}
    ------- stderr -------
    [RMEM5] Function 'rm-insert': a.b already has a document with _id: 1
    [RMEM5] Function 'rm-query': unknown operator: $no
    [RMEM5] Function 'rm-query': <document>:1:3: expected `:`, found the end of the text
      |
    1 | {x
      |   ^
      = hint: the `{` at 1:1 is not closed
    [RMEM5] Function 'rm-count': `nodot` is not a namespace: it has no dot; expected DATABASE.COLLECTION, like robmem.worldmodel
    [RMEM5] Function 'rm-plan': cannot read nofile.pddl: there is no such file or folder
    [RMEM5] Function 'rm-restore': cannot read nofile: there is no such file or folder
    [RMEM5] Function 'rm-gen-problem': cannot read nofile: there is no such file or folder
    [RMEM5] Function 'bson-parse': <document>:1:1: expected a value, found `warbagarbl`
      |
    1 | warbagarbl
      | ^^^^^^^^^^
      = hint: strings are written in quotes
    [exit code: 0]
    ");
}

#[test]
fn facts_are_documents_and_documents_facts() {
    let lab = lab();
    let program = r#"(deftemplate t (slot a (type STRING)) (slot s (type SYMBOL)) (multislot m) (slot sub))
        (defrule go => (bind ?d (bson-parse "{q: 1}"))
           (bind ?f (assert (t (a "x") (s y) (m 1 2.0 z "z") (sub ?d)))) (bind ?o (assert (on a "b c" 3)))
           (printout t (bson-tostring (rm-structured-fact-to-bson ?f)) crlf (bson-tostring (rm-ordered-fact-to-bson ?o)) crlf)
           (bind ?d (rm-ordered-fact-to-bson ?o)) (retract ?f ?o)
           (rm-assert-from-bson ?d) (rm-assert-from-bson "{relation: 't', a: 'green', s: 'green', m: [1, 'two words'], sub: 2.5}")
           (printout t (rm-assert-from-bson "{relation: 't', nosuch: 1}") crlf))
        (defrule t (t (a ?a) (s ?s) (m $?m) (sub ?u)) (test (numberp ?u)) => (printout t (stringp ?a) (symbolp ?s) ?m ?u crlf))
        (defrule on (on $?v) (test (= 3 (length$ ?v))) => (printout t ?v crlf))"#;
    let text = run(&lab, program, &[]).success();
    let mut lines: Vec<&str> = text.lines().collect();
    lines[3..].sort_unstable();
    assert_eq!(lines[1..3], [r#"{"relation":"on","values":["a","b c",3]}"#, "FALSE"]);
    assert!(
        lines[0].starts_with(r#"{"relation":"t","a":"x","s":"y","m":[1,2.0,"z","z"],"#)
            && lines[0].contains(r#""sub":{"q":1}"#),
        "{text}"
    );
    assert_eq!(lines[3..], [r#"(a "b c" 3)"#, r#"TRUETRUE(1 "two words")2.5"#]);
}

#[test]
fn strings_of_facts_come_back_by_notes_or_types_and_other_texts_as_symbols() {
    let lab = lab();
    let program = r#"(deftemplate t (slot a) (slot s (type STRING)) (slot y (type SYMBOL)) (multislot m))
        (deffunction kinds (?f) (printout t (class (fact-slot-value ?f a)) " " (class (fact-slot-value ?f s)) " "
           (class (fact-slot-value ?f y)) " " (implode$ (fact-slot-value ?f m)) crlf))
        (defrule go => (bind ?f (assert (t (a "x") (s "x") (y x) (m "x" y)))) (bind ?d (rm-structured-fact-to-bson ?f))
           (retract ?f) (bind ?f (rm-assert-from-bson ?d)) (kinds ?f) (retract ?f)
           (bind ?e (bson-create)) (bson-append ?e relation t)
           (progn$ (?key (create$ a s y)) (bson-append ?e ?key (bson-get ?d ?key)))
           (printout t (class (bson-get ?e a)) crlf) (kinds (rm-assert-from-bson ?e)))"#;
    let text = run(&lab, program, &[]).success();
    assert_eq!(text, "STRING STRING SYMBOL \"x\" y\nSTRING\nSYMBOL STRING SYMBOL \n");
}

#[test]
fn changes_of_the_memory_are_facts() {
    let lab = lab();
    let program = r#"(defglobal ?*t* = nil)
        (defrule begin => (bind ?*t* (rm-trigger-register a.b "{kind: 'order'}" orders))
           (rm-insert a.b "{_id: 1, kind: 'other'}") (rm-insert a.b "{_id: 2, kind: 'order'}")
           (rm-update a.b "{n: 5}" "{_id: 2}") (rm-delete a.b "{_id: 2}"))
        (defrule see ?f <- (robmem-trigger (name "orders") (rcvd-at ?s ?u) (ptr ?p) (operation ?op)) =>
           (printout t ?op " " (bson-get ?p "_id") " " (bson-get ?p "op") " " (> ?s 1000000000) crlf) (retract ?f)
           (if (eq ?op delete) then (rm-trigger-destroy ?*t*)))
        (defrule named ?f <- (orders) => (retract ?f))"#;
    let text = run(&lab, program, &["--timeout", "20s"]).success();
    assert_eq!(text, "insert 2 i TRUE\nupdate 2 u TRUE\ndelete 2 d TRUE\n");
}

#[test]
fn a_shared_fact_is_a_document_and_both_change_together() {
    let lab = lab();
    let template = "(deftemplate thing (slot name) (slot n (type INTEGER)) (slot tag) (multislot list) (slot sync-id (type INTEGER)))";
    let program = format!(
        r#"{template}
        (defrule go => (bind ?f (synced-assert "(thing (name \"t 1\") (n 1) (tag green) (list a))"))
           (bind ?f (synced-modify ?f n 5 tag "red")) (bind ?f (synced-add-to-multifield ?f list 3))
           (bind ?f (synced-add-to-multifield ?f list "b")) (bind ?f (synced-remove-from-multifield ?f list a))
           (bind ?g (synced-assert "(thing (name gone))")) (synced-retract ?g)
           (printout t (fact-slot-value ?f list) (fact-slot-value ?f n) (fact-slot-value ?f tag) " " (> (fact-slot-value ?f sync-id) 0) crlf)
           (halt))"#
    );
    assert_eq!(run(&lab, &program, &[]).success(), "(3 \"b\")5red TRUE\n");
    let fields = "{_id: 0, 'sync-id': 0}";
    let stored = lab.rmem(&["query", "syncedrobmem.clipswm", "{}", "--fields", fields]).success();
    assert_eq!(stored, "{\"relation\":\"thing\",\"name\":\"t 1\",\"n\":5,\"tag\":\"red\",\"list\":[3,\"b\"]}\n");
    // The next engine has it from the start, its strings still strings.
    let next =
        format!("{template} (defrule see (thing (tag ?t) (list $?l)) => (printout t (stringp ?t) ?l crlf) (halt))");
    assert_eq!(run(&lab, &next, &["--sync", "--timeout", "20s"]).success(), "TRUE(3 \"b\")\n");
    let foreign = format!("{template} (defrule r => (printout t (synced-modify (assert (thing)) n 1)) (halt))");
    assert_run!(run(&lab, &foreign, &["--timeout", "20s"]), @r"
    FALSE------- stderr -------
    [RMEM5] Function 'synced-modify': the fact is none of the shared world model
    [exit code: 0]
    ");
}

#[test]
fn world_models_are_dumped_and_restored() {
    let lab = lab();
    lab.rmem(&["insert", "a.b", "{_id: 1}", "{_id: 2}"]).success();
    let text = printed(
        &lab,
        r#"(printout t (rm-dump a.b "w.json") (rm-dump a.b "folder") (robmem-dump-collection a.b "dir") (robmem-dump-collection a.b "dir")
             (rm-delete a.b "{}") (rm-restore "w.json") (rm-delete a.b "{}") (rm-restore "folder") (robmem-restore-collection a.b "dir" a.c)
             (rm-count a.b) (rm-count a.c) (rm-dump a.b "folder") crlf)"#,
    );
    assert_eq!(text, "TRUETRUETRUETRUE2222222FALSE\n");
}

#[test]
fn mutexes_exclude_other_owners() {
    let lab = lab();
    let text = printed(
        &lab,
        "(printout t (robmem-mutex-create m) (robmem-mutex-renew-lock m r1) (robmem-mutex-try-lock m r1) (robmem-mutex-try-lock m r1)
           (robmem-mutex-try-lock m r2) (robmem-mutex-renew-lock m r1) (robmem-mutex-force-lock m r2) (robmem-mutex-unlock m r1)
           (robmem-mutex-unlock m r2) (robmem-mutex-try-lock m r1) (robmem-mutex-expire-locks 3600) (robmem-mutex-expire-locks 0)
           (robmem-mutex-try-lock m r2) (robmem-mutex-destroy m) crlf)",
    );
    let words = "TRUE FALSE TRUE TRUE FALSE TRUE TRUE FALSE TRUE TRUE 0 1 TRUE TRUE";
    assert_eq!(text, words.replace(' ', "") + "\n");
}

#[test]
fn an_executive_in_clips_plans_acts_and_plans_again() {
    let lab = lab();
    lab.write("goal.txt", "(goal \"(and (on A B) (on B C))\")\n");
    let executive = |hands: &str, lab: &Lab| {
        let files = ["--load", "fixtures/blocksworld.json", "clips", "run", hands, "examples/clips/executive.clp"];
        lab.rmem(&[&files[..], &["--facts", "goal.txt", "--timeout", "60s"]].concat()).success()
    };
    let reached = |lab: &Lab| {
        let filter = "{$or: [{object_top: 'A', object_bottom: 'B'}, {object_top: 'B', object_bottom: 'C'}]}";
        lab.rmem(&["count", "robmem.worldmodel", filter]).success() == "2\n"
    };
    let text = executive("examples/clips/blocks.clp", &lab);
    assert_eq!(text, "plan 1\ndid stack B C\ndid unstack D A\ndid putdown D\ndid pickup A\ndid stack A B\nreached\n");
    assert!(reached(&lab));

    // Hands that let the second thing fall once: it does not happen.
    let other = self::lab();
    other.write("goal.txt", "(goal \"(and (on A B) (on B C))\")\n");
    let hands = std::fs::read_to_string(crate::lab::root().join("examples/clips/blocks.clp")).unwrap();
    let clumsy = hands.replace(
        "(deffunction hands (?action ?blocks)",
        "(defglobal ?*grips* = 0)\n(deffunction hands (?action ?blocks)\n  (bind ?*grips* (+ ?*grips* 1))\n  (if (= ?*grips* 2) then (return FALSE))",
    );
    assert_ne!(hands, clumsy);
    other.write("clumsy.clp", &clumsy);
    let text = executive("clumsy.clp", &other);
    assert!(text.starts_with("plan 1\ndid stack B C\nfailed unstack D A\nplan 2\ndid unstack D A\n"), "{text}");
    assert!(text.ends_with("reached\n") && reached(&other), "{text}");
    assert_eq!(other.rmem(&["count", "robmem.plans", "{plan: 'success'}"]).success(), "2\n");
}

#[test]
fn an_interrupted_program_ends_with_130() {
    let lab = lab();
    let actions = "(printout t \"begun\" crlf) (printout stderr \"it goes on\" crlf) (while TRUE do (bind ?n 1))";
    lab.write("endless.clp", &format!("(defrule go => {actions})"));
    let run = Watch::rmem(&lab, &["--memory", "mem:", "clips", "run", "endless.clp"], "it goes on");
    run.signal("INT");
    assert_eq!(run.end(), (130, vec!["begun".to_owned()]));
}

#[test]
fn a_hundred_thousand_facts_are_asserted() {
    let lab = lab();
    let mut facts = String::new();
    for n in 0..100_000 {
        let _ = writeln!(facts, "(t (n {n}) (s \"text {n}\"))");
    }
    lab.write("facts.txt", &facts);
    let program = "(deftemplate t (slot n) (slot s)) (defrule r (t (n 99999) (s ?s)) => (printout t ?s))";
    assert_eq!(run(&lab, program, &["--facts", "facts.txt"]).success(), "text 99999");
}
