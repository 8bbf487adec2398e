//! Computables from rmem.toml: commands and how they fail, what is listed, logged and checked.

use crate::lab::watch::until;
use crate::lab::{Lab, assert_run};

/// The sum of two numbers of the query, by a shell and nothing else.
const SUM: &str = r#"#!/bin/sh
read -r query
x=$(printf '%s' "$query" | sed 's/.*"x":\([-0-9]*\).*/\1/')
y=$(printf '%s' "$query" | sed 's/.*"y":\([-0-9]*\).*/\1/')
echo "{\"compute\": \"sum\", \"x\": $x, \"y\": $y, \"sum\": $((x + y))}"
"#;

/// A folder with the computable `sum`, and lines for its table.
fn lab(rest: &str) -> Lab {
    let lab = Lab::new();
    lab.write("robot/sum.sh", SUM);
    lab.write(
        "robot/rmem.toml",
        &format!(
            "memory = \"file:robot.rmem\"\n[[computable]]\nname = \"sum\"\ncollection = \"robmem.calc\"\n\
             spec = \"{{compute: 'sum', x: {{$exists: true}}, y: {{$exists: true}}}}\"\n{rest}\n"
        ),
    );
    lab
}

const CONFIG: [&str; 2] = ["--config", "robot/rmem.toml"];

fn args<'a>(more: &[&'a str]) -> Vec<&'a str> {
    CONFIG.iter().chain(more).copied().collect()
}

#[test]
fn fifteen_and_four_are_nineteen() {
    let lab = lab("command = [\"sh\", \"sum.sh\"]");
    let query = args(&["query", "robmem.calc", "{compute: 'sum', x: 15, y: 4}", "--fields", "{_id: 0}"]);
    assert_eq!(lab.rmem(&query).success(), "{\"compute\":\"sum\",\"x\":15,\"y\":4,\"sum\":19}\n");
    let query = args(&["query", "robmem.calc", "{compute: 'sum', x: 15}"]);
    assert_eq!(lab.rmem(&query).success(), "");
    let query = args(&["count", "robmem.calc", "{compute: 'sum', x: 1, y: 1, sum: 3}"]);
    assert_eq!(lab.rmem(&query).success(), "0\n");
}

