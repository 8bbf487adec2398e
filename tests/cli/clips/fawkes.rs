//! clips run: programs of Fawkes, of its executive, of the referee box, and of CLIPS 6.30.

use super::lab;
use crate::lab::{Lab, assert_run};

/// Runs programs that were written to these files.
fn run(lab: &Lab, programs: &[(&str, &str)], more: &[&str]) -> crate::lab::Finished {
    programs.iter().for_each(|(name, text)| lab.write(name, text));
    let names: Vec<&str> = programs.iter().map(|(name, _)| *name).collect();
    lab.rmem(&[&["clips", "run"], &names[..], more].concat())
}

#[test]
fn functions_of_a_program_take_the_place_of_those_with_their_names() {
    let own = "(deftemplate robmem-trigger (slot name (type STRING)) (slot ptr (type EXTERNAL-ADDRESS)))
(deffunction str-replace (?in ?what ?with) (str-cat \"own \" ?in))
(deffunction rm-structured-fact-to-bson (?fact $?relation) (bind ?doc (bson-create)) (bson-append ?doc own ?relation) ?doc)
(deffunction MAIN::length (?values) own)\n";
    let agent = "(deftemplate t (slot a)) (deffacts f (t))
(defrule go ?f <- (t) =>
  (printout t (str-replace x y z) \" \" (length (create$ a)) \" \" (bson-tostring (rm-structured-fact-to-bson ?f \"r\")) crlf))\n";
    assert_run!(run(&lab(), &[("own.clp", own), ("agent.clp", agent)], &[]), @r#"
    own x own {"own":["r"]}
    ------- stderr -------
    own.clp has functions of its own in place of rmem's and CLIPS': length, rm-structured-fact-to-bson, str-replace
    [exit code: 0]
    "#);
}

#[test]
fn programs_of_clips_6_30_find_their_functions_and_streams() {
    let program = "(defrule go =>
  (printout t (length (create$ a b)) (length \"äbc\") (length sym) (length (now)) (length$ resource-) (length$ (create$)) (< 1600000000 (nth$ 1 (now-systime))) crlf)
  (printout warn \"a warning\" crlf) (printout wwarning \"another\" crlf) (printout logerror \"a third\" crlf))\n";
    assert_run!(run(&lab(), &[("p.clp", program)], &[]), @"
    233290TRUE
    ------- stderr -------
    a warning
    another
    a third
    [exit code: 0]
    ");
}

#[test]
fn a_structured_fact_becomes_a_document_of_another_relation() {
    let program =
        "(deftemplate mapped (slot name) (multislot param-values)) (deffacts f (mapped (name at) (param-values r1 c1)))
(defrule go ?f <- (mapped) =>
  (rm-insert robmem.clipswm (rm-structured-fact-to-bson ?f))
  (rm-insert robmem.clipswm (rm-structured-fact-to-bson ?f \"domain-fact\")))\n";
    let lab = lab();
    run(&lab, &[("p.clp", program)], &[]).success();
    let stored = "{\"relation\":\"mapped\",\"name\":\"at\",\"param-values\":[\"r1\",\"c1\"]}
{\"relation\":\"domain-fact\",\"name\":\"at\",\"param-values\":[\"r1\",\"c1\"]}\n";
    assert_eq!(lab.rmem(&["query", "robmem.clipswm", "--fields", "{_id: 0}"]).success(), stored);
}

#[test]
fn pipelines_are_put_together_stage_by_stage() {
    let lab = lab();
    lab.rmem(&["insert", "a.b", "{k: 'x', n: 1}", "{k: 'y', n: 2}", "{k: 'x', n: 4}"]).success();
    let program = "(deffunction show (?cursor)
  (while (bind ?d (rm-cursor-next ?cursor)) (printout t (bson-get ?d _id) \" \" (bson-get ?d sum) crlf)))
(defrule go =>
  (bind ?p (robmem-pipeline-create))
  (robmem-pipeline-append ?p \"{$match: {k: 'x'}}\")
  (robmem-pipeline-append ?p (bson-parse \"{$group: {_id: '$k', sum: {$sum: '$n'}}}\"))
  (show (robmem-aggregate a.b ?p))
  (robmem-pipeline-destroy ?p)
  (show (rm-aggregate a.b \"[{$group: {_id: '$k', sum: {$sum: '$n'}}}, {$sort: {_id: 1}}]\"))
  (rm-aggregate a.b \"[{$nostage: 1}]\")
  (rm-aggregate a.b ?p))\n";
    assert_run!(run(&lab, &[("p.clp", program)], &[]), @"
    x 5
    x 5
    y 2
    ------- stderr -------
    [RMEM5] Function 'rm-aggregate': unrecognized pipeline stage name: '$nostage'
    [RMEM1] Function 'rm-aggregate': the address is of something that was destroyed
    [PRCCODE4] Execution halted during the actions of defrule 'go'.
    [exit code: 1]
    ");
}

#[test]
fn the_functions_of_the_referee_box_use_the_database_of_the_collection() {
    let lab = lab();
    let program = "(defrule go =>
  (bind ?doc (bson-create)) (bson-append ?doc points 3)
  (mongodb-upsert game_report ?doc \"{name: 'g1'}\")
  (bson-append ?doc points 5)
  (mongodb-update game_report ?doc \"{name: 'g1'}\")
  (mongodb-update game_report ?doc \"{name: 'g2'}\")
  (bson-builder-destroy ?doc)
  (mongodb-insert other.clients (bson-parse \"{c: 1}\"))
  (bind ?c (mongodb-query-sort game_report (bson-create) (bson-parse \"{name: 1}\")))
  (while (bind ?d (mongodb-cursor-next ?c)) (printout t (bson-get ?d name) \" \" (bson-get ?d points) crlf))
  (mongodb-cursor-destroy ?c))\n";
    let report = run(&lab, &[("p.clp", program)], &["--collection", "rcll.worldmodel"]).success();
    assert_eq!(report, "g1 5\n");
    assert_eq!(lab.rmem(&["count", "rcll.game_report"]).success(), "1\n");
    assert_eq!(lab.rmem(&["count", "other.clients"]).success(), "1\n");
}

#[test]
fn mutexes_answer_by_facts() {
    let program = "(defrule go =>
  (printout t (robmem-mutex-create-async M1) (robmem-mutex-try-lock-async M1 r1) (robmem-mutex-try-lock-async M1 r2) crlf)
  (robmem-mutex-renew-lock-async M1 r1) (robmem-mutex-renew-lock-async M1 r2)
  (robmem-mutex-unlock-async M1 r1) (robmem-mutex-try-lock-async M1 r2) (robmem-mutex-force-lock-async M1 r1)
  (robmem-mutex-expire-locks-async 0.0)
  (robmem-mutex-destroy-async M1)
  (facts))\n";
    assert_run!(run(&lab(), &[("p.clp", program)], &[]), @"
    (TRUE)(TRUE)(TRUE)
    f-1     (mutex-op-feedback try-lock-async FAIL M1)
    f-2     (mutex-op-feedback renew-lock-async OK M1)
    f-3     (mutex-op-feedback renew-lock-async FAIL M1)
    f-4     (mutex-op-feedback expire-locks-async OK)
    For a total of 4 facts.
    ------- stderr -------
    [exit code: 0]
    ");
}

#[test]
fn a_program_that_follows_the_mutexes_of_fawkes_has_them_there() {
    let program = "(defrule go => (robmem-trigger-register robmem_coordination.mutex (bson-create) mutex)
  (robmem-mutex-try-lock-async M1 r1))
(defrule changed (robmem-trigger (name \"mutex\") (ptr ?doc)) (test (bson-get ?doc fullDocument.locked))
  => (printout t (bson-get ?doc documentKey._id) \" \" (bson-get ?doc fullDocument.locked-by) crlf) (exit))\n";
    let lab = lab();
    assert_eq!(run(&lab, &[("p.clp", program)], &["--timeout", "20s"]).success(), "M1 r1\n");
    assert_eq!(lab.rmem(&["count", "robmem_coordination.mutex", "{locked: true}"]).success(), "1\n");
}

#[test]
fn a_trigger_tells_what_a_change_stream_of_mongodb_tells() {
    let program = "(defrule go => (rm-trigger-register a.b \"{}\" changes))
(defrule registered ?f <- (mutex-trigger-register-feedback SUCCESS \"changes\" ?trigger)
  => (retract ?f)
  (rm-insert a.b \"{_id: 1, v: 'a'}\") (rm-upsert a.b \"{_id: 1, v: 'b'}\" \"{_id: 1}\") (rm-delete a.b \"{_id: 1}\"))
(defrule changed ?f <- (robmem-trigger (name \"changes\") (ptr ?doc) (operation ?operation))
  => (retract ?f)
  (printout t ?operation \" \" (bson-get ?doc operationType) \" \" (bson-get ?doc documentKey._id) \" \"
    (if (bson-has-field ?doc fullDocument) then (bson-get ?doc fullDocument.v) else none) \" \"
    (length$ (bson-get-time ?doc clusterTime)) crlf)
  (if (eq ?operation delete) then (exit)))\n";
    assert_run!(run(&lab(), &[("p.clp", program)], &["--timeout", "20s"]), @"
    insert insert 1 a 2
    replace update 1 b 2
    delete delete 1 none 2
    ------- stderr -------
    [exit code: 0]
    ");
}

#[test]
fn commands_among_constructs_run_where_they_stand() {
    let lab = lab();
    lab.write("rules.clp", "(defrule loaded (go ?x) => (printout t \"loaded \" ?x crlf))\n");
    let program = "(printout t \"starting\" crlf)
(load* \"rules.clp\")
(defglobal ?*x* = 1)
(deffacts f (go deffacts))
(build \"(defrule built (go ?x) => (printout t \\\"built \\\" ?x crlf))\")
(bind ?*x* 2) ; a command
(reset)
(assert (go (+ ?*x* 1)))\n";
    let text = run(&lab, &[("p.clp", program)], &[]).success();
    let mut lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines.remove(0), "starting");
    lines.sort_unstable();
    assert_eq!(lines, ["built 2", "built deffacts", "loaded 2", "loaded deffacts"]);
    let program =
        "(defrule a => )\n(skill-call rules.clp)\n(defrule b (x ?) => (nofunction))\n(printout t \"on\" crlf)\n";
    assert_run!(run(&lab, &[("p.clp", program)], &[]), @r"
    on
    ------- stderr -------
    error: p.clp:2:1: [EXPRNPSR3] Missing function declaration for 'skill-call'.
      |
    2 | (skill-call rules.clp)
      | ^^^^^^^^^^^^^^^^^^^^^^
    error: p.clp:3:1: [EXPRNPSR3] Missing function declaration for 'nofunction'.
      |
    3 | (defrule b (x ?) => (nofunction))
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    ");
    assert_eq!(run(&lab, &[("p.clp", "(exit 7)\n(printout t not)")], &[]).exits(7).stdout, "");
}

#[test]
fn files_of_a_program_are_found_on_its_search_path() {
    let lab = lab();
    lab.write("agent/rules.clp", "(defrule own (init) => (printout t \"agent/rules.clp\" crlf))\n");
    lab.write("other/rules.clp", "(defrule other (init) => (printout t \"other/rules.clp\" crlf))\n");
    lab.write(
        "other/deep/more.clp",
        "(deffacts more (init))\n(printout t \"a command\" crlf)\n(path-load rules.clp)\n",
    );
    lab.write("agent/late.clp", "(defrule late (init) => (printout t \"loaded by a rule\" crlf))\n");
    let program = "(path-add-subst \"@BASE@\" \"other\")
(path-add \"@BASE@/deep\" @BASE@)
(printout t (path-get) \" \" (resolve-file more.clp) \" \" (path-resolve \"none.clp\") crlf)
(path-load \"more.clp\")
(defrule load (declare (salience 10)) (init) => (printout t (path-load late.clp) crlf))\n";
    lab.write("agent/main.clp", program);
    assert_run!(lab.rmem(&["clips", "run", "agent/main.clp"]), @r#"
    ("agent/" "./" "other/deep/" "other/") other/deep/more.clp FALSE
    a command
    TRUE
    loaded by a rule
    agent/rules.clp
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&["clips", "run", "agent/main.clp", "--path", "other"]), @r#"
    ("other/" "agent/" "./" "other/deep/" "other/") other/deep/more.clp FALSE
    a command
    TRUE
    loaded by a rule
    other/rules.clp
    ------- stderr -------
    [exit code: 0]
    "#);
}

#[test]
fn mistakes_in_files_that_a_program_loads_are_at_their_places() {
    let lab = lab();
    lab.write(
        "bad.clp",
        "(defrule good (go) => (printout t \"good\" crlf))\n(defrule bad (go) => (nofunction))\n(nocommand)\n",
    );
    let program = "(deffacts f (go))\n(defrule load (declare (salience 10)) (go) => (printout t (path-load bad.clp) \" \" (path-load none.clp) crlf))\n";
    assert_run!(run(&lab, &[("p.clp", program)], &[]), @r"
    FALSE FALSE
    good
    ------- stderr -------
    bad.clp:2:1: [EXPRNPSR3] Missing function declaration for 'nofunction'.
      |
    2 | (defrule bad (go) => (nofunction))
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    bad.clp:3:1: [EXPRNPSR3] Missing function declaration for 'nocommand'.
      |
    3 | (nocommand)
      | ^^^^^^^^^^^
    [RMEM5] Function 'path-load': no file none.clp in ./; --path names other folders
    [exit code: 0]
    ");
}

#[test]
fn values_of_the_configuration_are_facts() {
    let lab = lab();
    lab.write("robot.yaml", "%YAML 1.2\n---\nclips-agent:\n  agent: rcll\n  speed: 1.5\n  retries: 3\n  offset: -2\n  debug: true\n  teams: [CYAN, 'MAGENTA \\\"X\\\"']\n  sizes: [1, 2.5]\n  flags: [true, false]\n  none: []\n  nothing: null\n  arms: [{joint: 1}]\nclips-agents: {x: 1}\n");
    lab.write("host.yaml", "clips-agent: {retries: 5, debug: false}\n");
    let program = "(deffacts f (init))
(defrule load (init) => (printout t (config-load \"/clips-agent\") \" values\" crlf))
(defrule show (confval (path ?p) (type ?t) (value ?v) (is-list ?l) (list-value $?vs)) => (printout t ?p \" \" ?t \" \" ?v \" \" ?l \" \" ?vs crlf))\n";
    let template = "(deftemplate confval (slot path (type STRING)) (slot type (type SYMBOL)) (slot value) (slot is-list (default FALSE)) (multislot list-value))\n";
    let files = ["--values", "robot.yaml", "--values", "host.yaml"];
    assert_run!(run(&lab, &[("t.clp", template), ("p.clp", program)], &files), @r#"
    10 values
    /clips-agent/arms/0/joint UINT 1 FALSE ()
    /clips-agent/none STRING nil TRUE ()
    /clips-agent/flags BOOL nil TRUE (TRUE FALSE)
    /clips-agent/sizes FLOAT nil TRUE (1.0 2.5)
    /clips-agent/teams STRING nil TRUE ("CYAN" "MAGENTA \"X\"")
    /clips-agent/debug BOOL FALSE FALSE ()
    /clips-agent/offset INT -2 FALSE ()
    /clips-agent/retries UINT 5 FALSE ()
    /clips-agent/speed FLOAT 1.5 FALSE ()
    /clips-agent/agent STRING rcll FALSE ()
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(run(&lab, &[("t.clp", template), ("p.clp", program)], &[]), @r"
    FALSE values
    ------- stderr -------
    [RMEM5] Function 'config-load': there is no configuration; --values names its YAML files
    [exit code: 0]
    ");
    let program =
        "(deffacts f (init))\n(defrule load (init) => (printout t (config-load \"robot.yaml\" \"clips-agents/\") crlf)
  (do-for-all-facts ((?c confval)) TRUE (printout t ?c:path \" \" ?c:value crlf)) (config-load none.yaml /))\n";
    assert_run!(run(&lab, &[("own.clp", template), ("q.clp", program)], &[]), @r"
    1
    /clips-agents/x 1
    ------- stderr -------
    [RMEM5] Function 'config-load': cannot read none.yaml: there is no such file or folder
    [exit code: 0]
    ");
    lab.write("wrong.yaml", "a: [1\n");
    assert_run!(run(&lab, &[("q.clp", program)], &["--values", "wrong.yaml"]), @r"
    ------- stderr -------
    error: wrong.yaml:2:1: this is not YAML: while parsing a flow sequence, expected ',' or ']'
      |
    2 | 
      | ^
    [exit code: 3]
    ");
}

#[test]
fn the_trace_of_an_endless_recursion_is_short() {
    let program = "(deffunction f (?n) (+ 1 (f (+ ?n 1)))) (defrule go => (f 0))";
    let run = run(&lab(), &[("p.clp", program)], &[]).exits(1);
    let lines: Vec<&str> = run.stderr.lines().collect();
    let frame = "[PRCCODE4] Execution halted during the actions of deffunction 'f'.";
    assert_eq!(lines.iter().filter(|line| **line == frame).count(), 10);
    assert!(
        lines.iter().any(|line| line.starts_with("… and ") && line.ends_with(" more lines like these")),
        "{lines:?}"
    );
    assert_eq!(lines.last(), Some(&"[RMEM2] Functions call themselves too deeply; the run was ended."));
    assert!(lines.len() < 40, "{lines:?}");
}

/// The template of an executive's world model, and who this is.
const WM: &str = "(deftemplate wm-fact (slot id (type STRING)) (multislot key (type SYMBOL))
  (slot type (type SYMBOL)) (slot is-list (type SYMBOL) (allowed-values FALSE TRUE)) (slot value) (multislot values))
(deffacts identity (wm-fact (id \"/cx/identity\") (key cx identity) (type STRING) (value \"R1\")))
(defrule enable (declare (salience 10)) => (wm-robmem-sync-enable \"/domain/\" \"/order/\"))\n";

#[test]
fn an_executive_that_does_not_say_who_it_is_is_told_that_it_shares_nothing() {
    let lab = lab();
    let nameless = WM.replace("/cx/identity", "/cx/other").replace("cx identity", "cx other");
    let facts = "(deffacts f (wm-fact (id \"/domain/x\") (key domain x) (type SYMBOL) (value y)))\n";
    let run = run(&lab, &[("wm.clp", &nameless), ("facts.clp", facts)], &["--timeout", "5s"]);
    let told = run.stderr.lines().filter(|line| line.contains("\"/cx/identity\" says who this is")).count();
    assert_eq!(told, 1, "{run}");
}

#[test]
fn facts_of_an_executive_are_documents_that_others_may_change() {
    let lab = lab();
    let first = "(deffacts f
  (wm-fact (id \"/domain/fact/at?r=r1\") (key domain fact at args? r r1) (type BOOL) (value TRUE))
  (wm-fact (id \"/domain/fact/gone\") (key domain fact gone) (type SYMBOL) (value x))
  (wm-fact (id \"/order/rings\") (key order rings) (type SYMBOL) (is-list TRUE) (values RED BLUE))
  (wm-fact (id \"/private\") (key private) (type SYMBOL) (value x)))
(defrule gone (declare (salience -1)) ?f <- (wm-fact (id \"/domain/fact/gone\")) => (retract ?f))
(defrule change (declare (salience -1)) ?f <- (wm-fact (id \"/domain/fact/at?r=r1\") (value TRUE)) => (modify ?f (value FALSE)))
(defrule end (declare (salience -2)) (wm-fact (id \"/domain/fact/at?r=r1\") (value FALSE)) => (halt))\n";
    run(&lab, &[("wm.clp", WM), ("first.clp", first)], &["--timeout", "20s"]).success();
    let stored =
        "{\"_id\":\"/domain/fact/at?r=r1\",\"source\":\"R1\",\"type\":\"BOOL\",\"is-list\":false,\"value\":false}
{\"_id\":\"/order/rings\",\"source\":\"R1\",\"type\":\"SYMBOL\",\"is-list\":true,\"values\":[\"RED\",\"BLUE\"]}\n";
    let query = |lab: &Lab| {
        let fields = ["--fields", "{'update-timestamp': 0}", "--sort", "{_id: 1}"];
        lab.rmem(&[&["query", "syncedrobmem.worldmodel", "{}"], &fields[..]].concat()).success()
    };
    assert_eq!(query(&lab), stored);
    // What others do while rules fire: a later change, an earlier one, a new fact, one of another kind, and a removal.
    let second = "(defrule restore (declare (salience 5)) => (printout t (wm-robmem-sync-restore) \" restored\" crlf) (assert (step 1)))
(defrule show (wm-fact (id ?id) (key ?first $?) (value ?v) (values $?vs)) (test (neq ?first cx)) => (printout t ?id \" \" ?v \" \" ?vs crlf))
(defrule others ?s <- (step 1) (wm-fact (id \"/order/rings\")) => (retract ?s)
  (bind ?ns syncedrobmem.worldmodel)
  (rm-update ?ns \"{$set: {value: true, source: 'R2', 'update-timestamp': ISODate('2100-01-01')}}\" \"{_id: '/domain/fact/at?r=r1'}\")
  (rm-update ?ns \"{$set: {values: ['NONE'], source: 'R2', 'update-timestamp': ISODate('2000-01-01')}}\" \"{_id: '/order/rings'}\")
  (rm-insert ?ns \"{_id: '/secret/x', type: 'SYMBOL', 'is-list': false, value: 'no', 'update-timestamp': ISODate('2100-01-01')}\")
  (rm-insert ?ns \"{_id: '/domain/new?a=b,c', type: 'STRING', 'is-list': false, value: 'a text', source: 'R2', 'update-timestamp': ISODate('2000-01-01')}\"))
(defrule key (wm-fact (key domain new args? a [ b c ] )) => (rm-delete syncedrobmem.worldmodel \"{_id: '/domain/new?a=b,c'}\") (assert (wait)))
(defrule late (declare (salience -5)) (wait) (not (wm-fact (key domain new $?)))
  ?f <- (wm-fact (id \"/domain/fact/at?r=r1\") (value TRUE))
  => (printout t \"removed\" crlf) (modify ?f (value FALSE)) (assert (last)))
(defrule end (declare (salience -10)) (last) => (exit))\n";
    let text = run(&lab, &[("wm.clp", WM), ("second.clp", second)], &["--timeout", "20s"]).success();
    let mut lines: Vec<&str> = text.lines().collect();
    lines.sort_unstable();
    let wanted = [
        "/domain/fact/at?r=r1 FALSE ()",
        "/domain/fact/at?r=r1 FALSE ()",
        "/domain/fact/at?r=r1 TRUE ()",
        "/domain/new?a=b,c a text ()",
        "/order/rings nil (RED BLUE)",
        "2 restored",
        "removed",
    ];
    assert_eq!(lines, wanted);
    // The last change of this engine is earlier than that of the other one.
    assert!(query(&lab).contains("\"source\":\"R2\",\"type\":\"BOOL\",\"is-list\":false,\"value\":true"));
}

#[test]
fn a_configuration_includes_other_files() {
    let lab = lab();
    lab.write("cfg/config.yaml", "%YAML 1.2\n%TAG ! tag:fawkesrobotics.org,cfg/\n---\ninclude:\n  - !ignore-missing none.d/\n  - conf.d/\n  - !host-specific host.yaml\n---\nplugins/memory/database: robmem\n");
    lab.write("cfg/conf.d/memory.yaml", "doc-url: !url http://localhost/x\n---\nplugins/memory:\n  port: 1\n");
    lab.write("cfg/host.yaml", "plugins:\n  memory: {database: robmem2}\n");
    let program = "(deffacts f (init))\n(defrule load (init) => (printout t (config-load FILE) crlf))
(defrule show (confval (path ?p) (value ?v)) => (printout t ?p \" \" ?v crlf))\n";
    let template = "(deftemplate confval (slot path (type STRING)) (slot type (type SYMBOL)) (slot value) (slot is-list (default FALSE)) (multislot list-value))\n";
    for (call, values) in [("\"/\"", &["--values", "cfg/config.yaml"][..]), ("\"cfg/config.yaml\" \"/plugins\"", &[])] {
        let program = program.replace("FILE", call);
        let shown = run(&lab, &[("t.clp", template), ("p.clp", &program)], values).success();
        assert_eq!(shown, "2\n/plugins/memory/port 1\n/plugins/memory/database robmem2\n");
    }
    lab.write("cfg/config.yaml", "include: [config.yaml, absent.yaml]\n---\na: 1\n");
    assert_run!(lab.rmem(&["clips", "run", "t.clp", "--values", "cfg/config.yaml"]), @r"
    ------- stderr -------
    error: cannot read cfg/absent.yaml: there is no such file or folder
    [exit code: 3]
    ");
}

#[test]
fn odd_files_are_refused_and_files_that_load_themselves_end() {
    let lab = lab();
    lab.write("folder.clp/x", "");
    lab.write("bytes.clp", "");
    std::fs::write(lab.path().join("bytes.clp"), [0x28, 0xff, 0xfe, 0x00]).unwrap();
    lab.write("self.clp", "(path-load self.clp)\n(printout t \"once\" crlf)\n");
    lab.write("a.clp", "(path-load folder.clp/b.clp)\n");
    lab.write("folder.clp/b.clp", "(path-load folder.clp/../a.clp)\n");
    let mut program = String::from(
        "(path-load self.clp)\n(path-load a.clp)\n(path-add-subst a aaaaaaaaaaaaaaaaaaaa)\n(path-add-subst aa aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa)\n",
    );
    for name in ["folder.clp", "bytes.clp", "", "..", "/", "/dev/zero", "~", "a/../../../../../../etc/hostname", "-"] {
        program += &format!("(printout t \"{name}: \" (resolve-file \"{name}\") \" \" (path-load \"{name}\") crlf)\n");
    }
    for _ in 0..6 {
        program += "(path-add-subst aaa aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa)\n";
    }
    program +=
        "(printout t (path-add aaaaaaaaaaaaaaa) crlf)\n(printout t (config-load /dev/zero /) (config-load . /) crlf)\n";
    assert_run!(run(&lab, &[("p.clp", &program)], &[]), @r"
    once
    folder.clp: FALSE FALSE
    bytes.clp: bytes.clp FALSE
    : FALSE FALSE
    ..: FALSE FALSE
    /: FALSE FALSE
    /dev/zero: FALSE FALSE
    ~: FALSE FALSE
    a/../../../../../../etc/hostname: FALSE FALSE
    -: FALSE FALSE
    FALSE
    FALSEFALSE
    ------- stderr -------
    [RMEM5] Function 'path-load': self.clp is being loaded already, or files load one another more than 64 deep
    [RMEM5] Function 'path-load': folder.clp/../a.clp is being loaded already, or files load one another more than 64 deep
    [RMEM5] Function 'path-load': no file folder.clp in ./; --path names other folders
    [RMEM5] Function 'path-load': bytes.clp:1:2: expected UTF-8 text, found invalid UTF-8
      |
    1 | (��
      |  ^
      = hint: this is a binary file, not a text
    [RMEM5] Function 'path-load': no file  in ./; --path names other folders
    [RMEM5] Function 'path-load': no file .. in ./; --path names other folders
    [RMEM5] Function 'path-load': no file / in ./; --path names other folders
    [RMEM5] Function 'path-load': no file /dev/zero in ./; --path names other folders
    [RMEM5] Function 'path-load': no file ~ in ./; --path names other folders
    [RMEM5] Function 'path-load': no file a/../../../../../../etc/hostname in ./; --path names other folders
    [RMEM5] Function 'path-load': no file - in ./; --path names other folders
    [RMEM5] Function 'path-add': the name of the folder aaaaaaaaaaaaaaa is too long
    [RMEM5] Function 'config-load': cannot read /dev/zero: it is not a file
    [RMEM5] Function 'config-load': cannot read .: it is not a file
    [exit code: 0]
    ");
}

#[test]
fn features_of_the_memory_are_there_when_they_are_requested() {
    let lab = lab();
    let program = "(deffacts f (init))\n(defrule ask (init) => (printout t (ff-feature-request \"robot_memory\") (ff-feature-request \"tf\") crlf))
(defrule have (ff-feature-loaded ?name) => (printout t ?name crlf))\n";
    assert_run!(run(&lab, &[("p.clp", program)], &[]), @r"
    TRUEFALSE
    robot_memory
    ------- stderr -------
    [RMEM5] Function 'ff-feature-request': there is no feature tf, only config, redefine-warning, robot_memory; define its functions in a file of your own
    [exit code: 0]
    ");
}
