//! Objects as documents: the keys `translation`, `rotation`, `geometry`, `color`, `mass`, `static`,
//! `attached_to`, `subframes` and `model`.
//!
//! `geometry` is a shape or an array of shapes: `{type: 'box', size: [x, y, z]}`,
//! `{type: 'sphere', radius}`, `{type: 'cylinder'|'cone', radius, length}`,
//! `{type: 'plane', normal: [x, y, z], offset}`, `{type: 'mesh', file, scale: [x, y, z]}` or
//! `{type: 'mesh', vertices: [[x, y, z]…], triangles: [[i, j, k]…]}`, each with its own
//! `translation`, `rotation` and `color` where they are not the object's.

use bson::{Bson, Document};

use super::pose::norm;
use super::{Attachment, Mesh, Object, Pose, Shape, Solid, Triangles};

/// How far the length of a rotation may be from 1.
const UNIT: f64 = 1e-3;

/// The keys of an object, beside those that say which object and in which frame.
pub const KEYS: [&str; 9] =
    ["translation", "rotation", "geometry", "color", "mass", "static", "attached_to", "subframes", "model"];

/// Reads an object. Its name is what the caller makes it.
///
/// # Errors
/// Which key is wrong, and what was expected.
pub fn read(document: &Document) -> Result<Object, String> {
    let mut object = Object {
        pose: pose(document)?,
        shapes: document.get(GEOMETRY).map_or_else(|| Ok(Vec::new()), shapes)?,
        mass: value(document, "mass").map(mass).transpose()?,
        fixed: value(document, "static").map(|value| boolean(value, "static")).transpose()?.unwrap_or_default(),
        attachment: value(document, "attached_to").map(attachment).transpose()?,
        subframes: value(document, "subframes").map_or_else(|| Ok(Vec::new()), subframes)?,
        model: value(document, "model").map(|value| text(value, "model")).transpose()?,
        ..Object::default()
    };
    object.fixed |= object.has_plane();
    if let Some(color) = value(document, "color") {
        let color = color_of(color)?;
        object.shapes.iter_mut().for_each(|shape| shape.color = shape.color.or(Some(color)));
    }
    Ok(object)
}

const GEOMETRY: &str = "geometry";

/// Reads the pose under `translation` and `rotation`.
///
/// # Errors
/// Where they are not three numbers and a unit quaternion.
pub fn pose(document: &Document) -> Result<Pose, String> {
    let translation = numbers(document, "translation")?;
    let rotation: [f64; 4] = numbers(document, "rotation")?;
    let length = norm(&rotation);
    Pose::new(translation, rotation).filter(|_| (length - 1.0).abs() <= UNIT).ok_or_else(|| {
        format!("its `rotation` {rotation:?} has the length {length:.6}; expected a unit quaternion [x, y, z, w]")
    })
}

/// Reads a geometry: a shape, or an array of shapes.
///
/// # Errors
/// Which key of which shape is wrong.
pub fn shapes(geometry: &Bson) -> Result<Vec<Shape>, String> {
    match geometry {
        Bson::Null => Ok(Vec::new()),
        Bson::Document(single) => Ok(vec![shape(single).map_err(|wrong| format!("its `geometry` {wrong}"))?]),
        Bson::Array(several) => {
            let each = |(index, value): (usize, &Bson)| {
                let single = value.as_document().ok_or_else(|| "is not a document".to_owned());
                single.and_then(shape).map_err(|wrong| format!("its `geometry.{index}` {wrong}"))
            };
            several.iter().enumerate().map(each).collect()
        }
        _ => Err(
            "its `geometry` is not a shape; expected one like {type: 'box', size: [0.1, 0.1, 0.1]}, or an array of such"
                .to_owned(),
        ),
    }
}

/// The keys that each type of shape has, beside those that all have.
const TYPES: [(&str, &[&str]); 6] = [
    ("box", &["size"]),
    ("sphere", &["radius"]),
    ("cylinder", &["radius", "length"]),
    ("cone", &["radius", "length"]),
    ("plane", &["normal", "offset"]),
    ("mesh", &["file", "scale", "vertices", "triangles"]),
];

