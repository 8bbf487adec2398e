//! scene: scenes for motion planners exported, compared, followed, checked, written back and drawn.

mod foreign;
mod formats;
mod refused;
mod watch;
mod worlds;

use crate::lab::{Finished, Lab};

const OBJECTS: &str = "robmem.worldmodel";

/// The kitchen of the fixtures in a memory of its own. Frames are those of `robmem.frames`; the scene is in `map`.
struct Kitchen {
    lab: Lab,
}

impl Kitchen {
    #[track_caller]
    fn new() -> Self {
        let lab = Lab::new();
        lab.rmem(&["count", OBJECTS, "--load", "fixtures/scenes/kitchen.json"]).success();
        Self { lab }
    }

    fn rmem(&self, args: &[&str]) -> Finished {
        self.lab.rmem(args)
    }

    #[track_caller]
    fn export(&self, format: &str, file: &str) {
        self.rmem(&["scene", "export", OBJECTS, "--frame", "map", "--format", format, "-o", file]).success();
    }

    /// What `scene apply` of a file does.
    fn apply(&self, file: &str, more: &[&str]) -> Finished {
        self.rmem(&[&["scene", "apply", file, "--into", OBJECTS, "--frame", "map"], more].concat())
    }

    /// What `scene check` finds.
    #[track_caller]
    fn check(&self, expected: i32) -> String {
        self.rmem(&["scene", "check", OBJECTS, "--frame", "map"]).exits(expected).stdout
    }

    #[track_caller]
    fn update(&self, namespace: &str, id: &str, change: &str) {
        self.rmem(&["update", namespace, &format!("{{_id: '{id}'}}"), change]).success();
    }

    /// A document without what is not its pose.
    fn pose(&self, id: &str) -> String {
        let fields = "{_id: 0, frame: 1, translation: 1, rotation: 1, attached_to: 1}";
        self.rmem(&["query", OBJECTS, &format!("{{_id: '{id}'}}"), "--fields", fields]).success()
    }
}

/// The value of a key in a line of JSON, where it is text.
fn word(line: &str, key: &str) -> String {
    let value: serde_json::Value = serde_json::from_str(line).unwrap();
    value[key].as_str().unwrap_or_default().to_owned()
}

/// Operation and name of each line.
fn operations(lines: &str) -> Vec<(String, String)> {
    lines.lines().map(|line| (word(line, "operation"), word(line, "name"))).collect()
}

fn named(operation: &str, name: &str) -> (String, String) {
    (operation.to_owned(), name.to_owned())
}

#[test]
fn a_scene_is_drawn_from_above() {
    let kitchen = Kitchen::new();
    kitchen.rmem(&["scene", "show", OBJECTS, "--frame", "map", "-o", "top.svg"]).success();
    let svg = kitchen.lab.read("top.svg");
    for part in [">counter<", ">blue-cup<", ">gripper<", ">static<", ">movable<", ">frames<"] {
        assert!(svg.contains(part), "no {part} in {svg}");
    }
}
