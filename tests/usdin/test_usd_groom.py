"""Feathers drawn in USD land where they were drawn."""

import numpy as np
import pytest
from pxr import Gf, UsdGeom
from usdin_scenes import TYPES, add_curves, add_matrix, arc, new_stage, rigid, vec

import featherfx
from featherfx.feather.types import LEADING
from featherfx.shot.frames import place


def built(groom, number=0):
    """World points of a feather of a groom, and the feather."""
    feather = featherfx.build(groom, "final")[number]
    placement = groom.feathers[number]
    return place(feather.rest, placement.position, placement.rotation), feather


def test_a_plain_curve(tmp_path):
    stage = new_stage(tmp_path / "bird.usda")
    add_curves(stage, "/bird/feathers", [arc(), arc(0.1) + np.array([1, 2, 3])], ids=["a", "b"])
    stage.Save()
    groom = featherfx.read_groom(tmp_path / "bird.usda")
    assert groom.name == "bird"
    assert [f.id for f in groom.feathers] == ["a", "b"]
    assert [f.kind.name for f in groom.feathers] == ["covert", "covert"]
    first, second = groom.feathers
    assert first.kind.length == pytest.approx(0.2, rel=1e-3)
    assert second.kind.length == pytest.approx(0.1, rel=1e-3)
    assert first.kind.rachis.camber == pytest.approx(30, abs=0.1)
    assert first.kind.rachis.sweep == pytest.approx(10, abs=0.1)
    np.testing.assert_allclose(second.position, [1, 2, 3], atol=1e-6)
    np.testing.assert_allclose(first.rotation, np.eye(3), atol=1e-3)
    # diameters grow with the length
    ratio = first.kind.rachis.diameter_base / second.kind.rachis.diameter_base
    assert ratio == pytest.approx(2.0, rel=1e-3)


@pytest.mark.parametrize("up_axis", ["Y", "Z"])
@pytest.mark.parametrize("meters_per_unit", [0.01, 1.0])
@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_units_axes_and_transforms(tmp_path, up_axis, meters_per_unit, mirror):
    """The built shaft runs along the drawn points, and leading barbs lie where they should."""
    stage = new_stage(tmp_path / "bird.usda", meters_per_unit, up_axis)
    drawn = arc(0.2, 40, 20)
    add_curves(stage, "/bird/wing/feathers", [drawn / meters_per_unit / 2.0], ids=["a"])
    above = rigid(35, (1, 2, 3), (0.4, -0.2, 0.7))
    above[3, :3] /= meters_per_unit
    inner = np.diag([2.0, 2.0 * mirror, 2.0, 1.0])  # mirrored in the feather's y
    add_matrix(UsdGeom.Xform.Define(stage, "/bird/wing"), inner)
    add_matrix(UsdGeom.Xform.Define(stage, "/bird"), above)
    stage.Save()
    groom = featherfx.read_groom(tmp_path / "bird.usda")
    assert groom.feathers[0].mirrored == (mirror < 0)

    above[3, :3] *= meters_per_unit
    to_world = (
        above[:3, :3] if up_axis == "Z" else above[:3, :3] @ [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    )
    shift = above[3, :3] if up_axis == "Z" else above[3, :3] @ [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    whole = np.diag([1, mirror, 1]) @ to_world
    placed, feather = built(groom)
    points = placed.nodes
    expected = drawn @ whole + shift
    for target in expected:
        near = np.linalg.norm(points[:, 0] - target, axis=1).min()
        assert near < 0.2 / (feather.rows - 1) * 0.6
    np.testing.assert_allclose(points[0, 0], expected[0], atol=1e-6)
    np.testing.assert_allclose(points[-1, 0], expected[-1], atol=2e-4)
    leading = points[feather.rows // 2, feather.columns] - points[feather.rows // 2, 0]
    assert leading @ (np.array([0, 1.0, 0]) @ whole) > 0  # toward the image of y
    part = feather.surface.part == LEADING
    corners = feather.surface.points(placed)[feather.surface.triangles[part]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).sum(axis=0)
    dorsal = np.array([0, 0, 1.0]) @ whole
    assert normal @ dorsal > 0


@pytest.mark.parametrize("basis", ["bezier", "bspline", "catmullRom"])
def test_cubic_curves_run_through_their_ends(tmp_path, basis):
    control = np.column_stack(
        [np.linspace(0, 0.3, 7), np.zeros(7), -0.1 * np.linspace(0, 1, 7) ** 2]
    )
    stage = new_stage(tmp_path / "bird.usda")
    prim = add_curves(stage, "/c", [control], ids=["a"])
    prim.CreateTypeAttr("cubic")
    prim.CreateBasisAttr(basis)
    prim.CreateWrapAttr("pinned" if basis != "bezier" else "nonperiodic")
    stage.Save()
    (points, _), _ = built(featherfx.read_groom(tmp_path / "bird.usda"))
    np.testing.assert_allclose(points[0, 0], control[0], atol=1e-6)
    np.testing.assert_allclose(points[-1, 0], control[-1], atol=6e-3)


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_curves_that_are_no_arcs_keep_their_shape(tmp_path, mirror):
    """The built shaft passes within 1 % of the length of each drawn point; an arc has no course."""
    stage = new_stage(tmp_path / "bird.usda")
    x = np.linspace(0, 0.2, 41)
    wave = np.column_stack([x, 0 * x, 0.02 * np.sin(3 * np.pi * x / 0.2)])
    screw = np.column_stack([x, 0.02 * np.cos(30 * x) - 0.02, 0.02 * np.sin(30 * x)])
    corner = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.18, 0, 0.05]])
    curves = [arc(), wave, screw, corner]
    prim = add_curves(stage, "/c", curves, ids=["arc", "wave", "screw", "corner"])
    add_matrix(prim, np.diag([1.0, mirror, 1.0, 1.0]))
    stage.Save()
    groom = featherfx.read_groom(tmp_path / "bird.usda")
    assert [len(each.kind.rachis.course) > 0 for each in groom.feathers] == [
        False,
        True,
        True,
        True,
    ]
    for number, curve in enumerate(curves):
        drawn, own = curve * [1, mirror, 1], groom.feathers[number]
        length = np.linalg.norm(np.diff(drawn, axis=0), axis=1).sum()
        assert own.kind.length == pytest.approx(length, rel=1e-6)
        (points, _), _ = built(groom, number)
        shaft = fine(points[:, 0])
        near = np.linalg.norm(shaft[:, None] - drawn, axis=-1).min(axis=0)
        assert near.max() < 0.01 * length
        np.testing.assert_allclose(points[-1, 0], drawn[-1], atol=0.01 * length)


