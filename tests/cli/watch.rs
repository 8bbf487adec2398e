//! watch: triggers on the embedded store.

use std::io::Read as _;
use std::process::Command;
use std::time::{Duration, Instant};

use rmem::store::{Embedded, Namespace, Store as _};

use crate::lab::watch::{TIMEOUT, Watch};
use crate::lab::{Lab, assert_run};

/// Starts `rmem watch` and waits until it is ready.
#[track_caller]
fn start(lab: &Lab, args: &[&str]) -> Watch {
    Watch::rmem(lab, &[&["watch"], args].concat(), "watching ")
}

fn count(lab: &Lab, sql: &str) -> i64 {
    let file = lab.path().join("home/.local/share/rmem/memory.rmem");
    rusqlite::Connection::open(file).unwrap().query_row(sql, [], |row| row.get(0)).unwrap()
}

#[test]
fn every_change_is_delivered_in_order_with_what_was_before_and_after() {
    let lab = Lab::new();
    let watch = start(&lab, &["a.b"]);
    lab.rmem(&["insert", "a.b", "{_id: 1, n: 1}", "{_id: 2, n: 1}"]).success();
    lab.rmem(&["insert", "a.other", "{_id: 1}"]).success();
    lab.rmem(&["update", "a.b", "{}", "{$inc: {n: 1}}", "--many"]).success();
    lab.rmem(&["update", "a.b", "{_id: 1}", "{m: 1}", "--replace"]).success();
    lab.rmem(&["update", "a.b", "{_id: 1}", "{m: 1}", "--replace"]).success();
    lab.rmem(&["update", "a.b", "{_id: 3}", "{$set: {n: 7}}", "--upsert"]).success();
    lab.rmem(&["delete", "a.b", "{_id: 2}"]).success();
    lab.rmem(&["drop", "a.b"]).success();
    for expected in [
        r#"{"operation":"insert","ns":"a.b","_id":1,"after":{"_id":1,"n":1}}"#,
        r#"{"operation":"insert","ns":"a.b","_id":2,"after":{"_id":2,"n":1}}"#,
        r#"{"operation":"update","ns":"a.b","_id":1,"before":{"_id":1,"n":1},"after":{"_id":1,"n":2}}"#,
        r#"{"operation":"update","ns":"a.b","_id":2,"before":{"_id":2,"n":1},"after":{"_id":2,"n":2}}"#,
        r#"{"operation":"replace","ns":"a.b","_id":1,"before":{"_id":1,"n":2},"after":{"_id":1,"m":1}}"#,
        r#"{"operation":"insert","ns":"a.b","_id":3,"after":{"_id":3,"n":7}}"#,
        r#"{"operation":"delete","ns":"a.b","_id":2,"before":{"_id":2,"n":2}}"#,
        r#"{"operation":"drop","ns":"a.b"}"#,
    ] {
        assert_eq!(watch.next(), expected);
    }
}

