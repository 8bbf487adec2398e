//! What each fuzz target does with bytes: it reads them, and where that is an
//! error, the error must have a place in the input. Nothing may panic.
//!
//! `tests/unit/fuzzed.rs` runs the same on damaged fixtures in every test run.

use bson::{Bson, Document, RawDocument, doc};
use rmem::formats::mongodump::{Archive, Documents, Metadata, decode_document, unpack};
use rmem::formats::{Diagnostic, Source, clips as facts, marker as sections, pddl, plan as plans, shell as json};
use rmem::memory::Memory;
use rmem::problem::{Request, Syntax, generate};
use rmem::query::{self, Filter, Pipeline, Projection, Sort, Update};
use rmem::store::{Embedded, Namespace, Store as _};

/// The bytes as a text, where they are one.
fn source(bytes: &[u8]) -> Option<Source> {
    std::str::from_utf8(bytes).ok().map(|text| Source::new("input", text))
}

/// An error has a line and a column of the input.
fn placed(source: &Source, error: &Diagnostic) {
    let (line, column) = error.position();
    let lines = source.text().split('\n').count();
    assert!(line >= 1 && line <= lines && column >= 1, "{line}:{column} of {lines} lines: {}", error.message());
    assert!(!error.to_string().is_empty());
}

fn read<T>(bytes: &[u8], read: impl Fn(&Source) -> Result<T, Diagnostic>) -> Option<T> {
    let source = source(bytes)?;
    read(&source).map_err(|error| placed(&source, &error)).ok()
}

/// Documents, values, pipelines and worlds in shell syntax; what is written reads back.
pub(crate) fn shell(bytes: &[u8]) {
    read(bytes, json::parse_documents);
    read(bytes, json::parse_pipeline);
    read(bytes, json::parse_world);
    if let Some(document) = read(bytes, json::parse_document) {
        let text = json::canonical(&document);
        let again = json::parse_document(&Source::new("again", text.as_str()));
        assert_eq!(again.map(|again| json::canonical(&again)).ok(), Some(text));
    }
}

/// A PDDL domain, in both dialects; what is written reads back.
pub(crate) fn pddl_domain(bytes: &[u8]) {
    read(bytes, |source| pddl::read_domain(source, pddl::Dialect { lenient: true }));
    if let Some(domain) = read(bytes, |source| pddl::read_domain(source, pddl::Dialect::default())) {
        let text = domain.to_string();
        assert!(pddl::read_domain(&Source::new("again", text.as_str()), pddl::Dialect::default()).is_ok(), "{text}");
    }
}

/// A PDDL problem, in both dialects; what is written reads back.
pub(crate) fn pddl_problem(bytes: &[u8]) {
    read(bytes, |source| pddl::read_problem(source, pddl::Dialect { lenient: true }));
    if let Some(problem) = read(bytes, |source| pddl::read_problem(source, pddl::Dialect::default())) {
        let text = problem.to_string();
        assert!(pddl::read_problem(&Source::new("again", text.as_str()), pddl::Dialect::default()).is_ok(), "{text}");
    }
}

/// What planners print and write.
pub(crate) fn plan(bytes: &[u8]) {
    read(bytes, plans::read_plan);
    if let Some(source) = source(bytes) {
        let _ = plans::ff::read(source.text(), "");
        let _ = plans::ff::read("", source.text());
        let _ = plans::downward::read(std::slice::from_ref(&source), Some(0), "", source.text());
        let _ = plans::temporal::read(std::slice::from_ref(&source), source.text(), "");
    }
}

/// CLIPS facts, deffacts and deftemplates.
pub(crate) fn clips(bytes: &[u8]) {
    let Some(source) = source(bytes) else { return };
    let found = facts::Reader::new(&source, []).chain(facts::Reader::of_templates(&source));
    found.filter_map(Result::err).for_each(|error| placed(&source, &error));
}

/// A template in the marker spelling.
pub(crate) fn marker(bytes: &[u8]) {
    read(bytes, sections::parse);
}

