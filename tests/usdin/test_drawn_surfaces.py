"""Surfaces as a renderer draws them: polygons, sides and transforms of skins and colliders."""

import numpy as np
import pytest
import trimesh
from pxr import Gf, Sdf, UsdGeom
from usdin_scenes import add_curves, add_mesh, new_stage, sheet

from featherfx.api import read_groom, read_shot
from featherfx.baking.export import export_groom
from featherfx.errors import InputError
from featherfx.groom.skin.points import signed_volume
from featherfx.usd.read.cache import Cache

GROOM = """name = "g"
[skin]
usd = "skin.usda"
prim = "/b/skin"
[[region]]
id = "r"
kind = "covert"
count = 40
length = 0.02
tilt = 20
flow = { direction = [1, 0, 0] }
"""
MIRRORS = {
    "none": Gf.Vec3d(1, 1, 1),
    "x": Gf.Vec3d(-1, 1, 1),
    "through a point": Gf.Vec3d(-1, -1, -1),
    "of two axes": Gf.Vec3d(-1, -2, 1),
}


def write_mesh(folder, points, counts, indices, scale=(1, 1, 1), left_handed=False):
    stage = new_stage(folder / "skin.usda")
    UsdGeom.Xform.Define(stage, "/b").AddScaleOp(UsdGeom.XformOp.PrecisionDouble).Set(
        Gf.Vec3d(*scale)
    )
    mesh = add_mesh(stage, "/b/skin", points, counts, indices)
    mesh.CreateSubdivisionSchemeAttr("none")
    if left_handed:
        mesh.CreateOrientationAttr("leftHanded")
    stage.GetRootLayer().Save()


def grow(folder):
    (folder / "groom.toml").write_text(GROOM)
    feathers = read_groom(folder / "groom.toml").feathers
    return np.array([f.position for f in feathers]), np.array([f.rotation for f in feathers])


@pytest.mark.parametrize("left_handed", [False, True])
@pytest.mark.parametrize("scale", MIRRORS.values(), ids=MIRRORS)
def test_feathers_of_a_mirrored_sheet_grow_on_its_side(tmp_path, scale, left_handed):
    points, counts, quads = sheet(4, 4)
    write_mesh(
        tmp_path, points, counts, quads[:, ::-1] if left_handed else quads, scale, left_handed
    )
    _, frames = grow(tmp_path)
    assert (np.sign(scale[2]) * frames[:, 2, 2] > 0.5).all()


@pytest.mark.parametrize("inwards", [False, True])
@pytest.mark.parametrize("scale", MIRRORS.values(), ids=MIRRORS)
def test_feathers_of_a_closed_body_grow_outside(tmp_path, scale, inwards):
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    faces = np.array(ball.faces)
    write_mesh(
        tmp_path, ball.vertices, [3] * len(faces), faces[:, ::-1] if inwards else faces, scale
    )
    places, frames = grow(tmp_path)
    assert (np.einsum("fc,fc->f", frames[:, :, 2], places) > 0.0).all()


ARROW = np.array([(0.4, 0.0), (0.2, -0.1), (0.0, 0.0), (0.2, -0.3)])
CROSS = np.array(
    [(1, 0), (2, 0), (2, 1), (3, 1), (3, 2), (2, 2), (2, 3), (1, 3), (1, 2), (0, 2), (0, 1), (1, 1)]
)


def is_inside(polygon, places):
    """Whether places (N, 2) are within a polygon, by rays along x."""
    x, y = polygon.T
    ahead_x, ahead_y = np.roll(x, -1), np.roll(y, -1)
    found = np.zeros(len(places), dtype=bool)
    for k in range(len(polygon)):
        spans = (y[k] > places[:, 1]) != (ahead_y[k] > places[:, 1])
        along = (places[:, 1] - y[k]) / np.where(ahead_y[k] == y[k], np.inf, ahead_y[k] - y[k])
        found ^= spans & (places[:, 0] < x[k] + along * (ahead_x[k] - x[k]))
    return found


