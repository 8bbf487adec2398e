//! Change streams.

use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use bson::spec::BinarySubtype;
use bson::{Binary, Bson, Document, doc};
use libtest_mimic::Failed;
use mongodb::change_stream::event::{ChangeNamespace, ChangeStreamEvent, OperationType};
use mongodb::options::{FullDocumentBeforeChangeType, FullDocumentType};
use mongodb::sync::ChangeStream;

use super::wire::Wire;
use super::{Case, Served, TIMEOUT, code};

pub(super) const CASES: &[(&str, Case)] = &[
    ("a_stream_reports_changes_with_the_documents_before_them", reported),
    ("a_stream_goes_on_behind_a_token_also_after_a_kill", resumed),
    ("a_stream_ends_where_its_collection_is_gone", ended),
    ("a_rename_is_one_event_and_ends_the_streams_of_both_names", renamed),
    ("a_stream_that_leaves_its_end_out_goes_on_behind_it", ended_unseen),
    ("a_restore_is_a_drop_and_inserts", restored),
    ("a_stream_of_a_database_ends_where_that_is_dropped", database_ended),
    ("a_stream_of_a_database_or_of_all_hears_every_collection", wider),
    ("a_change_by_another_process_is_reported", received),
    ("a_stream_from_a_time_misses_nothing_or_says_so", since),
    ("a_stream_from_the_time_of_a_write_begins_with_it", inclusive),
    ("a_stream_from_the_time_of_a_read_misses_nothing_that_was_not_read", read_among_writes),
    ("times_of_many_writes_at_once_do_not_run_ahead_of_the_clock", punctual),
    ("the_events_of_a_transaction_have_one_time_and_name_it", joined),
    ("an_event_that_is_too_large_is_refused", large),
    ("computed_documents_and_metadata_are_no_changes", hidden),
];

type Stream = ChangeStream<ChangeStreamEvent<Document>>;

fn next(stream: &mut Stream) -> Result<ChangeStreamEvent<Document>, Failed> {
    let since = Instant::now();
    while since.elapsed() < TIMEOUT {
        if let Some(event) = stream.next_if_any()? {
            return Ok(event);
        }
    }
    Err("no event came".into())
}

/// Writes of many clients are made durable together, some of which change nothing, or what no stream follows.
fn punctual() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let things = served.client()?.database("a").collection::<Document>("things");
    let _stream = things.watch().run()?;
    let until = Instant::now() + Duration::from_secs(2);
    let write = |client: i32| -> Result<i64, String> {
        let mut wire = Wire::connect(served.address()).map_err(|error| format!("{error:?}"))?;
        let mut ahead = i64::MIN;
        for n in 0.. {
            let (name, id) = (if client % 2 == 0 { "things" } else { "others" }, 1_000_000 * client + n);
            let command = match (client + n) % 3 {
                0 => doc! { "insert": name, "documents": [{ "_id": id }], "$db": "a" },
                _ => {
                    doc! { "update": name, "updates": [{ "q": { "_id": -1 }, "u": { "$set": { "n": 1 } } }], "$db": "a" }
                }
            };
            let answer = wire.run(&command).map_err(|error| format!("{error:?}"))?;
            let time = answer.get_timestamp("operationTime").map_err(|error| error.to_string())?;
            let millis = i64::from(time.time) * 1000 + i64::from(time.increment / 4_000_000);
            ahead = ahead.max(millis - bson::DateTime::now().timestamp_millis());
            if Instant::now() > until {
                break;
            }
        }
        Ok(ahead)
    };
    let ahead = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..32).map(|client| scope.spawn(move || write(client))).collect();
        let times = threads.into_iter().map(|thread| thread.join().expect("no panic"));
        times.collect::<Result<Vec<_>, _>>()
    })?;
    let most = ahead.into_iter().max();
    assert!(most.is_some_and(|most| most < 20), "{most:?} ms");
    Ok(())
}

