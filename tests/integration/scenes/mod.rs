//! Scenes in the programs that they are for: MuJoCo, Drake, MoveIt's shape reader, libsdformat, `check_urdf`, and
//! ROS 2's messages. What *they* read has to be what the scene says.

pub(crate) mod programs;
pub(crate) mod watched;

use std::path::Path;

use libtest_mimic::{Failed, Trial};
use rmem::formats::scene::pose::{from_axis, from_matrix, norm};
use rmem::formats::scene::{Attachment, Mesh, Object, Pose, Scene, Shape, Solid, Triangles, by_name};
use rmem::scene::distance::{Body, distance};

use programs::{Python, compile, installed, run};

/// How much what a program reads may differ.
const TOLERANCE: f64 = 1e-9;

/// Trials whose program is not installed are ignored.
pub(crate) fn trials() -> Vec<Trial> {
    let python = Python::find();
    let with = |module: &str| !python.as_ref().is_some_and(|python| python.has(module));
    let (mujoco, drake, rosbags) = (with("mujoco"), with("pydrake"), with("rosbags"));
    let package = |name: &str| !installed("g++") || !programs::has_package(name);
    let mut trials = vec![
        Trial::test("scenes::mujoco_reads_the_poses_and_sizes_of_mjcf", mujoco_reads).with_ignored_flag(mujoco),
        Trial::test("scenes::distances_agree_with_mujoco_on_1000_random_pairs", distances).with_ignored_flag(mujoco),
        Trial::test("scenes::drake_reads_the_poses_and_sizes_of_sdf", || drake_reads("sdf")).with_ignored_flag(drake),
        Trial::test("scenes::drake_reads_the_poses_and_sizes_of_urdf", || drake_reads("urdf")).with_ignored_flag(drake),
        Trial::test("scenes::rosbags_accepts_planning_scenes", ros_accepts).with_ignored_flag(rosbags),
        Trial::test("scenes::moveits_shape_reader_reads_scene_files", moveit_reads)
            .with_ignored_flag(package("geometric_shapes")),
        Trial::test("scenes::libsdformat_resolves_the_poses_of_sdf", sdformat_resolves)
            .with_ignored_flag(package("sdformat12")),
        Trial::test("scenes::check_urdf_accepts_urdf", urdf_is_accepted).with_ignored_flag(!installed("check_urdf")),
    ];
    trials.extend(watched::trials());
    trials
}

/// Numbers that look random and are the same in every run: Marsaglia's xorshift.
struct Numbers(u64);

impl Numbers {
    /// Between two bounds.
    fn between(&mut self, least: f64, greatest: f64) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        least + (self.0 >> 11) as f64 / (1_u64 << 53) as f64 * (greatest - least)
    }

    fn vector(&mut self, reach: f64) -> [f64; 3] {
        [0; 3].map(|_| self.between(-reach, reach))
    }

    fn pose(&mut self, reach: f64) -> Pose {
        let axis = self.vector(1.0);
        let angle = self.between(-3.0, 3.0);
        Pose::new(self.vector(reach), from_axis(axis, angle)).unwrap()
    }

    fn solid(&mut self, kind: usize) -> Solid {
        match kind % 3 {
            0 => Solid::Box([0; 3].map(|_| self.between(0.05, 0.5))),
            1 => Solid::Sphere(self.between(0.05, 0.3)),
            _ => Solid::Cylinder { radius: self.between(0.05, 0.3), length: self.between(0.05, 0.6) },
        }
    }
}

/// Objects with one to three shapes each, as every format can express them.
fn scene(numbers: &mut Numbers) -> Scene {
    let mut objects = Vec::new();
    for nth in 0..12 {
        let shape = |part: usize, numbers: &mut Numbers| Shape::new(numbers.solid(nth + part), numbers.pose(0.3));
        objects.push(Object {
            name: format!("object-{nth}"),
            pose: numbers.pose(2.0),
            shapes: (0..=nth % 3).map(|part| shape(part, numbers)).collect(),
            fixed: nth % 2 == 0,
            mass: (nth % 4 == 1).then(|| numbers.between(0.1, 2.0)),
            ..Object::default()
        });
    }
    Scene { name: Some("random".to_owned()), frame: Some("map".to_owned()), objects, ..Scene::default() }
}

