//! `scene watch` on both stores: nothing is missed after kills, and how soon an operation is printed.

use std::collections::BTreeSet;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use bson::{Document, doc};
use libtest_mimic::{Failed, Trial};
use rmem::store::{Namespace, Role, Store, StoreUri, UpdateSpec, open};
use serde_json::Value;

use crate::watching::{Pause, TIMEOUT, kills, update};

type Case = fn(&str) -> Result<(), Failed>;

/// What is tried on a server.
pub(crate) const CASES: [(&str, Case); 2] = [
    ("scenes::a_frame_of_mongod_that_moves_moves_every_object_in_it", moved_frame),
    ("scenes::a_killed_scene_watch_of_mongod_misses_nothing", killed),
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
        self.store.delete(&self.objects, &filter, false)?;
        Ok(())
    }
}

/// A `scene watch` beside the test.
struct Watched {
    child: Child,
    lines: Receiver<String>,
}

impl Watched {
    /// Starts it and waits until it follows.
    fn start(uri: &str, objects: &Namespace, home: &Path, more: &[&str]) -> Result<Self, Failed> {
        let mut child = Command::new(env!("CARGO_BIN_EXE_rmem"))
            .args(["--memory", uri, "scene", "watch", &objects.to_string(), "--frame", "map"])
            .args(more)
            .current_dir(home)
            .env("HOME", home)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()?;
        let (sender, lines) = channel();
        let stdout = BufReader::new(child.stdout.take().ok_or("no stdout")?);
        std::thread::spawn(move || stdout.lines().map_while(Result::ok).try_for_each(|line| sender.send(line)));
        let mut stderr = BufReader::new(child.stderr.take().ok_or("no stderr")?);
        let mut printed = String::new();
        stderr.read_line(&mut printed)?;
        if !printed.starts_with("following ") {
            child.kill()?;
            return Err(format!("it says {printed}").into());
        }
        // What it says later must not fill the pipe.
        std::thread::spawn(move || std::io::copy(&mut stderr, &mut std::io::sink()));
        Ok(Self { child, lines })
    }

    fn next(&self) -> Result<Value, Failed> {
        Ok(serde_json::from_str(&self.lines.recv_timeout(TIMEOUT)?)?)
    }

    /// Kills it at once; gives the whole lines that it had printed.
    fn kill(mut self) -> Result<Vec<Value>, Failed> {
        self.child.kill()?;
        self.child.wait()?;
        // A line that was cut is delivered again.
        Ok(self.lines.iter().filter_map(|line| serde_json::from_str(&line).ok()).collect())
    }
}

impl Drop for Watched {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
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
    let watched = Watched::start(uri, &world.objects, home.path(), &[])?;
    world.place(&world.frames, "table", 2.0)?;
    let mut moved = [watched.next()?, watched.next()?];
    moved.sort_by_key(words);
    for (operation, name) in moved.iter().zip(["cup", "plate"]) {
        assert_eq!(words(operation), named("move", name));
        let x = operation["translation"][0].as_f64().unwrap_or_default();
        assert!((x - 2.1).abs() < 1e-12, "{operation}");
    }
    world.remove("cup")?;
    assert_eq!(words(&watched.next()?), named("remove", "cup"));
    Ok(())
}

/// Kills the watch at some moment of each round; every operation of every round has to have come.
fn killed(uri: &str) -> Result<(), Failed> {
    let (world, home, mut pause) = (World::new(uri, "scene_killed")?, tempfile::tempdir()?, Pause::new());
    let start = || Watched::start(uri, &world.objects, home.path(), &["--resume", "planner"]);
    // The name has to be there before the first change.
    start()?.kill()?;
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
            came.extend(watched.kill()?.iter().map(words));
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
    Ok(())
}

/// How long it takes from before a change until the operation is printed by another process.
pub(crate) fn latency(uri: &str) -> Result<(), Failed> {
    const CHANGES: usize = 300;
    let (world, home, mut pause) = (World::new(uri, "scene_latency")?, tempfile::tempdir()?, Pause::new());
    let watched = Watched::start(uri, &world.objects, home.path(), &[])?;
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
    Ok(())
}
