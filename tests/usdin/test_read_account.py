"""The account of a reading: what was taken and left of a stage, and how it moves."""

import json
from dataclasses import asdict

import numpy as np
import pytest
from click.testing import CliRunner
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt
from usdin_scenes import add_curves, add_mesh, add_skinned, arc, new_stage, sheet, vec

from featherfx.api import read_groom
from featherfx.cli.main import main
from featherfx.errors import InputError, InputWarning
from featherfx.usd.read.contents import inspect_stage

LINE = np.linspace([0.0, 0.0, 0.0], [-0.1, 0.0, 0.0], 5) + [
    [0, 0, z] for z in (0, 4e-3, 1e-2, 2e-2, 4e-2)
]


def run(*arguments):
    result = CliRunner().invoke(main, list(map(str, arguments)))
    return result.exit_code, result.stdout, result.stderr


def add_nurbs(stage, path, points, order, knots, weights=None):
    prim = UsdGeom.NurbsCurves.Define(stage, path)
    prim.CreateCurveVertexCountsAttr([len(points)])
    prim.CreatePointsAttr(vec(points))
    prim.CreateOrderAttr([order])
    prim.CreateKnotsAttr(Vt.DoubleArray(knots))
    if weights is not None:
        prim.CreatePointWeightsAttr(Vt.DoubleArray(weights))
    UsdGeom.PrimvarsAPI(prim).CreatePrimvar("up", Sdf.ValueTypeNames.Vector3f).Set((0, 0, 1))
    return prim


def add_hermite(stage, path, points, tangents):
    prim = UsdGeom.HermiteCurves.Define(stage, path)
    prim.CreateCurveVertexCountsAttr([len(points)])
    prim.CreatePointsAttr(vec(points))
    prim.CreateTangentsAttr(vec(tangents))
    UsdGeom.PrimvarsAPI(prim).CreatePrimvar("up", Sdf.ValueTypeNames.Vector3f).Set((0, 0, 1))
    return prim


def feathers_of(stage, keys=""):
    stage.GetRootLayer().Save()
    folder = stage.GetRootLayer().realPath.rsplit("/", 1)[0]
    with open(f"{folder}/groom.toml", "w") as file:
        file.write(f'name = "g"\n[[usd]]\nfile = "groom.usda"\nkind = "covert"\n{keys}')
    return {feather.id: feather for feather in read_groom(f"{folder}/groom.toml").feathers}


def test_one_line_is_one_feather_in_every_kind_of_curve(tmp_path):
    """A parabola as Bezier, as B-splines of two degrees, and by its tangents."""
    stage = new_stage(tmp_path / "groom.usda")
    a, b, c = (np.array(p) for p in ([0, 0, 0], [-0.05, 0, 0.0], [-0.1, 0, 0.03]))
    cubic = np.array([a, (a + 2 * b) / 3, (2 * b + c) / 3, c])
    bezier = add_curves(stage, "/b/bezier", [cubic], up=(0, 0, 1))
    bezier.CreateTypeAttr("cubic")
    bezier.CreateBasisAttr("bezier")
    add_nurbs(stage, "/b/nurbs", [a, b, c], 3, [0, 0, 0, 1, 1, 1])
    add_nurbs(stage, "/b/cubic_nurbs", cubic, 4, [2, 2, 2, 2, 5, 5, 5, 5], [3.0] * 4)
    add_hermite(stage, "/b/hermite", [a, c], [2 * (b - a), 2 * (c - b)])
    found = feathers_of(stage)
    lengths = [feather.kind.length for feather in found.values()]
    np.testing.assert_allclose(lengths, lengths[0], rtol=1e-6)
    shapes = [feather.kind.rachis.camber for feather in found.values()]
    np.testing.assert_allclose(shapes, shapes[0], rtol=1e-5)


def test_weights_of_a_nurbs_curve_count(tmp_path):
    """A quarter of a circle is exact as a rational B-spline (Piegl and Tiller, chapter 7)."""
    radius = 0.1
    stage = new_stage(tmp_path / "groom.usda")
    points = radius * np.array([[0, 0, 0], [-1, 0, 0], [-1, 0, -1]])
    add_nurbs(stage, "/b/arc", points, 3, [0, 0, 0, 1, 1, 1], [1, np.sqrt(0.5), 1])
    (feather,) = feathers_of(stage).values()
    # of a polyline of 8 pieces within the arc
    assert feather.kind.length == pytest.approx(radius * np.pi / 2, rel=2e-3)


@pytest.mark.parametrize(
    ("order", "knots", "message"),
    [
        (9, [0] * 14, r"n\.order: does not fit"),
        (4, [0, 0, 0, 0, 1, 2, 2], r"n\.knots: has 7 values that do not fit"),
        (4, [0, 0, 0, 0, 3, 2, 2, 2, 2], r"n\.knots: has 9 values that do not fit"),
    ],
)
def test_nurbs_that_do_not_fit_are_refused(tmp_path, order, knots, message):
    stage = new_stage(tmp_path / "groom.usda")
    add_nurbs(stage, "/b/n", LINE, order, knots)
    with pytest.raises(InputError, match=message):
        feathers_of(stage)


