//! `$jsonSchema`: why a schema does not hold for a document.

use bson::{Bson, Document, doc};

use super::keyword::{alone, satisfies, titled};
use super::rule::failing;

/// Returns why a schema does not hold for a document or, with `holds`, that it does.
pub(super) fn explain(schema: &Document, document: &Document, holds: bool) -> Document {
    let mut details = doc! { "operatorName": "$jsonSchema" };
    if holds {
        details.insert("reason", "schema matched");
        return details;
    }
    let document = Bson::Document(document.clone());
    let fails = |keyword: &&str| !satisfies(&alone(schema, keyword), &document);
    if ["type", "bsonType"].iter().any(|keyword| schema.contains_key(keyword) && fails(keyword)) {
        details.insert("specifiedAs", doc! { "$jsonSchema": schema.clone() });
        details.insert("reason", "expression always evaluates to false");
        return details;
    }
    titled(schema, &mut details);
    let mut rules = failing(schema, &document);
    for rule in &mut rules {
        let options = schema.get_array("enum").map(Vec::as_slice).unwrap_or_default();
        // No document can be what is no document.
        if rule.get_str("operatorName").is_ok_and(|name| name == "enum")
            && !options.iter().any(|option| option.as_document().is_some())
        {
            rule.remove("consideredValue");
            rule.insert("reason", "expression always evaluates to false");
        }
    }
    details.insert("schemaRulesNotSatisfied", rules);
    details
}
