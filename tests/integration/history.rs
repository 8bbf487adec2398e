//! The history on a MongoDB server: of rmem's own writes, and of what other clients change.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use bson::{DateTime, Document, doc};
use libtest_mimic::Failed;
use mongodb::sync::Client;
use rmem::memory::Memory;
use rmem::memory::history::{Selection, listed};
use rmem::memory::watch::Trigger;
use rmem::store::{Find, HistoryRule, Namespace, Next, Scope, StoreUri, UpdateRequest, UpdateSpec};

use crate::processes::until;

type Case = fn(&str) -> Result<(), Failed>;

/// What is tried on the one server, by its address.
pub(crate) const CASES: [(&str, Case); 13] = [
    ("history::mongodb::own_writes_are_signed_and_those_of_others_are_recorded", written_by_all),
    ("history::mongodb::the_memory_is_read_as_it_was_and_changes_are_taken_back", read_and_undone),
    ("history::mongodb::record_keeps_the_history_while_it_runs", recorded),
    ("history::mongodb::what_is_dated_in_a_second_step_is_signed_and_taken_back", dated_later),
    ("history::mongodb::a_date_that_is_read_again_stays_with_its_change", read_again),
    ("history::mongodb::a_write_is_done_and_signed_while_others_write_all_the_time", among_others),
    ("history::mongodb::changes_of_large_documents_are_passed", large),
    ("history::mongodb::a_history_begins_again_behind_a_database_that_was_dropped", begun_again),
    ("history::mongodb::what_is_written_at_the_same_moment_is_signed_by_its_own_author", at_the_same_moment),
    ("history::mongodb::a_date_belongs_to_a_change_that_has_none", dated_by_itself),
    ("history::mongodb::changes_of_others_behind_an_own_one_are_not_signed", behind_own),
    ("history::mongodb::what_is_put_over_another_is_signed", put_over),
    ("history::mongodb::the_past_is_read_while_others_write", read_while_written),
];

fn ns(name: &str) -> Namespace {
    Namespace { database: format!("history_{}", std::process::id()), collection: name.to_owned() }
}

fn memory(uri: &str, author: &str) -> Result<Memory, Failed> {
    let uri = StoreUri::parse(uri)?;
    let rule = HistoryRule { scope: Scope::All, age: Duration::from_secs(3600), size: 64 << 20 };
    Ok(Memory::at(uri.clone(), uri, Vec::new()).with_history(&[rule], author))
}

fn select(ns: &Namespace) -> Selection {
    Selection { namespace: ns.clone(), filter: doc! {}, since: None, by: None, positions: Vec::new() }
}

fn set(filter: Document, fields: Document, many: bool) -> UpdateRequest {
    let update = UpdateSpec::Document(doc! { "$set": fields });
    UpdateRequest { filter, update, many, ..UpdateRequest::default() }
}

/// The entries as `by operation _id before after`.
fn entries(memory: &Memory, ns: &Namespace) -> Result<Vec<String>, Failed> {
    let entries = memory.history(&select(ns))?.map(|entry| {
        let entry = listed(ns, &entry?, false)?;
        let text = |key: &str| entry.get(key).map_or("-".to_owned(), ToString::to_string);
        Ok(format!("{} {} {} {} {}", text("by"), text("operation"), text("_id"), text("before"), text("after")))
    });
    entries.collect()
}

fn written_by_all(uri: &str) -> Result<(), Failed> {
    let (ns, memory) = (ns("all"), memory(uri, "rmem test")?);
    memory.insert(&ns, vec![doc! { "_id": 1, "n": 1 }, doc! { "_id": 2, "n": 1 }])?;
    let other = Client::with_uri_str(uri)?;
    let other = other.database(&ns.database).collection::<Document>(&ns.collection);
    other.update_one(doc! { "_id": 1 }, doc! { "$set": { "n": 5 } }).run()?;
    memory.update(&ns, &set(doc! {}, doc! { "n": 7 }, true))?;
    memory.update(&ns, &set(doc! {}, doc! { "n": 7 }, true))?;
    memory.delete(&ns, &doc! { "_id": 2 }, true)?;
    let found = entries(&memory, &ns)?;
    let wanted = [
        r#""rmem test" "insert" 1 - { "_id": 1, "n": 1 }"#,
        r#""rmem test" "insert" 2 - { "_id": 2, "n": 1 }"#,
        r#"- "update" 1 { "_id": 1, "n": 1 } { "_id": 1, "n": 5 }"#,
        r#""rmem test" "update" 1 { "_id": 1, "n": 5 } { "_id": 1, "n": 7 }"#,
        r#""rmem test" "update" 2 { "_id": 2, "n": 1 } { "_id": 2, "n": 7 }"#,
        r#""rmem test" "delete" 2 { "_id": 2, "n": 7 } -"#,
    ];
    assert_eq!(found, wanted);
    assert!(memory.collections()?.iter().all(|ns| !ns.is_own()), "what rmem keeps is not shown");
    assert!(memory.watch_names()?.iter().all(|name| !name.name.starts_with("rmem.")), "nor its watches");
    Ok(())
}

