//! Commands that fail behind something that they have done.

use std::path::Path;

use bson::{Bson, Document, doc};
use libtest_mimic::Failed;

use super::wire::Wire;
use super::{Beside, Case, Served};

pub(super) const CASES: &[(&str, Case)] = &[("others_write_while_a_pipeline_writes", between)];

/// What is compared with the answers of a mongod.
pub(super) const BESIDE: &[(&str, Beside)] =
    &[("serving::failures::what_a_command_did_before_it_failed_is_kept_as_on_mongod", beside)];

fn with(command: Document, more: Document) -> Document {
    command.into_iter().chain(more).collect()
}

fn commands() -> Vec<Document> {
    let more = |id: i32| doc! { "q": { "_id": id }, "u": { "$inc": { "n": 1 } } };
    let stages = |stages: Vec<Document>| doc! { "q": { "_id": 1 }, "u": stages };
    let unknown = || stages(vec![doc! { "$no": 1 }]);
    let update = |updates: Vec<Document>| doc! { "update": "c", "updates": updates };
    let pipeline = |stage: Document| doc! { "aggregate": "c", "pipeline": [stage], "cursor": {} };
    let merge = |options: Document| pipeline(doc! { "$merge": with(doc! { "into": "t" }, options) });
    let session = doc! { "lsid": { "id": bson::Uuid::new() }, "txnNumber": 1_i64 };
    let repeated = with(update(vec![more(0), unknown(), more(2)]), session);
    let drop = |concern: Document| doc! { "dropDatabase": 1, "writeConcern": concern };
    vec![
        update(vec![more(0), unknown(), more(2)]),
        with(update(vec![more(0), unknown(), more(2)]), doc! { "ordered": false }),
        update(vec![unknown(), more(2)]),
        update(vec![more(0), stages(vec![doc! { "$match": {} }]), more(2)]),
        update(vec![more(0), stages(vec![doc! {}]), more(2)]),
        update(vec![more(0), doc! { "q": { "_id": 1 }, "u": 1 }]),
        with(update(vec![more(0), with(more(1), doc! { "upsertSupplied": true }), more(2)]), doc! { "ordered": false }),
        update(vec![more(0), doc! { "q": {}, "u": { "$set": { "n": 1 } }, "x": 1 }]),
        repeated.clone(),
        repeated,
        merge(doc! { "whenMatched": "fail" }),
        merge(doc! { "whenNotMatched": "fail" }),
        merge(doc! { "whenMatched": "fail", "whenNotMatched": "discard" }),
        merge(doc! { "whenMatched": "replace" }),
        with(pipeline(doc! { "$merge": "t" }), doc! { "writeConcern": { "w": 5, "wtimeout": 9 } }),
        with(pipeline(doc! { "$match": {} }), doc! { "writeConcern": { "w": 5, "wtimeout": 9 } }),
        drop(doc! { "w": 5, "wtimeout": 100 }),
        drop(doc! { "w": 5, "wtimeout": 100 }),
        drop(doc! { "w": "far" }),
        drop(doc! { "w": { "place": 2 } }),
        drop(doc! { "w": 1 }),
    ]
}

