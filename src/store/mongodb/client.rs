//! The connection: its time limits, what a write waits for, where reads go.

use std::sync::mpsc;
use std::time::Duration;

use bson::{Document, RawDocumentBuf, doc};
use mongodb::options::{
    Acknowledgment, ClientOptions, CollectionOptions, DatabaseOptions, ReadConcern, ReadPreference, SelectionCriteria,
    WriteConcern,
};
use mongodb::sync::{Client, Collection, Database};

use super::write_policy::WritePolicy;
use super::{MongoDb, failure};
use crate::formats::credentials;
use crate::store::uri::Role;
use crate::store::{Namespace, StoreError};

/// How long the driver looks for a server, unless the URI sets it.
const SELECTION_TIMEOUT: Duration = Duration::from_secs(4);
/// How often the driver checks a server, unless the URI sets it. Where it does not answer within this and
/// [`SELECTION_TIMEOUT`], the driver ends the operations that wait for it.
const HEARTBEAT_INTERVAL: Duration = Duration::from_secs(2);
/// How long a write waits for a majority, unless the URI sets it.
const MAJORITY_TIMEOUT: Duration = Duration::from_secs(10);

impl MongoDb {
    /// A store over the server or replica set at `uri`; `address` is what messages call it.
    ///
    /// # Errors
    /// Where the driver does not accept the URI, or (`mongodb+srv`) the name does not resolve.
    pub fn open(uri: &str, address: String, role: Role) -> Result<Self, StoreError> {
        let options = completed(parse(uri, &address)?, role);
        let policy = WritePolicy::new(options.write_concern.clone().unwrap_or_default(), role == Role::Shared);
        let client = Client::with_options(options).map_err(|e| failure::explain(&address, &e))?;
        Ok(Self::new(client, address, policy))
    }

    fn new(client: Client, address: String, write_policy: WritePolicy) -> Self {
        let (decaying, collations, identities, keeping, version, is_bypassing) = Default::default();
        Self { client, decaying, collations, identities, keeping, version, is_bypassing, write_policy, address }
    }

    /// The same, whose writes the primary alone confirms: for what belongs to a write for whose confirmation was waited
    /// already.
    pub(super) fn without_majority(&self) -> Self {
        let own = WriteConcern::builder().w(Acknowledgment::Nodes(1)).journal(true).build();
        Self::new(self.client.clone(), self.address.clone(), WritePolicy::new(own, false))
    }

    pub(super) fn collection(&self, ns: &Namespace) -> Collection<RawDocumentBuf> {
        let options = CollectionOptions::builder().write_concern(self.write_policy.of_one()).build();
        self.client.database(&ns.database).collection_with_options(&ns.collection, options)
    }

    /// The database, with the write concern of [`MongoDb::collection`].
    pub(super) fn database(&self, ns: &Namespace) -> Database {
        let options = DatabaseOptions::builder().write_concern(self.write_policy.of_one()).build();
        self.client.database_with_options(&ns.database, options)
    }

    /// The collection as the primary has it, whatever the URI says of reads.
    pub(super) fn on_primary<T: Send + Sync>(&self, ns: &Namespace) -> Collection<T> {
        let options = CollectionOptions::builder()
            .selection_criteria(SelectionCriteria::ReadPreference(ReadPreference::Primary))
            .read_concern(ReadConcern::local())
            .build();
        self.client.database(&ns.database).collection_with_options(&ns.collection, options)
    }

    pub(super) fn client(&self) -> &Client {
        &self.client
    }

    /// What the server says of itself.
    pub(super) fn hello(&self) -> mongodb::error::Result<Document> {
        self.client.database("admin").run_command(doc! { "hello": 1 }).run()
    }

    pub(super) fn fail(&self, reason: &str) -> StoreError {
        StoreError::Failed { address: self.address.clone(), reason: reason.to_owned() }
    }

    pub(super) fn explain(&self, error: &mongodb::error::Error) -> StoreError {
        failure::explain(&self.address, error)
    }
}

/// The options of the URI, completed with rmem's defaults.
fn completed(mut options: ClientOptions, role: Role) -> ClientOptions {
    options.app_name.get_or_insert_with(|| "rmem".to_owned());
    options.server_selection_timeout.get_or_insert(SELECTION_TIMEOUT);
    options.connect_timeout.get_or_insert(SELECTION_TIMEOUT);
    options.heartbeat_freq.get_or_insert(HEARTBEAT_INTERVAL);
    options.write_concern = Some(durable(options.write_concern.take()));
    if role == Role::Shared {
        options.selection_criteria.get_or_insert(SelectionCriteria::ReadPreference(ReadPreference::nearest(None)));
    }
    options
}