/// A `.bson` file, packed or not; documents that are read can be stored.
pub(crate) fn bson(bytes: &[u8]) {
    let Ok(input) = unpack(bytes) else { return };
    for found in Documents::new(input) {
        let Ok((offset, document)) = found else { return };
        stored(offset, &document);
    }
}

/// An archive of mongodump, packed or not.
pub(crate) fn archive(bytes: &[u8]) {
    let Some(archive) = unpack(bytes).ok().and_then(|input| Archive::open(input).ok()) else { return };
    let first = archive.collections().first().map(|first| (first.database.clone(), first.collection.clone()));
    let (database, collection) = first.unwrap_or_default();
    for found in archive.documents(&database, &collection) {
        let Ok((offset, document)) = found else { return };
        stored(offset, &document);
    }
}

fn stored(offset: u64, document: &RawDocument) {
    if query::check(document).is_err() {
        return;
    }
    let Ok(document) = decode_document(offset, document) else { return };
    let store = Embedded::in_memory().expect("a store in memory");
    let ns = Namespace { database: "a".to_owned(), collection: "b".to_owned() };
    if store.insert(&ns, vec![document]).is_ok() {
        assert_eq!(store.count(&ns, (&Document::new()).into()).ok(), Some(1));
    }
}

/// The metadata file beside a `.bson` file.
pub(crate) fn metadata(bytes: &[u8]) {
    read(bytes, Metadata::parse);
}

/// A template in both spellings, over a memory of three documents.
pub(crate) fn template(bytes: &[u8]) {
    let Some(source) = source(bytes) else { return };
    let ns = Namespace { database: "robmem".to_owned(), collection: "worldmodel".to_owned() };
    let store = Embedded::in_memory().expect("a store in memory");
    let documents = ["a", "b", "c"].map(|name| doc! { "relation": "on-table", "object": name, "n": 1 });
    store.insert(&ns, documents.to_vec()).expect("documents that can be stored");
    let memory = Memory::new(Box::new(store), None, Vec::new());
    for syntax in [Syntax::Minijinja, Syntax::Marker] {
        let request = Request {
            template: source.clone(),
            parts: Vec::new(),
            syntax,
            collection: ns.clone(),
            goal: Some("(done)".to_owned()),
            parameters: Vec::new(),
            lenient: false,
        };
        if let Err(error) = generate(&request, &memory) {
            assert!(!error.to_string().is_empty());
        }
    }
}

/// Expressions that describe large values; each byte puts the expression before it into another one.
pub(crate) fn bomb(bytes: &[u8]) {
    let expression = bytes.iter().take(24).fold(Bson::from("$s"), |inner, byte| larger(*byte, inner));
    let original = doc! { "_id": 1, "s": "text", "n": [1, 2, 3] };
    let raw = bson::RawDocumentBuf::try_from(&original).expect("a document");
    let now = bson::DateTime::from_millis(0);
    let all = Filter::parse(&Document::new()).expect("an empty filter");
    let small = |result: &RawDocument| assert!(query::check(result).is_ok() && result.as_bytes().len() < 17 << 20);
    if let Ok(filter) = Filter::parse(&doc! { "$expr": expression.clone() }) {
        let _ = filter.matches(&raw);
    }
    if let Ok(projection) = Projection::parse(&doc! { "x": expression.clone() }) {
        projection.apply(&raw, &all, now).iter().for_each(|result| small(result));
    }
    if let Ok(update) = Update::parse_pipeline(&[doc! { "$set": { "x": expression.clone() } }]) {
        update.apply(&raw, &all, now).iter().flatten().for_each(|result| small(result));
    }
    let group = doc! { "$group": { "_id": "$n", "x": { "$push": expression } } };
    if let Ok(pipeline) = Pipeline::parse(&[doc! { "$unwind": "$n" }, group]) {
        let input: query::Documents<'_, query::QueryError> = Box::new(std::iter::once(Ok(raw)));
        let none = |_: &query::Origin, _: Option<&Document>| Ok::<_, query::QueryError>(None);
        pipeline.run(input, now, &none).flatten().for_each(|result| small(&result));
    }
}

