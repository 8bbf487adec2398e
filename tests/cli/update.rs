//! update and delete of one document or many; replacement.

use std::process::{Command, Stdio};

use rustix::process::{Pid, Signal};

use crate::lab::watch::until;
use crate::lab::{Lab, assert_run, rmem, three_documents};

#[test]
fn update_changes_the_first_match_or_all() {
    let lab = three_documents();
    let update = |more: &[&str]| {
        let mut args = vec!["update", "robmem.worldmodel", "{relation: 'on-table'}", "{$inc: {n: 1}}"];
        args.extend(more);
        lab.rmem(&args).success()
    };
    assert_eq!(update(&[]), "{\"matched\":1,\"modified\":1}\n");
    assert_eq!(update(&["--many"]), "{\"matched\":2,\"modified\":2}\n");
    let text = lab.rmem(&["update", "robmem.worldmodel", "{_id: 9}", "{$set: {a: 1}}", "--upsert"]).success();
    assert_eq!(text, "{\"matched\":0,\"modified\":0,\"upserted\":9}\n");
    let text = lab.rmem(&["update", "robmem.worldmodel", "{_id: 9}", "[{$set: {b: {$add: ['$a', 1]}}}]"]).success();
    assert_eq!(text, "{\"matched\":1,\"modified\":1}\n");
}

#[test]
fn update_and_delete_change_one_document_and_say_how_many_more_match() {
    let lab = three_documents();
    let update = ["update", "robmem.worldmodel", "{relation: 'on-table'}", "{$set: {seen: true}}"];
    assert_run!(lab.rmem(&update), @r#"
    {"matched":1,"modified":1}
    ------- stderr -------
    1 of 2 matching documents; use --many for all
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&[&update[..], &["--many"]].concat()), @r#"
    {"matched":2,"modified":1}
    ------- stderr -------
    [exit code: 0]
    "#);
    let delete = ["delete", "robmem.worldmodel", "{relation: 'on-table'}"];
    assert_run!(lab.rmem(&delete), @r"
    1
    ------- stderr -------
    1 of 2 matching documents; use --many for all
    [exit code: 0]
    ");
    assert_run!(lab.rmem(&delete), @r#"
    1
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&["delete", "robmem.worldmodel"]), @r#"
    ------- stderr -------
    error: an empty query matches every document of robmem.worldmodel; expected a query, or --all
    [exit code: 2]
    "#);
    assert_run!(lab.rmem(&["delete", "robmem.worldmodel", "--all"]), @r#"
    1
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&["count", "robmem.worldmodel"]), @r#"
    0
    ------- stderr -------
    [exit code: 0]
    "#);
}

#[test]
fn a_change_that_fails_at_a_document_keeps_those_before_and_says_how_many() {
    let lab = three_documents();
    lab.rmem(&["update", "robmem.worldmodel", "{_id: 3}", "{$set: {n: 'many'}}"]).success();
    assert_run!(lab.rmem(&["update", "robmem.worldmodel", "{}", "{$inc: {n: 1}}", "--many"]), @r#"
    ------- stderr -------
    error: failed after 2 documents; what was done stays
      caused by: <update>:1:2: cannot apply $inc to a value of non-numeric type: "many", in the field `n`
      |
    1 | {$inc: {n: 1}}
      |  ^^^^
    [exit code: 3]
    "#);
    assert_run!(lab.rmem(&["query", "robmem.worldmodel", "--fields", "{n: 1}"]), @r#"
    {"_id":1,"n":4}
    {"_id":2,"n":5}
    {"_id":3,"n":"many"}
    ------- stderr -------
    [exit code: 0]
    "#);
    // The query fails at it, too.
    assert_run!(lab.rmem(&["delete", "robmem.worldmodel", "{$expr: {$gte: [{$add: ['$n', 1]}, 0]}}", "--many"]), @r#"
    ------- stderr -------
    error: failed after 2 documents; what was done stays
      caused by: <query>:1:18: $add only supports numeric types, not string
      |
    1 | {$expr: {$gte: [{$add: ['$n', 1]}, 0]}}
      |                  ^^^^
    [exit code: 3]
    "#);
    assert_run!(lab.rmem(&["count", "robmem.worldmodel"]), @r#"
    1
    ------- stderr -------
    [exit code: 0]
    "#);
}

#[test]
fn a_whole_document_replaces_another_only_with_replace() {
    let lab = three_documents();
    let update = ["update", "robmem.worldmodel", "{_id: 1}", "{object: 'Z'}"];
    assert_run!(lab.rmem(&update), @r#"
    ------- stderr -------
    error: <update>:1:1: expected update operators, found a whole document
      |
    1 | {object: 'Z'}
      | ^^^^^^^^^^^^^
      = hint: write {$set: {…}} to change fields, or --replace to replace the document as a whole
    [exit code: 3]
    "#);
    assert_run!(lab.rmem(&[&update[..], &["--replace"]].concat()), @r#"
    {"matched":1,"modified":1}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&["query", "robmem.worldmodel", "{_id: 1}"]), @r#"
    {"_id":1,"object":"Z"}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&["update", "robmem.worldmodel", "{_id: 1}", "{$set: {a: 1}}", "--replace"]), @r#"
    ------- stderr -------
    error: <update>:1:1: expected a whole document for --replace
      |
    1 | {$set: {a: 1}}
      | ^^^^^^^^^^^^^^
      = hint: leave --replace out for operators and pipelines
    [exit code: 3]
    "#);
}

#[test]
fn an_interrupted_change_of_many_documents_says_how_many_were_changed() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    lab.write("many.jsonl", &(0..20_000).map(|n| format!("{{\"_id\": {n}}}\n")).collect::<String>());
    lab.rmem(&["insert", "a.b", "--file", "many.jsonl"]).success();
    // It takes its time over each document, so that all of them would take long.
    let slowly = "{$where: 'for (let n = 0; n < 100000; n++); return true'}";
    let count = |query: &str| lab.rmem(&["count", "a.b", query]).success().trim().parse::<u64>().unwrap();
    let interrupted = |command: &[&str], has_begun: &dyn Fn() -> bool| {
        let mut running = Command::new(rmem());
        lab.isolate(running.args(command).stdout(Stdio::null()).stderr(Stdio::piped()));
        let running = running.spawn().unwrap();
        until("a part of the documents is changed", has_begun);
        rustix::process::kill_process(Pid::from_child(&running), Signal::INT).unwrap();
        let output = running.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(130), "{output:?}");
        String::from_utf8(output.stderr).unwrap()
    };
    let said = |changed: u64| format!("error: interrupted after {changed} documents; what was done stays\n");
    let updated = interrupted(&["update", "a.b", slowly, "{$set: {n: 1}}", "--many"], &|| count("{n: 1}") > 0);
    assert_eq!(updated, said(count("{n: 1}")));
    let deleted = interrupted(&["delete", "a.b", slowly, "--many"], &|| count("{}") < 20_000);
    assert_eq!(deleted, said(20_000 - count("{}")));
}
