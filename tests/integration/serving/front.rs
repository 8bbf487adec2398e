//! `rmem serve` in front of a MongoDB server.

use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};

use bson::{Document, doc};
use libtest_mimic::Failed;
use mongodb::options::{Collation, ReturnDocument};
use mongodb::results::CollectionType;
use mongodb::sync::{Client, Database};
use tempfile::TempDir;

use super::wire::Wire;
use super::{Served, code};

type Case = fn(&str) -> Result<(), Failed>;

/// What is tried in front of the server at a URI.
pub(crate) const CASES: &[(&str, Case)] = &[
    ("serving::in_front_of_mongod::plain_clients_have_computables_and_metadata", in_front),
    ("serving::in_front_of_mongod::each_client_takes_another_document", taken),
    ("serving::in_front_of_mongod::each_client_gets_another_number", numbered),
    ("serving::in_front_of_mongod::clients_that_change_the_same_documents_all_get_done", crowded),
    ("serving::in_front_of_mongod::of_clients_that_do_the_same_one_did_it", claimed),
    ("serving::in_front_of_mongod::an_update_of_many_changes_each_once_beside_others", once_each),
    ("serving::in_front_of_mongod::an_update_of_many_takes_what_a_command_has_room_for", sized),
    ("serving::in_front_of_mongod::an_update_of_many_takes_documents_that_rmem_cannot_compute", uncomputed),
    ("serving::in_front_of_mongod::what_waits_for_the_server_ends_in_time", waiting),
    ("serving::in_front_of_mongod::an_update_of_many_makes_no_collection_that_was_dropped", dropped),
    ("serving::in_front_of_mongod::an_update_of_many_goes_on_where_its_parts_are_not_confirmed", unconfirmed),
    ("serving::in_front_of_mongod::an_upsert_that_others_were_faster_with_changes_nothing", upserted),
    ("serving::in_front_of_mongod::each_client_signs_what_it_changed", signed),
    ("serving::in_front_of_mongod::each_client_takes_the_nearest", nearest),
    ("serving::in_front_of_mongod::ids_that_are_equal_under_a_collation_are_told_apart", equal_ids),
    ("serving::in_front_of_mongod::writes_are_confirmed_as_their_client_says", confirmed),
    ("serving::in_front_of_mongod::statements_that_are_sent_again_are_answered_as_mongod_does", repeated),
    ("serving::in_front_of_mongod::what_sees_whole_documents_sees_no_metadata", whole),
    ("serving::in_front_of_mongod::a_write_that_fails_part_way_says_what_it_changed_and_can_be_undone", part_way),
];

/// Checks that what is served in front of a mongod gives the answers that are expected.
pub(super) fn answers_alike(
    mongod: &str,
    commands: &[Document],
    expected: &[Document],
    ask: impl Fn(&mut Wire, &Document) -> Result<Document, Failed>,
) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start_memory(folder.path(), mongod, &["--listen", "127.0.0.1:0"])?;
    let mut wire = Wire::connect(served.address())?;
    assert_eq!(commands.len(), expected.len());
    for (command, expected) in commands.iter().zip(expected) {
        assert_eq!(ask(&mut wire, command)?, *expected, "{command}");
    }
    Ok(())
}

