//! What needs a MongoDB server, and what needs one that is not there.

use std::io::{Read as _, Write as _};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use bson::doc;
use libtest_mimic::{Failed, Trial};
use rmem::store::{Find, Namespace, Role, StoreError, StoreUri, open};

use crate::computables;
use crate::contract;
use crate::history;
use crate::mongod::{Mongod, free_port};
use crate::places;
use crate::planning;
use crate::scenes::watched;
use crate::{mixtures, triggers, views, worlds};

/// The one server of this run, started by the first test that needs it.
static SERVER: Mutex<Option<Mongod>> = Mutex::new(None);

const PREFIX: &str = "contract::mongodb";
const COMPUTABLES: &str = "computables::mongodb";
const DECIDING: &str = "computables::benchmark::deciding_what_a_query_needs";
const ANOTHER: &str = "mongodb::a_replica_set_of_another_name_is_not_taken_for_a_silent_server";
const LOST: &str = "mongodb::an_operation_on_a_server_that_falls_silent_ends";

/// The names of the tests that need a server.
pub(crate) fn names() -> Vec<String> {
    let mut names = contract::names(PREFIX);
    names.extend(cases().map(|(name, _)| name.to_owned()));
    names.extend(killers().map(|(name, _)| name.to_owned()));
    names.extend(computables::names(COMPUTABLES));
    names.extend([ANOTHER, LOST, DECIDING, watched::LATENCY].map(str::to_owned));
    names
}

type Case = fn(&str) -> Result<(), Failed>;

/// What is tried on the one server, by its address.
fn cases() -> impl Iterator<Item = (&'static str, Case)> {
    let cases = worlds::CASES
        .iter()
        .chain(triggers::CASES)
        .chain(triggers::OF_MONGOD)
        .chain(&places::CASES)
        .chain(&mixtures::CASES)
        .chain(&watched::CASES)
        .chain(&views::CASES);
    #[cfg(feature = "serve")]
    let cases = cases
        .chain(crate::serving::IN_FRONT)
        .chain(crate::serving::STREAMS_IN_FRONT)
        .chain(crate::serving::BESIDE.into_iter().flatten());
    cases.chain(planning::CASES).chain(&history::CASES).copied()
}

type Killer = fn(&Path) -> Result<(), Failed>;

/// What is tried on servers of its own, which are killed.
fn killers() -> impl Iterator<Item = (&'static str, Killer)> {
    let killers = triggers::KILLERS.iter();
    #[cfg(feature = "serve")]
    let killers =
        killers.chain(crate::serving::KILLERS).chain(crate::serving::OUTAGES).chain(crate::serving::STREAM_KILLERS);
    killers.copied()
}

/// The tests; those that need a server are ignored where there is no program.
pub(crate) fn trials(program: Option<PathBuf>) -> Vec<Trial> {
    let missing = program.is_none();
    let server = program.clone();
    let another = Trial::test(ANOTHER, move || another_set(server.as_deref()));
    let server = program.clone();
    let lost = Trial::test(LOST, move || lost(server.as_deref())).with_ignored_flag(missing);
    let cases = cases().map(|(name, case)| {
        let program = program.clone();
        Trial::test(name, move || case(&uri(program.as_deref().ok_or("there is no mongod")?)?))
    });
    let killers = killers().map(|(name, killer)| {
        let program = program.clone();
        Trial::test(name, move || killer(program.as_deref().ok_or("there is no mongod")?))
    });
    let mut trials: Vec<_> = cases.chain(killers).collect();
    let (server, other, third) = (program.clone(), program.clone(), program.clone());
    trials.extend(computables::trials(COMPUTABLES, true, move || {
        Ok(computables::Place { uri: uri(server.as_deref().ok_or("there is no mongod")?)?, folder: None })
    }));
    trials.extend(contract::trials(PREFIX, move || match &program {
        Some(program) => connect(program),
        None => Err("there is no mongod".into()),
    }));
    let mut trials: Vec<_> = trials.into_iter().map(|trial| trial.with_ignored_flag(missing)).collect();
    let deciding = move || computables::deciding(&uri(other.as_deref().ok_or("there is no mongod")?)?);
    trials.push(Trial::test(DECIDING, deciding).with_ignored_flag(true));
    let latency = move || watched::latency(&uri(third.as_deref().ok_or("there is no mongod")?)?);
    trials.push(Trial::test(watched::LATENCY, latency).with_ignored_flag(true));
    trials.push(lost);
    trials.push(another.with_ignored_flag(missing));
    trials.push(Trial::test("mongodb::an_unreachable_server_is_named_within_seconds", unreachable));
    trials.push(Trial::test("mongodb::a_server_that_does_not_answer_is_named_within_seconds", silent));
    trials
}

fn connect(program: &Path) -> Result<contract::Subject, Failed> {
    let store = open(&StoreUri::parse(&uri(program)?)?, Role::Shared)?;
    Ok(contract::Subject { store, folder: None })
}

