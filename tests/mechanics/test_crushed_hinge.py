"""The openness of a hinge whose triangles are crushed: its range, and its gradient."""

from __future__ import annotations

import numpy as np
import pytest

from featherfx.algebra.vector_kernels import sub
from featherfx.algebra.views import lane, spread
from featherfx.jit.compiled import kernel
from featherfx.mechanics.vane_bending_kernels import angles_and_openness, openness_gradient
from featherfx.mechanics.vane_rest import CRUSHED_OPENNESS, opening

# unit edge, triangles of height 1 at rest
REST = 0.5


def nodes(height, seed=0):
    """Nodes of a hinge whose upper triangle has lost all but a share of its area."""
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    flat = np.array([[0, 0, 0], [1, 0, 0], [0.3, height, 0], [0.6, -0.15, 0.05]], dtype=float)
    return flat @ turn


@kernel
def _from_start(points, node):
    x, y, z = sub(points[node], points[0])
    return spread(x), spread(y), spread(z)


@kernel
def _openness(points, opened):
    e, u, v = _from_start(points, 1), _from_start(points, 2), _from_start(points, 3)
    return lane(angles_and_openness(e, u, v, spread(opened), spread(opened))[1], 0)


def openness(points):
    return _openness(points, float(opening(REST)))


@pytest.mark.parametrize("height", [CRUSHED_OPENNESS, 0.5, -1.0])
def test_a_triangle_that_keeps_enough_area_bends_as_ever(height):
    points = nodes(height)
    points[3] = points[0] + 2.0 * (points[3] - points[0])
    assert openness(points) == pytest.approx(1.0, abs=1e-12)


def test_the_openness_of_one_that_turns_over_passes_through_zero():
    heights = np.linspace(-0.2, 0.2, 41)
    values = [openness(nodes(height)) for height in heights]
    assert values[20] == pytest.approx(0.0, abs=1e-25)
    assert np.all(np.diff(values[20:]) > 0.0)
    assert values == pytest.approx(values[::-1])


@pytest.mark.parametrize("height", [0.19, 0.1, 0.03, 1e-3])
def test_its_gradient_is_the_derivative(height):
    points, gradient = nodes(height, 1), np.zeros((4, 3))
    openness_gradient(*points, opening(REST), opening(REST), gradient)
    rng = np.random.default_rng(2)
    for _ in range(6):
        x, step = rng.normal(size=(4, 3)), 1e-7
        slope = (openness(points + step * x) - openness(points - step * x)) / (2.0 * step)
        assert np.sum(gradient * x) == pytest.approx(slope, rel=1e-5, abs=1e-6)