fn in_front(mongod: &str) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let settings = "[[computable]]\nname = 'double'\ncollection = 'in_front.things'\nspec = \"{double: {$exists: true}}\"\n\
                    pipeline = \"[{$match: {n: {$exists: true}}}, {$project: {_id: 0, double: {$multiply: ['$n', 2]}}}]\"\n";
    std::fs::write(folder.path().join("rmem.toml"), settings)?;
    let served = Served::start_memory(folder.path(), mongod, &["--listen", "127.0.0.1:0"])?;
    let client = served.client()?;
    let database = client.database("in_front");
    database.drop().run()?;
    let things = database.collection::<Document>("things");
    things.insert_many([doc! { "_id": 1, "n": 21 }, doc! { "_id": 2 }]).run()?;
    let found = things.find_one(doc! { "double": 42 }).run()?.ok_or("nothing was computed")?;
    assert_eq!(found.get_i32("double")?, 42);
    // What is computed is not stored, and metadata is, where plain clients do not see it.
    let all = things.find(doc! {}).sort(doc! { "_id": 1 }).run()?.collect::<Result<Vec<_>, _>>()?;
    assert_eq!(all, [doc! { "_id": 1, "n": 21 }, doc! { "_id": 2 }]);
    let behind = Client::with_uri_str(mongod)?.database("in_front").collection::<Document>("things");
    let stored = behind.find_one(doc! { "_id": 1 }).run()?.ok_or("nothing was stored")?;
    assert!(stored.get_document("_robmem_info")?.contains_key("inserted"), "{stored}");
    assert_eq!(behind.count_documents(doc! { "double": 42 }).run()?, 0);
    // Changes, indexes, cursors and mistakes are the server's.
    things.update_one(doc! { "_id": 3 }, doc! { "$set": { "n": 4 } }).upsert(true).run()?;
    let changed = things.find_one_and_update(doc! { "_id": 3 }, doc! { "$inc": { "n": 1 } });
    assert_eq!(changed.return_document(ReturnDocument::After).run()?, Some(doc! { "_id": 3, "n": 5 }));
    // A decimal that rmem takes for the same number.
    let more: bson::Decimal128 = "0.1000000000000000055511151231257827".parse()?;
    things.insert_one(doc! { "_id": 8, "x": more }).run()?;
    let changed = things.find_one_and_update(doc! { "_id": 8 }, doc! { "$max": { "x": 0.1 } });
    assert_eq!(changed.return_document(ReturnDocument::After).run()?, Some(doc! { "_id": 8, "x": 0.1 }));
    let dated = doc! { "_id": 8, "x": 0.1, "_robmem_info.updated": { "$exists": true } };
    assert_eq!(behind.delete_one(dated).run()?.deleted_count, 1);
    // What is changed is dated also where it cannot be shown.
    let bad = doc! { "bad": { "$divide": ["$_id", "$zero"] } };
    let by_chance = vec![doc! { "$set": { "x": { "$ceil": { "$rand": {} } }, "zero": 0 } }];
    things.insert_one(doc! { "_id": 9 }).run()?;
    let changed = things.find_one_and_update(doc! { "_id": 9 }, by_chance).projection(bad);
    assert_eq!(code(changed.return_document(ReturnDocument::After).run()), Some(2));
    let dated = doc! { "_id": 9, "zero": 0, "_robmem_info.updated": { "$exists": true } };
    assert_eq!(behind.delete_one(dated).run()?.deleted_count, 1);
    things.create_index(mongodb::IndexModel::builder().keys(doc! { "n": 1 }).build()).run()?;
    assert!(behind.list_index_names().run()?.contains(&"n_1".to_owned()));
    let many = database.collection("many");
    many.insert_many((0..500).map(|n| doc! { "_id": n })).run()?;
    assert_eq!(many.find(doc! {}).batch_size(50).run()?.count(), 500);
    assert_eq!(code(things.insert_one(doc! { "_id": 1 }).run()), Some(11_000));
    let checked = database.run_command(doc! { "validate": "things" }).run()?;
    assert_eq!((checked.get_bool("valid")?, checked.get_i32("nrecords")?), (true, 3));
    let names: Vec<_> = checked.get_document("keysPerIndex")?.keys().cloned().collect();
    assert_eq!(names, things.list_index_names().run()?);
    // A pipeline that brings its own documents is one of the database.
    let own = [doc! { "$documents": [{ "_id": 7 }] }];
    assert_eq!(database.aggregate(own).run()?.collect::<Result<Vec<_>, _>>()?, [doc! { "_id": 7 }]);
    assert_eq!(things.delete_many(doc! {}).run()?.deleted_count, 3);
    // A replacement is inserted whatever else the query asks for.
    let made = things.replace_one(doc! { "_id": 8, "a": 1, "a.b": 2 }, doc! { "z": 1 }).upsert(true).run()?;
    assert_eq!(made.upserted_id, Some(8.into()));
    assert_eq!(things.find_one_and_delete(doc! { "z": 1 }).run()?, Some(doc! { "_id": 8, "z": 1 }));
    many.insert_one(doc! { "_id": -1 }).run()?;
    let slow = many.find(doc! { "$where": "sleep(60000) || true" }).max_time(std::time::Duration::from_millis(200));
    assert_eq!(code(slow.run()), Some(50));
    // A view is listed as one, and keeps nothing else from being listed.
    let behind = Client::with_uri_str(mongod)?.database("in_front");
    behind.run_command(doc! { "create": "seen", "viewOn": "things", "pipeline": [] }).run()?;
    let listed = database.list_collections().filter(doc! { "name": "seen" }).run()?.next().ok_or("no view")??;
    assert_eq!((listed.collection_type, listed.options.view_on.as_deref()), (CollectionType::View, Some("things")));
    assert!(database.list_collection_names().run()?.contains(&"many".to_owned()));
    let listed =
        Command::new(env!("CARGO_BIN_EXE_rmem")).args(["collections", "--options", "--memory", mongod]).output()?;
    let text = String::from_utf8(listed.stdout)?;
    let views: Vec<_> = text.lines().filter(|line| line.starts_with("in_front.seen ")).collect();
    assert_eq!(views, ["in_front.seen {\"viewOn\":\"things\",\"pipeline\":[]}"], "{text}");
    let stats = database.run_command(doc! { "dbStats": 1 }).run()?;
    assert_eq!((stats.get_i32("views")?, stats.get_i32("objects")?), (1, 501));
    // So is a time series; a dump says what becomes of either.
    behind.run_command(doc! { "create": "measured", "timeseries": { "timeField": "at" } }).run()?;
    behind.collection("measured").insert_one(doc! { "at": bson::DateTime::now(), "n": 1 }).run()?;
    let listed = database.list_collections().filter(doc! { "name": "measured" }).run()?.next().ok_or("no series")??;
    assert_eq!(listed.collection_type, CollectionType::Timeseries);
    let folder = tempfile::tempdir()?;
    let dump = Command::new(env!("CARGO_BIN_EXE_rmem"))
        .args(["dump", "--all", "--memory", mongod, "-o", "dump"])
        .current_dir(folder.path())
        .output()?;
    let said = String::from_utf8(dump.stderr)?;
    let is_said = |line: &str| said.lines().any(|said| said == line);
    assert!(is_said("warning: in_front.seen is a view, and was left out"), "{said}");
    assert!(
        is_said("warning: in_front.measured is a time series; from the dump, it will be a plain collection"),
        "{said}"
    );
    let written = std::fs::read(folder.path().join("dump/in_front/measured.bson"))?;
    assert_eq!(bson::RawDocumentBuf::from_reader(&*written)?.get_i32("n")?, 1);
    assert!(client.list_databases().run()?.iter().any(|found| found.name == "in_front"));
    // What only the server itself can do is refused, with the reason.
    let mut session = client.start_session().run()?;
    session.start_transaction().run()?;
    let refusal =
        things.insert_one(doc! { "_id": 9 }).session(&mut session).run().err().ok_or("a transaction was begun")?;
    assert!(refusal.to_string().contains("on a MongoDB server: connect to that"), "{refusal}");
    database.drop().run()?;
    Ok(())
}