def fine(line):
    """A polyline with more points between."""
    at = np.linspace(0, len(line) - 1, 1001)
    return np.stack([np.interp(at, np.arange(len(line)), each) for each in line.T], axis=1)


def test_a_drawn_shaft_has_no_course_of_its_kind(tmp_path):
    """The course of a kind is no part of what is drawn; one of an override is."""
    stage = new_stage(tmp_path / "bird.usda")
    add_curves(stage, "/c", [arc()], kind="curly", ids=["a"])
    stage.Save()
    (tmp_path / "presets/feather").mkdir(parents=True)
    course = "course = [[0, 0, 0, 0], [1, 0, 40, 0]]"
    preset = f'base = "covert"\n[rachis]\n{course}\n'
    (tmp_path / "presets/feather/curly.toml").write_text(preset)
    (tmp_path / "groom.toml").write_text('name = "g"\nusd = { file = "bird.usda" }\n')
    folders = [tmp_path / "presets"]
    assert not featherfx.read_groom(tmp_path / "groom.toml", folders).feathers[0].kind.rachis.course
    with (tmp_path / "groom.toml").open("a") as file:
        file.write("[overrides.a]\nrachis.course = [[0, 0, 0, 0], [1, 0, 30, 0]]\n")
    kind = featherfx.read_groom(tmp_path / "groom.toml", folders).feathers[0].kind
    assert kind.rachis.course == ((0, 0, 0, 0), (1, 0, 30, 0))


def test_curves_that_no_shaft_follows_warn(tmp_path):
    stage = new_stage(tmp_path / "bird.usda")
    number = np.arange(401)
    zigzag = np.column_stack([0.001 * number, 0 * number, 0.01 * (number % 2)])
    add_curves(stage, "/c", [arc(), zigzag], ids=["good", "zigzag"])
    stage.Save()
    with pytest.warns(featherfx.errors.InputWarning, match=r"off by more than 1% .*: 'zigzag' \d"):
        featherfx.read_groom(tmp_path / "bird.usda")


def test_shape_of_the_kind_and_overrides_win(tmp_path):
    stage = new_stage(tmp_path / "bird.usda")
    add_curves(stage, "/c", [arc()], ids=["a"])
    stage.Save()
    (tmp_path / "groom.toml").write_text(
        'name = "g"\n[[usd]]\nfile = "bird.usda"\nshape = "kind"\n'
    )
    kind = featherfx.read_groom(tmp_path / "groom.toml").feathers[0].kind
    assert (kind.rachis.camber, kind.rachis.sweep) == (20, 8)
    assert kind.length == pytest.approx(0.2, rel=1e-3)
    (tmp_path / "groom.toml").write_text(
        'name = "g"\nusd = { file = "bird.usda" }\n'
        '[overrides."*"]\nlength = 0.3\nrachis.camber = 5\n'
    )
    kind = featherfx.read_groom(tmp_path / "groom.toml").feathers[0].kind
    assert kind.length == 0.3
    assert kind.rachis.camber == 5
    assert kind.rachis.sweep == pytest.approx(10, abs=0.1)