/// Commands with values of the wrong type, or out of range.
fn refused() -> Vec<Document> {
    let wrong = [Bson::Int32(1), Bson::Int64(1), Bson::Double(1.0), Bson::Null];
    let update =
        |more: Document| doc! { "update": "c", "updates": [with(doc! { "q": {}, "u": { "$set": { "n": 1 } } }, more)] };
    let aggregate = |stage: Document| doc! { "aggregate": "c", "pipeline": [stage], "cursor": {} };
    let merge = |options: Document| aggregate(doc! { "$merge": with(doc! { "into": "t" }, options) });
    let of = |value: &Bson| {
        [
            doc! { "insert": "c", "documents": [{}], "ordered": value },
            doc! { "delete": "c", "deletes": [{ "q": { "_id": 9 }, "limit": 1 }], "ordered": value },
            update(doc! { "multi": value }),
            update(doc! { "upsert": value }),
            with(update(doc! {}), doc! { "ordered": value }),
            doc! { "listCollections": 1, "nameOnly": value },
            doc! { "listCollections": 1, "authorizedCollections": value },
            doc! { "find": "c", "singleBatch": value },
            doc! { "find": "c", "noCursorTimeout": value },
            doc! { "find": "c", "allowPartialResults": value },
        ]
    };
    let others = [
        doc! { "count": "c", "limit": true },
        doc! { "count": "c", "maxTimeMS": -1 },
        doc! { "find": "c", "maxTimeMS": -1 },
        aggregate(doc! { "$out": { "db": "admin", "coll": "x" } }),
        aggregate(doc! { "$merge": { "into": { "db": "admin", "coll": "x" } } }),
        merge(doc! { "into": { "coll": 1 } }),
        merge(doc! { "into": { "coll": "x", "db": 1 } }),
        aggregate(doc! { "$out": "a$b" }),
        aggregate(doc! { "$out": "system.x" }),
        aggregate(doc! { "$merge": "a$b" }),
        aggregate(doc! { "$merge": "system.x" }),
        merge(doc! { "on": [1] }),
        merge(doc! { "on": [] }),
        merge(doc! { "on": ["a", "a"] }),
        merge(doc! { "on": "" }),
        merge(doc! { "on": "$a" }),
        // There is no such index, which is found before documents without the field are.
        merge(doc! { "on": "u" }),
        merge(doc! { "into": "none", "on": "u" }),
        merge(doc! { "whenNotMatched": 1 }),
        aggregate(doc! { "$indexStats": { "a": 1 } }),
    ];
    let inserted = |command: &Document| command.get("ordered") == Some(&Bson::Null) && command.contains_key("insert");
    wrong.iter().flat_map(of).chain(others).filter(|command| !inserted(command)).collect()
}

/// What an answer says of what was done, and of what was not.
fn said(answer: &Document) -> Document {
    let keys = ["ok", "n", "nModified", "code", "codeName", "dropped", "retriedStmtIds"];
    let mut said: Document =
        keys.iter().filter_map(|key| Some(((*key).to_owned(), answer.get(key)?.clone()))).collect();
    if let Ok(errors) = answer.get_array("writeErrors") {
        let codes = errors.iter().filter_map(|error| error.as_document()?.get("code").cloned());
        said.insert("writeErrors", codes.collect::<Vec<Bson>>());
    }
    if let Ok(error) = answer.get_document("writeConcernError") {
        said.insert("writeConcernError", doc! { "code": error.get("code"), "codeName": error.get("codeName") });
    }
    said
}

/// What is answered to a command on collections of its own, and what is stored then.
fn outcome(wire: &mut Wire, command: &Document) -> Result<Document, Failed> {
    let own = |command: Document| with(command, doc! { "$db": "failures" });
    for (name, ids) in [("c", 0..4), ("t", 2..3)] {
        let documents: Vec<Document> = ids.map(|id| doc! { "_id": id, "n": 0 }).collect();
        wire.run(&own(doc! { "drop": name }))?;
        wire.run(&own(doc! { "insert": name, "documents": documents }))?;
    }
    let mut outcome = said(&wire.run(&own(command.clone()))?);
    for name in ["c", "t"] {
        let found = wire.run(&own(doc! { "find": name, "sort": { "_id": 1 } }))?;
        outcome.insert(name, found.get_document("cursor")?.get_array("firstBatch")?.clone());
    }
    Ok(outcome)
}

