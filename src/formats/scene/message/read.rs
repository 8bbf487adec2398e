//! A message, or operations, out of JSON.

use std::collections::HashMap;

use serde::Deserialize;
use serde::de::IgnoredAny;
use serde_json::value::RawValue;

use super::code::{ADD, APPEND, BOX, CONE, CYLINDER, MOVE, REMOVE, SPHERE};
use crate::formats::scene::json::place;
use crate::formats::scene::pose::norm;
use crate::formats::scene::{Attachment, Content, Mesh, Object, Operation, Pose, Scene, Shape, Solid, Triangles};
use crate::formats::{Diagnostic, Source, Span};

/// The message as it is written. What says nothing about objects may be anything.
#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct PlanningScene<'a> {
    name: String,
    #[serde(borrow)]
    robot_state: RobotState<'a>,
    #[serde(rename = "robot_model_name")]
    _robot_model_name: IgnoredAny,
    #[serde(rename = "fixed_frame_transforms")]
    _fixed_frame_transforms: IgnoredAny,
    #[serde(rename = "allowed_collision_matrix")]
    _allowed_collision_matrix: IgnoredAny,
    #[serde(rename = "link_padding")]
    _link_padding: IgnoredAny,
    #[serde(rename = "link_scale")]
    _link_scale: IgnoredAny,
    object_colors: Vec<ObjectColor>,
    world: World<'a>,
    is_diff: bool,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct RobotState<'a> {
    #[serde(rename = "joint_state")]
    _joint_state: IgnoredAny,
    #[serde(rename = "multi_dof_joint_state")]
    _multi_dof_joint_state: IgnoredAny,
    #[serde(borrow)]
    attached_collision_objects: Vec<&'a RawValue>,
    #[serde(rename = "is_diff")]
    _is_diff: bool,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct World<'a> {
    #[serde(borrow)]
    collision_objects: Vec<&'a RawValue>,
    #[serde(rename = "octomap")]
    _octomap: IgnoredAny,
}

#[derive(Deserialize)]
struct ObjectColor {
    id: String,
    color: Rgba,
}

