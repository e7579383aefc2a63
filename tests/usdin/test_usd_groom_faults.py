"""Grooms in USD that cannot be read: every problem names its prim, and nothing is written."""

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom
from usdin_scenes import TYPES, add_curves, arc, lifted, new_stage

import featherfx
from featherfx.errors import InputError


def problems_of(tmp_path, groom="bird.usda"):
    with pytest.raises(InputError) as caught:
        featherfx.read_groom(tmp_path / groom)
    return [str(problem) for problem in caught.value.problems]


def assert_told(found, expected):
    """expected: prim and words that one problem holds."""
    for path, words in expected.items():
        assert any(path in line and words in line for line in found), (path, found)


def test_all_problems_name_their_prims(tmp_path):
    stage = new_stage(tmp_path / "bird.usda")
    straight = np.column_stack([np.linspace(0, 0.2, 5), np.zeros((5, 2))])
    add_curves(stage, "/twice", [arc(), arc()], ids=["a", "a"])
    add_curves(stage, "/unknown", [arc()], kind="emu")
    add_curves(stage, "/kindless", [arc()], kind=None)
    add_curves(stage, "/upless", [straight], up=None)
    add_curves(stage, "/along", [straight], up=(1, 0, 0))
    add_curves(stage, "/point", [arc()[:1]])
    add_curves(stage, "/still", [np.zeros((4, 3))])
    add_curves(stage, "/infinite", [np.full((4, 3), np.inf)])
    add_curves(stage, "/sizes", [arc(), arc()], region=(TYPES.StringArray, ["a", "b", "c"]))
    add_curves(stage, "/ring", [arc()]).CreateWrapAttr("periodic")
    stage.Save()
    found = problems_of(tmp_path)
    assert_told(
        found,
        {
            "/sizes": "has 3 values for 2 elements",
            "/point": "curve 0 has 1 points, a rachis has 2 at least",
            "/infinite": "not finite",
            "/ring": "periodic",
        },
    )
    for path in ("/point", "/infinite", "/ring", "/sizes"):
        stage.RemovePrim(path)
    stage.Save()
    found = problems_of(tmp_path)
    assert_told(
        found,
        {
            "/twice[1]": "'a' is taken already, by /twice[0]",
            "/kindless": "missing",
            "/upless": "the curve is straight",
            "/along": "lies along the curve",
            "/still": "no length",
            "/unknown": "no feather preset 'emu'",
        },
    )


def test_places_and_lengths_that_cannot_be(tmp_path):
    """Not a number in a transform or an instance; a stage in centimetres that says metres."""
    stage = new_stage(tmp_path / "bird.usda")
    add_curves(stage, "/lost/a", [arc()])
    UsdGeom.Xform.Define(stage, "/lost").AddTranslateOp().Set((np.nan, 0, 0))
    add_curves(stage, "/giant", [100 * arc()])
    add_curves(stage, "/speck", [1e-4 * arc()])
    add_curves(stage, "/template", [arc()])
    for name, numbers, x in (("/far", [0], np.inf), ("/other", [1], 0.0), ("/before", [-1], 0.0)):
        instancer = UsdGeom.PointInstancer.Define(stage, name)
        instancer.CreatePrototypesRel().SetTargets(["/template"])
        instancer.CreateProtoIndicesAttr(numbers)
        instancer.CreatePositionsAttr([(x, 0, 0)])
    stage.Save()
    found = problems_of(tmp_path)
    assert_told(
        found,
        {
            "/lost/a": "transforms are not finite by default",
            "/far": "positions are not finite",
            "/other.protoIndices": "name prototype 1 of 1",
            "/before.protoIndices": "name prototype -1 of 1",
        },
    )
    for path in ("/lost", "/far", "/other", "/before"):
        stage.RemovePrim(path)
    stage.Save()
    found = problems_of(tmp_path)
    assert any("/giant.points: are 20 m long. Give 0.0001 to 10 m" in line for line in found)
    assert any("/speck.points: are 2e-05 m long" in line for line in found)


