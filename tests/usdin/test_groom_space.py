"""Grooms written in the space of their skin, and points that are landmarks of it."""

import warnings

import creature
import numpy as np
import pytest
import trimesh
from pxr import Gf, Usd, UsdGeom, Vt
from regions_skin import RADIUS, SKIN, grown, problems, region, roots, skin_folder, write_skin

from featherfx.baking.export import export_groom
from featherfx.render.camera import axes_of
from featherfx.usd.read.cache import Cache

__all__ = ["skin_folder"]

# rows are the axes forward, up, right in the groom's frame: candidates of regions are drawn in the
# mesh's own space, z up, and so at the same places
TO_SKIN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def written(to_space, unit, mirror, up_axis, table):
    """The groom in a frame whose coordinates are unit * to_space @ those of the groom's."""

    def typed(*vector):
        return (unit * to_space @ np.array(vector)).round(9).tolist()

    def direction(*vector):
        return (to_space @ np.array(vector, float)).tolist()

    corners = np.array([typed(-0.05, -0.2, -0.2), typed(0.2, 0.2, 0.2)])
    low, high = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    sphere = [*typed(0.1, 0, 0), unit * 0.12]
    p, d = typed, direction
    rows = [*typed(0.05, 0.02, 0.08), *direction(-1, 0, 0.1), *direction(0, 0, 1)]
    names = ["x", "y", "z", *(f"{what}_{axis}" for what in ("direction", "up") for axis in "xyz")]
    csv = ",".join(["id", *names]) + "\ncsv," + ",".join(map(str, rows)) + "\n"
    groom = f"""
[[joint]]
name = "left_wing"
position = {p(0.02, 0.05, 0.01)}
mirror = "{mirror}"
side = "left"
[[feather]]
id = "left_one"
kind = "covert"
position = {p(0.01, 0.06, 0.05)}
direction = {d(-1, 0.2, 0.1)}
up = {d(0, 0, 1)}
side = "left"
joint = "left_wing"
mirror = "{mirror}"
[[row]]
id = "right_row"
kind = "swan_primary"
count = 4
path = [{p(0.1, -0.02, 0)}, {p(0, -0.1, 0)}, {p(-0.1, -0.03, 0)}]
turn_with_path = true
first = {{ position = {p(0, 0, 0)}, direction = {d(-1, -0.5, 0)}, up = {d(0, 0, 1)} }}
last = {{ position = {p(0, 0, 0)}, direction = {d(-1, -0.9, 0)}, up = {d(0, 0.1, 1)} }}
scale = [0.2, 0.3]
mirror = "{mirror}"
[[table]]
file = "{table}"
kind = "covert"
[[region]]
id = "front"
kind = "body_contour"
count = 120
length = 0.02
where = [
    {{ sphere = {sphere}, soft = {unit * (0.02)} }},
    {{ box = [{low}, {high}], soft = {unit * (0.01)} }},
    {{ {up_axis} = [{unit * (-0.06)}, {unit * (0.2)}] }},
    {{ facing = {d(1, 0.3, 0.2)}, angle = 100 }},
    {{ free_radius = {unit * (0.05)}, soft = {unit * (0.01)} }},
]
flow = {{ away = {p(0.1, 0, 0.02)}, turn = 10 }}
"""
    return groom, csv


def turned_skin(folder):
    """The ball in a Y-up stage in centimetres, own axes forward, up, right, moved and turned."""
    stage = write_skin(folder)
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/skin"))
    points = 100.0 * np.array(mesh.GetPointsAttr().Get()) @ TO_SKIN.T
    mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    UsdGeom.SetStageUpAxis(stage, "Y")
    turn = Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d(1, 2, -0.5), 67.0))
    matrix = turn * Gf.Matrix4d().SetTranslate(Gf.Vec3d(300, -40, 120))
    UsdGeom.Xformable(mesh).AddTransformOp().Set(matrix)
    stage.Save()
    to_world = 0.01 * np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    return np.array(matrix)[:3, :3] @ to_world, np.array(matrix)[3, :3] @ to_world


