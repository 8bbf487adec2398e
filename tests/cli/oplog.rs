//! Dumps of `mongodump --oplog`: documents, and what changed while they were written.

use bson::{Document, RawDocumentBuf, Timestamp, doc};

use crate::lab::{Lab, assert_run};

fn bytes(documents: &[Document]) -> Vec<u8> {
    documents.iter().flat_map(|document| RawDocumentBuf::try_from(document).unwrap().into_bytes()).collect()
}

/// An entry of an oplog, as mongod writes it.
fn entry(op: &str, ns: &str, more: Document) -> Document {
    let mut entry = doc! { "ts": Timestamp { time: 1, increment: 1 }, "t": 1_i64, "v": 2_i64, "op": op, "ns": ns };
    entry.extend(more);
    entry
}

fn oplog() -> Vec<Document> {
    let change = |id: i32, o: Document| entry("u", "robmem.blocks", doc! { "o": o, "o2": { "_id": id } });
    let session = |more: Document| {
        let mut members = doc! { "lsid": { "id": 7 }, "txnNumber": 3_i64 };
        members.extend(more);
        members
    };
    let insert = |id: i32| bson::bson!({ "op": "i", "ns": "robmem.blocks", "o": { "_id": id } });
    vec![
        entry("n", "", doc! { "o": { "msg": "periodic noop" } }),
        entry("i", "robmem.blocks", doc! { "o": { "_id": 3, "name": "C" } }),
        entry("i", "robmem.blocks", doc! { "o": { "_id": 3, "name": "C" } }),
        change(
            1,
            doc! { "$v": 2, "diff": { "u": { "name": "a" }, "spose": { "sx": { "a": true, "u1": 9, "l": 2 } } } },
        ),
        change(2, doc! { "$v": 1, "$set": { "name": "b" }, "$unset": { "n": true } }),
        change(3, doc! { "_id": 3, "name": "whole" }),
        change(99, doc! { "$v": 2, "diff": { "d": { "n": false } } }),
        entry("d", "robmem.blocks", doc! { "o": { "_id": 4 } }),
        entry("c", "robmem.$cmd", doc! { "o": { "create": "places" } }),
        entry("i", "robmem.places", doc! { "o": { "_id": "table", "at": 1 } }),
        entry(
            "c",
            "robmem.$cmd",
            doc! { "o": { "createIndexes": "places", "v": 2, "key": { "at": 1 }, "name": "at_1", "unique": true } },
        ),
        entry("c", "robmem.$cmd", doc! { "o": { "create": "old" } }),
        entry("i", "robmem.old", doc! { "o": { "_id": 1 } }),
        entry("c", "robmem.$cmd", doc! { "o": { "renameCollection": "robmem.old", "to": "robmem.new" } }),
        entry("c", "robmem.$cmd", doc! { "o": { "collMod": "blocks", "validationLevel": "off" } }),
        entry("c", "admin.$cmd", session(doc! { "o": { "applyOps": [insert(10)], "partialTxn": true } })),
        entry("c", "admin.$cmd", session(doc! { "o": { "applyOps": [insert(11)], "count": 2_i64 } })),
        entry(
            "c",
            "admin.$cmd",
            doc! { "lsid": 1, "txnNumber": 8_i64, "o": { "applyOps": [insert(12)], "prepare": true } },
        ),
        entry("c", "admin.$cmd", doc! { "lsid": 1, "txnNumber": 8_i64, "o": { "abortTransaction": 1 } }),
        entry("i", "config.system.sessions", doc! { "o": { "_id": 1 } }),
    ]
}

