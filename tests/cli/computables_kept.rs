//! Computables that are kept in the memory: added, listed and removed; bad ones are refused.

use crate::lab::{Lab, assert_run};

const LOW: &str = "{name: 'low', collection: 'a.x', spec: {relation: 'on-table'}, pipeline: [{$match: {z: {$lt: 1}}}, \
                   {$project: {_id: 0, relation: 'on-table', object: '$block'}}], from: 'a.blocks', cache: '1m'}";

fn lab() -> Lab {
    let lab = Lab::new();
    lab.write("rmem.toml", "memory = 'file:robot.rmem'\n");
    lab
}

#[test]
fn what_is_added_answers_queries_until_it_is_removed() {
    let lab = lab();
    assert_run!(lab.rmem(&["computables", "add", LOW]), @r"
    low
    ------- stderr -------
    [exit code: 0]
    ");
    lab.rmem(&["insert", "a.blocks", "{block: 'A', z: 0}", "{block: 'B', z: 5}"]).success();
    let ask = ["query", "a.x", "{relation: 'on-table'}", "--fields", "{_id: 0}"];
    assert_eq!(lab.rmem(&ask).success(), "{\"relation\":\"on-table\",\"object\":\"A\"}\n");
    assert_run!(lab.rmem(&["computables"]), @r#"
    {"name":"low","collection":"a.x","spec":{"relation":"on-table"},"priority":0,"cache":"60s","body":"pipeline over a.blocks: [{\"$match\":{\"z\":{\"$lt\":1}}},{\"$project\":{\"_id\":0,\"relation\":\"on-table\",\"object\":\"$block\"}}]","origin":"a.rmem.computables"}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_eq!(
        lab.rmem(&["computables", "--check", "a.x", "{relation: 'in'}"]).success(),
        "{\"name\":\"low\",\"runs\":false,\"why\":\"the query does not match {\\\"relation\\\":\\\"on-table\\\"} of the spec\"}\n"
    );
    // It is none of the memory's documents.
    assert_eq!(lab.rmem(&["collections"]).success(), "a.blocks\na.x\n");
    assert_run!(lab.rmem(&["computables", "remove", "low", "low"]), @r"
    low
    ------- stderr -------
    error: the memory keeps no computable `low`; `rmem computables` lists those there are
    [exit code: 1]
    ");
    assert_eq!(lab.rmem(&ask).success(), "");
}

#[test]
fn a_toml_file_has_the_tables_of_the_settings() {
    let lab = lab();
    let tables = "\
[[computable]]
name = 'height'
collection = ['a.x', 'a.y']
spec = '{height: {$exists: true}}'
adds = ['height']
pipeline = \"[{$project: {height: '$z'}}]\"

[[computable]]
name = 'near'
collection = 'b.x'
spec = '{nearest_to: {$exists: true}}'
builtin = 'nearest'
position = 'at'
priority = 2
";
    lab.write("two.toml", tables);
    assert_run!(lab.rmem(&["computables", "add", "--file", "two.toml"]), @r"
    height
    near
    ------- stderr -------
    [exit code: 0]
    ");
    assert_run!(lab.rmem(&["computables", "list"]), @r#"
    {"name":"near","collection":"b.x","spec":{"nearest_to":{"$exists":true}},"priority":2,"cache":null,"body":"nearest, with positions under at","origin":"b.rmem.computables"}
    {"name":"height","collection":"a.y","spec":{"height":{"$exists":true}},"priority":0,"cache":null,"body":"pipeline over a.y: [{\"$project\":{\"height\":\"$z\"}}]","origin":"a.rmem.computables","adds":["height"]}
    {"name":"height","collection":"a.x","spec":{"height":{"$exists":true}},"priority":0,"cache":null,"body":"pipeline over a.x: [{\"$project\":{\"height\":\"$z\"}}]","origin":"a.rmem.computables","adds":["height"]}
    ------- stderr -------
    [exit code: 0]
    "#);
    lab.rmem(&["insert", "a.y", "{_id: 1, z: 3}"]).success();
    lab.rmem(&["insert", "b.x", "{_id: 1, at: [1, 0, 0]}", "{_id: 2, at: [9, 0, 0]}"]).success();
    assert_eq!(lab.rmem(&["query", "a.y", "{height: 3}"]).success(), "{\"_id\":1,\"z\":3,\"height\":3}\n");
    let near = ["query", "b.x", "{nearest_to: [8, 0, 0], limit: 1}", "--fields", "{_id: 0, distance: 1}"];
    assert_eq!(lab.rmem(&near).success(), "{\"distance\":1.0}\n");
    // In the settings, the same tables are the same computables; of one name, there is one.
    lab.write("rmem.toml", &format!("memory = 'file:robot.rmem'\n{tables}"));
    let both = lab.rmem(&["computables"]);
    assert_run!(both, @r#"
    {"name":"near","collection":"b.x","spec":{"nearest_to":{"$exists":true}},"priority":2,"cache":null,"body":"nearest, with positions under at","origin":"b.rmem.computables"}
    {"name":"near","collection":"b.x","spec":{"nearest_to":{"$exists":true}},"priority":2,"cache":null,"body":"nearest, with positions under at","origin":"$LAB/rmem.toml:10"}
    {"name":"height","collection":"a.y","spec":{"height":{"$exists":true}},"priority":0,"cache":null,"body":"pipeline over a.y: [{\"$project\":{\"height\":\"$z\"}}]","origin":"a.rmem.computables","adds":["height"]}
    {"name":"height","collection":"a.x","spec":{"height":{"$exists":true}},"priority":0,"cache":null,"body":"pipeline over a.x: [{\"$project\":{\"height\":\"$z\"}}]","origin":"a.rmem.computables","adds":["height"]}
    {"name":"height","collection":"a.y","spec":{"height":{"$exists":true}},"priority":0,"cache":null,"body":"pipeline over a.y: [{\"$project\":{\"height\":\"$z\"}}]","origin":"$LAB/rmem.toml:3","adds":["height"]}
    {"name":"height","collection":"a.x","spec":{"height":{"$exists":true}},"priority":0,"cache":null,"body":"pipeline over a.x: [{\"$project\":{\"height\":\"$z\"}}]","origin":"$LAB/rmem.toml:3","adds":["height"]}
    ------- stderr -------
    error: two computables are called `height`: that of $LAB/rmem.toml:3, and that of a.rmem.computables; rename one of them, or take the one in the memory away: rmem computables remove height
    error: two computables are called `near`: that of $LAB/rmem.toml:10, and that of b.rmem.computables; rename one of them, or take the one in the memory away: rmem computables remove near
    [exit code: 3]
    "#);
    assert_eq!(lab.rmem(&["query", "a.y", "{height: 3}"]).exits(3).stdout, "");
    assert_run!(lab.rmem(&["computables", "add", "--file", "two.toml"]), @r"
    ------- stderr -------
    error: a.rmem.computables keeps a computable `height` already; rmem computables remove height takes it away
    [exit code: 3]
    ");
    lab.rmem(&["computables", "remove", "near", "height"]).success();
    assert_run!(lab.rmem(&["computables", "remove", "near"]), @r"
    ------- stderr -------
    error: `near` is a computable of $LAB/rmem.toml:10, not of the memory; remove it there
    [exit code: 1]
    ");
    assert_eq!(lab.rmem(&["query", "a.y", "{height: 3}"]).success(), "{\"_id\":1,\"z\":3,\"height\":3}\n");
}

#[test]
fn programs_are_not_kept() {
    let lab = lab();
    lab.write(
        "program.toml",
        "[[computable]]\nname = 'sum'\ncollection = 'a.x'\nspec = '{}'\ncommand = ['sh', 'sum.sh']\n",
    );
    assert_run!(lab.rmem(&["computables", "add", "-f", "program.toml"]), @r"
    ------- stderr -------
    error: program.toml:5:11: a program is declared in a settings file only: others write to the memory, and what they write must not run programs here
      |
    5 | command = ['sh', 'sum.sh']
      |           ^^^^^^^^^^^^^^^^
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["computables", "add", "{name: 'sum', collection: 'a.x', spec: {}, command: ['sh']}"]), @r"
    ------- stderr -------
    error: <argument>:1:1: `command`: a program is declared in a settings file only: others write to the memory, and what they write must not run programs here
      |
    1 | {name: 'sum', collection: 'a.x', spec: {}, command: ['sh']}
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    ");
    // Nor is what is written there.
    let written = "{_id: 'sum', collection: 'a.x', spec: '{}', command: ['touch', 'ran']}";
    assert_run!(lab.rmem(&["insert", "a.rmem.computables", written]), @r"
    ------- stderr -------
    error: a.rmem.computables keeps computables, and the document `sum` is none: `command`: a program is declared in a settings file only: others write to the memory, and what they write must not run programs here; `rmem computables add` keeps one
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["insert", "a.rmem.computables", "{_id: 3}"]), @r"
    ------- stderr -------
    error: a.rmem.computables keeps computables, and the document `3` is none: `_id`: expected a string, found 3; `rmem computables add` keeps one
    [exit code: 3]
    ");
    assert!(!lab.path().join("ran").exists());
    assert_eq!(lab.rmem(&["count", "a.x"]).success(), "0\n");
}

#[test]
fn what_is_no_computable_is_refused_with_its_place() {
    let lab = lab();
    let mut all = String::new();
    for computable in [
        "3",
        "{}",
        "{name: ''}",
        "{name: 'a'}",
        "{name: 'a', collection: 'x'}",
        "{name: 'a', collection: []}",
        "{name: 'a', collection: ['a.x', 'b.x'], spec: {}}",
        "{name: 'a', collection: 'a.x'}",
        "{name: 'a', collection: 'a.x', spec: 3}",
        "{name: 'a', collection: 'a.x', spec: {$foo: 1}}",
        "{name: 'a', collection: 'a.x', spec: '{x'}",
        "{name: 'a', collection: 'a.x', spec: {}}",
        "{name: 'a', collection: 'a.x', spec: {}, pipeline: [], builtin: 'nearest'}",
        "{name: 'a', collection: 'a.x', spec: {}, builtin: 'nearst'}",
        "{name: 'a', collection: 'a.x', spec: {}, builtin: 'nearest', from: 'a.y'}",
        "{name: 'a', collection: 'a.x', spec: {}, pipeline: [3]}",
        "{name: 'a', collection: 'a.x', spec: {}, pipeline: [{$out: 'y'}]}",
        "{name: 'a', collection: 'a.x', spec: {}, pipeline: [], position: 'at'}",
        "{name: 'a', collection: 'a.x', spec: {}, pipeline: [], prioritty: 3}",
        "{name: 'a', collection: 'a.x', spec: {}, pipeline: [], priority: '3'}",
        "{name: 'a', collection: 'a.x', spec: {}, pipeline: [], cache: '3'}",
        "{name: 'a', collection: 'a.x', spec: {}, pipeline: [], cache: '0s'}",
        "{name: 'a', collection: 'a.x', spec: {}, pipeline: [], adds: ['_id']}",
        "{name: 'a', collection: 'a.x', spec: {}, pipeline: [], adds: true, cache: '1s'}",
    ] {
        let run = lab.rmem(&["computables", "add", computable]).exits(3);
        all.push_str(run.stderr.lines().next().unwrap_or_default());
        all.push('\n');
    }
    insta::assert_snapshot!(all, @r#"
    error: <argument>:1:1: expected a document `{…}`, found a number
    error: <argument>:1:1: expected a `name` for the computable
    error: <argument>:1:1: `name`: expected a name for the computable, found an empty one
    error: <argument>:1:1: expected the `collection` that it is for
    error: <argument>:1:1: `collection`: `x` is not a namespace: it has no dot; expected DATABASE.COLLECTION, like robmem.worldmodel
    error: <argument>:1:1: `collection`: expected a collection, found none
    error: <argument>:1:1: `collection`: a.x and b.x are in different databases, and a computable is kept in the database of its collection; add one for each database
    error: <argument>:1:1: expected a `spec`: the query that it answers, like {below: {$exists: true}}
    error: <argument>:1:1: `spec`: expected a query, found 3
    error: <argument>:1:1: `spec`: expected a query: unknown top level operator: $foo
    error: <argument>:1:1: `spec`: expected `:`, found the end of the text
    error: <argument>:1:1: expected one body: `pipeline` or `builtin`
    error: <argument>:1:1: expected one body: `pipeline` or `builtin`
    error: <argument>:1:1: `builtin`: unknown builtin `nearst`; expected one of transform, nearest
    error: <argument>:1:1: `from` has no meaning for the body `nearest`
    error: <argument>:1:1: `pipeline`: expected an array of stages, found 3
    error: <argument>:1:1: `pipeline`: expected a pipeline: a computable gives documents and stores none itself; leave $out out
    error: <argument>:1:1: `position` has no meaning for the body `pipeline`
    error: <argument>:1:1: unknown key `prioritty`; did you mean `priority`?
    error: <argument>:1:1: `priority`: expected an integer, found "3"
    error: <argument>:1:1: `cache`: `3` is not a duration; expected a number and a unit, like 500ms, 2s, 1m or 1h
    error: <argument>:1:1: `cache`: expected a duration above zero; leave it out to compute for each query
    error: <argument>:1:1: `adds`: `_id`: `_id` says which document gets the keys, and cannot be added
    error: <argument>:1:1: `cache` has no meaning where keys are added: they are stored nowhere
    "#);
    let other = lab.rmem(&["computables", "add", "{_id: 3, name: 'a', collection: 'a.x', spec: {}, pipeline: []}"]);
    assert!(other.exits(3).stderr.contains("`_id`: it is kept under its name, `a`; leave `_id` out"));
    let one = "{name: 'a', collection: 'a.x', spec: {}, pipeline: []}";
    assert_run!(lab.rmem(&["computables", "add", one, one]), @r"
    ------- stderr -------
    error: two computables are called `a`: that of <argument 1>, and that of <argument 2>; rename one of them
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["computables", "add", "[]"]), @r"
    ------- stderr -------
    error: there is no computable to add; expected a [[computable]] table, or a document
    [exit code: 2]
    ");
    assert_eq!(lab.rmem(&["computables"]).success(), "");
}

#[test]
fn what_is_written_among_the_computables_is_one_or_is_refused() {
    let lab = lab();
    let place = "a.rmem.computables";
    lab.rmem(&["computables", "add", LOW]).success();
    lab.write("w.json", r#"{"a.rmem.computables": [{"_id": "low", "collection": "a.q"}], "a.ok": [{"_id": 1}]}"#);
    for (args, wrong) in [
        (&["insert", place, "{_id: 'x', collection: 'a.b', spec: {a: 1}, pipeline: 7}"][..], "found 7"),
        (&["insert", place, "{name: 'x', collection: 'a.b', spec: {a: 1}, pipeline: []}"], "it has no _id"),
        (&["update", place, "{_id: 'low'}", "{$set: {cache: 'never'}}"], "`never` is not a duration"),
        (&["update", place, "{_id: 'low'}", "{collection: 'a.x'}", "--replace"], "expected a `spec`"),
        (&["update", place, "{_id: 'other'}", "{$set: {cache: '2m'}}", "--upsert"], "expected the `collection`"),
        (&["find-and-modify", place, "{_id: 'low'}", "{$set: {spec: 5}}"], "`spec`: expected a query, found 5"),
        (&["aggregate", "a.x", "[{$out: 'rmem.computables'}]"], "a pipeline cannot write there"),
        (&["restore", "w.json"], "nothing was changed"),
    ] {
        let stderr = lab.rmem(args).exits(3).stderr;
        assert!(stderr.contains(wrong) && stderr.contains("a.rmem.computables"), "{stderr}");
    }
    lab.rmem(&["update", place, "{_id: 'low'}", "{$set: {cache: '2m'}}"]).success();
    assert!(lab.rmem(&["computables"]).success().contains(r#""cache":"120s""#));
}

#[test]
fn a_name_that_settings_and_memory_have_stops_the_queries_that_need_it() {
    let lab = lab();
    lab.rmem(&["computables", "add", LOW]).success();
    lab.rmem(&["insert", "a.other", "{_id: 1}"]).success();
    lab.write(
        "rmem.toml",
        "memory = 'file:robot.rmem'\n[[computable]]\nname = 'low'\ncollection = 'a.z'\nspec = '{z: 1}'\npipeline = '[]'\n",
    );
    let taken = "two computables are called `low`: that of ";
    for query in [["query", "a.x", "{relation: 'on-table'}"], ["count", "a.z", "{z: 1}"]] {
        let stderr = lab.rmem(&query).exits(3).stderr;
        assert!(stderr.contains(taken), "{stderr}");
    }
    assert_eq!(lab.rmem(&["query", "a.other"]).success(), "{\"_id\":1}\n");
    assert_eq!(lab.rmem(&["query", "a.x", "{relation: 'in'}"]).success(), "");
    let listed = lab.rmem(&["computables"]).exits(3);
    assert!(listed.stdout.lines().count() == 2 && listed.stderr.contains(taken), "{listed}");
    lab.rmem(&["computables", "remove", "low"]).success();
    assert_eq!(lab.rmem(&["count", "a.z", "{z: 1}"]).success(), "0\n");
}

#[test]
fn json_works_for_every_command_on_computables() {
    let lab = lab();
    let json = |words: &[&str]| {
        let printed = lab.rmem(&[&["--format", "json", "computables"], words].concat()).success();
        serde_json::from_str::<serde_json::Value>(&printed).unwrap()
    };
    assert_eq!(json(&[]), serde_json::json!([]));
    assert_eq!(json(&["add", LOW]), serde_json::json!(["low"]));
    assert_eq!((json(&[])[0]["name"].clone(), json(&["list"])), ("low".into(), json(&[])));
    let checked = serde_json::json!([{ "name": "low", "runs": true, "why": "the query matches the spec" }]);
    assert_eq!(json(&["--check", "a.x", "{relation: 'on-table'}"]), checked);
    assert_eq!(json(&["remove", "low"]), serde_json::json!(["low"]));
    let table = lab.rmem(&["computables", "--check", "a.x", "{}", "--format", "csv"]);
    assert_eq!((table.code, table.stdout.as_str()), (0, ""), "{table}");
}
