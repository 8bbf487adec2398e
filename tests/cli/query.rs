//! query, its formats, and what a terminal shows of stored data; count, distinct.

use crate::lab::{Lab, assert_run, three_documents};

#[test]
fn canonical_spells_types_out() {
    let query = ["query", "robmem.worldmodel", "{_id: 2}", "--format", "canonical"];
    assert_run!(three_documents().rmem(&query), @r#"
    {"_id":{"$numberInt":"2"},"relation":"on-table","object":"C","n":{"$numberLong":"4"}}
    ------- stderr -------
    [exit code: 0]
    "#);
}

#[test]
fn sort_skip_limit_and_fields_are_mongodbs() {
    let lab = three_documents();
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
    let query = ["query", "robmem.worldmodel", "{relation: 'on-table'}", "--format", "table"];
    assert_run!(three_documents().rmem(&query), @r"
    _id  relation  object  n
    1    on-table  A       3
    2    on-table  C       4
    ------- stderr -------
    [exit code: 0]
    ");
}

#[test]
fn json_is_one_array() {
    let lab = three_documents();
    let text = lab.rmem(&["query", "robmem.worldmodel", "{}", "--format", "json"]).success();
    let value: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(value.as_array().unwrap().len(), 3);
    assert_eq!(lab.rmem(&["query", "robmem.none", "--format", "json"]).success().trim(), "[]");
}

#[test]
fn counts_distinct_values_and_pipelines() {
    let lab = three_documents();
    assert_eq!(lab.rmem(&["count", "robmem.worldmodel", "{relation: 'on-table'}"]).success(), "2\n");
    assert_eq!(lab.rmem(&["distinct", "robmem.worldmodel", "relation"]).success(), "\"on\"\n\"on-table\"\n");
    let pipeline = "[{$group: {_id: '$relation', n: {$sum: 1}}}, {$sort: {_id: 1}}]";
    let text = lab.rmem(&["aggregate", "robmem.worldmodel", pipeline]).success();
    assert_eq!(text, "{\"_id\":\"on\",\"n\":1}\n{\"_id\":\"on-table\",\"n\":2}\n");
}

#[test]
fn a_missing_collection_is_named_with_the_nearest() {
    let lab = three_documents();
    assert_run!(lab.rmem(&["query", "robmem.worldmodl"]), @r#"
    ------- stderr -------
    warning: no collection robmem.worldmodl; did you mean robmem.worldmodel?
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&["query", "robmem.worldmodel", "{relation: 'none'}"]), @r#"
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&["count", "robmem.other", "--strict"]), @r#"
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
    assert_run!(lab.rmem(&["count", "own.thing"]), @r#"
    0
    ------- stderr -------
    warning: no collection own.thing; did you mean own.things?
    [exit code: 0]
    "#);
}

#[test]
fn each_format_is_what_it_is_called_or_refused() {
    let lab = three_documents();
    let query = ["query", "robmem.worldmodel", "{relation: 'on-table'}", "--format"];
    assert_run!(lab.rmem(&[&query[..], &["csv"]].concat()), @r#"
    _id,relation,object,n
    1,on-table,A,3
    2,on-table,C,4
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&[&query[..], &["tsv"]].concat()), @r#"
    _id	relation	object	n
    1	on-table	A	3
    2	on-table	C	4
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&["query", "robmem.worldmodel", "--format", "table"]), @r#"
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
    assert_run!(lab.rmem(&[&query[..], &["dot"]].concat()), @r#"
    ------- stderr -------
    error: invalid value 'dot' for '--format <FORMAT>'
      [possible values: jsonl, json, canonical, table, csv, tsv]

    For more information, try '--help'.
    [exit code: 2]
    "#);
    assert_run!(lab.rmem(&["--format", "dot", "query", "robmem.worldmodel"]), @r#"
    ------- stderr -------
    error: `rmem query` has no format `dot`; it has jsonl, json, canonical, table, csv, tsv
    [exit code: 2]
    "#);
    assert_run!(lab.rmem(&["--format", "json", "completions", "bash"]), @r#"
    ------- stderr -------
    error: `rmem completions` has no format `json`; it has none
    [exit code: 2]
    "#);
    assert_run!(lab.rmem(&["distinct", "robmem.worldmodel", "relation", "--format", "json"]), @r#"
    [
    "on",
    "on-table"
    ]
    ------- stderr -------
    [exit code: 0]
    "#);
}

#[test]
fn a_predicate_in_javascript_filters_and_one_that_throws_names_itself() {
    let lab = three_documents();
    let found =
        lab.rmem(&["query", "robmem.worldmodel", "{$where: 'this.n > 3 || this.object_top'}", "--fields", "{n: 1}"]);
    assert_eq!(found.success(), "{\"_id\":2,\"n\":4}\n{\"_id\":3,\"n\":1.5}\n");
    let failed = lab.rmem(&["query", "robmem.worldmodel", "{$where: 'nothing.at.all'}"]).exits(3);
    assert_run!(failed, @r"
    ------- stderr -------
    error: <query>:1:1: JavaScript failed: ReferenceError: nothing is not defined
      |
    1 | {$where: 'nothing.at.all'}
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    ");
}

#[test]
fn explain_prints_how_a_query_is_answered() {
    let lab = Lab::new();
    lab.rmem(&["index", "robmem.objects", "{name: 1}"]).success();
    lab.rmem(&["insert", "robmem.objects", "{name: 'cup'}", "{name: 'jar'}"]).success();
    let explained = lab.rmem(&["query", "robmem.objects", "{name: 'cup'}", "--explain"]).success();
    assert_eq!(
        explained,
        "{\"index\":\"name_1\",\"keys\":{\"name\":1},\"bounds\":{\"name\":[\"[\\\"cup\\\", \\\"cup\\\"]\"]},\
         \"keys_examined\":1,\"documents_examined\":1,\"returned\":1}\n"
    );
    let scan = lab.rmem(&["query", "robmem.objects", "{mass: {$gt: 1}}", "--explain"]).success();
    assert_eq!(scan, "{\"index\":null,\"keys_examined\":0,\"documents_examined\":2,\"returned\":0}\n");
}

/// Clears the screen, sets the colour by a C1 control, and turns the direction of reading.
const NASTY: &str = "\u{1b}[2J\u{9b}31m\u{202e}";
const VISIBLE: &str = "\\u{1b}[2J\\u{9b}31m\\u{202e}";

#[test]
fn escape_sequences_in_stored_data_are_visible_on_stderr_and_in_tables() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    let document = format!("{{\"_id\": \"{NASTY}\", \"{NASTY}\": [\"{NASTY}\"]}}").replace('\u{1b}', "\\u001b");
    lab.rmem_with(&["insert", "a.b"], &document).success();
    let taken = lab.rmem_with(&["insert", "a.b"], &document).exits(5);
    assert!(taken.stderr.contains(VISIBLE), "{taken}");
    let owner = format!("{NASTY}r1");
    lab.rmem(&["lock", "table", "--owner", &owner]).success();
    let held = lab.rmem(&["lock", "table", "--owner", "r2"]).exits(5);
    assert!(held.stderr.contains(VISIBLE), "{held}");
    let table = lab.rmem(&["query", "a.b", "--format", "table"]).success();
    assert_eq!(table.matches(VISIBLE).count(), 2, "{table}");
    assert!(table.contains("[\"\\u001b[2J\\u{9b}31m\\u{202e}\"]"), "{table}");
    let unknown = lab.rmem(&["query", &format!("a.{NASTY}"), "--format", "table", "--explain"]);
    for text in [&taken.stderr, &held.stderr, &table, &unknown.stderr] {
        assert!(!text.contains(['\u{1b}', '\u{9b}', '\u{202e}']), "{text:?}");
    }
}

#[test]
fn a_long_answer_is_printed_as_several_tables() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    let lines: String = (0..2_500).map(|n| format!("{{_id: {n}, a: {n}}}\n")).collect();
    lab.rmem_with(&["insert", "a.b"], &lines).success();
    let table = lab.rmem(&["query", "a.b", "--format", "table"]).success();
    assert_eq!(table.lines().filter(|line| line.starts_with("_id")).count(), 3);
    assert_eq!(table.lines().filter(|line| line.is_empty()).count(), 2);
    assert_eq!(table.lines().count(), 2_500 + 3 + 2);
}

#[test]
fn a_large_result_is_separated_by_commas_as_a_small_one() {
    let lab = crate::lab::Lab::empty().env("RMEM_MEMORY", "file:m.rmem");
    let long = "x".repeat(20_000);
    let lines: String = (0..1000).map(|n| format!("{{\"_id\": {n}, \"k{}\": \"{long}\"}}\n", n % 2)).collect();
    lab.write("many.jsonl", &lines);
    lab.rmem(&["insert", "-q", "a.b", "--file", "many.jsonl"]).success();
    std::fs::create_dir(lab.path().join("tmp")).unwrap();
    let folder = lab.path().join("tmp").display().to_string();
    let lab = lab.env("TMPDIR", &folder);
    let text = lab.rmem(&["query", "a.b", "--format", "csv"]).success();
    assert_eq!((text.lines().next(), text.lines().count()), (Some("_id,k0,k1"), 1001));
    assert_eq!(text.lines().last(), Some(format!("999,,{long}").as_str()));
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 0, "nothing is left");
}

#[test]
fn a_dash_in_the_place_of_a_query_reads_it_from_stdin() {
    let lab = three_documents();
    let query = "{relation: 'on-table',\n // comment\n n: {$gt: 3}}\n";
    let name = "robmem.worldmodel";
    let wanted = lab.rmem(&["query", name, query]).success();
    assert!(wanted.contains("\"C\""), "{wanted}");
    assert_eq!(lab.rmem_with(&["query", name, "-"], query).success(), wanted);
    assert_eq!(lab.rmem_with(&["count", name, "-"], query).success(), "1\n");
    assert_eq!(lab.rmem_with(&["distinct", name, "n", "-"], query).success(), "4\n");
    assert_eq!(lab.rmem_with(&["aggregate", name, "-"], "[{$count: 'n'}]\n").success(), "{\"n\":3}\n");
    lab.rmem_with(&["clips", "export", name, "-"], query).success();
    let changed = "{\"matched\":1,\"modified\":1}\n";
    assert_eq!(lab.rmem_with(&["update", name, query, "-"], "{$set: {n: 5}}").success(), changed);
    assert_eq!(lab.rmem_with(&["update", name, "-", "{$set: {n: 6}}"], query).success(), changed);
    lab.rmem_with(&["find-and-modify", name, "{}", "-"], "{$set: {seen: true}}").success();
    assert_eq!(lab.rmem_with(&["delete", name, "-"], query).success(), "1\n");
    assert_run!(lab.rmem_with(&["update", name, "-", "-"], query), @r"
    ------- stderr -------
    error: stdin can be read only once; expected `-` for one text at most
    [exit code: 2]
    ");
    assert_run!(lab.rmem_with(&["query", name, "-"], "{\n  n: {$gth: 1}}"), @r"
    ------- stderr -------
    error: <query>:2:7: unknown operator: $gth
      |
    2 |   n: {$gth: 1}}
      |       ^^^^
      = hint: did you mean `$gt`?
    [exit code: 3]
    ");
    let run = lab.rmem(&["delete", name, "-"]).exits(3);
    assert!(run.stderr.starts_with("error: <query>:1:1: expected a value, found the end of the text"), "{run}");
}
