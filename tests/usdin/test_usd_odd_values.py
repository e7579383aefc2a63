"""Stages with odd values: one message with file, path, value and what is allowed; no traceback."""

from __future__ import annotations

import struct
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, UsdGeom, UsdSkel
from usdin_scenes import (
    TYPES,
    add_curves,
    add_mesh,
    add_skinned,
    arc,
    lifted,
    new_stage,
    sheet,
    vec,
    write_shot,
)

import featherfx
from featherfx.baking.pipeline import check, export
from featherfx.cli.main import main
from featherfx.errors import InputError

sys.path.append(str(Path(__file__).parents[2]))
from tests.fuzz import usd

SKIN = 'usd = "skin.usda"\nprim = "/bird/skin"\ntolerance = 10'

pytestmark = pytest.mark.filterwarnings("ignore::featherfx.errors.InputWarning")


def told(work, *arguments) -> str:
    """What an InputError says; anything else fails the test."""
    with pytest.raises(InputError) as caught:
        work(*arguments)
    return str(caught.value)


def checked(path) -> str:
    return "\n".join(str(problem) for problem in check(path))


def groom_stage(folder):
    stage = new_stage(folder / "groom.usda")
    add_curves(stage, "/bird", [arc()], ids=["a"])
    return stage


def skin_stage(folder):
    stage = new_stage(folder / "skin.usda")
    points, counts, quads = sheet()
    mesh = add_mesh(stage, "/bird/skin", points, counts, quads)
    for code in (1, 25):
        mesh.GetPointsAttr().Set(vec(lifted(points, 0.01 * code)), code)
    return stage, mesh


def put(prim, name, kind, value, code=None):
    """A value of any type, whatever the schema says that the attribute is of."""
    layer = prim.GetStage().GetRootLayer()
    spec = layer.GetPrimAtPath(prim.GetPath())
    if name in spec.properties:
        spec.RemoveProperty(spec.properties[name])
    attribute = Sdf.AttributeSpec(spec, name, kind)
    if code is None:
        attribute.default = value
    else:
        layer.SetTimeSample(attribute.path, code, value)


@pytest.mark.parametrize("arc_of", ["references", "payload"])
def test_arcs_within_a_file(tmp_path, arc_of):
    stage = groom_stage(tmp_path)
    stage.SetDefaultPrim(stage.GetPrimAtPath("/bird"))
    stage.Save()
    path = tmp_path / "groom.usda"
    del stage
    text = path.read_text()
    path.write_text(text + f'\ndef "other" (\n    prepend {arc_of} = </bird>\n)\n{{\n}}\n')
    assert "featherId 'a' is used 2 times" in checked(path)
    path.write_text(
        text
        + f'\ndef "other" (\n    prepend {arc_of} = </bird>\n)\n{{\n'
        + '    string[] primvars:featherId = ["b"] (\n        interpolation = "uniform"\n    )\n}\n'
    )
    assert checked(path) == ""
    assert [each.id for each in featherfx.read_groom(path).feathers] == ["a", "b"]
    groom = tmp_path / "groom.toml"
    groom.write_text('name = "g"\n[[usd]]\nfile = "groom.usda"\nprims = ["/none"]\n')
    assert "no prim /none" in told(featherfx.read_groom, groom)