def test_a_groom_in_the_space_of_a_moved_skin_is_the_same_groom_moved(tmp_path):
    """Mirrors, boxes, spheres, ranges, directions, tables: all of it, in another frame."""
    plain, moved = tmp_path / "plain", tmp_path / "moved"
    for folder in (plain, moved):
        folder.mkdir()
    write_skin(plain)
    linear, shift = turned_skin(moved)
    text, csv = written(np.eye(3), 1.0, "y", "z", "more.csv")
    (plain / "more.csv").write_text(csv)
    skin = "name = 'bird'\n[skin]\nusd = 'skin.usda'\nprim = '/skin'\n"
    wanted = grown(plain, text, skin=skin)
    text, csv = written(TO_SKIN, 100.0, "z", "y", "more.csv")
    (moved / "more.csv").write_text(csv)
    found = grown(moved, "[space]\nof = 'skin'\nleft = '-z'\n", text, skin=skin)
    # from the plain frame to the world of the moved one
    linear = 100.0 * TO_SKIN.T @ linear
    assert linear @ linear.T == pytest.approx(np.eye(3), abs=1e-6)
    own, other = ({f.id: f for f in groom.feathers} for groom in (wanted, found))
    assert own.keys() == other.keys()
    assert {own[name].mirrored for name in own if name.startswith("front")} == {True, False}
    for name in own:
        assert other[name].position == pytest.approx(own[name].position @ linear + shift, abs=2e-6)
        assert other[name].rotation == pytest.approx(linear.T @ own[name].rotation, abs=2e-4)
        assert other[name].mirrored == own[name].mirrored
        assert other[name].kind.length == pytest.approx(own[name].kind.length)
    for one, two in zip(wanted.joints, found.joints, strict=True):
        assert two.position == pytest.approx(one.position @ linear + shift, abs=1e-6)
        assert (two.name, two.side) == (one.name, one.side)


GROWN = "[[region]]\nid = 'back'\nkind = 'covert'\ncount = 3\nflow = { direction = [1, 0, 0] }\n"
FEATHER = "[[feather]]\nid = 'left'\nkind = 'covert'\nside = 'left'\nposition = "


def test_the_axes_of_the_stage_leave_out_the_transforms_of_the_prim(tmp_path):
    turned_skin(tmp_path)
    space = "[space]\nof = 'stage'\nleft = 'x'\n"
    skin = "name = 'bird'\n[skin]\nusd = 'skin.usda'\nprim = '/skin'\n"
    groom = grown(tmp_path, space, FEATHER + "[10, 20, 30]\nmirror = 'x'\n", skin=skin)
    assert roots(groom) == pytest.approx(np.array([[0.1, -0.3, 0.2], [-0.1, -0.3, 0.2]]))
    assert groom.feathers[0].rotation == pytest.approx(np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]))
    assert [f.mirrored for f in groom.feathers] == [True, False]


def test_limbs_stand_as_the_body_in_every_space(tmp_path):
    """Y up and looking along z: a spread wing and a tail point backwards, their upper sides up."""
    turned_skin(tmp_path)
    limbs = (
        "[[wing]]\nid = 'left_wing'\ntype = 'pigeon'\nside = 'left'\nfold = 0\n"
        "shoulder = [3, 0, 0]\n"
        "[[tail]]\nid = 'tail'\nposition = [0, 0, -10]\nkind = 'tail_feather'\ncount = 6\n"
        "lengths = [0.1]\nroot_width = 0.02\n"
    )
    skin = "name = 'bird'\n[skin]\nusd = 'skin.usda'\nprim = '/skin'\n"
    groom = grown(tmp_path, "[space]\nof = 'stage'\nleft = 'x'\n", limbs, skin=skin)
    assert groom.forward == pytest.approx((0.0, -1.0, 0.0))  # in the groom's frame, z up
    for part in ("secondaries", "tail"):
        frames = np.array([f.rotation for f in groom.feathers if f.region == part])
        assert (frames[:, :, 0] @ groom.forward < -0.7).all()
        assert (frames[:, 2, 2] > 0.7).all()


