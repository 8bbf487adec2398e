//! Several processes on one memory, and processes that are killed in the middle.
//!
//! The other processes are this program again, with their task in [`ROLE`].

use std::ffi::OsString;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Child, Command, ExitCode, Stdio};
use std::time::{Duration, Instant};

use bson::doc;
use libtest_mimic::{Failed, Trial};
use rmem::store::{Embedded, Find, Namespace, Store as _, UpdateRequest, UpdateSpec};

/// What a child process does: `ROLE PATH NAME COUNT`, separated by line feeds.
const ROLE: &str = "RMEM_TEST_ROLE";
/// How many writers are killed; more by hand than in every run.
pub(crate) const KILLS: &str = "RMEM_TEST_KILLS";
/// Another seed than that of every run.
const SEED: &str = "RMEM_TEST_SEED";
/// How long what has to come may take.
const TIMEOUT: Duration = Duration::from_secs(180);
/// How many documents each of the concurrent writers stores.
const WRITES: &str = "RMEM_TEST_WRITES";

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        Trial::test("processes::a_long_wait_for_another_writer_is_told", a_long_wait_is_told),
        Trial::test("processes::two_write_and_three_read_at_once", two_write_and_three_read_at_once),
        Trial::test("processes::several_create_one_file_at_once", several_create_one_file_at_once),
        Trial::test("processes::updates_of_several_are_all_counted", updates_of_several_are_all_counted),
        Trial::test("processes::a_full_disk_is_an_error_and_loses_nothing", a_full_disk_is_an_error_and_loses_nothing),
        Trial::test(
            "processes::what_a_killed_writer_acknowledged_is_there",
            what_a_killed_writer_acknowledged_is_there,
        ),
    ]
}

/// Does what a child process does, in a child process.
pub(crate) fn child() -> Option<ExitCode> {
    let role = std::env::var(ROLE).ok()?;
    let [role, path, name, count] = role.split('\n').collect::<Vec<_>>().try_into().ok()?;
    let store = Embedded::open(path).unwrap();
    let count: i32 = count.parse().ok()?;
    match role {
        "write" => write(&store, name, count),
        "read" => read(&store, count),
        "fill" => fill(&store, count),
        "churn" => super::crashes::churn(&store, count),
        "count" => (0..count).for_each(|_| increment(&store)),
        other => panic!("no role {other}"),
    }
    Some(ExitCode::SUCCESS)
}

fn ns() -> Namespace {
    Namespace::parse("robmem.processes").unwrap()
}

/// Stores one document after the other and says so once each is durable.
fn write(store: &Embedded, name: &str, count: i32) {
    let mut out = std::io::stdout().lock();
    for n in 0..count {
        let batch = (0..1 + n % 3).map(|part| doc! { "_id": format!("{name}-{n}-{part}"), "writer": name, "n": n });
        store.insert(&ns(), batch.collect()).unwrap();
        if writeln!(out, "{n}").and_then(|()| out.flush()).is_err() {
            return;
        }
    }
}

