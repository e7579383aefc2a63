"""Meshes finer than what is simulated, barbs as curves, and what the variants draw."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from places import SAMPLES
from pxr import Usd, UsdGeom

import featherfx
from featherfx.errors import InputError

PULL = SAMPLES / "feather_pull/shot.toml"
FRAMES = (8, 12)
DENSE = {"render_rows": 60, "render_columns": 10, "barbs": 80, "accelerations": True}


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("plain") / "pull.usdc"
    featherfx.bake(PULL, path, frames=FRAMES)
    return path


@pytest.fixture(scope="module")
def dense(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("dense") / "pull.usda"
    featherfx.bake(PULL, path, frames=FRAMES, layout="clips", chunk=2, **DENSE)
    return path


def gprim(stage, kind, scope):
    (found,) = (prim for prim in stage.GetPrimAtPath(f"/pull/{scope}").GetChildren())
    return kind(found)


def points(geometry, code):
    return np.array(geometry.GetPointsAttr().Get(code), dtype=float)


def test_the_dense_mesh_lies_on_the_simulated_one(plain, dense):
    """Every simulated point is near a dense one; ends and root are the same points."""
    from scipy.spatial import cKDTree

    stages = Usd.Stage.Open(str(plain)), Usd.Stage.Open(str(dense))
    coarse, fine = (gprim(stage, UsdGeom.Mesh, "feathers") for stage in stages)
    assert coarse.GetPath() == fine.GetPath()
    assert len(points(fine, 8)) > 3 * len(points(coarse, 8))
    for code in (8, 10, 12):
        moved = np.abs(points(coarse, code) - points(coarse, Usd.TimeCode.Default())).max()
        assert moved > 1e-3
        few, many = points(coarse, code), points(fine, code)
        far = cKDTree(many).query(few)[0].max()
        assert far < 0.02 * np.ptp(few, axis=0).max()
    shafts = [points(gprim(s, UsdGeom.BasisCurves, "rachises"), 11) for s in stages]
    assert len(shafts[1]) == DENSE["render_rows"]
    np.testing.assert_allclose(shafts[0][[0, -1]], shafts[1][[0, -1]], atol=1e-6)


@pytest.mark.parametrize("scope", ["feathers", "barbs", "rachises"])
def test_velocities_are_rates_of_the_points(dense, scope):
    stage = Usd.Stage.Open(str(dense))
    kind = UsdGeom.Mesh if scope == "feathers" else UsdGeom.BasisCurves
    geometry = gprim(stage, kind, scope)
    codes = geometry.GetPointsAttr().GetTimeSamples()
    assert codes == list(range(FRAMES[0], FRAMES[1] + 1))
    assert geometry.GetAccelerationsAttr().GetTimeSamples() == codes
    rate = 0.5 * stage.GetTimeCodesPerSecond() * (points(geometry, 11) - points(geometry, 9))
    speed = np.array(geometry.GetVelocitiesAttr().Get(10))
    cosine = (rate * speed).sum() / np.linalg.norm(rate) / np.linalg.norm(speed)
    assert cosine > 0.9


def test_barbs_are_curves_with_widths_and_padded_extents(dense):
    stage = Usd.Stage.Open(str(dense))
    barbs = gprim(stage, UsdGeom.BasisCurves, "barbs")
    counts = np.array(barbs.GetCurveVertexCountsAttr().Get())
    assert abs(len(counts) - 2 * DENSE["barbs"]) <= 6
    assert (
        barbs.GetPrim().GetName()
        == gprim(stage, UsdGeom.Mesh, "feathers").GetPrim().GetName() + "_barbs"
    )
    half = 0.5 * np.array(barbs.GetWidthsAttr().Get()).max()
    for code in (8, 11):
        placed = points(barbs, code)
        assert len(placed) == counts.sum() == len(barbs.GetWidthsAttr().Get())
        wanted = np.stack([placed.min(axis=0) - half, placed.max(axis=0) + half])
        np.testing.assert_allclose(barbs.GetExtentAttr().Get(code), wanted, atol=1e-6)
    assert not featherfx.check(dense)


def test_variants_change_what_is_drawn_and_nothing_else(dense):
    stage = Usd.Stage.Open(str(dense))
    variants = stage.GetPrimAtPath("/pull").GetVariantSet("representation")
    assert variants.GetVariantSelection() == "vane"
    hidden = "hidden"
    wanted = {
        "vane": ("default", hidden, "guide"),
        "barbs": ("proxy", "render", "render"),
        "rachis": (hidden, hidden, "default"),
    }
    assert sorted(variants.GetVariantNames()) == sorted(wanted)
    paths = [prim.GetPath() for prim in stage.Traverse()]
    for name, drawn in wanted.items():
        variants.SetVariantSelection(name)
        assert [prim.GetPath() for prim in stage.Traverse()] == paths
        for scope, expected in zip(("feathers", "barbs", "rachises"), drawn, strict=True):
            image = UsdGeom.Imageable(stage.GetPrimAtPath(f"/pull/{scope}").GetChildren()[0])
            seen = image.ComputeVisibility() != "invisible"
            assert (image.ComputePurpose() if seen else hidden) == expected
            kind = UsdGeom.Mesh if scope == "feathers" else UsdGeom.BasisCurves
            assert len(kind(image.GetPrim()).GetPointsAttr().GetTimeSamples()) == 5


def test_without_barbs_there_is_no_such_variant(plain):
    stage = Usd.Stage.Open(str(plain))
    names = stage.GetPrimAtPath("/pull").GetVariantSet("representation").GetVariantNames()
    assert sorted(names) == ["rachis", "vane"]
    assert not stage.GetPrimAtPath("/pull/barbs")


def test_every_number_out_of_range_is_told(tmp_path):
    with pytest.raises(InputError) as caught:
        featherfx.bake(PULL, tmp_path / "a.usdc", render_rows=2, render_columns=0, barbs=0)
    keys = [problem.key for problem in caught.value.problems]
    assert keys == ["render_rows", "render_columns", "barbs"]
    assert not list(tmp_path.iterdir())


def test_a_finished_cache_of_another_density_is_not_taken_over(plain):
    with pytest.raises(InputError, match="render grid"):
        featherfx.bake(PULL, plain, frames=FRAMES, resume=True, render_rows=40)


def samples(path):
    """Point data of every curve and mesh at every frame, by prim."""
    stage = Usd.Stage.Open(str(path))
    return {
        str(prim.GetPath()): [np.array(UsdGeom.PointBased(prim).GetPointsAttr().Get(c)).tobytes()
                              for c in range(FRAMES[0], FRAMES[1] + 1)]
        for prim in stage.Traverse() if prim.IsA(UsdGeom.PointBased)
    }  # fmt: skip


def test_a_resumed_bake_gives_the_same_barbs(tmp_path, dense):
    """Stopped after three of five frames, two of which were safe on disk."""

    def stop(done, total):
        if done == 3:
            raise KeyboardInterrupt

    path = tmp_path / "pull.usda"
    options = {"frames": FRAMES, "layout": "clips", "chunk": 2, **DENSE}
    with pytest.raises(KeyboardInterrupt):
        featherfx.bake(PULL, path, progress=stop, **options)
    report = featherfx.bake(PULL, path, resume=True, **options).report
    assert report["samples_taken_over"] == 2
    assert samples(path) == samples(dense)
