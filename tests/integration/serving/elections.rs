//! `rmem serve` in front of a replica set that elects another primary while clients write.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use bson::{Document, doc};
use libtest_mimic::Failed;
use mongodb::options::{ReadConcern, WriteConcern};
use mongodb::sync::{Client, Database};

use super::Served;
use super::front_streams::Follower;
use crate::mongod::{Mongod, admin};
use crate::processes::until;

type Killer = fn(&Path) -> Result<(), Failed>;

/// What is tried with servers of its own.
pub(crate) const KILLERS: &[(&str, Killer)] =
    &[("serving::in_front_of_mongod::what_is_acknowledged_outlasts_elections_and_is_done_once", elections)];

/// So many clients write.
const CLIENTS: i32 = 4;
/// So many writes are acknowledged before, between and behind elections.
const WRITES: u64 = 60;

/// What a client was told of its writes.
#[derive(Default)]
struct Told {
    inserted: BTreeSet<String>,
    /// How often its counter was raised, as it was told …
    raised: i64,
    /// … and how often it may have been.
    unknown: i64,
}

/// Inserts documents and raises a counter until it is time to stop. What fails may have been done, but not more than once.
fn write(database: &Database, client: i32, acknowledged: &AtomicU64, stop: &AtomicBool) -> Told {
    let mut told = Told::default();
    let (things, counters) = (database.collection("things"), database.collection::<Document>("counters"));
    for nth in 0.. {
        if stop.load(Ordering::SeqCst) {
            break;
        }
        let id = format!("{client}-{nth}");
        if things.insert_one(doc! { "_id": &id }).run().is_ok() {
            told.inserted.insert(id);
            acknowledged.fetch_add(1, Ordering::SeqCst);
        }
        let raise = doc! { "$inc": { "n": 1 } };
        match counters.update_one(doc! { "_id": client }, raise).upsert(true).run() {
            Ok(_) => told.raised += 1,
            Err(_) => told.unknown += 1,
        }
    }
    told
}

/// The place of the member that is the primary.
fn primary(members: &[Mongod]) -> Result<usize, Failed> {
    let is_primary = |member: &Mongod| -> Result<bool, Failed> {
        let hello = admin(member.port)?.run_command(doc! { "hello": 1 }).run()?;
        Ok(hello.get_bool("isWritablePrimary")?)
    };
    let all = members.iter().map(is_primary).collect::<Result<Vec<_>, _>>()?;
    Ok(all.iter().position(|is_primary| *is_primary).ok_or("there is no primary")?)
}

fn elections(program: &Path) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let (mut members, uri) = Mongod::members(program)?;
    let served = Served::start_memory(folder.path(), &uri, &["--listen", "127.0.0.1:0"])?;
    let (acknowledged, stop) = (AtomicU64::new(0), AtomicBool::new(false));
    let follower = Follower::open(served.address(), "elections", Some("things"), doc! {}, &[])?;
    let (told, heard) = std::thread::scope(|scope| -> Result<(Vec<Told>, Vec<String>), Failed> {
        let follower = scope.spawn(|| follower.inserted(&stop, "the last"));
        let majority = WriteConcern::builder().w(mongodb::options::Acknowledgment::Majority).build();
        let options = mongodb::options::DatabaseOptions::builder().write_concern(majority).build();
        let mut clients = Vec::new();
        for client in 0..CLIENTS {
            let database = served.client()?.database_with_options("elections", options.clone());
            let (acknowledged, stop) = (&acknowledged, &stop);
            clients.push(scope.spawn(move || write(&database, client, acknowledged, stop)));
        }
        let more = || {
            let enough = acknowledged.load(Ordering::SeqCst) + WRITES;
            until("more is acknowledged", || Ok(acknowledged.load(Ordering::SeqCst) >= enough))
        };
        let mut elect = || -> Result<(), Failed> {
            more()?;
            let step_down = doc! { "replSetStepDown": 60, "secondaryCatchUpPeriodSecs": 30 };
            let first = primary(&members)?;
            admin(members[first].port)?.run_command(step_down).run()?;
            more()?;
            let second = primary(&members)?;
            if second == first {
                return Err("no other member was elected".into());
            }
            members[second].kill()?;
            more()
        };
        let tried = elect();
        stop.store(true, Ordering::SeqCst);
        let told = clients.into_iter().map(|client| client.join().map_err(|_| Failed::from("a client panicked")));
        let told = told.collect::<Result<Vec<_>, _>>()?;
        let database = served.client()?.database_with_options("elections", options);
        let last = database.collection::<Document>("things").insert_one(doc! { "_id": "the last" }).run();
        let heard = follower.join().map_err(|_| Failed::from("the follower panicked"))?;
        tried?;
        last?;
        Ok((told, heard?))
    })?;
    let behind = Client::with_uri_str(&uri)?.database("elections");
    let found = behind.collection::<Document>("things").find(doc! {}).read_concern(ReadConcern::majority()).run()?;
    let stored = found.map(|found| Ok(found?.get_str("_id")?.to_owned())).collect::<Result<BTreeSet<_>, Failed>>()?;
    // The stream reported each stored document once, and its client did not open it again.
    assert_eq!(heard.len(), stored.len(), "{:?}", stored.difference(&heard.iter().cloned().collect()));
    assert_eq!(heard.into_iter().collect::<BTreeSet<_>>(), stored);
    for (client, told) in (0..).zip(&told) {
        let lost: Vec<_> = told.inserted.difference(&stored).collect();
        assert!(lost.is_empty(), "{lost:?} were acknowledged");
        let counter = behind.collection::<Document>("counters").find_one(doc! { "_id": client }).run()?;
        let raised = i64::from(counter.ok_or("no counter")?.get_i32("n")?);
        let may_be = told.raised..=told.raised + told.unknown;
        assert!(may_be.contains(&raised), "client {client} raised its counter {raised} times, and was told {may_be:?}");
    }
    Ok(())
}
