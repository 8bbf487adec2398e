//! MongoDB's commands on collections in memory.

use std::collections::HashMap;

use bson::{Bson, DateTime, Document, RawDocumentBuf, doc};
use rmem::query::{
    Filter, Output, Pipeline, Projection, QueryError, Sort, Update, WhenMatched, WhenNotMatched, compare_values,
};

use crate::collection::{Changed, Collection, invalid};

/// Why there is no answer.
#[derive(Debug)]
pub(crate) enum Failure {
    /// Not supported, by name.
    Refused(String),
    /// An error.
    Failed(String),
}

impl From<QueryError> for Failure {
    fn from(error: QueryError) -> Self {
        match (error.unsupported, error.operator) {
            (true, Some(operator)) => Self::Refused(operator),
            _ => Self::Failed(format!("{}: {}", error.code, error.message)),
        }
    }
}

type Answer = Result<Document, Failure>;

/// What commands are replayed on.
pub(crate) trait Model {
    /// Answers a command in the shape of mongod's reply. The recorded reply is
    /// given for what cannot be known: ids that mongod made.
    fn run(&mut self, command: &Document, recorded: &Document) -> Answer;
}

/// A server in memory.
#[derive(Default)]
pub(crate) struct Server {
    collections: HashMap<(String, String), Collection>,
    cursors: HashMap<i64, Vec<RawDocumentBuf>>,
}

/// Options of commands that rmem's stores have no word for.
const OPTIONS: [&str; 22] = [
    "allowDiskUse", "bypassDocumentValidation",
    "collation",
    "readConcern",
    "writeConcern",
    "hint",
    "explain",
    "max",
    "min",
    "returnKey",
    "showRecordId",
    "tailable",
    "awaitData",
    "apiVersion",
    "apiStrict",
    "viewOn",
    "timeseries",
    "capped",
    "validator",
    "clusteredIndex",
    "maxTimeMS",
    "size",
];

fn refuse_options(command: &Document) -> Result<(), Failure> {
    match command.keys().find(|name| OPTIONS.contains(&name.as_str())) {
        Some(name) => Err(Failure::Refused(format!("option {name}"))),
        None => Ok(()),
    }
}

/// Refuses options that no command has.
fn known(command: &Document, names: &[&str]) -> Result<(), Failure> {
    refuse_options(command)?;
    const ALL: [&str; 4] = ["$db", "comment", "cursor", "let"];
    match command.keys().skip(1).find(|name| !names.contains(&name.as_str()) && !ALL.contains(&name.as_str())) {
        Some(name) => Err(Failure::Failed(format!("unknown field {name}"))),
        None => Ok(()),
    }
}

fn document<'a>(command: &'a Document, name: &str) -> Result<Option<&'a Document>, Failure> {
    match command.get(name) {
        None | Some(Bson::Null) => Ok(None),
        Some(Bson::Document(document)) => Ok(Some(document)),
        Some(_) => Err(Failure::Failed(format!("{name} must be an object"))),
    }
}

fn documents(command: &Document, name: &str) -> Result<Vec<Document>, Failure> {
    let wrong = || Failure::Failed(format!("{name} must be an array of objects"));
    match command.get(name) {
        None => Ok(Vec::new()),
        Some(Bson::Array(items)) => items.iter().map(|item| item.as_document().cloned().ok_or_else(wrong)).collect(),
        Some(_) => Err(wrong()),
    }
}

fn whole(command: &Document, name: &str) -> Result<Option<i64>, Failure> {
    match command.get(name) {
        None | Some(Bson::Null) => Ok(None),
        Some(Bson::Int32(value)) => Ok(Some((*value).into())),
        Some(Bson::Int64(value)) => Ok(Some(*value)),
        Some(Bson::Double(value)) if value.is_finite() => Ok(Some(*value as i64)),
        Some(Bson::Decimal128(value)) => match value.to_string().parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(Some(value as i64)),
            _ => Err(Failure::Failed(format!("{name} must be finite"))),
        },
        Some(_) => Err(Failure::Failed(format!("{name} must be a number"))),
    }
}

fn unsigned(command: &Document, name: &str) -> Result<usize, Failure> {
    let value = whole(command, name)?.unwrap_or(0);
    usize::try_from(value).map_err(|_| Failure::Failed(format!("{name} must not be negative")))
}

fn flag(command: &Document, name: &str) -> Result<bool, Failure> {
    match command.get(name) {
        None | Some(Bson::Null) => Ok(false),
        Some(Bson::Boolean(value)) => Ok(*value),
        Some(Bson::Int32(value)) => Ok(*value != 0),
        Some(Bson::Int64(value)) => Ok(*value != 0),
        Some(Bson::Double(value)) => Ok(*value != 0.0),
        Some(_) => Err(Failure::Failed(format!("{name} must be a boolean"))),
    }
}

