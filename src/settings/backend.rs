//! `[backend.local]` and `[backend.shared]` of `rmem.toml`: the mongod processes of this robot.

use std::collections::BTreeSet;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::Deserialize;
use toml::Spanned;

use super::quoted::Mistake;
use crate::formats::quantity;

/// A mongod's cache cannot be smaller.
const SMALLEST_CACHE: u64 = 256 << 20;
/// How long a starting process may neither listen nor write to its log, where nothing else is set.
const START_TIMEOUT: Duration = Duration::from_secs(20);
/// How long a process has to end, where nothing else is set.
const STOP_TIMEOUT: Duration = Duration::from_secs(60);
/// The arguments that other keys give.
const GIVEN: [(&str, &str); 12] = [
    ("--port", "port"),
    ("--dbpath", "path"),
    ("--bind_ip", "bind"),
    ("--bind_ip_all", "bind"),
    ("--replSet", "replica_set"),
    ("--oplogSize", "oplog_size"),
    ("--wiredTigerCacheSizeGB", "cache_size"),
    ("--logpath", "log"),
    ("--logappend", "log_append"),
    ("--fork", "path"),
    ("--config", "arguments"),
    ("-f", "arguments"),
];
/// A replica set has at most so many members that vote.
const VOTERS: usize = 7;

/// The settings of one of this robot's mongod processes.
#[derive(Debug, Clone, PartialEq)]
pub struct Backend {
    /// `local` or `shared`: which table it is from.
    pub name: &'static str,
    /// The program: a path, or a name on PATH.
    pub mongod: PathBuf,
    /// The TCP port.
    pub port: u16,
    /// The addresses it listens on, in the form of mongod's `--bind_ip`.
    pub bind: String,
    /// The folder of its data; log and pid file are beside it.
    pub path: PathBuf,
    /// The name of its replica set (default: the table's name).
    pub replica_set: String,
    /// `host:port` of all members of the set, this one among them.
    pub members: Vec<String>,
    /// Size of the operations log, in bytes (default: mongod's own).
    pub oplog_size: Option<u64>,
    /// Size of the cache, in bytes (default: mongod's own).
    pub cache_size: Option<u64>,
    /// The log of the process (default: beside the folder of its data).
    pub log: Option<PathBuf>,
    /// Whether the log of an earlier run is kept.
    pub log_append: bool,
    /// Further arguments of the program.
    pub arguments: Vec<String>,
    /// How long a starting process may neither listen nor write to its log.
    pub start_timeout: Duration,
    /// How long a process has to end.
    pub stop_timeout: Duration,
    /// Whether the data is removed once the process is stopped.
    pub clear_on_stop: bool,
}

/// The tables in the file.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Tables {
    local: Option<Table>,
    shared: Option<Table>,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    port: Spanned<u16>,
    path: Spanned<String>,
    mongod: Option<Spanned<String>>,
    bind: Option<Spanned<String>>,
    replica_set: Option<Spanned<String>>,
    members: Option<Spanned<Vec<Spanned<String>>>>,
    oplog_size: Option<Spanned<String>>,
    cache_size: Option<Spanned<String>>,
    log: Option<Spanned<String>>,
    log_append: Option<bool>,
    #[serde(default)]
    arguments: Vec<Spanned<String>>,
    start_timeout: Option<Spanned<String>>,
    stop_timeout: Option<Spanned<String>>,
    #[serde(default)]
    clear_on_stop: bool,
}

impl Tables {
    fn named(&self) -> impl Iterator<Item = (&'static str, &Table)> {
        [("local", &self.local), ("shared", &self.shared)]
            .into_iter()
            .filter_map(|(name, table)| table.as_ref().map(|table| (name, table)))
    }

