//! What is exported, and what is different when it is read back.

use super::{Kitchen, OBJECTS, named, operations};
use crate::lab::assert_run;

/// All formats but rmem's own.
const OTHERS: [&str; 6] = ["moveit", "moveit-msg", "mjcf", "sdf", "urdf", "openrave"];

#[test]
fn poses_are_resolved_through_the_tree_of_frames() {
    let kitchen = Kitchen::new();
    let args = ["scene", "export", OBJECTS, "{name: 'red-cup'}", "--frame", "map", "--format", "moveit"];
    let text = kitchen.rmem(&args).success();
    // The kitchen is turned by a right angle: x is y there. map <- kitchen (2, 1) <- table (0.8, 0.2) <- cup (-0.2, 0.1)
    let numbers: Vec<f64> = text.lines().nth(2).unwrap().split(' ').map(|number| number.parse().unwrap()).collect();
    for (number, expected) in numbers.iter().zip([2.0 - 0.3, 1.0 + 0.6, 0.8]) {
        assert!((number - expected).abs() < 1e-9, "{text}");
    }
}

#[test]
fn every_format_is_written_and_says_the_same_when_it_is_read() {
    let kitchen = Kitchen::new();
    kitchen.export("json", "kitchen.json");
    for format in OTHERS {
        kitchen.export(format, "other");
        for sides in [["kitchen.json", "other"], ["other", OBJECTS]] {
            let diff = kitchen.rmem(&["scene", "diff", sides[0], sides[1], "--frame", "map"]);
            assert_eq!((diff.code, diff.stdout.as_str()), (0, ""), "{format}\n{diff}");
        }
        // Nothing differs, and so nothing is written.
        let applied = kitchen.apply("other", &[]);
        assert_eq!((applied.code, applied.stdout.as_str()), (0, ""), "{format}\n{applied}");
    }
}

#[test]
fn a_change_in_any_format_is_written_back_in_the_documents_own_frame() {
    for format in OTHERS {
        let kitchen = Kitchen::new();
        kitchen.update(OBJECTS, "red-cup", "{$set: {'translation.2': 0.15}}");
        kitchen.export(format, "higher");
        kitchen.update(OBJECTS, "red-cup", "{$set: {'translation.2': 0.05}}");
        let applied = kitchen.apply("higher", &[]).success();
        assert_eq!(operations(&applied), [named("move", "red-cup")], "{format}");
        let height = kitchen.rmem(&["query", OBJECTS, "{_id: 'red-cup'}", "--fields", "{_id: 0, translation: 1}"]);
        let height: serde_json::Value = serde_json::from_str(&height.success()).unwrap();
        let height = height["translation"][2].as_f64().unwrap();
        assert!((height - 0.15).abs() < 1e-9, "{format}: {height}");
    }
}

