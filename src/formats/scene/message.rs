//! MoveIt's message `moveit_msgs/PlanningScene` as JSON, which is YAML, too: for `ros2 topic pub`, for the
//! service `apply_planning_scene`, and for rosbridge.
//!
//! Quaternions are x, y, z, w; a box has full sizes; the dimensions of cylinders and cones are *height, radius*.
//! `operation` is 0 (add), 1 (remove), 2 (append) or 3 (move, without geometry); operations come with `is_diff`.
//! Shapes come in groups: primitives, meshes, planes. An object has one colour, and a weight where it is
//! attached. Source: the message definitions of moveit_msgs, shape_msgs and geometry_msgs.

use std::collections::HashMap;

use bson::{Bson, Document, doc};
use serde::Deserialize;
use serde::de::IgnoredAny;
use serde_json::value::RawValue;

use super::json::{line, place};
use super::pose::norm;
use super::spelling::group;
use super::{
    Attachment, Color, Content, Kind, Limits, Mass, Mesh, Model, Object, Operation, Pose, Scene, Shape, Solid,
    Spelling, Triangles,
};
use crate::formats::{Diagnostic, Source, Span};

/// `moveit_msgs/PlanningScene`.
pub const SPELLING: Spelling = Spelling {
    name: "moveit-msg",
    limits: Limits {
        kinds: &[Kind::Box, Kind::Sphere, Kind::Cylinder, Kind::Cone, Kind::Plane, Kind::Triangles],
        name: true,
        frame: true,
        framed: false,
        color: Color::Object,
        mass: Mass::Attached,
        fixed: false,
        attachment: true,
        subframes: true,
        model: Model::None,
        empty: true,
        grouped: true,
    },
    fits: |object| if object.name.is_empty() { Err("its name is empty".to_owned()) } else { Ok(()) },
    write: |scene| line(&planning_scene(scene)) + "\n",
    read,
    recognizes: |text| {
        let keys = ["\"world\"", "\"robot_state\"", "\"is_diff\"", "\"object_colors\""];
        (super::json::SPELLING.recognizes)(text)
            && !text.contains("\"objects\"")
            && keys.iter().any(|key| text.contains(key))
    },
};

const ADD: i32 = 0;
const REMOVE: i32 = 1;
const MOVE: i32 = 3;

/// A whole scene, which takes the place of what the planner knows.
fn planning_scene(scene: &Scene) -> Document {
    let mut message = Message { frame: scene.frame.clone(), ..Message::default() };
    scene.objects.iter().for_each(|object| message.add(object));
    message.finish(scene.name.as_deref(), false)
}

/// Operations as one message, which changes what the planner knows.
#[must_use]
pub fn write_operations(operations: &[Operation], frame: Option<&str>) -> String {
    let mut message = Message { frame: frame.map(str::to_owned), ..Message::default() };
    operations.iter().for_each(|operation| message.operate(operation));
    line(&message.finish(None, true)) + "\n"
}

/// A message in the making.
#[derive(Default)]
struct Message {
    frame: Option<String>,
    objects: Vec<Document>,
    attached: Vec<Document>,
    colors: Vec<Document>,
}

impl Message {
    fn finish(self, name: Option<&str>, is_diff: bool) -> Document {
        doc! {
            "name": name.unwrap_or_default(),
            "robot_state": { "is_diff": true, "attached_collision_objects": self.attached },
            "world": { "collision_objects": self.objects },
            "object_colors": self.colors,
            "is_diff": is_diff,
        }
    }

    fn add(&mut self, object: &Object) {
        if let Some([r, g, b, a]) = object.shapes.first().and_then(|shape| shape.color) {
            self.colors.push(doc! { "id": &object.name, "color": { "r": r, "g": g, "b": b, "a": a } });
        }
        let collision = self.collision(object);
        match &object.attachment {
            None => self.objects.push(collision),
            Some(attachment) => self.attach(attachment, collision, object.mass),
        }
    }

    fn attach(&mut self, attachment: &Attachment, object: Document, weight: Option<f64>) {
        self.attached.push(doc! {
            "link_name": &attachment.link,
            "object": object,
            "touch_links": attachment.touch.clone(),
            "weight": weight.unwrap_or_default(),
        });
    }

