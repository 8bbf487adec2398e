//! Computables from rmem.toml: commands and how they fail, what is listed, logged and checked.

use crate::lab::Lab;

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
    assert!(first.stderr.contains("compute sum robmem.calc: 1 documents in "), "{first}");
    lab.write("robot/sum.sh", "exit 1");
    let second = ask("{y: 4, x: 15, compute: 'sum'}");
    assert!(second.stderr.contains("cached sum robmem.calc: 1 documents in "), "{second}");
    assert_eq!(first.stdout, second.stdout);
}

#[test]
fn what_fails_is_named_and_nothing_is_stored() {
    for (body, words) in [
        ("command = [\"sh\", \"-c\", \"echo {sum: 1}; echo oh no >&2; exit 3\"]", vec!["exit code 3", "| oh no"]),
        ("command = [\"sh\", \"-c\", \"kill -9 $$\"]", vec!["was ended by signal 9"]),
        ("command = [\"sleep\", \"60\"]\ntimeout = \"200ms\"", vec!["was stopped after 200ms", "`timeout`"]),
        ("command = [\"no-such-program\"]", vec!["no such program"]),
        ("command = [\"./sum.py\"]", vec!["no such program", "$LAB/robot"]),
        ("command = [\"yes\", \"{}\"]", vec!["printed more than 64 MiB"]),
    ] {
        for cache in ["", "cache = \"1h\""] {
            let lab = lab(&format!("{body}\n{cache}"));
            let run = lab.rmem(&args(&["query", "robmem.calc", "{compute: 'sum', x: 15, y: 4}"])).exits(4);
            assert!(run.stderr.contains("the computable `sum` failed: its command `"), "{run}");
            assert!(words.iter().all(|word| run.stderr.contains(word)), "{words:?}: {run}");
            assert_eq!(run.stdout, "");
            assert_eq!(lab.rmem(&args(&["count", "robmem.calc"])).success(), "0\n");
        }
    }
}

#[test]
fn what_is_wrong_with_a_question_or_an_answer_is_bad_input() {
    let sum = "{compute: 'sum', x: 15, y: 0}";
    for (body, words) in [
        (
            r#"command = ["sh", "-c", "echo '{sum: 1}'; echo '{sum: }'; echo oh no >&2"]"#,
            ["did not print documents", "its output:2:7", "| oh no"],
        ),
        (r#"command = ["echo", "{a: 1, _id: [1]}"]"#, ["what it gave cannot be stored in robmem.calc", "_id", "array"]),
        (r#"builtin = "nearest""#, ["`nearest_to` has to be a point", "", ""]),
        (r#"pipeline = "[{$match: {sum: '$$query.z'}}]""#, ["its pipeline takes `$$query.z`", "has no `z`", ""]),
        (
            "pipeline = \"[{$set: {sum: {$divide: ['$$query.x', '$$query.y']}}}]\"\nfrom = \"robmem.numbers\"",
            ["zero", "", ""],
        ),
        (r#"pipeline = "[{$match: {compute: 'sum', x: 1, y: 1}}]""#, ["in a cycle: sum → sum", "", ""]),
    ] {
        let lab = lab(body);
        lab.rmem(&args(&["insert", "robmem.numbers", "{_id: 1}"])).success();
        let run = lab.rmem(&args(&["query", "robmem.calc", sum])).exits(3);
        assert!(run.stderr.contains("the computable `sum` failed: "), "{run}");
        assert!(words.iter().all(|word| run.stderr.contains(word)), "{words:?}: {run}");
        assert_eq!(lab.rmem(&args(&["count", "robmem.calc"])).success(), "0\n");
    }
}

#[test]
fn what_is_wrong_in_a_table_is_shown_at_its_place() {
    let second = |line: &str| format!("pipeline = '[]'\n[[computable]]\ncollection = 'a.b'\npipeline = '[]'\n{line}");
    for (rest, words) in [
        ("command = ['true']\ntimeout = '0s'", "7:11: expected a duration above zero, found `0s`"),
        ("command = ['true']\ntimeout = 'soon'", "7:11: `soon` is not a duration"),
        ("command = ['true']\ncache = '0ms'", "7:9: expected a duration above zero, found `0ms`"),
        ("command = ['true']\ntimeout = 3", "7:11: invalid type"),
        ("builtin = 'nearest'\ntimeout = '1s'", "7:11: `timeout` has no meaning"),
        ("builtin = 'nearest'\nposition = ''", "7:12: `` is no key"),
        (r#"pipeline = "[{$nope: 1}]""#, "6:15: expected a pipeline: "),
        (r#"pipeline = "[{$match: {a: 1}}, {$out: 'x'}]""#, "6:33: expected a pipeline: "),
        ("pipeline = '''\n[{$match: {a: 1}},\n {$set: {a: {$nope: 1}}}]'''", "8:3: expected a pipeline"),
        (r#"pipeline = "[{$set: {a: '$$nope'}}]""#, "expected a pipeline: "),
        (r#"pipeline = "[{$match: {a: }}]""#, "6:27: expected a pipeline: "),
        (r#"pipeline = "[{$match: {\"a\": }}]""#, "6:12: expected a pipeline: "),
        (&second("name = ' '\nspec = '{}'"), "10:8: expected a name for the computable"),
        (&second("name = 'b'\nspec = '{a: {$nope: 1}}'"), "11:14: expected a query: "),
    ] {
        let run = lab(rest).rmem(&args(&["computables"])).exits(3);
        assert!(run.stderr.contains("$LAB/robot/rmem.toml:"), "{run}");
        assert!(run.stderr.contains(words), "{words}: {run}");
    }
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
fn who_is_killed_over_a_computation_keeps_nobody_waiting() {
    let lab = lab("command = [\"sh\", \"slow.sh\"]\ntimeout = \"600s\"\ncache = \"60s\"");
    lab.write("robot/slow.sh", "[ -e started ] || { touch started; sleep 600; }\necho '{\"sum\": 7}'\n");
    let query = args(&["query", "robmem.calc", "{compute: 'sum', x: 3, y: 4}"]);
    let mut command = std::process::Command::new(crate::lab::rmem());
    lab.isolate(&mut command);
    let mut first = command.args(&query).spawn().unwrap();
    while !lab.path().join("robot/started").exists() {
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    first.kill().unwrap();
    first.wait().unwrap();
    lab.rmem(&query).success();
    let all = lab.rmem(&["--config", "robot/rmem.toml", "query", "robmem.calc", "{sum: 7}", "--fields", "{_id: 0}"]);
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
         translation\"}\n"
    );
    let check = |ns: &str, query: &str| lab.rmem(&args(&["computables", "--check", ns, query])).success();
    assert_eq!(
        check("robmem.calc", "{compute: 'sum', x: 15, y: 4}"),
        "{\"name\":\"sum\",\"runs\":true,\"why\":\"the query matches the spec\"}\n"
    );
    let missed = check("robmem.calc", "{compute: 'sum', x: 15}");
    assert!(missed.contains("the query does not match {\\\"y\\\":{\\\"$exists\\\":true}} of the spec"), "{missed}");
    assert!(check("robmem.other", "{}").contains("it computes documents of robmem.calc"));
    let run = lab.rmem(&args(&["computables", "--check", "nodot", "{}"])).exits(2);
    assert!(run.stderr.contains("`nodot` is not a namespace"), "{run}");
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
