//! What plain clients see.

use std::time::Duration;

use bson::{Bson, Document, doc};
use libtest_mimic::Failed;
use mongodb::options::{FindOneAndUpdateOptions, ReturnDocument};

use super::wire::{Wire, message};
use super::{Case, Served, code};

pub(super) const CASES: &[(&str, Case)] = &[
    ("plain_clients_see_no_metadata_unless_it_is_shown", metadata),
    ("computables_run_for_whoever_asks", computables),
    ("computables_that_are_added_meanwhile_run_too", added),
    ("a_cursor_is_read_by_any_connection_also_when_its_own_is_gone", cursors),
    ("who_asks_for_more_of_a_cursor_that_its_client_reads_to_the_end_is_answered", overtaken),
    ("cursors_of_few_connections_that_have_ended_are_kept", left),
    ("connections_that_have_ended_give_their_files_to_those_that_come", crowded),
    ("a_cursor_whose_collection_is_dropped_or_renamed_does_not_look_complete", dropped),
    ("a_cursor_that_is_not_read_is_closed", expired),
    ("mistakes_have_the_codes_and_names_of_mongodb", mistakes),
    ("what_is_not_supported_is_refused_by_its_name", refusals),
    ("collations_variables_and_hints_are_taken", modifiers),
    ("one_document_is_found_and_modified", modified),
    ("values_are_mapped_and_reduced_into_an_answer_or_a_collection", map_reduced),
    ("statements_of_a_command_fail_one_by_one", statements),
    ("nothing_is_changed_where_the_memory_is_served_read_only", read_only),
    ("a_command_ends_within_its_time_also_in_the_midst_of_its_work", timed),
    ("two_hundred_connections_write_at_once", crowd),
    ("what_was_done_is_counted_by_kind_and_by_collection", counted),
];

fn metadata() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let things = served.client()?.database("a").collection::<Document>("things");
    things.insert_one(doc! { "_id": 1, "n": 1 }).run()?;
    things.replace_one(doc! { "_id": 1 }, doc! { "n": 2 }).run()?;
    assert_eq!(things.find_one(doc! {}).run()?, Some(doc! { "_id": 1, "n": 2 }));
    assert_eq!(things.list_index_names().run()?, ["_id_"]);
    // Also where a pipeline puts documents into others.
    let joined = doc! { "$lookup": { "from": "things", "pipeline": [], "as": "all" } };
    let stages = [joined, doc! { "$set": { "root": "$$ROOT" } }, doc! { "$facet": { "found": [] } }];
    let found = things.aggregate(stages).run()?.next().ok_or("nothing was found")??;
    let thing = doc! { "_id": 1, "n": 2 };
    let root = doc! { "_id": 1, "n": 2, "all": [thing.clone()] };
    assert_eq!(found, doc! { "found": [{ "_id": 1, "n": 2, "all": [thing], "root": root }] });
    // What decays is there until then.
    let past = bson::DateTime::from_millis(0);
    things.insert_one(doc! { "_id": 2, "_robmem_info": { "decay_time": past } }).run()?;
    assert_eq!(things.count_documents(doc! {}).run()?, 1);
    drop(served);
    let served = Served::start(folder.path(), &["--meta"])?;
    let things = served.client()?.database("a").collection::<Document>("things");
    let found = things.find_one(doc! { "_id": 1 }).run()?.ok_or("it is gone")?;
    let info = found.get_document("_robmem_info")?;
    assert!(info.contains_key("inserted") && info.contains_key("updated"), "{info}");
    Ok(())
}

fn computables() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let settings = "[[computable]]\nname = 'double'\ncollection = 'a.things'\nspec = \"{double: {$exists: true}}\"\n\
                    pipeline = \"[{$match: {n: {$exists: true}}}, {$project: {_id: 0, double: {$multiply: ['$n', 2]}}}]\"\n";
    std::fs::write(folder.path().join("rmem.toml"), settings)?;
    let served = Served::start(folder.path(), &[])?;
    let things = served.client()?.database("a").collection::<Document>("things");
    things.insert_one(doc! { "_id": 1, "n": 21 }).run()?;
    let found = things.find_one(doc! { "double": 42 }).run()?.ok_or("nothing was computed")?;
    assert_eq!(found.get("double"), Some(&Bson::Int32(42)));
    assert_eq!(things.count_documents(doc! {}).run()?, 1);
    Ok(())
}