/// A filter, with the command's variables.
fn filter(command: &Document, name: &str) -> Result<Filter, Failure> {
    let filter = document(command, name)?.cloned().unwrap_or_default();
    if command.contains_key("let") {
        return Err(Failure::Refused("option let".to_owned()));
    }
    Ok(Filter::parse(&filter)?)
}

fn update(spec: Option<&Bson>, array_filters: &[Document], constants: &Document) -> Result<Update, Failure> {
    match spec {
        Some(Bson::Document(update)) => Ok(Update::parse(update, array_filters)?),
        Some(Bson::Array(stages)) => {
            let stages: Option<Vec<Document>> = stages.iter().map(|stage| stage.as_document().cloned()).collect();
            let stages = stages.ok_or_else(|| Failure::Failed("stages must be objects".to_owned()))?;
            if !array_filters.is_empty() {
                return Err(Failure::Failed("arrayFilters with a pipeline".to_owned()));
            }
            Ok(Update::parse_pipeline_with(&stages, constants)?)
        }
        _ => Err(Failure::Failed("an update must be an object or an array".to_owned())),
    }
}

impl Model for Server {
    fn run(&mut self, command: &Document, recorded: &Document) -> Answer {
        let Some((name, target)) = command.iter().next() else { return Ok(doc! {}) };
        let database = command.get_str("$db").unwrap_or_default().to_owned();
        if name == "getMore" {
            return self.more(command);
        }
        if matches!(name.as_str(), "listCollections") {
            return Ok(doc! {});
        }
        if name == "dropDatabase" {
            self.collections.retain(|(known, _), _| *known != database);
            return Ok(doc! {});
        }
        let namespace = match target {
            Bson::String(collection) if !collection.is_empty() => (database, collection.clone()),
            Bson::Int32(1) | Bson::Int64(1) if name == "aggregate" => (database, String::new()),
            Bson::Double(one) if *one == 1.0 && name == "aggregate" => (database, String::new()),
            _ => return Err(Failure::Failed("not a collection".to_owned())),
        };
        match name.as_str() {
            "drop" => {
                self.collections.remove(&namespace);
                Ok(doc! {})
            }
            "create" => {
                refuse_options(command)?;
                self.collections.entry(namespace).or_default();
                Ok(doc! {})
            }
            "createIndexes" => create_indexes(command),
            "insert" => self.insert(&namespace, command),
            "find" => self.find(&namespace, command, recorded),
            "aggregate" => self.aggregate(&namespace, command, recorded),
            "count" => self.count(&namespace, command),
            "distinct" => self.distinct(&namespace, command),
            "update" => self.update(&namespace, command, recorded),
            "delete" => self.delete(&namespace, command),
            "findAndModify" => self.find_and_modify(&namespace, command, recorded),
            other => Err(Failure::Refused(format!("command {other}"))),
        }
    }
}

/// Indexes are the store's; only plain ones change no answer.
fn create_indexes(command: &Document) -> Answer {
    refuse_options(command)?;
    for index in documents(command, "indexes")? {
        for (name, _) in &index {
            if !matches!(name.as_str(), "key" | "name" | "v" | "background") {
                return Err(Failure::Refused(format!("index option {name}")));
            }
        }
        if let Ok(keys) = index.get_document("key") {
            for (name, direction) in keys {
                if name.contains("$**") || matches!(direction, Bson::String(_)) {
                    return Err(Failure::Refused(format!(
                        "index {direction} {}",
                        if name.contains("$**") { "wildcard" } else { "" }
                    )));
                }
            }
        }
    }
    Err(Failure::Refused("createIndexes".to_owned()))
}

type Name = (String, String);

impl Server {
    fn collection(&mut self, namespace: &Name) -> &mut Collection {
        self.collections.entry(namespace.clone()).or_default()
    }

    fn insert(&mut self, namespace: &Name, command: &Document) -> Answer {
        known(command, &["documents", "ordered"])?;
        let documents = documents(command, "documents")?;
        if documents.is_empty() || documents.len() > 100_000 {
            return Err(Failure::Failed("bad number of documents".to_owned()));
        }
        let ordered = !command.contains_key("ordered") || flag(command, "ordered")?;
        let (mut n, mut errors) = (0, Vec::new());
        for document in &documents {
            match self.collection(namespace).insert(document) {
                Ok(()) => n += 1,
                Err(error) => {
                    errors.push(Bson::String(error.message));
                    if ordered {
                        break;
                    }
                }
            }
        }
        Ok(reply(doc! {"n": n}, errors))
    }