/// A server in front of mongod, with its folder, and an empty database there.
fn emptied(mongod: &str, name: &str) -> Result<(TempDir, Served, Database), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start_memory(folder.path(), mongod, &["--listen", "127.0.0.1:0"])?;
    let database = served.client()?.database(name);
    database.drop().run()?;
    Ok((folder, served, database))
}

/// What so many clients, each in a thread of its own, give.
fn at_once<T: Send>(clients: i32, work: impl Fn(i32) -> Result<T, Failed> + Sync) -> Result<Vec<T>, Failed> {
    std::thread::scope(|scope| {
        let work = &work;
        let clients: Vec<_> = (0..clients).map(|client| scope.spawn(move || work(client))).collect();
        clients.into_iter().map(|client| client.join().map_err(|_| "a client failed")?).collect()
    })
}

fn taken(mongod: &str) -> Result<(), Failed> {
    const CLIENTS: i32 = 4;
    const EACH: i32 = 15;
    let (_folder, served, database) = emptied(mongod, "taken")?;
    let orders = database.collection::<Document>("orders");
    orders.insert_many((0..CLIENTS * EACH).map(|id| doc! { "_id": id, "state": "open" })).run()?;
    let take = |_| -> Result<Vec<i32>, Failed> {
        let orders = served.client()?.database("taken").collection::<Document>("orders");
        let next = |_| {
            let taken = doc! { "$set": { "state": "taken" } };
            let order = orders.find_one_and_update(doc! { "state": "open" }, taken).sort(doc! { "_id": 1 }).run()?;
            Ok(order.ok_or("there was no order")?.get_i32("_id")?)
        };
        (0..EACH).map(next).collect()
    };
    let mut ids = at_once(CLIENTS, take)?.concat();
    ids.sort_unstable();
    assert_eq!(ids, (0..CLIENTS * EACH).collect::<Vec<_>>());
    database.drop().run()?;
    Ok(())
}

fn crowded(mongod: &str) -> Result<(), Failed> {
    const CLIENTS: i32 = 16;
    const ORDERS: i32 = 60;
    let (_folder, served, database) = emptied(mongod, "crowded")?;
    let orders = database.collection::<Document>("orders");
    orders.insert_many((0..ORDERS).map(|id| doc! { "_id": id, "state": "open" })).run()?;
    database.collection::<Document>("keys").create_index(unique("k")).run()?;
    let work = |client: i32| -> Result<u64, Failed> {
        let database = served.client()?.database("crowded");
        let (orders, keys) = (database.collection::<Document>("orders"), database.collection::<Document>("keys"));
        for key in 0..4 {
            let most = doc! { "$max": { "n": client }, "$setOnInsert": { "made": true } };
            keys.update_one(doc! { "k": key }, most).upsert(true).run()?;
        }
        let mut taken = 0;
        loop {
            let take = doc! { "$set": { "state": "taken", "by.client": client } };
            match orders.update_one(doc! { "state": "open" }, take).run()?.matched_count {
                0 => break,
                count => taken += count,
            }
        }
        assert_eq!(orders.count_documents(doc! { "state": "open" }).run()?, 0, "there were more");
        Ok(taken)
    };
    let taken: u64 = at_once(CLIENTS, work)?.into_iter().sum();
    assert_eq!(taken, u64::try_from(ORDERS)?);
    let most = doc! { "n": CLIENTS - 1, "made": true };
    assert_eq!(database.collection::<Document>("keys").count_documents(most).run()?, 4);
    database.drop().run()?;
    Ok(())
}

fn claimed(mongod: &str) -> Result<(), Failed> {
    const CLIENTS: i32 = 8;
    let (_folder, served, database) = emptied(mongod, "claimed")?;
    let updates = [
        doc! { "$addToSet": { "l": "mine" } },
        doc! { "$unset": { "free": 1 } },
        doc! { "$max": { "n": 5 } },
        doc! { "$set": { "a.b": 1 } },
        doc! { "$pull": { "l": "free" } },
    ];
    for (round, update) in (0..).zip(updates.iter().chain(&updates)) {
        let tables = database.collection::<Document>("tables");
        tables.insert_one(doc! { "_id": round, "l": ["free"], "free": true, "n": 1 }).run()?;
        let claim = |client: i32| -> Result<u64, Failed> {
            let tables = served.client()?.database("claimed").collection::<Document>("tables");
            let id = doc! { "_id": round };
            Ok(match client % 3 {
                0 => tables.update_many(id, update.clone()).run()?,
                1 => tables.update_one(id, update.clone()).run()?,
                _ => {
                    let pipeline = vec![doc! { "$set": { "p": { "$ifNull": ["$p", round] } } }];
                    tables.update_one(id.clone(), pipeline).run()?;
                    tables.update_one(id, update.clone()).run()?
                }
            }
            .modified_count)
        };
        assert_eq!(at_once(CLIENTS, claim)?.into_iter().sum::<u64>(), 1, "{update}");
    }
    database.drop().run()?;
    Ok(())
}

