//! insert, and the world files of --load.

use crate::lab::{Lab, assert_run, three_documents};

#[test]
fn insert_prints_ids_and_query_documents() {
    let lab = three_documents();
    let text = lab.rmem(&["query", "robmem.worldmodel", "{relation: 'on-table', n: {$gt: 3}}"]).success();
    assert_eq!(text, "{\"_id\":2,\"relation\":\"on-table\",\"object\":\"C\",\"n\":4}\n");
    assert_run!(lab.rmem_with(&["insert", "robmem.other"], "{a: 1}\n{a: 2}\n"), @r#"
    {"$oid":"[ID]"}
    {"$oid":"[ID]"}
    ------- stderr -------
    2 stored in robmem.other
    [exit code: 0]
    "#);
}

#[test]
fn malformed_documents_are_refused_with_their_place() {
    let lab = Lab::new();
    let insert = |text| lab.transcript(&[&["insert", "robmem.x", text]]);
    assert_run!(insert("{key-:+'not existing'}"), @r#"
    $ rmem insert robmem.x "{key-:+'not existing'}"
    ------- stderr -------
    error: <argument>:1:5: expected `:`, found `-`
      |
    1 | {key-:+'not existing'}
      |     ^
      = hint: quote the key: 'key-'
    [exit code: 3]
    "#);
    assert_run!(insert("{'testkey'::'value'}"), @r#"
    $ rmem insert robmem.x "{'testkey'::'value'}"
    ------- stderr -------
    error: <argument>:1:12: expected a value, found `:`
      |
    1 | {'testkey'::'value'}
      |            ^
    [exit code: 3]
    "#);
    assert_run!(insert("warbagarbl"), @r"
    $ rmem insert robmem.x warbagarbl
    ------- stderr -------
    error: <argument>:1:1: expected a value, found `warbagarbl`
      |
    1 | warbagarbl
      | ^^^^^^^^^^
      = hint: strings are written in quotes
    [exit code: 3]
    ");
    assert_run!(insert("{'bad':1.2.3}"), @r#"
    $ rmem insert robmem.x "{'bad':1.2.3}"
    ------- stderr -------
    error: <argument>:1:8: expected a value, found `1.2.3`
      |
    1 | {'bad':1.2.3}
      |        ^^^^^
    [exit code: 3]
    "#);
    assert_run!(insert("{([})]"), @r"
    $ rmem insert robmem.x '{([})]'
    ------- stderr -------
    error: <argument>:1:2: expected a key or `}`, found `(`
      |
    1 | {([})]
      |  ^
    [exit code: 3]
    ");
    assert_run!(insert("{____:4.56!}"), @r"
    $ rmem insert robmem.x '{____:4.56!}'
    ------- stderr -------
    error: <argument>:1:11: expected `,` or `}`, found `!`
      |
    1 | {____:4.56!}
      |           ^
    [exit code: 3]
    ");
    assert_eq!(lab.rmem(&["count", "robmem.x"]).success(), "0\n");
}

#[test]
fn loading_a_world_twice_changes_nothing() {
    let lab = Lab::new();
    let args = ["--load", "fixtures/blocksworld.json", "count", "robmem.worldmodel"];
    assert_eq!(lab.rmem(&args).success(), lab.rmem(&args).success());
}

#[test]
fn an_interrupted_insert_says_how_many_documents_of_the_file_are_stored() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    lab.write("many.jsonl", &(0..300_000).map(|n| format!("{{\"_id\": {n}}}\n")).collect::<String>());
    let line = "rmem insert a.b --file many.jsonl > ids & until [ -s ids ]; do sleep 0.01; done; kill -INT $!; wait $!";
    let run = lab.shell(line).exits(130);
    let count = lab.rmem(&["count", "a.b"]).success();
    let ids = lab.read("ids").lines().count();
    assert_eq!(count.trim(), ids.to_string(), "{run}");
    assert_eq!(
        run.stderr,
        format!("error: interrupted; the first {ids} documents of the file were stored in a.b\n"),
        "{run}"
    );
}
