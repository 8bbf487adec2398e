//! Servers that are killed among their writers.

use std::collections::BTreeSet;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use bson::{Document, doc};
use libtest_mimic::Failed;
use mongodb::change_stream::event::{ChangeStreamEvent, ResumeToken};
use mongodb::options::FullDocumentType;
use mongodb::sync::{Client, Collection};

use super::{Case, Served, TIMEOUT};

pub(super) const CASES: &[(&str, Case)] = &[("a_killed_server_keeps_what_it_acknowledged_once_and_tells_it", killed)];

/// How often the server is killed.
const KILLS: &str = "RMEM_TEST_SERVE_KILLS";
/// The document that is stored last.
const END: &str = "end";
/// How many write at once.
const WRITERS: i32 = 8;

fn collection(port: u16) -> Result<Collection<Document>, Failed> {
    let uri = format!("mongodb://127.0.0.1:{port}/?serverSelectionTimeoutMS=20000");
    Ok(Client::with_uri_str(uri)?.database("a").collection("c"))
}

/// Writers add to counters, each in one document of its own, and drivers send again what was lost on the way. So at the
/// end, each counter is what was acknowledged, or one more: what was sent and not answered.
fn killed() -> Result<(), Failed> {
    let kills = std::env::var(KILLS).map_or(Ok(5), |text| text.parse::<u32>())?;
    let folder = tempfile::tempdir()?;
    let mut served = Served::start(folder.path(), &[])?;
    let port: u16 = served.address().rsplit(':').next().ok_or("no port")?.parse()?;
    let listen = format!("127.0.0.1:{port}");
    let over = AtomicBool::new(false);
    let failures = Mutex::new(Vec::new());
    let watches = AtomicBool::new(false);
    let (served, counted) = std::thread::scope(|scope| -> Result<(Served, Vec<(i32, i32)>), Failed> {
        let watcher = scope.spawn(|| watch(port, &watches));
        while !watches.load(Ordering::SeqCst) && !watcher.is_finished() {
            std::thread::sleep(Duration::from_millis(5));
        }
        let writer = |id| {
            let (over, failures) = (&over, &failures);
            scope.spawn(move || (id, add(port, id, over, failures)))
        };
        let writers: Vec<_> = (0..WRITERS).map(writer).collect();
        for _ in 0..kills {
            std::thread::sleep(Duration::from_millis(1500));
            served.kill()?;
            served = Served::start_as(folder.path(), &["--listen", &listen])?;
        }
        std::thread::sleep(Duration::from_millis(300));
        over.store(true, Ordering::SeqCst);
        let counted: Vec<_> = writers.into_iter().map(|writer| writer.join().expect("no panic")).collect();
        collection(port)?.insert_one(doc! { "_id": END }).run()?;
        let seen = watcher.join().expect("no panic")?;
        for (id, count) in &counted {
            let missed: Vec<i32> = (1..=*count).filter(|n| !seen.contains(&(*id, *n))).collect();
            assert!(missed.is_empty(), "the stream missed {missed:?} of {id}");
        }
        Ok((served, counted))
    })?;
    let failures = failures.into_inner().map_err(|_| "it panicked")?;
    assert!(failures.is_empty(), "{failures:?}");
    let found = served.client()?.database("a").collection::<Document>("c");
    for (id, acknowledged) in counted {
        let kept = found.find_one(doc! { "_id": id }).run()?.map_or(0, |found| found.get_i32("n").unwrap_or(0));
        assert!(acknowledged > 0 && kept == acknowledged, "{id}: {acknowledged} acknowledged, {kept} kept");
    }
    Ok(())
}

/// Adds one at a time; gives how often.
fn add(port: u16, id: i32, over: &AtomicBool, failures: &Mutex<Vec<String>>) -> i32 {
    let Ok(found) = collection(port) else { return 0 };
    let mut count = 0;
    while !over.load(Ordering::SeqCst) {
        match found.update_one(doc! { "_id": id }, doc! { "$inc": { "n": 1 } }).upsert(true).run() {
            Ok(_) => count += 1,
            // The driver sends it again once; where that is lost, too, whether it was done is asked.
            Err(_) => match found.find_one(doc! { "_id": id }).run() {
                Ok(kept) => count = kept.map_or(0, |kept| kept.get_i32("n").unwrap_or(0)),
                Err(error) => failures.lock().expect("no panic").push(error.to_string()),
            },
        }
    }
    count
}

/// What a stream reports of counters up to the end, going on behind its last token wherever it is cut.
fn watch(port: u16, watches: &AtomicBool) -> Result<BTreeSet<(i32, i32)>, Failed> {
    let (mut seen, mut token): (_, Option<ResumeToken>) = (BTreeSet::new(), None);
    let since = Instant::now();
    let found = collection(port)?;
    while since.elapsed() < TIMEOUT {
        let watch = found.watch().full_document(FullDocumentType::UpdateLookup);
        let watch = match token.clone() {
            Some(token) => watch.resume_after(token),
            None => watch,
        };
        let Ok(mut stream) = watch.run() else { continue };
        token = token.or_else(|| stream.resume_token());
        watches.store(true, Ordering::SeqCst);
        while let Ok(event) = stream.next_if_any() {
            let Some(event) = event else { continue };
            if event.document_key == Some(doc! { "_id": END }) {
                return Ok(seen);
            }
            seen.extend(number(&event));
            token = Some(event.id);
        }
    }
    Err("the stream did not come to its end".into())
}

fn number(event: &ChangeStreamEvent<Document>) -> Option<(i32, i32)> {
    let document = event.full_document.as_ref()?;
    Some((document.get_i32("_id").ok()?, document.get_i32("n").ok()?))
}
