//! Why the results of a pipeline could not be written, as MongoDB says it.

use bson::{Bson, Document};

use crate::query::Pipeline;
use crate::serve::failure::{Failure, codes};

/// Why a pipeline that writes its results failed, as MongoDB says it: what is wrong in the pipeline itself, it refuses before.
pub(super) fn explained(stages: &[Document], failure: Failure) -> Failure {
    if failure.is_of_server() || failure.code == codes::NO_UNIQUE_INDEX || Pipeline::parse(stages).is_err() {
        return failure;
    }
    let merge = stages.last().and_then(|stage| stage.get("$merge"));
    let failure = match merge.and_then(|merge| refused_merge(merge, &failure)) {
        Some(why) => failure.caused(why),
        None => failure,
    };
    failure.caused("PlanExecutor error during aggregation")
}

/// What MongoDB says of a document that `$merge` cannot add or change.
fn refused_merge(merge: &Bson, failure: &Failure) -> Option<&'static str> {
    let merge = merge.as_document();
    let on = match merge.and_then(|merge| merge.get("on")) {
        Some(Bson::String(field)) => vec![field.as_str()],
        Some(Bson::Array(fields)) => fields.iter().filter_map(Bson::as_str).collect(),
        _ => vec!["_id"],
    };
    let fails = merge.is_some_and(|merge| merge.get_str("whenMatched").ok() == Some("fail"));
    let is_on = |key: &Document| key.len() == on.len() && on.iter().all(|field| key.contains_key(field));
    match failure.code {
        codes::IMMUTABLE => {
            Some("$merge failed to update the matching document, did you attempt to modify the _id or the shard key?")
        }
        codes::DUPLICATE if fails && failure.details.get_document("keyPattern").is_ok_and(is_on) => {
            Some("$merge with whenMatched: fail found an existing document with the same values for the 'on' fields")
        }
        codes::DUPLICATE => Some("$merge failed due to a DuplicateKey error"),
        _ => None,
    }
}
