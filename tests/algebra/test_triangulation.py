"""Triangles of polygons: they cover the polygon once, whatever its shape and its first corner."""

import numpy as np
import pytest

from featherfx.algebra.triangulation import triangulate as triangulate_faces


def triangulate(counts, corners):
    return triangulate_faces(counts, np.arange(len(corners)), corners)[:2]


ARROW = [(0.4, 0.0), (0.2, -0.1), (0.0, 0.0), (0.2, -0.3)]
HOUSE = [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)]
COMB = [(0, 0), (7, 0), (7, 3), (6, 3), (6, 1), (5, 3), (4, 1), (3, 3), (2, 1), (1, 3), (0, 3)]


def _star(count):
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    radius = np.where(np.arange(count) % 2, 0.3, 1.0)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def _shoelace(polygon):
    x, y = np.asarray(polygon, dtype=float).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def _areas(corners, places):
    a, b, c = (corners[places[:, k], :2] for k in range(3))
    first, second = b - a, c - a
    return 0.5 * (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])


SHAPES = {"arrow": ARROW, "house": HOUSE, "comb": COMB, "star": _star(24), "fine star": _star(400)}


@pytest.mark.parametrize("polygon", SHAPES.values(), ids=SHAPES)
@pytest.mark.parametrize("winding", [1, -1])
def test_triangles_cover_a_polygon_once(polygon, winding):
    flat = np.asarray(polygon, dtype=float)[::winding]
    whole = _shoelace(flat)
    for first in {0, 1, 2, 3, len(flat) // 2}:
        corners = np.column_stack([np.roll(flat, first, axis=0), np.zeros(len(flat))])
        places, face = triangulate(np.array([len(flat)]), corners)
        areas = _areas(corners, places)
        # all turn as the polygon does and add up to it, so none leaves it
        assert (np.sign(whole) * areas > 0.0).all()
        assert np.isclose(areas.sum(), whole)
        assert sorted(set(places.ravel())) == list(range(len(flat)))
        assert not face.any()


def test_a_fan_stays_where_it_fits_and_faces_keep_their_order():
    hexagon = np.column_stack([_star(12)[::2], np.zeros(6)])
    arrow = np.column_stack([ARROW, np.zeros(4)])
    places, face = triangulate(np.array([6, 4, 3]), np.vstack([hexagon, arrow, hexagon[:3]]))
    assert places[:4].tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]
    assert face.tolist() == [0, 0, 0, 0, 1, 1, 2]
    assert set(places[4:6].ravel()) == {6, 7, 8, 9}
    assert places[6].tolist() == [10, 11, 12]


def test_a_bent_polygon_is_covered_as_seen_along_its_normal():
    corners = np.column_stack([ARROW, [0.0, 0.03, 0.0, -0.02]])
    tilt = np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]])
    flat, _ = triangulate(np.array([4]), corners)
    turned, _ = triangulate(np.array([4]), 1000.0 + corners @ tilt)
    assert flat.tolist() == turned.tolist()
    assert np.isclose(np.abs(_areas(corners, flat)).sum(), abs(_shoelace(ARROW)))


def test_faces_without_area_still_have_triangles():
    corners = np.column_stack([np.linspace(0.0, 1.0, 5), np.zeros(5), np.zeros(5)])
    places, face = triangulate(np.array([5, 0, 2]), np.vstack([corners, corners[:2]]))
    assert len(places) == 3
    assert face.tolist() == [0, 0, 0]


def test_quadrangles_that_no_diagonal_fits_are_cut_where_they_are_left_least():
    bent = np.random.default_rng(2).normal(size=(300, 4, 3))
    ways, left = ([[0, 1, 2], [0, 2, 3]], [[1, 2, 3], [3, 0, 1]]), 0
    for corners in bent:
        places, _ = triangulate(np.array([4]), corners)
        area = np.cross(corners[2] - corners[0], corners[3] - corners[1])
        fan, other, own = (
            min(float(np.cross(b - a, c - a) @ area) for a, b, c in corners[np.asarray(way)])
            for way in (*ways, places)
        )
        left += max(fan, other) < 0.0 and fan > other
        assert own > 0.0 or own == max(fan, other)
    assert left > 10


@pytest.mark.parametrize("count", [4, 5, 7])
def test_the_corner_that_a_list_begins_with_is_of_no_account(count):
    """Of polygons that are bent out of their planes."""
    rng = np.random.default_rng(count)
    angles = np.sort(rng.uniform(0, 2 * np.pi, (200, count)), axis=1)
    points = np.stack([np.cos(angles), np.sin(angles), rng.normal(0, 0.1, angles.shape)], -1)
    counts, indices = np.full(200, count), np.arange(200 * count)
    found = []
    for turn in range(count):
        turned = np.roll(indices.reshape(-1, count), turn, axis=1).ravel()
        places, _, _ = triangulate_faces(counts, turned, points.reshape(-1, 3))
        found.append({tuple(sorted(each)) for each in turned[places].tolist()})
    assert all(each == found[0] for each in found)