/// A majority and its journals, where the URI does not ask for something else.
fn durable(asked: Option<WriteConcern>) -> WriteConcern {
    let mut concern = asked.unwrap_or_default();
    concern.w.get_or_insert(Acknowledgment::Majority);
    concern.journal.get_or_insert(true);
    concern.w_timeout.get_or_insert(MAJORITY_TIMEOUT);
    concern
}

/// Reads the URI. For `mongodb+srv` that asks the name service, which is given
/// as much time as a server.
fn parse(uri: &str, address: &str) -> Result<ClientOptions, StoreError> {
    if !uri.starts_with("mongodb+srv:") {
        return ClientOptions::parse(uri).run().map_err(|_| refused(uri, address));
    }
    let (sender, receiver) = mpsc::channel();
    let asked = uri.to_owned();
    std::thread::spawn(move || {
        // After the timeout nothing receives the result.
        let _ = sender.send(ClientOptions::parse(asked).run());
    });
    match receiver.recv_timeout(SELECTION_TIMEOUT) {
        Ok(Ok(options)) => Ok(options),
        Ok(Err(error)) => Err(match *error.kind {
            mongodb::error::ErrorKind::DnsResolve { message, .. } => {
                StoreError::unreachable(address, format!("the name does not resolve: {message}"))
            }
            _ => refused(uri, address),
        }),
        Err(_) => {
            let reason = format!("the name service did not answer within {} s", SELECTION_TIMEOUT.as_secs());
            Err(StoreError::unreachable(address, reason))
        }
    }
}

/// Why the driver refuses a URI, without repeating what may be a password:
/// it is asked again about the URI without credentials.
fn refused(uri: &str, address: &str) -> StoreError {
    let reason = match without_credentials(uri).map(|bare| ClientOptions::parse(bare).run()) {
        Some(Err(error)) => failure::brief(&error),
        _ => "a user name, password or option in the URI is not acceptable; \
              special characters are written with %, like %2F for /"
            .to_owned(),
    };
    StoreError::Failed { address: address.to_owned(), reason }
}

/// The URI without credentials, where it then holds no secret (options may).
fn without_credentials(uri: &str) -> Option<String> {
    let (scheme, rest) = uri.split_once("://")?;
    if scheme != "mongodb" || rest.to_ascii_lowercase().contains("password") || rest.contains("authMechanism") {
        return None;
    }
    Some(credentials::removed(uri))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn failure_of(uri: &str) -> String {
        match MongoDb::open(uri, "mongodb://host".to_owned(), Role::Local) {
            Ok(_) => "opened".to_owned(),
            Err(error) => error.to_string(),
        }
    }

    #[test]
    fn a_refused_uri_does_not_show_its_password() {
        for uri in [
            "mongodb://robot:sec%ret@host/",
            "mongodb://robot:sec:ret@host/",
            "mongodb://robot:secret@host/?readPreference=sideways",
            "mongodb://robot:secret@host:port/",
        ] {
            let shown = failure_of(uri);
            assert!(shown != "opened" && !shown.contains("sec") && !shown.contains("ret@"), "{uri}: {shown}");
        }
    }

    #[test]
    fn a_shared_store_reads_from_the_nearest_member_unless_the_uri_says_otherwise() {
        let criteria = |uri: &str, role| match completed(parse(uri, "").unwrap(), role).selection_criteria {
            Some(SelectionCriteria::ReadPreference(preference)) => Some(preference),
            _ => None,
        };
        assert!(matches!(criteria("mongodb://host", Role::Shared), Some(ReadPreference::Nearest { .. })));
        assert_eq!(criteria("mongodb://host", Role::Local), None);
        let primary = criteria("mongodb://host/?readPreference=primary", Role::Shared);
        assert_eq!(primary, Some(ReadPreference::Primary));
    }

    #[test]
    fn the_uri_may_ask_for_another_write_concern() {
        let asked = WriteConcern::builder().w(Acknowledgment::Nodes(1)).build();
        assert_eq!(durable(Some(asked)).w, Some(Acknowledgment::Nodes(1)));
        assert_eq!(durable(None).w, Some(Acknowledgment::Majority));
        assert_eq!(durable(None).journal, Some(true));
    }
}
