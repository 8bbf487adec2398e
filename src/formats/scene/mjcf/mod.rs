//! MuJoCo's MJCF.
//!
//! Quaternions are w, x, y, z. Sizes of boxes and lengths of cylinders are *half*. A cylinder's axis
//! is z. An angle in an `axisangle` or `euler` is in degrees unless `<compiler angle="radian"/>`.
//! What may move has a `<freejoint/>`. The scene's frame is noted in `<custom>`, which MuJoCo keeps
//! and does not read. Source: the XML reference of MuJoCo's documentation.

mod compiler;
mod defaults;

use std::collections::HashMap;
use std::fmt::Write as _;

use super::inertia::masses;
use super::number::numbers;
use super::pose::{cross, dot, from_axis, from_matrix, from_z_to, norm, sub};
use super::shape::{Mesh, Triangles};
use super::xml::{self, Element, check_names, escape};
use super::{Color, Content, Kind, Limits, Mass, Model, Object, Pose, Scene, Shape, Solid, Spelling};
use crate::formats::{Diagnostic, Source};
use compiler::Compiler;

/// MJCF.
pub const SPELLING: Spelling = Spelling {
    name: "mjcf",
    limits: Limits {
        kinds: &[Kind::Box, Kind::Sphere, Kind::Cylinder, Kind::Plane, Kind::MeshFile, Kind::Triangles],
        name: true,
        frame: true,
        framed: false,
        color: Color::Shape,
        mass: Mass::All,
        fixed: true,
        attachment: false,
        subframes: false,
        model: Model::None,
        empty: false,
        grouped: false,
    },
    fits,
    write,
    read,
    recognizes: |text| xml::root(text) == Some("mujoco"),
};

fn fits(object: &Object) -> Result<(), String> {
    check_names(object)?;
    if object.name == "world" {
        return Err("its name is `world`, which is that of MuJoCo's own body; give it another".to_owned());
    }
    if object.mass.is_some() && object.has_plane() {
        return Err("it has a mass and a plane, which mjcf does not weigh".to_owned());
    }
    Ok(())
}

fn write(scene: &Scene) -> String {
    let (mut assets, mut bodies) = (String::new(), String::new());
    for object in &scene.objects {
        body(object, &mut assets, &mut bodies);
    }
    let mut text = format!("<mujoco model=\"{}\">\n", escape(scene.name.as_deref().unwrap_or("scene")));
    if let Some(frame) = &scene.frame {
        let _ = writeln!(text, "  <custom>\n    <text name=\"frame\" data=\"{}\"/>\n  </custom>", escape(frame));
    }
    if !assets.is_empty() {
        let _ = writeln!(text, "  <asset>\n{assets}  </asset>");
    }
    let _ = write!(text, "  <worldbody>\n{bodies}  </worldbody>\n</mujoco>\n");
    text
}

fn body(object: &Object, assets: &mut String, bodies: &mut String) {
    let name = escape(&object.name);
    let _ = writeln!(bodies, "    <body name=\"{name}\"{}>", place(&object.pose));
    if !object.fixed {
        bodies.push_str("      <freejoint/>\n");
    }
    let masses = object.mass.map(|mass| masses(object, mass));
    for (index, shape) in object.shapes.iter().enumerate() {
        let (kind, pose) = geom(object, index, shape, assets);
        let _ = write!(bodies, "      <geom {kind}{}", place(&pose));
        if let Some(masses) = &masses {
            let _ = write!(bodies, " mass=\"{}\"", super::number::number(masses[index]));
        }
        if let Some(color) = shape.color {
            let _ = write!(bodies, " rgba=\"{}\"", numbers(&color));
        }
        bodies.push_str("/>\n");
    }
    bodies.push_str("    </body>\n");
}

/// The attributes of a pose; none where it is that of the frame around.
fn place(pose: &Pose) -> String {
    let mut text = String::new();
    if pose.translation != [0.0; 3] {
        let _ = write!(text, " pos=\"{}\"", numbers(&pose.translation));
    }
    let [x, y, z, w] = pose.rotation;
    if pose.rotation != Pose::IDENTITY.rotation {
        let _ = write!(text, " quat=\"{}\"", numbers(&[w, x, y, z]));
    }
    text
}

