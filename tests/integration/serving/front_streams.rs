//! Change streams of `rmem serve` in front of a MongoDB server.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use bson::{Document, Timestamp, doc};
use libtest_mimic::Failed;
use mongodb::sync::Client;

use super::Served;
use super::outages::fail_behind;
use super::wire::Wire;
use crate::mongod::Mongod;

type Case = fn(&str) -> Result<(), Failed>;

/// What is tried in front of the server at a URI.
pub(crate) const CASES: &[(&str, Case)] = &[
    ("serving::in_front_of_mongod::change_streams_do_not_show_what_rmem_keeps", hidden),
    ("serving::in_front_of_mongod::change_streams_begin_and_end_as_the_servers", begun_and_ended),
    ("serving::in_front_of_mongod::change_streams_are_of_what_is_served", of_what_is_served),
    ("serving::in_front_of_mongod::change_streams_bring_large_events_few_at_a_time", few_at_a_time),
];

type Killer = fn(&Path) -> Result<(), Failed>;

/// What is tried with a server of its own.
pub(crate) const KILLERS: &[(&str, Killer)] = &[
    ("serving::in_front_of_mongod::a_change_stream_goes_on_where_the_server_was_away", gone_on),
    ("serving::in_front_of_mongod::a_change_stream_is_opened_where_the_server_fails_for_a_moment", opened_again),
];

const DATABASE: &str = "front_streams";

/// A change stream through one connection, without a driver that resumes it.
pub(super) struct Follower {
    wire: Wire,
    database: String,
    collection: String,
    id: i64,
    first: Vec<Document>,
    token: Option<Document>,
}

impl Follower {
    /// Opens a stream of a collection, or of the database.
    pub(super) fn open(
        address: &str,
        database: &str,
        collection: Option<&str>,
        options: Document,
        stages: &[Document],
    ) -> Result<Self, Failed> {
        let mut wire = Wire::connect(address)?;
        let mut pipeline = vec![doc! { "$changeStream": options }];
        pipeline.extend_from_slice(stages);
        let command = match collection {
            Some(collection) => doc! { "aggregate": collection },
            None => doc! { "aggregate": 1 },
        };
        let variables = doc! { "kind": "insert" };
        let rest = doc! { "pipeline": pipeline, "cursor": {}, "let": variables, "$db": database };
        let answer = wire.run(&command.into_iter().chain(rest).collect())?;
        let cursor = answer.get_document("cursor").map_err(|_| Failed::from(answer.to_string()))?;
        let collection = cursor.get_str("ns")?.split_once('.').map_or("", |(_, name)| name).to_owned();
        Ok(Self {
            id: cursor.get_i64("id")?,
            first: events(cursor, "firstBatch")?,
            token: cursor.get_document("postBatchResumeToken").ok().cloned(),
            wire,
            database: database.to_owned(),
            collection,
        })
    }

    /// The next events, which are waited for for a moment.
    pub(super) fn next(&mut self) -> Result<Vec<Document>, Failed> {
        if !self.first.is_empty() || self.id == 0 {
            return Ok(std::mem::take(&mut self.first));
        }
        let more = doc! { "getMore": self.id, "collection": &self.collection, "maxTimeMS": 100, "$db": &self.database };
        let answer = self.wire.run(&more)?;
        let cursor = answer.get_document("cursor").map_err(|_| Failed::from(answer.to_string()))?;
        self.id = cursor.get_i64("id")?;
        self.token = cursor.get_document("postBatchResumeToken").ok().cloned();
        events(cursor, "nextBatch")
    }

    /// So many events, and that no more come behind them.
    fn take(&mut self, count: usize) -> Result<Vec<Document>, Failed> {
        let (mut all, since) = (Vec::new(), std::time::Instant::now());
        while all.len() < count && since.elapsed() < super::TIMEOUT {
            all.extend(self.next()?);
        }
        all.extend(self.next()?);
        assert_eq!(all.len(), count, "{all:?}");
        Ok(all)
    }