fn added() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let things = served.client()?.database("a").collection::<Document>("things");
    things.insert_one(doc! { "_id": 1, "n": 21 }).run()?;
    assert_eq!(things.find_one(doc! { "half": 21 }).run()?, None);
    let half = "{name: 'half', collection: 'a.things', spec: {half: {$exists: true}}, adds: ['half'], \
                pipeline: [{$project: {half: '$n'}}]}";
    for (arguments, found) in
        [(["add", half], Some(doc! { "_id": 1, "n": 21, "half": 21 })), (["remove", "half"], None)]
    {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_rmem"));
        command.args(["--memory", "file:robot.rmem", "computables"]).args(arguments).current_dir(folder.path());
        assert_eq!(command.output()?.status.code(), Some(0));
        assert_eq!(things.find_one(doc! { "half": 21 }).run()?, found);
    }
    Ok(())
}

fn cursors() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let documents = (0..1000).map(|n| doc! { "_id": n, "pad": "x".repeat(2000) });
    served.client()?.database("a").collection("c").insert_many(documents).run()?;
    let mut first = Wire::connect(served.address())?;
    let mut other = Wire::connect(served.address())?;
    let answer = first.run(&doc! { "find": "c", "batchSize": 10, "$db": "a" })?;
    let cursor = answer.get_document("cursor")?.get_i64("id")?;
    let more = doc! { "getMore": cursor, "collection": "c", "batchSize": 10, "$db": "a" };
    let ids = |answer: Document| -> Result<Vec<i32>, Failed> {
        let batch = answer.get_document("cursor")?.get_array("nextBatch")?.clone();
        batch.iter().map(|one| Ok(one.as_document().ok_or("no document")?.get_i32("_id")?)).collect()
    };
    assert_eq!(ids(other.run(&more)?)?, (10..20).collect::<Vec<_>>());
    assert_eq!(ids(first.run(&more)?)?, (20..30).collect::<Vec<_>>());
    // Each reads the other's at the same time.
    let answer = other.run(&doc! { "find": "c", "batchSize": 10, "$db": "a" })?;
    let others = answer.get_document("cursor")?.get_i64("id")?;
    let theirs = more_of(others);
    let crossed = std::thread::scope(|scope| {
        let one = scope.spawn(|| (0..200).all(|_| first.run(&theirs).is_ok_and(|answer| is_fine(&answer))));
        let two = (0..200).all(|_| other.run(&more_of(cursor)).is_ok_and(|answer| is_fine(&answer)));
        one.join().is_ok_and(|one| one) && two
    });
    assert!(crossed);
    drop(first);
    let rest = ids(other.run(&doc! { "getMore": cursor, "collection": "c", "$db": "a" })?)?;
    assert_eq!(rest.first(), Some(&230));
    let killed = other.run(&doc! { "killCursors": "c", "cursors": [others, 5_i64], "$db": "a" })?;
    assert_eq!(killed.get_array("cursorsKilled")?, &vec![Bson::Int64(others)]);
    assert_eq!(killed.get_array("cursorsNotFound")?, &vec![Bson::Int64(5)]);
    let gone = other.run(&doc! { "getMore": others, "collection": "c", "$db": "a" })?;
    assert_eq!(gone.get_str("codeName")?, "CursorNotFound");
    Ok(())
}

/// The owner's connection waits for the rest of a command when the other one asks, and has no cursor behind it.
fn overtaken() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let documents = (0..20).map(|n| doc! { "_id": n });
    served.client()?.database("a").collection("c").insert_many(documents).run()?;
    let mut owner = Wire::connect(served.address())?;
    let mut other = Wire::connect(served.address())?;
    let answer = owner.run(&doc! { "find": "c", "batchSize": 2, "$db": "a" })?;
    let cursor = answer.get_document("cursor")?.get_i64("id")?;
    let all = message(&doc! { "getMore": cursor, "collection": "c", "$db": "a" });
    owner.send(&all[..20])?;
    std::thread::sleep(Duration::from_millis(200));
    other.send(&message(&more_of(cursor)))?;
    std::thread::sleep(Duration::from_millis(200));
    owner.send(&all[20..])?;
    let rest = owner.receive()?;
    let answer = other.receive()?;
    assert!(is_fine(&rest) && (is_fine(&answer) || answer.get_i32("code")? == 43), "{rest} {answer}");
    assert!(is_fine(&owner.run(&doc! { "ping": 1, "$db": "a" })?));
    Ok(())
}

