//! Scenes in every format: what is written reads back, and every trap of the conventions is avoided.

use proptest::prelude::*;
use rmem::formats::Source;
use rmem::formats::scene::pose::{from_axis, from_rpy, norm};
use rmem::formats::scene::{
    Attachment, Content, Kind, Mesh, Object, Operation, Pose, SPELLINGS, Scene, Shape, Solid, Spelling, Triangles,
    by_name, document, recognize,
};

fn poses() -> impl Strategy<Value = Pose> {
    let any = prop::array::uniform4(-1.0..1.0_f64).prop_filter("no rotation", |parts| norm(parts) > 0.1);
    let right = prop::array::uniform3(-2..=2_i8)
        .prop_map(|turns| from_rpy(turns.map(|turn| f64::from(turn) * std::f64::consts::FRAC_PI_2)));
    (prop::array::uniform3(-100.0..100.0_f64), prop_oneof![3 => any, 1 => right])
        .prop_map(|(translation, rotation)| Pose::new(translation, rotation).unwrap())
}

fn triangles() -> impl Strategy<Value = Triangles> {
    let vertices = prop::collection::vec(prop::array::uniform3(-1.0..1.0_f64), 3..8);
    let faces = prop::collection::vec(prop::array::uniform3(0..3_usize), 1..8);
    (vertices, faces).prop_map(|(vertices, faces)| Triangles { vertices, faces })
}

fn solids() -> impl Strategy<Value = Solid> {
    let length = || 1e-3..10.0_f64;
    prop_oneof![
        prop::array::uniform3(length()).prop_map(Solid::Box),
        length().prop_map(Solid::Sphere),
        (length(), length()).prop_map(|(radius, length)| Solid::Cylinder { radius, length }),
        (length(), length()).prop_map(|(radius, length)| Solid::Cone { radius, length }),
        (poses(), -10.0..10.0_f64)
            .prop_map(|(pose, offset)| Solid::Plane { normal: pose.rotate([0.0, 0.0, 1.0]), offset }),
        ("[a-z]{1,8}\\.(stl|obj)", prop::array::uniform3(length()))
            .prop_map(|(file, scale)| Solid::Mesh(Mesh::File { file, scale })),
        triangles().prop_map(|triangles| Solid::Mesh(Mesh::Triangles(triangles))),
    ]
}

/// Shapes that a format can express.
fn shapes(spelling: &'static Spelling) -> impl Strategy<Value = Vec<Shape>> {
    let kinds = spelling.limits.kinds;
    let solid = solids().prop_filter("cannot be expressed", move |solid| kinds.contains(&solid.kind()));
    let color = prop::option::of(prop::array::uniform4(0.01..1.0_f64));
    let shape = (solid, poses(), color).prop_map(|(solid, pose, color)| Shape { color, ..Shape::new(solid, pose) });
    prop::collection::vec(shape, usize::from(!spelling.limits.empty)..4)
}

fn objects(spelling: &'static Spelling) -> impl Strategy<Value = Object> {
    let attachment = ("[a-z]{1,8}", prop::collection::vec("[a-z_]{1,8}", 0..3));
    let attachment = prop::option::of(attachment.prop_map(|(link, touch)| Attachment { link, touch }));
    let subframes = prop::collection::vec(("[a-z]{1,8}", poses()), 0..3);
    // Names that XML has to escape, and letters that are not ASCII.
    let name =
        "[a-zA-ZäÖ0-9&<>'\"_.-]{1,12}".prop_filter("reserved", |name| !name.starts_with("__") && name != "world");
    let weighed = (prop::option::of(0.01..100.0_f64), any::<bool>(), prop::option::of("[a-z]{1,8}\\.xml"));
    (name, poses(), shapes(spelling), weighed, attachment, subframes).prop_map(
        |(name, pose, shapes, (mass, fixed, model), attachment, mut subframes)| {
            subframes.sort_by(|a, b| a.0.cmp(&b.0));
            subframes.dedup_by(|a, b| a.0 == b.0);
            let mut object = Object { name, pose, shapes, mass, fixed, attachment, subframes, model };
            if object.has_plane() {
                // A plane stands still, and weighs nothing.
                (object.fixed, object.mass) = (true, None);
            }
            object
        },
    )
}

