"""Prints the distance of geoms 0 and 1, 2 and 3, and so on, as mj_geomDistance finds it."""
import sys

import mujoco

model = mujoco.MjModel.from_xml_path(sys.argv[1])
model.opt.ccd_tolerance = 1e-9
model.opt.ccd_iterations = 500
data = mujoco.MjData(model)
mujoco.mj_kinematics(model, data)
for geom in range(0, model.ngeom, 2):
    print(repr(float(mujoco.mj_geomDistance(model, data, geom, geom + 1, 1e3, None))))