@pytest.mark.parametrize(
    "polygon", [ARROW, 0.1 * CROSS, ARROW[::-1]], ids=["arrow", "cross", "back"]
)
@pytest.mark.parametrize("first", range(4))
def test_roots_stay_on_a_concave_face(tmp_path, polygon, first):
    corners = np.roll(polygon, first, axis=0)
    points = np.column_stack([corners, np.zeros(len(corners))])
    write_mesh(tmp_path, points, [len(points)], np.arange(len(points)))
    places, _ = grow(tmp_path)
    middle = corners.mean(axis=0)
    assert is_inside(corners, middle + (places[:, :2] - middle) * (1.0 - 1e-6)).all()


def test_the_colliders_of_a_shot_have_sides(tmp_path):
    """A closed mesh is a volume whatever its winding and its transforms, an open one a sheet."""
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    points, counts, quads = sheet(2, 2)
    count = len(box.vertices)
    write_mesh(
        tmp_path,
        np.vstack([box.vertices, points + np.array([3.0, 0.0, 0.0])]),
        [3] * len(box.faces) + counts.tolist(),
        np.concatenate([box.faces[:, ::-1].ravel(), quads.ravel() + count]),
        (-1, 1, 1),
    )
    (tmp_path / "groom.toml").write_text(
        'name = "g"\n[[feather]]\nid = "f"\nkind = "covert"\nposition = [0, 0, 2]\n'
    )
    (tmp_path / "shot.toml").write_text(
        'name = "s"\ngroom = "groom.toml"\nframes = [1, 2]\n[contact]\n'
        '[[collider]]\nusd = "skin.usda"\nprims = ["/b/skin"]\n'
    )
    (collider,) = read_shot(tmp_path / "shot.toml").colliders
    surface = collider.surface
    assert surface.closed.sum() == len(box.faces)
    assert signed_volume(surface.rest[surface.triangles[surface.closed]]) == pytest.approx(1.0)


def test_a_mesh_without_faces_is_refused_by_its_path(tmp_path):
    write_mesh(tmp_path, np.eye(3), [], [])
    with pytest.raises(InputError, match=r"/b/skin in .*: no face has any area"):
        grow(tmp_path)


def place_of(stage, index=0, time=None):
    """(3,) least point of a drawn mesh in the stage's space."""
    stage.GetRootLayer().Save()
    cache = Cache(stage.GetRootLayer().realPath)
    return cache.points(index, time).min(axis=0)


def test_a_picture_takes_transforms_that_have_samples_only(tmp_path):
    stage = new_stage(tmp_path / "set.usda")
    points, counts, quads = sheet(2, 2)
    above = UsdGeom.Xform.Define(stage, "/b")
    above.AddTranslateOp().Set(Gf.Vec3d(5, 0, 0), 1)
    add_mesh(stage, "/b/skin", points, counts, quads)
    np.testing.assert_allclose(place_of(stage), [4.8, -0.2, 0.0], atol=1e-6)
    above.AddScaleOp().Set(Gf.Vec3f(2, 2, 2))
    np.testing.assert_allclose(place_of(stage), [4.6, -0.4, 0.0], atol=1e-6)


def test_native_instances_are_in_pictures(tmp_path):
    stage = new_stage(tmp_path / "set.usda")
    points, counts, quads = sheet(2, 2)
    add_mesh(stage, "/kind/leaf", points, counts, quads)
    stage.OverridePrim("/kind").SetSpecifier(Sdf.SpecifierClass)
    for number in range(3):
        prim = UsdGeom.Xform.Define(stage, f"/set/tree_{number}")
        prim.AddTranslateOp().Set(Gf.Vec3d(number, 0, 0))
        prim.GetPrim().GetInherits().AddInherit("/kind")
        prim.GetPrim().SetInstanceable(True)
    UsdGeom.Imageable(stage.GetPrimAtPath("/set/tree_1")).MakeInvisible()
    assert [place_of(stage, index)[0].round(6) for index in range(2)] == [-0.2, 1.8]
    assert len(Cache(tmp_path / "set.usda").feathers) == 2