fn reported() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let things = served.client()?.database("a").collection::<Document>("things");
    let watch = things.watch().full_document(FullDocumentType::UpdateLookup);
    let mut stream = watch.full_document_before_change(FullDocumentBeforeChangeType::Required).run()?;
    things.insert_one(doc! { "_id": 1, "n": { "a": 1, "b": 1 }, "l": [1, 2] }).run()?;
    things.update_one(doc! {}, doc! { "$set": { "n.a": 2 }, "$unset": { "n.b": 1 }, "$pop": { "l": 1 } }).run()?;
    things.replace_one(doc! {}, doc! { "z": 1 }).run()?;
    // What changes nothing is no change.
    things.update_one(doc! {}, doc! { "$set": { "z": 1 } }).run()?;
    things.delete_one(doc! {}).run()?;
    let inserted = next(&mut stream)?;
    assert_eq!(inserted.operation_type, OperationType::Insert);
    assert_eq!(inserted.full_document, Some(doc! { "_id": 1, "n": { "a": 1, "b": 1 }, "l": [1, 2] }));
    let updated = next(&mut stream)?;
    let description = updated.update_description.ok_or("no description")?;
    assert_eq!(description.updated_fields, doc! { "n.a": 2 });
    assert_eq!(description.removed_fields, ["n.b"]);
    let truncated = description.truncated_arrays.unwrap_or_default();
    assert_eq!((truncated[0].field.as_str(), truncated[0].new_size), ("l", 1));
    assert_eq!(updated.full_document, Some(doc! { "_id": 1, "n": { "a": 2 }, "l": [1] }));
    assert_eq!(updated.full_document_before_change, inserted.full_document);
    let replaced = next(&mut stream)?;
    assert_eq!(replaced.operation_type, OperationType::Replace);
    assert_eq!(replaced.full_document, Some(doc! { "_id": 1, "z": 1 }));
    let deleted = next(&mut stream)?;
    assert_eq!(deleted.operation_type, OperationType::Delete);
    assert_eq!(deleted.full_document_before_change, Some(doc! { "_id": 1, "z": 1 }));
    assert_eq!(deleted.document_key, Some(doc! { "_id": 1 }));
    assert!(inserted.cluster_time < deleted.cluster_time);
    Ok(())
}

fn since() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let database = served.client()?.database("a");
    let things = database.collection::<Document>("things");
    let now = || -> Result<bson::Timestamp, Failed> {
        Ok(database.run_command(doc! { "ping": 1 }).run()?.get_timestamp("operationTime")?)
    };
    let before = now()?;
    things.insert_one(doc! { "_id": 1 }).run()?;
    let after = now()?;
    // What was written before anything was kept is lost, and a stream that would leave it out is refused.
    assert_eq!(code(things.watch().start_at_operation_time(before).run()), Some(286));
    assert_eq!(code(database.watch().start_at_operation_time(before).run()), Some(286));
    let mut stream = things.watch().start_at_operation_time(after).run()?;
    things.insert_one(doc! { "_id": 2 }).run()?;
    assert_eq!(next(&mut stream)?.document_key, Some(doc! { "_id": 2 }));
    // Once more, though other writes came since.
    let mut stream = things.watch().start_at_operation_time(after).run()?;
    assert_eq!(next(&mut stream)?.document_key, Some(doc! { "_id": 2 }));
    // What is kept for a database is kept for each of its collections.
    let mut stream = database.watch().run()?;
    let cups = database.collection::<Document>("cups");
    cups.insert_one(doc! { "_id": 1 }).run()?;
    cups.insert_one(doc! { "_id": 2 }).run()?;
    let token = next(&mut stream)?.id;
    let mut stream = cups.watch().resume_after(token).run()?;
    assert_eq!(next(&mut stream)?.document_key, Some(doc! { "_id": 2 }));
    Ok(())
}

