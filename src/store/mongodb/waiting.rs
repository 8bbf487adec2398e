//! Waiting until the writes of a client are confirmed as it asks.
//!
//! The driver gives no result of a write that is not confirmed, and MongoDB answers both. So the primary alone confirms
//! each write, and then an update of nothing has the client's write concern: the server waits for all that was written
//! before it. Where another member has become the primary meanwhile, what was written before may be lost, and is
//! reported as not confirmed. So is what could not be recorded in the history.

use bson::{Document, doc};

use super::action::max_time;
use super::write_policy::Member;
use super::{MongoDb, failure};
use crate::store::{Namespace, StoreError, WriteConcern};

/// The collection that the update of nothing is made in; it does not have to be there.
const NOTHING: &str = "rmem.retries";
/// The server's code for a write during which another member became the primary.
const ELECTED: i32 = 11_602;
/// The code for a write that is not in the history.
const UNRECORDED: i32 = 96;
/// The server's code for a member that is not reached.
const UNREACHABLE: i32 = 6;

impl MongoDb {
    /// Runs writes, and waits until they are confirmed as asked.
    pub(super) fn wait_for_all(
        &self,
        ns: &Namespace,
        asked: Option<&WriteConcern>,
        work: &mut dyn FnMut() -> bool,
    ) -> Result<Option<Document>, StoreError> {
        let needed = self.write_policy.needed(asked)?;
        let member = match self.write_policy.known() {
            Some(member) => member,
            None => self.ask_for_member()?,
        };
        member.check(asked)?;
        let postponed = self.write_policy.postpone();
        let has_written = work();
        drop(postponed);
        let unrecorded = self.take_unrecorded().map(|reason| doc! { "code": UNRECORDED, "errmsg": reason });
        let mut needed = needed.into_iter().filter(|_| has_written);
        Ok(needed.find_map(|concern| self.wait(ns, concern, member)).or(unrecorded))
    }

    /// What the server is.
    fn ask_for_member(&self) -> Result<Member, StoreError> {
        let hello = self.hello().map_err(|e| self.explain(&e))?;
        // A router says `msg`.
        let is_replicated = hello.contains_key("setName") || hello.contains_key("msg");
        let member = Member { is_replicated, election: hello.get_object_id("electionId").ok() };
        self.write_policy.learn(member);
        Ok(member)
    }

    /// Waits until all that was written is confirmed; returns why it is not.
    fn wait(&self, ns: &Namespace, concern: Document, before: Member) -> Option<Document> {
        let update = doc! { "q": { "_id": { "$in": [] } }, "u": { "$set": { "confirmed": true } } };
        let mut nothing = doc! { "update": NOTHING, "updates": [update], "writeConcern": concern };
        nothing.extend(max_time().map(|left| ("maxTimeMS".to_owned(), left.into())));
        let ask = || self.client().database(&ns.database).run_command(nothing.clone()).run();
        // It may be asked twice, as it writes nothing.
        let answer = match ask().or_else(|error| if failure::is_passing(&error) { ask() } else { Err(error) }) {
            Ok(answer) => answer,
            Err(error) => {
                let code = failure::code(&error).unwrap_or(UNREACHABLE);
                return Some(doc! { "code": code, "errmsg": self.explain(&error).to_string() });
            }
        };
        // `rmem serve` says it in no answer.
        let after = before.election.and_then(|known| answer.get_object_id("electionId").ok().or(Some(known)));
        self.write_policy.learn(Member { election: after, ..before });
        match answer.get_document("writeConcernError") {
            Ok(error) => Some(error.clone()),
            Err(_) if before.election == after => None,
            Err(_) => {
                let message = "another member has become the primary; what was written before that may be lost";
                Some(doc! { "code": ELECTED, "errmsg": message })
            }
        }
    }
}
