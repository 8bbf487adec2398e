//! Commands that write, for what the driver's actions have no word for: several statements, a limit of time, and what was done
//! where not as many members confirmed it as were to.

use bson::raw::{CStr, cstr};
use bson::{Document, RawArrayBuf, RawDocumentBuf, doc, rawdoc};
use mongodb::error::{Error, ErrorKind, WriteError, WriteFailure};

use super::action::max_time;
use super::{MongoDb, failure};
use crate::query::QueryError;
use crate::store::{Modifiers, Namespace, Query, StoreError, UpdateRequest, UpdateSpec, Updated};

impl MongoDb {
    /// Has the server do the statements of a command, which has a name, and a name for the list of them, within the time that
    /// is left. The driver does not send it again where a connection is lost.
    pub(super) fn write(
        &self,
        ns: &Namespace,
        (name, list, statements): (&CStr, &CStr, &RawArrayBuf),
        more: &RawDocumentBuf,
        variables: &Document,
    ) -> Result<mongodb::error::Result<Document>, QueryError> {
        let mut command = RawDocumentBuf::new();
        command.append(name, ns.collection.as_str());
        command.append(list, statements);
        for field in more {
            let (name, value) = field?;
            command.append(name, value);
        }
        let concern = bson::serialize_to_document(&self.write_policy.of_one())?;
        command.append(cstr!("writeConcern"), RawDocumentBuf::try_from(&concern)?);
        if !variables.is_empty() {
            command.append(cstr!("let"), RawDocumentBuf::try_from(variables)?);
        }
        if self.is_bypassing.get() && list == cstr!("updates") {
            command.append(cstr!("bypassDocumentValidation"), true);
        }
        if let Some(left) = max_time() {
            command.append(cstr!("maxTimeMS"), left);
        }
        Ok(self.client().database(&ns.database).run_raw_command(command).run())
    }

    /// The answer to a command of one statement.
    fn write_one(
        &self,
        ns: &Namespace,
        (name, list): (&CStr, &CStr),
        mut statement: Document,
        modifiers: &Modifiers,
    ) -> Result<Document, StoreError> {
        if let Some(collation) = &modifiers.collation {
            statement.insert("collation", collation.definition().clone());
        }
        if let Some(hint) = &modifiers.hint {
            statement.insert("hint", hint.to_bson());
        }
        let mut statements = RawArrayBuf::new();
        statements.push(RawDocumentBuf::try_from(&statement).map_err(QueryError::from)?);
        let answer = self.write(ns, (name, list, &statements), &rawdoc! {}, &modifiers.variables)?;
        let failed = |error: &Error| failure::explain_change(&self.address, ns, error);
        let answer = answer.map_err(|error| failed(&error))?;
        match answer.get_array("writeErrors").ok().and_then(|errors| errors.first()?.as_document()) {
            Some(error) => {
                let error: WriteError = bson::deserialize_from_document(error.clone()).map_err(QueryError::from)?;
                Err(failed(&ErrorKind::Write(WriteFailure::WriteError(error)).into()))
            }
            None => Ok(answer),
        }
    }

    /// Where not as many members confirmed the changes of a command as were to.
    pub(super) fn unconfirmed(&self, ns: &Namespace, answer: &Document) -> Option<StoreError> {
        let concern = answer.get_document("writeConcernError").ok()?;
        let reason = concern.get_str("errmsg").unwrap_or_default();
        Some(failure::unconfirmed(&self.address, &format!("the change of {ns}"), reason))
    }

    pub(super) fn applied_by_command(
        &self,
        ns: &Namespace,
        request: &UpdateRequest,
    ) -> Result<(Updated, Option<StoreError>), StoreError> {
        let UpdateRequest { filter, update, array_filters, many, upsert, modifiers } = request;
        let mut statement = doc! { "q": filter.clone() };
        match update {
            UpdateSpec::Document(document) => statement.insert("u", document.clone()),
            UpdateSpec::Pipeline(stages) => statement.insert("u", stages.clone()),
        };
        statement.extend(doc! { "multi": many, "upsert": upsert });
        if !array_filters.is_empty() {
            statement.insert("arrayFilters", array_filters.clone());
        }
        let answer = self.write_one(ns, (cstr!("update"), cstr!("updates")), statement, modifiers)?;
        let upserted =
            answer.get_array("upserted").ok().and_then(|all| all.first()?.as_document()?.get("_id").cloned());
        let matched = count(&answer, "n").saturating_sub(u64::from(upserted.is_some()));
        Ok((Updated { matched, modified: count(&answer, "nModified"), upserted }, self.unconfirmed(ns, &answer)))
    }

    pub(super) fn removed_by_command(
        &self,
        ns: &Namespace,
        query: Query<'_>,
        first_only: bool,
    ) -> Result<u64, StoreError> {
        let statement = doc! { "q": query.filter.clone(), "limit": i32::from(first_only) };
        let answer = self.write_one(ns, (cstr!("delete"), cstr!("deletes")), statement, query.modifiers)?;
        self.unconfirmed(ns, &answer).map_or_else(|| Ok(count(&answer, "n")), Err)
    }
}

/// A number of documents in an answer.
pub(super) fn count(answer: &Document, name: &str) -> u64 {
    answer
        .get(name)
        .and_then(|count| match count {
            bson::Bson::Int32(count) => u64::try_from(*count).ok(),
            bson::Bson::Int64(count) => u64::try_from(*count).ok(),
            _ => None,
        })
        .unwrap_or_default()
}
