"""Geometric stiffness of a stressed vane triangle, whole and along its normal."""

from __future__ import annotations

import numpy as np
import pytest

from featherfx.mechanics.vane_membrane_kernels import (
    membrane_geometric_stiffness,
    membrane_normal_stiffness,
    membrane_strain,
)

STRESSES = [(2.0, 0.7), (2.0, 0.0), (-1.5, 0.9), (0.3, -1.2)]


def triangle(seed):
    """Nodes (3, 3), rest numbers and unit normal of a random triangle."""
    rng = np.random.default_rng(seed)
    nodes = rng.normal(size=(3, 3))
    normal = np.cross(nodes[1] - nodes[0], nodes[2] - nodes[0])
    return nodes, np.array([1.3, 0.4, 0.8]), normal / np.linalg.norm(normal)


def second_variation(nodes, rest, moves, across, shear):
    """Second derivative of across e_ww + shear 2 e_vw when nodes move by (3, 3) times a step.

    Strains are quadratic in the positions, so that the second difference is exact.
    """

    def work(step):
        moved = nodes + step * moves
        e_ww, e_vw = membrane_strain(moved[0], moved[1], moved[2], rest)
        return across * e_ww + shear * e_vw

    return work(1.0) - 2.0 * work(0.0) + work(-1.0)


@pytest.mark.parametrize(("across", "shear"), STRESSES)
def test_geometric_stiffness_is_the_second_variation_less_the_squares_of_the_first(across, shear):
    nodes, rest, _ = triangle(6)
    own, pairs = np.split(np.array(membrane_geometric_stiffness(rest, across, shear)), 2)
    matrix = np.diag(2.0 * own)
    for (a, b), value in zip(((0, 1), (0, 2), (1, 2)), pairs, strict=True):
        matrix[a, b] = matrix[b, a] = value
    moves = np.random.default_rng(7).normal(size=(3, 3))
    expected = second_variation(nodes, rest, moves, across, shear)
    assert np.einsum("ak,ab,bk->", moves, matrix, moves) == pytest.approx(expected, rel=1e-12)


def along_normal(nodes, rest, across, shear):
    """Stiffnesses (2,) and gradients (2, 3, 3)."""
    stiffness, gradient = np.ones(2), np.ones((2, 3, 3))
    membrane_normal_stiffness(*nodes, rest, (across, shear), stiffness, gradient)
    return stiffness, gradient


@pytest.mark.parametrize(("across", "shear"), STRESSES)
def test_stiffness_along_the_normal_is_the_second_variation_split_by_sign(across, shear):
    nodes, rest, normal = triangle(3)
    stiffness, gradient = along_normal(nodes, rest, across, shear)
    along = gradient @ normal
    form = np.zeros((3, 3))
    for a in range(3):
        for b in range(3):
            one, two = np.eye(3)[a], np.eye(3)[b]
            plus, minus = (
                second_variation(nodes, rest, np.outer(each, normal), across, shear)
                for each in (one + two, one - two)
            )
            form[a, b] = 0.25 * (plus - minus)
    assert np.einsum("e,ea,eb->ab", stiffness, along, along) == pytest.approx(form, abs=1e-12)
    assert stiffness[0] >= 0.0 >= stiffness[1]
    expected = np.linalg.eigvalsh(np.array([[0.0, shear], [shear, across]]))
    assert np.sort(stiffness) == pytest.approx(expected, abs=1e-12)


def test_it_pushes_along_the_normal_only_and_not_on_a_rigid_shift():
    nodes, rest, normal = triangle(4)
    _, gradient = along_normal(nodes, rest, 1.0, 0.4)
    assert np.abs(gradient).max() > 0.1
    assert np.abs(np.cross(gradient, normal)).max() < 1e-12
    assert np.abs(gradient.sum(axis=1)).max() < 1e-12


def test_a_slack_triangle_has_no_such_stiffness():
    nodes, rest, _ = triangle(5)
    stiffness, gradient = along_normal(nodes, rest, 0.0, 0.0)
    assert not stiffness.any()
    assert not gradient.any()