@pytest.mark.parametrize("aim", ["</none>", "</other>"])
def test_arcs_that_lead_nowhere(tmp_path, aim):
    groom_stage(tmp_path).Save()
    path = tmp_path / "groom.usda"
    with path.open("a") as file:
        file.write(f'\ndef "other" (\n    prepend references = {aim}\n)\n{{\n}}\n')
    words = "its references form a cycle" if aim == "</other>" else "</none>, which is not there"
    assert f"/other: {words}" in checked(path).replace("refers to @" + str(path) + "@", "")


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("metersPerUnit = 1e300", "metersPerUnit: is 1e+300. Give 1e-09 to 1e+09"),
        ("metersPerUnit = 0", "metersPerUnit: is 0. Give"),
        ("metersPerUnit = -1", "metersPerUnit: is -1. Give"),
        ("metersPerUnit = nan", "metersPerUnit: is nan. Give"),
        ("timeCodesPerSecond = 0", "timeCodesPerSecond: is 0. Give 0.001 to 1e+09"),
        ("timeCodesPerSecond = -24", "timeCodesPerSecond: is -24. Give"),
        ("timeCodesPerSecond = nan", "timeCodesPerSecond: is nan. Give"),
        ("startTimeCode = nan", "startTimeCode: is nan. Give"),
        ('upAxis = "X"', "upAxis: is 'X', expects Y or Z"),
    ],
)
def test_units_axes_and_rates(tmp_path, line, words):
    """The same message from whatever reads the stage."""
    stage, _ = skin_stage(tmp_path)
    add_curves(stage, "/wing", [arc()])
    layer = stage.GetRootLayer()
    for name in ("metersPerUnit", "upAxis", "timeCodesPerSecond"):
        layer.pseudoRoot.ClearInfo(name)
    text = layer.ExportToString()
    del stage, layer
    path = tmp_path / "skin.usda"
    path.write_text(text.replace("#usda 1.0\n", f"#usda 1.0\n(\n    {line}\n)\n", 1))
    assert words in checked(path)
    assert words in told(featherfx.read_groom, path)
    assert words in told(featherfx.read_shot, write_shot(tmp_path, SKIN))
    for name in ("out.ply", "out.usda"):
        assert words in told(export, path, tmp_path / name)
        assert not (tmp_path / name).exists()


def test_layers_that_are_their_own_sublayers(tmp_path):
    for name, other in (("a", "b"), ("b", "a")):
        text = f"#usda 1.0\n(\n    subLayers = [@{other}.usda@]\n)\n"
        (tmp_path / f"{name}.usda").write_text(text)
    words = f"subLayers: form a cycle: {tmp_path}/a.usda -> {tmp_path}/b.usda -> {tmp_path}/a.usda"
    assert words in checked(tmp_path / "a.usda")
    assert words in told(featherfx.read_groom, tmp_path / "a.usda")


ODD = [
    (TYPES.String, "x"),
    (TYPES.StringArray, ["x"]),
    (TYPES.Int, 3),
    (TYPES.FloatArray, [1.0, 2.0]),
    (TYPES.Matrix4d, Gf.Matrix4d(1)),
    (TYPES.Asset, Sdf.AssetPath("x")),
    (TYPES.Float2Array, [(1, 2)]),
]


@pytest.mark.parametrize(("kind", "value"), ODD)
@pytest.mark.parametrize("name", ["points", "curveVertexCounts", "primvars:up", "type"])
def test_a_groom_of_odd_types(tmp_path, name, kind, value):
    stage = groom_stage(tmp_path)
    put(stage.GetPrimAtPath("/bird"), name, kind, value)
    stage.Save()
    path = tmp_path / "groom.usda"
    assert f"/bird.{name}" in told(featherfx.read_groom, path)
    assert f"/bird.{name}" in checked(path)


@pytest.mark.parametrize(("kind", "value"), ODD)
@pytest.mark.parametrize("name", ["points", "faceVertexCounts", "faceVertexIndices", "holeIndices"])
def test_a_skin_of_odd_types(tmp_path, name, kind, value):
    stage, mesh = skin_stage(tmp_path)
    put(mesh.GetPrim(), name, kind, value)
    stage.Save()
    words = f"/bird/skin.{name}"
    assert words in told(featherfx.read_shot, write_shot(tmp_path, SKIN))
    assert words in checked(tmp_path / "skin.usda")


@pytest.mark.parametrize("name", ["points", "faceVertexIndices"])
def test_empty_arrays(tmp_path, name):
    stage, mesh = skin_stage(tmp_path)
    mesh.GetPrim().GetAttribute(name).Clear()
    mesh.GetPrim().GetAttribute(name).Set([])
    stage.Save()
    assert "/bird/skin" in told(featherfx.read_shot, write_shot(tmp_path, SKIN))
    assert "/bird/skin" in checked(tmp_path / "skin.usda")


@pytest.mark.parametrize("kind", ["point3f", "foo"])
def test_types_that_usd_does_not_know(tmp_path, kind):
    groom_stage(tmp_path).Save()
    path = tmp_path / "groom.usda"
    path.write_text(path.read_text().replace("point3f[] points", f"{kind}X[] points"))
    assert "/bird.points" in told(featherfx.read_groom, path)
    assert "/bird.points: is of a type that USD does not know" in checked(path)