#[derive(Deserialize, Default, Clone, Copy)]
#[serde(deny_unknown_fields, default)]
struct Rgba {
    r: f64,
    g: f64,
    b: f64,
    a: f64,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct AttachedCollisionObject {
    link_name: String,
    object: CollisionObject,
    touch_links: Vec<String>,
    #[serde(rename = "detach_posture")]
    _detach_posture: IgnoredAny,
    weight: f64,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct CollisionObject {
    header: Header,
    pose: RosPose,
    id: String,
    #[serde(rename = "type")]
    _type: IgnoredAny,
    primitives: Vec<SolidPrimitive>,
    primitive_poses: Vec<RosPose>,
    meshes: Vec<RosMesh>,
    mesh_poses: Vec<RosPose>,
    planes: Vec<RosPlane>,
    plane_poses: Vec<RosPose>,
    subframe_names: Vec<String>,
    subframe_poses: Vec<RosPose>,
    operation: i32,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct Header {
    #[serde(rename = "seq")]
    _seq: IgnoredAny,
    #[serde(rename = "stamp")]
    _stamp: IgnoredAny,
    frame_id: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SolidPrimitive {
    #[serde(rename = "type")]
    kind: i32,
    dimensions: Vec<f64>,
    #[serde(default, rename = "polygon")]
    _polygon: IgnoredAny,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RosPlane {
    coef: [f64; 4],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RosMesh {
    triangles: Vec<RosTriangle>,
    vertices: Vec<Point>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RosTriangle {
    vertex_indices: [usize; 3],
}

#[derive(Deserialize, Clone, Copy, Default)]
#[serde(deny_unknown_fields, default)]
struct Point {
    x: f64,
    y: f64,
    z: f64,
}

#[derive(Deserialize, Clone, Copy)]
#[serde(deny_unknown_fields, default)]
struct Quaternion {
    x: f64,
    y: f64,
    z: f64,
    w: f64,
}

impl Default for Quaternion {
    /// As ROS 2 fills it in.
    fn default() -> Self {
        Self { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }
    }
}

#[derive(Deserialize, Clone, Copy, Default)]
#[serde(deny_unknown_fields, default)]
struct RosPose {
    position: Point,
    orientation: Quaternion,
}

impl RosPose {
    fn pose(&self) -> Result<Pose, String> {
        let Quaternion { x, y, z, w } = self.orientation;
        let length = norm(&[x, y, z, w]);
        // MoveIt itself takes four zeros as no rotation.
        let rotation = if length == 0.0 { Pose::IDENTITY.rotation } else { [x, y, z, w] };
        Pose::new([self.position.x, self.position.y, self.position.z], rotation)
            .filter(|_| length == 0.0 || (length - 1.0).abs() <= 1e-3)
            .ok_or_else(|| format!("a quaternion of length {length:.6}; expected a unit quaternion"))
    }
}

pub(super) fn read(source: &Source) -> Result<Content, Diagnostic> {
    let text = source.text();
    let message: PlanningScene<'_> = serde_json::from_str(text).map_err(|error| place(source, 0, text, &error))?;
    let mut reader = Reader {
        source,
        colors: message.object_colors.into_iter().map(|color| (color.id, color.color)).collect(),
        frame: None,
        operations: Vec::new(),
        is_whole: !message.is_diff,
    };
    for raw in message.world.collision_objects {
        let object: CollisionObject = reader.parse(raw)?;
        reader.collision(object, None).map_err(|words| reader.wrong(raw, &words))?;
    }
    for raw in message.robot_state.attached_collision_objects {
        let attached: AttachedCollisionObject = reader.parse(raw)?;
        let attachment = Attachment { link: attached.link_name, touch: attached.touch_links };
        let grip = Grip { attachment, weight: attached.weight };
        reader.collision(attached.object, Some(grip)).map_err(|words| reader.wrong(raw, &words))?;
    }
    if !reader.is_whole {
        return Ok(Content::Operations(reader.operations, reader.frame));
    }
    let objects = reader.operations.into_iter().filter_map(|operation| match operation {
        Operation::Add(object) => Some(*object),
        _ => None,
    });
    let name = Some(message.name).filter(|name| !name.is_empty());
    Ok(Content::Scene(Scene { name, frame: reader.frame, objects: objects.collect(), ..Scene::default() }))
}

/// How an object is held.
struct Grip {
    attachment: Attachment,
    weight: f64,
}

struct Reader<'a> {
    source: &'a Source,
    colors: HashMap<String, Rgba>,
    frame: Option<String>,
    operations: Vec<Operation>,
    /// Whether it is a scene, not a difference: all it has is added.
    is_whole: bool,
}

impl Reader<'_> {
    fn start(&self, raw: &RawValue) -> usize {
        raw.get().as_ptr() as usize - self.source.text().as_ptr() as usize
    }

    fn parse<'b, T: Deserialize<'b>>(&self, raw: &'b RawValue) -> Result<T, Diagnostic> {
        serde_json::from_str(raw.get()).map_err(|error| place(self.source, self.start(raw), raw.get(), &error))
    }

    fn wrong(&self, raw: &RawValue, words: &str) -> Diagnostic {
        let start = self.start(raw);
        Diagnostic::new(self.source, Span::new(start, start + raw.get().len()), words)
    }

    fn collision(&mut self, object: CollisionObject, grip: Option<Grip>) -> Result<(), String> {
        if object.id.is_empty() {
            return Err("an object without an `id`".to_owned());
        }
        self.stay(&object.header.frame_id)?;
        let (name, operation) = (object.id.clone(), object.operation);
        if let Some(weight) = grip.as_ref().map(|grip| grip.weight).filter(|weight| *weight < 0.0) {
            return Err(format!("`{name}` weighs {weight}; expected a weight of 0 (unknown) or more"));
        }
        if self.is_whole && operation != ADD {
            return Err(format!(
                "`{name}` has the operation {operation} in a scene that is not a difference; expected `is_diff`"
            ));
        }
        let is_bare = object.primitives.is_empty() && object.meshes.is_empty() && object.planes.is_empty();
        let next = match (operation, grip) {
            (ADD, Some(grip)) if is_bare && !self.is_whole => Operation::Attach { name, attachment: grip.attachment },
            (ADD, grip) => {
                let mut read = self.object(object)?;
                read.mass = grip.as_ref().map(|grip| grip.weight).filter(|weight| *weight > 0.0);
                read.attachment = grip.map(|grip| grip.attachment);
                Operation::Add(Box::new(read))
            }
            (REMOVE, Some(grip)) => Operation::Detach { name, link: grip.attachment.link },
            (REMOVE, None) => Operation::Remove { name },
            (MOVE, None) if is_bare => Operation::Move { name, pose: object.pose.pose()? },
            (MOVE, None) => return Err(format!("`{name}` is moved and has geometry; MoveIt refuses that")),
            (APPEND, _) => {
                return Err(format!("`{name}` is to be appended to; expected the whole object (operation 0)"));
            }
            (other, _) => return Err(format!("`{name}` has the unknown operation {other}; expected 0, 1 or 3")),
        };
        self.operations.push(next);
        Ok(())
    }

    /// Notes the frame; all objects have to be in one.
    fn stay(&mut self, frame: &str) -> Result<(), String> {
        match &self.frame {
            Some(known) if !frame.is_empty() && known != frame => {
                Err(format!("the frame `{frame}` here, and `{known}` before; expected one frame"))
            }
            None if !frame.is_empty() => {
                self.frame = Some(frame.to_owned());
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn object(&self, object: CollisionObject) -> Result<Object, String> {
        let name = object.id;
        let wrong = |words: String| format!("`{name}`: {words}");
        let solids = object.primitives.iter().map(primitive).map(|read| (read, &object.primitive_poses));
        let meshes = object.meshes.into_iter().map(mesh).map(|read| (Ok(read), &object.mesh_poses));
        let planes = object.planes.iter().map(plane).map(|read| (read, &object.plane_poses));
        let mut shapes = Vec::new();
        let mut previous: Option<(*const Vec<RosPose>, usize)> = None;
        for (solid, poses) in solids.chain(meshes).chain(planes) {
            let index = previous.filter(|(list, _)| std::ptr::eq(*list, poses)).map_or(0, |(_, index)| index + 1);
            previous = Some((std::ptr::from_ref(poses), index));
            let solid = solid.map_err(wrong)?;
            solid.check().map_err(|words| wrong(format!("a {} that {words}", solid.kind().name())))?;
            // Where there are fewer poses than shapes, the rest is at the object's own.
            let pose = poses.get(index).map_or(Ok(Pose::IDENTITY), RosPose::pose).map_err(wrong)?;
            shapes.push(Shape { color: self.color(&name).map_err(wrong)?, ..Shape::new(solid, pose) });
        }
        let pose = object.pose.pose().map_err(wrong)?;
        let subframe = |(frame, pose): (String, &RosPose)| Ok((frame, pose.pose().map_err(wrong)?));
        let subframes = object.subframe_names.into_iter().zip(&object.subframe_poses).map(subframe);
        let subframes = subframes.collect::<Result<_, String>>()?;
        Ok(Object { pose, shapes, subframes, name, ..Object::default() })
    }

    fn color(&self, name: &str) -> Result<Option<[f64; 4]>, String> {
        let Some(Rgba { r, g, b, a }) = self.colors.get(name).copied() else { return Ok(None) };
        let color = [r, g, b, a];
        let is_color = color.iter().all(|part| (0.0..=1.0).contains(part));
        if is_color { Ok(Some(color)) } else { Err(format!("a colour of {color:?}; expected numbers from 0 to 1")) }
    }
}

fn primitive(primitive: &SolidPrimitive) -> Result<Solid, String> {
    Ok(match (primitive.kind, &primitive.dimensions[..]) {
        (BOX, [x, y, z]) => Solid::Box([*x, *y, *z]),
        (SPHERE, [radius]) => Solid::Sphere(*radius),
        (CYLINDER, [length, radius]) => Solid::Cylinder { radius: *radius, length: *length },
        (CONE, [length, radius]) => Solid::Cone { radius: *radius, length: *length },
        (BOX..=CONE, dimensions) => {
            return Err(format!("a primitive of type {} with {} dimensions", primitive.kind, dimensions.len()));
        }
        (kind, _) => {
            return Err(format!(
                "a primitive of the unknown type {kind}; expected 1 (box), 2 (sphere), 3 (cylinder) or 4 (cone)"
            ));
        }
    })
}

fn mesh(mesh: RosMesh) -> Solid {
    let vertices = mesh.vertices.iter().map(|Point { x, y, z }| [*x, *y, *z]).collect();
    let faces = mesh.triangles.iter().map(|triangle| triangle.vertex_indices).collect();
    Solid::Mesh(Mesh::Triangles(Triangles { vertices, faces }))
}

fn plane(plane: &RosPlane) -> Result<Solid, String> {
    let [a, b, c, d] = plane.coef;
    let length = norm(&[a, b, c]);
    if !(length > 1e-9 && length.is_finite()) {
        return Err("a plane without a normal".to_owned());
    }
    Ok(Solid::Plane { normal: [a / length, b / length, c / length], offset: -d / length })
}
