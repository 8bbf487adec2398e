//! The process: its beginning, its end, its sockets and its lock.

use std::io::Read as _;
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::net::UnixDatagram;
use std::process::Command;
use std::time::Duration;

use bson::{Document, doc};
use libtest_mimic::Failed;
use mongodb::sync::Client;

use super::wire::{Wire, message, status};
use super::{Case, Served, code};
use crate::processes::until;

pub(super) const CASES: &[(&str, Case)] = &[
    ("what_was_begun_is_answered_before_the_server_ends", ends),
    ("a_socket_is_its_owners_alone_and_gone_at_the_end", sockets),
    ("one_process_serves_a_file_and_others_use_it_beside", lock),
    ("what_is_acknowledged_is_in_a_file_that_is_moved_and_the_server_ends", moved),
    ("a_server_whose_file_is_removed_ends_and_makes_no_other", removed),
    ("a_server_whose_log_is_removed_keeps_what_it_has_acknowledged_and_ends", log_removed),
    ("a_memory_that_is_gone_at_exit_is_served_to_all", in_memory),
    ("a_robot_that_does_not_reach_its_team_is_served", alone),
    ("a_file_is_open_as_often_as_commands_are_worked_at", open_files),
    ("a_service_manager_opens_the_socket_and_is_told", systemd),
];

fn rmem(folder: &std::path::Path, arguments: &[&str]) -> Result<(Option<i32>, String), Failed> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rmem"));
    let output = command.args(["--memory", "file:robot.rmem"]).args(arguments).current_dir(folder).output()?;
    let printed = [output.stdout, output.stderr].concat();
    Ok((output.status.code(), String::from_utf8_lossy(&printed).into_owned()))
}

fn ends() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let documents: Vec<Document> = (0..20_000).map(|n| doc! { "_id": n, "pad": "x".repeat(50) }).collect();
    let mut wire = Wire::connect(served.address())?;
    let mut idle = Wire::connect(served.address())?;
    idle.run(&doc! { "ping": 1, "$db": "a" })?;
    wire.send(&message(&doc! { "insert": "c", "documents": documents, "$db": "a" }))?;
    until("the command has come", || Ok(status(&mut idle, "network")?.get_i64("bytesIn")? > 1_000_000))?;
    let answer = std::thread::spawn(move || wire.receive().map(|answer| answer.get_i32("n").ok()).ok().flatten());
    assert_eq!(served.terminate()?, Some(0));
    assert_eq!(answer.join().ok().flatten(), Some(20_000));
    assert_eq!(rmem(folder.path(), &["count", "a.c"])?, (Some(0), "20000\n".to_owned()));
    // Nothing is left beside the file.
    assert_eq!(std::fs::read_dir(folder.path())?.count(), 1);
    Ok(())
}

fn open_files() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut clients = (0..20).map(|_| Wire::connect(served.address())).collect::<Result<Vec<_>, _>>()?;
    for (n, client) in (0..).zip(&mut clients) {
        client.run(&doc! { "insert": "c", "documents": [{ "_id": n }], "$db": "a" })?;
        assert_eq!(client.run(&doc! { "count": "c", "$db": "a" })?.get_i32("n")?, n + 1);
    }
    let path = std::fs::canonicalize(folder.path())?.join("robot.rmem");
    let mut open = 0;
    for file in std::fs::read_dir(format!("/proc/{}/fd", served.child.id()))? {
        open += usize::from(std::fs::read_link(file?.path()).is_ok_and(|target| target == path));
    }
    // By the connections, which took turns, by the writer, and by the lock.
    assert!((1..=5).contains(&open), "{open}");
    Ok(())
}

fn sockets() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start_as(folder.path(), &["--socket", "rmem.sock"])?;
    let path = folder.path().join("rmem.sock");
    assert_eq!(std::fs::metadata(&path)?.permissions().mode() & 0o777, 0o600);
    let found = Client::with_uri_str(&served.uri)?.database("a").collection::<Document>("c");
    found.insert_one(doc! { "_id": 1 }).run()?;
    assert_eq!(found.count_documents(doc! {}).run()?, 1);
    assert_eq!(served.terminate()?, Some(0));
    assert!(!path.exists());
    Ok(())
}