@pytest.mark.parametrize(("count", "typed"), [(3, True), (3, False), (1, False)])
def test_a_cubic_curve_with_few_points(tmp_path, count, typed):
    """As a shaft, and as a curve that guides a region; a curve without a type is cubic."""
    stage, _ = skin_stage(tmp_path)
    curve = add_curves(stage, "/line", [arc(points=count)])
    curve.GetTypeAttr().Set("cubic") if typed else curve.GetPrim().RemoveProperty("type")
    stage.Save()
    path = tmp_path / "skin.usda"
    words = f"/line.curveVertexCounts: curve 0 has {count} points"
    assert words in told(featherfx.read_groom, path)
    assert words in checked(path)
    (tmp_path / "groom.toml").write_text(
        'name = "g"\n[skin]\nusd = "skin.usda"\nprim = "/bird/skin"\n'
        '[[region]]\nid = "r"\nkind = "covert"\ncount = 3\nflow = { curves = ["/line"] }\n'
    )
    assert words in told(featherfx.read_groom, tmp_path / "groom.toml")


def test_bytes_that_are_no_text(tmp_path):
    groom_stage(tmp_path).Save()
    path = tmp_path / "groom.usda"
    path.write_bytes(path.read_bytes().replace(b'"covert"', b'"cov\xff\xfe"'))
    assert "groom.usda" in told(featherfx.read_groom, path)
    assert "no UTF-8" in checked(path) or "/bird.primvars:featherKind" in checked(path)


def test_a_damaged_crate(tmp_path):
    """The length of an array that reaches beyond the end of the file."""
    count = 12347
    stage = new_stage(tmp_path / "skin.usdc")
    mesh = add_mesh(
        stage, "/bird/skin", np.random.default_rng(1).random((count, 3)), [3], [0, 1, 2]
    )
    mesh.GetPointsAttr().Set(mesh.GetPointsAttr().Get(), 2)
    stage.Save()
    del stage, mesh
    path = tmp_path / "skin.usdc"
    content = path.read_bytes()
    length = struct.pack("<Q", count)
    assert content.count(length) > 0
    path.write_bytes(content.replace(length, struct.pack("<Q", count << 40)))
    words = "/bird/skin.points: USD cannot read it"
    assert words in checked(path)
    shot = write_shot(tmp_path, SKIN.replace("usda", "usdc"))
    assert words in told(featherfx.read_shot, shot)
    assert words in told(export, path, tmp_path / "out.ply")
    assert "USD cannot read it" in told(export, path, tmp_path / "out.usda")


def test_blend_shapes_that_do_not_fit(tmp_path):
    stage = new_stage(tmp_path / "skin.usda")
    add_skinned(stage)
    shape = UsdSkel.BlendShape(stage.GetPrimAtPath("/bird/skin/bulge"))
    shape.GetOffsetsAttr().Set(vec([[0, 0, 0.1]] * 3))
    stage.Save()
    words = "/bird/skin/bulge: has 3 offsets for 5 points"
    assert words in told(featherfx.read_shot, write_shot(tmp_path, SKIN))
    shape.GetOffsetsAttr().Set(vec([[0, 0, 0.1]] * 5))
    shape.GetPointIndicesAttr().Set([0, 1, 2, 40, 444])
    stage.Save()
    assert "pointIndices are out of range. Give 0 to 80" in checked(tmp_path / "skin.usda")
    shape.GetPrim().SetActive(False)
    stage.Save()
    words = "names /bird/skin/bulge, which is no active BlendShape"
    assert words in checked(tmp_path / "skin.usda")


def test_blend_shapes_whose_targets_lead_nowhere(tmp_path):
    stage = new_stage(tmp_path / "skin.usda")
    add_skinned(stage)
    targets = UsdSkel.BindingAPI(stage.GetPrimAtPath("/bird/skin")).GetBlendShapeTargetsRel()
    targets.SetTargets([targets.GetPath()])  # names itself
    stage.Save()
    words = "/bird/skin: skel:blendShapeTargets names what is no BlendShape"
    assert words in told(featherfx.read_shot, write_shot(tmp_path, SKIN))
    assert words in checked(tmp_path / "skin.usda")


