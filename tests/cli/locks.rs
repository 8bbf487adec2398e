//! lock, unlock.

use std::time::{Duration, Instant};

use crate::lab::Lab;

fn lock(lab: &Lab, owner: &str, args: &[&str]) -> crate::lab::Finished {
    lab.rmem(&[&["lock", "table", "--owner", owner], args].concat())
}

#[test]
fn a_lock_excludes_others_until_it_is_given_back() {
    let lab = Lab::new();
    let mutex = lock(&lab, "r1", &[]).success();
    assert!(mutex.starts_with(r#"{"_id":"table","locked":true,"locked-by":"r1","lock-time":{"$date":"#), "{mutex}");
    let held = lock(&lab, "r2", &[]).exits(5);
    assert!(held.stderr.starts_with("error: table is held by r1 since 20"), "{held}");
    assert!(held.stderr.ends_with("with no end\n"), "{held}");
    lock(&lab, "r1", &[]).success();
    let held = lab.rmem(&["unlock", "table", "--owner", "r2"]).exits(5);
    assert!(held.stderr.contains("not by r2"), "{held}");
    let free = lab.rmem(&["unlock", "table", "--owner", "r1"]).success();
    assert_eq!(free, "{\"_id\":\"table\",\"locked\":false}\n");
    lab.rmem(&["unlock", "table", "--owner", "r1"]).exits(1);
    lock(&lab, "r2", &[]).success();
    let stored = lab.rmem(&["distinct", "robmem.mutexes", "locked-by", "{locked: true}"]).success();
    assert_eq!(stored, "\"r2\"\n");
}

#[test]
fn nobody_is_no_owner_and_nothing_is_no_lock() {
    let lab = Lab::new();
    lab.rmem(&["lock", "arm", "--owner", ""]).exits(2);
    lab.rmem(&["lock", ""]).exits(2);
    lab.rmem(&["unlock", "arm", "--owner", ""]).exits(2);
}

#[test]
fn a_lock_expires_and_the_holder_renews_it() {
    let lab = Lab::new();
    lock(&lab, "r1", &["--ttl", "1h"]).success();
    let held = lock(&lab, "r2", &[]).exits(5);
    assert!(held.stderr.contains(" until 20"), "{held}");
    lock(&lab, "r1", &["--ttl", "1ms"]).success();
    std::thread::sleep(Duration::from_millis(20));
    lock(&lab, "r2", &[]).success();
    lab.rmem(&["unlock", "table", "--owner", "r1"]).exits(5);
}

#[test]
fn waiting_ends_when_the_lock_is_free_or_patience_is_over() {
    let lab = Lab::new();
    lock(&lab, "r1", &["--ttl", "700ms"]).success();
    let start = Instant::now();
    lock(&lab, "r2", &["--wait", "50ms"]).exits(5);
    assert!(start.elapsed() >= Duration::from_millis(50));
    lock(&lab, "r2", &["--wait", "1m"]).success();
    assert!(start.elapsed() < Duration::from_secs(50));
}

#[test]
fn the_owner_is_told_or_known_never_guessed() {
    let lab = Lab::new();
    let refused = lab.rmem(&["lock", "table"]).exits(2);
    assert!(refused.stderr.contains("expected --owner"), "{refused}");
    let lab = lab.env("USER", "robotino").env("HOSTNAME", "r2");
    assert!(lab.rmem(&["lock", "table"]).success().contains(r#""locked-by":"robotino@r2""#));
    lab.rmem(&["unlock", "table"]).success();
}

#[test]
fn a_pipeline_does_not_leave_its_store() {
    let lab = Lab::new();
    lab.write(
        "rmem.toml",
        "memory = \"file:local.rmem\"\nshared = \"file:shared.rmem\"\nshared_databases = [\"team\"]\n",
    );
    lab.rmem(&["insert", "own.a", "{_id: 1}"]).success();
    lab.rmem(&["insert", "team.a", "{_id: 2}"]).success();
    for (ns, stage) in [
        ("own.a", "{$out: {db: 'team', coll: 'leak'}}"),
        ("team.a", "{$out: {db: 'own', coll: 'leak'}}"),
        ("team.a", "{$merge: {into: {db: 'own', coll: 'leak'}}}"),
        ("own.a", "{$lookup: {from: {db: 'team', coll: 'a'}, pipeline: [], as: 'x'}}"),
    ] {
        let refused = lab.rmem(&["aggregate", ns, &format!("[{stage}]")]).exits(3);
        assert!(refused.stderr.contains("does not leave its store"), "{refused}");
    }
    lab.rmem(&["aggregate", "team.a", "[{$out: {db: 'team', coll: 'b'}}]"]).success();
    assert_eq!(lab.rmem(&["collections"]).success().lines().count(), 3);
}

#[test]
fn locks_of_shared_databases_are_shared() {
    let lab = Lab::new();
    lab.write(
        "rmem.toml",
        "memory = \"file:local.rmem\"\nshared = \"file:shared.rmem\"\nshared_databases = [\"team\"]\n",
    );
    lock(&lab, "r1", &[]).success();
    lab.write("empty.toml", "");
    let shared = lab.rmem(&["--config", "empty.toml", "--memory", "file:shared.rmem", "collections"]);
    assert_eq!(shared.success(), "team.mutexes\n");
    lock(&lab, "r2", &["--into", "robmem.own"]).success();
    assert_eq!(lab.rmem(&["count", "robmem.own"]).success(), "1\n");
}

#[test]
fn of_many_processes_one_at_a_time_holds_the_lock() {
    const ROUNDS: usize = 4;
    const ROBOTS: usize = 5;
    let lab = Lab::new();
    lab.rmem(&["insert", "robmem.counter", "{_id: 1, n: 0}"]).success();
    let script = format!(
        "for robot in $(seq {ROBOTS}); do (
           for round in $(seq {ROUNDS}); do
             rmem lock table --owner r$robot --wait 5m >/dev/null || exit 9
             n=$(rmem distinct robmem.counter n)
             rmem update robmem.counter '{{_id: 1}}' \"{{\\$set: {{n: $((n + 1))}}}}\" >/dev/null || exit 8
             rmem unlock table --owner r$robot >/dev/null || exit 7
           done ) & pids=\"$pids $!\"; done
         for pid in $pids; do wait $pid || exit $?; done"
    );
    lab.shell(&script).success();
    assert_eq!(lab.rmem(&["distinct", "robmem.counter", "n"]).success(), format!("{}\n", ROUNDS * ROBOTS));
}