/// The `_id`s in the events of a new stream of the collection `c`, with their times.
fn events(wire: &mut Wire, start: Document) -> Result<Vec<(i32, bson::Timestamp)>, Failed> {
    let stream = doc! { "aggregate": "c", "pipeline": [{ "$changeStream": start }], "cursor": {}, "$db": "a" };
    let answer = wire.run(&stream)?;
    let cursor = answer.get_document("cursor").map_err(|_| answer.to_string())?;
    let event = |event: &Bson| -> Result<_, Failed> {
        let event = event.as_document().ok_or("no event")?;
        Ok((event.get_document("documentKey")?.get_i32("_id")?, event.get_timestamp("clusterTime")?))
    };
    cursor.get_array("firstBatch")?.iter().map(event).collect()
}

fn inclusive() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut wire = Wire::connect(served.address())?;
    let insert = |id: i32| doc! { "insert": "c", "documents": [{ "_id": id }], "$db": "a" };
    // Of what was written before anything was kept, a stream cannot begin with the last, either.
    let unkept = wire.run(&insert(-1))?.get_timestamp("operationTime")?;
    let start = doc! { "$changeStream": { "startAtOperationTime": unkept } };
    let refused = wire.run(&doc! { "aggregate": "c", "pipeline": [start], "cursor": {}, "$db": "a" })?;
    assert_eq!(refused.get_i32("code")?, 286, "{refused}");
    events(&mut wire, doc! {})?;
    let mut times = Vec::new();
    for id in 0..20 {
        times.push(wire.run(&insert(id))?.get_timestamp("operationTime")?);
    }
    // That of a pipeline which writes is the time of its last event.
    let merge = doc! { "aggregate": "d", "pipeline": [{ "$merge": "c" }], "cursor": {}, "$db": "a" };
    wire.run(&doc! { "insert": "d", "documents": [{ "_id": 100 }, { "_id": 101 }], "$db": "a" })?;
    let merged = wire.run(&merge)?.get_timestamp("operationTime")?;
    assert_eq!(events(&mut wire, doc! { "startAtOperationTime": merged })?, [(101, merged)]);
    // Without a change, it is the time of the answer.
    let unchanged = wire.run(&merge)?.get_timestamp("operationTime")?;
    assert_eq!(events(&mut wire, doc! { "startAtOperationTime": unchanged })?, []);
    wire.run(&doc! { "delete": "c", "deletes": [{ "q": { "_id": { "$gte": 100 } }, "limit": 0 }], "$db": "a" })?;
    let all = events(&mut wire, doc! { "startAtOperationTime": times[0] })?;
    let all: Vec<_> = all.into_iter().filter(|(id, _)| *id < 100).collect();
    assert_eq!(all, (0..20).zip(times.clone()).collect::<Vec<_>>());
    for (id, time) in (0..).zip(times) {
        let from = |time: bson::Timestamp| doc! { "startAtOperationTime": time };
        let ids = |found: Vec<(i32, bson::Timestamp)>| {
            found.into_iter().map(|(id, _)| id).filter(|id| *id < 100).collect::<Vec<_>>()
        };
        assert_eq!(ids(events(&mut wire, from(time))?), (id..20).collect::<Vec<_>>());
        let behind = bson::Timestamp { increment: time.increment + 1, ..time };
        assert_eq!(ids(events(&mut wire, from(behind))?), (id + 1..20).collect::<Vec<_>>());
    }
    Ok(())
}

