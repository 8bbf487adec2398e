//! Watches, and writers, that are killed: nothing is missed, and the order holds.

use std::collections::HashMap;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI32, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use bson::{Document, doc};
use libtest_mimic::{Failed, Trial};
use rmem::store::{Embedded, Namespace, Role, StoreUri, UpdateRequest, UpdateSpec, open};

use super::processes::Draws;

/// How often a watch is killed.
const KILLS: &str = "RMEM_TEST_WATCH_KILLS";
/// How long what has to come may take.
pub(crate) const TIMEOUT: Duration = Duration::from_secs(120);

/// What needs no server.
pub(crate) fn trials() -> Vec<Trial> {
    let by_hand = Trial::test("watching::benchmark::how_soon_a_change_is_delivered", latency).with_ignored_flag(true);
    vec![Trial::test("watching::a_killed_watch_of_a_file_misses_nothing", kill_watch_of_a_file), by_hand]
}

pub(crate) fn namespace(name: &str) -> Namespace {
    Namespace { database: "watching".to_owned(), collection: name.to_owned() }
}

/// An update that inserts where nothing matches.
pub(crate) fn update(filter: Document, update: UpdateSpec, many: bool) -> UpdateRequest {
    UpdateRequest { filter, update, many, upsert: true, ..UpdateRequest::default() }
}

/// A `rmem watch`, or another command that prints what happens.
pub(crate) struct Watching {
    child: Child,
    pub(crate) lines: Receiver<String>,
}

impl Watching {
    /// Starts it and waits until it is ready.
    pub(crate) fn start(uri: &str, ns: &Namespace, home: &Path) -> Result<Self, Failed> {
        Self::run(uri, home, &["watch", &ns.to_string(), "--resume", "x"], "watching ")
    }

    /// Starts a command that watches, and waits for its first message, which begins with `ready`.
    pub(crate) fn run(uri: &str, home: &Path, command: &[&str], ready: &str) -> Result<Self, Failed> {
        let mut child = Command::new(env!("CARGO_BIN_EXE_rmem"))
            .args(["--memory", uri])
            .args(command)
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
        if !printed.starts_with(ready) {
            child.kill()?;
            return Err(format!("it says {printed}").into());
        }
        // What it says later must not fill the pipe.
        std::thread::spawn(move || std::io::copy(&mut stderr, &mut std::io::sink()));
        Ok(Self { child, lines })
    }

    /// Kills it at once; gives what it had printed.
    pub(crate) fn kill(mut self) -> Result<Vec<String>, Failed> {
        self.child.kill()?;
        self.child.wait()?;
        Ok(self.lines.iter().collect())
    }
}

impl Drop for Watching {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// What was delivered of the writers' changes, checked as it comes.
///
/// Writer `w` changes its document to `n: 0, 1, 2, …`. Of each writer, every number
/// has to come, and none before the one below it came; a number may come again.
#[derive(Default)]
pub(crate) struct Received {
    last: HashMap<i32, i32>,
    pub(crate) again: usize,
}

impl Received {
    pub(crate) fn receive(&mut self, line: &str) -> Result<(), Failed> {
        // A line that was cut by the kill was not delivered.
        let Ok(event) = serde_json::from_str::<serde_json::Value>(line) else { return Ok(()) };
        let number = |value: &serde_json::Value| value.as_i64().and_then(|n| i32::try_from(n).ok());
        let (Some(writer), Some(n)) = (number(&event["after"]["_id"]), number(&event["after"]["n"])) else {
            return Err(format!("unexpected: {line}").into());
        };
        let last = self.last.entry(writer).or_insert(-1);
        if n > *last + 1 {
            return Err(format!("writer {writer}: {n} came after {last}").into());
        }
        if n == *last + 1 {
            *last = n;
            let before = number(&event["before"]["n"]).unwrap_or(-1);
            if event.get("before").is_some() && before != n - 1 {
                return Err(format!("writer {writer}: {n} came with {before} before it").into());
            }
        } else {
            self.again += 1;
        }
        Ok(())
    }

    pub(crate) fn receive_all(&mut self, lines: &[String]) -> Result<(), Failed> {
        lines.iter().try_for_each(|line| self.receive(line))
    }
}

const WRITERS: i32 = 2;

/// Writers in threads, each with a connection of its own; how far each is.
pub(crate) struct Writers {
    stop: Arc<AtomicBool>,
    threads: Vec<std::thread::JoinHandle<Result<(), String>>>,
    written: Vec<Arc<AtomicI32>>,
}

impl Writers {
    /// Where `retries`, a writer whose server is away tries again.
    pub(crate) fn start(uri: &str, ns: &Namespace, retries: bool) -> Result<Self, Failed> {
        let stop = Arc::new(AtomicBool::new(false));
        let mut writers = Self { stop: Arc::clone(&stop), threads: Vec::new(), written: Vec::new() };
        for writer in 0..WRITERS {
            let written = Arc::new(AtomicI32::new(0));
            writers.written.push(Arc::clone(&written));
            let (uri, ns, stop) = (StoreUri::parse(uri)?, ns.clone(), Arc::clone(&stop));
            writers.threads.push(std::thread::spawn(move || {
                let store = open(&uri, Role::Local).map_err(|error| error.to_string())?;
                while !stop.load(Ordering::Relaxed) {
                    let n = written.load(Ordering::Relaxed);
                    // The number is set, not added to, so that what was done twice changes nothing.
                    let spec = UpdateSpec::Document(doc! { "$set": { "n": n } });
                    match store.update(&ns, &update(doc! { "_id": writer }, spec, false), None) {
                        Ok(_) => written.store(n + 1, Ordering::Relaxed),
                        Err(_) if retries => std::thread::sleep(Duration::from_millis(20)),
                        Err(error) => return Err(error.to_string()),
                    }
                }
                Ok(())
            }));
        }
        Ok(writers)
    }