    /// The `_id`s of the inserts, as often as they are reported, up to `last`, which is inserted after `stop` is set.
    pub(super) fn inserted(mut self, stop: &AtomicBool, last: &str) -> Result<Vec<String>, Failed> {
        let (mut all, mut stopped) = (Vec::<String>::new(), None);
        loop {
            for event in self.next()? {
                if event.get_str("operationType")? == "insert" {
                    all.push(event.get_document("documentKey")?.get_str("_id")?.to_owned());
                }
            }
            if all.iter().any(|id| id == last) {
                return Ok(all);
            }
            if stop.load(Ordering::SeqCst) {
                let since = *stopped.get_or_insert_with(std::time::Instant::now);
                assert!(since.elapsed() < super::TIMEOUT, "the stream does not go on behind {:?}", all.last());
            }
        }
    }

    /// The `_id`s of the events up to that of one.
    fn take_all_of(mut self, last: i32) -> Result<BTreeSet<i32>, Failed> {
        let (mut all, since) = (BTreeSet::new(), std::time::Instant::now());
        while !all.contains(&last) {
            assert!(since.elapsed() < super::TIMEOUT, "{all:?}");
            all.extend(heads(&self.next()?).into_iter().map(|(_, id)| id));
        }
        Ok(all)
    }
}

fn events(cursor: &Document, batch: &str) -> Result<Vec<Document>, Failed> {
    Ok(cursor.get_array(batch)?.iter().filter_map(|event| event.as_document().cloned()).collect())
}

/// What happened, and to which document.
fn heads(events: &[Document]) -> Vec<(&str, i32)> {
    let id = |event: &Document| event.get_document("documentKey").ok()?.get_i32("_id").ok();
    events.iter().map(|event| (event.get_str("operationType").unwrap_or(""), id(event).unwrap_or(-1))).collect()
}