fn scenes(spelling: &'static Spelling) -> impl Strategy<Value = Scene> {
    let objects = prop::collection::vec(objects(spelling), 0..6).prop_map(|mut objects| {
        objects.sort_by(|a, b| a.name.cmp(&b.name));
        objects.dedup_by(|a, b| a.name == b.name);
        objects
    });
    (objects, "[a-z]{2,8}").prop_map(|(objects, frame)| Scene {
        name: Some("scene".to_owned()),
        frame: Some(format!("{frame}_frame")),
        objects,
        ..Scene::default()
    })
}

/// The format that a text looks like; what looks like none is read as MoveIt's.
fn recognized(text: &str) -> &'static Spelling {
    recognize(text).unwrap_or(&rmem::formats::scene::moveit::SPELLING)
}

fn read(text: &str) -> Scene {
    let spelling = recognized(text);
    match (spelling.read)(&Source::new("scene", text)) {
        Ok(Content::Scene(scene)) => scene,
        other => panic!("{other:?}\n{text}"),
    }
}

/// What is written reads back as what the format can express, within 1e-9.
fn check_round_trip(spelling: &'static Spelling, scene: &Scene) -> Result<(), TestCaseError> {
    let mut scene = scene.clone();
    // Documents first: an object is what its document says.
    for object in &mut scene.objects {
        let name = object.name.clone();
        *object = Object { name, ..document::read(&document::write(object)).map_err(TestCaseError::fail)? };
        spelling.check(object).map_err(TestCaseError::fail)?;
    }
    let text = (spelling.write)(&scene);
    prop_assert_eq!(recognize(&text).map(|found| found.name), Some(spelling.name), "{}", text);
    let again = read(&text);
    if spelling.limits.frame && !(scene.objects.is_empty() && spelling.name == "moveit-msg") {
        prop_assert_eq!(&again.frame, &scene.frame);
    }
    prop_assert_eq!(again.objects.len(), scene.objects.len(), "{}", text);
    for object in &scene.objects {
        // What is attached is apart from the rest in a message.
        let back = again.objects.iter().find(|back| back.name == object.name);
        let back = back.ok_or_else(|| TestCaseError::fail(format!("no {}", object.name)))?;
        let expected = spelling.expressible(object);
        prop_assert!(expected.is_near(back, 1e-9), "{:#?}\n{:#?}\n{}", expected, back, text);
        // And through documents once more.
        let stored = document::read(&document::write(back)).map_err(TestCaseError::fail)?;
        prop_assert!(expected.has_shapes_near(&stored, 1e-9), "{:#?}\n{:#?}", expected, stored);
    }
    Ok(())
}

macro_rules! round_trips {
    ($($test:ident: $name:literal,)*) => {
        proptest! {
            #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]
            $(
                #[test]
                fn $test(scene in scenes(by_name($name).unwrap())) {
                    check_round_trip(by_name($name).unwrap(), &scene)?;
                }
            )*
        }
    };
}

round_trips! {
    json_reads_back: "json",
    moveit_reads_back: "moveit",
    a_planning_scene_reads_back: "moveit-msg",
    mjcf_reads_back: "mjcf",
    sdf_reads_back: "sdf",
    urdf_reads_back: "urdf",
    openrave_reads_back: "openrave",
}

/// A box, a cylinder and a sphere, none of them in any plane of symmetry.
fn lopsided() -> Scene {
    let turn = from_axis([1.0, 2.0, 3.0], 0.7);
    let pose = Pose::new([1.0, 2.0, 3.0], turn).unwrap();
    let object = |name: &str, solid: Solid| Object {
        name: name.to_owned(),
        pose,
        shapes: vec![Shape::new(solid, Pose::IDENTITY)],
        ..Object::default()
    };
    Scene {
        name: None,
        frame: Some("map".to_owned()),
        objects: vec![
            object("crate", Solid::Box([0.2, 0.4, 0.6])),
            object("can", Solid::Cylinder { radius: 0.05, length: 0.3 }),
        ],
        ..Scene::default()
    }
}

