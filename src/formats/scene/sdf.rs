//! SDF 1.9, as Gazebo and Drake read it.
//!
//! Sizes are full. Poses are written as `x y z qx qy qz qw` with `rotation_format="quat_xyzw"`, and
//! read as roll, pitch and yaw in radians, or in degrees where `degrees="true"`, too. Objects are models
//! with one link; a frame other than `world` is a `<frame>` of the world that poses are relative to.
//! Source: the specification at sdformat.org.

use std::fmt::Write as _;

use super::inertia::inertia;
use super::number::{number, numbers};
use super::pose::{from_rpy, from_z_to};
use super::xml::{self, Element, check_names, escape};
use super::{Color, Content, Kind, Limits, Mass, Mesh, Model, Object, Pose, Scene, Shape, Solid, Spelling};
use crate::formats::{Diagnostic, Source};

/// SDF.
pub const SPELLING: Spelling = Spelling {
    name: "sdf",
    limits: Limits {
        kinds: &[Kind::Box, Kind::Sphere, Kind::Cylinder, Kind::Plane, Kind::MeshFile],
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
    fits,
    write,
    read,
    recognizes: |text| xml::root(text) == Some("sdf"),
};

fn fits(object: &Object) -> Result<(), String> {
    check_names(object)?;
    let name = &object.name;
    if name.contains("::") || name == "world" || (name.starts_with("__") && name.ends_with("__")) {
        return Err(format!(
            "its name `{name}` is reserved in sdf: `world`, `__…__`, and what has `::`; give it another"
        ));
    }
    Ok(())
}

/// The frame that needs no name.
const WORLD: &str = "world";

fn write(scene: &Scene) -> String {
    let frame = scene.frame.as_deref().filter(|frame| *frame != WORLD).map(escape);
    let mut text = String::from("<?xml version=\"1.0\"?>\n<sdf version=\"1.9\">\n");
    let _ = writeln!(text, "  <world name=\"{}\">", escape(scene.name.as_deref().unwrap_or("scene")));
    if let Some(frame) = &frame {
        let _ = writeln!(text, "    <frame name=\"{frame}\"/>");
    }
    for object in &scene.objects {
        model(object, frame.as_deref(), &mut text);
    }
    text.push_str("  </world>\n</sdf>\n");
    text
}

fn model(object: &Object, frame: Option<&str>, text: &mut String) {
    let _ = writeln!(text, "    <model name=\"{}\">", escape(&object.name));
    if object.fixed {
        text.push_str("      <static>true</static>\n");
    }
    let relative = frame.map(|frame| format!(" relative_to=\"{frame}\"")).unwrap_or_default();
    let _ = writeln!(text, "      {}", pose(&object.pose, &relative));
    text.push_str("      <link name=\"link\">\n");
    if let Some(mass) = object.mass {
        weigh(object, mass, text);
    }
    for (index, shape) in object.shapes.iter().enumerate() {
        for element in ["collision", "visual"] {
            let _ = writeln!(text, "        <{element} name=\"{element}_{index}\">");
            let (geometry, place) = geometry(shape);
            if place != Pose::IDENTITY {
                let _ = writeln!(text, "          {}", pose(&place, ""));
            }
            let _ = writeln!(text, "          <geometry>{geometry}</geometry>");
            if let Some(color) = shape.color.filter(|_| element == "visual") {
                let color = numbers(&color);
                let _ = writeln!(
                    text,
                    "          <material><ambient>{color}</ambient><diffuse>{color}</diffuse></material>"
                );
            }
            let _ = writeln!(text, "        </{element}>");
        }
    }
    text.push_str("      </link>\n    </model>\n");
}

fn pose(pose: &Pose, relative: &str) -> String {
    let (place, turn) = (numbers(&pose.translation), numbers(&pose.rotation));
    format!("<pose{relative} rotation_format=\"quat_xyzw\">{place} {turn}</pose>")
}

fn weigh(object: &Object, mass: f64, text: &mut String) {
    let inertia = inertia(object, mass);
    let names = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"];
    let moments =
        names.iter().zip(inertia.moments).map(|(name, moment)| format!("<{name}>{}</{name}>", number(moment)));
    let center = Pose { translation: inertia.center, ..Pose::IDENTITY };
    let _ = writeln!(
        text,
        "        <inertial>\n          {}\n          <mass>{}</mass>\n          <inertia>{}</inertia>\n        </inertial>",
        pose(&center, ""),
        number(mass),
        moments.collect::<String>()
    );
}

fn geometry(shape: &Shape) -> (String, Pose) {
    let round = |name: &str, radius: f64, length: f64| {
        format!("<{name}><radius>{}</radius><length>{}</length></{name}>", number(radius), number(length))
    };
    let text = match &shape.solid {
        Solid::Box(size) => format!("<box><size>{}</size></box>", numbers(size)),
        Solid::Sphere(radius) => format!("<sphere><radius>{}</radius></sphere>", number(*radius)),
        Solid::Cylinder { radius, length } => round("cylinder", *radius, *length),
        Solid::Cone { radius, length } => round("cone", *radius, *length),
        Solid::Plane { normal, offset } => {
            // The normal of SDF is in the shape's own frame; turning the frame keeps every digit of it.
            let place = Pose { translation: normal.map(|part| part * offset), rotation: from_z_to(*normal) };
            return ("<plane><normal>0 0 1</normal><size>100 100</size></plane>".to_owned(), place);
        }
        Solid::Mesh(Mesh::File { file, scale }) => {
            format!("<mesh><uri>{}</uri><scale>{}</scale></mesh>", escape(file), numbers(scale))
        }
        // `check` lets none come here.
        Solid::Mesh(Mesh::Triangles(_)) => String::new(),
    };
    (text, shape.pose)
}

/// Elements of a world that say nothing about where things are.
const IGNORED: [&str; 12] = [
    "physics",
    "gravity",
    "light",
    "scene",
    "gui",
    "plugin",
    "atmosphere",
    "magnetic_field",
    "wind",
    "audio",
    "spherical_coordinates",
    "state",
];

fn read(source: &Source) -> Result<Content, Diagnostic> {
    xml::parse(source, |root| {
        if root.name() != "sdf" {
            return Err(root.wrong("expected <sdf>"));
        }
        let version = root.needs_attribute("version")?;
        if !version.starts_with("1.") {
            return Err(root.wrong_attribute("version", format!("unknown version `{version}`; expected 1.4 to 1.9")));
        }
        root.only(&["world", "model"], &["light", "plugin"])?;
        let mut scene = Scene::default();
        let Some(world) = root.child("world") else {
            for child in root.children().filter(|child| child.name() == "model") {
                scene.objects.push(object(child, &mut scene.frame)?);
            }
            return Ok(Content::Scene(scene));
        };
        let mut models = root.children().filter(|child| ["world", "model"].contains(&child.name()));
        if let Some(second) = models.find(|child| !child.is(&world)) {
            return Err(second.wrong(format!("<{}> beside the <world>; expected one world", second.name())));
        }
        world.only(&["model", "frame"], &IGNORED)?;
        scene.name = world.attribute("name").map(str::to_owned);
        for child in world.children().filter(|child| child.name() == "frame") {
            let is_world = child.attribute("attached_to").is_none_or(|other| other == WORLD);
            if child.children().next().is_some() || !is_world {
                return Err(
                    child.wrong("frames with a pose of their own are not read; expected one that is that of the world")
                );
            }
        }
        let mut frame = None;
        for child in world.children().filter(|child| child.name() == "model") {
            scene.objects.push(object(child, &mut frame)?);
        }
        let named = || world.child("frame").and_then(|frame| frame.attribute("name")).map(str::to_owned);
        scene.frame = frame.or_else(named).or_else(|| Some(WORLD.to_owned()));
        Ok(Content::Scene(scene))
    })
}

fn object(model: Element<'_>, frame: &mut Option<String>) -> Result<Object, Diagnostic> {
    model.only(
        &["static", "pose", "link"],
        &["plugin", "robotNamespace", "allow_auto_disable", "self_collide", "enable_wind"],
    )?;
    let mut object = Object { name: model.needs_attribute("name")?.to_owned(), ..Object::default() };
    if let Some(fixed) = model.child("static") {
        object.fixed = fixed.own_truth()?;
    }
    if let Some(pose) = model.child("pose") {
        object.pose = read_pose(pose)?;
        let relative = pose.attribute("relative_to").filter(|name| !name.is_empty()).unwrap_or(WORLD);
        match frame {
            Some(known) if known != relative => {
                let message =
                    format!("poses are relative to `{relative}` here and to `{known}` before; expected one frame");
                return Err(pose.wrong_attribute("relative_to", message));
            }
            _ => *frame = Some(relative.to_owned()),
        }
    }
    let mut links = model.children().filter(|child| child.name() == "link");
    let (Some(link), second) = (links.next(), links.next()) else { return Ok(object) };
    if let Some(second) = second {
        return Err(second.wrong("a second <link>; an object of a scene has one"));
    }
    read_link(link, &mut object)?;
    object.fixed |= object.has_plane();
    Ok(object)
}

fn read_link(link: Element<'_>, object: &mut Object) -> Result<(), Diagnostic> {
    link.only(
        &["pose", "inertial", "collision", "visual"],
        &[
            "sensor",
            "light",
            "plugin",
            "gravity",
            "kinematic",
            "self_collide",
            "enable_wind",
            "velocity_decay",
            "must_be_base_link",
            "audio_sink",
            "audio_source",
            "battery",
            "particle_emitter",
            "projector",
        ],
    )?;
    let own = link.child("pose").map(read_local).transpose()?.unwrap_or_default();
    if let Some(inertial) = link.child("inertial") {
        object.mass = inertial.child("mass").map(|mass| mass.mass(mass.own_numbers::<1>()?[0])).transpose()?;
    }
    let all = |name: &'static str| link.children().filter(move |child| child.name() == name);
    let collisions = all("collision").count();
    // Visuals are used as collisions only where there are no collisions.
    let (bodies, colors): (Vec<_>, Vec<_>) = if collisions > 0 {
        (all("collision").collect(), all("visual").collect())
    } else {
        (all("visual").collect(), all("visual").collect())
    };
    for (index, body) in bodies.into_iter().enumerate() {
        let color = colors.get(index).copied().map(read_color).transpose()?.flatten();
        object.shapes.push(Shape { color, ..read_shape(body, &own)? });
    }
    Ok(())
}

fn read_color(visual: Element<'_>) -> Result<Option<[f64; 4]>, Diagnostic> {
    let Some(material) = visual.child("material") else { return Ok(None) };
    let color = material.child("diffuse").or_else(|| material.child("ambient"));
    color.map(|color| color.color(color.own_color()?)).transpose()
}

fn read_shape(body: Element<'_>, around: &Pose) -> Result<Shape, Diagnostic> {
    let ignored = [
        "surface",
        "laser_retro",
        "max_contacts",
        "material",
        "cast_shadows",
        "transparency",
        "visibility_flags",
        "lidar_intensity",
        "density",
        "auto_inertia_params",
        "plugin",
        "meta",
    ];
    body.only(&["pose", "geometry"], &ignored)?;
    let pose = around.around(&body.child("pose").map(read_local).transpose()?.unwrap_or_default());
    let geometry = body.needs("geometry")?;
    geometry.only(&["box", "sphere", "cylinder", "plane", "mesh"], &[])?;
    let kind = geometry.children().next().ok_or_else(|| geometry.wrong("<geometry> has no shape"))?;
    if kind.name() == "plane" && body.name() == "visual" {
        return sheet(kind, &pose);
    }
    let solid = match kind.name() {
        "box" => Solid::Box(kind.needs("size")?.own_numbers()?),
        "sphere" => Solid::Sphere(kind.number_in("radius")?),
        "cylinder" => Solid::Cylinder { radius: kind.number_in("radius")?, length: kind.number_in("length")? },
        "plane" => Solid::Plane { normal: kind.needs("normal")?.own_numbers()?, offset: 0.0 },
        _ => {
            let scale = kind.child("scale").map(|scale| scale.own_numbers()).transpose()?;
            Solid::Mesh(Mesh::File { file: kind.needs("uri")?.text().to_owned(), scale: scale.unwrap_or([1.0; 3]) })
        }
    };
    solid.check().map_err(|wrong| kind.wrong(format!("a {} that {wrong}", solid.kind().name())))?;
    Ok(Shape::new(solid, pose))
}

/// The thickness in metres of the box that a visual plane is read as.
const SHEET: f64 = 0.001;

/// A visual plane, which has an extent: a thin box whose upper face it is. Only planes of collisions are endless.
fn sheet(plane: Element<'_>, around: &Pose) -> Result<Shape, Diagnostic> {
    let normal = plane.needs("normal")?.own_numbers()?;
    let [x, y] = plane.needs("size")?.own_numbers()?;
    let solid = Solid::Box([x, y, SHEET]);
    let checked = Solid::Plane { normal, offset: 0.0 }.check().and_then(|()| solid.check());
    checked.map_err(|wrong| plane.wrong(format!("a plane that {wrong}")))?;
    let pose = Pose { translation: normal.map(|part| -part * SHEET / 2.0), rotation: from_z_to(normal) };
    Ok(Shape::new(solid, around.around(&pose)))
}

/// A pose in the element around it.
fn read_local(pose: Element<'_>) -> Result<Pose, Diagnostic> {
    if pose.attribute("relative_to").is_some_and(|name| !name.is_empty()) {
        return Err(pose.wrong_attribute("relative_to", "only the pose of a model may be relative to a frame"));
    }
    read_pose(pose)
}

fn read_pose(pose: Element<'_>) -> Result<Pose, Diagnostic> {
    pose.only_attributes(&["relative_to", "rotation_format", "degrees", "frame"])?;
    // The word of SDF 1.5 and 1.6, in which programs never agreed on what it is relative to.
    if let Some(frame) = pose.attribute("frame").filter(|frame| !frame.is_empty()) {
        let message = format!("a pose in the frame `{frame}`, which is not read; expected `frame` to be empty");
        let hint = "since SDF 1.7, the pose of a model in a world may have `relative_to` instead";
        return Err(pose.wrong_attribute("frame", message).hint(hint));
    }
    match pose.attribute("rotation_format") {
        Some("quat_xyzw") => {
            let [x, y, z, rotation @ ..]: [f64; 7] = pose.own_numbers()?;
            pose.pose([x, y, z], rotation)
        }
        None | Some("euler_rpy") => {
            if pose.text().is_empty() {
                return Ok(Pose::IDENTITY);
            }
            let [x, y, z, angles @ ..]: [f64; 6] = pose.own_numbers()?;
            let degrees = matches!(pose.attribute("degrees"), Some("true" | "1"));
            let unit = if degrees { std::f64::consts::PI / 180.0 } else { 1.0 };
            pose.pose([x, y, z], from_rpy(angles.map(|angle| angle * unit)))
        }
        Some(other) => Err(pose
            .wrong_attribute("rotation_format", format!("unknown format `{other}`; expected euler_rpy or quat_xyzw"))),
    }
}