fn crowded() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start_limited(folder.path(), 64)?;
    let mut wire = Wire::connect(served.address())?;
    let documents: Vec<Document> = (0..100).map(|n| doc! { "_id": n }).collect();
    assert!(is_fine(&wire.run(&doc! { "insert": "c", "documents": documents, "$db": "a" })?));
    let mut opened = Vec::new();
    for _ in 0..60 {
        let answer = Wire::connect(served.address())?.run(&doc! { "find": "c", "batchSize": 1, "$db": "a" })?;
        opened.push(answer.get_document("cursor")?.get_i64("id")?);
    }
    assert!(is_fine(&wire.run(&doc! { "insert": "c", "documents": [{}], "$db": "a" })?));
    let is_open = |cursor: &i64, wire: &mut Wire| Ok::<_, Failed>(is_fine(&wire.run(&more_of(*cursor))?));
    let open = opened.iter().map(|cursor| is_open(cursor, &mut wire)).collect::<Result<Vec<_>, _>>()?;
    // Only those that were not read for longest are closed.
    assert!(!open[0] && open[59] && open.is_sorted(), "{open:?}");
    Ok(())
}

fn left() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let documents = (0..100).map(|n| doc! { "_id": n });
    served.client()?.database("a").collection("c").insert_many(documents).run()?;
    let mut opened = Vec::new();
    for _ in 0..110 {
        let answer = Wire::connect(served.address())?.run(&doc! { "find": "c", "batchSize": 1, "$db": "a" })?;
        opened.push(answer.get_document("cursor")?.get_i64("id")?);
    }
    let mut wire = Wire::connect(served.address())?;
    crate::processes::until("the connections have ended", || Ok(super::wire::connected(&mut wire)? < 5))?;
    let is_open = |cursor: i64, wire: &mut Wire| Ok::<_, Failed>(is_fine(&wire.run(&more_of(cursor))?));
    assert!(is_open(opened[109], &mut wire)? && is_open(opened[20], &mut wire)? && !is_open(opened[0], &mut wire)?);
    Ok(())
}

fn dropped() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let database = served.client()?.database("a");
    let mut wire = Wire::connect(served.address())?;
    for command in [
        doc! { "drop": "c", "$db": "a" },
        doc! { "dropDatabase": 1, "$db": "a" },
        doc! { "renameCollection": "a.c", "to": "a.d", "$db": "admin" },
    ] {
        let documents = (0..1000).map(|n| doc! { "_id": n });
        database.collection("c").insert_many(documents.clone()).run()?;
        let answer = wire.run(&doc! { "find": "c", "batchSize": 10, "$db": "a" })?;
        let cursor = answer.get_document("cursor")?.get_i64("id")?;
        let one = wire.run(&doc! { "find": "c", "sort": { "_id": -1 }, "batchSize": 10, "$db": "a" })?;
        let sorted = one.get_document("cursor")?.get_i64("id")?;
        assert!(is_fine(&wire.run(&more_of(cursor))?));
        assert!(is_fine(&wire.run(&command)?));
        // Also where another takes its name.
        database.collection("c").insert_one(doc! { "_id": 5 }).run()?;
        for cursor in [cursor, sorted] {
            assert_eq!(wire.run(&more_of(cursor))?.get_str("codeName")?, "QueryPlanKilled", "{command}");
            assert_eq!(wire.run(&more_of(cursor))?.get_str("codeName")?, "CursorNotFound");
        }
        database.collection::<Document>("c").drop().run()?;
    }
    Ok(())
}

fn more_of(cursor: i64) -> Document {
    doc! { "getMore": cursor, "collection": "c", "batchSize": 1, "$db": "a" }
}

fn is_fine(answer: &Document) -> bool {
    answer.get_f64("ok").is_ok_and(|ok| ok > 0.0)
}

fn expired() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &["--cursor-timeout", "300ms"])?;
    let documents = (0..100).map(|n| doc! { "_id": n, "pad": "x".repeat(2000) });
    served.client()?.database("a").collection("c").insert_many(documents).run()?;
    let mut wire = Wire::connect(served.address())?;
    let mut open =
        |find: Document| -> Result<i64, Failed> { Ok(wire.run(&find)?.get_document("cursor")?.get_i64("id")?) };
    let left = open(doc! { "find": "c", "batchSize": 10, "$db": "a" })?;
    let kept = open(doc! { "find": "c", "batchSize": 10, "noCursorTimeout": true, "$db": "a" })?;
    let stream = doc! { "aggregate": "c", "pipeline": [{ "$changeStream": {} }], "cursor": {}, "$db": "a" };
    let stream = open(stream)?;
    let until = std::time::Instant::now() + super::TIMEOUT;
    // A cursor that is asked for is one that is read: how many are open is asked instead.
    let mut open = || -> Result<i64, Failed> {
        let status = wire.run(&doc! { "serverStatus": 1, "$db": "admin" })?;
        Ok(status.get_document("metrics")?.get_document("cursor")?.get_document("open")?.get_i64("total")?)
    };
    while open()? > 1 && std::time::Instant::now() < until {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    for (cursor, is_open) in [(left, false), (stream, false), (kept, true)] {
        let answer = wire.run(&doc! { "getMore": cursor, "collection": "c", "batchSize": 1, "$db": "a" })?;
        let expected = if is_open { Err("") } else { Ok("CursorNotFound") };
        assert_eq!(answer.get_str("codeName").map_err(|_| ""), expected, "{answer}");
    }
    Ok(())
}