fn written(format: &str) -> String {
    (by_name(format).unwrap().write)(&lopsided())
}

#[track_caller]
fn has(text: &str, part: &str) {
    assert!(text.contains(part), "no {part} in\n{text}");
}

/// The quaternion of the scene, in both orders.
fn quaternions() -> (String, String) {
    let [x, y, z, w] = from_axis([1.0, 2.0, 3.0], 0.7);
    (format!("{x} {y} {z} {w}"), format!("{w} {x} {y} {z}"))
}

#[test]
fn mjcf_has_w_first_half_sizes_and_half_lengths() {
    let text = written("mjcf");
    has(&text, &format!("quat=\"{}\"", quaternions().1));
    has(&text, "type=\"box\" size=\"0.1 0.2 0.3\"");
    has(&text, "type=\"cylinder\" size=\"0.05 0.15\"");
}

#[test]
fn openrave_has_w_first_half_extents_full_heights_and_cylinders_along_y() {
    let text = written("openrave");
    has(&text, &format!("<Quat>{}</Quat>", quaternions().1));
    has(&text, "<Extents>0.1 0.2 0.3</Extents>");
    has(&text, "<Radius>0.05</Radius><Height>0.3</Height>");
    // The can's own turn takes y to z.
    let half = std::f64::consts::FRAC_1_SQRT_2;
    has(&text, &format!("<Quat>{half} {half} 0 0</Quat>"));
    let turned = Pose::turned([half, 0.0, 0.0, half]);
    let along = turned.rotate([0.0, 1.0, 0.0]);
    assert!(norm(&[along[0], along[1], along[2] - 1.0]) < 1e-15);
}

#[test]
fn moveit_has_w_last_full_sizes_and_radius_before_length() {
    let text = written("moveit");
    has(&text, &format!("* crate\n1 2 3\n{}\n1\nbox\n0.2 0.4 0.6\n", quaternions().0));
    has(&text, "cylinder\n0.05 0.3\n");
}

#[test]
fn a_planning_scene_has_height_before_radius() {
    let text = written("moveit-msg");
    has(&text, "{\"type\":1,\"dimensions\":[0.2,0.4,0.6]}");
    has(&text, "{\"type\":3,\"dimensions\":[0.3,0.05]}");
    let [x, y, z, w] = from_axis([1.0, 2.0, 3.0], 0.7);
    has(&text, &format!("\"orientation\":{{\"x\":{x},\"y\":{y},\"z\":{z},\"w\":{w}}}"));
}

#[test]
fn sdf_has_w_last_full_sizes_and_says_so() {
    let text = written("sdf");
    has(&text, &format!("<pose relative_to=\"map\" rotation_format=\"quat_xyzw\">1 2 3 {}</pose>", quaternions().0));
    has(&text, "<box><size>0.2 0.4 0.6</size></box>");
    has(&text, "<cylinder><radius>0.05</radius><length>0.3</length></cylinder>");
}

#[test]
fn urdf_has_radians_and_full_sizes() {
    let text = written("urdf");
    let [roll, pitch, yaw] = lopsided().objects[0].pose.rpy();
    has(&text, &format!("<origin xyz=\"1 2 3\" rpy=\"{roll} {pitch} {yaw}\"/>"));
    has(&text, "<box size=\"0.2 0.4 0.6\"/>");
    has(&text, "<cylinder radius=\"0.05\" length=\"0.3\"/>");
}

fn only(scene: &Scene) -> &Object {
    assert_eq!(scene.objects.len(), 1, "{scene:?}");
    &scene.objects[0]
}

#[track_caller]
fn lies(object: &Object, translation: [f64; 3], axis: [f64; 3], degrees: f64) {
    let expected = Pose::new(translation, from_axis(axis, degrees.to_radians())).unwrap();
    assert!(object.pose.is_near(&expected, 1e-9), "{:?}, expected {expected:?}", object.pose);
}

