//! Messages that are none: a connection may end, the server never does.

use bson::{Bson, Document, doc};
use libtest_mimic::Failed;
use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};

use super::wire::{Wire, connected, message};
use super::{Case, Served};
use crate::processes::until;

pub(super) const CASES: &[(&str, Case)] = &[
    ("damaged_messages_cost_their_connection_and_nothing_else", damaged),
    ("clients_that_stop_half_way_cost_nothing_else", halves),
    ("commands_of_any_shape_are_answered", shapes),
    ("an_explanation_of_a_pipeline_that_writes_writes_nothing", explained),
    ("an_unconfirmed_write_is_done_and_not_counted", unconfirmed),
    ("what_a_command_says_beside_its_query_is_checked", checked),
    ("old_drivers_begin_and_tools_read_the_status", old),
    ("tools_read_whether_a_collection_is_sound_and_the_sizes_of_its_indexes", sound),
];

/// How many messages are damaged.
const MESSAGES: &str = "RMEM_TEST_SERVE_MESSAGES";

fn wanted() -> Result<u32, Failed> {
    Ok(std::env::var(MESSAGES).map_or(Ok(3000), |text| text.parse())?)
}

fn commands() -> Vec<Document> {
    let db = |mut command: Document| {
        command.insert("$db", "a");
        command
    };
    let lsid = doc! { "id": bson::Uuid::from_bytes([7; 16]) };
    [
        doc! { "hello": 1, "client": { "application": { "name": "x" } }, "compression": ["zlib"] },
        doc! { "insert": "c", "documents": [{ "a": 1, "b": { "c": [1, 2, { "d": "x" }] } }], "ordered": true },
        doc! { "find": "c", "filter": { "a": { "$gt": 0 } }, "sort": { "a": 1 }, "limit": 3, "batchSize": 1 },
        doc! { "aggregate": "c", "pipeline": [{ "$match": { "a": 1 } }, { "$group": { "_id": "$b" } }], "cursor": {} },
        doc! { "update": "c", "updates": [{ "q": {}, "u": { "$set": { "x": 1 } }, "multi": true }] },
        doc! { "delete": "c", "deletes": [{ "q": { "a": 1 }, "limit": 1 }] },
        doc! { "findAndModify": "c", "query": {}, "update": { "$inc": { "a": 1 } } },
        doc! { "createIndexes": "c", "indexes": [{ "key": { "a": 1 }, "name": "a_1" }] },
        doc! { "aggregate": "c", "pipeline": [{ "$changeStream": {} }], "cursor": {} },
        doc! { "getMore": 5_i64, "collection": "c" },
        doc! { "saslStart": 1, "mechanism": "SCRAM-SHA-256", "payload": "n,,n=a,r=b" },
        doc! { "insert": "c", "documents": [{ "a": 1 }], "lsid": lsid, "txnNumber": 1_i64 },
        doc! { "endSessions": [{ "id": bson::Uuid::from_bytes([7; 16]) }] },
        doc! { "listCollections": 1, "filter": { "name": "c" } },
    ]
    .map(db)
    .to_vec()
}

/// How many documents there are.
fn count(wire: &mut Wire, collection: &str) -> Result<i32, Failed> {
    Ok(wire.run(&doc! { "count": collection, "$db": "a" })?.get_i32("n")?)
}

fn explained() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut wire = Wire::connect(served.address())?;
    wire.run(&doc! { "insert": "c", "documents": [{ "_id": 1 }], "$db": "a" })?;
    for stage in [doc! { "$out": "d" }, doc! { "$merge": { "into": "d" } }] {
        let explain = doc! { "aggregate": "c", "pipeline": [stage], "cursor": {}, "explain": true, "$db": "a" };
        let reply = wire.run(&explain)?;
        assert!(reply.contains_key("stages") && !reply.contains_key("cursor"), "{reply}");
        assert_eq!(count(&mut wire, "d")?, 0);
    }
    Ok(())
}