/// What is read while a write is being made durable does not have it yet.
fn read_among_writes() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut wire = Wire::connect(served.address())?;
    events(&mut wire, doc! {})?;
    let address = served.address().to_owned();
    let over = Arc::new(AtomicBool::new(false));
    let ended = Arc::clone(&over);
    let writer = std::thread::spawn(move || -> Result<(), String> {
        let mut wire = Wire::connect(&address).map_err(|error| format!("{error:?}"))?;
        for id in 0.. {
            if ended.load(Ordering::Relaxed) {
                break;
            }
            let insert = doc! { "insert": "c", "documents": [{ "_id": id }], "$db": "a" };
            wire.run(&insert).map_err(|error| format!("{error:?}"))?;
        }
        Ok(())
    });
    for round in 0..100_u8 {
        let mut read = doc! { "find": "c", "sort": { "_id": -1 }, "limit": 1, "$db": "a" };
        let is_snapshot = round % 2 == 1;
        if is_snapshot {
            let id = Binary { subtype: BinarySubtype::Uuid, bytes: vec![round; 16] };
            read.extend(doc! { "lsid": { "id": id }, "readConcern": { "level": "snapshot" } });
        }
        let read = wire.run(&read)?;
        let cursor = read.get_document("cursor").map_err(|_| read.to_string())?;
        let found = cursor.get_array("firstBatch")?;
        let last = found.first().and_then(Bson::as_document).map_or(-1, |found| found.get_i32("_id").unwrap_or(-1));
        let time =
            if is_snapshot { cursor.get_timestamp("atClusterTime")? } else { read.get_timestamp("operationTime")? };
        // The next write comes while the stream waits.
        let mut received = Vec::new();
        while received.is_empty() {
            received = events(&mut wire, doc! { "startAtOperationTime": time })?;
        }
        assert!(received[0].0 <= last + 1, "{round}: behind {last}, the first was {}", received[0].0);
    }
    over.store(true, Ordering::Relaxed);
    Ok(writer.join().map_err(|_| "it panicked")??)
}

fn joined() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let client = served.client()?;
    let [things, others] = ["c", "d"].map(|name| client.database("a").collection::<Document>(name));
    let mut stream = client.database("a").watch().run()?;
    things.insert_one(doc! { "_id": 1 }).run()?;
    let mut session = client.start_session().run()?;
    let id = session.id().get("id").cloned();
    for number in 1..=2 {
        session.start_transaction().run()?;
        things.insert_one(doc! { "_id": 10 * number }).session(&mut session).run()?;
        others.insert_one(doc! { "_id": 10 * number }).session(&mut session).run()?;
        // The times of the changes would differ.
        std::thread::sleep(Duration::from_millis(20));
        things.update_one(doc! { "_id": 1 }, doc! { "$inc": { "n": 1 } }).session(&mut session).run()?;
        session.commit_transaction().run()?;
    }
    things.delete_one(doc! { "_id": 1 }).run()?;
    let alone = next(&mut stream)?;
    assert!(alone.lsid.is_none() && alone.txn_number.is_none());
    let mut before = alone.cluster_time;
    let mut numbers = Vec::new();
    for _ in 1..=2 {
        let own = [next(&mut stream)?, next(&mut stream)?, next(&mut stream)?];
        // The driver may begin with the number of the session that the insert before had.
        numbers.push(own[0].txn_number.ok_or("no number")?);
        for event in &own {
            assert_eq!(
                (event.txn_number, event.cluster_time, event.wall_time),
                (own[0].txn_number, own[0].cluster_time, own[0].wall_time)
            );
            let lsid = event.lsid.as_ref().ok_or("no session")?;
            assert_eq!(lsid.get("id"), id.as_ref());
            assert_eq!(lsid.get_binary_generic("uid")?.len(), 32);
        }
        assert!(own[0].cluster_time > before);
        before = own[0].cluster_time;
        // A stream from that time begins with the first of them.
        let time = before.ok_or("no time")?;
        let mut again = things.watch().start_at_operation_time(time).run()?;
        assert_eq!(next(&mut again)?.document_key, own[0].document_key);
    }
    assert_eq!(numbers[1], numbers[0] + 1);
    let last = next(&mut stream)?;
    assert!(last.txn_number.is_none() && last.cluster_time > before);
    Ok(())
}