#[test]
fn angles_of_mjcf_are_degrees_unless_it_says_radian() {
    let text = |compiler: &str, turn: &str| {
        format!(
            "<mujoco>{compiler}<worldbody><body name='a' pos='1 2 3' {turn}><geom size='1'/></body></worldbody></mujoco>"
        )
    };
    let right = std::f64::consts::FRAC_PI_2;
    for (compiler, turn, axis, degrees) in [
        ("", "axisangle='0 0 1 90'".to_owned(), [0.0, 0.0, 1.0], 90.0),
        ("<compiler angle='radian'/>", format!("axisangle='0 0 1 {right}'"), [0.0, 0.0, 1.0], 90.0),
        ("<compiler angle='degree'/>", "euler='90 0 0'".to_owned(), [1.0, 0.0, 0.0], 90.0),
        ("", "xyaxes='0 1 0 -1 0 0'".to_owned(), [0.0, 0.0, 1.0], 90.0),
        ("", "zaxis='1 0 0'".to_owned(), [0.0, 1.0, 0.0], 90.0),
        ("", "quat='0 1 0 0'".to_owned(), [1.0, 0.0, 0.0], 180.0),
    ] {
        let scene = read(&text(compiler, &turn));
        lies(only(&scene), [1.0, 2.0, 3.0], axis, degrees);
    }
    // Turns about the body's own axes: x by 90, then its new y, which was z.
    let scene = read(&text("", "euler='90 90 0'"));
    let x = only(&scene).pose.rotate([1.0, 0.0, 0.0]);
    assert!(norm(&[x[0], x[1] + 1.0, x[2]]) < 1e-9 || norm(&[x[0], x[1], x[2] + 1.0]) > 1.0, "{x:?}");
}

#[test]
fn a_geom_from_one_point_to_another_lies_between_them() {
    let scene = read(
        "<mujoco><worldbody><body name='a'><geom type='cylinder' fromto='0 0 1 0 0 3' size='0.5'/></body></worldbody></mujoco>",
    );
    let shape = &only(&scene).shapes[0];
    assert_eq!(shape.solid, Solid::Cylinder { radius: 0.5, length: 2.0 });
    assert!(norm(&[shape.pose.translation[2] - 2.0]) < 1e-12, "{shape:?}");
}

#[test]
fn bodies_in_bodies_are_placed_in_the_world() {
    let scene = read(
        "<mujoco><worldbody><body name='table' pos='1 0 0' quat='0 0 0 1'><geom type='box' size='1 1 1'/>\
         <body name='cup' pos='1 0 0.5'><geom size='0.1'/></body></body></worldbody></mujoco>",
    );
    lies(&scene.objects[1], [0.0, 0.0, 0.5], [0.0, 0.0, 1.0], 180.0);
}

#[test]
fn poses_of_sdf_are_radians_degrees_or_quaternions() {
    let text = |pose: &str| {
        format!(
            "<sdf version='1.9'><world name='w'><model name='a'>{pose}<link name='l'><collision name='c'>\
             <geometry><sphere><radius>1</radius></sphere></geometry></collision></link></model></world></sdf>"
        )
    };
    for (pose, degrees) in [
        ("<pose>1 2 3 0 0 0.5</pose>", 0.5_f64.to_degrees()),
        ("<pose degrees='true'>1 2 3 0 0 90</pose>", 90.0),
        ("<pose rotation_format='quat_xyzw'>1 2 3 0 0 1 0</pose>", 180.0),
        ("<pose rotation_format='euler_rpy'>1 2 3 0 0 1</pose>", 1.0_f64.to_degrees()),
    ] {
        lies(only(&read(&text(pose))), [1.0, 2.0, 3.0], [0.0, 0.0, 1.0], degrees);
    }
}

#[test]
fn rotations_of_openrave_are_degrees_and_add_up_from_the_left() {
    let scene = read(
        "<Environment><KinBody name='a'><Translation>1 0 0</Translation><translation>0 2 3</translation>\
         <RotationAxis>1 0 0 90</RotationAxis><rotationaxis>0 0 1 90</rotationaxis>\
         <Body type='dynamic'><Geom type='box'><extents>1 2 3</extents></Geom></Body></KinBody></Environment>",
    );
    let object = only(&scene);
    assert_eq!(object.pose.translation, [1.0, 2.0, 3.0]);
    // About x first, which takes y to z; about z then leaves it there.
    let y = object.pose.rotate([0.0, 1.0, 0.0]);
    assert!(norm(&[y[0], y[1], y[2] - 1.0]) < 1e-12, "{y:?}");
    assert_eq!(object.shapes[0].solid, Solid::Box([2.0, 4.0, 6.0]));
    let scene = read(
        "<KinBody name='can'><Body><Geom type='cylinder'><radius>0.1</radius><height>2</height></Geom></Body></KinBody>",
    );
    // It lies along y.
    let along = only(&scene).shapes[0].pose.rotate([0.0, 0.0, 1.0]);
    assert!((along[1].abs() - 1.0).abs() < 1e-12, "{along:?}");
}

