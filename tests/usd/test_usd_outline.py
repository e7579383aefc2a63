"""Holes in an outline of meshes whose figures are known."""

from __future__ import annotations

import numpy as np
import pytest
from commands import invoke
from pxr import Gf, Sdf, Usd, UsdGeom

from featherfx.baking.pipeline import measure_holes

SLIT, SIZE = 0.003, 0.05


def strip(stage, name, low, high, frames=()):
    """A quad in the plane of `high` as a feather. low, high: corners; frames: (code, shift)."""
    (x, y, z), (u, v, w) = low, high
    corners = np.array([[x, y, z], [u, y, z], [u, v, w], [x, v, w]])
    mesh = UsdGeom.Mesh.Define(stage, f"/{name}")
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    tagged = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("featherId", Sdf.ValueTypeNames.String)
    tagged.Set(name)
    attribute = mesh.CreatePointsAttr([Gf.Vec3f(*map(float, each)) for each in corners])
    for code, shift in frames:
        attribute.Set([Gf.Vec3f(*map(float, each + shift)) for each in corners], code)


def frame_of_strips(path, unit=1.0, up="Z", slit=SLIT):
    """Four strips around a slit of 10 by 3 mm, and a gap beside them that is open to one side."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, unit)
    UsdGeom.SetStageUpAxis(stage, up)

    def put(name, low, high):
        places = [np.array([*each, 0.0]) / unit for each in (low, high)]
        if up == "Y":
            places = [each[[0, 2, 1]] * (1, 1, -1) for each in places]
        strip(stage, name, *places)

    put("left", (0.0, 0.0), (0.02, SIZE))
    put("right", (0.03, 0.0), (SIZE, SIZE))
    put("below", (0.02, 0.0), (0.03, 0.01))
    put("above", (0.02, 0.01 + slit), (0.03, 0.03))
    stage.GetRootLayer().Save()


@pytest.mark.parametrize(("unit", "up"), [(1.0, "Z"), (0.01, "Y")])
def test_the_widest_circle_of_an_enclosed_gap(tmp_path, unit, up):
    frame_of_strips(tmp_path / "a.usda", unit, up)
    (found,) = measure_holes(tmp_path / "a.usda", "top")
    assert found["holes"] == 1
    assert found["widest"] == pytest.approx(SLIT, abs=2.0 * found["pixel"])
    assert 0.02 < found["place"][0] < 0.03
    # from the side it is a line
    (beside,) = measure_holes(tmp_path / "a.usda", "front")
    assert beside["holes"] == 0
    assert beside["widest"] == 0.0


def test_what_touches_has_no_hole(tmp_path):
    frame_of_strips(tmp_path / "a.usda", slit=0.0)
    done = invoke("check", "--holes", "top", tmp_path / "a.usda")
    assert done.stdout == "holes: 0, the widest 0.00 mm, at rest\n"


def tagged(stage, name, region=None):
    """A strip of frame_of_strips: of a region, or without one no feather."""
    prim = stage.GetPrimAtPath(f"/{name}")
    if region is None:
        prim.RemoveProperty("primvars:featherId")
    else:
        api = UsdGeom.PrimvarsAPI(prim)
        api.CreatePrimvar("region", Sdf.ValueTypeNames.String).Set(region)


@pytest.mark.parametrize(
    ("legs", "bare", "gaps"),
    [
        (["below"], [], 1),  # between leg and belly
        (["left"], [], 0),  # beside a corner of it
        (["left", "right", "below", "above"], [], 0),  # among the feathers of one leg
        ([], ["above", "below"], 1),  # between leg and leg
        ([], ["left"], 0),  # skin shows at its end
    ],
)
def test_gaps_beside_legs_are_told_apart(tmp_path, legs, bare, gaps):
    frame_of_strips(tmp_path / "a.usda")
    stage = Usd.Stage.Open(str(tmp_path / "a.usda"))
    for name in legs:
        tagged(stage, name, "thigh")
    for name in bare:
        tagged(stage, name)
    stage.GetRootLayer().Save()
    (found,) = measure_holes(tmp_path / "a.usda", "top")
    assert (found["holes"], found["gaps"]) == (1 - gaps, gaps)
    wide = found["widest_gap" if gaps else "widest"]
    assert wide == pytest.approx(SLIT, abs=2.0 * found["pixel"])
    assert min(found["widest"], found["widest_gap"]) == 0.0
    told = invoke("check", "--holes", "top", tmp_path / "a.usda").stdout
    assert ("beside legs" in told) == bool(gaps)
