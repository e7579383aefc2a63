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