/// Reads until all writers' documents are there; never sees a batch half stored, or documents vanish.
fn read(store: &Embedded, count: i32) {
    let mut last = 0;
    while last < count {
        let documents = store.find(&ns(), &Find::default()).unwrap();
        let seen = i32::try_from(documents.inspect(|document| assert!(document.is_ok())).count()).unwrap();
        assert!(seen >= last, "{seen} after {last}");
        last = seen;
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Stores large documents until that fails, and says why.
fn fill(store: &Embedded, count: i32) {
    let mut out = std::io::stdout().lock();
    for n in 0..count {
        let printed = match store.insert(&ns(), vec![doc! { "_id": n, "pad": "x".repeat(20_000) }]) {
            Ok(_) => writeln!(out, "{n}"),
            Err(error) => writeln!(out, "{error}"),
        };
        printed.unwrap();
    }
}

fn increment(store: &Embedded) {
    let request = UpdateRequest {
        filter: doc! { "_id": "counter" },
        update: UpdateSpec::Document(doc! { "$inc": { "n": 1 } }),
        upsert: true,
        ..UpdateRequest::default()
    };
    store.update(&ns(), &request, None).unwrap();
}

pub(crate) fn spawn(role: &str, path: &Path, name: &str, count: i32) -> std::io::Result<Child> {
    let reported: OsString = format!("{role}\n{}\n{name}\n{count}", path.display()).into();
    Command::new(std::env::current_exe()?).env(ROLE, reported).stdin(Stdio::null()).stdout(Stdio::piped()).spawn()
}

fn succeeds(child: Child) -> Result<(), Failed> {
    let output = child.wait_with_output()?;
    if output.status.success() { Ok(()) } else { Err(format!("a process ended with {}", output.status).into()) }
}

pub(crate) fn number(variable: &str, default: i32) -> i32 {
    std::env::var(variable).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// Waits until something is so.
pub(crate) fn until(what: &str, mut is_so: impl FnMut() -> Result<bool, Failed>) -> Result<(), Failed> {
    let since = Instant::now();
    while !is_so()? {
        if since.elapsed() > TIMEOUT {
            return Err(format!("waited in vain until {what}").into());
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    Ok(())
}

/// Draws that look random: the same in every run, others where `RMEM_TEST_SEED` is set. A test that fails prints the
/// seed.
pub(crate) struct Draws {
    seed: u64,
    state: u64,
    is_over: bool,
}

impl Draws {
    pub(crate) fn new() -> Self {
        let seed = seed();
        Self { seed, state: seed, is_over: false }
    }

    pub(crate) fn draw(&mut self) -> u64 {
        self.state = self.state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        self.state >> 33
    }

    /// The test has not failed.
    pub(crate) fn end(mut self) {
        self.is_over = true;
    }
}

impl Drop for Draws {
    fn drop(&mut self) {
        if !self.is_over {
            eprintln!("it failed with the seed {}; {SEED}={} makes the same draws", self.seed, self.seed);
        }
    }
}

/// The seed of all that is drawn: the same in every run, unless another one is asked for.
pub(crate) fn seed() -> u64 {
    std::env::var(SEED).map_or(1, |text| text.parse().expect("RMEM_TEST_SEED is a number"))
}

/// How many documents a writer of `count` batches stores.
fn documents(count: i32) -> i32 {
    (0..count).map(|n| 1 + n % 3).sum()
}

fn a_long_wait_is_told() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("m.rmem");
    let store = Embedded::open(&path)?;
    let insert = |options: &[&str]| {
        let mut rmem = Command::new(env!("CARGO_BIN_EXE_rmem"));
        let memory = format!("file:{}", path.display());
        rmem.args(["--memory", &memory, "insert", "robmem.processes", "{}"]).args(options);
        rmem.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("rmem starts")
    };
    let (mut waiting, mut line) = (Vec::new(), String::new());
    store.atomically(&mut || {
        store.insert(&ns(), vec![doc! {}])?;
        waiting = vec![insert(&["--quiet"]), insert(&[])];
        let told = waiting.last_mut().and_then(|told| told.stderr.take()).expect("a pipe");
        BufReader::new(told).read_line(&mut line).expect("text");
        Ok(())
    })?;
    assert_eq!(line, "another process writes to the memory; waiting until it is done\n");
    for waiting in waiting {
        let ended = waiting.wait_with_output()?;
        assert!(ended.status.success() && ended.stderr.is_empty(), "{ended:?}");
    }
    assert_eq!(store.count(&ns(), (&doc! {}).into())?, 3);
    Ok(())
}

fn two_write_and_three_read_at_once() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("robot.rmem");
    let writes = number(WRITES, 150);
    let all = 2 * documents(writes);
    let mut children = Vec::new();
    for name in ["a", "b"] {
        children.push(spawn("write", &path, name, writes)?);
    }
    for name in ["x", "y", "z"] {
        children.push(spawn("read", &path, name, all)?);
    }
    for child in children {
        succeeds(child)?;
    }
    let store = Embedded::open(&path)?;
    assert_eq!(store.count(&ns(), (&doc! {}).into())?, u64::from(all.unsigned_abs()));
    Ok(())
}

fn several_create_one_file_at_once() -> Result<(), Failed> {
    for _ in 0..5 {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("robot.rmem");
        let names = ["a", "b", "c", "d"];
        let children = names.map(|name| spawn("write", &path, name, 1));
        for child in children {
            succeeds(child?)?;
        }
        assert_eq!(Embedded::open(&path)?.count(&ns(), (&doc! {}).into())?, 4);
    }
    Ok(())
}

fn updates_of_several_are_all_counted() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("robot.rmem");
    let children = ["a", "b", "c"].map(|name| spawn("count", &path, name, 60));
    for child in children {
        succeeds(child?)?;
    }
    assert_eq!(Embedded::open(&path)?.count(&ns(), (&doc! { "n": 180 }).into())?, 1);
    Ok(())
}

/// A limit on the size of files stands for the full disk.
fn a_full_disk_is_an_error_and_loses_nothing() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("robot.rmem");
    let output = Command::new("sh")
        .args(["-c", "trap '' XFSZ; ulimit -f 2000; exec \"$0\""])
        .arg(std::env::current_exe()?)
        .env(ROLE, format!("fill\n{}\nx\n200", path.display()))
        .stdin(Stdio::null())
        .output()?;
    assert!(output.status.success(), "{output:?}");
    let printed = String::from_utf8(output.stdout)?;
    let (stored, failed): (Vec<_>, Vec<_>) = printed.lines().partition(|line| line.parse::<i32>().is_ok());
    assert!(!stored.is_empty() && !failed.is_empty(), "{printed}");
    let wanted = format!("file:{}: ", path.display());
    assert!(failed.iter().all(|line| line.starts_with(&wanted) && line.contains("disk")), "{failed:?}");

    let store = Embedded::open(&path)?;
    let ids = store.find(&ns(), &Find::default())?.map(|document| Ok(document?.get_i32("_id")?.to_string()));
    assert_eq!(ids.collect::<Result<Vec<_>, Failed>>()?, stored);
    store.insert(&ns(), vec![doc! {}])?;
    Ok(())
}

/// Kills a writer with SIGKILL after a random number of acknowledged writes, again and again.
fn what_a_killed_writer_acknowledged_is_there() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("robot.rmem");
    let mut draws = Draws::new();
    for round in 0..number(KILLS, 30) {
        let name = format!("w{round}");
        let acknowledged = kill_one(spawn("write", &path, &name, i32::MAX)?, 0, 12, draws.draw())?;
        let store = Embedded::open(&path).map_err(|error| format!("round {round}: {error}"))?;
        for n in 0..acknowledged {
            let stored = store.count(&ns(), (&doc! { "writer": &name, "n": n }).into())?;
            assert_eq!(stored, u64::from((1 + n % 3).unsigned_abs()), "round {round}, write {n}");
        }
        // A batch that was not acknowledged is there whole or not at all.
        let begun = store.count(&ns(), (&doc! { "writer": &name, "n": acknowledged }).into())?;
        assert!(begun == 0 || begun == u64::from((1 + acknowledged % 3).unsigned_abs()), "round {round}: {begun}");
        store.delete(&ns(), (&doc! {}).into(), false)?;
    }
    draws.end();
    Ok(())
}

/// Lets a writer acknowledge some of its work, fewer than `most` pieces, waits a moment, kills it; gives the number behind
/// the last that it acknowledged, `from` where there is none.
pub(crate) fn kill_one(mut child: Child, from: i32, most: u64, random: u64) -> Result<i32, Failed> {
    let Some(stdout) = child.stdout.take() else { return Err("no output".into()) };
    let mut lines = BufReader::new(stdout).lines();
    let mut next = from;
    for line in lines.by_ref().take(usize::try_from(random % most)?) {
        next = line?.parse::<i32>()? + 1;
    }
    std::thread::sleep(Duration::from_micros(random / most % 3_000));
    child.kill()?;
    child.wait()?;
    // What it printed before it died, it had done.
    for line in lines {
        next = line?.parse::<i32>()? + 1;
    }
    Ok(next)
}
