//! `aggregate`: pipelines over documents, over changes, and over what the server knows of itself.

use bson::{Bson, Document, RawDocumentBuf, doc};

use super::definition::{Command, Run, raw};
use super::{results, statistics};
use crate::memory::Memory;
use crate::query::{Description, Origin, Pipeline, QueryError, type_name};
use crate::serve::call::Call;
use crate::serve::changes::{Behind, Following, Spec, Stream};
use crate::serve::clock;
use crate::serve::cursor::{Open, Owner};
use crate::serve::failure::{Answer, Failure, codes};
use crate::serve::fields::{Fields, integral, whole};
use crate::serve::host::{FirstBatch, Host};
use crate::serve::request::{Request, namespace};
use crate::store::namespace::NO_COLLECTION;
use crate::store::{Aggregation, Documents, Namespace, Scope, StoreError};

pub(super) const COMMANDS: &[Command] =
    &[Command { name: "aggregate", run: Run::Sliced(writes, read, write), is_open: false, in_transaction: true }];

/// What is taken, or makes no difference here.
const TAKEN: [&str; 12] = [
    "collation",
    "let",
    "pipeline",
    "cursor",
    "explain",
    "allowDiskUse",
    "bypassDocumentValidation",
    "hint",
    "fromMongos",
    "needsMerge",
    "isMapReduceCommand",
    "runtimeConstants",
];

/// Whether the pipeline ends in a collection.
fn writes(request: &Request) -> bool {
    if matches!(request.body.get("explain"), Some(Bson::Boolean(true))) {
        return false;
    }
    let last = request.body.get_array("pipeline").ok().and_then(|stages| stages.last()).and_then(Bson::as_document);
    last.and_then(|stage| stage.keys().next()).is_some_and(|name| name == "$out" || name == "$merge")
}

/// The collection, where there is one, and the stages.
pub(super) fn pipeline(call: &Call, fields: Fields<'_>) -> Result<(Namespace, Vec<Document>), Failure> {
    fields.check(&TAKEN, &["encryptionInformation", "exchange"])?;
    fields.strict_flag("allowDiskUse")?;
    let stages = fields.documents("pipeline")?.ok_or_else(|| fields.missing("pipeline"))?;
    let stages: Vec<Document> = stages.into_iter().cloned().collect();
    let ns = match call.request.target() {
        Some(Bson::String(_)) => call.request.readable()?,
        Some(number) if integral(number) == Some(1) => {
            let database = namespace(&call.request.database, "x")?.database;
            Namespace { database, collection: NO_COLLECTION.to_owned() }
        }
        Some(other) if whole(other).is_none() => {
            let message = format!("collection name has invalid type: {}", type_name(other));
            return Err(Failure::new(codes::TYPE_MISMATCH, message));
        }
        _ => {
            return Err(Failure::new(
                codes::FAILED_TO_PARSE,
                "Invalid command format: the 'aggregate' field must specify a collection name or 1",
            ));
        }
    };
    if stages.iter().any(|stage| stage.len() != 1) {
        let message = "A pipeline stage specification object must contain exactly one field.";
        return Err(Failure::new(codes::MALFORMED_STAGE, message));
    }
    Ok((ns, stages))
}

fn batch(fields: Fields<'_>) -> Result<FirstBatch, Failure> {
    let Some(cursor) = fields.document("cursor")? else {
        let message = "The 'cursor' option is required, except for aggregate with the explain argument";
        return Err(Failure::new(codes::FAILED_TO_PARSE, message));
    };
    let cursor = Fields::new("aggregate.cursor", cursor);
    cursor.known_inside(&["batchSize"])?;
    Ok(FirstBatch { size: cursor.size("batchSize")?, ..FirstBatch::default() })
}

fn read(host: &mut Host<'_>, call: &Call) -> Answer {
    let fields = call.request.fields();
    let (ns, stages) = pipeline(call, fields)?;
    if fields.strict_flag("explain")? {
        if fields.document.contains_key("writeConcern") {
            let message = "Aggregation explain does not support the 'writeConcern' option";
            return Err(Failure::new(codes::FAILED_TO_PARSE, message));
        }
        if fields.document("cursor")?.is_some() {
            batch(fields)?;
        }
        fields.modifiers()?;
        return super::explanation::of_pipeline(host, call, &ns, &stages);
    }
    let batch = batch(fields)?;
    if let Some(spec) = Spec::read(&call.request, &stages)? {
        return follow(host, call, spec, batch);
    }
    let memory = host.memory()?;
    let documents = match own_source(host, call, &ns, &stages)? {
        Some(documents) => through(stages.get(1..).unwrap_or_default(), documents)?,
        None => {
            check_source(&ns, &stages)?;
            call.access(memory).aggregate(&ns, Aggregation { stages: &stages, modifiers: &fields.modifiers()? })?
        }
    };
    call.request.check_ending()?;
    host.answer(&ns, call.request.origin(), documents, batch)
}