fn mistakes() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut wire = Wire::connect(served.address())?;
    wire.run(&doc! { "insert": "c", "documents": [{ "_id": 1 }], "$db": "a" })?;
    for (command, number, name) in [
        (doc! { "hunt": "c" }, 59, "CommandNotFound"),
        (doc! { "find": "c", "filter": { "a": { "$hunt": 1 } } }, 2, "BadValue"),
        (doc! { "find": "c", "filter": 3 }, 14, "TypeMismatch"),
        (doc! { "find": "c", "hunt": 3 }, 40415, "Location40415"),
        (doc! { "find": "a..b" }, 73, "InvalidNamespace"),
        (doc! { "find": "c", "hint": "none" }, 2, "BadValue"),
        (doc! { "find": "c", "skip": -1 }, 51024, "Location51024"),
        (doc! { "aggregate": "c", "pipeline": [] }, 9, "FailedToParse"),
        (doc! { "aggregate": "c", "pipeline": [{ "$hunt": 1 }], "cursor": {} }, 40324, "Location40324"),
        (doc! { "update": "c", "updates": [] }, 16, "InvalidLength"),
        (doc! { "drop": "none" }, 26, "NamespaceNotFound"),
        (doc! { "create": "c" }, 48, "NamespaceExists"),
        (doc! { "dropIndexes": "c", "index": "none" }, 27, "IndexNotFound"),
        (doc! { "dropIndexes": "c", "index": "_id_" }, 72, "InvalidOptions"),
        (doc! { "getMore": 7_i64, "collection": "c" }, 43, "CursorNotFound"),
        (doc! { "renameCollection": "a.none", "to": "a.d", "$db": "admin" }, 26, "NamespaceNotFound"),
        (doc! { "findAndModify": "c" }, 9, "FailedToParse"),
        (doc! { "commitTransaction": 1 }, 125, "CommandFailed"),
        (doc! { "ping": 1, "readConcern": { "level": "snapshot" } }, 72, "InvalidOptions"),
    ] {
        let mut asked = command.clone();
        asked.entry("$db").or_insert_with(|| "a".into());
        let answer = wire.run(&asked)?;
        let reported = (answer.get_i32("code")?, answer.get_str("codeName")?);
        assert_eq!(reported, (number, name), "{command}: {answer}");
    }
    Ok(())
}

fn refusals() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut wire = Wire::connect(served.address())?;
    for (command, word) in [
        (doc! { "find": "c", "tailable": true }, "tailable"),
        (doc! { "create": "c", "capped": true, "size": 1000 }, "capped"),
        (doc! { "create": "c", "capped": true, "size": 1000 }, "capped"),
        (doc! { "create": "c", "viewOn": "d" }, "viewOn"),
        (doc! { "aggregate": 1, "pipeline": [{ "$listLocalSessions": {} }], "cursor": {} }, "$listLocalSessions"),
        (doc! { "aggregate": 1, "pipeline": [{ "$queryStats": {} }], "cursor": {} }, "$queryStats"),
    ] {
        let mut asked = command.clone();
        asked.insert("$db", "a");
        let answer = wire.run(&asked)?;
        assert_eq!(answer.get_i32("code")?, 115, "{answer}");
        assert!(answer.get_str("errmsg")?.contains(word), "{answer}");
    }
    // What says nothing is as if left out.
    let plain = doc! { "find": "c", "tailable": false, "collation": { "locale": "simple" }, "$db": "a" };
    assert!(is_fine(&wire.run(&plain)?));
    Ok(())
}