def test_a_pose_that_is_not_finite_later_on(tmp_path):
    stage = new_stage(tmp_path / "skin.usda")
    add_skinned(stage)
    motion = UsdSkel.Animation(stage.GetPrimAtPath("/bird/motion"))
    still = motion.GetRotationsAttr().Get(1)
    motion.GetTranslationsAttr().Set([(0, 0, 0), (np.nan, 0, 0)], 25)
    motion.GetTranslationsAttr().Set([(0, 0, 0), (0, 0, 0)], 1)
    motion.GetRotationsAttr().Set(still, 25)
    stage.Save()
    read = told(featherfx.read_shot, write_shot(tmp_path, SKIN))
    assert "/bird/skin: points are not finite at time code 25" in read


@pytest.mark.parametrize(
    ("name", "kind", "value"),
    [
        ("primvars:featherId", TYPES.FloatArray, [1.0]),
        ("normals", TYPES.Int, 5),
        ("points", TYPES.StringArray, ["x"]),
        ("faceVertexCounts", TYPES.Float, 1.0),
        ("faceVertexCounts", TYPES.IntArray, [-3, 6]),
    ],
)
def test_a_cache_of_odd_types(tmp_path, name, kind, value):
    stage = new_stage(tmp_path / "cache.usda")
    mesh = add_mesh(stage, "/a", np.eye(3), [3], [0, 1, 2])
    UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("featherId", TYPES.String).Set("a")
    put(mesh.GetPrim(), name, kind, value)
    stage.Save()
    path = tmp_path / "cache.usda"
    assert "/a." in told(export, path, tmp_path / "out.ply")
    assert f"/a.{name}" in checked(path) or name == "primvars:featherId"


def test_an_odd_extent_is_named_and_hinders_nobody(tmp_path):
    """Nothing reads it: what is drawn or exported goes by the points."""
    stage = new_stage(tmp_path / "cache.usda")
    mesh = add_mesh(stage, "/a", np.eye(3), [3], [0, 1, 2])
    UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("featherId", TYPES.String).Set("a")
    put(mesh.GetPrim(), "extent", TYPES.String, "x")
    stage.Save()
    export(tmp_path / "cache.usda", tmp_path / "out.ply")
    assert (tmp_path / "out.ply").exists()
    assert "/a.extent" in checked(tmp_path / "cache.usda")


def test_more_frames_than_files_can_be(tmp_path):
    stage = new_stage(tmp_path / "cache.usda")
    add_mesh(stage, "/a", np.eye(3), [3], [0, 1, 2])
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(5e8)
    stage.Save()
    words = "endTimeCode: is 5e+08, more than 100000 frames after the first, 1"
    assert words in told(export, tmp_path / "cache.usda", tmp_path / "out.ply")


def test_what_a_file_says_of_featherfx_may_be_anything(tmp_path):
    stage = groom_stage(tmp_path)
    stage.GetRootLayer().customLayerData = {"featherfx": 3}
    stage.Save()
    assert checked(tmp_path / "groom.usda") == ""


def test_a_camera_of_odd_values(tmp_path):
    stage, _ = skin_stage(tmp_path)
    camera = UsdGeom.Camera.Define(stage, "/camera")
    camera.CreateFocalLengthAttr(float("nan"))
    stage.Save()
    more = '[level_of_detail]\nusd = "skin.usda"\nprim = "/camera"\n'
    words = "/camera.focalLength: is nan at first, expects a number"
    assert words in told(featherfx.read_shot, write_shot(tmp_path, SKIN, more=more))


@pytest.mark.parametrize("number", [*range(0, 12, 2), *range(14, 22, 2)])
def test_damage(tmp_path, capsys, monkeypatch, number):
    """Some of the damage of `python -m tests.fuzz usd`: every command ends with 0 or a message."""
    folder = tmp_path / "case"
    folder.mkdir()
    monkeypatch.chdir(folder)
    usd.prepare(folder)
    how, commands = usd.damage(np.random.default_rng([7, number]), number, folder)
    for command in commands:
        if command.arguments[0] == "preview":
            continue  # compiles kernels
        with warnings.catch_warnings():
            code = main.main(list(command.arguments), "featherfx", standalone_mode=False)
        said = capsys.readouterr()
        assert not code or (said.out + said.err).strip(), (how, command)
