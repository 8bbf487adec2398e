//! What runs: each member of each set, its state, how far behind it is, how long it may be away.

use std::time::Duration;

use super::{BackendError, process};
use crate::settings::backend::Backend;
use crate::store::mongodb::admin::{Admin, MemberState};

/// How long a member may take to answer.
const ANSWER: Duration = Duration::from_secs(2);

/// A member of a replica set, as it is now.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Row {
    /// `local` or `shared`.
    pub backend: &'static str,
    /// The replica set.
    pub set: String,
    /// `host:port`.
    pub member: String,
    /// Whether it is this robot's own.
    pub own: bool,
    /// `PRIMARY`, `SECONDARY`, `STARTUP2`, …; `DOWN` where it does not answer, `NEW` where it
    /// runs and is not in the set yet.
    pub state: String,
    /// How many seconds its last change is behind the primary's.
    pub lag: Option<i64>,
    /// How many seconds of changes its operations log has.
    pub oplog: Option<u32>,
    /// The version of its mongod.
    pub version: Option<String>,
    /// The process id of this robot's own.
    pub pid: Option<i64>,
}

impl Row {
    /// Whether it does its work.
    #[must_use]
    pub fn is_up(&self) -> bool {
        matches!(self.state.as_str(), "PRIMARY" | "SECONDARY" | "ARBITER")
    }
}

/// The members of a backend's set: those that the settings have, then those that only the set has.
///
/// # Errors
/// Where something else has this robot's port.
pub fn status(backend: &Backend) -> Result<Vec<Row>, BackendError> {
    let data = std::fs::canonicalize(&backend.path).unwrap_or_else(|_| backend.path.clone());
    let running = process::look(backend, &data)?;
    let address = backend.address();
    let asked = running.iter().map(|_| &address).chain(&backend.members);
    let states = asked.filter_map(|host| Some((host, Admin::at(host, ANSWER).ok()?.members().ok()??))).next();
    let (asked, states) = states.map_or((None, Vec::new()), |(host, states)| (Some(host), states));
    let own = match states.iter().find(|state| state.is_asked && asked == Some(&address)) {
        Some(state) => Some(state.name.clone()),
        None => own_name(backend),
    };
    let mut names = backend.members.clone();
    names.extend(states.iter().map(|state| state.name.clone()).filter(|name| !backend.members.contains(name)));
    let newest = states.iter().find(|state| state.state == "PRIMARY").and_then(|state| state.reached);
    let row = |name: &String| {
        let is_own = own.as_ref() == Some(name);
        let address = if is_own { &address } else { name };
        let known = states.iter().find(|state| state.name == *name);
        let mut row = row(backend, name, address, known, newest);
        row.own = is_own;
        row.pid = running.filter(|_| is_own).and_then(|running| running.pid);
        row
    };
    Ok(std::thread::scope(|scope| {
        let rows: Vec<_> = names.iter().map(|name| scope.spawn(|| row(name))).collect();
        rows.into_iter().filter_map(|row| row.join().ok()).collect()
    }))
}

/// Which of the configured members is this robot's own, where that is plain: the only one with its port.
fn own_name(backend: &Backend) -> Option<String> {
    let port = format!(":{}", backend.port);
    let mut with_port = backend.members.iter().filter(|member| member.ends_with(&port));
    let name = with_port.next()?;
    with_port.next().is_none().then(|| name.clone())
}

fn row(backend: &Backend, name: &str, address: &str, known: Option<&MemberState>, newest: Option<i64>) -> Row {
    let admin = Admin::at(address, ANSWER).ok();
    let version = admin.as_ref().and_then(|admin| admin.version().ok());
    let state = match (known, &version) {
        (_, None) => "DOWN".to_owned(),
        (Some(known), Some(_)) => known.state.clone(),
        (None, Some(_)) => "NEW".to_owned(),
    };
    let up = admin.filter(|_| version.is_some());
    Row {
        backend: backend.name,
        set: backend.replica_set.clone(),
        member: name.to_owned(),
        own: false,
        lag: known.filter(|_| up.is_some()).and_then(|known| Some((newest? - known.reached?).max(0))),
        oplog: up.and_then(|admin| admin.oplog_window().ok().flatten()),
        state,
        version,
        pid: None,
    }
}
