//! What computables do, written once and run over all stores.

use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use bson::{Bson, DateTime, Document, doc};
use libtest_mimic::{Failed, Trial};
use rmem::memory::computables::{BodyKind, Definition, Origin, Registry, Verdict};
use rmem::memory::dump::write;
use rmem::memory::{Clock, Memory};
use rmem::process::Host;
use rmem::store::{Find, Namespace, StoreUri, UpdateRequest, UpdateSpec};

/// Where a store is, and the folder that is removed after it.
pub(crate) struct Place {
    pub(crate) uri: String,
    pub(crate) folder: Option<tempfile::TempDir>,
}

/// A memory to be examined, and a database of its own in it.
struct Lab {
    uri: String,
    database: String,
}

type Case = fn(&Lab);

macro_rules! cases {
    ($($name:ident),* $(,)?) => { &[$((stringify!($name), $name as Case)),*] };
}

const CASES: &[(&str, Case)] = cases![
    stored_and_computed_documents_are_answered_alike,
    who_did_not_ask_sees_stored_documents_only,
    the_cache_answers_equal_queries_in_any_order_of_keys,
    what_is_no_longer_good_is_computed_again_in_place,
    what_was_changed_or_removed_is_computed_again,
    what_takes_longer_than_its_cache_time_is_computed_once_for_a_query,
    queries_that_overlap_see_no_document_twice,
    without_a_cache_nothing_is_left,
    answers_are_the_same_with_and_without_a_cache,
    what_is_computed_for_one_query_is_in_the_way_of_no_other,
    the_computable_of_higher_priority_comes_first,
    a_body_sees_what_others_compute_elsewhere,
    every_kind_of_question_computes,
    what_a_pipeline_looks_up_is_computed,
    changes_do_not_compute,
    a_cycle_is_named,
    a_pipeline_takes_values_of_the_query,
    a_filter_of_a_pipeline_takes_what_the_query_has,
    a_taken_id_is_an_error_and_nothing_is_stored,
    dropping_and_emptying_a_collection_empties_its_cache,
    dumps_and_the_list_of_collections_have_nothing_computed,
    a_check_says_what_would_run_and_why,
    poses_are_given_in_other_frames,
    frames_that_are_no_tree_are_an_error,
    the_nearest_come_first,
    the_nearest_of_thousands_are_the_first_of_those_as_near,
    the_nearest_in_another_frame,
];

/// What needs a store that others open, too.
const SHARED: &[(&str, Case)] = cases![
    what_the_memory_keeps_is_seen_by_all,
    the_cache_is_shared,
    those_who_ask_at_once_compute_once,
    those_who_ask_when_its_time_is_over_compute_once,
    what_begins_to_need_another_one_sees_its_documents,
    what_begins_to_take_long_is_computed_once,
    what_the_memory_keeps_is_seen_after_a_computation_whose_time_was_over,
    answers_are_whole_while_others_compute,
];

/// The names of all cases over a store called `prefix`.
#[cfg(feature = "mongodb")]
pub(crate) fn names(prefix: &str) -> Vec<String> {
    CASES.iter().chain(SHARED).map(|(name, _)| format!("{prefix}::{name}")).collect()
}

/// All cases over the stores that `open` gives.
pub(crate) fn trials(
    prefix: &str,
    shared: bool,
    open: impl Fn() -> Result<Place, Failed> + Clone + Send + 'static,
) -> Vec<Trial> {
    let cases = CASES.iter().chain(if shared { SHARED } else { &[] });
    let trial = |(name, case): &(&'static str, Case)| {
        let (name, case, open) = (*name, *case, open.clone());
        Trial::test(format!("{prefix}::{name}"), move || {
            let place = open()?;
            let short: String = name.chars().take(50).collect();
            case(&Lab { uri: place.uri, database: format!("c-{short}") });
            drop(place.folder);
            Ok(())
        })
    };
    cases.map(trial).collect()
}

/// All cases over the embedded store, in a file and in memory.
pub(crate) fn embedded() -> Vec<Trial> {
    let mut trials = trials("computables::file", true, || {
        let folder = tempfile::tempdir()?;
        let uri = format!("file:{}", folder.path().join("robot.rmem").display());
        Ok(Place { uri, folder: Some(folder) })
    });
    trials.extend(self::trials("computables::mem", false, || Ok(Place { uri: "mem:".to_owned(), folder: None })));
    trials
}

/// How long deciding takes, against a round trip to the database: a benchmark, by hand.
#[cfg(feature = "mongodb")]
pub(crate) fn deciding(uri: &str) -> Result<(), Failed> {
    let lab = Lab { uri: uri.to_owned(), database: "deciding".to_owned() };
    let round_trip = {
        let memory = lab.memory(Vec::new());
        memory.insert(&lab.ns("x"), vec![doc! { "_id": 1 }])?;
        per_call(500, || all(&memory, &lab.ns("x"), doc! { "_id": 1 }).len())
    };
    eprintln!("one round trip, a find by _id: {round_trip:?}");
    let spec = |index: i32| doc! { "compute": format!("c{index}"), "x": { "$exists": true } };
    let alike = |index: i32| doc! { "x": { "$exists": true, "$gt": index } };
    let open = |index: i32| doc! { "a": { "$ne": index } };
    let kinds: [(&str, &dyn Fn(i32) -> Document); 3] =
        [("each for a text of its own", &spec), ("all for one key", &alike), ("all to be tried", &open)];
    for (kind, spec) in kinds {
        let definitions =
            (0..100).map(|index| lab.pipeline(&format!("c{index}"), spec(index), "y", Vec::new())).collect();
        let memory = lab.memory(definitions);
        for (asked, query) in [
            ("needs one or more", doc! { "compute": "c50", "x": 5, "y": 4 }),
            ("needs none", doc! { "relation": "on-table", "object": "A" }),
        ] {
            let ns = lab.ns("x");
            let took = per_call(2_000, || memory.needed(&ns, &query).map_or(0, |needed| needed.len()));
            let ratio = round_trip.as_secs_f64() / took.as_secs_f64();
            eprintln!("100 computables, {kind}; the query {asked}: {took:?}, 1/{ratio:.0} of a round trip");
        }
    }
    Ok(())
}

/// How long a call takes: the median of ten runs.
#[cfg(feature = "mongodb")]
fn per_call(calls: u32, mut call: impl FnMut() -> usize) -> Duration {
    let mut runs: Vec<Duration> = (0..10)
        .map(|_| {
            let start = Instant::now();
            (0..calls).for_each(|_| {
                std::hint::black_box(call());
            });
            start.elapsed() / calls
        })
        .collect();
    runs.sort();
    runs[5]
}