/// A file with the scene in a format.
fn write(folder: &Path, format: &str, extension: &str, scene: &Scene) -> Result<String, Failed> {
    let path = folder.join(format!("scene.{extension}"));
    let spelling = by_name(format).ok_or("no such format")?;
    for object in &scene.objects {
        spelling.check(object)?;
    }
    std::fs::write(&path, (spelling.write)(scene))?;
    Ok(path.display().to_string())
}

/// A shape as a program reads it.
#[derive(serde::Deserialize)]
struct Read {
    object: String,
    kind: String,
    size: Vec<f64>,
    translation: [f64; 3],
    matrix: [f64; 9],
}

/// The dimensions of a shape in the order of the programs.
fn size(solid: &Solid) -> Vec<f64> {
    match solid {
        Solid::Box(size) => size.to_vec(),
        Solid::Sphere(radius) => vec![*radius],
        Solid::Cylinder { radius, length } => vec![*radius, *length],
        _ => Vec::new(),
    }
}

/// Compares what was read with the scene, shape by shape.
fn compare(scene: &Scene, lines: &str) -> Result<(), Failed> {
    let read: Vec<Read> = lines.lines().map(serde_json::from_str).collect::<Result<_, _>>()?;
    let wanted: usize = scene.objects.iter().map(|object| object.shapes.len()).sum();
    if read.len() != wanted {
        return Err(format!("{} shapes were read, {wanted} were written", read.len()).into());
    }
    for object in &scene.objects {
        let mut own: Vec<&Read> = read.iter().filter(|read| read.object == object.name).collect();
        for shape in &object.shapes {
            let expected = object.pose.around(&shape.pose);
            let matches = |read: &&Read| {
                let [a, b, c, d, e, f, g, h, i] = read.matrix;
                let rotation = from_matrix([[a, b, c], [d, e, f], [g, h, i]]);
                let pose = Pose::new(read.translation, rotation).unwrap_or_default();
                read.kind == shape.solid.kind().name()
                    && pose.is_near(&expected, TOLERANCE)
                    && read.size.len() == size(&shape.solid).len()
                    && read.size.iter().zip(size(&shape.solid)).all(|(a, b)| (a - b).abs() < TOLERANCE)
            };
            let Some(found) = own.iter().position(matches) else {
                return Err(format!("{}: nothing is read as {shape:?} at {expected:?}", object.name).into());
            };
            own.remove(found);
        }
    }
    Ok(())
}

fn python() -> Result<Python, Failed> {
    Python::find().ok_or_else(|| "there is no python3".into())
}

fn mujoco_reads() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let scene = scene(&mut Numbers(7));
    let file = write(folder.path(), "mjcf", "xml", &scene)?;
    let lines = python()?.run("mujoco_poses.py", &[&file])?;
    compare(&scene, &lines)?;
    // Masses, and what may move.
    for line in lines.lines() {
        let read: serde_json::Value = serde_json::from_str(line)?;
        let object = scene.objects.iter().find(|object| read["object"] == object.name).ok_or("an unknown body")?;
        if read["free"].as_bool() == Some(object.fixed) {
            return Err(format!("{} may move: {}", object.name, read["free"]).into());
        }
        if let Some(mass) =
            object.mass.filter(|mass| (read["mass"].as_f64().unwrap_or_default() - mass).abs() > TOLERANCE)
        {
            return Err(format!("{} weighs {} for MuJoCo, and should {mass}", object.name, read["mass"]).into());
        }
    }
    Ok(())
}

