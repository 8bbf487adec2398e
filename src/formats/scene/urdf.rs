//! URDF, the robot description of ROS: a scene is a robot whose root link is the frame.
//!
//! Sizes are full, angles are roll, pitch and yaw in radians, and there are no quaternions. Each object is
//! a link with a joint to the root: `fixed` where it never moves, else `floating`. Source: the URDF XML
//! specification of ROS.

use std::collections::HashMap;
use std::fmt::Write as _;

use super::inertia::inertia;
use super::number::{number, numbers};
use super::pose::from_rpy;
use super::xml::{self, Element, check_names, escape};
use super::{Color, Content, Kind, Limits, Mass, Mesh, Model, Object, Pose, Scene, Shape, Solid, Spelling};
use crate::formats::{Diagnostic, Source};

/// URDF.
pub const SPELLING: Spelling = Spelling {
    name: "urdf",
    limits: Limits {
        kinds: &[Kind::Box, Kind::Sphere, Kind::Cylinder, Kind::MeshFile],
        name: true,
        frame: true,
        framed: true,
        color: Color::Shape,
        mass: Mass::All,
        fixed: true,
        attachment: false,
        subframes: false,
        model: Model::None,
        empty: true,
        grouped: false,
    },
    fits: check_names,
    write,
    read,
    recognizes: |text| xml::root(text) == Some("robot"),
};

fn write(scene: &Scene) -> String {
    let frame = escape(scene.frame.as_deref().unwrap_or("world"));
    let mut text = String::from("<?xml version=\"1.0\"?>\n");
    let _ = writeln!(text, "<robot name=\"{}\">", escape(scene.name.as_deref().unwrap_or("scene")));
    let _ = writeln!(text, "  <link name=\"{frame}\"/>");
    for object in &scene.objects {
        link(object, &mut text);
        let name = escape(&object.name);
        let kind = if object.fixed { "fixed" } else { "floating" };
        let _ = writeln!(text, "  <joint name=\"{name}_joint\" type=\"{kind}\">");
        let _ = writeln!(text, "    <parent link=\"{frame}\"/>\n    <child link=\"{name}\"/>");
        let _ = writeln!(text, "    {}\n  </joint>", origin(&object.pose));
    }
    text.push_str("</robot>\n");
    text
}

fn link(object: &Object, text: &mut String) {
    let _ = writeln!(text, "  <link name=\"{}\">", escape(&object.name));
    if let Some(mass) = object.mass {
        let inertia = inertia(object, mass);
        let center = origin(&Pose { translation: inertia.center, ..Pose::IDENTITY });
        let names = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"];
        let moments = names.iter().zip(inertia.moments).map(|(name, moment)| format!(" {name}=\"{}\"", number(moment)));
        let moments: String = moments.collect();
        let _ =
            writeln!(text, "    <inertial>{center}<mass value=\"{}\"/><inertia{moments}/></inertial>", number(mass));
    }
    for (index, shape) in object.shapes.iter().enumerate() {
        let (origin, geometry) = (origin(&shape.pose), geometry(&shape.solid));
        let _ = writeln!(text, "    <collision>{origin}{geometry}</collision>");
        let material = shape.color.map(|color| {
            let name = escape(&format!("{}_{index}", object.name));
            format!("<material name=\"{name}\"><color rgba=\"{}\"/></material>", numbers(&color))
        });
        let _ = writeln!(text, "    <visual>{origin}{geometry}{}</visual>", material.unwrap_or_default());
    }
    text.push_str("  </link>\n");
}

fn origin(pose: &Pose) -> String {
    format!("<origin xyz=\"{}\" rpy=\"{}\"/>", numbers(&pose.translation), numbers(&pose.rpy()))
}

