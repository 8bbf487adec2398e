//! OpenRAVE's environments: the format of the robot memory's first motion planner.
//!
//! Quaternions are w, x, y, z, and `<rotationaxis>` is an axis and an angle in *degrees*. `<extents>` of a
//! box are *half*. A cylinder's axis is *y*. Rotations of one element premultiply each other and
//! translations add up; one of each is unambiguous, and that is what is written. Names of elements are
//! read in any case. Source: the custom XML format of OpenRAVE's documentation.

use std::fmt::Write as _;

use super::number::{number, numbers};
use super::pose::{from_axis, from_matrix, multiply};
use super::xml::{self, Element, check_names, escape};
use super::{Color, Content, Kind, Limits, Mass, Mesh, Model, Object, Pose, Scene, Shape, Solid, Spelling};
use crate::formats::{Diagnostic, Source};

/// OpenRAVE's XML.
pub const SPELLING: Spelling = Spelling {
    name: "openrave",
    limits: Limits {
        kinds: &[Kind::Box, Kind::Sphere, Kind::Cylinder, Kind::MeshFile],
        name: false,
        frame: false,
        framed: false,
        color: Color::Shape,
        mass: Mass::All,
        fixed: true,
        attachment: false,
        subframes: false,
        model: Model::Instead,
        empty: false,
        grouped: false,
    },
    fits,
    write,
    read,
    recognizes: |text| {
        xml::root(text).is_some_and(|root| ["environment", "kinbody"].contains(&root.to_ascii_lowercase().as_str()))
    },
};

fn fits(object: &Object) -> Result<(), String> {
    check_names(object)?;
    if object.name.chars().any(|c| c <= ' ' || c == '\u{7f}') {
        return Err(format!(
            "its name `{}` has a blank, which names of openrave cannot have; give it another",
            object.name.escape_debug()
        ));
    }
    let file = |shape: &Shape| match &shape.solid {
        Solid::Mesh(Mesh::File { file, .. }) => file.contains(char::is_whitespace),
        _ => false,
    };
    if object.shapes.iter().any(file) {
        return Err("its mesh has a file with a blank in its name, which openrave takes as the end of it".to_owned());
    }
    Ok(())
}

/// The turn that takes the y axis of OpenRAVE's cylinders to z.
const UPRIGHT: [f64; 4] = [std::f64::consts::FRAC_1_SQRT_2, 0.0, 0.0, std::f64::consts::FRAC_1_SQRT_2];

fn write(scene: &Scene) -> String {
    let mut text = String::from("<Environment>\n");
    for object in &scene.objects {
        let model = object.model.as_ref().map(|model| format!(" file=\"{}\"", escape(model))).unwrap_or_default();
        let _ = writeln!(text, "  <KinBody name=\"{}\"{model}>", escape(&object.name));
        place(&object.pose, "    ", &mut text);
        // A file describes the body; shapes beside it would be there twice.
        if object.model.is_none() {
            body(object, &mut text);
        }
        text.push_str("  </KinBody>\n");
    }
    text.push_str("</Environment>\n");
    text
}

fn body(object: &Object, text: &mut String) {
    let kind = if object.fixed { "static" } else { "dynamic" };
    let _ = writeln!(text, "    <Body name=\"base\" type=\"{kind}\">");
    if let Some(mass) = object.mass {
        let _ = writeln!(text, "      <Mass type=\"custom\"><total>{}</total></Mass>", number(mass));
    }
    for shape in &object.shapes {
        geom(shape, text);
    }
    text.push_str("    </Body>\n");
}

fn place(pose: &Pose, indent: &str, text: &mut String) {
    let [x, y, z, w] = pose.rotation;
    let _ = writeln!(text, "{indent}<Translation>{}</Translation>", numbers(&pose.translation));
    let _ = writeln!(text, "{indent}<Quat>{}</Quat>", numbers(&[w, x, y, z]));
}

fn geom(shape: &Shape, text: &mut String) {
    let (kind, lines, turn) = match &shape.solid {
        Solid::Box(size) => ("box", format!("<Extents>{}</Extents>", numbers(&size.map(|length| length / 2.0))), None),
        Solid::Sphere(radius) => ("sphere", format!("<Radius>{}</Radius>", number(*radius)), None),
        Solid::Cylinder { radius, length } | Solid::Cone { radius, length } => {
            let lines = format!("<Radius>{}</Radius><Height>{}</Height>", number(*radius), number(*length));
            ("cylinder", lines, Some(UPRIGHT))
        }
        Solid::Mesh(Mesh::File { file, scale }) => {
            ("trimesh", format!("<Data>{} {}</Data>", escape(file), numbers(scale)), None)
        }
        // `check` lets none come here.
        Solid::Plane { .. } | Solid::Mesh(Mesh::Triangles(_)) => return,
    };
    let _ = writeln!(text, "      <Geom type=\"{kind}\">");
    let rotation = turn.map_or(shape.pose.rotation, |turn| multiply(shape.pose.rotation, turn));
    place(&Pose { rotation, ..shape.pose }, "        ", text);
    let _ = writeln!(text, "        {lines}");
    if let Some([r, g, b, a]) = shape.color {
        let _ = writeln!(text, "        <DiffuseColor>{}</DiffuseColor>", numbers(&[r, g, b]));
        let _ = writeln!(text, "        <Transparency>{}</Transparency>", number(1.0 - a));
    }
    text.push_str("      </Geom>\n");
}

