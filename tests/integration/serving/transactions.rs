//! Sessions: transactions, and writes that are sent again.

use std::time::{Duration, Instant};

use bson::{Bson, Document, doc};
use libtest_mimic::Failed;

use super::wire::{Wire, connected};
use super::{Case, Served};
use crate::processes::until;

pub(super) const CASES: &[(&str, Case)] = &[
    ("a_transaction_is_kept_as_a_whole_or_not_at_all", whole),
    ("nobody_sees_a_transaction_before_it_is_committed_and_writers_wait", alone),
    ("a_second_transaction_is_told_that_one_is_open", second),
    ("a_transaction_that_only_reads_lets_others_write_and_sees_one_state", reading),
    ("a_transaction_that_has_read_writes_if_nothing_was_written_since", upgraded),
    ("cursors_of_a_transaction_outlive_its_first_write", cursors),
    ("a_cursor_is_read_in_its_session_and_transaction_alone", strangers),
    ("a_cursor_of_an_ended_transaction_says_whose_it_was", ended),
    ("a_snapshot_that_cannot_be_taken_is_not_tried_again", exhausted),
    ("a_computable_runs_in_a_transaction_that_has_read", computed),
    ("a_write_that_waits_for_a_transaction_longer_than_it_may_is_not_done", overdue),
    ("a_transaction_whose_client_is_gone_is_over", abandoned),
    ("a_failed_statement_ends_its_transaction", failed),
    ("a_transaction_that_is_not_open_is_told_so_by_its_code", late),
    ("a_transaction_that_waits_ends_with_its_session", killed),
    ("transactions_that_only_read_are_as_many_as_can_be_and_hold_up_no_writer", crowded),
    ("a_write_that_is_sent_again_is_done_once_also_after_a_kill", repeated),
    ("only_the_first_command_says_what_is_read_and_only_the_last_who_confirms", said),
    ("what_is_of_no_transaction_is_refused_in_one", outside),
    ("a_connection_that_ends_leaves_later_transactions_of_its_session", handed),
];

/// A session on a connection of its own.
struct Session {
    wire: Wire,
    id: Bson,
}

impl Session {
    fn open(served: &Served) -> Result<Self, Failed> {
        Ok(Self { wire: Wire::connect(served.address())?, id: bson::Uuid::new().into() })
    }

    fn run(&mut self, number: i64, starts: bool, mut command: Document) -> Result<Document, Failed> {
        command.extend(doc! { "lsid": { "id": self.id.clone() }, "txnNumber": number, "autocommit": false });
        command.entry("$db").or_insert_with(|| "a".into());
        if starts {
            command.insert("startTransaction", true);
        }
        self.wire.run(&command)
    }

    fn end(&mut self, number: i64, name: &str) -> Result<Document, Failed> {
        let mut command = doc! { name: 1 };
        command.extend(
            doc! { "$db": "admin", "lsid": { "id": self.id.clone() }, "txnNumber": number, "autocommit": false },
        );
        self.wire.run(&command)
    }
}

fn insert(id: i32) -> Document {
    doc! { "insert": "c", "documents": [{ "_id": id }] }
}

fn count(wire: &mut Wire) -> Result<i32, Failed> {
    Ok(wire.run(&doc! { "count": "c", "$db": "a" })?.get_i32("n")?)
}

#[track_caller]
fn fine(answer: Document) {
    assert!(answer.get_f64("ok").is_ok_and(|ok| ok > 0.0), "{answer}");
}

#[track_caller]
fn refused(answer: Document, code: i32) {
    assert_eq!(answer.get_i32("code").ok(), Some(code), "{answer}");
}

fn whole() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut session = Session::open(&served)?;
    fine(session.run(1, true, insert(1))?);
    fine(session.run(1, false, insert(2))?);
    fine(session.run(
        1,
        false,
        doc! { "update": "c", "updates": [{ "q": { "_id": 1 }, "u": { "$set": { "n": 1 } } }] },
    )?);
    fine(session.end(1, "commitTransaction")?);
    fine(session.run(2, true, insert(3))?);
    fine(session.end(2, "abortTransaction")?);
    assert_eq!(count(&mut session.wire)?, 2);
    // Sent again, it is committed still.
    fine(session.end(1, "commitTransaction").and_then(|_| session.run(3, true, insert(4)))?);
    fine(session.end(3, "commitTransaction")?);
    fine(session.end(3, "commitTransaction")?);
    refused(session.end(3, "abortTransaction")?, 256);
    served.kill()?;
    let served = Served::start(folder.path(), &[])?;
    let mut again = Session { wire: Wire::connect(served.address())?, id: session.id.clone() };
    fine(again.end(3, "commitTransaction")?);
    assert_eq!(count(&mut again.wire)?, 3);
    Ok(())
}