fn hidden(mongod: &str) -> Result<(), Failed> {
    // Of this test alone: a stream of a database reports what other tests do in it.
    const DATABASE: &str = "front_streams_hidden";
    let folder = tempfile::tempdir()?;
    let served = Served::start_memory(folder.path(), mongod, &["--listen", "127.0.0.1:0"])?;
    let database = served.client()?.database(DATABASE);
    let things = database.collection::<Document>("hidden");
    let behind = Client::with_uri_str(mongod)?.database(DATABASE);
    things.drop().run()?;
    let images = doc! { "create": "hidden", "changeStreamPreAndPostImages": { "enabled": true } };
    database.run_command(images).run()?;
    let options = doc! { "fullDocument": "required", "fullDocumentBeforeChange": "whenAvailable" };
    let open = |collection, options: &Document, stages: &[Document]| {
        Follower::open(served.address(), DATABASE, collection, options.clone(), stages)
    };
    let mut stream = open(Some("hidden"), &options, &[])?;
    let mut all = open(None, &doc! {}, &[])?;
    let is_insert = doc! { "$eq": ["$operationType", "$$kind"] };
    let stages = [doc! { "$match": { "fullDocument._robmem_info": { "$exists": false }, "$expr": is_insert } }];
    let mut inserted = open(Some("hidden"), &doc! {}, &stages)?;
    let own = Served::start_memory(folder.path(), mongod, &["--listen", "127.0.0.1:0", "--meta"])?;
    let mut shown = Follower::open(own.address(), DATABASE, Some("hidden"), doc! {}, &[])?;

    let list: Vec<i32> = (0..100).collect();
    things.insert_one(doc! { "_id": 1, "a": { "b": 1 }, "l": &list }).run()?;
    things.update_one(doc! { "_id": 1 }, doc! { "$set": { "a.b": 2 } }).run()?;
    // What only the server can work out is dated in a second step, which is no change for a client.
    things.update_one(doc! { "_id": 1 }, vec![doc! { "$set": { "r": { "$rand": {} } } }]).run()?;
    things.update_one(doc! { "_id": 1 }, vec![doc! { "$set": { "l": { "$slice": ["$l", 90] } } }]).run()?;
    things.replace_one(doc! { "_id": 1 }, doc! { "c": 1 }).run()?;
    things.delete_one(doc! { "_id": 1 }).run()?;
    // What a computable made is there for it alone, and so are rmem's own collections.
    let computed = doc! { "_id": 2, "_robmem_info": { "computed": true } };
    behind.collection::<Document>("hidden").insert_one(&computed).run()?;
    behind.collection::<Document>("hidden").delete_one(doc! { "_id": 2 }).run()?;
    let own = doc! { "_id": 4, "_robmem_info": { "l": &list } };
    let cut = vec![doc! { "$set": { "_robmem_info.l": { "$slice": ["$_robmem_info.l", 90] } } }];
    behind.collection::<Document>("others").insert_one(own).run()?;
    behind.collection::<Document>("others").update_one(doc! {}, cut).run()?;
    behind.collection::<Document>("rmem.own").insert_one(doc! { "_id": 3 }).run()?;

    let kinds = [
        ("insert", 1),
        ("update", 1),
        ("update", 1),
        ("update", 1),
        ("replace", 1),
        ("delete", 1),
        ("delete", 2),
        ("insert", 4),
    ];
    let events = stream.take(6)?;
    assert_eq!(heads(&events), kinds[..6]);
    assert!(!format!("{events:?}").contains("_robmem_info"), "{events:?}");
    let document = |event: usize, name: &str| events[event].get_document(name).cloned();
    assert_eq!(document(0, "fullDocument")?, doc! { "_id": 1, "a": { "b": 1 }, "l": &list });
    let update = doc! { "updatedFields": { "a.b": 2 }, "removedFields": [], "truncatedArrays": [] };
    assert_eq!(document(1, "updateDescription")?, update);
    assert_eq!(document(1, "fullDocumentBeforeChange")?, document(0, "fullDocument")?);
    assert_eq!(document(3, "updateDescription")?.get_array("truncatedArrays")?.len(), 1);
    assert_eq!(document(4, "fullDocument")?, doc! { "_id": 1, "c": 1 });
    assert!(document(4, "updateDescription").is_err());
    // Without the document before, a stream cannot leave out the removal of a computed document.
    assert_eq!(heads(&all.take(8)?), kinds);
    assert_eq!(heads(&inserted.take(1)?), kinds[..1]);
    let shown = shown.take(8)?;
    assert!(shown[0].get_document("fullDocument")?.contains_key("_robmem_info"), "{shown:?}");
    assert!(heads(&shown).iter().filter(|(kind, _)| *kind == "update").count() == 4, "{shown:?}");
    Ok(())
}

fn of_what_is_served(mongod: &str) -> Result<(), Failed> {
    const SERVED: &str = "front_streams_served";
    let folder = tempfile::tempdir()?;
    let settings = "shared = 'file:shared.rmem'\nshared_databases = ['front_streams_shared']\nkeep_history = '1h'\n";
    std::fs::write(folder.path().join("rmem.toml"), settings)?;
    let served = Served::start_memory(folder.path(), mongod, &["--listen", "127.0.0.1:0"])?;
    let (client, behind) = (served.client()?, Client::with_uri_str(mongod)?);
    let database = client.database(SERVED);
    database.drop().run()?;
    let things = database.collection::<Document>("c");
    things.insert_one(doc! { "_id": 1 }).run()?;
    // A database of a shared name on this server is not what is served by that name.
    let expanded = doc! { "showExpandedEvents": true };
    let mut all = {
        let options = doc! { "allChangesForCluster": true };
        let stages = [doc! { "$match": { "ns.db": { "$in": [SERVED, "front_streams_shared"] } } }];
        Follower::open(served.address(), "admin", None, options, &stages)?
    };
    let mut expanded = Follower::open(served.address(), SERVED, None, expanded, &[])?;
    let shared = |client: &Client| client.database("front_streams_shared").collection::<Document>("c");
    shared(&behind).insert_one(doc! { "_id": 7 }).run()?;
    shared(&behind).drop().run()?;
    shared(&client).insert_one(doc! { "_id": 8 }).run()?;
    // What rmem does for a document that decays, and for a history, is no event for clients.
    let decay = bson::DateTime::from_millis(4_000_000_000_000);
    things.insert_one(doc! { "_id": 2, "_robmem_info": { "decay_time": decay } }).run()?;
    things.update_one(doc! { "_id": 2 }, doc! { "$set": { "a": 1 } }).run()?;
    let images = doc! { "create": "d", "changeStreamPreAndPostImages": { "enabled": true } };
    database.run_command(images).run()?;
    database.drop().run()?;
    let kinds = [
        ("insert", 2),
        ("update", 2),
        ("create", -1),
        ("drop", -1),
        ("drop", -1),
        ("dropDatabase", -1),
        ("invalidate", -1),
    ];
    assert_eq!(heads(&expanded.take(7)?), kinds);
    let kinds: Vec<_> = kinds.into_iter().filter(|(kind, _)| !["create", "invalidate"].contains(kind)).collect();
    assert_eq!(heads(&all.take(5)?), kinds);
    Ok(())
}

