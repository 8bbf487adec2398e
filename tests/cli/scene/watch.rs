//! Operations as they happen: one for each object that a change is about, also after a kill.

use std::io::{BufRead as _, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use super::{Kitchen, OBJECTS, named, operations, word};
use crate::lab::rmem;

/// A `scene watch` that runs beside the test.
struct Watch {
    child: Child,
    lines: Receiver<String>,
}

impl Watch {
    #[track_caller]
    fn start(kitchen: &Kitchen, more: &[&str]) -> Self {
        let mut command = Command::new(rmem());
        command.args(["scene", "watch", OBJECTS, "--frame", "map"]).args(more);
        kitchen.lab.isolate(&mut command);
        let mut child = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let (sender, lines) = channel();
        let stdout = BufReader::new(child.stdout.take().unwrap());
        std::thread::spawn(move || stdout.lines().map_while(Result::ok).try_for_each(|line| sender.send(line)));
        let mut message = String::new();
        BufReader::new(child.stderr.as_mut().unwrap()).read_line(&mut message).unwrap();
        assert!(message.starts_with("following 4 objects in the frame map"), "{message}");
        Self { child, lines }
    }

    #[track_caller]
    fn next(&self) -> (String, String) {
        let line = self.lines.recv_timeout(Duration::from_secs(60)).expect("nothing was delivered");
        (word(&line, "operation"), word(&line, "name"))
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn a_frame_that_moves_moves_every_object_in_it() {
    let kitchen = Kitchen::new();
    let watch = Watch::start(&kitchen, &[]);
    kitchen.update("robmem.frames", "table-top", "{$set: {'translation.0': 0.9}}");
    let mut moved = [watch.next(), watch.next(), watch.next()];
    moved.sort();
    let expected = ["blue-cup", "red-cup", "table"].map(|name| named("move", name));
    assert_eq!(moved, expected, "the counter is not in that frame");
    kitchen.update(OBJECTS, "red-cup", "{$set: {'translation.0': -0.1}}");
    assert_eq!(watch.next(), named("move", "red-cup"));
    kitchen.update(OBJECTS, "red-cup", "{$set: {attached_to: {link: 'gripper'}}}");
    assert_eq!(watch.next(), named("attach", "red-cup"));
    // That a drawer is open is nothing to a motion planner.
    kitchen.update(OBJECTS, "counter", "{$set: {open: true}}");
    kitchen.update(OBJECTS, "red-cup", "{$set: {mass: 0.3}}");
    assert_eq!(watch.next(), named("reshape", "red-cup"));
    kitchen.rmem(&["delete", OBJECTS, "{_id: 'red-cup'}"]).success();
    assert_eq!(watch.next(), named("remove", "red-cup"));
    // What is no object any more is not there any more.
    kitchen.update(OBJECTS, "blue-cup", "{$set: {rotation: [0, 0, 0, 5]}}");
    assert_eq!(watch.next(), named("remove", "blue-cup"));
    kitchen.update(OBJECTS, "blue-cup", "{$set: {rotation: [0, 0, 0, 1]}}");
    assert_eq!(watch.next(), named("add", "blue-cup"));
}

#[test]
fn after_a_kill_no_operation_is_missed() {
    let kitchen = Kitchen::new();
    let mut delivered = std::collections::BTreeSet::new();
    drop(Watch::start(&kitchen, &["--resume", "planner"]));
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
    let rest = kitchen.rmem(&["scene", "watch", OBJECTS, "--frame", "map", "--resume", "planner", "--timeout", "2s"]);
    delivered.extend(operations(&rest.stdout));
    for expected in (0..10).map(|round| named("add", &format!("ball{round}"))).chain([named("move", "red-cup")]) {
        assert!(delivered.contains(&expected), "{expected:?} in {delivered:?}");
    }
}