/// The address of the server.
fn uri(program: &Path) -> Result<String, Failed> {
    let mut server = SERVER.lock().unwrap_or_else(PoisonError::into_inner);
    if server.is_none() {
        *server = Some(Mongod::start(program)?);
    }
    Ok(server.as_ref().map(|server| server.uri.clone()).unwrap_or_default())
}

fn another_set(program: Option<&Path>) -> Result<(), Failed> {
    let Some(program) = program else { return Err("there is no mongod".into()) };
    drop(connect(program)?);
    let uri = SERVER.lock().unwrap_or_else(PoisonError::into_inner).as_ref().map(|server| server.uri.clone());
    let wrong = uri.unwrap_or_default().replace("replicaSet=test", "replicaSet=wrong");
    let store = open(&StoreUri::parse(&wrong)?, Role::Local)?;
    let ns = Namespace::parse("robmem.blocks")?;
    let error = store.count(&ns, (&doc! {}).into()).err().ok_or("it answered")?.to_string();
    assert!(error.contains("its replica set has another name"), "{error}");
    let find = Find { skip: 1 << 63, ..Find::default() };
    let error = connect(program)?.store.find(&ns, &find).err().ok_or("it answered")?.to_string();
    assert_eq!(error, "skip may be at most 9223372036854775807");
    Ok(())
}

/// A server that is lost while it works on an operation.
fn lost(program: Option<&Path>) -> Result<(), Failed> {
    let Some(program) = program else { return Err("there is no mongod".into()) };
    drop(connect(program)?);
    let uri = SERVER.lock().unwrap_or_else(PoisonError::into_inner).as_ref().map(|server| server.uri.clone());
    let uri = uri.unwrap_or_default();
    let server = uri.trim_start_matches("mongodb://").split('/').next().unwrap_or_default().to_owned();
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
    let port = listener.local_addr()?.port();
    let silent = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&silent);
    std::thread::spawn(move || {
        for client in listener.incoming().flatten() {
            let Ok(server) = TcpStream::connect(&server) else { return };
            let (Ok(from), Ok(to)) = (client.try_clone(), server.try_clone()) else { return };
            let (there, back) = (Arc::clone(&flag), Arc::clone(&flag));
            std::thread::spawn(move || pass(from, to, &there));
            std::thread::spawn(move || pass(server, client, &back));
        }
    });
    let store = open(&StoreUri::parse(&format!("mongodb://127.0.0.1:{port}/?directConnection=true"))?, Role::Local)?;
    let ns = Namespace::parse("robmem.blocks")?;
    store.count(&ns, (&doc! {}).into())?;
    silent.store(true, Ordering::SeqCst);
    let since = Instant::now();
    let error = store.count(&ns, (&doc! {}).into()).err().ok_or("it answered")?;
    assert!(since.elapsed() < Duration::from_secs(20), "took {:?}", since.elapsed());
    assert!(matches!(error, StoreError::Unreachable { .. }), "{error:?}");
    Ok(())
}

/// Passes bytes on until it is to be silent; then it reads them and says nothing.
fn pass(mut from: TcpStream, mut to: TcpStream, silent: &AtomicBool) {
    let mut bytes = [0; 4096];
    while let Ok(count @ 1..) = from.read(&mut bytes) {
        if !silent.load(Ordering::SeqCst) && to.write_all(&bytes[..count]).is_err() {
            return;
        }
    }
}

/// Stops the server, where one was started.
pub(crate) fn stop() {
    drop(SERVER.lock().unwrap_or_else(PoisonError::into_inner).take());
}

fn unreachable() -> Result<(), Failed> {
    fails_soon(free_port()?)
}

fn silent() -> Result<(), Failed> {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
    fails_soon(listener.local_addr()?.port())
}

/// Every operation fails, in much less time than the driver's own 30 s, and
/// says where the server was looked for but not which process asked.
fn fails_soon(port: u16) -> Result<(), Failed> {
    let uri = StoreUri::parse(&format!("mongodb://robot:secret@127.0.0.1:{port}/?replicaSet=shared"))?;
    let store = open(&uri, Role::Shared)?;
    let ns = Namespace::parse("robmem.blocks")?;
    let since = Instant::now();
    let error = match store.find(&ns, &Find::default()) {
        Ok(_) => return Err("it answered".into()),
        Err(error) => error,
    };
    assert!(since.elapsed() < Duration::from_secs(10), "took {:?}", since.elapsed());
    assert!(matches!(error, StoreError::Unreachable { .. }), "{error:?}");
    assert!(error.to_string().starts_with(&format!("cannot reach mongodb://127.0.0.1:{port}: ")), "{error}");
    assert!(!format!("{error} {error:?} {}", store.describe()).contains("secret"), "{error:?}");
    assert!(store.insert(&ns, vec![doc! {}]).is_err());
    Ok(())
}
