//! `rmem backend`: three robots on loopback, each with its own `rmem.toml` and mongod processes.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::net::{Ipv4Addr, TcpListener};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use bson::doc;
use libtest_mimic::{Failed, Trial};
use mongodb::sync::Client;
use serde_json::Value;

use crate::mongod::{Mongod, free_port};

type Case = fn(&Path) -> Result<(), Failed>;

const CASES: &[(&str, Case)] = &[
    ("backend::a_killed_primary_loses_no_acknowledged_write_and_no_watch_misses_one", survive),
    ("backend::what_runs_stays_as_it_is_and_strangers_are_left_alone", stay),
    ("backend::the_log_arguments_and_data_are_as_the_settings_say", configured),
    ("backend::a_program_that_does_not_do_as_mongod_does_is_not_waited_for", misbehave),
    ("backend::a_write_meets_what_a_member_that_is_behind_has_not_yet", behind),
    ("backend::a_mongod_that_is_suspended_is_named_and_nothing_waits_for_it", suspended),
];

/// The names of the tests, all of which need a mongod.
pub(crate) fn names() -> Vec<String> {
    CASES.iter().map(|(name, _)| (*name).to_owned()).collect()
}

pub(crate) fn trials(program: Option<&Path>) -> Vec<Trial> {
    let trial = |(name, case): &(&str, Case)| {
        let (case, program) = (*case, program.map(Path::to_owned));
        let missing = program.is_none();
        let run = move || case(program.as_deref().ok_or("there is no mongod")?);
        Trial::test(*name, run).with_ignored_flag(missing)
    };
    CASES.iter().map(trial).collect()
}

