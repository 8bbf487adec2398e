//! The query room: MongoDB's semantics through its public interface.

use bson::{DateTime, Document, RawDocumentBuf, doc};
use rmem::query::{Filter, Projection, Update};

fn raw(document: &Document) -> RawDocumentBuf {
    RawDocumentBuf::try_from(document).unwrap()
}

fn matches(filter: Document, document: Document) -> bool {
    Filter::parse(&filter).unwrap().matches(&raw(&document)).unwrap()
}

#[test]
fn null_equals_missing_and_ranges_stay_in_their_type() {
    assert!(matches(doc! {"a": null}, doc! {}));
    assert!(matches(doc! {"a": {"$ne": null}}, doc! {"a": 0}));
    assert!(!matches(doc! {"a": {"$gt": 3}}, doc! {"a": "x"}));
    assert!(matches(doc! {"a": 1i64}, doc! {"a": 1.0}));
    assert!(matches(doc! {"a.b": {"$gt": 3}}, doc! {"a": [{"b": 1}, {"b": 4}]}));
    assert!(!matches(doc! {"a": {"$elemMatch": {"$gt": 3, "$lt": 5}}}, doc! {"a": [1, 9]}));
    assert!(matches(doc! {"a": {"$gt": 3, "$lt": 5}}, doc! {"a": [1, 9]}));
}

#[test]
fn an_update_says_whether_it_changed_the_document() {
    let filter = Filter::parse(&doc! {}).unwrap();
    let change = |update: Document, document: Document| {
        let update = Update::parse(&update, &[]).unwrap();
        let after = update.apply(&raw(&document), &filter, DateTime::from_millis(0)).unwrap();
        after.map(|after| Document::try_from(&after).unwrap())
    };
    assert_eq!(change(doc! {"$set": {"a": 1}}, doc! {"_id": 1, "a": 1}), None);
    assert_eq!(
        change(doc! {"$set": {"z": 1, "b": 2}, "$inc": {"a.c": 1}}, doc! {"_id": 1}),
        Some(doc! {"_id": 1, "a": {"c": 1}, "b": 2, "z": 1})
    );
    assert_eq!(
        change(doc! {"$push": {"a": {"$each": [5, 1], "$sort": 1, "$slice": -2}}}, doc! {"_id": 1, "a": [3]}),
        Some(doc! {"_id": 1, "a": [3, 5]})
    );
}

#[test]
fn the_positional_operator_takes_the_element_that_matched() {
    let filter = Filter::parse(&doc! {"a.b": 2}).unwrap();
    let document = raw(&doc! {"_id": 1, "a": [{"b": 1}, {"b": 2}]});
    let update = Update::parse(&doc! {"$set": {"a.$.c": 9}}, &[]).unwrap();
    let after = update.apply(&document, &filter, DateTime::from_millis(0)).unwrap().unwrap();
    assert_eq!(Document::try_from(&after).unwrap(), doc! {"_id": 1, "a": [{"b": 1}, {"b": 2, "c": 9}]});
    let projection = Projection::parse(&doc! {"_id": 0, "a.$": 1}).unwrap();
    let projected = projection.apply(&document, &filter, DateTime::from_millis(0)).unwrap();
    assert_eq!(Document::try_from(&projected).unwrap(), doc! {"a": [{"b": 2}]});
}