fn once_each(mongod: &str) -> Result<(), Failed> {
    const COUNT: i32 = 60;
    let (_folder, served, database) = emptied(mongod, "once_each")?;
    let tables = database.collection::<Document>("tables");
    tables.insert_many((0..COUNT).map(|id| doc! { "_id": id, "l": [{ "x": 0 }, { "x": 0 }, { "x": 0 }] })).run()?;
    let is_done = AtomicBool::new(false);
    let change = |client: i32| -> Result<(), Failed> {
        let tables = served.client()?.database("once_each").collection::<Document>("tables");
        if client > 0 {
            for id in (0..COUNT).cycle() {
                if is_done.load(Ordering::Relaxed) {
                    break;
                }
                tables.update_one(doc! { "_id": id }, doc! { "$inc": { "n": 1 } }).run()?;
            }
            return Ok(());
        }
        let work = (0..3).try_for_each(|_| {
            let set = doc! { "$set": { "l.$.x": 1 }, "$addToSet": { "l.$.by": client } };
            let done = tables.update_many(doc! { "l.x": 0 }, set).run()?;
            assert_eq!((done.matched_count, done.modified_count), (60, 60));
            Ok(())
        });
        is_done.store(true, Ordering::Relaxed);
        work
    };
    at_once(3, change)?;
    assert_eq!(tables.count_documents(doc! { "l.x": 0 }).run()?, 0);
    database.drop().run()?;
    Ok(())
}

fn sized(mongod: &str) -> Result<(), Failed> {
    const LARGE: usize = 9 << 20;
    let (_folder, _served, database) = emptied(mongod, "sized")?;
    let things = database.collection::<Document>("things");
    let names: Vec<String> = (0..2500).map(|n| format!("a thing with a long name, {n}")).collect();
    let new = |id: i32| doc! { "_id": id, "name": &names[id as usize], "n": 1, "l": [{ "x": 0 }, { "x": 1 }] };
    things.insert_many((0..2500).map(new)).run()?;
    let ids: Vec<i32> = (0..2500).collect();
    for (filter, update) in [
        (doc! { "name": { "$in": &names } }, doc! { "$mul": { "n": 2 } }),
        (doc! { "_id": { "$in": &ids } }, doc! { "$mul": { "n": 2 } }),
        (doc! { "_id": { "$in": &ids }, "l.x": 1 }, doc! { "$set": { "l.$.y": 1 } }),
        (doc! { "name": { "$in": &names[..100] }, "l.x": 1 }, doc! { "$set": { "l.$.z": 1 } }),
    ] {
        let count = if update.to_string().contains(".z") { 100 } else { 2500 };
        let done = things.update_many(filter, update.clone()).run()?;
        assert_eq!((done.matched_count, done.modified_count), (count, count), "{update}");
    }
    assert_eq!(things.count_documents(doc! { "n": 4, "l.1.y": 1, "l.0.y": { "$exists": false } }).run()?, 2500);
    assert_eq!(things.count_documents(doc! { "l.1.z": 1 }).run()?, 100);
    things.drop().run()?;
    let large = |letter: &str| letter.repeat(LARGE);
    let reference = || doc! { "$ref": "c", "$id": 1 };
    things.insert_many((0..2).map(|id| doc! { "_id": id, "l": [1, reference()] })).run()?;
    for update in [
        doc! { "$set": { "b": large("a") } },
        doc! { "$set": { "b": "c".repeat(LARGE + (6 << 20)) } },
        doc! { "$unset": { "b": 1 } },
        doc! { "$addToSet": { "l": large("d") } },
        doc! { "$pullAll": { "l": [large("d")] } },
        doc! { "$pullAll": { "l": [reference()] } },
    ] {
        let done = things.update_many(doc! {}, update.clone()).run()?;
        assert_eq!((done.matched_count, done.modified_count), (2, 2), "{:.40}", update.to_string());
    }
    assert_eq!(things.count_documents(doc! { "l": [1], "b": { "$exists": false } }).run()?, 2);
    things.drop().run()?;
    // Texts that a request with a collation names by their bytes.
    for letter in ["x", "y", "z"] {
        things.insert_one(doc! { "_id": letter.repeat(4 << 20) }).run()?;
    }
    let ignoring_case =
        Collation::builder().locale("en").strength(mongodb::options::CollationStrength::Secondary).build();
    for update in [doc! { "$addToSet": { "l": { "$each": [1] } } }, doc! { "$inc": { "n": 1 } }] {
        let done = things.update_many(doc! {}, update).collation(ignoring_case.clone()).run()?;
        assert_eq!((done.matched_count, done.modified_count), (3, 3));
    }
    database.drop().run()?;
    Ok(())
}

