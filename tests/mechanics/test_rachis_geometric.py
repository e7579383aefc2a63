"""Geometric stiffness of a rachis element against second differences of its strains."""

from __future__ import annotations

import numpy as np
import pytest
from trial_batches import random_turn, turned

from featherfx.mechanics.rachis_kernels import rachis_geometric, rachis_strain

LENGTH = 0.7


def element(seed):
    """A stretched and sheared element whose rows are not turned against each other."""
    rng = np.random.default_rng(seed)
    return random_turn(rng), rng.normal(size=(2, 3)), rng.normal(size=6)


def second_variation(turn, points, stress, x):
    """Second derivative of stress . strain along an increment (12,), world rotations by exp."""
    halfway, strain = np.zeros((3, 3)), np.zeros(6)

    def work(step):
        y = step * x
        first, second = turned(turn, y[3:6]), turned(turn, y[9:12])
        rachis_strain(first, second, points[0] + y[:3], points[1] + y[6:9], LENGTH, halfway, strain)
        return stress @ strain

    step = 1e-3
    return (work(step) - 2.0 * work(0.0) + work(-step)) / step**2


def stiffness_of(turn, points, stress, signed):
    halfway, strain, lower = np.zeros((3, 3)), np.zeros(6), np.zeros((12, 12))
    rachis_strain(turn, turn, points[0], points[1], LENGTH, halfway, strain)
    rachis_geometric(points[0], points[1], LENGTH, halfway, stress, signed, lower)
    return np.tril(lower) + np.tril(lower, -1).T


@pytest.mark.parametrize("seed", range(4))
def test_the_signed_stiffness_is_the_second_variation(seed):
    turn, points, stress = element(seed)
    matrix = stiffness_of(turn, points, stress, True)
    rng = np.random.default_rng(10 + seed)
    for _ in range(6):
        x = rng.normal(size=12)
        expected = second_variation(turn, points, stress, x)
        assert x @ matrix @ x == pytest.approx(expected, rel=1e-4, abs=1e-4)


@pytest.mark.parametrize("seed", range(4))
def test_the_unsigned_stiffness_never_destabilises(seed):
    turn, points, stress = element(seed)
    values = np.linalg.eigvalsh(stiffness_of(turn, points, stress, False))
    assert values.min() > -1e-12 * max(values.max(), 1.0)


def test_tension_stiffens_and_compression_does_not():
    turn, points, _ = element(0)
    along = points[1] - points[0]
    halfway, strain = np.zeros((3, 3)), np.zeros(6)
    rachis_strain(turn, turn, points[0], points[1], LENGTH, halfway, strain)
    pull = np.concatenate([halfway.T @ along, np.zeros(3)])
    assert np.abs(stiffness_of(turn, points, pull, False)).max() > 0.1
    assert not stiffness_of(turn, points, -pull, False).any()