    /// Stops them; how many changes each made.
    pub(crate) fn stop(self) -> Result<Vec<i32>, Failed> {
        self.stop.store(true, Ordering::Relaxed);
        for thread in self.threads {
            thread.join().map_err(|_| "a writer panicked")??;
        }
        Ok(self.written.iter().map(|written| written.load(Ordering::Relaxed)).collect())
    }
}

/// A pause between two kills, different each time.
pub(crate) struct Pause(Draws);

impl Pause {
    pub(crate) fn new() -> Self {
        Self(Draws::new())
    }

    pub(crate) fn sleep(&mut self, most: u64) {
        std::thread::sleep(Duration::from_micros(self.0.draw() % most));
    }

    /// The test has not failed.
    pub(crate) fn end(self) {
        self.0.end();
    }
}

pub(crate) fn kills() -> usize {
    std::env::var(KILLS).ok().and_then(|text| text.parse().ok()).unwrap_or(12)
}

/// Takes what is still to come, until all of it is there.
pub(crate) fn drain(watching: Watching, received: &mut Received, written: &[i32]) -> Result<(), Failed> {
    let since = Instant::now();
    let all: HashMap<i32, i32> = (0..WRITERS).zip(written.iter().map(|count| count - 1)).collect();
    while received.last != all {
        if since.elapsed() > TIMEOUT {
            return Err(format!("{:?} of {all:?} came", received.last).into());
        }
        if let Ok(line) = watching.lines.recv_timeout(Duration::from_millis(100)) {
            received.receive(&line)?;
        }
    }
    received.receive_all(&watching.kill()?)
}

pub(crate) fn killed_watch(uri: &str, ns: &Namespace) -> Result<(), Failed> {
    let home = tempfile::tempdir()?;
    let (mut received, mut pause) = (Received::default(), Pause::new());
    // The name has to be there before the first change.
    Watching::start(uri, ns, home.path())?.kill()?;
    let writers = Writers::start(uri, ns, false)?;
    for _ in 0..kills() {
        let watching = Watching::start(uri, ns, home.path())?;
        pause.sleep(300_000);
        received.receive_all(&watching.kill()?)?;
    }
    let written = writers.stop()?;
    drain(Watching::start(uri, ns, home.path())?, &mut received, &written)?;
    pause.end();
    eprintln!("{ns}: {} changes, {} of them again", written.iter().sum::<i32>(), received.again);
    Ok(())
}

fn kill_watch_of_a_file() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("robot.rmem");
    drop(Embedded::open(&path)?);
    killed_watch(&format!("file:{}", path.display()), &namespace("killed"))
}

/// How long it takes from before a change until another process has printed it, and what a watch
/// costs while nothing happens: a benchmark, by hand.
fn latency() -> Result<(), Failed> {
    const CHANGES: usize = 1_000;
    const IDLE: Duration = Duration::from_secs(60);
    let folder = tempfile::tempdir()?;
    let (uri, ns) = (format!("file:{}", folder.path().join("robot.rmem").display()), namespace("latency"));
    let store = open(&StoreUri::parse(&uri)?, Role::Local)?;
    store.insert(&ns, vec![doc! {}])?;
    let watching = Watching::start(&uri, &ns, folder.path())?;
    let before = processor_time(watching.child.id())?;
    std::thread::sleep(IDLE);
    let idle = processor_time(watching.child.id())? - before;
    let mut pause = Pause::new();
    let mut written = Vec::new();
    let mut received = Vec::new();
    for n in 0..CHANGES {
        // Long enough that the watch sleeps again.
        std::thread::sleep(Duration::from_millis(5));
        pause.sleep(40_000);
        let start = Instant::now();
        store.insert(&ns, vec![doc! { "_id": i64::try_from(n)? }])?;
        written.push(start.elapsed());
        watching.lines.recv_timeout(TIMEOUT)?;
        received.push(start.elapsed());
    }
    pause.end();
    written.sort();
    received.sort();
    eprintln!(
        "{CHANGES} inserts: stored in {:?} (median), printed by a watch in {:?} (median), {:?} (99 %), {:?} (all)",
        written[CHANGES / 2],
        received[CHANGES / 2],
        received[CHANGES * 99 / 100],
        received[CHANGES - 1]
    );
    eprintln!("a watch of nothing used {} ms of a processor in {IDLE:?}", idle * 10);
    Ok(())
}

/// The processor time of a process, in hundredths of a second: two fields of its `stat`.
fn processor_time(process: u32) -> Result<u64, Failed> {
    let stat = std::fs::read_to_string(format!("/proc/{process}/stat"))?;
    let (_, fields) = stat.rsplit_once(") ").ok_or("no fields")?;
    Ok(fields.split(' ').skip(11).take(2).filter_map(|field| field.parse::<u64>().ok()).sum())
}