    /// Checks what types cannot express; an error is the first mistake.
    pub(super) fn check(&self) -> Result<(), Mistake> {
        for (_, table) in self.named() {
            table.check()?;
        }
        if let (Some(local), Some(shared)) = (&self.local, &self.shared) {
            if local.port.get_ref() == shared.port.get_ref() {
                return Err((shared.port.span(), "both backends have this port; give each its own".to_owned()));
            }
            if local.path.get_ref() == shared.path.get_ref() {
                return Err((shared.path.span(), "both backends have this folder; give each its own".to_owned()));
            }
        }
        Ok(())
    }

    /// Returns the processes; relative paths are relative to `folder`.
    pub(super) fn resolve(&self, folder: &Path) -> Vec<Backend> {
        self.named().map(|(name, table)| table.resolve(name, folder)).collect()
    }
}

impl Table {
    fn check(&self) -> Result<(), Mistake> {
        if *self.port.get_ref() == 0 {
            return Err((self.port.span(), "expected a port from 1 to 65535".to_owned()));
        }
        let texts = [Some(&self.path), self.mongod.as_ref(), self.bind.as_ref(), self.log.as_ref()];
        for text in texts.into_iter().flatten().chain(&self.arguments) {
            if text.get_ref().trim().is_empty() {
                return Err((text.span(), "expected a text, found an empty one".to_owned()));
            }
        }
        if let Some(name) = &self.replica_set {
            let wrong = |c: char| c.is_whitespace() || c.is_control() || "/?&,".contains(c);
            if name.get_ref().is_empty() || name.get_ref().contains(wrong) {
                return Err((name.span(), "expected the name of a replica set, e.g. shared".to_owned()));
            }
        }
        for (size, least) in [(&self.oplog_size, 1 << 20), (&self.cache_size, SMALLEST_CACHE)] {
            let Some(size) = size else { continue };
            let bytes = quantity::size(size.get_ref()).map_err(|message| (size.span(), message))?;
            if bytes < least {
                return Err((size.span(), format!("expected at least {}M", least >> 20)));
            }
        }
        for argument in &self.arguments {
            let name = argument.get_ref().split('=').next().unwrap_or_default();
            if let Some((_, key)) = GIVEN.iter().find(|(given, _)| *given == name) {
                let instead = match *key {
                    "arguments" => "write the arguments themselves".to_owned(),
                    _ if name == "--fork" => "rmem gives it".to_owned(),
                    key => format!("use the key `{key}`"),
                };
                return Err((argument.span(), format!("`{name}` cannot be given here; {instead}")));
            }
        }
        for timeout in [&self.start_timeout, &self.stop_timeout].into_iter().flatten() {
            quantity::duration(timeout.get_ref()).map_err(|message| (timeout.span(), message))?;
        }
        self.members.as_ref().map_or(Ok(()), |members| self.check_members(members))
    }

    fn check_members(&self, members: &Spanned<Vec<Spanned<String>>>) -> Result<(), Mistake> {
        let mut seen = BTreeSet::new();
        for member in members.get_ref() {
            let name = member.get_ref();
            let parts = name.rsplit_once(':').filter(|(host, _)| !host.is_empty() && !host.contains(['/', '@', ' ']));
            if parts.and_then(|(_, port)| port.parse::<u16>().ok()).is_none_or(|port| port == 0) {
                return Err((
                    member.span(),
                    format!("expected a member as HOST:PORT, e.g. robot1:27021, found `{name}`"),
                ));
            }
            if !seen.insert(name) {
                return Err((member.span(), format!("`{name}` is given twice")));
            }
        }
        if members.get_ref().len() > VOTERS {
            return Err((members.span(), format!("a replica set has {VOTERS} members at most")));
        }
        let port = *self.port.get_ref();
        if !members.get_ref().iter().any(|member| port_of(member.get_ref()) == Some(port)) {
            let message =
                format!("no member has the port {port} of this backend; list all members, this robot among them");
            return Err((members.span(), message));
        }
        Ok(())
    }

