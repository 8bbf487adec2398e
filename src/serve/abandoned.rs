//! Operations whose client is gone: nobody reads the answer any more, so that what only reads is stopped, as with MongoDB.
//! Writes go on to their end.

use std::os::fd::AsFd as _;
use std::sync::Arc;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::command;
use super::request::Request;
use super::server::Server;
use super::stream::Handle;
use crate::query::QueryError;

/// How often clients of operations are looked for, and how long an operation runs before they are.
const WATCH_INTERVAL: Duration = Duration::from_millis(250);

/// Stops what is done for clients that are gone, until the server ends.
pub(super) fn watch(server: &Server) {
    while !server.is_stopping() {
        std::thread::sleep(WATCH_INTERVAL);
        let has_stopped = server.connections(stop_abandoned);
        if has_stopped {
            server.hub.call();
        }
    }
}

/// Stops what only reads, and has run for a while, for clients that are gone; says whether there was any.
fn stop_abandoned(connections: &mut dyn Iterator<Item = (i64, &Handle)>) -> bool {
    let running = connections.filter_map(|(_, handle)| Some((handle, handle.activity.current()?)));
    let long: Vec<(&Handle, Arc<Request>)> = running
        .filter(|(_, request)| request.since.elapsed() >= WATCH_INTERVAL && command::only_reads(request))
        .collect();
    let mut clients: Vec<PollFd<'_>> =
        long.iter().map(|(handle, _)| PollFd::from_borrowed_fd(handle.as_fd(), PollFlags::RDHUP)).collect();
    // What cannot be looked at now is looked at the next time.
    if clients.is_empty() || poll(&mut clients, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })).is_err() {
        return false;
    }
    let gone = long.iter().zip(&clients).filter(|(_, client)| !client.revents().is_empty());
    gone.map(|((_, request), _)| request.stop.stop(QueryError::CLIENT_DISCONNECT)).count() > 0
}
