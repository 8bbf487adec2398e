//! Triggers of a real mongod: the same as those of a file, also when it is killed.

use std::collections::HashMap;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use bson::{Bson, Document, doc};
use libtest_mimic::Failed;
use rmem::memory::Memory;
use rmem::memory::watch::{Trigger, Watch, event};
use rmem::store::{Name, Namespace, Next, StoreUri, UpdateRequest, UpdateSpec};

use crate::mongod::Mongod;
use crate::watching::{Pause, Received, TIMEOUT, Watching, Writers, drain, killed_watch, kills, namespace, update};

type Case = fn(&str) -> Result<(), Failed>;

/// What is tried on the server at a URI.
pub(crate) const CASES: &[(&str, Case)] = &[
    ("triggers::both_stores_deliver_the_same_changes", both_deliver_the_same),
    ("triggers::a_name_of_mongod_goes_on_where_it_was_done", a_name_goes_on),
    ("triggers::a_killed_watch_of_mongod_misses_nothing", kill_watch_of_mongod),
];

/// What is tried on a real mongod alone.
pub(crate) const OF_MONGOD: &[(&str, Case)] =
    &[("triggers::a_field_is_set_by_one_request_that_watches_call_an_update", set_by_one_request)];

type Killer = fn(&Path) -> Result<(), Failed>;

/// What is tried on servers of its own, which are killed.
pub(crate) const KILLERS: &[(&str, Killer)] = &[
    ("triggers::a_killed_mongod_costs_a_watch_nothing", kill_mongod),
    ("triggers::a_standalone_mongod_is_explained_at_once", standalone),
];

fn memory(uri: &str) -> Result<Memory, Failed> {
    let uri = StoreUri::parse(uri)?;
    Ok(Memory::at(uri.clone(), uri, Vec::new()))
}

fn trigger(ns: &Namespace, name: Option<&str>) -> Trigger {
    Trigger {
        namespace: ns.clone(),
        filter: Document::new(),
        name: name.map(str::to_owned),
        computed: false,
        metadata: false,
    }
}

/// Collects changes, without what differs from store to store, up to the one of `_id: "end"`.
fn collect(watch: &mut Watch<'_>, ns: &Namespace, changes: &mut Vec<Document>) -> Result<(), Failed> {
    let since = Instant::now();
    while since.elapsed() < TIMEOUT {
        if let Next::Change(change) = watch.next(Duration::from_millis(100))? {
            let mut event = event(ns, &change)?;
            let end = event.get_str("_id").is_ok_and(|id| id == "end");
            event.remove("time");
            event.remove("position");
            if end && event.get_str("operation").is_ok_and(|kind| kind == "delete") {
                return Ok(());
            }
            if !end {
                changes.push(event);
            }
        }
    }
    Err(format!("the end did not come, after {changes:?}").into())
}

/// Changes everything there is to change; what a watch reports of it.
fn scripted(memory: &Memory, watched: &Memory, ns: &Namespace) -> Result<Vec<Document>, Failed> {
    let source = namespace("source");
    let mut watch = watched.watch(Trigger { filter: doc! { "hidden": { "$ne": true } }, ..trigger(ns, None) })?;
    let mut changes = Vec::new();
    let mut pause = |changes: &mut Vec<Document>| -> Result<(), Failed> {
        memory.insert(ns, vec![doc! { "_id": "end" }])?;
        memory.delete(ns, &doc! { "_id": "end" }, false)?;
        collect(&mut watch, ns, changes)
    };
    let set = |fields: Document| UpdateSpec::Document(doc! { "$set": fields });
    memory.insert(ns, (0..5).map(|n| doc! { "_id": n, "n": n, "hidden": n == 4 }).collect())?;
    memory.update(ns, &update(doc! { "_id": { "$lt": 3 } }, set(doc! { "m": [1, { "x": 2 }] }), true))?;
    memory.update(ns, &update(doc! { "_id": 0 }, set(doc! { "n": 0 }), false))?;
    memory.update(ns, &update(doc! { "_id": 4 }, set(doc! { "hidden": false }), false))?;
    memory.update(ns, &update(doc! { "_id": 4 }, set(doc! { "hidden": true }), false))?;
    // Of a long document, a server may well note what is different only.
    for q in 1..=2 {
        let long = doc! { "pad": "x".repeat(2_000), "q": q };
        memory.update(ns, &update(doc! { "_id": 1 }, UpdateSpec::Document(long), false))?;
    }
    let stages = vec![doc! { "$set": { "n": { "$add": ["$n", 10] } } }];
    memory.update(ns, &update(doc! { "_id": 2 }, UpdateSpec::Pipeline(stages), false))?;
    memory.update(ns, &update(doc! { "_id": 7 }, set(doc! { "made": true }), false))?;
    memory.update(ns, &update(doc! { "_id": 8 }, UpdateSpec::Document(doc! { "made": 8 }), false))?;
    memory.put(ns, vec![doc! { "_id": 8, "made": 9 }, doc! { "_id": 9 }, doc! { "_id": 9 }])?;
    memory.delete(ns, &doc! { "n": { "$gte": 3 } }, false)?;
    pause(&mut changes)?;
    memory.insert(&source, vec![doc! { "_id": 20, "s": 1 }, doc! { "_id": 21, "s": 2 }])?;
    drop(memory.aggregate(&source, &[doc! { "$out": &ns.collection }])?);
    pause(&mut changes)?;
    memory.update(&source, &update(doc! { "_id": 21 }, set(doc! { "s": 3 }), false))?;
    memory.insert(&source, vec![doc! { "_id": 22 }])?;
    drop(memory.aggregate(&source, &[doc! { "$merge": &ns.collection }])?);
    memory.rename_collection(&source, ns, true)?;
    pause(&mut changes)?;
    memory.update(ns, &update(doc! { "_id": 22 }, set(doc! { "s": 4 }), false))?;
    memory.drop_collection(ns)?;
    pause(&mut changes)?;
    memory.insert(ns, vec![doc! { "_id": 30 }])?;
    memory.rename_collection(ns, &namespace("away"), true)?;
    pause(&mut changes)?;
    Ok(changes)
}

