//! `rmem serve` in front of a MongoDB server that fails behind a write which it has done.

use std::path::Path;

use bson::{Document, doc};
use libtest_mimic::Failed;
use mongodb::sync::{Client, Database};

use super::Served;
use super::front::rmem;
use super::wire::Wire;
use crate::mongod::{Mongod, admin};
use crate::processes::until;

type Killer = fn(&Path) -> Result<(), Failed>;

/// What is tried with a server of its own, which is told when to fail.
pub(crate) const KILLERS: &[(&str, Killer)] = &[
    ("serving::in_front_of_mongod::what_is_done_is_not_answered_as_to_be_repeated", answered),
    ("serving::in_front_of_mongod::what_cannot_be_recorded_is_done_once_and_recorded_later", recorded_later),
    ("serving::in_front_of_mongod::a_recording_goes_on_whose_release_failed", released_in_vain),
    ("serving::in_front_of_mongod::a_connection_lost_while_a_write_is_confirmed_is_no_failure", confirmed_again),
];

/// Has the server fail these commands.
fn fail(admin: &Database, command: &str, how: Document) -> Result<(), Failed> {
    fail_behind(admin, doc! { "skip": 0 }, doc! { "failCommands": [command] }.into_iter().chain(how).collect())
}

/// Has the server close the connection of queries of the collection, from the one behind the first few on.
fn close_queries(admin: &Database, skip: i32) -> Result<(), Failed> {
    let how = doc! { "failCommands": ["find"], "namespace": "outages.c", "closeConnection": true };
    fail_behind(admin, doc! { "skip": skip }, how)
}

/// Has the server fail as `data` says, in a `mode` of its fail point.
pub(super) fn fail_behind(admin: &Database, mode: Document, data: Document) -> Result<(), Failed> {
    admin.run_command(doc! { "configureFailPoint": "failCommand", "mode": mode, "data": data }).run()?;
    Ok(())
}

fn works_again(admin: &Database) -> Result<(), Failed> {
    admin.run_command(doc! { "configureFailPoint": "failCommand", "mode": "off" }).run()?;
    Ok(())
}

fn answered(program: &Path) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let server = Mongod::failing(program)?;
    let admin = admin(server.port)?;
    let served = Served::start_memory(folder.path(), &server.uri, &["--listen", "127.0.0.1:0"])?;
    let mut wire = Wire::connect(served.address())?;
    let things = Client::with_uri_str(&server.uri)?.database("outages").collection::<Document>("c");
    things.insert_many((0..1_500).map(|id| doc! { "_id": id, "n": 1 })).run()?;
    let by_chance = vec![doc! { "$set": { "n": { "$add": ["$n", 1, { "$multiply": [0, { "$rand": {} }] }] } } }];
    let one = doc! { "findAndModify": "c", "query": { "_id": 1 }, "update": by_chance, "$db": "outages" };
    // Found, changed, and not seen again.
    close_queries(&admin, 1)?;
    let answer = wire.run(&one)?;
    works_again(&admin)?;
    assert!(answer.get_i32("code")? == 6 && !answer.contains_key("errorLabels"), "{answer}");
    assert!(answer.get_str("errmsg")?.ends_with("the change of outages.c was made"), "{answer}");
    assert_eq!(things.count_documents(doc! { "n": 2 }).run()?, 1);
    // The first thousand are changed, and the others are not found.
    let update = doc! { "q": {}, "u": { "$inc": { "n": 1 } }, "multi": true };
    close_queries(&admin, 3)?;
    let answer = wire.run(&doc! { "update": "c", "updates": [update], "$db": "outages" })?;
    works_again(&admin)?;
    assert!(answer.get_i32("code")? == 6 && !answer.contains_key("errorLabels"), "{answer}");
    assert!(answer.get_str("errmsg")?.ends_with("failed after 1000 documents; what was done stays"), "{answer}");
    assert_eq!(things.count_documents(doc! { "_robmem_info.updated": { "$exists": true } }).run()?, 1_000);
    // What was certainly not done may be repeated.
    close_queries(&admin, 0)?;
    let answer = wire.run(&one)?;
    works_again(&admin)?;
    assert_eq!(answer.get_array("errorLabels")?, &["RetryableWriteError".into()]);
    Ok(())
}