/// Collations, variables and hints of commands.
fn modifiers() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut wire = Wire::connect(served.address())?;
    let mut run = |mut command: Document| -> Result<Document, Failed> {
        command.insert("$db", "a");
        wire.run(&command)
    };
    let collation = doc! { "locale": "en", "strength": 2 };
    run(doc! { "insert": "c", "documents": [{ "_id": "b", "n": 1 }, { "_id": "B", "n": 2 }, { "_id": "c", "n": 3 }] })?;
    let index = doc! { "key": { "n": -1 }, "name": "n", "collation": collation.clone() };
    assert!(is_fine(&run(doc! { "createIndexes": "c", "indexes": [index] })?));
    let ids = |answer: &Document| -> Result<Vec<String>, Failed> {
        let found = answer.get_document("cursor")?.get_array("firstBatch")?.iter().filter_map(bson::Bson::as_document);
        Ok(found.filter_map(|document| document.get_str("_id").ok().map(str::to_owned)).collect())
    };
    let find = run(doc! { "find": "c", "filter": { "_id": "B" }, "collation": collation.clone() })?;
    assert_eq!(ids(&find)?, ["b", "B"]);
    let find = run(
        doc! { "find": "c", "hint": "n", "let": { "most": 2 }, "filter": { "$expr": { "$lte": ["$n", "$$most"] } } },
    )?;
    assert_eq!(ids(&find)?, ["B", "b"]);
    let grouped = doc! { "aggregate": "c", "pipeline": [{ "$group": { "_id": { "$toLower": "$_id" } } }, { "$sort": { "_id": -1 } }],
    "cursor": {}, "collation": collation.clone() };
    assert_eq!(ids(&run(grouped)?)?, ["c", "b"]);
    let change = doc! { "findAndModify": "c", "query": { "_id": "B" }, "sort": { "n": -1 }, "update": { "$inc": { "n": 10 } },
    "new": true, "collation": collation.clone() };
    assert_eq!(run(change)?.get_document("value")?, &doc! { "_id": "B", "n": 12 });
    let update = doc! { "q": { "_id": "C" }, "u": [{ "$set": { "n": "$$new" } }], "c": { "new": 7 }, "collation": collation.clone() };
    assert_eq!(run(doc! { "update": "c", "updates": [update] })?.get_i32("nModified")?, 1);
    let delete = doc! { "q": { "_id": "b", "$expr": { "$lt": ["$n", "$$most"] } }, "limit": 0, "collation": collation };
    assert_eq!(run(doc! { "delete": "c", "deletes": [delete], "let": { "most": 5 } })?.get_i32("n")?, 1);
    let failed = run(doc! { "find": "c", "hint": "nothing" })?;
    assert_eq!(failed.get_i32("code")?, 2, "{failed}");
    let failed = run(doc! { "find": "c", "collation": { "strength": 2 } })?;
    assert_eq!(failed.get_i32("code")?, 40_414, "{failed}");
    // A collection has one that its operations inherit.
    let collation = doc! { "locale": "en", "strength": 2 };
    assert!(is_fine(&run(doc! { "create": "d", "collation": collation })?));
    run(doc! { "insert": "d", "documents": [{ "_id": "b" }] })?;
    assert_eq!(ids(&run(doc! { "find": "d", "filter": { "_id": "B" } })?)?, ["b"]);
    let listed = run(doc! { "listCollections": 1, "filter": { "name": "d" } })?;
    let listed = listed.get_document("cursor")?.get_array("firstBatch")?.first().and_then(bson::Bson::as_document);
    let listed = listed.cloned().unwrap_or_default();
    assert_eq!(listed.get_document("options")?.get_document("collation")?.get_i32("strength")?, 2);
    assert_eq!(listed.get_document("idIndex")?.get_document("collation")?.get_str("locale")?, "en");
    Ok(())
}

