//! Administration of one server: its state, and the replica set it belongs to.

use std::path::PathBuf;
use std::time::Duration;

use bson::{Bson, Document, Timestamp, doc};
use mongodb::error::ErrorKind;
use mongodb::options::{ClientOptions, ReadPreference, SelectionCriteria, ServerAddress};
use mongodb::sync::Client;

use super::failure;
use crate::saturate::to_i64;
use crate::store::StoreError;

/// A connection to one server, whatever its role in a replica set.
pub struct Admin {
    client: Client,
    address: String,
}

/// Why a server did not do what it was asked.
#[derive(Debug, thiserror::Error)]
pub enum AdminError {
    /// It does not answer.
    #[error(transparent)]
    Silent(StoreError),
    /// It refuses.
    #[error("{address}: {message} (code {code})")]
    Refused {
        /// Which server.
        address: String,
        /// The server's code.
        code: i32,
        /// The server's words.
        message: String,
    },
}

/// The role of a server in a replica set, as it reports it.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Hello {
    /// The set's name, once the server is a member of one.
    pub set: Option<String>,
    /// The primary, as far as the server knows: `host:port`.
    pub primary: Option<String>,
    /// It takes writes.
    pub is_primary: bool,
    /// It has a copy that can be read.
    pub is_secondary: bool,
}

/// How a server was started.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Started {
    /// The folder of its data.
    pub data: Option<PathBuf>,
    /// Where it writes its log.
    pub log: Option<PathBuf>,
    /// The name of the replica set it is for.
    pub set: Option<String>,
}

/// What the set knows of one of its members.
#[derive(Debug, Clone, PartialEq)]
pub struct MemberState {
    /// `host:port`.
    pub name: String,
    /// `PRIMARY`, `SECONDARY`, `STARTUP2`, …
    pub state: String,
    /// The time of the last change it has, in seconds since 1970; `None` before the first.
    pub reached: Option<i64>,
    /// Whether it is the server that was asked.
    pub is_asked: bool,
}

impl Admin {
    /// The server at `host:port`; nothing is contacted before the first question,
    /// and then it has `timeout` to answer.
    ///
    /// # Errors
    /// Where this is not an address.
    pub fn at(address: &str, timeout: Duration) -> Result<Self, AdminError> {
        let silent = |error: &mongodb::error::Error| AdminError::Silent(failure::explain(address, error));
        let host = ServerAddress::parse(address).map_err(|error| silent(&error))?;
        let mut options = ClientOptions::builder().hosts(vec![host]).build();
        options.direct_connection = Some(true);
        options.app_name = Some("rmem".to_owned());
        options.server_selection_timeout = Some(timeout);
        options.connect_timeout = Some(timeout);
        options.selection_criteria = Some(criteria());
        let client = Client::with_options(options).map_err(|error| silent(&error))?;
        Ok(Self { client, address: address.to_owned() })
    }

    /// `host:port`.
    #[must_use]
    pub fn address(&self) -> &str {
        &self.address
    }

    fn run(&self, database: &str, command: Document) -> Result<Document, AdminError> {
        let answer = self.client.database(database).run_command(command).selection_criteria(criteria()).run();
        answer.map_err(|error| match error.kind.as_ref() {
            ErrorKind::Command(refusal) => AdminError::Refused {
                address: self.address.clone(),
                code: refusal.code,
                message: refusal.message.clone(),
            },
            _ => AdminError::Silent(failure::explain(&self.address, &error)),
        })
    }

    /// Its place in a replica set.
    ///
    /// # Errors
    /// Where it does not answer.
    pub fn hello(&self) -> Result<Hello, AdminError> {
        let hello = self.run("admin", doc! { "hello": 1 })?;
        let text = |key: &str| hello.get_str(key).ok().map(str::to_owned);
        let flag = |key: &str| hello.get_bool(key).unwrap_or(false);
        let set = text("setName");
        Ok(Hello {
            is_primary: set.is_some() && flag("isWritablePrimary"),
            is_secondary: set.is_some() && flag("secondary"),
            primary: text("primary"),
            set,
        })
    }

    /// How it was started.
    ///
    /// # Errors
    /// Where it does not answer, or wants a login.
    pub fn started(&self) -> Result<Started, AdminError> {
        let options = self.run("admin", doc! { "getCmdLineOpts": 1 })?;
        let parsed = options.get_document("parsed").cloned().unwrap_or_default();
        let option = |group: &str, key: &str| {
            parsed.get_document(group).and_then(|group| group.get_str(key)).ok().map(str::to_owned)
        };
        Ok(Started {
            data: option("storage", "dbPath").map(PathBuf::from),
            log: option("systemLog", "path").map(PathBuf::from),
            set: option("replication", "replSet").or_else(|| option("replication", "replSetName")),
        })
    }

    /// Its process id.
    ///
    /// # Errors
    /// Where it does not answer, or wants a login.
    pub fn pid(&self) -> Result<Option<i64>, AdminError> {
        let sections = doc! { "serverStatus": 1, "repl": 0, "metrics": 0, "locks": 0, "wiredTiger": 0, "tcmalloc": 0 };
        Ok(self.run("admin", sections)?.get("pid").and_then(integer))
    }