fn recorded_later(program: &Path) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    std::fs::write(folder.path().join("rmem.toml"), "keep_history = '1h'\n")?;
    let server = Mongod::failing(program)?;
    let admin = admin(server.port)?;
    let served = Served::start_memory(folder.path(), &server.uri, &["--listen", "127.0.0.1:0"])?;
    let things = served.client()?.database("outages").collection::<Document>("c");
    let behind = Client::with_uri_str(&server.uri)?.database("outages");
    let entries = behind.collection::<Document>("rmem.history");
    let more = || doc! { "$inc": { "n": 1 } };
    things.insert_many((0..3).map(|id| doc! { "_id": id, "n": 1 })).run()?;
    // The history is written, and its size cannot be asked for; then its changes are not read at all.
    for (command, n) in [("collStats", 2), ("aggregate", 3)] {
        fail(&admin, command, doc! { "closeConnection": true })?;
        assert_eq!(things.update_one(doc! { "_id": 1 }, more()).run()?.modified_count, 1);
        let added = things.insert_one(doc! { "added": command }).run()?;
        let gone = things.delete_one(doc! { "_id": if n == 2 { 0 } else { 2 } }).run()?;
        works_again(&admin)?;
        assert_eq!(gone.deleted_count, 1);
        assert_eq!(things.count_documents(doc! { "added": command }).run()?, 1);
        let found = things.find_one(doc! { "_id": 1 }).run()?.ok_or("it is gone")?;
        assert_eq!((found.get_i32("n")?, added.inserted_id.as_object_id().is_some()), (n, true));
    }
    let changed = doc! { "_id": 1, "n": 4 };
    things.find_one_and_update(doc! { "_id": 1 }, more()).run()?;
    assert_eq!(things.find_one(doc! { "_id": 1 }).run()?, Some(changed));
    // All of it is recorded and signed.
    assert_eq!(entries.count_documents(doc! { "by": { "$exists": false } }).run()?, 0);
    let count = |operation: &str| entries.count_documents(doc! { "operation": operation }).run();
    assert_eq!((count("insert")?, count("update")?, count("delete")?), (5, 3, 2));
    // What will not end by itself is said beside the answer; a command finds it before it begins.
    fail(&admin, "aggregate", doc! { "errorCode": 286, "errorLabels": [] })?;
    let mut wire = Wire::connect(served.address())?;
    let update = doc! { "q": { "_id": 1 }, "u": more() };
    let answer = wire.run(&doc! { "update": "c", "updates": [update], "$db": "outages" })?;
    let said = rmem(folder.path(), &server.uri, &["update", "outages.c", "{_id: 1}", "{$inc: {n: 1}}"])?;
    works_again(&admin)?;
    assert_eq!(answer.get_i32("nModified")?, 1, "{answer}");
    let error = answer.get_document("writeConcernError")?;
    assert!(error.get_i32("code")? == 96 && !answer.contains_key("errorLabels"), "{answer}");
    assert!(error.get_str("errmsg")?.contains("was made, but could not be recorded in the history"), "{answer}");
    let found = things.find_one(doc! { "_id": 1 }).run()?.ok_or("it is gone")?;
    assert!(found.get_i32("n")? == 5 && said.contains("oplog does not reach back"), "{said}");
    Ok(())
}

/// Its name is free again once its lease is over.
fn released_in_vain(program: &Path) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    std::fs::write(folder.path().join("rmem.toml"), "keep_history = '1h'\n")?;
    let server = Mongod::failing(program)?;
    let admin = admin(server.port)?;
    let served = Served::start_memory(folder.path(), &server.uri, &["--listen", "127.0.0.1:0"])?;
    let things = served.client()?.database("outages").collection::<Document>("c");
    let behind = Client::with_uri_str(&server.uri)?.database("outages");
    let (entries, names) =
        (behind.collection::<Document>("rmem.history"), behind.collection::<Document>("rmem.watchers"));
    things.insert_one(doc! { "_id": 0 }).run()?;
    let is_held = || names.count_documents(doc! { "holder": { "$type": "string" } }).run();
    // The release is the last of the updates of the name.
    for skip in (0..8).rev() {
        let how = doc! { "failCommands": ["update"], "namespace": "outages.rmem.watchers", "errorCode": 11_600 };
        fail_behind(&admin, doc! { "skip": skip }, how)?;
        things.insert_one(doc! { "skipped": skip }).run()?;
        works_again(&admin)?;
        if is_held()? > 0 {
            break;
        }
    }
    assert_eq!(is_held()?, 1, "no release failed");
    things.insert_one(doc! { "_id": "last" }).run()?;
    until("the changes are recorded", || {
        things.update_one(doc! { "_id": 0 }, doc! { "$inc": { "n": 1 } }).run()?;
        Ok(entries.count_documents(doc! { "document": "last", "by": { "$exists": true } }).run()? == 1)
    })?;
    assert_eq!(is_held()?, 0);
    Ok(())
}

fn confirmed_again(program: &Path) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let server = Mongod::failing(program)?;
    let admin = admin(server.port)?;
    let served = Served::start_memory(folder.path(), &server.uri, &["--listen", "127.0.0.1:0"])?;
    let mut wire = Wire::connect(served.address())?;
    let mut insert = |id: i32, number: Option<i64>| {
        let mut insert = doc! { "insert": "c", "documents": [{ "_id": id }], "$db": "outages" };
        insert.extend(number.map(|number| ("txnNumber".to_owned(), number.into())));
        insert.extend(number.map(|_| ("lsid".to_owned(), doc! { "id": bson::Uuid::new() }.into())));
        wire.run(&insert)
    };
    insert(0, None)?;
    // What is written behind a write to wait for its confirmation.
    let lost = doc! { "failCommands": ["update"], "namespace": "outages.rmem.retries", "closeConnection": true };
    fail_behind(&admin, doc! { "times": 1 }, lost.clone())?;
    let answer = insert(1, None)?;
    works_again(&admin)?;
    assert!(answer.get_i32("n")? == 1 && !answer.contains_key("writeConcernError"), "{answer}");
    // Where it does not come, the write is done, and not to be sent again: it would be answered as done.
    for (id, number) in [(2, None), (3, Some(1))] {
        fail_behind(&admin, doc! { "skip": 0 }, lost.clone())?;
        let answer = insert(id, number)?;
        works_again(&admin)?;
        assert_eq!((answer.get_i32("n")?, answer.get_document("writeConcernError")?.get_i32("code")?), (1, 6));
        assert!(!answer.contains_key("errorLabels"), "{answer}");
    }
    Ok(())
}
