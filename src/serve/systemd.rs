//! Started by systemd: sockets that are open already, and saying when the server is ready.
//!
//! Protocols: sd_listen_fds(3), sd_notify(3).

use std::os::unix::net::UnixDatagram;

use listenfd::ListenFd;

use super::listener::{ListenError, Listener};
use super::tls::Tls;

/// The number of the first descriptor that systemd passes.
const FIRST: usize = 3;

/// The listeners that systemd has opened for this process.
///
/// # Errors
/// Where one of them cannot be used.
pub fn listeners(tls: Option<&Tls>) -> Result<Vec<Listener>, ListenError> {
    let mut sockets = ListenFd::from_env();
    let mut listeners = Vec::new();
    for index in 0..sockets.len() {
        if let Ok(Some(listener)) = sockets.take_tcp_listener(index) {
            listeners.push(Listener::of_tcp(listener, tls)?);
        } else if let Ok(Some(listener)) = sockets.take_unix_listener(index) {
            listeners.push(Listener::of_unix(listener)?.kept());
        } else {
            return Err(ListenError::Passed { descriptor: FIRST + index });
        }
    }
    Ok(listeners)
}

/// Sends a service manager, at its socket `NOTIFY_SOCKET`, a message like `READY=1`.
pub fn notify(socket: Option<&str>, state: &str) {
    let Some(name) = socket.filter(|name| !name.is_empty()) else { return };
    // Without a service manager there is nothing to do.
    let _ = send(name, state);
}

fn send(name: &str, state: &str) -> std::io::Result<()> {
    let socket = UnixDatagram::unbound()?;
    #[cfg(target_os = "linux")]
    if let Some(name) = name.strip_prefix('@') {
        use std::os::linux::net::SocketAddrExt as _;
        let address = std::os::unix::net::SocketAddr::from_abstract_name(name)?;
        return socket.send_to_addr(state.as_bytes(), &address).map(drop);
    }
    socket.send_to(state.as_bytes(), name).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_service_manager_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("notify");
        let manager = UnixDatagram::bind(&path).unwrap();
        notify(None, "READY=1");
        notify(path.to_str(), "READY=1");
        let mut message = [0; 64];
        let count = manager.recv(&mut message).unwrap();
        assert_eq!(&message[..count], b"READY=1");
    }
}
