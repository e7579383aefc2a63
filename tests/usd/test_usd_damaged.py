"""Caches whose points or faces are damaged: one message with prim, attribute and time code."""

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, Vt

from featherfx.baking.pipeline import export, retime
from featherfx.errors import InputError, InputWarning
from featherfx.usd.read.cache import Cache

POINTS = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], dtype=np.float32)


def write_cache(path, points_at_2=POINTS, faces=4, feather=True):
    stage = Usd.Stage.CreateNew(str(path))
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(3)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/c").GetPrim())
    mesh = UsdGeom.Mesh.Define(stage, "/c/f")
    mesh.CreateFaceVertexCountsAttr([4] * (faces // 4))
    mesh.CreateFaceVertexIndicesAttr(list(range(faces)))
    attribute = mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(POINTS))
    for code in (1, 2, 3):
        points = points_at_2 if code == 2 else POINTS
        attribute.Set(Vt.Vec3fArray.FromNumpy(np.asarray(points, np.float32).copy()), code)
    if feather:
        kind = Sdf.ValueTypeNames.StringArray
        UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("featherId", kind, "constant").Set(["f"])
    stage.GetRootLayer().Save()
    return path


DAMAGED = {
    "nan": np.where(np.arange(12).reshape(4, 3) == 4, np.nan, POINTS),
    "inf": np.where(np.arange(12).reshape(4, 3) == 11, np.inf, POINTS),
    "empty": np.zeros((0, 3)),
    "fewer": POINTS[:3],
}
COMMANDS = {
    "retime": lambda path: retime(path, path.with_name("o.usda"), speed=0.5),
    "meshes": lambda path: export(path, path.with_name("o.ply")),
    "pose": lambda path: Cache(path).pose(0, 2.0),
}


@pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS)
@pytest.mark.parametrize("points", DAMAGED.values(), ids=DAMAGED)
def test_damaged_points_are_one_message(tmp_path, points, command):
    with pytest.raises(InputError) as caught:
        command(write_cache(tmp_path / "c.usda", points))
    (problem,) = caught.value.problems
    assert problem.key == "/c/f.points"
    assert "at time code 2" in problem.message
    assert not [each for each in tmp_path.iterdir() if each.name != "c.usda"]


@pytest.mark.parametrize("name", ["velocities", "normals", "primvars:own"])
def test_a_sample_of_another_size_is_not_retimed(tmp_path, name):
    path = write_cache(tmp_path / "c.usda")
    stage = Usd.Stage.Open(str(path))
    kind = Sdf.ValueTypeNames.Vector3fArray
    attribute = stage.GetPrimAtPath("/c/f").CreateAttribute(name, kind)
    for code in (1, 2, 3):
        attribute.Set(Vt.Vec3fArray.FromNumpy(POINTS[: 0 if code == 2 else 4].copy()), code)
    stage.GetRootLayer().Save()
    with pytest.raises(InputError, match=f"/c/f.{name}: has 0 values at time code 2, not 4"):
        COMMANDS["retime"](path)
    assert not (tmp_path / "o.usda").exists()


@pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS)
def test_a_feather_without_faces_is_one_message(tmp_path, command):
    with pytest.raises(InputError, match=r"/c/f.faceVertexCounts: is empty"):
        command(write_cache(tmp_path / "c.usda", faces=0))


def test_other_meshes_without_faces_are_left_out_with_a_warning(tmp_path):
    path = write_cache(tmp_path / "c.usda", faces=0, feather=False)
    with pytest.warns(InputWarning, match="/c/f has no faces"), pytest.raises(InputError) as caught:
        Cache(path)
    assert "holds no visible mesh" in str(caught.value)
