"""Surfaces as a renderer draws them: polygons, sides and transforms of skins and colliders."""

import numpy as np
import pytest
import trimesh
from pxr import Gf, UsdGeom
from usdin_scenes import add_mesh, new_stage, sheet

from featherfx.api import read_groom, read_shot
from featherfx.errors import InputError
from featherfx.groom.skin.faults import signed_volume

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
