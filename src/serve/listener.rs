//! Listening: ports, Unix sockets, and sockets that systemd has opened.

use std::fs::{self, File};
use std::io;
use std::net::{TcpListener, TcpStream};
use std::os::fd::AsRawFd as _;
use std::os::unix::fs::{FileTypeExt as _, PermissionsExt as _};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use tempfile::TempDir;

use crate::fault::{AtFault, Fault};
use crate::process::stale_files;

use super::address::Address;
use super::client::Client;
use super::connection;
use super::server::{Server, thread};
use super::stream::Stream;
use super::tls::Tls;

/// How often to check whether the server is to end: that is how long an idle one takes to notice.
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// Why the server cannot listen.
#[derive(Debug, thiserror::Error)]
pub enum ListenError {
    /// The port is taken, or the address is not this machine's.
    #[error("cannot listen on {address}: {source}; {hint}")]
    Port {
        /// Where.
        address: Address,
        /// Why not.
        source: io::Error,
        /// What to do.
        hint: &'static str,
    },
    /// Another process listens there, or a file is in the way.
    #[error("{}: {reason}", path.display())]
    Socket {
        /// Where.
        path: PathBuf,
        /// Why not, and what to do.
        reason: String,
    },
    /// systemd passed something else than a socket for clients.
    #[error(
        "systemd passed a descriptor (number {descriptor}) that is no TCP or Unix socket to listen on; see ListenStream in rmem.socket"
    )]
    Passed {
        /// Its number in this process.
        descriptor: usize,
    },
}

impl AtFault for ListenError {
    fn fault(&self) -> Fault {
        Fault::Store
    }
}

/// Where clients come in.
pub struct Listener {
    kind: Kind,
    address: Address,
    tls: Option<Tls>,
    /// Whether a socket stays in the file system when the server ends: it belongs to another process.
    is_kept: bool,
}

enum Kind {
    Tcp(TcpListener),
    Unix(UnixListener),
}

impl Listener {
    /// Listens on an address; over a port, with TLS where it is given.
    ///
    /// # Errors
    /// Where that is not possible.
    pub fn bind(address: &Address, tls: Option<&Tls>) -> Result<Self, ListenError> {
        match address {
            Address::Tcp(socket) => {
                let listener = TcpListener::bind(socket).map_err(|source| port(address, source))?;
                Self::of_tcp(listener, tls)
            }
            Address::Unix(path) => {
                Ok(Self { kind: Kind::Unix(bind(path)?), address: address.clone(), tls: None, is_kept: false })
            }
        }
    }

    /// Listens on a port that was opened already.
    ///
    /// # Errors
    /// Where it is none.
    pub fn of_tcp(listener: TcpListener, tls: Option<&Tls>) -> Result<Self, ListenError> {
        let address = listener.local_addr().map(Address::Tcp);
        let address = address.map_err(|source| port(&Address::standard(), source))?;
        Ok(Self { kind: Kind::Tcp(listener), address, tls: tls.cloned(), is_kept: false })
    }

    /// Listens on a Unix socket that was opened already.
    ///
    /// # Errors
    /// Where it has no name.
    pub fn of_unix(listener: UnixListener) -> Result<Self, ListenError> {
        let path = listener.local_addr().ok().and_then(|address| address.as_pathname().map(Path::to_owned));
        let path = path.ok_or_else(|| ListenError::Socket {
            path: PathBuf::new(),
            reason: "the socket has no name in the file system".to_owned(),
        })?;
        Ok(Self { kind: Kind::Unix(listener), address: Address::Unix(path), tls: None, is_kept: false })
    }

    /// The same, whose socket stays in the file system when the server ends.
    #[must_use]
    pub fn kept(mut self) -> Self {
        self.is_kept = true;
        self
    }

    /// Where it listens, with the port that it was given.
    #[must_use]
    pub fn address(&self) -> &Address {
        &self.address
    }

    /// Whether what is sent can be read by those between.
    #[must_use]
    pub fn is_encrypted(&self) -> bool {
        self.tls.is_some()
    }

    /// Lets clients in until the server ends.
    pub fn run(self, server: &Arc<Server>) {
        if self.kind.set_nonblocking().is_err() {
            return;
        }
        while !server.is_stopping() {
            match self.accept(server) {
                Ok(()) => {}
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => self.kind.wait(POLL_INTERVAL),
                // Too many files are open, or a client has left before it was let in.
                Err(_) => {
                    server.free_files();
                    std::thread::sleep(Duration::from_millis(10));
                }
            }
        }
    }

    fn accept(&self, server: &Arc<Server>) -> io::Result<()> {
        match &self.kind {
            Kind::Tcp(listener) => {
                let (stream, peer) = listener.accept()?;
                stream.set_nonblocking(false)?;
                self.admit(server, Incoming::Tcp(stream), peer.to_string())
            }
            Kind::Unix(listener) => {
                let (stream, _) = listener.accept()?;
                stream.set_nonblocking(false)?;
                self.admit(server, Incoming::Unix(stream), "anonymous unix socket".to_owned())
            }
        }
    }

    /// Gives a client a thread of its own, below the limit of connections.
    fn admit(&self, server: &Arc<Server>, incoming: Incoming, peer: String) -> io::Result<()> {
        let (host, id) = (incoming.host(&self.address), server.next_id());
        let stream = incoming.stream(self.tls.as_ref())?;
        let handle = server.with_files(|| stream.handle(peer.clone()))?;
        let (is_busy, activity) = (Arc::clone(&handle.is_busy), Arc::clone(&handle.activity));
        if !server.enter(id, handle) {
            return Ok(());
        }
        let client = Client {
            id,
            peer,
            host,
            metadata: server.metadata(),
            author: "a client of rmem serve".into(),
            needs_login: server.options.users.is_some(),
            user: None,
            login: None,
            transactions: std::collections::HashMap::new(),
            is_busy,
            activity,
        };
        let shared = Arc::clone(server);
        let spawned = thread("connection").spawn(move || connection::serve(&shared, stream, client));
        spawned.map(drop).inspect_err(|_| server.leave(id))
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        if let (Address::Unix(path), false) = (&self.address, self.is_kept) {
            // It may have been removed already.
            let _ = fs::remove_file(path);
        }
    }
}