fn distances() -> Result<(), Failed> {
    const PAIRS: usize = 1000;
    let folder = tempfile::tempdir()?;
    let mut numbers = Numbers(11);
    let mut objects = Vec::new();
    for nth in 0..2 * PAIRS {
        let (pair, kinds) = (nth / 2, [nth / 2 % 3, nth / 6 % 3]);
        let solid = numbers.solid(kinds[nth % 2]);
        // Near enough to each other that about half of them overlap.
        let pose = numbers.pose(0.35);
        let name = format!("{pair}-{}", nth % 2);
        objects.push(Object {
            name,
            pose,
            shapes: vec![Shape::new(solid, Pose::IDENTITY)],
            fixed: true,
            ..Object::default()
        });
    }
    let scene = Scene { objects, ..Scene::default() };
    let file = write(folder.path(), "mjcf", "xml", &scene)?;
    let lines = python()?.run("mujoco_distances.py", &[&file])?;
    let theirs: Vec<f64> = lines.lines().map(str::parse).collect::<Result<_, _>>()?;
    let body = |nth: usize| Body::new(&scene.objects[nth].shapes[0], &scene.objects[nth].pose);
    let (mut worst, mut overlapping, mut wrong) = (0.0_f64, 0, Vec::new());
    for (pair, theirs) in theirs.iter().enumerate() {
        let ours = distance(&body(2 * pair), &body(2 * pair + 1));
        overlapping += usize::from(ours < 0.0);
        worst = worst.max((ours - theirs).abs());
        if (ours - theirs).abs() > 1e-5 {
            let kinds = [2 * pair, 2 * pair + 1].map(|nth| scene.objects[nth].shapes[0].solid.kind().name());
            wrong.push(format!("pair {pair} ({}): {ours}, MuJoCo {theirs}", kinds.join(", ")));
        }
    }
    if theirs.len() != PAIRS || !(300..700).contains(&overlapping) {
        return Err(format!("{} pairs, {overlapping} of them overlap", theirs.len()).into());
    }
    if !wrong.is_empty() {
        return Err(format!("{} differ, the worst by {worst}:\n{}", wrong.len(), wrong.join("\n")).into());
    }
    eprintln!("{PAIRS} pairs, {overlapping} of them overlap, differ by {worst:.1e} m at most");
    Ok(())
}

fn drake_reads(format: &str) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let mut scene = scene(&mut Numbers(13));
    if format == "urdf" {
        // Drake has no floating joints.
        scene.objects.iter_mut().for_each(|object| object.fixed = true);
    }
    let file = write(folder.path(), format, format, &scene)?;
    compare(&scene, &python()?.run("drake_poses.py", &[&file])?)
}

fn ros_accepts() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let mut scene = scene(&mut Numbers(17));
    scene.objects[3].attachment = Some(Attachment { link: "hand".to_owned(), touch: vec!["finger".to_owned()] });
    let file = write(folder.path(), "moveit-msg", "json", &scene)?;
    let lines = python()?.run("planning_scene.py", &[&file])?;
    let mut count = 0;
    for line in lines.lines() {
        let read: serde_json::Value = serde_json::from_str(line)?;
        let dimensions: Vec<f64> = serde_json::from_value(read["dimensions"].clone())?;
        let object = scene.objects.iter().find(|object| read["object"] == object.name).ok_or("an unknown object")?;
        let expected = |solid: &Solid| match solid {
            // Height before radius.
            Solid::Cylinder { radius, length } => (3, vec![*length, *radius]),
            Solid::Box(size) => (1, size.to_vec()),
            other => (2, size(other)),
        };
        let found = object.shapes.iter().any(|shape| {
            let (kind, size) = expected(&shape.solid);
            read["type"] == kind && size.iter().zip(&dimensions).all(|(a, b)| (a - b).abs() < TOLERANCE)
        });
        if !found || read["frame"] != "map" || read["attached"].as_bool() != Some(object.attachment.is_some()) {
            return Err(format!("no shape of {object:?} is {line}").into());
        }
        count += 1;
    }
    let wanted: usize = scene.objects.iter().map(|object| object.shapes.len()).sum();
    if count == wanted { Ok(()) } else { Err(format!("{count} of {wanted} shapes").into()) }
}