fn geom(object: &Object, index: usize, shape: &Shape, assets: &mut String) -> (String, Pose) {
    let half = |size: &[f64]| numbers(&size.iter().map(|length| length / 2.0).collect::<Vec<_>>());
    let plain = |text: String| (text, shape.pose);
    match &shape.solid {
        Solid::Box(size) => plain(format!("type=\"box\" size=\"{}\"", half(size))),
        Solid::Sphere(radius) => plain(format!("type=\"sphere\" size=\"{}\"", super::number::number(*radius))),
        Solid::Cylinder { radius, length } => {
            plain(format!("type=\"cylinder\" size=\"{}\"", numbers(&[*radius, length / 2.0])))
        }
        // `check` lets no cone come here.
        Solid::Cone { radius, length } => {
            plain(format!("type=\"cylinder\" size=\"{}\"", numbers(&[*radius, length / 2.0])))
        }
        Solid::Plane { normal, offset } => {
            let pose = Pose { translation: normal.map(|part| part * offset), rotation: from_z_to(*normal) };
            // Without bounds, a line of the grid each metre.
            ("type=\"plane\" size=\"0 0 1\"".to_owned(), pose)
        }
        Solid::Mesh(mesh) => {
            let name = escape(&format!("{}/{index}", object.name));
            let _ = match mesh {
                Mesh::File { file, scale } => {
                    writeln!(
                        assets,
                        "    <mesh name=\"{name}\" file=\"{}\" scale=\"{}\"/>",
                        escape(file),
                        numbers(scale)
                    )
                }
                Mesh::Triangles(Triangles { vertices, faces }) => {
                    let faces: Vec<String> = faces.as_flattened().iter().map(usize::to_string).collect();
                    let vertices = numbers(vertices.as_flattened());
                    writeln!(assets, "    <mesh name=\"{name}\" vertex=\"{vertices}\" face=\"{}\"/>", faces.join(" "))
                }
            };
            plain(format!("type=\"mesh\" mesh=\"{name}\""))
        }
    }
}

/// Elements that say nothing about where things are.
const IGNORED: [&str; 10] =
    ["option", "visual", "statistic", "size", "contact", "actuator", "tendon", "sensor", "keyframe", "light"];

fn read(source: &Source) -> Result<Content, Diagnostic> {
    xml::parse(source, |root| {
        if root.name() != "mujoco" {
            return Err(root.wrong("expected <mujoco>"));
        }
        root.only(&["compiler", "default", "custom", "asset", "worldbody"], &IGNORED)?;
        let mut reader = Reader { compiler: Compiler::default(), meshes: HashMap::new(), classes: false };
        for compiler in root.children().filter(|child| child.name() == "compiler") {
            reader.compiler.read(compiler)?;
        }
        for default in root.children().filter(|child| child.name() == "default") {
            defaults::check(default)?;
            reader.classes = true;
        }
        for asset in root.children().filter(|child| child.name() == "asset") {
            reader.assets(asset)?;
        }
        let mut scene = Scene { name: root.attribute("model").map(str::to_owned), ..Scene::default() };
        for custom in root.children().filter(|child| child.name() == "custom") {
            let text =
                custom.children().find(|child| child.name() == "text" && child.attribute("name") == Some("frame"));
            scene.frame = text.and_then(|text| text.attribute("data")).map(str::to_owned).or(scene.frame);
        }
        for world in root.children().filter(|child| child.name() == "worldbody") {
            world.only(&["body", "geom"], &["light", "camera", "site"])?;
            reader.bodies(world, &Pose::IDENTITY, &mut scene)?;
        }
        Ok(Content::Scene(scene))
    })
}

/// What holds for the whole file.
struct Reader {
    compiler: Compiler,
    meshes: HashMap<String, Mesh>,
    /// Whether it has defaults, which then change nothing.
    classes: bool,
}

impl Reader {
    fn assets(&mut self, assets: Element<'_>) -> Result<(), Diagnostic> {
        assets.only(&["mesh"], &["texture", "material"])?;
        for mesh in assets.children().filter(|child| child.name() == "mesh") {
            let ignored = ["normal", "texcoord", "smoothnormal", "inertia", "maxhullvert"];
            mesh.only_attributes(&[&["name", "file", "scale", "vertex", "face"][..], &ignored].concat())?;
            let scale = mesh.numbers("scale")?.unwrap_or([1.0; 3]);
            let file = mesh.attribute("file");
            let stem = || file.and_then(|file| std::path::Path::new(file).file_stem()?.to_str());
            let name = mesh.attribute("name").or_else(stem).ok_or_else(|| mesh.wrong("<mesh> has no `name`"))?;
            let read = match file {
                Some(file) => Mesh::File { file: self.compiler.file(file), scale },
                None => Mesh::Triangles(triangles(mesh, scale)?),
            };
            Solid::Mesh(read.clone()).check().map_err(|wrong| mesh.wrong(format!("this mesh {wrong}")))?;
            self.meshes.insert(name.to_owned(), read);
        }
        Ok(())
    }