    /// Its version.
    ///
    /// # Errors
    /// Where it does not answer.
    pub fn version(&self) -> Result<String, AdminError> {
        Ok(self.run("admin", doc! { "buildInfo": 1 })?.get_str("version").unwrap_or_default().to_owned())
    }

    /// The seconds between the oldest and the newest change in its operations log.
    ///
    /// # Errors
    /// Where it does not answer, or has no log yet.
    pub fn oplog_window(&self) -> Result<Option<u32>, AdminError> {
        let (oldest, newest) = (self.change(1)?, self.change(-1)?);
        Ok(oldest.zip(newest).map(|(oldest, newest)| newest.time.saturating_sub(oldest.time)))
    }

    /// The time of the first change of the log in an order.
    fn change(&self, order: i32) -> Result<Option<Timestamp>, AdminError> {
        let find = doc! { "find": "oplog.rs", "sort": { "$natural": order }, "limit": 1, "projection": { "ts": 1 } };
        let found = self.run("local", find)?;
        let first = found.get_document("cursor").and_then(|cursor| cursor.get_array("firstBatch")).ok();
        let first = first.and_then(|batch| batch.first()).and_then(Bson::as_document);
        Ok(first.and_then(|change| change.get_timestamp("ts").ok()))
    }

    /// The configuration of its replica set; `None` where it has none yet.
    ///
    /// # Errors
    /// Where it does not answer.
    pub fn configuration(&self) -> Result<Option<Document>, AdminError> {
        match self.run("admin", doc! { "replSetGetConfig": 1 }) {
            Ok(answer) => Ok(answer.get_document("config").ok().cloned()),
            Err(AdminError::Refused { .. }) => Ok(None),
            Err(silent) => Err(silent),
        }
    }

    /// Founds a replica set of these members, all of which have to answer.
    ///
    /// # Errors
    /// Where it does not answer, or refuses.
    pub fn initiate(&self, set: &str, members: &[&str]) -> Result<(), AdminError> {
        let members = members.iter().zip(0..).map(|(host, id)| doc! { "_id": id, "host": *host });
        let config = doc! { "_id": set, "members": members.collect::<Vec<_>>() };
        self.run("admin", doc! { "replSetInitiate": config }).map(|_| ())
    }

    /// Returns the set another configuration; with `force`, also where the server is not its primary.
    ///
    /// # Errors
    /// Where it does not answer, or refuses.
    pub fn reconfigure(&self, config: Document, force: bool) -> Result<(), AdminError> {
        self.run("admin", doc! { "replSetReconfig": config, "force": force }).map(|_| ())
    }

    /// What the server knows of the members of its set; `None` where it belongs to none.
    ///
    /// # Errors
    /// Where it does not answer.
    pub fn members(&self) -> Result<Option<Vec<MemberState>>, AdminError> {
        let status = match self.run("admin", doc! { "replSetGetStatus": 1 }) {
            Ok(status) => status,
            Err(AdminError::Refused { .. }) => return Ok(None),
            Err(silent) => return Err(silent),
        };
        let members = status.get_array("members").map(Vec::as_slice).unwrap_or_default();
        let member = |member: &Document| MemberState {
            name: member.get_str("name").unwrap_or_default().to_owned(),
            state: member.get_str("stateStr").unwrap_or_default().to_owned(),
            reached: member
                .get_datetime("optimeDate")
                .ok()
                .map(|date| date.timestamp_millis().div_euclid(1000))
                .filter(|seconds| *seconds > 0),
            is_asked: member.get_bool("self").unwrap_or(false),
        };
        Ok(Some(members.iter().filter_map(Bson::as_document).map(member).collect()))
    }

    /// How many members of its set vote: one that was added does so only once it has a copy.
    ///
    /// # Errors
    /// Where it does not answer, or belongs to no set.
    pub fn voters(&self) -> Result<usize, AdminError> {
        let status = self.run("admin", doc! { "replSetGetStatus": 1 })?;
        let count = status.get("votingMembersCount").and_then(integer).unwrap_or_default();
        Ok(usize::try_from(count).unwrap_or_default())
    }

    /// Asks the server to end, handing over to another member where there is one.
    ///
    /// # Errors
    /// Where it refuses. That it does not answer any more is what was asked for.
    pub fn shut_down(&self, grace: Duration) -> Result<(), AdminError> {
        let seconds = to_i64(grace.as_secs());
        match self.run("admin", doc! { "shutdown": 1, "force": true, "timeoutSecs": seconds }) {
            Ok(_) | Err(AdminError::Silent(_)) => Ok(()),
            Err(refused) => Err(refused),
        }
    }
}

impl From<AdminError> for StoreError {
    fn from(error: AdminError) -> Self {
        match error {
            AdminError::Silent(error) => error,
            AdminError::Refused { address, code, message } => {
                Self::Failed { address, reason: format!("{message} (code {code})") }
            }
        }
    }
}

/// Any server will do: there is only the one.
fn criteria() -> SelectionCriteria {
    SelectionCriteria::ReadPreference(ReadPreference::nearest(None))
}

fn integer(value: &Bson) -> Option<i64> {
    match value {
        Bson::Int32(number) => Some((*number).into()),
        Bson::Int64(number) => Some(*number),
        #[expect(clippy::cast_possible_truncation, reason = "process ids are small")]
        Bson::Double(number) => Some(*number as i64),
        _ => None,
    }
}