/// Elements that say nothing about where things are.
const IGNORED: [&str; 9] = [
    "camtrans",
    "camrotaxis",
    "camrotationaxis",
    "camrotmat",
    "camfocal",
    "bkgndcolor",
    "plugin",
    "ambientcolor",
    "adjacent",
];

/// Elements of an environment that are about its simulation.
const SIMULATED: [&str; 3] = ["physicsengine", "modelsdir", "datadir"];

/// Elements that place what they are in.
const PLACES: [&str; 4] = ["translation", "quat", "rotationaxis", "rotationmat"];

fn read(source: &Source) -> Result<Content, Diagnostic> {
    xml::parse(source, |root| {
        let mut scene = Scene::default();
        match lower(root).as_str() {
            "kinbody" => scene.objects.push(kinbody(root)?),
            "environment" => {
                root.only(&["kinbody", "robot", "unit"], &[&IGNORED[..], &SIMULATED].concat())?;
                no_other_files(root)?;
                for child in root.children() {
                    match lower(child).as_str() {
                        "kinbody" => scene.objects.push(kinbody(child)?),
                        "robot" => scene.robots.push(robot(child)),
                        "unit" => metres(child)?,
                        _ => {}
                    }
                }
            }
            _ => return Err(root.wrong("expected <Environment> or <KinBody>")),
        }
        Ok(Content::Scene(scene))
    })
}

fn lower(element: Element<'_>) -> String {
    element.name().to_ascii_lowercase()
}

/// What a robot is called: by its name, or the file that it is in.
fn robot(element: Element<'_>) -> String {
    let name = element.attribute("name").or_else(|| element.attribute("file"));
    name.unwrap_or("without a name").to_owned()
}

fn metres(unit: Element<'_>) -> Result<(), Diagnostic> {
    let words: Vec<&str> = unit.text().split_whitespace().collect();
    match words[..] {
        ["meter" | "m"] | ["meter" | "m", "1" | "1.0"] => Ok(()),
        _ => Err(unit.wrong(format!("lengths in `{}`; expected metres: <unit>meter 1.0</unit>", unit.text()))),
    }
}

/// Refuses what OpenRAVE would take from another file, and what changes its size.
fn no_other_files(element: Element<'_>) -> Result<(), Diagnostic> {
    if let Some(file) = element.attribute("file") {
        let message = format!("<{}> includes the file `{file}`, which is not read", element.name());
        let hint = "write what it has here in its place; only a <KinBody> may name a file, as its model";
        return Err(element.wrong_attribute("file", message).hint(hint));
    }
    as_large_as_it_says(element)
}

/// Refuses attributes that change the shapes of the element.
fn as_large_as_it_says(element: Element<'_>) -> Result<(), Diagnostic> {
    match ["scalegeometry", "skipgeometry"].into_iter().find(|name| element.attribute(name).is_some()) {
        None => Ok(()),
        Some(name) => Err(element
            .wrong_attribute(name, format!("`{name}` of <{}> changes shapes, and is not read", element.name()))
            .hint("give the shapes their own sizes")),
    }
}

fn kinbody(element: Element<'_>) -> Result<Object, Diagnostic> {
    as_large_as_it_says(element)?;
    element.only(&[&PLACES[..], &["body", "mass"]].concat(), &IGNORED)?;
    let mut object = Object {
        name: name(element)?,
        model: element.attribute("file").map(str::to_owned),
        pose: read_place(element)?,
        ..Object::default()
    };
    let mut bodies = element.children().filter(|child| lower(*child) == "body");
    let (Some(body), second) = (bodies.next(), bodies.next()) else { return Ok(object) };
    if let Some(second) = second {
        return Err(second.wrong("a second <Body>; an object of a scene has one"));
    }
    if let Some(file) = &object.model {
        return Err(body
            .wrong(format!("a <Body> beside the file `{file}`, which is not read; expected one of both"))
            .hint("write the bodies of that file here, and remove `file`"));
    }
    body.only(&[&PLACES[..], &["geom", "mass"]].concat(), &IGNORED)?;
    no_other_files(body)?;
    let own = read_place(body)?;
    object.fixed = body.attribute("type").is_some_and(|kind| kind.eq_ignore_ascii_case("static"));
    // Some files have the mass beside the body.
    let mass = [body, element].into_iter().find_map(|around| around.children().find(|child| lower(*child) == "mass"));
    if let Some(total) = mass.and_then(|mass| mass.child("total")) {
        object.mass = Some(total.mass(total.own_numbers::<1>()?[0])?);
    }
    for geom in body.children().filter(|child| lower(*child) == "geom") {
        object.shapes.push(read_geom(geom, &own)?);
    }
    Ok(object)
}