fn few_at_a_time(mongod: &str) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start_memory(folder.path(), mongod, &["--listen", "127.0.0.1:0"])?;
    let things = served.client()?.database(DATABASE).collection::<Document>("few");
    things.drop().run()?;
    things.insert_one(doc! { "_id": -1 }).run()?;
    let mut stream = Follower::open(served.address(), DATABASE, Some("few"), doc! {}, &[])?;
    let text = "x".repeat(200_000);
    let insert = |ids: std::ops::Range<i32>| things.insert_many(ids.map(|id| doc! { "_id": id, "text": &text })).run();
    insert(0..1)?;
    assert_eq!(heads(&stream.take(1)?), [("insert", 0)]);
    insert(1..40)?;
    let (mut sizes, since) = (Vec::new(), std::time::Instant::now());
    while sizes.iter().sum::<usize>() < 39 && since.elapsed() < super::TIMEOUT {
        sizes.push(stream.next()?.len());
    }
    assert!(sizes.iter().all(|size| *size <= 5) && sizes.iter().sum::<usize>() == 39, "{sizes:?}");
    Ok(())
}

fn begun_and_ended(mongod: &str) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start_memory(folder.path(), mongod, &["--listen", "127.0.0.1:0"])?;
    let things = served.client()?.database(DATABASE).collection::<Document>("begun");
    things.insert_many((0..3).map(|id| doc! { "_id": id })).run()?;
    let open = |options| Follower::open(served.address(), DATABASE, Some("begun"), options, &[]);
    let mut stream = open(doc! {})?;
    let start = stream.token.clone().ok_or("no token")?;
    // A time that this server told is of its own count.
    let hello = Wire::connect(served.address())?.run(&doc! { "ping": 1, "$db": DATABASE })?;
    let told = hello.get_document("$clusterTime")?.get_timestamp("clusterTime")?;
    let more = (3..250).map(|id| doc! { "_id": id });
    things.insert_many(more).run()?;
    let events = stream.take(247)?;
    open(doc! { "resumeAfter": stream.token.clone() })?.take(0)?;
    assert_eq!(heads(&open(doc! { "resumeAfter": &start })?.take(247)?)[246], ("insert", 249));
    let middle = events[99].get_document("_id")?;
    assert_eq!(heads(&open(doc! { "startAfter": middle })?.take(147)?)[0], ("insert", 103));
    let since = open(doc! { "startAtOperationTime": told })?.take_all_of(249)?;
    assert!(since.contains(&3), "{since:?}");
    let exact: Timestamp = events[240].get_timestamp("clusterTime")?;
    assert!(open(doc! { "startAtOperationTime": exact })?.take_all_of(249)?.contains(&243));
    // It ends with its collection.
    things.drop().run()?;
    let ended = stream.take(2)?;
    assert_eq!(heads(&ended), [("drop", -1), ("invalidate", -1)]);
    assert_eq!(stream.id, 0);
    let invalidate = ended[1].get_document("_id")?;
    things.insert_one(doc! { "_id": 1 }).run()?;
    assert_eq!(heads(&open(doc! { "startAfter": invalidate })?.take(1)?), [("insert", 1)]);
    // What the server refuses is refused with its code, and so is what its stream cannot have.
    let mut wire = Wire::connect(served.address())?;
    let wrong = [
        (vec![doc! { "$changeStream": { "resumeAfter": invalidate } }], 260),
        (vec![doc! { "$changeStream": {} }, doc! { "$group": { "_id": 1 } }], 20),
    ];
    for (pipeline, code) in wrong {
        let command = doc! { "aggregate": "begun", "pipeline": pipeline, "cursor": {}, "$db": DATABASE };
        let answer = wire.run(&command)?;
        assert_eq!(answer.get_i32("code").ok(), Some(code));
    }
    // One that is killed is gone, for who waits for it, too.
    let mut stream = open(doc! {})?;
    let kill = doc! { "killCursors": "begun", "cursors": [stream.id], "$db": DATABASE };
    assert_eq!(wire.run(&kill)?.get_array("cursorsKilled")?.len(), 1);
    assert!(stream.next().is_err());
    Ok(())
}

