//! Dumps and locks with a real mongod on one side or on both.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use bson::{Bson, DateTime, Document, doc};
use libtest_mimic::Failed;
use rmem::memory::Memory;
use rmem::memory::dump::diff::{DiffError, Side, compare};
use rmem::memory::dump::read::Dump;
use rmem::memory::dump::restore::{RestoreOptions, restore};
use rmem::memory::dump::write;
use rmem::memory::lock::{Mutex, Tried};
use rmem::store::{
    Embedded, Find, FindAndModify, Modification, Modifiers, Namespace, StoreUri, UpdateRequest, UpdateSpec,
};

type Case = fn(&str) -> Result<(), Failed>;

/// What is tried on the server at a URI.
pub(crate) const CASES: &[(&str, Case)] = &[
    ("worlds::a_dump_of_the_embedded_store_restores_into_mongod", to_server),
    ("worlds::a_dump_of_mongod_restores_into_the_embedded_store", from_server),
    ("worlds::a_failed_restore_leaves_what_mongod_had", failed),
    ("worlds::a_killed_restore_leaves_each_collection_of_mongod_old_or_new", crate::restores::on_server),
    ("worlds::one_robot_at_a_time_holds_a_lock_in_mongod", contended),
    ("worlds::a_lock_in_mongod_expires", expiring),
    ("worlds::a_counter_in_mongod_gives_each_number_once", counted),
    ("worlds::interrupted_changes_of_mongod_say_how_much_is_done", interrupted),
];

/// Interrupts rmem in the middle of an update and of a restore of many documents.
fn interrupted(uri: &str) -> Result<(), Failed> {
    const COUNT: usize = 20_000;
    let folder = tempfile::tempdir()?;
    let ns = Namespace::parse("worlds.interrupted")?;
    let memory = memory(uri)?;
    memory.drop_collection(&ns)?;
    let count = |filter: Document| -> Result<u64, Failed> { Ok(memory.count(&ns, &filter)?) };
    let run = |arguments: &[&str], is_begun: &dyn Fn() -> Result<bool, Failed>| -> Result<String, Failed> {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rmem"));
        command.args(["--memory", uri]).args(arguments).current_dir(folder.path()).env("HOME", folder.path());
        let mut child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn()?;
        while !is_begun()? && child.try_wait()?.is_none() {
            std::thread::sleep(Duration::from_millis(2));
        }
        let process = rustix::process::Pid::from_raw(i32::try_from(child.id())?).ok_or("no process")?;
        rustix::process::kill_process(process, rustix::process::Signal::INT)?;
        let ended = child.wait_with_output()?;
        assert_eq!(ended.status.code(), Some(130));
        Ok(String::from_utf8(ended.stderr)?)
    };
    let world: Vec<String> = (0..COUNT).map(|n| format!("{{\"_id\": {n}}}")).collect();
    std::fs::write(folder.path().join("world.json"), format!("{{\"{ns}\": [{}]}}", world.join(",\n")))?;
    let said = run(&["restore", "world.json"], &|| Ok(count(doc! {})? > 0))?;
    let stored = count(doc! {})?;
    let wanted = format!("error: interrupted; {ns}: {stored} of its documents were stored, and the rest were not\n");
    assert_eq!(said, wanted);
    let documents = (0..i32::try_from(COUNT)?).map(|n| doc! { "_id": n });
    memory.drop_collection(&ns)?;
    memory.insert(&ns, documents.collect())?;
    let update = ["update", "worlds.interrupted", "{}", "{$set: {n: 1}}", "--many"];
    let said = run(&update, &|| Ok(count(doc! { "n": 1 })? > 0))?;
    let changed = count(doc! { "n": 1 })?;
    assert_eq!(said, format!("error: interrupted after {changed} documents; what was done stays\n"));
    memory.drop_collection(&ns)?;
    Ok(())
}