fn alone() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let (mut session, mut other) = (Session::open(&served)?, Wire::connect(served.address())?);
    fine(session.run(1, true, insert(1))?);
    let found = session.run(1, false, doc! { "find": "c", "filter": {} })?;
    assert_eq!(found.get_document("cursor")?.get_array("firstBatch")?.len(), 1);
    assert_eq!(count(&mut other)?, 0);
    let mut plain = insert(2);
    plain.insert("$db", "a");
    let writer = std::thread::spawn(move || {
        let answer = other.run(&plain);
        (answer.map(|answer| answer.get_i32("n").unwrap_or_default()).map_err(|_| ()), Instant::now())
    });
    std::thread::sleep(Duration::from_millis(300));
    let before = Instant::now();
    fine(session.run(1, false, insert(3))?);
    fine(session.end(1, "commitTransaction")?);
    let (written, after) = writer.join().map_err(|_| "it panicked")?;
    assert!(written == Ok(1) && after > before);
    assert_eq!(count(&mut session.wire)?, 3);
    Ok(())
}

fn found(answer: &Document, batch: &str) -> Result<Vec<i32>, Failed> {
    let batch = answer.get_document("cursor")?.get_array(batch)?.iter();
    Ok(batch.filter_map(|found| found.as_document()?.get_i32("_id").ok()).collect())
}

fn all() -> Document {
    doc! { "find": "c", "filter": {} }
}

fn plain(wire: &mut Wire, mut command: Document) -> Result<Document, Failed> {
    command.insert("$db", "a");
    wire.run(&command)
}

fn reading() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut other = Wire::connect(served.address())?;
    fine(plain(&mut other, insert(1))?);
    let (mut one, mut two) = (Session::open(&served)?, Session::open(&served)?);
    assert_eq!(found(&one.run(1, true, all())?, "firstBatch")?, [1]);
    // An open transaction that waited for the writer, or that the writer waited for, would stop all of this.
    fine(plain(&mut other, insert(2))?);
    fine(two.run(1, true, insert(3))?);
    assert_eq!(found(&two.run(1, false, all())?, "firstBatch")?, [1, 2, 3]);
    assert_eq!(found(&one.run(1, false, all())?, "firstBatch")?, [1]);
    fine(two.end(1, "commitTransaction")?);
    assert_eq!(found(&one.run(1, false, all())?, "firstBatch")?, [1]);
    refused(one.run(1, true, all())?, 117);
    refused(one.run(0, false, all())?, 225);
    fine(one.end(1, "commitTransaction")?);
    fine(one.end(1, "commitTransaction")?);
    refused(one.run(1, false, all())?, 256);
    assert_eq!(found(&one.run(2, true, all())?, "firstBatch")?, [1, 2, 3]);
    fine(one.end(2, "abortTransaction")?);
    refused(one.end(2, "commitTransaction")?, 251);
    // A transaction that failed while it read is over.
    fine(one.run(3, true, all())?);
    refused(one.run(3, false, doc! { "find": "c", "filter": { "$x": 1 } })?, 2);
    refused(one.run(3, false, all())?, 251);
    refused(one.end(3, "commitTransaction")?, 251);
    Ok(())
}

