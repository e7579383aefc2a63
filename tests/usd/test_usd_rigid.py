"""Feathers that move rigidly as transforms."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from feathers import entries, frame
from pxr import Usd, UsdGeom

from featherfx.errors import InputError
from featherfx.shot.frames import FeatherPose, Frame
from featherfx.usd.check.check import check_usd
from featherfx.usd.convert.rigid import export_rigid, fit_rigid_motion
from featherfx.usd.read.cache import Cache
from featherfx.usd.write.cache_writer import CacheWriter
from featherfx.usd.write.options import WriteOptions

FRAMES = (1, 6)
BENT = "primary 1"
# world points of every mesh at some times, by plain USD
READER = """
import json, sys
import numpy as np
from pxr import Usd, UsdGeom
stage, found = Usd.Stage.Open(sys.argv[1]), {}
for code in (1, 2.5, 6):
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Mesh):
            to_world = np.array(UsdGeom.XformCache(code).GetLocalToWorldTransform(prim))
            points = np.array(UsdGeom.Mesh(prim).GetPointsAttr().Get(code))
            ids = UsdGeom.PrimvarsAPI(prim).GetPrimvar("featherId").Get()
            found[f"{code} {ids[0]}"] = (points @ to_world[:3, :3] + to_world[3, :3]).tolist()
print(json.dumps(found))
"""


def bent(number: int) -> Frame:
    """The frame of the small cache, but the second feather bends by up to 2 mm."""
    given = frame(number)
    own = given.poses[1]
    up = 0.002 * np.sin(number) * np.linspace(0, 1, 4)[:, None, None] ** 2
    nodes = own.points.nodes + up * np.array([0.0, 0.0, 1.0])
    changed = FeatherPose(own.points._replace(nodes=nodes), own.velocities, own.accelerations)
    return Frame(given.number, given.time, (given.poses[0], changed, *given.poses[2:]))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("rigid")
    for group in ("feather", "all"):
        options = WriteOptions(group=group, diagnostics=("strain",))
        with CacheWriter(made / f"{group}.usdc", entries(), FRAMES, 24.0, options) as writer:
            for number in range(FRAMES[0], FRAMES[1] + 1):
                writer.write(bent(number))
        export_rigid(made / f"{group}.usdc", made / f"{group}_rigid.usda", 0.05)
    return made


@pytest.mark.parametrize("group", ["feather", "all"])
def test_poses_stay_within_the_tolerance(folder, group):
    before, after = Cache(folder / f"{group}.usdc"), Cache(folder / f"{group}_rigid.usda")
    numbers = {each.id: k for k, each in enumerate(after.feathers)}
    assert len(numbers) == len(before.feathers)
    for k, each in enumerate(before.feathers):
        other = after.feathers[numbers[each.id]]
        assert np.array_equal(each.triangles, other.triangles)
        assert (each.kind, each.region) == (other.kind, other.region)
        assert each.subsets.keys() == other.subsets.keys()
        for code in range(FRAMES[0], FRAMES[1] + 1):
            one, two = before.pose(k, code), after.pose(numbers[each.id], code)
            assert np.linalg.norm(one.points - two.points, axis=1).max() < 5e-5
            assert np.abs(one.normals - two.normals).max() < 2e-3
            assert np.abs(one.barb_direction - two.barb_direction).max() < 2e-3


@pytest.mark.parametrize("group", ["feather", "all"])
def test_the_result_is_a_sound_cache_that_says_what_it_is(folder, group):
    path = folder / f"{group}_rigid.usda"
    assert check_usd(path) == []
    stage = Usd.Stage.Open(str(path))
    told = stage.GetRootLayer().customLayerData["featherfx"]
    # those that do not move are still in a cache of one a prim, and moved in a group
    assert told["rigid"] == (1 if group == "feather" else 3)
    moving = [
        prim
        for prim in stage.Traverse()
        if prim.IsA(UsdGeom.Mesh) and UsdGeom.Mesh(prim).GetPointsAttr().GetNumTimeSamples()
    ]
    (one,) = moving
    assert list(UsdGeom.PrimvarsAPI(one).GetPrimvar("featherId").Get()) == [BENT]
    flapping = stage.GetPrimAtPath(f"/{group}/feathers/primary_1")
    assert not flapping.GetAttribute("velocities").HasValue()
    assert flapping.GetAttribute("xformOp:orient").GetNumTimeSamples() == 6
    shaft = stage.GetPrimAtPath(f"/{group}/rachises/primary_1_rachis")
    assert shaft.GetAttribute("xformOp:orient").GetNumTimeSamples() == 6


def test_another_program_sees_the_same(folder):
    found = []
    for name in ("feather.usdc", "feather_rigid.usda"):
        run = [sys.executable, "-c", READER, str(folder / name)]
        done = subprocess.run(run, capture_output=True, check=True, text=True)
        found.append(json.loads(done.stdout))
    assert found[0].keys() == found[1].keys()
    assert len(found[0]) == 12
    for key, points in found[0].items():
        # between frames one goes straight, the other round
        assert np.array(found[1][key]) == pytest.approx(np.array(points), abs=2e-4), key


def test_what_fits_is_the_best_rotation():
    rng = np.random.default_rng(3)
    shape = rng.normal(size=(40, 3))
    turns = np.linalg.qr(rng.normal(size=(5, 3, 3)))[0]
    turns *= np.linalg.det(turns)[:, None, None]
    places = rng.normal(size=(5, 3))
    motion, off = fit_rigid_motion(np.einsum("fij,vj->fvi", turns, shape) + places[:, None])
    assert off < 1e-12
    assert motion.turns[0] == pytest.approx(np.eye(3), abs=1e-12)
    assert motion.turns @ turns[0] == pytest.approx(turns, abs=1e-12)
    noise = 1e-3 * rng.normal(size=(5, 40, 3))
    _, off = fit_rigid_motion(np.einsum("fij,vj->fvi", turns, shape) + places[:, None] + noise)
    assert 1e-3 < off < 6e-3


def test_what_cannot_be_is_told(folder, tmp_path):
    with pytest.raises(InputError, match="above 0 mm"):
        export_rigid(folder / "all.usdc", tmp_path / "a.usdc", 0.0)
    with CacheWriter(tmp_path / "still.usdc", entries(), None):
        pass
    with pytest.raises(InputError, match="no meshes of feathers that move"):
        export_rigid(tmp_path / "still.usdc", tmp_path / "a.usdc", 0.1)
    assert not (tmp_path / "a.usdc").exists()