fn shape(document: &Document) -> Result<Shape, String> {
    let known = || TYPES.map(|(name, _)| name).join(", ");
    let kind = document.get_str("type").map_err(|_| format!("has no `type`; expected one of {}", known()))?;
    let (_, keys) = TYPES
        .into_iter()
        .find(|(name, _)| *name == kind)
        .ok_or_else(|| format!("has the unknown type `{kind}`; expected one of {}", known()))?;
    let is_known = |key: &&String| {
        ["type", "translation", "rotation", "color"].contains(&key.as_str()) || keys.contains(&key.as_str())
    };
    if let Some(unknown) = document.keys().find(|key| !is_known(key)) {
        return Err(format!("has the unknown key `{unknown}`; a {kind} has {}", keys.join(", ")));
    }
    let one = |key: &str| number(document, key);
    let solid = match kind {
        "box" => Solid::Box(numbers(document, "size").map_err(inside)?),
        "sphere" => Solid::Sphere(one("radius")?),
        "cylinder" => Solid::Cylinder { radius: one("radius")?, length: one("length")? },
        "cone" => Solid::Cone { radius: one("radius")?, length: one("length")? },
        "plane" => Solid::Plane { normal: numbers(document, "normal").map_err(inside)?, offset: one("offset")? },
        _ => Solid::Mesh(mesh(document)?),
    };
    solid.check().map_err(|wrong| format!("is a {kind} that {wrong}"))?;
    let color = value(document, "color").map(color_of).transpose().map_err(inside)?;
    Ok(Shape { color, ..Shape::new(solid, own_pose(document).map_err(inside)?) })
}

/// A message about a key of an object, as one about a key of a shape.
fn inside(wrong: String) -> String {
    wrong.strip_prefix("its ").map_or_else(|| wrong.clone(), |rest| format!("is wrong: {rest}"))
}

fn mesh(document: &Document) -> Result<Mesh, String> {
    let scale = match document.get("scale") {
        None => [1.0; 3],
        Some(Bson::Array(_)) => numbers(document, "scale").map_err(inside)?,
        Some(_) => [number(document, "scale")?; 3],
    };
    match (document.get_str("file"), document.get("vertices")) {
        (Ok(file), None) => Ok(Mesh::File { file: file.to_owned(), scale }),
        (Err(_), Some(_)) => {
            let vertices = rows(document, "vertices", finite)?;
            let faces = rows(document, "triangles", |value| {
                finite(value)
                    .filter(|index| *index >= 0.0 && index.fract() == 0.0 && *index < 1e15)
                    .map(|index| index as usize)
            })?;
            let vertices = vertices.into_iter().map(|[x, y, z]: [f64; 3]| [x * scale[0], y * scale[1], z * scale[2]]);
            Ok(Mesh::Triangles(Triangles { vertices: vertices.collect(), faces }))
        }
        _ => Err("is a mesh; expected either `file` or `vertices` and `triangles`".to_owned()),
    }
}

fn rows<T>(document: &Document, key: &str, read: impl Fn(&Bson) -> Option<T>) -> Result<Vec<[T; 3]>, String> {
    let wrong = || format!("has `{key}` that are not arrays of three numbers each");
    let rows = document.get_array(key).map_err(|_| wrong())?;
    let row = |row: &Bson| {
        let values: Option<Vec<T>> = row.as_array()?.iter().map(&read).collect();
        values?.try_into().ok()
    };
    rows.iter().map(|value| row(value).ok_or_else(wrong)).collect()
}

/// The pose of a shape or subframe: the default is that of its object.
fn own_pose(document: &Document) -> Result<Pose, String> {
    let mut whole = Document::new();
    whole.insert("translation", document.get("translation").cloned().unwrap_or_else(|| vec![0.0; 3].into()));
    whole.insert("rotation", document.get("rotation").cloned().unwrap_or_else(|| vec![0.0, 0.0, 0.0, 1.0].into()));
    pose(&whole)
}

fn subframes(value: &Bson) -> Result<Vec<(String, Pose)>, String> {
    let wrong = || "its `subframes` is not a document of poses, like {handle: {translation: [0, 0, 0.1]}}".to_owned();
    let frame = |(name, value): (&String, &Bson)| {
        let own = value.as_document().ok_or_else(wrong)?;
        let pose = own_pose(own).map_err(|wrong| format!("its subframe `{name}`: {wrong}"))?;
        Ok((name.clone(), pose))
    };
    value.as_document().ok_or_else(wrong)?.iter().map(frame).collect()
}

fn attachment(value: &Bson) -> Result<Attachment, String> {
    let wrong = || "its `attached_to` is not like {link: 'gripper', touch: ['left_finger']}".to_owned();
    if let Bson::String(link) = value {
        return Ok(Attachment { link: link.clone(), touch: Vec::new() });
    }
    let document = value.as_document().ok_or_else(wrong)?;
    if document.keys().any(|key| key != "link" && key != "touch") {
        return Err(wrong());
    }
    let touch = match document.get("touch") {
        None => Vec::new(),
        Some(Bson::Array(names)) => {
            names.iter().map(|name| name.as_str().map(str::to_owned).ok_or_else(wrong)).collect::<Result<_, _>>()?
        }
        Some(_) => return Err(wrong()),
    };
    Ok(Attachment { link: document.get_str("link").map_err(|_| wrong())?.to_owned(), touch })
}