impl Lab {
    fn ns(&self, collection: &str) -> Namespace {
        Namespace { database: self.database.clone(), collection: collection.to_owned() }
    }

    fn memory(&self, definitions: Vec<Definition>) -> Memory {
        static NEVER: AtomicBool = AtomicBool::new(false);
        let host = Host {
            exe: env!("CARGO_BIN_EXE_rmem").into(),
            temporary: std::env::temp_dir(),
            interrupted: &NEVER,
            listener: Default::default(),
        };
        let uri = StoreUri::parse(&self.uri).unwrap();
        Memory::at(uri.clone(), uri, Vec::new()).with_computables(Registry::new(definitions, &host).unwrap())
    }

    /// A computable of the collection `x` with a pipeline over `from`.
    fn pipeline(&self, name: &str, spec: Document, from: &str, stages: Vec<Document>) -> Definition {
        Definition {
            name: name.to_owned(),
            namespace: self.ns("x"),
            spec,
            priority: 0,
            cache: Some(Duration::from_secs(600)),
            adds: None,
            body: BodyKind::Pipeline { from: self.ns(from), stages },
            origin: Origin::program(),
        }
    }

    /// The blocks at a height below 1 are on the table.
    fn low(&self) -> Definition {
        let stages = vec![
            doc! { "$match": { "z": { "$lt": 1 } } },
            doc! { "$project": { "_id": 0, "relation": "on-table", "object": "$block" } },
        ];
        self.pipeline("low", doc! { "relation": "on-table" }, "blocks", stages)
    }

    fn blocks(&self, memory: &Memory) {
        let blocks = [("A", 0), ("B", 5), ("C", 0)].map(|(block, z)| doc! { "block": block, "z": z });
        memory.insert(&self.ns("blocks"), blocks.to_vec()).unwrap();
    }
}

fn all(memory: &Memory, ns: &Namespace, filter: Document) -> Vec<Document> {
    let find = Find { filter, ..Find::default() };
    memory.find_with_metadata(ns, &find).unwrap().map(|raw| Document::try_from(&*raw.unwrap()).unwrap()).collect()
}

/// The texts under a key of the answer, sorted.
fn texts(memory: &Memory, ns: &Namespace, filter: Document, key: &str) -> Vec<String> {
    let mut texts: Vec<String> =
        all(memory, ns, filter).iter().map(|found| found.get_str(key).unwrap().into()).collect();
    texts.sort();
    texts
}

/// What was computed for the last operation: names, and whether the cache had it.
fn reported(memory: &Memory) -> Vec<(String, bool)> {
    memory.computed().into_iter().map(|computed| (computed.name, computed.cached)).collect()
}

fn fails(memory: &Memory, ns: &Namespace, filter: Document) -> String {
    memory.find(ns, &Find { filter, ..Find::default() }).err().expect("it was answered").to_string()
}

/// How many documents a collection really has.
fn stored(lab: &Lab, memory: &Memory, collection: &str) -> usize {
    memory.show_computed(true);
    // A query that no spec matches.
    let found = all(memory, &lab.ns(collection), doc! { "no-spec": { "$exists": false } }).len();
    memory.show_computed(false);
    found
}

fn who_did_not_ask_sees_stored_documents_only(lab: &Lab) {
    let memory = lab.memory(vec![lab.low()]);
    let (x, none) = (lab.ns("x"), doc! {});
    lab.blocks(&memory);
    memory.insert(&x, vec![doc! { "relation": "on", "object": "Z" }]).unwrap();
    assert_eq!(memory.count(&x, &none).unwrap(), 1);
    assert_eq!(memory.count(&x, &doc! { "relation": "on-table" }).unwrap(), 2);
    assert_eq!(memory.count(&x, &none).unwrap(), 1);
    assert_eq!(memory.distinct(&x, "object", &none).unwrap(), [Bson::from("Z")]);
    assert_eq!(texts(&memory, &x, doc! { "object": { "$exists": true } }, "object"), ["Z"]);
    let grouped = memory.aggregate(&x, &[doc! { "$sort": { "object": 1 } }]).unwrap();
    assert_eq!(grouped.count(), 1);
    let stages = [doc! { "$match": { "block": "A" } }, doc! { "$unionWith": "x" }];
    assert_eq!(memory.aggregate(&lab.ns("blocks"), &stages).unwrap().count(), 2);
    memory.show_computed(true);
    assert_eq!(memory.count(&x, &none).unwrap(), 3);
    assert_eq!(texts(&memory, &x, none.clone(), "object"), ["A", "C", "Z"]);
    memory.show_computed(false);
    assert_eq!(memory.delete(&x, &none, false).unwrap(), 1);
    assert_eq!(stored(lab, &memory, "x"), 0, "what was computed went with the rest, uncounted");
}

fn stored_and_computed_documents_are_answered_alike(lab: &Lab) {
    let memory = lab.memory(vec![lab.low()]);
    let x = lab.ns("x");
    lab.blocks(&memory);
    memory.insert(&x, vec![doc! { "relation": "on-table", "object": "Z" }]).unwrap();
    let found = all(&memory, &x, doc! { "relation": "on-table" });
    assert_eq!(found.len(), 3);
    let computed: Vec<_> = found
        .iter()
        .filter_map(|found| found.get_document("_robmem_info").ok())
        .filter(|info| {
            info.get_bool("computed").is_ok_and(|computed| computed) && info.get_datetime("cached_until").is_ok()
        })
        .collect();
    assert_eq!(computed.len(), 2);
    assert_eq!(texts(&memory, &x, doc! { "relation": "on-table" }, "object"), ["A", "C", "Z"]);
    assert_eq!(texts(&memory, &x, doc! { "relation": "on-table", "object": { "$gt": "B" } }, "object"), ["C", "Z"]);
    let hidden = memory.find(&x, &Find { filter: doc! { "relation": "on-table" }, ..Find::default() }).unwrap();
    let hidden: Vec<_> = hidden.map(|raw| raw.unwrap()).collect();
    assert_eq!(hidden.len(), 3);
    assert!(hidden.iter().all(|raw| raw.get("_robmem_info").unwrap().is_none()));
}

fn the_cache_answers_equal_queries_in_any_order_of_keys(lab: &Lab) {
    let memory = lab.memory(vec![lab.low()]);
    lab.blocks(&memory);
    let count = |query| memory.count(&lab.ns("x"), &query).unwrap();
    assert_eq!(count(doc! { "relation": "on-table", "a": { "$exists": false, "$ne": 1 } }), 2);
    assert_eq!(reported(&memory), [("low".into(), false)]);
    memory.delete(&lab.ns("blocks"), &doc! { "block": "A" }, false).unwrap();
    assert_eq!(count(doc! { "a": { "$ne": 1.0, "$exists": false }, "relation": "on-table" }), 2);
    assert_eq!(reported(&memory), [("low".into(), true)]);
    assert_eq!(count(doc! { "relation": "on-table" }), 1);
    assert_eq!(reported(&memory), [("low".into(), false)]);
}