fn upgraded() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut other = Wire::connect(served.address())?;
    let mut session = Session::open(&served)?;
    fine(session.run(1, true, all())?);
    fine(session.run(1, false, insert(1))?);
    assert_eq!(found(&session.run(1, false, all())?, "firstBatch")?, [1]);
    assert_eq!(count(&mut other)?, 0);
    fine(session.end(1, "commitTransaction")?);
    fine(session.end(1, "commitTransaction")?);
    assert_eq!(found(&session.run(2, true, all())?, "firstBatch")?, [1]);
    fine(plain(&mut other, insert(2))?);
    let answer = session.run(2, false, insert(3))?;
    assert_eq!(answer.get_array("errorLabels")?, &vec![Bson::from("TransientTransactionError")]);
    refused(answer, 112);
    refused(session.end(2, "commitTransaction")?, 251);
    assert_eq!(found(&session.run(3, true, all())?, "firstBatch")?, [1, 2]);
    // The next try keeps others from writing until it ends.
    let mut late = Wire::connect(served.address())?;
    std::thread::scope(|scope| -> Result<(), Failed> {
        let writer = scope.spawn(|| plain(&mut late, insert(4)).map_err(|_| "the connection broke"));
        fine(session.run(3, false, insert(3))?);
        fine(session.end(3, "abortTransaction")?);
        fine(writer.join().map_err(|_| "the writer panicked")??);
        Ok(())
    })?;
    assert_eq!(found(&plain(&mut other, all())?, "firstBatch")?, [1, 2, 4]);
    Ok(())
}

fn cursors() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut session = Session::open(&served)?;
    for id in 1..=5 {
        fine(plain(&mut session.wire, insert(id))?);
    }
    let answer = session.run(1, true, doc! { "find": "c", "filter": {}, "batchSize": 2 })?;
    assert_eq!(found(&answer, "firstBatch")?, [1, 2]);
    let cursor = answer.get_document("cursor")?.get_i64("id")?;
    let more = || doc! { "getMore": cursor, "collection": "c", "batchSize": 1 };
    assert_eq!(found(&session.run(1, false, more())?, "nextBatch")?, [3]);
    fine(session.run(1, false, doc! { "delete": "c", "deletes": [{ "q": { "_id": 4 }, "limit": 1 }] })?);
    assert_eq!(found(&session.run(1, false, more())?, "nextBatch")?, [4]);
    fine(session.run(1, false, insert(6))?);
    assert_eq!(found(&session.run(1, false, more())?, "nextBatch")?, [5]);
    fine(session.end(1, "commitTransaction")?);
    assert_eq!(count(&mut session.wire)?, 5);
    Ok(())
}

fn strangers() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut other = Wire::connect(served.address())?;
    for id in 1..=9 {
        fine(plain(&mut other, insert(id))?);
    }
    // A cursor is with the thread of its transaction, with the writer, and with the one beside the other.
    for (before, behind) in [(None, None), (Some(insert(10)), None), (None, Some(insert(10)))] {
        let mut session = Session::open(&served)?;
        let (is_writing, lsid) = (before.is_some(), doc! { "id": session.id.clone() });
        before.map_or(Ok(()), |first| session.run(1, true, first).map(fine))?;
        let answer = session.run(1, !is_writing, doc! { "find": "c", "filter": {}, "batchSize": 2 })?;
        let cursor = answer.get_document("cursor")?.get_i64("id")?;
        behind.map_or(Ok(()), |then| session.run(1, false, then).map(fine))?;
        let more = || doc! { "getMore": cursor, "collection": "c", "batchSize": 1 };
        let mut with = |fields: Document| plain(&mut other, more().into_iter().chain(fields).collect());
        refused(with(doc! {})?, 50_737);
        refused(with(doc! { "lsid": &lsid })?, 50_740);
        refused(with(doc! { "lsid": { "id": bson::Uuid::new() } })?, 50_738);
        refused(with(doc! { "lsid": &lsid, "txnNumber": 1_i64 })?, 50_768);
        // What is no transaction of the session leaves the one that is open as it is.
        refused(session.run(2, false, more())?, 251);
        refused(session.end(2, "commitTransaction")?, 251);
        assert_eq!(found(&session.run(1, false, more())?, "nextBatch")?, [3]);
        let answer = plain(&mut other, doc! { "killCursors": "c", "cursors": [cursor] })?;
        assert_eq!(answer.get_array("cursorsKilled")?.len(), 1, "{answer}");
        refused(session.run(1, false, more())?, 43);
        refused(session.end(1, "abortTransaction")?, 251);
        let written = more().into_iter().chain(doc! { "lsid": lsid, "txnNumber": 1_i64 }).collect();
        refused(plain(&mut other, written)?, 50_768);
    }
    assert_eq!(count(&mut other)?, 9);
    Ok(())
}