fn uncomputed(mongod: &str) -> Result<(), Failed> {
    let (_folder, _served, database) = emptied(mongod, "uncomputed")?;
    let things = database.collection::<Document>("things");
    let text = |id: i32| if id % 3 == 0 { "2020-01-01" } else { "@1234567" };
    things.insert_many((0..200).map(|id| doc! { "_id": id, "at": text(id) })).run()?;
    let parse = vec![doc! { "$set": { "date": { "$dateFromString": { "dateString": "$at" } } } }];
    let done = things.update_many(doc! {}, parse.clone()).run()?;
    assert_eq!((done.matched_count, done.modified_count), (200, 200));
    let done = things.update_many(doc! {}, parse).run()?;
    assert_eq!((done.matched_count, done.modified_count), (200, 0));
    database.drop().run()?;
    Ok(())
}

fn waiting(mongod: &str) -> Result<(), Failed> {
    let (_folder, _served, database) = emptied(mongod, "waiting")?;
    database.collection("c").insert_many((0..9).map(|id| doc! { "_id": id, "n": 1 })).run()?;
    let behind = Client::with_uri_str(mongod)?;
    let mut other = behind.start_session().run()?;
    other.start_transaction().run()?;
    let held = behind.database("waiting").collection::<Document>("c");
    held.update_one(doc! { "_id": 5 }, doc! { "$set": { "n": 5 } }).session(&mut other).run()?;
    let add = vec![doc! { "$set": { "n": { "$add": ["$n", 1] } } }];
    let update = |update: bson::Bson, many: bool| {
        let query = if many {
            doc! {}
        } else {
            doc! { "_id": 5 }
        };
        doc! { "update": "c", "updates": [{ "q": query, "u": update, "multi": many }] }
    };
    let changes =
        [doc! { "$inc": { "n": 1 } }.into(), doc! { "$mul": { "n": 2 } }.into(), add.into(), doc! { "n": 7 }.into()];
    let updates = changes.into_iter().map(|change: bson::Bson| {
        let is_whole = change.as_document().is_some_and(|change| change.contains_key("n"));
        update(change, !is_whole)
    });
    let deletes = [0, 1].map(|limit| doc! { "delete": "c", "deletes": [{ "q": { "_id": 5 }, "limit": limit }] });
    for mut command in updates.chain(deletes) {
        command.insert("maxTimeMS", 200);
        assert_eq!(code(database.run_command(command.clone()).run()), Some(50), "{command}");
    }
    other.abort_transaction().run()?;
    assert_eq!(held.count_documents(doc! { "_id": 5, "n": 1 }).run()?, 1);
    database.drop().run()?;
    Ok(())
}

fn dropped(mongod: &str) -> Result<(), Failed> {
    let (_folder, served, database) = emptied(mongod, "dropped")?;
    let things = database.collection::<Document>("things");
    for pause in [20, 60, 100] {
        things.insert_many((0..3000).map(|id| doc! { "_id": id, "n": 1 })).run()?;
        at_once(2, |client| {
            let things = served.client()?.database("dropped").collection::<Document>("things");
            if client == 0 {
                std::thread::sleep(std::time::Duration::from_millis(pause));
                things.drop().run()?;
            } else {
                // It may end with what MongoDB says of a collection that has gone.
                let _ = things.update_many(doc! {}, doc! { "$mul": { "n": 2 } }).run();
            }
            Ok(())
        })?;
        assert_eq!(database.list_collection_names().run()?, [""; 0]);
    }
    Ok(())
}

/// One member of a set of one cannot be confirmed by two.
fn unconfirmed(mongod: &str) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let behind = Client::with_uri_str(mongod)?.database("unconfirmed");
    behind.drop().run()?;
    let things = behind.collection::<Document>("c");
    things.insert_many((0..2500).map(|id| doc! { "_id": id, "n": 1 })).run()?;
    let separator = if mongod.contains('?') { '&' } else { '?' };
    let asking = format!("{mongod}{separator}w=2&wtimeoutMS=100");
    for (update, n) in [("{$mul: {n: 2}}", 2), ("{$inc: {n: 1}}", 3)] {
        let said = rmem(folder.path(), &asking, &["update", "unconfirmed.c", "--many", "{}", update])?;
        assert!(said.contains("did not confirm it"), "{said}");
        assert_eq!(things.count_documents(doc! { "n": n }).run()?, 2500, "{said}");
    }
    behind.drop().run()?;
    Ok(())
}

fn upserted(mongod: &str) -> Result<(), Failed> {
    const CLIENTS: i32 = 8;
    let (_folder, served, database) = emptied(mongod, "upserted")?;
    let updates =
        [doc! { "$setOnInsert": { "n": 1 } }, doc! { "$addToSet": { "l": 1 } }, doc! { "$set": { "a.b": 1 } }];
    for (round, update) in (0..).zip(updates.iter().cycle().take(12)) {
        let upsert = |_| -> Result<(u64, u64), Failed> {
            let tables = served.client()?.database("upserted").collection::<Document>("tables");
            let done = tables.update_one(doc! { "_id": round }, update.clone()).upsert(true).run()?;
            Ok((done.modified_count, u64::from(done.upserted_id.is_some())))
        };
        let (modified, inserted): (Vec<_>, Vec<_>) = at_once(CLIENTS, upsert)?.into_iter().unzip();
        assert_eq!((modified.iter().sum::<u64>(), inserted.iter().sum::<u64>()), (0, 1), "{update}");
    }
    database.drop().run()?;
    Ok(())
}