fn moveit_reads() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let mut scene = scene(&mut Numbers(19));
    scene.objects[0].shapes = vec![
        Shape::new(Solid::Cone { radius: 0.1, length: 0.3 }, Pose::IDENTITY),
        Shape::new(Solid::Plane { normal: [0.0, 0.6, 0.8], offset: 0.25 }, Pose::IDENTITY),
        Shape::new(
            Solid::Mesh(Mesh::Triangles(Triangles {
                vertices: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
                faces: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
            })),
            Pose::IDENTITY,
        ),
    ];
    scene.objects[1].name = "a name with blanks".to_owned();
    scene.objects[1].subframes = vec![("handle".to_owned(), Pose::IDENTITY)];
    let file = write(folder.path(), "moveit", "scene", &scene)?;
    let program = compile(folder.path(), "shapes.cpp", "geometric_shapes")?;
    let lines = run(&program, &[&file])?;
    let mut read = lines.lines().map(|line| line.split('\t').collect::<Vec<_>>());
    for object in &scene.objects {
        for shape in &object.shapes {
            let line = read.next().ok_or("too few shapes were read")?;
            let numbers: Vec<f64> = line[2..].iter().map(|number| number.parse()).collect::<Result<_, _>>()?;
            let expected = match &shape.solid {
                Solid::Cone { radius, length } => vec![*radius, *length],
                // ax + by + cz + d = 0
                Solid::Plane { normal: [a, b, c], offset } => vec![*a, *b, *c, -offset],
                Solid::Mesh(_) => vec![4.0, 4.0],
                solid => size(solid),
            };
            let apart: Vec<f64> = numbers.iter().zip(&expected).map(|(a, b)| a - b).collect();
            let same = line[0] == object.name && line[1] == shape.solid.kind().name();
            if !same || numbers.len() != expected.len() || norm(&apart) > TOLERANCE {
                return Err(format!("MoveIt reads {line:?} for {shape:?} of {}", object.name).into());
            }
        }
    }
    if read.next().is_some() { Err("too many shapes were read".into()) } else { Ok(()) }
}

fn sdformat_resolves() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let scene = scene(&mut Numbers(23));
    let file = write(folder.path(), "sdf", "sdf", &scene)?;
    let program = compile(folder.path(), "sdformat.cpp", "sdformat12")?;
    let lines = run(&program, &[&file])?;
    poses_are_those_of(&scene, &lines)
}

/// Lines of a name and a pose: x, y, z, and a quaternion x, y, z, w.
fn poses_are_those_of(scene: &Scene, lines: &str) -> Result<(), Failed> {
    let lines: Vec<Vec<&str>> = lines.lines().map(|line| line.split('\t').collect()).collect();
    if lines.len() != scene.objects.len() {
        return Err(format!("{} objects were read", lines.len()).into());
    }
    for (object, line) in scene.objects.iter().zip(&lines) {
        let numbers: Vec<f64> = line[1..].iter().map(|number| number.parse()).collect::<Result<_, _>>()?;
        let [x, y, z, rotation @ ..] = &numbers[..] else { return Err(format!("{line:?} is no pose").into()) };
        let pose = Pose::new([*x, *y, *z], rotation.try_into()?).unwrap_or_default();
        if line[0] != object.name || !pose.is_near(&object.pose, TOLERANCE) {
            return Err(format!("{line:?} is read for {object:?}").into());
        }
    }
    Ok(())
}

fn urdf_is_accepted() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let scene = scene(&mut Numbers(29));
    let file = write(folder.path(), "urdf", "urdf", &scene)?;
    let printed = run(Path::new("check_urdf"), &[&file])?;
    if printed.contains("Successfully Parsed XML") && printed.contains("root Link: map has 12 child(ren)") {
        return Ok(());
    }
    Err(printed.into())
}