    fn bodies(&self, parent: Element<'_>, around: &Pose, scene: &mut Scene) -> Result<(), Diagnostic> {
        for child in parent.children() {
            match child.name() {
                "body" => self.body(child, around, scene)?,
                "geom" if parent.name() == "worldbody" => {
                    let (shape, mass) = self.geom(child)?;
                    let name =
                        child.attribute("name").map_or_else(|| format!("geom{}", scene.objects.len()), str::to_owned);
                    let (pose, shape) = alone(shape);
                    let object = Object { name, pose, shapes: vec![shape], mass, fixed: true, ..Object::default() };
                    scene.objects.push(object);
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn body(&self, body: Element<'_>, around: &Pose, scene: &mut Scene) -> Result<(), Diagnostic> {
        body.only(&["body", "geom", "freejoint", "joint", "inertial"], &["site", "camera", "light"])?;
        let pose = around.around(&self.pose(body)?);
        let name = body.needs_attribute("name")?.to_owned();
        let mut object = Object { name, pose, fixed: true, ..Object::default() };
        let (mut weights, mut inertial) = (Vec::new(), None);
        for child in body.children() {
            match child.name() {
                "geom" => {
                    let (shape, mass) = self.geom(child)?;
                    object.shapes.push(shape);
                    weights.extend(mass);
                }
                "freejoint" => object.fixed = false,
                "joint" if child.attribute("type") == Some("free") => object.fixed = false,
                "joint" => return Err(child.wrong("a scene has no joints but free ones; expected <freejoint/>")),
                "inertial" => inertial = child.numbers("mass")?.map(|[mass]| child.mass(mass)).transpose()?,
                _ => {}
            }
        }
        object.mass = self.compiler.mass(inertial, &weights);
        object.fixed |= object.has_plane();
        scene.objects.push(object);
        self.bodies(body, &pose, scene)
    }

    fn geom(&self, geom: Element<'_>) -> Result<(Shape, Option<f64>), Diagnostic> {
        let known = [
            "type",
            "size",
            "pos",
            "quat",
            "axisangle",
            "euler",
            "xyaxes",
            "zaxis",
            "fromto",
            "rgba",
            "mass",
            "name",
            "mesh",
            "material",
            "class",
            "group",
            "contype",
            "conaffinity",
            "condim",
            "friction",
            "solref",
            "solimp",
            "margin",
            "gap",
            "density",
            "priority",
            "solmix",
            "fluidshape",
            "fluidcoef",
            "user",
        ];
        geom.only_attributes(&known)?;
        if geom.attribute("class").is_some() && !self.classes {
            return Err(geom.wrong_attribute("class", "there is no <default>; give the geom its own attributes"));
        }
        let (mut pose, mut size) = (self.pose(geom)?, geom.list("size")?);
        if let Some(ends) = geom.numbers::<6>("fromto")? {
            let [a, b, c, d, e, f] = ends;
            let (from, to) = ([a, b, c], [d, e, f]);
            let along = sub(to, from);
            if norm(&along) == 0.0 {
                return Err(geom.wrong_attribute("fromto", "both ends are one point"));
            }
            // MuJoCo's z axis leads from the second point to the first.
            pose = Pose {
                translation: [(a + d) / 2.0, (b + e) / 2.0, (c + f) / 2.0],
                rotation: from_z_to(along.map(|part| -part)),
            };
            size.truncate(1);
            size.push(norm(&along) / 2.0);
        }
        let solid = self.solid(geom, &size)?;
        solid.check().map_err(|wrong| geom.wrong(format!("a {} that {wrong}", solid.kind().name())))?;
        // A geom without a mass of its own has the mass 0.
        let mass = geom.numbers::<1>("mass")?.map(|[mass]| mass).filter(|mass| *mass != 0.0);
        let mass = mass.map(|mass| geom.mass(mass)).transpose()?;
        let color = geom.numbers("rgba")?.map(|color| geom.color(color)).transpose()?;
        Ok((Shape { color, ..Shape::new(solid, pose) }, mass))
    }

    fn solid(&self, geom: Element<'_>, size: &[f64]) -> Result<Solid, Diagnostic> {
        let kind = geom.attribute("type").unwrap_or(if geom.attribute("mesh").is_some() { "mesh" } else { "sphere" });
        let wrong = |expected: &str| geom.wrong_attribute("size", format!("a {kind} has {expected} in `size`"));
        match (kind, size) {
            ("box", [x, y, z]) => Ok(Solid::Box([x * 2.0, y * 2.0, z * 2.0])),
            ("box", _) => Err(wrong("three half lengths")),
            ("sphere", [radius, ..]) => Ok(Solid::Sphere(*radius)),
            ("sphere", _) => Err(wrong("a radius")),
            ("cylinder", [radius, half, ..]) => Ok(Solid::Cylinder { radius: *radius, length: half * 2.0 }),
            ("cylinder", _) => Err(wrong("a radius and a half length")),
            ("plane", _) => Ok(Solid::Plane { normal: [0.0, 0.0, 1.0], offset: 0.0 }),
            ("mesh", _) => {
                let name = geom.needs_attribute("mesh")?;
                let found = self.meshes.get(name);
                found
                    .map(|mesh| Solid::Mesh(mesh.clone()))
                    .ok_or_else(|| geom.wrong_attribute("mesh", format!("there is no <mesh> `{name}`")))
            }
            (other, _) => Err(geom.wrong_attribute(
                "type",
                format!("unknown geometry `{other}`; expected box, sphere, cylinder, plane or mesh"),
            )),
        }
    }

    /// `pos` and one of the spellings of an orientation.
    fn pose(&self, element: Element<'_>) -> Result<Pose, Diagnostic> {
        let translation = element.numbers("pos")?.unwrap_or_default();
        let spellings = ["quat", "axisangle", "euler", "xyaxes", "zaxis"];
        let mut given = spellings.into_iter().filter(|name| element.attribute(name).is_some());
        let (first, second) = (given.next(), given.next());
        if let Some(second) = second {
            return Err(element.wrong_attribute(second, "there are two orientations; expected one"));
        }
        let rotation = match first {
            Some("quat") => {
                let [w, x, y, z] = element.numbers("quat")?.unwrap_or_default();
                [x, y, z, w]
            }
            Some("axisangle") => {
                let [x, y, z, angle] = element.numbers("axisangle")?.unwrap_or_default();
                from_axis([x, y, z], self.compiler.radians(angle))
            }
            Some("euler") => self.compiler.turned(element.numbers("euler")?.unwrap_or_default()),
            Some("xyaxes") => {
                let [a, b, c, d, e, f] = element.numbers("xyaxes")?.unwrap_or_default();
                axes([a, b, c], [d, e, f])
                    .ok_or_else(|| element.wrong_attribute("xyaxes", "these are not two directions"))?
            }
            Some("zaxis") => {
                let axis: [f64; 3] = element.numbers("zaxis")?.unwrap_or_default();
                if norm(&axis) == 0.0 {
                    return Err(element.wrong_attribute("zaxis", "this is not a direction"));
                }
                from_z_to(axis)
            }
            _ => Pose::IDENTITY.rotation,
        };
        element.pose(translation, rotation)
    }
}

/// The orientation of a frame with these directions as x and, nearly, y.
fn axes(x: [f64; 3], y: [f64; 3]) -> Option<[f64; 4]> {
    let unit = |vector: [f64; 3]| (norm(&vector) > 1e-9).then(|| vector.map(|part| part / norm(&vector)));
    let x = unit(x)?;
    let across = dot(x, y);
    let y = unit(sub(y, x.map(|part| part * across)))?;
    let z = cross(x, y);
    Some(from_matrix([[x[0], y[0], z[0]], [x[1], y[1], z[1]], [x[2], y[2], z[2]]]))
}

/// A shape of the world as an object at its place; a plane stays where it is.
fn alone(shape: Shape) -> (Pose, Shape) {
    let pose = shape.pose;
    (pose, Shape { pose: Pose::IDENTITY, ..shape })
}

fn triangles(mesh: Element<'_>, scale: [f64; 3]) -> Result<Triangles, Diagnostic> {
    let (vertices, faces) = (mesh.list("vertex")?, mesh.list("face")?);
    if vertices.len() % 3 != 0 || faces.len() % 3 != 0 || vertices.is_empty() {
        return Err(mesh.wrong("expected `file`, or `vertex` and `face` with three numbers each"));
    }
    let (rows, _) = vertices.as_chunks::<3>();
    let vertices = rows.iter().map(|[x, y, z]| [x * scale[0], y * scale[1], z * scale[2]]).collect();
    let (rows, _) = faces.as_chunks::<3>();
    let index = |number: f64| (number >= 0.0 && number.fract() == 0.0).then_some(number as usize);
    let face = |[a, b, c]: &[f64; 3]| Some([index(*a)?, index(*b)?, index(*c)?]);
    let faces: Option<Vec<_>> = rows.iter().map(face).collect();
    Ok(Triangles {
        vertices,
        faces: faces.ok_or_else(|| mesh.wrong_attribute("face", "expected indices of vertices"))?,
    })
}