def add_nested(stage, path="/b/out"):
    """An instancer of two instancers of two curves, or sheets, each with transforms of its own."""
    outer = UsdGeom.PointInstancer.Define(stage, path)
    outer.CreateProtoIndicesAttr([0, 0])
    outer.CreatePositionsAttr([(0, 0, 0), (0, 0, 2)])
    inner = UsdGeom.PointInstancer.Define(stage, f"{path}/inner")
    outer.CreatePrototypesRel().SetTargets([inner.GetPath()])
    inner.CreateProtoIndicesAttr([0, 0, 0])
    inner.CreatePositionsAttr([(0, 0, 0), (0.5, 0, 0), (9, 9, 9)])
    inner.AddTranslateOp().Set(Gf.Vec3d(0, 3, 0))
    inner.DeactivateId(2)
    template = UsdGeom.Xform.Define(stage, f"{path}/inner/t")
    template.AddTranslateOp().Set(Gf.Vec3d(0, 1, 0))
    inner.CreatePrototypesRel().SetTargets([template.GetPath()])
    return inner, template


NESTED = [[0.0, 4.0, 0.0], [0.5, 4.0, 0.0], [0.0, 4.0, 2.0], [0.5, 4.0, 2.0]]


def test_instancers_in_instancers_place_feathers(tmp_path):
    stage = new_stage(tmp_path / "groom.usda")
    add_nested(stage)
    add_curves(stage, "/b/out/inner/t/c", [np.linspace([0, 0, 0], [-0.1, 0, 0.01], 5)])
    stage.GetRootLayer().Save()
    (tmp_path / "groom.toml").write_text('name = "g"\n[[usd]]\nfile = "groom.usda"\n')
    feathers = read_groom(tmp_path / "groom.toml").feathers
    np.testing.assert_allclose([f.position for f in feathers], NESTED, atol=1e-6)
    assert len({f.id for f in feathers}) == 4


@pytest.mark.parametrize("is_sampled", [False, True])
def test_instancers_in_instancers_are_in_pictures(tmp_path, is_sampled):
    """Also those whose places have only samples, and go on with a speed."""
    stage = new_stage(tmp_path / "set.usda")
    inner, _ = add_nested(stage)
    if is_sampled:
        places = inner.GetPositionsAttr().Get()
        inner.GetPositionsAttr().Clear()
        inner.GetPositionsAttr().Set(places, 2.0)
        inner.CreateVelocitiesAttr().Set([(0, 0, 24.0)] * 3, 2.0)
    add_mesh(stage, "/b/out/inner/t/leaf", *sheet(1, 1))
    hidden = add_mesh(stage, "/b/out/inner/t/hidden", *sheet(1, 1))
    hidden.MakeInvisible()
    found = [place_of(stage, index) + np.array([0.2, 0.2, 0.0]) for index in range(4)]
    np.testing.assert_allclose(found, NESTED, atol=1e-6)
    assert len(Cache(tmp_path / "set.usda").feathers) == 4


def test_a_ring_of_instancers_is_refused_by_its_paths(tmp_path):
    stage = new_stage(tmp_path / "groom.usda")
    inner, template = add_nested(stage)
    inner.GetPrototypesRel().SetTargets([template.GetPath(), "/b/out"])
    stage.GetRootLayer().Save()
    with pytest.raises(InputError, match=r"ring: /b/out -> /b/out/inner -> /b/out"):
        Cache(tmp_path / "groom.usda")
    (tmp_path / "groom.toml").write_text('name = "g"\n[[usd]]\nfile = "groom.usda"\n')
    with pytest.raises(InputError, match=r"ring: /b/out -> /b/out/inner"):
        read_groom(tmp_path / "groom.toml")


@pytest.mark.parametrize("folder", ["", "a_folder_whose_name_is_long" * 4])
@pytest.mark.parametrize("name", ["skin", "abcdefghij" * 20, "ski\u00f1"])
def test_a_groom_at_rest_names_its_skin_however_long_the_path(tmp_path, folder, name):
    (tmp_path / folder).mkdir(exist_ok=True)
    stage = new_stage(tmp_path / folder / "skin.usda")
    add_mesh(stage, f"/b/{name}", *sheet(2, 2))
    stage.GetRootLayer().Save()
    skin = f'usd = "{folder and folder + "/"}skin.usda"\nprim = "/b/{name}"'
    text = GROOM.replace('usd = "skin.usda"\nprim = "/b/skin"', skin)
    (tmp_path / "groom.toml").write_text(text)
    export_groom(tmp_path / "groom.toml", tmp_path / "out.usda")
    (scenery,) = Cache(tmp_path / "out.usda").scenery
    assert scenery["prim"] == f"/b/{name}"
    assert (tmp_path / scenery["file"]).samefile(tmp_path / folder / "skin.usda")
