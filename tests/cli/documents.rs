//! insert, query, count, distinct, aggregate, update, delete, drop, collections, dump.

use crate::lab::Lab;

fn lab() -> Lab {
    let lab = Lab::new();
    lab.rmem(&[
        "insert",
        "robmem.worldmodel",
        "{_id: 1, relation: 'on-table', object: 'A', n: 3}",
        "{_id: 2, relation: 'on-table', object: 'C', n: NumberLong(4)}",
        "{_id: 3, relation: 'on', object_top: 'D', object_bottom: 'A', n: 1.5}",
    ])
    .success();
    lab
}

#[test]
fn insert_prints_ids_and_query_documents() {
    let lab = lab();
    let text = lab.rmem(&["query", "robmem.worldmodel", "{relation: 'on-table', n: {$gt: 3}}"]).success();
    assert_eq!(text, "{\"_id\":2,\"relation\":\"on-table\",\"object\":\"C\",\"n\":4}\n");
    let ids = lab.rmem_with(&["insert", "robmem.other"], "{a: 1}\n{a: 2}\n").success();
    assert_eq!(ids.matches("$oid").count(), 2, "{ids}");
}

#[test]
fn canonical_spells_types_out() {
    let text = lab().rmem(&["query", "robmem.worldmodel", "{_id: 2}", "--format", "canonical"]).success();
    assert!(text.contains("\"n\":{\"$numberLong\":\"4\"}"), "{text}");
}

#[test]
fn sort_skip_limit_and_fields_are_mongodbs() {
    let lab = lab();
    let args = [
        "query",
        "robmem.worldmodel",
        "--sort",
        "{n: -1}",
        "--skip",
        "1",
        "--limit",
        "1",
        "--fields",
        "{n: 1, _id: 0}",
    ];
    assert_eq!(lab.rmem(&args).success(), "{\"n\":3}\n");
}

#[test]
fn a_table_has_a_column_a_key() {
    let text = lab().rmem(&["query", "robmem.worldmodel", "{relation: 'on-table'}", "--format", "table"]).success();
    let lines: Vec<_> = text.lines().collect();
    assert_eq!(lines.len(), 3, "{text}");
    assert_eq!(lines[1].split_whitespace().collect::<Vec<_>>(), ["1", "on-table", "A", "3"]);
}

#[test]
fn json_is_one_array() {
    let lab = lab();
    let text = lab.rmem(&["query", "robmem.worldmodel", "{}", "--format", "json"]).success();
    let value: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(value.as_array().unwrap().len(), 3);
    assert_eq!(lab.rmem(&["query", "robmem.none", "--format", "json"]).success().trim(), "[]");
}

#[test]
fn counts_distinct_values_and_pipelines() {
    let lab = lab();
    assert_eq!(lab.rmem(&["count", "robmem.worldmodel", "{relation: 'on-table'}"]).success(), "2\n");
    assert_eq!(lab.rmem(&["distinct", "robmem.worldmodel", "relation"]).success(), "\"on\"\n\"on-table\"\n");
    let pipeline = "[{$group: {_id: '$relation', n: {$sum: 1}}}, {$sort: {_id: 1}}]";
    let text = lab.rmem(&["aggregate", "robmem.worldmodel", pipeline]).success();
    assert_eq!(text, "{\"_id\":\"on\",\"n\":1}\n{\"_id\":\"on-table\",\"n\":2}\n");
}

