//! `scene watch` on both stores: nothing is missed after kills, and how soon an operation is printed.

use std::collections::BTreeSet;
use std::path::Path;
use std::time::{Duration, Instant};

use bson::{Document, doc};
use libtest_mimic::{Failed, Trial};
use rmem::store::{Namespace, Role, Store, StoreUri, UpdateSpec, open};
use serde_json::Value;

use crate::watching::{Pause, TIMEOUT, Watching, kills, update};

type Case = fn(&str) -> Result<(), Failed>;

/// What is tried on a server.
pub(crate) const CASES: [(&str, Case); 3] = [
    ("scenes::a_frame_of_mongod_that_moves_moves_every_object_in_it", moved_frame),
    ("scenes::a_killed_scene_watch_of_mongod_misses_nothing", killed),
    ("scenes::what_mongod_dropped_while_nobody_watched_is_removed", dropped),
];

/// How soon an operation is printed, on a server: a benchmark, by hand.
pub(crate) const LATENCY: &str = "scenes::benchmark::how_soon_an_operation_is_printed_from_mongod";

/// What needs no server.
pub(super) fn trials() -> Vec<Trial> {
    let of_file = |case: Case| {
        move || {
            let folder = tempfile::tempdir()?;
            case(&format!("file:{}", folder.path().join("robot.rmem").display()))
        }
    };
    let by_hand = Trial::test("scenes::benchmark::how_soon_an_operation_is_printed_from_a_file", of_file(latency));
    vec![
        Trial::test("scenes::a_killed_scene_watch_of_a_file_misses_nothing", of_file(killed)),
        Trial::test("scenes::what_was_dropped_while_nobody_watched_is_removed_in_a_file", of_file(dropped)),
        by_hand.with_ignored_flag(true),
    ]
}

/// A world of one frame in `map` and objects in it.
struct World {
    store: Box<dyn Store>,
    frames: Namespace,
    objects: Namespace,
}

impl World {
    /// In a database of its own.
    fn new(uri: &str, database: &str) -> Result<Self, Failed> {
        let namespace =
            |collection: &str| Namespace { database: database.to_owned(), collection: collection.to_owned() };
        let store = open(&StoreUri::parse(uri)?, Role::Local)?;
        let world = Self { store, frames: namespace("frames"), objects: namespace("objects") };
        let table = doc! { "_id": "table", "frame": "table", "parent": "map", "translation": [0.0, 0.0, 0.0], "rotation": [0.0, 0.0, 0.0, 1.0] };
        world.store.insert(&world.frames, vec![table])?;
        world.add(&["cup", "plate"])?;
        Ok(world)
    }

    fn add(&self, names: &[&str]) -> Result<(), Failed> {
        let object = |name: &&str| doc! { "_id": *name, "name": *name, "frame": "table", "translation": [0.1, 0.0, 0.0], "rotation": [0.0, 0.0, 0.0, 1.0] };
        self.store.insert(&self.objects, names.iter().map(object).collect())?;
        Ok(())
    }

    /// Moves the frame or an object along x.
    fn place(&self, namespace: &Namespace, id: &str, x: f64) -> Result<(), Failed> {
        let change = UpdateSpec::Document(doc! { "$set": { "translation.0": x } });
        self.store.update(namespace, &update(doc! { "_id": id }, change, false), None)?;
        Ok(())
    }

    fn remove(&self, id: &str) -> Result<(), Failed> {
        let filter: Document = doc! { "_id": id };
        self.store.delete(&self.objects, (&filter).into(), false)?;
        Ok(())
    }
}

/// Starts a `scene watch` and waits until it follows.
fn follow(uri: &str, objects: &Namespace, home: &Path, more: &[&str]) -> Result<Watching, Failed> {
    let objects = objects.to_string();
    let command = [&["scene", "watch", &objects, "--frame", "map"], more].concat();
    Watching::run(uri, home, &command, "following ")
}

fn next(watching: &Watching) -> Result<Value, Failed> {
    Ok(serde_json::from_str(&watching.lines.recv_timeout(TIMEOUT)?)?)
}

/// Kills it at once; gives the whole lines that it had printed.
fn kill(watching: Watching) -> Result<Vec<Value>, Failed> {
    // A line that was cut is delivered again.
    Ok(watching.kill()?.iter().filter_map(|line| serde_json::from_str(line).ok()).collect())
}

fn words(operation: &Value) -> (String, String) {
    let word = |key: &str| operation[key].as_str().unwrap_or_default().to_owned();
    (word("operation"), word("name"))
}

fn named(operation: &str, name: &str) -> (String, String) {
    (operation.to_owned(), name.to_owned())
}