/// Ends what the robots started, also when the tests are killed.
const KEEPER: &str = r#"
trap '' INT TERM
exec 2>/dev/null
read -r _
for file in "$1"/*/db/*.pid; do kill -9 "$(cat "$file")"; done
rm -rf "$1"
"#;

/// Robots in folders of their own, and the ports of their private and shared databases.
pub(crate) struct Robots {
    folder: PathBuf,
    keeper: Child,
    mongod: PathBuf,
    ports: Vec<(u16, u16)>,
}

impl Robots {
    pub(crate) fn new(mongod: &Path, count: usize) -> Result<Self, Failed> {
        let folder = tempfile::tempdir()?.keep();
        let keeper = Command::new("sh").args(["-c", KEEPER, "keeper"]).arg(&folder).stdin(Stdio::piped()).spawn()?;
        let ports = (0..count).map(|_| Ok((free_port()?, free_port()?))).collect::<std::io::Result<_>>()?;
        Ok(Self { folder, keeper, mongod: mongod.to_owned(), ports })
    }

    fn members(&self, count: usize) -> Vec<String> {
        self.ports.iter().take(count).map(|(_, port)| format!("127.0.0.1:{port}")).collect()
    }

    /// Writes the settings of a robot, in which the first `count` are members.
    pub(crate) fn settle(&self, robot: usize, count: usize) -> Result<(), Failed> {
        let (local, shared) = self.ports[robot];
        let common = format!("mongod = {:?}\noplog_size = '64M'\ncache_size = '256M'\n", self.mongod);
        let settings = format!(
            "memory = 'mongodb://127.0.0.1:{local}/'\nshared = 'mongodb://{}/?replicaSet=shared'\n\
             shared_databases = ['syncedrobmem']\n\
             [backend.local]\nport = {local}\npath = 'db/local'\n{common}\
             [backend.shared]\nport = {shared}\npath = 'db/shared'\nreplica_set = 'shared'\nmembers = {:?}\n{common}",
            self.members(self.ports.len()).join(","),
            self.members(count),
        );
        std::fs::create_dir_all(self.path(robot))?;
        Ok(std::fs::write(self.path(robot).join("rmem.toml"), settings)?)
    }

    pub(crate) fn path(&self, robot: usize) -> PathBuf {
        self.folder.join(format!("r{robot}"))
    }

    pub(crate) fn command(&self, robot: usize, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rmem"));
        command.args(arguments).current_dir(self.path(robot)).env("HOME", &self.folder).stdin(Stdio::null());
        command
    }

    fn run(&self, robot: usize, arguments: &[&str]) -> Result<Output, Failed> {
        Ok(self.command(robot, arguments).output()?)
    }

    /// Runs a command that has to end with `code`; gives its lines.
    fn ends(&self, robot: usize, arguments: &[&str], code: i32) -> Result<Vec<Value>, Failed> {
        let output = self.run(robot, arguments)?;
        if output.status.code() != Some(code) {
            return Err(format!("robot {robot}: {arguments:?} should have ended with {code}: {output:?}").into());
        }
        self.rows(&output)
    }

    /// What a command printed, line by line.
    fn rows(&self, output: &Output) -> Result<Vec<Value>, Failed> {
        let lines = std::str::from_utf8(&output.stdout)?;
        lines.lines().map(|line| Ok(serde_json::from_str(line)?)).collect()
    }

    /// Runs a command on several robots at once.
    pub(crate) fn together(&self, robots: &[usize], arguments: &[&str]) -> Result<(), Failed> {
        std::thread::scope(|scope| {
            let runs: Vec<_> = robots.iter().map(|robot| scope.spawn(|| self.ends(*robot, arguments, 0))).collect();
            runs.into_iter().try_for_each(|run| run.join().map_err(|_| Failed::from("a robot failed"))?.map(drop))
        })
    }

    /// Asks for the status until it is as wanted.
    fn until(&self, robot: usize, wanted: impl Fn(&[Value]) -> bool) -> Result<Vec<Value>, Failed> {
        let since = Instant::now();
        loop {
            let output = self.run(robot, &["backend", "status"])?;
            let text = String::from_utf8(output.stdout)?;
            let rows: Vec<Value> = text.lines().map(serde_json::from_str).collect::<Result<_, _>>()?;
            if wanted(&rows) {
                return Ok(rows);
            }
            if since.elapsed() > Duration::from_secs(90) {
                return Err(format!("the status of robot {robot} stays {rows:?}").into());
            }
            std::thread::sleep(Duration::from_millis(200));
        }
    }

    fn pid(&self, robot: usize, backend: &str) -> Result<String, Failed> {
        Ok(std::fs::read_to_string(self.path(robot).join(format!("db/{backend}.pid")))?.trim().to_owned())
    }

    /// The `_id`s in the shared collection, as one member has them.
    fn ids(&self, member: usize) -> Result<BTreeSet<String>, Failed> {
        let uri = format!("mongodb://127.0.0.1:{}/?directConnection=true", self.ports[member].1);
        let found = self.ends(member, &["--shared", &uri, "distinct", "syncedrobmem.x", "_id"], 0)?;
        Ok(found.iter().filter_map(|id| id.as_str().map(str::to_owned)).collect())
    }
}

impl Drop for Robots {
    fn drop(&mut self) {
        drop(self.keeper.stdin.take());
        let _ = self.keeper.wait();
    }
}

/// Whether a process is gone, or waits to be reaped.
fn ended(pid: &str) -> bool {
    std::fs::read(format!("/proc/{pid}/cmdline")).map_or(true, |line| line.is_empty())
}

/// The states of the members of the shared set.
fn states(rows: &[Value]) -> Vec<&str> {
    let shared = rows.iter().filter(|row| row["backend"] == "shared");
    let mut states: Vec<_> = shared.filter_map(|row| row["state"].as_str()).collect();
    states.sort_unstable();
    states
}

/// All members are up and none is behind.
fn healthy(rows: &[Value]) -> bool {
    let caught_up = rows.iter().all(|row| row["lag_seconds"] == 0 && row["version"].is_string());
    caught_up && states(rows) == ["PRIMARY", "SECONDARY", "SECONDARY"]
}

/// What the writers have been reported is stored.
#[derive(Default)]
struct Acknowledged {
    ids: Mutex<BTreeSet<String>>,
    count: AtomicUsize,
    stop: AtomicBool,
    longest: Mutex<Duration>,
}

impl Acknowledged {
    /// Writes documents through rmem, one after the other, each until it is acknowledged.
    fn write(&self, robots: &Robots, robot: usize) -> Result<(), Failed> {
        let mut last = Instant::now();
        for n in 0.. {
            if self.stop.load(Ordering::SeqCst) {
                break;
            }
            let id = format!("{robot}-{n}");
            let document = format!("{{_id: '{id}'}}");
            loop {
                let output = robots.run(robot, &["-q", "insert", "syncedrobmem.x", &document])?;
                match output.status.code() {
                    // 5: an attempt without an acknowledgement had been stored after all.
                    Some(0 | 5) => break,
                    Some(4) => {}
                    _ => return Err(format!("writing {id}: {output:?}").into()),
                }
                if last.elapsed() > Duration::from_secs(90) {
                    let status = robots.run(robot, &["backend", "status", "--format", "table"])?;
                    return Err(format!("writing does not go on: {output:?}; {status:?}").into());
                }
            }
            self.ids.lock().map_err(|_| "poisoned")?.insert(id);
            self.count.fetch_add(1, Ordering::SeqCst);
            let mut longest = self.longest.lock().map_err(|_| "poisoned")?;
            *longest = longest.max(last.elapsed());
            last = Instant::now();
        }
        Ok(())
    }

    /// Waits until so many more are acknowledged.
    fn more(&self, count: usize) -> Result<(), Failed> {
        let (since, start) = (Instant::now(), self.count.load(Ordering::SeqCst));
        while self.count.load(Ordering::SeqCst) < start + count {
            if since.elapsed() > Duration::from_secs(120) {
                return Err("writing does not go on".into());
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(())
    }
}

/// A `rmem watch` of the shared documents, by one of the robots, into a file.
struct Follower {
    child: Child,
    received: PathBuf,
}

impl Follower {
    fn open(robots: &Robots, robot: usize) -> Result<Self, Failed> {
        let received = robots.path(robot).join("received");
        let mut command = robots.command(robot, &["watch", "syncedrobmem.x", "--resume", "follower"]);
        let mut child = command.stdout(File::create(&received)?).stderr(Stdio::piped()).spawn()?;
        let mut printed = String::new();
        let mut stderr = BufReader::new(child.stderr.take().ok_or("no stderr")?);
        stderr.read_line(&mut printed)?;
        // Its messages about the election are not compared.
        std::thread::spawn(move || std::io::copy(&mut stderr, &mut std::io::sink()));
        assert!(printed.starts_with("watching "), "{printed}");
        Ok(Self { child, received })
    }

    /// The `_id`s of the changes, each where it is received first, once all of `written` are among them.
    fn receive(&self, written: &BTreeSet<String>) -> Result<Vec<String>, Failed> {
        let since = Instant::now();
        loop {
            let mut ids: Vec<String> = Vec::new();
            for line in
                std::fs::read_to_string(&self.received)?.split_inclusive('\n').filter(|line| line.ends_with('\n'))
            {
                let id = serde_json::from_str::<Value>(line)?["_id"].as_str().unwrap_or_default().to_owned();
                if !ids.contains(&id) {
                    ids.push(id);
                }
            }
            if written.iter().all(|id| ids.contains(id)) {
                return Ok(ids);
            }
            if since.elapsed() > Duration::from_secs(90) {
                return Err(format!("{} of {} changes were received", ids.len(), written.len()).into());
            }
            std::thread::sleep(Duration::from_millis(100));
        }
    }
}

impl Drop for Follower {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// What Fawkes configures of a mongod: its log, further arguments, and data that goes with it.
fn configured(mongod: &Path) -> Result<(), Failed> {
    let robots = Robots::new(mongod, 1)?;
    std::fs::create_dir_all(robots.path(0))?;
    let settings = |more: &str| {
        let port = robots.ports[0].0;
        let text = format!(
            "memory = 'mongodb://127.0.0.1:{port}/'\n[backend.local]\nport = {port}\npath = 'db/local'\nmongod = {mongod:?}\n\
             oplog_size = '64M'\ncache_size = '256M'\nlog = 'logs/mongod.txt'\narguments = ['--quiet', '--nounixsocket']\n\
             start_timeout = '2m'\nstop_timeout = '2m'\n{more}"
        );
        std::fs::write(robots.path(0).join("rmem.toml"), text)
    };
    let (log, data) = (robots.path(0).join("logs/mongod.txt"), robots.path(0).join("db/local"));
    settings("")?;
    robots.ends(0, &["backend", "up", "--wait", "1m"], 0)?;
    let line = std::fs::read(format!("/proc/{}/cmdline", robots.pid(0, "local")?))?;
    assert!(line.split(|byte| *byte == 0).any(|word| word == b"--nounixsocket"));
    let length = std::fs::metadata(&log)?.len();
    robots.ends(0, &["insert", "robmem.x", "{_id: 1}"], 0)?;
    // It is recognised by the log that it has, and its data stays.
    robots.ends(0, &["backend", "down"], 0)?;
    settings("clear_on_stop = true\n")?;
    robots.ends(0, &["backend", "up", "--wait", "1m"], 0)?;
    assert!(std::fs::metadata(&log)?.len() > length, "the log was not continued");
    assert_eq!(robots.ends(0, &["count", "robmem.x"], 0)?, [Value::from(1)]);
    robots.ends(0, &["backend", "down"], 0)?;
    assert!(!data.exists() && log.exists());
    settings("log_append = false\n")?;
    robots.ends(0, &["backend", "up", "--wait", "1m"], 0)?;
    assert_eq!(robots.ends(0, &["count", "robmem.x"], 0)?, [Value::from(0)]);
    robots.ends(0, &["backend", "down"], 0)?;
    assert!(data.exists());
    Ok(())
}

fn survive(mongod: &Path) -> Result<(), Failed> {
    let robots = Robots::new(mongod, 3)?;
    // One robot alone does its part, and says which ones are missing.
    for robot in 0..3 {
        robots.settle(robot, 2)?;
    }
    let alone = robots.ends(0, &["backend", "up"], 0)?;
    assert_eq!((&alone[0]["state"], &alone[1]["state"]), (&"PRIMARY".into(), &"WAITING".into()));
    robots.ends(0, &["backend", "up", "shared", "--wait", "10ms"], 1)?;
    robots.together(&[0, 1], &["backend", "up", "--wait", "1m"])?;
    assert_eq!(states(&robots.until(1, |rows| states(rows).len() == 2)?), ["PRIMARY", "SECONDARY"]);
    // A third appears in the settings; all come up at once.
    for robot in 0..3 {
        robots.settle(robot, 3)?;
    }
    robots.together(&[2, 0, 1], &["backend", "up", "--wait", "1m"])?;
    let rows = robots.until(0, healthy)?;
    assert!(rows.iter().all(|row| row["version"].as_str().is_some_and(|version| version.contains('.'))), "{rows:?}");

    robots.ends(0, &["insert", "syncedrobmem.x", "{_id: 'first'}"], 0)?;
    let follower = Follower::open(&robots, 0)?;
    let acknowledged = Acknowledged::default();
    let killed = std::thread::scope(|scope| -> Result<usize, Failed> {
        let writers: Vec<_> = (0..3)
            .map(|robot| {
                scope.spawn({
                    let (acknowledged, robots) = (&acknowledged, &robots);
                    move || acknowledged.write(robots, robot)
                })
            })
            .collect();
        let during = || -> Result<usize, Failed> {
            acknowledged.more(30)?;
            let rows = robots.ends(0, &["backend", "status"], 0)?;
            let primary = rows.iter().find(|row| row["backend"] == "shared" && row["state"] == "PRIMARY");
            let primary = primary.and_then(|row| row["member"].as_str()).ok_or("there is no primary")?;
            let killed =
                robots.members(3).iter().position(|member| member == primary).ok_or("no member has that address")?;
            let status = Command::new("kill").args(["-9", &robots.pid(killed, "shared")?]).status()?;
            assert!(status.success());
            acknowledged.more(60)?;
            Ok(killed)
        };
        let killed = during();
        acknowledged.stop.store(true, Ordering::SeqCst);
        for writer in writers {
            writer.join().map_err(|_| "a writer failed")??;
        }
        killed
    })?;
    let written = acknowledged.ids.lock().map_err(|_| "poisoned")?.clone();
    let gap = *acknowledged.longest.lock().map_err(|_| "poisoned")?;
    eprintln!("{} writes acknowledged; the longest took {:.1} s, the election", written.len(), gap.as_secs_f64());

    let received = follower.receive(&written)?;
    for robot in 0..3 {
        let prefix = format!("{robot}-");
        let numbers: Vec<u32> = received.iter().filter_map(|id| id.strip_prefix(&prefix)?.parse().ok()).collect();
        assert!(numbers.is_sorted(), "the changes of robot {robot} are out of order: {numbers:?}");
    }
    drop(follower);

    let written = written.into_iter().chain(["first".to_owned()]).collect();
    let other = (killed + 1) % 3;
    assert_eq!(states(&robots.ends(other, &["backend", "status"], 1)?), ["DOWN", "PRIMARY", "SECONDARY"]);
    robots.ends(killed, &["backend", "up", "--wait", "1m"], 0)?;
    robots.until(other, healthy)?;

    // One that is suspended does not hide the others.
    let pid = robots.pid(other, "shared")?;
    let signal = |name: &str| Command::new("kill").args([name, &pid]).status();
    signal("-STOP")?;
    let status = robots.run(other, &["backend", "status"])?;
    signal("-CONT")?;
    let rows = robots.rows(&status)?;
    let down = states(&rows).iter().filter(|state| **state == "DOWN").count();
    assert!(status.status.code() == Some(4) && states(&rows).len() == 3 && down == 1, "{status:?}");
    robots.until(other, healthy)?;
    for member in 0..3 {
        let since = Instant::now();
        while robots.ids(member)? != written && since.elapsed() < Duration::from_secs(30) {}
        assert!(robots.ids(member)? == written, "member {member} has not what was acknowledged");
    }
    // A member that lost its data copies it from the others.
    robots.ends(killed, &["backend", "down", "shared"], 0)?;
    std::fs::remove_dir_all(robots.path(killed).join("db/shared"))?;
    robots.ends(killed, &["backend", "up", "--wait", "1m"], 0)?;
    robots.until(killed, healthy)?;
    assert!(robots.ids(killed)? == written, "the copy is not whole");
    // One of three alone has no majority.
    for robot in 1..3 {
        robots.ends(robot, &["backend", "down", "shared"], 0)?;
    }
    robots.until(0, |rows| states(rows) == ["DOWN", "DOWN", "SECONDARY"])?;
    let refused = robots.run(0, &["insert", "syncedrobmem.x", "{}"])?;
    let printed = String::from_utf8(refused.stderr)?;
    assert!(
        refused.status.code() == Some(4) && printed.contains("`rmem backend up` starts those of this robot"),
        "{printed}"
    );
    robots.together(&[1, 2], &["backend", "up", "--wait", "1m"])?;
    for robot in 0..3 {
        let (local, shared) = (robots.pid(robot, "local")?, robots.pid(robot, "shared")?);
        let down = robots.ends(robot, &["backend", "down"], 0)?;
        assert!(down.iter().all(|row| row["did"] == "stopped"), "{down:?}");
        assert!([local, shared].iter().all(|pid| ended(pid)));
    }
    Ok(())
}

/// One of three members is an hour behind. Reads may go there, writes and what they read may not.
fn behind(mongod: &Path) -> Result<(), Failed> {
    let robots = Robots::new(mongod, 3)?;
    (0..3).try_for_each(|robot| robots.settle(robot, 3))?;
    robots.together(&[0, 1, 2], &["backend", "up", "--wait", "90s"])?;
    let rows = robots.until(0, healthy)?;
    let primary = rows.iter().find(|row| row["backend"] == "shared" && row["state"] == "PRIMARY");
    let primary = primary.and_then(|row| row["member"].as_str()).ok_or("there is no primary")?.to_owned();
    let client = Client::with_uri_str(format!("mongodb://{primary}/?directConnection=true"))?;
    let admin = client.database("admin");
    let mut config = admin.run_command(doc! { "replSetGetConfig": 1 }).run()?.get_document("config")?.clone();
    config.insert("version", config.get_i32("version")? + 1);
    let members = config.get_array_mut("members")?;
    let last = members.iter_mut().filter_map(|member| member.as_document_mut());
    let last =
        last.filter(|member| member.get_str("host").ok() != Some(primary.as_str())).last().ok_or("no secondary")?;
    last.extend(doc! { "priority": 0, "secondaryDelaySecs": 3_600 });
    admin.run_command(doc! { "replSetReconfig": config }).run()?;

    for nth in 0..12 {
        let (id, name) = (format!("{{_id: {nth}}}"), format!("n{nth}"));
        let query = format!("{{name: '{name}'}}");
        robots.ends(0, &["insert", "syncedrobmem.x", &format!("{{_id: {nth}, name: '{name}', list: [1]}}")], 0)?;
        let matched = |arguments: &[&str]| -> Result<(), Failed> {
            let done = robots.ends(0, &[&["update", "syncedrobmem.x"], arguments].concat(), 0)?;
            if done[0]["matched"] == 1 { Ok(()) } else { Err(format!("{arguments:?}: {done:?}").into()) }
        };
        for change in
            ["{$set: {a: 1}}", "{$inc: {n: 1}}", "{$addToSet: {list: 2}}", "[{$set: {sum: {$add: ['$a', '$n']}}}]"]
        {
            matched(&[&query, change])?;
        }
        matched(&[&query, "{$unset: {a: 1}}", "--many"])?;
        let found = robots.ends(0, &["find-and-modify", "syncedrobmem.x", &id, "{$inc: {n: 1}}", "--new"], 0)?;
        assert_eq!(
            (&found[0]["sum"], &found[0]["n"], &found[0]["list"]),
            (&2.into(), &2.into(), &serde_json::json!([1, 2]))
        );
        robots.ends(0, &["lock", &name, "--owner", "r1"], 0)?;
        robots.ends(0, &["unlock", &name, "--owner", "r1"], 0)?;
    }
    Ok(())
}

/// Programs that are no mongod, and a mongod that stays in the foreground.
fn misbehave(mongod: &Path) -> Result<(), Failed> {
    let robots = Robots::new(mongod, 1)?;
    robots.settle(0, 1)?;
    let settings = robots.path(0).join("rmem.toml");
    let text = std::fs::read_to_string(&settings)?;
    let program = robots.path(0).join("program");
    for (script, words) in [
        ("exit 1", "it ended with exit status: 1 and printed nothing"),
        ("echo I am not what you think >&2; exit 3", "did not start as a mongod: I am not what you think"),
        ("sleep 600 & echo $$ > pid; wait", "neither listened nor wrote to its log for 20s (start_timeout)"),
    ] {
        script_at(&program, script)?;
        std::fs::write(&settings, text.replace(&format!("{mongod:?}"), "'./program'"))?;
        let output = robots.run(0, &["backend", "up", "local"])?;
        let printed = String::from_utf8(output.stderr)?;
        assert!(output.status.code() == Some(4) && printed.contains(words), "{printed}");
    }
    assert!(ended(std::fs::read_to_string(robots.path(0).join("pid"))?.trim()), "it was left running");
    // Its first word, --fork, does not reach it.
    script_at(&program, &format!("shift; exec {mongod:?} \"$@\""))?;
    let up = robots.ends(0, &["backend", "up", "local"], 0)?;
    assert_eq!((&up[0]["started"], &up[0]["state"]), (&true.into(), &"PRIMARY".into()));
    robots.ends(0, &["insert", "robmem.x", "{_id: 1}"], 0)?;
    assert_eq!(robots.ends(0, &["backend", "down", "local"], 0)?[0]["did"], "stopped");
    Ok(())
}

/// A mongod that takes connections, and answers nothing.
fn suspended(mongod: &Path) -> Result<(), Failed> {
    let robots = Robots::new(mongod, 1)?;
    robots.settle(0, 1)?;
    robots.ends(0, &["backend", "up", "local"], 0)?;
    robots.ends(0, &["insert", "robmem.x", "{_id: 1}"], 0)?;
    let pid = robots.pid(0, "local")?;
    let signal = |name: &str| Command::new("kill").args([name, &pid]).status();
    signal("-STOP")?;
    let asked: [&[&str]; 5] = [
        &["query", "robmem.x"],
        &["count", "robmem.x"],
        &["insert", "robmem.x", "{_id: 2}"],
        &["update", "robmem.x", "{}", "{$set: {n: 1}}"],
        &["delete", "robmem.x", "{}", "--all"],
    ];
    let said: Vec<Output> = asked.iter().map(|args| robots.run(0, args)).collect::<Result<_, _>>()?;
    let status = robots.run(0, &["backend", "status"])?;
    signal("-CONT")?;
    assert_eq!(robots.rows(&status)?[0]["state"], "DOWN");
    let address = format!("cannot reach mongodb://127.0.0.1:{}: no server answers", robots.ports[0].0);
    let suspended = format!("its mongod, process {pid}, listens on port {} and does not answer", robots.ports[0].0);
    let wanted = said.iter().map(|output| (output, &address)).chain([(&status, &suspended)]);
    for (output, wanted) in wanted {
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(4) && message.contains(wanted), "{output:?}");
    }
    assert_eq!(robots.ends(0, &["count", "robmem.x"], 0)?, [Value::from(1)], "nothing was written");
    // One that is only slow to answer, as on a robot that starts, is stopped like any other.
    signal("-STOP")?;
    let down = std::thread::scope(|scope| {
        let down = scope.spawn(|| robots.ends(0, &["backend", "down", "local"], 0));
        std::thread::sleep(Duration::from_secs(5));
        signal("-CONT")?;
        down.join().map_err(|_| Failed::from("`backend down` failed"))?
    })?;
    assert_eq!(down[0]["did"], "stopped");
    Ok(())
}

fn script_at(path: &Path, script: &str) -> Result<(), Failed> {
    use std::os::unix::fs::PermissionsExt as _;
    std::fs::write(path, format!("#!/bin/sh\n{script}\n"))?;
    Ok(std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o755))?)
}

fn stay(mongod: &Path) -> Result<(), Failed> {
    let robots = Robots::new(mongod, 2)?;
    robots.settle(0, 2)?;
    robots.settle(1, 2)?;
    // Two at once, and again: one process is started, once.
    std::thread::scope(|scope| -> Result<(), Failed> {
        let runs = [0; 2].map(|robot| {
            scope.spawn({
                let robots = &robots;
                move || robots.ends(robot, &["backend", "up", "local"], 0)
            })
        });
        let mut rows = Vec::new();
        for run in runs {
            rows.extend(run.join().map_err(|_| "a run failed")??);
        }
        assert_eq!(rows.iter().filter(|row| row["started"] == true).count(), 1, "{rows:?}");
        assert_eq!(rows[0]["pid"], rows[1]["pid"]);
        Ok(())
    })?;
    let again = robots.ends(0, &["backend", "up", "local"], 0)?;
    assert_eq!((&again[0]["started"], &again[0]["state"]), (&false.into(), &"PRIMARY".into()));
    robots.ends(0, &["insert", "robmem.x", "{_id: 1}"], 0)?;

    // A mongod of another user, and something that is no mongod, on the port.
    let stranger = Mongod::start(mongod)?;
    let settings = robots.path(1).join("rmem.toml");
    let port = stranger.uri.trim_start_matches("mongodb://127.0.0.1:").split('/').next().unwrap_or_default().to_owned();
    let text = std::fs::read_to_string(&settings)?.replace(&robots.ports[1].0.to_string(), &port);
    std::fs::write(&settings, &text)?;
    for command in ["up", "down"] {
        let output = robots.run(1, &["backend", command, "local"])?;
        let printed = String::from_utf8(output.stderr)?;
        assert!(output.status.code() == Some(4) && printed.contains("taken by another mongod"), "{printed}");
    }
    robots.ends(1, &["count", "robmem.x"], 0)?;
    drop(stranger);
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
    std::fs::write(&settings, text.replace(&port, &listener.local_addr()?.port().to_string()))?;
    let output = robots.run(1, &["backend", "up", "local"])?;
    let printed = String::from_utf8(output.stderr)?;
    assert!(output.status.code() == Some(4) && printed.contains("does not answer as mongod does"), "{printed}");

    // The data of a process that runs.
    let text = text.replace("'db/local'", "'../r0/db/local'").replace(&port, &robots.ports[1].0.to_string());
    std::fs::write(&settings, text)?;
    let output = robots.run(1, &["backend", "up", "local"])?;
    let printed = String::from_utf8(output.stderr)?;
    assert!(output.status.code() == Some(4) && printed.contains("DBPathInUse"), "{printed}");

    // The port was changed: the set of one finds itself again, with its data.
    robots.ends(0, &["backend", "down", "local"], 0)?;
    let down = robots.ends(0, &["backend", "down", "local"], 0)?;
    assert_eq!(down[0]["did"], "not running");
    let settings = robots.path(0).join("rmem.toml");
    let text = std::fs::read_to_string(&settings)?;
    std::fs::write(&settings, text.replace(&robots.ports[0].0.to_string(), &robots.ports[1].0.to_string()))?;
    robots.ends(0, &["backend", "up", "local"], 0)?;
    assert_eq!(robots.ends(0, &["count", "robmem.x"], 0)?, [Value::from(1)]);

    // Without its program.
    std::fs::write(&settings, text.replace(&format!("mongod = {mongod:?}"), "mongod = 'missing-mongod'"))?;
    let output = robots.run(0, &["backend", "up", "local"])?;
    assert_eq!(output.status.code(), Some(127), "{output:?}");
    Ok(())
}
