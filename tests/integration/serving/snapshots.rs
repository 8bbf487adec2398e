//! Sessions that read the memory as it was at their first read.

use bson::{Bson, Document, Timestamp, doc};
use libtest_mimic::Failed;

use super::wire::Wire;
use super::{Case, Served, code};

pub(super) const CASES: &[(&str, Case)] = &[
    ("a_session_with_a_snapshot_reads_what_was_there_at_its_first_read", driven),
    ("a_snapshot_is_read_by_its_time_and_cursors_until_the_session_has_another", by_time),
];

/// By a driver, which remembers the time.
fn driven() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let client = served.client()?;
    let things = client.database("a").collection::<Document>("things");
    things.insert_many((0..3).map(|id| doc! { "_id": id, "n": 1 })).run()?;
    let mut session = client.start_session().snapshot(true).run()?;
    assert_eq!(things.find_one(doc! { "_id": 1 }).session(&mut session).run()?, Some(doc! { "_id": 1, "n": 1 }));
    things.update_many(doc! {}, doc! { "$set": { "n": 2 } }).run()?;
    things.insert_one(doc! { "_id": 3, "n": 2 }).run()?;
    assert_eq!(things.count_documents(doc! { "n": 1 }).session(&mut session).run()?, 3);
    assert_eq!(things.distinct("n", doc! {}).session(&mut session).run()?, [Bson::Int32(1)]);
    assert_eq!(things.count_documents(doc! { "n": 2 }).run()?, 4);
    let mut later = client.start_session().snapshot(true).run()?;
    assert_eq!(things.count_documents(doc! { "n": 2 }).session(&mut later).run()?, 4);
    assert!(things.insert_one(doc! { "_id": 4 }).session(&mut session).run().is_err());
    assert_eq!(code(things.watch().session(&mut session).run()), Some(72));
    let out = things.aggregate([doc! { "$out": "copy" }]).session(&mut session).run();
    assert!(out.err().is_some_and(|error| error.to_string().contains("nothing can be written in a snapshot")));
    Ok(())
}

fn ids(answer: &Document, batch: &str) -> Result<Vec<i32>, Failed> {
    let found = answer.get_document("cursor")?.get_array(batch)?.iter().filter_map(Bson::as_document);
    Ok(found.map(|document| document.get_i32("_id")).collect::<Result<_, _>>()?)
}

fn by_time() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut wire = Wire::connect(served.address())?;
    let id = doc! { "id": bson::Uuid::new() };
    let mut run = |command: Document, concern: Option<Document>| {
        let own = doc! { "lsid": id.clone(), "$db": "a" };
        let concern = concern.map(|concern| ("readConcern".to_owned(), concern.into()));
        wire.run(&command.into_iter().chain(own).chain(concern).collect())
    };
    let snapshot = || Some(doc! { "level": "snapshot" });
    let at = |time: Timestamp| Some(doc! { "level": "snapshot", "atClusterTime": time });
    run(doc! { "insert": "c", "documents": (0..5).map(|id| doc! { "_id": id }).collect::<Vec<_>>() }, None)?;
    let first = run(doc! { "find": "c", "batchSize": 2 }, snapshot())?;
    let cursor = first.get_document("cursor")?;
    let time = cursor.get_timestamp("atClusterTime")?;
    run(doc! { "insert": "c", "documents": [{ "_id": 9 }] }, None)?;
    let more = run(doc! { "getMore": cursor.get_i64("id")?, "collection": "c" }, None)?;
    assert_eq!([ids(&first, "firstBatch")?, ids(&more, "nextBatch")?].concat(), [0, 1, 2, 3, 4]);
    // Some drivers say with each batch which snapshot it is of.
    let of_all =
        doc! { "aggregate": "c", "pipeline": [{ "$match": { "_id": { "$gte": 0 } } }], "cursor": { "batchSize": 2 } };
    for command in [doc! { "find": "c", "batchSize": 2 }, of_all] {
        let first = run(command, at(time))?;
        let cursor = first.get_document("cursor")?.get_i64("id")?;
        let second = run(doc! { "getMore": cursor, "collection": "c", "batchSize": 2 }, at(time))?;
        let third = run(doc! { "getMore": cursor, "collection": "c", "batchSize": 2 }, at(time))?;
        let found = [ids(&first, "firstBatch")?, ids(&second, "nextBatch")?, ids(&third, "nextBatch")?];
        assert_eq!(found.concat(), [0, 1, 2, 3, 4]);
        assert_eq!(third.get_document("cursor")?.get_i64("id")?, 0);
    }
    // A command that fails ends nothing.
    let code = |answer: Document| answer.get_i32("code").ok();
    assert_eq!(code(run(doc! { "find": "c", "filter": { "$bad": 1 } }, at(time))?), Some(2));
    let again = run(doc! { "find": "c" }, at(time))?;
    assert_eq!(ids(&again, "firstBatch")?, [0, 1, 2, 3, 4]);
    assert_eq!(again.get_document("cursor")?.get_timestamp("atClusterTime")?, time);
    for command in ["count", "insert", "listIndexes", "ping"] {
        assert_eq!(code(run(doc! { command: "c" }, snapshot())?), Some(72), "{command}");
    }
    let explained = doc! { "aggregate": "c", "pipeline": [], "cursor": {}, "explain": true };
    assert_eq!(code(run(explained, snapshot())?), Some(72));
    assert_eq!(code(run(doc! { "explain": { "find": "c" } }, snapshot())?), Some(72));
    let future = Timestamp { time: time.time + 1000, increment: 1 };
    assert_eq!(code(run(doc! { "find": "c" }, at(future))?), Some(72));
    let values = run(doc! { "distinct": "c", "key": "_id" }, snapshot())?;
    assert_eq!(values.get_array("values")?.len(), 6);
    assert!(values.get_timestamp("atClusterTime")? > time);
    // The session has another now.
    assert_eq!(code(run(doc! { "find": "c" }, at(time))?), Some(246));
    Ok(())
}
