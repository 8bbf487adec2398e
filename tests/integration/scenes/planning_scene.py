"""Checks a PlanningScene as JSON against the message's definition: serialises it as ROS 2 would, and
prints a JSON line for each primitive that reads back."""
import json
import sys

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

store = get_typestore(Stores.ROS2_HUMBLE)
DEFINITIONS = {
    "object_recognition_msgs/msg/ObjectType": "string key\nstring db\n",
    "moveit_msgs/msg/CollisionObject": """std_msgs/Header header
geometry_msgs/Pose pose
string id
object_recognition_msgs/ObjectType type
shape_msgs/SolidPrimitive[] primitives
geometry_msgs/Pose[] primitive_poses
shape_msgs/Mesh[] meshes
geometry_msgs/Pose[] mesh_poses
shape_msgs/Plane[] planes
geometry_msgs/Pose[] plane_poses
string[] subframe_names
geometry_msgs/Pose[] subframe_poses
byte ADD=0
byte REMOVE=1
byte APPEND=2
byte MOVE=3
byte operation
""",
    "moveit_msgs/msg/AttachedCollisionObject": """string link_name
moveit_msgs/CollisionObject object
string[] touch_links
trajectory_msgs/JointTrajectory detach_posture
float64 weight
""",
    "moveit_msgs/msg/RobotState": """sensor_msgs/JointState joint_state
sensor_msgs/MultiDOFJointState multi_dof_joint_state
moveit_msgs/AttachedCollisionObject[] attached_collision_objects
bool is_diff
""",
    "moveit_msgs/msg/ObjectColor": "string id\nstd_msgs/ColorRGBA color\n",
    "moveit_msgs/msg/PlanningSceneWorld": "moveit_msgs/CollisionObject[] collision_objects\n",
    "moveit_msgs/msg/PlanningScene": """string name
moveit_msgs/RobotState robot_state
string robot_model_name
moveit_msgs/ObjectColor[] object_colors
moveit_msgs/PlanningSceneWorld world
bool is_diff
""",
}
types = {}
for name, text in DEFINITIONS.items():
    types.update(get_types_from_msg(text, name))
store.register(types)


def build(name, value):
    """The message of this type with these fields; an unknown field is an error, a missing one is the default."""
    import numpy

    fields = dict(store.get_msgdef(name).fields)
    unknown = set(value or {}) - set(fields)
    assert not unknown, f"{name} has no {unknown}"
    built = {}
    for field, (kind, detail) in fields.items():
        given = (value or {}).get(field)
        kind = int(kind)
        if kind == 1:  # a base type
            base = detail[0] if isinstance(detail, tuple) else detail
            built[field] = given if given is not None else {"string": "", "bool": False}.get(base, 0)
        elif kind == 2:  # a message
            built[field] = build(detail, given)
        else:  # an array or a sequence
            element = detail[0]
            if int(element[0]) == 2:
                built[field] = [build(element[1], one) for one in given or []]
            else:
                base = element[1][0] if isinstance(element[1], tuple) else element[1]
                count = detail[1] if kind == 3 else 0
                given = given if given is not None else [0] * count
                if base == "string":
                    built[field] = list(given)
                else:
                    built[field] = numpy.array(given, dtype=base)
    return store.types[name](**built)


def show(message, is_attached):
    for primitive, pose in zip(message.primitives, message.primitive_poses):
        print(json.dumps({
            "object": message.id,
            "frame": message.header.frame_id,
            "type": int(primitive.type),
            "dimensions": [float(size) for size in primitive.dimensions],
            "attached": is_attached,
        }))


scene = build("moveit_msgs/msg/PlanningScene", json.load(open(sys.argv[1])))
raw = store.serialize_cdr(scene, "moveit_msgs/msg/PlanningScene")
again = store.deserialize_cdr(raw, "moveit_msgs/msg/PlanningScene")
for one in again.world.collision_objects:
    show(one, False)
for one in again.robot_state.attached_collision_objects:
    show(one.object, True)