fn old() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut wire = Wire::connect(served.address())?;
    for (command, code) in [
        (doc! { "isMaster": 1 }, None),
        (doc! { "buildinfo": 1 }, None),
        (doc! { "saslStart": 1, "mechanism": "PLAIN", "payload": "" }, Some(18)),
        (doc! { "listDatabases": 1 }, Some(352)),
    ] {
        let answer = wire.query(&command)?;
        assert_eq!(answer.get_i32("code").ok(), code, "{command}: {answer}");
    }
    let status = wire.run(&doc! { "serverStatus": 1, "$db": "admin" })?;
    assert!(matches!(status.get("uptime"), Some(Bson::Int64(_))), "{status}");
    let parameter = wire.run(&doc! { "getParameter": 1, "authSchemaVersion": 1, "$db": "admin" })?;
    assert_eq!(parameter.get_i32("authSchemaVersion")?, 5);
    Ok(())
}

fn sound() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut wire = Wire::connect(served.address())?;
    let documents: Vec<Document> = (0..100).map(|id| doc! { "_id": id, "name": ["a", "b"] }).collect();
    wire.run(&doc! { "insert": "c", "documents": documents, "$db": "a" })?;
    let indexes = vec![doc! { "key": { "name": 1 }, "name": "name_1" }];
    wire.run(&doc! { "createIndexes": "c", "indexes": indexes, "$db": "a" })?;
    let validated = wire.run(&doc! { "validate": "c", "full": true, "$db": "a" })?;
    assert_eq!((validated.get_bool("valid")?, validated.get_i32("nrecords")?), (true, 100), "{validated}");
    assert_eq!(validated.get_document("keysPerIndex")?, &doc! { "_id_": 100, "name_1": 200 });
    let none = wire.run(&doc! { "validate": "none", "$db": "a" })?;
    assert_eq!(none.get_i32("code")?, 26);
    let statistics = wire.run(&doc! { "collStats": "c", "$db": "a" })?;
    let sizes = statistics.get_document("indexSizes")?;
    let (id, name) = (sizes.get_i32("_id_")?, sizes.get_i32("name_1")?);
    assert!(id > 100 && name > id, "{sizes}");
    assert_eq!(statistics.get_i32("totalIndexSize")?, id + name);
    let whole = wire.run(&doc! { "dbStats": 1, "$db": "a" })?;
    assert_eq!(whole.get_f64("indexSize")?, f64::from(id + name));
    for (command, code) in [
        (doc! { "profile": -1 }, None),
        (doc! { "profile": 0 }, None),
        (doc! { "profile": 1 }, Some(115)),
        (doc! { "profile": "x" }, Some(14)),
        (doc! { "setParameter": 1, "logLevel": 1 }, Some(72)),
        (doc! { "setParameter": 1 }, Some(72)),
    ] {
        let database = if command.contains_key("profile") { "a" } else { "admin" };
        let answer = wire.run(&command.into_iter().chain([("$db".to_owned(), database.into())]).collect())?;
        assert_eq!(answer.get_i32("code").ok(), code, "{answer}");
        assert_eq!(answer.get_i32("was").ok(), Some(0).filter(|_| code.is_none()));
    }
    Ok(())
}

fn unconfirmed() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut wire = Wire::connect(served.address())?;
    for (concern, counted) in [(doc! { "w": 0 }, 0), (doc! { "w": 0, "j": true }, 1), (doc! { "w": 1 }, 1)] {
        let insert = doc! { "insert": "c", "documents": [{}], "writeConcern": concern, "$db": "a" };
        assert_eq!(wire.run(&insert)?.get_i32("n")?, counted);
    }
    assert_eq!(count(&mut wire, "c")?, 3);
    Ok(())
}