#[test]
fn both_versions_of_moveits_files_are_read() {
    let new = "demo\n* wooden box 1\n1 2 3\n0 0 0 1\n1\nbox\n0.1 0.2 0.3\n0 0 0.5\n0 0 0 1\n1 0 0 1\n1\nhandle\n0 0 1\n0 0 0 1\n.\n";
    let old = "demo\n* wooden box 1\n1\nbox\n0.1 0.2 0.3\n1 2 3.5\n0 0 0 1\n0 0 0 0\n.\n";
    let (new, old) = (read(new), read(old));
    assert_eq!((only(&new).name.as_str(), only(&old).name.as_str()), ("wooden box 1", "wooden box 1"));
    assert_eq!(only(&new).shapes[0].color, Some([1.0, 0.0, 0.0, 1.0]));
    assert_eq!(only(&old).shapes[0].color, None, "four zeros are no colour");
    assert_eq!(only(&new).subframes[0].0, "handle");
    let place = |object: &Object| object.pose.around(&object.shapes[0].pose).translation;
    assert_eq!(place(only(&new)), [1.0, 2.0, 3.5]);
    assert_eq!(place(only(&new)), place(only(&old)));
}

#[test]
fn a_plane_of_moveit_has_its_offset_with_the_other_sign() {
    let scene = read("demo\n* floor\n1\nplane\n0 0 2 -1\n0 0 0\n0 0 0 1\n0 0 0 0\n.\n");
    assert_eq!(only(&scene).shapes[0].solid, Solid::Plane { normal: [0.0, 0.0, 1.0], offset: 0.5 });
}

#[test]
fn operations_are_messages_with_their_numbers() {
    let lopsided = lopsided();
    let [crate_, can] = &lopsided.objects[..] else { panic!() };
    let held = Attachment { link: "hand".to_owned(), touch: vec!["finger".to_owned()] };
    let operations = vec![
        Operation::Add(Box::new(crate_.clone())),
        Operation::Remove { name: "old".to_owned() },
        Operation::Move { name: "can".to_owned(), pose: can.pose },
    ];
    let taken = vec![
        Operation::Attach { name: "can".to_owned(), attachment: held },
        Operation::Detach { name: "crate".to_owned(), link: "hand".to_owned() },
    ];
    for (operations, part) in [
        (&operations, "\"id\":\"old\",\"operation\":1"),
        (&operations, "\"is_diff\":true"),
        (&operations, "\"operation\":3"),
        (&taken, "\"link_name\":\"hand\""),
    ] {
        let frame = operations.iter().any(|one| matches!(one, Operation::Move { .. })).then(|| "map".to_owned());
        let text = rmem::formats::scene::message::write_operations(operations, Some("map"));
        has(&text, part);
        let read = (recognized(&text).read)(&Source::new("message", text.as_str())).unwrap();
        assert_eq!(read, Content::Operations(operations.clone(), frame.clone()));
        // And as rmem's own lines; what says nothing of poses says nothing of a frame.
        let lines: Vec<String> =
            operations.iter().map(|one| rmem::formats::scene::json::line(&one.to_document(Some("map")))).collect();
        let lines = lines.join("\n");
        assert_eq!(
            (recognized(&lines).read)(&Source::new("lines", lines.as_str())).unwrap(),
            Content::Operations(operations.clone(), frame.clone())
        );
    }
}