fn signed(mongod: &str) -> Result<(), Failed> {
    const CLIENTS: i32 = 4;
    let folder = tempfile::tempdir()?;
    std::fs::write(folder.path().join("rmem.toml"), "keep_history = '1h'\n")?;
    let served = Served::start_memory(folder.path(), mongod, &["--listen", "127.0.0.1:0"])?;
    let behind = Client::with_uri_str(mongod)?.database("signed");
    behind.drop().run()?;
    let things = served.client()?.database("signed").collection::<Document>("c");
    things.insert_many((0..CLIENTS).map(|id| doc! { "_id": id, "n": 0 })).run()?;
    let together = std::sync::Barrier::new(usize::try_from(CLIENTS)?);
    let change = |client: i32| -> Result<(), Failed> {
        let things = served.client()?.database("signed").collection::<Document>("c");
        for _ in 0..6 {
            together.wait();
            things.update_one(doc! { "_id": client }, doc! { "$inc": { "n": 1 } }).run()?;
        }
        together.wait();
        let this = doc! { "_id": client };
        let removed = match client % 3 {
            0 => things.delete_one(this).run()?.deleted_count,
            1 => things.delete_many(this).run()?.deleted_count,
            _ => u64::from(things.find_one_and_delete(this).run()?.is_some()),
        };
        assert_eq!(removed, 1);
        Ok(())
    };
    at_once(CLIENTS, change)?;
    let entries = behind.collection::<Document>("rmem.history");
    let runs = [
        doc! { "$match": { "operation": { "$in": ["update", "delete"] } } },
        doc! { "$group": { "_id": "$run", "documents": { "$addToSet": "$document" }, "count": { "$sum": 1 } } },
    ];
    for run in entries.aggregate(runs).run()? {
        let run = run?;
        assert!(run.get_i64("_id").is_ok() && run.get_array("documents")?.len() == 1, "{run}");
    }
    for (operation, count) in [("update", 24), ("delete", 4)] {
        assert_eq!(entries.count_documents(doc! { "operation": operation }).run()?, count);
    }
    behind.drop().run()?;
    Ok(())
}

fn nearest(mongod: &str) -> Result<(), Failed> {
    const CLIENTS: i32 = 12;
    let (_folder, served, database) = emptied(mongod, "nearest")?;
    let shelves = database.collection::<Document>("shelves");
    shelves.create_index(mongodb::IndexModel::builder().keys(doc! { "at": "2d" }).build()).run()?;
    shelves.insert_many((0..60).map(|id| doc! { "_id": id, "at": [id, 0], "free": true })).run()?;
    let take = |client: i32| -> Result<(), Failed> {
        let shelves = served.client()?.database("nearest").collection::<Document>("shelves");
        let (free, take) = (doc! { "free": true, "at": { "$near": [0, 0] } }, doc! { "$unset": { "free": 1 } });
        match client % 2 {
            0 => assert_eq!(shelves.update_one(free, take).run()?.matched_count, 1),
            _ => assert!(shelves.find_one_and_update(free, take).run()?.is_some()),
        }
        Ok(())
    };
    at_once(CLIENTS, take)?;
    let farther = doc! { "free": { "$exists": false }, "_id": { "$gte": CLIENTS } };
    assert_eq!(shelves.count_documents(farther).run()?, 0);
    database.drop().run()?;
    Ok(())
}

fn equal_ids(mongod: &str) -> Result<(), Failed> {
    let (_folder, _served, database) = emptied(mongod, "equal_ids")?;
    let things = database.collection::<Document>("things");
    let ids = ["x", "X"].map(|text| {
        [
            bson::Bson::from(text),
            doc! { "a": text, "l": [1, { "b.c": text }] }.into(),
            doc! { "": { "d": text } }.into(),
        ]
    });
    let ids: Vec<_> = ids.into_iter().flatten().collect();
    things.insert_many(ids.iter().map(|id| doc! { "_id": id, "n": 0 })).run()?;
    let ignoring_case =
        Collation::builder().locale("en").strength(mongodb::options::CollationStrength::Secondary).build();
    // Each by a request of its own, and all by one.
    let pipeline = vec![doc! { "$replaceWith": { "$mergeObjects": ["$$ROOT", { "n": { "$add": ["$n", 1] } }] } }];
    let done = things.update_many(doc! {}, pipeline).collation(ignoring_case.clone()).run()?;
    assert_eq!((done.matched_count, done.modified_count), (6, 6));
    let done = things.update_many(doc! {}, doc! { "$inc": { "n": 1 } }).collation(ignoring_case.clone()).run()?;
    assert_eq!((done.matched_count, done.modified_count), (6, 6));
    assert_eq!(things.count_documents(doc! { "n": 2 }).run()?, 6);
    let one = doc! { "_id": ids.last().cloned() };
    let pop = vec![doc! { "$set": { "n": { "$add": ["$n", 1] } } }];
    assert!(things.find_one_and_update(one, pop).collation(ignoring_case).run()?.is_some());
    assert_eq!(things.count_documents(doc! { "n": 3 }).run()?, 1);
    database.drop().run()?;
    Ok(())
}