def test_the_space_of_the_body_goes_with_its_size(tmp_path):
    """The cap of a ball, found on balls of any size."""
    for size in (1.0, 28.0):
        folder = tmp_path / str(size)
        folder.mkdir()
        write_skin(folder, trimesh.creation.icosphere(3, radius=size * RADIUS))
        # a ball's box has a diagonal of 2 sqrt(3) radii
        region = (
            "[space]\nof = 'body'\nleft = 'y'\n[[region]]\nid = 'cap'\nkind = 'body_contour'\n"
            "count = 60\nlength = 0.01\nflow = { direction = [-1, 0, 0] }\n"
            "where = [{ sphere = { centre = [0, 0, 0.2886751], radius = 0.15 } }]\n"
        )
        found = roots(grown(folder, region)) / (size * RADIUS)
        top = np.linalg.norm(found - [0, 0, 1], axis=1)
        assert 0.9 * 0.15 * 2 * np.sqrt(3) < top.max() < 1.001 * 0.15 * 2 * np.sqrt(3)
        # candidates are drawn in metres, so that places differ: each cap is covered evenly. Squared
        # chords from its pole go evenly with the area of a cap (Archimedes)
        shares = np.sort(top**2) / (0.3 * np.sqrt(3)) ** 2
        assert len(shares) == 60
        assert np.abs(shares - (np.arange(60) + 0.5) / 60).max() < 0.08
        assert np.linalg.norm(found[:, :2].mean(axis=0)) < 0.05


def test_landmarks_stand_wherever_points_do(folder):
    mesh = trimesh.creation.icosphere(3, radius=RADIUS)
    feather = FEATHER + "{ vertex = 17, offset = [0, 0, 0.5] }\n"
    assert roots(grown(folder, feather))[0] == pytest.approx(
        mesh.vertices[17] + [0, 0, 0.5], abs=1e-7
    )
    # of a weight that is the height, on the upper half of a ball, the middle is at 2/3 of it
    top = roots(grown(folder, FEATHER + "{ primvar = 'top' }\n"))[0]
    assert top == pytest.approx([0, 0, RADIUS * 2 / 3], abs=0.01 * RADIUS)
    end = "{ position = { vertex = 17 }, direction = [1, 0, 0], up = [0, 0, 1] }"
    row = (
        f"[[row]]\nid = 'r'\nkind = 'covert'\ncount = 3\nfirst = {end}\nlast = {end}\n"
        "path = [{ vertex = 17 }, [0, 0, 0]]\n"
    )
    assert roots(grown(folder, row))[1] == pytest.approx(0.5 * mesh.vertices[17], abs=1e-7)
    region = (
        "[[region]]\nid = 'spot'\nkind = 'covert'\ncount = 30\nlength = 0.02\n"
        "where = [{ sphere = { centre = { vertex = 17 }, radius = 0.03 } }]\n"
        "flow = { away = { vertex = 17 } }\n"
    )
    found = grown(folder, region)
    away = roots(found) - mesh.vertices[17]
    assert np.linalg.norm(away, axis=1).max() < 0.0301
    along = np.array([f.rotation[:, 0] for f in found.feathers])
    assert ((along * away).sum(axis=1) > 0.9 * np.linalg.norm(away, axis=1)).all()


def test_landmarks_are_joints_of_the_skin_in_its_units(tmp_path):
    creature.skinned(tmp_path / "skin.usda")
    prim = "name = 'x'\n[skin]\nusd = 'skin.usda'\nprim = '/creature/skin'\n"
    space = "[space]\nof = 'skin'\nleft = '-z'\n"
    mark = "{ joint = 'j05', offset = [0, 2, 0] }\n"
    at = creature.HALF * (2 * 5 / (creature.JOINTS - 1) - 1)
    for own in (FEATHER + mark, FEATHER + mark.replace("j05", "j00/j01/j02/j03/j04/j05")):
        assert roots(grown(tmp_path, space, own, skin=prim))[0] == pytest.approx(
            [0, at, 0.02], abs=1e-6
        )