fn mass(value: &Bson) -> Result<f64, String> {
    finite(value)
        .filter(|mass| *mass > 0.0)
        .ok_or_else(|| format!("its `mass` is {value}; expected more than 0 kilograms"))
}

fn color_of(value: &Bson) -> Result<[f64; 4], String> {
    let wrong = || format!("its `color` is {value}; expected [r, g, b, a] from 0 to 1");
    let parts: Vec<f64> =
        value.as_array().ok_or_else(wrong)?.iter().map(finite).collect::<Option<_>>().ok_or_else(wrong)?;
    let color: [f64; 4] = match parts[..] {
        [r, g, b] => [r, g, b, 1.0],
        [r, g, b, a] => [r, g, b, a],
        _ => return Err(wrong()),
    };
    if color.iter().all(|part| (0.0..=1.0).contains(part)) { Ok(color) } else { Err(wrong()) }
}

/// The value of a key; one that is null is not there.
fn value<'a>(document: &'a Document, key: &str) -> Option<&'a Bson> {
    document.get(key).filter(|value| !matches!(value, Bson::Null))
}

fn boolean(value: &Bson, key: &str) -> Result<bool, String> {
    value.as_bool().ok_or_else(|| format!("its `{key}` is {value}; expected true or false"))
}

fn text(value: &Bson, key: &str) -> Result<String, String> {
    value.as_str().map(str::to_owned).ok_or_else(|| format!("its `{key}` is {value}; expected text"))
}

fn number(document: &Document, key: &str) -> Result<f64, String> {
    document.get(key).and_then(finite).ok_or_else(|| format!("has no `{key}` that is a finite number"))
}

/// An array of exactly so many finite numbers.
///
/// # Errors
/// Where the key has anything else.
pub fn numbers<const N: usize>(document: &Document, key: &str) -> Result<[f64; N], String> {
    let wrong = || format!("its `{key}` is not {N} finite numbers");
    if value(document, key).is_none() {
        return Err(format!("has no `{key}`; expected {N} finite numbers"));
    }
    let values = document.get_array(key).map_err(|_| wrong())?;
    if values.len() != N {
        return Err(wrong());
    }
    let mut numbers = [0.0; N];
    for (number, value) in numbers.iter_mut().zip(values) {
        *number = finite(value).ok_or_else(wrong)?;
    }
    Ok(numbers)
}

/// A finite number of any type.
#[must_use]
pub fn finite(value: &Bson) -> Option<f64> {
    let number = match value {
        Bson::Double(number) => *number,
        Bson::Int32(number) => f64::from(*number),
        // What is beyond 2^53 is no length in metres.
        Bson::Int64(number) => *number as f64,
        _ => return None,
    };
    number.is_finite().then_some(number)
}

/// Writes what [`read`] reads, without the name.
#[must_use]
pub fn write(object: &Object) -> Document {
    let mut document = pose_keys(&object.pose);
    document.extend(geometry_keys(object));
    if object.fixed {
        document.insert("static", true);
    }
    if let Some(attachment) = &object.attachment {
        document.insert("attached_to", attachment_value(attachment));
    }
    if !object.subframes.is_empty() {
        let frames = object.subframes.iter().map(|(name, pose)| (name.clone(), Bson::Document(pose_keys(pose))));
        document.insert("subframes", frames.collect::<Document>());
    }
    if let Some(model) = &object.model {
        document.insert("model", model);
    }
    document
}

/// The keys of a pose.
#[must_use]
pub fn pose_keys(pose: &Pose) -> Document {
    let mut document = Document::new();
    document.insert("translation", array(&pose.translation));
    document.insert("rotation", array(&pose.rotation));
    document
}

/// The keys `geometry`, `color` and `mass`.
#[must_use]
pub fn geometry_keys(object: &Object) -> Document {
    let mut document = Document::new();
    let common = object.color();
    let mut written: Vec<Document> = object.shapes.iter().map(|shape| shape_value(shape, common.is_none())).collect();
    match written.len() {
        0 => {}
        1 => drop(document.insert(GEOMETRY, written.remove(0))),
        _ => drop(document.insert(GEOMETRY, written)),
    }
    if let Some(color) = common {
        document.insert("color", array(&color));
    }
    if let Some(mass) = object.mass {
        document.insert("mass", mass);
    }
    document
}

/// What `attached_to` says.
#[must_use]
pub fn attachment_value(attachment: &Attachment) -> Document {
    let mut document = bson::doc! { "link": &attachment.link };
    if !attachment.touch.is_empty() {
        document.insert("touch", attachment.touch.clone());
    }
    document
}

