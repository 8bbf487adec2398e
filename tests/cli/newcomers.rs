//! What a newcomer types: lines of mongosh, misspelt keys, dictionaries of Python, batches with a mistake.

use serde_json::{Value, json};

use crate::lab::{Lab, assert_run, three_documents};

fn lab() -> Lab {
    let lab = Lab::new().env("RMEM_MEMORY", "file:m.rmem");
    lab.rmem(&[
        "insert",
        "-q",
        "robmem.orders",
        "{_id: 1, team: 'CYAN', rings: 2, pose: {x: 1.5}}",
        "{_id: 2, team: 'CYAN', rings: 0, pose: {x: 2}}",
        "{_id: 3, team: 'MAGENTA', rings: 2, tags: ['late']}",
    ])
    .success();
    lab
}

#[test]
fn a_line_of_mongosh_is_refused_with_the_command_for_it() {
    let lab = lab();
    assert_run!(lab.rmem(&["query", "db.orders.find({team:'CYAN'})"]), @r#"
    ------- stderr -------
    error: invalid value 'db.orders.find({team:'CYAN'})' for '<NS>': it is not a namespace: it has a `(`; expected DATABASE.COLLECTION, like robmem.worldmodel

      tip: write: rmem query robmem.orders "{team:'CYAN'}"

    For more information, try '--help'.
    [exit code: 2]
    "#);
    let tip = |words: &[&str], tip: &str| {
        let refused = lab.rmem(words).exits(2);
        assert!(refused.stderr.contains(tip), "{words:?}: {refused}");
    };
    tip(&["db.orders.find({team:'CYAN'})"], "tip: write: rmem query robmem.orders \"{team:'CYAN'}\"");
    tip(&["insert", "db.orders.insertOne({n: 1})", "{}"], "write: rmem insert robmem.orders \"{n: 1}\"");
    tip(&["update", "db.orders.updateMany({}, {$set: {n: 1}})", "{}", "{}"], "'{$set: {n: 1}}' --many");
    tip(&["drop", "db.orders.drop()"], "write: rmem drop robmem.orders");
    tip(&["robmem.orders"], "tip: 'rmem query robmem.orders' prints its documents");
    tip(&["export", "robmem.orders"], "'rmem dump robmem.orders -o FILE.json'");
    tip(&["query", "robmem.my orders"], "it has a blank");
    assert_eq!(lab.rmem(&["collections"]).success(), "robmem.orders\n", "nothing was made of it");
    // The command that is named does it.
    let named = lab.shell("rmem query robmem.orders \"{team:'CYAN'}\" --fields '{_id: 1}'").success();
    assert_eq!(named, "{\"_id\":1}\n{\"_id\":2}\n");
    lab.write("rmem.toml", "collection = \"my orders.x\"\n");
    let refused = lab.rmem(&["config"]).exits(3);
    assert!(refused.stderr.contains("rmem.toml:1:14: ") && refused.stderr.contains("it has a blank"), "{refused}");
}

#[test]
fn a_collection_of_that_name_in_another_database_is_named() {
    let lab = lab();
    let found = lab.rmem(&["query", "factory.orders"]).exits(0);
    assert!(found.stderr.contains("no collection factory.orders; did you mean robmem.orders?"), "{found}");
}

#[test]
fn why_says_which_condition_no_document_meets() {
    let lab = lab();
    let why = |query: &str| lab.rmem(&["query", "robmem.orders", query, "--why"]);
    assert_run!(why("{team: 'CYAN', rings: '2', 'pose.y': {$gt: 0}}"), @r#"
    robmem.orders: 3 documents, 0 match
      alone  together  condition
          2         2  {"team":"CYAN"}
          0         0  {"rings":"2"}
                       rings is a number in all 3 documents; you compare with a string
                       {rings: 2} matches 2 documents
          0         0  {"pose.y":{"$gt":0}}
                       no document has the key `pose.y`; 2 have `pose.x`
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(why("{team: 3, tags: {$in: ['Late']}, ring: 2, x: 1.5}"), @r#"
    robmem.orders: 3 documents, 0 match
      alone  together  condition
          0         0  {"team":3}
                       team is a string in all 3 documents; you compare with a number
          0         0  {"tags":{"$in":["Late"]}}
                       {tags: "late"} matches 1 document
          0         0  {"ring":2}
                       no document has the key `ring`; 3 have `rings`
          0         0  {"x":1.5}
                       no document has the key `x`; 2 have `pose.x`
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(why("{team: 'MAGENTA', rings: {$gte: 0, $lt: 2}}"), @r#"
    robmem.orders: 3 documents, 0 match
      alone  together  condition
          1         1  {"team":"MAGENTA"}
          3         1  {"rings":{"$gte":0}}
          1         0  {"rings":{"$lt":2}}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(why("{$or: [{team: 'CYANN'}, {rings: true}]}"), @r#"
    robmem.orders: 3 documents, 0 match
      alone  together  condition
          0         0  {"$or":[{"team":"CYANN"},{"rings":true}]}
                       {team: "CYAN"} matches 2 documents
                       rings is a number in all 3 documents; you compare with true or false
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(why("{}"), @r"
    robmem.orders: 3 documents, 3 match
    ------- stderr -------
    [exit code: 0]
    ");
    let json: Value = serde_json::from_str(
        &lab.rmem(&["query", "robmem.orders", "{ring: 2}", "--why", "--format", "jsonl"]).success(),
    )
    .unwrap();
    assert_eq!(
        json["conditions"],
        json!([{"query": {"ring": 2}, "alone": 0, "together": 0,
            "remarks": ["no document has the key `ring`; 3 have `rings`"]}])
    );
    let wrong = why("{team: {$wrong: 1}}").exits(3);
    assert!(wrong.stderr.contains("<query>:1:9"), "{wrong}");
    let missing = lab.rmem(&["query", "robmem.order", "{a: 1}", "--why"]).exits(0);
    assert!(missing.stderr.contains("did you mean robmem.orders?"), "{missing}");
}

#[test]
fn a_section_that_matches_nothing_says_why() {
    let lab = lab();
    lab.write(
        "t.j2",
        "{% for o in query('robmem.orders', {'team': 'CYAN'}) %}{{ o.team }} {% endfor %}\n\
         {% for o in query('robmem.orders', {'rings': '2', 'team': 'CYAN'}) %}{{ o.team }}{% endfor %}\n\
         {% for o in query('robmem.order') %}{{ o.team }}{% endfor %}{{ count('robmem.odrers') }}\n",
    );
    assert_run!(lab.rmem(&["gen-problem", "-t", "t.j2"]), @r#"
    CYAN CYAN 

    0
    ------- stderr -------
    warning: line 2: query('robmem.orders', {'rings': '2', 'team': 'CYAN'}) in robmem.orders: 0 documents
      robmem.orders: 3 documents, 0 match
        alone  together  condition
            0         0  {"rings":"2"}
                         rings is a number in all 3 documents; you compare with a string
                         {rings: 2} matches 2 documents
            2         0  {"team":"CYAN"}
    warning: line 3: query('robmem.order') in robmem.order: 0 documents
      no collection robmem.order; did you mean robmem.orders?
    warning: no collection robmem.odrers; did you mean robmem.orders?
    [exit code: 0]
    "#);
    let verbose = lab.rmem(&["-v", "gen-problem", "-t", "t.j2"]).exits(0);
    assert!(
        verbose.stderr.starts_with("line 1: query('robmem.orders', {'team': 'CYAN'}) in robmem.orders: 2 documents\n"),
        "{verbose}"
    );
    assert_eq!(lab.rmem(&["-q", "gen-problem", "-t", "t.j2"]).exits(0).stderr, "");
    lab.rmem(&["gen-problem", "-t", "t.j2", "--strict"]).exits(3);
    lab.write("t.tmpl", "<<#O|{rings: '2'}>><<team>><</O>>\n<<#P||[{$match: {ring: 2}}]>><<team>><</P>>\n");
    let marker = lab.rmem(&["--collection", "robmem.orders", "gen-problem", "-t", "t.tmpl"]).exits(0);
    for words in [
        "rings is a number in all 3 documents; you compare with a string",
        "no document has the key `ring`; 3 have `rings`",
    ] {
        assert!(marker.stderr.contains(words), "{marker}");
    }
}

#[test]
fn a_section_that_matches_nothing_for_no_mistake_is_one_line() {
    let lab = lab();
    lab.write("t.tmpl", "<<#O|{team: 'BLACK-AND-WHITE'}>><<team>><</O>>\n");
    let empty = lab.rmem(&["--collection", "robmem.orders", "gen-problem", "-t", "t.tmpl"]).exits(0);
    assert_eq!(empty.stderr, "warning: line 1: O in robmem.orders: 0 documents\n");
    let documents: Vec<String> = (0..10_001).map(|number| format!("{{n: {number}}}\n")).collect();
    lab.rmem_with(&["insert", "-q", "robmem.many", "-"], &documents.concat()).success();
    lab.write("t.tmpl", "<<#O|{m: 1}>><<n>><</O>>\n");
    let many = ["--collection", "robmem.many", "gen-problem", "-t", "t.tmpl"];
    let hint = "  rmem query robmem.many '{\"m\":1}' --why says why\n";
    assert!(lab.rmem(&many).exits(0).stderr.ends_with(hint), "a plan is not to wait for it");
    let verbose = lab.rmem(&[&many[..], &["-v"]].concat()).exits(0);
    assert!(verbose.stderr.contains("no document has the key `m`; there are _id, n"), "{verbose}");
}

#[test]
fn a_batch_with_a_mistake_says_the_reason_first_and_then_what_was_stored() {
    let lab = lab();
    assert_run!(lab.rmem(&["insert", "robmem.batch", "{_id: 1}", "{_id: 2}", "{_id: 1}", "{_id: 4}"]), @r"
    1
    2
    ------- stderr -------
    error: <argument 3>:1:1: robmem.batch already has a document with _id: 1
      |
    1 | {_id: 1}
      | ^
      2 documents were stored before it
    [exit code: 5]
    ");
    lab.write("b.jsonl", "{_id: 11}\n{_id: 12}\n{_id: 13, seen: True}\n{_id: 14}\n");
    assert_run!(lab.rmem(&["insert", "robmem.batch", "--file", "b.jsonl"]), @r"
    11
    12
    ------- stderr -------
    error: b.jsonl:3:17: expected a value, found `True`
      |
    3 | {_id: 13, seen: True}
      |                 ^^^^
      = hint: Python's True is written true
      2 documents were stored before it
    [exit code: 3]
    ");
    let first = lab.rmem(&["insert", "robmem.batch", "{_id: 1}"]).exits(5);
    assert!(!first.stderr.contains("before it"), "{first}");
    lab.write("c.jsonl", "{_id: 21}\n{_id: 22}\nnonsense\n");
    let ids = lab.rmem(&["insert", "robmem.batch", "--file", "c.jsonl", "--format", "json"]).exits(3);
    assert_eq!(serde_json::from_str::<Value>(&ids.stdout).unwrap(), json!([21, 22]));
    assert_eq!(lab.rmem(&["count", "robmem.batch"]).success(), "6\n");
}

#[test]
fn a_listing_of_facts_is_imported() {
    let lab = lab();
    let listing = "f-1     (block (name A))\nf-2     (holding B)\nFor a total of 2 facts.\n";
    let imported = lab.rmem_with(&["clips", "import", "--into", "robmem.facts"], listing);
    assert_eq!(imported.success(), "{\"inserted\":2,\"replaced\":0,\"unchanged\":0}\n");
    let blocks = lab.rmem(&["query", "robmem.facts", "{relation: 'block'}", "--fields", "{_id: 0, name: 1}"]);
    assert_eq!(blocks.success(), "{\"name\":\"A\"}\n");
}

#[test]
fn why_explains_documents_inside_documents() {
    let lab = Lab::new();
    let poses = ["{pose: {x: 1, y: 2}}", "{pose: {x: 1, y: 3}}", "{pose: [1, 2]}", "{name: 'cup'}"];
    lab.rmem(&[&["insert", "robmem.things"], &poses[..]].concat()).success();
    let why = |query: &str| lab.rmem(&["query", "robmem.things", query, "--why"]);
    assert_run!(why("{pose: {x: 1}}"), @r#"
    robmem.things: 4 documents, 0 match
      alone  together  condition
          0         0  {"pose":{"x":1}}
                       pose is compared as a whole, with all its keys in their order; {'pose.x': 1} matches 2 documents
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(why("{pose: {x: '1'}}"), @r#"
    robmem.things: 4 documents, 0 match
      alone  together  condition
          0         0  {"pose":{"x":"1"}}
                       pose.x is a number in all 2 documents; you compare with a string
                       {'pose.x': 1} matches 2 documents
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(why("{'pose.x': '1'}"), @r#"
    robmem.things: 4 documents, 0 match
      alone  together  condition
          0         0  {"pose.x":"1"}
                       pose.x is a number in all 2 documents; you compare with a string
                       {'pose.x': 1} matches 2 documents
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(why("{'pose.orientation': 1}"), @r#"
    robmem.things: 4 documents, 0 match
      alone  together  condition
          0         0  {"pose.orientation":1}
                       no document has the key `pose.orientation`; pose is a document in 2 documents, an array in 1 document, with the keys x, y
    ------- stderr -------
    [exit code: 0]
    "#);
}

#[test]
fn what_is_drawn_or_exported_of_no_collection_names_the_nearest_one() {
    let lab = three_documents();
    assert_run!(lab.rmem(&["plot", "robmem.worldmodl", "--x", "n", "--y", "n", "-o", "a.svg"]), @r"
    ------- stderr -------
    error: no collection robmem.worldmodl; did you mean robmem.worldmodel?
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["export", "mcap", "robmem.worldmodl", "--time", "at", "-o", "a.mcap"]), @r"
    ------- stderr -------
    error: no collection robmem.worldmodl; did you mean robmem.worldmodel?
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["clips", "export", "robmem.worldmodl"]), @r"
    ------- stderr -------
    warning: no collection robmem.worldmodl; did you mean robmem.worldmodel?
    0 facts
    [exit code: 0]
    ");
}

#[test]
fn habits_of_mongosh_are_answered() {
    let lab = three_documents();
    for line in [
        "rmem query db.orders.find",
        "rmem show collections",
        "rmem 'show dbs'",
        "rmem use robmem",
        "rmem 'use robmem'",
    ] {
        let run = lab.shell(line);
        let tip =
            run.stderr.lines().find(|line| line.contains("write: ") || line.contains("tip: ")).unwrap_or_default();
        assert!(tip.contains("rmem collections") || tip.contains("rmem query robmem."), "{line}: {run}");
    }
    let line = "rmem \"db['worldmodel'].findOneAndUpdate({n: 3}, {\\$set: {n: 4}})\"";
    assert!(
        lab.shell(line).stderr.contains("rmem find-and-modify robmem.worldmodel \"{n: 3}\" "),
        "{}",
        lab.shell(line)
    );
}

#[test]
fn messages_say_what_to_do_in_plain_words() {
    let lab = three_documents();
    assert_run!(lab.rmem(&["query", "robmem.worldmodel", "--fields", "object,n"]), @r"
    ------- stderr -------
    error: <fields>:1:1: expected a value, found `object`
      |
    1 | object,n
      | ^^^^^^
      = hint: write --fields '{object: 1, n: 1}'
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["count", "robmem.worldmodel", "{at: ISODate('2024-13-01')}"]), @r"
    ------- stderr -------
    error: <query>:1:6: the month 13 of `2024-13-01` is not from 01 to 12
      |
    1 | {at: ISODate('2024-13-01')}
      |      ^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    ");
    let wrong =
        |date: &str| lab.rmem(&["count", "robmem.worldmodel", &format!("{{at: ISODate('{date}')}}")]).exits(3).stderr;
    assert!(wrong("2023-02-29").contains("the day 29 of `2023-02-29` is not from 01 to 28"), "{}", wrong("2023-02-29"));
    assert!(wrong("2023-02-28T12:61:00Z").contains("the minute 61 of "), "{}", wrong("2023-02-28T12:61:00Z"));
    assert!(wrong("tomorrow").contains("takes an ISO 8601 string"), "{}", wrong("tomorrow"));
    for command in [
        &["validate", "gone.pddl"][..],
        &["restore", "gone"],
        &["query", "a.b", "--load", "gone.json"],
        &["diff", "gone", "gone"],
    ] {
        let run = lab.rmem(command);
        assert!(run.stderr.contains("there is no such file or folder") && !run.stderr.contains("os error"), "{run}");
    }
}

#[test]
fn an_argument_of_mongosh_has_a_tip() {
    let lab = Lab::new();
    for (args, tip) in [
        (&["query", "a.b", "{}", "{name: 1}"][..], "tip: write: --fields \"{name: 1}\""),
        (&["update", "a.b", "{}", "{}", "{upsert: true, multi: true}"], "tip: write: --upsert --many"),
        (&["query", "a.b", "--projection", "{a: 1}"], "tip: '--fields PROJECTION' selects fields"),
        (&["query", "a.b", "--limit", "-1"], "tip: all documents are printed without '--limit'"),
        (&["query", "a.b", "--db", "x"], "tip: a collection is named with its database"),
    ] {
        let run = lab.rmem(args).exits(2);
        assert!(run.stderr.contains(tip), "{run}");
    }
}

#[test]
fn a_method_of_mongosh_without_a_command_of_its_own_has_a_tip() {
    let lab = three_documents();
    let commands = [
        ["query", "db.orders.bulkWrite([{insertOne: {document: {a: 1}}}])"],
        ["--collection=shop.orders", "db.orders.find({a: 1})"],
        ["query", "db.dropDatabase()"],
    ];
    assert_run!(lab.transcript(&commands.each_ref().map(|args| &args[..])), @r#"
    $ rmem query 'db.orders.bulkWrite([{insertOne: {document: {a: 1}}}])'
    ------- stderr -------
    error: invalid value 'db.orders.bulkWrite([{insertOne: {document: {a: 1}}}])' for '<NS>': it is not a namespace: it has a `(`; expected DATABASE.COLLECTION, like robmem.worldmodel

      tip: 'rmem insert robmem.orders DOC…', 'rmem update robmem.orders QUERY UPDATE' and 'rmem delete robmem.orders QUERY' write one kind of change each

    For more information, try '--help'.
    [exit code: 2]
    $ rmem --collection=shop.orders 'db.orders.find({a: 1})'
    ------- stderr -------
    error: unrecognized subcommand 'db.orders.find({a: 1})'

      tip: write: rmem query shop.orders "{a: 1}"

    Usage: rmem [OPTIONS] <COMMAND>

    For more information, try '--help'.
    [exit code: 2]
    $ rmem query 'db.dropDatabase()'
    ------- stderr -------
    error: invalid value 'db.dropDatabase()' for '<NS>': it is not a namespace: it has a `(`; expected DATABASE.COLLECTION, like robmem.worldmodel

      tip: 'rmem drop --database robmem' removes all collections of robmem, and 'rmem drop NS' one of them

    For more information, try '--help'.
    [exit code: 2]
    "#);
    lab.write("rmem.toml", "collection = \"lab.world\"\n");
    assert!(lab.rmem(&["query", "db.world.stats()"]).exits(2).stderr.contains("rmem schema lab.world"));
    assert!(lab.rmem(&["bulkWrite"]).exits(2).stderr.contains("rmem insert"));
    assert!(lab.rmem(&["dropDatabase"]).exits(2).stderr.contains("'rmem drop --database lab'"));
    let bare = lab.rmem(&["query", "db.world.find"]).exits(0);
    assert!(bare.stderr.contains("no collection db.world.find; write: rmem query lab.world"), "{bare}");
    let counted = lab.rmem(&["count", "db.world.count", "--collection", "shop.x"]).exits(0);
    assert!(counted.stderr.contains("write: rmem count shop.world"), "{counted}");
    assert!(lab.rmem(&["export", "lab"]).exits(2).stderr.contains("'rmem dump lab.COLLECTION -o FILE.json'"));
}

#[test]
fn mistakes_in_arguments_are_shown_at_their_places() {
    let lab = three_documents();
    let commands: [&[&str]; 11] = [
        &["query", "robmem.worldmodel", "--sort", "name"],
        &["query", "robmem.worldmodel", "--sort", "n,-at.x"],
        &["query", "robmem.worldmodel", "--fields", "name,-_id"],
        &["find-and-modify", "robmem.worldmodel", "{}", "{$set: {n: 2}}", "--sort", "n,at.x"],
        &["index", "robmem.worldmodel", "name"],
        &["query", "robmem.worldmodel", "{}", "--sort", "{n: 1, name: 5}"],
        &["update", "robmem.worldmodel", "{}", "{$set: {_id: 'x'}}"],
        &["query", "robmem.worldmodel", "{n: 1, name: /x(/}"],
        &["count", "robmem.worldmodel", "{n: 1, name: {$regex: '['}}"],
        &["update", "robmem.worldmodel", "{name: /(/}", "{$set: {n: 1}}"],
        &["aggregate", "robmem.worldmodel", "[{$match: {n: 1, name: /(/}}]"],
    ];
    assert_run!(lab.transcript(&commands), @r#"
    $ rmem query robmem.worldmodel --sort name
    ------- stderr -------
    error: <sort>:1:1: expected a value, found `name`
      |
    1 | name
      | ^^^^
      = hint: write --sort '{name: 1}'
    [exit code: 3]
    $ rmem query robmem.worldmodel --sort n,-at.x
    ------- stderr -------
    error: <sort>:1:1: expected a value, found `n`
      |
    1 | n,-at.x
      | ^
      = hint: write --sort '{n: 1, "at.x": -1}'
    [exit code: 3]
    $ rmem query robmem.worldmodel --fields name,-_id
    ------- stderr -------
    error: <fields>:1:1: expected a value, found `name`
      |
    1 | name,-_id
      | ^^^^
      = hint: write --fields '{name: 1, _id: 0}'
    [exit code: 3]
    $ rmem find-and-modify robmem.worldmodel '{}' '{$set: {n: 2}}' --sort n,at.x
    ------- stderr -------
    error: <sort>:1:1: expected a value, found `n`
      |
    1 | n,at.x
      | ^
      = hint: write --sort '{n: 1, "at.x": 1}'
    [exit code: 3]
    $ rmem index robmem.worldmodel name
    ------- stderr -------
    error: <keys>:1:1: expected a value, found `name`
      |
    1 | name
      | ^^^^
      = hint: write '{name: 1}'
    [exit code: 3]
    $ rmem query robmem.worldmodel '{}' --sort '{n: 1, name: 5}'
    ------- stderr -------
    error: <sort>:1:8: a sort direction must be 1 or -1
      |
    1 | {n: 1, name: 5}
      |        ^^^^
    [exit code: 3]
    $ rmem update robmem.worldmodel '{}' "{\$set: {_id: 'x'}}"
    ------- stderr -------
    error: <update>:1:9: the (immutable) field '_id' was found to have been altered
      |
    1 | {$set: {_id: 'x'}}
      |         ^^^
    [exit code: 3]
    $ rmem query robmem.worldmodel '{n: 1, name: /x(/}'
    ------- stderr -------
    error: <query>:1:14: regular expression is invalid: PCRE2: error compiling pattern at offset 2: missing closing parenthesis
      |
    1 | {n: 1, name: /x(/}
      |              ^^^^
    [exit code: 3]
    $ rmem count robmem.worldmodel "{n: 1, name: {\$regex: '['}}"
    ------- stderr -------
    error: <query>:1:23: regular expression is invalid: PCRE2: error compiling pattern at offset 1: missing terminating ] for character class
      |
    1 | {n: 1, name: {$regex: '['}}
      |                       ^^^
    [exit code: 3]
    $ rmem update robmem.worldmodel '{name: /(/}' '{$set: {n: 1}}'
    ------- stderr -------
    error: <query>:1:8: regular expression is invalid: PCRE2: error compiling pattern at offset 1: missing closing parenthesis
      |
    1 | {name: /(/}
      |        ^^^
    [exit code: 3]
    $ rmem aggregate robmem.worldmodel '[{$match: {n: 1, name: /(/}}]'
    ------- stderr -------
    error: <pipeline>:1:24: regular expression is invalid: PCRE2: error compiling pattern at offset 1: missing closing parenthesis
      |
    1 | [{$match: {n: 1, name: /(/}}]
      |                        ^^^
    [exit code: 3]
    "#);
}

#[test]
fn a_name_of_several_words_in_a_goal_is_written_in_quotes() {
    let lab = Lab::new();
    lab.write(
        "d.pddl",
        "(define (domain d) (:predicates (on ?a ?b)) (:action put :parameters (?a ?b) :effect (on ?a ?b)))",
    );
    lab.write(
        "t.j2",
        "(define (problem p) (:domain d)\n  (:objects {{ 'box #18' }} table)\n  (:init)\n  (:goal {{ goal }}))",
    );
    let run = |goal: &str| lab.rmem(&["gen-problem", "-t", "t.j2", "-d", "d.pddl", "--goal", goal]);
    run("(on \"box #18\" table)").success();
    assert_run!(run("(on box #18 table)"), @r#"
    ------- stderr -------
    error: t.j2:4:10: predicate `on` takes 2 arguments, found 3
      |
    4 |   (:goal {{ goal }}))
      |          ^^^^^^^^^^
      = hint: it is declared as (on ?a - object ?b - object)
      = hint: the goal is (on box #18 table)
      = hint: a name of several words is written in quotes: "box #18"
      = hint: it became line 4 of the problem: (:goal (on box #18 table)))
    error: t.j2:4:10: object `box` is not declared
      |
    4 |   (:goal {{ goal }}))
      |          ^^^^^^^^^^
      = hint: the goal is (on box #18 table)
      = hint: a name of several words is written in quotes: "box #18"
      = hint: it became line 4 of the problem: (:goal (on box #18 table)))
    error: t.j2:4:10: object `#18` is not declared
      |
    4 |   (:goal {{ goal }}))
      |          ^^^^^^^^^^
      = hint: the goal is (on box #18 table)
      = hint: a name of several words is written in quotes: "box #18"
      = hint: it became line 4 of the problem: (:goal (on box #18 table)))
    [exit code: 3]
    "#);
}

#[test]
fn a_taken_key_says_which_document_of_the_file_and_which_of_the_memory() {
    let lab = Lab::new();
    lab.rmem(&["index", "a.b", "{name: 1}", "--unique"]).success();
    lab.rmem(&["insert", "a.b", "{_id: 7, name: 'A'}"]).success();
    lab.write("f.jsonl", "{_id: 1, name: 'B'}\n\n{_id: 2, name: 'A'}\n");
    lab.write("f.csv", "_id,name\n3,C\n4,A\n");
    lab.write("f.clp", "(machine (name D))\n(machine (name A))\n");
    lab.write("w.json", "{'a.b': [{_id: 9, name: 'A'}]}");
    lab.write("g.clp", "(machine (name E))\n(machine (name F) (tags x y))\n");
    lab.write("h.clp", "\n(machine (name E) (n 1))\n");
    let commands: [&[&str]; 7] = [
        &["insert", "a.b", "--file", "f.jsonl"],
        &["insert", "a.b", "--file", "f.csv"],
        &["insert", "a.b", "{_id: 5, name: 'A'}"],
        &["clips", "import", "f.clp", "--into", "a.b"],
        &["clips", "import", "g.clp", "h.clp", "--into", "a.b"],
        &["clips", "import", "g.clp", "h.clp", "--into", "a.b", "--key", "name"],
        &["restore", "w.json"],
    ];
    assert_run!(lab.transcript(&commands), @r#"
    $ rmem insert a.b --file f.jsonl
    1
    ------- stderr -------
    error: f.jsonl:3:1: a.b already has a document with name: "A" (unique index name_1): that with _id 7
      |
    3 | {_id: 2, name: 'A'}
      | ^
      1 document was stored before it
    [exit code: 5]
    $ rmem insert a.b --file f.csv
    3
    ------- stderr -------
    error: f.csv:3:1: a.b already has a document with name: "A" (unique index name_1): that with _id 7
      |
    3 | 4,A
      | ^
      1 document was stored before it
    [exit code: 5]
    $ rmem insert a.b "{_id: 5, name: 'A'}"
    ------- stderr -------
    error: a.b already has a document with name: "A" (unique index name_1): that with _id 7
    [exit code: 5]
    $ rmem clips import f.clp --into a.b
    ------- stderr -------
    error: f.clp:2:1: a.b already has a document with name: "A" (unique index name_1): that with _id 7; nothing was imported
    [exit code: 5]
    $ rmem clips import g.clp h.clp --into a.b
    ------- stderr -------
    error: h.clp:2:1: the fact at g.clp:1:1 has the same name: "E" (unique index name_1); nothing was imported
    [exit code: 5]
    $ rmem clips import g.clp h.clp --into a.b --key name
    ------- stderr -------
    error: h.clp:2:1: another fact has the key `name` "E"
      |
    2 | (machine (name E) (n 1))
      | ^^^^^^^^^^^^^^^^^^^^^^^^
      = hint: the other fact is at g.clp:1:1
    [exit code: 3]
    $ rmem restore w.json
    ------- stderr -------
    error: cannot restore a.b; nothing was changed: a.b already has a document with name: "A" (unique index name_1): that with _id 7
    [exit code: 5]
    "#);
    assert_eq!(lab.rmem(&["count", "a.b"]).success(), "3\n");
}

#[test]
fn what_restore_does_not_read_has_the_command_that_does() {
    let lab = Lab::new();
    lab.write("f.jsonl", "{name: 'B'}\n{name: 'C'}\n");
    lab.write("f.clp", "(machine (name A))\n");
    lab.write("w.json", "{'a.b': [{x: }]}");
    for (file, hint) in [
        ("f.jsonl", Some("`rmem insert NS --file f.jsonl`")),
        ("f.clp", Some("`rmem clips import f.clp`")),
        ("w.json", None),
    ] {
        let run = lab.rmem(&["restore", file]).exits(3);
        assert!(hint.is_none_or(|hint| run.stderr.contains(hint)), "{run}");
        assert_eq!(run.stderr.contains("`rmem "), hint.is_some(), "{run}");
    }
    assert!(lab.rmem_with(&["restore", "-"], "{a: 1}").exits(3).stderr.contains("rmem insert NS --file -"));
}

#[test]
fn misspelt_operators_and_options_of_other_tools_have_a_hint() {
    let lab = three_documents();
    for (args, code, hint) in [
        (&["query", "robmem.worldmodel", "{name: {$exits: true}}"][..], 3, "= hint: did you mean `$exists`?"),
        (&["query", "robmem.worldmodel", "{$orr: [{n: 1}]}"], 3, "= hint: did you mean `$or`?"),
        (&["update", "robmem.worldmodel", "{}", "{'$sett': {n: 1}}"], 3, "= hint: did you mean `$set`?"),
        (&["aggregate", "robmem.worldmodel", "[{$mach: {n: 1}}]"], 3, "= hint: did you mean `$match`?"),
        (&["count", "robmem.worldmodel", "--query", "{}"], 2, "tip: the query stands behind the collection"),
        (&["query", "robmem.worldmodel", "-n", "3"], 2, "tip: '--limit N'"),
        (&["plan", "--explain", "(on A B)"], 2, "tip: 'rmem gen-problem --explain ATOM'"),
    ] {
        let run = lab.rmem(args).exits(code);
        assert!(run.stderr.contains(hint), "{run}");
    }
    let unknown = lab.rmem(&["query", "robmem.worldmodel", "{name: {$dance: true}}"]).exits(3);
    assert!(!unknown.stderr.contains("did you mean"), "{unknown}");
}

#[test]
fn slips_in_expressions_of_templates_have_a_hint() {
    let lab = three_documents();
    for (expression, hint) in [
        ("query('robmem.worldmodel').name", "take its first document with find_one(…), or loop over it"),
        ("query('robmem.worldmodel' '{}')", "a comma is missing between the arguments"),
        ("find_one('robmem.worldmodel')[name]", "a key is written in quotes, find_one('robmem.worldmodel')[\"name\"]"),
    ] {
        lab.write(
            "t.j2",
            &format!("(define (problem p) (:domain d) (:init (a {{{{ {expression} }}}})) (:goal (and)))"),
        );
        let run = lab.rmem(&["gen-problem", "--template", "t.j2"]).exits(3);
        assert!(run.stderr.contains(hint), "{run}");
    }
}

#[test]
fn what_stands_in_the_place_of_an_option_has_a_tip() {
    let lab = lab();
    let run = lab.rmem(&["gen-problem", "problem.pddl.j2", "--domain", "d.pddl"]).exits(2);
    assert!(run.stderr.contains("tip: write: --template problem.pddl.j2"), "{run}");
    lab.write("facts.txt", "(a 1)");
    let run = lab.rmem(&["clips", "import", "lab.facts", "facts.txt"]).exits(2);
    assert!(run.stderr.contains("rmem clips import facts.txt --into lab.facts"), "{run}");
    let run = lab.rmem(&["clips", "import", "facts.txt", "lab.facts"]).exits(2);
    assert!(run.stderr.contains("rmem clips import facts.txt --into lab.facts"), "{run}");
    lab.write("named.txt", "(box (name a))");
    let run = lab.rmem(&["clips", "import", "named.txt", "--key", "names"]).exits(3);
    assert!(run.stderr.contains("= hint: did you mean `name`?"), "{run}");
    lab.write("types.clp", "(deftemplate box (slot name))");
    let run = lab.rmem(&["clips", "import", "types.clp"]).exits(0);
    assert!(run.stderr.contains("there are no facts to import: deftemplates say which slots facts have"), "{run}");
    let run = lab.rmem(&["update", "robmem.orders", "{}", "{$set: {n: 1}}", "--all"]).exits(2);
    assert!(run.stderr.contains("tip: '--many' changes all documents") && !run.stderr.contains("-- --all"), "{run}");
    let run = lab.rmem(&["update", "robmem.orders", "{_id: 1}", "{$push: {team: 'X'}}"]).exits(3);
    assert!(run.stderr.contains("$push needs an array, not string, in the field `team`"), "{run}");
    let run = lab.rmem(&["query", "robmem.orders", "{rings: {gt: 1}}", "--why"]).exits(0);
    assert!(run.stdout.contains("did you mean {rings: {$gt: 1}}? It matches 2 documents"), "{run}");
    lab.write("lab.facts", "(b 1)");
    lab.rmem(&["clips", "import", "lab.facts", "facts.txt"]).exits(0);
}

#[test]
fn a_command_without_its_subcommand_prints_its_help_and_no_error() {
    let lab = lab();
    for command in [&[][..], &["clips"], &["export"]] {
        let run = lab.rmem(command).exits(2);
        assert!(run.stdout.is_empty() && run.stderr.contains("Usage: rmem") && !run.stderr.contains("error:"), "{run}");
    }
}

#[test]
fn files_behind_plan_have_a_tip() {
    let lab = lab();
    assert_run!(lab.transcript(&[&["plan", "domain.pddl", "problem.pddl"], &["plan", "domain.pddl", "my problem.pddl.j2"], &["plan", "-d", "domain.pddl", "my problem.pddl"], &["plan", "--domain=domain.pddl", "p.pddl.j2"]]), @r#"
    $ rmem plan domain.pddl problem.pddl
    ------- stderr -------
    error: unrecognized subcommand 'domain.pddl'

      tip: write: rmem plan --domain domain.pddl --problem FILE, or --template FILE for one with queries

    Usage: rmem plan [OPTIONS] --domain <FILE> <--problem <FILE>|--template <FILE>>
           rmem plan [OPTIONS] <COMMAND>

    For more information, try '--help'.
    [exit code: 2]
    $ rmem plan domain.pddl 'my problem.pddl.j2'
    ------- stderr -------
    error: unrecognized subcommand 'domain.pddl'

      tip: write: rmem plan --domain domain.pddl --problem FILE, or --template FILE for one with queries

    Usage: rmem plan [OPTIONS] --domain <FILE> <--problem <FILE>|--template <FILE>>
           rmem plan [OPTIONS] <COMMAND>

    For more information, try '--help'.
    [exit code: 2]
    $ rmem plan -d domain.pddl 'my problem.pddl'
    ------- stderr -------
    error: unrecognized subcommand 'my problem.pddl'

      tip: write: --problem "my problem.pddl"

    Usage: rmem plan [OPTIONS] --domain <FILE> <--problem <FILE>|--template <FILE>>
           rmem plan [OPTIONS] <COMMAND>

    For more information, try '--help'.
    [exit code: 2]
    $ rmem plan --domain=domain.pddl p.pddl.j2
    ------- stderr -------
    error: unrecognized subcommand 'p.pddl.j2'

      tip: write: --template p.pddl.j2

    Usage: rmem plan [OPTIONS] --domain <FILE> <--problem <FILE>|--template <FILE>>
           rmem plan [OPTIONS] <COMMAND>

    For more information, try '--help'.
    [exit code: 2]
    "#);
}

#[test]
fn a_world_file_that_is_inserted_is_a_warning() {
    let lab = lab();
    lab.write("world.json", "{\"a.b\": [{\"_id\": 1}, {\"_id\": 2}]}");
    let stored = lab.rmem(&["insert", "c.d", "--file", "world.json"]).exits(0);
    assert!(stored.stderr.contains("`rmem restore FILE` stores the documents of a world file"), "{stored}");
    for document in ["{'a.b': []}", "{'a.b': [1]}", "{a: [{b: 1}]}", "{}", "{'a.b': [{}], c: 1}"] {
        let stored = lab.rmem(&["insert", "c.d", document]).exits(0);
        assert!(!stored.stderr.contains("restore"), "{document}: {stored}");
    }
}

#[test]
fn a_picture_of_another_format_is_refused() {
    let lab = lab();
    let refused = lab.rmem(&["plot", "c.d", "--x", "a", "--y", "b", "-o", "x.jpg"]).exits(2);
    assert!(refused.stderr.contains("expected a name that ends in .svg or .png"), "{refused}");
    let refused = lab.rmem(&["scene", "show", "-o", "x.jpg"]).exits(2);
    assert!(refused.stderr.contains("expected a name that ends in .svg or .png"), "{refused}");
}

#[test]
fn a_goal_with_names_in_single_quotes_gets_a_hint() {
    let lab = Lab::new();
    let task = ["gen-problem", "-t", "templates/blocksworld/problem.pddl.j2", "-d", "domains/blocksworld/domain.pddl"];
    let goal = ["--load", "fixtures/blocksworld.json", "--goal", "(on 'box 1' 'A')"];
    let refused = lab.rmem(&[&task[..], &goal].concat()).exits(3);
    assert!(refused.stderr.contains("names of several words are written in double quotes"), "{refused}");
    // Each name is wrong in the same way, which is said once.
    let goal = ["--load", "fixtures/blocksworld.json", "--goal", "(and (on 'X' 'Y') (on 'Y' 'Z'))"];
    let refused = lab.rmem(&[&task[..], &goal].concat()).exits(3);
    assert_eq!(refused.stderr.matches("error: ").count(), 1, "{refused}");
    assert!(refused.stderr.contains("and from 3 more places"), "{refused}");
}

#[test]
fn a_collection_is_renamed_in_its_database() {
    let lab = lab();
    lab.rmem(&["insert", "-q", "robmem.others", "{_id: 1}"]).success();
    lab.rmem(&["index", "robmem.orders", "{team: 1}", "-q"]).success();
    let commands: [&[&str]; 6] = [
        &["rename", "robmem.orders", "lab.orders"],
        &["rename", "robmem.orders", "robmem.orders"],
        &["rename", "robmem.ordres", "robmem.things"],
        &["rename", "robmem.orders", "robmem.others"],
        &["rename", "robmem.orders", "robmem.others", "--drop-target"],
        &["rename", "robmem.others", "robmem.orders", "--format", "json"],
    ];
    assert_run!(lab.transcript(&commands), @r#"
    $ rmem rename robmem.orders lab.orders
    ------- stderr -------
    error: robmem.orders and lab.orders are of two databases; write: rmem dump robmem.orders -o FILE.json, then rmem restore FILE.json --into lab.orders
    [exit code: 2]
    $ rmem rename robmem.orders robmem.orders
    ------- stderr -------
    error: robmem.orders has that name already
    [exit code: 2]
    $ rmem rename robmem.ordres robmem.things
    ------- stderr -------
    error: no collection robmem.ordres; did you mean robmem.orders?
    [exit code: 3]
    $ rmem rename robmem.orders robmem.others
    ------- stderr -------
    error: robmem.others exists already; --drop-target replaces it, with all its documents
    [exit code: 3]
    $ rmem rename robmem.orders robmem.others --drop-target
    ------- stderr -------
    [exit code: 0]
    $ rmem rename robmem.others robmem.orders --format json
    {
      "ns": "robmem.others",
      "renamed": "robmem.orders"
    }
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_eq!(lab.rmem(&["collections"]).success(), "robmem.orders\n");
    assert_eq!(lab.rmem(&["count", "robmem.orders"]).success(), "3\n");
    assert!(lab.rmem(&["index", "robmem.orders"]).success().contains("team_1"));
}

#[test]
fn mistakes_in_dates_pipelines_and_operators_say_what_to_write() {
    let lab = lab();
    let hints = |args: &[&str]| {
        let refused = lab.rmem(args).exits(3).stderr;
        let is_wanted = |line: &&str| line.starts_with("error: ") || line.contains("hint: ");
        refused.lines().filter(is_wanted).map(str::to_owned).collect::<Vec<_>>()
    };
    let date = |text: &str| hints(&["query", "robmem.orders", &format!("{{at: {text}}}")]);
    let local = "(JavaScript counts months from 0, and means local time)";
    assert_eq!(
        date("new Date(2026, 10, 1)"),
        [format!("error: <query>:1:6: `Date` takes a date as one string; write ISODate(\"2026-11-01\") {local}")]
    );
    assert_eq!(
        date("new Date(2026, 0, 31, 13, 5)"),
        [format!(
            "error: <query>:1:6: `Date` takes a date as one string; write ISODate(\"2026-01-31T13:05:00Z\") {local}"
        )]
    );
    for wrong in ["new Date(2026, 1, 30)", "new Date(2026, 12, 1)", "new Date('2026', 1)"] {
        let like = "error: <query>:1:6: `Date` takes a date as one string, like ISODate(\"2026-11-01\")";
        assert_eq!(date(wrong), [like], "{wrong}");
    }
    let pipeline = |text: &str| hints(&["aggregate", "robmem.orders", text]);
    assert_eq!(
        pipeline("{$match: {team: 'CYAN'}}, {$count: 'n'}"),
        [
            "error: <pipeline>:1:25: expected the end of the text, found `,`",
            "  = hint: several stages are written in brackets: [{$match: {…}}, {$group: {…}}]",
        ]
    );
    assert_eq!(pipeline("{$match: {}} x").len(), 1);
    assert_eq!(hints(&["query", "robmem.orders", "{rings: {$nope: 1}}"]).len(), 1);
    assert!(hints(&["query", "robmem.orders", "{rings: {$gtt: 1}}"])[1].ends_with("did you mean `$gt`?"));
}

#[test]
fn a_planner_without_output_is_read_as_what_it_prints() {
    let lab = Lab::new();
    lab.write("rmem.toml", "memory = 'file:robot.rmem'\n[planner.liar]\ncommand = ['echo', 'ff: goal can be simplified to FALSE. No plan will solve it']\n");
    let plan = [
        "plan",
        "-d",
        "domains/blocksworld/domain.pddl",
        "-t",
        "templates/blocksworld/problem.pddl.j2",
        "--goal",
        "(on A B)",
    ];
    let claimed =
        lab.rmem(&[&plan[..], &["--load", "fixtures/blocksworld.json", "--planner", "liar"]].concat()).exits(11);
    assert!(claimed.stderr.contains("why: liar claims it, and rmem has no proof of it"), "{claimed}");
}

#[test]
fn arguments_of_other_tools_and_in_another_order_get_a_tip() {
    let lab = lab();
    lab.write("objects.json", "[{_id: 9}]");
    let template = "templates/blocksworld/problem.pddl.j2";
    for (args, code, tip) in [
        (&["query", "robmem.orders", "team=CYAN"][..], 3, "a document is written in braces: {team: 'CYAN'}"),
        (&["query", "robmem.orders", "pose.x=1.5"], 3, "a document is written in braces: {'pose.x': 1.5}"),
        (&["count", "robmem.orders", "7"], 3, "a document is written in braces: {_id: 7}"),
        (&["query", "robmem.orders", "team", "CYAN"], 2, "a query is one argument: robmem.worldmodel \"{name: 'A'}\""),
        (&["query", "{team: 'CYAN'}", "robmem.orders"], 2, "robmem.worldmodel \"{team: 'CYAN'}\""),
        (&["insert", "{team: 'CYAN'}"], 2, "the collection stands in front of it: "),
        (&["insert", "robmem.orders", "a=1"], 3, "a document is written in braces: {a: 1}"),
        (&["insert", "robmem.orders", "objects.json"], 3, "--file objects.json reads the documents of a file"),
        (&["update", "robmem.orders", "{$set: {a: 1}}"], 2, "the query stands before the update"),
        (&["find-and-modify", "robmem.orders", "{}"], 2, "--remove needs no update"),
        (&["distinct", "robmem.orders"], 2, "the field stands behind the collection"),
        (&["distinct", "robmem.orders", "{team: 1}"], 2, "is not the name of a field; expected NS FIELD [QUERY]"),
        (&["dump", "-o", "x.json"], 2, "--all writes all collections"),
        (&["query", "robmem.orders", "--limit", "all"], 2, "expected a whole number, like 10"),
        (&["query", "robmem.orders", "--sort", "-rings"], 3, "write --sort '{rings: -1}'"),
        (&["query", "robmem.orders", "{rings: >=1}"], 3, "`>=` is written {$gte: 1}"),
        (&["query", "robmem.orders", "{$or: {a: 1}}"], 3, "write $or: [{a: 1}, {b: 2}]"),
        (&["aggregate", "robmem.orders", "[{$group: {n: {$sum: 1}}}]"], 3, "_id: null makes one group"),
        (&["aggregate", "robmem.orders", "$match"], 3, "stages are written in brackets and braces"),
        (&["collections", "robmem"], 2, "'rmem collections' lists all"),
        (&["gen-problem", template], 2, "write: --template templates/blocksworld/problem.pddl.j2"),
        (&["--load", "fixtures/blocksworld.json", "gen-problem", "-t", template], 3, "give the goal with --goal"),
    ] {
        let refused = lab.rmem(args).exits(code);
        assert!(refused.stderr.contains(tip), "{args:?}: {refused}");
    }
    assert_eq!(lab.rmem(&["count", "robmem.orders"]).success(), "3\n");
}

#[test]
fn an_operator_in_the_wrong_place_gets_its_right_one() {
    let lab = lab();
    assert_run!(lab.rmem(&["query", "robmem.orders", "{$gt: {battery: 0.6}}"]), @r"
    ------- stderr -------
    error: <query>:1:2: unknown top level operator: $gt
      |
    1 | {$gt: {battery: 0.6}}
      |  ^^^
      = hint: `$gt` stands behind a key: {battery: {$gt: 0.6}}
    [exit code: 3]
    ");
    for (query, hint) in [
        ("{$gte: {n: 1}}", "`$gte` stands behind a key: {n: {$gte: 1}}"),
        ("{$in: [1, 2]}", "`$in` stands behind a key: {key: {$in: [1, 2]}}"),
        ("{$not: {team: 'CYAN'}}", "`$not` stands behind a key: {key: {$not: {$gt: 5}}}; at the top there is {$nor: "),
        ("{$exists: true}", "`$exists` stands behind a key: {key: {$exists: true}}"),
        ("{n: {$gt: 0.1, $or: [1]}}", "`$or` stands at the top: {$or: [{a: 1}, {b: 2}]}"),
        ("{n: {$nor: [1]}}", "`$nor` stands at the top: {$nor: "),
        ("{$set: {n: 1}}", "`$set` stands in an update: rmem update NS QUERY '{$set: {key: 5}}'"),
        ("{$match: {n: 1}}", "`$match` is a stage of a pipeline: rmem aggregate NS '[{$match: …}]'"),
        ("{n: {$gtt: 1}}", "did you mean `$gt`?"),
    ] {
        let refused = lab.rmem(&["query", "robmem.orders", query]).exits(3);
        assert!(refused.stderr.contains(&format!("= hint: {hint}")), "{query}: {refused}");
        assert_eq!(refused.stderr.matches("= hint: ").count(), 1, "{query}: {refused}");
    }
    for (args, hint) in [
        (["aggregate", "robmem.orders", "[{$gt: 1}]"], "`$gt` stands in a query: [{$match: {key: {$gt: 5}}}]"),
        (["aggregate", "robmem.orders", "[{$sum: 1}]"], "`$sum` stands in a stage: [{$group: {_id: '$key', "),
        (["aggregate", "robmem.orders", "[{$inc: {n: 1}}]"], "`$inc` stands in an update"),
    ] {
        let refused = lab.rmem(&args).exits(3);
        assert!(refused.stderr.contains(&format!("= hint: {hint}")), "{args:?}: {refused}");
    }
    let update = |update: &str| lab.rmem(&["update", "robmem.orders", "{_id: 1}", update]).exits(3);
    assert!(update("{$gt: {n: 1}}").stderr.contains("`$gt` stands in a query, which is in front of the update"));
    assert!(update("{$project: {n: 1}}").stderr.contains("an update by stages has brackets: [{$project: {…}}]"));
}

#[test]
fn missing_braces_and_lines_of_mongosh_get_what_to_write() {
    let lab = lab();
    assert_run!(lab.rmem(&["query", "robmem.orders", "{rings: $gt: 0.6}"]), @r"
    ------- stderr -------
    error: <query>:1:9: expected a value, found `$gt`
      |
    1 | {rings: $gt: 0.6}
      |         ^^^
      = hint: a key and its value stand in braces: {$gt: 0.6}
    [exit code: 3]
    ");
    for (args, hint) in [
        (&["query", "robmem.orders", "{team}"][..], "`team` needs a value: {team: 1}"),
        (&["index", "robmem.orders", "{team}"], "`team` needs a value: {team: 1}"),
        (
            &["update", "robmem.orders", "{_id: 1}", "$set: {rings: 1}"],
            "a document is written in braces: {$set: {rings: 1}}",
        ),
        (
            &["aggregate", "robmem.orders", "[$match: {rings: 2}]"],
            "a key and its value stand in braces: {$match: {rings: 2}}",
        ),
        (&["query", "robmem.orders", "({team: 'CYAN'})"], "leave out the parentheses: {team: 'CYAN'}"),
        (&["query", "lab.orders", "db.orders.find({team: 'CYAN'})"], "write: rmem query lab.orders \"{team: 'CYAN'}\""),
        (&["count", "robmem.orders", "db.orders.countDocuments()"], "write: rmem count robmem.orders"),
        (&["insert", "robmem.orders", "db.orders.insertOne({n: 1})"], "write: rmem insert robmem.orders \"{n: 1}\""),
        (
            &["query", "robmem.orders", "db.orders.createIndex({a: 1}, {sparse: true})"],
            "'rmem index robmem.orders KEYS'",
        ),
    ] {
        let refused = lab.rmem(args).exits(3);
        assert!(refused.stderr.contains(&format!("= hint: {hint}")), "{args:?}: {refused}");
        assert!(!refused.stderr.contains("written in quotes"), "{refused}");
    }
}

#[test]
fn pddl_and_templates_in_the_place_of_others_get_the_command_for_them() {
    let lab = Lab::new().env("RMEM_MEMORY", "file:m.rmem");
    let domain = "domains/blocksworld/domain.pddl";
    lab.write("p.pddl", "; comment\n( DEFINE (problem p))");
    for (file, hint) in [(domain, "`rmem plan --domain "), ("p.pddl", "`rmem plan --problem p.pddl` plans for it")] {
        let refused = lab.rmem(&["restore", file]).exits(3);
        assert!(refused.stderr.contains(hint) && !refused.stderr.contains("clips"), "{refused}");
    }
    lab.write("facts.txt", "; comment\n(box a)");
    let facts = lab.rmem(&["restore", "facts.txt"]).exits(3);
    assert!(facts.stderr.contains("`rmem clips import facts.txt` reads facts"), "{facts}");
    let template = "templates/blocksworld/problem.pddl.j2";
    for args in [&["validate", template][..], &["validate", domain, template]] {
        let refused = lab.rmem(args).exits(3);
        let wanted = format!("{template} is a template; rmem gen-problem makes a problem of it");
        assert!(refused.stderr.contains(&wanted), "{refused}");
    }
    lab.rmem(&["validate", "absent.j2"]).exits(3);
}

#[test]
fn a_value_of_a_document_that_is_no_name_is_shown_with_the_document() {
    let lab = Lab::new().env("RMEM_MEMORY", "file:m.rmem");
    lab.rmem(&[
        "insert",
        "-q",
        "a.n",
        "{_id: 1, name: 'A', pose: {}}",
        "{_id: 2, name: null, tags: ['x'], seen: ISODate('2026-01-01T00:00:00Z'), pose: {x: null}}",
    ])
    .success();
    let render = |expression: &str| {
        lab.write("t.j2", &format!("{{% for n in query('a.n', '{{_id: 2}}') %}}(x {expression}){{% endfor %}}"));
        lab.rmem(&["gen-problem", "-t", "t.j2"]).exits(3).stderr
    };
    for (expression, message) in [
        ("{{ n.name }}", "null has no name in PDDL"),
        ("{{ n.tags }}", "a list is not a name"),
        ("{{ n.seen }}", "a date is not a name"),
        ("{{ n.pose.x }}", "null has no name in PDDL"),
    ] {
        let refused = render(expression);
        assert!(refused.contains(message) && refused.contains("= hint: from document _id 2 of a.n"), "{refused}");
    }
    let none = render("{{ none }}");
    assert!(none.contains("null has no name") && !none.contains("from document"), "{none}");
}