fn what_is_no_longer_good_is_computed_again_in_place(lab: &Lab) {
    let memory = lab.memory(vec![Definition { cache: Some(Duration::from_millis(1)), ..lab.low() }]);
    lab.blocks(&memory);
    for expected in [vec!["A", "C"], vec!["C"], vec![]] {
        assert_eq!(texts(&memory, &lab.ns("x"), doc! { "relation": "on-table" }, "object"), expected);
        assert_eq!(reported(&memory).last(), Some(&("low".into(), false)));
        std::thread::sleep(Duration::from_millis(20));
        assert_eq!(stored(lab, &memory, "x"), 0, "what is no longer good is not seen");
        memory.delete(&lab.ns("blocks"), &doc! { "z": 0 }, true).unwrap();
    }
}

fn what_was_changed_or_removed_is_computed_again(lab: &Lab) {
    let memory = lab.memory(vec![lab.low()]);
    let x = lab.ns("x");
    lab.blocks(&memory);
    let holds = |cached: bool| {
        assert_eq!(texts(&memory, &x, doc! { "relation": "on-table" }, "object"), ["A", "C"]);
        assert_eq!(reported(&memory), [("low".into(), cached)]);
    };
    let change = |update: Document| {
        let request = UpdateRequest {
            filter: doc! { "object": "C" },
            update: UpdateSpec::Document(update),
            ..UpdateRequest::default()
        };
        assert_eq!(memory.update(&x, &request).unwrap().matched, 0, "only stored documents are changed");
        memory.show_computed(true);
        assert_eq!(memory.update(&x, &request).unwrap().modified, 1);
        memory.show_computed(false);
    };
    holds(false);
    holds(true);
    assert_eq!(memory.delete(&x, &doc! { "object": "A" }, false).unwrap(), 0, "only stored documents are removed");
    memory.show_computed(true);
    assert_eq!(memory.delete(&x, &doc! { "object": "A" }, false).unwrap(), 1);
    memory.show_computed(false);
    holds(false);
    holds(true);
    change(doc! { "$set": { "object": "Z" } });
    holds(false);
    change(doc! { "relation": "under-table", "object": "Z" });
    holds(false);
    holds(true);
    // What has nothing to do with it leaves the cache alone.
    memory.insert(&x, vec![doc! { "relation": "on", "object": "C" }]).unwrap();
    memory.delete(&x, &doc! { "relation": "on" }, false).unwrap();
    holds(true);
}

fn a_pipeline_takes_values_of_the_query(lab: &Lab) {
    let stages = vec![
        doc! { "$match": { "z": { "$lt": "$$query.below" } } },
        doc! { "$project": {
            "_id": 0, "below": "$$query.below", "object": "$block", "gap": { "$subtract": ["$$query.below", "$z"] },
            "no": "$$query.no",
        } },
    ];
    let memory = lab.memory(vec![lab.pipeline("lower", doc! { "below": { "$exists": true } }, "blocks", stages)]);
    lab.blocks(&memory);
    let gaps = |below: i32| -> Vec<i32> {
        let found = all(&memory, &lab.ns("x"), doc! { "below": below });
        assert!(found.iter().all(|found| !found.contains_key("no")));
        found.iter().map(|found| found.get_i32("gap").unwrap()).collect()
    };
    assert_eq!(gaps(3), [3, 3]);
    assert_eq!(gaps(6), [6, 1, 6]);
    assert!(gaps(0).is_empty());
}

fn a_filter_of_a_pipeline_takes_what_the_query_has(lab: &Lab) {
    let filter = vec![doc! { "$match": { "block": "$$query.named" } }, doc! { "$unset": "_id" }];
    let memory = lab.memory(vec![lab.pipeline("named", doc! {}, "blocks", filter)]);
    lab.blocks(&memory);
    assert_eq!(all(&memory, &lab.ns("x"), doc! { "named": { "$in": ["A", "B"] } }).len(), 0, "none has the key");
    assert_eq!(memory.computed().first().map(|computed| computed.documents), Some(2));
    let error = fails(&memory, &lab.ns("x"), doc! { "block": "A" });
    assert!(error.contains("`named`") && error.contains("the query {\"block\":\"A\"} has no `named`"), "{error}");
}

fn queries_that_overlap_see_no_document_twice(lab: &Lab) {
    let memory = lab.memory(vec![lab.low()]);
    lab.blocks(&memory);
    for query in [
        doc! { "relation": "on-table" },
        doc! { "relation": "on-table", "object": "A" },
        doc! { "relation": "on-table", "object": { "$in": ["A", "C"] } },
        doc! { "relation": "on-table" },
    ] {
        let expected = if query.get("object") == Some(&Bson::from("A")) { 1 } else { 2 };
        assert_eq!(all(&memory, &lab.ns("x"), query).len(), expected);
    }
}

fn without_a_cache_nothing_is_left(lab: &Lab) {
    let memory = lab.memory(vec![Definition { cache: None, ..lab.low() }]);
    lab.blocks(&memory);
    for _ in 0..2 {
        assert_eq!(memory.count(&lab.ns("x"), &doc! { "relation": "on-table" }).unwrap(), 2);
        assert_eq!(reported(&memory), [("low".into(), false)]);
        assert_eq!(stored(lab, &memory, "x"), 0);
    }
}