/// A folder as `mongodump --oplog` writes it.
fn dumped(oplog: &[Document]) -> Lab {
    let lab = Lab::new();
    lab.write("dump/robmem/blocks.metadata.json", r#"{"indexes":[],"collectionName":"blocks"}"#);
    let documents = [
        doc! { "_id": 1, "name": "A", "pose": { "x": [1, 2, 3] } },
        doc! { "_id": 2, "name": "B", "n": 1 },
        doc! { "_id": 4 },
    ];
    std::fs::write(lab.path().join("dump/robmem/blocks.bson"), bytes(&documents)).unwrap();
    std::fs::write(lab.path().join("dump/oplog.bson"), bytes(oplog)).unwrap();
    lab
}

#[test]
fn the_oplog_of_a_dump_is_applied_on_request() {
    for way in [&[][..], &["--drop"]] {
        let lab = dumped(&oplog());
        let before = lab.rmem(&["collections"]).success();
        let replay = [&["restore", "dump", "--oplog-replay"], way].concat();
        let foreseen = lab.rmem(&[&replay[..], &["--dry-run"]].concat());
        assert_eq!(lab.rmem(&["collections"]).success(), before, "a dry run changed something");
        let report = lab.rmem(&replay);
        assert_eq!(foreseen.stdout, report.stdout);
        assert_eq!(foreseen.stderr, format!("{}nothing was changed: --dry-run\n", report.stderr));
        if way.is_empty() {
            assert_run!(report, @r#"
            {"namespace":"robmem.blocks","inserted":3,"replaced":0,"skipped":0,"oplog":9}
            {"namespace":"robmem.new","inserted":0,"replaced":0,"skipped":0,"oplog":1}
            {"namespace":"robmem.old","inserted":0,"replaced":0,"skipped":0,"oplog":3}
            {"namespace":"robmem.places","inserted":0,"replaced":0,"skipped":0,"oplog":3}
            ------- stderr -------
            warning: config.system.sessions is the server's own and is left out
            warning: robmem.blocks: `collMod` is not applied
            [exit code: 0]
            "#);
        }
        assert_run!(lab.rmem(&["dump", "--all"]), @r#"
        {
          "robmem.blocks": [
            {"_id":1,"name":"a","pose":{"x":[1,9]}},
            {"_id":2,"name":"b"},
            {"_id":3,"name":"whole"},
            {"_id":10},
            {"_id":11}
          ],
          "robmem.new": [
            {"_id":1}
          ],
          "robmem.places": [
            {"_id":"table","at":1}
          ]
        }
        ------- stderr -------
        warning: a world file keeps no indexes, collations and validators; left out: at_1 of robmem.places; -o FOLDER keeps them
        [exit code: 0]
        "#);
        assert_run!(lab.rmem(&["index", "robmem.places"]), @r#"
        {"v":2,"key":{"_id":1},"name":"_id_"}
        {"v":2,"key":{"at":1},"name":"at_1","unique":true}
        ------- stderr -------
        [exit code: 0]
        "#);
        // What the dump has seen already changes nothing.
        lab.rmem(&replay).success();
        assert_eq!(lab.rmem(&["count", "robmem.blocks"]).success(), "5\n");
    }
}

#[test]
fn without_a_request_the_oplog_is_left_out_with_a_warning() {
    let lab = dumped(&oplog());
    assert_run!(lab.rmem(&["restore", "dump"]), @r#"
    {"namespace":"robmem.blocks","inserted":3,"replaced":0,"skipped":0}
    ------- stderr -------
    warning: dump/oplog.bson, what changed during the dump, is left out; --oplog-replay applies it
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&["collections"]), @r"
    robmem.blocks
    ------- stderr -------
    [exit code: 0]
    ");
    assert_run!(lab.rmem(&["restore", "dump/oplog.bson"]), @r"
    ------- stderr -------
    error: dump/oplog.bson: there is only an oplog; --oplog-replay applies it to the memory
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["restore", "dump/oplog.bson", "--oplog-replay"]), @r#"
    {"namespace":"robmem.blocks","inserted":0,"replaced":0,"skipped":0,"oplog":9}
    {"namespace":"robmem.new","inserted":0,"replaced":0,"skipped":0,"oplog":1}
    {"namespace":"robmem.old","inserted":0,"replaced":0,"skipped":0,"oplog":3}
    {"namespace":"robmem.places","inserted":0,"replaced":0,"skipped":0,"oplog":3}
    ------- stderr -------
    warning: config.system.sessions is the server's own and is left out
    warning: robmem.blocks: `collMod` is not applied
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&["restore", "dump/robmem", "--oplog-replay"]), @r"
    ------- stderr -------
    error: dump/robmem: there is no oplog to replay; `mongodump --oplog` writes one
    [exit code: 3]
    ");
}

#[test]
fn a_validator_that_came_during_the_dump_is_told_to_be_left_out() {
    let create = doc! { "o": { "create": "checked", "validator": { "n": { "$gt": 0 } } } };
    let lab =
        dumped(&[entry("c", "robmem.$cmd", create), entry("i", "robmem.checked", doc! { "o": { "_id": 1, "n": 1 } })]);
    let run = lab.rmem(&["restore", "dump", "--oplog-replay"]);
    assert!(run.code == 0 && run.stderr.contains("warning: robmem.checked: its validator is not set"), "{run}");
    assert_eq!(lab.rmem(&["count", "robmem.checked"]).success(), "1\n");
}

#[test]
fn a_collection_that_is_called_oplog_is_one() {
    let lab = Lab::new();
    lab.rmem(&["insert", "robmem.oplog", "{_id: 1}"]).success();
    lab.rmem(&["dump", "--all", "-o", "dump"]).success();
    std::fs::remove_file(lab.path().join("dump/robmem/oplog.metadata.json")).unwrap();
    assert_run!(lab.rmem(&["restore", "dump/robmem"]), @r#"
    {"namespace":"robmem.oplog","inserted":0,"replaced":0,"skipped":1}
    ------- stderr -------
    [exit code: 0]
    "#);
}

#[test]
fn an_entry_that_is_not_one_is_named_with_its_place() {
    for (wrong, reason) in [
        (entry("x", "robmem.blocks", doc! { "o": {} }), r#"has an unknown `op`: "x""#),
        (entry("u", "robmem.blocks", doc! { "o": {} }), "has no `o2`, a document"),
        (entry("d", "robmem.blocks", doc! { "o": {} }), "has no `_id`"),
        (entry("c", "robmem.$cmd", doc! { "o": {} }), "has an empty command"),
        (entry("c", "robmem.$cmd", doc! { "o": { "applyOps": 1 } }), "has no operations in `applyOps`"),
    ] {
        let lab = dumped(&[entry("n", "", doc! {}), wrong]);
        let failed = lab.rmem(&["restore", "dump", "--oplog-replay"]).exits(3);
        let expected = format!("error: dump/oplog.bson: byte 58: the entry of the oplog {reason}\n");
        assert_eq!(failed.stderr, expected);
        assert_eq!(lab.rmem(&["collections"]).success(), "", "something was restored");
    }
    // Applied on what it is of, and found wrong only then.
    let wrong = doc! { "o": { "$v": 2, "diff": { "x": 1 } }, "o2": { "_id": 1 } };
    let lab = dumped(&[entry("u", "robmem.blocks", wrong)]);
    assert_run!(lab.rmem(&["restore", "dump", "--oplog-replay"]), @r"
    ------- stderr -------
    error: dump/oplog.bson: byte 0: the entry of the oplog has an unknown `x` in the difference of a document
    [exit code: 3]
    ");
    assert_eq!(lab.rmem(&["collections"]).success(), "", "something was restored");
}

/// An archive as `mongodump --archive --oplog` writes it.
fn archive(oplog: &[Document]) -> Vec<u8> {
    let mark = [0xFF; 4].to_vec();
    let of = |db: &str, collection: &str, end: bool| doc! { "db": db, "collection": collection, "EOF": end };
    let listed = [
        doc! { "db": "robmem", "collection": "blocks", "metadata": "{\"indexes\":[]}", "size": 1 },
        doc! { "db": "", "collection": "oplog", "metadata": "", "size": 0 },
    ];
    let segment = |db: &str, collection: &str, documents: &[Document]| {
        let end = bytes(&[of(db, collection, true)]);
        [bytes(&[of(db, collection, false)]), bytes(documents), mark.clone(), end, mark.clone()].concat()
    };
    [
        0x8199_E26D_u32.to_le_bytes().to_vec(),
        bytes(&[doc! { "version": "0.1" }]),
        bytes(&listed),
        mark.clone(),
        segment("robmem", "blocks", &[doc! { "_id": 1, "name": "A" }]),
        segment("", "oplog", oplog),
    ]
    .concat()
}

#[test]
fn the_oplog_of_an_archive_is_recognised_too() {
    let lab = Lab::new();
    let entries = [entry("i", "robmem.blocks", doc! { "o": { "_id": 2 } })];
    std::fs::write(lab.path().join("all.archive"), archive(&entries)).unwrap();
    assert_run!(lab.rmem(&["restore", "all.archive"]), @r#"
    {"namespace":"robmem.blocks","inserted":1,"replaced":0,"skipped":0}
    ------- stderr -------
    warning: the oplog in all.archive, what changed during the dump, is left out; --oplog-replay applies it
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&["restore", "all.archive", "--oplog-replay"]), @r#"
    {"namespace":"robmem.blocks","inserted":0,"replaced":0,"skipped":1,"oplog":1}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_eq!(lab.rmem(&["collections"]).success(), "robmem.blocks\n");
}

#[test]
fn documents_without_an_id_get_one_on_request() {
    let lab = Lab::new();
    lab.write("dump/robmem/logs.metadata.json", r#"{"indexes":[]}"#);
    let documents = [doc! { "line": 1 }, doc! { "line": 1 }, doc! { "_id": 7, "line": 2 }];
    std::fs::write(lab.path().join("dump/robmem/logs.bson"), bytes(&documents)).unwrap();
    assert_run!(lab.rmem(&["restore", "dump"]), @r"
    ------- stderr -------
    error: dump/robmem/logs.bson: byte 0: the document has no _id; --add-ids gives it one
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["restore", "dump", "--add-ids"]), @r#"
    {"namespace":"robmem.logs","inserted":3,"replaced":0,"skipped":0}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&["restore", "dump", "--add-ids"]), @r#"
    {"namespace":"robmem.logs","inserted":0,"replaced":0,"skipped":3}
    ------- stderr -------
    [exit code: 0]
    "#);
}

#[test]
fn a_collection_of_the_server_is_restored_under_another_name() {
    let lab = Lab::new();
    lab.write("dump/robmem/system.js.metadata.json", r#"{"indexes":[]}"#);
    std::fs::write(lab.path().join("dump/robmem/system.js.bson"), bytes(&[doc! { "_id": "sum" }])).unwrap();
    assert_run!(lab.rmem(&["restore", "dump"]), @r"
    ------- stderr -------
    error: dump: there are only the server's own collections; --into NS restores one of them under another name
    [exit code: 3]
    ");
    for path in ["dump", "dump/robmem/system.js.bson"] {
        lab.rmem(&["restore", path]).exits(3);
        lab.rmem(&["restore", path, "--into", "robmem.functions", "--drop"]).success();
        assert_eq!(lab.rmem(&["query", "robmem.functions"]).success(), "{\"_id\":\"sum\"}\n");
    }
}

#[test]
fn a_mistake_in_metadata_is_told_with_one_path() {
    let lab = dumped(&[]);
    lab.write("dump/robmem/blocks.metadata.json", r#"{"indexes":[}"#);
    assert_run!(lab.rmem(&["restore", "dump"]), @r#"
    ------- stderr -------
    error: the metadata of blocks cannot be read
      caused by: dump/robmem/blocks.metadata.json:1:13: expected a value or `]`, found `}`
      |
    1 | {"indexes":[}
      |             ^
      = hint: the `[` at 1:12 is not closed
    [exit code: 3]
    "#);
}

#[test]
fn a_dry_run_warns_of_what_a_restore_warns_of() {
    let lab = dumped(&[]);
    let text = r#"{"indexes":[{"key":{"name":"geoHaystack"},"name":"name_geoHaystack"}]}"#;
    lab.write("dump/robmem/blocks.metadata.json", text);
    lab.write("dump/robmem/seen.metadata.json", r#"{"options":{"viewOn":"blocks"},"indexes":[]}"#);
    let foreseen = lab.rmem(&["restore", "dump", "--dry-run"]);
    assert_run!(foreseen, @r#"
    {"namespace":"robmem.blocks","inserted":3,"replaced":0,"skipped":0}
    ------- stderr -------
    warning: dump/robmem/seen.metadata.json describes a view and is left out
    warning: dump/oplog.bson, what changed during the dump, is left out; --oplog-replay applies it
    warning: robmem.blocks: the index name_geoHaystack is not restored: an index of type `geoHaystack` is not supported by the embedded store
    nothing was changed: --dry-run
    [exit code: 0]
    "#);
    let restored = lab.rmem(&["restore", "dump"]);
    assert_eq!(foreseen.stderr, format!("{}nothing was changed: --dry-run\n", restored.stderr));
    assert_eq!(foreseen.stdout, restored.stdout);
}