def test_names_regions_scales_and_skin_places(tmp_path):
    stage = new_stage(tmp_path / "bird.usda")
    add_curves(
        stage,
        "/c",
        [arc(), arc() + 1],
        kind=None,
        species=(TYPES.StringArray, ["covert", "swan_primary"]),
        region=(TYPES.StringArray, ["wing", "tail"]),
        lengthScale=(TYPES.FloatArray, [1.0, 0.5]),
        skinPrim=(TYPES.StringArray, ["/skin", "/skin"]),
        skinUV=(TYPES.TexCoord2fArray, [(0.25, 0.5), (0.75, 0.5)]),
    )
    stage.Save()
    (tmp_path / "groom.toml").write_text(
        'name = "g"\n[[usd]]\nfile = "bird.usda"\nprims = ["/c"]\nnames.kind = "species"\n'
    )
    first, second = featherfx.read_groom(tmp_path / "groom.toml").feathers
    assert [first.kind.name, second.kind.name] == ["covert", "swan_primary"]
    assert [first.region, second.region] == ["wing", "tail"]
    assert second.kind.length == pytest.approx(0.1, rel=1e-3)
    assert [first.id, second.id] == ["c_0000", "c_0001"]
    assert (second.skin, second.skin_uv) == ("/skin", (0.75, 0.5))


def test_up_follows_frames_and_bends(tmp_path):
    stage = new_stage(tmp_path / "bird.usda")
    turned = rigid(90, (1, 0, 0), (0, 0, 0))[:3, :3]
    straight = np.column_stack([np.linspace(0, 0.2, 5), np.zeros((5, 2))])
    add_curves(stage, "/bent", [arc(sweep=0)], up=None)
    prim = add_curves(stage, "/framed", [straight], up=None)
    api = UsdGeom.PrimvarsAPI(prim)
    api.CreatePrimvar("frame", TYPES.Matrix3d, "constant").Set(Gf.Matrix3d(*turned.ravel()))
    prim = add_curves(stage, "/quaternion", [straight], up=None)
    turn = Gf.Quatf(Gf.Rotation(Gf.Vec3d(1, 0, 0), 90).GetQuat())
    UsdGeom.PrimvarsAPI(prim).CreatePrimvar("frame", TYPES.Quatf, "constant").Set(turn)
    stage.Save()
    frames = {f.id: f.rotation for f in featherfx.read_groom(tmp_path / "bird.usda").feathers}
    np.testing.assert_allclose(frames["bent"][:, 2], [0, 0, 1], atol=5e-3)
    for name in ("framed", "quaternion"):
        np.testing.assert_allclose(frames[name][:, 2], [0, -1, 0], atol=1e-6)


@pytest.mark.parametrize(
    ("mirror", "plain_numbers"), [(False, False), (True, False), (False, True)]
)
def test_condensed_feathers(tmp_path, mirror, plain_numbers):
    """A built feather written as a shaft with barbs comes back with the same barb ends."""
    (tmp_path / "source.toml").write_text(
        'name = "s"\n[[feather]]\nid = "f"\nkind = "swan_primary"\nposition = [0.1, 0.2, 0.3]\n'
        "direction = [1, 0.5, 0.2]\nup = [0, 0.2, 1]\n"
    )
    (points, _), feather = built(featherfx.read_groom(tmp_path / "source.toml"))
    columns = feather.columns
    barbs = points[:, 1 : 1 + columns], points[:, 1 + columns :]
    stage = new_stage(tmp_path / "bird.usda", 0.01, "Z")
    scale = [100, -100, 100] if mirror else [100, 100, 100]
    prim = add_curves(stage, "/bird/feathers", [points[:, 0] * scale], "swan_primary", None, ["f"])
    for name, side in zip(
        ("P_barbl", "P_barbr"), reversed(barbs) if mirror else barbs, strict=True
    ):
        if plain_numbers:
            UsdGeom.PrimvarsAPI(prim).CreatePrimvar(
                name, TYPES.FloatArray, "vertex", 3 * columns
            ).Set((side * scale).ravel().tolist())
            continue
        primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(
            name, TYPES.Point3fArray, "vertex", columns
        )
        primvar.Set(vec((side * scale).reshape(-1, 3)))
    if mirror:  # drawn mirrored, and mirrored again by the transform
        add_matrix(UsdGeom.Xform.Define(stage, "/bird"), np.diag([1.0, -1.0, 1.0, 1.0]))
        api = UsdGeom.PrimvarsAPI(prim)
        left = [api.GetPrimvar(n).Get() for n in ("P_barbl", "P_barbr")]
        assert len(left[0]) == len(left[1]) == columns * feather.rows
    stage.Save()
    (tmp_path / "groom.toml").write_text(
        'name = "g"\n[[usd]]\nfile = "bird.usda"\n' + ('side = "left"\n' if mirror else "")
    )
    groom = featherfx.read_groom(tmp_path / "groom.toml")
    assert not groom.feathers[0].mirrored
    (again, _), rebuilt = built(groom)
    length = groom.feathers[0].kind.length
    assert rebuilt.columns == columns
    for column in (0, columns, 2 * columns):  # shaft, leading and trailing ends
        for point in again[3:-3, column]:
            off = np.linalg.norm(points[:, column] - point, axis=1).min()
            assert off < 0.04 * length