#[test]
fn the_cache_holds_from_one_run_to_the_next() {
    let lab = lab("command = [\"sh\", \"sum.sh\"]\ncache = \"1h\"");
    let ask = |query: &str| lab.rmem(&args(&["-v", "query", "robmem.calc", query])).exits(0);
    let first = ask("{compute: 'sum', x: 15, y: 4}");
    assert_run!(first, @r#"
    {"_id":{"$oid":"[ID]"},"compute":"sum","x":15,"y":4,"sum":19}
    ------- stderr -------
    compute sum robmem.calc: 1 document in [DURATION]
    find robmem.calc: 1 document in [DURATION]
    [exit code: 0]
    "#);
    lab.write("robot/sum.sh", "exit 1");
    let second = ask("{y: 4, x: 15, compute: 'sum'}");
    assert_run!(second, @r#"
    {"_id":{"$oid":"[ID]"},"compute":"sum","x":15,"y":4,"sum":19}
    ------- stderr -------
    cached sum robmem.calc: 1 document in [DURATION]
    find robmem.calc: 1 document in [DURATION]
    [exit code: 0]
    "#);
    assert_eq!(first.stdout, second.stdout);
}

#[test]
fn what_fails_is_named_and_nothing_is_stored() {
    let mut failures = String::new();
    for body in [
        "command = [\"sh\", \"-c\", \"echo {sum: 1}; echo oh no >&2; exit 3\"]",
        "command = [\"sh\", \"-c\", \"kill -9 $$\"]",
        "command = [\"sleep\", \"60\"]\ntimeout = \"200ms\"",
        "command = [\"no-such-program\"]",
        "command = [\"./sum.py\"]",
        "command = [\"yes\", \"{}\"]",
    ] {
        let query = args(&["query", "robmem.calc", "{compute: 'sum', x: 15, y: 4}"]);
        let outcome = |cache: &str| {
            let lab = lab(&format!("{body}\n{cache}"));
            let outcome = lab.rmem(&query).to_string();
            assert_eq!(lab.rmem(&args(&["count", "robmem.calc"])).success(), "0\n");
            outcome
        };
        let failure = outcome("");
        assert_eq!(failure, outcome("cache = \"1h\""));
        failures += &format!("{body}\n{failure}\n");
    }
    assert_run!(failures, @r#"
    command = ["sh", "-c", "echo {sum: 1}; echo oh no >&2; exit 3"]
    ------- stderr -------
    error: the computable `sum` failed: its command `sh -c echo {sum: 1}; echo oh no >&2; exit 3` failed with exit code 3
      | oh no
    [exit code: 4]
    command = ["sh", "-c", "kill -9 $$"]
    ------- stderr -------
    error: the computable `sum` failed: its command `sh -c kill -9 $$` was ended by signal 9
    [exit code: 4]
    command = ["sleep", "60"]
    timeout = "200ms"
    ------- stderr -------
    error: the computable `sum` failed: its command `sleep 60` was stopped after 200ms; the computable's `timeout` is how long it may take
    [exit code: 4]
    command = ["no-such-program"]
    ------- stderr -------
    error: the computable `sum` failed: its command `no-such-program` cannot be run: there is no such program; a path is relative to $LAB/robot
    [exit code: 4]
    command = ["./sum.py"]
    ------- stderr -------
    error: the computable `sum` failed: its command `./sum.py` cannot be run: there is no such program; a path is relative to $LAB/robot
    [exit code: 4]
    command = ["yes", "{}"]
    ------- stderr -------
    error: the computable `sum` failed: its command `yes {}` was stopped because it printed more than 64 MiB
    [exit code: 4]
    "#);
}

#[test]
fn what_is_wrong_with_a_question_or_an_answer_is_bad_input() {
    let sum = "{compute: 'sum', x: 15, y: 0}";
    let mut failures = String::new();
    for body in [
        r#"command = ["sh", "-c", "echo '{sum: 1}'; echo '{sum: }'; echo oh no >&2"]"#,
        r#"command = ["echo", "{a: 1, _id: [1]}"]"#,
        r#"builtin = "nearest""#,
        r#"pipeline = "[{$match: {sum: '$$query.z'}}]""#,
        "pipeline = \"[{$set: {sum: {$divide: ['$$query.x', '$$query.y']}}}]\"\nfrom = \"robmem.numbers\"",
        r#"pipeline = "[{$match: {compute: 'sum', x: 1, y: 1}}]""#,
    ] {
        let lab = lab(body);
        lab.rmem(&args(&["insert", "robmem.numbers", "{_id: 1}"])).success();
        let run = lab.rmem(&args(&["query", "robmem.calc", sum]));
        failures += &format!("{body}\n{run}\n");
        assert_eq!(lab.rmem(&args(&["count", "robmem.calc"])).success(), "0\n");
    }
    assert_run!(failures, @r#"
    command = ["sh", "-c", "echo '{sum: 1}'; echo '{sum: }'; echo oh no >&2"]
    ------- stderr -------
    error: the computable `sum` failed: its command `sh -c echo '{sum: 1}'; echo '{sum: }'; echo oh no >&2` did not print documents, one a line
    its output:2:7: expected a value, found `}`
      |
    2 | {sum: }
      |       ^
      = hint: the `{` at 2:1 is not closed
      | oh no
    [exit code: 3]
    command = ["echo", "{a: 1, _id: [1]}"]
    ------- stderr -------
    error: the computable `sum` failed: what it gave cannot be stored in robmem.calc: the _id may not be an array
    [exit code: 3]
    builtin = "nearest"
    ------- stderr -------
    error: the computable `sum` failed: its `nearest_to` has to be a point, [x, y, z] or [x, y]
    [exit code: 3]
    pipeline = "[{$match: {sum: '$$query.z'}}]"
    ------- stderr -------
    error: the computable `sum` failed: its pipeline takes `$$query.z` for a filter, and the query {"compute":"sum","x":15,"y":0} has no `z`; let the spec ask for it, with {'z': {$exists: true}}
    [exit code: 3]
    pipeline = "[{$set: {sum: {$divide: ['$$query.x', '$$query.y']}}}]"
    from = "robmem.numbers"
    ------- stderr -------
    error: the computable `sum` failed: can't $divide by zero
    [exit code: 3]
    pipeline = "[{$match: {compute: 'sum', x: 1, y: 1}}]"
    ------- stderr -------
    error: the computable `sum` failed: computables depend on each other in a cycle: sum → sum; narrow the spec or the query of one
    [exit code: 3]
    "#);
}

#[test]
fn what_is_wrong_in_a_table_is_shown_at_its_place() {
    let second = |line: &str| format!("pipeline = '[]'\n[[computable]]\ncollection = 'a.b'\npipeline = '[]'\n{line}");
    let mistakes = [
        "command = ['true']\ntimeout = '0s'",
        "command = ['true']\ntimeout = 'soon'",
        "command = ['true']\ncache = '0ms'",
        "command = ['true']\ntimeout = 3",
        "builtin = 'nearest'\ntimeout = '1s'",
        "builtin = 'nearest'\nposition = ''",
        r#"pipeline = "[{$nope: 1}]""#,
        r#"pipeline = "[{$match: {a: 1}}, {$out: 'x'}]""#,
        "pipeline = '''\n[{$match: {a: 1}},\n {$set: {a: {$nope: 1}}}]'''",
        r#"pipeline = "[{$set: {a: '$$nope'}}]""#,
        r#"pipeline = "[{$match: {a: }}]""#,
        r#"pipeline = "[{$match: {\"a\": }}]""#,
        &second("name = ' '\nspec = '{}'"),
        &second("name = 'b'\nspec = '{a: {$nope: 1}}'"),
    ];
    let refused = mistakes.map(|rest| lab(rest).rmem(&args(&["computables"])).to_string());
    assert_run!(refused.join("\n"), @r#"
    ------- stderr -------
    error: $LAB/robot/rmem.toml:7:11: expected a duration above zero, found `0s`; leave `timeout` out for 10s
      |
    7 | timeout = '0s'
      |           ^^^^
    [exit code: 3]
    ------- stderr -------
    error: $LAB/robot/rmem.toml:7:11: `soon` is not a duration; expected a number and a unit, like 500ms, 2s, 1m or 1h
      |
    7 | timeout = 'soon'
      |           ^^^^^^
    [exit code: 3]
    ------- stderr -------
    error: $LAB/robot/rmem.toml:7:9: expected a duration above zero, found `0ms`; leave `cache` out to compute for each query
      |
    7 | cache = '0ms'
      |         ^^^^^
    [exit code: 3]
    ------- stderr -------
    error: $LAB/robot/rmem.toml:7:11: expected a string, found `3`
      |
    7 | timeout = 3
      |           ^
    [exit code: 3]
    ------- stderr -------
    error: $LAB/robot/rmem.toml:7:11: `timeout` has no meaning for the body `nearest`
      |
    7 | timeout = '1s'
      |           ^^^^
    [exit code: 3]
    ------- stderr -------
    error: $LAB/robot/rmem.toml:7:12: `` is not a key; expected one like `pose.translation`
      |
    7 | position = ''
      |            ^^
    [exit code: 3]
    ------- stderr -------
    error: $LAB/robot/rmem.toml:6:15: expected a pipeline: unrecognized pipeline stage name: '$nope'
      |
    6 | pipeline = "[{$nope: 1}]"
      |               ^^^^^
    [exit code: 3]
    ------- stderr -------
    error: $LAB/robot/rmem.toml:6:33: expected a pipeline: a computable gives documents and stores none itself; leave $out out
      |
    6 | pipeline = "[{$match: {a: 1}}, {$out: 'x'}]"
      |                                 ^^^^
    [exit code: 3]
    ------- stderr -------
    error: $LAB/robot/rmem.toml:8:14: expected a pipeline: unrecognized expression '$nope'
      |
    8 |  {$set: {a: {$nope: 1}}}]'''
      |              ^^^^^
    [exit code: 3]
    ------- stderr -------
    error: $LAB/robot/rmem.toml:6:26: expected a pipeline: use of undefined variable: nope
      |
    6 | pipeline = "[{$set: {a: '$$nope'}}]"
      |                          ^^^^^^
    [exit code: 3]
    ------- stderr -------
    error: $LAB/robot/rmem.toml:6:27: expected a pipeline: expected a value, found `}`
      |
    6 | pipeline = "[{$match: {a: }}]"
      |                           ^
    [exit code: 3]
    ------- stderr -------
    error: $LAB/robot/rmem.toml:6:12: expected a pipeline: expected a value, found `}`
      |
    6 | pipeline = "[{$match: {\"a\": }}]"
      |            ^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    ------- stderr -------
    error: $LAB/robot/rmem.toml:10:8: expected a name for the computable, found an empty one
       |
    10 | name = ' '
       |        ^^^
    [exit code: 3]
    ------- stderr -------
    error: $LAB/robot/rmem.toml:11:14: expected a query: unknown operator: $nope
       |
    11 | spec = '{a: {$nope: 1}}'
       |              ^^^^^
    [exit code: 3]
    "#);
    for right in [
        "pipeline = \"[{$match: {a: '$$query.x'}}, {$limit: '$$query.y'}]\"",
        "pipeline = \"[{$set: {a: {$add: ['$$query.x', '$a']}}}]\"",
        "pipeline = \"[{$match: {$text: {$search: 'x'}}}]\"",
        "builtin = 'nearest'\nposition = 'pose.translation'",
    ] {
        lab(right).rmem(&args(&["computables"])).success();
    }
}

#[test]
fn a_computation_that_was_killed_lets_others_compute() {
    let lab = lab("command = [\"sh\", \"slow.sh\"]\ntimeout = \"600s\"\ncache = \"60s\"");
    lab.write("robot/slow.sh", "[ -e started ] || { touch started; sleep 600; }\necho '{\"sum\": 7}'\n");
    let query = args(&["query", "robmem.calc", "{compute: 'sum', x: 3, y: 4}"]);
    let mut command = std::process::Command::new(crate::lab::rmem());
    lab.isolate(&mut command);
    let mut first = command.args(&query).spawn().unwrap();
    until("it computes", || lab.path().join("robot/started").exists());
    first.kill().unwrap();
    first.wait().unwrap();
    lab.rmem(&query).success();
    let all = args(&["query", "robmem.calc", "{sum: 7}", "--fields", "{_id: 0}", "--computed"]);
    let all = lab.rmem(&all);
    assert_eq!(all.success(), "{\"sum\":7}\n");
}

#[test]
fn a_program_that_is_not_asked_is_not_run() {
    let lab = lab("command = [\"no-such-program\"]");
    for question in [
        vec!["query", "robmem.calc", "{compute: 'sum', x: 15}"],
        vec!["query", "robmem.other", "{compute: 'sum', x: 15, y: 4}"],
        vec!["update", "robmem.calc", "{compute: 'sum', x: 15, y: 4}", "{$set: {a: 1}}"],
        vec!["delete", "robmem.calc", "{compute: 'sum', x: 15, y: 4}"],
        vec!["dump", "--all"],
        vec!["computables", "--check", "robmem.calc", "{compute: 'sum', x: 15, y: 4}"],
    ] {
        lab.rmem(&args(&question)).success();
    }
    assert!(!lab.path().join("robot/robot.rmem").exists(), "questions make no file");
}

#[test]
fn the_registered_are_listed_and_checked() {
    let lab = lab("builtin = \"nearest\"\npriority = 3\ncache = \"500ms\"");
    let listed = lab.rmem(&args(&["computables"])).success();
    assert_eq!(
        listed,
        "{\"name\":\"sum\",\"collection\":\"robmem.calc\",\"spec\":{\"compute\":\"sum\",\"x\":{\"$exists\":true},\
         \"y\":{\"$exists\":true}},\"priority\":3,\"cache\":\"500ms\",\"body\":\"nearest, with positions under \
         translation\",\"origin\":\"$LAB/robot/rmem.toml:3\"}\n"
    );
    let check = |ns: &str, query: &str| lab.rmem(&args(&["computables", "--check", ns, query])).success();
    assert_eq!(
        check("robmem.calc", "{compute: 'sum', x: 15, y: 4}"),
        "{\"name\":\"sum\",\"runs\":true,\"why\":\"the query matches the spec\"}\n"
    );
    assert_run!(check("robmem.calc", "{compute: 'sum', x: 15}"), @r#"{"name":"sum","runs":false,"why":"the query does not match {\"y\":{\"$exists\":true}} of the spec"}"#);
    assert_run!(check("robmem.other", "{}"), @r#"{"name":"sum","runs":false,"why":"it computes documents of robmem.calc"}"#);
    assert_run!(lab.rmem(&args(&["computables", "--check", "nodot", "{}"])), @r"
    ------- stderr -------
    error: `nodot` is not a namespace: it has no dot; expected DATABASE.COLLECTION, like robmem.worldmodel
    [exit code: 2]
    ");
}

#[test]
fn an_explained_query_says_what_was_computed() {
    let lab = lab("command = [\"sh\", \"sum.sh\"]\ncache = \"1h\"");
    for cached in ["false", "true"] {
        let query = args(&["query", "robmem.calc", "{compute: 'sum', x: 15, y: 4}", "--explain"]);
        let text = lab.rmem(&query).success();
        let start = format!(
            "\"computables\":[{{\"name\":\"sum\",\"namespace\":\"robmem.calc\",\"cached\":{cached},\"documents\":1,"
        );
        assert!(text.contains(&start) && text.contains("\"milliseconds\":"), "{text}");
    }
}

/// The arguments for the blocks world as a camera sees it.
fn geometric<'a>(world: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let mut args = vec!["--memory", "mem:", "--config", "fixtures/blocksworld-geometric.toml", "--load", world];
    args.extend(more);
    args.extend(["--template", "templates/blocksworld/problem.pddl.j2", "--domain", "domains/blocksworld/domain.pddl"]);
    args.extend(["--goal", "(and (on A B) (on B C))"]);
    args
}

#[test]
fn poses_give_the_problem_that_relations_give() {
    let lab = Lab::new();
    let problem = lab.rmem(&geometric("fixtures/blocksworld-geometric.json", &["gen-problem"])).success();
    let relations = geometric("fixtures/blocksworld.json", &["gen-problem"]);
    let without = relations.into_iter().filter(|word| !word.ends_with(".toml") && *word != "--config");
    // Which is on record in a snapshot.
    assert_eq!(problem, lab.rmem(&without.collect::<Vec<_>>()).success());
    let plan = lab.rmem(&geometric("fixtures/blocksworld-geometric.json", &["plan", "--no-store"])).success();
    assert_eq!(plan.lines().next(), Some("(stack B C)"), "{plan}");
    assert!(plan.ends_with("; cost = 5 (unit cost)\n"), "{plan}");
}

#[test]
fn a_block_that_stands_on_nothing_known_stands_on_an_unknown_block() {
    let lab = Lab::new();
    let world = lab.read("fixtures/blocksworld-geometric.json");
    let world: Vec<&str> = world.lines().filter(|line| !line.contains("\"block\": \"A\"")).collect();
    lab.write("unseen.json", &world.join("\n"));
    let mut args = geometric("unseen.json", &["gen-problem"]);
    args.pop();
    args.push("(on B C)");
    let problem = lab.rmem(&args).success();
    assert!(problem.contains("(on D unknown-below-D)") && problem.contains("(on-table unknown-below-D)"), "{problem}");
    assert!(problem.contains("(:objects B C unknown-below-D D)"), "{problem}");
}

#[test]
fn computations_are_logged() {
    let lab = lab("command = [\"sh\", \"sum.sh\"]");
    lab.rmem(&args(&["--log", "log", "count", "robmem.calc", "{compute: 'sum', x: 15, y: 4}"])).success();
    let log = lab.read("log");
    assert!(log.contains("\"operation\":\"compute sum\",\"subject\":\"robmem.calc\""), "{log}");
}

#[test]
fn a_cached_computation_that_ends_too_far_ahead_is_stale() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    lab.write(
        "rmem.toml",
        "[[computable]]\nname = \"now\"\ncollection = \"a.b\"\nspec = \"{compute: 'now'}\"\ncache = \"1m\"\n\
         command = [\"sh\", \"-c\", \"echo {compute: \\\\\\\"now\\\\\\\", n: $(date +%N)}\"]\n",
    );
    let query = || lab.rmem(&["query", "a.b", "{compute: 'now'}"]).success();
    let first = query();
    assert_eq!(first, query(), "the cache holds");
    // As if the clock had been a day ahead when it was computed.
    let later = "{$set: {'_robmem_info.cached_until': new Date(4102444800000)}}";
    let store = rmem::store::Embedded::open(lab.path().join("robot.rmem")).unwrap();
    let update = rmem::formats::shell::parse_document(&rmem::formats::Source::new("u", later)).unwrap();
    let request = rmem::store::UpdateRequest {
        filter: bson::doc! {},
        update: rmem::store::UpdateSpec::Document(update),
        many: true,
        ..rmem::store::UpdateRequest::default()
    };
    let ns = rmem::store::Namespace { database: "a".into(), collection: "rmem.computed".into() };
    rmem::store::Store::update(&store, &ns, &request, None).unwrap();
    drop(store);
    assert_ne!(first, query());
}

#[test]
fn a_supervisor_that_was_stopped_is_continued() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    // The parent of the program is its supervisor.
    lab.write(
        "rmem.toml",
        "[[computable]]\nname = \"stop\"\ncollection = \"a.b\"\nspec = \"{compute: 'stop'}\"\n\
         command = [\"sh\", \"-c\", \"kill -STOP $PPID; sleep 0.2; echo '{compute: \\\"stop\\\"}'\"]\n",
    );
    let answer = lab.rmem(&["count", "a.b", "{compute: 'stop'}"]).success();
    assert_eq!(answer, "1\n");
}

#[test]
fn who_did_not_ask_a_computable_counts_stored_documents_only() {
    let lab = lab("command = [\"sh\", \"sum.sh\"]\ncache = \"1h\"");
    lab.rmem(&args(&["insert", "robmem.calc", "{_id: 1, compute: 'nothing'}"])).success();
    let count = |more: &[&str]| {
        let mut words = args(&["count", "robmem.calc"]);
        words.extend(more);
        lab.rmem(&words).success()
    };
    assert_eq!(count(&[]), "1\n");
    assert_eq!(count(&["{compute: 'sum', x: 15, y: 4}"]), "1\n");
    assert_eq!(count(&[]), "1\n", "a query finds what other queries computed");
    assert_eq!(count(&["--computed"]), "2\n");
    let of = |words: &[&str]| lab.rmem(&args(words)).success();
    assert_eq!(of(&["distinct", "robmem.calc", "compute"]), "\"nothing\"\n");
    assert_eq!(of(&["distinct", "robmem.calc", "compute", "--computed"]), "\"nothing\"\n\"sum\"\n");
    assert_eq!(of(&["query", "robmem.calc", "--fields", "{_id: 0}"]), "{\"compute\":\"nothing\"}\n");
    assert!(of(&["query", "robmem.calc", "--computed"]).contains("\"sum\":19"));
    let total = "[{$group: {_id: null, n: {$sum: 1}}}, {$project: {_id: 0}}]";
    assert_eq!(of(&["aggregate", "robmem.calc", total]), "{\"n\":1}\n");
    assert_eq!(of(&["aggregate", "robmem.calc", total, "--computed"]), "{\"n\":2}\n");
    assert_eq!(
        of(&["update", "robmem.calc", "{}", "{$set: {seen: true}}", "--many"]),
        "{\"matched\":1,\"modified\":1}\n"
    );
}

/// A memory of objects, and a computable that adds their distances from a point.
fn distances(adds: &str, body: &str) -> Lab {
    let lab = Lab::new();
    lab.write(
        "rmem.toml",
        &format!(
            "memory = 'file:robot.rmem'\n\
             [[computable]]\nname = 'distance'\ncollection = 'a.objects'\nspec = \"{{distance: {{$exists: true}}}}\"\n\
             adds = {adds}\n{body}\n"
        ),
    );
    let objects = ["{_id: 1, name: 'cup', x: 3}", "{_id: 2, name: 'cup', x: 8}", "{_id: 3, name: 'jar', x: 1}"];
    lab.rmem(&[&["insert", "a.objects"], &objects[..]].concat()).success();
    lab.rmem(&["insert", "a.objects", "{_id: 4, name: 'lid', x: 1, distance: 'far'}"]).success();
    lab.rmem(&["insert", "a.shelves", "{_id: 1, holds: 'cup'}", "{_id: 2, holds: 'jar'}"]).success();
    lab
}

const DISTANCE: &str = "pipeline = \"[{$project: {distance: {$abs: {$subtract: ['$x', 4]}}}}]\"";

#[test]
fn keys_are_added_to_stored_documents_and_stored_nowhere() {
    let lab = distances("['distance']", DISTANCE);
    let near = "{distance: {$lt: 3.5}, name: {$ne: 'pan'}}";
    assert_run!(lab.rmem(&["query", "a.objects", near, "--sort", "{distance: -1}", "-v"]), @r#"
    {"_id":3,"name":"jar","x":1,"distance":3}
    {"_id":1,"name":"cup","x":3,"distance":1}
    ------- stderr -------
    add distance a.objects: 4 documents in [DURATION]
    [exit code: 0]
    "#);
    assert_eq!(lab.rmem(&["count", "a.objects", near]).success(), "2\n");
    assert_eq!(
        lab.rmem(&["distinct", "a.objects", "distance", "{distance: {$exists: true}}"]).success(),
        "1\n3\n4\n\"far\"\n"
    );
    let joined = "[{$match: {distance: {$lt: 2}}}, {$lookup: {from: 'shelves', localField: 'name', foreignField: 'holds', as: 'on'}},
        {$project: {_id: 0, name: 1, distance: 1, on: '$on._id'}}]";
    assert_run!(lab.rmem(&["aggregate", "a.objects", joined]), @r#"
    {"name":"cup","distance":1,"on":[1]}
    ------- stderr -------
    [exit code: 0]
    "#);
    let other =
        "[{$lookup: {from: 'objects', pipeline: [{$match: {distance: {$gt: 2}}}, {$sort: {_id: 1}}], as: 'far'}},
        {$project: {_id: 1, far: '$far.distance'}}]";
    assert_run!(lab.rmem(&["aggregate", "a.shelves", other]), @r#"
    {"_id":1,"far":[4,3]}
    {"_id":2,"far":[4,3]}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&["aggregate", "a.objects", "[{$match: {distance: {$gt: 2}}}, {$out: 'copy'}]"]), @r"
    ------- stderr -------
    error: <pipeline>:1:1: a pipeline that writes cannot ask for keys that computables add, since they are stored nowhere
      |
    1 | [{$match: {distance: {$gt: 2}}}, {$out: 'copy'}]
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    ");
    // Nothing is stored, and a query that asks for no distance gets none.
    assert_run!(lab.rmem(&["query", "a.objects", "--computed"]), @r#"
    {"_id":1,"name":"cup","x":3}
    {"_id":2,"name":"cup","x":8}
    {"_id":3,"name":"jar","x":1}
    {"_id":4,"name":"lid","x":1,"distance":"far"}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_eq!(lab.rmem(&["collections"]).success(), "a.objects\na.shelves\n");
}

#[test]
fn a_program_adds_keys_to_the_documents_that_it_reads() {
    let lab = distances("true", "command = ['sh', 'tag.sh']");
    lab.write(
        "tag.sh",
        "read query; echo \"$query\" > asked; while read -r line; do echo \"$line\" >> asked; done\n\
        echo '{_id: 1, tag: \"first\", name: \"never\"}'; echo '{_id: 99, tag: 1}'; echo '{tag: 2}'\n",
    );
    let toml = lab.read("rmem.toml").replace("distance: {$exists: true}", "name: {$exists: true}");
    lab.write("rmem.toml", &toml);
    assert_run!(lab.rmem(&["query", "a.objects", "{name: 'cup'}"]), @r#"
    {"_id":1,"name":"cup","x":3,"tag":"first"}
    {"_id":2,"name":"cup","x":8}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_eq!(
        lab.read("asked"),
        "{\"name\":\"cup\"}\n{\"_id\":1,\"name\":\"cup\",\"x\":3}\n{\"_id\":2,\"name\":\"cup\",\"x\":8}\n"
    );
    // What the query asks of other keys is met as without the computable.
    assert_eq!(lab.rmem(&["count", "a.objects", "{name: 'cup', tag: 'first'}"]).success(), "0\n");
    lab.write("tag.sh", "exit 3\n");
    assert_run!(lab.rmem(&["query", "a.objects", "{name: 'cup'}"]), @r"
    ------- stderr -------
    error: the computable `distance` failed: its command `sh tag.sh` failed with exit code 3
    [exit code: 4]
    ");
}

#[test]
fn one_computable_is_for_several_collections() {
    let lab = distances("['distance']", DISTANCE);
    lab.write("rmem.toml", &lab.read("rmem.toml").replace("'a.objects'", "['a.objects', 'a.people']"));
    lab.rmem(&["insert", "a.people", "{_id: 1, x: 2}"]).success();
    assert_run!(lab.rmem(&["query", "a.people", "{distance: {$lt: 3}}"]), @r#"
    {"_id":1,"x":2,"distance":2}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_eq!(lab.rmem(&["count", "a.objects", "{distance: {$lt: 3}}"]).success(), "1\n");
    assert_run!(lab.rmem(&["computables"]), @r#"
    {"name":"distance","collection":"a.people","spec":{"distance":{"$exists":true}},"priority":0,"cache":null,"body":"pipeline over a.people: [{\"$project\":{\"distance\":{\"$abs\":{\"$subtract\":[\"$x\",4]}}}}]","origin":"$LAB/rmem.toml:3","adds":["distance"]}
    {"name":"distance","collection":"a.objects","spec":{"distance":{"$exists":true}},"priority":0,"cache":null,"body":"pipeline over a.objects: [{\"$project\":{\"distance\":{\"$abs\":{\"$subtract\":[\"$x\",4]}}}}]","origin":"$LAB/rmem.toml:3","adds":["distance"]}
    ------- stderr -------
    [exit code: 0]
    "#);
}

#[test]
fn explain_and_why_count_keys_that_are_added() {
    let lab = distances("['distance']", DISTANCE);
    lab.rmem(&["index", "a.objects", "{name: 1}"]).success();
    let near = "{distance: {$lt: 3}, name: 'cup'}";
    assert_run!(lab.rmem(&["query", "a.objects", near, "--explain", "--sort", "{distance: 1}"]), @r#"
    {"index":"name_1","keys":{"name":1},"bounds":{"name":["[\"cup\", \"cup\"]"]},"keys_examined":2,"documents_examined":2,"returned":1,"sort":"memory","computables":[{"name":"distance","namespace":"a.objects","cached":false,"documents":2,"milliseconds":[DURATION]}]}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&["query", "a.objects", "{distance: {$lt: 3.5}, name: 'pan'}", "--why"]), @r#"
    a.objects: 4 documents, 0 match
      alone  together  condition
          2         2  {"distance":{"$lt":3.5}}
          0         0  {"name":"pan"}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&["query", "a.objects", "{distance: '3', name: 'cup'}", "--why"]), @r#"
    a.objects: 4 documents, 0 match
      alone  together  condition
          0         0  {"distance":"3"}
                       {distance: 3} matches 1 document
          2         0  {"name":"cup"}
    ------- stderr -------
    [exit code: 0]
    "#);
}

#[test]
fn a_key_that_adds_does_not_name_is_an_error() {
    let lab = distances("['distance']", "pipeline = \"[{$project: {distance: '$x', far: {$literal: true}}}]\"");
    assert_run!(lab.rmem(&["query", "a.objects", "{distance: 3}"]), @r"
    ------- stderr -------
    error: the computable `distance` failed: it gives the key `far` to the document with _id 1, and `adds` names distance; name that one, too, or leave it out
    [exit code: 3]
    ");
}

#[test]
fn mistakes_in_what_is_added_are_shown_at_their_place() {
    for (adds, more, message) in [
        ("3", "", "rmem.toml:6:8: expected true, or an array of the added keys"),
        ("[1]", "", "rmem.toml:6:8: expected true, or an array of the added keys"),
        ("[]", "", "rmem.toml:6:8: expected the keys that it adds, found none; `true` stands for any"),
        ("['x', '_id']", "", "rmem.toml:6:8: `_id`: `_id` says which document gets the keys, and cannot be added"),
        ("['x.y']", "", "rmem.toml:6:8: `x.y`: expected a key of the document itself"),
        ("['x', 'x']", "", "rmem.toml:6:8: `x`: it is given twice"),
        ("true", "cache = '1s'", "rmem.toml:8:9: `cache` has no meaning where keys are added"),
        ("true", "builtin = 'nearest'", "keys are added by a `pipeline` or a `command`"),
    ] {
        let lab = Lab::new();
        let body = if more.starts_with("builtin") { String::new() } else { DISTANCE.to_owned() };
        lab.write(
            "rmem.toml",
            &format!("[[computable]]\nname = 'd'\ncollection = 'a.b'\nspec = '{{}}'\n# added\nadds = {adds}\n{body}\n{more}\n"),
        );
        let run = lab.rmem(&["collections"]).exits(3);
        assert!(run.stderr.contains(message), "{run}");
    }
    for (collection, message) in [
        ("[]", "expected a collection, found none"),
        ("3", "expected a collection, or an array of collections, found integer"),
        ("['a.b', 'a.b']", "a.b is given twice"),
        ("['a.b', 'c']", "`c` is not a namespace"),
    ] {
        let lab = Lab::new();
        lab.write(
            "rmem.toml",
            &format!("[[computable]]\nname = 'd'\ncollection = {collection}\nspec = '{{}}'\n{DISTANCE}\n"),
        );
        let run = lab.rmem(&["collections"]).exits(3);
        assert!(run.stderr.contains(&format!("rmem.toml:3:14: {message}")), "{run}");
    }
}

#[test]
fn documents_that_get_keys_are_chosen_and_worked_on_as_the_collection_or_the_query_compares() {
    let lab = Lab::new();
    // Two names that differ only in case are one group.
    let body = "[{$group: {_id: '$name', all: {$push: '$_id'}}}, {$unwind: '$all'}, {$group: {_id: '$all', group: {$first: '$_id'}}}, \
                {$project: {first: {$eq: ['$group', 'cup']}}}]";
    lab.write(
        "rmem.toml",
        &format!(
            "memory = 'file:robot.rmem'\n[[computable]]\nname = 'first'\ncollection = 'a.objects'\n\
             spec = \"{{first: {{$exists: true}}}}\"\nadds = ['first']\npipeline = \"{body}\"\n"
        ),
    );
    let count = |more: &[&str]| {
        let query = ["count", "a.objects", "{name: 'CUP', first: true}"];
        lab.rmem(&[&query[..], more].concat()).success()
    };
    let objects = ["insert", "a.objects", "{_id: 1, name: 'cup'}", "{_id: 2, name: 'Cup'}", "{_id: 3, name: 'jar'}"];
    lab.rmem(&objects).success();
    let ignore_case = ["--collation", "{locale: 'en', strength: 2}"];
    assert_eq!([count(&[]), count(&ignore_case)], ["0\n", "1\n"]);
    lab.rmem(&["drop", "a.objects"]).success();
    lab.rmem(&[&["create", "a.objects"][..], &ignore_case].concat()).success();
    lab.rmem(&objects).success();
    assert_eq!([count(&[]), count(&["--collation", "{locale: 'simple'}"])], ["2\n", "0\n"]);
}

#[test]
fn what_a_computable_prints_has_to_be_utf_8() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    lab.write(
        "rmem.toml",
        "[[computable]]\nname = \"utf\"\ncollection = \"a.b\"\nspec = \"{utf: 1}\"\n\
         command = [\"printf\", \"{utf: 1}\\\\n{utf: 1, a: \\\"\\\\377\\\"}\\\\n\"]\n",
    );
    let refused = lab.rmem(&["query", "a.b", "{utf: 1}"]).exits(3);
    assert!(refused.stderr.contains("2:14: expected UTF-8 text, found invalid UTF-8"), "{refused}");
}