fn checked() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut wire = Wire::connect(served.address())?;
    let aggregate = |more: Document| {
        let mut command = doc! { "aggregate": 1, "pipeline": [{ "$currentOp": {} }], "cursor": {}, "$db": "admin" };
        command.extend(more);
        command
    };
    let options = |options: bson::Bson| aggregate(doc! { "pipeline": [{ "$currentOp": options }] });
    let cases = [
        (aggregate(doc! {}), 0),
        (aggregate(doc! { "allowDiskUse": 1 }), 14),
        (aggregate(doc! { "explain": bson::Bson::Null }), 14),
        (aggregate(doc! { "explain": true, "writeConcern": { "w": 1 } }), 9),
        (aggregate(doc! { "explain": true, "cursor": { "size": 1 } }), 40_415),
        (aggregate(doc! { "readConcern": { "level": "majority" } }), 72),
        (aggregate(doc! { "aggregate": "c" }), 73),
        (options(bson::bson!({ "allUsers": true, "localOps": false })), 0),
        (options(bson::bson!({ "allUsers": 1 })), 14),
        (options(bson::bson!({ "everything": true })), 9),
        (options(bson::bson!(1)), 14),
        (aggregate(doc! { "pipeline": [{ "$changeStream": { "showExpandedEvents": 1 } }], "$db": "a" }), 14),
        (doc! { "aggregate": "c", "pipeline": [{ "$changeStream": {} }], "cursor": {}, "$db": "local" }, 73),
        (
            doc! { "aggregate": "c", "pipeline": [{ "$collStats": { "latencyStats": { "x": 1 } } }], "cursor": {}, "$db": "a" },
            40_415,
        ),
        (doc! { "insert": "c", "documents": [{}], "writeConcern": { "w": { "rack": "x" } }, "$db": "a" }, 9),
        (doc! { "ping": 1, "apiVersion": "1", "apiStrict": true, "$db": "a" }, 0),
        (doc! { "ping": 1, "apiVersion": "2", "$db": "a" }, 322),
        (doc! { "ping": 1, "apiStrict": true, "$db": "a" }, 4_886_600),
        (doc! { "delete": "c", "deletes": [{ "q": {}, "limit": 0 }, { "q": {}, "limit": 2 }], "$db": "a" }, 9),
        (doc! { "dropIndexes": "c", "index": { "a": 1 }, "$db": "a" }, 181),
        (doc! { "ping": 1, "bogus": 1, "$db": "a" }, 40_415),
        (doc! { "endSessions": [], "bogus": 1, "$db": "a" }, 40_415),
        (doc! { "connectionStatus": 1, "bogus": 1, "$db": "a" }, 40_415),
        (doc! { "insert": "c", "documents": [{}], "let": {}, "$db": "a" }, 40_415),
        (doc! { "renameCollection": "a.c", "to": "a.d", "$db": "a" }, 13),
        (doc! { "renameCollection": "a.c", "to": "a.$d", "$db": "admin" }, 20),
        (doc! { "renameCollection": "a.c", "to": "a", "$db": "admin" }, 73),
        (
            doc! { "aggregate": "c", "pipeline": [{ "$changeStream": {} }, { "$out": "d" }], "cursor": {}, "$db": "a" },
            20,
        ),
        (doc! { "explain": { "mapReduce": "c", "map": "", "reduce": "", "out": "d" }, "$db": "a" }, 0),
    ];
    wire.run(&doc! { "createIndexes": "c", "indexes": [{ "key": { "a": 1 }, "name": "a_1" }], "$db": "a" })?;
    let index = |key: Document, more: Document| {
        let mut index = doc! { "key": key, "name": "new" };
        index.extend(more);
        doc! { "createIndexes": "c", "indexes": [index], "$db": "a" }
    };
    let with = |mut command: Document, name: &str, value: Bson| {
        command.insert(name, value);
        command
    };
    let plain = || index(doc! { "b": 1 }, doc! {});
    let twice = plain().get_array("indexes")?[0].clone();
    for (command, code) in [
        (index(doc! { "b": 1 }, doc! { "v": 3 }), 67),
        (index(doc! { "b": 1 }, doc! { "bogus": 1 }), 197),
        (index(doc! { "b": "foo" }, doc! {}), 67),
        (index(doc! { "b": 1 }, doc! { "name": "*" }), 2),
        (index(doc! { "b": 1 }, doc! { "name": "_id_" }), 2),
        (index(doc! { "_id": -1 }, doc! {}), 2),
        (index(doc! { "_id": 1 }, doc! { "unique": true }), 197),
        (index(doc! { "a": 1 }, doc! { "name": "a_1", "expireAfterSeconds": 9 }), 85),
        (index(doc! { "a": 1 }, doc! { "name": "a_1", "sparse": true }), 86),
        (with(plain(), "commitQuorum", 5.into()), 278),
        (with(plain(), "commitQuorum", (-1).into()), 9),
        (with(plain(), "commitQuorum", "far".into()), 79),
        (with(plain(), "indexes", vec![twice.clone(), twice].into()), 68),
        (with(index(doc! { "b": 1 }, doc! { "bogus": 1 }), "ignoreUnknownIndexOptions", true.into()), 0),
        (with(plain(), "commitQuorum", "majority".into()), 0),
    ] {
        assert_eq!(wire.run(&command)?.get_i32("code").unwrap_or(0), code, "{command}");
    }
    let modify = |index: Document| doc! { "collMod": "c", "index": index, "$db": "a" };
    let hidden = wire.run(&modify(doc! { "name": "a_1", "hidden": true }))?;
    assert_eq!((hidden.get_bool("hidden_old")?, hidden.get_bool("hidden_new")?), (false, true));
    let shown = wire.run(&modify(doc! { "keyPattern": { "a": 1 }, "hidden": false }))?;
    assert_eq!((shown.get_bool("hidden_old")?, shown.get_bool("hidden_new")?), (true, false));
    for (index, code) in [
        (doc! { "name": "b_1", "hidden": true }, 27),
        (doc! { "name": "_id_", "hidden": true }, 2),
        (doc! { "name": "a_1" }, 72),
        (doc! { "name": "a_1", "keyPattern": { "a": 1 }, "hidden": true }, 72),
        (doc! { "name": "a_1", "prepareUnique": true }, 115),
    ] {
        assert_eq!(wire.run(&modify(index.clone()))?.get_i32("code").unwrap_or(0), code, "{index}");
    }
    let other = doc! { "key": { "a": 1 }, "name": "other", "collation": { "locale": "en" } };
    wire.run(&doc! { "createIndexes": "c", "indexes": [other], "$db": "a" })?;
    wire.run(&doc! { "insert": "c", "documents": [{ "kept": true }], "$db": "a" })?;
    for (command, code) in cases {
        let reply = wire.run(&command)?;
        assert_eq!(reply.get_i32("code").unwrap_or(0), code, "{command}: {reply}");
    }
    // Where one statement is wrong, none was done.
    assert_eq!(count(&mut wire, "c")?, 1);
    Ok(())
}