fn ended() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut other = Wire::connect(served.address())?;
    for id in 1..=9 {
        fine(plain(&mut other, insert(id))?);
    }
    for (is_writing, end) in [
        (false, "commitTransaction"),
        (false, "abortTransaction"),
        (true, "commitTransaction"),
        (true, "abortTransaction"),
    ] {
        let mut session = Session::open(&served)?;
        let lsid = doc! { "id": session.id.clone() };
        if is_writing {
            let statement = doc! { "q": { "_id": 1 }, "u": { "$inc": { "n": 1 } } };
            fine(session.run(1, true, doc! { "update": "c", "updates": [statement] })?);
        }
        let answer = session.run(1, !is_writing, doc! { "find": "c", "filter": {}, "batchSize": 2 })?;
        let cursor = answer.get_document("cursor")?.get_i64("id")?;
        fine(session.end(1, end)?);
        let more = || doc! { "getMore": cursor, "collection": "c", "batchSize": 1 };
        let mut with = |fields: Document| plain(&mut other, more().into_iter().chain(fields).collect());
        refused(with(doc! {})?, 50_737);
        refused(with(doc! { "lsid": &lsid })?, 50_740);
        refused(with(doc! { "lsid": { "id": bson::Uuid::new() } })?, 50_738);
        fine(session.run(2, true, all())?);
        refused(session.run(2, false, more())?, 50_741);
        fine(plain(&mut other, doc! { "endSessions": [lsid] })?);
        refused(plain(&mut other, more())?, 43);
    }
    Ok(())
}

fn exhausted() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start_limited(folder.path(), 64)?;
    let mut session = Session::open(&served)?;
    fine(plain(&mut session.wire, insert(1))?);
    let (mut open, mut refusals) = (Vec::new(), 0);
    // The thread of a transaction may fail before it is asked, or behind that: the client hears why in either case.
    while refusals < 20 {
        session.id = bson::Uuid::new().into();
        let answer = session.run(1, true, all())?;
        if !answer.contains_key("code") {
            open.push(session.id.clone());
            continue;
        }
        assert!(!answer.contains_key("errorLabels") && answer.get_str("errmsg")?.contains("open files"), "{answer}");
        refusals += 1;
    }
    refused(session.end(1, "commitTransaction")?, 251);
    // There is room again when some have ended.
    for id in open {
        session.id = id;
        fine(session.end(1, "commitTransaction")?);
    }
    fine(plain(&mut session.wire, insert(2))?);
    assert_eq!(count(&mut session.wire)?, 2);
    Ok(())
}

fn computed() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let settings = "[[computable]]\nname = 'double'\ncollection = 'a.c'\nspec = \"{double: {$exists: true}}\"\ncache = '1m'\n\
                    pipeline = \"[{$match: {_id: 4}}, {$project: {_id: 0, double: {$multiply: ['$_id', 2]}}}]\"\n";
    std::fs::write(folder.path().join("rmem.toml"), settings)?;
    let served = Served::start(folder.path(), &[])?;
    let mut session = Session::open(&served)?;
    fine(plain(&mut session.wire, insert(4))?);
    assert_eq!(found(&session.run(1, true, all())?, "firstBatch")?, [4]);
    let answer = session.run(1, false, doc! { "find": "c", "filter": { "double": 8 } })?;
    assert_eq!(answer.get_document("cursor")?.get_array("firstBatch")?.len(), 1, "{answer}");
    fine(session.end(1, "commitTransaction")?);
    // What is computed is found, and not changed.
    let modify = doc! { "findAndModify": "c", "query": { "double": 8 } };
    let with = |fields: Document| modify.clone().into_iter().chain(fields).collect::<Document>();
    for command in [
        doc! { "update": { "$set": { "a": 1 } } },
        doc! { "update": { "$set": { "a": 1 } }, "new": true },
        doc! { "remove": true },
    ] {
        let answer = plain(&mut session.wire, with(command))?;
        let last = answer.get_document("lastErrorObject")?;
        assert_eq!((last.get_i32("n")?, answer.get("value")), (0, Some(&Bson::Null)), "{answer}");
    }
    Ok(())
}