fn shape_value(shape: &Shape, with_color: bool) -> Document {
    let mut document = bson::doc! { "type": shape.solid.kind().name() };
    match &shape.solid {
        Solid::Box(size) => drop(document.insert("size", array(size))),
        Solid::Sphere(radius) => drop(document.insert("radius", *radius)),
        Solid::Cylinder { radius, length } | Solid::Cone { radius, length } => {
            document.insert("radius", *radius);
            document.insert("length", *length);
        }
        Solid::Plane { normal, offset } => {
            document.insert("normal", array(normal));
            document.insert("offset", *offset);
        }
        Solid::Mesh(Mesh::File { file, scale }) => {
            document.insert("file", file);
            if *scale != [1.0; 3] {
                document.insert("scale", array(scale));
            }
        }
        Solid::Mesh(Mesh::Triangles(triangles)) => {
            let indices =
                |face: &[usize; 3]| Bson::Array(face.iter().map(|index| Bson::Int64(*index as i64)).collect());
            document.insert("vertices", triangles.vertices.iter().map(|vertex| array(vertex)).collect::<Vec<_>>());
            document.insert("triangles", triangles.faces.iter().map(indices).collect::<Vec<_>>());
        }
    }
    if shape.pose.translation != [0.0; 3] {
        document.insert("translation", array(&shape.pose.translation));
    }
    if shape.pose.rotation != Pose::IDENTITY.rotation {
        document.insert("rotation", array(&shape.pose.rotation));
    }
    if let Some(color) = shape.color.filter(|_| with_color) {
        document.insert("color", array(&color));
    }
    document
}

/// Numbers, zero without a sign.
fn array(values: &[f64]) -> Bson {
    Bson::Array(values.iter().map(|value| Bson::Double(value + 0.0)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::doc;

    fn wrong(changes: Document) -> String {
        let mut document =
            doc! { "translation": [1, 2, 3], "rotation": [0, 0, 0, 1], "geometry": { "type": "sphere", "radius": 1 } };
        document.extend(changes);
        read(&document).unwrap_err()
    }

    #[test]
    fn what_is_wrong_is_named_by_its_key() {
        for (changes, words) in [
            (doc! { "translation": [1, 2] }, "its `translation` is not 3 finite numbers"),
            (doc! { "translation": [1, 2, f64::NAN] }, "its `translation` is not 3 finite numbers"),
            (doc! { "rotation": [0, 0, 0, 1.01] }, "expected a unit quaternion [x, y, z, w]"),
            (doc! { "rotation": bson::Bson::Null }, "has no `rotation`; expected 4 finite numbers"),
            (doc! { "rotation": "up" }, "its `rotation` is not 4 finite numbers"),
            (
                doc! { "geometry": { "type": "sphere", "radius": -1 } },
                "its `geometry` is a sphere that has the radius -1; expected more than 0",
            ),
            (
                doc! { "geometry": [{ "type": "box", "size": [1, 0, 1] }] },
                "its `geometry.0` is a box that has the size [1, 0, 1]",
            ),
            (
                doc! { "geometry": { "type": "box", "size": [1, f64::NAN, 1] } },
                "its `geometry` is wrong: `size` is not 3 finite numbers",
            ),
            (doc! { "geometry": { "type": "capsule" } }, "unknown type `capsule`; expected one of box, sphere"),
            (
                doc! { "geometry": { "type": "box", "size": [1, 1, 1], "lenght": 1 } },
                "unknown key `lenght`; a box has size",
            ),
            (doc! { "geometry": { "type": "plane", "normal": [0, 0, 2], "offset": 0 } }, "expected a unit vector"),
            (doc! { "geometry": { "type": "mesh" } }, "expected either `file` or `vertices`"),
            (doc! { "geometry": 7 }, "is not a shape"),
            (doc! { "color": [1, 0] }, "expected [r, g, b, a] from 0 to 1"),
            (doc! { "mass": 0 }, "expected more than 0 kilograms"),
            (doc! { "static": 1 }, "expected true or false"),
            (doc! { "attached_to": { "joint": 1 } }, "`attached_to` is not like"),
            (doc! { "subframes": [1] }, "`subframes` is not a document of poses"),
        ] {
            let wrong = wrong(changes);
            assert!(wrong.contains(words), "{wrong}");
        }
    }

    #[test]
    fn integers_are_numbers_and_a_pose_of_a_plane_becomes_part_of_it() {
        let document = doc! {
            "translation": [1, 2_i64, 3], "rotation": [0, 0, 0, 1],
            "geometry": { "type": "plane", "normal": [0, 0, 1], "offset": 1, "translation": [5, 5, 0.5] },
        };
        let object = read(&document).unwrap();
        assert_eq!(object.pose.translation, [1.0, 2.0, 3.0]);
        assert_eq!(object.shapes[0].solid, Solid::Plane { normal: [0.0, 0.0, 1.0], offset: 1.5 });
        assert!(object.fixed, "a plane does not move");
    }
}