fn lock() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let (code, printed) = rmem(folder.path(), &["serve", "--listen", "127.0.0.1:0"])?;
    assert!(code == Some(5) && printed.contains(&served.uri), "{code:?} {printed}");
    let (code, printed) = rmem(folder.path(), &["serve", "--socket", "second.sock"])?;
    assert!(code == Some(5) && !folder.path().join("second.sock").exists(), "{code:?} {printed}");
    assert_eq!(rmem(folder.path(), &["insert", "a.c", "{_id: 1}"])?.0, Some(0));
    let found = served.client()?.database("a").collection::<Document>("c");
    found.insert_one(doc! { "_id": 2 }).run()?;
    assert_eq!(rmem(folder.path(), &["count", "a.c"])?.1, "2\n");
    let (_, printed) = rmem(folder.path(), &["doctor"])?;
    assert!(printed.contains(&format!("process {}", served.child.id())) && printed.contains(&served.uri), "{printed}");
    served.kill()?;
    assert!(!rmem(folder.path(), &["doctor"])?.1.contains("served"));
    assert!(Served::start(folder.path(), &[]).is_ok());
    Ok(())
}

fn alone() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let settings = "shared = \"mongodb://127.0.0.1:1/?serverSelectionTimeoutMS=100\"\nshared_databases = [\"team\"]\n";
    std::fs::write(folder.path().join("rmem.toml"), settings)?;
    let (served, stderr) = Served::start_heard(folder.path())?;
    let client = served.client()?;
    client.database("a").collection::<Document>("c").insert_one(doc! { "_id": 1 }).run()?;
    assert_eq!(client.database("a").list_collection_names().run()?, ["c"]);
    assert_eq!(client.list_database_names().run()?, ["a", "team"]);
    let top = client.database("admin").run_command(doc! { "top": 1 }).run()?;
    assert!(top.get_document("totals")?.contains_key("a.c"), "{top}");
    let refused = code(client.database("team").collection::<Document>("c").find_one(doc! {}).run());
    assert_eq!(refused, Some(6));
    assert_eq!(served.terminate()?, Some(0));
    let said = std::io::read_to_string(stderr)?;
    assert!(said.contains("the shared store (team): cannot reach mongodb://127.0.0.1:1"), "{said}");
    Ok(())
}

fn moved() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let found = served.client()?.database("a").collection::<Document>("c");
    found.insert_one(doc! { "_id": 0 }).run()?;
    let (sender, acknowledged) = std::sync::mpsc::channel();
    let writer = std::thread::spawn(move || {
        for n in 1.. {
            if found.insert_one(doc! { "_id": n, "pad": "x".repeat(100) }).run().is_err() {
                return n;
            }
            let _ = sender.send(n);
        }
        0
    });
    let last = acknowledged.iter().take(20).last();
    std::fs::rename(folder.path().join("robot.rmem"), folder.path().join("old.rmem"))?;
    assert_eq!((last, served.ended()?), (Some(20), Some(4)));
    let count = writer.join().map_err(|_| "the writer failed")?;
    assert!(!folder.path().join("robot.rmem").exists());
    // The one that failed may have been done.
    std::fs::rename(folder.path().join("old.rmem"), folder.path().join("robot.rmem"))?;
    let (_, printed) = rmem(folder.path(), &["count", "a.c"])?;
    assert!(printed == format!("{count}\n") || printed == format!("{}\n", count + 1), "{count} {printed}");
    Ok(())
}

/// The log alone.
fn log_removed() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let (served, mut stderr) = Served::start_heard(folder.path())?;
    let mut wire = Wire::connect(served.address())?;
    let insert = |id: i32| doc! { "insert": "c", "documents": [{ "_id": id }], "$db": "a" };
    for id in 0..10 {
        assert_eq!(wire.run(&insert(id))?.get_i32("n")?, 1);
    }
    std::fs::remove_file(folder.path().join("robot.rmem-wal"))?;
    if let Ok(answer) = wire.run(&insert(10)) {
        assert!(answer.get_str("errmsg")?.contains("moved or removed"), "{answer}");
    }
    assert_eq!(served.ended()?, Some(4));
    let mut printed = String::new();
    stderr.read_to_string(&mut printed)?;
    assert!(printed.contains("robot.rmem-wal: this log was moved or removed"), "{printed}");
    assert_eq!(rmem(folder.path(), &["count", "a.c"])?.1, "10\n");
    Ok(())
}

