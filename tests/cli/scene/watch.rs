//! Operations as they happen: one for each object that a change is about, also after a kill.

use std::process::{Command, Stdio};
use std::time::Duration;

use super::{Kitchen, OBJECTS, named, operations, word};
use crate::lab::watch::Watch;
use crate::lab::{Finished, rmem};

/// Starts a `scene watch` and waits until it follows.
#[track_caller]
fn start(kitchen: &Kitchen, more: &[&str]) -> Watch {
    let command = [&["scene", "watch", OBJECTS, "--frame", "map"], more].concat();
    Watch::rmem(&kitchen.lab, &command, "following 4 objects in the frame map")
}

/// The next operation, and the object it is about.
#[track_caller]
fn next(watch: &Watch) -> (String, String) {
    let line = watch.line();
    (word(&line, "operation"), word(&line, "name"))
}

#[test]
fn a_frame_that_moves_moves_every_object_in_it() {
    let kitchen = Kitchen::new();
    let watch = start(&kitchen, &[]);
    kitchen.update("robmem.frames", "table-top", "{$set: {'translation.0': 0.9}}");
    let mut moved = [next(&watch), next(&watch), next(&watch)];
    moved.sort();
    let expected = ["blue-cup", "red-cup", "table"].map(|name| named("move", name));
    assert_eq!(moved, expected, "the counter is not in that frame");
    kitchen.update(OBJECTS, "red-cup", "{$set: {'translation.0': -0.1}}");
    assert_eq!(next(&watch), named("move", "red-cup"));
    kitchen.update(OBJECTS, "red-cup", "{$set: {attached_to: {link: 'gripper'}}}");
    assert_eq!(next(&watch), named("attach", "red-cup"));
    // That a drawer is open is nothing to a motion planner.
    kitchen.update(OBJECTS, "counter", "{$set: {open: true}}");
    kitchen.update(OBJECTS, "red-cup", "{$set: {mass: 0.3}}");
    assert_eq!(next(&watch), named("reshape", "red-cup"));
    kitchen.rmem(&["delete", OBJECTS, "{_id: 'red-cup'}"]).success();
    assert_eq!(next(&watch), named("remove", "red-cup"));
    // What is no object any more is not there any more.
    kitchen.update(OBJECTS, "blue-cup", "{$set: {rotation: [0, 0, 0, 5]}}");
    assert_eq!(next(&watch), named("remove", "blue-cup"));
    kitchen.update(OBJECTS, "blue-cup", "{$set: {rotation: [0, 0, 0, 1]}}");
    assert_eq!(next(&watch), named("add", "blue-cup"));
}

#[test]
fn after_a_kill_no_operation_is_missed() {
    let kitchen = Kitchen::new();
    let mut delivered = std::collections::BTreeSet::new();
    drop(start(&kitchen, &["--resume", "planner"]));
    for round in 0..10_u32 {
        let x = f64::from(round) / 100.0;
        kitchen.update(OBJECTS, "red-cup", &format!("{{$set: {{'translation.0': {x}, mass: {}}}}}", 1.0 + x));
        kitchen.update("robmem.frames", "base_link", &format!("{{$set: {{'translation.0': {x}}}}}"));
        kitchen
            .rmem(&[
                "insert",
                OBJECTS,
                &format!("{{name: 'ball{round}', frame: 'gripper', translation: [0, 0, 0], rotation: [0, 0, 0, 1]}}"),
            ])
            .success();
        // It is killed at some moment, in the midst of its work or before.
        let mut command = Command::new(rmem());
        command.args(["scene", "watch", OBJECTS, "--frame", "map", "--resume", "planner"]);
        kitchen.lab.isolate(&mut command);
        let mut child = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(u64::from(17 * round)));
        child.kill().unwrap();
        let output = child.wait_with_output().unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        // A line that was cut off in the middle is delivered again.
        delivered.extend(
            text.split_inclusive('\n')
                .filter(|line| line.ends_with('\n'))
                .map(|line| (word(line, "operation"), word(line, "name"))),
        );
    }
    let balls = (0..10).map(|round| named("add", &format!("ball{round}")));
    let expected: std::collections::BTreeSet<_> = balls.chain([named("move", "red-cup")]).collect();
    if !expected.is_subset(&delivered) {
        let mut command = Command::new(rmem());
        command.args(["scene", "watch", OBJECTS, "--frame", "map", "--resume", "planner"]);
        let watch = Watch::run(&kitchen.lab, command, "following ");
        while !expected.is_subset(&delivered) {
            delivered.insert(next(&watch));
        }
    }
}

/// Goes on with a watch for some time, or until so many operations came.
fn go_on(kitchen: &Kitchen, more: &[&str]) -> Finished {
    kitchen.rmem(&[&["scene", "watch", OBJECTS, "--frame", "map", "--resume", "planner"], more].concat())
}

/// What a watch that goes on prints, sorted, where it is so many operations and then nothing more.
#[track_caller]
fn resumed(kitchen: &Kitchen, count: usize) -> (Vec<(String, String)>, String) {
    let finished = go_on(kitchen, &["--count", &count.to_string(), "--timeout", "1m"]).exits(0);
    assert_quiet(kitchen);
    let mut operations = operations(&finished.stdout);
    operations.sort();
    (operations, finished.stderr)
}

