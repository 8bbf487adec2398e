//! Operations that end before they are done: by `killOp`, with their cursor or session, with their client, or in time.

use std::thread::JoinHandle;

use bson::{Bson, Document, doc};
use libtest_mimic::Failed;

use super::wire::{Wire, message};
use super::{Case, Served};
use crate::processes::until;

pub(super) const CASES: &[(&str, Case)] = &[
    ("an_operation_is_listed_and_ended_by_its_number", ended),
    ("a_write_that_waits_for_its_turn_is_given_up", given_up),
    ("what_only_reads_ends_with_its_client_and_a_write_does_not", left),
    ("an_operation_ends_with_its_cursor_or_its_session", killed),
    ("one_call_of_a_function_takes_no_longer_than_its_command_may", called),
];

/// How many documents there are. With the function below, looking at all of them takes minutes.
const COUNT: i32 = 10_000;

/// A function that takes 30 ms.
fn slow(result: &str) -> String {
    format!("var begin = Date.now(); while (Date.now() - begin < 30) {{}} return {result}")
}

fn served(folder: &std::path::Path) -> Result<(Served, Wire), Failed> {
    let served = Served::start(folder, &[])?;
    let mut wire = Wire::connect(served.address())?;
    let documents: Vec<_> = (0..COUNT).map(|n| doc! { "_id": n }).collect();
    wire.run(&doc! { "insert": "c", "documents": documents, "$db": "a" })?;
    Ok((served, wire))
}

/// What is being done in the database `a`.
fn running(wire: &mut Wire) -> Result<Vec<Document>, Failed> {
    let answer = wire.run(&doc! { "currentOp": 1, "ns": { "$regex": "^a\\." }, "$db": "admin" })?;
    Ok(answer.get_array("inprog")?.iter().filter_map(Bson::as_document).cloned().collect())
}

/// Waits until one operation has run for half a second, so that the first of its statements is done; returns what is said of it.
fn listed(wire: &mut Wire) -> Result<Document, Failed> {
    let mut found = None;
    until("an operation runs", || {
        let is_long = |one: &Document| one.get_i64("microsecs_running").is_ok_and(|micros| micros > 500_000);
        found = running(wire)?.into_iter().find(is_long);
        Ok(found.is_some())
    })?;
    Ok(found.ok_or("no operation")?)
}

fn kill(wire: &mut Wire, operation: &Document) -> Result<(), Failed> {
    let answer = wire.run(&doc! { "killOp": 1, "op": operation.get_i32("opid")?, "$db": "admin" })?;
    assert_eq!(answer.get_f64("ok")?, 1.0);
    Ok(())
}

/// Runs a command on a connection of its own; returns the code of its failure.
fn begin(served: &Served, command: &Document) -> Result<JoinHandle<Option<i32>>, Failed> {
    let (mut wire, command) = (Wire::connect(served.address())?, command.clone());
    let work = move || wire.run(&command).ok().and_then(|answer| answer.get_i32("code").ok());
    Ok(std::thread::spawn(work))
}

fn code(begun: JoinHandle<Option<i32>>) -> Option<i32> {
    begun.join().expect("no panic")
}

fn count(wire: &mut Wire, query: Document) -> Result<i32, Failed> {
    Ok(wire.run(&doc! { "count": "c", "query": query, "$db": "a" })?.get_i32("n")?)
}