fn removed() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let (served, mut stderr) = Served::start_heard(folder.path())?;
    let mut wire = Wire::connect(served.address())?;
    let insert = doc! { "insert": "c", "documents": [{}], "$db": "a" };
    assert_eq!(wire.run(&insert)?.get_i32("n")?, 1);
    std::fs::remove_file(folder.path().join("robot.rmem"))?;
    // It is refused, or the connection has ended.
    if let Ok(answer) = wire.run(&insert) {
        assert!(answer.get_str("errmsg")?.contains("moved or removed"), "{answer}");
    }
    let later = Wire::connect(served.address()).and_then(|mut wire| wire.run(&insert));
    assert!(later.is_err() || later.is_ok_and(|answer| answer.get_i32("n").is_err()));
    assert_eq!(served.ended()?, Some(4));
    assert!(!folder.path().join("robot.rmem").exists());
    let mut printed = String::new();
    stderr.read_to_string(&mut printed)?;
    assert!(printed.contains("robot.rmem: the file was moved or removed"), "{printed}");
    Ok(())
}

fn in_memory() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    std::fs::write(folder.path().join("world.json"), "{\"a.c\": [{\"_id\": 1}]}")?;
    let options = ["--memory", "mem:", "--load", "world.json", "--listen", "127.0.0.1:0"];
    let served = Served::start_as(folder.path(), &options)?;
    served.client()?.database("a").collection("c").insert_one(doc! { "_id": 2 }).run()?;
    let count = served.client()?.database("a").collection::<Document>("c").count_documents(doc! {}).run()?;
    assert_eq!(count, 2);
    assert!(!folder.path().join("robot.rmem").exists());
    Ok(())
}

/// Opens a socket, as systemd does for a unit, and runs a program with it.
const ACTIVATE: &str = "
import os, socket, sys
kind = socket.SOCK_DGRAM if sys.argv[1].endswith('.datagrams') else socket.SOCK_STREAM
listener = socket.socket(socket.AF_UNIX, kind)
listener.bind(sys.argv[1])
if kind == socket.SOCK_STREAM:
    listener.listen()
os.dup2(listener.fileno(), 3)
os.set_inheritable(3, True)
os.environ['LISTEN_FDS'] = '1'
os.environ['LISTEN_PID'] = str(os.getpid())
os.execv(sys.argv[2], sys.argv[2:])
";

fn systemd() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let (socket, notify) = (folder.path().join("rmem.sock"), folder.path().join("notify"));
    let manager = UnixDatagram::bind(&notify)?;
    manager.set_read_timeout(Some(Duration::from_secs(60)))?;
    let mut child = Command::new("python3")
        .args(["-c", ACTIVATE])
        .arg(&socket)
        .arg(env!("CARGO_BIN_EXE_rmem"))
        // The unit of the service names the socket, too.
        .args(["--memory", "file:robot.rmem", "serve", "--socket"])
        .arg(&socket)
        .current_dir(folder.path())
        .env("NOTIFY_SOCKET", &notify)
        .spawn()?;
    let mut printed = [0; 64];
    let reported = manager.recv(&mut printed);
    let uri = format!("mongodb://{}/?directConnection=true", socket.display().to_string().replace('/', "%2F"));
    let counted = Client::with_uri_str(uri)?.database("a").collection::<Document>("c").count_documents(doc! {}).run();
    let process = rustix::process::Pid::from_raw(i32::try_from(child.id())?).ok_or("no process")?;
    rustix::process::kill_process(process, rustix::process::Signal::TERM)?;
    assert_eq!(child.wait()?.code(), Some(0));
    assert_eq!(printed.get(..reported?), Some(b"READY=1".as_slice()));
    assert_eq!(counted?, 0);
    // The socket is the service manager's.
    assert!(socket.exists());
    let refused = Command::new("python3")
        .args(["-c", ACTIVATE])
        .arg(folder.path().join("rmem.datagrams"))
        .arg(env!("CARGO_BIN_EXE_rmem"))
        .args(["--memory", "file:robot.rmem", "serve"])
        .current_dir(folder.path())
        .output()?;
    assert_eq!(refused.status.code(), Some(4));
    assert!(
        String::from_utf8_lossy(&refused.stderr).contains("(number 3) that is no TCP or Unix socket"),
        "{refused:?}"
    );
    Ok(())
}