fn unique(field: &str) -> mongodb::IndexModel {
    let options = mongodb::options::IndexOptions::builder().unique(true).build();
    mongodb::IndexModel::builder().keys(doc! { field: 1 }).options(options).build()
}

fn numbered(mongod: &str) -> Result<(), Failed> {
    const CLIENTS: i32 = 4;
    const EACH: i32 = 15;
    let (_folder, served, database) = emptied(mongod, "numbered")?;
    let counters = database.collection::<Document>("counters");
    let add = [doc! { "$set": { "n": { "$add": ["$n", "$$step"] } } }];
    let collation = Collation::builder().locale("en").build();
    let count = |n: i32| -> Result<i64, Failed> {
        let counters = served.client()?.database("numbered").collection::<Document>("counters");
        let next = counters.find_one_and_update(doc! { "_id": 1 }, add.to_vec()).let_vars(doc! { "step": 1_i64 });
        let next = if n % 2 == 0 { next.collation(collation.clone()) } else { next };
        let next = next.return_document(ReturnDocument::After).run()?;
        Ok(next.ok_or("there was no counter")?.get_i64("n")?)
    };
    counters.insert_one(doc! { "_id": 1, "n": 0_i64 }).run()?;
    let mut numbers = at_once(CLIENTS, |_| (0..EACH).map(count).collect::<Result<Vec<_>, _>>())?.concat();
    numbers.sort_unstable();
    assert_eq!(numbers, (1..=i64::from(CLIENTS * EACH)).collect::<Vec<_>>());
    database.drop().run()?;
    Ok(())
}

fn repeated(mongod: &str) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start_memory(folder.path(), mongod, &["--listen", "127.0.0.1:0"])?;
    super::retries::compare(mongod, &served, "retries_in_front")
}

/// Runs `rmem` in a folder, with the server at a URI as its memory; gives what it says.
pub(super) fn rmem(folder: &Path, mongod: &str, arguments: &[&str]) -> Result<String, Failed> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rmem"));
    let output = command.current_dir(folder).args(["--memory", mongod]).args(arguments).output()?;
    Ok(String::from_utf8([output.stdout, output.stderr].concat())?)
}

fn part_way(mongod: &str) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    std::fs::write(folder.path().join("rmem.toml"), "keep_history = '1h'\n")?;
    let served = Served::start_memory(folder.path(), mongod, &["--listen", "127.0.0.1:0"])?;
    let behind = Client::with_uri_str(mongod)?.database("part_way");
    behind.drop().run()?;
    let (stored, entries) = (behind.collection::<Document>("c"), behind.collection::<Document>("rmem.history"));
    let things = served.client()?.database("part_way").collection::<Document>("c");
    let documents = (0..6).map(|id| {
        if id == 3 {
            doc! { "_id": id, "n": "x" }
        } else {
            doc! { "_id": id, "n": 0 }
        }
    });
    things.insert_many(documents.clone()).run()?;
    let more = doc! { "$inc": { "n": 1 } };
    assert_eq!(code(things.update_many(doc! {}, more).run()), Some(14));
    assert_eq!(stored.count_documents(doc! { "n": 1 }).run()?, 3);
    let is_dated = doc! { "n": 1, "$expr": { "$gt": ["$_robmem_info.updated", "$_robmem_info.inserted"] } };
    assert_eq!(stored.count_documents(is_dated).run()?, 3);
    assert_eq!(entries.count_documents(doc! { "operation": "update", "by": { "$exists": true } }).run()?, 3);
    // A key that is taken: what was stored before it is signed, too.
    let some = [doc! { "_id": 10 }, doc! { "_id": 0 }, doc! { "_id": 11 }];
    assert_eq!(code(things.insert_many(some).run()), Some(11_000));
    let own = doc! { "operation": "insert", "document": 10, "by": { "$exists": true } };
    assert_eq!(entries.count_documents(own).run()?, 1);
    let said = rmem(folder.path(), mongod, &["update", "part_way.c", "--many", "{}", "{$inc: {n: 1}}"])?;
    assert!(said.contains("failed after 3 documents; what was done stays"), "{said}");
    assert_eq!(stored.count_documents(doc! { "n": 2 }).run()?, 3);
    let said = rmem(folder.path(), mongod, &["undo", "part_way.c"])?;
    assert_eq!(stored.count_documents(doc! { "n": 1 }).run()?, 3, "{said}");
    behind.drop().run()?;
    Ok(())
}

