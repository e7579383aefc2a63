"""Geometric stiffness of a stressed vane triangle along its normal."""

from __future__ import annotations

import numpy as np
import pytest

from featherfx.mechanics.vane_membrane_kernels import membrane_lift, membrane_strain

STRESSES = [(2.0, 0.7), (2.0, 0.0), (-1.5, 0.9), (0.3, -1.2)]


def triangle(seed):
    """Nodes (3, 3), rest numbers and unit normal of a random triangle."""
    rng = np.random.default_rng(seed)
    nodes = rng.normal(size=(3, 3))
    normal = np.cross(nodes[1] - nodes[0], nodes[2] - nodes[0])
    return nodes, np.array([1.3, 0.4, 0.8]), normal / np.linalg.norm(normal)


def second_variation(nodes, rest, normal, across, shear, heights):
    """Second derivative of across e_ww + shear 2 e_vw when nodes move along the normal.

    Strains are quadratic in the positions, so that the second difference is exact.
    """

    def work(step):
        moved = nodes + step * np.outer(heights, normal)
        e_ww, e_vw = membrane_strain(moved[0], moved[1], moved[2], rest)
        return across * e_ww + shear * e_vw

    return work(1.0) - 2.0 * work(0.0) + work(-1.0)


def lift(nodes, rest, across, shear):
    """Stiffnesses (2,) and gradients (2, 3, 3)."""
    stiffness, gradient = np.ones(2), np.ones((2, 3, 3))
    membrane_lift(*nodes, rest, across, shear, stiffness, gradient)
    return stiffness, gradient


@pytest.mark.parametrize(("across", "shear"), STRESSES)
def test_lift_is_the_second_variation_split_by_sign(across, shear):
    nodes, rest, normal = triangle(3)
    stiffness, gradient = lift(nodes, rest, across, shear)
    along = gradient @ normal
    form = np.zeros((3, 3))
    for a in range(3):
        for b in range(3):
            one, two = np.eye(3)[a], np.eye(3)[b]
            plus, minus = (
                second_variation(nodes, rest, normal, across, shear, each)
                for each in (one + two, one - two)
            )
            form[a, b] = 0.25 * (plus - minus)
    assert np.einsum("e,ea,eb->ab", stiffness, along, along) == pytest.approx(form, abs=1e-12)
    assert stiffness[0] >= 0.0 >= stiffness[1]
    expected = np.linalg.eigvalsh(np.array([[0.0, shear], [shear, across]]))
    assert np.sort(stiffness) == pytest.approx(expected, abs=1e-12)


def test_lift_pushes_along_the_normal_only_and_not_on_a_rigid_shift():
    nodes, rest, normal = triangle(4)
    _, gradient = lift(nodes, rest, 1.0, 0.4)
    assert np.abs(gradient).max() > 0.1
    assert np.abs(np.cross(gradient, normal)).max() < 1e-12
    assert np.abs(gradient.sum(axis=1)).max() < 1e-12


def test_a_slack_triangle_has_no_lift():
    nodes, rest, _ = triangle(5)
    stiffness, gradient = lift(nodes, rest, 0.0, 0.0)
    assert not stiffness.any()
    assert not gradient.any()