#[derive(Debug, Clone)]
enum Damage {
    Byte(usize, u8),
    Cut(usize),
    Length(u32),
    Insert(usize, Vec<u8>),
}

fn damage() -> impl Strategy<Value = Damage> {
    prop_oneof![
        (any::<usize>(), any::<u8>()).prop_map(|(at, byte)| Damage::Byte(at, byte)),
        any::<usize>().prop_map(Damage::Cut),
        any::<u32>().prop_map(Damage::Length),
        (0..100_000_000_u32).prop_map(Damage::Length),
        (any::<usize>(), proptest::collection::vec(any::<u8>(), 1..9))
            .prop_map(|(at, bytes)| Damage::Insert(at, bytes)),
    ]
}

fn apply(mut bytes: Vec<u8>, damages: &[Damage]) -> Vec<u8> {
    for damage in damages {
        let length = bytes.len().max(1);
        match damage {
            Damage::Byte(at, byte) => bytes.iter_mut().skip(at % length).take(1).for_each(|old| *old = *byte),
            Damage::Cut(at) => bytes.truncate(at % length),
            Damage::Length(new) => bytes.iter_mut().zip(new.to_le_bytes()).for_each(|(old, new)| *old = new),
            Damage::Insert(at, more) => {
                let at = at % length;
                bytes.splice(at..at, more.iter().copied());
            }
        }
    }
    bytes
}

