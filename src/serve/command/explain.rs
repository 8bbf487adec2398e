//! `explain`: how a query is answered, in the words of MongoDB.

use bson::{Bson, Document, doc};

use super::handshake::VERSION;
use super::{Call, Command, aggregate, find, raw};
use crate::serve::failure::{Answer, Failure, codes};
use crate::serve::fields::Fields;
use crate::serve::host::Host;
use crate::serve::request::Request;
use crate::store::{Find, Namespace};

pub(super) const COMMANDS: &[Command] = &[Command::read("explain", explain)];

fn explain(host: &mut Host<'_>, call: &Call) -> Answer {
    let fields = call.request.fields();
    fields.known(&["verbosity"])?;
    let Some(Bson::Document(inner)) = call.request.target() else { return Err(fields.missing("explain")) };
    let mut inner = inner.clone();
    inner.insert("$db", &call.request.database);
    let is_run = match fields.text("verbosity")?.unwrap_or("allPlansExecution") {
        "queryPlanner" => false,
        "executionStats" | "allPlansExecution" => true,
        other => {
            let message = format!(
                "verbosity string must be one of {{'queryPlanner', 'executionStats', 'allPlansExecution'}}, not '{other}'"
            );
            return Err(Failure::new(codes::FAILED_TO_PARSE, message));
        }
    };
    let inner = Call { request: Request::read(inner)?, metadata: call.metadata };
    let ns = inner.request.readable()?;
    let fields = inner.request.fields();
    let asked = match inner.request.name.as_str() {
        "find" => find::read(fields)?,
        "count" => Find { filter: fields.document_or_empty("query")?, ..Find::default() },
        "distinct" => Find { filter: fields.document_or_empty("query")?, ..Find::default() },
        "findAndModify" => Find {
            filter: fields.document_or_empty("query")?,
            sort: fields.document_or_empty("sort")?,
            limit: 1,
            ..Find::default()
        },
        "update" => Find { filter: statement(fields, "updates")?, ..Find::default() },
        "delete" => Find { filter: statement(fields, "deletes")?, ..Find::default() },
        "aggregate" => {
            let (ns, stages) = aggregate::pipeline(&inner, fields)?;
            return of_pipeline(host, &inner, &ns, &stages);
        }
        other => {
            return Err(Failure::new(codes::NO_COMMAND, format!("Explain failed due to unknown command: {other}")));
        }
    };
    raw(&explained(host, &inner, &ns, &asked, is_run)?)
}

/// What the first statement of a write looks for.
fn statement(fields: Fields<'_>, name: &str) -> Result<Document, Failure> {
    let statements = fields.documents(name)?.unwrap_or_default();
    let first = statements.first().ok_or_else(|| fields.missing(name))?;
    Fields::new(name, first).document_or_empty("q")
}

/// How a pipeline is answered: what its first stage looks for, and the others.
pub(super) fn of_pipeline(host: &Host<'_>, call: &Call, ns: &Namespace, stages: &[Document]) -> Answer {
    let filter = stages.first().and_then(|stage| stage.get_document("$match").ok()).cloned().unwrap_or_default();
    let find = Find { filter, ..Find::default() };
    let mut first = explained(host, call, ns, &find, true)?;
    first.remove("serverInfo");
    let mut all = vec![doc! { "$cursor": first }];
    all.extend(stages.iter().cloned());
    raw(&doc! { "stages": all, "serverInfo": server_info(), "explainVersion": "1" })
}

fn explained(host: &Host<'_>, call: &Call, ns: &Namespace, find: &Find, is_run: bool) -> Result<Document, Failure> {
    let account = call.access(host.memory()?).explain(ns, find)?;
    let number = |name: &str| account.get(name).cloned().unwrap_or(Bson::Int64(0));
    let plan = plan(&account, find);
    let mut reply = doc! {
        "explainVersion": "1",
        "queryPlanner": {
            "namespace": ns.to_string(),
            "indexFilterSet": false,
            "parsedQuery": find.filter.clone(),
            "winningPlan": plan.clone(),
            "rejectedPlans": Bson::Array(Vec::new()),
        },
    };
    if is_run {
        let mut stages = plan;
        stages.insert("nReturned", number("returned"));
        reply.insert(
            "executionStats",
            doc! {
                "executionSuccess": true,
                "nReturned": number("returned"),
                "executionTimeMillis": i64::try_from(call.request.since.elapsed().as_millis()).unwrap_or(i64::MAX),
                "totalKeysExamined": number("keys_examined"),
                "totalDocsExamined": number("documents_examined"),
                "executionStages": stages,
            },
        );
    }
    if let Some(computables) = account.get("computables") {
        reply.insert("computables", computables.clone());
    }
    reply.insert("serverInfo", server_info());
    Ok(reply)
}

/// The stages by which documents are found.
fn plan(account: &Document, find: &Find) -> Document {
    let alternatives: Vec<Document> =
        account.get_array("any").into_iter().flatten().filter_map(Bson::as_document).map(scan).collect();
    let source = match (alternatives.is_empty(), account.get_str("index")) {
        (false, _) => doc! { "stage": "FETCH", "inputStage": { "stage": "OR", "inputStages": alternatives } },
        (true, Ok(_)) => doc! { "stage": "FETCH", "filter": find.filter.clone(), "inputStage": scan(account) },
        (true, Err(_)) => doc! { "stage": "COLLSCAN", "filter": find.filter.clone(), "direction": "forward" },
    };
    let sorted = match account.get_str("sort") {
        Ok("memory") => doc! { "stage": "SORT", "sortPattern": find.sort.clone(), "inputStage": source },
        _ => source,
    };
    match find.limit {
        0 => sorted,
        limit => doc! { "stage": "LIMIT", "limitAmount": limit.cast_signed(), "inputStage": sorted },
    }
}

fn scan(account: &Document) -> Document {
    let of = |name: &str| account.get(name).cloned().unwrap_or_else(|| Document::new().into());
    doc! {
        "stage": "IXSCAN",
        "keyPattern": of("keys"),
        "indexName": of("index"),
        "direction": "forward",
        "indexBounds": of("bounds"),
    }
}

fn server_info() -> Document {
    doc! { "host": "rmem", "port": 0, "version": VERSION, "gitVersion": env!("CARGO_PKG_VERSION") }
}
