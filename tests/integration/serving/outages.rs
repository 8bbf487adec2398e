//! `rmem serve` in front of a MongoDB server that fails behind a write which it has done.

use std::path::Path;

use bson::{Document, doc};
use libtest_mimic::Failed;
use mongodb::sync::{Client, Database};

use super::Served;
use super::wire::Wire;
use crate::mongod::{Mongod, admin};

type Killer = fn(&Path) -> Result<(), Failed>;

/// What is tried with a server of its own, which is told when to fail.
pub(crate) const KILLERS: &[(&str, Killer)] =
    &[("serving::in_front_of_mongod::what_is_done_is_not_answered_as_to_be_repeated", answered)];

/// Has the server close the connection of queries of the collection, from the one behind the first few on.
fn close_queries(admin: &Database, skip: i32) -> Result<(), Failed> {
    fail_behind(admin, skip, doc! { "failCommands": ["find"], "namespace": "outages.c", "closeConnection": true })
}

fn fail_behind(admin: &Database, skip: i32, data: Document) -> Result<(), Failed> {
    let mode = doc! { "skip": skip };
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