def test_what_is_left_is_told_by_path_and_reason(tmp_path):
    stage = new_stage(tmp_path / "groom.usda")
    add_curves(stage, "/b/hair", [arc(), arc() + np.array([0.1, 0, 0])])
    add_curves(stage, "/b/guide", [arc()]).CreatePurposeAttr("guide")
    add_curves(stage, "/b/off", [arc()]).MakeInvisible()
    feathers_of(stage)
    code, _, told = run("groom", tmp_path / "groom.toml", "-o", tmp_path / "out.usda")
    assert code == 0
    (line,) = [each for each in told.splitlines() if "read" in each]
    assert "2 feathers; left 1 BasisCurves that is of purpose guide" in line
    assert "(/b/guide); 1 BasisCurves that is invisible" in line


SHOT = """name = "s"
groom = "groom.toml"
frames = [1, 3]
quality = { base = "draft", rows = 5, columns = 2 }
[skin]
usd = "skin.usda"
prim = "/b/skin"
tolerance = 1
"""
FEATHER = 'name = "g"\n[[feather]]\nid = "f"\nkind = "covert"\nposition = [0.05, 0, 0]\n'


def test_a_bake_reports_what_it_read(tmp_path):
    stage = new_stage(tmp_path / "skin.usda")
    add_mesh(stage, "/b/skin", *sheet(2, 2))
    translate = UsdGeom.Xform.Define(stage, "/b").AddTranslateOp()
    translate.Set(Gf.Vec3d(0, 0, 0), 1)
    translate.Set(Gf.Vec3d(0, 0, 0.01), 3)
    stage.GetRootLayer().Save()
    (tmp_path / "groom.toml").write_text(FEATHER)
    (tmp_path / "shot.toml").write_text(SHOT)
    report = tmp_path / "report.json"
    code, _, told = run(
        "bake", tmp_path / "shot.toml", "-o", tmp_path / "o.usda", "--report", report
    )
    assert code == 0, told
    (entry,) = json.loads(report.read_text())["read"]
    assert (entry["path"], entry["as"], entry["taken"], entry["left"]) == ("/b/skin", "skin", 1, [])
    assert entry["motion"] == "frame 1 is time code 1, 24 a second; moves 0.01 m in the shot"
    assert entry["motion"] in told


WIND_AND_CAMERA = """[[collider]]
usd = "skin.usda"
prims = ["g*"]
[wind_usd]
usd = "skin.usda"
prim = "/b/air"
attribute = "speed"
[level_of_detail]
usd = "skin.usda"
prim = "/b/eye"
"""


def test_every_prim_of_a_shot_has_its_line_in_lines_and_json(tmp_path):
    stage = new_stage(tmp_path / "skin.usda")
    stage.SetTimeCodesPerSecond(25)
    add_mesh(stage, "/b/skin", *sheet(2, 2))
    add_mesh(stage, "/b/ground", *sheet(2, 2))
    UsdGeom.Imageable(add_mesh(stage, "/b/grass", *sheet(2, 2))).MakeInvisible()
    air = UsdGeom.Xform.Define(stage, "/b/air").GetPrim()
    speed = air.CreateAttribute("speed", Sdf.ValueTypeNames.Vector3f)
    for code in (1, 3):
        speed.Set(Gf.Vec3f(code, 0, 0), code)
    UsdGeom.Camera.Define(stage, "/b/eye").AddTranslateOp().Set(Gf.Vec3d(0, 0, 3))
    stage.GetRootLayer().Save()
    (tmp_path / "groom.toml").write_text(FEATHER)
    (tmp_path / "shot.toml").write_text(SHOT + WIND_AND_CAMERA)
    code, told, lines = run("check", "--json", tmp_path / "shot.toml")
    assert code == 0, lines
    found = {each["as"]: each for each in json.loads(told)["read"]}
    assert set(found) == {"skin", "collider", "wind", "camera"}
    rate = "frame 1 is time code 1, 25 a second"
    assert found["collider"]["motion"] == f"{rate}; still"
    assert [each["path"] for each in found["collider"]["left"]] == ["/b/grass"]
    assert found["wind"]["motion"] == f"{rate}; changes from time code 1 to 3"
    assert f"/b/eye: 1 camera, {rate}; still" in lines


def mesh_report(stage, path):
    stage.GetRootLayer().Save()
    report = inspect_stage(stage.GetRootLayer().realPath)
    return next(asdict(each) for each in report.prims if each.path == path)


