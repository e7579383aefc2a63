"""A ball with primvars, a subset and guides, and regions that grow on it."""

import numpy as np
import pytest
import trimesh
from pxr import Sdf, UsdGeom, Vt
from usd_meshes import define_mesh
from usdin_scenes import new_stage

from featherfx.api import read_groom
from featherfx.errors import InputError

RADIUS = 0.1
FLOAT, VECTOR = Sdf.ValueTypeNames.FloatArray, Sdf.ValueTypeNames.Vector3fArray


def write_skin(folder, mesh=None, meters_per_unit=1.0):
    mesh = mesh or trimesh.creation.icosphere(3, radius=RADIUS)
    stage = new_stage(folder / "skin.usda", meters_per_unit)
    points, faces = np.array(mesh.vertices) / meters_per_unit, np.array(mesh.faces)
    skin = define_mesh(stage, "/skin", points, faces)
    api = UsdGeom.PrimvarsAPI(skin)
    height = (points[:, 2] * meters_per_unit / RADIUS).astype(np.float32)
    api.CreatePrimvar("top", FLOAT, "vertex").Set(Vt.FloatArray.FromNumpy(np.clip(height, 0, 1)))
    flow = np.tile(np.float32([0, 1, 0]), (len(points), 1))
    api.CreatePrimvar("flow", VECTOR, "vertex").Set(Vt.Vec3fArray.FromNumpy(flow))
    back = np.flatnonzero(points[faces].mean(axis=1)[:, 0] < 0)
    UsdGeom.Subset.CreateGeomSubset(
        skin, "back", "face", Vt.IntArray.FromNumpy(back.astype(np.int32)), "regions"
    )
    guide = UsdGeom.BasisCurves.Define(stage, "/guides/line")
    guide.CreateTypeAttr("linear")
    guide.CreateCurveVertexCountsAttr([3])
    guide.CreatePointsAttr(Vt.Vec3fArray([(0, 0, 0.1), (-0.05, 0, 0.1), (-0.1, 0, 0.1)]))
    stage.GetRootLayer().Save()
    return stage


def region(name="body", keys="count = 200", flow="direction = [-1, 0, 0]"):
    return f"[[region]]\nid = '{name}'\nkind = 'body_contour'\n{keys}\nflow = {{ {flow} }}\n"


SKIN = "name = 'bird'\n[skin]\nusd = 'skin.usda'\nprim = '/skin'\n"


def grown(folder, *regions, skin=SKIN):
    path = folder / "groom.toml"
    path.write_text(skin + "".join(regions))
    return read_groom(path)


def problems(folder, *regions, skin=SKIN):
    with pytest.raises(InputError) as caught:
        grown(folder, *regions, skin=skin)
    return "\n".join(map(str, caught.value.problems))


@pytest.fixture(name="folder")
def skin_folder(tmp_path):
    write_skin(tmp_path)
    return tmp_path


def roots(groom):
    return np.array([f.position for f in groom.feathers])
