//! The bytes of a connection, however it is made.

use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use rustls::{ServerConnection, StreamOwned};

use super::activity::Activity;

/// How long a client may be silent within a message, or not take an answer.
const IO_TIMEOUT: Duration = Duration::from_secs(30);

/// A connection's bytes.
pub(super) enum Stream {
    Tcp(TcpStream),
    Unix(UnixStream),
    Tls(Box<StreamOwned<ServerConnection, TcpStream>>),
}

/// What another thread may do to a connection.
pub(super) struct Handle {
    socket: Socket,
    /// Whether a message is being read or answered.
    pub(super) is_busy: Arc<AtomicBool>,
    /// What is being done for the client.
    pub(super) activity: Arc<Activity>,
    /// The address of the client.
    pub(super) peer: String,
}

enum Socket {
    Tcp(TcpStream),
    Unix(UnixStream),
}

impl AsFd for Socket {
    fn as_fd(&self) -> BorrowedFd<'_> {
        match self {
            Self::Tcp(stream) => stream.as_fd(),
            Self::Unix(stream) => stream.as_fd(),
        }
    }
}

impl AsFd for Handle {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }
}

impl Handle {
    /// Ends the connection, unless it is at work; then it ends by itself.
    pub(super) fn finish(&self) {
        if self.is_busy.load(Ordering::SeqCst) {
            return;
        }
        // It has ended already where that fails.
        let _ = match &self.socket {
            Socket::Tcp(stream) => stream.shutdown(Shutdown::Read),
            Socket::Unix(stream) => stream.shutdown(Shutdown::Read),
        };
    }
}

impl Stream {
    /// A connection over a port.
    pub(super) fn tcp(stream: TcpStream) -> io::Result<Self> {
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(IO_TIMEOUT))?;
        stream.set_write_timeout(Some(IO_TIMEOUT))?;
        Ok(Self::Tcp(stream))
    }

    /// A connection over a Unix socket.
    pub(super) fn unix(stream: UnixStream) -> io::Result<Self> {
        stream.set_read_timeout(Some(IO_TIMEOUT))?;
        stream.set_write_timeout(Some(IO_TIMEOUT))?;
        Ok(Self::Unix(stream))
    }

    /// What other threads may do to the connection of the client at an address.
    pub(super) fn handle(&self, peer: String) -> io::Result<Handle> {
        let socket = match self {
            Self::Tcp(stream) => Socket::Tcp(stream.try_clone()?),
            Self::Unix(stream) => Socket::Unix(stream.try_clone()?),
            Self::Tls(stream) => Socket::Tcp(stream.sock.try_clone()?),
        };
        Ok(Handle { socket, is_busy: Arc::default(), activity: Arc::default(), peer })
    }

    /// Whether bytes have been received that were not read yet.
    pub(super) fn has_received(&mut self) -> bool {
        match self {
            Self::Tcp(_) | Self::Unix(_) => false,
            Self::Tls(stream) => {
                stream.conn.process_new_packets().is_ok_and(|state| state.plaintext_bytes_to_read() > 0)
            }
        }
    }

    /// The name by which the client called this machine, if it sent one.
    pub(super) fn name(&self) -> Option<&str> {
        match self {
            Self::Tls(stream) => stream.conn.server_name(),
            Self::Tcp(_) | Self::Unix(_) => None,
        }
    }

    pub(super) fn descriptor(&self) -> BorrowedFd<'_> {
        match self {
            Self::Tcp(stream) => stream.as_fd(),
            Self::Unix(stream) => stream.as_fd(),
            Self::Tls(stream) => stream.sock.as_fd(),
        }
    }
}

impl Read for Stream {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Tcp(stream) => stream.read(bytes),
            Self::Unix(stream) => stream.read(bytes),
            Self::Tls(stream) => stream.read(bytes),
        }
    }
}

impl Write for Stream {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Tcp(stream) => stream.write(bytes),
            Self::Unix(stream) => stream.write(bytes),
            Self::Tls(stream) => stream.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => stream.flush(),
            Self::Unix(stream) => stream.flush(),
            Self::Tls(stream) => stream.flush(),
        }
    }
}
