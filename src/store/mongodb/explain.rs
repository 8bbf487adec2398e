//! The server's explanation of a query, shortened.

use bson::{Bson, Document, doc};

use super::MongoDb;
use super::visible::for_server;
use crate::saturate::to_i64;
use crate::store::{Find, Namespace, StoreError};

impl MongoDb {
    pub(super) fn explanation(&self, ns: &Namespace, find: &Find) -> Result<Document, StoreError> {
        let filter = for_server(find)?.0.into_owned();
        let mut query = doc! { "find": &ns.collection, "filter": filter };
        for (key, document) in [("sort", &find.sort), ("projection", &find.projection)] {
            if !document.is_empty() {
                query.insert(key, document.clone());
            }
        }
        for (key, number) in [("skip", find.skip), ("limit", find.limit)] {
            if number > 0 {
                query.insert(key, to_i64(number));
            }
        }
        query.extend(find.keys.to_document());
        if let (true, Some(hint)) = (find.keys.is_bounded(), &find.modifiers.hint) {
            query.insert("hint", hint.to_bson());
        }
        let command = doc! { "explain": query, "verbosity": "executionStats" };
        let answer = self.client().database(&ns.database).run_command(command).run().map_err(|e| self.explain(&e))?;
        Ok(condensed(&answer, !find.sort.is_empty()))
    }
}

/// The server's explanation in the shape of [`crate::store::Store::explain`].
fn condensed(answer: &Document, is_sorting: bool) -> Document {
    let empty = Document::new();
    let part = |name: &str| answer.get_document(name).unwrap_or(&empty);
    let plan = part("queryPlanner").get_document("winningPlan").unwrap_or(&empty);
    // The engine that runs a plan may stand between it and the stages.
    let plan = plan.get_document("queryPlan").unwrap_or(plan);
    let mut scans = Vec::new();
    let sorts = stages(plan, &mut scans);
    let mut explanation = match scans.len() {
        0 => doc! { "index": Bson::Null },
        1 => scans.swap_remove(0),
        _ => doc! { "any": scans },
    };
    if is_sorting {
        explanation.insert("sort", if sorts { "memory" } else { "index" });
    }
    let statistics = part("executionStats");
    for (name, theirs) in
        [("keys_examined", "totalKeysExamined"), ("documents_examined", "totalDocsExamined"), ("returned", "nReturned")]
    {
        explanation.insert(name, statistics.get(theirs).cloned().unwrap_or(Bson::Int64(0)));
    }
    explanation
}

/// Collects the scans of indexes; returns whether documents are sorted in memory.
fn stages(stage: &Document, scans: &mut Vec<Document>) -> bool {
    let name = stage.get_str("stage").unwrap_or_default();
    if let Ok(index) = stage.get_str("indexName") {
        let of = |key: &str| stage.get_document(key).cloned().unwrap_or_default();
        scans.push(doc! { "index": index, "keys": of("keyPattern"), "bounds": of("indexBounds") });
    } else if name == "IDHACK" {
        scans.push(doc! { "index": "_id_", "keys": { "_id": 1 } });
    }
    let one = stage.get_document("inputStage").into_iter();
    let more = stage.get_array("inputStages").into_iter().flatten().filter_map(Bson::as_document);
    one.chain(more).fold(name == "SORT", |sorts, input| stages(input, scans) || sorts)
}
