"""Every planted defect is found, and a clean file has none."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
from commands import invoke
from pxr import Sdf, Usd, UsdGeom, Vt

from featherfx.usd.check import geometry
from featherfx.usd.check.check import check_usd

MESH = "/usdc/feathers/primary_1"
STILL = "/usdc/feathers/covert"
CURVE = "/usdc/rachises/primary_1_rachis"


@pytest.mark.parametrize("kind", ["usda", "usdc", "usd", "payload"])
def test_a_clean_file_has_no_problems(caches, kind):
    assert check_usd(caches[kind]) == []


def change(path: str, name: str, code: float | None, function):
    """A defect: one value of an attribute replaced by function(value as numpy)."""

    def plant(stage):
        attribute = stage.GetPrimAtPath(path).GetAttribute(name)
        at = Usd.TimeCode.Default() if code is None else Usd.TimeCode(code)
        old = attribute.Get(at)
        value = function(np.array(old))
        is_vector = value.ndim == 2
        made = (Vt.Vec3fArray if is_vector else type(old)).FromNumpy(np.ascontiguousarray(value))
        attribute.Set(made, at)

    return plant


def with_value(index, number):
    def function(values):
        values[index] = number
        return values

    return function


def metadata(name: str):
    return lambda stage: stage.ClearMetadata(name)


def flip(stage):
    attribute = stage.GetPrimAtPath(STILL).GetAttribute("faceVertexIndices")
    indices = np.array(attribute.Get())
    indices[3:6] = indices[[3, 5, 4]]
    attribute.Set(Vt.IntArray.FromNumpy(indices))


def sample_static(stage):
    attribute = stage.GetPrimAtPath(STILL).GetAttribute("primvars:st")
    attribute.Set(attribute.Get(), 2.0)


def sample_still_points(stage):
    for name in ("points", "extent", "normals"):
        attribute = stage.GetPrimAtPath(STILL).GetAttribute(name)
        attribute.Set(attribute.Get(), 2.0)


def scalar_primvar(stage):
    prim = stage.GetPrimAtPath(STILL)
    UsdGeom.PrimvarsAPI(prim).CreatePrimvar("mass", Sdf.ValueTypeNames.Float).Set(1.0)


def subset(indices):
    def plant(stage):
        prim = stage.GetPrimAtPath(f"{STILL}/rachis")
        prim.GetAttribute("indices").Set(Vt.IntArray(indices))

    return plant


def no_kind(stage):
    Usd.ModelAPI(stage.GetDefaultPrim()).SetKind("")


def drop_sample(stage):
    stage.GetPrimAtPath(MESH).GetAttribute("velocities").ClearAtTime(2.0)


def no_extent(stage):
    stage.GetPrimAtPath(STILL).RemoveProperty("extent")


DEFECTS = {
    "extent": (change(MESH, "extent", 3, lambda v: v * 1.01), f"{MESH}.extent", "time 3"),
    "extent of curve": (
        change(CURVE, "extent", 2, lambda v: v + 0.0005),
        f"{CURVE}.extent",
        "time 2",
    ),
    "no extent": (no_extent, f"{STILL}.extent", "missing"),
    "nan": (
        change(MESH, "points", 4, with_value((3, 1), np.nan)),
        f"{MESH}.points",
        "time 4: not finite in 1 elements, the first is 3",
    ),
    "nan in velocities": (
        change(MESH, "velocities", 2, with_value((0, 0), np.inf)),
        f"{MESH}.velocities",
        "time 2: not finite",
    ),
    "point count": (
        change(MESH, "points", 5, lambda v: v[:-1]),
        f"{MESH}.points",
        "time 5: 35 points, not 36",
    ),
    "velocity count": (
        change(MESH, "velocities", 5, lambda v: v[:-1]),
        f"{MESH}.velocities",
        "time 5: 35 values for 36",
    ),
    "velocity sample missing": (drop_sample, f"{MESH}.velocities", "4 samples, not at the times"),
    "index out of range": (
        change(STILL, "faceVertexIndices", None, with_value(7, 36)),
        f"{STILL}.faceVertexIndices",
        "36 is out of range. Give 0 to 35",
    ),
    "negative index": (
        change(STILL, "faceVertexIndices", None, with_value(7, -1)),
        f"{STILL}.faceVertexIndices",
        "-1 is out of range",
    ),
    "face counts": (
        change(STILL, "faceVertexCounts", None, lambda v: v[:-1]),
        f"{STILL}.faceVertexCounts",
        "sum is 141",
    ),
    "curve counts": (
        change(CURVE, "curveVertexCounts", None, lambda v: v - 1),
        f"{CURVE}.curveVertexCounts",
        "sum is 3",
    ),
    "widths": (
        change(CURVE, "widths", None, lambda v: v[:-1]),
        f"{CURVE}.widths",
        "3 values. Interpolation vertex asks for 4",
    ),
    "normals": (change(MESH, "normals", 1, lambda v: v[:5]), f"{MESH}.normals", "time 1: 5 values"),
    "primvar size": (
        change(STILL, "primvars:side", None, lambda v: v[:-2]),
        f"{STILL}.primvars:side",
        "46 values. Interpolation uniform asks for 48",
    ),
    "scalar primvar": (scalar_primvar, f"{STILL}.primvars:mass", "not an array"),
    "flipped face": (
        flip,
        f"{STILL}.faceVertexIndices",
        "at rest: 1 faces face away from their normals, the first is 1",
    ),
    "subset out of range": (subset([0, 48]), f"{STILL}.rachis.indices", "Give 0 to 47"),
    "subset overlap": (
        subset([0, *range(8, 16), *range(24, 32), *range(40, 48)]),
        f"{STILL}.subsetFamily:materialBind",
        "1 faces in several",
    ),
    "subset gap": (subset([8, 9]), f"{STILL}.subsetFamily:materialBind", "22 faces in no subset"),
    "sampled constant": (sample_static, f"{STILL}.primvars:st", "time samples (first at 2)"),
    "samples at rest": (sample_still_points, f"{STILL}.points", "all equal to the default"),
    "sample out of range": (
        lambda stage: stage.SetEndTimeCode(4),
        f"{MESH}.points",
        "sample at time 5 is outside the stage's 1 to 4",
    ),
    "no default prim": (lambda s: s.ClearDefaultPrim(), "defaultPrim", "missing"),
    "no kind": (no_kind, "/usdc.kind", "missing"),
    "no units": (metadata("metersPerUnit"), "metersPerUnit", "missing"),
    "no up axis": (metadata("upAxis"), "upAxis", "missing"),
    "no rate": (metadata("timeCodesPerSecond"), "timeCodesPerSecond", "missing"),
    "no start": (metadata("startTimeCode"), "startTimeCode", "missing"),
}


@pytest.mark.parametrize("at_once", [geometry._WINDOW_BYTES, 2 * 36 * 12])
@pytest.mark.parametrize("name", DEFECTS)
def test_a_planted_defect_is_named(tmp_path, caches, monkeypatch, name, at_once):
    """Also where few samples fit into memory at once."""
    monkeypatch.setattr(geometry, "_WINDOW_BYTES", at_once)
    plant, key, message = DEFECTS[name]
    path = tmp_path / "planted.usdc"
    stage = Usd.Stage.Open(Sdf.Layer.OpenAsAnonymous(str(caches["usdc"])))
    plant(stage)
    stage.GetRootLayer().Export(str(path))
    problems = check_usd(path)
    matching = [p for p in problems if p.key == key and message in p.message]
    assert len(matching) == 1, problems
    assert matching[0].source == str(path)


# defects that keep points, velocities, faces or curves from being followed
UNMEASURABLE = {
    "nan", "nan in velocities", "point count", "velocity count", "index out of range",
    "negative index", "face counts", "curve counts",
}  # fmt: skip


@pytest.mark.parametrize("name", DEFECTS)
def test_a_cache_with_a_defect_is_measured_or_the_reason_is_given(tmp_path, caches, name):
    plant, key, _ = DEFECTS[name]
    path = tmp_path / "planted.usdc"
    stage = Usd.Stage.Open(Sdf.Layer.OpenAsAnonymous(str(caches["usdc"])))
    plant(stage)
    stage.GetRootLayer().Export(str(path))
    done = invoke("check", path, "--json")
    told = json.loads(done.stdout)
    assert done.exit_code == 1
    assert ("lengths" in told) == (name not in UNMEASURABLE)
    if name in UNMEASURABLE:
        assert key in told["not_measured"][0]
        assert [line for line in told["problems"] if key in line]
        assert "cannot be measured" in done.stderr


def test_files_that_are_no_usd(tmp_path):
    (tmp_path / "text.usda").write_text("not usd")
    assert "cannot open" in check_usd(tmp_path / "text.usda")[0].message
    assert "there is no such file" in check_usd(tmp_path / "none.usda")[0].message


def copied(caches, tmp_path):
    folder = tmp_path / "copy"
    shutil.copytree(caches["clips"].parent, folder)
    return folder / "clips.usda"


@pytest.mark.parametrize("how", ["gone", "cut"])
def test_a_missing_clip_is_named(caches, tmp_path, how):
    path = copied(caches, tmp_path)
    clip = next(path.parent.rglob("0001.usdc"))
    if how == "gone":
        clip.unlink()
    else:
        clip.write_bytes(clip.read_bytes()[:100])
    assert any("0001.usdc" in str(problem) for problem in check_usd(path))


def test_a_missing_payload_is_named(caches, tmp_path):
    path = copied(caches, tmp_path)
    (path.parent / "clips.payload.usdc").unlink()
    assert any("clips.payload.usdc" in p.key for p in check_usd(path))
    told = json.loads(invoke("check", path, "--json").stdout)
    assert told["not_measured"] == told["problems"]
