"""Barbs as inextensible curves: curvature shapes, cantilevers, arcs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize
from trial_batches import barb_slopes, random_quat

from featherfx.algebra.vectors import quats_to_frames
from featherfx.mechanics.barb_kernels import barb_points
from featherfx.mechanics.resolution import MIN_BARB_STIFFNESS
from featherfx.mechanics.vane_rest import curvature_shapes

UNIT = np.array([1.0, 0.0, 0.0, 0.0])


def straight_joints(count):
    return np.tile(UNIT, (count, 1))


def nodes_of(shapes, coefficients, length=1.0):
    """Nodes (m, 3) of a straight barb along x, clamped at the origin."""
    count = shapes.shape[1]
    points = np.zeros((count, 3))
    barb_points(
        *(UNIT, np.zeros(3), UNIT, straight_joints(count), length / count),
        *(shapes, np.asarray(coefficients, float), np.zeros((count, 4)), points),
    )
    return points


def tip_flexibility(taper, coefficients, joints):
    """Tip deflection of a barb of unit length and root stiffness under a unit tip load."""
    shapes = curvature_shapes(coefficients, joints, taper)
    slopes = barb_slopes(
        UNIT, UNIT, straight_joints(joints), 1.0 / joints, shapes, np.zeros(2 * coefficients)
    )
    normal, in_plane = slopes[6 : 6 + coefficients, 2, -1], slopes[6 + coefficients :, 1, -1]
    assert np.sum(normal**2) == pytest.approx(np.sum(in_plane**2), rel=1e-12)
    return np.sum(normal**2)


@pytest.mark.parametrize("taper", [0.0, 1.0, 2.5])
def test_shapes_are_orthonormal_under_the_bending_stiffness(taper):
    joints = 1000
    shares = curvature_shapes(4, joints, taper)
    edges = np.concatenate([[0.0], (np.arange(joints) + 0.5) / joints])
    width, middle = np.diff(edges), 0.5 * (edges[1:] + edges[:-1])
    stiffness = np.maximum((1.0 - middle) ** taper, MIN_BARB_STIFFNESS)
    product = (shares / width * stiffness) @ shares.T
    assert product == pytest.approx(np.eye(4), abs=0.01)


def test_no_coefficients_and_fewer_shapes_are_the_first_of_more():
    assert curvature_shapes(0, 6, 1.0).shape == (0, 6)
    assert curvature_shapes(2, 6, 1.0) == pytest.approx(curvature_shapes(4, 6, 1.0)[:2], abs=1e-12)


@pytest.mark.parametrize(
    ("taper", "exact"),
    # F L^3 / B times the integral of (1 - s)^2 / max((1 - s)^taper, 0.05)
    [(0.0, 1.0 / 3.0), (1.0, 0.5 - 0.5 * MIN_BARB_STIFFNESS**2 + MIN_BARB_STIFFNESS**2 / 3.0)],
)
def test_tip_load_deflects_a_barb_as_beam_theory_says(taper, exact):
    """However few joints there are, because they turn as the segments' mean directions do."""
    for joints in (1, 3, 6, 12):
        assert tip_flexibility(taper, 2, joints) == pytest.approx(exact, rel=1e-3)


@pytest.mark.parametrize("turn", [0.5, 2.0, 5.5])
def test_a_constant_curvature_is_an_arc(turn):
    joints = 60
    shapes = np.full((1, joints), 1.0 / joints)
    shapes[0, 0] *= 0.5
    points = nodes_of(shapes, [turn, 0.0])
    middle = (np.arange(joints) + 1.0) / joints * turn
    assert points[:, 0] == pytest.approx(np.sin(middle) / turn, abs=2e-3)
    assert points[:, 1] == pytest.approx(np.zeros(joints), abs=1e-12)
    assert -points[:, 2] == pytest.approx((1.0 - np.cos(middle)) / turn, abs=2e-3)


def elastica_tip(load):
    """Tip (along, across) of the exact inextensible cantilever, load = F L^2 / B, by shooting."""

    def solve(curvature):
        def rates(_, y):
            return [y[1], -load * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])]

        return solve_ivp(rates, (0.0, 1.0), [0.0, curvature, 0, 0], rtol=1e-9, atol=1e-11).y[:, -1]

    root = brentq(lambda curvature: solve(curvature)[1], 0.0, load, xtol=1e-10)
    return solve(root)[2:]


@pytest.mark.parametrize("load", [0.5, 2.0])
def test_a_barb_under_a_large_tip_load_takes_the_shape_of_the_elastica(load):
    shapes = curvature_shapes(3, 60, 0.0)

    def energy(q):
        tip = nodes_of(shapes, np.concatenate([np.zeros(3), q]))[-1]
        return 0.5 * np.sum(q**2) - load * tip[1]

    q = minimize(energy, np.zeros(3), tol=1e-10).x
    tip = nodes_of(shapes, np.concatenate([np.zeros(3), q]))[-1]
    assert tip[:2] == pytest.approx(elastica_tip(load), abs=1e-3)


def test_segments_keep_their_length_in_any_pose():
    rng = np.random.default_rng(0)
    joints = np.stack([UNIT, *(random_quat(rng) for _ in range(7))])
    shapes, root, points = curvature_shapes(3, 8, 1.0), rng.normal(size=3), np.zeros((8, 3))
    frames = np.zeros((8, 4))
    for _ in range(20):
        coefficients = 10.0 * rng.normal(size=6)
        barb_points(
            *(random_quat(rng), root, random_quat(rng), joints, 0.37),
            *(shapes, coefficients, frames, points),
        )
        segments = np.linalg.norm(np.diff(np.vstack([root, points]), axis=0), axis=1)
        assert segments == pytest.approx(np.full(8, 0.37), rel=1e-14)


def test_a_barb_without_curvature_leaves_along_its_clamp():
    rng = np.random.default_rng(1)
    turn, clamp, root = random_quat(rng), random_quat(rng), rng.normal(size=3)
    shapes, points = curvature_shapes(2, 4, 1.0), np.zeros((4, 3))
    frames, straight = np.zeros((4, 4)), straight_joints(4)
    barb_points(turn, root, clamp, straight, 0.25, shapes, np.zeros(4), frames, points)
    direction = quats_to_frames(turn) @ quats_to_frames(clamp)[:, 0]
    assert points == pytest.approx(root + np.outer(np.arange(1, 5) / 4, direction), abs=1e-14)
