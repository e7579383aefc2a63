"""Coarse skins are split for their coats."""

import numpy as np

from featherfx.algebra.triangulation import weld
from featherfx.coat.carrier import find_neighbours, refine

ICOSAHEDRON = np.array([(0, a, b * (1 + 5**0.5) / 2) for a in (-1, 1) for b in (-1, 1)])
ICOSAHEDRON = np.concatenate([np.roll(ICOSAHEDRON, k, axis=1) for k in range(3)])


def coarse_ball():
    """An icosahedron in a ball of 1 m: points (12, 3) and faces (20, 3) that look outwards."""
    from scipy.spatial import ConvexHull

    points = ICOSAHEDRON / np.linalg.norm(ICOSAHEDRON[0])
    corners = points[ConvexHull(points).simplices]
    inwards = np.einsum(
        "tc,tc->t", np.cross(*np.diff(corners, axis=1).swapaxes(0, 1)), corners[:, 0]
    )
    return weld(np.where(inwards[:, None, None] < 0.0, corners[:, ::-1], corners))


def longest(points, faces):
    return np.linalg.norm(np.roll(points[faces], -1, axis=1) - points[faces], axis=2).max()


def test_edges_become_short_beside_feathers_and_the_skin_stays_closed_and_round():
    points, faces = coarse_ball()
    roots, lengths = points[:1], np.array([0.3])
    fine, split = refine(points, faces, roots, lengths)
    near = np.linalg.norm(fine[split].mean(axis=1) - roots[0], axis=1) < 0.3
    assert longest(fine, split[near]) < 0.5 * 0.3
    assert (find_neighbours(split) >= 0).all()
    assert len(split) < 1500
    # the facets of the solid lie 0.2 m within the ball
    radii = np.linalg.norm(fine, axis=1)
    assert np.linalg.norm(points[faces].mean(axis=1), axis=1).max() < 0.8
    assert radii.min() > 0.95
    assert radii.max() < 1.02
    assert np.array_equal(fine[: len(points)], points)


def test_a_fine_skin_stays_as_it_is():
    points, faces = refine(*coarse_ball(), np.zeros((1, 3)), np.array([1.0]))
    again = refine(points, faces, points[:1], np.array([3.0]))
    assert again[0] is points
    assert again[1] is faces