fn answers_are_the_same_with_and_without_a_cache(lab: &Lab) {
    let stages = vec![doc! { "$project": { "_id": 0, "high": "yes", "n": "$z" } }];
    let high = || lab.pipeline("high", doc! { "high": { "$exists": true } }, "blocks", stages.clone());
    // Reads what the first one made, by a query and by a pipeline.
    let counted = vec![
        doc! { "$match": { "n": { "$exists": true } } },
        doc! { "$group": { "_id": null, "sum": { "$sum": "$n" } } },
        doc! { "$project": { "_id": 0, "high": "sum", "n": "$sum" } },
    ];
    let sum = || Definition {
        priority: -1,
        ..lab.pipeline("sum", doc! { "high": { "$exists": true } }, "x", counted.clone())
    };
    let once = |definition: Definition| Definition { cache: None, ..definition };
    let (cached, alone) = (lab.memory(vec![high(), sum()]), lab.memory(vec![once(high()), once(sum())]));
    lab.blocks(&cached);
    if lab.uri == "mem:" {
        lab.blocks(&alone);
    }
    let x = lab.ns("x");
    let written: Vec<Document> = (0..5).map(|n| doc! { "_id": n, "high": "no", "n": n * 3 % 5 }).collect();
    for memory in [&cached, &alone] {
        if memory.count(&x, &doc! {}).unwrap() == 0 {
            memory.insert(&x, written.clone()).unwrap();
        }
    }
    let asked = doc! { "high": { "$in": ["yes", "no", "sum"] } };
    let found = |memory: &Memory, find: &Find| -> Vec<Document> {
        let found = memory.find(&x, find).unwrap().map(|raw| Document::try_from(&*raw.unwrap()).unwrap());
        // Those of which the `_id` is made up differ in that.
        let comparable = found.map(|document| match document.get_object_id("_id") {
            Ok(_) => document.into_iter().filter(|(key, _)| key != "_id").collect(),
            Err(_) => document,
        });
        comparable.collect()
    };
    for sort in [doc! {}, doc! { "n": 1 }, doc! { "n": -1, "high": 1 }] {
        for (skip, limit) in [(0, 0), (1, 4), (6, 0)] {
            for projection in [doc! {}, doc! { "n": 1 }] {
                let (filter, sort) = (asked.clone(), sort.clone());
                let find = Find { filter, sort, skip, limit, projection, ..Find::default() };
                assert_eq!(found(&alone, &find), found(&cached, &find), "{find:?}");
            }
        }
    }
    let find = Find { filter: asked.clone(), ..Find::default() };
    assert_eq!(found(&alone, &find).len(), 9);
    let stages = [
        doc! { "$match": asked.clone() },
        doc! { "$group": { "_id": "$high", "n": { "$sum": "$n" } } },
        doc! { "$sort": { "_id": 1 } },
    ];
    for memory in [&alone, &cached] {
        assert_eq!(memory.count(&x, &asked).unwrap(), 9);
        assert_eq!(memory.distinct(&x, "high", &asked).unwrap(), ["no", "sum", "yes"].map(Bson::from));
        let grouped: Vec<_> =
            memory.aggregate(&x, &stages).unwrap().map(|raw| raw.unwrap().get_i32("n").unwrap()).collect();
        assert_eq!(grouped, [10, 15, 5]);
        let explained = memory.explain(&x, &find).unwrap();
        // A server counts in numbers of 32 bits.
        let returned = explained.get("returned").and_then(|n| n.as_i64().or(n.as_i32().map(i64::from)));
        assert_eq!(returned, Some(9), "{explained}");
    }
    let left = lab.memory(Vec::new());
    assert_eq!(left.count(&x, &doc! {}).unwrap(), if lab.uri == "mem:" { 0 } else { 5 });
}

fn what_is_computed_for_one_query_is_in_the_way_of_no_other(lab: &Lab) {
    let stages =
        vec![doc! { "$project": { "_id": { "$literal": 7 }, "one": { "$literal": true } } }, doc! { "$limit": 1 }];
    let one = Definition { cache: None, ..lab.pipeline("one", doc! { "one": true }, "blocks", stages.clone()) };
    let two = Definition { cache: None, priority: -1, ..lab.pipeline("two", doc! { "two": true }, "blocks", stages) };
    let memory = lab.memory(vec![one, two]);
    lab.blocks(&memory);
    let x = lab.ns("x");
    let mut found = memory.find(&x, &Find { filter: doc! { "one": true }, ..Find::default() }).unwrap();
    assert_eq!(memory.count(&x, &doc! { "one": true }).unwrap(), 1);
    assert!(found.next().is_some_and(|found| found.is_ok()) && found.next().is_none());
    // For one query, they are.
    let error = fails(&memory, &x, doc! { "one": true, "two": true });
    assert!(error.contains("the computable `two` failed") && error.contains("_id: 7"), "{error}");
    assert_eq!(stored(lab, &memory, "x"), 0);
    memory.insert(&x, vec![doc! { "_id": 7 }]).unwrap();
    assert!(fails(&memory, &x, doc! { "one": true }).contains("computed documents take no other one's place"));
    assert_eq!(stored(lab, &memory, "x"), 1);
}

fn the_computable_of_higher_priority_comes_first(lab: &Lab) {
    let high = |name: &str, priority: i64| Definition {
        priority,
        ..lab.pipeline(
            name,
            doc! { "all": true },
            "blocks",
            vec![
                doc! { "$match": { "block": "A" } },
                doc! { "$project": { "_id": 0, "all": { "$literal": true }, "by": { "$literal": name } } },
            ],
        )
    };
    // Counts what those before it made.
    let last = Definition {
        priority: -5,
        ..lab.pipeline(
            "last",
            doc! { "all": true },
            "x",
            vec![
                doc! { "$match": { "by": { "$exists": true } } },
                doc! { "$group": { "_id": null, "n": { "$sum": 1 } } },
                doc! { "$project": { "_id": 0, "all": { "$literal": true }, "n": 1 } },
            ],
        )
    };
    let memory = lab.memory(vec![last, high("first", 3), high("equal", 3), high("top", 10)]);
    lab.blocks(&memory);
    let found = all(&memory, &lab.ns("x"), doc! { "all": true });
    let order: Vec<String> = reported(&memory).into_iter().map(|(name, _)| name).collect();
    assert_eq!(order, ["top", "equal", "first", "last"]);
    assert_eq!(found.iter().find_map(|found| found.get_i32("n").ok()), Some(3));
}

fn a_body_sees_what_others_compute_elsewhere(lab: &Lab) {
    let stages = vec![
        doc! { "$match": { "relation": "on-table" } },
        doc! { "$group": { "_id": null, "n": { "$sum": 1 } } },
        doc! { "$project": { "_id": 0, "count": "on-table", "n": 1 } },
    ];
    let mut count = lab.pipeline("count", doc! { "count": { "$exists": true } }, "x", stages);
    count.namespace = lab.ns("y");
    let memory = lab.memory(vec![count, lab.low()]);
    lab.blocks(&memory);
    let found = all(&memory, &lab.ns("y"), doc! { "count": "on-table" });
    assert_eq!(found.first().and_then(|found| found.get_i32("n").ok()), Some(2));
    assert_eq!(reported(&memory), [("low".into(), false), ("count".into(), false)]);
}