    fn answer(&mut self, found: Vec<RawDocumentBuf>, command: &Document, recorded: &Document) -> Answer {
        let options = command.get_document("cursor").unwrap_or(command);
        let batch = match options.get("batchSize") {
            None => 101,
            Some(_) => unsigned(options, "batchSize")?,
        };
        let mut found = found;
        let rest = found.split_off(batch.min(found.len()));
        if let Some(id) = recorded.get_document("cursor").ok().and_then(|cursor| cursor.get_i64("id").ok()) {
            self.cursors.insert(id, rest);
        }
        Ok(doc! {"cursor": {"firstBatch": array(found)?}})
    }

    fn more(&mut self, command: &Document) -> Answer {
        let id = command.get_i64("getMore").unwrap_or(0);
        let mut found = self.cursors.remove(&id).unwrap_or_default();
        let batch = if command.contains_key("batchSize") { unsigned(command, "batchSize")? } else { usize::MAX };
        let rest = found.split_off(batch.min(found.len()));
        self.cursors.insert(id, rest);
        Ok(doc! {"cursor": {"nextBatch": array(found)?}})
    }

    fn find(&mut self, namespace: &Name, command: &Document, recorded: &Document) -> Answer {
        known(command, &["filter", "projection", "sort", "limit", "skip", "batchSize", "singleBatch"])?;
        let now = DateTime::now();
        let filter = filter(command, "filter")?;
        let sort = Sort::parse(document(command, "sort")?.unwrap_or(&Document::new()))?;
        let projection = Projection::parse(document(command, "projection")?.unwrap_or(&Document::new()))?;
        let (skip, limit) = (unsigned(command, "skip")?, whole(command, "limit")?.unwrap_or(0).unsigned_abs() as usize);
        let collection = self.collection(namespace);
        let mut found = Vec::new();
        for place in collection.matching(&filter)? {
            found.push(collection.documents[place].clone());
        }
        let sorted: Vec<_> = sort.sort::<QueryError>(found.into_iter().map(Ok), None)?;
        let window = sorted.into_iter().skip(skip).take(if limit == 0 { usize::MAX } else { limit });
        let found: Result<Vec<_>, QueryError> =
            window.map(|document| projection.apply(&document, &filter, now)).collect();
        self.answer(found?, command, recorded)
    }

