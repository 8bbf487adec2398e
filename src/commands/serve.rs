//! `rmem serve`: every MongoDB client is a client of the memory.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use clap::Args;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

use super::context::Opening;
use super::{Context, UsageError};
use crate::error::{Context as _, Result};
use crate::exit::Exit;
use crate::formats::quantity;
use crate::interrupt::InterruptGuard;
use crate::serve::lock::{self, Lock};
use crate::serve::{Address, Listener, Opener, Options, Running, Server, Tls, Users, private_folder, systemd};
use crate::settings::{Origin, Settings};
use crate::store::{StoreError, StoreUri};

/// How often to check whether the server is to end: a user does not notice the delay.
const POLL_INTERVAL: Duration = Duration::from_millis(20);

/// Serve the memory to MongoDB clients: drivers, mongosh, Compass
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  rmem serve --memory file:robot.rmem\n  rmem serve --memory file:robot.rmem --socket /run/robot/rmem.sock\n  rmem serve --listen 0.0.0.0:27017 --users users --tls-cert robot.pem --tls-key robot.key\n  mongosh mongodb://127.0.0.1:27017/robmem\n\n\
Speaks MongoDB's wire protocol on 127.0.0.1:27017, or where --listen and --socket say. Computables\n\
run for every client, documents are shown without their metadata, and change streams are kept for an\n\
hour. Other rmem processes use the file beside it; one process at a time serves a file (exit code 5).\n\
An address that other machines reach needs --users and TLS. A file of users has a line for each,\n\
NAME:PASSWORD, or NAME: and what --hash-password prints; only its owner may read it. Exits with 0 on\n\
SIGTERM, after the running commands are answered. Takes sockets from systemd and notifies it when it is ready."
)]
pub struct ServeArgs {
    /// Listen on ADDRESS: HOST, HOST:PORT or :PORT; port 0 picks a free one (can be repeated)
    #[arg(long, value_name = "ADDRESS")]
    pub listen: Vec<String>,
    /// Listen on a Unix socket, which only its owner may use (can be repeated)
    #[arg(long, value_name = "PATH")]
    pub socket: Vec<PathBuf>,
    /// Refuse what changes the memory, and change streams
    #[arg(long)]
    pub read_only: bool,
    /// Require a login (SCRAM-SHA-256) by the users of FILE
    #[arg(long, value_name = "FILE")]
    pub users: Option<PathBuf>,
    /// Encrypt with this certificate chain (PEM)
    #[arg(long, value_name = "FILE", requires = "tls_key")]
    pub tls_cert: Option<PathBuf>,
    /// The certificate's private key (PEM)
    #[arg(long, value_name = "FILE", requires = "tls_cert")]
    pub tls_key: Option<PathBuf>,
    /// Show the memory's metadata, `_robmem_info`
    #[arg(long)]
    pub meta: bool,
    /// At most N connections at once
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub max_connections: u32,
    /// Close cursors that were not read for this long
    #[arg(long, value_name = "DURATION", default_value = "10m", value_parser = quantity::duration)]
    pub cursor_timeout: Duration,
    /// Do not poll for the next command of a client that sends one after the other: slower, but the
    /// processor sleeps in between
    #[arg(long)]
    pub no_busy_poll: bool,
    /// Print the URIs on stdout once clients can connect
    #[arg(long)]
    pub print_uri: bool,
    /// Read a password from stdin, print its hash for a file of users, and exit
    #[arg(long, conflicts_with_all = ["listen", "socket", "read_only", "users", "meta", "print_uri"])]
    pub hash_password: bool,
}