fn modified() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let things = served.client()?.database("a").collection::<Document>("things");
    things.insert_many((1..=3).map(|n| doc! { "_id": n, "n": n, "l": [1, 2, 3] })).run()?;
    let after =
        FindOneAndUpdateOptions::builder().sort(doc! { "n": -1 }).return_document(ReturnDocument::After).build();
    let found = things.find_one_and_update(doc! { "l": 2 }, doc! { "$set": { "l.$": 9 } }).with_options(after).run()?;
    assert_eq!(found, Some(doc! { "_id": 3, "n": 3, "l": [1, 9, 3] }));
    let before = things.find_one_and_update(doc! { "_id": 9 }, doc! { "$set": { "n": 9 } }).upsert(true).run()?;
    assert_eq!((before, things.count_documents(doc! { "n": 9 }).run()?), (None, 1));
    let removed = things.find_one_and_delete(doc! {}).sort(doc! { "n": 1 }).run()?;
    assert_eq!(removed, Some(doc! { "_id": 1, "n": 1, "l": [1, 2, 3] }));
    assert_eq!(things.find_one_and_delete(doc! { "_id": 1 }).run()?, None);
    // Many at once take each number once.
    let counted: Vec<i32> = std::thread::scope(|scope| {
        let count = || -> Result<Vec<i32>, Failed> {
            let numbers = served.client()?.database("a").collection::<Document>("numbers");
            let next = || {
                let update = doc! { "$inc": { "n": 1 } };
                let one = numbers.find_one_and_update(doc! { "_id": "next" }, update).upsert(true);
                one.return_document(ReturnDocument::After).run()
            };
            (0..25).map(|_| Ok(next()?.ok_or("none")?.get_i32("n")?)).collect()
        };
        let workers: Vec<_> = (0..4).map(|_| scope.spawn(count)).collect();
        workers.into_iter().flat_map(|worker| worker.join().expect("no panic").expect("numbers")).collect()
    });
    let mut sorted = counted;
    sorted.sort_unstable();
    assert_eq!(sorted, (1..=100).collect::<Vec<_>>());
    Ok(())
}

fn map_reduced() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let a = served.client()?.database("a");
    let seen = [("cup", 2), ("plate", 5), ("cup", 3), ("fork", 9)].map(|(name, n)| doc! { "name": name, "n": n });
    a.collection("seen").insert_many(seen).run()?;
    let command = |out: Bson| {
        let (map, reduce) =
            ("function() { emit(this.name, this.n) }", "function(k, v) { return Array.sum(v) * times }");
        let map = Bson::JavaScriptCode(map.to_owned());
        doc! { "mapReduce": "seen", "map": map, "reduce": reduce, "query": { "n": { "$lt": 9 } }, "scope": { "times": 2 }, "out": out }
    };
    let run = |out: Bson| a.run_command(command(out)).run();
    let all =
        || a.collection::<Document>("sums").find(doc! {}).sort(doc! { "_id": 1 }).run()?.collect::<Result<Vec<_>, _>>();
    let result = |name: &str, value: f64| doc! { "_id": name, "value": value };
    // A key with one value is not reduced, as on mongod.
    let inline = run(doc! { "inline": 1 }.into())?;
    assert_eq!(inline.get_array("results")?, &[result("cup", 10.0), result("plate", 5.0)].map(Bson::from));
    a.collection("sums").insert_many([doc! { "_id": "cup", "value": 1 }, doc! { "_id": "jug", "value": 1 }]).run()?;
    assert_eq!(
        run(doc! { "merge": "sums", "db": "a" }.into())?.get_document("result")?,
        &doc! { "db": "a", "collection": "sums" }
    );
    assert_eq!(all()?, [result("cup", 10.0), doc! { "_id": "jug", "value": 1 }, result("plate", 5.0)]);
    run(doc! { "reduce": "sums" }.into())?;
    assert_eq!(all()?, [result("cup", 40.0), doc! { "_id": "jug", "value": 1 }, result("plate", 20.0)]);
    assert_eq!(run("sums".into())?.get_str("result")?, "sums");
    assert_eq!(all()?, [result("cup", 10.0), result("plate", 5.0)]);
    assert_eq!(code(run(doc! { "replace": "sums", "db": "b" }.into())), Some(115));
    assert_eq!(code(run(doc! {}.into())), Some(2));
    // Keys are the same as the collection compares, or as the command says.
    a.run_command(doc! { "create": "mixed", "collation": { "locale": "en", "strength": 2 } }).run()?;
    let mixed = [("cup", 2), ("Cup", 5)].map(|(name, n)| doc! { "name": name, "n": n });
    a.collection("mixed").insert_many(mixed).run()?;
    let mut alike = command(doc! { "inline": 1 }.into());
    alike.insert("mapReduce", "mixed");
    let keys = |command: &Document| -> Result<usize, Failed> {
        Ok(a.run_command(command.clone()).run()?.get_array("results")?.len())
    };
    assert_eq!(keys(&alike)?, 1);
    alike.insert("collation", doc! { "locale": "simple" });
    assert_eq!(keys(&alike)?, 2);
    let mut hunting = command("sums".into());
    hunting.insert("hunt", 1);
    assert_eq!(code(a.run_command(hunting).run()), Some(40415));
    Ok(())
}