fn moved_frame(uri: &str) -> Result<(), Failed> {
    let (world, home) = (World::new(uri, "scene_moved")?, tempfile::tempdir()?);
    let watched = follow(uri, &world.objects, home.path(), &[])?;
    world.place(&world.frames, "table", 2.0)?;
    let mut moved = [next(&watched)?, next(&watched)?];
    moved.sort_by_key(words);
    for (operation, name) in moved.iter().zip(["cup", "plate"]) {
        assert_eq!(words(operation), named("move", name));
        let x = operation["translation"][0].as_f64().unwrap_or_default();
        assert!((x - 2.1).abs() < 1e-12, "{operation}");
    }
    world.remove("cup")?;
    assert_eq!(words(&next(&watched)?), named("remove", "cup"));
    Ok(())
}

/// Kills the watch at some moment of each round; every operation of every round has to have come.
fn killed(uri: &str) -> Result<(), Failed> {
    let (world, home, mut pause) = (World::new(uri, "scene_killed")?, tempfile::tempdir()?, Pause::new());
    let start = || follow(uri, &world.objects, home.path(), &["--resume", "planner"]);
    // The name has to be there before the first change.
    kill(start()?)?;
    let rounds = kills();
    let (mut expected, mut came): (BTreeSet<_>, BTreeSet<_>) = (BTreeSet::new(), BTreeSet::new());
    for round in 0..rounds {
        let (ball, x) = (format!("ball-{round}"), round as f64 + 1.0);
        let watched = if round % 2 == 0 { Some(start()?) } else { None };
        world.add(&[&ball])?;
        world.place(&world.objects, "cup", x)?;
        world.place(&world.frames, "table", x)?;
        if round % 3 == 0 {
            world.remove(&ball)?;
            expected.insert(named("remove", &ball));
        }
        expected.extend([named("add", &ball), named("move", "cup"), named("move", "plate")]);
        pause.sleep(100_000);
        if let Some(watched) = watched {
            came.extend(kill(watched)?.iter().map(words));
        }
    }
    let watched = start()?;
    let since = Instant::now();
    // The last pose of all is that of the last round.
    let (end, mut last) = (rounds as f64 + 0.1, 0.0);
    while !(expected.is_subset(&came) && (last - end).abs() < 1e-9) {
        if since.elapsed() > TIMEOUT {
            return Err(format!("missed: {:?}, {last} for {end}", expected.difference(&came)).into());
        }
        let Ok(line) = watched.lines.recv_timeout(Duration::from_millis(100)) else { continue };
        let operation: Value = serde_json::from_str(&line)?;
        if words(&operation) == named("move", "plate") {
            last = operation["translation"][0].as_f64().unwrap_or_default();
        }
        came.insert(words(&operation));
    }
    pause.end();
    Ok(())
}

/// Collections that are dropped while no watch runs: every object in them is removed by the next.
fn dropped(uri: &str) -> Result<(), Failed> {
    let (world, home) = (World::new(uri, "scene_dropped")?, tempfile::tempdir()?);
    for namespace in [&world.objects, &world.frames] {
        kill(follow(uri, &world.objects, home.path(), &["--resume", "planner"])?)?;
        Store::drop(&*world.store, namespace)?;
        let watched = follow(uri, &world.objects, home.path(), &["--resume", "planner"])?;
        let mut gone = [words(&next(&watched)?), words(&next(&watched)?)];
        gone.sort();
        assert_eq!(gone, [named("remove", "cup"), named("remove", "plate")]);
        if *namespace == world.objects {
            world.add(&["cup", "plate"])?;
            let mut back = [words(&next(&watched)?), words(&next(&watched)?)];
            back.sort();
            assert_eq!(back, [named("add", "cup"), named("add", "plate")]);
        }
        kill(watched)?;
    }
    Ok(())
}

/// How long it takes from before a change until the operation is printed by another process.
pub(crate) fn latency(uri: &str) -> Result<(), Failed> {
    const CHANGES: usize = 300;
    let (world, home, mut pause) = (World::new(uri, "scene_latency")?, tempfile::tempdir()?, Pause::new());
    let watched = follow(uri, &world.objects, home.path(), &[])?;
    for (what, namespace, id, lines) in [("object", &world.objects, "cup", 1), ("frame", &world.frames, "table", 2)] {
        let mut times = Vec::new();
        for nth in 0..CHANGES {
            std::thread::sleep(Duration::from_millis(5));
            pause.sleep(40_000);
            let start = Instant::now();
            world.place(namespace, id, nth as f64 + 1.0)?;
            for _ in 0..lines {
                watched.lines.recv_timeout(TIMEOUT)?;
            }
            times.push(start.elapsed());
        }
        times.sort();
        eprintln!(
            "{what} moved {CHANGES} times: printed after {:?} (median), {:?} (99 %), {:?} (all)",
            times[CHANGES / 2],
            times[CHANGES * 99 / 100],
            times[CHANGES - 1]
        );
    }
    pause.end();
    Ok(())
}
