//! Which collection a write is for, where the server can be told.
//!
//! A server makes a collection for an upsert, also for one that then fails. An update of documents that are known must not make
//! one again that another client has dropped, so it names the collection by the server's identity for it.

use bson::{Bson, doc};

use super::known::Identity;
use super::{MongoDb, failure};
use crate::store::{Namespace, StoreError};

/// The server's code for a collection that is not the one that was named.
pub(super) const IS_OTHER: i32 = 361;
/// The server's code for what a user may not do.
const UNAUTHORIZED: i32 = 13;

impl MongoDb {
    /// Which collection has a name, and whether the server was asked now.
    pub(super) fn identity(&self, ns: &Namespace) -> Result<(Identity, bool), StoreError> {
        if let Some(known) = self.identities.get(ns) {
            return Ok((known, false));
        }
        let identity = if self.takes_identities()? { self.ask_for_identity(ns)? } else { Identity::Unknown };
        if !matches!(identity, Identity::Missing) {
            self.identities.learn(ns, identity.clone());
        }
        Ok((identity, true))
    }

    fn ask_for_identity(&self, ns: &Namespace) -> Result<Identity, StoreError> {
        let command = doc! { "listCollections": 1, "filter": { "name": &ns.collection } };
        let listed = self.client().database(&ns.database).run_cursor_command(command).run();
        let mut listed = match listed {
            Ok(listed) => listed,
            Err(error) if failure::code(&error) == Some(UNAUTHORIZED) => return Ok(Identity::Unknown),
            Err(error) => return Err(self.explain(&error)),
        };
        let Some(found) = listed.next().transpose().map_err(|e| self.explain(&e))? else {
            return Ok(Identity::Missing);
        };
        match found.get_document("info").ok().and_then(|info| info.get("uuid")) {
            Some(Bson::Binary(id)) => Ok(Identity::Known(id.clone())),
            _ => Ok(Identity::Unknown),
        }
    }
}
