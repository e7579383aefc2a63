"""Subdivision: against a plain version one point at a time, B-splines, and trimesh."""

from itertools import pairwise

import numpy as np
import pytest

from featherfx.algebra.subdivision import (
    estimate_cage_distance,
    measure_cage_distance,
    refine,
    refine_within,
)
from featherfx.algebra.subdivision_cage import Rules, Sharp, make_cage, make_value_cage
from featherfx.groom.skin.skin import closest

CUBE = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
CORNERS = np.array([(x, y, z) for z in (-1, 1) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
# a triangle, a pentagon and quads, two of them folded over an open border
MIXED = [(0, 1, 2), (0, 2, 3, 4, 5), (2, 1, 6, 7), (3, 2, 7, 8), (4, 3, 8, 9)]
# point 3 has two faces, which share both its edges
POCKET = [(0, 1, 2, 3), (0, 3, 2, 4)]


def cage(faces, size, **rules):
    return make_cage(
        np.array([len(each) for each in faces]), np.concatenate(faces), size, Rules(**rules)
    )


def split_plainly(points, faces, creases, corners, smooth_triangles=False):
    """One level by Catmull and Clark, one point at a time, with creases (DeRose 1998)."""
    sides = {}
    for number, face in enumerate(faces):
        for a, b in zip(face, [*face[1:], face[0]], strict=True):
            sides.setdefault(frozenset((a, b)), []).append(number)
    sharp = {
        edge: np.inf if len(near) == 1 else creases.get(edge, 0.0) for edge, near in sides.items()
    }
    centre = [np.mean([points[k] for k in face], axis=0) for face in faces]
    number_of, made, edge_sharpness = {}, [], {}
    for edge, near in sides.items():
        a, b = sorted(edge)
        middle = 0.5 * (points[a] + points[b])
        weights = [0.47 if smooth_triangles and len(faces[f]) == 3 else 0.25 for f in near]
        share = np.mean(weights)
        smooth = (1 - 2 * share) * middle + share * sum(centre[f] for f in near)
        amount = min(sharp[edge], 1.0)
        number_of[edge] = len(points) + len(made)
        made.append(middle if amount == 1.0 else amount * middle + (1 - amount) * smooth)
        for end in edge:
            if creases.get(edge, 0.0) > 1.0:
                edge_sharpness[frozenset((end, number_of[edge]))] = creases[edge] - 1.0

    def ruled(k, sharpness, corner):
        edges = [edge for edge in sides if k in edge]
        others = [points[next(iter(edge - {k}))] for edge in edges]
        lines = [o for o, edge in zip(others, edges, strict=True) if sharpness[edge] > 0.0]
        if corner > 0.0 or len(lines) > 2:
            return points[k]
        if len(lines) == 2:
            return 0.75 * points[k] + 0.125 * sum(lines)
        n, around = len(edges), [c for c, face in zip(centre, faces, strict=True) if k in face]
        return ((n - 2) * points[k] + np.mean(others, axis=0) + np.mean(around, axis=0)) / n

    moved = []
    worn = {edge: max(amount - 1.0, 0.0) for edge, amount in sharp.items()}
    for k in range(len(points)):
        if not any(k in edge for edge in sides):
            moved.append(points[k])
            continue
        corner = corners.get(k, 0.0)
        fading = [sharp[e] for e in sides if k in e and sharp[e] > 0.0 and worn[e] == 0.0]
        fading += [corner] if 0.0 < corner <= 1.0 else []
        share = min(np.mean(fading), 1.0) if fading else 1.0
        before = ruled(k, sharp, corner)
        after = ruled(k, worn, max(corner - 1.0, 0.0))
        moved.append(share * before + (1 - share) * after)
    inner = len(points) + len(made)
    children = [
        (
            a,
            number_of[frozenset((a, b))],
            inner + number,
            number_of[frozenset((a, face[place - 1]))],
        )
        for number, face in enumerate(faces)
        for place, (a, b) in enumerate(zip(face, [*face[1:], face[0]], strict=True))
    ]
    corners = {k: value - 1.0 for k, value in corners.items() if value > 1.0}
    return np.array([*moved, *made, *centre]), children, edge_sharpness, corners


def creased(creases, corners):
    edges = np.array([sorted(edge) for edge in creases]).reshape(-1, 2)
    return {
        "creases": Sharp(edges, np.array(list(creases.values()), float)),
        "corners": Sharp(np.array(list(corners), int), np.array(list(corners.values()), float)),
    }


SHARP = {
    "smooth": ({}, {}),
    "crease": ({frozenset((4, 5)): 1.5, frozenset((5, 6)): 0.3, frozenset((6, 7)): 10.0}, {}),
    "dart and corner": ({frozenset((0, 1)): 2.2}, {6: 0.7, 3: 10.0}),
}


@pytest.mark.parametrize("name", SHARP)
@pytest.mark.parametrize("smooth_triangles", [False, True])
def test_limits_are_those_of_a_level_made_one_point_at_a_time(name, smooth_triangles):
    creases, sharp = SHARP[name]
    random = np.random.default_rng(3)
    for faces, size in ((CUBE, 8), (MIXED, 10), (POCKET, 5)):
        corners = {k: s for k, s in sharp.items() if k < size}
        points = random.normal(size=(size, 3))
        # the only face at a point makes it a corner
        lone = {k: np.inf for k in range(size) if sum(k in face for face in faces) == 1}
        known = {edge: s for edge, s in creases.items() if any(edge <= set(f) for f in faces)}
        rules = {"smooth_triangles": smooth_triangles}
        ours = refine(cage(faces, size, **rules, **creased(known, corners)), 3)
        level = points, faces, known, {**corners, **lone}
        for _ in range(3):
            level = split_plainly(*level, smooth_triangles)
        plain = refine(cage(level[1], len(level[0]), **creased(level[2], level[3])), 0)
        ours, plain = (
            sorted(map(tuple, np.round((each.matrix @ at)[np.unique(each.indices)], 9)))
            for each, at in ((ours, points), (plain, level[0]))
        )
        assert len(ours) == len(plain)
        np.testing.assert_allclose(ours, plain, atol=2e-9)


def test_limits_are_where_levels_tend_to():
    points, faces = CORNERS.astype(float) + 0.3 * np.sin(7.0 * CORNERS[:, [1, 2, 0]]), CUBE
    limit = refine(cage(CUBE, 8), 0).matrix @ points
    off = []
    level = points, faces, {}, {}
    for _ in range(4):
        level = split_plainly(*level)
        off.append(np.abs(level[0][:8] - limit).max())
    assert all(after < 0.45 * before for before, after in pairwise(off))
    assert off[-1] < 6e-3


def grid(n):
    """(faces, (V, 2) places) of n by n quads within 0 and n."""
    number = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    faces = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1)
    places = np.stack(np.meshgrid(*[np.arange(n + 1.0)] * 2, indexing="ij"), axis=-1)
    return [tuple(each) for each in faces.reshape(-1, 4).tolist()], places.reshape(-1, 2)


def spline(knots, at):
    """Uniform cubic B-spline weights (len(at), knots) in closed form."""
    away = np.abs(at[:, None] - np.arange(knots))
    near = 2 / 3 - away**2 + away**3 / 2
    return np.where(away < 1, near, np.where(away < 2, (2 - away) ** 3 / 6, 0.0))


def test_regular_patches_are_b_splines():
    faces, places = grid(5)
    random = np.random.default_rng(1)
    points = np.column_stack([places, random.normal(size=len(places))])
    found = refine(cage(faces, 36), 3)
    limit = found.matrix @ points
    inner = ((limit[:, :2] >= 1.0) & (limit[:, :2] <= 4.0)).all(axis=1)
    x, y = (spline(6, limit[inner, axis]) for axis in (0, 1))
    np.testing.assert_allclose(
        np.einsum("ki,kj,ij->k", x, y, points[:, 2].reshape(6, 6)), limit[inner, 2], atol=1e-12
    )


def test_loop_is_that_of_trimesh():
    trimesh = pytest.importorskip("trimesh")
    ball = trimesh.creation.icosphere(0)
    vertices, faces = np.array(ball.vertices) * (1.0, 1.3, 0.7), np.array(ball.faces)
    found = refine(cage(list(faces), len(vertices), scheme="loop"), 2)
    limit = found.matrix @ vertices
    for levels in (2, 3):
        other, other_faces = trimesh.remesh.subdivide_loop(vertices, faces, levels)
        again = refine(cage(list(other_faces), len(other), scheme="loop"), 0).matrix @ other
        distance = np.linalg.norm(limit[:, None] - again[None], axis=2).min(axis=1)
        assert distance.max() < 1e-12
    assert np.linalg.norm(limit[:, None] - other[None], axis=2).min(axis=1).max() < 6e-3


def test_bilinear_keeps_points_and_adds_middles():
    found = refine(cage(CUBE, 8, scheme="bilinear"), 1)
    points = found.matrix @ CORNERS.astype(float)
    assert (points[:8] == CORNERS).all()
    assert {tuple(each) for each in points} == {
        (x, y, z)
        for x in (-1, 0, 1)
        for y in (-1, 0, 1)
        for z in (-1, 0, 1)
        if (x, y, z) != (0,) * 3
    }


@pytest.mark.parametrize(("boundary", "corner"), [("edgeOnly", 1 / 6), ("edgeAndCorner", 0.0)])
def test_borders_are_splines_and_corners_as_the_rule_says(boundary, corner):
    faces, places = grid(3)
    points = np.column_stack([places, np.zeros(16)])
    found = refine(cage(faces, 16, boundary=boundary), 0)
    limit = found.matrix @ points
    np.testing.assert_allclose(limit[0], [corner, corner, 0.0], atol=1e-12)
    np.testing.assert_allclose(limit[1], [0.0, 1.0, 0.0], atol=1e-12)


def test_without_a_boundary_rule_faces_at_borders_are_not_drawn():
    faces, places = grid(4)
    found = refine(cage(faces, 25, boundary="none"), 1)
    drawn = (found.matrix @ np.column_stack([places, np.zeros(25)]))[np.unique(found.indices)]
    assert drawn[:, :2].min() == pytest.approx(1.0)
    assert drawn[:, :2].max() == pytest.approx(3.0)
    holed = refine(cage(faces, 25, holes=np.array([5])), 2)
    assert set(range(16)) - set(holed.parent.tolist()) == {5}


@pytest.mark.parametrize(
    ("rule", "at_lone_corner", "at_seam"),
    [
        ("none", 1 / 6, False),
        ("cornersOnly", 0.0, False),
        ("cornersPlus1", 0.0, False),
        ("cornersPlus2", 0.0, False),
        ("boundaries", 0.0, True),
        ("all", 0.0, True),
    ],
)
def test_values_of_corners_keep_seams_and_follow_the_rule(rule, at_lone_corner, at_seam):
    # two charts side by side; the seam between them is bent in the plane of the values
    faces, places = grid(4)
    corners = np.concatenate(faces)
    right = np.repeat([places[list(face)].mean(axis=0)[0] > 2.0 for face in faces], 4)
    chart = right.astype(int) * 25 + corners
    numbers, values = np.unique(chart, return_inverse=True)
    uv = places[numbers % 25] + np.array([10.0, 0.0]) * (numbers >= 25)[:, None]
    uv[:, 0] += np.where(np.isin(numbers % 25, [11, 13]), 0.3, 0.0)  # beside the middle
    outer = cage(faces, 25, boundary="edgeOnly")
    inner, value = make_value_cage(outer, values.reshape(-1), rule)
    found = refine(inner, 0)
    limit = found.matrix @ np.column_stack([uv, np.zeros(len(uv))])[value]
    of = {int(each): limit[k] for k, each in enumerate(value)}
    lone = of[int(np.flatnonzero(numbers == 0)[0])]
    np.testing.assert_allclose(lone[:2], [at_lone_corner] * 2, atol=1e-12)
    seam = of[int(np.flatnonzero(numbers == 12)[0])]
    expected = 2.0 if at_seam else 2.0 + 0.3 / 3
    assert seam[0] == pytest.approx(expected)


def test_values_without_seams_follow_the_points():
    random = np.random.default_rng(5)
    points = random.normal(size=(10, 3))
    outer = cage(MIXED, 10, creases=Sharp(np.array([[2, 3]]), np.array([2.5])))
    inner, value = make_value_cage(outer, np.concatenate(MIXED), "cornersPlus1")
    ours, own = refine(inner, 2), refine(outer, 2)
    np.testing.assert_allclose(
        (ours.matrix @ points[value])[ours.indices], (own.matrix @ points)[own.indices], atol=1e-12
    )


def test_values_apart_at_each_corner_are_bilinear():
    outer = cage(CUBE, 8)
    inner, value = make_value_cage(outer, np.arange(24), "cornersPlus1")
    uv = np.random.default_rng(2).normal(size=(24, 3))
    found = refine(inner, 1)
    np.testing.assert_allclose(
        (found.matrix @ uv[value])[found.indices].reshape(24, 4, 3)[:, 2],
        np.repeat(uv.reshape(6, 4, 3).mean(axis=1), 4, axis=0),
        atol=1e-12,
    )


def test_levels_end_where_faces_are_near_the_surface():
    ball = CORNERS * 0.05
    finer = refine(cage(CUBE, 8), 5)
    surface = (finer.matrix @ ball)[finer.indices.reshape(-1, 4)[:, [[0, 1, 2], [0, 2, 3]]]]
    surface = surface.reshape(-1, 3, 3)
    for tolerance in (1e-3, 1e-4):
        found, off = refine_within(cage(CUBE, 8), ball, tolerance)
        assert off <= tolerance
        quads = (found.matrix @ ball)[found.indices].reshape(-1, 4, 3)
        middles = np.concatenate([0.5 * (quads[:, 0] + quads[:, 2]), quads.mean(axis=1)])
        triangle, weights = closest(middles, surface)
        near = np.einsum("nk,nkc->nc", weights, surface[triangle])
        assert np.linalg.norm(near - middles, axis=1).max() < tolerance + 2e-5
    coarse, off = refine_within(cage(CUBE, 8), ball, 0.0, max_faces=100)
    assert len(coarse.counts) == 96
    assert off > 0.0


def test_the_distance_of_a_cage_is_that_of_its_farthest_corner():
    assert measure_cage_distance(cage(CUBE, 8), CORNERS * 0.1) == pytest.approx(0.05 * 3**0.5)
    sharp = Sharp(np.arange(8), np.full(8, 10.0))
    assert measure_cage_distance(cage(CUBE, 8, corners=sharp), CORNERS * 0.1) == 0.0
    counts, indices = np.full(6, 4), np.concatenate(CUBE)
    for scheme in ("catmullClark", "bilinear"):
        mesh = cage(CUBE, 8, scheme=scheme)
        assert estimate_cage_distance(counts, indices, CORNERS * 0.1, scheme) == pytest.approx(
            measure_cage_distance(mesh, CORNERS * 0.1)
        )