    fn resolve(&self, name: &'static str, folder: &Path) -> Backend {
        let text = |value: &Option<Spanned<String>>| value.as_ref().map(|value| value.get_ref().clone());
        let size = |value: &Option<Spanned<String>>| text(value).and_then(|text| quantity::size(&text).ok());
        let time = |value: &Option<Spanned<String>>| text(value).and_then(|text| quantity::duration(&text).ok());
        let port = *self.port.get_ref();
        let members: Vec<String> = match &self.members {
            Some(members) if !members.get_ref().is_empty() => {
                members.get_ref().iter().map(|member| member.get_ref().clone()).collect()
            }
            _ => vec![format!("127.0.0.1:{port}")],
        };
        let mongod = text(&self.mongod).unwrap_or_else(|| "mongod".to_owned());
        Backend {
            name,
            mongod: if mongod.contains('/') { folder.join(mongod) } else { mongod.into() },
            port,
            bind: text(&self.bind).unwrap_or_else(|| reach(&members).to_owned()),
            path: folder.join(self.path.get_ref()),
            replica_set: text(&self.replica_set).unwrap_or_else(|| name.to_owned()),
            members,
            oplog_size: size(&self.oplog_size),
            cache_size: size(&self.cache_size),
            log: text(&self.log).map(|log| folder.join(log)),
            log_append: self.log_append.unwrap_or(true),
            arguments: self.arguments.iter().map(|argument| argument.get_ref().clone()).collect(),
            start_timeout: time(&self.start_timeout).unwrap_or(START_TIMEOUT),
            stop_timeout: time(&self.stop_timeout).unwrap_or(STOP_TIMEOUT),
            clear_on_stop: self.clear_on_stop,
        }
    }
}

/// Returns the address to listen on so that the members reach each other.
fn reach(members: &[String]) -> &'static str {
    let is_here = |member: &String| is_loopback(member.rsplit_once(':').map_or(member.as_str(), |(host, _)| host));
    if members.iter().all(is_here) { "127.0.0.1" } else { "0.0.0.0" }
}

/// Whether only this machine reaches an address.
fn is_loopback(host: &str) -> bool {
    host == "localhost" || host.parse().is_ok_and(|address: IpAddr| address.is_loopback())
}

fn port_of(member: &str) -> Option<u16> {
    member.rsplit_once(':').and_then(|(_, port)| port.parse().ok())
}

impl Backend {
    /// Returns the address at which this machine reaches the process, `host:port`.
    #[must_use]
    pub fn address(&self) -> String {
        let first = self.bind.split(',').map(str::trim).next().unwrap_or_default();
        let everywhere = IpAddr::from(Ipv4Addr::LOCALHOST);
        match first.parse::<IpAddr>() {
            Ok(host) if host.is_unspecified() => SocketAddr::new(everywhere, self.port).to_string(),
            Ok(host) => SocketAddr::new(host, self.port).to_string(),
            Err(_) if ["", "*", "localhost"].contains(&first) => SocketAddr::new(everywhere, self.port).to_string(),
            Err(_) => format!("{first}:{}", self.port),
        }
    }

    /// Whether other machines can reach it.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.bind.split(',').map(str::trim).any(|host| !is_loopback(host))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_address_of_a_backend_is_one_of_this_machine_and_open_where_others_reach_it() {
        for (bind, address, is_open) in [
            ("127.0.0.1", "127.0.0.1:27017", false),
            ("localhost,10.0.0.5", "127.0.0.1:27017", true),
            ("0.0.0.0", "127.0.0.1:27017", true),
            ("::1", "[::1]:27017", false),
            ("::1, 127.0.0.1", "[::1]:27017", false),
            ("::", "127.0.0.1:27017", true),
            ("fe80::1", "[fe80::1]:27017", true),
            ("robot1", "robot1:27017", true),
            ("127.example.org", "127.example.org:27017", true),
        ] {
            let tables: Tables =
                toml::from_str(&format!("local = {{ port = 27017, path = 'd', bind = '{bind}' }}")).unwrap();
            let backend = &tables.resolve(Path::new("/"))[0];
            assert_eq!((backend.address().as_str(), backend.is_open()), (address, is_open), "{bind}");
        }
    }
}
