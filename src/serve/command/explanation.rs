//! How a query is answered, in the words of MongoDB.

use bson::{Bson, Document, doc};

use super::definition::raw;
use super::handshake::VERSION;
use crate::saturate::to_i64;
use crate::serve::call::Call;
use crate::serve::failure::{Answer, Failure};
use crate::serve::fields::{number, whole};
use crate::serve::host::Host;
use crate::store::{Find, Namespace};

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

pub(super) fn explained(
    host: &Host<'_>,
    call: &Call,
    ns: &Namespace,
    find: &Find,
    is_run: bool,
) -> Result<Document, Failure> {
    let explained = call.access(host.memory()?).explain(ns, find)?;
    let counted = |name: &str| number(explained.get(name).and_then(whole).unwrap_or_default());
    let plan = plan(&explained, find);
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
        stages.insert("nReturned", counted("returned"));
        reply.insert(
            "executionStats",
            doc! {
                "executionSuccess": true,
                "nReturned": counted("returned"),
                "executionTimeMillis": number(to_i64(call.request.since.elapsed().as_millis())),
                "totalKeysExamined": counted("keys_examined"),
                "totalDocsExamined": counted("documents_examined"),
                "executionStages": stages,
            },
        );
    }
    if let Some(computables) = explained.get("computables") {
        reply.insert("computables", computables.clone());
    }
    reply.insert("serverInfo", server_info());
    Ok(reply)
}

/// The stages by which documents are found.
fn plan(explained: &Document, find: &Find) -> Document {
    let alternatives: Vec<Document> =
        explained.get_array("any").into_iter().flatten().filter_map(Bson::as_document).map(scan).collect();
    let source = match (alternatives.is_empty(), explained.get_str("index")) {
        (false, _) => doc! { "stage": "FETCH", "inputStage": { "stage": "OR", "inputStages": alternatives } },
        (true, Ok(_)) => doc! { "stage": "FETCH", "filter": find.filter.clone(), "inputStage": scan(explained) },
        (true, Err(_)) => doc! { "stage": "COLLSCAN", "filter": find.filter.clone(), "direction": "forward" },
    };
    let sorted = match explained.get_str("sort") {
        Ok("memory") => doc! { "stage": "SORT", "sortPattern": find.sort.clone(), "inputStage": source },
        _ => source,
    };
    let returned = match find.keys.return_key {
        true => doc! { "stage": "RETURN_KEY", "inputStage": sorted },
        false => sorted,
    };
    match find.limit {
        0 => returned,
        limit => doc! { "stage": "LIMIT", "limitAmount": limit.cast_signed(), "inputStage": returned },
    }
}

fn scan(explained: &Document) -> Document {
    let of = |name: &str| explained.get(name).cloned().unwrap_or_else(|| Document::new().into());
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
