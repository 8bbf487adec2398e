//! `findAndModify`

use bson::{Bson, Document, RawDocumentBuf, doc};

use super::definition::{Command, raw};
use super::update::{array_filters, spec};
use crate::memory::Memory;
use crate::query::QueryError;
use crate::serve::call::Call;
use crate::serve::effect::Effect;
use crate::serve::failure::{Answer, Failure, codes};
use crate::serve::fields::number;
use crate::store::{Find, Modifiers, Namespace, StoreError, UpdateRequest, UpdateSpec};

pub(super) const COMMANDS: &[Command] = &[Command::write("findAndModify", modify).transactional()];

const TAKEN: [&str; 14] = [
    "query",
    "sort",
    "remove",
    "update",
    "new",
    "fields",
    "upsert",
    "arrayFilters",
    "hint",
    "collation",
    "let",
    "bypassDocumentValidation",
    "stmtId",
    "runtimeConstants",
];

/// What is to be done with the first document that matches.
#[derive(Clone)]
struct Modification {
    query: Document,
    sort: Document,
    fields: Document,
    update: Option<UpdateSpec>,
    array_filters: Vec<Document>,
    new: bool,
    upsert: bool,
    modifiers: Modifiers,
}

fn modify(memory: &Memory, call: &Call) -> Answer {
    let (ns, fields) = (call.request.namespace()?, call.request.fields());
    fields.known(&TAKEN)?;
    let modification = Modification {
        query: fields.document_or_empty("query")?,
        sort: fields.document_or_empty("sort")?,
        fields: fields.document_or_empty("fields")?,
        update: spec(fields, "update")?,
        array_filters: array_filters(fields)?,
        new: fields.flag("new")?,
        upsert: fields.flag("upsert")?,
        modifiers: fields.modifiers()?,
    };
    modification.check(fields.flag("remove")?)?;
    if let Some((statement, effect)) = call.statements.repeated(0) {
        let mut reply = effect.modified(modification.update.is_none())?;
        reply.insert("retriedStmtId", number(statement));
        return raw(&reply);
    }
    let answer = match &modification.update {
        None => modification.remove(memory, call, &ns),
        Some(update) => modification.change(memory, call, &ns, update),
    };
    answer.map_err(|failure| modification.explained(memory, call, &ns, failure))
}

impl Modification {
    fn check(&self, removes: bool) -> Result<(), Failure> {
        let wrong = |message: &str| Err(Failure::new(codes::FAILED_TO_PARSE, message));
        match (removes, &self.update) {
            (true, Some(_)) => wrong("Cannot specify both an update and remove=true"),
            (false, None) => wrong("Either an update or remove=true must be specified"),
            (true, None) if self.upsert => wrong("Cannot specify both upsert=true and remove=true"),
            (true, None) if self.new => {
                wrong("Cannot specify both new=true and remove=true; 'remove' always returns the deleted document")
            }
            _ => Ok(()),
        }
    }

    /// The first document that matches, as the client is shown it.
    fn first(&self, memory: &Memory, call: &Call, ns: &Namespace) -> Result<Option<RawDocumentBuf>, Failure> {
        let find = Find {
            filter: self.query.clone(),
            sort: self.sort.clone(),
            limit: 1,
            projection: self.fields.clone(),
            modifiers: self.modifiers.clone(),
            current: true,
            ..Find::default()
        };
        Ok(call.access(memory).stored(ns, &find)?.next().transpose()?)
    }

    /// The `_id` of that document.
    fn id(&self, memory: &Memory, call: &Call, ns: &Namespace) -> Result<Option<Bson>, Failure> {
        let find = Find {
            filter: self.query.clone(),
            sort: self.sort.clone(),
            limit: 1,
            projection: doc! { "_id": 1 },
            modifiers: self.modifiers.clone(),
            current: true,
            ..Find::default()
        };
        let Some(found) = call.access(memory).stored(ns, &find)?.next().transpose()? else { return Ok(None) };
        Ok(found.get("_id")?.map(Bson::try_from).transpose()?)
    }

    fn by_id(&self, memory: &Memory, call: &Call, ns: &Namespace, id: &Bson) -> Result<Bson, Failure> {
        let find =
            Find { filter: same(id), limit: 1, projection: self.fields.clone(), current: true, ..Find::default() };
        value(call.access(memory).stored(ns, &find)?.next().transpose()?)
    }

    /// The same for no document at all.
    fn of_nothing(&self) -> Self {
        let query = doc! { "$and": [self.query.clone(), { "_id": { "$in": [] } }] };
        Self { query, upsert: false, ..self.clone() }
    }