fn every_kind_of_question_computes(lab: &Lab) {
    let memory = lab.memory(vec![Definition { cache: None, ..lab.low() }]);
    let x = lab.ns("x");
    lab.blocks(&memory);
    let query = doc! { "relation": "on-table" };
    assert_eq!(memory.count(&x, &query).unwrap(), 2);
    assert_eq!(memory.distinct(&x, "object", &query).unwrap(), [Bson::from("A"), Bson::from("C")]);
    let stages = [doc! { "$match": query }, doc! { "$count": "n" }];
    let found: Vec<_> = memory.aggregate(&x, &stages).unwrap().map(|raw| raw.unwrap()).collect();
    assert_eq!(found[0].get_i32("n").unwrap(), 2);
    let later = [doc! { "$sort": { "a": 1 } }, doc! { "$match": { "relation": "on-table" } }];
    assert_eq!(memory.aggregate(&x, &later).unwrap().count(), 0, "the asked query is what a pipeline begins with");
    assert_eq!(memory.count(&x, &doc! { "relation": "on" }).unwrap(), 0);
    assert_eq!(reported(&memory), []);
}

fn what_a_pipeline_looks_up_is_computed(lab: &Lab) {
    let memory = lab.memory(vec![lab.low()]);
    lab.blocks(&memory);
    let inner = vec![doc! { "$match": { "relation": "on-table" } }];
    let stages =
        [doc! { "$match": { "block": "A" } }, doc! { "$lookup": { "from": "x", "pipeline": inner, "as": "low" } }];
    let found: Vec<_> = memory.aggregate(&lab.ns("blocks"), &stages).unwrap().map(|raw| raw.unwrap()).collect();
    let found = Document::try_from(&*found[0]).unwrap();
    assert_eq!(found.get_array("low").unwrap().len(), 2);
    // What has decayed is not looked up either.
    let gone = doc! { "relation": "on-table", "_robmem_info": { "decay_time": bson::DateTime::from_millis(5) } };
    memory.insert(&lab.ns("x"), vec![gone]).unwrap();
    let found: Vec<_> = memory.aggregate(&lab.ns("blocks"), &stages).unwrap().map(|raw| raw.unwrap()).collect();
    assert_eq!(Document::try_from(&*found[0]).unwrap().get_array("low").unwrap().len(), 2);
}

fn changes_do_not_compute(lab: &Lab) {
    let memory = lab.memory(vec![lab.low()]);
    let x = lab.ns("x");
    lab.blocks(&memory);
    let update = UpdateRequest {
        filter: doc! { "relation": "on-table" },
        update: UpdateSpec::Document(doc! { "$set": { "a": 1 } }),
        many: true,
        ..UpdateRequest::default()
    };
    assert_eq!(memory.update(&x, &update).unwrap().matched, 0);
    assert_eq!(memory.delete(&x, &doc! { "relation": "on-table" }, false).unwrap(), 0);
    assert_eq!(reported(&memory), []);
}

fn a_cycle_is_named(lab: &Lab) {
    let of = |name: &str, asked: &str, other: &str| {
        let stages = vec![doc! { "$match": { "what": other } }, doc! { "$project": { "_id": 0 } }];
        lab.pipeline(name, doc! { "what": asked }, "x", stages)
    };
    let memory = lab.memory(vec![of("one", "a", "b"), of("two", "b", "c"), of("three", "c", "a")]);
    let error = fails(&memory, &lab.ns("x"), doc! { "what": "b" });
    assert!(error.contains("in a cycle: two → three → one → two"), "{error}");
    // It is no obstacle for what comes after.
    assert_eq!(memory.count(&lab.ns("x"), &doc! { "what": "d" }).unwrap(), 0);
    let error = fails(&memory, &lab.ns("x"), doc! { "what": "b" });
    assert!(error.contains("cycle"), "{error}");
    let own = lab.memory(vec![lab.pipeline("own", doc! {}, "x", vec![])]);
    let error = fails(&own, &lab.ns("x"), doc! {});
    assert!(error.contains("own → own"), "{error}");
}

fn a_taken_id_is_an_error_and_nothing_is_stored(lab: &Lab) {
    let stages = vec![doc! { "$project": { "_id": "$block", "taken": { "$literal": true } } }];
    let doubled = vec![doc! { "$project": { "_id": { "$literal": 7 } } }];
    let memory = lab.memory(vec![
        lab.pipeline("taken", doc! { "taken": true }, "blocks", stages),
        lab.pipeline("doubled", doc! { "doubled": true }, "blocks", doubled),
    ]);
    lab.blocks(&memory);
    memory.insert(&lab.ns("x"), vec![doc! { "_id": "B", "mine": 1 }]).unwrap();
    for _ in 0..2 {
        let error = fails(&memory, &lab.ns("x"), doc! { "taken": true });
        assert!(error.contains("the computable `taken` failed") && error.contains("_id: \"B\""), "{error}");
        assert_eq!(stored(lab, &memory, "x"), 1);
    }
    memory.delete(&lab.ns("x"), &doc! { "_id": "B" }, false).unwrap();
    for _ in 0..2 {
        assert_eq!(memory.count(&lab.ns("x"), &doc! { "taken": true }).unwrap(), 3);
    }
    let error = fails(&memory, &lab.ns("x"), doc! { "doubled": true });
    assert_eq!(error, "the computable `doubled` failed: it gave two documents with _id 7");
}

fn dropping_and_emptying_a_collection_empties_its_cache(lab: &Lab) {
    let memory = lab.memory(vec![lab.low()]);
    let x = lab.ns("x");
    lab.blocks(&memory);
    let count = || memory.count(&x, &doc! { "relation": "on-table" }).unwrap();
    assert_eq!(count(), 2);
    memory.drop_collection(&x).unwrap();
    assert_eq!(count(), 2);
    memory.delete(&x, &doc! {}, false).unwrap();
    assert_eq!(count(), 2);
    memory.insert(&lab.ns("other"), vec![doc! { "relation": "on-table" }]).unwrap();
    memory.rename_collection(&lab.ns("other"), &x, true).unwrap();
    assert_eq!(count(), 3);
}

fn dumps_and_the_list_of_collections_have_nothing_computed(lab: &Lab) {
    let memory = lab.memory(vec![lab.low(), lab.pipeline("any", doc! {}, "blocks", vec![doc! { "$unset": "_id" }])]);
    let x = lab.ns("x");
    lab.blocks(&memory);
    memory.insert(&x, vec![doc! { "_id": 7 }]).unwrap();
    assert_eq!(memory.count(&x, &doc! {}).unwrap(), 4);
    assert_eq!(memory.count(&x, &doc! { "relation": "on-table" }).unwrap(), 2);
    let own: Vec<_> = memory.collections().unwrap().into_iter().filter(|ns| ns.database == lab.database).collect();
    assert_eq!(own, [lab.ns("blocks"), x.clone()]);
    let folder = tempfile::tempdir().unwrap();
    let dumped = write::write_folder(&memory, std::slice::from_ref(&x), &folder.path().join("d"), false).unwrap();
    assert_eq!(dumped.iter().map(|(_, count)| count).sum::<u64>(), 1);
    assert_eq!(rmem::memory::dump::world_file::dump(&memory, &[x]).unwrap().matches("_id").count(), 1);
}