enum Incoming {
    Tcp(TcpStream),
    Unix(UnixStream),
}

impl Incoming {
    fn stream(self, tls: Option<&Tls>) -> io::Result<Stream> {
        match self {
            Self::Unix(stream) => Stream::unix(stream),
            Self::Tcp(stream) => match (Stream::tcp(stream)?, tls) {
                (Stream::Tcp(stream), Some(tls)) => tls.wrap(stream),
                (stream, _) => Ok(stream),
            },
        }
    }

    /// This server, as the client reaches it.
    fn host(&self, address: &Address) -> String {
        match self {
            Self::Tcp(stream) => stream.local_addr().map_or_else(|_| address.to_string(), |local| local.to_string()),
            Self::Unix(_) => address.to_string(),
        }
    }
}

impl Kind {
    fn set_nonblocking(&self) -> io::Result<()> {
        match self {
            Self::Tcp(listener) => listener.set_nonblocking(true),
            Self::Unix(listener) => listener.set_nonblocking(true),
        }
    }

    /// Waits for a client.
    fn wait(&self, limit: Duration) {
        use rustix::event::{PollFd, PollFlags, Timespec, poll};
        let mut clients = [match self {
            Self::Tcp(listener) => PollFd::new(listener, PollFlags::IN),
            Self::Unix(listener) => PollFd::new(listener, PollFlags::IN),
        }];
        // An interrupted wait is over.
        let _ = poll(&mut clients, Timespec::try_from(limit).ok().as_ref());
    }
}

fn port(address: &Address, source: io::Error) -> ListenError {
    let hint = match source.kind() {
        io::ErrorKind::AddrInUse => "another process listens there; end it, or use another port with --listen",
        io::ErrorKind::PermissionDenied => "use a port from 1024 on",
        _ => "use an address of this machine with --listen, like 127.0.0.1:27017",
    };
    ListenError::Port { address: address.clone(), source, hint }
}

/// A folder for this process alone, within another one; those that killed processes left there go.
///
/// # Errors
/// Where it cannot be made.
pub fn private_folder(folder: &Path) -> io::Result<TempDir> {
    let mut builder = tempfile::Builder::new();
    builder.permissions(fs::Permissions::from_mode(0o700));
    builder.prefix(&stale_files::prefix(folder, ".rmem-")).tempdir_in(folder)
}

/// A socket that only its owner may use. It is made in a folder of its own, and named when it has its mode.
fn bind(path: &Path) -> Result<UnixListener, ListenError> {
    let wrong = |reason: String| ListenError::Socket { path: path.to_owned(), reason };
    match fs::symlink_metadata(path) {
        Ok(found) if !found.file_type().is_socket() => {
            return Err(wrong("is not a socket; remove it, or name another path with --socket".to_owned()));
        }
        Ok(_) if UnixStream::connect(path).is_ok() => {
            return Err(wrong("another process listens there; end it, or name another path".to_owned()));
        }
        _ => {}
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let made = private_folder(folder).and_then(|private| {
        // Through its descriptor: the path of a socket may have 107 bytes.
        let open = File::open(private.path())?;
        let place = PathBuf::from(format!("/proc/self/fd/{}/s", open.as_raw_fd()));
        let listener = UnixListener::bind(&place)?;
        fs::set_permissions(&place, fs::Permissions::from_mode(0o600))?;
        fs::rename(&place, path)?;
        Ok(listener)
    });
    made.map_err(|error| wrong(format!("cannot listen there: {error}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_socket_is_its_owners_alone_and_takes_the_place_of_one_that_nobody_serves() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rmem.sock");
        let address = Address::Unix(path.clone());
        let listener = Listener::bind(&address, None).unwrap();
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        assert!(Listener::bind(&address, None).is_err());
        drop(listener);
        assert!(!path.exists());
        drop(UnixListener::bind(&path).unwrap());
        assert!(path.exists() && Listener::bind(&address, None).is_ok());
        fs::write(&path, "precious").unwrap();
        assert!(Listener::bind(&address, None).is_err());
        assert_eq!(fs::read_to_string(&path).unwrap(), "precious");
    }

    #[test]
    fn what_a_killed_server_left_is_not_in_the_way() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join(format!(".rmem-{}", std::process::id()))).unwrap();
        let listener = Listener::bind(&Address::Unix(folder.path().join("rmem.sock")), None);
        assert!(listener.is_ok());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[test]
    fn a_socket_may_have_a_path_as_long_as_the_system_lets_it() {
        let folder = tempfile::tempdir().unwrap();
        let length = 107 - folder.path().as_os_str().len() - "/".len();
        let path = folder.path().join("s".repeat(length));
        let _listener = Listener::bind(&Address::Unix(path.clone()), None).unwrap();
        assert!(UnixStream::connect(&path).is_ok());
    }

    #[test]
    fn a_port_that_is_taken_is_named() {
        let first = Listener::bind(&Address::tcp("127.0.0.1:0").unwrap(), None).unwrap();
        let error = Listener::bind(first.address(), None).err().unwrap().to_string();
        assert!(error.contains("another process listens there"), "{error}");
    }
}