#[test]
fn the_query_is_matched_after_a_change_and_before_a_deletion() {
    let lab = Lab::new();
    lab.rmem(&["insert", "a.b", "{_id: 1, n: 1}", "{_id: 2, n: 5}"]).success();
    let watch = start(&lab, &["a.b", "{n: {$gt: 3}}"]);
    lab.rmem(&["update", "a.b", "{_id: 1}", "{$set: {n: 2}}"]).success();
    lab.rmem(&["update", "a.b", "{_id: 1}", "{$set: {n: 4}}"]).success();
    lab.rmem(&["update", "a.b", "{_id: 1}", "{$set: {n: 0}}"]).success();
    lab.rmem(&["delete", "a.b", "--all"]).success();
    assert!(watch.next().contains(r#""before":{"_id":1,"n":2},"after":{"_id":1,"n":4}"#));
    assert!(watch.next().contains(r#""operation":"delete","ns":"a.b","_id":2"#));
}

#[test]
fn a_command_that_does_not_end_is_stopped_when_the_time_is_over() {
    let lab = Lab::new();
    let watch = start(&lab, &["a.b", "--exec", "sleep 600", "--count", "1", "--timeout", "1500ms"]);
    lab.rmem(&["insert", "a.b", "{_id: 1}"]).success();
    assert_eq!(watch.end().0, 1);
}

#[test]
fn what_takes_a_collections_place_is_delivered() {
    let lab = Lab::new();
    lab.rmem(&["insert", "a.b", "{_id: 1}"]).success();
    lab.rmem(&["dump", "a.b", "-o", "world.json"]).success();
    lab.rmem(&["insert", "a.source", "{_id: 7}", "{_id: 8}"]).success();
    let watch = start(&lab, &["a.b"]);
    lab.rmem(&["restore", "world.json", "--drop"]).success();
    lab.rmem(&["aggregate", "a.source", "[{$match: {_id: 7}}, {$out: 'b'}]"]).success();
    lab.rmem(&["aggregate", "a.source", "[{$set: {m: 1}}, {$merge: 'b'}]"]).success();
    for expected in [
        r#"{"operation":"drop","ns":"a.b"}"#,
        r#"{"operation":"insert","ns":"a.b","_id":1,"after":{"_id":1}}"#,
        r#"{"operation":"drop","ns":"a.b"}"#,
        r#"{"operation":"insert","ns":"a.b","_id":7,"after":{"_id":7}}"#,
        r#"{"operation":"update","ns":"a.b","_id":7,"before":{"_id":7},"after":{"_id":7,"m":1}}"#,
        r#"{"operation":"insert","ns":"a.b","_id":8,"after":{"_id":8,"m":1}}"#,
    ] {
        assert_eq!(watch.next(), expected);
    }
}

#[test]
fn metadata_and_computed_documents_are_shown_when_asked_for() {
    let lab = Lab::new();
    let plain = start(&lab, &["a.b"]);
    let all = start(&lab, &["a.b", "--meta", "--computed"]);
    let info = bson::doc! { "computed": true, "inserted": bson::DateTime::now() };
    let computed = vec![bson::doc! { "_id": 1, "_robmem_info": info }];
    let store = Embedded::open(lab.path().join("home/.local/share/rmem/memory.rmem")).unwrap();
    store.insert(&Namespace::parse("a.b").unwrap(), computed).unwrap();
    lab.rmem(&["insert", "a.b", "{_id: 2}"]).success();
    assert_eq!(plain.next(), r#"{"operation":"insert","ns":"a.b","_id":2,"after":{"_id":2}}"#);
    assert!(all.next().contains(r#""after":{"_id":1,"_robmem_info":{"computed":true,"inserted":"#));
    assert!(all.next().contains(r#""after":{"_id":2,"_robmem_info":{"inserted":"#));
}

#[test]
fn a_named_watch_continues_after_the_last_change_it_handled() {
    let lab = Lab::new();
    lab.rmem(&["insert", "a.b", "{_id: 0}"]).success();
    let named = ["watch", "a.b", "--resume", "x", "--count", "2", "--timeout", "1m"];
    let watch = start(&lab, &named[1..]);
    lab.rmem(&["insert", "a.b", "{_id: 1}", "{_id: 2}", "{_id: 3}"]).success();
    assert!(watch.next().contains(r#""_id":1"#));
    assert!(watch.next().contains(r#""_id":2"#));
    assert_eq!(watch.end(), (0, vec![]));
    lab.rmem(&["insert", "a.b", "{_id: 4}"]).success();
    let resumed = lab.rmem(&named).success();
    let ids: Vec<_> = resumed.lines().map(|line| &line[..42]).collect();
    assert_eq!(ids, [r#"{"operation":"insert","ns":"a.b","_id":3,""#, r#"{"operation":"insert","ns":"a.b","_id":4,""#]);
    lab.rmem(&["watch", "a.b", "--resume", "x", "--timeout", "50ms"]).exits(1);
}

#[test]
fn one_process_at_a_time_has_a_name() {
    let lab = Lab::new();
    let watch = start(&lab, &["a.b", "--resume", "x"]);
    let held = lab.rmem(&["watch", "a.b", "--resume", "x"]).exits(5);
    assert_run!(held.to_string().replace(&watch.child.id().to_string(), "[PID]"), @r"
    ------- stderr -------
    error: process [PID] follows changes by the name `x`; end it first
    [exit code: 5]
    ");
    lab.rmem(&["watch", "a.b", "--resume", "x", "--forget"]).exits(5);
    watch.signal("KILL");
    watch.end();
    lab.rmem(&["watch", "a.b", "--resume", "x", "--timeout", "10ms"]).exits(1);
    assert_run!(lab.rmem(&["watch", "a.c", "--resume", "x", "--timeout", "10ms"]), @r"
    ------- stderr -------
    error: the name `x` follows a.b; use another name
    [exit code: 5]
    ");
    lab.rmem(&["watch", "a.b", "--resume", "x", "--forget"]).success();
    assert_run!(lab.rmem(&["watch", "a.b", "--resume", "x", "--forget"]), @r"
    ------- stderr -------
    error: no watch of a.b has the name `x`; `rmem watch --names` lists those there are
    [exit code: 1]
    ");
    lab.rmem(&["watch", "a.c", "--resume", "x", "--timeout", "10ms"]).exits(1);
}

#[test]
fn a_name_is_free_at_once_when_its_process_was_killed() {
    let lab = Lab::new();
    for _ in 0..10 {
        let watch = start(&lab, &["a.b", "--resume", "x"]);
        watch.signal("KILL");
        lab.rmem(&["watch", "a.b", "--resume", "x", "--timeout", "10ms"]).exits(1);
    }
}

#[test]
fn without_a_watch_no_change_is_kept_and_a_killed_watch_keeps_none() {
    let lab = Lab::new();
    lab.rmem(&["insert", "a.b", "{_id: 1}"]).success();
    assert_eq!(count(&lab, "SELECT count(*) FROM changes"), 0);
    let watch = start(&lab, &["a.b"]);
    lab.rmem(&["insert", "a.b", "{_id: 2}"]).success();
    assert!(watch.next().contains(r#""_id":2"#));
    watch.signal("KILL");
    watch.end();
    lab.rmem(&["insert", "a.b", "{_id: 3}"]).success();
    assert_eq!(count(&lab, "SELECT count(*) FROM changes"), 0);
    assert_eq!(count(&lab, "SELECT count(*) FROM watchers"), 0);
    let watch = start(&lab, &["a.b", "--resume", "x"]);
    lab.rmem(&["insert", "a.b", "{_id: 4}"]).success();
    assert!(watch.next().contains(r#""_id":4"#));
    watch.signal("TERM");
    assert_eq!(watch.end().0, 130);
    assert_eq!(count(&lab, "SELECT count(*) FROM changes"), 0, "what is done is not kept");
    lab.rmem(&["insert", "a.b", "{_id: 5}"]).success();
    assert_eq!(count(&lab, "SELECT count(*) FROM changes"), 1, "what a name has not seen is kept");
}

#[test]
fn names_are_listed_with_what_waits_for_them() {
    let lab = Lab::new();
    assert_eq!(lab.rmem(&["watch", "--names"]).success(), "");
    lab.rmem(&["watch", "a.c", "--resume", "idle", "--timeout", "10ms"]).exits(1);
    let watch = start(&lab, &["a.b", "--resume", "busy"]);
    lab.rmem(&["insert", "a.c", "{_id: 1}", "{_id: 2}"]).success();
    let names = lab.rmem(&["watch", "--names"]).success();
    let (busy, idle) = names.trim_end().split_once('\n').unwrap();
    let process = watch.child.id();
    let expected = format!(r#"{{"name":"busy","ns":"a.b","process":{process},"missed":false,"waiting":0,"bytes":0}}"#);
    assert_eq!(busy, expected);
    assert!(
        idle.starts_with(r#"{"name":"idle","ns":"a.c","process":null,"missed":false,"waiting":2,"bytes":1"#),
        "{idle}"
    );
    lab.rmem(&["watch", "a.c", "--resume", "idle", "--forget"]).success();
    assert_eq!(lab.rmem(&["watch", "--names"]).success().lines().count(), 1);
    lab.rmem(&["watch"]).exits(2);
    lab.rmem(&["watch", "a.b", "--names"]).exits(2);
}

#[test]
fn a_watch_that_missed_changes_is_refused_with_the_way_out() {
    let lab = Lab::new();
    lab.rmem(&["watch", "a.b", "--resume", "x", "--timeout", "10ms"]).exits(1);
    lab.rmem(&["insert", "a.b", "{_id: 1}"]).success();
    let file = lab.path().join("home/.local/share/rmem/memory.rmem");
    rusqlite::Connection::open(file).unwrap().execute("UPDATE watchers SET missed = 1", []).unwrap();
    assert_run!(lab.rmem(&["watch", "a.b", "--resume", "x", "--timeout", "10ms"]), @r"
    ------- stderr -------
    error: file:$LAB/home/.local/share/rmem/memory.rmem: more than 256 MiB of changes were made since `x` followed a.b last, and the oldest of them are gone; read a.b anew, and forget the name with `rmem watch a.b --resume x --forget`
    [exit code: 4]
    ");
    lab.rmem(&["watch", "a.b", "--resume", "x", "--forget"]).success();
    lab.rmem(&["watch", "a.b", "--resume", "x", "--timeout", "10ms"]).exits(1);
}

#[test]
fn a_command_is_run_for_each_change() {
    let lab = Lab::new();
    let line = "cat >> events; echo $RMEM_OPERATION $RMEM_NAMESPACE";
    let watch = start(&lab, &["a.b", "--exec", line, "--count", "2"]);
    lab.rmem(&["insert", "a.b", "{_id: 1}"]).success();
    lab.rmem(&["delete", "a.b", "{_id: 1}"]).success();
    assert_eq!((watch.next().as_str(), watch.next().as_str()), ("insert a.b", "delete a.b"));
    assert_eq!(watch.end(), (0, vec![]));
    let events = lab.read("events");
    let operations: Vec<_> = events.lines().filter_map(|line| line.split(',').next()).collect();
    assert_eq!(operations, [r#"{"operation":"insert""#, r#"{"operation":"delete""#]);
}

#[test]
fn a_change_whose_command_fails_comes_again_under_its_name() {
    let lab = Lab::new();
    let watch = start(&lab, &["a.b", "--exec", "exit 7", "--count", "2"]);
    lab.rmem(&["insert", "a.b", "{_id: 1}", "{_id: 2}"]).success();
    assert_eq!(watch.end().0, 0, "without a name, it goes on");
    let line = "read event; echo $event; test -e allowed || exit 9";
    let named = ["a.b", "--resume", "x", "--exec", line, "--count", "1", "--timeout", "1m"];
    let watch = start(&lab, &named);
    lab.rmem(&["insert", "a.b", "{_id: 3}"]).success();
    let first = watch.next();
    assert_eq!(watch.end().0, 9);
    lab.write("allowed", "");
    let watch = start(&lab, &named);
    assert_eq!(watch.next(), first);
    assert_eq!(watch.end().0, 0);
    lab.rmem(&["watch", "a.b", "--resume", "x", "--timeout", "10ms"]).exits(1);
}

#[test]
fn an_interrupted_command_is_stopped_and_its_change_comes_again() {
    let lab = Lab::new();
    let watch = start(&lab, &["a.b", "--resume", "x", "--exec", "echo begun; sleep 1000"]);
    lab.rmem(&["insert", "a.b", "{_id: 1}"]).success();
    assert_eq!(watch.next(), "begun");
    watch.signal("INT");
    assert_eq!(watch.end().0, 130);
    let again = lab.rmem(&["watch", "a.b", "--resume", "x", "--count", "1"]).success();
    assert!(again.contains(r#""_id":1"#), "{again}");
}

#[test]
fn a_killed_watch_leaves_no_command_behind() {
    let lab = Lab::new();
    let watch = start(&lab, &["a.b", "--exec", "sleep 1000 & echo $$ $!; wait"]);
    lab.rmem(&["insert", "a.b", "{_id: 1}"]).success();
    let line = watch.next();
    watch.signal("KILL");
    watch.end();
    let since = Instant::now();
    for process in line.split(' ') {
        let is_there = || std::fs::read(format!("/proc/{process}/cmdline")).is_ok_and(|line| !line.is_empty());
        while is_there() {
            assert!(since.elapsed() < TIMEOUT, "process {process} of `{line}` does not end");
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

#[test]
fn what_a_command_starts_in_the_background_keeps_running() {
    let lab = Lab::new();
    let line = "(while ! [ -e go ]; do sleep 0.02; done; touch went) > /dev/null 2>&1 &";
    let watch = start(&lab, &["a.b", "--exec", line, "--count", "1"]);
    lab.rmem(&["insert", "a.b", "{_id: 1}"]).success();
    assert_eq!(watch.end(), (0, vec![]));
    lab.write("go", "");
    let since = Instant::now();
    while !lab.path().join("went").exists() {
        assert!(since.elapsed() < TIMEOUT, "it did not live on");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn facts_of_clips_carry_the_change() {
    let lab = Lab::new();
    let watch = start(&lab, &["a.b", "--resume", "orders", "--format", "clips"]);
    lab.rmem(&["insert", "a.b", "{_id: 1, name: 'x'}"]).success();
    let fact = watch.next();
    assert!(fact.starts_with(r#"(robmem-trigger (name "orders") (rcvd-at "#), "{fact}");
    let rest = r#"(operation insert) (namespace "a.b") (id "1") (before "") (after "{\"_id\":1,\"name\":\"x\"}"))"#;
    assert!(fact.ends_with(rest), "{fact}");
    assert_eq!(watch.next(), "(orders)");
}

#[test]
fn a_timeout_without_a_change_is_1() {
    let lab = Lab::new();
    lab.rmem(&["watch", "a.b", "--timeout", "20ms"]).exits(1);
    drop(start(&lab, &["a.b", "--resume", "x"]));
    lab.rmem(&["insert", "a.b", "{_id: 1}"]).success();
    let watch = |timeout| lab.rmem(&["watch", "a.b", "--resume", "x", "--count", "2", "--timeout", timeout]).exits(1);
    // A time may be over before it has begun, on a slow machine.
    let delivered =
        ["500ms", "5s", "1m"].into_iter().map(|timeout| watch(timeout).stdout).find(|text| !text.is_empty());
    assert_eq!(delivered.map(|text| text.lines().count()), Some(1));
}

#[test]
fn a_closed_stdout_ends_it_quietly() {
    let lab = Lab::new();
    let mut command = Command::new("bash");
    command.args(["-o", "pipefail", "-c", "rmem watch a.b | head -n 1"]);
    let mut watch = Watch::run(&lab, command, "watching ");
    while watch.child.try_wait().unwrap().is_none() {
        lab.rmem(&["insert", "a.b", "{}"]).success();
    }
    let mut message = String::new();
    watch.child.stderr.take().unwrap().read_to_string(&mut message).unwrap();
    let (code, lines) = watch.end();
    assert_eq!((code, lines.len(), message.as_str()), (0, 1, ""));
}

#[test]
fn what_cannot_be_watched_is_refused_with_the_reason() {
    let lab = Lab::new();
    let commands = [
        &["watch", "a.b", "--memory", "mem:"][..],
        &["watch", "a.b", "{n: {$nope: 1}}", "--timeout", "10ms"],
        &["watch", "a.b", "--count", "0"],
        &["watch", "a.b", "--forget"],
    ];
    assert_run!(lab.transcript(&commands), @r"
    $ rmem watch a.b --memory mem:
    ------- stderr -------
    error: mem:: no other process can change a memory in this process, so there is nothing to watch; use file:PATH or mongodb://…
    [exit code: 2]
    $ rmem watch a.b '{n: {$nope: 1}}' --timeout 10ms
    ------- stderr -------
    error: <query>:1:6: unknown operator: $nope
      |
    1 | {n: {$nope: 1}}
      |      ^^^^^
    [exit code: 3]
    $ rmem watch a.b --count 0
    ------- stderr -------
    error: invalid value '0' for '--count <N>': expected a whole number from 1 on

    For more information, try '--help'.
    [exit code: 2]
    $ rmem watch a.b --forget
    ------- stderr -------
    error: the following required arguments were not provided:
      --resume <NAME>

    Usage: rmem watch --resume <NAME> --forget <NS> [QUERY]

    For more information, try '--help'.
    [exit code: 2]
    ");
}

#[test]
fn each_trigger_is_logged_with_its_duration() {
    let lab = Lab::new();
    let watch = start(&lab, &["a.b", "--count", "1", "--log", "log"]);
    lab.rmem(&["insert", "a.b", "{_id: 1}"]).success();
    assert_eq!(watch.end().0, 0);
    let log = lab.read("log");
    assert!(log.contains(r#"{"operation":"trigger","subject":"a.b","detail":"insert 1","milliseconds":"#), "{log}");
}

#[test]
fn a_count_is_delivered_when_it_begins_to_meet_the_condition() {
    let lab = Lab::new();
    lab.rmem(&["insert", "a.b", "{_id: 1, open: true}", "{_id: 2, open: true}", "{_id: 3}"]).success();
    let watch = start(&lab, &["a.b", "{open: true}", "--when", "count > 2"]);
    let event = |count: u32| format!(r#"{{"operation":"count","ns":"a.b","count":{count},"when":"count > 2"}}"#);
    lab.rmem(&["insert", "a.b", "{_id: 4, open: true}"]).success();
    assert_eq!(watch.next(), event(3));
}

#[test]
fn a_count_that_meets_the_condition_at_the_start_is_delivered_at_once() {
    let lab = Lab::new();
    lab.rmem(&["insert", "a.b", "{_id: 1}"]).success();
    let run = ["watch", "a.b", "--when", "count == 1", "--count", "1", "--timeout", "1m"];
    assert_run!(lab.rmem(&[&run[..], &["--exec", "cut -d , -f 1-4; echo $RMEM_OPERATION"]].concat()), @r#"
    {"operation":"count","ns":"a.b","count":1,"when":"count == 1"
    count
    ------- stderr -------
    watching a.b
    [exit code: 0]
    "#);
    lab.rmem(&["watch", "a.b", "--when", "count > 1", "--timeout", "1ms"]).exits(1);
    assert_run!(lab.rmem(&["watch", "a.b", "--when", "counts > 1"]), @r#"
    ------- stderr -------
    error: invalid value 'counts > 1' for '--when <CONDITION>': expected a condition on the number of documents, like "count > 3"

    For more information, try '--help'.
    [exit code: 2]
    "#);
    assert_run!(lab.rmem(&["watch", "a.b", "--when", "count > 1", "--format", "clips"]), @r"
    ------- stderr -------
    error: --when has no facts; expected --format jsonl, json or canonical
    [exit code: 2]
    ");
    lab.rmem(&["watch", "a.b", "--when", "count > 1", "--resume", "x"]).exits(2);
}

#[test]
fn a_watch_of_what_is_not_there_yet_names_what_may_be_meant() {
    let lab = Lab::new();
    lab.rmem(&["--memory", "file:robot.rmem", "insert", "robmem.worldmodel", "{_id: 1}"]).success();
    let watch =
        |memory: &str, ns: &str| lab.rmem(&["--memory", memory, "watch", ns, "--timeout", "1ms"]).exits(1).stderr;
    assert_eq!(
        watch("file:robot.rmem", "robmem.worldmodle"),
        "warning: no collection robmem.worldmodle; did you mean robmem.worldmodel?\nwatching robmem.worldmodle\n"
    );
    assert_eq!(watch("file:robot.rmem", "robmem.orders"), "watching robmem.orders\n");
    assert_eq!(
        watch("file:robto.rmem", "robmem.worldmodel"),
        "warning: robto.rmem did not exist yet; did you mean robot.rmem?\nwatching robmem.worldmodel\n"
    );
    assert_eq!(watch("file:robto.rmem", "robmem.worldmodel"), "watching robmem.worldmodel\n");
}

#[test]
fn what_a_computable_gives_is_counted_and_where_changes_of_it_are_not_seen_a_warning() {
    let lab = Lab::new();
    lab.write(
        "rmem.toml",
        "memory = 'file:robot.rmem'\n[[computable]]\nname = 'low'\ncollection = 'a.b'\nspec = '{kind: \"low\"}'\n\
         pipeline = '[{$match: {battery: {$lt: 10}}}, {$project: {_id: 0, kind: \"low\", name: 1}}]'\n",
    );
    lab.rmem(&["insert", "-q", "a.b", "{_id: 1, name: 'r', battery: 5}"]).success();
    let watched = ["watch", "a.b", "{kind: 'low'}"];
    let when = |condition: &str| {
        let more = ["--when", condition, "--count", "1", "--timeout", "1m", "--exec", "cut -d , -f 1-4"];
        lab.rmem(&[&watched[..], &more].concat())
    };
    assert_run!(when("count == 1"), @r#"
    {"operation":"count","ns":"a.b","count":1,"when":"count == 1"
    ------- stderr -------
    watching a.b
    warning: the computable `low` answers this query: --when counts what is computed as well, whenever a.b changes, and only then
    [exit code: 0]
    "#);
    let watch = start(&lab, &["a.b", "{kind: 'low'}", "--when", "count == 0"]);
    lab.rmem(&["update", "-q", "a.b", "{_id: 1}", "{$set: {battery: 50}}"]).success();
    assert!(watch.next().starts_with(r#"{"operation":"count","ns":"a.b","count":0,"#));
    assert_run!(lab.rmem(&[&watched[..], &["--timeout", "1ms"]].concat()), @r"
    ------- stderr -------
    watching a.b
    warning: the computable `low` answers this query: watch delivers changes of stored documents only
    [exit code: 1]
    ");
}
