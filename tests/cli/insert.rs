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

#[test]
fn documents_come_from_yaml_and_from_rows_of_values() {
    let lab = Lab::new();
    lab.write(
        "objects.yaml",
        "- _id: cup\n  pose: {frame: map, x: 1.5}\n  seen: 2026-01-02T03:04:05Z\n- _id: jar\n  n: 3\n",
    );
    lab.write("objects.csv", "_id,pose.x,code.string(),n\nbox,2,007,3\nlid,,12,\n");
    lab.write("objects.txt", "_id\tn\nbin\t4\n");
    assert_run!(lab.rmem(&["insert", "robmem.objects", "--file", "objects.yaml"]), @r#"
    "cup"
    "jar"
    ------- stderr -------
    2 stored in robmem.objects
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&["insert", "robmem.objects", "--file", "objects.csv"]), @r#"
    "box"
    "lid"
    ------- stderr -------
    2 stored in robmem.objects
    [exit code: 0]
    "#);
    lab.rmem(&["insert", "robmem.objects", "--file", "objects.txt", "--type", "tsv"]).success();
    lab.rmem_with(&["insert", "robmem.objects", "--type", "yaml"], "_id: pan\n---\n_id: pot\n").success();
    assert_run!(lab.rmem(&["query", "robmem.objects"]), @r#"
    {"_id":"cup","pose":{"frame":"map","x":1.5},"seen":{"$date":"[TIME]"}}
    {"_id":"jar","n":3}
    {"_id":"box","pose":{"x":2},"code":"007","n":3}
    {"_id":"lid","code":"12"}
    {"_id":"bin","n":4}
    {"_id":"pan"}
    {"_id":"pot"}
    ------- stderr -------
    [exit code: 0]
    "#);
    // What rmem writes as CSV comes back.
    let rows = |ns| lab.rmem(&["query", ns, "{n: {$gte: 3}}", "--format", "csv"]).success();
    lab.rmem_with(&["insert", "robmem.copies", "--type", "csv"], &rows("robmem.objects")).success();
    assert_eq!(rows("robmem.copies"), rows("robmem.objects"));
}

#[test]
fn what_stands_before_a_mistake_in_yaml_or_csv_is_stored() {
    let lab = Lab::new();
    lab.write("bad.yaml", "- {_id: 1}\n- {_id: 2}\n- three\n");
    assert_run!(lab.rmem(&["insert", "robmem.objects", "-q", "--file", "bad.yaml"]), @r"
    1
    2
    ------- stderr -------
    error: bad.yaml:3:3: expected a document, which is a mapping: `key: value`
      |
    3 | - three
      |   ^^^^^
      2 documents were stored before it
    [exit code: 3]
    ");
    lab.write("twice.yaml", "- _id: 3\n- _id: 4\n  n: 2\n- _id: 3\n");
    assert_run!(lab.rmem(&["insert", "robmem.twice", "-q", "--file", "twice.yaml"]), @r"
    3
    4
    ------- stderr -------
    error: twice.yaml:4:3: robmem.twice already has a document with _id: 3
      |
    4 | - _id: 3
      |   ^
      2 documents were stored before it
    [exit code: 5]
    ");
    lab.write("bad.csv", "_id,n.int32()\n3,1\n4,one\n");
    assert_run!(lab.rmem(&["insert", "robmem.objects", "-q", "--file", "bad.csv"]), @r"
    3
    ------- stderr -------
    error: bad.csv:3:3: expected an integer of 32 bits for `n`, found `one`
      |
    3 | 4,one
      |   ^^^
      1 document was stored before it
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["insert", "robmem.objects", "{_id: 5}", "--type", "csv"]), @r"
    ------- stderr -------
    error: --type is for a file or stdin; documents on the command line are in shell syntax
    [exit code: 2]
    ");
}

#[test]
fn what_stands_before_wrong_metadata_is_stored() {
    let lab = Lab::new();
    let wrong = "{_id: 3, _robmem_info: {decay_time: 'x'}}";
    let valid = "{_id: 2, _robmem_info: {persistent: false}}";
    let refused = lab.rmem(&["insert", "robmem.objects", "-q", "{_id: 1}", valid, wrong, "{_id: 4}"]).exits(3);
    assert_eq!(refused.stdout, "1\n2\n");
    assert!(refused.stderr.contains("_robmem_info.decay_time has to be a date"), "{refused}");
    let lines: String = (5..15).map(|n| format!("{{_id: {n}}}\n")).collect();
    let lines = lines.replace("{_id: 11}", "{_id: 11, _robmem_info: {persistent: 1}}");
    assert_eq!(lab.rmem_with(&["insert", "robmem.objects", "-q"], &lines).exits(3).stdout, "5\n6\n7\n8\n9\n10\n");
    assert_eq!(lab.rmem(&["count", "robmem.objects"]).success(), "8\n");
}

#[test]
fn a_regular_expression_of_extended_json_1_is_stored_as_one() {
    let lab = Lab::new();
    lab.rmem(&["insert", "robmem.rules", r#"{_id: 1, "match": {"$regex": "^a", "$options": "i"}}"#]).success();
    let canonical = lab.rmem(&["query", "robmem.rules", "--format", "canonical", "--fields", "{_id: 0}"]).success();
    assert_eq!(canonical, "{\"match\":{\"$regularExpression\":{\"pattern\":\"^a\",\"options\":\"i\"}}}\n");
    lab.rmem(&["insert", "robmem.names", "{_id: 'Anna'}", "{_id: 'Bert'}"]).success();
    for query in ["{_id: {$in: [{$regex: '^a', $options: 'i'}]}}", "{_id: {$regex: '^a', $options: 'i'}}"] {
        assert_eq!(lab.rmem(&["query", "robmem.names", query]).success(), "{\"_id\":\"Anna\"}\n");
    }
}

#[test]
fn a_key_with_hyphens_needs_no_quotes() {
    let lab = Lab::new();
    lab.rmem(&["insert", "robmem.machines", "{_id: 'CS1', cap-loaded: 'NONE'}"]).success();
    assert_eq!(lab.rmem(&["count", "robmem.machines", "{cap-loaded: 'NONE'}"]).success(), "1\n");
}

#[test]
fn rows_of_values_without_their_type_get_the_option_for_it() {
    let lab = Lab::new().env("RMEM_MEMORY", "file:m.rmem");
    lab.write("rows", "name,is,x\nA,box,1\n");
    assert_run!(lab.rmem(&["insert", "a.b", "--file", "rows"]), @r"
    ------- stderr -------
    error: rows:1:1: expected a value, found `name`
      |
    1 | name,is,x
      | ^^^^
      = hint: for CSV: --type csv, or --file with a name that ends in .csv
    [exit code: 3]
    ");
    let refused = |text: &str| lab.rmem_with(&["insert", "a.b"], text).exits(3).stderr;
    assert!(refused("name,is\nA,box\n").contains("for CSV: --type csv, or --file with a name that ends in .csv"));
    assert!(refused("name: A\nis: box\n").contains("for YAML: --type yaml"));
    for other in
        ["{name: A}\n", "(robot (name R1))\n", "hello world\n", "INSERT INTO x VALUES (1, 2)\n", "True, False\n"]
    {
        assert!(!refused(other).contains("--type"), "{}", refused(other));
    }
    assert_eq!(lab.rmem_with(&["insert", "a.b", "--type", "csv", "-q"], "_id,is\n1,box\n").success(), "1\n");
}

#[test]
fn a_dash_is_stdin_in_every_format() {
    let lab = Lab::new();
    let insert = |kind: &str, text: &str| {
        lab.rmem_with(&["insert", "robmem.objects", "--type", kind, "-"], text).success();
    };
    insert("csv", "_id,n\n1,2\n");
    insert("tsv", "_id\tn\n2\t3\n");
    insert("yaml", "{_id: 3, n: 4}\n");
    insert("json", "{_id: 4, n: 5}\n");
    let stored = "{\"_id\":1,\"n\":2}\n{\"_id\":2,\"n\":3}\n{\"_id\":3,\"n\":4}\n{\"_id\":4,\"n\":5}\n";
    assert_eq!(lab.rmem(&["query", "robmem.objects"]).success(), stored);
}

#[test]
fn a_document_that_is_refused_is_shown_at_its_place() {
    let lab = Lab::new();
    lab.write("list.jsonl", "{_id: 1}\n{_id: 2}\n  {_id: [3]}\n{_id: 4}\n");
    lab.write("array.json", "[{_id: 5}, {_id: 1}]\n");
    let commands: [&[&str]; 4] = [
        &["insert", "a.b", "--file", "list.jsonl"],
        &["insert", "a.b", "--file", "array.json"],
        &["insert", "a.b", "{_id: 6}", "{_id: [7]}"],
        &["insert", "a.b", "{_id: [8]}"],
    ];
    let mut transcript = lab.transcript(&commands);
    let stdin = lab.rmem_with(&["insert", "a.b"], "{_id: 9}\n{_id: /x/}\n");
    transcript.push_str(&stdin.to_string());
    assert_run!(transcript, @r"
    $ rmem insert a.b --file list.jsonl
    1
    2
    ------- stderr -------
    error: list.jsonl:3:3: the document cannot be stored: the _id may not be an array
      |
    3 |   {_id: [3]}
      |   ^
      2 documents were stored before it
    [exit code: 3]
    $ rmem insert a.b --file array.json
    5
    ------- stderr -------
    error: array.json:1:12: a.b already has a document with _id: 1
      |
    1 | [{_id: 5}, {_id: 1}]
      |            ^
      1 document was stored before it
    [exit code: 5]
    $ rmem insert a.b '{_id: 6}' '{_id: [7]}'
    6
    ------- stderr -------
    error: <argument 2>:1:1: the document cannot be stored: the _id may not be an array
      |
    1 | {_id: [7]}
      | ^
      1 document was stored before it
    [exit code: 3]
    $ rmem insert a.b '{_id: [8]}'
    ------- stderr -------
    error: the _id may not be an array
    [exit code: 3]
    9
    ------- stderr -------
    error: <stdin>:2:1: the document cannot be stored: the _id may not be a regular expression
      1 document was stored before it
    [exit code: 3]
    ");
}

#[test]
fn a_text_that_is_not_utf8_is_shown_with_what_converts_it() {
    let lab = Lab::new();
    let write = |name: &str, bytes: &[u8]| std::fs::write(lab.path().join(name), bytes).unwrap();
    write("my docs.json", b"\n{b: 'cup\xe9'}\n");
    write("a.csv", b"a\ncup\xe9\n");
    write("wide.csv", b"\xff\xfea\x00\n\x00");
    write("image.json", b"\x89PNG\0\r\n");
    write("t.j2", b"(a)\n{# cup\xe9 #}");
    write("rmem.toml", b"# cup\xe9\n");
    let latin = |file: &str| format!("if this is Latin-1, convert it by iconv -f latin1 -t utf-8 {file}");
    let wide = "this is UTF-16: convert it by iconv -f utf-16 -t utf-8 wide.csv".to_owned();
    let binary = "this is a binary file, not a text".to_owned();
    let (insert, file, config) =
        (["insert", "n.c", "--file"], "my docs.json", ["--config", "rmem.toml", "collections"]);
    for (arguments, place, line, caret, hint) in [
        ([&insert[..], &[file]], "my docs.json:2:9", "{b: 'cup\u{fffd}'}", 8, latin("\"my docs.json\"")),
        ([&insert[..], &["a.csv"]], "a.csv:2:4", "cup\u{fffd}", 3, latin("a.csv")),
        ([&insert[..], &["wide.csv"]], "wide.csv:1:1", "\u{fffd}\u{fffd}a", 0, wide),
        ([&insert[..], &["image.json"]], "image.json:1:1", "\u{fffd}PNG", 0, binary),
        ([&["gen-problem", "-t"][..], &["t.j2"]], "t.j2:2:7", "{# cup\u{fffd} #}", 6, latin("t.j2")),
        ([&config[..], &[]], "$LAB/rmem.toml:1:6", "# cup\u{fffd}", 5, latin("$LAB/rmem.toml")),
    ] {
        let arguments = arguments.concat();
        let none: &[&str] = if arguments.contains(&"--config") { &[] } else { &["--config", "/dev/null"] };
        let run = lab.rmem(&[none, &["--memory", "mem:"], &arguments].concat());
        let number = place.split(':').nth(1).unwrap();
        let wanted = format!(
            "error: {place}: expected UTF-8 text, found invalid UTF-8\n  |\n{number} | {line}\n  | {}^\n  = hint: {hint}\n",
            " ".repeat(caret)
        );
        assert_eq!(run.exits(3).stderr, wanted);
    }
}