    /// Refuses an update that is wrong, also where there is nothing to update; names of fields are for the document itself.
    fn check_update(&self, memory: &Memory, call: &Call, ns: &Namespace) -> Result<(), Failure> {
        let Some(update) = &self.update else { return Ok(()) };
        match call.access(memory).update(ns, &self.request(self.query.clone(), update)) {
            Err(StoreError::Query(error)) if error.code == codes::DOLLAR_PREFIXED => Ok(()),
            Err(error) => Err(error.into()),
            Ok(_) => Ok(()),
        }
    }

    /// Why it failed, as MongoDB says it: what is wrong whatever the documents are, that refuses before it looks for one.
    fn explained(&self, memory: &Memory, call: &Call, ns: &Namespace, failure: Failure) -> Failure {
        // A MongoDB server has said so of its query.
        let is_said = failure.message.contains("xecutor error during");
        if failure.is_of_server() || is_said {
            return failure;
        }
        let nothing = self.of_nothing();
        let found = nothing.first(memory, call, ns);
        match found.and_then(|_| nothing.check_update(memory, call, ns)) {
            Ok(()) => failure.caused("Plan executor error during findAndModify"),
            Err(_) => failure,
        }
    }

    fn remove(&self, memory: &Memory, call: &Call, ns: &Namespace) -> Answer {
        let Some(id) = self.id(memory, call, ns)? else {
            return raw(&doc! { "lastErrorObject": { "n": 0 }, "value": Bson::Null });
        };
        let before = value(self.first(memory, call, ns)?)?;
        call.access(memory).delete(ns, (&same(&id)).into(), true)?;
        kept(call, doc! { "lastErrorObject": { "n": 1 }, "value": before }, Effect::Removed)
    }

    fn request(&self, filter: Document, update: &UpdateSpec) -> UpdateRequest {
        UpdateRequest {
            filter,
            update: update.clone(),
            array_filters: self.array_filters.clone(),
            many: false,
            upsert: self.upsert,
            modifiers: self.modifiers.without_hint(),
        }
    }

    fn change(&self, memory: &Memory, call: &Call, ns: &Namespace, update: &UpdateSpec) -> Answer {
        let id = self.id(memory, call, ns)?;
        let before = if self.new { Bson::Null } else { value(self.first(memory, call, ns)?)? };
        if id.is_none() && !self.upsert {
            self.of_nothing().check_update(memory, call, ns)?;
            return raw(&doc! { "lastErrorObject": { "n": 0, "updatedExisting": false }, "value": Bson::Null });
        }
        // What the query matched determines which element `$` is.
        let filter = match &id {
            Some(id) => doc! { "$and": [self.query.clone(), exactly(id)] },
            None => self.query.clone(),
        };
        let updated = call.access(memory).update(ns, &self.request(filter, update))?;
        let is_changed = Effect::of(&updated).is_some();
        let mut last = doc! { "n": 1, "updatedExisting": id.is_some() };
        if let Some(made) = &updated.upserted {
            last.insert("upserted", made);
        }
        let after = match (self.new, id.or(updated.upserted)) {
            (true, Some(id)) => self.by_id(memory, call, ns, &id)?,
            _ => before,
        };
        let reply = doc! { "lastErrorObject": last, "value": after };
        if is_changed { kept(call, reply, Effect::Modified) } else { raw(&reply) }
    }
}

/// An answer that is known when the command is sent again.
fn kept(call: &Call, reply: Document, effect: fn(Document) -> Effect) -> Answer {
    let answer = raw(&reply);
    call.statements.note(0..1, &effect(reply));
    answer
}

fn same(id: &Bson) -> Document {
    doc! { "_id": { "$eq": id } }
}

/// A document's `_id`, also where strings compare by a collation: by a pattern, which compares bytes.
fn exactly(id: &Bson) -> Document {
    let Bson::String(text) = id else { return same(id) };
    let escape = |c: char| if c.is_ascii_punctuation() { format!("\\{c}") } else { c.to_string() };
    let escaped: String = text.chars().map(escape).collect();
    doc! { "_id": { "$regex": format!("^{escaped}\\z") } }
}

fn value(document: Option<RawDocumentBuf>) -> Result<Bson, Failure> {
    let document = document.map(|raw| Document::try_from(&*raw)).transpose().map_err(QueryError::from)?;
    Ok(document.map_or(Bson::Null, Bson::Document))
}