def test_inspect_tells_how_a_mesh_is_drawn_and_moves(tmp_path):
    stage = new_stage(tmp_path / "skin.usda", meters_per_unit=0.01)
    points, counts, quads = sheet(2, 2, 4.0)
    mesh = add_mesh(stage, "/b/skin", points, counts, quads)
    mesh.GetSubdivisionSchemeAttr().Set("catmullClark")
    for code, height in ((1, 0.0), (4, 3.0), (7, -1.0)):
        mesh.GetPointsAttr().Set(vec(points + np.array([0, 0, height])), code)
    UsdGeom.Xform.Define(stage, "/b").AddScaleOp().Set(Gf.Vec3f(-1, 1, 1))
    found = mesh_report(stage, "/b/skin")
    expected = {"triangles": 8, "closed": False, "mirrored": True, "subdivision": "catmullClark"}
    assert {name: found[name] for name in expected} == expected
    assert found["moves"] == (1.0, 7.0)
    assert found["displacement"] == pytest.approx(0.03)
    # the corners of a flat sheet are sharp, its edges are not drawn in
    assert found["cage_distance"] >= 0.0


@pytest.mark.skipif(not hasattr(Usd.Attribute, "HasSpline"), reason="USD knows no splines")
@pytest.mark.filterwarnings("ignore:.*inner looping")
@pytest.mark.parametrize(("end", "is_loop"), [(5.0, False), (8.0, False), (8.0, True)])
def test_a_transform_that_is_a_spline_moves_a_mesh(tmp_path, end, is_loop):
    from pxr import Ts

    stage = new_stage(tmp_path / "skin.usda")
    stage.SetStartTimeCode(2)
    stage.SetEndTimeCode(8)
    add_mesh(stage, "/b/skin", *sheet(2, 2))
    turn = UsdGeom.Xform.Define(stage, "/b").AddRotateXOp(UsdGeom.XformOp.PrecisionDouble)
    spline = Ts.Spline("double")
    for code, degrees in ((2.0, 0.0), (5.0, 60.0)):
        knot = Ts.Knot("double")
        knot.SetTime(code)
        knot.SetValue(degrees)
        knot.SetNextInterpolation(Ts.InterpLinear)
        spline.SetKnot(knot)
    if is_loop:  # once more, from where it ended
        loop = Ts.LoopParams()
        loop.protoStart, loop.protoEnd, loop.numPostLoops, loop.valueOffset = 2.0, 5.0, 1, 60.0
        spline.SetInnerLoopParams(loop)
    elif end > 5.0:  # goes on by another 60 degrees
        beyond = Ts.Extrapolation()
        beyond.mode = Ts.ExtrapLinear
        spline.SetPostExtrapolation(beyond)
    turn.GetAttr().SetSpline(spline)
    found = mesh_report(stage, "/b/skin")
    assert found["moves"] == (2.0, end)
    # a turn about x of points 0.2 m from it
    half = np.radians(10.0 * (end - 2.0))
    assert found["displacement"] == pytest.approx(0.4 * np.sin(half), rel=1e-6)


def unbind(stage, how):
    """Break the binding of add_skinned in one way."""
    skin, skeleton = stage.GetPrimAtPath("/bird/skin"), stage.GetPrimAtPath("/bird/skeleton")
    if how == "schema of the mesh":
        skin.RemoveAPI(UsdSkel.BindingAPI)
    elif how == "schema of the skeleton":
        skeleton.RemoveAPI(UsdSkel.BindingAPI)
    elif how == "animation":
        UsdSkel.BindingAPI(skeleton).GetAnimationSourceRel().ClearTargets(True)
    elif how == "joints":
        UsdSkel.Animation(stage.GetPrimAtPath("/bird/motion")).GetJointsAttr().Set(
            ["other", "more"]
        )
        skin.RemoveProperty("skel:blendShapes")


HOW = ["schema of the mesh", "schema of the skeleton", "animation", "joints"]


@pytest.mark.parametrize("how", HOW)
def test_a_skin_that_its_skeleton_does_not_move_is_told(tmp_path, how):
    stage = new_stage(tmp_path / "skin.usda")
    add_skinned(stage)
    unbind(stage, how)
    with pytest.warns(InputWarning, match="/bird/skin: .* but moves by nothing"):
        assert mesh_report(stage, "/bird/skin")["moves"] is None


@pytest.mark.parametrize("binder", ["skeleton", "skin"])
def test_of_two_animations_the_one_that_moves_a_skin_is_told(tmp_path, binder):
    stage = new_stage(tmp_path / "skin.usda")
    add_skinned(stage)
    UsdSkel.Animation.Define(stage, "/bird/other")
    binding = UsdSkel.BindingAPI(stage.GetPrimAtPath(f"/bird/{binder}"))
    binding.CreateAnimationSourceRel().AddTarget("/bird/other")
    with pytest.warns(InputWarning, match="moved by /bird/motion, not by /bird/other"):
        assert mesh_report(stage, "/bird/skin")["moves"] == (1.0, 25.0)


def test_a_skin_that_moves_is_not_told(tmp_path, recwarn):
    stage = new_stage(tmp_path / "skin.usda")
    add_skinned(stage)
    found = mesh_report(stage, "/bird/skin")
    assert found["moves"] == (1.0, 25.0)
    assert not [each for each in recwarn if "moves by nothing" in str(each.message)]
