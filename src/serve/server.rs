//! What all connections share.

use std::collections::HashMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU64, Ordering};
use std::sync::mpsc::Receiver;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use bson::DateTime;

use super::access::Metadata;
use super::age::Ages;
use super::auth::Users;
use super::behind::Behind;
use super::busy_poll::BusyPoll;
use super::changes::Scopes;
use super::clock::Clock;
use super::cursor::Cursors;
use super::failure::{Failure, codes};
use super::files::{Files, Moved};
use super::hub::Hub;
use super::job::{Job, JobQueue};
use super::pool::{Pool, Pooled};
use super::request::Request;
use super::session::Sessions;
use super::snapshot::Readings;
use super::stream::Handle;
use super::turns::Turns;
use super::usage::Usage;
use crate::memory::Memory;
use crate::store::StoreError;
use crate::store::embedded::Notifier;

/// Opens the memory that is served, in whichever thread asks.
pub type Opener = Arc<dyn Fn() -> Result<Memory, StoreError> + Send + Sync>;

/// How a memory is served.
#[derive(Clone)]
pub struct Options {
    /// Clients see `_robmem_info`.
    pub metadata: bool,
    /// Nothing may be changed.
    pub read_only: bool,
    /// The users who may connect; none means that no login is needed.
    pub users: Option<Arc<Users>>,
    /// At most so many connections at once.
    pub connections: usize,
    /// How long a cursor lives without being read.
    pub cursor_timeout: Duration,
    /// Whether connections may poll for commands that come one after the other, instead of sleeping.
    pub busy_poll: bool,
}

impl Default for Options {
    fn default() -> Self {
        let cursor_timeout = Duration::from_secs(600);
        Self { metadata: false, read_only: false, users: None, connections: 1000, cursor_timeout, busy_poll: true }
    }
}

/// A memory being served.
pub struct Server {
    open: Opener,
    pub(super) options: Options,
    pub(super) cursors: Cursors,
    pub(super) writer: JobQueue,
    pub(super) pool: Pool,
    pub(super) hub: Hub,
    pub(super) scopes: Scopes,
    pub(super) sessions: Sessions,
    pub(super) behind: Behind,
    pub(super) readings: Readings,
    pub(super) clock: Clock,
    pub(super) ages: Ages,
    pub(super) turns: Turns,
    pub(super) busy_poll: BusyPoll,
    files: Files,
    pub(super) counters: Counters,
    pub(super) usage: Usage,
    pub(super) started: DateTime,
    pub(super) since: Instant,
    stopping: AtomicBool,
    connections: Mutex<HashMap<i64, Handle>>,
    ids: AtomicI64,
}

/// What was done since the start.
#[derive(Debug, Default)]
pub(super) struct Counters {
    pub(super) commands: AtomicU64,
    pub(super) connections: AtomicU64,
    pub(super) received: AtomicU64,
    pub(super) sent: AtomicU64,
}

impl Counters {
    pub(super) fn add(counter: &AtomicU64, more: usize) {
        counter.fetch_add(more as u64, Ordering::Relaxed);
    }
}

/// How often the file is looked at, whether or not a change of another process was reported.
const NOTIFY_TIMEOUT: Duration = Duration::from_secs(1);

impl Server {
    /// Returns a server of the memory that `open` opens, and what its writer is given to do.
    pub(super) fn new(open: Opener, options: Options) -> (Arc<Self>, Receiver<Job>) {
        let (writer, jobs) = JobQueue::new();
        let busy_poll = BusyPoll::new(options.busy_poll);
        let server = Arc::new(Self {
            open,
            options,
            cursors: Cursors::default(),
            writer,
            pool: Pool::default(),
            hub: Hub::default(),
            scopes: Scopes::default(),
            sessions: Sessions::default(),
            behind: Behind::default(),
            readings: Readings::default(),
            clock: Clock::default(),
            ages: Ages::new(),
            turns: Turns::default(),
            busy_poll,
            files: Files::default(),
            counters: Counters::default(),
            usage: Usage::default(),
            started: DateTime::now(),
            since: Instant::now(),
            stopping: AtomicBool::new(false),
            connections: Mutex::default(),
            ids: AtomicI64::new(1),
        });
        (server, jobs)
    }