fn read_and_undone(uri: &str) -> Result<(), Failed> {
    let (ns, now) = (ns("past"), memory(uri, "rmem test")?);
    now.insert(&ns, vec![doc! { "_id": 1, "n": 1 }, doc! { "_id": 2, "n": 1 }, doc! { "_id": 3, "n": 1 }])?;
    std::thread::sleep(Duration::from_millis(20));
    let time = DateTime::now();
    std::thread::sleep(Duration::from_millis(20));
    now.sign("the second");
    now.update(&ns, &set(doc! { "_id": { "$lt": 3 } }, doc! { "n": 9 }, true))?;
    now.delete(&ns, &doc! { "_id": 3 }, true)?;
    now.insert(&ns, vec![doc! { "_id": 4 }])?;
    let past = memory(uri, "rmem test")?.as_of(time)?;
    let find = Find { sort: doc! { "_id": 1 }, ..Find::default() };
    let documents = past.find(&ns, &find)?.map(|found| Ok(Document::try_from(&*found?)?));
    let documents: Vec<Document> = documents.collect::<Result<_, Failed>>()?;
    assert_eq!(documents, [1, 2, 3].map(|id| doc! { "_id": id, "n": 1 }));
    assert!(past.count(&ns, &doc! { "n": 9 })? == 0 && now.count(&ns, &doc! { "n": 9 })? == 2);
    // The three operations are one run.
    let plan = now.plan_undo(&select(&ns), Some(1))?;
    assert_eq!((plan.changes, plan.conflicts().count()), (4, 0));
    now.undo(&ns, &plan)?;
    assert_eq!((now.count(&ns, &doc! { "n": 1 })?, now.count(&ns, &doc! {})?), (3, 3));
    // What another client has changed since is not to be overwritten.
    let other = Client::with_uri_str(uri)?;
    let other = other.database(&ns.database).collection::<Document>(&ns.collection);
    other.update_one(doc! { "_id": 1 }, doc! { "$set": { "n": 5 } }).run()?;
    let by = Selection { by: Some("the second".to_owned()), ..select(&ns) };
    assert!(now.plan_undo(&by, None)?.conflicts().count() > 0);
    // A drop takes what it removed with it.
    now.drop_collection(&ns)?;
    let past = memory(uri, "rmem test")?.as_of(time)?;
    let error = past.count(&ns, &doc! {}).err().ok_or("it answered")?.to_string();
    assert!(error.contains("is not known"), "{error}");
    Ok(())
}

fn recorded(uri: &str) -> Result<(), Failed> {
    let (ns, memory) = (ns("recorded"), memory(uri, "rmem test")?);
    let stop = AtomicBool::new(false);
    let other = Client::with_uri_str(uri)?;
    let other = other.database(&ns.database).collection::<Document>(&ns.collection);
    let kept = Client::with_uri_str(uri)?.database(&ns.database).collection::<Document>("rmem.history");
    // The history is read by another client: reading it by rmem would be recorded.
    let is_kept = || -> Result<bool, Failed> {
        Ok(stop.load(Ordering::Relaxed) || kept.count_documents(doc! { "ns": ns.to_string() }).run()? >= 2)
    };
    std::thread::scope(|scope| -> Result<(), Failed> {
        let waiting = scope.spawn(|| {
            let waited = until("two changes are recorded", is_kept);
            stop.store(true, Ordering::Relaxed);
            waited
        });
        let mut written = Ok(());
        let begun = &mut || {
            // From here on, others are recorded.
            let inserted = other.insert_one(doc! { "_id": 1 }).run();
            let change = doc! { "$set": { "n": 1 } };
            written = inserted.and_then(|_| other.update_one(doc! { "_id": 1 }, change).run()).map(drop);
        };
        let recorded = memory.record(&ns, None, &stop, begun);
        stop.store(true, Ordering::Relaxed);
        written?;
        waiting.join().map_err(|_| "the wait panicked")??;
        assert_eq!(recorded?, 2);
        Ok(())
    })?;
    assert_eq!(entries(&memory, &ns)?.len(), 2);
    Ok(())
}