fn ended() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let (served, mut wire) = served(folder.path())?;
    let predicate = doc! { "$where": slow("true") };
    let expression =
        doc! { "$function": { "body": format!("function() {{ {} }}", slow("1")), "args": [], "lang": "js" } };
    let update = |q: Document| doc! { "q": q, "u": { "$set": { "n": 1 } }, "multi": true };
    let removal = doc! { "q": { "$where": slow("false") }, "limit": 0 };
    let grown = doc! { "$project": { "all": { "$range": [0, 1_000_000] } } };
    let commands = [
        ("query", doc! { "find": "c", "filter": predicate.clone(), "batchSize": 5000 }),
        ("command", doc! { "count": "c", "query": predicate.clone() }),
        ("command", doc! { "distinct": "c", "key": "n", "query": predicate.clone() }),
        ("command", doc! { "aggregate": "c", "pipeline": [{ "$group": { "_id": expression.clone() } }], "cursor": {} }),
        (
            "command",
            doc! { "aggregate": "c", "pipeline": [{ "$set": { "n": expression } }, { "$out": "d" }], "cursor": {} },
        ),
        (
            "command",
            doc! { "aggregate": "c", "pipeline": [grown, { "$unwind": "$all" }, { "$count": "n" }], "cursor": {} },
        ),
        (
            "command",
            doc! { "mapReduce": "c", "map": format!("function() {{ {} }}", slow("0")), "reduce": "0", "out": { "inline": 1 } },
        ),
        ("update", doc! { "update": "c", "updates": [update(doc! { "_id": 7 }), update(predicate.clone())] }),
        ("remove", doc! { "delete": "c", "deletes": [removal] }),
    ];
    for (kind, mut command) in commands {
        command.insert("$db", "a");
        let begun = begin(&served, &command)?;
        let operation = listed(&mut wire)?;
        let collection = format!("a.{}", command.values().next().and_then(Bson::as_str).unwrap_or_default());
        assert_eq!((operation.get_str("op")?, operation.get_str("ns")?), (kind, collection.as_str()));
        assert_eq!(operation.get_document("command")?, &command);
        kill(&mut wire, &operation)?;
        assert_eq!(code(begun), Some(11_601), "{command}");
    }
    // What was done before stays, and nothing of the statement that ended.
    assert_eq!((count(&mut wire, doc! { "n": 1 })?, count(&mut wire, doc! {})?), (1, COUNT));
    // One that is over, or of a number that there was not yet, is not looked for.
    kill(&mut wire, &doc! { "opid": i32::MAX })?;
    let all = wire.run(&doc! { "currentOp": 1, "$all": true, "$db": "admin" })?;
    assert!(
        all.get_array("inprog")?
            .iter()
            .filter_map(Bson::as_document)
            .any(|one| one.get_str("op").is_ok_and(|op| op == "command"))
    );
    assert_eq!(wire.run(&doc! { "killOp": 1, "op": 1, "$db": "a" })?.get_i32("code")?, 13);
    Ok(())
}

fn given_up() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let (served, mut wire) = served(folder.path())?;
    let part = doc! { "lsid": { "id": bson::Uuid::new() }, "txnNumber": 1_i64, "autocommit": false };
    let with = |mut command: Document| {
        command.extend(part.clone());
        command
    };
    let mut own = Wire::connect(served.address())?;
    let insert = |id: i32| doc! { "insert": "c", "documents": [{ "_id": id }], "$db": "a" };
    let first = with(insert(COUNT)).into_iter().chain([("startTransaction".to_owned(), true.into())]).collect();
    assert_eq!(own.run(&first)?.get_i32("n")?, 1);
    let begun = begin(&served, &insert(COUNT + 1))?;
    let operation = listed(&mut wire)?;
    kill(&mut wire, &operation)?;
    assert_eq!(code(begun), Some(11_601));
    own.run(&with(doc! { "commitTransaction": 1, "$db": "admin" }))?;
    let later = insert(COUNT + 2);
    assert_eq!(wire.run(&later)?.get_i32("n")?, 1);
    assert_eq!(count(&mut wire, doc! { "_id": { "$gte": COUNT } })?, 2);
    Ok(())
}

fn left() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let (served, mut wire) = served(folder.path())?;
    let find = doc! { "find": "c", "filter": { "$where": slow("false") }, "$db": "a" };
    let watch = doc! { "aggregate": "c", "pipeline": [{ "$changeStream": {} }], "cursor": {}, "$db": "a" };
    let stream = wire.run(&watch)?.get_document("cursor")?.get_i64("id")?;
    let wait = doc! { "getMore": stream, "collection": "c", "maxTimeMS": 3_600_000, "$db": "a" };
    for command in [find, wait] {
        let mut leaving = Wire::connect(served.address())?;
        leaving.send(&message(&command))?;
        listed(&mut wire)?;
        drop(leaving);
        until("the operation has ended", || Ok(running(&mut wire)?.is_empty()))?;
    }
    // A second of work, whose client does not wait for it.
    let q = doc! { "_id": { "$lt": 40 }, "$where": slow("true") };
    let update =
        doc! { "update": "c", "updates": [{ "q": q, "u": { "$set": { "n": 1 } }, "multi": true }], "$db": "a" };
    let mut leaving = Wire::connect(served.address())?;
    leaving.send(&message(&update))?;
    listed(&mut wire)?;
    drop(leaving);
    until("the write has ended", || Ok(running(&mut wire)?.is_empty()))?;
    assert_eq!(count(&mut wire, doc! { "n": 1 })?, 40);
    Ok(())
}

