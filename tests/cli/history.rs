//! history, undo, and --at: what a memory was, and how it became what it is.

use crate::lab::{Lab, TASK, assert_run};

const NS: &str = "robmem.worldmodel";

/// A folder whose memory keeps the history of everything for a day.
fn lab() -> Lab {
    with_settings("keep_history = '24h'\n")
}

fn with_settings(settings: &str) -> Lab {
    let lab = Lab::new();
    lab.write("rmem.toml", &format!("memory = 'file:robot.rmem'\n{settings}"));
    lab
}

fn lines(text: &str) -> Vec<serde_json::Value> {
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// The history, without times.
fn history(lab: &Lab, more: &[&str]) -> Vec<serde_json::Value> {
    lines(&lab.rmem(&[&["history", NS], more].concat()).success())
}

/// The time at which the last change was made.
fn last_time(lab: &Lab) -> String {
    let all = history(lab, &[]);
    all.last().unwrap()["time"]["$date"].as_str().unwrap().to_owned()
}

/// Lets the clock go on, so that what comes next has another time.
fn tick() {
    std::thread::sleep(std::time::Duration::from_millis(5));
}

#[test]
fn a_change_has_its_time_its_command_and_both_documents() {
    let lab = lab();
    lab.rmem(&["insert", NS, "{_id: 1, at: 'A'}", "{_id: 2, at: 'B'}"]).success();
    lab.rmem(&["update", NS, "{_id: 1}", "{$set: {at: 'C'}}"]).success();
    lab.rmem(&["delete", NS, "{_id: 2}"]).success();
    let all = history(&lab, &[]);
    let short: Vec<_> = all
        .iter()
        .map(|entry| {
            format!("{} {} {} {} {}", entry["by"], entry["operation"], entry["_id"], entry["before"], entry["after"])
        })
        .collect();
    assert_eq!(
        short,
        [
            r#""rmem insert" "insert" 1 null {"_id":1,"at":"A"}"#,
            r#""rmem insert" "insert" 2 null {"_id":2,"at":"B"}"#,
            r#""rmem update" "update" 1 {"_id":1,"at":"A"} {"_id":1,"at":"C"}"#,
            r#""rmem delete" "delete" 2 {"_id":2,"at":"B"} null"#,
        ]
    );
    assert!(all.iter().all(|entry| entry["time"]["$date"].is_string() && entry["ns"] == NS));
    assert_eq!(history(&lab, &["{at: 'C'}"]).len(), 1);
    assert_eq!(history(&lab, &["{_id: 2}", "--by", "delete"]).len(), 1);
    assert_eq!(history(&lab, &["--limit", "2"]).len(), 2);
    assert_eq!(history(&lab, &["--since", "1h"]).len(), 4);
    assert!(history(&lab, &["--meta", "--limit", "1"])[0]["before"]["_robmem_info"].is_object());
}

#[test]
fn a_memory_whose_history_is_not_kept_says_how_to_keep_it() {
    let lab = with_settings("");
    lab.rmem(&["insert", NS, "{_id: 1}"]).success();
    for command in [&["history", NS][..], &["undo", NS], &["query", NS, "--at", "1s"], &["dump", NS, "--at", "1s"]] {
        let run = lab.rmem(command).exits(2);
        assert!(run.stderr.contains("keep_history = \"24h\""), "{run}");
    }
    // Another table of the file is not made: nothing is paid.
    let tables = "SELECT count(*) FROM sqlite_schema WHERE name IN ('histories', 'origins')";
    let file = rusqlite::Connection::open(lab.path().join("robot.rmem")).unwrap();
    assert_eq!(file.query_row(tables, [], |row| row.get::<_, i64>(0)).unwrap(), 0);
}

#[test]
fn rules_are_for_databases_and_collections() {
    let lab = with_settings("[keep_history]\nrobmem = '1h'\n'robmem.camera' = 'off'\n");
    for ns in [NS, "robmem.camera", "other.things"] {
        lab.rmem(&["insert", ns, "{_id: 1}"]).success();
    }
    assert_eq!(history(&lab, &[]).len(), 1);
    for ns in ["robmem.camera", "other.things"] {
        assert!(lab.rmem(&["history", ns]).exits(2).stderr.contains("no history"));
    }
    // Off: the history goes, at the next write.
    lab.write("rmem.toml", "memory = 'file:robot.rmem'\nkeep_history = { robmem = 'off' }\n");
    lab.rmem(&["insert", NS, "{_id: 2}"]).success();
    assert!(lab.rmem(&["history", NS]).exits(2).stderr.contains("no history"));
}

#[test]
fn before_the_first_change_and_after_the_setting_is_gone_the_history_says_how_it_is() {
    let lab = lab();
    assert_run!(lab.rmem(&["history", NS]), @r"
    ------- stderr -------
    robmem.worldmodel was not changed since rmem.toml has keep_history; its history begins with the next write
    [exit code: 0]
    ");
    assert_run!(lab.rmem(&["undo", NS]), @r#"
    {"changes":0,"restored":0,"removed":0}
    ------- stderr -------
    error: no change of robmem.worldmodel is to be taken back
    [exit code: 1]
    "#);
    lab.rmem(&["insert", "robmem.other", "{_id: 1}"]).success();
    assert_run!(lab.rmem(&["history", NS]), @r"
    ------- stderr -------
    [exit code: 0]
    ");
    lab.write("rmem.toml", "memory = 'file:robot.rmem'\nkeep_history = 'off'\n");
    let run = lab.rmem(&["history", "robmem.other"]).exits(0);
    assert_eq!(run.stderr, "warning: keep_history is off for robmem.other: these changes go with the next write\n");
    assert_eq!(lines(&run.stdout).len(), 1);
}

#[test]
fn a_program_without_the_setting_keeps_the_history_too() {
    let lab = lab();
    lab.rmem(&["insert", NS, "{_id: 1}"]).success();
    lab.write("other/rmem.toml", "memory = 'file:../robot.rmem'\n");
    lab.shell("cd other && rmem update robmem.worldmodel '{_id: 1}' '{$set: {a: 1}}'").success();
    assert_eq!(history(&lab, &[]).len(), 2);
}

#[test]
fn undo_takes_the_last_command_back_and_undo_again_takes_that_back() {
    let lab = lab();
    lab.rmem(&["insert", NS, "{_id: 1, n: 1}", "{_id: 2, n: 1}", "{_id: 3, n: 1}"]).success();
    let before = lab.rmem(&["query", NS, "--meta"]).success();
    lab.rmem(&["update", NS, "{}", "{$set: {n: 2}}", "--many"]).success();
    let dry = lab.rmem(&["undo", NS, "--dry-run"]).exits(0);
    let first = "{\"_id\":1,\"becomes\":{\"_id\":1,\"n\":1},\"overwrites_later_changes\":false}\n";
    assert!(
        dry.stdout.starts_with(first) && dry.stdout.ends_with("{\"changes\":3,\"restored\":3,\"removed\":0}\n"),
        "{dry}"
    );
    assert_eq!(lab.rmem(&["undo", NS, "--dry-run", "-q"]).success(), dry.stdout);
    let json = lab.rmem(&["undo", NS, "--dry-run", "--format", "json"]).success();
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!((&json["changes"], &json["documents"][0]["becomes"]["n"]), (&3.into(), &1.into()), "{json}");
    let whole = lab.rmem(&["undo", NS, "--dry-run", "--meta"]).exits(0);
    assert!(whole.stdout.contains("\"becomes\":{\"_id\":1,\"n\":1,\"_robmem_info\":{"), "{whole}");
    assert_eq!(lab.rmem(&["count", NS, "{n: 2}"]).success(), "3\n");
    let misspelt = lab.rmem(&["history", &NS[..NS.len() - 1]]).exits(0);
    assert!(misspelt.stderr.contains(&format!("did you mean {NS}?")), "{misspelt}");
    assert_eq!(lab.rmem(&["undo", NS]).success(), "{\"changes\":3,\"restored\":3,\"removed\":0}\n");
    assert_eq!(lab.rmem(&["query", NS, "--meta"]).success(), before, "with the metadata it had");
    assert_eq!(lab.rmem(&["undo", NS]).success(), "{\"changes\":3,\"restored\":3,\"removed\":0}\n");
    assert_eq!(lab.rmem(&["count", NS, "{n: 2}"]).success(), "3\n");
    assert_eq!(lab.rmem(&["undo", NS, "--last", "4"]).success(), "{\"changes\":12,\"restored\":0,\"removed\":3}\n");
    assert_eq!(lab.rmem(&["count", NS]).success(), "0\n");
    assert_eq!(history(&lab, &["--by", "undo"]).len(), 9);
}

#[test]
fn undo_brings_back_what_was_deleted_dropped_and_replaced() {
    let lab = lab();
    lab.rmem(&["insert", NS, "{_id: 1}", "{_id: 2}", "{_id: 3}"]).success();
    let before = lab.rmem(&["query", NS, "--sort", "{_id: 1}"]).success();
    let now = || lab.rmem(&["query", NS, "--sort", "{_id: 1}"]).success();
    lab.write("world.json", "{\"robmem.worldmodel\": [{\"_id\": 9}]}");
    for change in [
        &["delete", NS, "{}", "--all"][..],
        &["drop", NS],
        &["restore", "world.json", "--drop"],
        &["aggregate", NS, "[{$match: {_id: 2}}, {$out: 'worldmodel'}]"],
    ] {
        lab.rmem(change).success();
        assert_ne!(now(), before, "{change:?}");
        lab.rmem(&["undo", NS]).success();
        assert_eq!(now(), before, "{change:?}");
    }
}

#[test]
fn undo_that_would_overwrite_later_changes_says_which_and_needs_force() {
    let lab = lab();
    lab.rmem(&["insert", NS, "{_id: 1, n: 1}", "{_id: 2, n: 1}"]).success();
    lab.rmem(&["update", NS, "{_id: 1}", "{$set: {n: 2}}"]).success();
    let position = history(&lab, &["--limit", "1"])[0]["position"].as_str().unwrap().to_owned();
    lab.rmem(&["update", NS, "{_id: 1}", "{$set: {m: 'later'}}"]).success();
    lab.rmem(&["delete", NS, "{_id: 2}"]).success();
    let run = lab.rmem(&["undo", NS, "--change", &position]).exits(5);
    assert!(run.stderr.contains("would overwrite later changes"), "{run}");
    assert!(run.stderr.contains("1: update by rmem update at "), "{run}");
    assert_eq!(run.stderr.matches("position").count(), 1, "the other document is not concerned: {run}");
    assert_eq!(lab.rmem(&["query", NS, "{_id: 1}"]).success(), "{\"_id\":1,\"n\":2,\"m\":\"later\"}\n");
    lab.rmem(&["undo", NS, "--change", &position, "--force"]).success();
    assert_eq!(lab.rmem(&["query", NS, "{_id: 1}"]).success(), "{\"_id\":1,\"n\":1}\n");
    // Another process may have taken it back meanwhile.
    assert_run!(lab.rmem(&["undo", NS, "--change", &position]), @r#"
    {"changes":1,"restored":0,"removed":0}
    ------- stderr -------
    error: the documents of robmem.worldmodel are already what they were before this change; nothing was done
    [exit code: 1]
    "#);
    let none = lab.rmem(&["undo", NS, "{_id: 77}"]).exits(1);
    assert!(none.stderr.contains("no change of robmem.worldmodel is to be taken back"), "{none}");
    let count = history(&lab, &[]).len();
    let unknown = lab.rmem(&["undo", NS, "--change", "abc", "--change", &position]).exits(2);
    assert!(unknown.stderr.contains("has no change at the position abc; rmem history robmem"), "{unknown}");
    assert_eq!(history(&lab, &[]).len(), count, "nothing was done");
    let wrong = lab.rmem(&["undo", NS, "{_id: }"]).exits(3);
    assert!(wrong.stderr.contains("<query>:1:7"), "{wrong}");
}

#[test]
fn a_query_at_a_time_answers_as_it_would_have_answered() {
    let lab = lab();
    lab.rmem(&["insert", NS, "{_id: 1, at: 'A'}", "{_id: 2, at: 'B'}", "{_id: 3, at: 'C'}"]).success();
    lab.rmem(&["insert", "robmem.rooms", "{_id: 'A', floor: 1}"]).success();
    let (time, before) = (last_time(&lab), lab.rmem(&["query", NS]).success());
    tick();
    lab.rmem(&["update", NS, "{_id: 2}", "{$set: {at: 'D'}}"]).success();
    lab.rmem(&["delete", NS, "{_id: 1}"]).success();
    lab.rmem(&["insert", NS, "{_id: 4}"]).success();
    lab.rmem(&["drop", "robmem.rooms"]).success();
    let at = |args: &[&str]| lab.rmem(&[args, &["--at", &time]].concat()).success();
    assert_eq!(at(&["query", NS]), before, "in the same order");
    assert_eq!(at(&["query", NS, "{at: 'B'}", "--fields", "{_id: 1}"]), "{\"_id\":2}\n");
    assert_eq!(at(&["count", NS]), "3\n");
    let world = at(&["dump", "--all"]);
    assert!(
        world.contains("robmem.worldmodel") && world.contains("\"at\":\"A\"") && !world.contains("\"D\""),
        "{world}"
    );
    let old = lab.rmem(&["query", NS, "{at: 'B'}", "--at", "1h"]).exits(2);
    assert!(old.stderr.starts_with("error: robmem.worldmodel: the history begins at 2"), "{old}");
    let wrong = lab.rmem(&["query", NS, "--at", "tomorrow"]).exits(2);
    assert!(wrong.stderr.contains("expected 14:03:20 (UTC)"), "{wrong}");
    assert!(lab.rmem(&["query", NS, "--at", "2999-01-01"]).exits(2).stderr.contains("in the future"));
}

#[test]
fn a_problem_and_a_plan_are_made_again_as_they_were() {
    let lab = lab();
    let task: Vec<&str> = TASK.iter().copied().filter(|word| *word != "--load" && !word.ends_with(".json")).collect();
    lab.rmem(&["restore", "fixtures/blocksworld.json"]).success();
    let problem: Vec<&str> = [&["gen-problem"], &task[..]].concat();
    let before = lab.rmem(&problem).success();
    let plan = lab.rmem(&[&["plan"], &task[..]].concat()).success();
    let ns = lab.rmem(&["collections"]).success();
    let ns = ns.lines().find(|name| !name.contains("plans")).unwrap().to_owned();
    let all = lines(&lab.rmem(&["history", &ns]).success());
    let time = all.last().unwrap()["time"]["$date"].as_str().unwrap();
    tick();
    lab.rmem(&["delete", &ns, "{relation: 'clear', object: 'C'}"]).success();
    assert_ne!(lab.rmem(&problem).success(), before);
    assert_eq!(lab.rmem(&[&problem[..], &["--at", time]].concat()).success(), before);
    assert_eq!(lab.rmem(&["plan", "rerun", "last", "--at", time]).success(), plan);
}

#[test]
fn computables_answer_for_the_memory_as_it_was_and_are_not_in_the_history() {
    let lab = with_settings(
        "keep_history = '1h'\n[[computable]]\nname = 'low'\ncollection = 'robmem.worldmodel'\nspec = \"{low: true}\"\n\
         pipeline = \"[{$match: {z: {$lt: 1}}}, {$project: {_id: 0, low: {$literal: true}, of: '$name'}}]\"\n",
    );
    lab.rmem(&["insert", NS, "{_id: 1, name: 'A', z: 0}", "{_id: 2, name: 'B', z: 5}"]).success();
    let time = last_time(&lab);
    tick();
    lab.rmem(&["update", NS, "{_id: 2}", "{$set: {z: 0}}"]).success();
    let of = |more: &[&str]| lab.rmem(&[&["count", NS, "{low: true}"], more].concat()).success();
    assert_eq!([of(&[]), of(&["--at", &time])], ["2\n", "1\n"]);
    assert_eq!(history(&lab, &[]).len(), 3);
}

#[test]
fn a_history_is_bounded_by_its_size() {
    let lab = with_settings("keep_history = '24h'\nhistory_size = '200K'\n");
    lab.rmem(&["insert", NS, "{_id: 1, pad: ''}"]).success();
    let first = last_time(&lab);
    for _ in 0..30 {
        let update = format!("{{$set: {{pad: '{}'}}, $inc: {{n: 1}}}}", "x".repeat(10_000));
        lab.rmem(&["update", NS, "{_id: 1}", &update]).success();
    }
    let kept = history(&lab, &[]).len();
    assert!((5..15).contains(&kept), "{kept}");
    let run = lab.rmem(&["query", NS, "--at", &first]).exits(2);
    assert!(run.stderr.contains("robmem.worldmodel: the history begins at"), "{run}");
    // A collection that is too large to be kept is dropped all the same.
    let big = format!("{{_id: 2, pad: '{}'}}", "x".repeat(300_000));
    lab.rmem_with(&["insert", NS, "--file", "-"], &big).success();
    let time = last_time(&lab);
    tick();
    lab.rmem(&["drop", NS]).success();
    assert!(lab.rmem(&["query", NS, "--at", &time]).exits(2).stderr.contains("is not known"));
}

#[test]
fn a_run_whose_oldest_changes_are_not_kept_is_taken_back_only_where_that_is_asked_for() {
    let lab = with_settings("keep_history = '24h'\nhistory_size = '1M'\n");
    let documents: String = (0..8_000).map(|id| format!("{{_id: {id}, n: 0}}\n")).collect();
    lab.rmem_with(&["insert", NS, "--file", "-"], &documents).success();
    lab.rmem(&["insert", "robmem.other", "{_id: 1}"]).success();
    lab.rmem(&["update", NS, "{}", "{$set: {n: 1}}", "--many"]).success();
    let refused = lab.rmem(&["undo", NS]).exits(1);
    assert_eq!(refused.stdout, "{\"changes\":0,\"restored\":0,\"removed\":0}\n");
    assert!(refused.stderr.contains("error: of the run of rmem update that ended at "), "{refused}");
    assert!(refused.stderr.contains("the older ones are not any more"), "{refused}");
    assert_eq!(lab.rmem(&["count", NS, "{n: 1}"]).success(), "8000\n");
    // A run that is kept as a whole is taken back, whatever was removed before it.
    lab.rmem(&["update", NS, "{_id: {$lt: 100}}", "{$set: {n: 2}}", "--many"]).success();
    assert!(lab.rmem(&["undo", NS, "--last", "2"]).exits(1).stderr.contains("--partial"));
    assert_eq!(lab.rmem(&["undo", NS]).success(), "{\"changes\":100,\"restored\":100,\"removed\":0}\n");
    // Removals that follow cut another run, and the first one more.
    for n in 3..30 {
        let update = format!("{{$set: {{n: {n}}}}}");
        lab.rmem(&["update", NS, "{_id: {$lt: 200}}", &update, "--many"]).success();
    }
    assert_eq!(lab.rmem(&["undo", NS, "--last", "5", "--dry-run"]).success().lines().count(), 201);
    let by = ["undo", NS, "--by", "rmem update"];
    assert!(lab.rmem(&by).exits(1).stderr.contains("--partial"));
    let kept = history(&lab, &[]).len();
    let run = lab.rmem(&[&by[..], &["--partial"]].concat()).success();
    assert!((1_000..6_000).contains(&kept) && run.starts_with("{\"changes\":"), "{kept} {run}");
    assert_eq!(lab.rmem(&["undo", "robmem.other"]).exits(1).stdout, "{\"changes\":0,\"restored\":0,\"removed\":0}\n");
}

#[test]
fn a_clock_that_was_ahead_hides_the_history_no_longer_than_until_the_next_change() {
    let lab = lab();
    lab.rmem(&["insert", NS, "{_id: 1, n: 1}"]).success();
    // As if the clock had said 2300 until now.
    let ahead = "UPDATE histories SET since = 10413792000000; UPDATE changes SET time = 10413792000000";
    crate::repair::sql(&lab, "robot.rmem", ahead);
    let run = lab.rmem(&["query", NS, "--at", "0s"]).exits(2);
    assert!(run.stderr.contains("the history begins at 2300-01-01 00:00:00 UTC"), "{run}");
    assert!(run.stderr.contains("by a clock that was set back since"), "{run}");
    lab.rmem(&["update", NS, "{}", "{$set: {n: 2}}"]).success();
    let first = last_time(&lab);
    tick();
    lab.rmem(&["update", NS, "{}", "{$set: {n: 3}}"]).success();
    assert_eq!(lab.rmem(&["query", NS, "--at", &first]).success(), "{\"_id\":1,\"n\":2}\n");
    let run = lab.rmem(&["query", NS, "--at", "2026-01-01T00:00:00Z"]).exits(2);
    assert!(run.stderr.contains("the history begins at") && !run.stderr.contains("2300"), "{run}");
}

#[test]
fn record_is_for_servers() {
    let lab = lab();
    lab.rmem(&["insert", NS, "{_id: 1}"]).success();
    let run = lab.rmem(&["record", NS]).exits(2);
    assert!(run.stderr.contains("where keep_history says so, every write to a file keeps its history itself"), "{run}");
}

#[test]
fn a_history_for_one_database_or_collection_takes_over_what_was_kept_for_all() {
    let lab = lab();
    lab.rmem(&["insert", NS, "{_id: 1}", "{_id: 2}"]).success();
    for scope in ["robmem", "robmem.worldmodel"] {
        lab.write("rmem.toml", &format!("memory = 'file:robot.rmem'\n[keep_history]\n'{scope}' = '24h'\n"));
        lab.rmem(&["insert", "robmem.other", "{}"]).success();
        assert_eq!(history(&lab, &[]).len(), 2, "{scope}");
    }
    lab.rmem(&["undo", NS]).success();
    assert_eq!(lab.rmem(&["count", NS]).success(), "0\n");
}

#[test]
fn a_history_that_does_not_reach_back_says_when_it_begins() {
    let lab = lab();
    lab.rmem(&["insert", NS, "{_id: 1}"]).success();
    let early = lab.rmem(&["query", NS, "--at", "2001-02-03T04:05:06Z"]).exits(2).stderr;
    assert!(
        early.contains("the history begins at 20") && early.contains("what was there at 2001-02-03 04:05:06 is"),
        "{early}"
    );
    // What was not typed is not pointed at.
    let none = with_settings("").rmem(&["history", NS]).exits(2).stderr;
    assert!(!none.contains("{}"), "{none}");
}

#[test]
fn a_table_of_changes_is_one_list_in_order_of_time() {
    let lab = lab();
    lab.rmem(&["insert", NS, "{_id: 1, at: 'A'}"]).success();
    lab.rmem(&["update", NS, "{_id: 1}", "{$set: {at: 'C'}}"]).success();
    lab.rmem(&["insert", NS, "{_id: 2, at: 'B'}"]).success();
    lab.rmem(&["delete", NS, "{_id: 1}"]).success();
    let table = lab.rmem(&["history", NS, "--format", "table"]).success();
    let operations: Vec<&str> = table.lines().skip(1).map(|line| line.split_whitespace().nth(4).unwrap()).collect();
    assert_eq!(operations, ["insert", "update", "insert", "delete"], "{table}");
}

#[test]
fn a_collection_that_undo_brings_back_has_its_collation_and_its_history_is_asked_by_it() {
    let lab = lab();
    let collation = "{locale: 'en', strength: 2}";
    lab.rmem(&["create", NS, "--collation", collation]).success();
    lab.rmem(&["insert", NS, "{_id: 'Cup', at: 'A'}"]).success();
    let asked = |filter| lab.rmem(&["history", NS, filter]).success().lines().count();
    assert_eq!([asked("{_id: 'cup'}"), asked("{at: 'a'}"), asked("{at: 'b'}")], [1, 1, 0]);
    lab.rmem(&["drop", NS]).success();
    lab.rmem(&["undo", NS]).success();
    assert_eq!(lab.rmem(&["count", NS, "{_id: 'CUP', at: 'a'}"]).success(), "1\n");
    // One without a collation comes back without.
    lab.rmem(&["drop", NS]).success();
    lab.rmem(&["insert", NS, "{_id: 'Jar', at: 'A'}"]).success();
    lab.rmem(&["drop", NS]).success();
    lab.rmem(&["undo", NS]).success();
    assert_eq!(lab.rmem(&["count", NS, "{at: 'a'}"]).success(), "0\n");
    assert_eq!(lab.rmem(&["count", NS, "{at: 'A'}"]).success(), "1\n");
}

#[test]
fn undo_names_the_collection_that_was_probably_meant() {
    let lab = Lab::new().env("RMEM_MEMORY", "file:m.rmem");
    lab.write("rmem.toml", "keep_history = '24h'\n");
    lab.rmem(&["insert", "-q", "lager.welt", "{_id: 1}"]).success();
    let run = lab.rmem(&["undo", "lager.wlet"]).exits(1);
    assert!(run.stderr.contains("no collection lager.wlet; did you mean lager.welt?"), "{run}");
}

/// Changes a letter of the document that the second change replaced.
const DAMAGE: &str = "UPDATE changes SET before = CAST(substr(before, 1, 21) || x'42' || substr(before, 23) AS BLOB) \
     WHERE sequence = 2";

#[test]
fn a_damaged_document_in_the_log_is_found_and_never_written_back() {
    let lab = lab();
    lab.rmem(&["insert", NS, "{_id: 1, at: 'A'}"]).success();
    lab.rmem(&["update", NS, "{_id: 1}", "{$set: {at: 'C'}}"]).success();
    crate::repair::sql(&lab, "robot.rmem", DAMAGE);
    for args in [&["history", NS][..], &["undo", NS]] {
        let run = lab.rmem(args).exits(4);
        let expected =
            "a change of the document with _id 1 of robmem.worldmodel in the log is damaged: its checksum is wrong";
        assert!(run.stderr.contains(expected), "{run}");
    }
    assert_eq!(lab.rmem(&["query", NS]).success(), "{\"_id\":1,\"at\":\"C\"}\n");
    let found = lab.rmem(&["doctor", "--deep"]).exits(4).stdout;
    let expected = "damage     the change 2 in the log is damaged: the document with _id 1: its checksum is wrong\n";
    assert!(found.contains(expected), "{found}");
}

#[test]
fn a_log_without_checksums_is_read() {
    let lab = lab();
    lab.rmem(&["insert", NS, "{_id: 1, at: 'A'}"]).success();
    lab.rmem(&["update", NS, "{_id: 1}", "{$set: {at: 'C'}}"]).success();
    let all = history(&lab, &[]);
    // As an earlier rmem stored the documents: without the checksum of 8 bytes.
    let earlier = "UPDATE changes SET before = substr(before, 1, length(before) - 8), after = substr(after, 1, length(after) - 8)";
    crate::repair::sql(&lab, "robot.rmem", earlier);
    assert_eq!(history(&lab, &[]), all);
    lab.rmem(&["doctor", "--deep"]).success();
    lab.rmem(&["undo", NS]).success();
    assert_eq!(lab.rmem(&["query", NS]).success(), "{\"_id\":1,\"at\":\"A\"}\n");
}

#[test]
fn a_repair_says_that_the_log_is_damaged_and_saves_what_comes_behind() {
    let lab = lab();
    lab.rmem(&["insert", NS, "{_id: 1, at: 'A'}"]).success();
    lab.rmem(&["update", NS, "{_id: 1}", "{$set: {at: 'C'}}"]).success();
    lab.rmem(&["update", NS, "{_id: 1}", "{$set: {at: 'D'}}"]).success();
    crate::repair::sql(&lab, "robot.rmem", DAMAGE);
    let refused = lab.rmem(&["repair"]).exits(4);
    assert!(refused.stderr.contains("the change 2 in the log is damaged: the document with _id 1"), "{refused}");
    let saved = lab.rmem(&["repair", "-o", "saved.rmem"]).exits(1).stdout;
    let lost =
        "lost: the changes up to 2 in the log, which is damaged: the document with _id 1: its checksum is wrong\n";
    assert!(saved.ends_with(lost), "{saved}");
    let of_saved = |args: &[&str]| lab.rmem(&[&["--memory", "file:saved.rmem"], args].concat());
    of_saved(&["doctor", "--deep"]).success();
    let kept = lines(&of_saved(&["history", NS]).success());
    assert_eq!(kept.iter().map(|entry| &entry["before"]["at"]).collect::<Vec<_>>(), ["C"]);
    let run = of_saved(&["query", NS, "--at", "2026-01-01T00:00:00Z"]).exits(2);
    assert!(run.stderr.contains("the history begins at"), "{run}");
}