    fn aggregate(&mut self, namespace: &Name, command: &Document, recorded: &Document) -> Answer {
        known(command, &["pipeline"])?;
        if !command.contains_key("pipeline") || !matches!(command.get("cursor"), Some(Bson::Document(_))) {
            return Err(Failure::Failed("pipeline and cursor are needed".to_owned()));
        }
        let stages = documents(command, "pipeline")?;
        let constants = document(command, "let")?.cloned().unwrap_or_default();
        let pipeline = Pipeline::parse_with(&stages, &constants)?;
        if pipeline.brings_documents() != namespace.1.is_empty() {
            return Err(Failure::Failed("a collection, or $documents".to_owned()));
        }
        let now = DateTime::now();
        let all = self.collections.clone();
        let input = all.get(namespace).cloned().unwrap_or_default().documents;
        let sources = |origin: &rmem::query::Origin| -> Result<rmem::query::Documents<'_, QueryError>, QueryError> {
            let database = origin.database.clone().unwrap_or_else(|| namespace.0.clone());
            let found = all.get(&(database, origin.collection.clone())).map(|collection| collection.documents.clone());
            Ok(Box::new(found.unwrap_or_default().into_iter().map(Ok)))
        };
        let found = pipeline.run(Box::new(input.into_iter().map(Ok)), now, &sources);
        let found: Vec<RawDocumentBuf> = found.collect::<Result<_, QueryError>>()?;
        match pipeline.output() {
            None => self.answer(found, command, recorded),
            Some(output) => {
                self.write(&namespace.0, output, &found, now)?;
                Ok(doc! {"cursor": {"firstBatch": []}})
            }
        }
    }

    fn write(
        &mut self,
        database: &str,
        output: &Output,
        found: &[RawDocumentBuf],
        now: DateTime,
    ) -> Result<(), Failure> {
        let name = |origin: &rmem::query::Origin| {
            (origin.database.clone().unwrap_or_else(|| database.to_owned()), origin.collection.clone())
        };
        match output {
            Output::Out(origin) => {
                let mut fresh = Collection::default();
                for document in found {
                    fresh.insert(&Document::try_from(document).map_err(invalid)?)?;
                }
                self.collections.insert(name(origin), fresh);
                Ok(())
            }
            Output::Merge(merge) => {
                if merge.on != ["_id"] {
                    return Err(Failure::Refused("$merge on other fields".to_owned()));
                }
                let target = self.collection(&name(&merge.into));
                for document in found {
                    merge_one(target, merge, &Document::try_from(document).map_err(invalid)?, now)?;
                }
                Ok(())
            }
        }
    }

    fn count(&mut self, namespace: &Name, command: &Document) -> Answer {
        known(command, &["query", "limit", "skip", "fields"])?;
        let filter = filter(command, "query")?;
        let (skip, limit) = (unsigned(command, "skip")?, whole(command, "limit")?.unwrap_or(0).unsigned_abs() as usize);
        let found = self.collection(namespace).matching(&filter)?.len().saturating_sub(skip);
        let n = if limit == 0 { found } else { found.min(limit) };
        Ok(doc! {"n": n as i32})
    }

    fn distinct(&mut self, namespace: &Name, command: &Document) -> Answer {
        known(command, &["key", "query"])?;
        let filter = filter(command, "query")?;
        let key = command.get_str("key").map_err(|_| Failure::Failed("key must be a string".to_owned()))?;
        let collection = self.collection(namespace);
        let mut values: Vec<Bson> = Vec::new();
        for place in collection.matching(&filter)? {
            rmem::query::distinct(&collection.documents[place], key, &mut |value| {
                if !values.iter().any(|known| compare_values(known, &value).is_eq()) {
                    values.push(value);
                }
            })?;
        }
        Ok(doc! {"values": values})
    }

    fn update(&mut self, namespace: &Name, command: &Document, recorded: &Document) -> Answer {
        known(command, &["updates", "ordered"])?;
        if command.contains_key("let") {
            return Err(Failure::Refused("option let".to_owned()));
        }
        let now = DateTime::now();
        let upserted = recorded.get_array("upserted").cloned().unwrap_or_default();
        let (mut n, mut modified, mut errors) = (0, 0, Vec::new());
        let ordered = !command.contains_key("ordered") || flag(command, "ordered")?;
        for (index, one) in documents(command, "updates")?.iter().enumerate() {
            refuse_options(one)?;
            let theirs = upserted
                .iter()
                .filter_map(Bson::as_document)
                .find(|entry| entry.get_i32("index").is_ok_and(|found| found == index as i32));
            match self.update_one(namespace, one, theirs.and_then(|entry| entry.get("_id")), now) {
                Ok(changed) => {
                    n += changed.matched + i32::from(changed.upserted.is_some());
                    modified += changed.modified;
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
        &mut self,
        namespace: &Name,
        one: &Document,
        theirs: Option<&Bson>,
        now: DateTime,
    ) -> Result<Changed, Failure> {
        let query = document(one, "q")?.cloned().unwrap_or_default();
        let filter = Filter::parse(&query)?;
        let update =
            update(one.get("u"), &documents(one, "arrayFilters")?, one.get_document("c").unwrap_or(&Document::new()))?;
        let (many, upsert) = (flag(one, "multi")?, flag(one, "upsert")?);
        if many && update.is_replacement() {
            return Err(Failure::Failed("multi update with a replacement".to_owned()));
        }
        let collection = self.collection(namespace);
        let mut places = collection.matching(&filter)?;
        if !many {
            places.truncate(1);
        }
        let mut changed = collection.update(&places, &filter, &update, now)?;
        if places.is_empty() && upsert {
            changed.upserted = Some(collection.upsert(update.upsert(&query, now)?, theirs)?);
        }
        Ok(changed)
    }

    fn delete(&mut self, namespace: &Name, command: &Document) -> Answer {
        known(command, &["deletes", "ordered"])?;
        if command.contains_key("let") {
            return Err(Failure::Refused("option let".to_owned()));
        }
        if !matches!(command.get("deletes"), Some(Bson::Array(deletes)) if !deletes.is_empty()) {
            return Err(Failure::Failed("deletes is needed".to_owned()));
        }
        let (mut n, mut errors) = (0, Vec::new());
        for one in documents(command, "deletes")? {
            refuse_options(&one)?;
            let limit = whole(&one, "limit")?;
            if !one.contains_key("q") || !matches!(limit, Some(0 | 1)) {
                return Err(Failure::Failed("q and limit are needed".to_owned()));
            }
            let removed = filter(&one, "q").and_then(|filter| {
                let collection = self.collection(namespace);
                let mut places = collection.matching(&filter)?;
                if limit == Some(1) {
                    places.truncate(1);
                }
                collection.remove(&places);
                Ok(places.len())
            });
            match removed {
                Ok(removed) => n += removed as i32,
                Err(Failure::Refused(name)) => return Err(Failure::Refused(name)),
                Err(Failure::Failed(message)) => {
                    errors.push(Bson::String(message));
                    if !command.contains_key("ordered") || flag(command, "ordered")? {
                        break;
                    }
                }
            }
        }
        Ok(reply(doc! {"n": n}, errors))
    }

    fn find_and_modify(&mut self, namespace: &Name, command: &Document, recorded: &Document) -> Answer {
        known(command, &["query", "sort", "update", "remove", "new", "fields", "upsert", "arrayFilters"])?;
        let now = DateTime::now();
        let query = document(command, "query")?.cloned().unwrap_or_default();
        let filter = filter(command, "query")?;
        let sort = Sort::parse(document(command, "sort")?.unwrap_or(&Document::new()))?;
        let projection = Projection::parse(document(command, "fields")?.unwrap_or(&Document::new()))?;
        let (remove, new, upsert) = (flag(command, "remove")?, flag(command, "new")?, flag(command, "upsert")?);
        if remove == command.contains_key("update") || remove && (new || upsert) {
            return Err(Failure::Failed("either update or remove".to_owned()));
        }
        let change = if remove {
            None
        } else {
            Some(update(command.get("update"), &documents(command, "arrayFilters")?, &Document::new())?)
        };
        let collection = self.collection(namespace);
        let mut places = collection.matching(&filter)?;
        let mut keyed = Vec::new();
        for place in places {
            keyed.push((sort.key(&collection.documents[place])?, place));
        }
        keyed.sort();
        places = keyed.into_iter().map(|(_, place)| place).take(1).collect();
        let before = places.first().map(|place| collection.documents[*place].clone());
        let mut after = None;
        match (&change, before.is_some()) {
            (None, _) => collection.remove(&places),
            (Some(update), true) => {
                collection.update(&places, &filter, update, now)?;
                after = places.first().map(|place| collection.documents[*place].clone());
            }
            (Some(update), false) if upsert => {
                let theirs = recorded.get_document("lastErrorObject").ok().and_then(|last| last.get("upserted"));
                collection.upsert(update.upsert(&query, now)?, theirs)?;
                after = collection.documents.last().cloned();
            }
            _ => {}
        }
        let shown = if new { after } else { before };
        let value = match shown {
            Some(document) => {
                let all = Filter::parse(&Document::new())?;
                let projected = projection.apply(&document, if new { &all } else { &filter }, now)?;
                Bson::Document(Document::try_from(&projected).map_err(invalid)?)
            }
            None => Bson::Null,
        };
        Ok(doc! {"value": value})
    }
}

fn merge_one(
    target: &mut Collection,
    merge: &rmem::query::Merge,
    result: &Document,
    now: DateTime,
) -> Result<(), Failure> {
    let id = result.get("_id").cloned().unwrap_or_else(|| Bson::ObjectId(bson::oid::ObjectId::new()));
    let query = doc! {"_id": {"$eq": id.clone()}};
    let filter = Filter::parse(&query)?;
    let places = target.matching(&filter)?;
    if places.is_empty() {
        return match merge.when_not_matched {
            WhenNotMatched::Insert => Ok(target.insert(result)?),
            WhenNotMatched::Discard => Ok(()),
            WhenNotMatched::Fail => Err(Failure::Failed("no such document".to_owned())),
        };
    }
    let change = match &merge.when_matched {
        WhenMatched::KeepExisting => return Ok(()),
        WhenMatched::Fail => return Err(Failure::Failed("there is such a document".to_owned())),
        WhenMatched::Replace => Update::parse(result, &[])?,
        WhenMatched::Merge => Update::parse(&doc! {"$set": result.clone()}, &[])?,
        WhenMatched::Pipeline(stages) => Update::parse_pipeline_with(stages, &merge.constants(result, now)?)?,
    };
    target.update(&places, &filter, &change, now)?;
    Ok(())
}

fn array(found: Vec<RawDocumentBuf>) -> Result<Vec<Document>, Failure> {
    found
        .iter()
        .map(|document| Document::try_from(document).map_err(|error| Failure::Failed(error.to_string())))
        .collect()
}

fn reply(mut reply: Document, errors: Vec<Bson>) -> Document {
    if !errors.is_empty() {
        reply.insert("writeErrors", errors);
    }
    reply
}
