//! A scene, or operations, as JSON.

use serde::Serialize;

use super::code::{ADD, BOX, CONE, CYLINDER, MOVE, REMOVE, SPHERE};
use crate::formats::scene::spelling::group;
use crate::formats::scene::{Attachment, Mesh, Object, Operation, Pose, Scene, Solid, Triangles};

/// A whole scene, which takes the place of what the planner knows.
pub(super) fn write_scene(scene: &Scene) -> String {
    let mut message = Message { frame: scene.frame.as_deref().unwrap_or_default(), ..Message::default() };
    scene.objects.iter().for_each(|object| message.add(object));
    message.finish(scene.name.as_deref(), false)
}

/// Operations as one message, which changes what the planner knows.
#[must_use]
pub fn write_operations(operations: &[Operation], frame: Option<&str>) -> String {
    let mut message = Message { frame: frame.unwrap_or_default(), ..Message::default() };
    operations.iter().for_each(|operation| message.operate(operation));
    message.finish(None, true)
}

/// A message in the making.
#[derive(Default)]
struct Message<'a> {
    frame: &'a str,
    objects: Vec<Collision<'a>>,
    attached: Vec<Attached<'a>>,
    colors: Vec<ObjectColor<'a>>,
}

impl<'a> Message<'a> {
    fn finish(self, name: Option<&str>, is_diff: bool) -> String {
        let scene = PlanningScene {
            name: name.unwrap_or_default(),
            robot_state: RobotState { is_diff: true, attached_collision_objects: self.attached },
            world: World { collision_objects: self.objects },
            object_colors: self.colors,
            is_diff,
        };
        // Numbers, texts and lists of these have a text.
        serde_json::to_string(&scene).unwrap_or_default() + "\n"
    }

    fn add(&mut self, object: &'a Object) {
        if let Some([r, g, b, a]) = object.shapes.first().and_then(|shape| shape.color) {
            self.colors.push(ObjectColor { id: &object.name, color: Rgba { r, g, b, a } });
        }
        let collision = Collision::Whole(Box::new(Whole::new(object, self.frame)));
        match &object.attachment {
            None => self.objects.push(collision),
            Some(attachment) => self.attach(attachment, collision, object.mass),
        }
    }

    fn attach(&mut self, attachment: &'a Attachment, object: Collision<'a>, weight: Option<f64>) {
        self.attached.push(Attached {
            link_name: &attachment.link,
            object,
            touch_links: &attachment.touch,
            weight: weight.unwrap_or_default(),
        });
    }

    fn operate(&mut self, operation: &'a Operation) {
        match operation {
            Operation::Add(object) | Operation::Reshape(object) => self.add(object),
            Operation::Remove { name } => self.objects.push(Collision::Named { id: name, operation: REMOVE }),
            Operation::Move { name, pose } => self.objects.push(Collision::Moved {
                header: Header { frame_id: self.frame },
                id: name,
                pose: pose.into(),
                operation: MOVE,
            }),
            Operation::Attach { name, attachment } => {
                self.attach(attachment, Collision::Named { id: name, operation: ADD }, None);
            }
            Operation::Detach { name, link } => self.attached.push(Attached {
                link_name: link,
                object: Collision::Named { id: name, operation: REMOVE },
                touch_links: &[],
                weight: 0.0,
            }),
        }
    }
}

#[derive(Serialize)]
struct PlanningScene<'a> {
    name: &'a str,
    robot_state: RobotState<'a>,
    world: World<'a>,
    object_colors: Vec<ObjectColor<'a>>,
    is_diff: bool,
}

#[derive(Serialize)]
struct RobotState<'a> {
    is_diff: bool,
    attached_collision_objects: Vec<Attached<'a>>,
}

#[derive(Serialize)]
struct World<'a> {
    collision_objects: Vec<Collision<'a>>,
}

#[derive(Serialize)]
struct ObjectColor<'a> {
    id: &'a str,
    color: Rgba,
}

#[derive(Serialize)]
struct Rgba {
    r: f64,
    g: f64,
    b: f64,
    a: f64,
}

#[derive(Serialize)]
struct Attached<'a> {
    link_name: &'a str,
    object: Collision<'a>,
    touch_links: &'a [String],
    weight: f64,
}