pub(super) fn run(args: &ServeArgs, context: &mut Context<'_>) -> Result<Exit> {
    if args.hash_password {
        return hash_password(context);
    }
    allow_files();
    let (tls, options) = (tls(args)?, options(args)?);
    let scratch = file_for_memory(context)?;
    let files = files(&context.settings)?;
    let mut locks = if args.read_only { Vec::new() } else { take_locks(&files)? };
    let listeners = listeners(args, tls.as_ref(), options.users.is_some(), context)?;
    fill(args.read_only && scratch.is_none(), context)?;
    let guard = InterruptGuard::new();
    let running = Running::start(opener(context.opening()), options).context("cannot start")?;
    files.iter().try_for_each(|file| running.server().listen_at(file)).context("cannot start")?;
    let uris: Vec<String> = listeners.iter().map(uri).collect();
    let threads = start(listeners, running.server())?;
    announce(args, &uris, &mut locks, context)?;
    let ended = wait(guard.interrupted(), running.server(), context);
    systemd::notify(notify_socket(context).as_deref(), "STOPPING=1");
    running.stop();
    for thread in threads {
        // It ends by itself once the server is stopping.
        let _ = thread.join();
    }
    drop((locks, scratch));
    ended?;
    Ok(Exit::Done)
}

/// Raises the limit on open files as far as this process may: a connection takes several.
fn allow_files() {
    let limit = getrlimit(Resource::Nofile);
    // Where that is refused, fewer clients can connect at once.
    let _ = setrlimit(Resource::Nofile, Rlimit { current: limit.maximum, ..limit });
}

fn hash_password(context: &mut Context<'_>) -> Result<Exit> {
    let mut password = String::new();
    context.take_stdin()?.read_line(&mut password).context("cannot read stdin")?;
    let password = password.trim_end_matches(['\n', '\r']);
    if password.is_empty() {
        return Err(UsageError::new("no password on stdin; expected a line with one").into());
    }
    let verifier = Users::verifier(password)
        .ok_or_else(|| UsageError::new("the password has a character that is not allowed in one"))?;
    context.output.line(&verifier)?;
    Ok(Exit::Done)
}

fn tls(args: &ServeArgs) -> Result<Option<Tls>> {
    match (&args.tls_cert, &args.tls_key) {
        (Some(certificate), Some(key)) => Ok(Some(Tls::read(certificate, key)?)),
        _ => Ok(None),
    }
}

fn options(args: &ServeArgs) -> Result<Options> {
    let users = args.users.as_deref().map(Users::read).transpose()?;
    Ok(Options {
        metadata: args.meta,
        read_only: args.read_only,
        users: users.map(Arc::new),
        connections: args.max_connections as usize,
        cursor_timeout: args.cursor_timeout,
        busy_poll: !args.no_busy_poll,
    })
}

/// Where clients come in: as the command line says, or systemd, or MongoDB's port of this machine.
fn listeners(args: &ServeArgs, tls: Option<&Tls>, has_users: bool, context: &Context<'_>) -> Result<Vec<Listener>> {
    let mut addresses = Vec::new();
    for text in &args.listen {
        addresses.push(Address::tcp(text)?);
    }
    for path in &args.socket {
        addresses.push(Address::Unix(std::path::absolute(path)?));
    }
    let activated = match context.environment.contains_key("LISTEN_FDS") {
        true => systemd::listeners(tls)?,
        false => Vec::new(),
    };
    if addresses.is_empty() && activated.is_empty() {
        addresses.push(Address::standard());
    }
    for address in addresses.iter().chain(activated.iter().map(Listener::address)) {
        check_reach(address, tls.is_some(), has_users)?;
    }
    let mut listeners = activated;
    // Where the service manager listens already, its socket is the one that is meant.
    addresses.retain(|address| listeners.iter().all(|listener| listener.address() != address));
    for address in &addresses {
        listeners.push(Listener::bind(address, tls)?);
    }
    Ok(listeners)
}

/// An address that other machines reach needs passwords and encryption.
fn check_reach(address: &Address, has_tls: bool, has_users: bool) -> Result<(), UsageError> {
    if address.is_local() || (has_tls && has_users) {
        return Ok(());
    }
    Err(UsageError::new(format!(
        "{address} can be reached from other machines, which could all read and change the memory; \
         give --users, --tls-cert and --tls-key, or listen on 127.0.0.1 or a --socket"
    )))
}

