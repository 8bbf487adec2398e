"""Prints what Drake reads in an SDF or URDF file: a JSON line for each collision geometry, sizes in full."""
import json
import logging
import sys

from pydrake.geometry import Box, Cylinder, HalfSpace, Role, SceneGraph, Sphere
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

logging.getLogger("drake").setLevel(logging.ERROR)
builder = DiagramBuilder()
plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
parser = Parser(plant)
parser.SetStrictParsing()
parser.AddModels(sys.argv[1])
plant.Finalize()
diagram = builder.Build()
context = plant.GetMyContextFromRoot(diagram.CreateDefaultContext())
inspector = scene_graph.model_inspector()
for geometry in inspector.GetAllGeometryIds(Role.kProximity):
    body = plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
    pose = plant.EvalBodyPoseInWorld(context, body).multiply(inspector.GetPoseInFrame(geometry))
    shape = inspector.GetShape(geometry)
    if isinstance(shape, Box):
        kind, size = "box", [float(length) for length in shape.size()]
    elif isinstance(shape, Sphere):
        kind, size = "sphere", [shape.radius()]
    elif isinstance(shape, Cylinder):
        kind, size = "cylinder", [shape.radius(), shape.length()]
    else:
        kind, size = "plane", []
    model = plant.GetModelInstanceName(body.model_instance())
    print(json.dumps({
        "object": body.name() if sys.argv[1].endswith("urdf") else model.split("::")[-1],
        "body": body.name(),
        "kind": kind,
        "size": size,
        "translation": [float(part) for part in pose.translation()],
        "matrix": [float(part) for part in pose.rotation().matrix().flatten()],
    }))