fn second() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let (mut one, mut other) = (Session::open(&served)?, Session::open(&served)?);
    fine(one.run(1, true, insert(1))?);
    let answer = other.run(1, true, insert(2))?;
    assert_eq!(answer.get_array("errorLabels")?, &vec![Bson::from("TransientTransactionError")]);
    refused(answer, 112);
    fine(one.end(1, "commitTransaction")?);
    fine(other.run(2, true, insert(2))?);
    fine(other.end(2, "commitTransaction")?);
    assert_eq!(count(&mut one.wire)?, 2);
    Ok(())
}

fn overdue() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let (mut session, mut other) = (Session::open(&served)?, Wire::connect(served.address())?);
    fine(session.run(1, true, insert(1))?);
    let mut limited = insert(2);
    limited.insert("maxTimeMS", 100);
    refused(plain(&mut other, limited)?, 50);
    fine(session.end(1, "commitTransaction")?);
    fine(plain(&mut other, insert(3))?);
    assert_eq!(found(&plain(&mut other, all())?, "firstBatch")?, [1, 3]);
    Ok(())
}

fn abandoned() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut session = Session::open(&served)?;
    fine(session.run(1, true, insert(1))?);
    let id = session.id.clone();
    drop(session);
    let mut other = Wire::connect(served.address())?;
    let since = Instant::now();
    let mut plain = insert(2);
    plain.insert("$db", "a");
    fine(other.run(&plain)?);
    assert!(since.elapsed() < Duration::from_secs(30));
    assert_eq!(count(&mut other)?, 1);
    let mut again = Session { wire: other, id };
    refused(again.end(1, "commitTransaction")?, 251);
    Ok(())
}

fn handed() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    for (number, is_writing) in [(1, true), (3, false)] {
        let command = |id| if is_writing { insert(id) } else { all() };
        let mut first = Session::open(&served)?;
        let mut second = Session { wire: Wire::connect(served.address())?, id: first.id.clone() };
        assert!(!first.run(number, true, command(1))?.contains_key("code"));
        fine(second.end(number, "commitTransaction")?);
        assert!(!second.run(number + 1, true, command(2))?.contains_key("code"));
        drop(first);
        // The server has seen that it is gone.
        until("the first connection is over", || Ok(connected(&mut second.wire)? == 1))?;
        assert!(!second.run(number + 1, false, command(3))?.contains_key("code"));
        fine(second.end(number + 1, "commitTransaction")?);
    }
    assert_eq!(count(&mut Wire::connect(served.address())?)?, 3);
    Ok(())
}

fn failed() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut session = Session::open(&served)?;
    fine(session.run(1, true, insert(1))?);
    // It is no write by itself, and not begun twice.
    let again = insert(1).into_iter().chain(doc! { "lsid": { "id": session.id.clone() }, "txnNumber": 1_i64 });
    refused(plain(&mut session.wire, again.collect())?, 217);
    let answer = session.run(1, false, insert(1))?;
    assert!(answer.contains_key("writeErrors"), "{answer}");
    let answer = session.run(1, false, insert(2))?;
    assert_eq!(answer.get_array("errorLabels")?, &vec![Bson::from("TransientTransactionError")]);
    refused(answer, 251);
    refused(session.end(1, "commitTransaction")?, 251);
    refused(session.run(1, true, insert(1))?, 117);
    assert_eq!(count(&mut session.wire)?, 0);
    refused(session.run(2, true, doc! { "count": "c" })?, 263);
    Ok(())
}