fn damaged() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let address = served.address().to_owned();
    let seeds: Vec<Vec<u8>> = commands().iter().map(message).collect();
    let config = Config { cases: wanted()?, failure_persistence: None, ..Config::default() };
    let inputs = (proptest::sample::select(seeds), proptest::collection::vec(damage(), 1..4));
    let ran = TestRunner::new(config).run(&inputs, |(seed, damages)| {
        let send = || -> Result<(), Failed> {
            let mut wire = Wire::connect(&address)?;
            // The server may close the connection before all is sent.
            let _ = wire.send(&apply(seed, &damages));
            wire.drain();
            Ok(())
        };
        send().map_err(|failed| TestCaseError::fail(format!("{:?}", failed.message())))
    });
    ran.map_err(|error| error.to_string())?;
    let answer = Wire::connect(&address)?.run(&doc! { "ping": 1, "$db": "a" })?;
    assert!(answer.get_f64("ok").is_ok_and(|ok| ok > 0.0));
    assert_eq!(served.terminate()?, Some(0));
    Ok(())
}

fn halves() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let whole = message(&commands()[1]);
    let mut waiting = Vec::new();
    for length in 0..whole.len().min(100) {
        let mut wire = Wire::connect(served.address())?;
        wire.send(&whole[..length])?;
        waiting.push(wire);
    }
    // A message that is announced to be large takes no memory before it comes.
    for _ in 0..50 {
        let mut wire = Wire::connect(served.address())?;
        wire.send(&[48_000_000_u32, 1, 0, 2013].map(u32::to_le_bytes).concat())?;
        waiting.push(wire);
    }
    let mut asking = Wire::connect(served.address())?;
    until("all clients are heard", || {
        let is_there = connected(&mut asking)? == i64::try_from(waiting.len())? + 1;
        Ok(is_there && unread(served.address())? == 0 && is_at_rest(served.child.id())?)
    })?;
    let status = std::fs::read_to_string(format!("/proc/{}/status", served.child.id())).unwrap_or_default();
    let resident = status.lines().find_map(|line| line.strip_prefix("VmRSS:")?.split_whitespace().next()?.parse().ok());
    assert!(resident.unwrap_or(0_u64) < 400_000, "{resident:?} kB");
    let answer = Wire::connect(served.address())?.run(&commands()[1])?;
    assert_eq!(answer.get_i32("n")?, 1);
    Ok(())
}

/// How many connections of a server have bytes that it has not read.
fn unread(address: &str) -> Result<usize, Failed> {
    let port: u16 = address.rsplit(':').next().ok_or("no port")?.parse()?;
    let table = std::fs::read_to_string("/proc/net/tcp")?;
    let is_unread = |line: &&str| {
        let fields: Vec<&str> = line.split_whitespace().collect();
        matches!(fields[..], [_, local, _, "01", queues, ..]
            if local.ends_with(&format!(":{port:04X}")) && !queues.ends_with(":00000000"))
    };
    Ok(table.lines().filter(is_unread).count())
}

/// Whether every thread of a process waits for something.
fn is_at_rest(process: u32) -> Result<bool, Failed> {
    for thread in std::fs::read_dir(format!("/proc/{process}/task"))? {
        let stat = std::fs::read_to_string(thread?.path().join("stat")).unwrap_or_default();
        if stat.rsplit_once(") ").is_some_and(|(_, rest)| !rest.starts_with('S')) {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Values of every kind in every place of a command.
fn shapes() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut wire = Wire::connect(served.address())?;
    let values: Vec<bson::Bson> = vec![
        bson::Bson::Null,
        true.into(),
        (-1).into(),
        i64::MAX.into(),
        i64::MIN.into(),
        f64::NAN.into(),
        1e300.into(),
        "".into(),
        "$a".into(),
        Document::new().into(),
        doc! { "$a": 1 }.into(),
        bson::Bson::Array(Vec::new()),
        bson::Bson::Array(vec![1.into(), doc! {}.into()]),
        bson::Bson::MinKey,
        bson::Timestamp { time: u32::MAX, increment: u32::MAX }.into(),
        bson::Bson::Undefined,
    ];
    for command in commands() {
        for name in command.keys().filter(|name| *name != "$db") {
            for value in &values {
                let mut changed = command.clone();
                changed.insert(name, value.clone());
                let answer = wire.run(&changed)?;
                assert!(answer.contains_key("ok"), "{changed}: {answer}");
                assert!(answer.get_i32("code").ok() != Some(1), "{changed}: {answer}");
            }
        }
    }
    Ok(())
}