/// Commands that have a write concern; each finds what those before it have left.
fn writes() -> Vec<Document> {
    let (map, reduce) = ("function() { emit(1, 1) }", "function(key, values) { return 1 }");
    vec![
        doc! { "insert": "c", "documents": [{ "_id": 1 }, { "_id": 2 }] },
        doc! { "insert": "c", "documents": [{ "_id": 3 }, { "_id": 1 }] },
        doc! { "update": "c", "updates": [{ "q": { "_id": 1 }, "u": { "$set": { "n": 1 } } }] },
        doc! { "update": "c", "updates": [{ "q": { "_id": 7 }, "u": { "$set": { "n": 1 } }, "upsert": true }] },
        doc! { "update": "c", "updates": [{ "q": {}, "u": { "$set": { "n": 2 } }, "multi": true }] },
        doc! { "update": "c", "updates": [{ "q": { "_id": 1 }, "u": { "$bad": 1 } }] },
        doc! { "delete": "c", "deletes": [{ "q": { "_id": 2 }, "limit": 1 }, { "q": { "n": 2 }, "limit": 0 }] },
        doc! { "findAndModify": "c", "query": { "_id": 1 }, "update": { "n": 3 }, "upsert": true, "new": true },
        doc! { "findAndModify": "c", "query": { "_id": 1 }, "remove": true },
        doc! { "findAndModify": "c", "query": { "_id": 1 }, "update": { "$bad": 1 } },
        doc! { "create": "d" },
        doc! { "createIndexes": "c", "indexes": [{ "key": { "n": 1 }, "name": "n_1" }] },
        doc! { "dropIndexes": "c", "index": "n_1" },
        doc! { "aggregate": "c", "pipeline": [{ "$out": "o" }], "cursor": {} },
        doc! { "mapReduce": "c", "map": map, "reduce": reduce, "out": "o" },
        doc! { "drop": "o" },
    ]
}

/// What an answer says of what was done, and of its confirmation.
fn said(answer: &Document) -> Document {
    let mut said: Document =
        ["ok", "n", "nModified", "upserted", "lastErrorObject", "value", "code", "writeConcernError"]
            .into_iter()
            .filter_map(|key| Some((key.to_owned(), answer.get(key)?.clone())))
            .collect();
    said.insert("failed", answer.get_array("writeErrors").map_or(0, Vec::len) as i64);
    said
}

fn confirmed(mongod: &str) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start_memory(folder.path(), mongod, &["--listen", "127.0.0.1:0"])?;
    let address = mongod.trim_start_matches("mongodb://").split('/').next().unwrap_or_default();
    let (mut behind, mut front) = (Wire::connect(address)?, Wire::connect(served.address())?);
    let concerns = [
        doc! { "w": 1 },
        doc! { "w": "majority", "j": true, "wtimeout": 5000 },
        doc! { "w": 5, "wtimeout": 100 },
        doc! { "w": "far" },
        doc! { "w": { "place": 2 } },
        doc! { "j": true },
        doc! { "j": true, "fsync": true },
    ];
    for concern in concerns {
        for write in writes() {
            let own = |database: &str| {
                let own = doc! { "$db": database, "writeConcern": concern.clone() };
                write.clone().into_iter().chain(own).collect::<Document>()
            };
            let (expected, found) = (behind.run(&own("confirmed"))?, front.run(&own("confirmed_in_front"))?);
            assert_eq!(said(&found), said(&expected), "{write} {concern}");
        }
        for database in ["confirmed", "confirmed_in_front"] {
            behind.run(&doc! { "dropDatabase": 1, "$db": database })?;
        }
    }
    Ok(())
}

/// In front of a server, and over a file.
fn whole(mongod: &str) -> Result<(), Failed> {
    let (_folder, served, database) = emptied(mongod, "whole")?;
    let folder = tempfile::tempdir()?;
    let over_file = Served::start(folder.path(), &[])?;
    let keep = doc! { "into": "t", "whenMatched": [{ "$set": { "seen": "$$ROOT" } }] };
    let schema = |schema: Document| doc! { "count": "c", "query": { "$jsonSchema": schema } };
    for served in [&served, &over_file] {
        let mut wire = Wire::connect(served.address())?;
        let mut run = |command: Document| wire.run(&[command, doc! { "$db": "whole" }].into_iter().flatten().collect());
        run(doc! { "insert": "c", "documents": [{ "_id": 1, "at": [0, 0] }, { "_id": 2, "at": [5, 5], "n": 1 }] })?;
        run(doc! { "insert": "t", "documents": [{ "_id": 1, "x": 9 }] })?;
        run(doc! { "createIndexes": "c", "indexes": [{ "key": { "at": "2dsphere" }, "name": "at" }] })?;
        run(doc! { "aggregate": "c", "pipeline": [{ "$match": { "_id": 1 } }, { "$merge": &keep }], "cursor": {} })?;
        let answer = run(doc! { "find": "t" })?;
        let found = answer.get_document("cursor")?.get_array("firstBatch")?;
        assert_eq!(found, &[doc! { "_id": 1, "x": 9, "seen": { "_id": 1, "x": 9 } }.into()]);
        let near =
            doc! { "$nearSphere": { "$geometry": { "type": "Point", "coordinates": [0, 0] }, "$maxDistance": 9 } };
        for (count, n) in [
            (doc! { "count": "c", "query": { "$where": "this.n == 1" } }, 1),
            (doc! { "count": "c", "query": { "at": near }, "limit": 5 }, 1),
            (schema(doc! { "maxProperties": 2 }), 1),
            (schema(doc! { "minProperties": 3.0 }), 1),
            (schema(doc! { "minProperties": 4_i64 }), 0),
            (schema(doc! { "minProperties": 2, "maxProperties": 3, "allOf": [{ "required": ["n"] }] }), 1),
        ] {
            let answer = run(count.clone())?;
            assert_eq!(answer.get_i32("n").ok(), Some(n), "{count}: {answer}");
        }
        let answer = run(schema(doc! { "minProperties": "x" }))?;
        assert_eq!(answer.get_i32("code")?, 9, "{answer}");
    }
    database.drop().run()?;
    Ok(())
}