fn late() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let mut served = Served::start(folder.path(), &[])?;
    let mut session = Session::open(&served)?;
    refused(session.run(5, false, insert(1))?, 251);
    refused(session.end(5, "abortTransaction")?, 251);
    fine(session.run(6, true, insert(1))?);
    // A later transaction of the session takes the place of the one that is open.
    fine(session.run(7, true, insert(2))?);
    refused(session.run(6, false, insert(3))?, 225);
    // A read that starts it again, or an older one, leaves it as it is.
    refused(session.run(7, true, all())?, 117);
    refused(session.run(6, true, all())?, 225);
    fine(session.end(7, "commitTransaction")?);
    refused(session.end(6, "commitTransaction")?, 225);
    assert_eq!(count(&mut session.wire)?, 1);
    // A read that fails ends its transaction.
    for number in 8..20 {
        assert!(session.run(number, true, doc! { "find": "c", "filter": { "$bad": 1 } })?.contains_key("code"));
        refused(session.end(number, "commitTransaction")?, 251);
    }
    // A server that was started again knows the last one that was committed.
    fine(session.run(20, true, insert(5))?);
    fine(session.end(20, "commitTransaction")?);
    served.kill()?;
    served = Served::start(folder.path(), &[])?;
    session.wire = Wire::connect(served.address())?;
    refused(session.run(20, true, insert(6))?, 117);
    refused(session.run(19, true, insert(6))?, 225);
    fine(session.end(20, "commitTransaction")?);
    fine(session.run(21, true, insert(6))?);
    fine(session.end(21, "commitTransaction")?);
    assert_eq!(count(&mut session.wire)?, 3);
    Ok(())
}

/// A transaction that waits for another one, and whose session is ended.
fn killed() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let (mut open, mut waiting) = (Session::open(&served)?, Session::open(&served)?);
    fine(open.run(1, true, insert(1))?);
    let id = waiting.id.clone();
    let waits = std::thread::spawn(move || {
        let answer = waiting.run(1, true, insert(2)).map_err(|error| format!("{error:?}"));
        (waiting, answer)
    });
    let mut other = Wire::connect(served.address())?;
    // It is killed as often as it takes for it to have come.
    let kill = doc! { "killSessions": [{ "id": id }], "$db": "admin" };
    while !waits.is_finished() {
        fine(other.run(&kill)?);
        std::thread::sleep(Duration::from_millis(20));
    }
    let (mut waiting, answer) = waits.join().map_err(|_| "the thread failed")?;
    refused(answer?, 251);
    fine(open.end(1, "commitTransaction")?);
    refused(waiting.end(1, "commitTransaction")?, 251);
    assert_eq!(count(&mut other)?, 1);
    Ok(())
}

/// One that only reads has a thread, of which there are 200.
fn crowded() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut session = Session::open(&served)?;
    fine(plain(&mut session.wire, insert(1))?);
    let mut open = Vec::new();
    for _ in 0..200 {
        session.id = bson::Uuid::new().into();
        fine(session.run(1, true, all())?);
        open.push(session.id.clone());
    }
    session.id = bson::Uuid::new().into();
    let answer = session.run(1, true, all())?;
    assert!(answer.get_array("errorLabels")?.contains(&"TransientTransactionError".into()), "{answer}");
    refused(answer, 112);
    // No writer waits for them.
    fine(plain(&mut session.wire, with_time(insert(2)))?);
    session.id = open.pop().unwrap_or(Bson::Null);
    fine(session.end(1, "commitTransaction")?);
    session.id = bson::Uuid::new().into();
    fine(session.run(1, true, all())?);
    Ok(())
}

fn with_time(mut command: Document) -> Document {
    command.insert("maxTimeMS", 20_000);
    command
}

fn said() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut session = Session::open(&served)?;
    let with = |mut command: Document, more: Document| {
        command.extend(more);
        command
    };
    let level = |level: &str| doc! { "readConcern": { "level": level } };
    refused(session.run(1, true, with(all(), level("linearizable")))?, 72);
    refused(session.run(2, true, with(all(), level("available")))?, 72);
    fine(session.run(3, true, with(all(), level("majority")))?);
    refused(session.run(3, false, with(all(), level("local")))?, 72);
    refused(session.run(4, true, with(insert(1), doc! { "writeConcern": { "w": 1 } }))?, 72);
    refused(session.run(5, true, with(all(), doc! { "$db": "config" }))?, 263);
    refused(session.run(6, false, doc! { "commitTransaction": 1 })?, 13);
    // A write of an older number, and one of many documents, cannot be known again.
    fine(session.run(9, true, all())?);
    let write = |number: i64, multi: bool| {
        let update = doc! { "q": {}, "u": { "$set": { "n": 1 } }, "multi": multi };
        doc! { "update": "c", "updates": [update], "$db": "a", "lsid": { "id": session.id.clone() }, "txnNumber": number }
    };
    refused(session.wire.run(&write(8, false))?, 225);
    // The statement fails, and not the command.
    let of_many = session.wire.run(&write(10, true))?;
    let errors = of_many.get_array("writeErrors")?.iter().filter_map(Bson::as_document);
    assert_eq!(errors.map(|error| error.get_i32("code").ok()).collect::<Vec<_>>(), [Some(72)], "{of_many}");
    fine(session.wire.run(&write(11, false))?);
    Ok(())
}

