"""Prints what MuJoCo reads in an MJCF file: a JSON line for each geom, sizes in full."""
import json
import sys

import mujoco

model = mujoco.MjModel.from_xml_path(sys.argv[1])
data = mujoco.MjData(model)
mujoco.mj_kinematics(model, data)
NAMES = {
    mujoco.mjtGeom.mjGEOM_BOX: "box",
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_PLANE: "plane",
    mujoco.mjtGeom.mjGEOM_MESH: "mesh",
}
for geom in range(model.ngeom):
    kind = NAMES[mujoco.mjtGeom(model.geom_type[geom])]
    half = [float(size) for size in model.geom_size[geom]]
    size = {
        "box": [2 * length for length in half],
        "sphere": half[:1],
        "cylinder": [half[0], 2 * half[1]],
    }.get(kind, [])
    body = model.geom_bodyid[geom]
    print(json.dumps({
        "object": mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, body),
        "kind": kind,
        "size": size,
        "translation": [float(part) for part in data.geom_xpos[geom]],
        "matrix": [float(part) for part in data.geom_xmat[geom]],
        "mass": float(model.body_mass[body]),
        "free": bool(model.body_dofnum[body] == 6),
    }))
