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


@pytest.mark.parametrize(("across", "shear"), STRESSES)
def test_lift_is_the_positive_part_of_the_second_variation(across, shear):
    nodes, rest, normal = triangle(3)
    gradient = np.zeros((3, 3))
    stiffness = membrane_lift(*nodes, rest, across, shear, gradient)
    along = gradient @ normal
    form = np.zeros((3, 3))
    for a in range(3):
        for b in range(3):
            one, two = np.eye(3)[a], np.eye(3)[b]
            parts = [
                second_variation(nodes, rest, normal, across, shear, each)
                for each in (one + two, one - two)
            ]
            form[a, b] = 0.25 * (parts[0] - parts[1])
    # one and two as turns of the edge and of the height: a congruence keeps the split
    turns = np.array([[-1.0, 1.0, 0.0], [0.0, 0.0, 0.0]]) * rest[0]
    turns[1] = (np.array([-1.0, 0.0, 1.0]) - rest[1] * turns[0]) * rest[2]
    values, vectors = np.linalg.eigh(np.array([[0.0, shear], [shear, across]]))
    assert form == pytest.approx(
        turns.T @ np.array([[0.0, shear], [shear, across]]) @ turns, abs=1e-12
    )
    line = vectors[:, 1] @ turns
    assert stiffness * np.outer(along, along) == pytest.approx(
        values[1] * np.outer(line, line), abs=1e-12
    )
    assert stiffness >= 0.0


def test_lift_pushes_along_the_normal_only_and_not_on_a_rigid_shift():
    nodes, rest, normal = triangle(4)
    gradient = np.zeros((3, 3))
    membrane_lift(*nodes, rest, 1.0, 0.4, gradient)
    assert np.cross(gradient, normal) == pytest.approx(np.zeros((3, 3)), abs=1e-12)
    assert gradient.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)


def test_a_slack_triangle_has_no_lift():
    nodes, rest, _ = triangle(5)
    gradient = np.ones((3, 3))
    assert membrane_lift(*nodes, rest, 0.0, 0.0, gradient) == 0.0
    assert not gradient.any()