fn statements() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut wire = Wire::connect(served.address())?;
    let documents = [1, 1, 2, 2, 3].map(|id| doc! { "_id": id });
    let indexes = |answer: &Document| -> Vec<i32> {
        let errors = answer.get_array("writeErrors").into_iter().flatten();
        errors.filter_map(|error| error.as_document()?.get_i32("index").ok()).collect()
    };
    let answer = wire.run(&doc! { "insert": "c", "documents": documents.to_vec(), "ordered": false, "$db": "a" })?;
    assert_eq!((answer.get_i32("n")?, indexes(&answer)), (3, vec![1, 3]));
    let answer = wire.run(&doc! { "insert": "d", "documents": documents.to_vec(), "$db": "a" })?;
    assert_eq!((answer.get_i32("n")?, indexes(&answer)), (1, vec![1]));
    // Also where many are refused, here and there and all of them.
    let many: Vec<_> = (0..3000).map(|n| doc! { "_id": if n % 7 == 0 { 0 } else { n } }).collect();
    let answer = wire.run(&doc! { "insert": "f", "documents": many.clone(), "ordered": false, "$db": "a" })?;
    assert_eq!((answer.get_i32("n")?, indexes(&answer)), (2572, (1..429).map(|n| n * 7).collect()));
    let answer = wire.run(&doc! { "insert": "f", "documents": many, "ordered": false, "$db": "a" })?;
    assert_eq!((answer.get_i32("n")?, indexes(&answer)), (0, (0..3000).collect()));
    let updates = vec![
        doc! { "q": { "_id": 1 }, "u": { "$set": { "n": "x" } } },
        doc! { "q": { "_id": 1 }, "u": { "$inc": { "n": 1 } } },
        doc! { "q": { "_id": 2 }, "u": { "$set": { "n": 1 } } },
        doc! { "q": { "_id": 7 }, "u": { "$set": { "n": 1 } }, "upsert": true },
    ];
    let answer = wire.run(&doc! { "update": "c", "updates": updates, "ordered": false, "$db": "a" })?;
    assert_eq!((answer.get_i32("n")?, answer.get_i32("nModified")?, indexes(&answer)), (3, 2, vec![1]));
    assert_eq!(answer.get_array("upserted")?, &vec![Bson::Document(doc! { "index": 3, "_id": 7 })]);
    // An update of many that fails at one keeps what it changed before.
    wire.run(&doc! { "insert": "e", "documents": [{ "_id": 1, "n": 1 }, { "_id": 2, "n": "x" }], "$db": "a" })?;
    let updates = vec![
        doc! { "q": {}, "u": { "$set": { "m": 1 } }, "multi": true },
        doc! { "q": {}, "u": { "$inc": { "n": 1 } }, "multi": true },
    ];
    let answer = wire.run(&doc! { "update": "e", "updates": updates, "$db": "a" })?;
    assert_eq!((answer.get_i32("n")?, indexes(&answer)), (2, vec![1]));
    let found = wire.run(&doc! { "find": "e", "filter": { "n": 2, "m": 1 }, "$db": "a" })?;
    assert_eq!(found.get_document("cursor")?.get_array("firstBatch")?.len(), 1);
    Ok(())
}

fn timed() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut wire = Wire::connect(served.address())?;
    let documents: Vec<_> = (0..10_000).map(|n| doc! { "_id": n }).collect();
    wire.run(&doc! { "insert": "c", "documents": documents, "$db": "a" })?;
    // Each with each would take minutes.
    let each = doc! { "$lookup": { "from": "c", "pipeline": [{ "$match": { "n": 1 } }], "as": "all" } };
    let limited = |mut command: Document| {
        command.extend(doc! { "maxTimeMS": 200, "$db": "a" });
        command
    };
    let commands = [
        doc! { "aggregate": "c", "pipeline": [each.clone(), { "$sort": { "all": 1 } }], "cursor": {} },
        doc! { "aggregate": "c", "pipeline": [each, { "$out": "d" }], "cursor": {} },
        doc! { "update": "c", "updates": [{ "q": { "$where": "for (let n = 0; n < 1e5; n++); return true" }, "u": { "$set": { "n": 1 } }, "multi": true }] },
    ];
    for command in commands {
        let reply = wire.run(&limited(command.clone()))?;
        let failure = reply.get_array("writeErrors").ok().and_then(|errors| errors.first()?.as_document());
        assert_eq!(failure.unwrap_or(&reply).get_i32("code").ok(), Some(50), "{command}: {reply}");
    }
    for (query, count) in [(doc! { "n": 1 }, 0), (doc! {}, 10_000)] {
        assert_eq!(wire.run(&doc! { "count": "c", "query": query, "$db": "a" })?.get_i32("n")?, count);
    }
    assert_eq!(wire.run(&doc! { "count": "d", "$db": "a" })?.get_i32("n")?, 0);
    Ok(())
}

