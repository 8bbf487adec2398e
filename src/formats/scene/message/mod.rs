//! MoveIt's message `moveit_msgs/PlanningScene` as JSON, which is YAML, too: for `ros2 topic pub`, for the
//! service `apply_planning_scene`, and for rosbridge.
//!
//! Quaternions are x, y, z, w; a box has full sizes; the dimensions of cylinders and cones are *height, radius*.
//! `operation` is 0 (add), 1 (remove), 2 (append) or 3 (move, without geometry); operations come with `is_diff`.
//! Shapes come in groups: primitives, meshes, planes. An object has one colour, and a weight where it is
//! attached. Source: the message definitions of moveit_msgs, shape_msgs and geometry_msgs.

mod code;
mod read;
mod write;

pub use write::write_operations;

use super::{Color, Kind, Limits, Mass, Model, Spelling};

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
    write: write::write_scene,
    read: read::read,
    recognizes: |text| {
        let keys = ["\"world\"", "\"robot_state\"", "\"is_diff\"", "\"object_colors\""];
        (super::json::SPELLING.recognizes)(text)
            && !text.contains("\"objects\"")
            && keys.iter().any(|key| text.contains(key))
    },
};
