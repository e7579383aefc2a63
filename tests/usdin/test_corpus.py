"""The corpus test: outcomes of files that are read, refused and out of place."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom
from usdin_scenes import add_matrix, add_mesh, lifted, new_stage, rigid, sheet, vec

from featherfx.baking import check
from featherfx.usd.check.skins import measure_roots


@pytest.mark.nightly
def test_each_file_has_its_outcome(tmp_path):
    stage = new_stage(tmp_path / "moved.usda", 0.01, "Y")
    points, counts, quads = sheet()
    mesh = add_mesh(stage, "/body/skin", 100.0 * points, counts, quads)
    mesh.GetSubdivisionSchemeAttr().Clear()
    for code in range(4, 9):
        add_matrix(mesh, rigid(10.0 * code, (1, 2, 3), (code, 0, 0)), code)
        mesh.GetPointsAttr().Set(vec(lifted(100.0 * points, 1.0 * code)), code)
    stage.GetRootLayer().Save()
    (tmp_path / "broken.usda").write_text("#usda 1.0\ndef Mesh")
    (tmp_path / "none.usda").write_text("#usda 1.0\n")
    files = check.list_files([tmp_path])
    broken, moved, none = map(check.try_file, files)
    assert broken.inspect.startswith("refused: ")
    assert (moved.inspect, moved.groom, moved.bake, moved.check) == ("ok",) * 4
    assert (moved.meshes, moved.moving) == ((1, 1), 1)
    assert moved.root_error < 1e-7
    assert (none.inspect, none.groom, none.meshes) == ("ok", "-", (0, 0))
    assert not any(each.crashes for each in (broken, moved, none))
    *rows, total = check.outcome_rows([broken, moved, none])
    assert len(rows) == 3
    assert total[0] == "3 files"


def test_what_is_no_refusal_is_a_crash():
    outcome = check.FileOutcome("a.usda")
    assert outcome.run("bake", lambda: [][0]) is None
    assert outcome.bake == "crash"
    assert outcome.crashes == ["bake: IndexError: list index out of range"]


def test_roots_out_of_place_are_measured(tmp_path):
    stage = new_stage(tmp_path / "skin.usda", 1.0)
    add_mesh(stage, "/skin", *sheet())
    stage.GetRootLayer().Save()
    own = Usd.Stage.CreateNew(str(tmp_path / "cache.usda"))
    UsdGeom.SetStageUpAxis(own, "Z")
    UsdGeom.SetStageMetersPerUnit(own, 1.0)
    curve, mesh = UsdGeom.BasisCurves.Define(own, "/r"), UsdGeom.Mesh.Define(own, "/m")
    x, y, z = np.array(sheet()[0][3]).tolist()
    curve.CreatePointsAttr([(x, y, z + 0.25), (1, 1, 1)])
    for prim in (curve, mesh):
        UsdGeom.PrimvarsAPI(prim).CreatePrimvar("featherId", _type("string[]")).Set(["f"])
    api = UsdGeom.PrimvarsAPI(mesh)
    api.CreatePrimvar("skinPrim", _type("string[]")).Set(["/skin"])
    api.CreatePrimvar("skinPoints", _type("int[]")).Set([3, 0, 1])
    api.CreatePrimvar("skinBarycentric", _type("float[]")).Set([1.0, 0.0, 0.0])
    own.GetRootLayer().Save()
    found = measure_roots(tmp_path / "cache.usda", tmp_path / "skin.usda")
    assert abs(found - 0.25) < 1e-6


def _type(name):
    return Sdf.ValueTypeNames.Find(name)