/// Several clients count at the same time, from before the counter is there.
fn counted(uri: &str) -> Result<(), Failed> {
    const CLIENTS: i32 = 4;
    const ROUNDS: i32 = 15;
    let ns = Namespace::parse("worlds.counters")?;
    memory(uri)?.drop_collection(&ns)?;
    let count = || -> Result<Vec<i32>, Failed> {
        let memory = memory(uri)?;
        let update = UpdateSpec::Document(doc! { "$inc": { "n": 1 } });
        let change = FindAndModify {
            filter: doc! { "_id": "n" },
            sort: doc! {},
            modification: Modification::Update { update, array_filters: Vec::new(), upsert: true },
            new: true,
            projection: doc! {},
            modifiers: Modifiers::default(),
        };
        let next = |_| {
            let after = memory.find_and_modify(&ns, &change)?.document.ok_or("nothing was changed")?;
            Ok(after.get_i32("n")?)
        };
        (0..ROUNDS).map(next).collect()
    };
    let numbers = std::thread::scope(|scope| -> Result<Vec<i32>, Failed> {
        let clients: Vec<_> = (0..CLIENTS).map(|_| scope.spawn(count)).collect();
        let mut numbers = Vec::new();
        for client in clients {
            numbers.extend(client.join().map_err(|_| "a client failed")??);
        }
        numbers.sort_unstable();
        Ok(numbers)
    })?;
    assert_eq!(numbers, (1..=CLIENTS * ROUNDS).collect::<Vec<_>>());
    Ok(())
}

fn memory(uri: &str) -> Result<Memory, Failed> {
    let uri = StoreUri::parse(uri)?;
    Ok(Memory::at(uri.clone(), uri, Vec::new()))
}

fn embedded() -> Result<Memory, Failed> {
    Ok(Memory::new(Box::new(Embedded::in_memory()?), None, Vec::new()))
}

/// Documents with values of many types.
fn documents() -> Vec<Document> {
    let mut documents: Vec<Document> = (0..2_500)
        .map(|n| doc! { "_id": (n * 7_919) % 2_500, "n": i64::from(n), "x": f64::from(n) / 3.0, "tags": ["a", { "b": n }] })
        .collect();
    documents.push(doc! { "_id": "text", "nothing": Bson::Null, "at": DateTime::from_millis(-5), "ä": "ö€𝄞\0" });
    documents.push(doc! { "_id": { "x": 1 }, "t": Bson::Timestamp(bson::Timestamp { time: 7, increment: 1 }) });
    documents
        .push(doc! { "_id": bson::oid::ObjectId::from_bytes([7; 12]), "d": Bson::Double(f64::NAN), "": { "": [] } });
    documents
}

/// How many differences there are between a memory and a dump.
fn differences(memory: Memory, path: &Path, ns: &Namespace) -> Result<u64, Failed> {
    let mut of_namespace = 0;
    compare(&Side::Memory(memory), &Side::Dump(Dump::open(path)?), &[], |found, _| {
        of_namespace += u64::from(found == ns);
        Ok::<_, DiffError>(())
    })?;
    Ok(of_namespace)
}

/// Dumps from one memory, restores into the other both ways, and compares.
fn carry(from: Memory, into: impl Fn() -> Result<Memory, Failed>, ns: &Namespace, gzip: bool) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("dump");
    from.drop_collection(ns)?;
    from.insert(ns, documents())?;
    let written = write::write_folder(&from, std::slice::from_ref(ns), &path, gzip)?;
    assert_eq!(written, [(ns.clone(), 2_503)]);
    let to = into()?;
    to.drop_collection(ns)?;
    let done = restore(&to, &Dump::open(&path)?, RestoreOptions::default())?;
    assert_eq!(
        (done.collections[0].inserted, done.collections[0].replaced, done.collections[0].skipped),
        (2_503, 0, 0)
    );
    let again = restore(&to, &Dump::open(&path)?, RestoreOptions::default())?;
    assert_eq!(
        (again.collections[0].inserted, again.collections[0].replaced, again.collections[0].skipped),
        (0, 0, 2_503)
    );
    to.delete(ns, &doc! { "_id": "text" }, true)?;
    to.insert(ns, vec![doc! { "_id": "other" }])?;
    let swapped = restore(&to, &Dump::open(&path)?, RestoreOptions { drop: true, ..RestoreOptions::default() })?;
    assert_eq!((swapped.collections[0].inserted, swapped.collections[0].dropped), (2_503, Some(2_503)));
    let kept = |memory: &Memory| -> Result<Vec<Vec<u8>>, Failed> {
        let found: Result<Vec<_>, _> = memory.find(ns, &Find::default())?.collect();
        Ok(found?.into_iter().map(|document| document.as_bytes().to_vec()).collect())
    };
    assert!(kept(&from)? == kept(&to)?, "the documents are not the same, or not in the same order");
    assert!(!to.collections()?.iter().any(|ns| ns.collection.contains("restoring_")));
    Ok(())
}

fn to_server(uri: &str) -> Result<(), Failed> {
    carry(embedded()?, || memory(uri), &Namespace::parse("worlds.to")?, false)
}

