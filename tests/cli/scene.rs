//! scene: scenes for motion planners exported, compared, followed, checked, written back and drawn.

use std::io::{BufRead as _, BufReader};
use std::process::Stdio;
use std::process::{Child, Command};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use crate::lab::{Finished, Lab, assert_run, rmem};

const KITCHEN: [&str; 2] = ["--load", "fixtures/scenes/kitchen.json"];
const OBJECTS: &str = "robmem.worldmodel";

/// The kitchen in the memory of this lab.
fn kitchen() -> Lab {
    let lab = Lab::new();
    lab.rmem(&[&["count", OBJECTS], &KITCHEN[..]].concat()).success();
    lab
}

#[track_caller]
fn export(lab: &Lab, format: &str, file: &str) {
    lab.rmem(&["scene", "export", OBJECTS, "--frame", "map", "--format", format, "-o", file]).success();
}

/// A document of the kitchen, without what is not its pose.
fn pose(lab: &Lab, id: &str) -> String {
    let query = format!("{{_id: '{id}'}}");
    let fields = "{_id: 0, frame: 1, translation: 1, rotation: 1, attached_to: 1}";
    lab.rmem(&["query", OBJECTS, &query, "--fields", fields]).success()
}

#[test]
fn poses_are_resolved_through_the_tree_of_frames() {
    let lab = kitchen();
    let text =
        lab.rmem(&["scene", "export", OBJECTS, "{name: 'red-cup'}", "--frame", "map", "--format", "moveit"]).success();
    // The kitchen is turned by a right angle: x is y there. map <- kitchen (2, 1) <- table (0.8, 0.2) <- cup (-0.2, 0.1)
    let numbers: Vec<f64> = text.lines().nth(2).unwrap().split(' ').map(|number| number.parse().unwrap()).collect();
    for (number, expected) in numbers.iter().zip([2.0 - 0.3, 1.0 + 0.6, 0.8]) {
        assert!((number - expected).abs() < 1e-9, "{text}");
    }
}

#[test]
fn every_format_is_written_and_says_the_same_when_it_is_read() {
    let lab = kitchen();
    export(&lab, "json", "kitchen.json");
    for format in ["moveit", "moveit-msg", "mjcf", "sdf", "urdf", "openrave"] {
        export(&lab, format, "other");
        let diff = lab.rmem(&["scene", "diff", "kitchen.json", "other"]);
        assert_eq!((diff.code, diff.stdout.as_str()), (0, ""), "{format}\n{diff}");
        let diff = lab.rmem(&["scene", "diff", "other", OBJECTS, "--frame", "map"]);
        assert_eq!((diff.code, diff.stdout.as_str()), (0, ""), "{format}\n{diff}");
        // Nothing differs, and so nothing is written.
        let applied = lab.rmem(&["scene", "apply", "other", "--into", OBJECTS, "--frame", "map"]);
        assert_eq!((applied.code, applied.stdout.as_str()), (0, ""), "{format}\n{applied}");
    }
}

