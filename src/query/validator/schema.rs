//! `$jsonSchema`: why a schema does not hold for a document.

use bson::{Bson, Document, doc};

use super::keyword::titled;
use super::rule::{Place, failing, never};

/// Returns why a schema does not hold for a document or, with `holds`, that it does.
pub(super) fn explain(schema: &Document, document: &Document, holds: bool) -> Document {
    let mut details = doc! { "operatorName": "$jsonSchema" };
    if holds {
        details.insert("reason", "schema matched");
        return details;
    }
    let document = Bson::Document(document.clone());
    if let Some(details) = never(schema, &document, Place::Whole) {
        return details;
    }
    titled(schema, &mut details);
    details.insert("schemaRulesNotSatisfied", failing(schema, &document, Place::Whole));
    details
}
