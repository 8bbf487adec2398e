//! aggregate.

use insta::assert_snapshot;

use crate::lab::{Lab, assert_run};

#[test]
fn a_pipeline_does_not_leave_its_store() {
    let lab = Lab::new();
    lab.write(
        "rmem.toml",
        "memory = \"file:local.rmem\"\nshared = \"file:shared.rmem\"\nshared_databases = [\"team\"]\n",
    );
    lab.rmem(&["insert", "own.a", "{_id: 1}"]).success();
    lab.rmem(&["insert", "team.a", "{_id: 2}"]).success();
    let mut refused = String::new();
    for (ns, stage) in [
        ("own.a", "{$out: {db: 'team', coll: 'leak'}}"),
        ("team.a", "{$out: {db: 'own', coll: 'leak'}}"),
        ("team.a", "{$merge: {into: {db: 'own', coll: 'leak'}}}"),
        ("own.a", "{$lookup: {from: {db: 'team', coll: 'a'}, pipeline: [], as: 'x'}}"),
    ] {
        refused += &lab.transcript(&[&["aggregate", ns, &format!("[{stage}]")]]);
    }
    assert_run!(refused, @r#"
    $ rmem aggregate own.a "[{\$out: {db: 'team', coll: 'leak'}}]"
    ------- stderr -------
    error: <pipeline>:1:1: team.leak is in the shared store, and a pipeline over the private own.a does not leave its store; query one and insert into the other
      |
    1 | [{$out: {db: 'team', coll: 'leak'}}]
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    $ rmem aggregate team.a "[{\$out: {db: 'own', coll: 'leak'}}]"
    ------- stderr -------
    error: <pipeline>:1:1: own.leak is in the private store, and a pipeline over the shared team.a does not leave its store; query one and insert into the other
      |
    1 | [{$out: {db: 'own', coll: 'leak'}}]
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    $ rmem aggregate team.a "[{\$merge: {into: {db: 'own', coll: 'leak'}}}]"
    ------- stderr -------
    error: <pipeline>:1:1: own.leak is in the private store, and a pipeline over the shared team.a does not leave its store; query one and insert into the other
      |
    1 | [{$merge: {into: {db: 'own', coll: 'leak'}}}]
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    $ rmem aggregate own.a "[{\$lookup: {from: {db: 'team', coll: 'a'}, pipeline: [], as: 'x'}}]"
    ------- stderr -------
    error: <pipeline>:1:1: team.a is in the shared store, and a pipeline over the private own.a does not leave its store; query one and insert into the other
      |
    1 | [{$lookup: {from: {db: 'team', coll: 'a'}, pipeline: [], as: 'x'}}]
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    "#);
    lab.rmem(&["aggregate", "team.a", "[{$out: {db: 'team', coll: 'b'}}]"]).success();
    assert_eq!(lab.rmem(&["collections"]).success().lines().count(), 3);
}

#[test]
fn a_stage_with_two_keys_is_refused_wherever_it_stands() {
    let lab = Lab::new();
    lab.rmem(&["insert", "-q", "robmem.a", "{_id: 1}", "{_id: 2}"]).success();
    let two = "{$match: {}, $limit: 1}";
    for pipeline in [
        format!("[{two}]"),
        format!("[{{$match: {{}}}}, {two}]"),
        "[{$limit: 1, $match: {}}]".to_owned(),
        format!("[{{$lookup: {{from: 'a', pipeline: [{two}], as: 'x'}}}}]"),
        format!("[{{$lookup: {{from: 'a', pipeline: [{{$match: {{}}}}, {two}], as: 'x'}}}}]"),
        format!("[{{$unionWith: {{coll: 'a', pipeline: [{two}]}}}}]"),
        format!("[{{$facet: {{x: [{two}]}}}}]"),
        format!("[{{$match: {{}}}}, {{$facet: {{x: [{{$unionWith: {{coll: 'a', pipeline: [{two}]}}}}]}}}}]"),
    ] {
        let errors = lab.rmem(&["aggregate", "robmem.a", &pipeline]).stderr;
        assert!(
            errors.contains("a pipeline stage specification object must contain exactly one field"),
            "{pipeline}: {errors}"
        );
    }
    lab.write("two.j2", "<<#ONE||[{$match: {}, $limit: 1}]>><<_id>><</ONE>>");
    let errors = lab.rmem(&["gen-problem", "--template", "two.j2"]).stderr;
    assert!(errors.contains("exactly one field"), "{errors}");
    // Empty filters in front of what has to be first are still nothing.
    let found = lab.rmem(&["aggregate", "robmem.a", "[{$match: {}}, {$match: {}}, {$limit: 1}]"]).success();
    assert_eq!(found, "{\"_id\":1}\n");
}

#[test]
fn metadata_of_joined_documents_is_hidden() {
    let lab = Lab::new();
    lab.rmem(&["insert", "-q", "robmem.rooms", "{_id: 'kitchen'}"]).success();
    lab.rmem(&["insert", "-q", "robmem.cups", "{_id: 1, room: 'kitchen'}"]).success();
    let pipeline =
        "[{$lookup: {from: 'rooms', localField: 'room', foreignField: '_id', as: 'room'}}, {$project: {room: 1}}]";
    let plain = lab.rmem(&["aggregate", "robmem.cups", pipeline]).success();
    assert_eq!(plain, "{\"_id\":1,\"room\":[{\"_id\":\"kitchen\"}]}\n");
    // Unless it is asked for by its name.
    let named =
        lab.rmem(&["aggregate", "robmem.cups", "[{$project: {_id: 0, known: {$type: '$_robmem_info.inserted'}}}]"]);
    assert_eq!(named.success(), "{\"known\":\"date\"}\n");
}

/// Two documents that are equal but for their ids and what the memory notes of them, and one that holds the first.
fn with_equal_documents() -> Lab {
    let lab = Lab::new();
    for document in ["{_id: 1, room: 'kitchen'}", "{_id: 2, room: 'kitchen'}"] {
        lab.rmem(&["insert", "-q", "robmem.cups", document]).success();
    }
    lab.rmem(&["insert", "-q", "robmem.rooms", "{_id: 'kitchen', n: 1}"]).success();
    lab.rmem(&["insert", "-q", "robmem.copies", "{_id: 1, of: [{_id: 'kitchen', n: 1}]}"]).success();
    lab
}

#[test]
fn stages_and_expressions_see_no_metadata() {
    let lab = with_equal_documents();
    let found = "{from: 'rooms', localField: 'room', foreignField: '_id', as: 'of'}";
    let graph = "{from: 'rooms', startWith: '$room', connectFromField: 'next', connectToField: '_id', as: 'of'}";
    let mut results = String::new();
    for pipeline in [
        "{$unset: '_id'}, {$group: {_id: '$$ROOT', n: {$sum: 1}}}",
        "{$project: {_id: 0, n: {$size: {$objectToArray: '$$ROOT'}}}}",
        "{$match: {$expr: {$eq: ['$$ROOT', {_id: 1, room: 'kitchen'}]}}}",
        &format!("{{$lookup: {found}}}, {{$match: {{of: {{_id: 'kitchen', n: 1}}}}}}, {{$count: 'n'}}"),
        "{$limit: 1}, {$lookup: {from: 'rooms', pipeline: [], as: 'of'}}, {$set: {of: {$objectToArray: {$first: '$of'}}}}",
        &format!("{{$graphLookup: {graph}}}, {{$match: {{of: [{{_id: 'kitchen', n: 1}}]}}}}, {{$count: 'n'}}"),
        "{$facet: {a: [{$match: {_id: 1}}]}}, {$match: {a: [{_id: 1, room: 'kitchen'}]}}",
        "{$unionWith: 'rooms'}, {$project: {n: {$size: {$objectToArray: '$$ROOT'}}}}",
    ] {
        results += &lab.rmem(&["aggregate", "robmem.cups", &format!("[{pipeline}]")]).success();
    }
    assert_snapshot!(results, @r#"
    {"_id":{"room":"kitchen"},"n":2}
    {"n":2}
    {"n":2}
    {"_id":1,"room":"kitchen"}
    {"n":2}
    {"_id":1,"room":"kitchen","of":[{"k":"_id","v":"kitchen"},{"k":"n","v":1}]}
    {"n":2}
    {"a":[{"_id":1,"room":"kitchen"}]}
    {"_id":1,"n":2}
    {"_id":2,"n":2}
    {"_id":"kitchen","n":2}
    "#);
    let schema = "{_id: 1, $jsonSchema: {properties: {_id: {}, room: {}}, additionalProperties: false}}";
    let transcript = lab.transcript(&[
        &["query", "robmem.cups", "{$expr: {$in: ['$$ROOT', [{_id: 2, room: 'kitchen'}]]}}"],
        &["query", "robmem.cups", "{_id: 1}", "--fields", "{k: '$$ROOT'}"],
        &["query", "robmem.cups", schema],
        &["count", "robmem.cups", "{$expr: {$eq: [{$size: {$objectToArray: '$$CURRENT'}}, 2]}}"],
    ]);
    assert_run!(transcript, @r#"
    $ rmem query robmem.cups "{\$expr: {\$in: ['\$\$ROOT', [{_id: 2, room: 'kitchen'}]]}}"
    {"_id":2,"room":"kitchen"}
    ------- stderr -------
    [exit code: 0]
    $ rmem query robmem.cups '{_id: 1}' --fields "{k: '\$\$ROOT'}"
    {"_id":1,"k":{"_id":1,"room":"kitchen"}}
    ------- stderr -------
    [exit code: 0]
    $ rmem query robmem.cups '{_id: 1, $jsonSchema: {properties: {_id: {}, room: {}}, additionalProperties: false}}'
    {"_id":1,"room":"kitchen"}
    ------- stderr -------
    [exit code: 0]
    $ rmem count robmem.cups "{\$expr: {\$eq: [{\$size: {\$objectToArray: '\$\$CURRENT'}}, 2]}}"
    2
    ------- stderr -------
    [exit code: 0]
    "#);
}

#[test]
fn what_a_pipeline_stores_has_no_metadata_of_what_it_read() {
    let lab = with_equal_documents();
    lab.rmem(&["insert", "-q", "robmem.cups", "{_id: 3, room: 'hall', _robmem_info: {persistent: false}}"]).success();
    let joined = "{$lookup: {from: 'rooms', localField: 'room', foreignField: '_id', as: 'of'}}";
    assert_run!(
        lab.transcript(&[
            &["aggregate", "robmem.cups", &format!("[{joined}, {{$out: 'made'}}]")],
            &["query", "robmem.made", "--meta"],
            &["aggregate", "robmem.cups", &format!("[{joined}, {{$merge: 'merged'}}]")],
            &["query", "robmem.merged", "--meta"],
            &["update", "robmem.cups", "{_id: 3}", "[{$set: {was: '$$ROOT'}}]"],
            &["update", "robmem.cups", "{_id: 3}", "[{$replaceWith: {$mergeObjects: ['$$ROOT', {n: 1}]}}]"],
            &["find-and-modify", "robmem.cups", "{_id: 3}", "[{$project: {n: 1, again: '$$ROOT.was'}}]", "--new"],
            &["query", "robmem.cups", "{_id: 3}", "--meta"],
        ]),
        @r#"
        $ rmem aggregate robmem.cups "[{\$lookup: {from: 'rooms', localField: 'room', foreignField: '_id', as: 'of'}}, {\$out: 'made'}]"
        ------- stderr -------
        [exit code: 0]
        $ rmem query robmem.made --meta
        {"_id":1,"room":"kitchen","of":[{"_id":"kitchen","n":1}],"_robmem_info":{"inserted":{"$date":"[TIME]"}}}
        {"_id":2,"room":"kitchen","of":[{"_id":"kitchen","n":1}],"_robmem_info":{"inserted":{"$date":"[TIME]"}}}
        {"_id":3,"room":"hall","of":[],"_robmem_info":{"inserted":{"$date":"[TIME]"}}}
        ------- stderr -------
        [exit code: 0]
        $ rmem aggregate robmem.cups "[{\$lookup: {from: 'rooms', localField: 'room', foreignField: '_id', as: 'of'}}, {\$merge: 'merged'}]"
        ------- stderr -------
        [exit code: 0]
        $ rmem query robmem.merged --meta
        {"_id":1,"of":[{"_id":"kitchen","n":1}],"room":"kitchen"}
        {"_id":2,"of":[{"_id":"kitchen","n":1}],"room":"kitchen"}
        {"_id":3,"of":[],"room":"hall"}
        ------- stderr -------
        [exit code: 0]
        $ rmem update robmem.cups '{_id: 3}' "[{\$set: {was: '\$\$ROOT'}}]"
        {"matched":1,"modified":1}
        ------- stderr -------
        [exit code: 0]
        $ rmem update robmem.cups '{_id: 3}' "[{\$replaceWith: {\$mergeObjects: ['\$\$ROOT', {n: 1}]}}]"
        {"matched":1,"modified":1}
        ------- stderr -------
        [exit code: 0]
        $ rmem find-and-modify robmem.cups '{_id: 3}' "[{\$project: {n: 1, again: '\$\$ROOT.was'}}]" --new
        {"_id":3,"n":1,"again":{"_id":3,"room":"hall"}}
        ------- stderr -------
        [exit code: 0]
        $ rmem query robmem.cups '{_id: 3}' --meta
        {"_id":3,"n":1,"again":{"_id":3,"room":"hall"},"_robmem_info":{"persistent":false,"inserted":{"$date":"[TIME]"},"updated":{"$date":"[TIME]"}}}
        ------- stderr -------
        [exit code: 0]
        "#
    );
}

#[test]
fn metadata_that_a_pipeline_names_is_there() {
    let lab = with_equal_documents();
    lab.rmem(&["insert", "-q", "robmem.cups", "{_id: 3, room: 'hall', _robmem_info: {persistent: false}}"]).success();
    assert_run!(
        lab.transcript(&[
            &["aggregate", "robmem.cups", "[{$match: {'_robmem_info.persistent': false}}, {$project: {_id: 1}}]"],
            &["aggregate", "robmem.cups", "[{$group: {_id: {$type: '$_robmem_info.inserted'}, n: {$sum: 1}}}]"],
            &["aggregate", "robmem.cups", "[{$set: {p: '$_robmem_info.persistent'}}, {$match: {p: false}}, {$project: {n: {$size: {$objectToArray: '$$ROOT'}}}}]"],
            &["aggregate", "robmem.cups", "[{$match: {_id: 1}}, {$set: {'_robmem_info.persistent': false}}, {$out: 'made'}]"],
            &["query", "robmem.made", "{'_robmem_info.persistent': false}"],
            &["query", "robmem.cups", "{$expr: {$eq: ['$_robmem_info.persistent', false]}}"],
        ]),
        @r#"
        $ rmem aggregate robmem.cups "[{\$match: {'_robmem_info.persistent': false}}, {\$project: {_id: 1}}]"
        {"_id":3}
        ------- stderr -------
        [exit code: 0]
        $ rmem aggregate robmem.cups "[{\$group: {_id: {\$type: '\$_robmem_info.inserted'}, n: {\$sum: 1}}}]"
        {"_id":"date","n":3}
        ------- stderr -------
        [exit code: 0]
        $ rmem aggregate robmem.cups "[{\$set: {p: '\$_robmem_info.persistent'}}, {\$match: {p: false}}, {\$project: {n: {\$size: {\$objectToArray: '\$\$ROOT'}}}}]"
        {"_id":3,"n":3}
        ------- stderr -------
        [exit code: 0]
        $ rmem aggregate robmem.cups "[{\$match: {_id: 1}}, {\$set: {'_robmem_info.persistent': false}}, {\$out: 'made'}]"
        ------- stderr -------
        [exit code: 0]
        $ rmem query robmem.made "{'_robmem_info.persistent': false}"
        {"_id":1,"room":"kitchen"}
        ------- stderr -------
        [exit code: 0]
        $ rmem query robmem.cups "{\$expr: {\$eq: ['\$_robmem_info.persistent', false]}}"
        {"_id":3,"room":"hall"}
        ------- stderr -------
        [exit code: 0]
        "#
    );
}

#[test]
fn a_collection_describes_itself() {
    let lab = Lab::new();
    lab.rmem(&["insert", "-q", "robmem.cups", "{_id: 1, n: 1}", "{_id: 2, n: 2}"]).success();
    lab.rmem(&["index", "robmem.cups", "{n: 1}"]).success();
    let sizes = "[{$collStats: {storageStats: {}, count: {}}}, {$project: {count: 1, n: '$storageStats.count', \
                 indexes: '$storageStats.nindexes', large: {$gt: ['$storageStats.size', 60]}}}]";
    let transcript = lab.transcript(&[
        &["aggregate", "robmem.cups", sizes],
        &["aggregate", "robmem.cups", "[{$indexStats: {}}, {$project: {name: 1, spec: 1}}]"],
        &["aggregate", "robmem.cups", "[{$collStats: {latencyStats: {}}}]"],
        &["aggregate", "robmem.cups", "[{$limit: 1}, {$indexStats: {}}]"],
        &["aggregate", "robmem.none", "[{$collStats: {count: {}}}]"],
    ]);
    assert_run!(transcript, @r#"
    $ rmem aggregate robmem.cups "[{\$collStats: {storageStats: {}, count: {}}}, {\$project: {count: 1, n: '\$storageStats.count', indexes: '\$storageStats.nindexes', large: {\$gt: ['\$storageStats.size', 60]}}}]"
    {"count":2,"n":2,"indexes":2,"large":true}
    ------- stderr -------
    [exit code: 0]
    $ rmem aggregate robmem.cups '[{$indexStats: {}}, {$project: {name: 1, spec: 1}}]'
    {"name":"_id_","spec":{"v":2,"key":{"_id":1},"name":"_id_"}}
    {"name":"n_1","spec":{"v":2,"key":{"n":1},"name":"n_1"}}
    ------- stderr -------
    [exit code: 0]
    $ rmem aggregate robmem.cups '[{$collStats: {latencyStats: {}}}]'
    ------- stderr -------
    error: <pipeline>:1:16: latencyStats of $collStats is not measured by the embedded store; take storageStats or count
      |
    1 | [{$collStats: {latencyStats: {}}}]
      |                ^^^^^^^^^^^^
    [exit code: 3]
    $ rmem aggregate robmem.cups '[{$limit: 1}, {$indexStats: {}}]'
    ------- stderr -------
    error: <pipeline>:1:16: $indexStats is only valid as the first stage in a pipeline
      |
    1 | [{$limit: 1}, {$indexStats: {}}]
      |                ^^^^^^^^^^^
    [exit code: 3]
    $ rmem aggregate robmem.none '[{$collStats: {count: {}}}]'
    ------- stderr -------
    error: <pipeline>:1:1: there is no collection robmem.none
      |
    1 | [{$collStats: {count: {}}}]
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    "#);
}

#[test]
fn what_is_stored_is_never_taken_for_computed() {
    let lab = with_equal_documents();
    let of_rmem = "is rmem's; an application may set _robmem_info.persistent and _robmem_info.decay_time";
    for (command, rest) in [
        ("insert", &["{_id: 9, _robmem_info: {computed: true}}"][..]),
        ("insert", &["{_id: 9, _robmem_info: {cached_until: ISODate('2001-01-01')}}"]),
        ("update", &["{_id: 1}", "{b: 2, _robmem_info: {computed: true}}", "--replace"]),
        ("update", &["{_id: 1}", "{$rename: {room: '_robmem_info.computed'}}"]),
        ("update", &["{_id: 1}", "[{$replaceWith: {_id: 1, _robmem_info: {computed: true}}}]"]),
        ("aggregate", &["[{$set: {_robmem_info: {computed: true}}}, {$out: 'made'}]"]),
        ("aggregate", &["[{$set: {'_robmem_info.computation': 1}}, {$merge: 'made'}]"]),
    ] {
        let refused = lab.rmem(&[&[command, "robmem.cups"], rest].concat()).exits(3);
        assert!(refused.stderr.contains(of_rmem), "{refused}");
    }
    assert!(!lab.rmem(&["collections"]).success().contains("made"));
    // Where an expression makes it, it is seen only when it is stored.
    let made = "{$replaceWith: {$mergeObjects: ['$$ROOT', {_robmem_info: {computed: true}}]}}";
    lab.rmem(&["update", "robmem.cups", "{_id: 1}", &format!("[{made}]")]);
    lab.rmem(&["aggregate", "robmem.cups", &format!("[{made}, {{$out: 'made'}}]")]);
    lab.rmem(&["aggregate", "robmem.cups", &format!("[{made}, {{$merge: 'made'}}]")]);
    for name in ["robmem.cups", "robmem.made"] {
        assert_eq!(lab.rmem(&["count", name, "{'_robmem_info.computed': true}"]).success(), "0\n", "{name}");
    }
}