fn write(memory: &Memory, call: &Call) -> Answer {
    let fields = call.request.fields();
    let (ns, stages) = pipeline(call, fields)?;
    if call.request.is_in_transaction() {
        let message = "$out and $merge cannot be used in a transaction";
        return Err(Failure::new(codes::NOT_IN_TRANSACTION, message));
    }
    let level = fields.document("readConcern")?.and_then(|concern| concern.get_str("level").ok());
    if level == Some("linearizable") {
        let message = "$out and $merge cannot be used with a 'linearizable' read concern level";
        return Err(Failure::new(codes::INVALID_OPTIONS, message));
    }
    batch(fields)?;
    // Behind `$changeStream`, neither of them may be.
    Spec::read(&call.request, &stages)?;
    check_source(&ns, &stages)?;
    let aggregation = Aggregation { stages: &stages, modifiers: &fields.modifiers()? };
    let written = call.access(memory).aggregate(&ns, aggregation);
    let written = written.and_then(|mut rest| rest.try_for_each(|document| document.map(drop)));
    if let Err(error) = written {
        let failure = Failure::from(error);
        // A MongoDB server says itself what it did.
        return Err(if memory.is_current(&ns)? { results::explained(&stages, failure) } else { failure });
    }
    Ok(crate::serve::cursor::reply(0, &ns.to_string(), &bson::RawArrayBuf::new(), true))
}

/// A pipeline of no collection brings its own documents.
fn check_source(ns: &Namespace, stages: &[Document]) -> Result<(), Failure> {
    let brings = stages.first().is_some_and(|stage| stage.contains_key("$documents"));
    if brings == (ns.collection == NO_COLLECTION) {
        return Ok(());
    }
    // A stage that is unknown or not supported is named as that.
    Pipeline::parse(stages.get(..1).unwrap_or_default())?;
    let first = stages.first().and_then(|stage| stage.keys().next()).map_or("an empty pipeline", String::as_str);
    let message = match brings {
        true => "$documents is for `aggregate: 1`, not for a collection".to_owned(),
        false => format!("{{aggregate: 1}} is not valid for {first}; a collection is required"),
    };
    Err(Failure::new(codes::INVALID_NAMESPACE, message))
}

/// What the server knows of itself, where that is asked for.
fn own_source(
    host: &Host<'_>,
    call: &Call,
    ns: &Namespace,
    stages: &[Document],
) -> Result<Option<Vec<Document>>, Failure> {
    let Some((name, argument)) = stages.first().and_then(|stage| stage.iter().next()) else { return Ok(None) };
    let memory = host.memory()?;
    let is_own = matches!(name.as_str(), "$collStats" | "$indexStats" | "$currentOp" | "$planCacheStats");
    if is_own && call.request.is_in_transaction() {
        let message = format!("Stage not supported inside of a multi-document transaction: {name}");
        return Err(Failure::new(codes::NOT_IN_TRANSACTION, message));
    }
    Ok(Some(match name.as_str() {
        "$collStats" => vec![statistics::stage(memory, call, ns, argument)?],
        "$indexStats" => {
            Description::parse(&doc! { "$indexStats": argument })?;
            statistics::indexes(memory, ns)?
        }
        "$currentOp" => {
            let lists_idle = check_current_op(call, ns, argument)?;
            super::operation::operations(&host.server, lists_idle)
        }
        "$listSessions" | "$listLocalSessions" | "$planCacheStats" => {
            return Err(Failure::unsupported(&format!("the stage {name}")));
        }
        _ => return Ok(None),
    }))
}

