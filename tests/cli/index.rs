//! index, and how queries use indexes.

use crate::lab::{Lab, assert_run, three_documents};

#[test]
fn an_index_is_made_listed_and_dropped() {
    let lab = Lab::new();
    let name = lab.rmem(&["index", "robmem.objects", "{name: 1, 'at.x': -1}", "--unique"]).success();
    assert_eq!(name, "name_1_at.x_-1\n");
    let listed = lab.rmem(&["index", "robmem.objects"]).success();
    assert_eq!(
        listed,
        "{\"v\":2,\"key\":{\"_id\":1},\"name\":\"_id_\"}\n\
         {\"v\":2,\"key\":{\"name\":1,\"at.x\":-1},\"name\":\"name_1_at.x_-1\",\"unique\":true}\n"
    );
    lab.rmem(&["index", "robmem.objects", "{name: 1, 'at.x': -1}", "--drop"]).success();
    assert_eq!(lab.rmem(&["index", "robmem.objects"]).success().lines().count(), 1);
}

#[test]
fn a_taken_unique_key_is_a_conflict_that_names_key_and_index() {
    let lab = Lab::new();
    lab.rmem(&["index", "robmem.objects", "{name: 1}", "--unique", "--name", "names"]).success();
    lab.rmem(&["insert", "robmem.objects", "{name: 'cup'}"]).success();
    assert_run!(lab.rmem(&["insert", "robmem.objects", "{name: 'cup'}"]), @r#"
    ------- stderr -------
    error: robmem.objects already has a document with name: "cup" (unique index names): that with _id {"$oid":"[ID]"}
    [exit code: 5]
    "#);
    lab.rmem(&["index", "robmem.objects", "{name: 1}", "--name", "names"]).exits(3);
}

#[test]
fn words_are_searched_by_a_text_index() {
    let lab = Lab::new();
    lab.rmem(&["insert", "robmem.objects", "{_id: 1, name: 'red cup'}", "{_id: 2, name: 'cups', note: 'red'}"])
        .success();
    let best = "{score: {$meta: 'textScore'}}";
    let commands = [
        &["query", "robmem.objects", "{$text: {$search: 'cup'}}"][..],
        &["index", "robmem.objects", "{name: 'text', note: 'text'}", "--weights", "{name: 3}"],
        &["index", "robmem.objects"],
        &["query", "robmem.objects", "{$text: {$search: 'red cup'}}", "--sort", best, "--fields", best],
        &["query", "robmem.objects", "{$text: {$search: '\"red cup\" -lamp'}}"],
        &["count", "robmem.objects", "{$text: {$search: 'CUPS', $caseSensitive: true}}"],
        &["query", "robmem.objects", "{$text: {$search: 'cup'}}", "--explain"],
        &["aggregate", "robmem.objects", "[{$limit: 1}, {$match: {$text: {$search: 'cup'}}}]"],
        &["query", "robmem.objects", "--sort", best],
        &["index", "robmem.objects", "{note: 'text'}"],
        &["index", "robmem.objects", "--drop", "--name", "name_text_note_text"],
    ];
    assert_run!(lab.transcript(&commands), @r#"
    $ rmem query robmem.objects "{\$text: {\$search: 'cup'}}"
    ------- stderr -------
    error: <query>:1:2: text index required for $text query: make one, like `rmem index NS "{name: 'text'}"`
      |
    1 | {$text: {$search: 'cup'}}
      |  ^^^^^
    [exit code: 3]
    $ rmem index robmem.objects "{name: 'text', note: 'text'}" --weights '{name: 3}'
    name_text_note_text
    ------- stderr -------
    [exit code: 0]
    $ rmem index robmem.objects
    {"v":2,"key":{"_id":1},"name":"_id_"}
    {"v":2,"key":{"_fts":"text","_ftsx":1},"name":"name_text_note_text","weights":{"name":3,"note":1},"default_language":"english","language_override":"language","textIndexVersion":3}
    ------- stderr -------
    [exit code: 0]
    $ rmem query robmem.objects "{\$text: {\$search: 'red cup'}}" --sort "{score: {\$meta: 'textScore'}}" --fields "{score: {\$meta: 'textScore'}}"
    {"_id":1,"name":"red cup","score":4.5}
    {"_id":2,"name":"cups","note":"red","score":4.1}
    ------- stderr -------
    [exit code: 0]
    $ rmem query robmem.objects "{\$text: {\$search: '"red cup" -lamp'}}"
    {"_id":1,"name":"red cup"}
    ------- stderr -------
    [exit code: 0]
    $ rmem count robmem.objects "{\$text: {\$search: 'CUPS', \$caseSensitive: true}}"
    0
    ------- stderr -------
    [exit code: 0]
    $ rmem query robmem.objects "{\$text: {\$search: 'cup'}}" --explain
    {"index":"name_text_note_text","keys":{"_fts":"text","_ftsx":1},"keys_examined":0,"documents_examined":2,"returned":2}
    ------- stderr -------
    [exit code: 0]
    $ rmem aggregate robmem.objects "[{\$limit: 1}, {\$match: {\$text: {\$search: 'cup'}}}]"
    ------- stderr -------
    error: <pipeline>:1:25: $match with $text is only allowed as the first stage of a pipeline
      |
    1 | [{$limit: 1}, {$match: {$text: {$search: 'cup'}}}]
      |                         ^^^^^
    [exit code: 3]
    $ rmem query robmem.objects --sort "{score: {\$meta: 'textScore'}}"
    ------- stderr -------
    error: <sort>:1:10: {$meta: "textScore"} needs $text in the query
      |
    1 | {score: {$meta: 'textScore'}}
      |          ^^^^^
    [exit code: 3]
    $ rmem index robmem.objects "{note: 'text'}"
    ------- stderr -------
    error: <keys>:1:1: a collection has one text index; name_text_note_text is there: { "v": 2, "key": { "_fts": "text", "_ftsx": 1 }, "name": "name_text_note_text", "weights": { "name": 3, "note": 1 }, "default_language": "english", "language_override": "language", "textIndexVersion": 3 }
      |
    1 | {note: 'text'}
      | ^^^^^^^^^^^^^^
    [exit code: 3]
    $ rmem index robmem.objects --drop --name name_text_note_text
    ------- stderr -------
    [exit code: 0]
    "#);
}

#[test]
fn an_index_is_hidden_and_shown_again() {
    let lab = Lab::new();
    for n in 0..3 {
        lab.rmem(&["insert", "-q", "robmem.objects", &format!("{{_id: {n}, a: {n}, b: {n}}}")]).success();
    }
    lab.rmem(&["index", "robmem.objects", "{a: 1}"]).success();
    let plan = || lab.rmem(&["query", "robmem.objects", "{a: 2}", "--explain"]).stdout;
    assert!(plan().contains("a_1"), "{}", plan());
    lab.rmem(&["index", "robmem.objects", "{a: 1}", "--hide"]).success();
    assert!(!plan().contains("a_1"), "{}", plan());
    assert_eq!(lab.rmem(&["count", "robmem.objects", "{a: 2}"]).success(), "1\n");
    assert_run!(lab.rmem(&["index", "robmem.objects"]), @r#"
    {"v":2,"key":{"_id":1},"name":"_id_"}
    {"v":2,"key":{"a":1},"name":"a_1","hidden":true}
    ------- stderr -------
    [exit code: 0]
    "#);
    lab.rmem(&["index", "robmem.objects", "--name", "a_1", "--unhide"]).success();
    assert!(plan().contains("a_1"), "{}", plan());
    assert_run!(lab.rmem(&["index", "robmem.objects", "--hide", "--name", "b_1"]), @r"
    ------- stderr -------
    warning: robmem.objects has no index b_1
    [exit code: 0]
    ");
    assert_run!(lab.rmem(&["index", "robmem.objects", "--hide"]), @r"
    ------- stderr -------
    error: expected the index to hide: KEYS, like '{name: 1}', or --name NAME (`rmem index NS` lists both)
    [exit code: 2]
    ");
    assert_run!(lab.rmem(&["index", "robmem.objects", "{_id: 1}", "--hide"]), @r"
    ------- stderr -------
    error: the index on _id cannot be hidden
    [exit code: 3]
    ");
}

#[test]
fn a_hashed_index_serves_queries_and_refuses_arrays() {
    let lab = Lab::new();
    lab.rmem(&["insert", "-q", "robmem.objects", "{_id: 1, a: 'x'}"]).success();
    lab.rmem(&["insert", "-q", "robmem.objects", "{_id: 2, a: {b: 1}}"]).success();
    assert_eq!(lab.rmem(&["index", "robmem.objects", "{a: 'hashed'}"]).success(), "a_hashed\n");
    assert_eq!(
        lab.rmem(&["query", "robmem.objects", "{a: 'x'}", "--hint", "a_hashed"]).success(),
        "{\"_id\":1,\"a\":\"x\"}\n"
    );
    assert_run!(lab.rmem(&["insert", "robmem.objects", "{_id: 3, a: [1]}"]), @r"
    ------- stderr -------
    error: an index with a hashed key takes no arrays; one of a has an array
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["index", "robmem.objects", "{b: 'hashed'}", "--unique"]), @r"
    ------- stderr -------
    error: <keys>:1:1: an index with a hashed key cannot be unique
      |
    1 | {b: 'hashed'}
      | ^^^^^^^^^^^^^
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["index", "robmem.objects", "{b: 'hashed', c: 'hashed'}"]), @r"
    ------- stderr -------
    error: <keys>:1:1: an index has at most one hashed key
      |
    1 | {b: 'hashed', c: 'hashed'}
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    ");
}

#[test]
fn an_index_may_hold_some_documents_and_be_hidden() {
    let lab = Lab::new();
    let commands = [
        &["index", "robmem.objects", "{name: 1}", "--unique", "--partial", "{seen: true}"][..],
        &["insert", "robmem.objects", "{_id: 1, name: 'cup', seen: true}", "{_id: 2, name: 'cup'}"],
        &["insert", "robmem.objects", "{_id: 3, name: 'cup', seen: true}"],
        &["index", "robmem.objects", "{seen: 1}", "--hidden"],
        &["query", "robmem.objects", "{seen: true}", "--explain"],
        &["index", "robmem.objects"],
        &["index", "robmem.objects", "--hidden"],
    ];
    assert_run!(lab.transcript(&commands), @r#"
    $ rmem index robmem.objects '{name: 1}' --unique --partial '{seen: true}'
    name_1
    ------- stderr -------
    [exit code: 0]
    $ rmem insert robmem.objects "{_id: 1, name: 'cup', seen: true}" "{_id: 2, name: 'cup'}"
    1
    2
    ------- stderr -------
    2 stored in robmem.objects
    [exit code: 0]
    $ rmem insert robmem.objects "{_id: 3, name: 'cup', seen: true}"
    ------- stderr -------
    error: robmem.objects already has a document with name: "cup" (unique index name_1): that with _id 1
    [exit code: 5]
    $ rmem index robmem.objects '{seen: 1}' --hidden
    seen_1
    ------- stderr -------
    [exit code: 0]
    $ rmem query robmem.objects '{seen: true}' --explain
    {"index":null,"keys_examined":0,"documents_examined":2,"returned":1}
    ------- stderr -------
    [exit code: 0]
    $ rmem index robmem.objects
    {"v":2,"key":{"_id":1},"name":"_id_"}
    {"v":2,"key":{"name":1},"name":"name_1","unique":true,"partialFilterExpression":{"seen":true}}
    {"v":2,"key":{"seen":1},"name":"seen_1","hidden":true}
    ------- stderr -------
    [exit code: 0]
    $ rmem index robmem.objects --hidden
    ------- stderr -------
    error: an index needs keys; expected KEYS, like '{name: 1}'
    [exit code: 2]
    "#);
}

#[test]
fn what_is_no_index_is_refused() {
    let lab = Lab::new();
    let commands = [
        &["index", "robmem.objects", "--unique"][..],
        &["index", "robmem.objects", "--drop"],
        &["index", "robmem.objects", "{a: 1}", "--ttl", "500ms"],
        &["index", "robmem.objects", "{a: 1, b: 1}", "--ttl", "1s"],
        &["index", "robmem.objects", "{a: 'geoHaystack'}"],
        &["index", "robmem.objects", "{a: 'text'}", "--language", "german"],
        &["index", "robmem.objects", "{a: 1}", "--partial", "{b: {$ne: 1}}"],
        &["index", "robmem.objects", "{a: 0}"],
    ];
    assert_run!(lab.transcript(&commands), @r#"
    $ rmem index robmem.objects --unique
    ------- stderr -------
    error: an index needs keys; expected KEYS, like '{name: 1}'
    [exit code: 2]
    $ rmem index robmem.objects --drop
    ------- stderr -------
    error: expected the index to drop: KEYS, like '{name: 1}', or --name NAME (`rmem index NS` lists both)
    [exit code: 2]
    $ rmem index robmem.objects '{a: 1}' --ttl 500ms
    ------- stderr -------
    error: --ttl takes whole seconds, at most 2147483647 of them
    [exit code: 2]
    $ rmem index robmem.objects '{a: 1, b: 1}' --ttl 1s
    ------- stderr -------
    error: <keys>:1:1: an index by which documents expire has one key
      |
    1 | {a: 1, b: 1}
      | ^^^^^^^^^^^^
    [exit code: 3]
    $ rmem index robmem.objects "{a: 'geoHaystack'}"
    ------- stderr -------
    error: <keys>:1:6: an index of type `geoHaystack` is not supported by the embedded store
      |
    1 | {a: 'geoHaystack'}
      |      ^^^^^^^^^^^
    [exit code: 3]
    $ rmem index robmem.objects "{a: 'text'}" --language german
    ------- stderr -------
    error: <keys>:1:1: the language `german` is not supported by the embedded store; take english or none
      |
    1 | {a: 'text'}
      | ^^^^^^^^^^^
    [exit code: 3]
    $ rmem index robmem.objects '{a: 1}' --partial '{b: {$ne: 1}}'
    ------- stderr -------
    error: <partial>:1:6: the partialFilterExpression of an index cannot have $ne: 1
      |
    1 | {b: {$ne: 1}}
      |      ^^^
    [exit code: 3]
    $ rmem index robmem.objects '{a: 0}'
    ------- stderr -------
    error: <keys>:1:1: the key `a` of an index takes 1, -1, "2d", "2dsphere", "hashed" or "text"
      |
    1 | {a: 0}
      | ^^^^^^
    [exit code: 3]
    "#);
}

#[test]
fn documents_do_not_expire_by_their_id() {
    let lab = Lab::new();
    assert_run!(lab.rmem(&["index", "robmem.seen", "{_id: 1}", "--ttl", "1s"]), @r"
    ------- stderr -------
    error: <keys>:1:1: the index on _id is there already, and takes no options
      |
    1 | {_id: 1}
      | ^^^^^^^^
    [exit code: 3]
    ");
}

#[test]
fn a_drop_without_a_name_says_how_an_index_is_named() {
    let lab = Lab::new();
    lab.rmem(&["index", "robmem.objects", "{name: 1}"]).success();
    assert_run!(lab.rmem(&["index", "robmem.objects", "--drop"]), @r"
    ------- stderr -------
    error: expected the index to drop: KEYS, like '{name: 1}', or --name NAME (`rmem index NS` lists both)
    [exit code: 2]
    ");
}

#[test]
fn a_partial_index_is_unique_among_the_documents_that_match() {
    let store = rmem::store::Embedded::in_memory().unwrap();
    use rmem::store::{Index, Namespace, Store as _};
    let ns = Namespace { database: "robmem".to_owned(), collection: "objects".to_owned() };
    let partial = bson::doc! { "key": { "a": 1 }, "unique": true, "partialFilterExpression": { "n": { "$gt": 1 } } };
    store.create_index(&ns, &Index::parse(&partial).unwrap()).unwrap();
    let insert = |n: i32| store.insert(&ns, vec![bson::doc! { "a": 1, "n": n }]).is_ok();
    assert_eq!([insert(0), insert(1), insert(2), insert(3)], [true, true, true, false]);
    let find = rmem::store::Find { filter: bson::doc! { "a": 1 }, ..Default::default() };
    assert_eq!(store.find(&ns, &find).unwrap().count(), 3);
    for wrong in [
        bson::doc! { "n": { "$ne": 1 } },
        bson::doc! { "n": { "$exists": false } },
        bson::doc! { "$nor": [{ "n": 1 }] },
    ] {
        let partial = bson::doc! { "key": { "b": 1 }, "partialFilterExpression": wrong };
        assert!(store.create_index(&ns, &Index::parse(&partial).unwrap()).is_err());
    }
}

#[test]
fn wildcard_indexes_are_listed_and_answered_by_a_scan() {
    let lab = three_documents();
    assert_eq!(lab.rmem(&["index", "robmem.worldmodel", "{'$**': 1}"]).success(), "$**_1\n");
    assert_eq!(lab.rmem(&["index", "robmem.worldmodel", "{'pose.$**': 1}"]).success(), "pose.$**_1\n");
    let hinted = |query: &str| lab.rmem(&["count", "robmem.worldmodel", query, "--hint", "$**_1"]);
    assert_eq!(hinted("{relation: 'on-table'}").success(), "2\n");
    assert_run!(hinted("{}"), @r"
    ------- stderr -------
    error: <hint>:1:1: the hint names a wildcard index, and the query asks for none of its paths
      |
    1 | $**_1
      | ^^^^^
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["index", "robmem.worldmodel", "{'$**': 1}", "--unique", "--name", "u"]), @r"
    ------- stderr -------
    error: <keys>:1:1: a wildcard index is neither unique nor sparse, and no document expires by it
      |
    1 | {'$**': 1}
      | ^^^^^^^^^^
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["index", "robmem.worldmodel", "{a: 1, '$**': 1}"]), @r"
    ------- stderr -------
    error: <keys>:1:9: a wildcard index has one key
      |
    1 | {a: 1, '$**': 1}
      |         ^^^
    [exit code: 3]
    ");
}

#[test]
fn weights_that_are_no_document_say_how_they_are_written() {
    let lab = Lab::new();
    let args = ["--memory", "mem:", "index", "robmem.objects", "{name: 'text'}", "--weights", "1.5"];
    assert_run!(lab.rmem(&args), @r"
    ------- stderr -------
    error: <weights>:1:1: expected a document `{…}`, found a number
      |
    1 | 1.5
      | ^^^
      = hint: weights are those of fields: --weights '{name: 3}'; a field that is left out has 1
    [exit code: 3]
    ");
}

#[test]
fn a_text_search_finds_what_its_index_holds() {
    let lab = Lab::new();
    for document in ["{_id: 1, s: 'a red cup', on: true}", "{_id: 2, s: 'the blue cup'}", "{_id: 3, s: 'plate', n: 7}"]
    {
        lab.rmem(&["insert", "-q", "robmem.things", document]).success();
    }
    lab.rmem(&["index", "robmem.things", "{s: 'text'}", "--partial", "{on: true}"]).success();
    let cup = "{$text: {$search: 'cup'}}";
    let partial = lab.transcript(&[&["query", "robmem.things", cup], &["count", "robmem.things", cup]]);
    lab.rmem(&["index", "robmem.things", "--drop", "--name", "s_text"]).success();
    lab.rmem(&["index", "robmem.things", "{s: 'text'}"]).success();
    let either = "{$or: [{$text: {$search: 'cup'}}, {n: 7}]}";
    let refused = lab.transcript(&[&["query", "robmem.things", either]]);
    lab.rmem(&["index", "robmem.things", "{n: 1}"]).success();
    let whole = lab.transcript(&[
        &["query", "robmem.things", either, "--sort", "{_id: 1}"],
        &["query", "robmem.things", "{$text: {$search: 'cup -the', $language: 'none'}}"],
        &["query", "robmem.things", "{$nor: [{$text: {$search: 'cup'}}]}"],
    ]);
    assert_run!(format!("{partial}{refused}{whole}"), @r#"
    $ rmem query robmem.things "{\$text: {\$search: 'cup'}}"
    {"_id":1,"s":"a red cup","on":true}
    ------- stderr -------
    [exit code: 0]
    $ rmem count robmem.things "{\$text: {\$search: 'cup'}}"
    1
    ------- stderr -------
    [exit code: 0]
    $ rmem query robmem.things "{\$or: [{\$text: {\$search: 'cup'}}, {n: 7}]}"
    ------- stderr -------
    error: <query>:1:9: $text within $or needs an index for each other alternative; make one, or ask in two queries
      |
    1 | {$or: [{$text: {$search: 'cup'}}, {n: 7}]}
      |         ^^^^^
    [exit code: 3]
    $ rmem query robmem.things "{\$or: [{\$text: {\$search: 'cup'}}, {n: 7}]}" --sort '{_id: 1}'
    {"_id":1,"s":"a red cup","on":true}
    {"_id":2,"s":"the blue cup"}
    {"_id":3,"s":"plate","n":7}
    ------- stderr -------
    [exit code: 0]
    $ rmem query robmem.things "{\$text: {\$search: 'cup -the', \$language: 'none'}}"
    {"_id":1,"s":"a red cup","on":true}
    ------- stderr -------
    [exit code: 0]
    $ rmem query robmem.things "{\$nor: [{\$text: {\$search: 'cup'}}]}"
    ------- stderr -------
    error: <query>:1:10: $text is only allowed at the top of a query
      |
    1 | {$nor: [{$text: {$search: 'cup'}}]}
      |          ^^^^^
    [exit code: 3]
    "#);
}

#[test]
fn a_collation_that_would_do_nothing_is_refused() {
    let lab = three_documents();
    lab.rmem(&["index", "robmem.worldmodel", "{object: 1}"]).success();
    let collation = ["--collation", "{locale: 'en'}"];
    let run = lab.rmem(&[&["index", "robmem.worldmodel"], &collation[..]].concat()).exits(2);
    assert_eq!(run.stderr, "error: an index needs keys; expected KEYS, like '{name: 1}'\n");
    for flag in ["--hide", "--unhide", "--drop"] {
        let run = lab.rmem(&[&["index", "robmem.worldmodel", "{object: 1}", flag], &collation[..]].concat()).exits(2);
        assert!(run.stderr.contains("cannot be used with"), "{run}");
    }
    assert_eq!(lab.rmem(&["index", "robmem.worldmodel"]).success().lines().count(), 2);
}

#[test]
fn an_index_is_dropped_and_hidden_by_its_name_as_in_mongosh() {
    let lab = Lab::new();
    assert_eq!(lab.rmem(&["--format", "json", "index", "a.b", "{x: 1}"]).success(), "\"x_1\"\n");
    lab.rmem(&["index", "a.b", "x_1", "--hide"]).success();
    assert!(lab.rmem(&["index", "a.b"]).success().contains("\"hidden\":true"));
    lab.rmem(&["index", "a.b", "x_1", "--drop"]).success();
    assert!(!lab.rmem(&["index", "a.b"]).success().contains("x_1"));
    assert!(lab.rmem(&["index", "a.b", "y_1", "--drop"]).success().is_empty());
}
