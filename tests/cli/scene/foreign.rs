//! Files of other programs: what is read of them, what is passed over, and what is refused with its place.

use crate::lab::{Finished, Lab};

/// What `scene apply` of a file would do, in an empty memory.
#[track_caller]
fn applied(lab: &Lab, file: &str, text: &str) -> Finished {
    lab.write(file, text);
    lab.rmem(&["scene", "apply", file, "--into", "robmem.things", "--frame", "world", "--dry-run"])
}

/// The documents that a file makes, a line each.
#[track_caller]
fn documents(file: &str, text: &str) -> String {
    let lab = Lab::new();
    lab.write(file, text);
    lab.rmem(&["scene", "apply", file, "--into", "robmem.things", "--frame", "world"]).success();
    lab.rmem(&["query", "robmem.things", "{}", "--fields", "{_id: 0}", "--sort", "{name: 1}"]).success()
}

/// The error that a file is refused with. Nothing is written.
#[track_caller]
fn refused(file: &str, text: &str) -> String {
    let lab = Lab::new();
    let refused = applied(&lab, file, text).exits(3);
    assert_eq!(refused.stdout, "");
    refused.stderr
}

/// An SDF model with this in its link.
fn sdf(link: &str) -> String {
    format!("<sdf version='1.6'><model name='a'><link name='l'>{link}</link></model></sdf>")
}

#[test]
fn a_visual_plane_of_sdf_is_a_thin_box_and_one_of_collisions_is_endless() {
    let plane =
        "<pose>1 0 0.5 0 0 0</pose><geometry><plane><normal>0 0 1</normal><size>0.2 0.1</size></plane></geometry>";
    let visual = format!("<visual name='v'>{plane}</visual>");
    let sheet = documents("a.sdf", &sdf(&visual));
    let expected = r#""geometry":{"type":"box","size":[0.2,0.1,0.001],"translation":[1.0,0.0,0.4995]}"#;
    assert!(sheet.contains(expected), "{sheet}");
    let endless = documents("a.sdf", &sdf(&format!("<collision name='c'>{plane}</collision>{visual}")));
    let expected = r#""geometry":{"type":"plane","normal":[0.0,0.0,1.0],"offset":0.5},"static":true"#;
    assert!(endless.contains(expected), "{endless}");
    // It is turned with its normal, and overlaps only what it reaches.
    let lab = Lab::new();
    let wall = visual.replace("0 0 1<", "1 0 0<");
    let ball = |x: f64, y: f64| {
        format!(
            "<model name='ball'><link name='l'><pose>{x} {y} 0.5 0 0 0</pose><collision name='c'><geometry>\
             <sphere><radius>0.1</radius></sphere></geometry></collision></link></model>"
        )
    };
    for (x, y, code) in [(0.95, 0.0, 1), (0.85, 0.0, 0), (0.95, 0.5, 0), (1.05, 0.0, 1), (-3.0, 0.0, 0)] {
        lab.rmem(&["drop", "robmem.things"]);
        lab.write("w.sdf", &sdf(&wall).replace("</sdf>", &format!("{}</sdf>", ball(x, y))));
        lab.rmem(&["scene", "apply", "w.sdf", "--into", "robmem.things", "--frame", "world"]).success();
        lab.rmem(&["scene", "check", "robmem.things", "--frame", "world"]).exits(code);
    }
    for (wrong, words) in [
        (visual.replace("0.2 0.1", "0 0.1"), "a.sdf:1:104: a plane that has the size [0, 0.1, 0.001]"),
        (visual.replace("0 0 1<", "0 0 0<"), "a plane that has the normal [0.0, 0.0, 0.0]"),
        (visual.replace("<size>0.2 0.1</size>", ""), "a.sdf:1:104: <plane> has no <size>"),
    ] {
        let error = refused("a.sdf", &sdf(&wrong));
        assert!(error.contains(words), "{error}");
    }
}

