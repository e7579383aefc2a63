"""Fibre networks: closed forms, plane against space, bounds."""

import numpy as np
import pytest

from featherfx.lab.networks.network import (
    FibreNetwork,
    held_displacements,
    homogenised,
    network_energy,
)

pytestmark = pytest.mark.verification


def chain(count, length, stretch, bend, size):
    """A straight fibre along x of count segments, clamped in direction at its first node."""
    first = np.arange(count)
    span = np.zeros((count, size))
    span[:, 0] = length / count
    return FibreNetwork(
        nodes=count + 1,
        ends=np.stack([first, first + 1], axis=1),
        span=span,
        stretch=np.full(count, stretch),
        pairs=np.stack([first - 1, first], axis=1),
        reach=length / count * np.where(first > 0, 2.0, 1.0),
        bend=np.full(count, bend),
    )


@pytest.mark.parametrize("size", [2, 3])
@pytest.mark.parametrize("count", [1, 5, 20])
def test_cantilever_errs_by_half_over_n_squared(size, count):
    """F L^3 / 3 EI (1 + 1 / (2 n^2)): the sum over hinges of F (L - s)^2 / k, k = EI / l, and
    2 EI / l at the clamp."""
    force = np.zeros((count + 1, size))
    force[-1, 1] = 0.7
    fibre = chain(count, 2.0, 5.0, 3.0, size)
    moved = held_displacements(fibre, np.array([0]), np.zeros((1, size)), force)
    expected = 0.7 * 8.0 / 9.0 * (1.0 + 0.5 / count**2)
    assert moved[-1, 1] == pytest.approx(expected, rel=1e-9)
    # work of the force is twice the energy
    assert network_energy(fibre, moved) == pytest.approx(0.5 * 0.7 * expected, rel=1e-9)


def square(bend):
    """Periodic cell 0.2 x 0.5 of two fibres along the axes that cross at one hinge."""
    return FibreNetwork(
        nodes=1,
        ends=np.zeros((2, 2), dtype=int),
        span=np.array([[0.2, 0.0], [0.0, 0.5]]),
        stretch=np.array([3.0, 7.0]),
        pairs=np.array([[0, 0], [1, 1]]),
        reach=np.array([0.4, 1.0]),
        bend=np.full(2, bend),
    )


def test_square_lattice_has_ea_over_spacing_and_no_shear_stiffness():
    gradients = np.array([[[1, 0], [0, 0]], [[0, 0], [0, 1]], [[0, 0.5], [0.5, 0]]], dtype=float)
    relaxed, affine = homogenised(square(1.0), gradients)
    assert relaxed / (0.2 * 0.5) == pytest.approx(np.diag([3.0 / 0.5, 7.0 / 0.2, 0.0]))
    assert affine == pytest.approx(relaxed)


def test_rotation_costs_nothing():
    turn = np.array([[[0.0, -1.0], [1.0, 0.0]]])
    assert homogenised(square(1.0), turn)[0] == pytest.approx(0.0, abs=1e-15)


def test_mechanism_is_not_solved():
    loose = square(1.0)
    pair = FibreNetwork(
        nodes=2,
        ends=np.array([[0, 1]]),
        span=np.array([[1.0, 0.0]]),
        stretch=loose.stretch[:1],
        pairs=np.zeros((0, 2), dtype=int),
        reach=np.zeros(0),
        bend=np.zeros(0),
    )
    with pytest.raises(ValueError, match="mechanism"):
        held_displacements(pair, np.array([0]), np.zeros((1, 2)), np.ones((2, 2)))