fn gone_on(program: &Path) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let mut server = Mongod::start(program)?;
    let served = Served::start_memory(folder.path(), &server.uri, &["--listen", "127.0.0.1:0"])?;
    let things = served.client()?.database(DATABASE).collection::<Document>("gone_on");
    things.insert_one(doc! { "_id": 0 }).run()?;
    let mut stream = Follower::open(served.address(), DATABASE, Some("gone_on"), doc! {}, &[])?;
    let mut read = Follower::open(served.address(), DATABASE, Some("gone_on"), doc! {}, &[])?;
    things.insert_one(doc! { "_id": 1 }).run()?;
    assert_eq!(heads(&read.take(1)?), [("insert", 1)]);
    server.kill()?;
    // While it is away, nothing comes.
    assert!(stream.next()?.is_empty() && read.next()?.is_empty());
    server.revive()?;
    things.insert_one(doc! { "_id": 2 }).run()?;
    assert_eq!(heads(&stream.take(2)?), [("insert", 1), ("insert", 2)]);
    assert_eq!(heads(&read.take(1)?), [("insert", 2)]);
    Ok(())
}

fn opened_again(program: &Path) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let server = Mongod::failing(program)?;
    let admin = crate::mongod::admin(server.port)?;
    let served = Served::start_memory(folder.path(), &server.uri, &["--listen", "127.0.0.1:0"])?;
    let things = served.client()?.database(DATABASE).collection::<Document>("opened");
    things.insert_one(doc! { "_id": 0 }).run()?;
    let fail = |times: i32, command: &str, how: Document| {
        fail_behind(
            &admin,
            doc! { "times": times },
            doc! { "failCommands": [command] }.into_iter().chain(how).collect(),
        )
    };
    let open = || Follower::open(served.address(), DATABASE, Some("opened"), doc! {}, &[]);
    for how in [doc! { "errorCode": 10_107 }, doc! { "errorCode": 91 }, doc! { "closeConnection": true }] {
        fail(2, "aggregate", how)?;
        open()?;
    }
    let mut stream = open()?;
    for (id, how) in
        (1..).zip([doc! { "errorCode": 43 }, doc! { "errorCode": 11_602 }, doc! { "closeConnection": true }])
    {
        fail(2, "getMore", how)?;
        things.insert_one(doc! { "_id": id }).run()?;
        assert_eq!(heads(&stream.take(1)?), [("insert", id)]);
    }
    // What does not pass is the client's to know of.
    fail(1, "getMore", doc! { "errorCode": 286 })?;
    let error = (0..3).find_map(|_| stream.next().err()).ok_or("no error")?;
    let message = error.message().unwrap_or_default().to_owned();
    assert!(message.contains("NonResumableChangeStreamError") && message.contains("286"), "{message}");
    Ok(())
}
