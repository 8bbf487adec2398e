//! MongoDB's commands as operations of the embedded store.

use std::collections::HashMap;

use bson::{Bson, Document, RawDocumentBuf, doc};
use rmem::query::Collation;
use rmem::store::{Aggregation, Embedded, Find, Index, Namespace, Query, Store as _, StoreError};

use crate::command::{Answer, Failure, document, documents, flag, known, modifiers, refuse_options, unsigned, whole};

/// An embedded store in memory, and the cursors over its answers.
pub(crate) struct Server {
    pub(crate) store: Embedded,
    cursors: HashMap<i64, Vec<Document>>,
}

impl Server {
    pub(crate) fn open() -> Result<Self, StoreError> {
        Ok(Self { store: Embedded::in_memory()?, cursors: HashMap::new() })
    }

    /// Answers a command in the shape of mongod's reply. The recorded reply is
    /// given for what cannot be known: ids that mongod made.
    pub(crate) fn run(&mut self, command: &Document, recorded: &Document) -> Answer {
        let Some((name, target)) = command.iter().next() else { return Ok(doc! {}) };
        let database = command.get_str("$db").unwrap_or_default().to_owned();
        match name.as_str() {
            "getMore" => return self.more(command),
            "listCollections" => return Ok(doc! {}),
            "dropDatabase" => return self.drop_database(&database),
            _ => {}
        }
        let collection = match target {
            Bson::String(collection) if !collection.is_empty() => collection.clone(),
            Bson::Int32(1) | Bson::Int64(1) if name == "aggregate" => NO_COLLECTION.to_owned(),
            Bson::Double(one) if *one == 1.0 && name == "aggregate" => NO_COLLECTION.to_owned(),
            _ => return Err(Failure::Failed("not a collection".to_owned())),
        };
        let ns = Namespace { database, collection };
        match name.as_str() {
            "drop" => self.store.drop(&ns).map(|_| doc! {}).map_err(Into::into),
            "create" => {
                refuse_options(command)?;
                let collation = document(command, "collation")?.map(Collation::parse).transpose()?;
                self.store.create(&ns, collation.as_ref()).map(|_| doc! {}).map_err(Into::into)
            }
            "createIndexes" => self.create_indexes(&ns, command),
            "insert" => self.insert(&ns, command),
            "find" => self.find(&ns, command, recorded),
            "aggregate" => self.aggregate(&ns, command, recorded),
            "count" => self.count(&ns, command),
            "distinct" => self.distinct(&ns, command),
            "update" => self.update(&ns, command, recorded),
            "delete" => self.delete(&ns, command),
            "findAndModify" => self.find_and_modify(&ns, command, recorded),
            other => Err(Failure::Refused(format!("command {other}"))),
        }
    }

    fn drop_database(&self, database: &str) -> Answer {
        for ns in self.store.collections()?.iter().filter(|ns| ns.database == database) {
            self.store.drop(ns)?;
        }
        Ok(doc! {})
    }

    fn create_indexes(&self, ns: &Namespace, command: &Document) -> Answer {
        refuse_options(command)?;
        for index in documents(command, "indexes")? {
            self.store.create_index(ns, &Index::parse(&index)?)?;
        }
        Ok(doc! {})
    }

    fn insert(&self, ns: &Namespace, command: &Document) -> Answer {
        known(command, &["documents", "ordered"])?;
        let documents = documents(command, "documents")?;
        if documents.is_empty() || documents.len() > 100_000 {
            return Err(Failure::Failed("bad number of documents".to_owned()));
        }
        let ordered = !command.contains_key("ordered") || flag(command, "ordered")?;
        let batches: Vec<_> =
            if ordered { vec![documents] } else { documents.into_iter().map(|one| vec![one]).collect() };
        let (mut n, mut errors) = (0, Vec::new());
        for batch in batches {
            match self.store.insert(ns, batch) {
                Ok(inserted) => n += inserted.ids.len(),
                Err(error) => {
                    n += error.stored().len();
                    errors.push(message(error)?);
                }
            }
        }
        Ok(reply(doc! {"n": n as i32}, errors))
    }

    /// The first batch of an answer; the rest is kept for `getMore`.
    fn answer(&mut self, mut found: Vec<Document>, command: &Document, recorded: &Document) -> Answer {
        let options = command.get_document("cursor").unwrap_or(command);
        let batch = match options.get("batchSize") {
            None => 101,
            Some(_) => unsigned(options, "batchSize")?,
        };
        let rest = found.split_off(batch.min(found.len()));
        if let Some(id) = recorded.get_document("cursor").ok().and_then(|cursor| cursor.get_i64("id").ok()) {
            self.cursors.insert(id, rest);
        }
        Ok(doc! {"cursor": {"firstBatch": found}})
    }

    fn more(&mut self, command: &Document) -> Answer {
        let id = command.get_i64("getMore").unwrap_or(0);
        let mut found = self.cursors.remove(&id).unwrap_or_default();
        let batch = if command.contains_key("batchSize") { unsigned(command, "batchSize")? } else { usize::MAX };
        let rest = found.split_off(batch.min(found.len()));
        self.cursors.insert(id, rest);
        Ok(doc! {"cursor": {"nextBatch": found}})
    }

    fn find(&mut self, ns: &Namespace, command: &Document, recorded: &Document) -> Answer {
        known(command, &["filter", "projection", "sort", "limit", "skip", "batchSize", "singleBatch"])?;
        if command.get("filter") == Some(&Bson::Null) {
            return Err(Failure::Failed("filter must be an object".to_owned()));
        }
        let find = Find {
            filter: document(command, "filter")?.cloned().unwrap_or_default(),
            sort: document(command, "sort")?.cloned().unwrap_or_default(),
            skip: unsigned(command, "skip")? as u64,
            limit: whole(command, "limit")?.unwrap_or(0).unsigned_abs(),
            projection: document(command, "projection")?.cloned().unwrap_or_default(),
            modifiers: modifiers(command, &["collation", "let", "hint"])?,
            ..Find::default()
        };
        let found = self.found(ns, &find)?;
        self.answer(found, command, recorded)
    }