def at_vertex(table):
    return FEATHER + table + "\n"


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        (["[space]\nof = 'skin'\n"], "space.left: is missing. Give the axis"),
        (["[space]\nof = 'world'\n"], "space.of: 'world' is not allowed"),
        ([at_vertex("{ vertex = 9999 }")], "feather[0].position.vertex: 9999 is out of range, "),
        ([at_vertex("{ joint = 'hand' }")], "position.joint: no skeleton moves /skin"),
        ([at_vertex("{ primvar = 'tip' }")], "position.primvar: no primvar 'tip' on /skin"),
        ([at_vertex("{ vertex = 1, joint = 'a' }")], "position: holds vertex and joint, expects"),
        ([at_vertex("{ offset = [0, 0, 0] }")], "position: holds none, expects one of vertex"),
        ([at_vertex("{ vertx = 3 }")], "position.vertx: unknown key, did you mean 'vertex'?"),
        ([at_vertex("{ vertex = 3, prim = '/no' }")], "feather[0].position.prim: no prim /no"),
        ([GROWN + "prim = '/nay'\n"], "region[0].prim: no prim /nay"),
        ([at_vertex("[0, 0, 0]\nmirror = 'w'")], "mirror: 'w' is not allowed"),
    ],
)
def test_bad_spaces_and_landmarks_are_named(folder, tables, said):
    assert said in problems(folder, *tables)


def test_regions_of_a_wrong_space_are_not_grown(folder):
    space = "[space]\nof = 'skin'\n"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert (
            len(problems(folder, space, GROWN + "where = [{ y = [110, 160] }]\n").splitlines()) == 1
        )


def test_a_region_without_a_place_in_the_world_is_told_of_the_axes_of_the_skin(folder):
    with pytest.warns(UserWarning, match="hardly any place .* of = 'skin' writes"):
        grown(folder, region(), GROWN + "where = [{ y = [110, 160] }]\n")


def test_a_space_or_a_landmark_without_a_skin_is_named(tmp_path):
    bare = "name = 'x'\n"
    space = problems(tmp_path, "[space]\nof = 'skin'\nleft = 'x'\n", skin=bare)
    assert "space.of: is taken from the skin, and there is no [skin]" in space
    mark = problems(tmp_path, at_vertex("{ vertex = 3 }"), skin=bare)
    assert "feather[0].position: is taken from the skin, and there is no [skin]" in mark


@pytest.mark.parametrize(
    ("scale", "said"), [((1, 2, 1), "stretched or sheared"), ((-1, 1, 1), "mirrored")]
)
def test_a_skin_without_even_axes_lends_no_space(folder, scale, said):
    stage = Usd.Stage.Open(str(folder / "skin.usda"))
    UsdGeom.Xformable(stage.GetPrimAtPath("/skin")).AddScaleOp().Set(Gf.Vec3f(*scale))
    stage.Save()
    assert f"/skin is {said} by its transforms" in problems(
        folder, "[space]\nof = 'skin'\nleft = 'y'\n"
    )


def test_landmarks_of_a_skin_that_is_not_there_are_one_mistake(folder):
    row = """[space]
of = 'skin'
left = 'y'
[[row]]
id = 'right_row'
kind = 'covert'
count = 3
path = [{ vertex = 1 }, { vertex = 2 }]
first = { position = { vertex = 1 }, direction = [1, 0, 0], up = [0, 0, 1] }
last = { position = [0, 0, 0], direction = [1, 0, 0], up = [0, 0, 1] }
"""
    found = problems(folder, row, skin=SKIN.replace("/skin", "/skim"))
    assert "no prim /skim" in found
    assert len(found.splitlines()) == 1


@pytest.mark.parametrize(
    ("tables", "forward"),
    [
        ("", (1, 0, 0)),
        ("[space]\nof = 'stage'\nleft = 'x'\n", (0, -1, 0)),
        ("[space]\nleft = '-y'\n", (-1, 0, 0)),
    ],
)
def test_the_front_of_a_picture_is_the_creatures(tmp_path, tables, forward):
    write_skin(tmp_path)
    stage = Usd.Stage.Open(str(tmp_path / "skin.usda"))
    UsdGeom.SetStageUpAxis(stage, "Y")
    stage.GetRootLayer().Save()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        (tmp_path / "groom.toml").write_text(SKIN + tables + region(keys="count = 3"))
        export_groom(tmp_path / "groom.toml", tmp_path / "out.usda", quality="draft")
    heading = Cache(tmp_path / "out.usda").heading
    for view, seen in (("front", 1.0), ("side", 0.0), ("top", 0.0)):
        right, up = axes_of(view, np.zeros((1, 3)), np.zeros((0, 3), int), False, heading)
        assert np.cross(right, up) @ forward == pytest.approx(seen, abs=1e-9)