fn a_check_says_what_would_run_and_why(lab: &Lab) {
    let stages = || vec![doc! { "$match": { "block": "A" } }];
    let other = Definition { namespace: lab.ns("y"), ..lab.pipeline("other", doc! {}, "blocks", stages()) };
    let once = Definition { cache: None, ..lab.pipeline("once", doc! { "n": { "$gt": 3 } }, "blocks", stages()) };
    let memory = lab.memory(vec![lab.low(), other, once]);
    lab.blocks(&memory);
    let verdicts = |query: Document| -> Vec<(String, Verdict)> {
        let checks = memory.check_computables(&lab.ns("x"), &query).unwrap();
        checks.into_iter().map(|check| (check.computable.definition.name.clone(), check.verdict)).collect()
    };
    let elsewhere = ("other".to_owned(), Verdict::Elsewhere);
    assert_eq!(
        verdicts(doc! { "n": 4 }),
        [
            ("once".into(), Verdict::Runs),
            elsewhere.clone(),
            ("low".into(), Verdict::Unneeded(vec![doc! { "relation": "on-table" }])),
        ]
    );
    let query = doc! { "relation": "on-table" };
    let unneeded = ("once".to_owned(), Verdict::Unneeded(vec![doc! { "n": { "$gt": 3 } }]));
    assert_eq!(verdicts(query.clone()), [unneeded.clone(), elsewhere, ("low".into(), Verdict::Runs)]);
    assert_eq!(memory.count(&lab.ns("x"), &query).unwrap(), 2);
    assert!(matches!(verdicts(query)[2].1, Verdict::Cached { documents: 2, .. }));
}

fn what_the_memory_keeps_is_seen_by_all(lab: &Lab) {
    let (one, other) = (lab.memory(Vec::new()), lab.memory(Vec::new()));
    lab.blocks(&one);
    let ask = |memory: &Memory| memory.count(&lab.ns("x"), &doc! { "relation": "on-table" }).unwrap();
    assert_eq!([ask(&one), ask(&other)], [0, 0]);
    one.keep_computables(&[vec![lab.low()]]).unwrap();
    assert_eq!(ask(&one), 2);
    soon(|| ask(&other) == 2);
    let taken = other.keep_computables(&[vec![lab.low()]]).unwrap_err().to_string();
    assert!(taken.contains("keeps a computable `low` already"), "{taken}");
    let settings = lab.memory(vec![lab.low()]);
    assert_eq!(settings.count(&lab.ns("x"), &doc! {}).unwrap(), 0, "a query that needs neither");
    let both = settings.count(&lab.ns("x"), &doc! { "relation": "on-table" }).unwrap_err().to_string();
    assert!(both.contains("that of this program, and that of") && both.contains(".rmem.computables"), "{both}");
    assert!(other.forget_computable("low").unwrap().is_some());
    assert_eq!(ask(&other), 0);
    soon(|| ask(&one) == 0);
    assert_eq!(settings.count(&lab.ns("x"), &doc! {}).unwrap(), 0);
    assert!(other.forget_computable("low").unwrap().is_none());
}

fn what_the_memory_keeps_is_seen_after_a_computation_whose_time_was_over(lab: &Lab) {
    let (one, other) = (lab.memory(Vec::new()), lab.memory(Vec::new()));
    lab.blocks(&one);
    let ask = || texts(&one, &lab.ns("x"), doc! { "relation": "on-table" }, "object");
    let again = || {
        // Behind the first one, each is a part of the write that stores it.
        for _ in 0..4 {
            ask();
            std::thread::sleep(Duration::from_millis(3));
        }
    };
    let often = Definition { name: "often".into(), cache: Some(Duration::from_millis(1)), ..lab.low() };
    one.keep_computables(&[vec![often]]).unwrap();
    again();
    assert_eq!(ask(), ["A", "C"]);
    let high = doc! { "$match": { "z": { "$gt": 1 } } };
    let object = doc! { "$project": { "_id": 0, "relation": "on-table", "object": "$block" } };
    let more = || lab.pipeline("more", doc! { "relation": "on-table" }, "blocks", vec![high.clone(), object.clone()]);
    other.keep_computables(&[vec![more()]]).unwrap();
    soon(|| ask() == ["A", "B", "C"]);
    assert!(other.forget_computable("more").unwrap().is_some());
    soon(|| ask() == ["A", "C"]);
    again();
    one.keep_computables(&[vec![more()]]).unwrap();
    assert_eq!(ask(), ["A", "B", "C"]);
    again();
    assert!(one.forget_computable("often").unwrap().is_some());
    assert_eq!(ask(), ["B"]);
}