/// A watch that goes on prints nothing.
#[track_caller]
fn assert_quiet(kitchen: &Kitchen) -> Finished {
    let finished = go_on(kitchen, &["--timeout", "1s"]).exits(1);
    assert_eq!(operations(&finished.stdout), []);
    finished
}

fn all(operation: &str, names: &[&str]) -> Vec<(String, String)> {
    names.iter().map(|name| named(operation, name)).collect()
}

#[test]
fn objects_that_went_with_a_dropped_collection_are_removed_also_after_a_pause() {
    let kitchen = Kitchen::new();
    drop(start(&kitchen, &["--resume", "planner"]));
    kitchen.rmem(&["drop", OBJECTS]).success();
    let new = "{_id: 1, name: 'vase', frame: 'map', translation: [0, 0, 0], rotation: [0, 0, 0, 1]}";
    kitchen.rmem(&["insert", OBJECTS, new]).success();
    let mut expected = all("add", &["vase"]);
    expected.extend(all("remove", &["blue-cup", "counter", "red-cup", "table"]));
    assert_eq!(resumed(&kitchen, 5).0, expected);
}

#[test]
fn objects_whose_frames_went_are_removed_and_come_back_with_them() {
    let kitchen = Kitchen::new();
    let frames = kitchen.rmem(&["query", "robmem.frames"]).success();
    kitchen.lab.write("frames.jsonl", &frames);
    let back = || drop(kitchen.rmem(&["insert", "robmem.frames", "--file", "frames.jsonl"]).success());
    let names = ["blue-cup", "counter", "red-cup", "table"];
    drop(start(&kitchen, &["--resume", "planner"]));
    for gone in [&["drop", "robmem.frames"][..], &["delete", "robmem.frames", "--all"]] {
        kitchen.rmem(gone).success();
        let (operations, messages) = resumed(&kitchen, 4);
        assert_eq!(operations, all("remove", &names));
        assert_eq!(
            messages.matches("warning: left out: the document of robmem.worldmodel with _id").count(),
            4,
            "{messages}"
        );
        back();
        assert_eq!(resumed(&kitchen, 4).0, all("add", &names));
    }
    let watch = start(&kitchen, &[]);
    kitchen.rmem(&["drop", "robmem.frames"]).success();
    let mut removed: Vec<_> = names.iter().map(|_| next(&watch)).collect();
    removed.sort();
    assert_eq!(removed, all("remove", &names));
    back();
    let mut added: Vec<_> = names.iter().map(|_| next(&watch)).collect();
    added.sort();
    assert_eq!(added, all("add", &names));
}

#[test]
fn of_two_objects_with_one_name_the_other_is_left_out_until_the_first_is_gone() {
    let kitchen = Kitchen::new();
    drop(start(&kitchen, &["--resume", "planner"]));
    let twin = "{_id: 7, name: 'red-cup', frame: 'map', translation: [0, 0, 0], rotation: [0, 0, 0, 1]}";
    kitchen.rmem(&["insert", OBJECTS, twin]).success();
    let messages = assert_quiet(&kitchen).stderr;
    let reason = "with _id 7 is not an object of a scene: there is another object with the name `red-cup`";
    assert!(messages.contains(reason), "{messages}");
    kitchen.rmem(&["delete", OBJECTS, "{_id: 'red-cup'}"]).success();
    let mut expected = all("add", &["red-cup"]);
    expected.extend(all("remove", &["red-cup"]));
    assert_eq!(resumed(&kitchen, 2).0, expected);
}

#[test]
fn a_forgotten_watch_begins_anew() {
    let kitchen = Kitchen::new();
    drop(start(&kitchen, &["--resume", "planner"]));
    kitchen.rmem(&["watch", OBJECTS, "--resume", "planner", "--forget"]).success();
    kitchen.rmem(&["delete", OBJECTS, "{_id: 'red-cup'}"]).success();
    assert_quiet(&kitchen);
}

#[test]
fn no_more_operations_are_printed_than_were_asked_for() {
    let kitchen = Kitchen::new();
    let watch = start(&kitchen, &["--count", "2"]);
    // Three objects are in this frame.
    kitchen.update("robmem.frames", "table-top", "{$set: {'translation.0': 0.9}}");
    let (code, operations) = watch.end();
    assert_eq!((code, operations.len()), (0, 2), "{operations:?}");
}

#[test]
fn a_watch_of_a_named_position_prints_the_last_change_whole() {
    let kitchen = Kitchen::new();
    let watch = start(&kitchen, &["--count", "2", "--resume", "planner"]);
    kitchen.update("robmem.frames", "table-top", "{$set: {'translation.0': 0.9}}");
    let (code, operations) = watch.end();
    assert_eq!((code, operations.len()), (0, 3), "{operations:?}");
}

#[test]
fn a_watch_ends_when_nobody_reads_what_it_prints() {
    let kitchen = Kitchen::new();
    let line = format!("timeout 50 rmem scene watch {OBJECTS} --frame map | true");
    assert_eq!(kitchen.lab.shell(&line).code, 0);
}