#[test]
fn files_that_openrave_would_include_are_refused_by_name() {
    let body = "<Body type='static'><Geom type='box'><extents>1 1 1</extents></Geom></Body>";
    let error = refused(
        "a.env.xml",
        &format!("<Environment file='data/other.env.xml'>\n<KinBody name='a'>{body}</KinBody>\n</Environment>"),
    );
    insta::assert_snapshot!(error, @r"
    error: a.env.xml:1:20: <Environment> includes the file `data/other.env.xml`, which is not read
      |
    1 | <Environment file='data/other.env.xml'>
      |                    ^^^^^^^^^^^^^^^^^^
      = hint: write what it has here in its place; only a <KinBody> may name a file, as its model
    ");
    for (text, words) in [
        (
            format!("<KinBody name='a'>{}</KinBody>", body.replace("<Body", "<Body file='b.xml'")),
            "a.xml:1:31: <Body> includes the file `b.xml`",
        ),
        (
            format!("<KinBody name='a'>{}</KinBody>", body.replace("<Geom", "<Geom file='b.xml'")),
            "<Geom> includes the file `b.xml`",
        ),
        (format!("<KinBody name='a' file='b.xml'>{body}</KinBody>"), "a.xml:1:32: a <Body> beside the file `b.xml`"),
        (
            format!("<KinBody name='a' scalegeometry='2'>{body}</KinBody>"),
            "a.xml:1:34: `scalegeometry` of <KinBody> changes shapes",
        ),
    ] {
        let error = refused("a.xml", &text);
        assert!(error.contains(words), "{error}");
    }
    // The file of a body is the object's model.
    let model = documents(
        "a.xml",
        "<Environment><KinBody name='a' file='b.xml'><Translation>1 2 3</Translation></KinBody></Environment>",
    );
    assert!(model.contains(r#""translation":[1.0,2.0,3.0]"#) && model.contains(r#""model":"b.xml""#), "{model}");
}

#[test]
fn the_frame_of_a_pose_in_older_sdf_may_be_empty() {
    let text = |pose: &str| {
        sdf("<visual name='v'><geometry><sphere><radius>1</radius></sphere></geometry></visual>")
            .replace("<link", &format!("{pose}<link"))
    };
    let taken = documents("a.sdf", &text("<pose frame=''>1 2 3 0 0 0</pose>"));
    assert!(taken.contains(r#""translation":[1.0,2.0,3.0]"#), "{taken}");
    insta::assert_snapshot!(refused("a.sdf", &text("<pose frame='base'>1 2 3 0 0 0</pose>")), @r"
    error: a.sdf:1:49: a pose in the frame `base`, which is not read; expected `frame` to be empty
      |
    1 | <sdf version='1.6'><model name='a'><pose frame='base'>1 2 3 0 0 0</pose><link name='l'><visual name=
      |                                                 ^^^^
      = hint: since SDF 1.7, the pose of a model in a world may have `relative_to` instead
    ");
}

#[test]
fn a_color_of_sdf_with_three_numbers_is_opaque() {
    let text = |color: &str| {
        let geometry = "<geometry><sphere><radius>1</radius></sphere></geometry>";
        sdf(&format!("<visual name='v'>{geometry}<material><diffuse>{color}</diffuse></material></visual>"))
    };
    for (color, expected) in [("0 0.1 0.2", "[0.0,0.1,0.2,1.0]"), ("0 0.1 0.2 0.3", "[0.0,0.1,0.2,0.3]")] {
        let read = documents("a.sdf", &text(color));
        assert!(read.contains(&format!(r#""color":{expected}"#)), "{read}");
    }
    for (color, words) in [
        ("0 0.1", "a.sdf:1:143: <diffuse> has 2 numbers; expected 3 or 4"),
        ("0 0 0 0 1", "<diffuse> has 5 numbers; expected 3 or 4"),
        ("0 0 red", "<diffuse> has `red`; expected a finite number"),
    ] {
        let error = refused("a.sdf", &text(color));
        assert!(error.contains(words), "{error}");
    }
}

#[test]
fn elements_and_attributes_with_a_prefix_are_passed_over() {
    let body = "<collision name='c'><geometry><box><size>1 2 3</size></box></geometry>\
        <drake:proximity_properties drake:a='1'><drake:mu_dynamic>0.5</drake:mu_dynamic><pose>9 9 9 0 0 0</pose>\
        </drake:proximity_properties></collision>";
    let plain =
        documents("a.sdf", &sdf("<collision name='c'><geometry><box><size>1 2 3</size></box></geometry></collision>"));
    let custom = sdf(body).replace("<link", "<gz:link name='x'/><pose gz:type='b'></pose><link");
    let declared = custom.replace("<sdf", "<sdf xmlns:drake='drake.mit.edu' xmlns:gz='gazebosim.org'");
    for text in [&custom, &declared] {
        assert_eq!(documents("a.sdf", text), plain, "{text}");
    }
    let robot = "<robot name='r'><link name='world'/><link name='a'><collision><geometry><box size='1 2 3'/></geometry>\
        <drake:proximity_properties/></collision><controller:x/></link><joint name='j' type='floating'>\
        <parent link='world'/><child link='a'/></joint></robot>";
    assert!(documents("a.urdf", robot).contains(r#""geometry":{"type":"box","size":[1.0,2.0,3.0]}"#));
    // Places are those of the file, without any declaration.
    for (text, words) in [
        (custom.replace("1 2 3", "1 2"), "a.sdf:1:136: <size> has 2 numbers; expected 3"),
        (custom.replace("1 2 3", "1 2").replace("'1.6'>", "'1.6'>\n"), "a.sdf:2:117: <size> has 2 numbers; expected 3"),
        (custom.replace("gz:type='b'", "type='b'"), "a.sdf:1:61: unknown attribute `type` of <pose>"),
        (custom.replace("</model>", "</modem>"), "this is no XML: expected 'model' tag, not 'modem'"),
        (
            custom.replace("<drake:prox", "<prox").replace("</drake:prox", "</prox"),
            "unknown element <proximity_properties> in <collision>",
        ),
        (
            custom.replace("gz:link name='x'", "xi:include href='b.sdf'"),
            "a.sdf:1:36: <xi:include> includes another file, which is not read",
        ),
        (custom.replace("sdf ", "gz:sdf ").replace("/sdf", "/gz:sdf"), "this looks like no format of scenes"),
    ] {
        let error = refused("a.sdf", &text);
        assert!(error.contains(words), "{error}");
    }
}

#[test]
fn two_hyphens_in_a_comment_are_shown_at_their_place() {
    let comment = "<?xml version='1.0'?>\n<!--\n  a\n  gz topic --msgtype x\n-->\n";
    insta::assert_snapshot!(refused("a.sdf", &format!("{comment}{}", sdf(""))), @r"
    error: a.sdf:4:12: this is no XML: a comment has `--` in it, which XML allows only in the `-->` at its end
      |
    4 |   gz topic --msgtype x
      |            ^^
      = hint: write one hyphen, or a blank between the two
    ");
    let text = sdf("<!-- a --->");
    let error = refused("a.sdf", &text);
    assert!(error.contains("a.sdf:1:58: this is no XML: a comment has `--` in it"), "{error}");
    insta::assert_snapshot!(refused("a.sdf", "<!-- by hand -->\n<?xml version='1.0'?>\n<sdf version='1.6'/>"), @r"
    error: a.sdf:2:1: this is no XML: `<?xml` stands behind something else
      |
    2 | <?xml version='1.0'?>
      | ^
      = hint: it has to be the very beginning of the file; move it there, or remove it
    ");
}

#[test]
fn xacro_is_named_with_the_command_that_makes_urdf_of_it() {
    let robot = |inner: &str| format!("<robot name='r' xmlns:xacro='http://ros.org/wiki/xacro'>\n{inner}\n</robot>");
    insta::assert_snapshot!(refused("a.urdf", &robot("<xacro:macro name='leg' params='x'><link name='${x}'/></xacro:macro>")), @r"
    error: a.urdf:2:1: <xacro:macro> is an element of Xacro
      |
    2 | <xacro:macro name='leg' params='x'><link name='${x}'/></xacro:macro>
      | ^^^^^^^^^^^^
      = hint: this file is Xacro: `xacro FILE > robot.urdf` makes the URDF
    ");
    for (text, words) in [
        (robot("<link name='${prefix}a'/>"), "a.urdf:2:13: `name` has an expression of Xacro"),
        (robot("<xacro:leg/>").replace(" xmlns:xacro='http://ros.org/wiki/xacro'", ""), "a.urdf:2:1: <xacro:leg> is an element of Xacro"),
        (
            "<robot name='r'><link name='a'><visual><geometry><sphere radius='${2 * r}'/></geometry></visual></link></robot>".to_owned(),
            "`radius` has `${2 * r}`, an expression of Xacro; `xacro FILE > robot.urdf` makes the URDF",
        ),
    ] {
        let error = refused("a.urdf", &text);
        assert!(error.contains(words), "{error}");
    }
    insta::assert_snapshot!(refused("a.urdf", &robot("")), @r"
    error: a.urdf:1:1: a robot without links; expected one at least, which is the frame
      |
    1 | <robot name='r' xmlns:xacro='http://ros.org/wiki/xacro'>
      | ^^^^^^
      = hint: run `xacro FILE > robot.urdf` on the file that uses the macros of this one
    ");
    // What Xacro made still declares its prefix.
    let made = documents(
        "a.urdf",
        &robot(
            "<link name='world'/><link name='a'/><joint name='j' type='fixed'><parent link='world'/><child link='a'/></joint>",
        ),
    );
    assert!(made.contains(r#""name":"a""#), "{made}");
}

#[test]
fn elements_for_simulators_and_drivers_are_passed_over() {
    let model = sdf("<plugin name='p'/><sensor name='s' type='ray'/><visual name='v'><plugin name='q'/>\
        <geometry><box><size>1 2 3</size></box></geometry></visual>");
    let model = model.replace("<link", "<robotNamespace>r</robotNamespace><plugin name='p' filename='p.so'/><link");
    let light = "<light type='directional' name='sun'><pose>0 0 10 0 0 0</pose></light>";
    let box_of = |read: &str| read.contains(r#""name":"a""#) && read.contains(r#""size":[1.0,2.0,3.0]"#);
    for text in [
        model.replace("<model", &format!("{light}<plugin name='p' filename='p.so'/><model")),
        model
            .replace("<model", &format!("<world name='w'>{light}<plugin name='p' filename='p.so'/><model"))
            .replace("</sdf>", "</world></sdf>"),
    ] {
        let read = documents("a.sdf", &text);
        assert!(box_of(&read) && read.lines().count() == 1, "{read}");
    }
    let robot = "<robot name='r'><ros2_control name='c' type='system'/><gazebo reference='a'/><transmission/><sensor/>\
        <frame name='f' link='a'/><link name='world'/><link name='a'><contact_coefficients mu='1'/><sensor/>\
        <visual><geometry><box size='1 2 3'/></geometry></visual></link>\
        <joint name='j' type='fixed'><parent link='world'/><child link='a'/><gazebo/></joint></robot>";
    assert!(box_of(&documents("a.urdf", robot)));
    // A word that is wrong is still found, and so is what changes the scene.
    for (file, text, words) in [
        ("a.urdf", robot.replace("visual>", "visuel>"), "a.urdf:1:202: unknown element <visuel> in <link>"),
        (
            "a.urdf",
            robot.replace("<gazebo/>", "<include file='b'/>"),
            "<include> takes what another file has, which is not read",
        ),
        ("a.sdf", model.replace("<plugin", "<include/><plugin"), "a.sdf:1:70: <include> takes what another file has"),
        (
            "a.sdf",
            model.replace("<model", "<world name='w'/><model"),
            "a.sdf:1:37: <model> beside the <world>; expected one world",
        ),
        (
            "a.sdf",
            model.replace("<model", "<world name='v'/><world name='w'/><model"),
            "a.sdf:1:37: <world> beside the <world>",
        ),
    ] {
        let error = refused(file, &text);
        assert!(error.contains(words), "{error}");
    }
}

/// A file of MJCF with this before its world, and this in its body.
fn mjcf(before: &str, body: &str) -> String {
    format!("<mujoco>{before}<worldbody><body name='a'><freejoint/>{body}</body></worldbody></mujoco>")
}

#[test]
fn what_moves_and_looks_is_passed_over_in_mjcf() {
    let geom = "<geom type='box' size='1 1 1' mass='2'/>";
    let plain = documents("a.xml", &mjcf("", geom));
    for before in [
        "<compiler texturedir='t' assetdir='a' autolimits='true' balanceinertia='true' usethread='false'/>",
        "<option timestep='0.1'/><visual><map/></visual><statistic extent='1'/><size njmax='1'/>",
        "<contact><exclude/></contact><actuator><motor/></actuator><tendon/><sensor/><keyframe><key/></keyframe>",
        "<default><default class='c'><geom friction='1'/><motor ctrlrange='0 1'/></default><joint damping='1'/></default>",
        "<compiler settotalmass='-1' discardvisual='false' inertiagrouprange='0 5' boundmass='0.1'/>",
    ] {
        assert_eq!(documents("a.xml", &mjcf(before, geom)), plain, "{before}");
    }
    let class = "<default><default class='c'><geom friction='1'/></default></default>";
    assert_eq!(documents("a.xml", &mjcf(class, &geom.replace("<geom", "<geom class='c'"))), plain);
    for (text, words) in [
        (
            mjcf("<default><geom rgba='1 0 0 1'/></default>", geom),
            "a.xml:1:30: `rgba` in the defaults of <geom> changes the scene",
        ),
        (
            mjcf("<default><default class='c'><joint type='free'/></default></default>", geom),
            "`type` in the defaults of <joint>",
        ),
        (mjcf("<default><mesh scale='2 2 2'/></default>", geom), "`scale` in the defaults of <mesh>"),
        (mjcf("<include file='b.xml'/>", geom), "a.xml:1:9: <include> takes what another file has"),
        (mjcf("<equality/>", geom), "unknown element <equality> in <mujoco>"),
        (mjcf("<compiler settotalmass='5'/>", geom), "a.xml:1:33: `settotalmass` scales all masses"),
        (mjcf("<compiler discardvisual='true'/>", geom), "`discardvisual` removes geoms that never collide"),
        (mjcf("<compiler inertiagrouprange='2 3'/>", geom), "`inertiagrouprange` leaves out masses"),
        (mjcf("<compiler eulerseq='xyq'/>", geom), "expected three letters of `xyzXYZ`"),
        (mjcf("<compiler balance='true'/>", geom), "unknown attribute `balance` of <compiler>"),
        (mjcf("", &geom.replace("<geom", "<geom class='c'")), "there is no <default>"),
    ] {
        let error = refused("a.xml", &text);
        assert!(error.contains(words), "{error}");
    }
}

#[test]
fn the_compiler_of_mjcf_says_how_angles_files_and_masses_are_meant() {
    let turned = |compiler: &str| -> Vec<i64> {
        let read = documents("a.xml", &mjcf(compiler, "<geom size='1' euler='90 90 0'/>"));
        let read: serde_json::Value = serde_json::from_str(&read).unwrap();
        let rotation = read["geometry"]["rotation"].as_array().unwrap();
        rotation.iter().map(|part| (part.as_f64().unwrap() * 1e6).round() as i64).collect()
    };
    let half = 500_000;
    // About x and then about the body's own y; with capital letters, about the y that is not turned.
    for (compiler, expected) in [
        ("", [half, half, half, half]),
        ("<compiler eulerseq='xyz'/><compiler/>", [half, half, half, half]),
        ("<compiler eulerseq='XYZ'/>", [half, half, -half, half]),
        ("<compiler eulerseq='yxz'/>", [half, half, -half, half]),
        ("<compiler angle='radian' eulerseq='zzz'/><compiler angle='degree'/>", [0, 0, 2 * half, 0]),
    ] {
        assert_eq!(turned(compiler), expected, "{compiler}");
    }
    let meshed = |compiler: &str, file: &str| {
        documents(
            "a.xml",
            &mjcf(&format!("{compiler}<asset><mesh name='m' file='{file}'/></asset>"), "<geom mesh='m'/>"),
        )
    };
    for (compiler, file, expected) in [
        ("<compiler meshdir='x' assetdir='y'/>", "b/c.stl", "x/b/c.stl"),
        ("<compiler assetdir='y' strippath='true'/>", "b/c.stl", "y/c.stl"),
        ("<compiler meshdir='x'/>", "/b/c.stl", "/b/c.stl"),
    ] {
        let read = meshed(compiler, file);
        assert!(read.contains(&format!("\"file\":\"{expected}\"")), "{read}");
    }
    let body = "<inertial pos='0 0 0' mass='3'/><geom size='1' mass='2'/>";
    for (compiler, mass) in [
        ("", "3.0"),
        ("<compiler inertiafromgeom='true'/>", "2.0"),
        ("<compiler inertiafromgeom='false'/>", "3.0"),
        ("<compiler boundmass='5'/>", "5.0"),
    ] {
        let read = documents("a.xml", &mjcf(compiler, body));
        assert!(read.contains(&format!("\"mass\":{mass}")), "{compiler}\n{read}");
    }
}