/// Waits until something holds.
fn soon(holds: impl Fn() -> bool) {
    for _ in 0..1_000 {
        if holds() {
            return;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    panic!("it does not hold");
}

fn transform(lab: &Lab) -> Definition {
    Definition {
        name: "tf".into(),
        namespace: lab.ns("x"),
        spec: doc! { "frame": { "$exists": true }, "allow_tf": true },
        priority: 10,
        cache: None,
        adds: None,
        body: BodyKind::builtin("transform", [("frames", lab.ns("frames").to_string())]),
        origin: Origin::program(),
    }
}

/// The table is turned by a quarter in the map, the arm stands on it upside down.
fn frames(lab: &Lab, memory: &Memory) {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let frames = vec![
        doc! { "frame": "table", "parent": "map", "translation": [10.0, 0.0, 1.0], "rotation": [0.0, 0.0, half, half] },
        doc! { "frame": "arm", "parent": "table", "translation": [0, 0, 2], "rotation": [1, 0, 0, 0] },
    ];
    memory.insert(&lab.ns("frames"), frames).unwrap();
    let object = |name: &str, frame: &str| {
        doc! { "object": name, "frame": frame, "color": "red", "translation": [1.0, 2.0, 3.0], "rotation": [0.0, 0.0, 0.0, 1.0] }
    };
    memory.insert(&lab.ns("x"), vec![object("A", "table"), object("B", "map"), object("C", "arm")]).unwrap();
}

fn numbers(found: &Document, key: &str) -> Vec<f64> {
    found.get_array(key).unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

#[track_caller]
fn close(found: &[f64], expected: &[f64]) {
    let near = found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12);
    assert!(near && found.len() == expected.len(), "{found:?} is not {expected:?}");
}

fn poses_are_given_in_other_frames(lab: &Lab) {
    let memory = lab.memory(vec![transform(lab)]);
    frames(lab, &memory);
    let ask = |frame: &str, object: &str| {
        let mut found = all(&memory, &lab.ns("x"), doc! { "frame": frame, "allow_tf": true, "object": object });
        assert_eq!(found.len(), 1, "{object} in {frame}");
        found.remove(0)
    };
    let found = ask("map", "A");
    // Turned by a quarter: x to y, y to -x.
    close(&numbers(&found, "translation"), &[8.0, 1.0, 4.0]);
    let half = std::f64::consts::FRAC_1_SQRT_2;
    close(&numbers(&found, "rotation"), &[0.0, 0.0, half, half]);
    assert_eq!((found.get_str("color").unwrap(), found.get_bool("allow_tf").unwrap()), ("red", true));
    // Half a turn about x: y and z change their signs.
    close(&numbers(&ask("table", "C"), "translation"), &[1.0, -2.0, -1.0]);
    close(&numbers(&ask("map", "C"), "translation"), &[12.0, 1.0, 0.0]);
    close(&numbers(&ask("table", "B"), "translation"), &[2.0, 9.0, 2.0]);
    assert_eq!(numbers(&ask("map", "B"), "translation"), [1.0, 2.0, 3.0]);
    let high = doc! { "frame": "map", "allow_tf": true, "translation.2": { "$gt": 3.5 } };
    assert_eq!(texts(&memory, &lab.ns("x"), high, "object"), ["A"]);
    assert_eq!(memory.count(&lab.ns("x"), &doc! { "frame": "map" }).unwrap(), 1, "nothing is left");
}

fn frames_that_are_no_tree_are_an_error(lab: &Lab) {
    let memory = lab.memory(vec![transform(lab)]);
    frames(lab, &memory);
    let ask = |frame: Bson| fails(&memory, &lab.ns("x"), doc! { "frame": frame, "allow_tf": true });
    let error = ask("nowhere".into());
    assert!(
        error.contains("`tf`") && error.contains("`nowhere` is not known") && error.contains("arm, map, table"),
        "{error}"
    );
    let error = ask(doc! { "$exists": true }.into());
    assert!(error.contains("needs one frame"), "{error}");
    let back = doc! { "frame": "map", "parent": "arm", "translation": [0, 0, 0], "rotation": [0, 0, 0, 1] };
    memory.insert(&lab.ns("frames"), vec![back]).unwrap();
    let error = ask("elsewhere".into());
    assert!(error.contains("are not a tree: table → map → arm → table"), "{error}");
}

fn nearest(lab: &Lab) -> Definition {
    Definition {
        name: "near".into(),
        namespace: lab.ns("x"),
        spec: doc! { "nearest_to": { "$exists": true } },
        priority: 0,
        cache: Some(Duration::from_secs(600)),
        adds: None,
        body: BodyKind::builtin("nearest", [("position", "translation".to_owned())]),
        origin: Origin::program(),
    }
}

fn the_nearest_come_first(lab: &Lab) {
    let memory = lab.memory(vec![nearest(lab)]);
    let at = |name: &str, x: f64, color: &str| doc! { "object": name, "translation": [x, 0.0, 0.0], "color": color };
    let objects = vec![at("far", 9.0, "red"), at("near", 1.0, "red"), at("mid", 4.0, "red"), at("blue", 2.0, "blue")];
    memory.insert(&lab.ns("x"), objects).unwrap();
    memory.insert(&lab.ns("x"), vec![doc! { "object": "nowhere" }]).unwrap();
    let ask = |query: Document| -> Vec<(String, f64)> {
        let found = all(&memory, &lab.ns("x"), query);
        let pair = |found: &Document| (found.get_str("object").unwrap().to_owned(), found.get_f64("distance").unwrap());
        found.iter().map(pair).collect()
    };
    let red = ask(doc! { "nearest_to": [0.0, 0.0, 0.0], "limit": 2, "color": "red" });
    assert_eq!(red, [("near".into(), 1.0), ("mid".into(), 4.0)]);
    let near = ask(doc! { "max_distance": 2.5, "nearest_to": [0, 0, 0] });
    assert_eq!(near, [("near".into(), 1.0), ("blue".into(), 2.0)]);
    assert_eq!(ask(doc! { "nearest_to": [9, 4, 0], "limit": 1 }), [("far".into(), 4.0)]);
    let error = fails(&memory, &lab.ns("x"), doc! { "nearest_to": "here" });
    assert!(error.contains("`near`") && error.contains("has to be a point"), "{error}");
}

fn the_nearest_of_thousands_are_the_first_of_those_as_near(lab: &Lab) {
    let memory = lab.memory(vec![nearest(lab)]);
    // Ten rings, from far to near, in turn.
    let at = |n: i32| doc! { "object": n, "translation": [10 - n % 10, 0, 0] };
    memory.insert(&lab.ns("x"), (0..5_000).map(at).collect()).unwrap();
    let ask = |limit: i32| -> Vec<i32> {
        let found = all(&memory, &lab.ns("x"), doc! { "nearest_to": [0, 0, 0], "limit": limit });
        found.iter().map(|found| found.get_i32("object").unwrap()).collect()
    };
    assert_eq!(ask(3), [9, 19, 29]);
    let nearest: Vec<i32> = [9, 8].iter().flat_map(|ring| (0..500).map(move |n| 10 * n + ring)).take(600).collect();
    assert_eq!(ask(600), nearest);
}

fn the_nearest_in_another_frame(lab: &Lab) {
    let memory = lab.memory(vec![nearest(lab), transform(lab)]);
    frames(lab, &memory);
    let query = doc! { "nearest_to": [0, 0, 0], "frame": "map", "allow_tf": true, "limit": 2 };
    let found = all(&memory, &lab.ns("x"), query);
    let order: Vec<&str> = found.iter().map(|found| found.get_str("object").unwrap()).collect();
    assert_eq!(order, ["B", "A"]);
}

fn the_cache_is_shared(lab: &Lab) {
    let (one, other) = (lab.memory(vec![lab.low()]), lab.memory(vec![lab.low()]));
    lab.blocks(&one);
    let query = doc! { "relation": "on-table" };
    assert_eq!(one.count(&lab.ns("x"), &query).unwrap(), 2);
    assert_eq!(other.count(&lab.ns("x"), &query).unwrap(), 2);
    assert_eq!(reported(&other), [("low".into(), true)]);
}

/// A computable that takes its time, and leaves a line in `log` when it runs.
fn slow(lab: &Lab, log: &Path, cache: Duration, seconds: &str) -> Definition {
    let script =
        format!("echo ran >> {}; sleep {seconds}; echo '{{slow: 1, n: 1}}'; echo '{{slow: 1, n: 2}}'", log.display());
    Definition {
        name: "slow".into(),
        namespace: lab.ns("x"),
        spec: doc! { "slow": 1 },
        priority: 0,
        cache: Some(cache),
        adds: None,
        body: BodyKind::Command {
            words: vec!["sh".into(), "-c".into(), script],
            folder: std::env::temp_dir(),
            timeout: Duration::from_secs(60),
        },
        origin: Origin::program(),
    }
}

fn what_takes_longer_than_its_cache_time_is_computed_once_for_a_query(lab: &Lab) {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("log");
    let slow = |name: &str| {
        let definition = slow(lab, &log, Duration::from_millis(50), "0.2");
        Definition { name: name.into(), ..definition }
    };
    let memory = lab.memory(vec![slow("one"), slow("other")]);
    for runs in [2, 4] {
        assert_eq!(memory.count(&lab.ns("x"), &doc! { "slow": 1 }).unwrap(), 4);
        assert_eq!(std::fs::read_to_string(&log).unwrap().lines().count(), runs, "each is computed once");
        std::thread::sleep(Duration::from_millis(60));
        assert_eq!(stored(lab, &memory, "x"), 0, "nothing is kept beyond its time");
    }
}

fn those_who_ask_at_once_compute_once(lab: &Lab) {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("log");
    std::thread::scope(|scope| {
        for _ in 0..3 {
            scope.spawn(|| {
                let memory = lab.memory(vec![slow(lab, &log, Duration::from_secs(600), "0.3")]);
                assert_eq!(memory.count(&lab.ns("x"), &doc! { "slow": 1 }).unwrap(), 2);
            });
        }
    });
    assert_eq!(std::fs::read_to_string(log).unwrap().lines().count(), 1);
    assert_eq!(stored(lab, &lab.memory(vec![]), "x"), 2);
}

/// A memory whose clock stands at a number of seconds from now.
fn later(memory: Memory, seconds: i64) -> Memory {
    memory.with_clock(Clock::Stopped(DateTime::from_millis(DateTime::now().timestamp_millis() + seconds * 1000)))
}

fn those_who_ask_when_its_time_is_over_compute_once(lab: &Lab) {
    let memory = |seconds| {
        let low = Definition { cache: Some(Duration::from_secs(10)), ..lab.low() };
        later(lab.memory(vec![low]), seconds)
    };
    let asked = doc! { "relation": "on-table" };
    lab.blocks(&memory(0));
    for seconds in [0, 20, 40] {
        let runs = AtomicUsize::new(0);
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    let memory = memory(seconds);
                    assert_eq!(texts(&memory, &lab.ns("x"), asked.clone(), "object"), ["A", "C"]);
                    let [(_, was_cached)] = reported(&memory)[..] else { panic!("one is asked for") };
                    runs.fetch_add(usize::from(!was_cached), Ordering::Relaxed);
                });
            }
        });
        assert_eq!(runs.into_inner(), 1, "at {seconds}");
        assert_eq!(stored(lab, &memory(seconds), "x"), 2, "at {seconds}");
    }
}

