//! Objects as Foxglove's messages: `foxglove.SceneUpdate` and `foxglove.FrameTransforms`.
//!
//! Sizes are full, quaternions are x, y, z, w, cylinders stand along z. Source: the message schemas of
//! Foxglove's SDK.

use serde_json::{Value, json};

use crate::formats::scene::{Mesh, Object, Pose, Shape, Solid};

/// The name of the schema of scenes.
pub const SCENE_UPDATE: &str = "foxglove.SceneUpdate";
/// The name of the schema of frames.
pub const FRAME_TRANSFORMS: &str = "foxglove.FrameTransforms";

/// The JSON schema of scenes, as far as it is used.
pub const SCENE_UPDATE_SCHEMA: &str = r#"{"title":"foxglove.SceneUpdate","type":"object","properties":{
"deletions":{"type":"array","items":{"type":"object"}},
"entities":{"type":"array","items":{"type":"object","properties":{
"timestamp":{"type":"object","properties":{"sec":{"type":"integer"},"nsec":{"type":"integer"}}},
"frame_id":{"type":"string"},"id":{"type":"string"},
"lifetime":{"type":"object","properties":{"sec":{"type":"integer"},"nsec":{"type":"integer"}}},
"frame_locked":{"type":"boolean"},
"metadata":{"type":"array","items":{"type":"object"}},"arrows":{"type":"array","items":{"type":"object"}},
"cubes":{"type":"array","items":{"type":"object"}},"spheres":{"type":"array","items":{"type":"object"}},
"cylinders":{"type":"array","items":{"type":"object"}},"lines":{"type":"array","items":{"type":"object"}},
"triangles":{"type":"array","items":{"type":"object"}},"texts":{"type":"array","items":{"type":"object"}},
"models":{"type":"array","items":{"type":"object"}}}}}}}"#;

/// The JSON schema of frames, as far as it is used.
pub const FRAME_TRANSFORMS_SCHEMA: &str = r#"{"title":"foxglove.FrameTransforms","type":"object","properties":{
"transforms":{"type":"array","items":{"type":"object","properties":{
"timestamp":{"type":"object","properties":{"sec":{"type":"integer"},"nsec":{"type":"integer"}}},
"parent_frame_id":{"type":"string"},"child_frame_id":{"type":"string"},
"translation":{"type":"object"},"rotation":{"type":"object"}}}}}}"#;

/// The default colour.
const GREY: [f64; 4] = [0.6, 0.6, 0.6, 1.0];

/// A scene update with one object in its frame, at a time in nanoseconds since 1970.
#[must_use]
pub fn scene_update(object: &Object, frame: &str, time: u64) -> Value {
    let mut lists: [Vec<Value>; 5] = Default::default();
    let [cubes, spheres, cylinders, triangles, models] = &mut lists;
    for shape in &object.shapes {
        let pose = pose(&object.pose.around(&shape.pose));
        let color = color(shape);
        match &shape.solid {
            Solid::Box(size) => cubes.push(json!({ "pose": pose, "size": vector(*size), "color": color })),
            Solid::Sphere(radius) => {
                spheres.push(json!({ "pose": pose, "size": vector([radius * 2.0; 3]), "color": color }));
            }
            Solid::Cylinder { radius, length } | Solid::Cone { radius, length } => {
                let top = if matches!(shape.solid, Solid::Cone { .. }) { 0.0 } else { 1.0 };
                let size = vector([radius * 2.0, radius * 2.0, *length]);
                cylinders
                    .push(json!({ "pose": pose, "size": size, "bottom_scale": 1.0, "top_scale": top, "color": color }));
            }
            Solid::Mesh(Mesh::Triangles(mesh)) => {
                let points: Vec<Value> = mesh.vertices.iter().map(|vertex| vector(*vertex)).collect();
                let indices: Vec<usize> = mesh.faces.iter().flatten().copied().collect();
                triangles
                    .push(json!({ "pose": pose, "points": points, "color": color, "colors": [], "indices": indices }));
            }
            Solid::Mesh(Mesh::File { file, scale }) => models.push(json!({
                "pose": pose, "scale": vector(*scale), "color": color, "override_color": shape.color.is_some(),
                "url": file, "media_type": "", "data": "",
            })),
            // There is no primitive without an end.
            Solid::Plane { .. } => {}
        }
    }
    let label = Pose { translation: object.pose.translation, ..Pose::IDENTITY };
    let text = json!({
        "pose": pose(&label), "billboard": true, "font_size": 12.0, "scale_invariant": true,
        "color": rgba([0.0, 0.0, 0.0, 1.0]), "text": object.name,
    });
    let [cubes, spheres, cylinders, triangles, models] = lists;
    let entity = json!({
        "timestamp": stamp(time), "frame_id": frame, "id": object.name, "lifetime": { "sec": 0, "nsec": 0 },
        "frame_locked": true, "metadata": [], "arrows": [], "cubes": cubes, "spheres": spheres,
        "cylinders": cylinders, "lines": [], "triangles": triangles, "texts": [text], "models": models,
    });
    json!({ "deletions": [], "entities": [entity] })
}

/// All frames: each with its parent, and its pose there.
#[must_use]
pub fn frame_transforms(frames: &[(&str, &str, Pose)], time: u64) -> Value {
    let transform = |(frame, parent, pose): &(&str, &str, Pose)| {
        json!({
            "timestamp": stamp(time), "parent_frame_id": parent, "child_frame_id": frame,
            "translation": vector(pose.translation), "rotation": quaternion(pose.rotation),
        })
    };
    json!({ "transforms": frames.iter().map(transform).collect::<Vec<_>>() })
}

fn stamp(time: u64) -> Value {
    json!({ "sec": time / 1_000_000_000, "nsec": time % 1_000_000_000 })
}

fn pose(pose: &Pose) -> Value {
    json!({ "position": vector(pose.translation), "orientation": quaternion(pose.rotation) })
}

fn vector([x, y, z]: [f64; 3]) -> Value {
    json!({ "x": x, "y": y, "z": z })
}

fn quaternion([x, y, z, w]: [f64; 4]) -> Value {
    json!({ "x": x, "y": y, "z": z, "w": w })
}

fn color(shape: &Shape) -> Value {
    rgba(shape.color.unwrap_or(GREY))
}

fn rgba([r, g, b, a]: [f64; 4]) -> Value {
    json!({ "r": r, "g": g, "b": b, "a": a })
}
