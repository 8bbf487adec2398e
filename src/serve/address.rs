//! Where clients connect to.

use std::fmt;
use std::net::{IpAddr, SocketAddr, ToSocketAddrs as _};
use std::path::{Path, PathBuf};

use crate::fault::{AtFault, Fault};

/// MongoDB's port.
const PORT: u16 = 27_017;

/// Where clients connect to: a port of this machine, or a socket in the file system.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Address {
    /// An address and a port; 0 is any that is free.
    Tcp(SocketAddr),
    /// A Unix socket.
    Unix(PathBuf),
}

/// Why a text is not an address.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{text}` is not an address to listen on: {reason}; expected HOST:PORT, like 127.0.0.1:27017")]
pub struct AddressError {
    text: String,
    reason: String,
}

impl AtFault for AddressError {
    fn fault(&self) -> Fault {
        Fault::Usage
    }
}

impl Address {
    /// Reads `HOST`, `HOST:PORT` or `:PORT`; a name is looked up.
    ///
    /// # Errors
    /// Where it is none of these, or the name is not known.
    pub fn tcp(text: &str) -> Result<Self, AddressError> {
        let refuse = |reason: &str| AddressError { text: text.to_owned(), reason: reason.to_owned() };
        if let Ok(address) = text.parse::<SocketAddr>() {
            return Ok(Self::Tcp(address));
        }
        if let Ok(ip) = text.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>() {
            return Ok(Self::Tcp(SocketAddr::new(ip, PORT)));
        }
        let (host, port) = match text.rsplit_once(':') {
            Some((host, port)) => (host, port.parse().map_err(|_| refuse("the port is not a number up to 65535"))?),
            None => (text, PORT),
        };
        let host = if host.is_empty() { "127.0.0.1" } else { host };
        let found = (host, port).to_socket_addrs().ok().and_then(|mut found| found.next());
        found.map(Self::Tcp).ok_or_else(|| refuse("the name is not known"))
    }

    /// The default: MongoDB's port on this machine only.
    #[must_use]
    pub fn standard() -> Self {
        Self::Tcp(SocketAddr::from(([127, 0, 0, 1], PORT)))
    }

    /// Whether only processes of this machine reach it.
    #[must_use]
    pub fn is_local(&self) -> bool {
        match self {
            Self::Tcp(address) => address.ip().is_loopback(),
            Self::Unix(_) => true,
        }
    }

    /// The URI by which clients connect; `options` like `tls=true`. Where it is all addresses of this machine, that has the
    /// machine's name.
    #[must_use]
    pub fn uri(&self, options: &str) -> String {
        let separator = if options.is_empty() { "" } else { "?" };
        match self {
            Self::Tcp(address) if address.ip().is_unspecified() => {
                let name = rustix::system::uname();
                let name = name.nodename().to_string_lossy();
                format!("mongodb://{name}:{}/{separator}{options}", address.port())
            }
            Self::Tcp(address) => format!("mongodb://{address}/{separator}{options}"),
            Self::Unix(path) => format!("mongodb://{}/{separator}{options}", escaped(path)),
        }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Tcp(address) => address.fmt(f),
            Self::Unix(path) => path.display().fmt(f),
        }
    }
}

/// A path as the host of a URI.
fn escaped(path: &Path) -> String {
    use std::os::unix::ffi::OsStrExt as _;
    let escape = |byte: &u8| match byte {
        b'.' | b'-' | b'_' | b'~' | b'0'..=b'9' | b'A'..=b'Z' | b'a'..=b'z' => char::from(*byte).to_string(),
        byte => format!("%{byte:02X}"),
    };
    path.as_os_str().as_bytes().iter().map(escape).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_addresses_are_named_as_one_that_a_client_can_reach() {
        let name = rustix::system::uname().nodename().to_string_lossy().into_owned();
        for all in ["0.0.0.0:27018", "[::]:27018"] {
            let uri = Address::tcp(all).unwrap().uri("tls=true");
            assert_eq!(uri, format!("mongodb://{name}:27018/?tls=true"));
        }
        assert_eq!(Address::standard().uri(""), "mongodb://127.0.0.1:27017/");
    }

    #[test]
    fn addresses_are_read_with_and_without_a_port() {
        let shown = |text: &str| Address::tcp(text).map(|address| address.to_string());
        assert_eq!(shown("127.0.0.1").unwrap(), "127.0.0.1:27017");
        assert_eq!(shown(":0").unwrap(), "127.0.0.1:0");
        assert_eq!(shown("[::1]:5").unwrap(), "[::1]:5");
        assert_eq!(shown("::1").unwrap(), "[::1]:27017");
        assert!(shown("127.0.0.1:x").is_err() && shown("127.0.0.1:70000").is_err());
    }

    #[test]
    fn only_loopback_and_sockets_are_local() {
        let is_local = |text: &str| Address::tcp(text).unwrap().is_local();
        assert!(is_local("127.0.0.1:1") && is_local("[::1]:1"));
        assert!(!is_local("0.0.0.0:1") && !is_local("[::]:1") && !is_local("192.168.0.1:1"));
        assert!(Address::Unix("/tmp/x.sock".into()).is_local());
    }

    #[test]
    fn the_path_of_a_socket_is_escaped_in_its_uri() {
        assert_eq!(Address::Unix("/tmp/a b.sock".into()).uri(""), "mongodb://%2Ftmp%2Fa%20b.sock/");
    }
}
