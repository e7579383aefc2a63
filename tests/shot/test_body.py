"""Bodies that an act carries, and the layer that shows them."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest
from farm.farm_cases import SerialEngine, options_of
from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt

import featherfx
from featherfx.algebra.rotation import from_angles
from featherfx.baking import pipeline
from featherfx.errors import InputError
from featherfx.farm.job import Job
from featherfx.shot.motion.motion import root_motion
from featherfx.usd.read.cache import Cache
from featherfx.usd.read.scenery import find_scenery

GROOM = """
name = "bird"
[[wing]]
id = "right_wing"
type = "pigeon"
shoulder = [0.03, -0.03, 0.03]
fold = 0
mirror = "y"
[[feather]]
id = "breast"
kind = "contour"
position = [0.02, 0, 0.05]
direction = [-1, 0, 0.2]
up = [0, 0, 1]
"""
TURN, WAY = (0.0, -30.0, 0.0), (0.2, 0.1, 0.4)
SHOT = f"""
name = "s"
groom = "groom.toml"
frames = [1, 7]
quality = "draft"
[skin]
usd = "body.usda"
prim = "/bird/body"
tolerance = 1
[[detail]]
level = "rigid"
[motion]
kind = "act"
body = "act"
[[motion.motions]]
kind = "keys"
keyframes = [
  {{ time = 0, rotation = [0, 0, 0], position = [0, 0, 0] }},
  {{ time = 0.25, rotation = {list(TURN)}, position = {list(WAY)} }},
]
[[motion.motions]]
kind = "fold"
joints = "*_wing_*"
folds = [{{ time = 0, fold = 0 }}, {{ time = 0.25, fold = 0.5 }}]
"""
CUBE = 0.05 * np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
FACES = [0, 1, 3, 2, 4, 6, 7, 5, 0, 4, 5, 1, 2, 3, 7, 6, 0, 2, 6, 4, 1, 5, 7, 3]


def write_body(path, kind, up="Z", unit=1.0):
    """A cube that stands still, walks by its points, or by a skeleton."""
    stage = Usd.Stage.CreateNew(str(path))
    stage.SetMetadata("metersPerUnit", unit)
    UsdGeom.SetStageUpAxis(stage, up)
    points = CUBE[:, [0, 2, 1]] * (1, 1, -1) if up == "Y" else CUBE
    points = points / unit
    stage.SetDefaultPrim(
        (UsdSkel.Root if kind == "skeleton" else UsdGeom.Xform).Define(stage, "/bird").GetPrim()
    )
    mesh = UsdGeom.Mesh.Define(stage, "/bird/body")
    mesh.CreateFaceVertexCountsAttr([4] * 6)
    mesh.CreateFaceVertexIndicesAttr(FACES)
    mesh.CreateSubdivisionSchemeAttr("none")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.float32(points)))
    if kind == "points":
        for code in range(1, 8):
            moved = np.float32(points + 0.01 / unit * (code - 1))
            mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(moved), code)
    if kind == "skeleton":
        skeleton = UsdSkel.Skeleton.Define(stage, "/bird/skeleton")
        skeleton.CreateJointsAttr(["root"])
        for make in (skeleton.CreateBindTransformsAttr, skeleton.CreateRestTransformsAttr):
            make([Gf.Matrix4d(1.0)])
        walk = UsdSkel.Animation.Define(stage, "/bird/skeleton/walk")
        walk.CreateJointsAttr(["root"])
        walk.CreateScalesAttr([Gf.Vec3h(1.0)])
        walk.CreateRotationsAttr([Gf.Quatf(1.0)])
        for code in range(1, 8):
            walk.CreateTranslationsAttr().Set([Gf.Vec3f(0.01 / unit * (code - 1))], code)
        binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
        binding.CreateSkeletonRel().SetTargets(["/bird/skeleton"])
        binding.CreateJointIndicesPrimvar(False, 1).Set([0] * 8)
        binding.CreateJointWeightsPrimvar(False, 1).Set([1.0] * 8)
        UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets(
            ["/bird/skeleton/walk"]
        )
    stage.Save()


@pytest.fixture
def shot(tmp_path):
    (tmp_path / "groom.toml").write_text(GROOM)
    (tmp_path / "shot.toml").write_text(SHOT)
    return tmp_path / "shot.toml"


@pytest.mark.parametrize(
    ("kind", "up", "unit"), [("still", "Z", 1.0), ("points", "Y", 0.01), ("skeleton", "Y", 0.01)]
)
def test_an_act_carries_skin_and_roots_as_one(shot, tmp_path, kind, up, unit):
    write_body(tmp_path / "body.usda", kind, up, unit)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        read = featherfx.read_shot(shot)
    said = [each for each in told if "without its own animation" in str(each.message)]
    assert len(said) == (kind != "still")
    first, last = (root_motion(read).frames(time) for time in (0.0, 0.25))
    turn = from_angles(TURN, "xyz")
    breast = next(k for k, each in enumerate(read.groom.feathers) if each.id == "breast")
    there = first.positions[breast] @ turn.T + WAY
    np.testing.assert_allclose(last.positions[breast], there, atol=1e-6)
    np.testing.assert_allclose(last.rotations[breast], turn @ first.rotations[breast], atol=1e-6)
    cache = featherfx.bake(read, tmp_path / "out.usdc")
    assert featherfx.check(cache.path) == []
    layer = tmp_path / "out.body.usda"
    for code, (moved, way) in {1.0: (np.eye(3), np.zeros(3)), 7.0: (turn, WAY)}.items():
        (body,) = find_scenery(Cache(cache.path).scenery, cache.path, ["skin"], "drawn")
        assert body.scene.path == layer
        np.testing.assert_allclose(body.points(code), CUBE @ moved.T + way, atol=1e-6)


def test_a_layer_replaces_no_file_unasked_and_no_skin(shot, tmp_path):
    write_body(tmp_path / "body.usda", "still")
    layer = tmp_path / "out.body.usda"
    layer.write_text("mine")
    with pytest.raises(InputError, match=r"out\.body\.usda"):
        featherfx.bake(shot, tmp_path / "out.usdc")
    assert layer.read_text() == "mine"
    (tmp_path / "body.usda").rename(layer)
    shot.write_text(SHOT.replace("body.usda", "out.body.usda"))
    with pytest.raises(InputError, match=r"out\.body\.usda"):
        featherfx.bake(shot, tmp_path / "out.usdc", overwrite=True)


def test_a_skin_that_moves_the_body_writes_no_layer(shot, tmp_path):
    write_body(tmp_path / "body.usda", "points")
    shot.write_text(SHOT.replace('body = "act"', ""))
    featherfx.bake(shot, tmp_path / "out.usdc")
    assert not list(tmp_path.glob("*.body*.usda"))


FLOOR = """
[[collider]]
usd = "floor.usda"
prims = ["/floor"]
"""


@pytest.mark.parametrize(
    ("low", "away", "said"),
    [
        (-0.031, 0.0, "by 31 mm at frame 4. Give a path"),
        (0.01, 0.0, ""),
        # beside the floor and back, below it
        (-0.031, 1.0, ""),
    ],
)
def test_a_body_that_goes_through_the_floor_is_told(shot, tmp_path, low, away, said):
    """It stands 5 mm within the floor at first, and goes down and up again."""
    write_body(tmp_path / "body.usda", "still")
    stage = Usd.Stage.CreateNew(str(tmp_path / "floor.usda"))
    floor = UsdGeom.Mesh.Define(stage, "/floor")
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]) * 0.5 - (0, 0, 0.045)
    floor.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.float32(corners)))
    floor.CreateFaceVertexCountsAttr([4])
    floor.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.Save()
    beside = [
        (0.04, (away, 0, 0)),
        (0.125, (away, 0, low)),
        (0.21, (away, 0, 0)),
        (0.25, (0, 0, 0)),
    ]
    keys = [f"{{ time = {time}, position = {list(place)} }}" for time, place in beside]
    start = "keyframes = [{ time = 0, position = [0, 0, 0] }, "
    text = re.sub(r"keyframes = \[\n.*?\n\]", f"{start}{', '.join(keys)}]", SHOT, flags=re.S)
    shot.write_text(text.replace("[motion]", f"{FLOOR}[motion]"))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        featherfx.read_shot(shot)
    found = [str(each.message) for each in told if "through" in str(each.message)]
    assert [each.partition("/floor, ")[2][: len(said)] for each in found] == [said] * bool(said)


def test_the_body_of_a_take_off_leaves_the_ground(shot, tmp_path):
    """Wings go with it: as a whole the bird is where its act takes it."""
    write_body(tmp_path / "body.usda", "still")
    head = SHOT.partition("[motion]")[0].replace("[1, 7]", "[1, 30]")
    shot.write_text(head + '[motion]\nbase = "take_off"\nfit = "none"\n')
    read = featherfx.read_shot(shot)
    motion = root_motion(read)
    start, end = (motion.frames(time).positions for time in (0.0, 29.0 / 24.0))
    assert (end[:, 2] - start[:, 2]).min() > 0.3
    spread = [np.linalg.norm(each - each.mean(axis=0), axis=1).max() for each in (start, end)]
    assert spread[1] < 3.0 * spread[0]


def test_shares_of_a_bake_have_one_layer_between_them(shot, tmp_path):
    write_body(tmp_path / "body.usda", "still")
    featherfx.bake(shot, tmp_path / "whole.usdc")
    for k in (2, 1):
        featherfx.bake(shot, tmp_path / "out.usdc", feathers=(k, 2))
    pipeline.join(tmp_path / "out.usdc", 2)
    names = [each.name for each in sorted(tmp_path.glob("*.body*.usda"))]
    assert names == ["out.body.usda", "whole.body.usda"]
    texts = [(tmp_path / each).read_text() for each in names]
    assert texts[0] == texts[1]
    (body,) = find_scenery(
        Cache(tmp_path / "out.usdc").scenery, tmp_path / "out.usdc", ["skin"], "drawn"
    )
    assert body.scene.path == tmp_path / "out.body.usda"
    with pytest.raises(InputError, match=r"out\.body\.usda"):
        featherfx.bake(shot, tmp_path / "out.usda")
    (tmp_path / "out.body.usda").write_text("mine")
    with pytest.raises(InputError, match=r"out\.body\.usda"):
        featherfx.bake(shot, tmp_path / "out.usda", feathers=(1, 2))


@pytest.mark.nightly
def test_a_job_leaves_the_layer_beside_its_cache_alone(shot, tmp_path):
    write_body(tmp_path / "body.usda", "still")
    featherfx.bake(shot, tmp_path / "whole.usdc")
    options = options_of(chunk=3, layout="flat")
    out = tmp_path / "out"
    out.mkdir()
    told = Job([shot], [out / "out.usdc"], options, SerialEngine(), 3, lambda *_: None).run()
    assert told
    assert sorted(each.name for each in out.iterdir()) == ["out.body.usda", "out.usdc"]
    find = find_scenery(Cache(out / "out.usdc").scenery, out / "out.usdc", ["skin"], "drawn")
    assert next(iter(find)).scene.path == out / "out.body.usda"