fn from_server(uri: &str) -> Result<(), Failed> {
    let ns = Namespace::parse("worlds.from")?;
    carry(memory(uri)?, embedded, &ns, true)?;
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("dump");
    let server = memory(uri)?;
    write::write_folder(&server, std::slice::from_ref(&ns), &path, false)?;
    assert_eq!(differences(memory(uri)?, &path, &ns)?, 0);
    server.delete(&ns, &doc! { "_id": { "$lt": 3 } }, false)?;
    assert_eq!(differences(server, &path, &ns)?, 3);
    Ok(())
}

/// A document twice in a dump is only noticed by the server, in the middle.
fn failed(uri: &str) -> Result<(), Failed> {
    let (server, ns) = (memory(uri)?, Namespace::parse("worlds.failed")?);
    server.drop_collection(&ns)?;
    server.insert(&ns, vec![doc! { "_id": "old" }])?;
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("worlds/failed.bson");
    std::fs::create_dir(folder.path().join("worlds"))?;
    let twice = [1, 2, 1].map(|id| bson::RawDocumentBuf::try_from(&doc! { "_id": id }).unwrap().into_bytes());
    std::fs::write(&file, twice.concat())?;
    assert!(restore(&server, &Dump::open(&file)?, RestoreOptions { drop: true, ..RestoreOptions::default() }).is_err());
    assert_eq!(server.distinct(&ns, "_id", &doc! {})?, ["old".into()]);
    assert!(!server.collections()?.iter().any(|ns| ns.collection.contains("restoring_")));
    Ok(())
}

fn mutex(name: &str, owner: &str) -> Result<Mutex, Failed> {
    Ok(Mutex { namespace: Namespace::parse("worlds.mutexes")?, name: name.to_owned(), owner: owner.to_owned() })
}

/// Several count in a document, reading and writing in two steps, under the lock.
fn contended(uri: &str) -> Result<(), Failed> {
    const ROBOTS: i32 = 6;
    const ROUNDS: i32 = 15;
    let ns = Namespace::parse("worlds.counter")?;
    let server = memory(uri)?;
    server.drop_collection(&ns)?;
    server.drop_collection(&Namespace::parse("worlds.mutexes")?)?;
    server.insert(&ns, vec![doc! { "_id": 1, "n": 0 }])?;
    let robot = |owner: String, ns: &Namespace| -> Result<(), Failed> {
        let (memory, mutex) = (memory(uri)?, mutex("counter", &owner)?);
        for _ in 0..ROUNDS {
            let tried = mutex.lock(&memory, Some(Duration::from_secs(60)), Duration::from_secs(60))?;
            assert!(matches!(tried, Tried::Done(_)), "{tried:?}");
            let n = match memory.distinct(ns, "n", &doc! {})?.as_slice() {
                [Bson::Int32(n)] => *n,
                other => panic!("{other:?}"),
            };
            let update = UpdateSpec::Document(doc! { "$set": { "n": n + 1 } });
            let filter = doc! { "_id": 1 };
            memory.update(ns, &UpdateRequest { filter, update, ..UpdateRequest::default() })?;
            assert!(matches!(mutex.unlock(&memory)?, Tried::Done(_)));
        }
        Ok(())
    };
    std::thread::scope(|scope| {
        let robots: Vec<_> = (0..ROBOTS)
            .map(|n| {
                scope.spawn({
                    let ns = &ns;
                    move || robot(format!("r{n}"), ns)
                })
            })
            .collect();
        robots.into_iter().try_for_each(|robot| robot.join().map_err(|_| Failed::from("a robot failed"))?)
    })?;
    assert_eq!(server.distinct(&ns, "n", &doc! {})?, [Bson::Int32(ROBOTS * ROUNDS)]);
    Ok(())
}

fn expiring(uri: &str) -> Result<(), Failed> {
    let server = memory(uri)?;
    let (one, other) = (mutex("expiring", "one")?, mutex("expiring", "other")?);
    assert!(matches!(one.try_lock(&server, Some(Duration::from_secs(3600)))?, Tried::Done(_)));
    match other.try_lock(&server, None)? {
        Tried::Held(holder) => assert!(holder.owner == "one" && holder.until > holder.since, "{holder}"),
        tried => return Err(format!("{tried:?}").into()),
    }
    one.try_lock(&server, Some(Duration::from_millis(1)))?;
    std::thread::sleep(Duration::from_millis(30));
    assert!(matches!(other.try_lock(&server, None)?, Tried::Done(_)));
    assert!(matches!(one.unlock(&server)?, Tried::Held(_)));
    Ok(())
}