fn large() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let things = served.client()?.database("a").collection::<Document>("things");
    things.insert_one(doc! { "_id": 1, "text": "x".repeat(9 << 20) }).run()?;
    let watch = things.watch().full_document_before_change(FullDocumentBeforeChangeType::Required);
    let mut stream = watch.run()?;
    let mut small = things.watch().pipeline([doc! { "$project": { "operationType": 1 } }]).run()?;
    things.replace_one(doc! {}, doc! { "text": "y".repeat(9 << 20) }).run()?;
    let refused = loop {
        match stream.next_if_any() {
            Ok(None) => {}
            event => break code(event),
        }
    };
    assert_eq!(refused, Some(10_334));
    assert_eq!(next(&mut small)?.operation_type, OperationType::Replace);
    Ok(())
}

fn resumed() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let things = served.client()?.database("a").collection::<Document>("things");
    let mut stream = things.watch().run()?;
    for n in 0..10 {
        things.insert_one(doc! { "_id": n }).run()?;
    }
    let token = (0..5).map(|_| next(&mut stream)).last().ok_or("none")??.id;
    drop(stream);
    served.kill()?;
    // Changes while no server runs are not missed either.
    let rmem = std::process::Command::new(env!("CARGO_BIN_EXE_rmem"))
        .args(["--memory", "file:robot.rmem", "insert", "a.things", "{_id: 10}"])
        .current_dir(folder.path())
        .output()?;
    assert!(rmem.status.success());
    let served = Served::start(folder.path(), &[])?;
    let things = served.client()?.database("a").collection::<Document>("things");
    let mut stream = things.watch().resume_after(token).run()?;
    things.insert_one(doc! { "_id": 11 }).run()?;
    for n in 5..12 {
        assert_eq!(next(&mut stream)?.document_key, Some(doc! { "_id": n }));
    }
    let wrong = doc! { "aggregate": "things", "pipeline": [{ "$changeStream": { "resumeAfter": { "_data": "82" } } }], "cursor": {} };
    assert_eq!(code(served.client()?.database("a").run_command(wrong).run()), Some(260));
    Ok(())
}

fn ended() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let things = served.client()?.database("a").collection::<Document>("things");
    things.insert_one(doc! { "_id": 0 }).run()?;
    let mut stream = things.watch().run()?;
    things.drop().run()?;
    let dropped = next(&mut stream)?;
    assert_eq!(dropped.operation_type, OperationType::Drop);
    let end = next(&mut stream)?;
    assert_eq!(end.operation_type, OperationType::Invalidate);
    // Behind the event of the drop, too, though there is a collection of that name again.
    things.insert_one(doc! { "_id": 1 }).run()?;
    assert_eq!(code(things.watch().resume_after(end.id.clone()).run()), Some(260));
    let mut stream = things.watch().start_after(end.id.clone()).run()?;
    assert_eq!(next(&mut stream)?.document_key, Some(doc! { "_id": 1 }));
    for again in [things.watch().resume_after(dropped.id.clone()), things.watch().start_after(dropped.id)] {
        let mut stream = again.run()?;
        let event = next(&mut stream)?;
        assert_eq!((event.operation_type, event.id), (OperationType::Invalidate, end.id.clone()));
        assert!(!stream.is_alive());
    }
    Ok(())
}

