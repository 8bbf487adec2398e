//! What is no scene: named by the document or the place, and nothing is half-written.

use super::{Kitchen, OBJECTS};
use crate::lab::{Lab, assert_run, settings};

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
fn what_is_no_object_is_an_error_with_its_id_and_nothing_is_written() {
    let (lab, mut refusals) = (Lab::new(), String::new());
    for (changes, format) in [
        ("rotation: [0, 0, 0, 1.1]", "json"),
        ("rotation: [0, 0, 0, 0]", "json"),
        ("rotation: [0, 0, 0, Infinity]", "json"),
        ("translation: [NaN, 0, 0]", "json"),
        ("geometry: {type: 'box', size: [1, -1, 1]}", "json"),
        ("geometry: {type: 'sphere', radius: 0}", "json"),
        ("geometry: {type: 'cylinder', radius: 1, length: NaN}", "json"),
        ("geometry: {type: 'blob'}", "json"),
        ("geometry: [{type: 'sphere', radius: 1}, {type: 'box', size: [1, 1]}]", "json"),
        ("mass: -1", "json"),
        ("color: [2, 0, 0]", "json"),
        ("frame: 'nowhere'", "json"),
        ("frame: 7", "json"),
        ("name: 5", "json"),
        ("name: ''", "json"),
        ("name: 'red cup'", "openrave"),
        ("name: 'a::b'", "sdf"),
        ("name: 'map'", "sdf"),
        ("name: 'map'", "urdf"),
        ("name: 'world'", "mjcf"),
        ("name: ' cup'", "moveit"),
        ("name: ''", "moveit-msg"),
        ("name: 'a\\u0007'", "mjcf"),
        ("geometry: {type: 'cone', radius: 1, length: 1}", "urdf"),
        ("geometry: {type: 'plane', normal: [0, 0, 1], offset: 0}", "openrave"),
        ("geometry: {type: 'mesh', file: 'missing.stl'}", "moveit"),
    ] {
        lab.rmem(&["drop", "robmem.things"]);
        lab.rmem(&["insert", "robmem.things", &object("good", "static: true"), &object("bad", changes)]).success();
        let args = ["scene", "export", "robmem.things", "--frame", "map", "--format", format, "-o", "out"];
        refusals += &format!("{format}, {changes}\n{}\n", lab.rmem(&args));
        assert!(!lab.path().join("out").exists(), "{changes}");
        let left_out = lab.rmem(&[&args[..], &["--skip-invalid"]].concat()).exits(0);
        assert!(left_out.stderr.contains("left out: the document of robmem.things with _id \"bad\""), "{left_out}");
        assert!(lab.read("out").contains("good") && !lab.read("out").contains("bad"));
        std::fs::remove_file(lab.path().join("out")).unwrap();
    }
    settings().bind(|| insta::assert_snapshot!("refused_objects", refusals));
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
    error: the document of robmem.things with _id 2 is not an object of a scene: there is another object with the name `a`; correct it, or leave it out with --skip-invalid
    [exit code: 3]
    ");
    let frame = |frame: &str, parent: &str| {
        format!("{{frame: '{frame}', parent: '{parent}', translation: [0, 0, 0], rotation: [0, 0, 0, 1]}}")
    };
    lab.rmem(&["insert", "robmem.frames", &frame("x", "y"), &frame("y", "x")]).success();
    lab.rmem(&["insert", "robmem.other", &object(3, "x")]).success();
    assert_run!(lab.rmem(&["scene", "export", "robmem.other", "--frame", "map"]), @r"
    ------- stderr -------
    error: the frames of robmem.frames are not a tree: x → y → x; the parents of a frame have to end at one without a parent
    [exit code: 3]
    ");
    lab.rmem(&["insert", "robmem.more", &object(4, "map")]).success();
    assert_run!(lab.rmem(&["scene", "export", "robmem.more", "--frame", "x"]), @r"
    ------- stderr -------
    error: the frames of robmem.frames are not a tree: x → y → x; the parents of a frame have to end at one without a parent
    [exit code: 3]
    ");
    let skipped =
        lab.rmem(&["scene", "export", "robmem.other", "--frame", "map", "--skip-invalid", "--format", "json"]);
    assert_run!(skipped, @r#"
    {
      "frame": "map",
      "objects": []
    }
    ------- stderr -------
    warning: left out: the document of robmem.other with _id 3 is not an object of a scene: the frames of robmem.frames are not a tree: x → y → x
    [exit code: 0]
    "#);
}

#[test]
fn frames_that_a_format_cannot_name_are_refused_before_anything_is_written() {
    let kitchen = Kitchen::new();
    for (frame, format, words) in [
        ("a::b", "sdf", "reserved in sdf"),
        ("a\u{7}", "urdf", "which XML cannot express"),
        ("", "json", "a value is required"),
    ] {
        let known = format!("{{frame: {frame:?}, parent: 'map', translation: [0, 0, 1], rotation: [0, 0, 0, 1]}}");
        kitchen.rmem(&["insert", "robmem.frames", &known.replace("\\u{7}", "\\u0007")]).success();
        let args = ["scene", "export", OBJECTS, "--frame", frame, "--format", format, "--skip-invalid", "-o", "out"];
        let refused = kitchen.rmem(&args).exits(2);
        assert!(refused.stderr.contains(words), "{frame}\n{refused}");
        assert!(!kitchen.lab.path().join("out").exists());
    }
    let refused = kitchen.rmem(&["scene", "export", OBJECTS, "--frame", "map", "--name", "a\u{7}"]).exits(2);
    assert!(refused.stderr.contains("the character \\u{7} cannot be in a name of a scene"), "{refused}");
}

#[test]
fn frames_that_are_not_turned_by_a_unit_quaternion_are_refused() {
    let kitchen = Kitchen::new();
    kitchen.update("robmem.frames", "gripper", "{$set: {rotation: [0, 0, 0, 2]}}");
    assert_run!(kitchen.rmem(&["scene", "export", OBJECTS, "--frame", "map"]), @r#"
    ------- stderr -------
    error: the frame `gripper` of robmem.frames (_id "gripper") has no pose: its `rotation` [0.0, 0.0, 0.0, 2.0] has the length 2.000000; expected a unit quaternion [x, y, z, w]
    [exit code: 3]
    "#);
}

#[test]
fn a_collection_whose_name_ends_like_a_file_is_compared_where_there_is_no_such_file() {
    let kitchen = Kitchen::new();
    let cup = "{name: 'cup', frame: 'map', translation: [0, 0, 1], rotation: [0, 0, 0, 1], geometry: {type: 'sphere', radius: 1}}";
    kitchen.rmem(&["insert", "robmem.scene", cup]).success();
    kitchen.rmem(&["scene", "export", "robmem.scene", "--frame", "map", "--format", "json", "-o", "s.json"]).success();
    let same = kitchen.rmem(&["scene", "diff", "s.json", "robmem.scene", "--frame", "map"]).exits(0);
    assert!(same.stderr.contains("there is no file robmem.scene; it is taken for a collection"), "{same}");
    // A file of that name is the file.
    kitchen.lab.write("robmem.scene", "nothing");
    let file = kitchen.rmem(&["scene", "diff", "s.json", "robmem.scene", "--frame", "map"]).exits(3);
    assert!(file.stderr.contains("robmem.scene:1:1"), "{file}");
    let typo = kitchen.rmem(&["scene", "diff", "s.json", "earlier.scene", "--frame", "map"]).exits(3);
    assert!(typo.stderr.contains("cannot read earlier.scene"), "{typo}");
    kitchen.rmem(&["insert", "robmem.half", "{name: 'cup', frame: 'map', translation: [0, 0, 1]}"]).success();
    let half = kitchen.rmem(&["scene", "export", "robmem.half", "--frame", "map"]).exits(3);
    assert!(half.stderr.contains("has no `rotation`; expected 4 finite numbers"), "{half}");
}

#[test]
fn a_file_that_looks_like_no_scene_is_not_taken_for_one() {
    let lab = Lab::new();
    lab.write("world.yaml", "objects:\n  - name: cup\n");
    assert_run!(lab.rmem(&["scene", "diff", "world.yaml", "world.yaml"]), @r"
    ------- stderr -------
    error: world.yaml:1:1: this looks like no format of scenes (in MoveIt's, the second line is `* NAME` or `.`); name its format with --from: json, moveit, moveit-msg, mjcf, sdf, urdf, openrave
      |
    1 | objects:
      | ^^^^^^^^
    [exit code: 3]
    ");
    lab.write("empty", "");
    assert_run!(lab.rmem(&["scene", "diff", "empty", "empty"]), @r"
    ------- stderr -------
    error: empty:1:1: expected a scene, found nothing
    [exit code: 3]
    ");
}

#[test]
fn wrong_scene_files_are_shown_at_their_place_and_change_nothing() {
    let kitchen = Kitchen::new();
    let before = kitchen.rmem(&["query", OBJECTS, "{}", "--meta"]).success();
    let cup = "<body name='red-cup' pos='9 9 9'><geom size='1'/></body>";
    for (text, words) in [
        (
            format!(
                "<mujoco>\n  <worldbody>{cup}\n    <body name='a'><geom type='capsule' size='1 1'/></body>\n  </worldbody>\n</mujoco>"
            ),
            "bad:3:32: unknown geometry `capsule`; expected box",
        ),
        (
            format!(
                "<mujoco><worldbody>{cup}<body name='a' quat='1 1 0 0'><geom size='1'/></body></worldbody></mujoco>"
            ),
            "a quaternion of length 1.414214 in <body>; expected a unit quaternion",
        ),
        (format!("<mujoco><worldbody>{cup}<body name='a' pos='nan 0 0'/></worldbody></mujoco>"), "`pos` has `nan`"),
        (
            format!("<mujoco><worldbody>{cup}<body name='a'><geom size='-1'/></body></worldbody></mujoco>"),
            "the radius -1",
        ),
        (
            format!("<mujoco><worldbody>{cup}<body name='a'><geom size='1' mass='-1'/></body></worldbody></mujoco>"),
            "a mass of -1",
        ),
        (
            format!(
                "<mujoco><worldbody>{cup}<body name='a'><geom size='1' rgba='2 0 0 1'/></body></worldbody></mujoco>"
            ),
            "a colour",
        ),
        (format!("<mujoco><worldbody>{cup}<frame/></worldbody></mujoco>"), "unknown element <frame> in <worldbody>"),
        (
            format!("<mujoco><worldbody>{cup}{cup}</worldbody></mujoco>"),
            "bad: there are two objects with the name `red-cup`",
        ),
        (
            "<Environment>\n  <unit>mm 0.001</unit>\n</Environment>".to_owned(),
            "bad:2:3: lengths in `mm 0.001`; expected metres",
        ),
        ("demo\n* red-cup\n9 9 9\n0 0 0 1\n1\npyramid\n".to_owned(), "bad:6:1: unknown shape `pyramid`"),
        ("{\"objects\": [{\"name\": \"red-cup\", \"units\": \"mm\"}]}".to_owned(), "unknown key `units`"),
    ] {
        kitchen.lab.write("bad", &text);
        let refused = kitchen.apply("bad", &["--remove"]).exits(3);
        assert!(refused.stderr.contains(words), "{text}\n{refused}");
        assert!(refused.stderr.contains("bad:"), "{refused}");
        assert_eq!(kitchen.rmem(&["query", OBJECTS, "{}", "--meta"]).success(), before, "{text}");
    }
}

#[test]
fn poses_in_another_frame_and_other_formats_are_refused() {
    let kitchen = Kitchen::new();
    kitchen.export("json", "kitchen.json");
    let args = ["scene", "apply", "kitchen.json", "--into", OBJECTS, "--frame", "base_link"];
    assert_run!(kitchen.rmem(&args), @r"
    ------- stderr -------
    error: the poses of kitchen.json are in the frame `map`, not in `base_link`
    [exit code: 3]
    ");
    kitchen.rmem(&["scene", "export", OBJECTS, "--frame", "map", "--format", "csv"]).exits(2);
}

#[test]
fn a_frame_that_there_is_not_is_named_and_not_the_documents() {
    let lab = Lab::new();
    lab.rmem(&["insert", "robmem.things", &object("cup", "static: true")]).success();
    lab.rmem(&[
        "insert",
        "robmem.frames",
        "{frame: 'table', parent: 'map', translation: [0, 0, 1], rotation: [0, 0, 0, 1]}",
    ])
    .success();
    for command in ["export", "check"] {
        let refused = lab.rmem(&["scene", command, "robmem.things", "--frame", "robot", "--skip-invalid"]).exits(3);
        assert_eq!(refused.stderr, "error: --frame robot: no such frame; robmem.frames has map, table\n");
    }
    lab.rmem(&["scene", "export", "robmem.things", "--frame", "table"]).success();
}

#[test]
fn a_length_that_is_none_is_refused_with_a_sentence() {
    let lab = Lab::new();
    for (number, command) in
        [("-1", ["check", "--distance"]), ("x", ["check", "--distance"]), ("-0.5", ["diff", "--tolerance"])]
    {
        let run = lab.rmem(&["scene", command[0], "a.b", "a.c", "--frame", "map", command[1], number]).exits(2);
        let wanted = "': expected a number that is not negative, like 0.01\n";
        assert!(run.stderr.starts_with(&format!("error: invalid value '{number}' for '{}", command[1])), "{run}");
        assert!(run.stderr.contains(wanted), "{run}");
    }
}