fn read_only() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    served.client()?.database("a").collection("c").insert_one(doc! { "_id": 1 }).run()?;
    drop(served);
    let served = Served::start(folder.path(), &["--read-only"])?;
    let things = served.client()?.database("a").collection::<Document>("c");
    assert_eq!(things.count_documents(doc! {}).run()?, 1);
    assert_eq!(code(things.insert_one(doc! { "_id": 2 }).run()), Some(20));
    assert_eq!(code(things.drop().run()), Some(20));
    let out = vec![doc! { "$out": "d" }];
    assert_eq!(code(things.aggregate(out).run()), Some(20));
    Ok(())
}

fn crowd() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let address = served.address();
    let write = |worker: i32| -> Result<(), Failed> {
        let mut wire = Wire::connect(address)?;
        for n in 0..5 {
            let id = format!("{worker}-{n}");
            let insert = doc! { "insert": "c", "documents": [{ "_id": &id }], "$db": "a" };
            let answer = wire.run(&insert)?;
            let found = wire.run(&doc! { "find": "c", "filter": { "_id": &id }, "$db": "a" })?;
            let batch = found.get_document("cursor")?.get_array("firstBatch")?.len();
            if answer.get_i32("n")? != 1 || batch != 1 {
                return Err(format!("{id}: {answer}, {found}").into());
            }
        }
        Ok(())
    };
    let failures: Vec<Failed> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..200).map(|worker| scope.spawn(move || write(worker))).collect();
        workers.into_iter().filter_map(|worker| worker.join().expect("no panic").err()).collect()
    });
    assert!(failures.is_empty(), "{:?}", failures.first().and_then(Failed::message));
    let count = served.client()?.database("a").collection::<Document>("c").count_documents(doc! {}).run()?;
    assert_eq!(count, 1000);
    Ok(())
}

fn counted() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut wire = Wire::connect(served.address())?;
    let status = |wire: &mut Wire| wire.run(&doc! { "serverStatus": 1, "mem": 0, "$db": "admin" });
    let before = status(&mut wire)?;
    for command in [
        doc! { "insert": "c", "documents": [{ "_id": 1 }, { "_id": 2 }, { "_id": 3 }] },
        doc! { "insert": "d", "documents": [{ "_id": 1 }] },
        doc! { "find": "c", "batchSize": 1 },
        doc! { "update": "c", "updates": [{ "q": { "_id": 1 }, "u": { "$set": { "n": 1 } } }, { "q": {}, "u": { "n": 2 } }] },
        doc! { "delete": "c", "deletes": [{ "q": { "_id": 3 }, "limit": 1 }] },
        doc! { "count": "c" },
    ] {
        let answer = wire.run(&command.into_iter().chain(doc! { "$db": "a" }).collect())?;
        assert!(is_fine(&answer), "{answer}");
    }
    let after = status(&mut wire)?;
    let done = |kind: &str| -> Result<i64, Failed> {
        let count = |status: &Document| status.get_document("opcounters")?.get_i64(kind);
        Ok(count(&after)? - count(&before)?)
    };
    let kinds = ["insert", "query", "update", "delete", "getmore", "command"].map(done);
    // The first status is noted when it is answered.
    assert_eq!(kinds.into_iter().collect::<Result<Vec<_>, _>>()?, [4, 1, 2, 1, 0, 2]);
    assert_eq!(after.get_document("catalogStats")?.get_i32("collections")?, 2);
    assert!(!after.contains_key("mem") && wire.run(&doc! { "serverStatus": 1, "$db": "admin" })?.contains_key("mem"));
    let top = wire.run(&doc! { "top": 1, "$db": "admin" })?;
    let totals = top.get_document("totals")?;
    assert_eq!(totals.keys().collect::<Vec<_>>(), ["note", "a.c", "a.d"]);
    let of = |kind: &str| totals.get_document("a.c")?.get_document(kind)?.get_i64("count");
    let counts = ["total", "readLock", "writeLock", "insert", "queries", "update", "remove", "commands"].map(of);
    assert_eq!(counts.into_iter().collect::<Result<Vec<_>, _>>()?, [5, 2, 3, 1, 1, 1, 1, 1]);
    assert!(totals.get_document("a.c")?.get_document("total")?.get_i64("time")? > 0);
    assert_eq!(wire.run(&doc! { "top": 1, "$db": "a" })?.get_i32("code")?, 13);
    Ok(())
}
