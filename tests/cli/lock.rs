//! lock, unlock.

use std::time::{Duration, Instant};

use crate::lab::watch::TIMEOUT;
use crate::lab::{Lab, assert_run};

fn lock(lab: &Lab, owner: &str, args: &[&str]) -> crate::lab::Finished {
    lab.rmem(&[&["lock", "table", "--owner", owner], args].concat())
}

#[test]
fn a_name_or_an_owner_of_several_lines_is_shown_in_one() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    let name = "x\u{1b}[31m\nerror: forged";
    lab.rmem(&["lock", name, "--owner", "r1\nerror: forged"]).success();
    let held = lab.rmem(&["lock", name, "--owner", "r2"]).exits(5);
    let start = "error: x\\u{1b}[31m\\nerror: forged is held by r1\\nerror: forged since ";
    assert!(held.stderr.starts_with(start) && held.stderr.lines().count() == 1, "{held}");
    let held = lab.rmem(&["unlock", name, "--owner", "r2\n"]).exits(5);
    assert!(held.stderr.starts_with(start) && held.stderr.lines().count() == 1, "{held}");
}

#[test]
fn a_lock_excludes_others_until_it_is_given_back() {
    let lab = Lab::new();
    assert_run!(lock(&lab, "r1", &[]), @r#"
    {"_id":"table","locked":true,"locked-by":"r1","lock-time":{"$date":"[TIME]"}}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(lock(&lab, "r2", &[]), @r"
    ------- stderr -------
    error: table is held by r1 since [TIME], with no end
    [exit code: 5]
    ");
    lock(&lab, "r1", &[]).success();
    assert_run!(lab.rmem(&["unlock", "table", "--owner", "r2"]), @r"
    ------- stderr -------
    error: table is held by r1 since [TIME], with no end, not by r2
    [exit code: 5]
    ");
    assert_run!(lab.rmem(&["unlock", "table", "--owner", "r1"]), @r#"
    {"_id":"table","locked":false}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&["unlock", "table", "--owner", "r1"]), @r"
    ------- stderr -------
    error: table is not locked
    [exit code: 1]
    ");
    lock(&lab, "r2", &[]).success();
    let stored = lab.rmem(&["distinct", "robmem.mutexes", "locked-by", "{locked: true}"]).success();
    assert_eq!(stored, "\"r2\"\n");
}

#[test]
fn a_time_that_no_date_can_hold_is_refused_and_no_lock_is_made() {
    let lab = Lab::new();
    assert_run!(lock(&lab, "r1", &["--ttl", "99999999999999d"]), @r"
    ------- stderr -------
    error: invalid value '99999999999999d' for '--ttl <DURATION>': 99999999999999d is too long; expected at most 36500d

    For more information, try '--help'.
    [exit code: 2]
    ");
    assert_eq!(lab.rmem(&["collections"]).stdout, "");
}

#[test]
fn an_empty_owner_and_an_empty_name_are_refused() {
    let lab = Lab::new();
    assert_run!(lab.rmem(&["lock", "arm", "--owner", ""]), @r"
    ------- stderr -------
    error: a value is required for '--owner <OWNER>' but none was supplied

    For more information, try '--help'.
    [exit code: 2]
    ");
    assert_run!(lab.rmem(&["lock", ""]), @r"
    ------- stderr -------
    error: a value is required for '<NAME>' but none was supplied

    For more information, try '--help'.
    [exit code: 2]
    ");
    assert_run!(lab.rmem(&["unlock", "arm", "--owner", ""]), @r"
    ------- stderr -------
    error: a value is required for '--owner <OWNER>' but none was supplied

    For more information, try '--help'.
    [exit code: 2]
    ");
}

#[test]
fn a_lock_expires_and_the_holder_renews_it() {
    let lab = Lab::new();
    lock(&lab, "r1", &["--ttl", "1h"]).success();
    assert_run!(lock(&lab, "r2", &[]), @r"
    ------- stderr -------
    error: table is held by r1 since [TIME] until [TIME]
    [exit code: 5]
    ");
    lock(&lab, "r1", &["--ttl", "1ms"]).success();
    std::thread::sleep(Duration::from_millis(20));
    lock(&lab, "r2", &[]).success();
    lab.rmem(&["unlock", "table", "--owner", "r1"]).exits(5);
}

#[test]
fn waiting_ends_when_the_lock_is_free_or_the_timeout_is_over() {
    let lab = Lab::new();
    lock(&lab, "r1", &["--ttl", "1h"]).success();
    let start = Instant::now();
    lock(&lab, "r2", &["--wait", "50ms"]).exits(5);
    assert!(start.elapsed() >= Duration::from_millis(50));
    // Given back while another waits, who waits on if that is not noticed.
    let start = Instant::now();
    std::thread::scope(|scope| {
        let waiting = scope.spawn(|| lock(&lab, "r2", &["--wait", "5m"]));
        std::thread::sleep(Duration::from_millis(200));
        lab.rmem(&["unlock", "table", "--owner", "r1"]).success();
        waiting.join().unwrap().success();
    });
    assert!(start.elapsed() < TIMEOUT);
    // Or over by itself.
    lock(&lab, "r2", &["--ttl", "500ms"]).success();
    let start = Instant::now();
    lock(&lab, "r1", &["--wait", "5m"]).success();
    assert!(start.elapsed() < TIMEOUT);
}

#[test]
fn the_owner_is_an_option_or_the_user_of_this_host() {
    let lab = Lab::new();
    assert_run!(lab.rmem(&["lock", "table"]), @r"
    ------- stderr -------
    error: the owner is not known: USER is not set; expected --owner OWNER
    [exit code: 2]
    ");
    let lab = lab.env("USER", "robotino");
    let locked = lab.rmem(&["lock", "table"]).success();
    let host = rustix::system::uname().nodename().to_string_lossy().into_owned();
    assert!(locked.contains(&format!("\"locked-by\":\"robotino@{host}\"")), "{locked}");
    lab.rmem(&["unlock", "table"]).success();
    let lab = lab.env("HOSTNAME", "r2");
    assert_run!(lab.rmem(&["lock", "table"]), @r#"
    {"_id":"table","locked":true,"locked-by":"robotino@r2","lock-time":{"$date":"[TIME]"}}
    ------- stderr -------
    [exit code: 0]
    "#);
    lab.rmem(&["unlock", "table"]).success();
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

#[test]
fn a_lock_of_a_robot_that_is_gone_is_taken_by_force() {
    let lab = Lab::new();
    lock(&lab, "gone", &[]).success();
    lock(&lab, "r2", &[]).exits(5);
    assert_run!(lock(&lab, "r2", &["--force"]), @r#"
    {"_id":"table","locked":true,"locked-by":"r2","lock-time":{"$date":"[TIME]"}}
    ------- stderr -------
    table was held by gone since [TIME], with no end
    [exit code: 0]
    "#);
    lock(&lab, "gone", &[]).exits(5);
    // Of an owner's own lock, there is nothing to say; so of a free one.
    assert_eq!(lock(&lab, "r2", &["--force"]).stderr, "");
    lab.rmem(&["lock", "free", "--owner", "r2", "--force"]).success();
    lab.rmem(&["unlock", "table", "--owner", "r2"]).success();
}

#[test]
fn a_lock_that_was_taken_in_the_future_is_told() {
    let lab = Lab::new();
    let taken = r#"{_id: "table", locked: true, "locked-by": "r1", "lock-time": ISODate("2150-01-01T00:00:00Z")}"#;
    lab.rmem(&["insert", "robmem.mutexes", taken]).success();
    assert_run!(lock(&lab, "r2", &[]), @r"
    ------- stderr -------
    error: table is held by r1 since [TIME] (in the future: this clock was set back, or another machine's is ahead), with no end
    [exit code: 5]
    ");
}

#[test]
fn expired_locks_are_released_and_the_others_stay() {
    let lab = Lab::new();
    lab.rmem(&["lock", "door", "--owner", "r1", "--ttl", "1ms"]).success();
    lab.rmem(&["lock", "shelf", "--owner", "r1", "--ttl", "1h"]).success();
    lab.rmem(&["lock", "table", "--owner", "r1"]).success();
    std::thread::sleep(std::time::Duration::from_millis(20));
    lab.rmem(&["unlock", "shelf", "--expired"]).exits(1);
    assert_run!(lab.rmem(&["unlock", "--expired"]), @r#"
    {"_id":"door","locked":false,"was-locked-by":"r1","lock-until":{"$date":"[TIME]"}}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&["unlock", "--expired"]), @r"
    ------- stderr -------
    no lock has expired
    [exit code: 0]
    ");
    for name in ["shelf", "table"] {
        lab.rmem(&["lock", name, "--owner", "r2"]).exits(5);
    }
    lab.rmem(&["lock", "door", "--owner", "r2"]).success();
    lab.rmem(&["unlock"]).exits(2);
}

#[test]
fn a_lock_of_no_time_is_refused() {
    let lab = Lab::new();
    let refused = lock(&lab, "r1", &["--ttl", "0s"]).exits(2);
    assert!(refused.stderr.contains("a lock with --ttl 0s ends at once; expected more than 0s"), "{refused}");
}