#[test]
fn what_a_format_cannot_say_is_left_out_with_a_warning() {
    let kitchen = Kitchen::new();
    assert_run!(kitchen.rmem(&["scene", "export", OBJECTS, "--frame", "map", "--format", "moveit"]), @r"
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
    warning: moveit has no masses; written without them: blue-cup, red-cup
    warning: moveit has no `static` flags; written without them: counter, table
    [exit code: 0]
    ");
}

#[test]
fn an_operation_is_printed_for_each_difference() {
    let kitchen = Kitchen::new();
    kitchen.export("json", "before.json");
    kitchen.update(OBJECTS, "red-cup", "{$set: {'translation.0': -0.1, mass: 0.3}}");
    kitchen.update(OBJECTS, "blue-cup", "{$set: {attached_to: {link: 'gripper', touch: ['table']}}}");
    kitchen.rmem(&["delete", OBJECTS, "{_id: 'counter'}"]).success();
    let new = "{name: 'ball', frame: 'map', translation: [0, 0, 1], rotation: [0, 0, 0, 1], geometry: {type: 'sphere', radius: 0.1}}";
    kitchen.rmem(&["insert", OBJECTS, new]).success();
    let diff = kitchen.rmem(&["scene", "diff", "before.json", OBJECTS]).exits(1);
    let expected =
        [("remove", "counter"), ("attach", "blue-cup"), ("reshape", "red-cup"), ("move", "red-cup"), ("add", "ball")];
    assert_eq!(operations(&diff.stdout), expected.map(|(word, name)| named(word, name)), "{diff}");
    let array = kitchen.rmem(&["scene", "diff", "before.json", OBJECTS, "--format", "json"]).exits(1);
    let array: Vec<serde_json::Value> = serde_json::from_str(&array.stdout).unwrap();
    let lines: Vec<serde_json::Value> = diff.stdout.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(array, lines);
    // Both are read, with and without a mark of the byte order in front.
    for text in [diff.stdout.clone(), serde_json::to_string(&array).unwrap(), format!("\u{feff}{}", diff.stdout)] {
        let read =
            kitchen.lab.rmem_with(&["scene", "apply", "-", "--into", OBJECTS, "--frame", "map", "--dry-run"], &text);
        assert!(read.code == 0, "{text}: {read}");
    }
    let applied = kitchen.rmem(&["scene", "apply", "before.json", "--into", OBJECTS, "--dry-run", "--format", "json"]);
    let applied: serde_json::Value = serde_json::from_str(&applied.success()).unwrap();
    assert!(applied.as_array().is_some_and(|changes| changes.len() > 1), "{applied}");
    let message = kitchen.rmem(&["scene", "diff", "before.json", OBJECTS, "--format", "moveit-msg"]).exits(1);
    assert!(
        message.stdout.contains("\"is_diff\":true") && message.stdout.contains("\"id\":\"counter\",\"operation\":1"),
        "{message}"
    );
}

#[test]
fn removed_objects_stay_unless_removing_is_asked_for() {
    let kitchen = Kitchen::new();
    let count = || kitchen.rmem(&["count", OBJECTS, "{name: 'counter'}"]).success();
    kitchen.export("moveit", "kitchen.scene");
    let text = kitchen.lab.read("kitchen.scene");
    let (start, end) = (text.find("* counter").unwrap(), text.find("* table").unwrap());
    kitchen.lab.write("less.scene", &format!("{}{}", &text[..start], &text[end..]));
    assert_run!(kitchen.apply("less.scene", &[]), @r"
    ------- stderr -------
    kept 1 object that the scene does not have; use --remove to delete
    [exit code: 0]
    ");
    let tried = kitchen.apply("less.scene", &["--remove", "--dry-run"]).success();
    assert_eq!((operations(&tried), count()), (vec![named("remove", "counter")], "1\n".to_owned()));
    kitchen.apply("less.scene", &["--remove"]).success();
    assert_eq!(count(), "0\n");
    // And an object that the memory does not have becomes a document.
    kitchen.apply("kitchen.scene", &[]).success();
    let new = kitchen.rmem(&["query", OBJECTS, "{name: 'counter'}", "--fields", "{_id: 0, frame: 1, geometry: 1}"]);
    assert_eq!(new.success(), "{\"frame\":\"map\",\"geometry\":{\"type\":\"box\",\"size\":[1.6,0.6,0.9]}}\n");
}

#[test]
fn operations_that_change_nothing_are_applied() {
    let kitchen = Kitchen::new();
    kitchen.export("json", "scene.json");
    let before = kitchen.rmem(&["query", OBJECTS, "{}", "--meta"]).success();
    for format in [&[][..], &["--format", "json"]] {
        let diff = kitchen.rmem(&[&["scene", "diff", "scene.json", OBJECTS][..], format].concat()).success();
        for from in [&[][..], &["--from", "json"]] {
            let apply = [&["scene", "apply", "-", "--into", OBJECTS, "--remove"][..], from].concat();
            assert_eq!(kitchen.lab.rmem_with(&apply, &diff).success(), "");
        }
    }
    assert_eq!(kitchen.rmem(&["query", OBJECTS, "{}", "--meta"]).success(), before);
    kitchen.lab.write("empty", "\n");
    assert_run!(kitchen.rmem(&["scene", "diff", "empty", "scene.json"]), @r"
    ------- stderr -------
    error: empty:1:1: expected a scene, found nothing
    [exit code: 3]
    ");
}

#[test]
fn what_is_no_object_among_operations_is_shown_at_its_place() {
    let kitchen = Kitchen::new();
    for text in ["[{\"operation\": \"remove\", \"name\": \"a\"}, [1]]", "{\"frame\": \"map\", \"objects\": [[1]]}"] {
        let refused = kitchen.lab.rmem_with(&["scene", "apply", "-", "--into", OBJECTS], text).exits(3);
        assert!(refused.stderr.contains("expected an object, found an array"), "{refused}");
    }
}

#[test]
fn a_watch_refuses_a_frame_that_is_not_there_as_an_export_does() {
    let kitchen = Kitchen::new();
    let watch = ["scene", "watch", OBJECTS, "--frame", "nowhere", "--timeout", "1ms"];
    let refused = kitchen.rmem(&watch).exits(3);
    assert!(refused.stderr.contains("leave it out with --skip-invalid"), "{refused}");
    kitchen.rmem(&[&watch[..], &["--skip-invalid"]].concat()).exits(1);
}

#[test]
fn an_environment_of_openrave_is_read_without_its_robots() {
    let kitchen = Kitchen::new();
    kitchen.lab.write(
        "lab.env.xml",
        "<Environment>\n  <physicsengine type=\"ode\"/>\n  <Robot name=\"arm\" file=\"robots/arm.robot.xml\"/>\n  \
         <Robot file=\"robots/base.robot.xml\"/>\n  <KinBody name=\"bin\">\n    <Body>\n      <Geom type=\"box\">\n        \
         <Extents>0.1 0.2 0.3</Extents>\n      </Geom>\n    </Body>\n    <mass type=\"box\"><total>2</total></mass>\n  </KinBody>\n  \
         <KinBody file=\"data/mug.kinbody.xml\"><Translation>1 0 0</Translation></KinBody>\n</Environment>\n",
    );
    let apply = ["scene", "apply", "lab.env.xml", "--into", "robmem.bins", "--frame", "map"];
    let applied = kitchen.rmem(&apply);
    assert!(applied.code == 0 && applied.stdout.lines().count() == 2, "{applied}");
    for part in ["\"name\":\"bin\"", "\"mass\":2.0", "\"name\":\"mug\"", "\"model\":\"data/mug.kinbody.xml\""] {
        assert!(applied.stdout.contains(part), "no {part} in {applied}");
    }
    let warning = "warning: lab.env.xml: left out: `arm`, `robots/base.robot.xml`; a robot is no object of a scene\n";
    assert!(applied.stderr.contains(warning), "{applied}");
}