    fn operate(&mut self, operation: &Operation) {
        match operation {
            Operation::Add(object) | Operation::Reshape(object) => self.add(object),
            Operation::Remove { name } => self.objects.push(doc! { "id": name, "operation": REMOVE }),
            Operation::Move { name, pose } => {
                let moved = doc! { "header": self.header(), "id": name, "pose": pose_value(pose), "operation": MOVE };
                self.objects.push(moved);
            }
            Operation::Attach { name, attachment } => {
                self.attach(attachment, doc! { "id": name, "operation": ADD }, None);
            }
            Operation::Detach { name, link } => {
                let attachment = Attachment { link: link.clone(), touch: Vec::new() };
                self.attach(&attachment, doc! { "id": name, "operation": REMOVE }, None);
            }
        }
    }

    fn header(&self) -> Document {
        doc! { "frame_id": self.frame.as_deref().unwrap_or_default() }
    }

    fn collision(&self, object: &Object) -> Document {
        let mut lists: [(Vec<Document>, Vec<Document>); 3] = Default::default();
        for shape in &object.shapes {
            let (shapes, poses) = &mut lists[usize::from(group(&shape.solid))];
            shapes.push(solid_value(&shape.solid));
            poses.push(pose_value(&shape.pose));
        }
        let [(primitives, primitive_poses), (meshes, mesh_poses), (planes, plane_poses)] = lists;
        let (names, poses): (Vec<&str>, Vec<Document>) =
            object.subframes.iter().map(|(name, pose)| (name.as_str(), pose_value(pose))).unzip();
        doc! {
            "header": self.header(), "pose": pose_value(&object.pose), "id": &object.name,
            "primitives": primitives, "primitive_poses": primitive_poses,
            "meshes": meshes, "mesh_poses": mesh_poses,
            "planes": planes, "plane_poses": plane_poses,
            "subframe_names": names, "subframe_poses": poses,
            "operation": ADD,
        }
    }
}

fn pose_value(pose: &Pose) -> Document {
    let ([x, y, z], [qx, qy, qz, qw]) = (pose.translation.map(|part| part + 0.0), pose.rotation.map(|part| part + 0.0));
    doc! { "position": { "x": x, "y": y, "z": z }, "orientation": { "x": qx, "y": qy, "z": qz, "w": qw } }
}

/// The types of `shape_msgs/SolidPrimitive`.
const BOX: i32 = 1;
const SPHERE: i32 = 2;
const CYLINDER: i32 = 3;
const CONE: i32 = 4;

fn solid_value(solid: &Solid) -> Document {
    let primitive = |kind: i32, dimensions: &[f64]| doc! { "type": kind, "dimensions": dimensions.to_vec() };
    match solid {
        Solid::Box(size) => primitive(BOX, size),
        Solid::Sphere(radius) => primitive(SPHERE, &[*radius]),
        Solid::Cylinder { radius, length } => primitive(CYLINDER, &[*length, *radius]),
        Solid::Cone { radius, length } => primitive(CONE, &[*length, *radius]),
        Solid::Plane { normal: [a, b, c], offset } => doc! { "coef": [a + 0.0, b + 0.0, c + 0.0, 0.0 - offset] },
        Solid::Mesh(Mesh::Triangles(triangles)) => {
            let index = |index: usize| Bson::Int64(index as i64);
            let faces = triangles.faces.iter().map(|face| doc! { "vertex_indices": face.map(index).to_vec() });
            let vertices = triangles.vertices.iter().map(|[x, y, z]| doc! { "x": x, "y": y, "z": z });
            doc! { "triangles": faces.collect::<Vec<_>>(), "vertices": vertices.collect::<Vec<_>>() }
        }
        // `check` lets none come here.
        Solid::Mesh(Mesh::File { .. }) => Document::new(),
    }
}

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

fn read(source: &Source) -> Result<Content, Diagnostic> {
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
    Ok(Content::Scene(Scene { name, frame: reader.frame, objects: objects.collect() }))
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
                "`{name}` has the operation {operation} in a scene that is no difference; expected `is_diff`"
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
            (2, _) => return Err(format!("`{name}` is to be appended to; expected the whole object (operation 0)")),
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
