"""Feathers kilometres from the world's origin: points are written from a root prim beside them."""

from __future__ import annotations

import numpy as np
import pytest
from places import COARSE
from pxr import Usd, UsdGeom

import featherfx
from featherfx.baking import pipeline

AT = (9000.25, -8000.5, 40.0)
GROOM = """
name = "far"
[[feather]]
id = "a"
kind = "covert"
position = [{0}, {1}, {2}]
scale = 0.3
[[feather]]
id = "b"
kind = "swan_primary"
position = [{0}, {1}, {2}]
"""
SHOT = (
    COARSE
    + """
name = "far"
groom = "groom.toml"
frames = [1, 3]
frames_per_second = 24
motion = "hold"
"""
)


@pytest.fixture
def shot(tmp_path):
    (tmp_path / "groom.toml").write_text(GROOM.format(*AT))
    (tmp_path / "shot.toml").write_text(SHOT)
    return tmp_path / "shot.toml"


def world_points(path, code):
    """Feather id to (V, 3), double precision, stage units."""
    stage, found = Usd.Stage.Open(str(path)), {}
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Mesh):
            matrix = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(code))
            local = np.array(prim.GetAttribute("points").Get(code), dtype=float)
            name = UsdGeom.PrimvarsAPI(prim).GetPrimvar("featherId").Get()[0]
            found[name] = local @ matrix[:3, :3] + matrix[3, :3]
    return found


@pytest.mark.parametrize(
    "options",
    [
        {"layout": "flat"},
        {"layout": "clips"},
        {"layout": "payload", "meters_per_unit": 0.01, "up_axis": "Y"},
        {"layout": "flat", "render_rows": 60, "barbs": 20},
    ],
)
def test_a_cache_far_away_is_sound_and_exact(shot, tmp_path, options):
    path = tmp_path / "far.usda"
    featherfx.bake(shot, path, **options)
    assert pipeline.check(path) == []
    near = (tmp_path / "groom.toml").read_text()
    for far, zero in zip(AT, (0.0, 0.0, 0.0), strict=True):
        near = near.replace(str(far), str(zero))
    (tmp_path / "groom.toml").write_text(near)
    featherfx.bake(shot, tmp_path / "near.usda", **options)
    unit = options.get("meters_per_unit", 1.0)
    at = np.array(AT if "up_axis" not in options else (AT[0], AT[2], -AT[1])) / unit
    for code in (1.0, 3.0):
        there, here = world_points(path, code), world_points(tmp_path / "near.usda", code)
        for name in ("a", "b"):
            np.testing.assert_allclose(there[name] - at, here[name], atol=2e-7 / unit)


def test_shares_stand_in_the_same_place(shot, tmp_path):
    for number in (1, 2):
        featherfx.bake(shot, tmp_path / "far.usdc", feathers=(number, 2))
    featherfx.join(tmp_path / "far.usdc", 2)
    featherfx.bake(shot, tmp_path / "whole.usdc")
    assert pipeline.check(tmp_path / "far.usdc") == []
    joined, whole = (world_points(tmp_path / f"{n}.usdc", 3.0) for n in ("far", "whole"))
    for name in ("a", "b"):
        np.testing.assert_array_equal(joined[name], whole[name])


@pytest.mark.parametrize("instances", [True, False])
def test_rest_feathers_far_away_are_sound(shot, tmp_path, instances):
    path = tmp_path / "rest.usdc"
    featherfx.export_groom(tmp_path / "groom.toml", path, instances=instances)
    assert pipeline.check(path) == []
    stage = Usd.Stage.Open(str(path))
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), [UsdGeom.Tokens.default_])
    box = cache.ComputeWorldBound(stage.GetDefaultPrim()).ComputeAlignedRange()
    assert np.abs(np.array(box.GetMidpoint()) - AT).max() < 1.0


def test_near_caches_have_no_transform(tmp_path, shot):
    (tmp_path / "groom.toml").write_text(GROOM.format(50.0, 0.0, 0.0))
    featherfx.bake(shot, tmp_path / "near.usda")
    assert "xformOp" not in (tmp_path / "near.usda").read_text()


@pytest.mark.parametrize(("length", "away"), [(0.01, 10_000), (0.05, -20_000), (0.3, 5_000)])
def test_a_groom_at_home_is_at_rest_there_whatever_its_skin_does(tmp_path, length, away):
    near, far = (
        [(x + d, y, 0) for x, y in ((-3, -3), (3, -3), (3, 3), (-3, 3))] for d in (0, away)
    )
    (tmp_path / "skin.usda").write_text(
        '#usda 1.0\n( upAxis = "Z"\n metersPerUnit = 1 )\ndef Mesh "m" {\n'
        "int[] faceVertexCounts = [4]\nint[] faceVertexIndices = [0, 1, 2, 3]\n"
        f"point3f[] points = {near}\npoint3f[] points.timeSamples = {{ 1: {far} }}\n}}\n"
    )
    feather = f'[[feather]]\nid = "a"\nkind = "covert"\noverrides = {{ length = {length} }}\n'
    (tmp_path / "groom.toml").write_text(
        f'name = "g"\n{feather}position = [0, 0, 0.01]\ndirection = [-1, 0, 2]\nup = [2, 0, 1]\n'
    )
    skin = 'frames = [1, 2]\nskin = { usd = "skin.usda", prim = "/m", tolerance = 1000 }\n'
    (tmp_path / "shot.toml").write_text(f'{COARSE}name = "s"\ngroom = "groom.toml"\n{skin}')
    report = featherfx.bake(tmp_path / "shot.toml", tmp_path / "o.usdc")
    assert report.report["bounds_passed"] == []
    stage = Usd.Stage.Open(str(tmp_path / "o.usdc"))
    (mesh,) = (prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh))
    rest = np.array(mesh.GetAttribute("primvars:rest").Get(), dtype=float)
    assert np.linalg.norm(np.ptp(rest, axis=0)) == pytest.approx(length, rel=0.15)