def test_a_kind_that_many_curves_lack_is_one_problem(tmp_path):
    stage = new_stage(tmp_path / "bird.usda")
    add_curves(stage, "/wing", [lifted(arc(), 0.01 * k) for k in range(50)], kind=None)
    stage.Save()
    (line,) = problems_of(tmp_path)
    assert "/wing.primvars:featherKind: missing. Give the primvar, or kind" in line


@pytest.mark.parametrize(
    ("prims", "words"),
    [
        ('["/nowhere"]', "no prim /nowhere"),
        ('["/off"]', "/off is inactive"),
        ('["/off/inner"]', "/off is inactive"),
        ('["/over"]', "only an over"),
        ('["/model"]', "is a class"),
        ('["/empty"]', "no curves and no instances at /empty"),
        ('["a b"]', "no absolute prim path"),
    ],
)
def test_prims_that_cannot_be_read(tmp_path, prims, words):
    stage = new_stage(tmp_path / "bird.usda")
    add_curves(stage, "/off/inner", [arc()])
    stage.GetPrimAtPath("/off").SetActive(False)
    stage.OverridePrim("/over")
    stage.CreateClassPrim("/model")
    UsdGeom.Xform.Define(stage, "/empty")
    stage.Save()
    (tmp_path / "groom.toml").write_text(
        f'name = "g"\n[[usd]]\nfile = "bird.usda"\nprims = {prims}\n'
    )
    assert any(words in line for line in problems_of(tmp_path, "groom.toml"))


@pytest.mark.parametrize("content", ["", "#usda 1.0\ndef Xform {", "nonsense"])
def test_stages_that_do_not_open(tmp_path, content):
    (tmp_path / "bird.usda").write_text(content)
    (line,) = problems_of(tmp_path)
    assert "bird.usda" in line
    assert "cannot open" in line


def test_a_file_without_permission(tmp_path, monkeypatch):
    Usd.Stage.CreateNew(str(tmp_path / "bird.usda")).Save()
    monkeypatch.setattr("os.access", lambda path, mode: False)
    (line,) = problems_of(tmp_path)
    assert "may not be read" in line


def test_units_that_are_not_authored_warn(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "bird.usda"))
    add_curves(stage, "/c", [arc() * 100])
    stage.Save()
    with pytest.warns(featherfx.errors.InputWarning, match="metersPerUnit is not authored"):
        groom = featherfx.read_groom(tmp_path / "bird.usda")
    assert groom.feathers[0].kind.length == pytest.approx(0.2, rel=1e-3)


def test_edits_of_a_host_are_read_and_kept(tmp_path):
    stage = new_stage(tmp_path / "bird.usda")
    add_curves(stage, "/c", [arc()])
    stage.Save()
    add_curves(stage, "/not_saved", [arc()])
    bytes_before = (tmp_path / "bird.usda").read_bytes()
    groom = featherfx.read_groom(tmp_path / "bird.usda")
    assert [f.id for f in groom.feathers] == ["c", "not_saved"]
    assert stage.GetPrimAtPath("/not_saved")
    assert stage.GetRootLayer().dirty
    assert (tmp_path / "bird.usda").read_bytes() == bytes_before


def test_a_file_that_changed_on_disk_is_read_anew(tmp_path):
    stage = new_stage(tmp_path / "bird.usda")
    add_curves(stage, "/c", [arc()])
    stage.Save()
    assert len(featherfx.read_groom(tmp_path / "bird.usda").feathers) == 1
    other = Sdf.Layer.CreateAnonymous(".usda")
    other.TransferContent(stage.GetRootLayer())
    add_curves(Usd.Stage.Open(other), "/d", [arc()])
    (tmp_path / "bird.usda").write_text(other.ExportToString())
    assert len(featherfx.read_groom(tmp_path / "bird.usda").feathers) == 2