fn outside() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut session = Session::open(&served)?;
    fine(plain(&mut session.wire, insert(0))?);
    // A command that is of no transaction leaves the one that is open as it is.
    fine(session.run(1, true, insert(1))?);
    for name in ["ping", "hello", "serverStatus"] {
        refused(session.run(1, false, doc! { name: 1 })?, 263);
    }
    fine(session.end(1, "commitTransaction")?);
    // What fails in one ends it.
    let stage = |stage: &str| doc! { "aggregate": "c", "pipeline": [{ stage: {} }], "cursor": {} };
    let index = doc! { "createIndexes": "c", "indexes": [{ "key": { "a": 1 }, "name": "a_1" }] };
    for (number, command) in (2..).zip([stage("$collStats"), stage("$indexStats"), index]) {
        fine(session.run(number, true, insert(2))?);
        refused(session.run(number, false, command)?, 263);
        refused(session.end(number, "commitTransaction")?, 251);
    }
    // An unordered insert stops at the first failure, too.
    let documents = [doc! { "_id": 5 }, doc! { "_id": 0 }, doc! { "_id": 0 }];
    let unordered = doc! { "insert": "c", "documents": documents.to_vec(), "ordered": false };
    assert_eq!(session.run(6, true, unordered)?.get_array("writeErrors")?.len(), 1);
    // A write concern that names no members fails nothing, and keeps nothing open.
    let concern = |command: &str| doc! { command: 1, "writeConcern": { "w": "far" }, "$db": "admin" };
    fine(session.run(7, true, insert(7))?);
    fine(session.run(7, false, concern("abortTransaction"))?);
    refused(session.end(7, "commitTransaction")?, 251);
    fine(session.run(8, true, insert(8))?);
    let answer = session.run(8, false, concern("commitTransaction"))?;
    assert_eq!(answer.get_document("writeConcernError")?.get_i32("code")?, 79);
    assert_eq!(count(&mut session.wire)?, 3);
    Ok(())
}

fn repeated() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let mut served = Served::start(folder.path(), &[])?;
    let session: Bson = bson::Uuid::new().into();
    let add = |number: i64| {
        let update = doc! { "q": { "_id": 1 }, "u": { "$inc": { "n": 1 } }, "upsert": true };
        doc! { "update": "c", "updates": [update], "$db": "a", "lsid": { "id": session.clone() }, "txnNumber": number }
    };
    let modify = |number: i64| {
        doc! {
            "findAndModify": "c", "query": { "_id": 1 }, "update": { "$inc": { "n": 1 } }, "new": true,
            "$db": "a", "lsid": { "id": session.clone() }, "txnNumber": number,
        }
    };
    for number in 1..=4 {
        let command = if number % 2 == 1 { add(number) } else { modify(number) };
        let mut wire = Wire::connect(served.address())?;
        let mut answers = vec![wire.run(&command)?, wire.run(&command)?];
        served.kill()?;
        served = Served::start(folder.path(), &[])?;
        answers.push(Wire::connect(served.address())?.run(&command)?);
        for (nth, answer) in answers.iter_mut().enumerate() {
            let retried = [answer.remove("retriedStmtIds"), answer.remove("retriedStmtId")];
            assert_eq!(retried.iter().flatten().count(), usize::from(nth > 0), "{answer}");
            answer.remove("operationTime");
            answer.remove("$clusterTime");
        }
        assert!(answers[0] == answers[1] && answers[1] == answers[2], "{answers:?}");
    }
    let mut wire = Wire::connect(served.address())?;
    let found = wire.run(&doc! { "find": "c", "$db": "a" })?;
    let batch = found.get_document("cursor")?.get_array("firstBatch")?.clone();
    assert_eq!(batch, [Bson::Document(doc! { "_id": 1, "n": 4 })]);
    refused(wire.run(&add(2))?, 225);
    Ok(())
}