/// The name of an object; one that is in a file of its own may be called as that is, without its endings.
fn name(element: Element<'_>) -> Result<String, Diagnostic> {
    let file = element.attribute("file").filter(|_| element.attribute("name").is_none());
    let stem = file.and_then(|file| file.rsplit('/').next()?.split('.').next()).filter(|stem| !stem.is_empty());
    match stem {
        Some(stem) => Ok(stem.to_owned()),
        None => Ok(element.needs_attribute("name")?.to_owned()),
    }
}

/// Translations add up; each rotation turns those before it.
fn read_place(element: Element<'_>) -> Result<Pose, Diagnostic> {
    let (mut translation, mut rotation) = ([0.0; 3], Pose::IDENTITY.rotation);
    for child in element.children() {
        let turn = match lower(child).as_str() {
            "translation" => {
                translation = super::pose::add(translation, child.own_numbers()?);
                continue;
            }
            "quat" => {
                let [w, x, y, z] = child.own_numbers()?;
                child.pose([0.0; 3], [x, y, z, w])?.rotation
            }
            "rotationaxis" => {
                let [x, y, z, degrees] = child.own_numbers()?;
                from_axis([x, y, z], degrees.to_radians())
            }
            "rotationmat" => {
                let [a, b, c, d, e, f, g, h, i] = child.own_numbers()?;
                from_matrix([[a, b, c], [d, e, f], [g, h, i]])
            }
            _ => continue,
        };
        rotation = multiply(turn, rotation);
    }
    element.pose(translation, rotation)
}

fn read_geom(geom: Element<'_>, around: &Pose) -> Result<Shape, Diagnostic> {
    let known = [
        "extents",
        "halfextents",
        "fullextents",
        "radius",
        "height",
        "data",
        "collision",
        "diffusecolor",
        "transparency",
    ];
    geom.only(&[&PLACES[..], &known].concat(), &["ambientcolor", "render", "name"])?;
    no_other_files(geom)?;
    let mut pose = read_place(geom)?;
    let kind = geom.needs_attribute("type")?;
    let solid = match kind.to_ascii_lowercase().as_str() {
        "box" => match geom.child("fullextents") {
            Some(full) => Solid::Box(full.own_numbers()?),
            None => {
                let half = geom.child("halfextents").map_or_else(|| geom.needs("extents"), Ok)?;
                Solid::Box(half.own_numbers()?.map(|length: f64| length * 2.0))
            }
        },
        "sphere" => Solid::Sphere(geom.number_in("radius")?),
        "cylinder" => {
            let [x, y, z, w] = UPRIGHT;
            pose.rotation = multiply(pose.rotation, [-x, -y, -z, w]);
            Solid::Cylinder { radius: geom.number_in("radius")?, length: geom.number_in("height")? }
        }
        "trimesh" => Solid::Mesh(mesh(geom)?),
        _ => {
            return Err(geom.wrong_attribute(
                "type",
                format!("unknown geometry `{kind}`; expected box, sphere, cylinder or trimesh"),
            ));
        }
    };
    solid.check().map_err(|wrong| geom.wrong(format!("a {} that {wrong}", solid.kind().name())))?;
    Ok(Shape { color: read_color(geom)?, ..Shape::new(solid, around.around(&pose)) })
}

fn read_color(geom: Element<'_>) -> Result<Option<[f64; 4]>, Diagnostic> {
    let Some(color) = geom.child("diffusecolor") else { return Ok(None) };
    let [r, g, b] = color.color(color.own_numbers()?)?;
    let [clear] = geom.child("transparency").map_or(Ok([0.0]), |clear| clear.color(clear.own_numbers()?))?;
    Ok(Some([r, g, b, 1.0 - clear]))
}

/// A file, and one or three factors.
fn mesh(geom: Element<'_>) -> Result<Mesh, Diagnostic> {
    let data =
        geom.child("data").or_else(|| geom.child("collision")).ok_or_else(|| geom.wrong("a trimesh without <Data>"))?;
    let mut words = data.text().split_whitespace();
    let file = words.next().unwrap_or_default().to_owned();
    let factors: Option<Vec<f64>> =
        words.map(|word| word.parse().ok().filter(|factor: &f64| factor.is_finite())).collect();
    let scale = match factors.as_deref() {
        Some([]) => [1.0; 3],
        Some([all]) => [*all; 3],
        Some([x, y, z]) => [*x, *y, *z],
        _ => return Err(data.wrong("expected a file, and one or three factors")),
    };
    Ok(Mesh::File { file, scale })
}