fn both_deliver_the_same(uri: &str) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let file = format!("file:{}", folder.path().join("robot.rmem").display());
    let ns = namespace("same");
    let embedded = scripted(&memory(&file)?, &memory(&file)?, &ns)?;
    let server = scripted(&memory(uri)?, &memory(uri)?, &ns)?;
    for (left, right) in embedded.iter().zip(&server) {
        assert_eq!(left, right);
    }
    assert_eq!(embedded.len(), server.len());
    let mut kinds: HashMap<String, usize> = HashMap::new();
    embedded.iter().for_each(|event| *kinds.entry(event.get_str("operation").unwrap().to_owned()).or_default() += 1);
    let wanted =
        [("insert", 4 + 3 + 2 + 1 + 3 + 1), ("update", 3 + 1 + 1 + 1 + 1), ("replace", 3), ("delete", 2), ("drop", 4)];
    assert_eq!(kinds, wanted.map(|(kind, count)| (kind.to_owned(), count)).into(), "{embedded:#?}");
    Ok(())
}

/// Documents with more than the field, and one with little more.
fn set_by_one_request(uri: &str) -> Result<(), Failed> {
    let (memory, ns) = (memory(uri)?, Namespace::parse("requests.c")?);
    let database = mongodb::sync::Client::with_uri_str(uri)?.database(&ns.database);
    let things = ["cup", "cup", "box"].into_iter().enumerate();
    let things = things.map(|(id, name)| doc! { "_id": id as i64, "name": name, "position": "0", "room": "kitchen" });
    memory.insert(&ns, things.collect())?;
    // Other clients write no metadata.
    database.collection(&ns.collection).insert_one(doc! { "_id": 3_i64, "n": 0 }).run()?;
    let mut watch = memory.watch(trigger(&ns, None))?;
    database.run_command(doc! { "profile": 2 }).run()?;
    let set = |filter: Document, fields: Document| -> Result<(u64, u64), Failed> {
        let set = UpdateSpec::Document(doc! { "$set": fields });
        let done = memory.update(&ns, &UpdateRequest { filter, update: set, ..UpdateRequest::default() })?;
        Ok((done.matched, done.modified))
    };
    assert_eq!(set(doc! { "name": "cup" }, doc! { "position": "1" })?, (1, 1));
    // The first one is meant, also where another one would change.
    assert_eq!(set(doc! { "name": "cup" }, doc! { "position": "1" })?, (1, 0));
    assert_eq!(set(doc! { "_id": 2_i64 }, doc! { "position": "1" })?, (1, 1));
    assert_eq!(set(doc! { "name": "bowl" }, doc! { "position": "1" })?, (0, 0));
    database.run_command(doc! { "profile": 0 }).run()?;
    assert_eq!(set(doc! { "n": 0 }, doc! { "n": 1 })?, (1, 1));
    // A value of another type is a change, also where the two are equal.
    assert_eq!(set(doc! { "name": "box" }, doc! { "room": 1 })?, (1, 1));
    assert_eq!(set(doc! { "name": "box" }, doc! { "room": 1.0 })?, (1, 1));
    assert_eq!(set(doc! { "name": "box" }, doc! { "room": 1.0 })?, (1, 0));
    assert_eq!(set(doc! { "name": "box" }, doc! { "room": [f64::NAN] })?, (1, 1));
    assert_eq!(set(doc! { "name": "box" }, doc! { "room": [f64::NAN] })?, (1, 0));
    let profile = database.collection::<Document>("system.profile");
    let entries = profile.find(doc! { "ns": ns.to_string() }).sort(doc! { "ts": 1 }).run()?;
    let entries = entries.collect::<mongodb::error::Result<Vec<Document>>>()?;
    let asked: Vec<&str> = entries.iter().filter_map(|entry| entry.get_str("op").ok()).collect();
    // What stays as it is takes a second one, and both are quick: neither writes.
    assert_eq!(asked, ["update"; 5]);
    let mut changes = Vec::new();
    memory.insert(&ns, vec![doc! { "_id": "end" }])?;
    memory.delete(&ns, &doc! { "_id": "end" }, false)?;
    collect(&mut watch, &ns, &mut changes)?;
    let kinds: Vec<_> = changes.iter().map(|event| event.get_str("operation").unwrap_or_default()).collect();
    assert_eq!(kinds, ["update"; 6], "{changes:?}");
    Ok(())
}