    /// All documents that a query finds.
    pub(crate) fn found(&self, ns: &Namespace, find: &Find) -> Result<Vec<Document>, Failure> {
        self.store.find(ns, find)?.map(decoded).collect()
    }

    fn aggregate(&mut self, ns: &Namespace, command: &Document, recorded: &Document) -> Answer {
        known(command, &["pipeline"])?;
        if !command.contains_key("pipeline") || !matches!(command.get("cursor"), Some(Bson::Document(_))) {
            return Err(Failure::Failed("pipeline and cursor are needed".to_owned()));
        }
        let stages = documents(command, "pipeline")?;
        let modifiers = modifiers(command, &["collation", "let", "hint"])?;
        let brings = stages.first().is_some_and(|stage| stage.contains_key("$documents"));
        let mut found: Vec<_> = self
            .store
            .aggregate(ns, Aggregation { stages: &stages, modifiers: &modifiers })?
            .map(decoded)
            .collect::<Result<_, _>>()?;
        if found.iter().any(|document| document.contains_key("storageStats")) {
            // Sizes are those of mongod's files.
            return Err(Failure::Refused("storageStats of $collStats".to_owned()));
        }
        take_host(&mut found, recorded);
        if brings != (ns.collection == NO_COLLECTION) {
            return Err(Failure::Failed("a collection, or $documents".to_owned()));
        }
        self.answer(found, command, recorded)
    }

    fn count(&self, ns: &Namespace, command: &Document) -> Answer {
        known(command, &["query", "limit", "skip", "fields"])?;
        let filter = document(command, "query")?.cloned().unwrap_or_default();
        let (skip, limit) = (unsigned(command, "skip")? as u64, whole(command, "limit")?.unwrap_or(0).unsigned_abs());
        let modifiers = modifiers(command, &["collation", "hint"])?;
        let n = match (skip, limit) {
            (0, 0) => self.store.count(ns, Query { filter: &filter, modifiers: &modifiers })?,
            _ => self.found(ns, &Find { filter, skip, limit, modifiers, ..Find::default() })?.len() as u64,
        };
        Ok(doc! {"n": n as i32})
    }

    fn distinct(&self, ns: &Namespace, command: &Document) -> Answer {
        known(command, &["key", "query"])?;
        let filter = document(command, "query")?.cloned().unwrap_or_default();
        let key = command.get_str("key").map_err(|_| Failure::Failed("key must be a string".to_owned()))?;
        let modifiers = modifiers(command, &["collation"])?;
        Ok(doc! {"values": self.store.distinct(ns, key, Query { filter: &filter, modifiers: &modifiers })?})
    }

    fn delete(&self, ns: &Namespace, command: &Document) -> Answer {
        known(command, &["deletes", "ordered"])?;
        if !matches!(command.get("deletes"), Some(Bson::Array(deletes)) if !deletes.is_empty()) {
            return Err(Failure::Failed("deletes is needed".to_owned()));
        }
        let (mut n, mut errors) = (0, Vec::new());
        for one in documents(command, "deletes")? {
            refuse_options(&one)?;
            let mut modifiers = match modifiers(&one, &["collation", "hint"]) {
                Ok(modifiers) => modifiers,
                Err(Failure::Failed(message)) if !message.contains("must be an object") => {
                    errors.push(Bson::String(message));
                    break;
                }
                Err(failure) => return Err(failure),
            };
            modifiers.variables = document(command, "let")?.cloned().unwrap_or_default();
            let limit = whole(&one, "limit")?;
            if !matches!(one.get("q"), Some(Bson::Document(_))) || !matches!(limit, Some(0 | 1)) {
                return Err(Failure::Failed("q and limit are needed".to_owned()));
            }
            let filter = document(&one, "q")?.cloned().unwrap_or_default();
            match self
                .store
                .delete(ns, Query { filter: &filter, modifiers: &modifiers }, limit == Some(1))
                .map_err(Failure::from)
            {
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
}

/// Gives documents that name their host that of the recording.
fn take_host(found: &mut [Document], recorded: &Document) {
    let Some(host) = recorded_host(recorded) else { return };
    for document in found.iter_mut().filter(|document| document.get_str("host").is_ok_and(|host| host == "rmem")) {
        document.insert("host", host);
    }
}

/// The host that the first document of a recorded answer names.
pub(crate) fn recorded_host(recorded: &Document) -> Option<&str> {
    let batch = recorded.get_document("cursor").and_then(|cursor| cursor.get_array("firstBatch"));
    batch.ok().and_then(|batch| batch.first()?.as_document()?.get_str("host").ok())
}

/// The collection of a pipeline that brings its own documents.
const NO_COLLECTION: &str = "$cmd.aggregate";

/// What a write error says; a refusal by name ends the case.
pub(crate) fn message(error: StoreError) -> Result<Bson, Failure> {
    match Failure::from(error) {
        Failure::Failed(message) => Ok(Bson::String(message)),
        refused @ Failure::Refused(_) => Err(refused),
    }
}

fn decoded(raw: Result<RawDocumentBuf, StoreError>) -> Result<Document, Failure> {
    Ok(Document::try_from(&*raw?)?)
}

pub(crate) fn reply(mut reply: Document, errors: Vec<Bson>) -> Document {
    if !errors.is_empty() {
        reply.insert("writeErrors", errors);
    }
    reply
}
