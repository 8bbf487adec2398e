//! Images of documents before and after changes, which servers from version 6 on keep for
//! collections with that option.

use bson::doc;

use super::{MongoDb, failure};
use crate::query::QueryError;
use crate::store::{Namespace, StoreError};

/// The first version of the wire protocol that knows of images: MongoDB 6.0.
const WIRE_VERSION: i32 = 17;
/// That of MongoDB 5.0, the first that notes which fields a pipeline changes: before, change streams say that it replaces.
const NOTING: i32 = 13;

/// What a server offers to watchers.
pub(super) struct Server {
    /// Whether it keeps images.
    pub(super) images: bool,
}

impl MongoDb {
    /// Asks whether changes can be watched at all.
    pub(super) fn examine(&self) -> Result<Server, StoreError> {
        let hello = self.hello().map_err(|e| self.explain(&e))?;
        let replicated =
            hello.contains_key("setName") || hello.get_str("msg").is_ok_and(|message| message == "isdbgrid");
        if !replicated {
            return Err(self.fail(failure::STANDALONE));
        }
        Ok(Server { images: hello.get_i32("maxWireVersion").unwrap_or_default() >= WIRE_VERSION })
    }

    /// Whether the server notes which fields the pipeline of an update changes.
    pub(super) fn notes_what_pipelines_change(&self) -> Result<bool, StoreError> {
        self.speaks(NOTING)
    }

    /// Whether the server takes with a write which collection it is for, as servers from version 6 on do.
    pub(super) fn takes_identities(&self) -> Result<bool, StoreError> {
        self.speaks(WIRE_VERSION)
    }

    /// Whether the server knows a version of the wire protocol. It is asked once.
    fn speaks(&self, least: i32) -> Result<bool, StoreError> {
        if let Some(version) = self.version.get() {
            return Ok(*version >= least);
        }
        let version = match self.hello() {
            Ok(hello) => hello.get_i32("maxWireVersion").unwrap_or_default(),
            // An old server does not know the command.
            Err(error) if failure::code(&error).is_some() => 0,
            Err(error) => return Err(self.explain(&error)),
        };
        Ok(*self.version.get_or_init(|| version) >= least)
    }

    /// Makes the server keep images of an existing collection, or stop doing so.
    pub(super) fn change_images(&self, ns: &Namespace, are_kept: bool) -> Result<(), StoreError> {
        self.modify_images(ns, are_kept).map_err(|e| self.explain(&e))
    }

    fn modify_images(&self, ns: &Namespace, are_kept: bool) -> mongodb::error::Result<()> {
        let modify = doc! { "collMod": &ns.collection, "changeStreamPreAndPostImages": { "enabled": are_kept } };
        self.client().database(&ns.database).run_command(modify).run().map(drop)
    }

    /// Makes the server keep images of the collection, which is made where it is
    /// missing. Where that is not allowed, changes come without the document before.
    pub(super) fn keep_images(&self, ns: &Namespace, create: bool) -> Result<(), StoreError> {
        // A `collMod` locks the collection, and is an event for those that follow it.
        let options = self.options_of(ns, &["collection"])?.unwrap_or_default();
        if options
            .get_document("changeStreamPreAndPostImages")
            .is_ok_and(|images| images.get_bool("enabled").unwrap_or(false))
        {
            return Ok(());
        }
        let outcome = match self.modify_images(ns, true) {
            Err(error) if create && failure::code(&error) == Some(QueryError::NAMESPACE_NOT_FOUND) => {
                let made = doc! { "create": &ns.collection, "changeStreamPreAndPostImages": { "enabled": true } };
                match self.client().database(&ns.database).run_command(made).run() {
                    Err(error) if failure::code(&error) == Some(QueryError::NAMESPACE_EXISTS) => {
                        self.modify_images(ns, true)
                    }
                    outcome => outcome.map(drop),
                }
            }
            outcome => outcome,
        };
        match outcome {
            Ok(()) => Ok(()),
            // The server's refusal is no failure; that it cannot be reached is.
            Err(error) if failure::code(&error).is_some() => Ok(()),
            Err(error) => Err(self.explain(&error)),
        }
    }
}
