"""Sides of meshes: closed components face outwards, open ones agree with the larger part."""

import numpy as np
import pytest
import trimesh

from featherfx.algebra.triangulation import orient, triangulate
from featherfx.algebra.vectors import face_products
from featherfx.groom.skin.points import signed_volume

BALL = trimesh.creation.icosphere(subdivisions=2)
POINTS, FACES = np.array(BALL.vertices), np.array(BALL.faces, dtype=np.int64)


def _orient(faces, points):
    return orient(np.full(len(faces), 3), faces.ravel(), points, face_products(points[faces]))


def _turned(faces, which):
    found = faces.copy()
    found[which] = found[which][:, [0, 2, 1]]
    return found


@pytest.mark.parametrize("fraction", [0.0, 0.1, 0.5, 1.0])
def test_a_closed_component_is_a_volume_whatever_its_winding(fraction):
    which = np.random.default_rng(1).random(len(FACES)) < fraction
    given = _turned(FACES, which)
    mesh = _orient(given, POINTS)
    assert mesh.closed.all()
    assert not mesh.border.any()
    assert np.array_equal(mesh.turned, which)
    assert np.isclose(signed_volume(POINTS[_turned(given, mesh.turned)]), BALL.volume)


def test_split_points_do_not_open_a_volume():
    # every triangle has points of its own, as after a seam of textures along each edge
    mesh = _orient(np.arange(3 * len(FACES)).reshape(-1, 3), POINTS[FACES].reshape(-1, 3))
    assert mesh.closed.all()


def test_each_component_has_its_own_side():
    shifted = POINTS + np.array([3.0, 0.0, 0.0])
    sheet = np.array([[0.0, 0, 9], [1, 0, 9], [1, 1, 9], [0, 1, 9]])
    quad = np.array([[0, 1, 2], [0, 2, 3]]) + 2 * len(POINTS)
    faces = np.vstack([FACES, FACES[:, ::-1] + len(POINTS), quad])
    mesh = _orient(faces, np.vstack([POINTS, shifted, sheet]))
    balls = np.arange(len(faces)) < 2 * len(FACES)
    assert np.array_equal(mesh.closed, balls)
    assert np.array_equal(mesh.border, ~balls)
    assert np.array_equal(np.flatnonzero(mesh.turned), len(FACES) + np.arange(len(FACES)))
    # an open component keeps its author's winding
    assert not mesh.turned[~balls].any()


def test_an_open_component_agrees_with_its_larger_part():
    cap = FACES[POINTS[FACES][:, :, 2].mean(axis=1) > 0.0]
    for fraction in (0.2, 0.8):
        which = np.random.default_rng(2).random(len(cap)) < fraction
        mesh = _orient(_turned(cap, which), POINTS)
        assert not mesh.closed.any()
        assert np.array_equal(mesh.turned, which if fraction < 0.5 else ~which)


def test_a_strip_with_one_side_stays_as_it_is():
    count = 12
    ring = 2 * np.arange(count)
    after = np.roll(np.stack([ring, ring + 1], axis=1), -1, axis=0)
    after[-1] = after[-1][::-1]  # half a turn
    quads = np.stack([ring, ring + 1, after[:, 1], after[:, 0]], axis=1)
    strip = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    mesh = _orient(strip, np.random.default_rng(3).random((2 * count, 3)))
    assert not mesh.turned.any()
    assert not mesh.closed.any()


def test_inputs_stay_as_they_are():
    # a view with another order of memory, as after a change of winding
    faces = FACES[1:][:, [0, 2, 1]]
    before = faces.copy()
    assert len(_orient(faces, POINTS).closed) == len(faces)
    assert np.array_equal(faces, before)
    assert len(_orient(FACES[:0], POINTS).closed) == 0


def test_faces_of_any_number_of_corners_have_sides():
    box = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    quads = [[4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = [*quads, [1, 0, 2, 2, 3]]  # the last inwards, with one corner twice
    counts, indices = np.array([len(each) for each in faces]), np.concatenate(faces)
    for left_out, turned in ((0, [5]), (1, [])):
        some = len(indices) - 5 * left_out
        _, _, normals = triangulate(counts[: 6 - left_out], indices[:some], box)
        mesh = orient(counts[: 6 - left_out], indices[:some], box, normals)
        assert mesh.closed.all() != bool(left_out)
        assert np.flatnonzero(mesh.turned).tolist() == turned
        assert mesh.border.sum() == 4 * left_out