fn geometry(solid: &Solid) -> String {
    let kind = match solid {
        Solid::Box(size) => format!("<box size=\"{}\"/>", numbers(size)),
        Solid::Sphere(radius) => format!("<sphere radius=\"{}\"/>", number(*radius)),
        Solid::Cylinder { radius, length } | Solid::Cone { radius, length } => {
            format!("<cylinder radius=\"{}\" length=\"{}\"/>", number(*radius), number(*length))
        }
        Solid::Mesh(Mesh::File { file, scale }) => {
            format!("<mesh filename=\"{}\" scale=\"{}\"/>", escape(file), numbers(scale))
        }
        // `check` lets none come here.
        Solid::Plane { .. } | Solid::Mesh(Mesh::Triangles(_)) => String::new(),
    };
    format!("<geometry>{kind}</geometry>")
}

/// A joint: where a link is in its parent.
struct Joint<'a> {
    parent: &'a str,
    pose: Pose,
    fixed: bool,
}

/// Elements of simulators and drivers, which the reader of ROS passes over, too.
const IGNORED: [&str; 12] = [
    "gazebo",
    "transmission",
    "ros2_control",
    "sensor",
    "frame",
    "contact",
    "contact_coefficients",
    "collision_filter_group",
    "force_element",
    "self_collision_checking",
    "mujoco",
    "plugin",
];

/// Elements of joints that say how one moves, and not where it is.
const OF_JOINTS: [&str; 6] = ["axis", "limit", "dynamics", "safety_controller", "calibration", "mimic"];

fn read(source: &Source) -> Result<Content, Diagnostic> {
    xml::parse(source, |root| {
        if root.name() != "robot" {
            return Err(root.wrong("expected <robot>"));
        }
        root.only(&["link", "joint", "material"], &IGNORED)?;
        let mut materials = HashMap::new();
        for material in root.children().filter(|child| child.name() == "material") {
            materials.extend(color(material)?.map(|color| (material.attribute("name").unwrap_or_default(), color)));
        }
        let mut joints: HashMap<&str, Joint<'_>> = HashMap::new();
        for element in root.children().filter(|child| child.name() == "joint") {
            let (child, joint) = read_joint(element)?;
            if joints.insert(child, joint).is_some() {
                return Err(element.wrong(format!("the link `{child}` has two joints above it")));
            }
        }
        let mut scene = Scene { name: root.attribute("name").map(str::to_owned), ..Scene::default() };
        let links = || root.children().filter(|child| child.name() == "link");
        if links().next().is_none() {
            return Err(without_links(root));
        }
        let tops: Vec<&str> =
            links().filter_map(|link| link.attribute("name")).filter(|name| !joints.contains_key(name)).collect();
        let [top] = tops[..] else {
            return Err(root.wrong(format!("expected one link without a joint above it, found {}", tops.len())));
        };
        scene.frame = Some(top.to_owned());
        for link in links() {
            let mut object = read_link(link, &materials)?;
            if object.name == top && object.shapes.is_empty() {
                continue;
            }
            (object.pose, object.fixed) =
                placed(&object.name, &joints).ok_or_else(|| link.wrong("its joints lead to no root link"))?;
            scene.objects.push(object);
        }
        Ok(Content::Scene(scene))
    })
}

fn without_links(root: Element<'_>) -> Diagnostic {
    let wrong = root.wrong("a robot without links; expected one at least, which is the frame");
    if root.is_of_xacro() {
        return wrong.hint("run `xacro FILE > robot.urdf` on the file that uses the macros of this one");
    }
    wrong
}

fn read_joint<'a>(element: Element<'a>) -> Result<(&'a str, Joint<'a>), Diagnostic> {
    let kind = element.needs_attribute("type")?;
    let fixed = match kind {
        "fixed" => true,
        "floating" => false,
        other => {
            return Err(element.wrong_attribute(
                "type",
                format!("a scene has no joints of the type `{other}`; expected fixed or floating"),
            ));
        }
    };
    element.only(&["origin", "parent", "child"], &[&IGNORED[..], &OF_JOINTS].concat())?;
    let parent = element.needs("parent")?.needs_attribute("link")?;
    let child = element.needs("child")?.needs_attribute("link")?;
    Ok((child, Joint { parent, pose: read_origin(element)?, fixed }))
}