/// What is said of the operations to be listed: whether connections that do nothing are, too.
fn check_current_op(call: &Call, ns: &Namespace, argument: &Bson) -> Result<bool, Failure> {
    const OPTIONS: [&str; 7] =
        ["allUsers", "backtrace", "idleConnections", "idleCursors", "idleSessions", "localOps", "truncateOps"];
    if ns.database != "admin" || ns.collection != NO_COLLECTION {
        let message = "$currentOp must be run against the 'admin' database with {aggregate: 1}";
        return Err(Failure::new(codes::INVALID_NAMESPACE, message));
    }
    let Bson::Document(options) = argument else {
        return Err(Failure::new(codes::TYPE_MISMATCH, "$currentOp options must be specified in an object"));
    };
    if let Some(other) = options.keys().find(|name| !OPTIONS.contains(&name.as_str())) {
        return Err(Failure::new(
            codes::FAILED_TO_PARSE,
            format!("Unrecognized option '{other}' in $currentOp stage."),
        ));
    }
    let level = call.request.fields().document("readConcern")?.and_then(|concern| concern.get_str("level").ok());
    if let Some(level) = level.filter(|level| *level != "local") {
        let message = format!("$currentOp cannot run with a readConcern other than 'local', found '{level}'");
        return Err(Failure::new(codes::INVALID_OPTIONS, message));
    }
    let options = Fields::new("$currentOp", options);
    OPTIONS.iter().try_for_each(|name| options.strict_flag(name).map(drop))?;
    options.strict_flag("idleConnections")
}

/// Documents that are there already, through the stages behind the one that gave them.
fn through<'m>(stages: &[Document], documents: Vec<Document>) -> Result<Documents<'m>, Failure> {
    let mut raw = Vec::new();
    for document in &documents {
        raw.push(Ok::<_, QueryError>(RawDocumentBuf::try_from(document)?));
    }
    let none = |_: &Origin, _: Option<&Document>| Ok::<_, QueryError>(None);
    let pipeline = Pipeline::parse(stages)?;
    let results: Vec<_> = pipeline.run(Box::new(raw.into_iter()), bson::DateTime::now(), &none).collect();
    Ok(Box::new(results.into_iter().map(|result| result.map_err(StoreError::from))))
}

/// Opens a change stream.
fn follow(host: &mut Host<'_>, call: &Call, spec: Spec, batch: FirstBatch) -> Answer {
    if call.request.is_in_transaction() {
        let message = "$changeStream cannot be used in a transaction";
        return Err(Failure::new(codes::NOT_IN_TRANSACTION, message));
    }
    let ns = place(&spec.scope);
    let (stream, first) = match host.memory()?.is_current(&ns)? {
        true => {
            let mut stream = open_kept(host, call, spec, &ns)?;
            let first = stream.next(host.memory()?, Some(crate::serve::cursor::first_batch(batch.size)))?;
            (Following::File(stream), first)
        }
        false => {
            let (stream, first) =
                Behind::open(host.memory()?, spec, call.metadata, host.server.clock.now(), batch.size)?;
            (Following::Server(stream), first)
        }
    };
    let id = if first.is_over {
        0
    } else {
        let owner = Owner::Stream(std::sync::Arc::new(std::sync::Mutex::new(stream)));
        host.server.cursors.open(Open::new(ns.clone(), call.request.origin(), owner, host.id))?
    };
    super::cursor::stream_reply(id, &ns.to_string(), &first, true)
}

/// Opens a change stream of a file, whose changes are kept from now on.
fn open_kept(host: &mut Host<'_>, call: &Call, spec: Spec, ns: &Namespace) -> Result<Stream, Failure> {
    if host.server.options.read_only {
        let message = "changes are not kept where a memory is served read-only, so there are no change streams";
        return Err(Failure::new(codes::ILLEGAL, message));
    }
    spec.check_start()?;
    let (scope, server) = (spec.scope.clone(), std::sync::Arc::clone(&host.server));
    let kept = host.write(
        ns.clone(),
        None,
        call.request.limits(),
        Box::new(move |memory| {
            let written = server.clock.written().unwrap_or(clock::of(server.started, 0));
            let kept = server.scopes.keep(memory, &scope, written, &server.ages)?;
            raw(&doc! { "from": kept.from, "last": kept.last, "isNew": kept.is_new })
        }),
    )?;
    let number = |name| kept.get_i64(name).map_err(|error| Failure::new(codes::INTERNAL, error.to_string()));
    let is_new = kept.get_bool("isNew").is_ok_and(|is_new| is_new);
    let kept = crate::store::Kept { from: number("from")?, last: number("last")?, is_new };
    Stream::open(host.memory()?, spec, kept, (&host.server.scopes, &host.server.ages), call.metadata)
}

/// The namespace of a stream's cursor.
fn place(scope: &Scope) -> Namespace {
    let all = |database: &str| Namespace { database: database.to_owned(), collection: NO_COLLECTION.to_owned() };
    match scope {
        Scope::Collection(ns) => ns.clone(),
        Scope::Database(database) => all(database),
        Scope::All => all("admin"),
    }
}