    pub(super) fn open(&self) -> Result<Memory, Failure> {
        self.check_files()?;
        let memory = (self.open)()?;
        // Whoever uses what could not be opened gets the error.
        let _ = self.with_files(|| memory.open_existing());
        // Another file may have taken the name since.
        self.check_files()?;
        Ok(memory)
    }

    /// Lends a memory: one that was lent before, or another one.
    pub(super) fn lend(&self) -> Result<Pooled, Failure> {
        self.pool.take().map_or_else(|| self.open_one_more(), Ok)
    }

    /// Opens one of many memories, which keeps only a share of what it reads.
    pub(super) fn open_one_more(&self) -> Result<Pooled, Failure> {
        let memory = self.open()?;
        let share = self.pool.opened();
        memory.limit_caches(share).inspect_err(|_| self.pool.lost())?;
        Ok(Pooled { memory, share })
    }

    /// Looks whether the files that are served still have their names.
    ///
    /// # Errors
    /// Where one has been moved or removed.
    pub fn check_files(&self) -> Result<(), Moved> {
        self.files.check()
    }

    /// How clients see metadata that are not rmem themselves.
    pub(super) fn metadata(&self) -> Metadata {
        if self.options.metadata { Metadata::Shown } else { Metadata::Hidden }
    }

    pub(super) fn next_id(&self) -> i64 {
        self.ids.fetch_add(1, Ordering::Relaxed)
    }

    /// Serves a file from now on, and notifies waiting threads of the changes that other processes make to it.
    ///
    /// # Errors
    /// Where the system has no more threads to give.
    pub fn listen_at(self: &Arc<Self>, file: &Path) -> std::io::Result<()> {
        self.files.add(file);
        let (server, notifier) = (Arc::clone(self), Notifier::new(file));
        let listen = move || {
            while !server.is_stopping() {
                notifier.wait(NOTIFY_TIMEOUT);
                server.hub.call();
            }
        };
        thread("changes").spawn(listen).map(drop)
    }

    pub(super) fn is_stopping(&self) -> bool {
        self.stopping.load(Ordering::SeqCst)
    }

    /// Takes no more connections, and lets those that there are end when they have answered.
    pub(super) fn stop(&self) {
        self.stopping.store(true, Ordering::SeqCst);
        self.lock().values().for_each(Handle::finish);
        self.hub.call();
    }

    /// Registers a connection; says whether there is room for it.
    pub(super) fn enter(&self, id: i64, handle: Handle) -> bool {
        let mut connections = self.lock();
        let has_room = connections.len() < self.options.connections && !self.is_stopping();
        if has_room {
            connections.insert(id, handle);
            Counters::add(&self.counters.connections, 1);
        }
        has_room
    }

    pub(super) fn leave(&self, id: i64) {
        self.lock().remove(&id);
    }

    /// Does something with all connections, each with its number.
    pub(super) fn connections<T>(&self, work: impl FnOnce(&mut dyn Iterator<Item = (i64, &Handle)>) -> T) -> T {
        work(&mut self.lock().iter().map(|(id, handle)| (*id, handle)))
    }

    /// Stops the operations that are meant, with MongoDB's code for the reason.
    pub(super) fn stop_operations(&self, code: i32, is_meant: impl Fn(&Request) -> bool) {
        self.connections(|connections| {
            let running = connections.filter_map(|(_, handle)| handle.activity.current());
            running.filter(|request| is_meant(request)).for_each(|request| request.stop.stop(code));
        });
        // Some wait for changes.
        self.hub.call();
    }

    pub(super) fn connected(&self) -> usize {
        self.lock().len()
    }

    pub(super) fn check_running(&self) -> Result<(), Failure> {
        match self.is_stopping() {
            true => Err(Failure::new(codes::SHUTDOWN, "the server is shutting down")),
            false => Ok(()),
        }
    }

    pub(super) fn expire_streams(&self) {
        let limit = self.options.cursor_timeout;
        self.cursors.expire_streams(|used| used.elapsed() >= limit);
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<i64, Handle>> {
        self.connections.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A thread whose stack is as large as that of a process's first thread.
pub(super) fn thread(name: &str) -> std::thread::Builder {
    std::thread::Builder::new().name(name.to_owned()).stack_size(8 << 20)
}