/// Commands that are refused in the same words.
fn explained() -> Vec<Document> {
    let change = |collection: &str, query: Document, update: Document| {
        doc! { "findAndModify": collection, "query": query, "update": update }
    };
    let set = |fields: Document| doc! { "$set": fields };
    let pipeline = |stages: Vec<Document>| doc! { "aggregate": "c", "pipeline": stages, "cursor": {} };
    let merge = |fields: Document, options: Document| {
        pipeline(vec![set(fields), doc! { "$merge": with(doc! { "into": "t" }, options) }])
    };
    let confirmed = || doc! { "writeConcern": { "w": 1 } };
    let by_zero = || doc! { "$expr": { "$divide": ["$n", 0] } };
    vec![
        change("t", doc! { "_id": 2 }, set(doc! { "u": 1 })),
        with(change("t", doc! { "_id": 9, "u": 1 }, set(doc! { "n": 1 })), doc! { "upsert": true }),
        change("v", doc! { "_id": 1 }, set(doc! { "n": -1 })),
        with(change("v", doc! { "_id": 2 }, set(doc! { "n": -1 })), doc! { "upsert": true }),
        change("c", by_zero(), set(doc! { "n": 1 })),
        doc! { "findAndModify": "c", "query": by_zero(), "remove": true },
        doc! { "findAndModify": "c", "update": [set(doc! { "n": { "$divide": [1, "$n"] } })] },
        // These, before a document is looked for.
        doc! { "findAndModify": "c", "query": { "n": { "$unknown": 1 } }, "remove": true },
        doc! { "findAndModify": "c", "query": {} },
        with(change("c", doc! {}, set(doc! { "n": 1 })), doc! { "remove": true }),
        pipeline(vec![set(doc! { "n": -1 }), doc! { "$out": "v" }]),
        pipeline(vec![set(doc! { "n": -1 }), doc! { "$merge": "v" }]),
        pipeline(vec![set(doc! { "n": { "$divide": [1, "$n"] } }), doc! { "$out": "x" }]),
        merge(doc! {}, doc! { "whenMatched": "fail" }),
        merge(doc! { "_id": 7, "u": 1 }, doc! { "whenMatched": "fail" }),
        merge(doc! { "_id": 7, "u": 1 }, doc! {}),
        merge(doc! { "u": 1 }, doc! { "on": "u", "whenMatched": "fail" }),
        // What does not write, has no write concern.
        with(doc! { "ping": 1 }, confirmed()),
        with(doc! { "find": "c" }, confirmed()),
        with(doc! { "explain": { "find": "c" } }, confirmed()),
        with(doc! { "getMore": 7_i64, "collection": "c" }, confirmed()),
        with(doc! { "mapReduce": "c", "map": "", "reduce": "", "out": { "inline": 1 } }, confirmed()),
    ]
}

/// Why a command is refused.
fn explanation(wire: &mut Wire, command: &Document) -> Result<Document, Failed> {
    let mut run = |command: Document| wire.run(&with(command, doc! { "$db": "failures" }));
    for (name, documents) in [
        ("c", vec![doc! { "_id": 0, "n": 0 }, doc! { "_id": 2, "n": 0 }]),
        ("t", vec![doc! { "_id": 2, "u": 2 }, doc! { "_id": 3, "u": 1 }]),
        ("v", vec![doc! { "_id": 1, "n": 1 }]),
    ] {
        run(doc! { "drop": name })?;
        run(doc! { "insert": name, "documents": documents })?;
    }
    run(doc! { "createIndexes": "t", "indexes": [{ "key": { "u": 1 }, "name": "u", "unique": true }] })?;
    run(doc! { "collMod": "v", "validator": { "n": { "$gt": 0 } } })?;
    let answer = run(command.clone())?;
    let said = |name: &str| Some((name.to_owned(), answer.get(name)?.clone()));
    Ok(["code", "codeName", "errmsg"].into_iter().filter_map(said).collect())
}

fn beside(mongod: &str) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let address = mongod.trim_start_matches("mongodb://").split('/').next().unwrap_or_default();
    let (mut real, mut own) = (Wire::connect(address)?, Wire::connect(served.address())?);
    for command in commands().into_iter().chain(refused()) {
        assert_eq!(outcome(&mut own, &command)?, outcome(&mut real, &command)?, "{command}");
    }
    for command in explained() {
        let (real, own) = (explanation(&mut real, &command)?, explanation(&mut own, &command)?);
        assert!(real.contains_key("errmsg"), "{command} is not refused");
        assert_eq!(own, real, "{command}");
    }
    // Of a database that is not there, nothing is dropped.
    let drop = doc! { "dropDatabase": 1, "writeConcern": { "w": 5, "wtimeout": 100 }, "$db": "failures" };
    for _ in 0..2 {
        assert_eq!(said(&own.run(&drop)?), said(&real.run(&drop)?));
    }
    assert_eq!(in_no_time(&mut own)?, in_no_time(&mut real)?);
    Ok(())
}