#[test]
fn what_is_wrong_in_a_file_is_shown_at_its_place() {
    for (text, words) in [
        (
            "<mujoco>\n<worldbody>\n<body name='a' quat='2 0 0 0'/></worldbody></mujoco>",
            "scene:3:1: a quaternion of length 2",
        ),
        (
            "<mujoco><worldbody><body name='a'><geom type='capsule' size='1 1'/></body></worldbody></mujoco>",
            "scene:1:47: unknown geometry `capsule`",
        ),
        (
            "<mujoco>\n<worldbody>\n<body name='a'><geom size='-1'/></body></worldbody></mujoco>",
            "scene:3:16: a sphere that has the radius -1",
        ),
        (
            "<mujoco>\n<default><geom size='1'/></default></mujoco>",
            "scene:2:22: `size` in the defaults of <geom> changes the scene",
        ),
        ("<mujoco><compiler angle='grad'/></mujoco>", "scene:1:26: expected `degree` or `radian`"),
        (
            "<mujoco><worldbody><body name='a'><joint type='hinge'/></body></worldbody></mujoco>",
            "a scene has no joints but free ones",
        ),
        ("<mujoco><worldbody><body name='a' pos='1 2 nan'/></worldbody></mujoco>", "scene:1:40: `pos` has `nan`"),
        ("<sdf version='1.9'><world name='w'>\n<actor name='x'/></world></sdf>", "scene:2:1: unknown element <actor>"),
        ("<sdf version='2.0'/>", "scene:1:15: unknown version `2.0`"),
        (
            "<sdf version='1.9'><model name='a'><pose>1 2 3</pose></model></sdf>",
            "scene:1:42: <pose> has 3 numbers; expected 6",
        ),
        (
            "<sdf version='1.9'><model name='a'><link name='l'><collision name='c'><geometry><heightmap/></geometry></collision></link></model></sdf>",
            "unknown element <heightmap>",
        ),
        (
            "<robot name='r'><link name='a'/><link name='b'/></robot>",
            "expected one link without a joint above it, found 2",
        ),
        (
            "<robot name='r'><link name='a'/><link name='b'/><joint name='j' type='revolute'><parent link='a'/><child link='b'/></joint></robot>",
            "no joints of the type `revolute`",
        ),
        ("<Environment><unit>mm 0.001</unit></Environment>", "scene:1:14: lengths in `mm 0.001`; expected metres"),
        (
            "<Environment><KinBody name='a'><Body><Geom type='cage'/></Body></KinBody></Environment>",
            "unknown geometry `cage`",
        ),
        ("<Environment>\n<Sensor/></Environment>", "scene:2:1: unknown element <Sensor>"),
        ("demo\n* a\n1 2 3\n0 0 0 2\n0\n0\n.\n", "scene:4:1: a quaternion of length 2"),
        ("demo\n* a\n1 2 3\n0 0 0 1\n1\npyramid\n", "scene:6:1: unknown shape `pyramid`"),
        ("demo\n* a\n1 2 3\n0 0 0 1\n1\nsphere\n-1\n", "a sphere that has the radius -1"),
        ("demo\n* a\n1 2 x\n", "scene:3:1: expected a position: x y z, found `1 2 x`"),
        ("demo\n* a\n1 2 3\n", "expected a quaternion: x y z w, found the end of the file"),
        ("demo\n* a\n1\nmesh\n999999999 999999999\n", "more vertices and triangles than the file has lines"),
        (
            "{\"objects\": [\n{\"name\": \"a\", \"translation\": [0,0,0], \"rotation\": [0,0,0,2]}]}",
            "scene:2:1: `a` cannot be read: its `rotation`",
        ),
        ("{\"objects\": [\n  {\"name\": \"a\", \"size\": 1}]}", "scene:2:3: `a` has the unknown key `size`"),
        ("{\"objects\": [\n  {]}", "scene:2:4: "),
        ("{\"operation\": \"push\", \"name\": \"a\"}", "there is no operation `push`"),
        (
            "{\"world\": {\"collision_objects\": [\n{\"id\": \"a\", \"primitives\": [{\"type\": 5, \"dimensions\": [1]}]}]}}",
            "scene:2:1: `a`: a primitive of the unknown type 5",
        ),
        ("{\"world\": {\"collision_objects\": [{\"id\": \"a\",\n \"shape\": 1}]}}", "scene:2:"),
        (
            "{\"is_diff\": true, \"world\": {\"collision_objects\": [{\"id\": \"a\", \"operation\": 3, \"planes\": [{\"coef\": [0,0,1,0]}]}]}}",
            "is moved and has geometry",
        ),
        (
            "{\"is_diff\": true, \"world\": {\"collision_objects\": [{\"id\": \"a\", \"operation\": 2}]}}",
            "is to be appended to",
        ),
    ] {
        let wrong = (recognized(text).read)(&Source::new("scene", text)).map(|content| format!("{content:?}"));
        let wrong = wrong.expect_err(text).to_string();
        assert!(wrong.starts_with("scene:") && wrong.contains(words), "{text}\n{wrong}");
    }
}