fn a_name_goes_on(uri: &str) -> Result<(), Failed> {
    let (memory, other, ns) = (memory(uri)?, memory(uri)?, namespace("named"));
    let mut watch = memory.watch(trigger(&ns, Some("shared")))?;
    let held = other.watch(trigger(&ns, Some("shared"))).err().ok_or("two have one name")?.to_string();
    assert!(held.contains("follows changes by the name `shared`; end it first"), "{held}");
    memory.insert(&ns, (0..10).map(|n| doc! { "_id": n }).collect())?;
    let mut ids = Vec::new();
    while ids.len() < 4 {
        if let Next::Change(change) = watch.next(Duration::from_secs(1))? {
            ids.extend(change.id);
        }
    }
    watch.done()?;
    drop(watch);
    let mut watch = other.watch(trigger(&ns, Some("shared")))?;
    while ids.len() < 10 {
        if let Next::Change(change) = watch.next(Duration::from_secs(1))? {
            ids.extend(change.id);
        }
    }
    assert_eq!(ids, (0..10).map(Bson::Int32).collect::<Vec<_>>());
    drop(watch);
    let other_ns =
        other.watch(trigger(&namespace("else"), Some("shared"))).err().ok_or("a name has two collections")?;
    assert!(other_ns.to_string().contains("the name `shared` follows watching.named"), "{other_ns}");
    assert!(other.watch(trigger(&namespace("rmem.watchers"), None)).is_err());
    let own = |names: Vec<Name>| names.into_iter().filter(|name| name.namespace == ns).collect::<Vec<_>>();
    let free = Name { name: "shared".into(), namespace: ns.clone(), process: None, missed: false, waiting: None };
    assert_eq!(own(memory.watch_names()?), std::slice::from_ref(&free));
    let watch = other.watch(trigger(&ns, Some("shared")))?;
    assert_eq!(own(memory.watch_names()?), [Name { process: Some(std::process::id()), ..free }]);
    drop(watch);
    let shown = memory.collections()?;
    assert!(shown.contains(&ns) && shown.iter().all(|shown| !shown.collection.contains("watchers")), "{shown:?}");
    assert!(memory.forget_watch(&ns, "shared")? && !memory.forget_watch(&ns, "shared")?);
    Ok(())
}

fn kill_watch_of_mongod(uri: &str) -> Result<(), Failed> {
    killed_watch(uri, &namespace("killed"))
}

/// Kills the server in the middle of changes, again and again, and the watch with it now and then.
fn kill_mongod(program: &Path) -> Result<(), Failed> {
    let mut server = Mongod::start(program)?;
    let (uri, ns, home) = (server.uri.clone(), namespace("server"), tempfile::tempdir()?);
    let (mut received, mut pause) = (Received::default(), Pause::new());
    let mut watching = Some(Watching::start(&uri, &ns, home.path())?);
    let writers = Writers::start(&uri, &ns, true)?;
    for round in 0..kills().div_ceil(4) {
        pause.sleep(1_500_000);
        server.kill()?;
        if round % 2 == 1
            && let Some(watching) = watching.take()
        {
            received.receive_all(&watching.kill()?)?;
        }
        server.revive()?;
        if watching.is_none() {
            watching = Some(Watching::start(&uri, &ns, home.path())?);
        }
    }
    pause.sleep(1_500_000);
    let written = writers.stop()?;
    drain(watching.ok_or("there is no watch")?, &mut received, &written)?;
    pause.end();
    eprintln!("{ns}: {} changes, {} of them again", written.iter().sum::<i32>(), received.again);
    Ok(())
}

fn standalone(program: &Path) -> Result<(), Failed> {
    let server = Mongod::alone(program, &[])?;
    let refused = memory(&server.uri)?.watch(trigger(&namespace("alone"), None)).err().ok_or("it is watched")?;
    assert!(refused.to_string().contains("start mongod with --replSet NAME"), "{refused}");
    let output = Command::new(env!("CARGO_BIN_EXE_rmem")).args(["--memory", &server.uri, "watch", "a.b"]).output()?;
    assert_eq!(output.status.code(), Some(4));
    Ok(())
}
