//! find-and-modify.

use crate::lab::{Lab, assert_run};

fn lab() -> Lab {
    let lab = Lab::new();
    let orders = ["{_id: 1, state: 'open', due: 30}", "{_id: 2, state: 'open', due: 10, parts: [{n: 1}, {n: 2}]}"];
    lab.rmem(&[&["insert", "robmem.orders"], &orders[..]].concat()).success();
    lab
}

#[test]
fn one_document_is_found_changed_and_printed() {
    let lab = lab();
    let taken = "{$set: {state: 'taken', 'parts.$.n': 7}}";
    let take = ["find-and-modify", "robmem.orders", "{state: 'open', 'parts.n': 2}", taken, "--sort", "{due: 1}"];
    assert_run!(lab.rmem(&take), @r#"
    {"_id":2,"state":"open","due":10,"parts":[{"n":1},{"n":2}]}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&take), @r"
    ------- stderr -------
    no document matches
    [exit code: 1]
    ");
    let new = ["find-and-modify", "robmem.orders", "{state: 'taken'}", "{$inc: {due: 1}}", "--new"];
    assert_run!(lab.rmem(&new), @r#"
    {"_id":2,"state":"taken","due":11,"parts":[{"n":1},{"n":7}]}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&["find-and-modify", "robmem.orders", "{}", "--remove", "--sort", "{due: -1}"]), @r#"
    {"_id":1,"state":"open","due":30}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&["query", "robmem.orders"]), @r#"
    {"_id":2,"state":"taken","due":11,"parts":[{"n":1},{"n":7}]}
    ------- stderr -------
    [exit code: 0]
    "#);
}

#[test]
fn a_counter_counts_for_everyone() {
    const ROBOTS: usize = 6;
    const ROUNDS: usize = 5;
    let lab = Lab::new();
    let line = format!(
        "for robot in $(seq {ROBOTS}); do (
           for round in $(seq {ROUNDS}); do
             rmem find-and-modify a.counters \"{{_id: 'n'}}\" '{{$inc: {{n: 1}}}}' --upsert --new || exit 9
           done ) & pids=\"$pids $!\"; done
         for pid in $pids; do wait $pid || exit $?; done"
    );
    let printed = lab.shell(&line).success();
    let mut numbers: Vec<&str> = printed.lines().collect();
    numbers.sort_unstable_by_key(|line| (line.len(), *line));
    let wanted: Vec<String> = (1..=ROBOTS * ROUNDS).map(|n| format!("{{\"_id\":\"n\",\"n\":{n}}}")).collect();
    assert_eq!(numbers, wanted);
}

#[test]
fn what_cannot_be_is_refused_and_changes_nothing() {
    let lab = lab();
    let orders = lab.rmem(&["query", "robmem.orders"]).success();
    let run = |more: &[&str]| lab.rmem(&[&["find-and-modify", "robmem.orders"], more].concat());
    assert_run!(run(&["{}"]), @r"
    ------- stderr -------
    error: the following required arguments were not provided:
      <UPDATE>

      tip: the query stands before the update, '{}' for all documents; --remove needs no update

    Usage: rmem find-and-modify <NS> <QUERY> <UPDATE>

    For more information, try '--help'.
    [exit code: 2]
    ");
    assert_run!(run(&["{}", "{$inc: {state: 1}}"]), @r#"
    ------- stderr -------
    error: <update>:1:2: cannot apply $inc to a value of non-numeric type: "open", in the field `state`
      |
    1 | {$inc: {state: 1}}
      |  ^^^^
    [exit code: 3]
    "#);
    assert_run!(run(&["{}", "{state: 'done'}"]), @r"
    ------- stderr -------
    error: <update>:1:1: expected update operators, found a whole document
      |
    1 | {state: 'done'}
      | ^^^^^^^^^^^^^^^
      = hint: write {$set: {…}} to change fields, or --replace to replace the document as a whole
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["find-and-modify", "robmem.order", "{}", "--remove"]), @r"
    ------- stderr -------
    warning: no collection robmem.order; did you mean robmem.orders?
    [exit code: 1]
    ");
    run(&["{}", "{$set: {a: 1}}", "--remove"]).exits(2);
    assert_eq!(lab.rmem(&["query", "robmem.orders"]).success(), orders);
    assert_run!(run(&["{_id: 1}", "{state: 'done'}", "--replace", "--new"]), @r#"
    {"_id":1,"state":"done"}
    ------- stderr -------
    [exit code: 0]
    "#);
}

#[test]
fn the_document_is_printed_in_every_format_of_documents() {
    let lab = lab();
    let ask = |format: &str| {
        let take = ["find-and-modify", "robmem.orders", "{_id: 1}", "{$set: {due: 30}}", "--format", format];
        lab.rmem(&take).success()
    };
    for (format, printed) in [
        ("jsonl", "{\"_id\":1,\"state\":\"open\",\"due\":30}\n"),
        ("json", "{\n  \"_id\": 1,\n  \"state\": \"open\",\n  \"due\": 30\n}\n"),
        ("canonical", "{\"_id\":{\"$numberInt\":\"1\"},\"state\":\"open\",\"due\":{\"$numberInt\":\"30\"}}\n"),
        ("csv", "_id,state,due\n1,open,30\n"),
        ("tsv", "_id\tstate\tdue\n1\topen\t30\n"),
        ("table", "_id  state  due\n1    open   30\n"),
    ] {
        assert_eq!(ask(format), printed, "{format}");
    }
}
