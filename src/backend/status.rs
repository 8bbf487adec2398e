//! The state of the members of a set: role, lag, oplog window, version.

use std::time::Duration;

use super::error::BackendError;
use super::process;
use crate::settings::backend::Backend;
use crate::store::mongodb::admin::{Admin, MemberState};

/// How long a member may take to answer.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(2);

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

/// The members of a backend's set.
#[derive(Debug)]
pub struct Status {
    /// Those that the settings have, then those that only the set has.
    pub rows: Vec<Row>,
    /// Why this robot's own member cannot be asked: it does not answer, or something else has its port.
    pub problem: Option<BackendError>,
}

/// Asks the members of a backend's set.
#[must_use]
pub fn status(backend: &Backend) -> Status {
    let data = std::fs::canonicalize(&backend.path).unwrap_or_else(|_| backend.path.clone());
    let (running, problem) = match process::look(backend, &data, process::ANSWER_TIMEOUT) {
        Ok(running) => (running, None),
        Err(error) => (None, Some(error)),
    };
    let address = backend.address();
    let own = running.iter().map(|_| address.as_str());
    let unasked = problem.as_ref().and_then(|_| own_name(backend));
    let members = backend.members.iter().map(String::as_str).filter(|name| unasked.as_deref() != Some(*name));
    let mut answers = ask(own.chain(members));
    let states = answers.iter().find_map(|(host, answer)| Some((host.clone(), answer.members.clone()?)));
    let (asked, states) = states.map_or((None, Vec::new()), |(host, states)| (Some(host), states));
    let own = match states.iter().find(|state| state.is_asked && asked.as_ref() == Some(&address)) {
        Some(state) => Some(state.name.clone()),
        None => own_name(backend),
    };
    let mut names = backend.members.clone();
    names.extend(states.iter().map(|state| state.name.clone()).filter(|name| !backend.members.contains(name)));
    let is_asked = |name: &&str| answers.iter().any(|(host, _)| host == name) || own.as_deref() == Some(*name);
    let others: Vec<&str> = names.iter().map(String::as_str).filter(|name| !is_asked(name)).collect();
    let more = ask(others.into_iter());
    answers.extend(more);
    let newest = states.iter().find(|state| state.state == "PRIMARY").and_then(|state| state.reached);
    let row = |name: &String| {
        let is_own = own.as_ref() == Some(name);
        let host = if is_own && running.is_some() { &address } else { name };
        let answer = answers.iter().find(|(other, _)| other == host).map(|(_, answer)| answer);
        let known = states.iter().find(|state| state.name == *name);
        let mut row = row(backend, name, answer, known, newest);
        row.own = is_own;
        row.pid = running.filter(|_| is_own).and_then(|running| running.pid);
        row
    };
    Status { rows: names.iter().map(row).collect(), problem }
}

/// The answer of a member.
#[derive(Debug, Default)]
struct Answer {
    version: Option<String>,
    members: Option<Vec<MemberState>>,
    oplog: Option<u32>,
}

/// Asks all at once: a member that is down takes the whole timeout.
fn ask<'a>(hosts: impl Iterator<Item = &'a str>) -> Vec<(String, Answer)> {
    std::thread::scope(|scope| {
        let asked: Vec<_> = hosts.map(|host| (host, scope.spawn(|| answer(host)))).collect();
        asked.into_iter().map(|(host, answer)| (host.to_owned(), answer.join().unwrap_or_default())).collect()
    })
}

fn answer(host: &str) -> Answer {
    let Ok(admin) = Admin::at(host, ANSWER_TIMEOUT) else { return Answer::default() };
    let Ok(version) = admin.version() else { return Answer::default() };
    Answer {
        version: Some(version),
        members: admin.members().ok().flatten(),
        oplog: admin.oplog_window().ok().flatten(),
    }
}

/// Which of the configured members is this robot's own, where that is plain: the only one with its port.
fn own_name(backend: &Backend) -> Option<String> {
    let port = format!(":{}", backend.port);
    let mut with_port = backend.members.iter().filter(|member| member.ends_with(&port));
    let name = with_port.next()?;
    with_port.next().is_none().then(|| name.clone())
}

fn row(
    backend: &Backend,
    name: &str,
    answer: Option<&Answer>,
    known: Option<&MemberState>,
    newest: Option<i64>,
) -> Row {
    let up = answer.filter(|answer| answer.version.is_some());
    let state = match (known, up) {
        (_, None) => "DOWN".to_owned(),
        (Some(known), Some(_)) => known.state.clone(),
        (None, Some(_)) => "NEW".to_owned(),
    };
    Row {
        backend: backend.name,
        set: backend.replica_set.clone(),
        member: name.to_owned(),
        own: false,
        lag: known.filter(|_| up.is_some()).and_then(|known| Some((newest? - known.reached?).max(0))),
        oplog: up.and_then(|answer| answer.oplog),
        state,
        version: up.and_then(|answer| answer.version.clone()),
        pid: None,
    }
}
