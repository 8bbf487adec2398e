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
    assert_run!(both, @r"
    ------- stderr -------
    error: two computables are called `height`: that of $LAB/rmem.toml:3, and that of a.rmem.computables; rename one of them, or take the one in the memory away: rmem computables remove height
    [exit code: 3]
    ");
    assert_eq!(lab.rmem(&["query", "a.y", "{height: 3}"]).exits(3).stdout, "");
    assert_run!(lab.rmem(&["computables", "add", "--file", "two.toml"]), @r"
    ------- stderr -------
    error: two computables are called `height`: that of $LAB/rmem.toml:3, and that of a.rmem.computables; rename one of them, or take the one in the memory away: rmem computables remove height
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
    // Nor is what another program wrote there.
    lab.rmem(&[
        "insert",
        "a.rmem.computables",
        "{_id: 'sum', collection: 'a.x', spec: '{}', command: ['touch', 'ran']}",
    ])
    .success();
    assert_run!(lab.rmem(&["query", "a.x", "{}"]), @r#"
    ------- stderr -------
    error: a.rmem.computables has a document with _id "sum" that is no computable: `command`: a program is declared in a settings file only: others write to the memory, and what they write must not run programs here; remove it: rmem computables remove sum
    [exit code: 3]
    "#);
    assert!(!lab.path().join("ran").exists());
    lab.rmem(&["computables", "remove", "sum"]).success();
    lab.rmem(&["insert", "a.rmem.computables", "{_id: 3}"]).success();
    assert_run!(lab.rmem(&["query", "a.x", "{}"]), @r"
    ------- stderr -------
    error: a.rmem.computables has a document with _id 3 that is no computable: `_id`: expected a string, found 3; remove it: rmem delete a.rmem.computables '{_id: 3}'
    [exit code: 3]
    ");
    lab.rmem(&["delete", "a.rmem.computables", "{_id: 3}"]).success();
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