/// Where a link is in the root, and whether all joints on the way are fixed.
fn placed(name: &str, joints: &HashMap<&str, Joint<'_>>) -> Option<(Pose, bool)> {
    let (mut pose, mut fixed, mut link) = (Pose::IDENTITY, true, name);
    for _ in 0..=joints.len() {
        let Some(joint) = joints.get(link) else { return Some((pose, fixed)) };
        pose = joint.pose.around(&pose);
        (fixed, link) = (fixed && joint.fixed, joint.parent);
    }
    None
}

fn read_link(link: Element<'_>, materials: &HashMap<&str, [f64; 4]>) -> Result<Object, Diagnostic> {
    link.only(&["inertial", "collision", "visual"], &IGNORED)?;
    let mut object = Object { name: link.needs_attribute("name")?.to_owned(), ..Object::default() };
    if let Some(inertial) = link.child("inertial") {
        let mass = inertial.needs("mass")?;
        object.mass = mass.numbers("value")?.map(|[value]| mass.mass(value)).transpose()?;
    }
    let all = |name: &'static str| link.children().filter(move |child| child.name() == name);
    let visuals: Vec<_> = all("visual").collect();
    let collisions: Vec<_> = all("collision").collect();
    // Visuals are used as collisions only where there are no collisions.
    let bodies = if collisions.is_empty() { &visuals } else { &collisions };
    for (index, body) in bodies.iter().enumerate() {
        let mut shape = read_shape(*body)?;
        if let Some(material) = visuals.get(index).and_then(|visual| visual.child("material")) {
            let named = || material.attribute("name").and_then(|name| materials.get(name).copied());
            shape.color = color(material)?.or_else(named);
        }
        object.shapes.push(shape);
    }
    Ok(object)
}

fn color(material: Element<'_>) -> Result<Option<[f64; 4]>, Diagnostic> {
    let Some(color) = material.child("color") else { return Ok(None) };
    color.numbers("rgba")?.map(|rgba| color.color(rgba)).transpose()
}

fn read_shape(body: Element<'_>) -> Result<Shape, Diagnostic> {
    body.only(&["origin", "geometry"], &["material", "verbose", "contact_coefficients"])?;
    let pose = read_origin(body)?;
    let geometry = body.needs("geometry")?;
    geometry.only(&["box", "sphere", "cylinder", "mesh"], &[])?;
    let kind = geometry.children().next().ok_or_else(|| geometry.wrong("<geometry> has no shape"))?;
    let one = |name: &str| {
        kind.needs_attribute(name)?;
        kind.numbers::<1>(name).map(|number| number.map_or(0.0, |[number]| number))
    };
    let solid = match kind.name() {
        "box" => {
            kind.needs_attribute("size")?;
            Solid::Box(kind.numbers("size")?.unwrap_or_default())
        }
        "sphere" => Solid::Sphere(one("radius")?),
        "cylinder" => Solid::Cylinder { radius: one("radius")?, length: one("length")? },
        _ => Solid::Mesh(Mesh::File {
            file: kind.needs_attribute("filename")?.to_owned(),
            scale: kind.numbers("scale")?.unwrap_or([1.0; 3]),
        }),
    };
    solid.check().map_err(|wrong| kind.wrong(format!("a {} that {wrong}", solid.kind().name())))?;
    Ok(Shape::new(solid, pose))
}

/// The pose in `<origin>`; without one, that of the element around.
fn read_origin(element: Element<'_>) -> Result<Pose, Diagnostic> {
    let Some(origin) = element.child("origin") else { return Ok(Pose::IDENTITY) };
    origin.only_attributes(&["xyz", "rpy"])?;
    let angles = origin.numbers("rpy")?.unwrap_or_default();
    origin.pose(origin.numbers("xyz")?.unwrap_or_default(), from_rpy(angles))
}
