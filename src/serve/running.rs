//! A server that runs: its own thread, and its end.

use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::abandoned;
use super::job::Job;
use super::server::{Opener, Options, Server, thread};
use super::writer;

/// How long connections have to end when the server does; then they are cut.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_secs(10);

/// The server's own thread; to be ended by [`Running::stop`].
pub struct Running {
    server: Arc<Server>,
    writer: JoinHandle<()>,
}

impl Running {
    /// Starts a server of the memory that `open` opens.
    ///
    /// # Errors
    /// Where the system has no more threads to give.
    pub fn start(open: Opener, options: Options) -> std::io::Result<Self> {
        let (server, jobs) = Server::new(open, options);
        let shared = Arc::clone(&server);
        let writer = thread("writer").spawn(move || writer::run(&shared, &jobs))?;
        let shared = Arc::clone(&server);
        thread("clients").spawn(move || abandoned::watch(&shared))?;
        Ok(Self { server, writer })
    }

    /// The server, which connections share.
    #[must_use]
    pub fn server(&self) -> &Arc<Server> {
        &self.server
    }

    /// Ends the server: what was begun is answered, what is waited for is not.
    pub fn stop(self) {
        let since = Instant::now();
        self.server.stop();
        while self.server.connected() > 0 && since.elapsed() < SHUTDOWN_TIMEOUT {
            self.server.stop();
            std::thread::sleep(Duration::from_millis(2));
        }
        // It has ended already where that fails.
        let _ = self.server.writer.submit(Job::Stop);
        let _ = self.writer.join();
    }
}