/// An object: as it is described, where it is now, or what is done to it.
#[derive(Serialize)]
#[serde(untagged)]
enum Collision<'a> {
    Whole(Box<Whole<'a>>),
    Moved { header: Header<'a>, id: &'a str, pose: RosPose, operation: i32 },
    Named { id: &'a str, operation: i32 },
}

#[derive(Serialize)]
struct Whole<'a> {
    header: Header<'a>,
    pose: RosPose,
    id: &'a str,
    primitives: Vec<Primitive>,
    primitive_poses: Vec<RosPose>,
    meshes: Vec<RosMesh>,
    mesh_poses: Vec<RosPose>,
    planes: Vec<RosPlane>,
    plane_poses: Vec<RosPose>,
    subframe_names: Vec<&'a str>,
    subframe_poses: Vec<RosPose>,
    operation: i32,
}

impl<'a> Whole<'a> {
    fn new(object: &'a Object, frame: &'a str) -> Self {
        let solids = || object.shapes.iter().map(|shape| &shape.solid);
        let poses = |wanted: u8| {
            let own = object.shapes.iter().filter(move |shape| group(&shape.solid) == wanted);
            own.map(|shape| RosPose::from(&shape.pose)).collect()
        };
        Self {
            header: Header { frame_id: frame },
            pose: (&object.pose).into(),
            id: &object.name,
            primitives: solids().filter_map(primitive).collect(),
            primitive_poses: poses(0),
            meshes: solids().filter_map(mesh).collect(),
            mesh_poses: poses(1),
            planes: solids().filter_map(plane).collect(),
            plane_poses: poses(2),
            subframe_names: object.subframes.iter().map(|(name, _)| name.as_str()).collect(),
            subframe_poses: object.subframes.iter().map(|(_, pose)| pose.into()).collect(),
            operation: ADD,
        }
    }
}

#[derive(Serialize)]
struct Header<'a> {
    frame_id: &'a str,
}

#[derive(Serialize)]
struct Point {
    x: f64,
    y: f64,
    z: f64,
}

#[derive(Serialize)]
struct Quaternion {
    x: f64,
    y: f64,
    z: f64,
    w: f64,
}

#[derive(Serialize)]
struct RosPose {
    position: Point,
    orientation: Quaternion,
}

impl From<&Pose> for RosPose {
    /// Zero has no sign.
    fn from(pose: &Pose) -> Self {
        let [x, y, z] = pose.translation.map(|part| part + 0.0);
        let position = Point { x, y, z };
        let [x, y, z, w] = pose.rotation.map(|part| part + 0.0);
        Self { position, orientation: Quaternion { x, y, z, w } }
    }
}

#[derive(Serialize)]
struct Primitive {
    #[serde(rename = "type")]
    kind: i32,
    dimensions: Vec<f64>,
}

fn primitive(solid: &Solid) -> Option<Primitive> {
    let primitive = |kind: i32, dimensions: &[f64]| Some(Primitive { kind, dimensions: dimensions.to_vec() });
    match solid {
        Solid::Box(size) => primitive(BOX, size),
        Solid::Sphere(radius) => primitive(SPHERE, &[*radius]),
        Solid::Cylinder { radius, length } => primitive(CYLINDER, &[*length, *radius]),
        Solid::Cone { radius, length } => primitive(CONE, &[*length, *radius]),
        Solid::Plane { .. } | Solid::Mesh(_) => None,
    }
}

#[derive(Serialize)]
struct RosPlane {
    coef: [f64; 4],
}

fn plane(solid: &Solid) -> Option<RosPlane> {
    let Solid::Plane { normal: [a, b, c], offset } = solid else { return None };
    Some(RosPlane { coef: [a + 0.0, b + 0.0, c + 0.0, 0.0 - offset] })
}

#[derive(Serialize)]
struct RosMesh {
    triangles: Vec<RosTriangle>,
    vertices: Vec<Point>,
}

#[derive(Serialize)]
struct RosTriangle {
    vertex_indices: [usize; 3],
}

/// The triangles of a mesh. `check` lets no mesh in a file come here.
fn mesh(solid: &Solid) -> Option<RosMesh> {
    let Solid::Mesh(Mesh::Triangles(Triangles { vertices, faces })) = solid else { return None };
    let triangles = faces.iter().map(|face| RosTriangle { vertex_indices: *face }).collect();
    let vertices = vertices.iter().map(|[x, y, z]| Point { x: *x, y: *y, z: *z }).collect();
    Some(RosMesh { triangles, vertices })
}