/// As MongoDB 6.0 reports it, whether or not there is a collection in the place of the new name.
fn renamed() -> Result<(), Failed> {
    for has_target in [false, true] {
        let folder = tempfile::tempdir()?;
        let served = Served::start(folder.path(), &[])?;
        let client = served.client()?;
        let database = client.database("a");
        let [cups, mugs] = ["cups", "mugs"].map(|name| database.collection::<Document>(name));
        cups.insert_one(doc! { "_id": 1 }).run()?;
        if has_target {
            mugs.insert_one(doc! { "_id": 2 }).run()?;
        }
        let ending = [(&cups, cups.watch().run()?), (&mugs, mugs.watch().run()?)];
        let mut wider = [database.watch().run()?, client.watch().run()?];
        let rename = doc! { "renameCollection": "a.cups", "to": "a.mugs", "dropTarget": has_target };
        let done = client.database("admin").run_command(rename).run()?;
        mugs.insert_one(doc! { "_id": 3 }).run()?;
        let is_rename = |event: &ChangeStreamEvent<Document>| {
            assert_eq!(event.operation_type, OperationType::Rename);
            let named = |ns: &ChangeNamespace| (ns.db.clone(), ns.coll.clone().unwrap_or_default());
            let names = [&event.ns, &event.to].map(|ns| ns.as_ref().map(named));
            assert_eq!(names, ["cups", "mugs"].map(|name| Some(("a".to_owned(), name.to_owned()))));
            assert_eq!((&event.full_document, &event.document_key), (&None, &None));
        };
        // Each stream gives it the same token, and it is at the time that its command had.
        let mut ids = Vec::new();
        let time = done.get_timestamp("operationTime")?;
        is_rename(&next(&mut database.watch().start_at_operation_time(time).run()?)?);
        for (collection, mut stream) in ending {
            is_rename(&next(&mut collection.watch().start_at_operation_time(time).run()?)?);
            let event = next(&mut stream)?;
            is_rename(&event);
            ids.push(event.id.clone());
            let end = next(&mut stream)?;
            assert_eq!(end.operation_type, OperationType::Invalidate);
            assert!(!stream.is_alive());
            let mut stream = collection.watch().resume_after(event.id).run()?;
            assert_eq!(next(&mut stream)?.operation_type, OperationType::Invalidate);
        }
        for stream in &mut wider {
            let event = next(stream)?;
            is_rename(&event);
            ids.push(event.id);
            let inserted = next(stream)?;
            assert_eq!(
                (inserted.operation_type, inserted.document_key),
                (OperationType::Insert, Some(doc! { "_id": 3 }))
            );
        }
        ids.dedup();
        assert_eq!(ids.len(), 1, "{ids:?}");
    }
    Ok(())
}

/// A stream whose stages leave the end out is gone on with behind it.
fn ended_unseen() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let client = served.client()?;
    let cups = client.database("a").collection::<Document>("cups");
    cups.insert_one(doc! { "_id": 1 }).run()?;
    let inserts = || cups.watch().pipeline([doc! { "$match": { "operationType": "insert" } }]);
    let mut stream = inserts().run()?;
    client.database("admin").run_command(doc! { "renameCollection": "a.cups", "to": "a.mugs" }).run()?;
    let since = Instant::now();
    while stream.is_alive() && since.elapsed() < TIMEOUT {
        assert_eq!(stream.next_if_any()?, None);
    }
    let token = stream.resume_token().ok_or("no token")?;
    cups.insert_one(doc! { "_id": 2 }).run()?;
    assert_eq!(code(inserts().resume_after(token.clone()).run().map(drop)), Some(260));
    assert_eq!(next(&mut inserts().start_after(token).run()?)?.document_key, Some(doc! { "_id": 2 }));
    Ok(())
}

/// What a restore fills first is rmem's own.
fn restored() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let database = served.client()?.database("a");
    let cups = database.collection::<Document>("cups");
    cups.insert_one(doc! { "_id": 1 }).run()?;
    let mut stream = database.watch().run()?;
    let rmem = |arguments: &[&str]| -> Result<(), Failed> {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rmem"));
        let done = command.current_dir(&folder).args(["--memory", "file:robot.rmem"]).args(arguments).status()?;
        if done.success() { Ok(()) } else { Err(format!("{arguments:?}: {done}").into()) }
    };
    rmem(&["dump", "a.cups", "-o", "cups.json"])?;
    rmem(&["restore", "cups.json", "--drop"])?;
    for kind in [OperationType::Drop, OperationType::Insert] {
        let event = next(&mut stream)?;
        assert_eq!((event.operation_type, event.ns.and_then(|ns| ns.coll)), (kind, Some("cups".to_owned())));
    }
    Ok(())
}