fn what_begins_to_need_another_one_sees_its_documents(lab: &Lab) {
    let low = || Definition { cache: Some(Duration::from_secs(10)), ..lab.low() };
    let more = || Definition {
        namespace: lab.ns("blocks"),
        ..lab.pipeline("more", doc! {}, "others", vec![doc! { "$project": { "_id": 0 } }])
    };
    let before = later(lab.memory(vec![low()]), 0);
    lab.blocks(&before);
    before.insert(&lab.ns("others"), vec![doc! { "block": "D", "z": 0 }]).unwrap();
    let ask = |memory: &Memory| texts(memory, &lab.ns("x"), doc! { "relation": "on-table" }, "object");
    assert_eq!(ask(&before), ["A", "C"]);
    let after = later(lab.memory(vec![low(), more()]), 20);
    assert_eq!(ask(&after), ["A", "C", "D"]);
    assert_eq!(reported(&after), [("more".into(), false), ("low".into(), false)]);
    let last = later(lab.memory(vec![low(), more()]), 40);
    assert_eq!(ask(&last), ["A", "C", "D"]);
    assert_eq!(reported(&last), [("more".into(), true), ("low".into(), false)], "its cache holds");
}

fn what_begins_to_take_long_is_computed_once(lab: &Lab) {
    let smaller = vec![doc! { "$match": { "$expr": { "$lt": ["$n", "$$n"] } } }, doc! { "$count": "count" }];
    let pairs = || {
        let stages = vec![
            doc! { "$lookup": { "from": "numbers", "let": { "n": "$n" }, "pipeline": smaller.clone(), "as": "smaller" } },
            doc! { "$group": { "_id": null, "pairs": { "$sum": { "$first": "$smaller.count" } } } },
            doc! { "$project": { "_id": 0, "of": "numbers", "pairs": { "$toString": "$pairs" } } },
        ];
        let pairs = lab.pipeline("pairs", doc! { "of": "numbers" }, "numbers", stages);
        Definition { cache: Some(Duration::from_secs(10)), ..pairs }
    };
    let first = later(lab.memory(vec![pairs()]), 0);
    let add = |from, to| {
        first.insert(&lab.ns("numbers"), (from..to).map(|n| doc! { "n": n }).collect()).unwrap();
    };
    let ask = |memory: &Memory| texts(memory, &lab.ns("x"), doc! { "of": "numbers" }, "pairs");
    add(0, 3);
    assert_eq!(ask(&first), ["3"]);
    let second = later(lab.memory(vec![pairs()]), 20);
    assert_eq!(ask(&second), ["3"]);
    add(3, 200);
    let third = later(lab.memory(vec![pairs()]), 40);
    assert_eq!(ask(&third), ["19900"]);
    assert_eq!(reported(&third), [("pairs".into(), false)]);
    assert_eq!(ask(&third), ["19900"]);
    assert_eq!(reported(&third), [("pairs".into(), true)]);
    assert_eq!(stored(lab, &third, "x"), 1);
}

fn answers_are_whole_while_others_compute(lab: &Lab) {
    let low = || Definition { cache: Some(Duration::from_millis(1)), ..lab.low() };
    lab.blocks(&lab.memory(vec![]));
    let end = Instant::now() + Duration::from_secs(2);
    std::thread::scope(|scope| {
        for _ in 0..3 {
            scope.spawn(|| {
                let memory = lab.memory(vec![low()]);
                let mut asked = 0;
                while asked < 5 || Instant::now() < end {
                    assert_eq!(memory.count(&lab.ns("x"), &doc! { "relation": "on-table" }).unwrap(), 2);
                    asked += 1;
                }
            });
        }
    });
}
