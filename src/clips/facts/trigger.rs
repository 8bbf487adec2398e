//! Changes of the memory as facts of CLIPS.

use std::time::{Duration, UNIX_EPOCH};

use bson::{Bson, Document, doc};

use super::error::FactError;
use super::export::Exporter;
use super::key::RELATION;
use super::nested::Nested;
use super::schema::Schema;
use crate::formats::clips::{Fact, Item, Reader};
use crate::formats::{Source, shell};
use crate::saturate::to_i64;

/// What a program of CLIPS has to know of the facts: each document is JSON, in a string, and
/// empty where there is none.
pub const TRIGGER: &str = "(deftemplate robmem-trigger
   (slot name (type STRING))
   (multislot rcvd-at (type INTEGER) (cardinality 2 2))
   (slot operation (type SYMBOL))
   (slot namespace (type STRING))
   (slot id (type STRING))
   (slot before (type STRING))
   (slot after (type STRING)))";

/// The facts of one change, as the document of [`crate::memory::watch::event`]: a
/// `robmem-trigger`, and where the trigger has a name that is a symbol, the ordered
/// fact of that name. `received` is the time since 1970.
///
/// # Errors
/// Where a text holds what no string of CLIPS can.
pub fn trigger(name: Option<&str>, event: &Document, received: Duration) -> Result<Vec<Fact>, FactError> {
    let schema = schema();
    let exporter = Exporter { schema: &schema, nested: Nested::Refuse, strict: false };
    let namespace = event.get_str("ns").unwrap_or_default();
    let json = |key: &str| event.get(key).map(shell::relaxed_value).unwrap_or_default();
    let seconds = to_i64(received.as_secs());
    let fact = doc! {
        RELATION: "robmem-trigger",
        "name": name.unwrap_or(namespace),
        "rcvd-at": [Bson::Int64(seconds), Bson::Int64(i64::from(received.subsec_micros()))],
        "operation": event.get_str("operation").unwrap_or_default(),
        "namespace": namespace,
        "id": json("_id"),
        "before": json("before"),
        "after": json("after"),
    };
    let mut facts = vec![exporter.fact(&fact)?];
    facts.extend(name.and_then(|name| exporter.fact(&doc! { RELATION: name }).ok()));
    Ok(facts)
}

/// The time since 1970.
#[must_use]
pub fn now() -> Duration {
    UNIX_EPOCH.elapsed().unwrap_or_default()
}

fn schema() -> Schema {
    let mut schema = Schema::default();
    for item in Reader::of_templates(&Source::new("<robmem-trigger>", TRIGGER)) {
        if let Ok(Item::Template(template)) = item {
            schema.add(template);
        }
    }
    schema
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::clips::{write_fact, write_value};

    fn written(name: Option<&str>, event: &Document) -> Vec<String> {
        let facts = trigger(name, event, Duration::from_micros(5_000_017)).unwrap();
        let text = |fact: &Fact| {
            let mut text = String::new();
            write_fact(fact, write_value, &mut text);
            text
        };
        facts.iter().map(text).collect()
    }

    #[test]
    fn a_change_is_a_fact_with_its_documents_as_text() {
        let event = doc! { "operation": "update", "ns": "a.b", "_id": 1, "after": { "_id": 1, "s": "\"x\"" } };
        assert_eq!(
            written(None, &event),
            [
                r#"(robmem-trigger (name "a.b") (rcvd-at 5 17) (operation update) (namespace "a.b") (id "1") (before "") (after "{\"_id\":1,\"s\":\"\\\"x\\\"\"}"))"#
            ]
        );
    }

    #[test]
    fn a_name_that_is_a_symbol_is_asserted_too() {
        let event = doc! { "operation": "drop", "ns": "a.b" };
        assert_eq!(written(Some("orders"), &event).last().unwrap(), "(orders)");
        for name in ["two words", "and", "3"] {
            assert_eq!(written(Some(name), &event).len(), 1, "{name}");
        }
    }
}
