//! `update` and `findAndModify`.

use bson::{Bson, Document, doc};
use rmem::store::{Find, Namespace, Store as _, UpdateRequest, UpdateSpec, Updated};

use crate::command::{Answer, Failure, document, documents, flag, known, modifiers, refuse_options};
use crate::server::{Server, reply};

fn change(spec: Option<&Bson>) -> Result<UpdateSpec, Failure> {
    match spec {
        Some(Bson::Document(update)) => Ok(UpdateSpec::Document(update.clone())),
        Some(Bson::Array(stages)) => {
            let stages: Option<Vec<Document>> = stages.iter().map(|stage| stage.as_document().cloned()).collect();
            Ok(UpdateSpec::Pipeline(stages.ok_or_else(|| Failure::Failed("stages must be objects".to_owned()))?))
        }
        _ => Err(Failure::Failed("an update must be an object or an array".to_owned())),
    }
}

impl Server {
    pub(crate) fn update(&self, ns: &Namespace, command: &Document, recorded: &Document) -> Answer {
        known(command, &["updates", "ordered"])?;
        let upserted = recorded.get_array("upserted").cloned().unwrap_or_default();
        let (mut n, mut modified, mut errors) = (0, 0, Vec::new());
        let ordered = !command.contains_key("ordered") || flag(command, "ordered")?;
        let updates = documents(command, "updates")?;
        let variables = document(command, "let")?.cloned().unwrap_or_default();
        let whole = |one: &Document| {
            ["multi", "upsert"].iter().all(|name| matches!(one.get(name), None | Some(Bson::Boolean(_))))
                && one.contains_key("q")
                && matches!(one.get("u"), Some(Bson::Document(_) | Bson::Array(_)))
        };
        if updates.is_empty() || !updates.iter().all(whole) {
            return Err(Failure::Failed("updates with q and u are needed".to_owned()));
        }
        for (index, one) in updates.iter().enumerate() {
            let theirs = upserted
                .iter()
                .filter_map(Bson::as_document)
                .find(|entry| entry.get_i32("index").is_ok_and(|found| found == index as i32));
            match self.update_one(ns, one, theirs.and_then(|entry| entry.get("_id")), &variables) {
                Ok(changed) => {
                    n += changed.matched as i32 + i32::from(changed.upserted.is_some());
                    modified += changed.modified as i32;
                }
                Err(Failure::Refused(name)) => return Err(Failure::Refused(name)),
                Err(Failure::Failed(message)) => {
                    errors.push(Bson::String(message));
                    if ordered {
                        break;
                    }
                }
            }
        }
        Ok(reply(doc! {"n": n, "nModified": modified}, errors))
    }

    fn update_one(
        &self,
        ns: &Namespace,
        one: &Document,
        theirs: Option<&Bson>,
        variables: &Document,
    ) -> Result<Updated, Failure> {
        refuse_options(one)?;
        let mut modifiers = modifiers(one, &["collation", "hint"])?;
        modifiers.variables = variables.clone();
        let constants = document(one, "c")?.cloned().unwrap_or_default();
        modifiers.variables.extend(constants.into_iter().map(|(name, value)| (name, bson::bson!({"$literal": value}))));
        let request = UpdateRequest {
            filter: document(one, "q")?.cloned().unwrap_or_default(),
            update: change(one.get("u"))?,
            array_filters: documents(one, "arrayFilters")?,
            many: flag(one, "multi")?,
            upsert: flag(one, "upsert")?,
            modifiers,
        };
        self.apply(ns, &request, theirs)
    }

    /// Updates; a document that was made gets the `_id` that mongod made.
    fn apply(&self, ns: &Namespace, request: &UpdateRequest, theirs: Option<&Bson>) -> Result<Updated, Failure> {
        let mut updated = self.store.update(ns, request, None)?;
        if let (Some(ours @ Bson::ObjectId(_)), Some(theirs @ Bson::ObjectId(_))) = (&updated.upserted, theirs) {
            let filter = doc! {"_id": ours.clone()};
            for mut made in self.found(ns, &Find { filter: filter.clone(), ..Find::default() })? {
                self.store.delete(ns, (&filter).into(), true)?;
                made.insert("_id", theirs.clone());
                self.store.insert(ns, vec![made])?;
            }
            updated.upserted = Some(theirs.clone());
        }
        Ok(updated)
    }

    pub(crate) fn find_and_modify(&self, ns: &Namespace, command: &Document, recorded: &Document) -> Answer {
        known(command, &["query", "sort", "update", "remove", "new", "fields", "upsert", "arrayFilters"])?;
        let query = document(command, "query")?.cloned().unwrap_or_default();
        let sort = document(command, "sort")?.cloned().unwrap_or_default();
        let projection = document(command, "fields")?.cloned().unwrap_or_default();
        let (remove, new, upsert) = (flag(command, "remove")?, flag(command, "new")?, flag(command, "upsert")?);
        if remove == command.contains_key("update") || remove && (new || upsert) {
            return Err(Failure::Failed("either update or remove".to_owned()));
        }
        let modifiers = modifiers(command, &["collation", "let", "hint"])?;
        let first = Find { filter: query.clone(), sort, limit: 1, modifiers: modifiers.clone(), ..Find::default() };
        let id = self.found(ns, &first)?.first().and_then(|found| found.get("_id").cloned());
        let before = self.found(ns, &Find { projection: projection.clone(), ..first })?.into_iter().next();
        let one = |id: &Bson| doc! {"_id": {"$eq": id.clone()}};
        if remove {
            if let Some(id) = &id {
                self.store.delete(ns, (&one(id)).into(), true)?;
            }
            return Ok(doc! {"value": before});
        }
        let request = UpdateRequest {
            filter: id.as_ref().map_or_else(|| query.clone(), |id| doc! {"$and": [query.clone(), one(id)]}),
            update: change(command.get("update"))?,
            array_filters: documents(command, "arrayFilters")?,
            upsert,
            many: false,
            modifiers: modifiers.without_hint(),
        };
        let theirs = recorded.get_document("lastErrorObject").ok().and_then(|last| last.get("upserted"));
        let updated = self.apply(ns, &request, theirs)?;
        let value = match (new, id.or(updated.upserted)) {
            (false, _) => before,
            (true, None) => None,
            (true, Some(id)) => self.found(ns, &Find { filter: one(&id), projection, ..Find::default() })?.pop(),
        };
        Ok(doc! {"value": value})
    }
}
