//! --collation, --let and --hint: how strings compare, variables, and which index is read.
#![cfg(feature = "collation")]

use crate::lab::{Lab, assert_run};

fn boxes() -> Lab {
    let lab = Lab::new();
    lab.rmem(&[
        "insert",
        "-q",
        "robmem.boxes",
        "{_id: 1, name: 'box10', color: 'red', n: 3, tags: ['Big', 'big']}",
        "{_id: 2, name: 'Box9', color: 'Red', n: 4}",
        "{_id: 3, name: 'Öre', color: 'blue', n: 5}",
    ])
    .success();
    lab
}

const IGNORE_CASE: &str = "{locale: 'en', strength: 2}";
const NUMERIC: &str = "{locale: 'en', numericOrdering: true}";

#[test]
fn a_collation_ignores_case_and_orders_numbers() {
    let lab = boxes();
    let query = ["query", "robmem.boxes", "{color: 'RED'}", "--collation", IGNORE_CASE, "--fields", "{name: 1}"];
    assert_run!(lab.rmem(&query), @r#"
    {"_id":1,"name":"box10"}
    {"_id":2,"name":"Box9"}
    ------- stderr -------
    [exit code: 0]
    "#);
    let sorted = ["query", "robmem.boxes", "--sort", "{name: 1}", "--collation", NUMERIC, "--fields", "{name: 1}"];
    assert_run!(lab.rmem(&sorted), @r#"
    {"_id":2,"name":"Box9"}
    {"_id":1,"name":"box10"}
    {"_id":3,"name":"Öre"}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_eq!(lab.rmem(&["count", "robmem.boxes", "{color: 'RED'}", "--collation", IGNORE_CASE]).success(), "2\n");
    let distinct = lab.rmem(&["distinct", "robmem.boxes", "color", "--collation", IGNORE_CASE]).success();
    assert_eq!(distinct, "\"blue\"\n\"red\"\n");
    let groups = "[{$group: {_id: '$color', n: {$sum: 1}}}, {$sort: {_id: 1}}]";
    let groups = lab.rmem(&["aggregate", "robmem.boxes", groups, "--collation", IGNORE_CASE]).success();
    assert_eq!(groups, "{\"_id\":\"blue\",\"n\":1}\n{\"_id\":\"red\",\"n\":2}\n");
}

#[test]
fn updates_and_deletions_compare_by_the_collation() {
    let lab = boxes();
    let update = ["update", "robmem.boxes", "{name: 'BOX10'}", "{$pull: {tags: 'BIG'}, $set: {color: 'RED'}}"];
    assert_run!(lab.rmem(&[&update[..], &["--collation", IGNORE_CASE]].concat()), @r#"
    {"matched":1,"modified":1}
    ------- stderr -------
    [exit code: 0]
    "#);
    let after = lab.rmem(&["query", "robmem.boxes", "{_id: 1}", "--fields", "{color: 1, tags: 1}"]).success();
    assert_eq!(after, "{\"_id\":1,\"color\":\"RED\",\"tags\":[]}\n");
    let delete = ["delete", "robmem.boxes", "{color: 'red'}", "--many", "--collation", IGNORE_CASE];
    assert_eq!(lab.rmem(&delete).success(), "2\n");
}

#[test]
fn an_index_has_a_collation_and_serves_only_queries_with_it() {
    let lab = boxes();
    let index = ["index", "robmem.boxes", "{name: 1}", "--unique", "--collation", IGNORE_CASE];
    assert_eq!(lab.rmem(&index).success(), "name_1\n");
    assert_run!(lab.rmem(&["insert", "robmem.boxes", "{name: 'BOX9'}"]), @r#"
    ------- stderr -------
    error: robmem.boxes already has a document with name: "BOX9" (unique index name_1): that with _id 2
    [exit code: 5]
    "#);
    let explain = |more: &[&str]| {
        let text = lab.rmem(&[&["query", "robmem.boxes", "{name: 'BOX9'}", "--explain"], more].concat()).success();
        serde_json::from_str::<serde_json::Value>(&text).unwrap()
    };
    let with = explain(&["--collation", IGNORE_CASE]);
    assert_eq!((with["index"].as_str(), with["returned"].as_i64()), (Some("name_1"), Some(1)));
    let without = explain(&[]);
    assert_eq!((without["index"].as_str(), without["returned"].as_i64()), (None, Some(0)));
}

#[test]
fn what_is_no_collation_is_shown() {
    let lab = boxes();
    assert_run!(lab.rmem(&["query", "robmem.boxes", "--collation", "{locale: 'xx'}"]), @r#"
    ------- stderr -------
    error: <collation>:1:1: the `locale` "xx" of a collation is none of MongoDB's; one is 'en', and 'simple' compares bytes
      |
    1 | {locale: 'xx'}
      | ^^^^^^^^^^^^^^
    [exit code: 3]
    "#);
}

#[test]
fn variables_are_used_by_expressions() {
    let lab = boxes();
    let query = ["query", "robmem.boxes", "{$expr: {$gt: ['$n', '$$least']}}", "--let", "{least: {$add: [2, 2]}}"];
    assert_run!(lab.rmem(&[&query[..], &["--fields", "{n: 1, over: {$subtract: ['$n', '$$least']}}"]].concat()), @r#"
    {"_id":3,"n":5,"over":1}
    ------- stderr -------
    [exit code: 0]
    "#);
    let update = ["update", "robmem.boxes", "{_id: 1}", "[{$set: {n: '$$new'}}]", "--let", "{new: 7}"];
    lab.rmem(&update).success();
    assert_eq!(
        lab.rmem(&["count", "robmem.boxes", "{$expr: {$eq: ['$n', '$$n']}}", "--let", "{n: 7}"]).success(),
        "1\n"
    );
    assert_run!(lab.rmem(&["count", "robmem.boxes", "--let", "{n: '$n'}"]), @r"
    ------- stderr -------
    error: <let>:1:1: the variable n of `let` depends on a document; it is computed before any is read
      |
    1 | {n: '$n'}
      | ^^^^^^^^^
    [exit code: 3]
    ");
}

#[test]
fn a_hint_chooses_the_index() {
    let lab = boxes();
    lab.rmem(&["index", "robmem.boxes", "{n: -1}"]).success();
    lab.rmem(&["index", "robmem.boxes", "{tags: 1}", "--sparse"]).success();
    let ids = |hint: &str| lab.rmem(&["query", "robmem.boxes", "--fields", "{_id: 1}", "--hint", hint]).success();
    assert_eq!(ids("n_-1"), "{\"_id\":3}\n{\"_id\":2}\n{\"_id\":1}\n");
    assert_eq!(ids("{tags: 1}"), "{\"_id\":1}\n", "a sparse index does not have the other documents");
    assert_eq!(ids("{$natural: -1}"), "{\"_id\":3}\n{\"_id\":2}\n{\"_id\":1}\n");
    assert_run!(lab.rmem(&["query", "robmem.boxes", "--hint", "nothing"]), @r"
    ------- stderr -------
    error: <hint>:1:1: the hint names no index that queries use: `rmem index NS` lists the indexes
      |
    1 | nothing
      | ^^^^^^^
    [exit code: 3]
    ");
    // Also where the query has the same word, and where others that match are counted first.
    let update = ["update", "robmem.boxes", "{nothing: {$exists: false}}", "{$set: {a: 1}}", "--hint", "nothing"];
    assert_run!(lab.rmem(&update), @r"
    ------- stderr -------
    error: <hint>:1:1: the hint names no index that queries use: `rmem index NS` lists the indexes
      |
    1 | nothing
      | ^^^^^^^
    [exit code: 3]
    ");
}

#[test]
fn a_collection_has_a_collation_that_dumps_carry() {
    let lab = Lab::new();
    let create = ["create", "robmem.boxes", "--collation", IGNORE_CASE];
    lab.rmem(&create).success();
    assert_run!(lab.rmem(&create), @r"
    ------- stderr -------
    robmem.boxes exists already
    [exit code: 0]
    ");
    assert_run!(lab.rmem(&["create", "robmem.boxes"]), @r"
    ------- stderr -------
    warning: robmem.boxes exists with another collation, which cannot be changed; drop it first
    [exit code: 1]
    ");
    assert_run!(lab.rmem(&["collections", "--options"]), @r#"
    robmem.boxes {"collation":{"locale":"en","caseLevel":false,"caseFirst":"off","strength":2,"numericOrdering":false,"alternate":"non-ignorable","maxVariable":"punct","normalization":false,"backwards":false}}
    ------- stderr -------
    [exit code: 0]
    "#);
    lab.rmem(&["insert", "-q", "robmem.boxes", "{_id: 'a', name: 'Box'}", "{_id: 'b', name: 'cup'}"]).success();
    lab.rmem(&["index", "robmem.boxes", "{name: 1}"]).success();
    lab.rmem(&["index", "robmem.boxes", "{name: -1}", "--collation", "{locale: 'simple'}"]).success();
    assert_run!(lab.rmem(&["insert", "robmem.boxes", "{_id: 'A'}"]), @r#"
    ------- stderr -------
    error: robmem.boxes already has a document with _id: "A"
    [exit code: 5]
    "#);
    lab.rmem(&["dump", "robmem.boxes", "-o", "dump"]).success();
    lab.rmem(&["dump", "robmem.boxes", "-o", "boxes.json"]).success();
    let indexes = lab.rmem(&["index", "robmem.boxes"]).success();
    let check = |label: &str| {
        assert_eq!(lab.rmem(&["index", "robmem.boxes"]).success(), indexes, "{label}");
        assert_eq!(lab.rmem(&["count", "robmem.boxes", "{_id: 'A', name: 'BOX'}"]).success(), "1\n", "{label}");
        let simple = ["count", "robmem.boxes", "{name: 'BOX'}", "--collation", "{locale: 'simple'}"];
        assert_eq!(lab.rmem(&simple).success(), "0\n", "{label}");
    };
    for restore in [&["restore", "dump"][..], &["restore", "dump", "--drop"], &["restore", "boxes.json", "--drop"]] {
        lab.rmem(restore).success();
        check("over what is there");
    }
    for restore in [&["restore", "dump"][..], &["restore", "dump", "--drop"]] {
        lab.rmem(&["drop", "robmem.boxes"]).success();
        lab.rmem(&[restore, &["--dry-run"]].concat()).success();
        lab.rmem(restore).success();
        check("into nothing");
    }
    lab.rmem(&["drop", "robmem.boxes"]).success();
    lab.rmem(&["insert", "-q", "robmem.boxes", "{_id: 'c'}"]).success();
    assert_run!(lab.rmem(&["restore", "dump"]), @r#"
    {"namespace":"robmem.boxes","inserted":2,"replaced":0,"skipped":0}
    ------- stderr -------
    warning: robmem.boxes: the collation of the collection is not restored: it exists with another one; --drop replaces it
    [exit code: 0]
    "#);
}

#[test]
fn a_collection_with_a_collation_is_repaired_with_it() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    lab.rmem(&["create", "robmem.boxes", "--collation", IGNORE_CASE]).success();
    lab.rmem(&["insert", "-q", "robmem.boxes", "{_id: 'a', name: 'Box'}"]).success();
    lab.rmem(&["index", "robmem.boxes", "{name: 1}", "--collation", "{locale: 'simple'}"]).success();
    let indexes = lab.rmem(&["index", "robmem.boxes"]).success();
    lab.rmem(&["doctor", "--deep"]).success();
    lab.rmem(&["repair", "-o", "saved.rmem"]).success();
    let of_copy = ["--memory", "file:saved.rmem", "index", "robmem.boxes"];
    assert_eq!(lab.rmem(&of_copy).success(), indexes);
    let count = ["--memory", "file:saved.rmem", "count", "robmem.boxes", "{_id: 'A'}"];
    assert_eq!(lab.rmem(&count).success(), "1\n");
}

#[test]
fn a_dry_run_of_a_restore_says_what_the_restore_says_of_collations() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    let error = |run: crate::lab::Finished| run.exits(5).stderr;
    lab.rmem(&["create", "robmem.boxes", "--collation", IGNORE_CASE]).success();
    lab.write("alike.json", "{'robmem.boxes': [{_id: 'A'}, {_id: 'a'}]}");
    for restore in [&["restore", "alike.json", "--drop"][..], &["restore", "alike.json"]] {
        let foreseen = error(lab.rmem(&[restore, &["--dry-run"]].concat()));
        assert_eq!(foreseen, error(lab.rmem(restore)), "{restore:?}");
        assert!(foreseen.contains("robmem.boxes already has a document with _id: \"a\""), "{foreseen}");
    }
    lab.write("other.json", "{'robmem.boxes': [{_id: 'A'}, {_id: 'b'}]}");
    lab.rmem(&["restore", "other.json", "--drop", "--dry-run"]).success();
    lab.rmem(&["restore", "other.json", "--drop"]).success();
    lab.rmem(&["dump", "robmem.boxes", "-o", "dump"]).success();
    lab.rmem(&["drop", "robmem.boxes"]).success();
    let warning = "warning: robmem.boxes: the collation of the collection is not restored: it exists with another one; --drop \
                   replaces it\n";
    assert_eq!(lab.rmem(&["-q", "restore", "dump", "--dry-run"]).exits(0).stderr, "");
    lab.rmem(&["insert", "-q", "robmem.boxes", "{_id: 'c'}"]).success();
    for restore in [&["restore", "dump", "--dry-run"][..], &["restore", "dump"]] {
        assert!(lab.rmem(restore).exits(0).stderr.contains(warning), "{restore:?}");
    }
    assert!(!lab.rmem(&["restore", "dump", "--dry-run", "--drop"]).exits(0).stderr.contains("warning"));
}

#[test]
fn values_are_reduced_by_key_as_the_collection_compares() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    lab.rmem(&["create", "robmem.boxes", "--collation", IGNORE_CASE]).success();
    lab.rmem(&["insert", "-q", "robmem.boxes", "{_id: 1, k: 'a'}", "{_id: 2, k: 'A'}", "{_id: 3, k: 'b'}"]).success();
    let functions = ["--map", "function() { emit(this.k, 1) }", "--reduce", "(key, values) => Array.sum(values)"];
    let printed = lab.rmem(&[&["map-reduce", "robmem.boxes"][..], &functions].concat()).success();
    assert_eq!(printed, "{\"_id\":\"a\",\"value\":2.0}\n{\"_id\":\"b\",\"value\":1.0}\n");
}