#[test]
fn names_and_shapes_that_a_format_cannot_express_are_refused() {
    let object = |name: &str, solid: Solid| Object {
        name: name.to_owned(),
        shapes: vec![Shape::new(solid, Pose::IDENTITY)],
        ..Object::default()
    };
    let ball = |name: &str| object(name, Solid::Sphere(1.0));
    let mesh = |file: &str| Solid::Mesh(Mesh::File { file: file.to_owned(), scale: [1.0; 3] });
    let cone = || object("cone", Solid::Cone { radius: 1.0, length: 1.0 });
    for (format, object, words) in [
        ("moveit", ball(" cup"), "begins or ends with a blank"),
        ("moveit", ball("a\nb"), "not a single line"),
        ("mjcf", ball("a\u{1}"), "which XML cannot express"),
        ("mjcf", object("a", mesh("a\u{1}.stl")), "its mesh has the character \\u{1}"),
        ("urdf", Object { model: Some("\u{2}".into()), ..ball("a") }, "its model has the character \\u{2}"),
        ("mjcf", ball("world"), "MuJoCo's own body"),
        ("sdf", ball("a::b"), "reserved in sdf"),
        ("sdf", ball("__cup__"), "reserved in sdf"),
        ("openrave", ball("red cup"), "has a blank"),
        ("urdf", ball(""), "is empty"),
        ("mjcf", cone(), "mjcf has no cone; it has box, sphere, cylinder, plane, mesh"),
        ("urdf", object("floor", Solid::Plane { normal: [0.0, 0.0, 1.0], offset: 0.0 }), "urdf has no plane"),
        ("openrave", Object { name: "a".into(), ..Object::default() }, "it has no geometry"),
        ("sdf", object("m", Solid::Mesh(Mesh::Triangles(Triangles::default()))), "meshes in files only"),
    ] {
        let wrong = by_name(format).unwrap().check(&object).unwrap_err();
        assert!(wrong.contains(words), "{format}: {wrong}");
    }
    let all = [Kind::Box, Kind::Sphere, Kind::Cylinder];
    assert!(SPELLINGS.iter().all(|spelling| all.iter().all(|kind| spelling.limits.kinds.contains(kind))));
}

proptest! {
    #[test]
    fn no_text_makes_a_reader_panic(text in "\\PC{0,60}", head in 0..7_usize) {
        let heads = ["<mujoco>", "<sdf version='1.9'>", "<robot name='r'>", "<Environment>", "{\"world\": ", "{\"objects\": ", "demo\n* a\n"];
        let text = format!("{}{text}", heads[head]);
        let _ = (recognized(&text).read)(&Source::new("scene", text.as_str()));
    }

    #[test]
    fn no_damage_makes_a_reader_panic(
        scene in scenes(by_name("json").unwrap()),
        cuts in prop::collection::vec((any::<prop::sample::Index>(), any::<char>()), 1..4),
    ) {
        for spelling in SPELLINGS {
            let mut scene = scene.clone();
            scene.objects.retain(|object| spelling.check(object).is_ok());
            let mut text: Vec<char> = (spelling.write)(&scene).chars().collect();
            for (at, with) in &cuts {
                let at = at.index(text.len());
                text[at] = *with;
            }
            let text: String = text.into_iter().collect();
            let _ = (recognized(&text).read)(&Source::new("scene", text.as_str()));
        }
    }
}