#[test]
fn what_a_format_cannot_say_is_left_out_with_a_warning() {
    let lab = kitchen();
    assert_run!(lab.rmem(&["scene", "export", OBJECTS, "--frame", "map", "--format", "moveit"]), @r"
    scene
    * blue-cup
    1.6999999999999997 2 0.8
    0 0 0.7071067811865476 0.7071067811865476
    1
    cylinder
    0.04 0.1
    0 0 0
    0 0 0 1
    0.1 0.2 0.9 1
    1
    handle
    0.05 0 0
    0 0 0 1
    * red-cup
    1.6999999999999997 1.6 0.8
    0 0 0.7071067811865476 0.7071067811865476
    1
    cylinder
    0.04 0.1
    0 0 0
    0 0 0 1
    0.9 0.1 0.1 1
    0
    * counter
    0.5999999999999999 1.7999999999999998 0.45
    0 0 0.7071067811865476 0.7071067811865476
    1
    box
    1.6 0.6 0.9
    0 0 0
    0 0 0 1
    0 0 0 0
    0
    * table
    1.7999999999999998 1.8 0.75
    0 0 0.7071067811865476 0.7071067811865476
    5
    box
    1.2 0.8 0.04
    0 0 -0.02
    0 0 0 1
    0.6 0.4 0.2 1
    box
    0.06 0.06 0.71
    0.5 0.3 -0.395
    0 0 0 1
    0.6 0.4 0.2 1
    box
    0.06 0.06 0.71
    -0.5 0.3 -0.395
    0 0 0 1
    0.6 0.4 0.2 1
    box
    0.06 0.06 0.71
    0.5 -0.3 -0.395
    0 0 0 1
    0.6 0.4 0.2 1
    box
    0.06 0.06 0.71
    -0.5 -0.3 -0.395
    0 0 0 1
    0.6 0.4 0.2 1
    0
    .
    ------- stderr -------
    warning: moveit has no masses, which are left out: blue-cup, red-cup
    warning: moveit has no static objects, which are left out: counter, table
    [exit code: 0]
    ");
}

#[test]
fn an_operation_is_printed_for_each_difference() {
    let lab = kitchen();
    export(&lab, "json", "before.json");
    lab.rmem(&["update", OBJECTS, "{_id: 'red-cup'}", "{$set: {'translation.0': -0.1, mass: 0.3}}"]).success();
    lab.rmem(&["update", OBJECTS, "{_id: 'blue-cup'}", "{$set: {attached_to: {link: 'gripper', touch: ['table']}}}"])
        .success();
    lab.rmem(&["delete", OBJECTS, "{_id: 'counter'}"]).success();
    let new = "{name: 'ball', frame: 'map', translation: [0, 0, 1], rotation: [0, 0, 0, 1], geometry: {type: 'sphere', radius: 0.1}}";
    lab.rmem(&["insert", OBJECTS, new]).success();
    let diff = lab.rmem(&["scene", "diff", "before.json", OBJECTS]).exits(1);
    let words: Vec<(String, String)> =
        diff.stdout.lines().map(|line| (word(line, "operation"), word(line, "name"))).collect();
    let expected =
        [("remove", "counter"), ("attach", "blue-cup"), ("reshape", "red-cup"), ("move", "red-cup"), ("add", "ball")];
    assert_eq!(words, expected.map(|(one, other)| (one.to_owned(), other.to_owned())), "{diff}");
    let message = lab.rmem(&["scene", "diff", "before.json", OBJECTS, "--format", "moveit-msg"]).exits(1);
    assert!(
        message.stdout.contains("\"is_diff\":true") && message.stdout.contains("\"id\":\"counter\",\"operation\":1"),
        "{message}"
    );
}

/// The value of a key in a line of JSON, where it is text.
fn word(line: &str, key: &str) -> String {
    let value: serde_json::Value = serde_json::from_str(line).unwrap();
    value[key].as_str().unwrap_or_default().to_owned()
}

#[test]
fn the_robot_tidies_up() {
    let lab = kitchen();
    let check = |expected: i32| lab.rmem(&["scene", "check", OBJECTS, "--frame", "map"]).exits(expected).stdout;
    assert_eq!(check(0), "");
    let plan =
        lab.rmem(&["plan", "--domain", "domains/tidyup/domain.pddl", "--template", "templates/tidyup/problem.pddl.j2"]);
    assert_eq!(
        plan.success(),
        "(pick-up red-cup table kitchen gripper)\n(put-down red-cup counter kitchen gripper)\n; cost = 2 (unit cost)\n"
    );
    export(&lab, "json", "start.json");
    // It takes the cup: the motion planner is told, and so is the memory.
    lab.write("taken", "{\"operation\": \"attach\", \"name\": \"red-cup\", \"attached_to\": {\"link\": \"gripper\", \"touch\": [\"table\"]}}\n");
    let applied = lab.rmem(&["scene", "apply", "taken", "--into", OBJECTS]).success();
    assert_eq!(word(&applied, "operation"), "attach");
    assert!(pose(&lab, "red-cup").contains("\"attached_to\":{\"link\":\"gripper\",\"touch\":[\"table\"]}"));
    // It puts the cup where the other one is, which the check finds.
    let put = |x: f64, y: f64, z: f64| {
        format!(
            "{{\"operation\": \"detach\", \"name\": \"red-cup\", \"attached_to\": {{\"link\": \"gripper\"}}}}\n\
             {{\"operation\": \"move\", \"name\": \"red-cup\", \"translation\": [{x}, {y}, {z}], \"rotation\": [0, 0, 0, 1]}}\n"
        )
    };
    lab.write("put", &put(1.7, 1.95, 0.8));
    let wrong = lab.rmem(&["scene", "apply", "put", "--into", OBJECTS]).exits(2);
    assert_run!(wrong, @r"
    ------- stderr -------
    error: put does not say in which frame its poses are; expected --frame FRAME
    [exit code: 2]
    ");
    lab.rmem(&["scene", "apply", "put", "--into", OBJECTS, "--frame", "map"]).success();
    let overlap = check(1);
    assert!(
        overlap.contains("\"first\":\"blue-cup\",\"second\":\"red-cup\"") && overlap.contains("\"depth\":0.0"),
        "{overlap}"
    );
    // On the counter nothing is in its way. The pose is written in the frame of the document.
    lab.write("put", &put(0.6, 1.8, 0.95));
    lab.rmem(&["scene", "apply", "put", "--into", OBJECTS, "--frame", "map"]).success();
    assert_eq!(check(0), "");
    let stored = pose(&lab, "red-cup");
    assert!(stored.contains("\"frame\":\"table-top\"") && !stored.contains("attached_to"), "{stored}");
    let diff = lab.rmem(&["scene", "diff", "start.json", OBJECTS]).exits(1);
    assert_eq!(diff.stdout.lines().map(|line| word(line, "operation")).collect::<Vec<_>>(), ["move"]);
    let near = lab.rmem(&["scene", "check", OBJECTS, "--frame", "map", "--distance", "0.01"]).exits(1);
    assert!(near.stdout.contains("\"second\":\"red-cup\"") || near.stdout.contains("\"first\":\"red-cup\""), "{near}");
}

#[test]
fn blocks_that_are_moved_in_the_scene_change_the_next_plan() {
    let lab = Lab::new();
    let config = ["--config", "fixtures/blocksworld-geometric.toml"];
    let with = |args: &[&str]| lab.rmem(&[args, &config[..]].concat());
    with(&["count", "robmem.blocks", "--load", "fixtures/blocksworld-geometric.json"]).success();
    let plan = || {
        let task = [
            "plan",
            "--domain",
            "domains/blocksworld/domain.pddl",
            "--template",
            "templates/blocksworld/problem.pddl.j2",
        ];
        with(&[&task[..], &["--goal", "(on D C)"]].concat()).success()
    };
    assert!(plan().contains("(unstack D A)"), "D stands on A");
    // The four keys and a geometry make scenes of documents that know nothing of scenes.
    let scene = with(&["scene", "export", "--frame", "map", "--format", "moveit", "-o", "blocks.scene"]);
    scene.exits(0);
    let scene = lab.read("blocks.scene");
    assert!(scene.contains("* D\n0.432 -0.041 0.05\n"), "{scene}");
    let environment = with(&["scene", "export", "--frame", "map", "--format", "openrave"]).success();
    assert!(environment.contains("<KinBody name=\"D\" file=\"models/block.kinbody.xml\">"), "{environment}");
    // The motion planner's user puts D on the table.
    lab.write("moved.scene", &scene.replace("0.432 -0.041 0.05", "0.7 0.3 0"));
    let applied = with(&["scene", "apply", "moved.scene", "--frame", "map"]).success();
    assert_eq!((word(&applied, "operation"), word(&applied, "name")), ("move".to_owned(), "D".to_owned()));
    // What was computed from the old poses is kept for half a second.
    std::thread::sleep(Duration::from_millis(600));
    let plan = plan();
    assert!(plan.contains("(pickup D)") && !plan.contains("(unstack D A)"), "{plan}");
}

#[test]
fn removed_objects_stay_unless_removing_is_asked_for() {
    let lab = kitchen();
    export(&lab, "moveit", "kitchen.scene");
    let text = lab.read("kitchen.scene");
    let (start, end) = (text.find("* counter").unwrap(), text.find("* table").unwrap());
    lab.write("less.scene", &format!("{}{}", &text[..start], &text[end..]));
    let apply = |more: &[&str]| {
        lab.rmem(&[&["scene", "apply", "less.scene", "--into", OBJECTS, "--frame", "map"], more].concat())
    };
    assert_run!(apply(&[]), @r"
    ------- stderr -------
    kept 1 object that the scene does not have; use --remove to delete
    [exit code: 0]
    ");
    assert_eq!(word(&apply(&["--remove", "--dry-run"]).success(), "operation"), "remove");
    assert_eq!(lab.rmem(&["count", OBJECTS, "{_id: 'counter'}"]).success(), "1\n");
    apply(&["--remove"]).success();
    assert_eq!(lab.rmem(&["count", OBJECTS, "{_id: 'counter'}"]).success(), "0\n");
    // And an object that the memory does not have becomes a document.
    lab.rmem(&["scene", "apply", "kitchen.scene", "--into", OBJECTS, "--frame", "map"]).success();
    let new =
        lab.rmem(&["query", OBJECTS, "{name: 'counter'}", "--fields", "{_id: 0, frame: 1, geometry: 1}"]).success();
    assert_eq!(new, "{\"frame\":\"map\",\"geometry\":{\"type\":\"box\",\"size\":[1.6,0.6,0.9]}}\n");
}

#[test]
fn what_is_no_object_is_an_error_with_its_id_and_nothing_is_written() {
    let lab = Lab::new();
    let mut refusals = String::new();
    for (changes, format) in [
        ("rotation: [0, 0, 0, 1.1]", "json"),
        ("translation: [NaN, 0, 0]", "json"),
        ("geometry: {type: 'box', size: [1, -1, 1]}", "json"),
        ("geometry: {type: 'blob'}", "json"),
        ("frame: 'nowhere'", "json"),
        ("frame: 7", "json"),
        ("name: 5", "json"),
        ("name: 'red cup'", "openrave"),
        ("name: 'a::b'", "sdf"),
        ("geometry: {type: 'cone', radius: 1, length: 1}", "urdf"),
        ("geometry: {type: 'mesh', file: 'missing.stl'}", "moveit"),
    ] {
        lab.rmem(&["drop", "robmem.things"]);
        lab.rmem(&["insert", "robmem.things", &object("good", "static: true"), &object("bad", changes)]).success();
        let args = ["scene", "export", "robmem.things", "--frame", "map", "--format", format, "-o", "out"];
        refusals += &format!("{changes}\n{}\n", lab.rmem(&args));
        assert!(!lab.path().join("out").exists(), "{changes}");
        let left_out = lab.rmem(&[&args[..], &["--skip-invalid"]].concat()).exits(0);
        assert!(left_out.stderr.contains("left out: the document of robmem.things with _id \"bad\""), "{left_out}");
        assert!(lab.read("out").contains("good") && !lab.read("out").contains("bad"));
        std::fs::remove_file(lab.path().join("out")).unwrap();
    }
    assert_run!(refusals, @r#"
    rotation: [0, 0, 0, 1.1]
    ------- stderr -------
    error: the document of robmem.things with _id "bad" is no object of a scene: its `rotation` [0.0, 0.0, 0.0, 1.1] has the length 1.100000; expected a unit quaternion [x, y, z, w]; correct it, or leave it out with --skip-invalid
    [exit code: 3]
    translation: [NaN, 0, 0]
    ------- stderr -------
    error: the document of robmem.things with _id "bad" is no object of a scene: its `translation` is not 3 finite numbers; correct it, or leave it out with --skip-invalid
    [exit code: 3]
    geometry: {type: 'box', size: [1, -1, 1]}
    ------- stderr -------
    error: the document of robmem.things with _id "bad" is no object of a scene: its `geometry` is a box that has the size [1, -1, 1]; expected more than 0 metres; correct it, or leave it out with --skip-invalid
    [exit code: 3]
    geometry: {type: 'blob'}
    ------- stderr -------
    error: the document of robmem.things with _id "bad" is no object of a scene: its `geometry` has the unknown type `blob`; expected one of box, sphere, cylinder, cone, plane, mesh; correct it, or leave it out with --skip-invalid
    [exit code: 3]
    frame: 'nowhere'
    ------- stderr -------
    error: the document of robmem.things with _id "bad" is no object of a scene: the frame `nowhere` is not known; robmem.frames has no documents {frame, parent, translation, rotation}; correct it, or leave it out with --skip-invalid
    [exit code: 3]
    frame: 7
    ------- stderr -------
    error: the document of robmem.things with _id "bad" is no object of a scene: its `frame` is 7; expected the name of a frame; correct it, or leave it out with --skip-invalid
    [exit code: 3]
    name: 5
    ------- stderr -------
    error: the document of robmem.things with _id "bad" is no object of a scene: its `name` is 5; expected a name as text; correct it, or leave it out with --skip-invalid
    [exit code: 3]
    name: 'red cup'
    ------- stderr -------
    error: the document of robmem.things with _id "bad" is no object of a scene: its name `red cup` has a blank, which names of openrave cannot have; give it another; correct it, or leave it out with --skip-invalid
    [exit code: 3]
    name: 'a::b'
    ------- stderr -------
    error: the document of robmem.things with _id "bad" is no object of a scene: its name `a::b` is reserved in sdf: `world`, `__…__`, and what has `::`; give it another; correct it, or leave it out with --skip-invalid
    [exit code: 3]
    geometry: {type: 'cone', radius: 1, length: 1}
    ------- stderr -------
    error: the document of robmem.things with _id "bad" is no object of a scene: urdf has no cone; it has box, sphere, cylinder, mesh; correct it, or leave it out with --skip-invalid
    [exit code: 3]
    geometry: {type: 'mesh', file: 'missing.stl'}
    ------- stderr -------
    error: the document of robmem.things with _id "bad" is no object of a scene: its mesh missing.stl cannot be read: No such file or directory (os error 2); correct it, or leave it out with --skip-invalid
    [exit code: 3]
    "#);
}

/// An object with one key as it is given.
fn object(id: &str, changed: &str) -> String {
    let (key, value) = changed.split_once(": ").unwrap();
    let keys = [
        ("name", format!("'{id}'")),
        ("frame", "'map'".to_owned()),
        ("translation", "[0, 0, 0]".to_owned()),
        ("rotation", "[0, 0, 0, 1]".to_owned()),
        ("geometry", "{type: 'sphere', radius: 1}".to_owned()),
    ];
    let others = keys.into_iter().filter(|(other, _)| *other != key).map(|(key, value)| format!("{key}: {value}"));
    format!("{{_id: '{id}', {}, {key}: {value}}}", others.collect::<Vec<_>>().join(", "))
}

#[test]
fn two_objects_of_one_name_and_frames_in_a_circle_are_errors() {
    let lab = Lab::new();
    let object = |id: i32, frame: &str| {
        format!("{{_id: {id}, name: 'a', frame: '{frame}', translation: [0, 0, 0], rotation: [0, 0, 0, 1]}}")
    };
    lab.rmem(&["insert", "robmem.things", &object(1, "map"), &object(2, "map")]).success();
    assert_run!(lab.rmem(&["scene", "export", "robmem.things", "--frame", "map"]), @r"
    ------- stderr -------
    error: the document of robmem.things with _id 2 is no object of a scene: there is another object with the name `a`; correct it, or leave it out with --skip-invalid
    [exit code: 3]
    ");
    let frame = |frame: &str, parent: &str| {
        format!("{{frame: '{frame}', parent: '{parent}', translation: [0, 0, 0], rotation: [0, 0, 0, 1]}}")
    };
    lab.rmem(&["insert", "robmem.frames", &frame("x", "y"), &frame("y", "x")]).success();
    lab.rmem(&["insert", "robmem.other", &object(3, "x")]).success();
    assert_run!(lab.rmem(&["scene", "export", "robmem.other", "--frame", "map"]), @r"
    ------- stderr -------
    error: the document of robmem.other with _id 3 is no object of a scene: the frames of robmem.frames are no tree: x → y → x; correct it, or leave it out with --skip-invalid
    [exit code: 3]
    ");
}

#[test]
fn wrong_scene_files_are_shown_at_their_place() {
    let lab = kitchen();
    lab.write("bad.xml", "<mujoco>\n  <worldbody>\n    <body name='a'><geom type='capsule' size='1 1'/></body>\n  </worldbody>\n</mujoco>\n");
    assert_run!(lab.rmem(&["scene", "apply", "bad.xml", "--into", OBJECTS, "--frame", "map"]), @r"
    ------- stderr -------
    error: bad.xml:3:32: unknown geometry `capsule`; expected box, sphere, cylinder, plane or mesh
      |
    3 |     <body name='a'><geom type='capsule' size='1 1'/></body>
      |                                ^^^^^^^
    [exit code: 3]
    ");
    export(&lab, "json", "kitchen.json");
    assert_run!(lab.rmem(&["scene", "apply", "kitchen.json", "--into", OBJECTS, "--frame", "base_link"]), @r"
    ------- stderr -------
    error: the poses of kitchen.json are in the frame `map`, not in `base_link`
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["scene", "export", OBJECTS, "--frame", "map", "--format", "csv"]), @r"
    ------- stderr -------
    error: invalid value 'csv' for '--format <FORMAT>'
      [possible values: json, moveit, moveit-msg, mjcf, sdf, urdf, openrave]

    For more information, try '--help'.
    [exit code: 2]
    ");
}

/// A `scene watch` that runs beside the test.
struct Watch {
    child: Child,
    lines: Receiver<String>,
}

impl Watch {
    #[track_caller]
    fn start(lab: &Lab, more: &[&str]) -> Self {
        let mut command = Command::new(rmem());
        command.args(["scene", "watch", OBJECTS, "--frame", "map"]).args(more);
        lab.isolate(&mut command);
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

fn update(lab: &Lab, namespace: &str, id: &str, change: &str) -> Finished {
    lab.rmem(&["update", namespace, &format!("{{_id: '{id}'}}"), change]).exits(0)
}

#[test]
fn a_frame_that_moves_moves_every_object_in_it() {
    let lab = kitchen();
    let watch = Watch::start(&lab, &[]);
    update(&lab, "robmem.frames", "table-top", "{$set: {'translation.0': 0.9}}");
    let mut moved = [watch.next(), watch.next(), watch.next()];
    moved.sort();
    let expected = ["blue-cup", "red-cup", "table"].map(|name| ("move".to_owned(), name.to_owned()));
    assert_eq!(moved, expected, "the counter is not in that frame");
    update(&lab, OBJECTS, "red-cup", "{$set: {'translation.0': -0.1}}");
    assert_eq!(watch.next(), ("move".to_owned(), "red-cup".to_owned()));
    update(&lab, OBJECTS, "red-cup", "{$set: {attached_to: {link: 'gripper'}}}");
    assert_eq!(watch.next(), ("attach".to_owned(), "red-cup".to_owned()));
    // That a drawer is open is nothing to a motion planner.
    update(&lab, OBJECTS, "counter", "{$set: {open: true}}");
    update(&lab, OBJECTS, "red-cup", "{$set: {mass: 0.3}}");
    assert_eq!(watch.next(), ("reshape".to_owned(), "red-cup".to_owned()));
    lab.rmem(&["delete", OBJECTS, "{_id: 'red-cup'}"]).success();
    assert_eq!(watch.next(), ("remove".to_owned(), "red-cup".to_owned()));
    // What is no object any more is not there any more.
    update(&lab, OBJECTS, "blue-cup", "{$set: {rotation: [0, 0, 0, 5]}}");
    assert_eq!(watch.next(), ("remove".to_owned(), "blue-cup".to_owned()));
    update(&lab, OBJECTS, "blue-cup", "{$set: {rotation: [0, 0, 0, 1]}}");
    assert_eq!(watch.next(), ("add".to_owned(), "blue-cup".to_owned()));
}

#[test]
fn after_a_kill_no_operation_is_missed() {
    let lab = kitchen();
    let mut delivered = std::collections::BTreeSet::new();
    drop(Watch::start(&lab, &["--resume", "planner"]));
    for round in 0..10_u32 {
        let x = f64::from(round) / 100.0;
        update(&lab, OBJECTS, "red-cup", &format!("{{$set: {{'translation.0': {x}, mass: {}}}}}", 1.0 + x));
        update(&lab, "robmem.frames", "base_link", &format!("{{$set: {{'translation.0': {x}}}}}"));
        lab.rmem(&[
            "insert",
            OBJECTS,
            &format!("{{name: 'ball{round}', frame: 'gripper', translation: [0, 0, 0], rotation: [0, 0, 0, 1]}}"),
        ])
        .success();
        // It is killed at some moment, in the midst of its work or before.
        let mut command = Command::new(rmem());
        command.args(["scene", "watch", OBJECTS, "--frame", "map", "--resume", "planner"]);
        lab.isolate(&mut command);
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
    let rest = lab.rmem(&["scene", "watch", OBJECTS, "--frame", "map", "--resume", "planner", "--timeout", "2s"]);
    delivered.extend(rest.stdout.lines().map(|line| (word(line, "operation"), word(line, "name"))));
    for expected in (0..10)
        .map(|round| ("add".to_owned(), format!("ball{round}")))
        .chain([("move".to_owned(), "red-cup".to_owned())])
    {
        assert!(delivered.contains(&expected), "{expected:?} in {delivered:?}");
    }
}

#[test]
fn a_scene_is_drawn_from_above() {
    let lab = Lab::new();
    crate::lab::kitchen(&lab, &["scene", "show", "robmem.worldmodel", "--frame", "map", "-o", "top.svg"]).exits(0);
    let svg = lab.read("top.svg");
    for part in [">counter<", ">blue-cup<", ">gripper<", ">static<", ">movable<", ">frames<"] {
        assert!(svg.contains(part), "no {part} in {svg}");
    }
}