fn killed() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let (served, mut wire) = served(folder.path())?;
    let lsid = doc! { "id": bson::Uuid::new() };
    let of_session = |mut command: Document| {
        command.extend(doc! { "lsid": lsid.clone(), "$db": "a" });
        command
    };
    let filter = doc! { "$where": slow("true") };
    let first = of_session(doc! { "find": "c", "filter": filter.clone(), "batchSize": 1 });
    let cursor = wire.run(&first)?.get_document("cursor")?.get_i64("id")?;
    // Another connection reads it, through the thread of the first one.
    let begun = begin(&served, &of_session(doc! { "getMore": cursor, "collection": "c", "batchSize": 5000 }))?;
    let mut other = Wire::connect(served.address())?;
    listed(&mut other)?;
    let answer = other.run(&doc! { "killCursors": "c", "cursors": [cursor], "$db": "a" })?;
    assert_eq!(answer.get_array("cursorsKilled")?, &[Bson::Int64(cursor)]);
    assert_eq!(code(begun), Some(237));
    for kill in [doc! { "killSessions": [lsid.clone()] }, doc! { "killAllSessions": [] }] {
        let begun = begin(&served, &of_session(doc! { "count": "c", "query": filter.clone() }))?;
        listed(&mut other)?;
        // A session that ends at its client leaves its operations alone.
        other.run(&doc! { "endSessions": [lsid.clone()], "$db": "admin" })?;
        listed(&mut other)?;
        assert_eq!(other.run(&of_session(kill))?.get_f64("ok")?, 1.0);
        assert_eq!(code(begun), Some(11_601));
    }
    Ok(())
}

fn called() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let (_served, mut wire) = served(folder.path())?;
    let forever = "function() { while (true) {} }";
    let function = doc! { "$function": { "body": forever, "args": [], "lang": "js" } };
    let accumulator = doc! { "$accumulator": {
        "init": "function() { return 0 }", "accumulate": forever, "accumulateArgs": [], "merge": forever, "lang": "js",
    } };
    let update = doc! { "q": { "$where": forever }, "u": { "$set": { "n": 1 } } };
    let long = doc! { "$reduce": { "input": { "$range": [0, 100_000] }, "initialValue": 0, "in": { "$size": { "$range": [0, 100_000] } } } };
    let commands = [
        doc! { "find": "c", "filter": { "$where": forever } },
        doc! { "count": "c", "query": { "$where": forever } },
        doc! { "aggregate": "c", "pipeline": [{ "$set": { "n": function } }], "cursor": {} },
        doc! { "aggregate": "c", "pipeline": [{ "$group": { "_id": 1, "n": accumulator } }], "cursor": {} },
        doc! { "aggregate": "c", "pipeline": [{ "$set": { "n": long } }], "cursor": {} },
        doc! { "mapReduce": "c", "map": forever, "reduce": forever, "out": { "inline": 1 } },
        doc! { "mapReduce": "c", "map": "function() { emit(1, 1) }", "reduce": forever, "out": "d" },
        doc! { "update": "c", "updates": [update] },
    ];
    for mut command in commands {
        command.extend(doc! { "maxTimeMS": 300, "$db": "a" });
        let answer = wire.run(&command)?;
        assert_eq!(answer.get_i32("code").ok(), Some(50), "{command}: {answer}");
    }
    // Each stage doubles the document; an index is made of many.
    let double = vec![doc! { "$set": { "a": "$$ROOT", "b": "$$ROOT" } }; 17];
    let update = doc! { "q": { "_id": 1 }, "u": double.clone() };
    let commands = [
        doc! { "update": "c", "updates": [update] },
        doc! { "aggregate": "c", "pipeline": double, "cursor": {} },
        doc! { "createIndexes": "c", "indexes": [{ "key": { "n": 1 }, "name": "n_1" }] },
    ];
    for mut command in commands {
        command.extend(doc! { "maxTimeMS": 1, "$db": "a" });
        assert_eq!(wire.run(&command)?.get_i32("code").ok(), Some(50), "{command}");
    }
    assert_eq!(wire.run(&doc! { "collStats": "c", "$db": "a" })?.get_i32("nindexes")?, 1);
    assert_eq!((count(&mut wire, doc! { "n": 1 })?, count(&mut wire, doc! {})?), (0, COUNT));
    Ok(())
}