/// What no one can predict: the server changes the documents, and rmem writes the date behind that.
fn by_chance() -> UpdateRequest {
    let update = UpdateSpec::Pipeline(vec![doc! { "$set": { "n": { "$rand": {} } } }]);
    UpdateRequest { update, many: true, ..UpdateRequest::default() }
}

fn dated_later(uri: &str) -> Result<(), Failed> {
    let (ns, memory) = (ns("dated"), memory(uri, "rmem test")?);
    memory.insert(&ns, (0..3).map(|id| doc! { "_id": id, "n": 5 }).collect())?;
    memory.sign("by chance");
    assert_eq!(memory.update(&ns, &by_chance())?.modified, 3);
    let signed = entries(&memory, &ns)?.into_iter().filter(|entry| entry.starts_with(r#""by chance" "update""#));
    assert_eq!(signed.count(), 3);
    let plan = memory.plan_undo(&select(&ns), Some(1))?;
    assert_eq!((plan.changes, plan.conflicts().count()), (3, 0));
    memory.undo(&ns, &plan)?;
    assert_eq!(memory.count(&ns, &doc! { "n": 5 })?, 3);
    Ok(())
}

/// As behind a process that was killed between its entries and its position.
fn read_again(uri: &str) -> Result<(), Failed> {
    let (ns, memory) = (ns("again"), memory(uri, "rmem test")?);
    memory.insert(&ns, vec![doc! { "_id": 1, "n": 5 }])?;
    memory.update(&ns, &by_chance())?;
    let server = Client::with_uri_str(uri)?.database(&ns.database);
    let other = server.collection::<Document>(&ns.collection);
    other.update_one(doc! {}, doc! { "$set": { "n": 7 } }).run()?;
    let recorded = entries(&memory, &ns)?;
    assert_eq!(recorded.len(), 3);
    let history = server.collection::<Document>("rmem.history");
    let kept = history.find(doc! { "ns": ns.to_string() }).sort(doc! { "_id": 1 });
    let kept: Vec<Document> = kept.run()?.collect::<Result<_, _>>()?;
    let place = doc! { "_id": format!("rmem.history:{}", ns.collection) };
    let back = doc! { "$set": { "token._data": kept[1].get_str("_id")? } };
    let moved = server.collection::<Document>("rmem.watchers").update_one(place, back).run()?;
    assert_eq!((moved.modified_count, entries(&memory, &ns)?), (1, recorded));
    Ok(())
}

fn among_others(uri: &str) -> Result<(), Failed> {
    let (ns, memory) = (ns("busy"), memory(uri, "rmem test")?);
    memory.insert(&ns, vec![doc! { "_id": 1, "n": 0 }, doc! { "_id": 2, "n": 0 }])?;
    let other = Client::with_uri_str(uri)?.database(&ns.database).collection::<Document>(&ns.collection);
    let (is_over, until) = (AtomicBool::new(false), Instant::now() + Duration::from_secs(60));
    memory.sign("own");
    std::thread::scope(|scope| {
        let busy = scope.spawn(|| -> Result<(), mongodb::error::Error> {
            while !is_over.load(Ordering::Relaxed) && Instant::now() < until {
                other.update_one(doc! { "_id": 1 }, doc! { "$inc": { "n": 1 } }).run()?;
            }
            Ok(())
        });
        let work = || -> Result<(), Failed> {
            for n in 1..4 {
                memory.update(&ns, &set(doc! { "_id": 2 }, doc! { "n": n }, false))?;
                // The history is read to its end, though more comes all the time.
                assert!(entries(&memory, &ns)?.len() > 2);
            }
            assert!(Instant::now() < until, "the writes waited until the others stopped");
            Ok(())
        };
        let done = work();
        is_over.store(true, Ordering::Relaxed);
        busy.join().map_err(|_| "the other client failed")??;
        done
    })?;
    let own = entries(&memory, &ns)?.into_iter().filter(|entry| entry.starts_with(r#""own" "update" 2"#));
    assert_eq!(own.count(), 3);
    Ok(())
}

fn large(uri: &str) -> Result<(), Failed> {
    let (ns, memory) = (ns("large"), memory(uri, "rmem test")?);
    memory.insert(&ns, vec![doc! { "_id": 1, "n": 1, "text": "x".repeat(9 << 20) }])?;
    let trigger = Trigger { namespace: ns.clone(), filter: doc! {}, name: None, computed: false, metadata: false };
    let mut watch = memory.watch(trigger)?;
    memory.sign("large");
    assert_eq!(memory.update(&ns, &set(doc! {}, doc! { "n": 2 }, true))?.modified, 1);
    assert_eq!(memory.update(&ns, &by_chance())?.modified, 1);
    memory.sign("small");
    memory.insert(&ns, vec![doc! { "_id": 2, "n": 2 }])?;
    let found: Vec<_> = memory.history(&select(&ns))?.collect::<Result<_, _>>()?;
    let images = |place: usize| (found[place].change.before.is_some(), found[place].change.after.is_some());
    assert_eq!([0, 1, 2, 3].map(images), [(false, true), (false, false), (false, false), (false, true)]);
    let authors: Vec<_> = found.iter().map(|entry| entry.author.as_deref().unwrap_or("-")).collect();
    assert_eq!(authors, ["rmem test", "large", "large", "small"]);
    // What is small is taken back, and of what is large it is said that it cannot be.
    let plan = memory.plan_undo(&select(&ns), Some(1))?;
    memory.undo(&ns, &plan)?;
    assert_eq!(memory.count(&ns, &doc! { "_id": 2 })?, 0);
    let by = Selection { by: Some("large".to_owned()), ..select(&ns) };
    let error = memory.plan_undo(&by, None).err().ok_or("it was planned")?.to_string();
    assert!(error.contains("of documents of about 8 MB or more"), "{error}");
    // A watch has the document after the change.
    let mut seen = Vec::new();
    while let Next::Change(change) = watch.next(Duration::from_secs(2))? {
        seen.push(format!("{} {}", change.kind.name(), change.after.is_some()));
    }
    assert_eq!(seen, ["update true", "update true", "insert true", "delete false"]);
    Ok(())
}

fn begun_again(uri: &str) -> Result<(), Failed> {
    let database = format!("history_dropped_{}", std::process::id());
    let (ns, memory) = (Namespace { database, ..ns("c") }, memory(uri, "rmem test")?);
    memory.insert(&ns, vec![doc! { "_id": 1, "n": 1 }])?;
    Client::with_uri_str(uri)?.database(&ns.database).drop().run()?;
    memory.insert(&ns, vec![doc! { "_id": 2, "n": 1 }])?;
    memory.update(&ns, &set(doc! {}, doc! { "n": 2 }, true))?;
    let wanted = [
        r#""rmem test" "insert" 2 - { "_id": 2, "n": 1 }"#,
        r#""rmem test" "update" 2 { "_id": 2, "n": 1 } { "_id": 2, "n": 2 }"#,
    ];
    // The server does not keep what was there before a change of a collection that was made by it.
    let known = entries(&memory, &ns)?.into_iter().map(|entry| entry.replace("2 - { \"_id\": 2, \"n\": 2 }", "2"));
    assert_eq!(known.collect::<Vec<_>>(), wanted);
    Client::with_uri_str(uri)?.database(&ns.database).drop().run()?;
    Ok(())
}

fn at_the_same_moment(uri: &str) -> Result<(), Failed> {
    const EACH: i32 = 40;
    let ns = ns("moment");
    memory(uri, "before")?.insert(&ns, vec![doc! { "_id": "counter", "n": 0 }])?;
    let together = std::sync::Barrier::new(2);
    let inserting = || -> Result<(), Failed> {
        let memory = memory(uri, "inserting")?;
        for id in 0..EACH {
            together.wait();
            memory.insert(&ns, vec![doc! { "_id": id }])?;
        }
        Ok(())
    };
    let updating = || -> Result<(), Failed> {
        let memory = memory(uri, "updating")?;
        for n in 1..=EACH {
            together.wait();
            memory.update(&ns, &set(doc! { "_id": "counter" }, doc! { "n": n }, false))?;
        }
        Ok(())
    };
    std::thread::scope(|scope| {
        let other = scope.spawn(inserting);
        let done = updating();
        other.join().map_err(|_| "the other one failed")??;
        done
    })?;
    let found = entries(&memory(uri, "after")?, &ns)?;
    for (author, operation) in [("inserting", "insert"), ("updating", "update")] {
        let own = format!("\"{author}\" \"{operation}\"");
        assert_eq!(found.iter().filter(|entry| entry.starts_with(&own)).count(), EACH as usize, "{found:#?}");
    }
    Ok(())
}

/// Two changes, of which the second has its date, and then a date by itself.
fn dated_by_itself(uri: &str) -> Result<(), Failed> {
    let (ns, memory) = (ns("itself"), memory(uri, "rmem test")?);
    memory.insert(&ns, vec![doc! { "_id": 1, "n": 1 }])?;
    let server = Client::with_uri_str(uri)?.database(&ns.database);
    let other = server.collection::<Document>(&ns.collection);
    let (first, second) = (DateTime::from_millis(4_000_000_000_000), DateTime::from_millis(4_000_000_000_001));
    let date = "_robmem_info.updated";
    for update in [doc! { "n": 2 }, doc! { "n": 3, date: second }, doc! { date: first }] {
        other.update_one(doc! {}, doc! { "$set": update }).run()?;
    }
    assert_eq!(entries(&memory, &ns)?.len(), 3);
    let history = server.collection::<Document>("rmem.history");
    let updates = history.find(doc! { "ns": ns.to_string(), "operation": "update" }).sort(doc! { "_id": 1 });
    let updates: Vec<Document> = updates.run()?.collect::<Result<_, _>>()?;
    let dates =
        updates.iter().map(|entry| entry.get_document("after")?.get_document("_robmem_info")?.get_datetime("updated"));
    assert_eq!(dates.collect::<Result<Vec<_>, _>>()?, [&first, &second]);
    Ok(())
}

fn behind_own(uri: &str) -> Result<(), Failed> {
    let (ns, memory) = (ns("behind"), memory(uri, "rmem test")?);
    let other = Client::with_uri_str(uri)?.database(&ns.database).collection::<Document>(&ns.collection);
    memory.insert(&ns, vec![doc! { "_id": 1, "own": 0, "others": 0 }])?;
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| -> Result<(), Failed> {
        let busy = scope.spawn(|| -> Result<(), mongodb::error::Error> {
            while !is_over.load(Ordering::Relaxed) {
                other.update_one(doc! { "_id": 1 }, doc! { "$inc": { "others": 1 } }).run()?;
                other.insert_one(doc! { "_id": 2 }).run()?;
                other.delete_one(doc! { "_id": 2 }).run()?;
            }
            Ok(())
        });
        let work = || -> Result<(), Failed> {
            for n in 1..=12 {
                memory.update(&ns, &set(doc! { "_id": 1 }, doc! { "own": n }, false))?;
            }
            Ok(())
        };
        let done = work();
        is_over.store(true, Ordering::Relaxed);
        busy.join().map_err(|_| "the other client failed")??;
        done
    })?;
    let found = entries(&memory, &ns)?;
    let signed = found.iter().filter(|entry| entry.starts_with(r#""rmem test" "update""#)).count();
    assert_eq!(signed, 12, "{found:#?}");
    Ok(())
}

fn put_over(uri: &str) -> Result<(), Failed> {
    let (ns, memory) = (ns("put"), memory(uri, "rmem test")?);
    memory.put(&ns, vec![doc! { "_id": 1, "n": 1 }, doc! { "_id": 2, "n": 1 }])?;
    memory.sign("the second");
    let put = memory.put(&ns, vec![doc! { "_id": 1, "n": 2 }, doc! { "_id": 2, "n": 1 }, doc! { "_id": 3, "n": 2 }])?;
    assert_eq!((put.inserted, put.replaced, put.same), (1, 1, 1));
    let second = entries(&memory, &ns)?.split_off(2);
    let wanted = [
        r#""the second" "replace" 1 { "_id": 1, "n": 1 } { "_id": 1, "n": 2 }"#,
        r#""the second" "insert" 3 - { "_id": 3, "n": 2 }"#,
    ];
    assert_eq!(second, wanted);
    Ok(())
}

fn read_while_written(uri: &str) -> Result<(), Failed> {
    let (ns, writing) = (ns("written"), memory(uri, "rmem test")?);
    writing.insert(&ns, (0..3).map(|id| doc! { "_id": id }).collect())?;
    std::thread::sleep(Duration::from_millis(20));
    let time = DateTime::now();
    std::thread::sleep(Duration::from_millis(20));
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| -> Result<(), Failed> {
        let busy = scope.spawn(|| -> Result<(), Failed> {
            let writing = memory(uri, "rmem test")?;
            while !is_over.load(Ordering::Relaxed) {
                writing.insert(&ns, vec![doc! {}])?;
            }
            Ok(())
        });
        let read = || -> Result<Vec<u64>, Failed> {
            (0..8).map(|_| Ok(memory(uri, "rmem test")?.as_of(time)?.count(&ns, &doc! {})?)).collect()
        };
        let counts = read();
        is_over.store(true, Ordering::Relaxed);
        busy.join().map_err(|_| "the other one failed")??;
        assert_eq!(counts?, [3; 8]);
        Ok(())
    })
}