/// An expression whose value is larger or deeper than that of the one inside.
fn larger(byte: u8, inner: Bson) -> Bson {
    let times = [3, 30, 199, 2000][usize::from(byte / 16) % 4];
    let reduce = |body: Document, initial: Bson| {
        let body = Bson::from(body);
        doc! { "$reduce": { "input": { "$range": [0, times] }, "initialValue": initial, "in": body } }
    };
    Bson::from(match byte % 16 {
        0 => doc! { "a": inner },
        1 => doc! { "a": inner.clone(), "b": inner },
        2 => reduce(doc! { "a": "$$value" }, inner),
        3 => reduce(doc! { "$concat": ["$$value", "$$value"] }, inner),
        4 => reduce(doc! { "$concatArrays": ["$$value", "$$value"] }, inner),
        5 => reduce(doc! { "$mergeObjects": ["$$value", { "a": "$$value" }] }, inner),
        6 => doc! { "$map": { "input": { "$range": [0, times] }, "in": inner } },
        7 => doc! { "$let": { "vars": { "v": inner }, "in": ["$$v", "$$v"] } },
        8 => doc! { "$concat": [inner.clone(), inner] },
        9 => doc! { "$replaceAll": { "input": inner.clone(), "find": "t", "replacement": inner } },
        10 => doc! { "$zip": { "inputs": [inner, { "$range": [0, times] }], "useLongestLength": true } },
        11 => doc! { "$split": [inner, "t"] },
        12 => doc! { "$setField": { "field": "f", "input": { "g": inner.clone() }, "value": inner } },
        13 => doc! { "$objectToArray": { "k": inner } },
        14 => doc! { "$filter": { "input": inner, "cond": true } },
        _ => doc! { "$setUnion": [[inner], { "$range": [0, times] }] },
    })
}

/// A filter, update, projection, sort and pipeline, and a document they are applied to.
pub(crate) fn query(bytes: &[u8]) {
    let Some(document) = read(bytes, json::parse_document) else { return };
    let Ok(raw) = bson::RawDocumentBuf::try_from(&document) else { return };
    let now = bson::DateTime::from_millis(0);
    let filter = Filter::parse(&document).ok();
    if let Some(filter) = &filter {
        let _ = filter.matches(&raw);
    }
    let Ok(all) = Filter::parse(&Document::new()) else { return };
    if let Ok(update) = Update::parse(&document, &[]) {
        let _ = update.apply(&raw, &all, now);
        let _ = update.upsert(&document, now);
    }
    if let Ok(projection) = Projection::parse(&document) {
        let _ = projection.apply(&raw, filter.as_ref().unwrap_or(&all), now);
    }
    if let Ok(sort) = Sort::parse(&document) {
        let _ = sort.key(&raw);
    }
    if Pipeline::parse(std::slice::from_ref(&document)).is_ok() {
        let store = Embedded::in_memory().expect("a store in memory");
        let ns = Namespace { database: "a".to_owned(), collection: "b".to_owned() };
        let _ = store.insert(&ns, vec![document.clone()]);
        if let Ok(found) = store.aggregate(&ns, (&[document]).into()) {
            let _ = found.take(1000).count();
        }
    }
}

/// A document, which is decoded as the library decodes it where it is acceptable.
fn decoded(bytes: &[u8]) {
    let Ok(raw) = RawDocument::from_bytes(bytes) else { return };
    let expected = query::check(raw).ok().and_then(|()| Document::try_from(raw).ok());
    // NaN is printed as it is, and equals nothing.
    assert_eq!(format!("{:?}", query::decode(raw).ok()), format!("{expected:?}"));
}

/// A message of MongoDB's wire protocol; what is read is answered. And a document as in one.
#[cfg(feature = "serve")]
pub(crate) fn wire(bytes: &[u8]) {
    decoded(bytes);
    let Ok(message) = rmem::serve::Message::parse(bytes) else { return };
    if let Ok(command) = &message.command
        && let Ok(raw) = bson::RawDocumentBuf::try_from(command)
    {
        assert!(rmem::serve::Reply::to(&message).bytes(&raw).len() > raw.as_bytes().len());
    }
}