def instanced(tmp_path, kind_only=False):
    stage = new_stage(tmp_path / "bird.usda", 0.01, "Y")
    instancer = UsdGeom.PointInstancer.Define(stage, "/bird/coverts")
    template = stage.DefinePrim("/bird/coverts/templates/covert", "Xform")
    api = UsdGeom.PrimvarsAPI(template)
    api.CreatePrimvar("featherKind", TYPES.String, "constant").Set("covert")
    if not kind_only:
        curves = add_curves(stage, "/bird/coverts/templates/covert/shaft", [arc(sweep=0) * 100])
        add_matrix(curves, rigid(0, (1, 0, 0), (0, 0, 0)))
    instancer.CreatePrototypesRel().SetTargets([template.GetPath()])
    instancer.CreateProtoIndicesAttr([0, 0, 0])
    instancer.CreatePositionsAttr([(0, 0, 0), (10, 0, 0), (0, 20, 0)])
    half = float(np.sqrt(0.5))
    turn = Gf.Quath(half, 0, 0, half)
    instancer.CreateOrientationsAttr([Gf.Quath(1), turn, Gf.Quath(1)])
    instancer.CreateScalesAttr([(1, 1, 1), (2, 2, 2), (1, 1, 1)])
    instancer.CreateIdsAttr([7, 8, 9])
    instancer.CreateInvisibleIdsAttr([9])
    stage.Save()
    return featherfx.read_groom(tmp_path / "bird.usda")


@pytest.mark.parametrize("kind_only", [False, True])
def test_instanced_templates(tmp_path, kind_only):
    groom = instanced(tmp_path, kind_only)
    assert [f.id for f in groom.feathers] == ["coverts_0007", "coverts_0008"]
    first, second = groom.feathers
    assert second.kind.length == pytest.approx(2 * first.kind.length, rel=1e-3)
    assert first.kind.length == pytest.approx(0.11 if kind_only else 0.2, rel=1e-3)
    np.testing.assert_allclose(second.position, [0.1, 0, 0], atol=1e-7)
    # y up: the template's dorsal z is -y of the world, a quarter turn about it takes x to z
    np.testing.assert_allclose(first.rotation[:, 0], [1, 0, 0], atol=1e-3)
    np.testing.assert_allclose(second.rotation[:, 0], [0, 0, 1], atol=2e-3)
    np.testing.assert_allclose(first.rotation[:, 2], [0, -1, 0], atol=1e-3)


def test_scene_graph_instances_are_read(tmp_path):
    stage = new_stage(tmp_path / "bird.usda")
    add_curves(stage, "/patch/feathers", [arc(), arc() + 0.1])
    for name in ("left", "right"):
        prim = stage.DefinePrim(f"/bird/{name}", "Xform")
        prim.GetReferences().AddInternalReference("/patch")
        prim.SetInstanceable(True)
    stage.Save()
    (tmp_path / "groom.toml").write_text(
        'name = "g"\n[[usd]]\nfile = "bird.usda"\nprims = ["/bird"]\n'
    )
    groom = featherfx.read_groom(tmp_path / "groom.toml")
    assert [f.id for f in groom.feathers] == [
        "bird_left_feathers[0]",
        "bird_left_feathers[1]",
        "bird_right_feathers[0]",
        "bird_right_feathers[1]",
    ]


def test_a_cache_of_ours_is_a_groom(tmp_path):
    (tmp_path / "g.toml").write_text(
        'name = "s"\n[[feather]]\nid = "f"\nkind = "covert"\nposition = [0.1, 0.2, 0.3]\n'
    )
    featherfx.export_groom(tmp_path / "g.toml", tmp_path / "cache.usda", up_axis="Y")
    groom = featherfx.read_groom(tmp_path / "cache.usda")
    (feather,) = groom.feathers
    assert (feather.id, feather.kind.name) == ("f", "covert")
    np.testing.assert_allclose(feather.position, [0.1, 0.2, 0.3], atol=1e-6)
    assert feather.kind.rachis.camber == pytest.approx(20, abs=0.1)
    assert feather.kind.rachis.sweep == pytest.approx(8, abs=0.1)