fn database_ended() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let client = served.client()?;
    let database = client.database("a");
    database.collection("things").insert_one(doc! { "_id": 1 }).run()?;
    let (mut stream, mut all) = (database.watch().run()?, client.watch().run()?);
    database.drop().run()?;
    assert_eq!(next(&mut stream)?.operation_type, OperationType::Drop);
    let event = next(&mut stream)?;
    assert_eq!(event.operation_type, OperationType::DropDatabase);
    assert_eq!(event.ns.map(|ns| (ns.db, ns.coll)), Some(("a".to_owned(), None)));
    assert_eq!(next(&mut stream)?.operation_type, OperationType::Invalidate);
    assert!(!stream.is_alive());
    let mut stream = database.watch().resume_after(event.id).run()?;
    assert_eq!(next(&mut stream)?.operation_type, OperationType::Invalidate);
    // A stream of everything goes on.
    database.collection("things").insert_one(doc! { "_id": 1 }).run()?;
    let kinds = [next(&mut all)?, next(&mut all)?, next(&mut all)?].map(|event| event.operation_type);
    assert_eq!(kinds, [OperationType::Drop, OperationType::DropDatabase, OperationType::Insert]);
    Ok(())
}

fn wider() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let client = served.client()?;
    let mut database = client.database("a").watch().run()?;
    let mut all = client.watch().run()?;
    for (database, collection) in [("a", "x"), ("b", "x"), ("a", "y")] {
        client.database(database).collection(collection).insert_one(doc! { "n": 1 }).run()?;
    }
    let place = |event: ChangeStreamEvent<Document>| {
        let ns = event.ns.unwrap_or_else(|| panic!("no namespace"));
        format!("{}.{}", ns.db, ns.coll.unwrap_or_default())
    };
    let received = [next(&mut database)?, next(&mut database)?].map(place);
    assert_eq!(received, ["a.x", "a.y"]);
    let received = [next(&mut all)?, next(&mut all)?, next(&mut all)?].map(place);
    assert_eq!(received, ["a.x", "b.x", "a.y"]);
    Ok(())
}

fn received() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let things = served.client()?.database("a").collection::<Document>("things");
    let mut stream = things.watch().pipeline(vec![doc! { "$match": { "fullDocument.n": { "$gt": 1 } } }]).run()?;
    let path = folder.path().join("robot.rmem");
    let other = std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(200));
        let store = rmem::store::Embedded::open(&path).expect("a store");
        let ns = rmem::store::Namespace::parse("a.things").expect("a namespace");
        rmem::store::Store::insert(&store, &ns, vec![doc! { "_id": 1, "n": 1 }, doc! { "_id": 2, "n": 2 }]).map(drop)
    });
    assert_eq!(next(&mut stream)?.document_key, Some(doc! { "_id": 2 }));
    other.join().map_err(|_| "it panicked")??;
    Ok(())
}

fn hidden() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let settings = "[[computable]]\nname = 'one'\ncollection = 'a.things'\nspec = \"{one: 1}\"\ncache = '1m'\n\
                    pipeline = \"[{$match: {n: 1}}, {$project: {_id: 0, one: '$n'}}]\"\n";
    std::fs::write(folder.path().join("rmem.toml"), settings)?;
    let served = Served::start(folder.path(), &[])?;
    let things = served.client()?.database("a").collection::<Document>("things");
    let mut stream = things.watch().run()?;
    things.insert_one(doc! { "_id": 1, "n": 1 }).run()?;
    assert!(things.find_one(doc! { "one": 1 }).run()?.is_some());
    things.update_one(doc! { "_id": 1 }, doc! { "$set": { "_robmem_info.persistent": false } }).run()?;
    things.insert_one(doc! { "_id": 2 }).run()?;
    let ids = [next(&mut stream)?, next(&mut stream)?].map(|event| event.document_key);
    assert_eq!(ids, [Some(doc! { "_id": 1 }), Some(doc! { "_id": 2 })]);
    Ok(())
}