/// A memory that is gone at exit is a file meanwhile: each connection opens it.
fn file_for_memory(context: &mut Context<'_>) -> Result<Option<tempfile::TempDir>> {
    let is_memory = context.settings.memory.value.as_deref() == Some("mem:");
    if !is_memory {
        return Ok(None);
    }
    let folder = private_folder(&context.temporary()).context("cannot make a temporary folder")?;
    context.settings.memory.value = Some(format!("file:{}", folder.path().join("memory.rmem").display()));
    Ok(Some(folder))
}

/// The files that are served.
fn files(settings: &Settings) -> Result<Vec<PathBuf>> {
    let mut files: Vec<PathBuf> = Vec::new();
    for uri in [&settings.memory.value, &settings.shared.value].into_iter().flatten() {
        let uri = StoreUri::parse(uri)?;
        let path = uri.path().map(Path::to_owned);
        files.extend(path.filter(|path| !files.contains(path)));
    }
    Ok(files)
}

/// The server of the local memory, if one runs.
pub(super) fn server(settings: &Settings) -> Option<lock::Holder> {
    files(settings).ok()?.first().and_then(|file| lock::holder(file))
}

fn take_locks(files: &[PathBuf]) -> Result<Vec<Lock>> {
    files.iter().map(|file| Ok(Lock::take(file)?)).collect()
}

/// Opens the memory once: errors are reported now, and a missing file is created. A robot that does not reach its team can
/// use its own databases.
fn fill(has_to_be_there: bool, context: &mut Context<'_>) -> Result<()> {
    let memory = if has_to_be_there { context.memory()? } else { context.memory_to_fill()? };
    let is_file = context.settings.memory.value.as_deref().is_some_and(|uri| uri.starts_with("file:"));
    if is_file && !has_to_be_there {
        memory.open_local()?;
    }
    memory.check_local()?;
    if let Err(error) = memory.check_shared() {
        let databases = context.settings.shared_databases.value.join(", ");
        let hint = "the databases in it are refused until it answers";
        context.output.warn(&format!("the shared store ({databases}): {error}; {hint}"));
    }
    context.report_operations();
    Ok(())
}

fn opener(opening: Opening) -> Opener {
    Arc::new(move || {
        opening
            .open(None)
            .map_err(|error| StoreError::Failed { address: "the memory".to_owned(), reason: format!("{error:#}") })
    })
}

fn uri(listener: &Listener) -> String {
    listener.address().uri(if listener.is_encrypted() { "tls=true" } else { "" })
}

fn start(listeners: Vec<Listener>, server: &Arc<Server>) -> Result<Vec<std::thread::JoinHandle<()>>> {
    let spawn = |listener: Listener| {
        let server = Arc::clone(server);
        std::thread::Builder::new().name("listener".to_owned()).spawn(move || listener.run(&server))
    };
    listeners.into_iter().map(spawn).collect::<Result<_, _>>().context("cannot start")
}

/// Says that clients may connect, and where.
fn announce(args: &ServeArgs, uris: &[String], locks: &mut [Lock], context: &mut Context<'_>) -> Result<()> {
    for lock in locks {
        lock.write_uris(&uris.join("\n"))?;
    }
    if args.print_uri {
        for uri in uris {
            context.output.line(uri)?;
        }
        context.output.flush()?;
    }
    let memory = context.settings.memory.value.as_deref().map_or("none".to_owned(), super::config::address);
    let name = if matches!(context.settings.memory.origin, Origin::Default) { "your memory" } else { &memory };
    context.output.note(&format!("serving {name} at {}", uris.join(" ")));
    systemd::notify(notify_socket(context).as_deref(), "READY=1");
    Ok(())
}

fn notify_socket(context: &Context<'_>) -> Option<String> {
    context.environment.get("NOTIFY_SOCKET").cloned()
}

/// Waits until the server is to end; an error where a file is not there any more.
fn wait(interrupted: &AtomicBool, server: &Server, context: &mut Context<'_>) -> Result<()> {
    while !interrupted.load(Ordering::Relaxed) {
        std::thread::sleep(POLL_INTERVAL);
        context.report_operations();
        server.check_files()?;
    }
    Ok(())
}