#[test]
fn update_changes_the_first_match_or_all() {
    let lab = lab();
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
fn delete_removes_the_first_match_and_drop_the_collection() {
    let lab = lab();
    assert_eq!(lab.rmem(&["delete", "robmem.worldmodel", "{relation: 'on-table'}"]).success(), "1\n");
    assert_eq!(lab.rmem(&["delete", "robmem.worldmodel", "{relation: 'on-table'}"]).success(), "1\n");
    assert_eq!(lab.rmem(&["collections"]).success(), "robmem.worldmodel\n");
    lab.rmem(&["drop", "robmem.worldmodel"]).success();
    assert_eq!(lab.rmem(&["collections"]).success(), "");
}

#[test]
fn malformed_documents_are_refused_with_their_place() {
    let lab = Lab::new();
    for text in
        ["{key-:+'not existing'}", "{'testkey'::'value'}", "warbagarbl", "{'bad':1.2.3}", "{([})]", "{____:4.56!}"]
    {
        let run = lab.rmem(&["insert", "robmem.x", text]).exits(3);
        assert!(run.stderr.contains("<argument>:1:") && run.stderr.contains('^'), "{text}: {run}");
    }
    assert_eq!(lab.rmem(&["count", "robmem.x"]).success(), "0\n");
}

#[test]
fn a_dump_loads_again_and_gives_the_same_bytes() {
    let lab = lab();
    lab.rmem(&["dump", "--all", "-o", "world.json"]).success();
    let again = lab.rmem(&["--memory", "mem:", "--load", "world.json", "dump", "--all"]).success();
    assert_eq!(again, lab.read("world.json"));
}

#[test]
fn loading_a_world_twice_changes_nothing() {
    let lab = Lab::new();
    let args = ["--load", "fixtures/blocksworld.json", "count", "robmem.worldmodel"];
    assert_eq!(lab.rmem(&args).success(), lab.rmem(&args).success());
}

#[test]
fn update_and_delete_change_one_document_and_say_how_many_more_match() {
    let lab = lab();
    let update = ["update", "robmem.worldmodel", "{relation: 'on-table'}", "{$set: {seen: true}}"];
    insta::assert_snapshot!(lab.rmem(&update), @r#"
    {"matched":1,"modified":1}
    ------- stderr -------
    1 of 2 that match; --many for all
    [exit code: 0]
    "#);
    insta::assert_snapshot!(lab.rmem(&[&update[..], &["--many"]].concat()), @r#"
    {"matched":2,"modified":1}
    ------- stderr -------
    [exit code: 0]
    "#);
    let delete = ["delete", "robmem.worldmodel", "{relation: 'on-table'}"];
    insta::assert_snapshot!(lab.rmem(&delete), @r#"
    1
    ------- stderr -------
    1 of 2 that match; --many for all
    [exit code: 0]
    "#);
    insta::assert_snapshot!(lab.rmem(&delete), @r#"
    1
    ------- stderr -------
    [exit code: 0]
    "#);
    insta::assert_snapshot!(lab.rmem(&["delete", "robmem.worldmodel"]), @r#"
    ------- stderr -------
    error: an empty query matches every document of robmem.worldmodel; expected a query, or --all
    [exit code: 2]
    "#);
    insta::assert_snapshot!(lab.rmem(&["delete", "robmem.worldmodel", "--all"]), @r#"
    1
    ------- stderr -------
    [exit code: 0]
    "#);
    insta::assert_snapshot!(lab.rmem(&["count", "robmem.worldmodel"]), @r#"
    0
    ------- stderr -------
    [exit code: 0]
    "#);
}

#[test]
fn a_whole_document_replaces_another_only_with_replace() {
    let lab = lab();
    let update = ["update", "robmem.worldmodel", "{_id: 1}", "{object: 'Z'}"];
    insta::assert_snapshot!(lab.rmem(&update), @r#"
    ------- stderr -------
    error: <update>:1:1: expected update operators, found a whole document
      |
    1 | {object: 'Z'}
      | ^^^^^^^^^^^^^
      = hint: write {$set: {…}} to change fields, or --replace to replace the document as a whole
    [exit code: 3]
    "#);
    insta::assert_snapshot!(lab.rmem(&[&update[..], &["--replace"]].concat()), @r#"
    {"matched":1,"modified":1}
    ------- stderr -------
    [exit code: 0]
    "#);
    insta::assert_snapshot!(lab.rmem(&["query", "robmem.worldmodel", "{_id: 1}"]), @r#"
    {"_id":1,"object":"Z"}
    ------- stderr -------
    [exit code: 0]
    "#);
    insta::assert_snapshot!(lab.rmem(&["update", "robmem.worldmodel", "{_id: 1}", "{$set: {a: 1}}", "--replace"]), @r#"
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
fn a_missing_collection_is_named_with_the_nearest() {
    let lab = lab();
    insta::assert_snapshot!(lab.rmem(&["query", "robmem.worldmodl"]), @r#"
    ------- stderr -------
    warning: no collection robmem.worldmodl; did you mean robmem.worldmodel?
    [exit code: 0]
    "#);
    insta::assert_snapshot!(lab.rmem(&["query", "robmem.worldmodel", "{relation: 'none'}"]), @r#"
    ------- stderr -------
    [exit code: 0]
    "#);
    insta::assert_snapshot!(lab.rmem(&["count", "robmem.other", "--strict"]), @r#"
    ------- stderr -------
    error: no collection robmem.other; `rmem collections` lists those there are
    [exit code: 3]
    "#);
}

#[test]
fn the_hint_about_a_missing_collection_needs_no_other_store() {
    let lab = Lab::new();
    let settings = "memory = \"file:own.rmem\"\nshared = \"file:/proc/none/x.rmem\"\nshared_databases = [\"team\"]\n";
    lab.write("rmem.toml", settings);
    lab.rmem(&["insert", "own.things", "{a: 1}"]).success();
    insta::assert_snapshot!(lab.rmem(&["count", "own.thing"]), @r#"
    0
    ------- stderr -------
    warning: no collection own.thing; did you mean own.things?
    [exit code: 0]
    "#);
}

#[test]
fn each_format_is_what_it_is_called_or_refused() {
    let lab = lab();
    let query = ["query", "robmem.worldmodel", "{relation: 'on-table'}", "--format"];
    insta::assert_snapshot!(lab.rmem(&[&query[..], &["csv"]].concat()), @r#"
    _id,relation,object,n
    1,on-table,A,3
    2,on-table,C,4
    ------- stderr -------
    [exit code: 0]
    "#);
    insta::assert_snapshot!(lab.rmem(&[&query[..], &["tsv"]].concat()), @r#"
    _id	relation	object	n
    1	on-table	A	3
    2	on-table	C	4
    ------- stderr -------
    [exit code: 0]
    "#);
    insta::assert_snapshot!(lab.rmem(&["query", "robmem.worldmodel", "--format", "table"]), @r#"
    on-table (2)
    _id  relation  object  n
    1    on-table  A       3
    2    on-table  C       4

    on (1)
    _id  relation  object_top  object_bottom  n
    3    on        D           A              1.5
    ------- stderr -------
    [exit code: 0]
    "#);
    insta::assert_snapshot!(lab.rmem(&[&query[..], &["dot"]].concat()), @r#"
    ------- stderr -------
    error: invalid value 'dot' for '--format <FORMAT>'
      [possible values: jsonl, json, canonical, table, csv, tsv]

    For more information, try '--help'.
    [exit code: 2]
    "#);
    insta::assert_snapshot!(lab.rmem(&["--format", "dot", "query", "robmem.worldmodel"]), @r#"
    ------- stderr -------
    error: `rmem query` has no format `dot`; it has jsonl, json, canonical, table, csv, tsv
    [exit code: 2]
    "#);
    insta::assert_snapshot!(lab.rmem(&["--format", "json", "completions", "bash"]), @r#"
    ------- stderr -------
    error: `rmem completions` has no format `json`; it has none
    [exit code: 2]
    "#);
    insta::assert_snapshot!(lab.rmem(&["distinct", "robmem.worldmodel", "relation", "--format", "json"]), @r#"
    [
      "on",
      "on-table"
    ]
    ------- stderr -------
    [exit code: 0]
    "#);
}

#[test]
fn values_are_reduced_by_key_and_printed_or_stored() {
    let lab = lab();
    let functions =
        ["--map", "function() { emit(this.relation, this.n) }", "--reduce", "(key, values) => Array.sum(values)"];
    let printed = lab.rmem(&[["map-reduce", "robmem.worldmodel"].as_slice(), &functions].concat()).success();
    assert_eq!(printed, "{\"_id\":\"on\",\"value\":1.5}\n{\"_id\":\"on-table\",\"value\":7.0}\n");
    let stored = [["map-reduce", "robmem.worldmodel", "--out", "robmem.sums"].as_slice(), &functions].concat();
    assert_eq!(lab.rmem(&stored).success(), "");
    assert_eq!(lab.rmem(&["query", "robmem.sums", "{_id: 'on'}"]).success(), "{\"_id\":\"on\",\"value\":1.5}\n");
    let failed =
        lab.rmem(&["map-reduce", "robmem.worldmodel", "--map", "function() { nothing() }", "--reduce", "() => 1"]);
    assert!(failed.exits(3).stderr.contains("nothing is not defined"));
}

#[test]
fn a_predicate_in_javascript_filters_and_one_that_throws_names_itself() {
    let lab = lab();
    let found =
        lab.rmem(&["query", "robmem.worldmodel", "{$where: 'this.n > 3 || this.object_top'}", "--fields", "{n: 1}"]);
    assert_eq!(found.success(), "{\"_id\":2,\"n\":4}\n{\"_id\":3,\"n\":1.5}\n");
    let failed = lab.rmem(&["query", "robmem.worldmodel", "{$where: 'nothing.at.all'}"]).exits(3);
    assert!(failed.stderr.contains("ReferenceError"), "{failed}");
}