/// A cursor that waits for nothing has no time to wait, and goes on after it was asked so.
fn in_no_time(wire: &mut Wire) -> Result<[Document; 2], Failed> {
    let own = |command: Document| with(command, doc! { "$db": "failures" });
    let answer = wire.run(&own(doc! { "find": "c", "batchSize": 1 }))?;
    let more = doc! { "getMore": answer.get_document("cursor")?.get_i64("id")?, "collection": "c", "batchSize": 1 };
    let limited = wire.run(&own(with(more.clone(), doc! { "maxTimeMS": 5 })))?;
    Ok([said(&limited), said(&wire.run(&own(more))?)])
}

/// Another client inserts while `$merge` writes, also where the connection has a cursor.
fn between() -> Result<(), Failed> {
    const COUNT: i32 = 40_000;
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let (mut wire, mut other) = (Wire::connect(served.address())?, Wire::connect(served.address())?);
    let documents: Vec<Document> = (0..COUNT).map(|n| doc! { "_id": n, "n": n }).collect();
    wire.run(&doc! { "insert": "from", "documents": documents, "$db": "a" })?;
    let count = |wire: &mut Wire, name: &str| -> Result<i32, Failed> {
        Ok(wire.run(&doc! { "count": name, "$db": "a" })?.get_i32("n")?)
    };
    for target in ["first", "second"] {
        if target == "second" {
            wire.run(&doc! { "find": "from", "batchSize": 1, "$db": "a" })?;
        }
        let command = doc! { "aggregate": "from", "pipeline": [{ "$merge": target }], "cursor": {}, "$db": "a" };
        let (answer, seen) = std::thread::scope(|scope| -> Result<_, Failed> {
            let writing = scope.spawn(|| wire.run(&command).map_err(|error| format!("{error:?}")));
            let mut seen = false;
            while !writing.is_finished() {
                let insert = doc! { "insert": "other", "documents": [{}], "$db": "a" };
                assert_eq!(other.run(&insert)?.get_i32("n")?, 1);
                seen |= (1..COUNT).contains(&count(&mut other, target)?);
            }
            Ok((writing.join().map_err(|_| "it panicked")??, seen))
        })?;
        assert_eq!(answer.get_f64("ok")?, 1.0, "{answer}");
        assert!(seen, "an insert was done before the end");
        assert_eq!(count(&mut other, target)?, COUNT);
    }
    Ok(())
}

/// On a disk of 12 MiB, which is more than a connection keeps in memory of what it writes: there is room for one statement of a
/// command, and not for the log of the one before it, by which the command fails as a whole. The server goes on.
pub(crate) fn full_disk(folder: &Path) -> Result<(), Failed> {
    let served = Served::start(folder, &[])?;
    let mut wire = Wire::connect(served.address())?;
    wire.run(&doc! { "insert": "c", "documents": [{ "_id": 0, "n": 0 }], "$db": "a" })?;
    let insert = doc! { "insert": "c", "documents": [{ "text": "x".repeat(30_000) }], "$db": "a" };
    while wire.run(&insert)?.contains_key("n") {}
    let all = doc! { "q": {}, "u": { "$inc": { "n": 1 } }, "multi": true };
    let one = doc! { "q": { "_id": 0 }, "u": { "$inc": { "n": 1 } } };
    for _ in 0..3 {
        let updates = [&all, &one];
        let answer = wire.run(&doc! { "update": "c", "updates": updates, "ordered": false, "$db": "a" })?;
        assert!(answer.get_str("errmsg").is_ok_and(|message| message.contains("the disk is full")), "{answer}");
        let found = wire.run(&doc! { "find": "c", "filter": { "n": { "$exists": true } }, "$db": "a" })?;
        let found = found.get_document("cursor")?.get_array("firstBatch")?.clone();
        assert_eq!(found, [Bson::from(doc! { "_id": 0, "n": 0 })], "{answer}");
    }
    let answer = wire.run(&doc! { "update": "c", "updates": [one], "$db": "a" })?;
    assert_eq!(answer.get_i32("nModified")?, 1, "{answer}");
    Ok(())
}
